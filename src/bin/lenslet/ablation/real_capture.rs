//! Real captures: what a camera is calibrated by and its captures, each read once, and the calibrations.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use anyhow::Result;
use lenslet_core::calibration::{self, Calibration, CalibrationVariant};
use lenslet_core::container::{CameraProfile, Capture};
use lenslet_core::progress::Observer;

use super::settings::CalibratedBy;

/// What was read and made so far.
#[derive(Default)]
pub(super) struct RealCaptures {
    sources: Vec<Capture>,
    capture: Option<(PathBuf, Capture)>,
    calibrations: HashMap<&'static str, Calibration>,
}

impl RealCaptures {
    /// The capture and the camera's calibrations of these variants.
    pub(super) fn get(
        &mut self,
        capture: &Path,
        calibrated_by: &CalibratedBy,
        variants: &[CalibrationVariant],
        observer: &dyn Observer,
    ) -> Result<(&Capture, Vec<&Calibration>)> {
        for &variant in variants {
            if !self.calibrations.contains_key(variant.name()) {
                let made = self.calibrate(calibrated_by, variant, observer)?;
                self.calibrations.insert(variant.name(), made);
            }
        }
        let found = match self.capture.take().filter(|(path, _)| path == capture) {
            Some(found) => found,
            None => (capture.to_owned(), open(capture)?),
        };
        let calibrations = variants.iter().map(|v| &self.calibrations[v.name()]).collect();
        Ok((&self.capture.insert(found).1, calibrations))
    }

    fn calibrate(
        &mut self,
        calibrated_by: &CalibratedBy,
        variant: CalibrationVariant,
        observer: &dyn Observer,
    ) -> Result<Calibration> {
        if let CalibratedBy::File(file) = calibrated_by {
            return Ok(calibration::load(file)?);
        }
        let files = calibrated_by.files();
        if self.sources.len() != files.len() {
            self.sources = files.iter().map(|f| open(f)).collect::<Result<_>>()?;
        }
        let options = calibration::CalibrationOptions { variant, ..calibration::CalibrationOptions::default() };
        Ok(match calibrated_by {
            CalibratedBy::Captures(_) => calibration::calibrate_from_captures(&self.sources, &options, observer)?,
            _ => calibration::calibrate(&self.sources, &options, observer)?,
        })
    }

    /// sha256 of the files read, by name.
    pub(super) fn hashes(&self, calibrated_by: &CalibratedBy) -> BTreeMap<String, String> {
        let name = |file: &Path| file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let files = calibrated_by.files().iter().map(PathBuf::as_path).zip(&self.sources);
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
