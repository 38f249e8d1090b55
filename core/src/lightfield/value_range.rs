//! The range of an array's numbers: which stored value is 1.0, and that all of them are numbers.
//!
//! Integers of 8 and 16 bit are full scale at their largest value, floating point at 1. Arrays of other programs often
//! hold 8-bit codes in floating point, or 10-bit codes in 16-bit integers: the numbers themselves are looked at.

use std::path::Path;

use ndarray::Array3;

use super::error::{Error, malformed, unsupported};
use super::image_file;
use super::meta::MAX_VIEW_VALUES;
use super::sample::{SampleFormat, SampleKind};

/// Largest value of floating point that is taken for 0..1: sharpened and linear views pass 1 by less.
/// Source: chosen.
const UNIT: f64 = 1.5;
/// Least largest value of floating point that is taken for codes of 8 bits; between it and [`UNIT`] all is possible.
/// Source: chosen.
const LEAST_CODE: f64 = 8.0;
/// Most negative value of floating point that rounding and sharpening make.
/// Source: chosen.
const UNDERSHOOT: f64 = -0.5;
/// Largest value of 16-bit integers that look like codes of fewer bits.
/// Source: 12-bit sensors.
const FEW_BITS: f64 = 4095.0;

/// What the stored numbers are like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    least: f64,
    most: f64,
    /// Numbers looked at, and how many of them are not finite.
    count: u64,
    bad: u64,
    /// The first of these.
    first_bad: u64,
}

impl Default for Extent {
    fn default() -> Self {
        Extent { least: f64::INFINITY, most: f64::NEG_INFINITY, count: 0, bad: 0, first_bad: 0 }
    }
}

impl Extent {
    /// Whether the numbers of this kind say something that their kind does not.
    pub(super) fn matters(kind: SampleKind) -> bool {
        matches!(kind, SampleKind::F32 | SampleKind::F64 | SampleKind::U16)
    }

    /// Adds numbers as stored.
    pub(super) fn add(&mut self, number: SampleFormat, bytes: &[u8]) {
        match (number.kind, number.big_endian) {
            (SampleKind::F32, false) => {
                bytes.as_chunks().0.iter().for_each(|&b| self.add_one(f64::from(f32::from_le_bytes(b))));
            }
            (SampleKind::U16, false) => {
                bytes.as_chunks().0.iter().for_each(|&b| self.add_one(f64::from(u16::from_le_bytes(b))));
            }
            _ => bytes.chunks_exact(number.kind.bytes()).for_each(|b| self.add_one(number.read(b))),
        }
    }

    #[inline]
    fn add_one(&mut self, x: f64) {
        if x.is_finite() {
            self.least = self.least.min(x);
            self.most = self.most.max(x);
        } else {
            if self.bad == 0 {
                self.first_bad = self.count;
            }
            self.bad += 1;
        }
        self.count += 1;
    }
}

/// The stored value of 1.0, and a note where it was inferred. `wanted`: stated by the user; `place`: names a number of
/// the array by its position.
pub(super) fn full_scale(
    path: &Path,
    kind: SampleKind,
    extent: &Extent,
    wanted: Option<f32>,
    place: impl Fn(u64) -> String,
) -> Result<(f32, Option<String>), Error> {
    if extent.bad > 0 {
        let reason = format!(
            "{} of its {} numbers are not finite (NaN or infinite), the first at {}",
            extent.bad,
            extent.count,
            place(extent.first_bad)
        );
        return Err(malformed(path, reason));
    }
    let (least, most) = (extent.least, extent.most);
    let floating = matches!(kind, SampleKind::F32 | SampleKind::F64);
    if let Some(full) = wanted {
        let over = f64::from(full) * if floating { UNIT } else { 1.0 };
        if most > over {
            return Err(unsupported(path, format!("values up to {most}, more than the {full} of --full-scale")));
        }
        return Ok((full, None));
    }
    let full = kind.full_scale().unwrap_or(1.0);
    let state = "state the value of white with --full-scale";
    if !floating {
        let few = kind == SampleKind::U16 && most > 0.0 && most <= FEW_BITS;
        let bits = [(255.0, 8), (1023.0, 10), (FEW_BITS, 12)].into_iter().find(|(code, _)| most <= *code);
        let note = bits.filter(|_| few).map(|(code, bits)| {
            format!(
                "{}: its largest value is {most} of 65535, so that it is dark; if these are {bits}-bit numbers, give \
                 --full-scale {code}",
                path.display()
            )
        });
        return Ok((full, note));
    }
    let codes = |full: f32| {
        let note = format!("{}: values up to {most} are taken for 0..{full}; {state} if it is another", path.display());
        Ok((full, Some(note)))
    };
    if least < UNDERSHOOT && most <= UNIT {
        let reason = format!("values from {least} to {most}, which are not 0..1; bring them to 0..1 first");
        return Err(unsupported(path, reason));
    }
    if most <= UNIT {
        return Ok((full, None));
    }
    if least >= -LEAST_CODE && (LEAST_CODE..=255.5).contains(&most) {
        return codes(255.0);
    }
    if least >= -LEAST_CODE && (FEW_BITS + 0.5..=65535.5).contains(&most) {
        return codes(65535.0);
    }
    let reason = format!("values from {least} to {most}, which may be 0..255, 0..1023, 0..4095 or more; {state}");
    Err(unsupported(path, reason))
}

/// The range of the values of pictures: those of 16 bits may hold codes of fewer.
#[derive(Debug, Clone, Default)]
pub(super) struct PictureRange {
    /// Factor on values 0..1, where it is not 1.
    factor: Option<f32>,
    /// What there is to say.
    pub(super) note: Option<String>,
}

impl PictureRange {
    /// By the picture `path`, one of its kind; `wanted`: the code of white as stated by the user.
    pub(super) fn of(path: &Path, wanted: Option<f32>) -> Result<Self, Error> {
        if wanted.is_none() && !image_file::has_sixteen_bits(path)? {
            return Ok(PictureRange::default());
        }
        let (bytes, number, _) = image_file::read_stored(path, MAX_VIEW_VALUES)?;
        let mut extent = Extent::default();
        extent.add(number, &bytes);
        let (full, note) = full_scale(path, number.kind, &extent, wanted, |k| format!("value {k}"))?;
        let usual = number.kind.full_scale().unwrap_or(1.0);
        Ok(PictureRange { factor: (full != usual).then_some(usual / full), note })
    }

    /// Values 0..1 of the pictures' own type, on this range.
    pub(super) fn apply(&self, mut view: Array3<f32>) -> Array3<f32> {
        if let Some(factor) = self.factor {
            view.mapv_inplace(|x| x * factor);
        }
        view
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(kind: SampleKind, values: &[f64], wanted: Option<f32>) -> Result<(f32, Option<String>), Error> {
        let mut extent = Extent::default();
        values.iter().for_each(|&v| extent.add_one(v));
        full_scale(Path::new("x"), kind, &extent, wanted, |k| format!("number {k}"))
    }

    #[test]
    fn floating_point_is_unit_or_codes_or_refused() {
        assert_eq!(of(SampleKind::F32, &[-0.02, 1.1], None).unwrap(), (1.0, None));
        for (most, full) in [(200.0, 255.0), (255.0, 255.0), (60_000.0, 65535.0)] {
            let (found, note) = of(SampleKind::F64, &[0.0, most], None).unwrap();
            assert!(found == full && note.unwrap().contains("--full-scale"), "{most}");
        }
        for odd in [[0.0, 3.0], [0.0, 700.0], [0.0, 1e6], [-1.0, 1.0]] {
            assert!(of(SampleKind::F32, &odd, None).is_err(), "{odd:?}");
        }
        assert_eq!(of(SampleKind::F32, &[0.0, 700.0], Some(1023.0)).unwrap(), (1023.0, None));
        assert!(of(SampleKind::F32, &[0.0, 3000.0], Some(1023.0)).is_err());
    }

    #[test]
    fn few_bits_in_sixteen_are_noted() {
        assert_eq!(of(SampleKind::U16, &[0.0, 50_000.0], None).unwrap(), (65535.0, None));
        let (full, note) = of(SampleKind::U16, &[0.0, 1023.0], None).unwrap();
        assert!(full == 65535.0 && note.unwrap().contains("--full-scale 1023"));
        assert_eq!(of(SampleKind::U16, &[0.0, 1023.0], Some(1023.0)).unwrap(), (1023.0, None));
        assert!(of(SampleKind::U16, &[0.0, 1024.0], Some(1023.0)).is_err());
    }

    #[test]
    fn what_is_no_number_is_counted_and_placed() {
        let error = of(SampleKind::F32, &[0.0, f64::NAN, 1.0, f64::INFINITY], None).unwrap_err().to_string();
        assert!(error.contains("2 of its 4") && error.contains("number 1"), "{error}");
    }
}
