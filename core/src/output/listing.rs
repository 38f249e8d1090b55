//! What lenslet wrote into a folder: the list that lies in it, by which it is recognised later.
//!
//! While a folder is written, [`JOURNAL`] names every file before it is created, so that what a killed run left can be
//! removed without touching anything else. When it is complete, [`LIST`] holds every file's length and CRC-32. A folder
//! is lenslet's own as long as everything in it is on the list and has not changed; files may be missing.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};

use serde::{Deserialize, Serialize};

use crate::input::{open_regular, read_regular};

/// Name of the list in a complete folder.
pub const LIST: &str = ".lenslet";
/// Name of the journal in a folder that is being written.
pub(super) const JOURNAL: &str = ".lenslet-journal";
/// Longest list that is read, bytes.
/// Source: chosen.
const MAX_LIST: u64 = 64 << 20;

/// Length and CRC-32 of a file's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Stamp(u64, u32);

impl Stamp {
    /// That of these bytes.
    pub(super) fn of(bytes: &[u8]) -> Stamp {
        let mut crc = flate2::Crc::new();
        crc.update(bytes);
        Stamp(bytes.len() as u64, crc.sum())
    }

    /// That of a regular file; nothing else is opened.
    fn of_file(path: &Path) -> io::Result<Stamp> {
        let mut file = flate2::CrcReader::new(open_regular(path)?.0);
        let length = io::copy(&mut file, &mut io::sink())?;
        Ok(Stamp(length, file.crc().sum()))
    }
}

/// The list of a folder.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct List {
    /// Program and version.
    tool: String,
    /// Files by their place in the folder, parts separated by `/`; several stamps where one is being replaced.
    files: BTreeMap<String, Vec<Stamp>>,
    /// The folder's name while another takes it, on file systems that cannot exchange two names in one step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    aside: Option<String>,
}

/// A place in a folder as the list has it; `None` where it is no text or not inside.
fn listed_name(root: &Path, path: &Path) -> Option<String> {
    let inside = path.strip_prefix(root).ok()?;
    let parts: Option<Vec<&str>> = inside
        .components()
        .map(|c| match c {
            std::path::Component::Normal(part) => part.to_str(),
            _ => None,
        })
        .collect();
    parts.filter(|p| !p.is_empty()).map(|p| p.join("/"))
}

impl List {
    /// The list in a folder, where there is one.
    pub(super) fn read(folder: &Path) -> Option<List> {
        let bytes = read_regular(&folder.join(LIST), MAX_LIST).ok()?;
        let list: List = serde_json::from_slice(&bytes).ok()?;
        list.tool.starts_with("lenslet ").then_some(list)
    }

    /// A list without files.
    pub(super) fn empty() -> List {
        List { tool: concat!("lenslet ", env!("CARGO_PKG_VERSION")).into(), files: BTreeMap::new(), aside: None }
    }

    /// Its bytes as a file.
    pub(super) fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes = serde_json::to_vec(self)?;
        bytes.push(b'\n');
        Ok(bytes)
    }

    /// Notes the name that another folder is about to take.
    pub(super) fn step_aside_from(&mut self, name: &str) {
        self.aside = Some(name.to_string());
    }

    /// That name, where it is one.
    pub(super) fn stepped_aside_from(&self) -> Option<String> {
        let name = self.aside.clone()?;
        (Path::new(&name).file_name() == Some(name.as_ref())).then_some(name)
    }

    /// Whether a file is on the list with the bytes it has now, or absent from both.
    pub(super) fn owns(&self, folder: &Path, name: &str) -> bool {
        let path = folder.join(name);
        if path.symlink_metadata().is_err() {
            return true;
        }
        self.files.get(name).is_some_and(|stamps| Stamp::of_file(&path).is_ok_and(|s| stamps.contains(&s)))
    }

    /// Whether a file is on the list, whatever it holds by now.
    pub(super) fn names(&self, name: &str) -> bool {
        self.files.contains_key(name)
    }

    /// Adds what a file may hold, besides what it held.
    pub(super) fn expect(&mut self, name: &str, stamp: Stamp) {
        let stamps = self.files.entry(name.to_string()).or_default();
        if stamps.len() > 1 {
            stamps.remove(0);
        }
        if !stamps.contains(&stamp) {
            stamps.push(stamp);
        }
    }

    /// What the list of a complete folder says: every name of the journal, with its bytes.
    ///
    /// # Errors
    /// When a file is missing, or something else is there.
    fn of_complete(folder: &Path, names: &BTreeSet<String>) -> io::Result<List> {
        let mut list = List::empty();
        for name in names.iter().filter(|n| !n.ends_with('/')) {
            let path = folder.join(name);
            // A file that was created, and given up again, is no part of the output.
            if path.symlink_metadata().is_ok() {
                list.files.insert(name.clone(), vec![Stamp::of_file(&path)?]);
            }
        }
        let expected: BTreeSet<String> = list.files.keys().cloned().collect();
        match foreign(folder, &expected, names)? {
            None => Ok(list),
            Some(other) => Err(io::Error::other(format!("{other} appeared in it while it was written"))),
        }
    }

    /// Why a folder is not, or no longer, what this list says; `None` where it is. `quick` compares lengths only.
    pub(super) fn contradiction(&self, folder: &Path, quick: bool) -> io::Result<Option<String>> {
        let names: BTreeSet<String> = self.files.keys().cloned().collect();
        if let Some(other) = foreign(folder, &names, &BTreeSet::new())? {
            return Ok(Some(format!("it holds {other}, which lenslet did not write")));
        }
        for (name, stamps) in &self.files {
            let path = folder.join(name);
            let Ok(meta) = path.symlink_metadata() else { continue };
            let same = stamps.iter().any(|s| s.0 == meta.len()) && (quick || stamps.contains(&Stamp::of_file(&path)?));
            if !same {
                return Ok(Some(format!("its {name} was changed after lenslet wrote it")));
            }
        }
        Ok(None)
    }

    /// Removes the files on the list, then the folders that are empty then, and the folder itself.
    pub(super) fn remove(&self, folder: &Path) -> io::Result<()> {
        remove_names(folder, self.files.keys().cloned().collect())
    }
}

/// The first thing in a folder that is neither a regular file named in `files`, nor a folder that holds one (or is named
/// in `folders` with a `/` at its end), nor the list or the journal.
fn foreign(folder: &Path, files: &BTreeSet<String>, folders: &BTreeSet<String>) -> io::Result<Option<String>> {
    let mut known: BTreeSet<String> = folders.iter().filter_map(|n| n.strip_suffix('/').map(String::from)).collect();
    for name in files.iter().map(String::as_str).chain(folders.iter().map(String::as_str)) {
        known.extend(name.match_indices('/').map(|(at, _)| name[..at].to_string()));
    }
    let device = device_of(&fs::symlink_metadata(folder)?);
    let mut waiting = vec![folder.to_path_buf()];
    while let Some(place) = waiting.pop() {
        for entry in fs::read_dir(&place)? {
            let path = entry?.path();
            let meta = path.symlink_metadata()?;
            let name = listed_name(folder, &path);
            let own = match &name {
                _ if device_of(&meta) != device => false,
                Some(name) if meta.is_dir() => known.contains(name),
                Some(name) if meta.is_file() => files.contains(name) || name == LIST || name == JOURNAL,
                _ => false,
            };
            if !own {
                let shown = path.strip_prefix(folder).unwrap_or(&path).display().to_string();
                return Ok(Some(shown));
            }
            if meta.is_dir() {
                waiting.push(path);
            }
        }
    }
    Ok(None)
}

#[cfg(unix)]
pub(super) fn device_of(meta: &fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::dev(meta)
}

/// Not known on this system.
#[cfg(not(unix))]
pub(super) fn device_of(_: &fs::Metadata) -> u64 {
    0
}

fn remove_names(folder: &Path, names: BTreeSet<String>) -> io::Result<()> {
    let mut folders = BTreeSet::new();
    for name in &names {
        folders.extend(name.match_indices('/').map(|(at, _)| name[..at].to_string()));
        let path = folder.join(name);
        if !name.ends_with('/') && path.symlink_metadata().is_ok_and(|m| m.is_file()) {
            fs::remove_file(path)?;
        }
    }
    // Those within others come later in the order of names.
    for name in folders.iter().rev() {
        let _ = fs::remove_dir(folder.join(name));
    }
    for name in [LIST, JOURNAL] {
        let _ = fs::remove_file(folder.join(name));
    }
    fs::remove_dir(folder)
}

/// Names of the files of a folder that is being written, on disk before each file is created.
#[derive(Debug)]
pub(super) struct Journal {
    root: PathBuf,
    names: Mutex<BTreeSet<String>>,
    file: Mutex<File>,
}

impl Journal {
    /// Starts the journal of a new, empty folder.
    pub(super) fn start(root: &Path) -> io::Result<Journal> {
        let file = File::create_new(root.join(JOURNAL))?;
        Ok(Journal { root: root.to_path_buf(), names: Mutex::default(), file: Mutex::new(file) })
    }

    /// The folder.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Names a file (or a folder) that is about to be created.
    pub(super) fn add(&self, path: &Path, folder: bool) -> io::Result<()> {
        let refused =
            || io::Error::new(io::ErrorKind::InvalidInput, "a name that is no text, or not inside the output");
        let mut name = listed_name(&self.root, path).ok_or_else(refused)?;
        if folder {
            name.push('/');
        }
        let mut line = serde_json::to_vec(&name)?;
        line.push(b'\n');
        if locked(&self.names)?.insert(name) {
            locked(&self.file)?.write_all(&line)?;
        }
        Ok(())
    }

    /// Replaces the journal by the list of the complete folder.
    pub(super) fn close(&self) -> io::Result<()> {
        let list = List::of_complete(&self.root, &*locked(&self.names)?)?;
        let mut file = File::create_new(self.root.join(LIST))?;
        file.write_all(&list.to_bytes()?)?;
        file.sync_data()?;
        fs::remove_file(self.root.join(JOURNAL))
    }

    /// Removes the files named so far, and the folder if nothing else is in it.
    pub(super) fn discard(&self) -> io::Result<()> {
        let names = match self.names.lock() {
            Ok(names) => names.clone(),
            Err(broken) => broken.into_inner().clone(),
        };
        remove_names(&self.root, names)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> io::Result<MutexGuard<'_, T>> {
    mutex.lock().map_err(|_| io::Error::other("a thread failed while it wrote the journal"))
}

/// Removes what a killed run left in an unfinished folder: the files its journal or its list names, nothing else.
pub(super) fn remove_unfinished(folder: &Path) -> io::Result<()> {
    if let Ok((file, length)) = open_regular(&folder.join(JOURNAL)) {
        let mut bytes = Vec::new();
        file.take(length.min(MAX_LIST)).read_to_end(&mut bytes)?;
        // The last line may be cut off; its file was not yet created.
        let lines = bytes.split(|&b| b == b'\n').filter_map(|line| serde_json::from_slice::<String>(line).ok());
        let inside = |name: &String| Path::new(name).components().all(|c| matches!(c, std::path::Component::Normal(_)));
        return remove_names(folder, lines.filter(inside).collect());
    }
    match List::read(folder) {
        Some(list) if list.contradiction(folder, false)?.is_none() => list.remove(folder),
        Some(_) => Ok(()),
        None => fs::remove_dir(folder),
    }
}
