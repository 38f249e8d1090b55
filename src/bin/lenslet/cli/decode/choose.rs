//! Which calibration belongs to a capture, with the reason, and what else was there when none does.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use lenslet_core::calibration::{self, Calibration, CalibrationOptions};
use lenslet_core::container::{CameraFacts, Capture, members, whites};
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;

use crate::cli::{Context, Usage};

/// What is known of one calibration file without keeping it in memory.
struct StoredCalibration {
    path: PathBuf,
    size: Size,
    origin: calibration::CalibrationOrigin,
}

/// Calibrations to choose from; the last one used stays loaded.
pub struct CalibrationStore {
    candidates: Vec<StoredCalibration>,
    /// White images instead of calibrations: a calibration folder, bundle or archive.
    whites: Option<PathBuf>,
    place: Option<PathBuf>,
    last: Option<(PathBuf, Calibration)>,
}

impl CalibrationStore {
    /// Opens a calibration file, a folder of them, or white images (a camera's calibration folder, data.C.n bundle or
    /// .tar). Without any, captures must carry their own white image.
    pub fn open(path: Option<&Path>, context: &Context) -> anyhow::Result<CalibrationStore> {
        let mut store =
            CalibrationStore { candidates: Vec::new(), whites: None, place: path.map(Path::to_path_buf), last: None };
        let Some(path) = path else { return Ok(store) };
        if !path.is_dir() {
            if members::list_members(path).is_ok() {
                store.whites = Some(path.to_path_buf());
                return Ok(store);
            }
            store.add(path)?;
            return Ok(store);
        }
        let failed = |e: std::io::Error| anyhow::anyhow!("{}: {e}", path.display());
        let mut files = Vec::new();
        for entry in std::fs::read_dir(path).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("calib")) {
                files.push(file);
            }
        }
        files.sort();
        for file in files {
            context.progress.check()?;
            if let Err(e) = store.add(&file) {
                context.progress.note(&format!("passed over: {e:#}"));
            }
        }
        if store.candidates.is_empty() {
            if !whites::list_calibration_images(path)?.images.is_empty() {
                store.whites = Some(path.to_path_buf());
                return Ok(store);
            }
            anyhow::bail!(
                "{}: no calibration (.calib) and no white images in this folder; make a calibration with `lenslet calibrate`",
                path.display()
            );
        }
        Ok(store)
    }

    fn add(&mut self, path: &Path) -> anyhow::Result<()> {
        let found = calibration::load(path)?;
        let (size, origin) = (Size::new(found.width, found.height), found.origin.clone());
        self.candidates.push(StoredCalibration { path: path.to_path_buf(), size, origin });
        self.last = Some((path.to_path_buf(), found));
        Ok(())
    }

    /// The calibration for `capture`, and why it was chosen.
    /// A capture that carries its own white image has that where a folder or archive holds none that fits.
    pub fn choose(&mut self, capture: &Capture, context: &Context) -> anyhow::Result<(&Calibration, String)> {
        let several = self.whites.is_some() || self.place.as_deref().is_some_and(Path::is_dir);
        let reason = match self.place {
            None => self.load_own(capture, context)?,
            Some(_) => match self.load_from_place(capture, context) {
                Err(e) if several && capture.white.is_some() && !context.progress.cancelled() => {
                    context.progress.note(&format!("{e:#}: the capture's own white image is taken"));
                    self.load_own(capture, context)?
                }
                other => other?,
            },
        };
        match &self.last {
            Some((_, found)) => Ok((found, reason)),
            None => Err(self.nothing(capture)),
        }
    }

    /// Loads the calibration made from the white image that the capture carries; why it is the right one.
    fn load_own(&mut self, capture: &Capture, context: &Context) -> anyhow::Result<String> {
        let Some(white) = &capture.white else {
            return Err(Usage(
                "--calibration is needed: the capture contains no white image; make one with `lenslet calibrate WHITE --out \
                 CAM.calib`, or from five captures or more with `lenslet calibrate --from-captures FILES --out CAM.calib`"
                    .into(),
            )
            .into());
        };
        let options = CalibrationOptions::default();
        let own = calibration::calibrate(std::slice::from_ref(&**white), &options, &context.progress);
        let own = own.map_err(|e| match e {
            calibration::Error::Interrupted(_) => anyhow::Error::new(e),
            e => anyhow::Error::new(e).context("the white image inside it"),
        })?;
        self.last = Some((PathBuf::new(), own));
        Ok("made from the white image inside the capture".into())
    }

    /// Loads the calibration among those given; why it was chosen.
    fn load_from_place(&mut self, capture: &Capture, context: &Context) -> anyhow::Result<String> {
        if let Some(place) = self.whites.clone() {
            return self.load_by_whites(&place, capture, context);
        }
        let size = Size::new(capture.mosaic.width, capture.mosaic.height);
        let fitting: Vec<&StoredCalibration> = self.candidates.iter().filter(|c| c.size == size).collect();
        let camera = &capture.camera;
        let same = |a: &Option<String>, b: &Option<String>| matches!((a, b), (Some(a), Some(b)) if a == b);
        let other = |a: &Option<String>, b: &Option<String>| matches!((a, b), (Some(a), Some(b)) if a != b);
        // Without a serial number, those of several bodies fit equally well: none is chosen.
        let bodies: BTreeSet<&String> = fitting.iter().filter_map(|c| c.origin.serial.as_ref()).collect();
        if camera.serial.is_none() && bodies.len() > 1 {
            anyhow::bail!("{}; the capture does not state which of these cameras is its own", self.nothing(capture));
        }
        // Another body's lenslets lie elsewhere: never chosen where both serial numbers are known and differ.
        let best = fitting.iter().filter(|c| !other(&c.origin.serial, &camera.serial)).min_by_key(|c| {
            (
                !same(&c.origin.serial, &camera.serial),
                steps(c.origin.zoom_step, camera.zoom_step),
                steps(c.origin.focus_step, camera.focus_step),
            )
        });
        let only = self.candidates.len() == 1;
        let (path, reason) = match best {
            Some(c) => (c.path.clone(), reason(c, camera, only)),
            // The only one does not fit: the compatibility check gives the reason.
            None if only => (self.candidates[0].path.clone(), String::new()),
            None => return Err(self.nothing(capture)),
        };
        if self.last.as_ref().is_none_or(|(p, _)| *p != path) {
            self.last = Some((path.clone(), calibration::load(&path)?));
        }
        match &self.last {
            Some((_, found)) => {
                // Decoding refuses it, too; here the calibration's file is known.
                calibration::check_compatible(found, capture)
                    .map_err(|e| anyhow::Error::new(e).context(path.display().to_string()))?;
                if only {
                    for line in calibration::lens_setting_differences(found, capture) {
                        context.progress.note(&format!("{}: {line}", path.display()));
                    }
                }
                Ok(format!("{} ({reason})", path.display()))
            }
            None => Err(self.nothing(capture)),
        }
    }

    /// Finds the capture's white image, notes what else was there, and calibrates from it; the last calibration is
    /// reused.
    fn load_by_whites(&mut self, place: &Path, capture: &Capture, context: &Context) -> anyhow::Result<String> {
        let choice = whites::find_white_image(place, capture)?;
        let white = choice.load()?;
        let name = choice.chosen.as_ref().map(|c| c.member.label()).unwrap_or_default();
        if self.last.as_ref().is_none_or(|(p, _)| p.as_os_str() != name.as_str()) {
            for line in choice.lines() {
                context.progress.note(&crate::cli::info::clean(&line));
            }
            let blacks: Vec<&whites::CalibrationImage> =
                choice.passed.iter().map(|(c, _)| c).filter(|c| c.class == whites::ExposureClass::Black).collect();
            let hot_pixels = crate::cli::calibrate::hot_pixels(&blacks, &white, context)?;
            let options = CalibrationOptions { hot_pixels, names: vec![name.clone()], ..CalibrationOptions::default() };
            let made = calibration::calibrate(std::slice::from_ref(&white), &options, &context.progress)
                .map_err(|e| e.in_file_of(&[PathBuf::from(&name)]))?;
            self.last = Some((PathBuf::from(&name), made));
        }
        Ok(format!("made from {name} ({})", choice.reason))
    }

    fn nothing(&self, capture: &Capture) -> anyhow::Error {
        let camera = &capture.camera;
        let place = self.place.as_deref().unwrap_or(Path::new("")).display();
        let there: Vec<String> = self
            .candidates
            .iter()
            .map(|c| {
                let name = c.path.file_name().unwrap_or_default().to_string_lossy();
                let serial = c.origin.serial.as_deref().unwrap_or("no serial");
                format!("{name}: {}, {serial}", c.size)
            })
            .collect();
        anyhow::anyhow!(
            "{place}: no calibration for this camera ({}x{}, serial {}); there are: {}",
            capture.mosaic.width,
            capture.mosaic.height,
            camera.serial.as_deref().unwrap_or("unknown"),
            there.join("; ")
        )
    }
}

/// Distance of stepper positions; unknown counts as farthest.
fn steps(a: Option<i64>, b: Option<i64>) -> u64 {
    match (a, b) {
        (Some(a), Some(b)) => a.abs_diff(b),
        _ => u64::MAX,
    }
}

fn reason(c: &StoredCalibration, camera: &CameraFacts, only: bool) -> String {
    let mut parts = Vec::new();
    if only {
        parts.push("the one given".to_string());
    }
    match (&c.origin.serial, &camera.serial) {
        (Some(a), Some(_)) => parts.push(format!("same camera {a}")),
        _ => parts.push("same sensor size".into()),
    }
    for (name, a, b) in
        [("zoom", c.origin.zoom_step, camera.zoom_step), ("focus", c.origin.focus_step, camera.focus_step)]
    {
        if let (Some(a), Some(b)) = (a, b) {
            parts.push(if a == b { format!("same {name} {a}") } else { format!("nearest {name} {a} to {b}") });
        }
    }
    parts.join(", ")
}
