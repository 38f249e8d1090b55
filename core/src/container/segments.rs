//! The segments of a container (.lfp, .lfr, data.C.n): position, length and expected sha1 of each.
//!
//! Payloads are read only when asked for. Lengths in the file are compared with the file's true length before
//! anything is allocated, and the number of segments is limited.

use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde_json::Value;
use sha1::{Digest, Sha1};
use sha2::Sha256;

use super::error::Error;
use super::{file, json};

/// First 8 bytes of a container.
pub const MAGIC: [u8; 8] = *b"\x89LFP\r\n\x1a\n";
/// Bytes before the payload of a segment.
pub(super) const HEADER: u64 = 96;
/// Most segments of one container; cameras write fewer than a thousand.
/// Source: chosen.
const MAX_SEGMENTS: usize = 1 << 16;
/// Longest run of zeros skipped when the next segment is searched for, bytes.
/// Source: chosen.
const MAX_ZEROS: u64 = 1 << 16;

/// What a segment is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SegmentKind {
    /// `LFM`: table of contents, JSON.
    Contents,
    /// `LFC`: content.
    Content,
    /// Another letter in the third place of its mark.
    Other(u8),
}

impl SegmentKind {
    /// `LFM`, `LFC` or the other mark of the file.
    pub fn name(self) -> String {
        let letter = match self {
            SegmentKind::Contents => b'M',
            SegmentKind::Content => b'C',
            SegmentKind::Other(b) => b,
        };
        format!("LF{}", letter.escape_ascii())
    }
}

/// One segment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Segment {
    /// What it is.
    pub kind: SegmentKind,
    /// Where its header starts in the file.
    pub offset: u64,
    /// Bytes of payload.
    pub length: u64,
    /// `sha1-` and 40 hexadecimal digits, in lower case, as stated in the header.
    pub sha1: String,
}

trait Bytes: Read + Seek + Send {}
impl<T: Read + Seek + Send> Bytes for T {}

/// An open container.
pub struct Container {
    path: PathBuf,
    source: Mutex<Box<dyn Bytes>>,
    /// Segments in file order.
    pub segments: Vec<Segment>,
    /// Anomalies that did not prevent reading, one line each.
    pub warnings: Vec<String>,
}

impl std::fmt::Debug for Container {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Container").field("path", &self.path).field("segments", &self.segments).finish_non_exhaustive()
    }
}

impl Container {
    /// Opens the container at `path` and finds its segments.
    ///
    /// # Errors
    /// When the file cannot be read, is no container, or ends inside a segment.
    pub fn open(path: &Path) -> Result<Container, Error> {
        let (file, length) = file::open(path)?;
        Self::scan(path, Box::new(file), length)
    }

    /// The same for a container in memory; `path` only names it in messages.
    ///
    /// # Errors
    /// As [`Container::open`].
    ///
    /// ```
    /// use lenslet_core::container::segments::{Container, MAGIC, sha1_of};
    ///
    /// let contents = br#"{"frames": []}"#;
    /// let mut bytes = [&MAGIC[..], &[0, 0, 0, 1, 0, 0, 0, 0]].concat(); // file header
    /// bytes.extend(b"\x89LFM\r\n\x1a\n\0\0\0\0"); // segment header: mark, version, length, sha1, padding
    /// bytes.extend((contents.len() as u32).to_be_bytes());
    /// bytes.extend(sha1_of(contents).bytes());
    /// bytes.extend([0; 35]);
    /// bytes.extend(contents);
    ///
    /// let container = Container::from_bytes("memory.lfp".as_ref(), bytes)?;
    /// assert_eq!(container.segments[0].kind.name(), "LFM");
    /// assert!(container.contents()?[0]["frames"].is_array());
    /// # Ok::<(), lenslet_core::container::Error>(())
    /// ```
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Container, Error> {
        let length = bytes.len() as u64;
        Self::scan(path, Box::new(Cursor::new(bytes)), length)
    }

    fn scan(path: &Path, mut source: Box<dyn Bytes>, length: u64) -> Result<Container, Error> {
        let mut head = [0u8; 16];
        if length < 16 {
            return Err(Error::malformed(path, format!("not a light-field container: only {length} bytes long")));
        }
        source.read_exact(&mut head).map_err(Error::io(path))?;
        if head[..8] != MAGIC {
            return Err(Error::not_recognised(
                path,
                "not a light-field container (.lfp, .lfr): its first bytes are not \\x89LFP",
            ));
        }
        let mut segments: Vec<Segment> = Vec::new();
        let mut warnings = Vec::new();
        let (mut position, mut end) = (16u64, 16u64);
        while position < length {
            let Some(mut segment) = header_at(&mut source, position, length).map_err(Error::io(path))? else {
                // No segment at the expected position: only zeros may be left, or the padding may be of another length.
                let Some(next) = skip_zeros(&mut source, end, length).map_err(Error::io(path))? else { break };
                if next != position && header_at(&mut source, next, length).map_err(Error::io(path))?.is_some() {
                    warnings.push(format!("odd padding: a segment expected at byte {position} starts at byte {next}"));
                    position = next;
                    continue;
                }
                if length - next < HEADER && mark_at(&mut source, next).map_err(Error::io(path))? {
                    return Err(Error::malformed(
                        path,
                        format!("cut off: the file ends inside the segment header at byte {next}"),
                    ));
                }
                if segments.is_empty() {
                    return Err(Error::malformed(path, format!("no segment at byte {next}")));
                }
                warnings.push(format!("{} bytes from byte {next} on are no segment and were left out", length - next));
                break;
            };
            let start = position + HEADER;
            if segment.length > length - start {
                return Err(Error::malformed(
                    path,
                    format!(
                        "cut off: the segment at byte {position} should have {} bytes, but the file ends after {} of them; copy the file again",
                        segment.length,
                        length - start
                    ),
                ));
            }
            if segments.len() == MAX_SEGMENTS {
                let (value, limit) = (MAX_SEGMENTS as u64 + 1, MAX_SEGMENTS as u64);
                return Err(Error::Limit { path: path.into(), what: "the number of segments".into(), value, limit });
            }
            end = start + segment.length;
            segment.offset = position;
            segments.push(segment);
            position = end.next_multiple_of(16);
        }
        Ok(Container { path: path.to_path_buf(), source: Mutex::new(source), segments, warnings })
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the payload of a segment.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn payload(&self, segment: &Segment) -> Result<Vec<u8>, Error> {
        self.head(segment, segment.length)
    }

    /// Reads the first `limit` bytes of a segment's payload (all of it, if shorter).
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn head(&self, segment: &Segment, limit: u64) -> Result<Vec<u8>, Error> {
        let length = usize::try_from(segment.length.min(limit)).unwrap_or(usize::MAX);
        // The length was compared with the file's when the segment was found; the file may have shrunk since.
        let mut bytes = Vec::new();
        bytes
            .try_reserve_exact(length)
            .map_err(|e| Error::malformed(&self.path, format!("no memory for a segment: {e}")))?;
        let mut source = self.source.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        source.seek(SeekFrom::Start(segment.offset + HEADER)).map_err(Error::io(&self.path))?;
        source.by_ref().take(length as u64).read_to_end(&mut bytes).map_err(Error::io(&self.path))?;
        if bytes.len() != length {
            return Err(Error::malformed(&self.path, "the file became shorter while it was read"));
        }
        Ok(bytes)
    }

    /// The segment with this reference (`sha1-…`, in either case).
    pub fn find(&self, sha1: &str) -> Option<&Segment> {
        self.segments.iter().find(|s| s.sha1.eq_ignore_ascii_case(sha1))
    }

    /// The payload of `segment`, and a warning when its sha1 is not the one in its header.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn checked(&self, segment: &Segment) -> Result<(Vec<u8>, Option<String>), Error> {
        let bytes = self.payload(segment)?;
        let found = sha1_of(&bytes);
        let warning = (found != segment.sha1).then(|| {
            format!("the segment at byte {} is damaged: it has {found}, not {}", segment.offset, segment.sha1)
        });
        Ok((bytes, warning))
    }

    /// sha256 of the whole file, in hexadecimal.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn sha256(&self) -> Result<String, Error> {
        let mut source = self.source.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        source.seek(SeekFrom::Start(0)).map_err(Error::io(&self.path))?;
        let mut hash = Sha256::new();
        let mut buffer = vec![0u8; 1 << 20];
        loop {
            match source.read(&mut buffer) {
                Ok(0) => return Ok(format!("{:x}", hash.finalize())),
                Ok(n) => hash.update(&buffer[..n]),
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.path)(e)),
            }
        }
    }

    /// Every table of contents, parsed, in file order.
    ///
    /// # Errors
    /// When there is none, or one cannot be parsed.
    pub fn contents(&self) -> Result<Vec<Value>, Error> {
        let mut out = Vec::new();
        for segment in self.segments.iter().filter(|s| s.kind == SegmentKind::Contents) {
            if segment.length > json::MAX_TEXT as u64 {
                let (value, limit) = (segment.length, json::MAX_TEXT as u64);
                return Err(Error::Limit {
                    path: self.path.clone(),
                    what: "the table of contents".into(),
                    value,
                    limit,
                });
            }
            let value = json::parse(&self.payload(segment)?).map_err(|e| {
                Error::malformed(&self.path, format!("table of contents at byte {}: {e}", segment.offset))
            })?;
            out.push(value);
        }
        if out.is_empty() {
            return Err(Error::malformed(&self.path, "the container has no table of contents (no LFM segment)"));
        }
        Ok(out)
    }
}

/// `sha1-` and the hexadecimal digest of `bytes`.
pub fn sha1_of(bytes: &[u8]) -> String {
    format!("sha1-{:x}", Sha1::digest(bytes))
}

/// Whether the bytes at `position` begin a segment mark.
fn mark_at(source: &mut Box<dyn Bytes>, position: u64) -> std::io::Result<bool> {
    source.seek(SeekFrom::Start(position))?;
    let mut mark = Vec::new();
    source.by_ref().take(3).read_to_end(&mut mark)?;
    Ok(b"\x89LF".starts_with(&mark))
}

/// The segment whose header starts at `position`, if one does (its offset is left 0).
fn header_at(source: &mut Box<dyn Bytes>, position: u64, length: u64) -> std::io::Result<Option<Segment>> {
    if length - position < HEADER {
        return Ok(None);
    }
    let mut h = [0u8; HEADER as usize];
    source.seek(SeekFrom::Start(position))?;
    source.read_exact(&mut h)?;
    if h[..3] != MAGIC[..3] || h[4..8] != MAGIC[4..] {
        return Ok(None);
    }
    let kind = match h[3] {
        b'M' => SegmentKind::Contents,
        b'C' => SegmentKind::Content,
        other => SegmentKind::Other(other),
    };
    let payload = u32::from_be_bytes([h[12], h[13], h[14], h[15]]);
    let sha1 =
        h[16..61].iter().map(|b| if b.is_ascii_graphic() { b.to_ascii_lowercase() as char } else { '?' }).collect();
    Ok(Some(Segment { kind, offset: 0, length: u64::from(payload), sha1 }))
}

/// The first byte that is not zero from `position` on; `None` when only zeros follow, or too many.
fn skip_zeros(source: &mut Box<dyn Bytes>, position: u64, length: u64) -> std::io::Result<Option<u64>> {
    source.seek(SeekFrom::Start(position))?;
    let mut bytes = Vec::new();
    source.by_ref().take(MAX_ZEROS.min(length - position)).read_to_end(&mut bytes)?;
    Ok(bytes.iter().position(|&b| b != 0).map(|k| position + k as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(letter: u8, payload: &[u8]) -> Vec<u8> {
        let mut s = b"\x89LF?\r\n\x1a\n\0\0\0\0".to_vec();
        s[3] = letter;
        s.extend((payload.len() as u32).to_be_bytes());
        s.extend(sha1_of(payload).bytes());
        s.extend([0; 35]);
        s.extend(payload);
        s
    }

    fn file(parts: &[&[u8]], padding: usize) -> Vec<u8> {
        let mut f = MAGIC.to_vec();
        f.extend([0, 0, 0, 1, 0, 0, 0, 0]);
        for p in parts {
            f.extend(*p);
            f.resize(f.len().next_multiple_of(padding), 0);
        }
        f
    }

    fn open(bytes: &[u8]) -> Result<Container, Error> {
        Container::from_bytes(Path::new("x.lfp"), bytes.to_vec())
    }

    #[test]
    fn segments_are_found_whatever_their_order() {
        let (m, c) = (segment(b'M', b"{\"a\":1}"), segment(b'C', &[7; 21]));
        for parts in [[&m[..], &c[..]], [&c[..], &m[..]]] {
            let f = file(&parts, 16);
            let container = open(&f).unwrap();
            assert_eq!(container.segments.len(), 2);
            assert!(container.warnings.is_empty());
            assert_eq!(container.contents().unwrap()[0]["a"], 1);
            let s = container.find(&sha1_of(&[7; 21]).to_uppercase()).unwrap();
            assert_eq!(container.checked(s).unwrap(), (vec![7; 21], None));
        }
    }

    #[test]
    fn odd_padding_is_skipped_with_a_warning() {
        let (m, c) = (segment(b'M', b"{\"a\":1}"), segment(b'C', &[7; 21]));
        for padding in [1, 4, 4096] {
            let f = file(&[&m, &c, &c], padding);
            let container = open(&f).unwrap();
            assert_eq!(container.segments.len(), 3, "padding {padding}");
            assert!(!container.warnings.is_empty());
        }
    }

    #[test]
    fn damage_is_named() {
        let (m, c) = (segment(b'M', b"{}"), segment(b'C', &[7; 21]));
        let mut f = file(&[&m, &c], 16);
        let n = f.len();
        f[n - 20] ^= 1;
        let container = open(&f).unwrap();
        let (_, warning) = container.checked(&container.segments[1]).unwrap();
        assert!(warning.unwrap().contains("damaged"));
        f.extend(b"rubbish that is no segment");
        assert!(open(&f).unwrap().warnings[0].contains("no segment"));
    }

    #[test]
    fn every_truncation_is_an_error_or_ends_between_segments() {
        let (m, c) = (segment(b'M', b"{\"a\":1}"), segment(b'C', &[7; 21]));
        let f = file(&[&m, &c], 16);
        let second = 16 + m.len().next_multiple_of(16);
        for n in 0..f.len() {
            match open(&f[..n]) {
                // Only padding was lost, or whole segments.
                Ok(container) => assert!(
                    n == 16 || (16 + m.len()..=second).contains(&n) || n >= second + c.len(),
                    "{n}: {container:?}"
                ),
                Err(e) => assert!(!e.to_string().is_empty()),
            }
        }
    }

    #[test]
    fn stated_lengths_are_not_trusted() {
        let mut c = segment(b'C', &[7; 21]);
        c[12..16].copy_from_slice(&[0xff; 4]);
        assert!(open(&file(&[&c], 16)).unwrap_err().to_string().contains("cut off"));
        let empty = segment(b'C', &[]);
        let parts = vec![&empty[..]; MAX_SEGMENTS + 1];
        assert!(matches!(open(&file(&parts, 16)), Err(Error::Limit { .. })));
    }

    #[test]
    fn text_and_empty_files_are_refused() {
        assert!(open(b"").is_err());
        assert!(matches!(open(b"just some text that is long enough"), Err(Error::NotRecognised { .. })));
    }
}
