//! White images: which of those in a calibration folder, bundle or archive belongs to a capture.
//!
//! By sha1 where the capture names one; else the same serial number, the nearest zoom step, then the nearest focus
//! step. Black images, dark ones (mean under 500 of 4095) and the darker exposure of a pair are passed over.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::Path;

use super::capture::{assemble, profile_for, sha256_of};
use super::members::{Member, members};
use super::metadata::{self, Frame};
use super::packing::unpack;
use super::profile::Profile;
use super::segments::{Container, HEADER, MAGIC, sha1_of};
use super::{CameraFacts, Capture, Error, json, lfp};

/// Longest image read.
const MAX_IMAGE: u64 = 512 << 20;
/// Images with a mean under this share of the white level (500 of 4095) are too dark to find centres in.
const DARK: f64 = 500.0 / 4095.0;
/// Images whose mean stands this little above the black level (as a share of the range) are black images.
const BLACK: f64 = 0.02;
/// More saturated pixels than this share spoil a white image.
const SATURATED: f64 = 0.01;

/// What an image is good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// A white image.
    White,
    /// A white image with too little light.
    Dark,
    /// A white image with too much light.
    Saturated,
    /// A black image (hot pixels).
    Black,
}

/// An image of a calibration folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Where its packed pixels lie.
    pub member: Member,
    /// What its metadata says.
    pub frame: Frame,
    /// Every `sha1-…` it is known by, except that of its own pixels where nobody has computed it.
    pub names: Vec<String>,
    /// What it is good for.
    pub state: State,
    /// Mean value in DN, from a thousandth part to all of its pixels.
    pub mean: f64,
}

impl Candidate {
    /// Reads the whole image.
    ///
    /// # Errors
    /// When it cannot be read, or its size is not what its metadata says.
    pub fn load(&self) -> Result<Capture, Error> {
        let bytes = self.member.read(MAX_IMAGE)?;
        let mut warnings = Vec::new();
        if let Some(sha1) = self.member.sha1.as_ref().filter(|s| **s != sha1_of(&bytes)) {
            warnings.push(format!("{} is damaged: it does not have the {sha1} it should", self.member.label()));
        }
        let profile = profile_for(&self.frame, self.member.length);
        let pixels = lfp::pixels(&self.member.path, &self.frame, profile.as_ref(), &bytes, &mut warnings)?;
        Ok(assemble(pixels, self.frame.clone(), profile.as_ref(), sha256_of(&bytes), warnings))
    }

    /// Name, serial, zoom, focus and brightness in one line.
    pub fn describe(&self) -> String {
        let c = &self.frame.camera;
        let mut out = self.member.label();
        if let Some(serial) = &c.serial {
            out.push_str(&format!(", serial {serial}"));
        }
        for (word, value) in [("zoom", c.zoom_step), ("focus", c.focus_step)] {
            if let Some(value) = value {
                out.push_str(&format!(", {word} {value}"));
            }
        }
        out.push_str(&format!(", mean {:.0} DN", self.mean));
        out
    }
}

/// Every image of a folder.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct List {
    /// White, dark and black images, in order of place.
    pub candidates: Vec<Candidate>,
    /// Files that could have been images but could not be used, one line each, and other oddities.
    pub warnings: Vec<String>,
}

/// The white image of a capture, and what else was there.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The white image, if there is a usable one.
    pub chosen: Option<Candidate>,
    /// Why this one; or, without one, what was looked for and what was there.
    pub reason: String,
    /// The others, each with why it was passed over.
    pub passed: Vec<(Candidate, String)>,
    /// Oddities met while looking.
    pub warnings: Vec<String>,
    place: std::path::PathBuf,
}

impl Choice {
    /// Reads the chosen white image.
    ///
    /// # Errors
    /// When there is none (the message says what was looked for and what was there), or it cannot be read.
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

/// Lists the images of a calibration folder, `data.C.n` bundle or .tar archive: packed .RAW files with their
/// metadata, and containers tagged as white images or called `white…` or `MOD…`.
///
/// # Errors
/// When the place cannot be read.
pub fn list(place: &Path) -> Result<List, Error> {
    let found = members(place)?;
    let mut out = List { candidates: Vec::new(), warnings: found.warnings };
    let key = |m: &Member| {
        let folder = m.name.rsplit_once(['\\', '/']).map_or("", |(f, _)| f).to_string();
        (m.path.parent().map(Path::to_path_buf), folder, m.stem_and_extension().0)
    };
    let mut texts = HashMap::new();
    let mut hashes: HashMap<String, String> = HashMap::new();
    for m in &found.list {
        let (stem, extension) = m.stem_and_extension();
        if extension == "TXT" || extension == "JSON" {
            if stem == "CAL_FILE_MANIFEST" {
                hashes.extend(manifest(m));
            }
            texts.insert(key(m), m);
        }
    }
    for m in &found.list {
        let (stem, extension) = m.stem_and_extension();
        let candidate = if extension == "RAW" {
            raw_candidate(m, texts.get(&key(m)).copied())
        } else if m.offset == 0 && m.part(0, 8).is_ok_and(|h| h == MAGIC) {
            container_candidate(m, &stem).transpose()
        } else {
            None
        };
        match candidate {
            None => {}
            Some(Ok(mut c)) => {
                c.names.extend(hashes.get(&stem).cloned());
                c.names.extend(c.member.sha1.clone());
                out.candidates.push(c);
            }
            Some(Err(e)) => out.warnings.push(format!("left out: {e}")),
        }
    }
    Ok(out)
}

/// Stem of each calibration file and its hash.
fn manifest(member: &Member) -> Vec<(String, String)> {
    let Ok(bytes) = member.read(json::MAX_TEXT as u64) else { return Vec::new() };
    let Ok(value) = json::parse(&bytes) else { return Vec::new() };
    let files = value.get("calibrationFiles").and_then(serde_json::Value::as_array);
    let entry = |f: &serde_json::Value| {
        let name = json::text(f, "name")?.to_ascii_uppercase();
        let stem = name.rsplit(['\\', '/']).next()?.rsplit_once('.')?.0.to_string();
        Some((stem, json::text(f, "hash")?.to_ascii_lowercase()))
    };
    files.into_iter().flatten().filter_map(entry).collect()
}

fn raw_candidate(member: &Member, text: Option<&Member>) -> Option<Result<Candidate, Error>> {
    let frame = match text.map(|t| (t, t.read(json::MAX_TEXT as u64))) {
        None => Ok(Frame::default()),
        Some((t, bytes)) => bytes
            .and_then(|b| json::parse(&b).map_err(|e| Error::malformed(&t.path, format!("{}: {e}", t.name))))
            .map(|v| metadata::frame(&v, None).0),
    };
    Some(frame.and_then(|f| weigh(member.clone(), f)))
}

fn container_candidate(member: &Member, stem: &str) -> Result<Option<Candidate>, Error> {
    let container = Container::open(&member.path)?;
    let looks = stem.starts_with("WHITE") || stem.starts_with("MOD");
    let (frame, image) = match lfp::locate(&container) {
        Ok(lfp::Located { facts, image: Some(image), .. }) => (facts, image),
        Err(e) if looks => return Err(e),
        _ => return Ok(None),
    };
    if !(looks || frame.is_white == Some(true)) {
        return Ok(None);
    }
    let inside = Member {
        name: member.name.clone(),
        path: member.path.clone(),
        offset: image.offset + HEADER,
        length: image.length,
        sha1: Some(image.sha1),
    };
    weigh(inside, frame).map(Some)
}

/// Judges an image by a sample of its pixels: 64 stretches spread over it.
fn weigh(member: Member, frame: Frame) -> Result<Candidate, Error> {
    let profile = profile_for(&frame, member.length);
    let describe = |reason: &str| Error::malformed(&member.path, format!("{}: {reason}", member.name));
    let packing = frame
        .packing
        .or(profile.as_ref().map(|p| p.sensor.packing))
        .ok_or_else(|| describe("nothing says how its pixels are packed"))?;
    let levels = frame
        .levels
        .clone()
        .or(profile.as_ref().map(Profile::levels))
        .ok_or_else(|| describe("its black and white level are not known"))?;
    let size = frame.size.or(profile.as_ref().map(|p| (p.sensor.width, p.sensor.height)));
    if let Some((w, h)) = size
        && packing.bytes(w * h).map(|n| n as u64) != Some(member.length)
    {
        return Err(describe(&format!(
            "its {} bytes do not hold {w}x{h} pixels of {} bit",
            member.length,
            packing.bits()
        )));
    }
    const GROUP: u64 = 30; // bytes; whole groups of every packing
    const STRETCH: u64 = GROUP * 128;
    let (mut sum, mut count, mut high) = (0u64, 0u64, 0u64);
    let white = levels.white.iter().copied().fold(f32::INFINITY, f32::min);
    for k in 0..64 {
        let start = (member.length.saturating_sub(STRETCH) * k / 63) / GROUP * GROUP;
        let bytes = member.part(start, STRETCH)?;
        let pixels = bytes.len() * 8 / packing.bits() as usize / 4 * 4;
        for v in unpack(packing, &bytes, pixels).unwrap_or_default() {
            sum += u64::from(v);
            count += 1;
            high += u64::from(f32::from(v) >= white * 0.995);
        }
        if member.length <= STRETCH {
            break;
        }
    }
    if count == 0 {
        return Err(describe("it holds no pixels"));
    }
    let mean = sum as f64 / count as f64;
    let (black, white) = (f64::from(levels.black[1]), f64::from(white));
    let state = if frame.is_dark == Some(true) || mean < black + BLACK * (white - black) {
        State::Black
    } else if mean < DARK * white {
        State::Dark
    } else if high as f64 > SATURATED * count as f64 {
        State::Saturated
    } else {
        State::White
    };
    let names = frame.camera.white_ref.iter().cloned().collect();
    Ok(Candidate { member, frame, names, state, mean })
}

/// Finds the white image of `capture` in a calibration folder, bundle or archive.
///
/// # Errors
/// When the place cannot be read; that no image fits is no error here but told by [`Choice::load`].
pub fn find(place: &Path, capture: &Capture) -> Result<Choice, Error> {
    let found = list(place)?;
    Ok(choose(place, found, capture))
}

/// The choice among listed images.
pub fn choose(place: &Path, found: List, capture: &Capture) -> Choice {
    let want = &capture.camera;
    let size = (capture.mosaic.width, capture.mosaic.height);
    let mut usable = Vec::new();
    let mut passed = Vec::new();
    for c in found.candidates {
        match unfit(&c, want, size) {
            Some(why) => passed.push((c, why)),
            None => usable.push(c),
        }
    }
    usable.sort_by(|a, b| order(a, b, want));
    let total = usable.len() + passed.len();
    let mut rest = usable.into_iter();
    let chosen = rest.next();
    let reason = match &chosen {
        Some(c) => reason(c, want),
        None => nothing(want, size, total, &passed),
    };
    if let Some(c) = &chosen {
        let later: Vec<_> = rest.map(|o| (why_later(c, &o, want), o)).map(|(why, o)| (o, why)).collect();
        passed.splice(0..0, later);
    }
    Choice { chosen, reason, passed, warnings: found.warnings, place: place.to_path_buf() }
}

/// Why an image cannot be the capture's white image, if so.
fn unfit(c: &Candidate, want: &CameraFacts, size: (usize, usize)) -> Option<String> {
    match c.state {
        State::Black => return Some("a black image, for hot pixels".into()),
        State::Dark => return Some("too dark: its mean is under 500 of 4095".into()),
        State::Saturated => return Some("over-exposed".into()),
        State::White => {}
    }
    if let Some((w, h)) = c.frame.size.filter(|s| *s != size) {
        return Some(format!("{w}x{h} pixels, the capture has {}x{}", size.0, size.1));
    }
    match (&want.serial, &c.frame.camera.serial) {
        (Some(a), Some(b)) if a != b => Some(format!("of another camera, {b}")),
        _ => None,
    }
}

fn named(c: &Candidate, want: &CameraFacts) -> bool {
    want.white_ref.as_ref().is_some_and(|r| c.names.iter().any(|n| n.eq_ignore_ascii_case(r)))
}

fn distance(a: Option<i64>, b: Option<i64>) -> u64 {
    match (a, b) {
        (Some(a), Some(b)) => a.abs_diff(b),
        (None, _) => 0,
        (Some(_), None) => u64::MAX,
    }
}

fn order(a: &Candidate, b: &Candidate, want: &CameraFacts) -> Ordering {
    let key = |c: &Candidate| {
        let f = &c.frame.camera;
        let other = want.serial.is_some() && f.serial.is_none();
        (!named(c, want), other, distance(want.zoom_step, f.zoom_step), distance(want.focus_step, f.focus_step))
    };
    key(a).cmp(&key(b)).then(b.mean.total_cmp(&a.mean))
}

fn reason(c: &Candidate, want: &CameraFacts) -> String {
    if named(c, want) {
        return "the capture names it by sha1".into();
    }
    let f = &c.frame.camera;
    let mut out = match (&want.serial, &f.serial) {
        (Some(_), Some(_)) => "same serial number".to_string(),
        (Some(s), None) => format!("it does not say which camera it is of (the capture is of {s})"),
        (None, _) => "the capture does not say which camera it is of".to_string(),
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

fn why_later(best: &Candidate, c: &Candidate, want: &CameraFacts) -> String {
    let (b, f) = (&best.frame.camera, &c.frame.camera);
    if named(best, want) && !named(c, want) {
        return "not the one the capture names".into();
    }
    for (word, want, best, own) in
        [("zoom", want.zoom_step, b.zoom_step, f.zoom_step), ("focus", want.focus_step, b.focus_step, f.focus_step)]
    {
        let d = distance(want, own);
        if d > distance(want, best) {
            return if d == u64::MAX {
                format!("its {word} step is not known")
            } else {
                format!("{word} step {d} away")
            };
        }
    }
    if want.serial.is_some() && f.serial.is_none() && b.serial.is_some() {
        return "it does not say which camera it is of".into();
    }
    if c.mean < best.mean { "the darker exposure".into() } else { "as good as the chosen one".into() }
}

/// What was looked for, and what was there, in one line.
fn nothing(want: &CameraFacts, size: (usize, usize), total: usize, passed: &[(Candidate, String)]) -> String {
    let number = |v: Option<i64>| v.map_or("unknown".to_string(), |v| v.to_string());
    let mut out = format!(
        "looked for a white image of {}x{} pixels, serial {}, zoom {}, focus {}",
        size.0,
        size.1,
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
pub fn blacks<'a>(found: &'a List, camera: &CameraFacts) -> Vec<&'a Candidate> {
    let same = |c: &&Candidate| match (&camera.serial, &c.frame.camera.serial) {
        (Some(a), Some(b)) => a == b,
        _ => true,
    };
    found.candidates.iter().filter(|c| c.state == State::Black).filter(same).collect()
}
