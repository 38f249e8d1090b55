//! Real captures: a camera's white images and captures, each read once, and the calibrations made of the white images.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use anyhow::Result;
use lenslet_core::calibration::{self, Calibration, CalibrationVariant};
use lenslet_core::container::{CameraProfile, Capture};
use lenslet_core::progress::Observer;

/// What was read and made so far.
#[derive(Default)]
pub(super) struct RealCaptures {
    whites: Vec<Capture>,
    capture: Option<(PathBuf, Capture)>,
    calibrations: HashMap<&'static str, Calibration>,
}

impl RealCaptures {
    /// The capture and the camera's calibration of that variant.
    pub(super) fn get(
        &mut self,
        capture: &Path,
        whites: &[PathBuf],
        variant: CalibrationVariant,
        observer: &dyn Observer,
    ) -> Result<(&Capture, &Calibration)> {
        if self.whites.len() != whites.len() {
            self.whites = whites.iter().map(|w| open(w)).collect::<Result<_>>()?;
        }
        if !self.calibrations.contains_key(variant.name()) {
            let options = calibration::CalibrationOptions { variant, ..calibration::CalibrationOptions::default() };
            self.calibrations.insert(variant.name(), calibration::calibrate(&self.whites, &options, observer)?);
        }
        let found = match self.capture.take().filter(|(path, _)| path == capture) {
            Some(found) => found,
            None => (capture.to_owned(), open(capture)?),
        };
        Ok((&self.capture.insert(found).1, &self.calibrations[variant.name()]))
    }

    /// sha256 of the files read, by name.
    pub(super) fn hashes(&self, whites: &[PathBuf]) -> BTreeMap<String, String> {
        let name = |file: &Path| file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let files = whites.iter().map(PathBuf::as_path).zip(&self.whites);
        let capture = self.capture.iter().map(|(path, c)| (path.as_path(), c));
        files.chain(capture).map(|(file, source)| (name(file), source.source_sha256.clone())).collect()
    }
}

fn open(path: &Path) -> Result<Capture> {
    // A bare mosaic does not name its camera.
    let opened = Capture::open(path);
    match CameraProfile::fallback() {
        Some(camera) => opened.or_else(|_| Capture::open_as(path, camera)).map_err(Into::into),
        None => Ok(opened?),
    }
}
