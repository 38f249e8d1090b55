//! The header of a `.calib` file, what its payload holds, and whether the header's numbers are possible.

use serde::{Deserialize, Serialize};

use crate::calibration::model::{CalibrationOrigin, CalibrationQuality, Lattice, Lenslet};
use crate::calibration::photometric::hot_pixels::PIXELS_PER_HOT_PIXEL;

/// Longest sensor side accepted, pixels.
const LARGEST_SIDE: usize = 1 << 16;
/// Most sensor pixels accepted.
const MOST_PIXELS: usize = 1 << 29;

/// The JSON header.
#[derive(Debug, Serialize, Deserialize)]
pub struct Header {
    pub program: String,
    pub width: usize,
    pub height: usize,
    pub lattice: Lattice,
    pub lenslets: usize,
    #[serde(default)]
    pub hot_pixels: usize,
    pub vignetting: Option<[usize; 2]>,
    pub quality: CalibrationQuality,
    pub origin: CalibrationOrigin,
    pub payload_bytes: usize,
    pub payload_sha256: String,
}

/// Number of figures stored as f64: origin, a, b; the five of the quality.
pub const FIGURES: usize = 11;

/// The figures, in the order they are stored in.
pub fn figures(lattice: &Lattice, quality: &CalibrationQuality) -> [f64; FIGURES] {
    let (o, a, b, q) = (lattice.origin, lattice.a, lattice.b, quality);
    [o[0], o[1], a[0], a[1], b[0], b[1], q.residual_rms, q.scatter, q.noise, q.rejected, q.confidence]
}

/// What a payload holds besides the figures.
pub struct Payload {
    pub lenslets: Vec<Lenslet>,
    pub hot_pixels: Vec<u32>,
    pub white: Vec<u16>,
}

/// Pixels of the white image (0 without one).
///
/// # Errors
/// Sizes that no sensor has, or that contradict each other.
pub fn white_pixels(header: &Header) -> Result<usize, &'static str> {
    let size = |w: usize, h: usize| {
        ((1..=LARGEST_SIDE).contains(&w) && (1..=LARGEST_SIDE).contains(&h) && w * h <= MOST_PIXELS).then_some(w * h)
    };
    let sensor = size(header.width, header.height).ok_or("its sensor size is impossible")?;
    if header.lenslets > sensor / 4 {
        return Err("it has more lenslets than its sensor has room for");
    }
    let pixels = match header.vignetting {
        Some([w, h]) if [w, h] == [header.width, header.height] => sensor,
        Some(_) => return Err("its white image is not of its sensor's size"),
        None => 0,
    };
    if header.hot_pixels > sensor / PIXELS_PER_HOT_PIXEL {
        return Err("it has more hot pixels than a sensor may have");
    }
    Ok(pixels)
}

/// Refuses a lattice whose vectors are not finite or enclose less than a pixel.
pub fn check_lattice(l: &Lattice) -> Result<(), &'static str> {
    let numbers = [l.origin, l.a, l.b];
    let det = l.a[0] * l.b[1] - l.a[1] * l.b[0];
    if !numbers.iter().flatten().all(|v| v.is_finite() && v.abs() < 1e6) || det.abs() <= 1.0 {
        return Err("its lattice is impossible");
    }
    Ok(())
}

/// The `k`th N-byte item of a slice that has it.
pub fn item_bytes<const N: usize>(from: &[u8], k: usize) -> [u8; N] {
    std::array::from_fn(|b| from[k * N + b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_lattices_are_refused() {
        let good = Lattice::hexagonal(10.0, 0.003, 1.0, [500.0, 400.0]);
        assert!(check_lattice(&good).is_ok());
        for wrong in [f64::NAN, f64::INFINITY, 1e6, -1e6] {
            for k in 0..6 {
                let mut bad = good;
                match k / 2 {
                    0 => bad.origin[k % 2] = wrong,
                    1 => bad.a[k % 2] = wrong,
                    _ => bad.b[k % 2] = wrong,
                }
                assert!(check_lattice(&bad).is_err(), "{bad:?}");
            }
        }
        let cell = |height: f64| Lattice { a: [2.0, 0.0], b: [5.0, height], ..good };
        assert!(check_lattice(&cell(0.5)).is_err() && check_lattice(&cell(-0.5)).is_err());
        assert!(check_lattice(&cell(0.51)).is_ok() && check_lattice(&cell(-0.51)).is_ok());
    }
}
