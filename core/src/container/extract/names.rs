//! Safe file names: parts of stored names, cleaned, and no two alike.

use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};

/// One path component of characters that every file system takes.
pub(super) fn safe_part(part: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() || "._-+ ()".contains(c) { c } else { '_' };
    let clean: String = part.chars().take(100).map(keep).collect();
    let clean = clean.trim_matches([' ', '.']);
    if clean.is_empty() { "_".into() } else { clean.into() }
}

/// A stored name as a path below a folder: drive letters, `.` and `..` are dropped, unusual characters become `_`.
///
/// ```
/// use lenslet_core::container::extract::safe_path;
///
/// assert_eq!(safe_path("C:\\T1CALIB\\MOD_0001.RAW"), "T1CALIB/MOD_0001.RAW");
/// assert_eq!(safe_path("../../etc/passwd"), "etc/passwd");
/// ```
pub fn safe_path(name: &str) -> String {
    let drive = |p: &str| p.len() == 2 && p.ends_with(':');
    let parts: Vec<&str> =
        name.split(['/', '\\']).filter(|p| !p.trim_matches([' ', '.']).is_empty() && !drive(p)).collect();
    let skip = parts.len().saturating_sub(8);
    let parts: Vec<String> = parts[skip..].iter().map(|p| safe_part(p)).collect();
    if parts.is_empty() { "_".into() } else { parts.join("/") }
}

/// Names given out so far: no two that differ only in case, none that is also a folder of another.
#[derive(Default)]
pub(super) struct Names {
    files: HashSet<String>,
    folders: HashSet<String>,
}

impl Names {
    /// `name`, or a variant of it that no earlier file or folder has.
    pub(super) fn unique(&mut self, name: &str) -> String {
        let free = |n: &str| {
            let n = n.to_ascii_lowercase();
            let parents: Vec<&str> = n.match_indices('/').map(|(i, _)| &n[..i]).collect();
            n != "index.json"
                && !self.files.contains(&n)
                && !self.folders.contains(&n)
                && !parents.iter().any(|p| self.files.contains(*p))
        };
        let (stem, extension) = match name.rsplit_once('.') {
            Some((s, e)) if !e.contains('/') && !s.is_empty() => (s.to_string(), format!(".{e}")),
            _ => (name.to_string(), String::new()),
        };
        let flat = name.replace('/', "_");
        let tries = std::iter::once(name.to_string())
            .chain((2..1000).map(|k| format!("{stem}-{k}{extension}")))
            .chain((0..).map(|k| format!("{k}-{flat}")));
        let chosen = tries.into_iter().find(|n| free(n)).unwrap_or_else(|| name.to_string());
        let lower = chosen.to_ascii_lowercase();
        self.folders.extend(lower.match_indices('/').map(|(i, _)| lower[..i].to_string()));
        self.files.insert(lower);
        chosen
    }
}

/// `name` below `folder`; components that would leave it (there are none after [`safe_path`]) are dropped.
pub(super) fn inside(folder: &Path, name: &str) -> PathBuf {
    let mut path = folder.to_path_buf();
    path.extend(Path::new(name).components().filter(|c| matches!(c, Component::Normal(_))));
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_inside() {
        for (name, expected) in [
            ("C:\\T1CALIB\\MOD_0001.RAW", "T1CALIB/MOD_0001.RAW"),
            ("../../etc/passwd", "etc/passwd"),
            ("/abs/olute", "abs/olute"),
            ("..\\..\\x\u{0}y\n.raw", "x_y_.raw"),
            ("", "_"),
            ("..", "_"),
            ("...", "_"),
            ("a/./b//c", "a/b/c"),
            ("nül/con", "n_l/con"),
        ] {
            assert_eq!(safe_path(name), expected);
        }
        let long = "x/".repeat(500) + &"y".repeat(5000);
        let safe = safe_path(&long);
        assert!(safe.len() < 200 && safe.split('/').count() == 8);
    }

    #[test]
    fn no_two_files_share_a_name() {
        let mut names = Names::default();
        let given: Vec<String> = ["a/b.raw", "A/B.RAW", "a", "a/b.raw/c", "index.json", "x", "x/y"]
            .iter()
            .map(|n| names.unique(n))
            .collect();
        assert_eq!(given, ["a/b.raw", "A/B-2.RAW", "a-2", "0-a_b.raw_c", "index-2.json", "x", "0-x_y"]);
    }
}
