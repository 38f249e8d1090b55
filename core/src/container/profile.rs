//! Camera profiles: a camera is data (TOML), not code.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::packing::Packing;
use super::{Cfa, ColourFacts, Error, Levels, MlaHint};

/// Longest profile file read.
const MAX_FILE: u64 = 1 << 20;
/// Largest width or height of a sensor.
pub(super) const MAX_SIDE: usize = 1 << 15;

/// What is known of a camera model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Version of this format, 1.
    pub format: u32,
    /// Name, e.g. `lytro-f01`.
    pub name: String,
    /// Maker.
    #[serde(default)]
    pub make: Option<String>,
    /// Model names in metadata.
    #[serde(default)]
    pub models: Vec<String>,
    /// Whether its captures carry their white image.
    #[serde(default)]
    pub white_inside: bool,
    /// The sensor.
    pub sensor: Sensor,
    /// The micro-lens array, as a first guess for calibration.
    #[serde(default)]
    pub lenslets: Option<MlaHint>,
    /// Colour, where a capture does not say.
    #[serde(default)]
    pub colour: Option<ColourFacts>,
}

/// A sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Pixels a row.
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

impl Profile {
    /// The sensor's levels.
    pub fn levels(&self) -> Levels {
        Levels { black: self.sensor.black, white: self.sensor.white }
    }

    /// The colour facts, neutral where the profile has none.
    pub fn colour(&self) -> ColourFacts {
        self.colour.clone().unwrap_or_else(neutral)
    }

    /// Bytes of a packed raw image.
    pub fn raw_bytes(&self) -> Option<usize> {
        self.sensor.packing.bytes(self.sensor.width.checked_mul(self.sensor.height)?)
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
        if !levels_ok(&l) || l.white.iter().any(|w| *w > f32::from(self.sensor.packing.max())) {
            return Err("levels must be 0 <= black < white <= the largest value of the packing".into());
        }
        if self.lenslets.as_ref().is_some_and(|m| !mla_ok(m)) {
            return Err("lenslets: pitch must be 2 to 500 pixels, rotation within ±π, row_stretch 0.5 to 2".into());
        }
        if self
            .colour
            .as_ref()
            .is_some_and(|c| !(gains_ok(&c.white_balance) && ccm_ok(&c.ccm) && c.gamma.is_none_or(gamma_ok)))
        {
            return Err("colour: gains must be positive, all numbers finite and below 1000".into());
        }
        Ok(())
    }
}

/// Colour facts that change nothing.
pub(super) fn neutral() -> ColourFacts {
    ColourFacts { white_balance: [1.0; 4], ccm: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], gamma: None }
}

pub(super) fn levels_ok(l: &Levels) -> bool {
    l.black.iter().zip(&l.white).all(|(b, w)| *b >= 0.0 && b < w && *w <= 65535.0)
}

pub(super) fn mla_ok(m: &MlaHint) -> bool {
    (2.0..=500.0).contains(&m.pitch) && m.rotation.abs() <= std::f64::consts::PI && (0.5..=2.0).contains(&m.row_stretch)
}

pub(super) fn gains_ok(gains: &[f32; 4]) -> bool {
    gains.iter().all(|g| *g > 0.0 && *g < 1000.0)
}

pub(super) fn ccm_ok(ccm: &[f32; 9]) -> bool {
    ccm.iter().all(|v| v.abs() < 1000.0) && ccm.iter().any(|v| *v != 0.0)
}

pub(super) fn gamma_ok(gamma: f32) -> bool {
    (0.05..=20.0).contains(&gamma)
}

/// Reads a profile from TOML text.
///
/// # Errors
/// A line saying what is wrong with it.
pub fn parse(text: &str) -> Result<Profile, String> {
    let profile: Profile = toml::from_str(text).map_err(|e| e.message().to_string())?;
    profile.check()?;
    Ok(profile)
}

/// The profiles that come with the program.
pub fn profiles() -> Vec<Profile> {
    [include_str!("../../profiles/lytro-f01.toml"), include_str!("../../profiles/lytro-illum.toml")]
        .iter()
        .filter_map(|text| parse(text).ok())
        .collect()
}

/// The profile of a name (`lytro-f01`), or of a TOML file at a path.
///
/// # Errors
/// When there is no such profile, or the file is not a valid one.
pub fn profile(name: &str) -> Result<Profile, Error> {
    let known = profiles();
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
    let bytes = super::file::read(path, "a camera profile", MAX_FILE)?;
    let text =
        std::str::from_utf8(&bytes).map_err(|_| Error::malformed(path, "not a camera profile: not UTF-8 text"))?;
    parse(text).map_err(|e| Error::malformed(path, format!("not a camera profile: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_profiles_are_valid() {
        let all = profiles();
        assert_eq!(all.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["lytro-f01", "lytro-illum"]);
        assert_eq!(all[0].raw_bytes(), Some(16_137_600));
        assert_eq!(all[1].raw_bytes(), Some(51_854_880));
        for p in &all {
            assert_eq!(parse(&toml::to_string(p).unwrap()).unwrap(), *p);
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
            let error = parse(&good.replace(from, to)).unwrap_err();
            assert!(error.contains(word), "{to}: {error}");
            assert!(!error.contains('\n'));
        }
        assert!(parse("").is_err());
    }

    #[test]
    fn profiles_are_found_by_name_and_path() {
        assert_eq!(profile("lytro-illum").unwrap().sensor.width, 7728);
        assert!(profile("nikon").unwrap_err().to_string().contains("lytro-f01"));
        assert!(matches!(profile("no/such.toml"), Err(Error::Io { .. })));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mine.toml");
        std::fs::write(&path, include_str!("../../profiles/lytro-f01.toml").replace("lytro-f01", "mine")).unwrap();
        assert_eq!(profile(path.to_str().unwrap()).unwrap().name, "mine");
    }
}
