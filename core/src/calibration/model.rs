//! The calibration model, input of every later step: lattice, lenslet centres, vignetting, quality.

use serde::{Deserialize, Serialize};

use crate::geometry::Size;
pub use crate::geometry::{Grid, Lattice};

/// One lenslet whose centre lies on the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lenslet {
    /// Lattice index along `a`.
    pub i: i32,
    /// Lattice index along `b`.
    pub j: i32,
    /// Centre x, sensor pixels.
    pub x: f64,
    /// Centre y, sensor pixels.
    pub y: f64,
    /// Weight of the measurement in the centre: 0 = lattice prediction only, 1 = measurement only.
    pub trust: f32,
}

/// The white image that decoding divides by, normalised so that a lenslet centre under full illumination is 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Vignetting {
    /// Width of `white`, pixels.
    pub width: usize,
    /// Height of `white`, pixels.
    pub height: usize,
    /// Light after black level and response of each colour, `width·height` values, row-major, as u16 = value·32768.
    pub white: Vec<u16>,
}

/// Quality figures of a calibration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationQuality {
    /// RMS distance of measured centres from the lattice, pixels.
    pub residual_rms: f64,
    /// Scatter of the lenslets themselves about the lattice (measurement noise subtracted), per axis, pixels.
    #[serde(default)]
    pub scatter: f64,
    /// Typical standard deviation of one measured centre, per axis, pixels.
    #[serde(default)]
    pub noise: f64,
    /// Share of lenslets whose measurement was rejected, 0 to 1.
    pub rejected: f64,
    /// Confidence, 0 to 1: coherence of the pattern's phases, times 1 − 1/√(prominence of its spectral peaks), times
    /// the share of lenslets accepted.
    pub confidence: f64,
}

impl CalibrationQuality {
    /// Confidence, 0 to 1, of the coherence of the phases (0 to 1), the prominence of the spectral peaks, and the share
    /// of lenslets accepted.
    pub(super) fn confidence_of(coherence: f64, prominence: f64, accepted: f64) -> f64 {
        let peak = 1.0 - 1.0 / prominence.max(1.0).sqrt();
        (coherence * peak * accepted).clamp(0.0, 1.0)
    }
}

/// What a calibration was made from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationOrigin {
    /// How it was made: `white` or `captures`, followed by the variant in brackets unless it is the default.
    pub method: String,
    /// Camera model, if known.
    pub model: Option<String>,
    /// Camera serial number, if known.
    pub serial: Option<String>,
    /// Zoom stepper position, if known.
    pub zoom_step: Option<i64>,
    /// Focus stepper position, if known.
    pub focus_step: Option<i64>,
    /// sha256 of each source file.
    pub sources: Vec<String>,
}

/// A calibrated camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Sensor width in pixels.
    pub width: usize,
    /// Sensor height in pixels.
    pub height: usize,
    /// The regular lattice.
    pub lattice: Lattice,
    /// Every lenslet with its centre on the sensor, sorted by (j, i).
    pub lenslets: Vec<Lenslet>,
    /// Quality figures.
    pub quality: CalibrationQuality,
    /// White image for vignetting, if known.
    pub vignetting: Option<Vignetting>,
    /// Hot pixels, bright without light in black images: `y·width + x`, ascending.
    pub hot_pixels: Vec<u32>,
    /// Provenance.
    pub origin: CalibrationOrigin,
}

impl Calibration {
    /// A camera of which only the lattice is known: every lenslet of a sensor of this `size` at its regular place.
    ///
    /// ```
    /// use lenslet_core::calibration::{Calibration, Lattice};
    /// use lenslet_core::geometry::Size;
    /// let lattice = Lattice::hexagonal(10.0, 0.003, 1.0, [60.2, 59.7]);
    /// let camera = Calibration::of_lattice(lattice, Size::new(120, 120));
    /// assert!(camera.lenslets.iter().all(|l| [l.x, l.y] == camera.lattice.centre(l.i, l.j)));
    /// ```
    #[must_use]
    pub fn of_lattice(lattice: Lattice, size: Size) -> Self {
        let points = lattice.points_within(size, 0.0);
        let lenslet = |(&[i, j], &[x, y]): (&[i32; 2], &[f64; 2])| Lenslet { i, j, x, y, trust: 1.0 };
        Calibration {
            width: size.width,
            height: size.height,
            lattice,
            lenslets: points.index.iter().zip(&points.centres).map(lenslet).collect(),
            quality: CalibrationQuality::default(),
            vignetting: None,
            hot_pixels: Vec::new(),
            origin: CalibrationOrigin::default(),
        }
    }

    /// Lenslet centres (x, y) in sensor pixels (x right, y down, pixel centres at integers), sorted by (j, i).
    pub fn centres(&self) -> impl ExactSizeIterator<Item = [f64; 2]> {
        self.lenslets.iter().map(|l| [l.x, l.y])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_is_a_product_of_shares() {
        // 0.5 · (1 − 1/√4) · 0.8.
        assert!((CalibrationQuality::confidence_of(0.5, 4.0, 0.8) - 0.2).abs() < 1e-12);
        assert_eq!(CalibrationQuality::confidence_of(1.0, 0.5, 1.0), 0.0);
        assert_eq!(CalibrationQuality::confidence_of(-0.5, 100.0, 1.0), 0.0);
        assert!((CalibrationQuality::confidence_of(1.0, 1e12, 1.0) - 1.0).abs() < 1e-5);
    }
}
