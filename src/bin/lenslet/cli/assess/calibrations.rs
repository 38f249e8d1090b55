//! The calibration that methods are measured with, and those that are compared with it.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::calibration::{self, Calibration, CalibrationOptions, CalibrationVariant};
use lenslet_core::container::Capture;

use super::super::Context;
use super::super::decode::CalibrationStore;

/// Calibrations given, or made for the comparison.
pub(super) struct Calibrations {
    store: CalibrationStore,
    /// Further ones that were given, and how they are called.
    others: Vec<(String, Calibration)>,
    first_name: String,
    /// Those made from white images or captures, the full one first.
    made: Vec<(String, Calibration)>,
    /// What they were made from.
    source: String,
    last_of_store: Option<Calibration>,
}

fn name_of(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}

impl Calibrations {
    pub(super) fn open(given: &[PathBuf], context: &Context) -> anyhow::Result<Calibrations> {
        let store = CalibrationStore::open(given.first().map(PathBuf::as_path), context)?;
        let load = |path: &PathBuf| -> anyhow::Result<_> { Ok((name_of(path), calibration::load(path)?)) };
        Ok(Calibrations {
            store,
            others: given.iter().skip(1).map(load).collect::<Result<_, _>>()?,
            first_name: given.first().map(|p| name_of(p)).unwrap_or_default(),
            made: Vec::new(),
            source: String::new(),
            last_of_store: None,
        })
    }

    /// Calibrates from files, all variants where they are to be compared.
    pub(super) fn calibrate(
        &mut self,
        files: &[PathBuf],
        white: bool,
        profile: Option<&str>,
        all: bool,
        context: &Context,
    ) -> anyhow::Result<()> {
        let (paths, captures) = calibration::open_captures(files, profile, &context.progress)?;
        let variants = if all { &CalibrationVariant::ALL[..] } else { &CalibrationVariant::ALL[..1] };
        for &variant in variants {
            let names = paths.iter().map(|p| p.display().to_string()).collect();
            let options = CalibrationOptions { variant, names, ..CalibrationOptions::default() };
            let made = if white {
                calibration::calibrate(&captures, &options, &context.progress)
            } else {
                calibration::calibrate_from_captures(&captures, &options, &context.progress)
            };
            let made = made.map_err(|e| e.in_file_of(&paths)).with_context(|| format!("calibration {variant}"))?;
            self.made.push((variant.name().to_owned(), made));
        }
        let kind = if white { "white images" } else { "captures" };
        self.source = format!("made from {} {kind}", paths.len());
        Ok(())
    }

    /// The calibration for the capture, and where it comes from.
    pub(super) fn first(&mut self, capture: &Capture, context: &Context) -> anyhow::Result<(&Calibration, String)> {
        if let Some((_, made)) = self.made.first() {
            return Ok((made, self.source.clone()));
        }
        let (found, reason) = self.store.choose(capture, context)?;
        // Kept for the comparison.
        if self.others.is_empty() {
            self.last_of_store = None;
            return Ok((found, reason));
        }
        Ok((self.last_of_store.insert(found.clone()), reason))
    }

    /// All calibrations to compare, after [`Calibrations::first`]; those that do not fit the capture are an error.
    pub(super) fn all(&self, capture: &Capture) -> anyhow::Result<Vec<(String, &Calibration)>> {
        let first = self.last_of_store.iter().map(|c| (self.first_name.clone(), c));
        let rest = self.made.iter().chain(&self.others).map(|(name, c)| (name.clone(), c));
        let all: Vec<(String, &Calibration)> = first.chain(rest).collect();
        for (name, c) in &all {
            calibration::check_compatible(c, capture).with_context(|| format!("calibration {name}"))?;
        }
        Ok(all)
    }
}
