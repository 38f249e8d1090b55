//! Which patches of a crop become pairs.

use lenslet_core::dictionary;

use super::error::Error;

/// Which patches are taken.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchOptions {
    /// Side of the residual patch, pixels, odd, at most 4 larger than the window; default 9.
    pub patch: usize,
    /// Side of the window whose gradients are the features, odd; default 9. The filters reach two pixels further.
    pub window: usize,
    /// Pairs a crop, at most; default 1000.
    pub per_crop: usize,
    /// Candidates drawn for each pair, 1..=100; default 3. Those with more texture are likelier to stay.
    pub candidates: usize,
    /// Smallest norm of the features, at least 0; default 0.05. Flatter patches are left out.
    pub min_norm: f32,
    /// Whether pairs that hardly differ from an earlier one stay; default no.
    pub keep_near_duplicates: bool,
    /// Seed of places and choices; default 1.
    pub seed: u64,
}

impl Default for PatchOptions {
    fn default() -> Self {
        PatchOptions {
            patch: 9,
            window: 9,
            per_crop: 1000,
            candidates: 3,
            min_norm: 0.05,
            keep_near_duplicates: false,
            seed: 1,
        }
    }
}

impl PatchOptions {
    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<(), Error> {
        let odd = |n: usize| n % 2 == 1 && n + 4 <= dictionary::limits::SIDE;
        if !odd(self.patch) || !odd(self.window) || self.patch > self.window + 4 {
            return Err(Error::Parameter(format!(
                "patches of {} pixels in windows of {}: both must be odd, up to {}, and the patch at most 4 larger",
                self.patch,
                self.window,
                dictionary::limits::SIDE - 4
            )));
        }
        if self.candidates == 0 || self.candidates > 100 || !(self.min_norm >= 0.0) {
            return Err(Error::Parameter("1 to 100 candidates a pair, and a flatness of at least 0".into()));
        }
        Ok(())
    }
}
