//! What real optics and sensors do and an ideal lenslet camera does not. Everything is off by default.

use serde::{Deserialize, Serialize};

use super::error::Error;

/// Departures of a camera from the ideal one. [`Imperfections::default`] has none, [`Imperfections::real`] all of them
/// in a strength that real cameras have; both ends of every range are allowed.
///
/// ```
/// use lenslet_data_gen::simulate::Imperfections;
/// let mut list = Imperfections::default();
/// list.set("pupil-shift=0.2")?;
/// list.set("cats-eye")?;
/// assert_eq!(list, Imperfections { pupil_shift: 0.2, cats_eye: 0.5, ..Imperfections::default() });
/// assert!(list.set("fog").is_err());
/// # Ok::<(), lenslet_data_gen::simulate::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Imperfections {
    /// Distance between a micro-image's centre of light and the centre of its lenslet in the corners of the sensor,
    /// outwards, in pitches, −0.5..=0.5; it grows in proportion to the distance from the middle of the sensor. The main
    /// lens's pupil is not infinitely far away. Default 0; when named 0.1.
    pub pupil_shift: f64,
    /// Cat's-eye vignetting: in the corners of the sensor a second round aperture, as large as the first, lies this far
    /// from the middle of the micro-image, in half pitches, 0..=1; in proportion to the distance from the middle of the
    /// sensor. Default 0; when named 0.5.
    pub cats_eye: f64,
    /// The white images' pupil shift minus the capture's, pitches in the corners, −0.5..=0.5: the white images were
    /// taken at another zoom. Default 0; when named 0.05.
    pub white_shift: f64,
    /// The white images' micro-images over the capture's, diameters, 0.5..=1.5. Default 1; when named 0.95.
    pub white_size: f64,
    /// Standard deviation of the lenslets' optical blur, as a share of that blur, 0..=0.3; every lenslet has its own
    /// blur on the sensor, half to one and a half times [`Optics::psf`](super::Optics::psf). Default 0; when named 0.15.
    pub focal_spot: f64,
    /// Share of a pixel's signal that each of its four neighbours receives, 0..=0.1. Default 0; when named 0.01.
    pub crosstalk: f64,
    /// Share of full scale above which the response of the sensor bends: what lies above the knee k comes out as
    /// `k + (1 − k)·(1 − exp(−(s − k)/(1 − k)))`; 0.1..=1. Default 1, no bend; when named 0.8.
    pub saturation: f64,
    /// The capture is saved as an 8-bit grey JPEG of this quality, 1..=100; white images are not. Default none; when
    /// named 95.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jpeg: Option<u8>,
}

impl Default for Imperfections {
    fn default() -> Self {
        Imperfections {
            pupil_shift: 0.0,
            cats_eye: 0.0,
            white_shift: 0.0,
            white_size: 1.0,
            focal_spot: 0.0,
            crosstalk: 0.0,
            saturation: 1.0,
            jpeg: None,
        }
    }
}

impl Imperfections {
    /// Names that [`Imperfections::set`] knows; `other-zoom` stands for `white-shift` and `white-size`, `real` for all,
    /// `ideal` for none.
    pub const NAMES: [&'static str; 11] = [
        "pupil-shift",
        "cats-eye",
        "white-shift",
        "white-size",
        "focal-spot",
        "crosstalk",
        "saturation",
        "jpeg",
        "other-zoom",
        "real",
        "ideal",
    ];

    /// All of them. The values are chosen: a pupil 30 mm before an F01's sensor shifts its micro-images by a tenth of a
    /// pitch in the corners; the others are about as strong as the white images and JPEG mosaics of F01 cameras show.
    pub fn real() -> Imperfections {
        Imperfections {
            pupil_shift: 0.1,
            cats_eye: 0.5,
            white_shift: 0.05,
            white_size: 0.95,
            focal_spot: 0.15,
            crosstalk: 0.01,
            saturation: 0.8,
            jpeg: Some(95),
        }
    }

    /// Whether there are none.
    pub fn is_ideal(&self) -> bool {
        *self == Imperfections::default()
    }

    /// Switches one on: `NAME` in the strength of [`Imperfections::real`], or `NAME=VALUE`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a name that is not in [`Imperfections::NAMES`] or a value out of range.
    pub fn set(&mut self, text: &str) -> Result<(), Error> {
        let (name, value) = match text.split_once('=') {
            Some((name, value)) => {
                let number = value.trim().parse::<f64>();
                (name.trim(), Some(number.map_err(|_| Error::Parameter(format!("{name}: {value} is no number")))?))
            }
            None => (text.trim(), None),
        };
        let real = Imperfections::real();
        match name {
            "pupil-shift" => self.pupil_shift = value.unwrap_or(real.pupil_shift),
            "cats-eye" => self.cats_eye = value.unwrap_or(real.cats_eye),
            "white-shift" => self.white_shift = value.unwrap_or(real.white_shift),
            "white-size" => self.white_size = value.unwrap_or(real.white_size),
            "focal-spot" => self.focal_spot = value.unwrap_or(real.focal_spot),
            "crosstalk" => self.crosstalk = value.unwrap_or(real.crosstalk),
            "saturation" => self.saturation = value.unwrap_or(real.saturation),
            "jpeg" => {
                self.jpeg = match value {
                    None => real.jpeg,
                    Some(q) if q.fract() == 0.0 && (1.0..=100.0).contains(&q) => Some(q as u8),
                    Some(q) => return Err(Error::Parameter(format!("the JPEG quality must be 1 to 100, not {q}"))),
                }
            }
            "other-zoom" if value.is_none() => {
                (self.white_shift, self.white_size) = (real.white_shift, real.white_size);
            }
            "real" if value.is_none() => *self = real,
            "ideal" if value.is_none() => *self = Imperfections::default(),
            _ => {
                return Err(Error::Parameter(format!(
                    "no optics `{text}`: one of {}",
                    Imperfections::NAMES.join(", ")
                )));
            }
        }
        self.check()
    }

    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first one.
    pub fn check(&self) -> Result<(), Error> {
        let within = |name: &str, value: f64, low: f64, high: f64| {
            if value >= low && value <= high {
                Ok(())
            } else {
                Err(Error::Parameter(format!("{name} must lie in {low}..={high}, not {value}")))
            }
        };
        within("the pupil shift (pitches)", self.pupil_shift, -0.5, 0.5)?;
        within("the cat's eye (half pitches)", self.cats_eye, 0.0, 1.0)?;
        within("the white images' pupil shift (pitches)", self.white_shift, -0.5, 0.5)?;
        within("the size of the white images' micro-images", self.white_size, 0.5, 1.5)?;
        within("the spread of focal spots", self.focal_spot, 0.0, 0.3)?;
        within("the crosstalk", self.crosstalk, 0.0, 0.1)?;
        within("the saturation knee", self.saturation, 0.1, 1.0)?;
        within("the JPEG quality", self.jpeg.map_or(1.0, f64::from), 1.0, 100.0)
    }
}

impl std::str::FromStr for Imperfections {
    type Err = Error;

    /// A list of names with or without values, separated by commas, each as [`Imperfections::set`] takes it.
    fn from_str(text: &str) -> Result<Self, Error> {
        let mut all = Imperfections::default();
        text.split(',').try_for_each(|one| all.set(one))?;
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_switch_on_what_they_name() {
        let all: Imperfections =
            "pupil-shift,cats-eye,other-zoom,focal-spot,crosstalk,saturation,jpeg".parse().unwrap();
        assert_eq!(all, Imperfections::real());
        assert_eq!("real,jpeg=50".parse::<Imperfections>().unwrap().jpeg, Some(50));
        assert!("ideal".parse::<Imperfections>().unwrap().is_ideal());
        for bad in ["", "fog", "jpeg=0", "jpeg=9.5", "crosstalk=2", "cats-eye=x", "real=1", "saturation=nan"] {
            assert!(matches!(bad.parse::<Imperfections>(), Err(Error::Parameter(_))), "{bad}");
        }
    }
}
