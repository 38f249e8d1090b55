//! The `.lfd` file: magic, format version, codec, header length, header (bincode), padding, raw little-endian matrices.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | magic `89 4C 46 44 0D 0A 1A 0A` |
//! | 4 | format version, little-endian |
//! | 4 | codec of the header: 1 = bincode 2, standard configuration |
//! | 8 | length of the header |
//! | … | header: tool, recipe (JSON text), models, table of matrices, SHA-256 of the payload |
//! | … | zeros up to a multiple of 64, then the payload: matrices, each at a multiple of 64 |

use std::cell::Cell;
use std::io::Read;
use std::path::Path;

use ndarray::{Array2, Array3};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{Anchored, Base, Dictionary, Error, Footprint, Model, Pass, Recipe, Storage, limits, validate};

/// The version of the format that this library writes, and the only one it reads.
pub const FORMAT_VERSION: u32 = 1;
const MAGIC: [u8; 8] = *b"\x89LFD\r\n\x1a\n";
const CODEC_BINCODE: u32 = 1;
const FIXED: usize = 24;
const ALIGN: usize = 64;

#[derive(Debug, Serialize, Deserialize)]
struct Header {
    tool: String,
    recipe: String,
    storage: Storage,
    models: Vec<ModelHeader>,
    tables: Vec<Table>,
    sha256: [u8; 32],
}

#[derive(Debug, Serialize, Deserialize)]
struct ModelHeader {
    footprint: Footprint,
    base: Base,
    pitch: f64,
    passes: Vec<PassHeader>,
}

#[derive(Debug, Serialize, Deserialize)]
struct PassHeader {
    support: u32,
    patch: u32,
    floor: f32,
    lambda: f32,
    with_linear: bool,
    anchored: bool,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Table {
    name: String,
    bytes_per_value: u8,
    shape: Vec<u64>,
    offset: u64,
}

fn configuration() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<{ limits::HEADER }>()
}

/// Writes matrices one after the other and remembers where.
#[derive(Default)]
struct Payload {
    bytes: Vec<u8>,
    tables: Vec<Table>,
}

impl Payload {
    fn begin(&mut self, name: String, bytes_per_value: u8, shape: &[usize]) {
        self.bytes.resize(self.bytes.len().next_multiple_of(ALIGN), 0);
        let shape = shape.iter().map(|&n| n as u64).collect();
        self.tables.push(Table { name, bytes_per_value, shape, offset: self.bytes.len() as u64 });
    }

    fn f32s<'a>(&mut self, name: String, shape: &[usize], values: impl Iterator<Item = &'a f32>) {
        self.begin(name, 4, shape);
        values.for_each(|v| self.bytes.extend_from_slice(&v.to_le_bytes()));
    }

    /// Rows as signed bytes times a scale each; a row of zeros has scale 0.
    fn i8s(&mut self, name: &str, maps: &Array3<f32>) {
        let (k, m, p2) = maps.dim();
        let mut scales = Vec::with_capacity(k * m);
        self.begin(format!("{name}.values"), 1, &[k, m, p2]);
        for row in maps.rows() {
            let scale = row.iter().fold(0.0f32, |a, b| a.max(b.abs())) / 127.0;
            let inverse = if scale > 0.0 { 1.0 / scale } else { 0.0 };
            self.bytes.extend(row.iter().map(|v| (v * inverse).round().clamp(-127.0, 127.0) as i8 as u8));
            scales.push(scale);
        }
        self.f32s(format!("{name}.scales"), &[k, m], scales.iter());
    }
}

/// A dictionary as the bytes of an `.lfd` file. The same dictionary always gives the same bytes.
///
/// # Errors
/// [`Error::Parameter`] when it is not a valid dictionary.
pub fn to_bytes(dictionary: &Dictionary) -> Result<Vec<u8>, Error> {
    validate(dictionary)?;
    let mut payload = Payload::default();
    let mut models = Vec::new();
    for (i, model) in dictionary.models.iter().enumerate() {
        let mut passes = Vec::new();
        for (j, pass) in model.passes.iter().enumerate() {
            let name = |what: &str| format!("{i}.{j}.{what}");
            for (what, a) in
                [("filters", &pass.filters), ("low", &pass.low), ("high", &pass.high), ("linear", &pass.linear)]
            {
                payload.f32s(name(what), a.shape(), a.iter());
            }
            if let Some(a) = &pass.anchored {
                payload.f32s(name("anchors"), a.anchors.shape(), a.anchors.iter());
                match dictionary.storage {
                    Storage::F32 => payload.f32s(name("maps"), a.maps.shape(), a.maps.iter()),
                    Storage::I8 => payload.i8s(&name("maps"), &a.maps),
                }
            }
            passes.push(PassHeader {
                support: pass.support as u32,
                patch: pass.patch as u32,
                floor: pass.floor,
                lambda: pass.lambda,
                with_linear: pass.with_linear,
                anchored: pass.anchored.is_some(),
            });
        }
        models.push(ModelHeader { footprint: model.footprint, base: model.base, pitch: model.pitch, passes });
    }
    let header = Header {
        tool: format!("lenslet {}", env!("CARGO_PKG_VERSION")),
        recipe: serde_json::to_string(&dictionary.recipe).map_err(|e| Error::Parameter(e.to_string()))?,
        storage: dictionary.storage,
        models,
        tables: payload.tables,
        sha256: Sha256::digest(&payload.bytes).into(),
    };
    let header =
        bincode::serde::encode_to_vec(&header, configuration()).map_err(|e| Error::Parameter(e.to_string()))?;
    if header.len() > limits::HEADER {
        return Err(Error::Parameter(format!("the recipe takes {} bytes, too many", header.len())));
    }
    let mut bytes = Vec::with_capacity(FIXED + header.len() + ALIGN + payload.bytes.len());
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&FORMAT_VERSION.to_le_bytes());
    bytes.extend_from_slice(&CODEC_BINCODE.to_le_bytes());
    bytes.extend_from_slice(&(header.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&header);
    bytes.resize(bytes.len().next_multiple_of(ALIGN), 0);
    bytes.extend_from_slice(&payload.bytes);
    Ok(bytes)
}

/// Writes an `.lfd` file, whole or not at all.
///
/// # Errors
/// As [`to_bytes`], and when the file exists (without `force`) or cannot be written.
pub fn save(path: &Path, dictionary: &Dictionary, force: bool) -> Result<(), Error> {
    Ok(crate::output::write_file(path, force, &to_bytes(dictionary)?)?)
}

/// Reads an `.lfd` file.
///
/// # Errors
/// When it cannot be read, is no dictionary, is of another version, or is damaged: see [`Error`].
pub fn load(path: &Path) -> Result<Dictionary, Error> {
    let name = path.display().to_string();
    let io = |source| Error::Io { path: name.clone(), source };
    let file = std::fs::File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    if length > limits::FILE {
        return Err(Error::Malformed { path: name, reason: format!("{length} bytes are too many for a dictionary") });
    }
    let mut bytes = Vec::new();
    // The length is only a promise: a device file may say 0 and never end.
    file.take(limits::FILE).read_to_end(&mut bytes).map_err(io)?;
    from_bytes(&bytes, &name)
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at + N)?.try_into().ok()
}

/// Reads the bytes of an `.lfd` file; `name` is what errors call it.
///
/// # Errors
/// As [`load`].
pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Dictionary, Error> {
    let malformed = |reason: String| Error::Malformed { path: name.into(), reason };
    let short = || malformed(format!("it ends after {} bytes", bytes.len()));
    if !bytes.starts_with(&MAGIC) {
        return Err(Error::NotDictionary { path: name.into() });
    }
    let version = u32::from_le_bytes(number(bytes, 8).ok_or_else(short)?);
    if version != FORMAT_VERSION {
        let remedy = if version > FORMAT_VERSION {
            "use a newer lenslet, or train it again with `lenslet train-dict`"
        } else {
            "train it again with `lenslet train-dict`"
        };
        return Err(Error::Version { path: name.into(), found: version, known: FORMAT_VERSION, remedy });
    }
    let codec = u32::from_le_bytes(number(bytes, 12).ok_or_else(short)?);
    if codec != CODEC_BINCODE {
        return Err(malformed(format!("header codec {codec} is not known")));
    }
    let length = u64::from_le_bytes(number(bytes, 16).ok_or_else(short)?);
    let length = usize::try_from(length).ok().filter(|&l| l <= limits::HEADER);
    let length = length.ok_or_else(|| malformed("its header is too long".into()))?;
    let header = bytes.get(FIXED..FIXED + length).ok_or_else(short)?;
    let (header, used): (Header, usize) = bincode::serde::decode_from_slice(header, configuration())
        .map_err(|e| malformed(format!("its header cannot be read ({e})")))?;
    if used != length {
        return Err(malformed("its header has bytes left over".into()));
    }
    let payload = bytes.get((FIXED + length).next_multiple_of(ALIGN)..).ok_or_else(short)?;
    if Sha256::digest(payload).as_slice() != header.sha256 {
        return Err(malformed("its matrices do not match their checksum".into()));
    }
    let recipe: Recipe =
        serde_json::from_str(&header.recipe).map_err(|e| malformed(format!("its recipe cannot be read ({e})")))?;
    let reader = Reader { payload, tables: &header.tables, left: Cell::new(payload.len()) };
    let models = models(&header, &reader).map_err(malformed)?;
    let dictionary = Dictionary { recipe, storage: header.storage, models };
    validate(&dictionary).map_err(|e| malformed(e.to_string()))?;
    Ok(dictionary)
}

struct Reader<'a> {
    payload: &'a [u8],
    tables: &'a [Table],
    /// Payload not yet taken: matrices that share bytes would let a small file ask for any amount of memory.
    left: Cell<usize>,
}

impl Reader<'_> {
    /// The shape and bytes of a matrix, if they lie within the payload.
    fn bytes(&self, name: &str, bytes_per_value: u8) -> Result<(Vec<usize>, &[u8]), String> {
        let table = self.tables.iter().find(|t| t.name == name).ok_or_else(|| format!("matrix {name} is missing"))?;
        let wrong = || format!("matrix {name} of shape {:?} does not fit the file", table.shape);
        if table.bytes_per_value != bytes_per_value || table.shape.len() > 3 {
            return Err(wrong());
        }
        let mut count = 1u64;
        for &n in &table.shape {
            count = count.checked_mul(n).ok_or_else(wrong)?;
        }
        let length = count.checked_mul(bytes_per_value.into()).ok_or_else(wrong)?;
        let end = table.offset.checked_add(length).ok_or_else(wrong)?;
        if end > self.payload.len() as u64 {
            return Err(wrong());
        }
        let left = self.left.get().checked_sub(length as usize).ok_or_else(|| "its matrices overlap".to_string())?;
        self.left.set(left);
        let shape = table.shape.iter().map(|&n| n as usize).collect();
        Ok((shape, &self.payload[table.offset as usize..end as usize]))
    }

    fn f32s(&self, name: &str) -> Result<(Vec<usize>, Vec<f32>), String> {
        let (shape, bytes) = self.bytes(name, 4)?;
        Ok((shape, bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()))
    }

    fn matrix(&self, name: &str) -> Result<Array2<f32>, String> {
        let (shape, values) = self.f32s(name)?;
        let &[rows, columns] = shape.as_slice() else { return Err(format!("matrix {name} has not two dimensions")) };
        Array2::from_shape_vec((rows, columns), values).map_err(|e| e.to_string())
    }

    fn maps(&self, name: &str, storage: Storage) -> Result<Array3<f32>, String> {
        let (shape, values) = match storage {
            Storage::F32 => self.f32s(name)?,
            Storage::I8 => {
                let (shape, bytes) = self.bytes(&format!("{name}.values"), 1)?;
                let (_, scales) = self.f32s(&format!("{name}.scales"))?;
                let row = shape.last().copied().unwrap_or(0).max(1);
                if scales.len() * row != bytes.len() {
                    return Err(format!("matrix {name} has {} scales", scales.len()));
                }
                let rows = bytes.chunks_exact(row).zip(&scales);
                (shape, rows.flat_map(|(r, s)| r.iter().map(move |&b| f32::from(b as i8) * s)).collect())
            }
        };
        let &[k, m, p] = shape.as_slice() else { return Err(format!("matrix {name} has not three dimensions")) };
        Array3::from_shape_vec((k, m, p), values).map_err(|e| e.to_string())
    }
}

fn models(header: &Header, reader: &Reader<'_>) -> Result<Vec<Model>, String> {
    let mut models = Vec::new();
    for (i, model) in header.models.iter().enumerate() {
        if i == limits::PARTS || model.passes.len() > limits::PARTS {
            return Err(format!("more than {} models, or passes of one", limits::PARTS));
        }
        let mut passes = Vec::new();
        for (j, pass) in model.passes.iter().enumerate() {
            let name = |what: &str| format!("{i}.{j}.{what}");
            let side =
                |n: u32| if n as usize > limits::SIDE { Err(format!("a side of {n} pixels")) } else { Ok(n as usize) };
            let anchored = if pass.anchored {
                Some(Anchored {
                    anchors: reader.matrix(&name("anchors"))?,
                    maps: reader.maps(&name("maps"), header.storage)?,
                })
            } else {
                None
            };
            passes.push(Pass {
                support: side(pass.support)?,
                patch: side(pass.patch)?,
                filters: reader.matrix(&name("filters"))?,
                floor: pass.floor,
                lambda: pass.lambda,
                low: reader.matrix(&name("low"))?,
                high: reader.matrix(&name("high"))?,
                linear: reader.matrix(&name("linear"))?,
                with_linear: pass.with_linear,
                anchored,
            });
        }
        models.push(Model { footprint: model.footprint, base: model.base, pitch: model.pitch, passes });
    }
    Ok(models)
}
