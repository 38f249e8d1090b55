//! Files inside calibration folders: plain files, the members of data.C.n bundles (several volumes), of .tar archives.
//!
//! A member is a stretch of a file; it is read only when asked for.

use std::collections::HashSet;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::error::Error;
use super::segments::{Container, HEADER, MAGIC, SegmentKind};
use super::{file, json, references};

/// Most files looked at in one folder.
/// Source: chosen.
const MAX_FILES: usize = 20_000;
/// Levels of sub-folders searched.
/// Source: chosen.
const MAX_DEPTH: usize = 4;
/// Most volumes of one bundle.
/// Source: chosen.
const MAX_VOLUMES: usize = 100;

/// One file: by itself, or a stretch of a bundle or archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// Its name as stored: a file name, or a camera's path such as `C:\T1CALIB\MOD_0001.RAW`.
    pub name: String,
    /// The file on disk it lies in.
    pub path: PathBuf,
    /// Where in that file it starts.
    pub offset: u64,
    /// Its length in bytes.
    pub length: u64,
    /// Its `sha1-…` as stated by the bundle, if it lies in one.
    pub sha1: Option<String>,
    /// The bundle (its first volume) or archive that it lies in, if it is not a file by itself.
    pub archive: Option<PathBuf>,
}

impl Member {
    /// The last part of the name, in upper case, split at its last dot: (`MOD_0001`, `RAW`).
    pub fn stem_and_extension(&self) -> (String, String) {
        let last = self.name.rsplit(['\\', '/']).next().unwrap_or_default().to_ascii_uppercase();
        match last.rsplit_once('.') {
            Some((stem, extension)) => (stem.to_string(), extension.to_string()),
            None => (last, String::new()),
        }
    }

    /// What it lies in: the archive (empty for plain files) and the folder. Files that belong together have both in common.
    pub fn place(&self) -> (PathBuf, PathBuf) {
        match &self.archive {
            Some(archive) => {
                let folder = self.name.rsplit_once(['\\', '/']).map_or("", |(folder, _)| folder);
                (archive.clone(), PathBuf::from(folder.replace('\\', "/")))
            }
            None => (PathBuf::new(), self.path.parent().map(Path::to_path_buf).unwrap_or_default()),
        }
    }

    /// Reads `length` bytes from `start` of the member on (fewer at its end).
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn part(&self, start: u64, length: u64) -> Result<Vec<u8>, Error> {
        let length = length.min(self.length.saturating_sub(start));
        let (mut file, _) = file::open(&self.path)?;
        file.seek(SeekFrom::Start(self.offset + start)).map_err(Error::io(&self.path))?;
        let mut bytes = Vec::new();
        file.take(length).read_to_end(&mut bytes).map_err(Error::io(&self.path))?;
        Ok(bytes)
    }

    /// Reads all of it.
    ///
    /// # Errors
    /// When it is longer than `limit`, or cannot be read whole.
    pub fn read(&self, limit: u64) -> Result<Vec<u8>, Error> {
        if self.length > limit {
            let what = format!("the length in bytes of {}", self.name);
            return Err(Error::Limit { path: self.path.clone(), what, value: self.length, limit });
        }
        let bytes = self.part(0, self.length)?;
        if bytes.len() as u64 != self.length {
            return Err(Error::malformed(&self.path, format!("{} is cut off", self.name)));
        }
        Ok(bytes)
    }

    /// Its name in messages: the file, and the name inside it where that differs.
    pub fn label(&self) -> String {
        if self.offset == 0 && self.path.to_string_lossy().ends_with(&self.name) {
            self.path.display().to_string()
        } else {
            format!("{}:{}", self.path.display(), self.name)
        }
    }
}

/// The files found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Members {
    /// In order of file name, then place.
    pub list: Vec<Member>,
    /// Anomalies, one line each.
    pub warnings: Vec<String>,
}

/// Every file in a folder (and its sub-folders, and the bundles and archives in them), a bundle, or an archive.
///
/// # Errors
/// When `path` cannot be read or is none of these.
pub fn list_members(path: &Path) -> Result<Members, Error> {
    let mut out = Members::default();
    let mut seen = HashSet::new();
    if std::fs::metadata(path).map_err(Error::io(path))?.is_dir() {
        add_folder(path, 0, &mut seen, &mut out)?;
        return Ok(out);
    }
    if !add_contents_of(path, &mut seen, &mut out)? {
        return Err(Error::not_recognised(path, "not a folder, a calibration bundle (data.C.n) or a .tar archive"));
    }
    Ok(out)
}

fn add_folder(path: &Path, depth: usize, seen: &mut HashSet<PathBuf>, out: &mut Members) -> Result<(), Error> {
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(path).map_err(Error::io(path))? {
        entries.push(entry.map_err(Error::io(path))?.path());
        if entries.len() + out.list.len() > MAX_FILES {
            let (value, limit) = (MAX_FILES as u64 + 1, MAX_FILES as u64);
            return Err(Error::Limit { path: path.into(), what: "the number of files".into(), value, limit });
        }
    }
    entries.sort();
    for entry in entries {
        let Ok(meta) = std::fs::metadata(&entry) else { continue };
        if meta.is_dir() {
            if depth < MAX_DEPTH {
                add_folder(&entry, depth + 1, seen, out)?;
            } else {
                out.warnings.push(format!("{} lies too deep and was left out", entry.display()));
            }
        } else if meta.is_file() {
            match add_contents_of(&entry, seen, out) {
                Ok(true) => {}
                Ok(false) => {
                    let name = entry.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    out.list.push(Member {
                        name,
                        path: entry,
                        offset: 0,
                        length: meta.len(),
                        sha1: None,
                        archive: None,
                    });
                }
                Err(e) => out.warnings.push(format!("left out: {e}")),
            }
        }
    }
    Ok(())
}

/// Adds the members of `path` if it is a bundle or an archive; returns whether it is.
fn add_contents_of(path: &Path, seen: &mut HashSet<PathBuf>, out: &mut Members) -> Result<bool, Error> {
    let canonical = path.canonicalize().map_err(Error::io(path))?;
    if seen.contains(&canonical) {
        return Ok(true);
    }
    let head = file::head(path, 512)?;
    if head.starts_with(&MAGIC) {
        return add_bundle(path, seen, out);
    }
    if head.len() == 512 && &head[257..262] == b"ustar" {
        seen.insert(canonical);
        out.list.extend(list_archive(path)?);
        return Ok(true);
    }
    Ok(false)
}

/// A data.C.n bundle with the volumes it names; false when the container is a capture.
fn add_bundle(path: &Path, seen: &mut HashSet<PathBuf>, out: &mut Members) -> Result<bool, Error> {
    let mut volumes = vec![Container::open(path)?];
    let contents = volumes[0].contents()?;
    if !contents.iter().any(|c| c.get("files").is_some_and(serde_json::Value::is_array)) {
        return Ok(false);
    }
    let mut queue = contents;
    let mut named = Vec::new();
    let mut own = HashSet::new();
    own.insert(path.canonicalize().map_err(Error::io(path))?);
    while let Some(contents) = queue.pop() {
        for entry in contents.get("files").and_then(serde_json::Value::as_array).into_iter().flatten() {
            if let (Some(name), Some(sha1)) = (json::text_at(entry, "name"), json::text_at(entry, "dataRef")) {
                named.push((name, sha1.to_ascii_lowercase()));
            }
        }
        let Some(next) = json::text_at(&contents, "nextFile") else { continue };
        // A file in the same folder, never a path to elsewhere.
        if next.contains(['/', '\\']) || next == ".." {
            out.warnings
                .push(format!("{}: the next volume `{next}` is not a plain file name; ignored", path.display()));
            continue;
        }
        let beside = path.with_file_name(&next);
        let volume = beside.canonicalize().map_err(Error::io(&beside)).and_then(|c| {
            let new = own.len() < MAX_VOLUMES && own.insert(c);
            if new { Container::open(&beside).map(Some) } else { Ok(None) }
        });
        match volume {
            Ok(Some(volume)) => {
                // A later volume need not have a table of contents.
                queue.extend(volume.contents().unwrap_or_default());
                volumes.push(volume);
            }
            Ok(None) => {}
            Err(e) => out.warnings.push(format!("{}: its next volume: {e}", path.display())),
        }
    }
    let order: HashSet<&str> = named.iter().map(|(_, s)| s.as_str()).collect();
    let mut found = Vec::new();
    for (name, sha1) in &named {
        let place = volumes.iter().enumerate().find_map(|(k, v)| Some((k, v.find(sha1)?)));
        match place {
            Some((k, s)) => found.push((
                k,
                Member {
                    name: name.clone(),
                    path: volumes[k].path().to_path_buf(),
                    offset: s.offset + HEADER,
                    length: s.length,
                    sha1: Some(sha1.clone()),
                    archive: Some(path.to_path_buf()),
                },
            )),
            None => out.warnings.push(format!("{}: {name} ({sha1}) is named but not in the bundle", path.display())),
        }
    }
    let unnamed = volumes
        .iter()
        .flat_map(|v| &v.segments)
        .filter(|s| s.kind == SegmentKind::Content && !order.contains(s.sha1.as_str()) && references::is_sha1(&s.sha1));
    let count = unnamed.count();
    if count > 0 {
        out.warnings.push(format!("{}: {count} segments that its contents do not name", path.display()));
    }
    found.sort_by_key(|(k, m)| (*k, m.offset));
    out.list.extend(found.into_iter().map(|(_, m)| m));
    for v in &volumes {
        out.warnings.extend(v.warnings.iter().map(|w| format!("{}: {w}", v.path().display())));
    }
    seen.extend(own);
    Ok(true)
}

/// The regular files of a .tar archive (ustar; names up to 255 bytes).
fn list_archive(path: &Path) -> Result<Vec<Member>, Error> {
    let (mut file, length) = file::open(path)?;
    let mut out = Vec::new();
    let (mut position, mut head) = (0u64, [0u8; 512]);
    while position + 512 <= length {
        file.seek(SeekFrom::Start(position)).map_err(Error::io(path))?;
        file.read_exact(&mut head).map_err(Error::io(path))?;
        if head.iter().all(|&b| b == 0) {
            break;
        }
        let text = |range: std::ops::Range<usize>| {
            let field = &head[range];
            let end = field.iter().position(|&b| b == 0).unwrap_or(field.len());
            String::from_utf8_lossy(&field[..end]).trim().to_string()
        };
        let size = u64::from_str_radix(&text(124..136), 8)
            .ok()
            .filter(|s| &head[257..262] == b"ustar" && *s <= length - position - 512)
            .ok_or_else(|| Error::malformed(path, format!("the archive is cut off or damaged at byte {position}")))?;
        if matches!(head[156], 0 | b'0') {
            let (prefix, name) = (text(345..500), text(0..100));
            let name = if prefix.is_empty() { name } else { format!("{prefix}/{name}") };
            out.push(Member {
                name,
                path: path.to_path_buf(),
                offset: position + 512,
                length: size,
                sha1: None,
                archive: Some(path.to_path_buf()),
            });
        }
        if out.len() > MAX_FILES {
            let (value, limit) = (MAX_FILES as u64 + 1, MAX_FILES as u64);
            return Err(Error::Limit { path: path.into(), what: "the number of files".into(), value, limit });
        }
        position += 512 + size.next_multiple_of(512);
    }
    Ok(out)
}
