//! The `.lfd` file: magic, format version, codec, header length, header (bincode), padding, raw little-endian matrices.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | magic `89 4C 46 44 0D 0A 1A 0A` |
//! | 4 | format version, little-endian |
//! | 4 | codec of the header: 1 = bincode 2, standard configuration |
//! | 8 | length of the header |
//! | … | header: tool, recipe (JSON text), models, table of matrices, SHA-256 of the payload; version 3: then the networks |
//! | … | zeros up to a multiple of 64, then the payload: matrices, each at a multiple of 64 |
//! | 32 | SHA-256 of everything before it (since version 2; version 1 ends with the payload and guards only that) |
//!
//! A dictionary without networks is written as version 2.

use std::cell::Cell;
use std::io::Read;
use std::path::Path;

use ndarray::{Array2, Array3};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{
    Anchored, Dictionary, Error, Footprint, Interpolation, Layer, Model, Network, Pass, Recipe, Storage, limits,
    validate,
};

/// The latest version of the format; this library reads all from 1.
pub const FORMAT_VERSION: u32 = 3;
/// Since this version networks follow the header.
const NETWORKS: u32 = 3;
/// Since this version the file ends with a hash over everything before it.
const SEALED: u32 = 2;
/// Bytes of that hash.
const SEAL: usize = 32;
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
    base: Interpolation,
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

/// What stands behind the header since version 3, one for every pass that has a network.
#[derive(Debug, Serialize, Deserialize)]
struct NetworkHeader {
    model: u32,
    pass: u32,
    support: u32,
    floor: f32,
    beside: Vec<Interpolation>,
    shares: Vec<u32>,
    layers: u32,
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
    let (mut models, mut networks) = (Vec::new(), Vec::new());
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
            if let Some(n) = &pass.network {
                payload.f32s(name("network.filters"), n.filters.shape(), n.filters.iter());
                for (k, layer) in n.layers.iter().enumerate() {
                    let name = |what: &str| name(&format!("network.{k}.{what}"));
                    payload.f32s(name("weights"), layer.weights.shape(), layer.weights.iter());
                    payload.f32s(name("bias"), &[1, layer.bias.len()], layer.bias.iter());
                }
                networks.push(NetworkHeader {
                    model: i as u32,
                    pass: j as u32,
                    support: n.support as u32,
                    floor: n.floor,
                    beside: n.beside.clone(),
                    shares: n.shares.iter().map(|&s| s as u32).collect(),
                    layers: n.layers.len() as u32,
                });
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
    let encode_error = |e: bincode::error::EncodeError| Error::Parameter(e.to_string());
    let mut header = bincode::serde::encode_to_vec(&header, configuration()).map_err(encode_error)?;
    let version = if networks.is_empty() { NETWORKS - 1 } else { NETWORKS };
    if version >= NETWORKS {
        header.extend(bincode::serde::encode_to_vec(&networks, configuration()).map_err(encode_error)?);
    }
    if header.len() > limits::HEADER {
        return Err(Error::Parameter(format!("the recipe takes {} bytes, too many", header.len())));
    }
    let mut bytes = Vec::with_capacity(FIXED + header.len() + ALIGN + payload.bytes.len() + SEAL);
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&version.to_le_bytes());
    bytes.extend_from_slice(&CODEC_BINCODE.to_le_bytes());
    bytes.extend_from_slice(&(header.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&header);
    bytes.resize(bytes.len().next_multiple_of(ALIGN), 0);
    bytes.extend_from_slice(&payload.bytes);
    let seal = Sha256::digest(&bytes);
    bytes.extend_from_slice(&seal);
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
    if !(1..=FORMAT_VERSION).contains(&version) {
        let remedy = if version > FORMAT_VERSION {
            "use a newer lenslet, or train it again with `lenslet train-dict`"
        } else {
            "train it again with `lenslet train-dict`"
        };
        return Err(Error::Version { path: name.into(), found: version, known: FORMAT_VERSION, remedy });
    }
    let bytes = if version < SEALED {
        bytes
    } else {
        let (body, seal) = bytes.split_last_chunk::<SEAL>().ok_or_else(short)?;
        if Sha256::digest(body).as_slice() != seal {
            return Err(malformed("it is cut short or damaged: its bytes do not match their checksum".into()));
        }
        body
    };
    let codec = u32::from_le_bytes(number(bytes, 12).ok_or_else(short)?);
    if codec != CODEC_BINCODE {
        return Err(malformed(format!("header codec {codec} is not known")));
    }
    let length = u64::from_le_bytes(number(bytes, 16).ok_or_else(short)?);
    let length = usize::try_from(length).ok().filter(|&l| l <= limits::HEADER);
    let length = length.ok_or_else(|| malformed("its header is too long".into()))?;
    let encoded = bytes.get(FIXED..FIXED + length).ok_or_else(short)?;
    let unread = |e: bincode::error::DecodeError| malformed(format!("its header cannot be read ({e})"));
    let (header, mut used): (Header, usize) =
        bincode::serde::decode_from_slice(encoded, configuration()).map_err(unread)?;
    let mut networks: Vec<NetworkHeader> = Vec::new();
    if version >= NETWORKS {
        let more;
        (networks, more) = bincode::serde::decode_from_slice(&encoded[used..], configuration()).map_err(unread)?;
        used += more;
    }
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
    let mut models = models(&header, &reader).map_err(malformed)?;
    for header in &networks {
        let pass = models.get_mut(header.model as usize).and_then(|m| m.passes.get_mut(header.pass as usize));
        let pass = pass.ok_or_else(|| malformed("a network of no pass".into()))?;
        pass.network = Some(network(header, &reader).map_err(malformed)?);
    }
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
                network: None,
            });
        }
        models.push(Model { footprint: model.footprint, base: model.base, pitch: model.pitch, passes });
    }
    Ok(models)
}

fn network(header: &NetworkHeader, reader: &Reader<'_>) -> Result<Network, String> {
    let name = |what: &str| format!("{}.{}.network.{what}", header.model, header.pass);
    if header.layers as usize > limits::PARTS || header.support as usize > limits::SIDE {
        return Err(format!("a network of {} layers and windows of {} pixels", header.layers, header.support));
    }
    let mut layers = Vec::new();
    for k in 0..header.layers {
        let bias = reader.matrix(&name(&format!("{k}.bias")))?;
        layers
            .push(Layer { weights: reader.matrix(&name(&format!("{k}.weights")))?, bias: bias.flatten().into_owned() });
    }
    Ok(Network {
        support: header.support as usize,
        beside: header.beside.clone(),
        shares: header.shares.iter().map(|&s| s as usize).collect(),
        filters: reader.matrix(&name("filters"))?,
        floor: header.floor,
        layers,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dictionary::network::tests::random;
    use crate::dictionary::tests::small;

    /// A dictionary with a network, which version 3 is written for.
    fn with_network() -> Dictionary {
        let mut dictionary = small(1);
        dictionary.models[0].passes[0].network = Some(random(5, &[Interpolation::Barycentric, Interpolation::Cubic]));
        dictionary
    }

    #[test]
    fn networks_come_back_and_need_version_3() {
        let bytes = to_bytes(&with_network()).unwrap();
        assert_eq!((bytes[8], to_bytes(&small(1)).unwrap()[8]), (3, 2));
        assert_eq!(from_bytes(&bytes, "t").unwrap(), with_network());
        for n in (0..bytes.len()).step_by(7) {
            assert!(from_bytes(&bytes[..n], "t").is_err(), "{n} of {} bytes", bytes.len());
        }
        let mut bad = with_network();
        bad.models[0].passes[0].network.as_mut().unwrap().shares[0] += 1;
        assert!(to_bytes(&bad).is_err());
    }
    use proptest::prelude::*;

    #[test]
    fn a_file_gives_back_what_was_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lfd");
        let dictionary = small(3);
        save(&path, &dictionary, false).unwrap();
        assert_eq!(load(&path).unwrap(), dictionary);
        assert!(matches!(save(&path, &dictionary, false), Err(Error::Output(_))));
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes, to_bytes(&load(&path).unwrap()).unwrap());
        assert!(matches!(load(&folder.path().join("absent.lfd")), Err(Error::Io { .. })));
    }

    #[test]
    fn bytes_keep_maps_to_half_a_step() {
        let mut dictionary = small(3);
        dictionary.storage = Storage::I8;
        let back = from_bytes(&to_bytes(&dictionary).unwrap(), "x").unwrap();
        let maps = |d: &Dictionary| d.models[0].passes[0].anchored.as_ref().unwrap().maps.clone();
        let (before, after) = (maps(&dictionary), maps(&back));
        for (b, a) in before.rows().into_iter().zip(after.rows()) {
            let step = b.iter().fold(0.0f32, |m, v| m.max(v.abs())) / 127.0;
            assert!(b.iter().zip(a).all(|(x, y)| (x - y).abs() <= 0.5001 * step));
        }
        assert_eq!(back.models[0].passes[0].low, dictionary.models[0].passes[0].low);
    }

    #[test]
    fn another_version_is_named_with_what_to_do() {
        let mut bytes = to_bytes(&small(1)).unwrap();
        bytes[8] = 9;
        let error = from_bytes(&bytes, "old.lfd").unwrap_err().to_string();
        assert!(error.contains("old.lfd") && error.contains("version 9") && error.contains("newer lenslet"), "{error}");
        bytes[8] = 0;
        let error = from_bytes(&bytes, "old.lfd").unwrap_err().to_string();
        assert!(error.contains("train it again"), "{error}");
        assert!(matches!(from_bytes(b"just text", "t"), Err(Error::NotDictionary { .. })));
        assert!(matches!(from_bytes(b"", "t"), Err(Error::NotDictionary { .. })));
    }

    #[test]
    fn no_truncation_is_accepted() {
        let bytes = to_bytes(&small(1)).unwrap();
        for n in 0..bytes.len() {
            assert!(from_bytes(&bytes[..n], "t").is_err(), "{n} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn no_flipped_bit_is_accepted() {
        let whole = to_bytes(&small(1)).unwrap();
        for at in 0..whole.len() {
            for bit in [0, 3, 7] {
                let mut bytes = whole.clone();
                bytes[at] ^= 1 << bit;
                // As version 1 the file is a little longer than its payload, which that version's checksum sees.
                assert!(from_bytes(&bytes, "t").is_err(), "bit {bit} of byte {at}");
            }
        }
        let longer = [&whole[..], b"x"].concat();
        assert!(from_bytes(&longer, "t").is_err());
    }

    /// The same dictionary as version 1 wrote it.
    fn version_1(dictionary: &Dictionary) -> Vec<u8> {
        let mut bytes = to_bytes(dictionary).unwrap();
        bytes[8] = 1;
        bytes.truncate(bytes.len() - SEAL);
        bytes
    }

    #[test]
    fn a_header_that_lies_about_sizes_is_refused() {
        let bytes = to_bytes(&small(1)).unwrap();
        let length = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
        let (mut header, _): (Header, usize) =
            bincode::serde::decode_from_slice(&bytes[FIXED..FIXED + length], configuration()).unwrap();
        let payload = bytes[(FIXED + length).next_multiple_of(ALIGN)..bytes.len() - SEAL].to_vec();
        let rebuilt = |header: &Header| {
            let h = bincode::serde::encode_to_vec(header, configuration()).unwrap();
            let mut out = bytes[..16].to_vec();
            out.extend_from_slice(&(h.len() as u64).to_le_bytes());
            out.extend_from_slice(&h);
            out.resize(out.len().next_multiple_of(ALIGN), 0);
            out.extend_from_slice(&payload);
            let seal = Sha256::digest(&out);
            out.extend_from_slice(&seal);
            out
        };
        assert!(from_bytes(&rebuilt(&header), "t").is_ok());
        let shape = header.tables[0].shape.clone();
        for wrong in [vec![u64::MAX, 2], vec![1 << 40, 1 << 40], vec![0, 0], vec![1], vec![1, 2, 3, 4]] {
            header.tables[0].shape = wrong;
            assert!(from_bytes(&rebuilt(&header), "t").is_err());
        }
        header.tables[0].shape = shape;
        header.tables[0].offset = u64::MAX - 4;
        assert!(from_bytes(&rebuilt(&header), "t").is_err());
        header.tables[0].offset = 0;
        header.models[0].passes[0].patch = u32::MAX;
        assert!(from_bytes(&rebuilt(&header), "t").is_err());
    }

    proptest! {
        #[test]
        fn damage_to_version_1_never_panics(at in 0usize..4000, value: u8, cut in 0usize..4000) {
            let mut bytes = version_1(&small(1));
            let n = bytes.len();
            prop_assert_eq!(from_bytes(&bytes, "t").unwrap(), small(1));
            bytes[at % n] = value;
            // The payload is guarded by its sha256; a header that still reads must still make sense.
            if let Ok(d) = from_bytes(&bytes, "t") {
                prop_assert!(validate(&d).is_ok());
                prop_assert_eq!(&d.models[0].passes[0].low, &small(1).models[0].passes[0].low);
            }
            bytes.truncate(cut % n);
            prop_assert!(from_bytes(&bytes, "t").is_err());
        }

        #[test]
        fn noise_after_the_magic_never_panics(noise in proptest::collection::vec(any::<u8>(), 0..300)) {
            let mut bytes = MAGIC.to_vec();
            bytes.extend_from_slice(&FORMAT_VERSION.to_le_bytes());
            bytes.extend_from_slice(&CODEC_BINCODE.to_le_bytes());
            bytes.extend_from_slice(&noise);
            prop_assert!(from_bytes(&bytes, "t").is_err());
        }
    }
}
