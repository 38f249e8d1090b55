//! The part of a view that one sample averages.

use std::f64::consts::PI;

/// The part of a view that one sample averages; sizes in pixels of the target view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SampleFootprint {
    /// The picture at one place.
    Point,
    /// The mean over a rectangle of pixels, each itself a mean over its own area: a pixel that an enlargement replaces by
    /// `width`×`height` pixels.
    Box {
        /// Width, pixels.
        width: f64,
        /// Height, pixels.
        height: f64,
    },
    /// The mean over a disc, as a lenslet gathers: its diameter is one pitch.
    Disc {
        /// Diameter, pixels.
        diameter: f64,
    },
    /// A Gaussian mean.
    Gaussian {
        /// Standard deviation, pixels.
        sigma: f64,
    },
}

impl SampleFootprint {
    /// Share of a wave of frequency (`fx`, `fy`), cycles a pixel, that the mean keeps.
    #[must_use]
    pub fn transfer(&self, fx: f64, fy: f64) -> f64 {
        match *self {
            SampleFootprint::Point => 1.0,
            SampleFootprint::Box { width, height } => sinc(width * fx) / sinc(fx) * sinc(height * fy) / sinc(fy),
            SampleFootprint::Disc { diameter } => disc_transfer(diameter * fx.hypot(fy)),
            SampleFootprint::Gaussian { sigma } => (-2.0 * (PI * sigma).powi(2) * (fx * fx + fy * fy)).exp(),
        }
    }

    /// Half its larger side, pixels; of a Gaussian two and a half standard deviations.
    #[must_use]
    pub fn reach(&self) -> f64 {
        match *self {
            SampleFootprint::Point => 0.0,
            SampleFootprint::Box { width, height } => width.max(height) / 2.0,
            SampleFootprint::Disc { diameter } => diameter / 2.0,
            SampleFootprint::Gaussian { sigma } => 2.5 * sigma,
        }
    }
}

/// sin(πx)/(πx).
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// Transfer of a disc of diameter 1: 2·J₁(πf)/(πf) = 2/π ∫ √(1−t²) cos(πft) dt over −1..1, by Gauss–Chebyshev quadrature.
fn disc_transfer(f: f64) -> f64 {
    const NODES: usize = 24;
    let node = |k: usize| PI * k as f64 / (NODES + 1) as f64;
    let sum: f64 = (1..=NODES).map(|k| node(k).sin().powi(2) * (PI * f * node(k).cos()).cos()).sum();
    2.0 * sum / (NODES + 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_passes_no_wave_at_the_first_zero_of_its_bessel_function() {
        // The first zero of J1 is at 3.8317; J1(1) = 0.440051.
        assert!(disc_transfer(3.831_706 / PI).abs() < 1e-6);
        assert!((disc_transfer(1.0 / PI) - 2.0 * 0.440_050_6).abs() < 1e-6);
        assert!((disc_transfer(0.0) - 1.0).abs() < 1e-12);
    }
}
