//! As much of Markdown as the checks of documents need: code, links, headings, tables.

use std::path::{Path, PathBuf};

/// A document of the repository.
pub struct Document {
    /// From the root of the checkout.
    pub name: String,
    pub text: String,
}

/// A piece of code, inline or a line of a fenced block, and the line it stands on.
pub struct Code {
    pub line: usize,
    pub text: String,
    pub fenced: bool,
    /// In a block of the language `sh`.
    pub shell: bool,
}

/// A table: its first line, what `<!-- measured: … -->` above it says, its rows of cells.
pub struct Table {
    pub line: usize,
    pub comment: Option<String>,
    pub rows: Vec<Vec<String>>,
}

impl Document {
    /// All documents below the root, but for those that nobody keeps (build output) and those of fixtures.
    pub fn all(root: &Path) -> Vec<Document> {
        let mut out = Vec::new();
        let mut folders = vec![root.to_path_buf()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                if path.is_dir() {
                    if !name.starts_with('.') && !["target", "out", "node_modules"].contains(&name.as_str()) {
                        folders.push(path);
                    }
                } else if name.ends_with(".md") {
                    let text = std::fs::read_to_string(&path).unwrap();
                    out.push(Document { name: path.strip_prefix(root).unwrap().display().to_string(), text });
                }
            }
        }
        out.sort_by(|a, b| a.name.cmp(&b.name));
        out
    }

    /// Its lines, numbered from 1, with whether they are inside a fenced block (fences are not told).
    fn lines(&self) -> Vec<(usize, &str, bool)> {
        self.lines_with_language().into_iter().map(|(n, line, fenced, _)| (n, line, fenced)).collect()
    }

    /// The same with the language of the block.
    fn lines_with_language(&self) -> Vec<(usize, &str, bool, &str)> {
        let (mut fenced, mut language) = (false, "");
        let mut out = Vec::new();
        for (n, line) in self.text.lines().enumerate() {
            if let Some(tag) = line.trim_start().strip_prefix("```") {
                fenced = !fenced;
                language = if fenced { tag.trim() } else { "" };
            } else {
                out.push((n + 1, line, fenced, language));
            }
        }
        out
    }

    /// All code: inline spans (also those that go over a line's end) and the lines of fenced blocks, where a line that
    /// ends in `\` goes on in the next.
    pub fn code(&self) -> Vec<Code> {
        let mut out: Vec<Code> = Vec::new();
        let mut open: Option<Code> = None;
        let mut joined = false;
        for (line, text, fenced, language) in self.lines_with_language() {
            let shell = language == "sh";
            if fenced {
                open = None;
                let text = text.split(" #").next().unwrap_or_default().trim();
                let (text, goes_on) = text.strip_suffix('\\').map_or((text, false), |t| (t, true));
                match out.last_mut().filter(|_| joined) {
                    Some(last) => last.text.push_str(&format!(" {text}")),
                    None => out.push(Code { line, text: text.to_owned(), fenced, shell }),
                }
                joined = goes_on;
                continue;
            }
            joined = false;
            if text.trim().is_empty() || text.starts_with('#') {
                open = None;
            }
            if let Some(code) = &mut open {
                code.text.push(' ');
            }
            for c in text.chars() {
                match (&mut open, c) {
                    (Some(_), '`') => out.extend(open.take()),
                    (None, '`') => open = Some(Code { line, text: String::new(), fenced, shell }),
                    (Some(code), c) => code.text.push(c),
                    (None, _) => {}
                }
            }
        }
        out
    }

    /// Targets of links and pictures, with their lines.
    pub fn links(&self) -> Vec<(usize, String)> {
        let mut out = Vec::new();
        for (line, text, fenced) in self.lines() {
            for (opening, closing) in [("](", ')'), ("src=\"", '"'), ("href=\"", '"')] {
                for (at, _) in text.match_indices(opening).filter(|_| !fenced) {
                    let rest = &text[at + opening.len()..];
                    if let Some(end) = rest.find(closing) {
                        out.push((line, rest[..end].to_owned()));
                    }
                }
            }
        }
        out
    }

    /// The anchors of its headings, as GitHub makes them.
    pub fn anchors(&self) -> Vec<String> {
        let headings = self.lines().into_iter().filter(|(_, text, fenced)| !fenced && text.starts_with('#'));
        let slug = |text: &str| {
            let text = text.trim_start_matches('#').trim().to_lowercase();
            let kept = text.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
            kept.map(|c| if c == ' ' { '-' } else { c }).collect()
        };
        headings.map(|(_, text, _)| slug(text)).collect()
    }

    /// Its tables.
    pub fn tables(&self) -> Vec<Table> {
        let mut out: Vec<Table> = Vec::new();
        let (mut inside, mut comment): (bool, Option<String>) = (false, None);
        let mut commenting = false;
        for (line, text, fenced) in self.lines() {
            let text = text.trim();
            let is_row = !fenced && text.starts_with('|') && text.len() > 1;
            if commenting {
                // A comment over several lines.
                let said = comment.get_or_insert_default();
                said.push_str(&format!(" {}", text.trim_end_matches("-->").trim()));
                commenting = !text.ends_with("-->");
            } else if is_row {
                let cells = text.trim_matches('|').split('|').map(|c| c.trim().to_owned()).collect();
                if !inside {
                    out.push(Table { line, comment: comment.take(), rows: Vec::new() });
                }
                out.last_mut().unwrap().rows.push(cells);
            } else if let Some(said) = text.strip_prefix("<!-- measured:") {
                comment = Some(said.trim_end_matches("-->").trim().to_owned());
                commenting = !text.ends_with("-->");
            } else if !text.is_empty() {
                comment = None;
            }
            inside = is_row;
        }
        out
    }
}

impl Table {
    /// Whether it tells measurements: a quarter of its cells, and three at least, have a number with a fraction or a
    /// percentage.
    pub fn has_measurements(&self) -> bool {
        let cells: Vec<&String> = self.rows.iter().skip(2).flat_map(|row| row.iter().skip(1)).collect();
        let measured = |cell: &&&String| {
            let text = cell.trim_start_matches(['*', '−', '-', '+', '<', '.', ' ']);
            let fraction = text.as_bytes().windows(2).any(|w| w[0] == b'.' && w[1].is_ascii_digit());
            text.starts_with(|c: char| c.is_ascii_digit()) && (fraction || cell.contains(" %"))
        };
        let count = cells.iter().filter(measured).count();
        count >= 3 && 4 * count >= cells.len()
    }
}

/// The folder of the checkout.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}
