//! Whether what a user gives is what the command takes: one place for every command and every input, before any work. What
//! is refused is named for what it is, with the command that takes it.

use std::fmt;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::container::segments::MAGIC;
use lenslet_core::dictionary;
use lenslet_core::input::open_regular;
use lenslet_core::picture_file::{ENDINGS, UNREAD_ENDINGS};
use lenslet_views::reconstruct;

/// Entries of a folder that are looked at.
/// Source: chosen.
const MAX_ENTRIES: usize = 10_000;

/// What a command takes at some place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// One capture or bundle, to be taken apart.
    Container,
    /// Captures, or folders of captures.
    Captures,
    /// A capture, as a file.
    CaptureFile,
    /// A white or black image, as a file.
    WhiteImage,
    /// A camera's calibration folder, bundle or archive.
    Bundle,
    /// Calibrations or white images, as a file or folder.
    Calibrations,
    /// A calibration, as a file.
    CalibrationFile,
    /// A light field, or a picture as one of one view.
    LightField,
    /// A photo or a folder of photos.
    Photos,
    /// A photo, as a file.
    PhotoFile,
    /// A dictionary, by file or name.
    Dictionary,
    /// A map of disparities.
    Map,
    /// A text: parameters, lines.
    Text,
}

impl Input {
    /// In what form it is given.
    fn form(self) -> &'static str {
        match self {
            Input::Container | Input::Captures | Input::CaptureFile | Input::WhiteImage => {
                ".lfp, .lfr, .raw with .txt or .json beside it, or mosaics (PNG, TIFF, JPEG)"
            }
            Input::Bundle => "one with white images (.raw with .txt beside it, data.C.n, .tar)",
            Input::Calibrations | Input::CalibrationFile => "a .calib",
            Input::LightField => {
                "a folder with a lightfield.json or numbered pictures, a .npy, a .mat, or a lenslet picture"
            }
            Input::Photos | Input::PhotoFile => "pictures (PNG, JPEG, TIFF, BMP or PNM)",
            Input::Dictionary => "a .lfd or .safetensors",
            Input::Map => "a .pfm or .npy",
            Input::Text => "a file of text",
        }
    }

    /// Whether the command can do nothing without it.
    fn alone(self) -> bool {
        matches!(
            self,
            Input::CalibrationFile | Input::LightField | Input::Photos | Input::PhotoFile | Input::Map | Input::Text
        )
    }
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Input::Container => "a capture or bundle",
            Input::Captures => "a capture",
            Input::CaptureFile => "a capture",
            Input::WhiteImage => "a white image",
            Input::Bundle => "a camera's calibration folder, bundle or archive",
            Input::Calibrations | Input::CalibrationFile => "a calibration",
            Input::LightField => "a light field",
            Input::Photos | Input::PhotoFile => "a photo",
            Input::Dictionary => "a dictionary",
            Input::Map => "a map of disparities (.pfm or .npy)",
            Input::Text => "a text file",
        })
    }
}

/// What stands at a path.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Found {
    Capture,
    LightField,
    Array,
    Calibration,
    Dictionary,
    Samples,
    Archive,
    Picture,
    Folder(Contents),
    /// Not known by its first bytes: the reader says what is wrong with it.
    Other,
}

/// Files of one kind in a folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Group {
    count: usize,
    first: PathBuf,
}

impl Group {
    fn add(&mut self, path: PathBuf) {
        if self.count == 0 || path < self.first {
            self.first = path;
        }
        self.count += 1;
    }
}

/// What is in a folder, by names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Contents {
    captures: Group,
    light_fields: Group,
    calibrations: Group,
    dictionaries: Group,
    pictures: Group,
    /// Pictures of formats that are not read.
    unread: usize,
    folders: usize,
    others: usize,
}

impl Contents {
    fn of(folder: &Path) -> std::io::Result<Contents> {
        let mut found = Contents::default();
        for entry in std::fs::read_dir(folder)?.take(MAX_ENTRIES).flatten() {
            let path = entry.path();
            if entry.file_name().as_encoded_bytes().starts_with(b".") {
                continue;
            }
            if path.is_dir() {
                if path.join("lightfield.json").is_file() {
                    found.light_fields.add(path);
                } else {
                    found.folders += 1;
                }
                continue;
            }
            match ending(&path).as_str() {
                "lfp" | "lfr" | "raw" => found.captures.add(path),
                "npy" | "mat" => found.light_fields.add(path),
                "calib" => found.calibrations.add(path),
                "lfd" | "safetensors" => found.dictionaries.add(path),
                e if ENDINGS.contains(&e) => found.pictures.add(path),
                e if UNREAD_ENDINGS.iter().any(|u| u.0 == e) => found.unread += 1,
                _ => found.others += 1,
            }
        }
        Ok(found)
    }

    fn is_empty(&self) -> bool {
        *self == Contents::default()
    }

    fn kinds(&self) -> [(&Group, &'static str); 5] {
        [
            (&self.captures, "captures"),
            (&self.light_fields, "light fields"),
            (&self.calibrations, "calibrations"),
            (&self.dictionaries, "dictionaries"),
            (&self.pictures, "pictures"),
        ]
    }

    /// Those that a place takes.
    fn wanted(&self, wanted: Input) -> &Group {
        match wanted {
            Input::Container | Input::Captures | Input::CaptureFile | Input::WhiteImage | Input::Bundle => {
                &self.captures
            }
            Input::Calibrations | Input::CalibrationFile => &self.calibrations,
            Input::LightField | Input::Map | Input::Text => &self.light_fields,
            Input::Photos | Input::PhotoFile => &self.pictures,
            Input::Dictionary => &self.dictionaries,
        }
    }
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Found::Capture => "a raw capture",
            Found::LightField => "a light field",
            Found::Array => "a light field or array",
            Found::Calibration => "a calibration",
            Found::Dictionary => "a dictionary",
            Found::Samples => "measured samples",
            Found::Archive => "an archive",
            Found::Picture => "a picture",
            Found::Other => "a file that is not known by its first bytes",
            Found::Folder(contents) => {
                let kinds = contents.kinds();
                let there: Vec<String> = kinds
                    .iter()
                    .filter(|k| k.0.count > 0)
                    .map(|(some, name)| format!("{} {name}", some.count))
                    .collect();
                return match there.as_slice() {
                    [] if contents.is_empty() => f.write_str("an empty folder"),
                    [] => f.write_str("a folder without captures, light fields or pictures"),
                    [all @ .., last] if !all.is_empty() => write!(f, "a folder ({} and {last})", all.join(", ")),
                    _ => write!(f, "a folder ({})", there[0]),
                };
            }
        })
    }
}

fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// What stands at `path`; `None` where nothing does, or nothing that can be opened: the reader says why.
fn look(path: &Path) -> Option<Found> {
    let what = std::fs::metadata(path).ok()?;
    if what.is_dir() {
        if path.join("lightfield.json").is_file() {
            return Some(Found::LightField);
        }
        return Contents::of(path).ok().map(Found::Folder);
    }
    let (file, _) = open_regular(path).ok()?;
    let mut head = Vec::with_capacity(512);
    file.take(512).read_to_end(&mut head).ok()?;
    let starts = |magic: &[u8]| head.starts_with(magic);
    Some(if starts(&MAGIC) {
        Found::Capture
    } else if starts(b"LENSCAL\0") {
        Found::Calibration
    } else if dictionary::Format::detect(&head).is_some() {
        Found::Dictionary
    } else if starts(b"\x93NUMPY") || starts(b"MATLAB") {
        Found::Array
    } else if starts(b"PK\x03\x04") && ending(path) == "npz" {
        Found::Samples
    } else if head.len() == 512 && &head[257..262] == b"ustar" {
        Found::Archive
    } else if starts(b"\x89PNG") || starts(b"\xff\xd8\xff") || starts(b"BM") || starts(b"II*\0") || starts(b"MM\0*") {
        Found::Picture
    } else if matches!(ending(path).as_str(), "raw" | "lfp" | "lfr") {
        Found::Capture
    } else {
        Found::Other
    })
}

/// Whether a reader of `wanted` can be left to say what it makes of it.
fn takes(wanted: Input, found: &Found) -> bool {
    match (wanted, found) {
        (Input::Dictionary | Input::Map | Input::Text | Input::PhotoFile, Found::Folder(_)) => false,
        (Input::CaptureFile | Input::WhiteImage | Input::Container | Input::CalibrationFile, Found::Folder(_)) => false,
        (_, Found::Other) => true,
        (Input::Container, found) => matches!(found, Found::Capture | Found::Archive),
        (Input::Captures, Found::Folder(c)) => c.captures.count + c.pictures.count > 0,
        (Input::Captures | Input::CaptureFile | Input::WhiteImage, found) => {
            matches!(found, Found::Capture | Found::Picture)
        }
        (Input::Bundle, Found::Folder(c)) => c.captures.count + c.folders + c.others > 0,
        (Input::Bundle, found) => matches!(found, Found::Capture | Found::Archive),
        // A folder is searched for calibrations and for white images.
        (Input::Calibrations, Found::Folder(c)) => c.captures.count + c.calibrations.count + c.folders + c.others > 0,
        (Input::Calibrations, found) => matches!(found, Found::Calibration | Found::Archive | Found::Capture),
        (Input::CalibrationFile, found) => matches!(found, Found::Calibration),
        (Input::LightField, Found::Folder(c)) => c.pictures.count + c.unread > 0,
        (Input::LightField, found) => matches!(found, Found::LightField | Found::Array | Found::Picture),
        // Folders within folders are searched.
        (Input::Photos, Found::Folder(c)) => c.pictures.count + c.unread + c.folders > 0,
        (Input::Photos, found) => matches!(found, Found::Picture | Found::LightField),
        (Input::PhotoFile, found) => matches!(found, Found::Picture),
        (Input::Dictionary, found) => matches!(found, Found::Dictionary),
        (Input::Map, found) => matches!(found, Found::Array),
        (Input::Text, _) => false,
    }
}

/// What to do with it instead.
fn advice(path: &Path, wanted: Input, found: &Found) -> String {
    let p = path.display();
    if let Found::Folder(contents) = found {
        let there = contents.wanted(wanted);
        let first = there.first.display();
        match (wanted, there.count) {
            (Input::WhiteImage | Input::CaptureFile, 1..) => {
                return format!(
                    "files are needed: give the files in it ({first} …), or, for a camera's calibration folder, \
                     `lenslet calibrate --bundle {p}`"
                );
            }
            (Input::Text | Input::Map, _) | (_, 0) => {}
            (_, 1) => return format!("give the one in it: {first}"),
            _ => return format!("give one of them, as {first}"),
        }
    }
    match (wanted, found) {
        (Input::WhiteImage | Input::CaptureFile, Found::Folder(c)) if c.folders + c.others > 0 => {
            return format!(
                "files are needed, or, for a camera's calibration folder, `lenslet calibrate --bundle {p}`"
            );
        }
        (Input::Calibrations | Input::CalibrationFile, _) => {
            return "make one with `lenslet calibrate WHITE… --out CAM.calib`".into();
        }
        (Input::Dictionary, _) => return "train one with `lenslet train-dict PHOTO… --out NAME.lfd`".into(),
        _ => {}
    }
    match found {
        Found::Capture => format!("decode it first: `lenslet decode {p} --calibration CAM.calib --out OUT.lf`"),
        Found::Folder(c) if c.captures.count > 0 => {
            format!("decode them first: `lenslet decode {p} --calibration CAM.calib --out LIGHTFIELDS`")
        }
        Found::Folder(c) if c.light_fields.count > 0 => {
            format!("look at one with `lenslet view {} --out page.html`", c.light_fields.first.display())
        }
        Found::LightField | Found::Array => format!(
            "it is decoded already; look at it with `lenslet view {p} --out page.html`, or convert it with `lenslet convert`"
        ),
        Found::Calibration => format!("it belongs to `lenslet decode CAPTURE --calibration {p} --out OUT.lf`"),
        Found::Dictionary => format!("it belongs to `lenslet infer LF --dictionary {p} --out OUT.lf`"),
        Found::Samples => "it belongs to the light field that it lies beside: give that one".into(),
        Found::Archive => format!("it may belong to `lenslet calibrate --bundle {p} --out CALIBRATIONS`"),
        Found::Picture | Found::Other => format!("`lenslet info {p}` says what it is"),
        Found::Folder(_) => format!("give {}", wanted.form()),
    }
}

/// Refuses what a command cannot take, with what it is and what to do. What is not there, or not known, is left to its
/// reader.
pub fn check<'a>(inputs: impl IntoIterator<Item = (&'a Path, Input)>) -> anyhow::Result<()> {
    for (path, wanted) in inputs {
        // A name goes before a folder that happens to have it.
        let named = || path.to_str().is_some_and(|name| reconstruct::embedded_names().any(|own| own == name));
        if wanted == Input::Dictionary && !path.is_file() && named() {
            continue;
        }
        let Some(found) = look(path) else {
            // Of several captures or images the others are used, and a name need not be a file.
            if let (true, Err(e)) = (wanted.alone(), std::fs::metadata(path)) {
                return Err(e).with_context(|| format!("cannot read {}", path.display()));
            }
            continue;
        };
        anyhow::ensure!(
            takes(wanted, &found),
            "{}: {found}, not {wanted}; {}",
            path.display(),
            advice(path, wanted, &found)
        );
    }
    Ok(())
}

/// The same input for each of several paths. Of several captures and images to calibrate from, those that are of another
/// kind are left out with a note when they are opened.
pub fn each(paths: &[PathBuf], wanted: Input) -> impl Iterator<Item = (&Path, Input)> {
    let all = paths.len() == 1 || !matches!(wanted, Input::WhiteImage | Input::CaptureFile);
    paths.iter().filter(move |path| all || path.is_dir()).map(move |path| (path.as_path(), wanted))
}

/// What a folder is, and what to do with it, for one that is nothing.
pub fn explain_folder(path: &Path) -> String {
    let Some(found @ Found::Folder(_)) = look(path) else { return String::new() };
    let Found::Folder(contents) = &found else { return String::new() };
    match contents.kinds().into_iter().find(|k| k.0.count > 0) {
        Some((group, _)) => format!("{found}; look at one of them: `lenslet info {}`", group.first.display()),
        None => found.to_string(),
    }
}
