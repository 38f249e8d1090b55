//! How the simulated pictures are taken, and which truth is written.

use serde::{Deserialize, Serialize};

use super::error::Error;

/// How to take the pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulationOptions {
    /// Seed of the lenslets' errors and of the noise.
    pub seed: u64,
    /// Strength of the noise: 0 none, 1 one electron a DN and 3 DN of read noise, at most 100.
    pub noise: f64,
    /// Number of white images, 0..=32.
    pub whites: usize,
}

impl Default for SimulationOptions {
    fn default() -> Self {
        SimulationOptions { seed: 1, noise: 0.7, whites: 2 }
    }
}

impl SimulationOptions {
    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first one.
    pub fn check(&self) -> Result<(), Error> {
        if !(0.0..=100.0).contains(&self.noise) {
            return Err(Error::Parameter(format!("the noise must lie in 0..=100, not {}", self.noise)));
        }
        if self.whites > 32 {
            return Err(Error::Parameter(format!("{} white images are too many: at most 32", self.whites)));
        }
        Ok(())
    }
}

/// What truth to write.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthOptions {
    /// Views a row and a column, odd, 1..=15.
    pub views: usize,
    /// Sensor pixels between neighbouring views, above 0, at most 4.
    pub view_step: f64,
    /// Longer side of the views, 16..=8192 pixels.
    pub size: usize,
}

impl Default for TruthOptions {
    fn default() -> Self {
        TruthOptions { views: 7, view_step: 1.0, size: 1080 }
    }
}

impl TruthOptions {
    /// Refuses what cannot be rendered.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first value out of range.
    pub fn check(&self) -> Result<(), Error> {
        let bad = |text: String| Err(Error::Parameter(text));
        if self.views.is_multiple_of(2) || self.views > 15 {
            return bad(format!("the views a side must be odd and at most 15, not {}", self.views));
        }
        if !(self.view_step > 0.0 && self.view_step <= 4.0) {
            return bad(format!("the view step must be over 0 and at most 4, not {}", self.view_step));
        }
        if !(16..=8192).contains(&self.size) {
            return bad(format!("the size of the views must lie in 16..=8192, not {}", self.size));
        }
        Ok(())
    }
}
