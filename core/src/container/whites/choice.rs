//! The choice of a capture's white image among those of a calibration folder, with its reasons.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::image::{CalibrationImage, ExposureClass};
use super::list::{CalibrationImages, list_calibration_images};
use crate::container::capture::Capture;
use crate::container::error::Error;
use crate::container::facts::CameraFacts;
use crate::geometry::Size;

/// The white image of a capture, and what else was there.
#[derive(Debug, Clone, PartialEq)]
pub struct WhiteChoice {
    /// The white image, if there is a usable one.
    pub chosen: Option<CalibrationImage>,
    /// Why this one was chosen; or, without one, what was searched for and what was found.
    pub reason: String,
    /// The other images, each with the reason why it was passed over.
    pub passed: Vec<(CalibrationImage, String)>,
    /// Anomalies found while searching, one line each.
    pub warnings: Vec<String>,
    place: PathBuf,
}

impl WhiteChoice {
    /// Reads the chosen white image.
    ///
    /// # Errors
    /// When there is none (the message says what was searched for and what was found), or it cannot be read.
    pub fn load(&self) -> Result<Capture, Error> {
        match &self.chosen {
            Some(c) => c.load(),
            None => Err(Error::unsupported(&self.place, self.reason.clone())),
        }
    }

    /// The choice, its reason and everything passed over, a line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = match &self.chosen {
            Some(c) => vec![format!("white image: {}: {}", c.describe(), self.reason)],
            None => vec![format!("no white image: {}", self.reason)],
        };
        lines.extend(self.passed.iter().map(|(c, why)| format!("  passed over: {}: {why}", c.describe())));
        lines.extend(self.warnings.iter().map(|w| format!("  {w}")));
        lines
    }
}

/// Finds the white image of `capture` in a calibration folder, bundle or archive.
///
/// # Errors
/// When the place cannot be read. That no image fits is an error of [`WhiteChoice::load`] only.
///
/// ```
/// use lenslet_core::container::whites::find_white_image;
/// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic, write_lfp};
///
/// let frame = |level| {
///     let mosaic = RawMosaic { width: 32, height: 32, data: vec![level; 1024] };
///     Capture::bare(mosaic, Cfa::Bggr, Levels { black: [168.0; 4], white: [4095.0; 4] })
/// };
/// let folder = tempfile::tempdir()?;
/// write_lfp(&folder.path().join("white-00.lfp"), &frame(2000), false)?;
/// write_lfp(&folder.path().join("white-01.lfp"), &frame(300), false)?;
///
/// let choice = find_white_image(folder.path(), &frame(700))?;
/// assert_eq!(choice.load()?.mosaic.data[0], 2000);
/// assert!(choice.passed[0].1.starts_with("too dark"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn find_white_image(place: &Path, capture: &Capture) -> Result<WhiteChoice, Error> {
    Ok(choose_white_image(place, list_calibration_images(place)?, capture))
}

/// The choice among listed images.
pub fn choose_white_image(place: &Path, found: CalibrationImages, capture: &Capture) -> WhiteChoice {
    let want = &capture.camera;
    let size = Size::new(capture.mosaic.width, capture.mosaic.height);
    let mut usable = Vec::new();
    let mut passed = Vec::new();
    for c in found.images {
        match why_unfit(&c, want, size) {
            Some(why) => passed.push((c, why)),
            None => usable.push(c),
        }
    }
    if let Some(why) = several_cameras(&usable, want) {
        passed.extend(usable.drain(..).map(|c| (c, why.clone())));
    }
    usable.sort_by(|a, b| closeness(a, b, want));
    let total = usable.len() + passed.len();
    let mut rest = usable.into_iter();
    let chosen = rest.next();
    let reason = match &chosen {
        Some(c) => describe_reason(c, want),
        None => describe_absence(want, size, total, &passed),
    };
    if let Some(c) = &chosen {
        let later: Vec<_> = rest.map(|o| (why_passed_over(c, &o, want), o)).map(|(why, o)| (o, why)).collect();
        passed.splice(0..0, later);
    }
    WhiteChoice { chosen, reason, passed, warnings: found.warnings, place: place.to_path_buf() }
}

/// Why an image cannot be the capture's white image, if so.
fn why_unfit(c: &CalibrationImage, want: &CameraFacts, size: Size) -> Option<String> {
    match c.class {
        ExposureClass::Black => return Some("a black image, for hot pixels".into()),
        ExposureClass::Dark => return Some("too dark: its mean is under 500 of 4095".into()),
        ExposureClass::Saturated => return Some("over-exposed".into()),
        ExposureClass::White => {}
    }
    if let Some(other) = c.frame.size.map(Size::from).filter(|s| *s != size) {
        return Some(format!("{other} pixels, the capture has {size}"));
    }
    match (&want.serial, &c.frame.camera.serial) {
        (Some(a), Some(b)) if a != b => Some(format!("of another camera, {b}")),
        _ => None,
    }
}

/// Why none of the images can be chosen: they are of several cameras, and nothing says which is the capture's.
fn several_cameras(usable: &[CalibrationImage], want: &CameraFacts) -> Option<String> {
    if want.serial.is_some() || usable.iter().any(|c| is_named(c, want)) {
        return None;
    }
    let serials: BTreeSet<&str> = usable.iter().filter_map(|c| c.frame.camera.serial.as_deref()).collect();
    (serials.len() > 1).then(|| {
        let list: Vec<&str> = serials.into_iter().collect();
        format!("of one of several cameras ({}), and the capture does not state its own", list.join(", "))
    })
}

fn is_named(c: &CalibrationImage, want: &CameraFacts) -> bool {
    want.white_ref.as_ref().is_some_and(|r| c.names.iter().any(|n| n.eq_ignore_ascii_case(r)))
}

/// Distance of two stepper positions; largest where only the capture's is known.
fn step_distance(a: Option<i64>, b: Option<i64>) -> u64 {
    match (a, b) {
        (Some(a), Some(b)) => a.abs_diff(b),
        (None, _) => 0,
        (Some(_), None) => u64::MAX,
    }
}

/// Which of two usable images fits better: less is better.
fn closeness(a: &CalibrationImage, b: &CalibrationImage, want: &CameraFacts) -> Ordering {
    let key = |c: &CalibrationImage| {
        let f = &c.frame.camera;
        let other = want.serial.is_some() && f.serial.is_none();
        (
            !is_named(c, want),
            other,
            step_distance(want.zoom_step, f.zoom_step),
            step_distance(want.focus_step, f.focus_step),
        )
    };
    key(a).cmp(&key(b)).then(b.mean.total_cmp(&a.mean))
}

/// Why the chosen image was chosen.
fn describe_reason(c: &CalibrationImage, want: &CameraFacts) -> String {
    if is_named(c, want) {
        return "the capture names it by sha1".into();
    }
    let f = &c.frame.camera;
    let mut out = match (&want.serial, &f.serial) {
        (Some(_), Some(_)) => "same serial number".to_string(),
        (Some(s), None) => format!("its serial number is not known (that of the capture is {s})"),
        (None, _) => "the serial number of the capture is not known".to_string(),
    };
    for (word, w, h) in [("zoom", want.zoom_step, f.zoom_step), ("focus", want.focus_step, f.focus_step)] {
        out.push_str(&match (w, h) {
            (Some(w), Some(h)) if w == h => format!(", same {word} step"),
            (Some(w), Some(h)) => format!(", nearest {word} step ({} from the capture's {w})", w.abs_diff(h)),
            (Some(_), None) => format!(", {word} step not known"),
            (None, _) => format!(", {word} step of the capture not known"),
        });
    }
    out
}

/// Why a usable image comes after the chosen one.
fn why_passed_over(best: &CalibrationImage, c: &CalibrationImage, want: &CameraFacts) -> String {
    let (b, f) = (&best.frame.camera, &c.frame.camera);
    if is_named(best, want) && !is_named(c, want) {
        return "not the one the capture names".into();
    }
    for (word, want, best, own) in
        [("zoom", want.zoom_step, b.zoom_step, f.zoom_step), ("focus", want.focus_step, b.focus_step, f.focus_step)]
    {
        let d = step_distance(want, own);
        if d > step_distance(want, best) {
            return if d == u64::MAX {
                format!("its {word} step is not known")
            } else {
                format!("{word} step {d} away")
            };
        }
    }
    if want.serial.is_some() && f.serial.is_none() && b.serial.is_some() {
        return "its serial number is not known".into();
    }
    if c.mean < best.mean { "the darker exposure".into() } else { "as good as the chosen one".into() }
}

/// What was searched for, and what was found, in one line.
fn describe_absence(want: &CameraFacts, size: Size, total: usize, passed: &[(CalibrationImage, String)]) -> String {
    let number = |v: Option<i64>| v.map_or("unknown".to_string(), |v| v.to_string());
    let mut out = format!(
        "looked for a white image of {size} pixels, serial {}, zoom {}, focus {}",
        want.serial.as_deref().unwrap_or("unknown"),
        number(want.zoom_step),
        number(want.focus_step)
    );
    if let Some(r) = &want.white_ref {
        out.push_str(&format!(" (or {r})"));
    }
    if total == 0 {
        out.push_str("; there are no .RAW images with their .TXT, and no containers tagged as white images");
        return out;
    }
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for (_, why) in passed {
        match counts.iter_mut().find(|(w, _)| w == why) {
            Some((_, n)) => *n += 1,
            None => counts.push((why, 1)),
        }
    }
    let list: Vec<String> = counts.iter().take(6).map(|(why, n)| format!("{n} {why}")).collect();
    out.push_str(&format!("; of the {total} images there: {}", list.join("; ")));
    out
}

/// The black images of a list that fit a capture's camera.
pub fn black_images<'a>(found: &'a CalibrationImages, camera: &CameraFacts) -> Vec<&'a CalibrationImage> {
    let same = |c: &&CalibrationImage| match (&camera.serial, &c.frame.camera.serial) {
        (Some(a), Some(b)) => a == b,
        _ => true,
    };
    found.images.iter().filter(|c| c.class == ExposureClass::Black).filter(same).collect()
}
