//! Camera profiles: a camera is data (one TOML file of `core/profiles`), not code.

use std::path::Path;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use super::cfa::Cfa;
use super::error::Error;
use super::facts::{ColourFacts, Levels, MAX_SIDE, MlaHint, ccm_valid, gains_valid};
use super::file;
use super::packing::Packing;

/// Longest profile file read, bytes.
const MAX_FILE: u64 = 1 << 20;

// `EMBEDDED`: the text of every file of `core/profiles`, made by `core/build.rs`.
include!(concat!(env!("OUT_DIR"), "/profiles.rs"));

/// The facts of a camera model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraProfile {
    /// Version of this format, 1.
    pub format: u32,
    /// Its name on the command line, e.g. `lytro-f01`.
    pub name: String,
    /// Maker.
    #[serde(default)]
    pub make: Option<String>,
    /// Model names that its captures have in their metadata, the usual one first.
    #[serde(default)]
    pub models: Vec<String>,
    /// Other names of the same model, e.g. that in its white images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Whether mosaics without any camera facts are read as this camera's; set in exactly one profile. Default: no.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fallback: bool,
    /// Whether its captures contain their white image. Default: no.
    #[serde(default)]
    pub white_inside: bool,
    /// The sensor.
    pub sensor: Sensor,
    /// The micro-lens array, as a first guess for calibration.
    #[serde(default)]
    pub lenslets: Option<MlaHint>,
    /// Colour facts for captures without them.
    #[serde(default)]
    pub colour: Option<ColourFacts>,
    /// Figures measured on one body; a simulated camera of this model has them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<MeasuredBody>,
}

/// Figures of one body of a model; bodies of a model differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredBody {
    /// Its micro-lens array.
    pub lenslets: MlaHint,
    /// Its white balance gains of R, Gr, Gb, B in daylight.
    pub white_balance: [f32; 4],
    /// Its matrix from camera RGB to linear sRGB, row-major.
    pub ccm: [f32; 9],
}

/// A sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// How raw files are packed.
    pub packing: Packing,
    /// Colour filter array.
    pub cfa: Cfa,
    /// Black level of R, Gr, Gb, B (DN).
    pub black: [f32; 4],
    /// White level of R, Gr, Gb, B (DN).
    pub white: [f32; 4],
    /// Pixel pitch in metres.
    #[serde(default)]
    pub pixel_pitch: Option<f64>,
    /// Stops to add to the exposure bias that its files state (`modulationExposureBias`).
    #[serde(default)]
    pub exposure_offset: f64,
}

impl CameraProfile {
    /// The sensor's levels.
    pub fn levels(&self) -> Levels {
        Levels { black: self.sensor.black, white: self.sensor.white }
    }

    /// The colour facts, neutral where the profile has none.
    pub fn colour(&self) -> ColourFacts {
        self.colour.clone().unwrap_or_else(ColourFacts::neutral)
    }

    /// Bytes of a packed raw image.
    pub fn raw_bytes(&self) -> Option<usize> {
        self.sensor.packing.bytes(self.sensor.width.checked_mul(self.sensor.height)?)
    }

    /// Whether `model` is one of this camera's names: its models and aliases, in any case, spaces around it left out.
    pub fn is_called(&self, model: &str) -> bool {
        self.models.iter().chain(&self.aliases).any(|m| m.eq_ignore_ascii_case(model.trim()))
    }

    fn check(&self) -> Result<(), String> {
        if self.format != 1 {
            return Err(format!(
                "profile format {} is newer than the 1 this program knows; update lenslet",
                self.format
            ));
        }
        let side = |n: usize| (16..=MAX_SIDE).contains(&n);
        if !side(self.sensor.width) || !side(self.sensor.height) {
            return Err(format!("sensor size must be 16 to {MAX_SIDE} pixels a side"));
        }
        if self.sensor.exposure_offset.is_nan() || self.sensor.exposure_offset.abs() > 8.0 {
            return Err("exposure_offset must lie within 8 stops".into());
        }
        let l = self.levels();
        if !l.is_valid() || l.white.iter().any(|w| *w > f32::from(self.sensor.packing.max())) {
            return Err("levels must be 0 <= black < white <= the largest value of the packing".into());
        }
        let lenslets = self.lenslets.iter().chain(self.measured.iter().map(|m| &m.lenslets));
        if !lenslets.into_iter().all(MlaHint::is_valid) {
            return Err("lenslets: pitch must be 2 to 500 pixels, rotation within ±π, row_stretch 0.5 to 2".into());
        }
        let gains = self.measured.as_ref().is_none_or(|m| gains_valid(&m.white_balance) && ccm_valid(&m.ccm));
        if !gains || self.colour.as_ref().is_some_and(|c| !c.is_valid()) {
            return Err("colour: gains must be positive, all numbers finite and below 1000".into());
        }
        Ok(())
    }

    /// Reads a profile from TOML text.
    ///
    /// # Errors
    /// A line that says what is wrong: not TOML, an unknown key, a value out of range.
    pub fn from_toml(text: &str) -> Result<CameraProfile, String> {
        let profile: CameraProfile = toml::from_str(text).map_err(|e| e.message().to_string())?;
        profile.check()?;
        Ok(profile)
    }

    /// The profiles that come with the program (the files of `core/profiles`), in order of name.
    pub fn built_in() -> &'static [CameraProfile] {
        static PROFILES: OnceLock<Vec<CameraProfile>> = OnceLock::new();
        PROFILES.get_or_init(|| EMBEDDED.iter().filter_map(|text| Self::from_toml(text).ok()).collect())
    }

    /// The built-in profile of a model, by any of its names.
    ///
    /// ```
    /// use lenslet_core::container::CameraProfile;
    ///
    /// let illum = CameraProfile::of_model("b01").expect("the Illum's white images call it B01");
    /// assert_eq!((illum.name.as_str(), illum.sensor.width), ("lytro-illum", 7728));
    /// ```
    pub fn of_model(model: &str) -> Option<&'static CameraProfile> {
        Self::built_in().iter().find(|p| p.is_called(model))
    }

    /// The built-in profile for mosaics without any camera facts.
    pub fn fallback() -> Option<&'static CameraProfile> {
        let all = Self::built_in();
        all.iter().find(|p| p.fallback).or(all.first())
    }

    /// The built-in profile of a name (`lytro-f01`), or that of a TOML file at a path.
    ///
    /// # Errors
    /// When there is no such profile, or the file is not a valid one.
    ///
    /// ```
    /// use lenslet_core::container::CameraProfile;
    ///
    /// let f01 = CameraProfile::find("lytro-f01")?;
    /// assert_eq!(f01.raw_bytes(), Some(3280 * 3280 * 3 / 2)); // 12 bit per pixel
    /// assert!(CameraProfile::find("nikon").is_err());
    /// # Ok::<(), lenslet_core::container::Error>(())
    /// ```
    pub fn find(name: &str) -> Result<CameraProfile, Error> {
        let known = Self::built_in();
        if let Some(p) = known.iter().find(|p| p.name == name) {
            return Ok(p.clone());
        }
        let path = Path::new(name);
        if !(path.is_file() || name.ends_with(".toml") || path.components().count() > 1) {
            let names: Vec<_> = known.iter().map(|p| p.name.as_str()).collect();
            return Err(Error::Parameter(format!(
                "no camera profile is called `{name}`; known are {}, or give the path of a .toml file",
                names.join(", ")
            )));
        }
        let bytes = file::read(path, "a camera profile", MAX_FILE)?;
        let text =
            std::str::from_utf8(&bytes).map_err(|_| Error::malformed(path, "not a camera profile: not UTF-8 text"))?;
        Self::from_toml(text).map_err(|e| Error::malformed(path, format!("not a camera profile: {e}")))
    }
}

/// Whether two model names are of one camera model: equal but for case and spaces around them, or two names of one
/// built-in profile.
///
/// ```
/// use lenslet_core::container::same_model;
///
/// assert!(same_model("Illum", "B01 ") && same_model("x99", "X99") && !same_model("F01", "B01"));
/// ```
pub fn same_model(first: &str, second: &str) -> bool {
    first.trim().eq_ignore_ascii_case(second.trim())
        || CameraProfile::of_model(first).is_some_and(|p| p.is_called(second))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_profiles_are_valid() {
        let all = CameraProfile::built_in();
        assert_eq!(all.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["lytro-f01", "lytro-illum"]);
        assert_eq!(all[0].raw_bytes(), Some(16_137_600));
        assert_eq!(all[1].raw_bytes(), Some(51_854_880));
        for p in all {
            assert_eq!(CameraProfile::from_toml(&toml::to_string(p).unwrap()).unwrap(), *p);
        }
    }

    #[test]
    fn wrong_profiles_are_refused_with_a_reason() {
        let good = include_str!("../../profiles/lytro-f01.toml");
        for (from, to, word) in [
            ("format = 1", "format = 2", "newer"),
            ("width = 3280", "width = 4000000000", "size"),
            ("width = 3280", "width = -1", "invalid"),
            ("pitch = 9.928", "pitch = nan", "pitch"),
            ("black = [168.0,", "black = [5000.0,", "levels"),
            ("packing = \"be12\"", "packing = \"be13\"", "be13"),
            ("gamma = 0.41666", "gamma = inf", "colour"),
            ("[sensor]", "[sensor]\nextra = 1", "extra"),
        ] {
            assert!(good.contains(from));
            let error = CameraProfile::from_toml(&good.replace(from, to)).unwrap_err();
            assert!(error.contains(word), "{to}: {error}");
            assert!(!error.contains('\n'));
        }
        assert!(CameraProfile::from_toml("").is_err());
    }

    #[test]
    fn profiles_are_found_by_name_and_path() {
        assert_eq!(CameraProfile::find("lytro-illum").unwrap().sensor.width, 7728);
        assert!(CameraProfile::find("nikon").unwrap_err().to_string().contains("lytro-f01"));
        assert!(matches!(CameraProfile::find("no/such.toml"), Err(Error::Io { .. })));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mine.toml");
        std::fs::write(&path, include_str!("../../profiles/lytro-f01.toml").replace("lytro-f01", "mine")).unwrap();
        assert_eq!(CameraProfile::find(path.to_str().unwrap()).unwrap().name, "mine");
    }

    #[test]
    fn every_profile_of_the_folder_is_built_in_and_one_is_the_fallback() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("profiles");
        let files = std::fs::read_dir(folder)
            .unwrap()
            .filter(|f| f.as_ref().is_ok_and(|f| f.path().extension().is_some_and(|e| e == "toml")));
        assert_eq!(files.count(), CameraProfile::built_in().len());
        assert_eq!(CameraProfile::built_in().iter().filter(|p| p.fallback).count(), 1);
        assert_eq!(CameraProfile::fallback().unwrap().name, "lytro-f01");
    }

    #[test]
    fn a_camera_has_several_names() {
        let named = |model: &str| CameraProfile::of_model(model).map(|p| p.name.as_str());
        assert_eq!(
            (named("F01"), named("illum"), named("B01")),
            (Some("lytro-f01"), Some("lytro-illum"), Some("lytro-illum"))
        );
        assert_eq!((named(""), named("X99")), (None, None));
        assert!(same_model(" illum", "B01") && same_model("B01", "Illum") && same_model("x99", "X99 "));
        assert!(!same_model("F01", "B01") && !same_model("", "F01"));
    }
}
