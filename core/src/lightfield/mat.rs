//! MATLAB files, level 5 (MathWorks, "MAT-File Format"): the light field is an array of 4 or 5 dimensions
//! (v, u, t, s[, c]) in column-major order, plain or compressed; a fourth channel is a weight.
//!
//! LFToolbox writes such an `LF` (uint16, 65535 = 1, weight last); the networks of the BasicLFSR family read one
//! (0..1). A second variable `lenslet` holds the description of what this project writes.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use flate2::read::ZlibDecoder;
use ndarray::Array3;

use super::axes::lay_out;
use super::block::{BlockLayout, BlockViews, SampleBlock};
use super::colour::ColourSpace;
use super::companion::{Companion, MAX_TEXT, fingerprint_by, fingerprint_of};
use super::error::{Error, io_at, malformed, unsupported};
use super::format::ReadOptions;
use super::meta::Meta;
use super::sample::{SampleFormat, SampleKind};
use super::value_range::{Extent, full_scale};
use super::view_io::{Numbering, ViewSink, check_all_written, relative_weights};
use crate::input::open_regular;
use crate::output::Pending;
use crate::picture_file::may_expand;

/// First bytes of a level 5 file.
pub(super) const MAGIC: &[u8] = b"MATLAB 5.0 MAT-file";
/// First bytes of a level 7.3 file, which is HDF5 behind the same kind of header.
const MAGIC_73: &[u8] = b"MATLAB 7.3 MAT-file";
/// First bytes of an HDF5 file.
const MAGIC_HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Length of a file's header, bytes.
const HEADER: u64 = 128;
/// The variable that holds the description.
const DESCRIPTION: &str = "lenslet";
/// Bytes behind the numbers of an array that are looked at.
const MAX_PADDING: u64 = 64;
/// Most variables looked at.
const MAX_VARIABLES: usize = 10_000;
/// Most dimensions of an array.
const MAX_DIMENSIONS: usize = 32;
/// Longest name of a variable, bytes.
const MAX_NAME: u64 = 256;
/// Largest array read or written, bytes; level 5 itself ends at 2 GiB.
const MAX_ARRAY: u64 = (1 << 31) - 4096;

// Data types, array classes and flags of the format (tables 1-1 and 1-3).
const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;
const MI_INT8: u32 = 1;
const MI_INT32: u32 = 5;
const MI_UINT32: u32 = 6;
const MI_SINGLE: u32 = 7;
const MI_UINT16: u32 = 4;
const CLASS_SINGLE: u8 = 7;
const CLASS_CHAR: u8 = 4;
const COMPLEX: u8 = 0x08;

/// Refuses MATLAB files that [`open`] cannot read, with advice. `head`: the first bytes.
pub(super) fn refuse_level_73(path: &Path, head: &[u8]) -> Result<(), Error> {
    let hdf5 = head.starts_with(MAGIC_HDF5) || head.get(512..).is_some_and(|h| h.starts_with(MAGIC_HDF5));
    if hdf5 || head.starts_with(MAGIC_73) {
        let reason = "a MATLAB 7.3 (HDF5) file; save it in MATLAB with save(FILE, 'LF', '-v7'), or in Python with \
                      numpy.save('LF.npy', h5py.File(FILE)['LF'][()].T)";
        return Err(unsupported(path, reason));
    }
    Ok(())
}

/// An array's description, read from the head of its element.
#[derive(Debug, Clone)]
struct Array {
    name: String,
    class: u8,
    complex: bool,
    dims: Vec<u64>,
    stored: SampleFormat,
    bytes: u64,
}

/// Position of an element in the file.
#[derive(Debug, Clone, Copy)]
struct Place {
    start: u64,
    length: u64,
    compressed: bool,
}

/// Reads the light field of a MATLAB file, kept in memory as stored.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<BlockViews, Error> {
    let (mut file, _) = open_regular(path).map_err(io_at(path))?;
    let length = file.metadata().map_err(io_at(path))?.len();
    let big = read_byte_order(&mut file, path)?;
    let (place, array, description) = find_light_field(&mut file, path, length, big)?;
    let bad = |what: String| unsupported(path, format!("variable {}: {what}", array.name));
    if array.complex {
        return Err(bad("complex numbers".into()));
    }
    let Some(scale) = scale_of(array.class) else {
        return Err(bad("its numbers are of a type with no agreed meaning; save it as single or uint16".into()));
    };
    let sides: Vec<usize> = array.dims.iter().map(|&n| usize::try_from(n).unwrap_or(usize::MAX)).collect();
    let layout = lay_out(&sides, true, options.axes.as_ref(), options.views).map_err(bad)?;
    let colour = options.colour.unwrap_or(ColourSpace::Srgb);
    let mut meta = Meta::new(layout.views, layout.size, layout.channels(), colour);
    meta.check().map_err(|e| bad(e.to_string()))?;
    // Meta::check bounds every factor, so the product stays far below 2^64.
    let [[rows, columns], [height, width]] = [layout.views, layout.size];
    let values = (rows * columns) as u64 * (height * width * layout.stored) as u64;
    let expected = values * array.stored.kind.bytes() as u64;
    if array.bytes != expected {
        return Err(malformed(
            path,
            format!("variable {} has {} bytes, its shape needs {expected}", array.name, array.bytes),
        ));
    }
    if expected > MAX_ARRAY {
        return Err(bad(format!("{} MiB are too many", expected >> 20)));
    }
    let mut notes = Vec::new();
    let (mut bytes, mut scale) = (Vec::new(), scale);
    // Without its numbers, a description cannot be told from another's.
    let mut fingerprint = None;
    if !options.header_only {
        if !may_expand(expected, place.length) {
            let (mib, length) = (expected >> 20, place.length);
            return Err(bad(format!("{mib} MiB out of {length} compressed bytes; save it as .npy if it is so")));
        }
        bytes = read_numbers(&mut file, path, place, big, expected)?;
        let mut extent = Extent::default();
        extent.add(array.stored, &bytes);
        let kind = kind_of(array.class);
        let at = |k: u64| place_of(k, &sides);
        let (full, note) = if layout.stored == 4 {
            (options.full_scale.unwrap_or(scale), None)
        } else {
            full_scale(path, kind, &extent, options.full_scale, at)?
        };
        scale = full;
        notes.extend(note);
        fingerprint = Some(fingerprint_of(&bytes));
    }
    let mut numbering = Numbering::Pairs;
    match description {
        Some(place) => {
            let text = read_description(&mut file, place, big).map_err(|e| e.to_string());
            let found = text.and_then(|text| Companion::from_text(&text)).and_then(|found| match &fingerprint {
                Some(own) => found.of(&meta, own),
                None => found.of_shape(&meta),
            });
            match found {
                Ok(described) => (meta, numbering) = (described, Numbering::Described),
                Err(why) => notes.push(format!(
                    "{}: its description (variable {DESCRIPTION}) is left alone: {why}",
                    path.display()
                )),
            }
        }
        None if options.colour.is_none() => notes.push(format!(
            "{}: no description in it (variable {DESCRIPTION}); assumed: sRGB-encoded values (--input-linear if they are \
             linear light), no known pitch or method",
            path.display()
        )),
        None => {}
    }
    let block = SampleBlock::new(bytes, BlockLayout { strides: layout.strides, number: array.stored, scale });
    if layout.stored == 4 && meta.weights.is_none() && !options.header_only {
        let means: Vec<f64> =
            (0..rows * columns).map(|k| block.mean_of_channel(k / columns, k % columns, (height, width), 3)).collect();
        meta.weights = relative_weights(&means);
    }
    Ok(BlockViews::new(path, meta, block, notes, numbering, length))
}

/// The type of numbers that a class of arrays stands for. MATLAB may store them in a smaller type.
fn kind_of(class: u8) -> SampleKind {
    match class {
        9 => SampleKind::U8,
        11 => SampleKind::U16,
        _ => SampleKind::F64,
    }
}

/// Subscripts of number `k` of an array of these sides, as MATLAB counts.
fn place_of(mut k: u64, sides: &[usize]) -> String {
    let one = |&side: &usize| {
        let side = side.max(1) as u64;
        let at = k % side;
        k /= side;
        (at + 1).to_string()
    };
    format!("({})", sides.iter().map(one).collect::<Vec<_>>().join(", "))
}

/// Checks the file's header; true for big-endian numbers.
fn read_byte_order(file: &mut File, path: &Path) -> Result<bool, Error> {
    let mut header = [0; HEADER as usize];
    file.read_exact(&mut header).map_err(|_| malformed(path, "ends within its header"))?;
    match &header[126..] {
        b"IM" => Ok(false),
        b"MI" => Ok(true),
        _ => Err(malformed(path, "no byte order in the header of this MATLAB file")),
    }
}

/// Finds the light field: the variable `LF`, or else the only array of 4 or 5 dimensions; and its description.
fn find_light_field(
    file: &mut File,
    path: &Path,
    length: u64,
    big: bool,
) -> Result<(Place, Array, Option<Place>), Error> {
    let mut at = HEADER;
    let mut candidates: Vec<(Place, Array)> = Vec::new();
    let mut description = None;
    let mut found_by_name = false;
    let mut seen = Vec::new();
    for _ in 0..MAX_VARIABLES {
        if at + 8 > length {
            break;
        }
        file.seek(SeekFrom::Start(at)).map_err(io_at(path))?;
        let (kind, size) = match read_tag(file, big) {
            Ok(tag) => tag,
            Err(_) if found_by_name => break,
            Err(_) => return Err(malformed(path, "ends within a variable")),
        };
        let start = at + 8;
        // Behind the light field nothing is needed.
        if size > length - start && found_by_name {
            break;
        }
        if size > length - start {
            let reason = format!("ends early: {length} bytes, but the variable at byte {at} has {size}");
            return Err(malformed(path, reason));
        }
        at = start + size;
        let place = Place { start, length: size, compressed: kind == MI_COMPRESSED };
        if kind != MI_MATRIX && kind != MI_COMPRESSED {
            continue;
        }
        // An array we cannot describe (a cell, a structure, text) is not the light field.
        if let Ok(array) = describe_array(file, place, big) {
            if array.class == CLASS_CHAR {
                if array.name == DESCRIPTION {
                    description = Some(place);
                }
                continue;
            }
            seen.push(array.name.clone());
            let named = array.name == "LF";
            if !found_by_name && (named || (array.dims.len() >= 4 && array.dims.len() <= 5)) {
                if named {
                    candidates.clear();
                    found_by_name = true;
                }
                candidates.push((place, array));
            }
        }
    }
    let mut candidates = candidates.into_iter();
    match (candidates.next(), candidates.next()) {
        (Some((place, array)), None) => Ok((place, array, description)),
        (Some(first), Some(second)) => {
            let (a, b) = (first.1.name, second.1.name);
            Err(unsupported(path, format!("both {a} and {b} could be the light field; name the right one LF")))
        }
        _ => {
            seen.truncate(10);
            let reason = format!("no variable LF (v, u, t, s, c) in it; there is: {}", seen.join(", "));
            Err(unsupported(path, reason))
        }
    }
}

/// Reads an element's description, up to the start of its numbers.
fn describe_array(file: &mut File, place: Place, big: bool) -> std::io::Result<Array> {
    let raw = BufReader::new(file.take(place.length));
    if place.compressed {
        let mut inside = ZlibDecoder::new(raw);
        let (kind, size) = read_tag(&mut inside, big)?;
        if kind != MI_MATRIX {
            return Err(std::io::ErrorKind::InvalidData.into());
        }
        read_array_header(&mut inside.take(size), big)
    } else {
        read_array_header(&mut { raw }, big)
    }
}

/// Reads the numbers of the array at `place`: `count` bytes, which the caller has bounded.
fn read_numbers(file: &mut File, path: &Path, place: Place, big: bool, count: u64) -> Result<Vec<u8>, Error> {
    let short = |_| malformed(path, "the numbers of its light field end early or are damaged");
    file.seek(SeekFrom::Start(place.start)).map_err(io_at(path))?;
    let raw = BufReader::new(file.take(place.length));
    let mut inside: Box<dyn Read + '_> = if place.compressed {
        let mut inside = ZlibDecoder::new(raw);
        read_tag(&mut inside, big).map_err(short)?;
        Box::new(inside)
    } else {
        Box::new(raw)
    };
    read_array_header(&mut inside, big).map_err(short)?;
    // Grows with the bytes there are, not with the length in the header.
    let mut bytes = Vec::new();
    inside.by_ref().take(count).read_to_end(&mut bytes).map_err(short)?;
    if bytes.len() as u64 == count {
        // Padding, behind which a compressed stream compares its checksum.
        if place.compressed {
            inside.take(MAX_PADDING).read_to_end(&mut Vec::new()).map_err(short)?;
        }
        Ok(bytes)
    } else {
        Err(malformed(path, "the numbers of its light field end early"))
    }
}

/// The text of the array of characters at `place`.
fn read_description(file: &mut File, place: Place, big: bool) -> std::io::Result<Vec<u8>> {
    let bad = || std::io::Error::from(std::io::ErrorKind::InvalidData);
    file.seek(SeekFrom::Start(place.start))?;
    let raw = BufReader::new(file.take(place.length));
    let mut inside: Box<dyn Read + '_> = if place.compressed {
        let mut inside = ZlibDecoder::new(raw);
        read_tag(&mut inside, big)?;
        Box::new(inside)
    } else {
        Box::new(raw)
    };
    let array = read_array_header(&mut inside, big)?;
    if array.bytes > 2 * MAX_TEXT {
        return Err(bad());
    }
    let mut bytes = Vec::new();
    inside.take(array.bytes).read_to_end(&mut bytes)?;
    match array.stored.kind {
        SampleKind::U16 => {
            let units: Vec<u16> = bytes.chunks_exact(2).map(|b| array.stored.read(b) as u16).collect();
            String::from_utf16(&units).map(String::into_bytes).map_err(|_| bad())
        }
        SampleKind::U8 | SampleKind::I8 => Ok(bytes),
        _ => Err(bad()),
    }
}

fn read_word(from: &mut dyn Read, big: bool) -> std::io::Result<u32> {
    let mut b = [0; 4];
    from.read_exact(&mut b)?;
    Ok(if big { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) })
}

/// A tag of the long form: what follows, and its length in bytes.
fn read_tag(from: &mut dyn Read, big: bool) -> std::io::Result<(u32, u64)> {
    Ok((read_word(from, big)?, u64::from(read_word(from, big)?)))
}

/// A small sub-element of either form: its content without padding.
fn read_small_element(from: &mut dyn Read, big: bool, most: u64) -> std::io::Result<Vec<u8>> {
    let bad = || std::io::Error::from(std::io::ErrorKind::InvalidData);
    let first = read_word(from, big)?;
    let (length, space) = match first >> 16 {
        0 => {
            let length = u64::from(read_word(from, big)?);
            (length, length.next_multiple_of(8))
        }
        length @ 1..=4 => (u64::from(length), 4),
        _ => return Err(bad()),
    };
    if length > most {
        return Err(bad());
    }
    let mut bytes = vec![0; space as usize];
    from.read_exact(&mut bytes)?;
    bytes.truncate(length as usize);
    Ok(bytes)
}

/// An array's flags, dimensions and name, and the tag of its numbers; leaves `from` where they start.
fn read_array_header(from: &mut dyn Read, big: bool) -> std::io::Result<Array> {
    let bad = || std::io::Error::from(std::io::ErrorKind::InvalidData);
    let int = SampleFormat { kind: SampleKind::U32, big_endian: big };
    let flags = int.read(read_small_element(from, big, 8)?.get(..4).ok_or_else(bad)?) as u32;
    let dims = read_small_element(from, big, 4 * MAX_DIMENSIONS as u64)?;
    let dims: Vec<u64> = dims.chunks_exact(4).map(|d| int.read(d) as u64).collect();
    let name = String::from_utf8_lossy(&read_small_element(from, big, MAX_NAME)?).into_owned();
    let first = read_word(from, big)?;
    // A short form would hold at most one number of a light field; its four bytes are the data that follow.
    let (kind, bytes) = match first >> 16 {
        0 => (first, u64::from(read_word(from, big)?)),
        length => (first & 0xffff, u64::from(length)),
    };
    let kind = match kind {
        1 => SampleKind::I8,
        2 => SampleKind::U8,
        3 => SampleKind::I16,
        4 => SampleKind::U16,
        5 => SampleKind::I32,
        6 => SampleKind::U32,
        7 => SampleKind::F32,
        9 => SampleKind::F64,
        // Text of MATLAB in UTF-8 and UTF-16.
        16 => SampleKind::U8,
        17 => SampleKind::U16,
        _ => return Err(bad()),
    };
    let stored = SampleFormat { kind, big_endian: big };
    Ok(Array { name, class: flags as u8, complex: (flags >> 8) as u8 & COMPLEX != 0, dims, stored, bytes })
}

/// The value that represents 1.0 in an array of this class. MATLAB may store its numbers in a smaller type.
fn scale_of(class: u8) -> Option<f32> {
    match class {
        6 | CLASS_SINGLE => Some(1.0),
        9 => Some(255.0),
        11 => Some(65535.0),
        _ => None,
    }
}

/// Writes a MATLAB file with the variable `LF` (v, u, t, s, c), single, uncompressed. The values stay in memory until
/// it is finished.
pub(super) struct Writer {
    meta: Meta,
    written: Vec<bool>,
    /// Column-major: v runs fastest.
    values: Vec<f32>,
    pending: Pending,
}

impl Writer {
    pub(super) fn create(path: &Path, meta: Meta, force: bool) -> Result<Self, Error> {
        let (t, s, c) = meta.view_shape();
        let views = meta.views[0] * meta.views[1];
        let bytes = views as u64 * (t * s * c) as u64 * 4;
        if bytes > MAX_ARRAY {
            let reason = format!("{} MiB, but a MATLAB file of level 5 holds at most 2 GiB; write .npy", bytes >> 20);
            return Err(unsupported(path, reason));
        }
        let pending = Pending::file(path, force)?;
        Ok(Writer { written: vec![false; views], values: vec![0.0; views * t * s * c], meta, pending })
    }
}

impl ViewSink for Writer {
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error> {
        self.meta.check_view(v, u, view)?;
        let [rows, columns] = self.meta.views;
        let (t, s, _) = view.dim();
        let [step_t, step_s] = [rows * columns, rows * columns * t];
        for ((i, j, k), &x) in view.indexed_iter() {
            self.values[v + u * rows + i * step_t + j * step_s + k * step_s * s] = x;
        }
        self.written[v * columns + u] = true;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), Error> {
        check_all_written(&self.written, &self.meta)?;
        let path = self.pending.path().to_path_buf();
        let mut out = BufWriter::new(self.pending.handle()?);
        out.write_all(&file_header(&self.meta, self.values.len())).map_err(io_at(&path))?;
        for x in &self.values {
            out.write_all(&x.to_le_bytes()).map_err(io_at(&path))?;
        }
        if self.values.len() % 2 == 1 {
            out.write_all(&[0; 4]).map_err(io_at(&path))?;
        }
        out.write_all(&description_element(&self.meta, &self.values)?).map_err(io_at(&path))?;
        out.into_inner().map_err(|e| io_at(&path)(e.into_error()))?;
        Ok(self.pending.commit()?)
    }
}

/// Everything before the numbers: the file's header, the array's flags, dimensions and name.
fn file_header(meta: &Meta, values: usize) -> Vec<u8> {
    let (t, s, c) = meta.view_shape();
    let mut text = b"MATLAB 5.0 MAT-file, light field LF(v, u, t, s, c) written by lenslet".to_vec();
    text.resize(124, b' ');
    text.extend([0x00, 0x01, b'I', b'M']);
    let words = |out: &mut Vec<u8>, words: &[u32]| out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    let bytes = 4 * values as u32;
    let padded = bytes.next_multiple_of(8);
    // Flags 16, dimensions 8 + 20 + 4, name 8 (short form), tag of the numbers 8.
    words(&mut text, &[MI_MATRIX, 16 + 32 + 8 + 8 + padded]);
    words(&mut text, &[MI_UINT32, 8, u32::from(CLASS_SINGLE), 0]);
    words(&mut text, &[MI_INT32, 20]);
    for n in [meta.views[0], meta.views[1], t, s, c] {
        words(&mut text, &[n as u32]);
    }
    words(&mut text, &[0]);
    words(&mut text, &[(2 << 16) | MI_INT8]);
    text.extend(b"LF\0\0");
    words(&mut text, &[MI_SINGLE, bytes]);
    text
}

/// The variable with the description: a row of characters.
fn description_element(meta: &Meta, values: &[f32]) -> Result<Vec<u8>, Error> {
    let (blocks, numbers) = (values.len(), 4);
    let fingerprint = fingerprint_by(blocks as u64 * numbers, |at, buffer| {
        for (k, byte) in buffer.iter_mut().enumerate() {
            let at = at as usize + k;
            *byte = values[at / 4].to_le_bytes()[at % 4];
        }
        Ok(())
    })
    .unwrap_or_default();
    let text = Companion::new(meta, fingerprint).to_text()?;
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let padded = units.len().next_multiple_of(8);
    let mut out = Vec::new();
    let words = |out: &mut Vec<u8>, words: &[u32]| out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    // Flags 16, dimensions 8 + 8, name 8 + 8, tag of the characters 8.
    words(&mut out, &[MI_MATRIX, 16 + 16 + 16 + 8 + padded as u32]);
    words(&mut out, &[MI_UINT32, 8, u32::from(CLASS_CHAR), 0]);
    words(&mut out, &[MI_INT32, 8, 1, (units.len() / 2) as u32]);
    words(&mut out, &[MI_INT8, DESCRIPTION.len() as u32]);
    out.extend(DESCRIPTION.as_bytes());
    out.resize(out.len().next_multiple_of(8), 0);
    words(&mut out, &[MI_UINT16, units.len() as u32]);
    let end = out.len() + padded;
    out.extend(units);
    out.resize(end, 0);
    Ok(out)
}
