//! Folders of numbered pictures, one per view, as other tools leave them: `view_3_5.png`, `input_Cam042.png`,
//! `IMG_0001_017_02_04.png` and the like.

use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::colour::ColourSpace;
use super::error::{Error, absent, io_at, malformed, unsupported};
use super::format::ReadOptions;
use super::image_file;
use super::meta::Meta;
use super::names::{Arrangement, Order, arrange_names};
use super::parallax::{Rows, rows_of};
use super::value_range::PictureRange;
use super::view_io::{Numbering, ViewSource, tell_absent};
use crate::picture_file::{ENDINGS, READ, UNREAD_ENDINGS};

/// Most files looked at in a folder.
/// Source: chosen.
const MAX_FILES: usize = 1 << 17;

/// Reads a folder of numbered pictures.
pub(super) struct Reader {
    folder: PathBuf,
    /// Row-major; `None` where a view is absent.
    names: Vec<Option<String>>,
    meta: Meta,
    range: PictureRange,
    notes: Vec<String>,
    numbering: Numbering,
    stored: u64,
}

impl Reader {
    pub(super) fn open(folder: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let (mut names, mut unread) = (Vec::new(), Vec::new());
        for entry in std::fs::read_dir(folder).map_err(io_at(folder))?.take(MAX_FILES) {
            let entry = entry.map_err(io_at(folder))?;
            // Names that are not text have no numbers; other files do not matter.
            let Some(name) = entry.file_name().to_str().map(str::to_string) else { continue };
            match kind_of_name(&name) {
                Some(Ok(())) => names.push(name),
                Some(Err(format)) => unread.push((name, format)),
                None => {}
            }
        }
        if names.len() < unread.len()
            && let Some((name, format)) = unread.first()
        {
            let reason = format!(
                "{} of its pictures ({name} …) are {format}, which is not read: convert them to PNG ({READ} are read)",
                unread.len()
            );
            return Err(unsupported(folder, reason));
        }
        let mut found = arrange_names(names, options.views).map_err(|reason| malformed(folder, reason))?;
        found.left_out.extend(unread.into_iter().map(|(name, _)| name));
        let Some(first) = found.names.iter().flatten().next() else { return Err(malformed(folder, "no pictures")) };
        let image_file::Shape { width, height, channels } = image_file::read_shape(&folder.join(first))?;
        let mut meta = Meta::new(found.views, [height, width], channels, options.colour.unwrap_or(ColourSpace::Srgb));
        meta.check().map_err(|e| malformed(folder, e.to_string()))?;
        let mut notes: Vec<String> = check_order(folder, &found)?.into_iter().collect();
        notes.extend(found.left_out_note());
        let missing = found.missing();
        if !missing.is_empty() {
            notes.push(tell_absent(folder, &meta, &missing, options.partial)?);
            meta.weights = Some(found.names.iter().map(|n| f32::from(u8::from(n.is_some()))).collect());
        }
        let notes = notes.into_iter().map(|note| format!("{}: {note}", folder.display())).collect();
        let range = if options.header_only {
            PictureRange::default()
        } else {
            let middle = found.names.len() / 2;
            let sample = found.names[middle].as_ref().unwrap_or(first);
            PictureRange::of(&folder.join(sample), options.full_scale)?
        };
        let length = |name: &String| std::fs::metadata(folder.join(name)).map_or(0, |m| m.len());
        let stored = found.names.iter().flatten().map(length).sum();
        let numbering = if found.order == Order::Named { Numbering::Pairs } else { Numbering::Running };
        let (folder, names) = (folder.to_path_buf(), found.names);
        let mut reader = Reader { folder, names, meta, range, notes, numbering, stored };
        reader.notes.extend(reader.range.note.clone());
        Ok(reader)
    }
}

/// Compares an order that follows from a count with the pictures themselves.
fn check_order(folder: &Path, found: &Arrangement) -> Result<Option<String>, Error> {
    if found.order == Order::Named || !found.missing().is_empty() {
        return Ok(None);
    }
    let names: Vec<&str> = found.names.iter().flatten().map(String::as_str).collect();
    let ([rows, columns], n) = (found.views, names.len());
    let looks = match rows_of(folder, &names, columns)? {
        Rows::Confirmed | Rows::Unknown => return Ok(None),
        Rows::Other(one) if one == n => "one single row or column of views".to_string(),
        Rows::Other(other) => format!("rows of {other} views"),
    };
    if found.order == Order::Stated {
        return Ok(Some(format!(
            "taken as {rows}x{columns} views as --views says, though the pictures look like {looks}"
        )));
    }
    let reason = format!(
        "{n} numbered pictures, {rows}x{columns} views by their count, but by their parallax they are {looks}: state how they \
         are arranged with --views ROWSxCOLUMNS (counting absent views), or add what is missing"
    );
    Err(unsupported(folder, reason))
}

impl ViewSource for Reader {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn numbering(&self) -> Numbering {
        self.numbering
    }

    fn stored_bytes(&self) -> Option<u64> {
        Some(self.stored)
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        self.meta.check_place(v, u)?;
        match &self.names[v * self.meta.views[1] + u] {
            Some(name) => Ok(self.range.apply(image_file::read_view(&self.folder.join(name), &self.meta)?)),
            None => Err(absent(&self.folder, v, u)),
        }
    }

    fn is_absent(&self, v: usize, u: usize) -> Result<bool, Error> {
        self.meta.check_place(v, u)?;
        Ok(self.names[v * self.meta.views[1] + u].is_none())
    }
}

/// Whether a name is that of a picture; the format, if it is one that is not read.
fn kind_of_name(name: &str) -> Option<Result<(), &'static str>> {
    let (stem, ending) = name.rsplit_once('.')?;
    if stem.is_empty() || stem.starts_with('.') {
        return None;
    }
    let ending = ending.to_ascii_lowercase();
    if ENDINGS.contains(&ending.as_str()) {
        return Some(Ok(()));
    }
    UNREAD_ENDINGS.iter().find(|(e, _)| *e == ending).map(|(_, format)| Err(*format))
}
