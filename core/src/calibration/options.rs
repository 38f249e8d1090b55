//! Options of a calibration. Variants of the centres are for comparison (paper section 5: results without calibration,
//! without sub-pixel precision).

/// How centres are found. Default: [`CalibrationVariant::Full`].
///
/// ```
/// use lenslet_core::calibration::CalibrationVariant;
///
/// assert_eq!("rotation-only".parse(), Ok(CalibrationVariant::RotationOnly));
/// assert_eq!(CalibrationVariant::default().name(), "full");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CalibrationVariant {
    /// All steps, on the unrotated mosaic.
    #[default]
    Full,
    /// The paper's Algorithm 1 as printed: gamma, rotated image, erosion, local maxima, paraboloids.
    Paper,
    /// The default's centres rounded to whole pixels.
    Integer,
    /// An ideal grid of the measured pitch and rotation: no row stretch, no residuals.
    RotationOnly,
    /// An ideal grid whose pitch is a whole number of pixels, not rotated (no calibration).
    None,
}

impl CalibrationVariant {
    /// All of them, the default first.
    pub const ALL: [CalibrationVariant; 5] = [
        CalibrationVariant::Full,
        CalibrationVariant::Paper,
        CalibrationVariant::Integer,
        CalibrationVariant::RotationOnly,
        CalibrationVariant::None,
    ];

    /// Name as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            CalibrationVariant::Full => "full",
            CalibrationVariant::Paper => "paper",
            CalibrationVariant::Integer => "integer",
            CalibrationVariant::RotationOnly => "rotation-only",
            CalibrationVariant::None => "none",
        }
    }
}

impl std::fmt::Display for CalibrationVariant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for CalibrationVariant {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        CalibrationVariant::ALL.into_iter().find(|v| v.name() == text).ok_or_else(|| {
            let names: Vec<&str> = CalibrationVariant::ALL.iter().map(|v| v.name()).collect();
            format!("`{text}` is not a variant; expected one of {}", names.join(", "))
        })
    }
}

/// How a camera is calibrated; the defaults are [`CalibrationVariant::Full`], with vignetting, no hot pixels, no names.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CalibrationOptions {
    /// Which centres the calibration holds.
    pub variant: CalibrationVariant,
    /// Leave out the vignetting pattern (centres only; takes less time).
    pub without_vignetting: bool,
    /// Pixels to leave out, as [`find_hot_pixels`](crate::calibration::find_hot_pixels) finds them in black images:
    /// `y·width + x`, ascending, at most one in a hundred.
    pub hot_pixels: Vec<u32>,
    /// Names of the images in notes, in their order; images without a name are called `image 1`, `image 2` …
    pub names: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back() {
        for v in CalibrationVariant::ALL {
            assert_eq!(v.to_string().parse(), Ok(v));
        }
        assert!("x".parse::<CalibrationVariant>().unwrap_err().contains("rotation-only"));
    }
}
