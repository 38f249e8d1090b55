//! The `.lfd` file: magic, format version, codec, header length, header, padding, raw little-endian matrices.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | magic `89 4C 46 44 0D 0A 1A 0A` |
//! | 4 | format version, little-endian |
//! | 4 | codec of the header: 1 = bincode 2, standard configuration |
//! | 8 | length of the header |
//! | … | header: tool, recipe (JSON), models, table of matrices, SHA-256 of the payload; version 3: the networks |
//! | … | zeros up to a multiple of 64, then the payload: matrices, each at a multiple of 64 |
//! | 32 | SHA-256 of everything before it (since version 2; version 1 ends with the payload and guards only that) |
//!
//! A dictionary without networks is written as version 2.

use std::cell::Cell;

use sha2::{Digest, Sha256};

use super::super::error::Error;
use super::super::limits;
use super::super::model::{Dictionary, Model, ModelKind, Storage};
use super::super::patch_model::{Matrix, NetworkNumbers, PatchNumbers, Values, assemble, matrices};
use super::super::recipe::Recipe;
use super::super::validate::validate;
use super::lfd_header::{
    Header, ModelHeader, NetworkHeader, PassHeader, SideInputCode, Table, decode_header, encode_header,
};
use super::quantise::{is_quantised, quantise, restored_maps};

/// The latest version of the `.lfd` format; this library reads all from 1.
pub const FORMAT_VERSION: u32 = 4;
/// Since this version networks can take noise.
const NOISE: u32 = 4;
/// Since this version networks follow the header.
const NETWORKS: u32 = 3;
/// Since this version the file ends with a hash over everything before it.
const SEALED: u32 = 2;
/// Bytes of that hash.
const SEAL: usize = 32;
pub(super) const MAGIC: [u8; 8] = *b"\x89LFD\r\n\x1a\n";
const CODEC_BINCODE: u32 = 1;
/// Bytes before the header.
const FIXED: usize = 24;
/// The payload and its matrices lie at multiples of this.
const ALIGN: usize = 64;

/// Matrices one after the other, and where each is.
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

    fn add_f32s<'a>(&mut self, name: String, shape: &[usize], values: impl IntoIterator<Item = &'a f32>) {
        self.begin(name, 4, shape);
        values.into_iter().for_each(|v| self.bytes.extend_from_slice(&v.to_le_bytes()));
    }
}

/// A dictionary as the bytes of an `.lfd` file. The same dictionary always gives the same bytes.
///
/// ```
/// use lenslet_core::dictionary;
///
/// # let file = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"));
/// let dictionary = dictionary::from_bytes(file, "golden-1.lfd")?;
/// let bytes = dictionary::to_bytes(&dictionary)?;
/// assert_eq!(bytes[8], 2); // the format version
/// assert_eq!(dictionary::from_bytes(&bytes, "written again")?, dictionary);
/// # Ok::<(), dictionary::Error>(())
/// ```
///
/// # Errors
/// [`Error::Parameter`] when it is not a valid dictionary.
pub fn to_bytes(dictionary: &Dictionary) -> Result<Vec<u8>, Error> {
    validate(dictionary)?;
    let mut payload = Payload::default();
    let (mut models, mut networks) = (Vec::new(), Vec::new());
    for (i, model) in dictionary.models.iter().enumerate() {
        for (which, values) in matrices(&model.patch_model) {
            let name = table_name(i, which);
            if is_quantised(which, dictionary.storage) {
                let (bytes, scales) = quantise(&values);
                payload.begin(format!("{name}.values"), 1, values.shape());
                payload.bytes.extend_from_slice(&bytes);
                payload.add_f32s(format!("{name}.scales"), &values.shape()[..2], &scales);
            } else if let Matrix::LayerBias(_) = which {
                payload.add_f32s(name, &[1, values.len()], &values);
            } else {
                payload.add_f32s(name, values.shape(), &values);
            }
        }
        let numbers = PatchNumbers::of(&model.patch_model);
        models.push(ModelHeader {
            footprint: model.footprint.into(),
            base: model.base.into(),
            pitch: model.pitch,
            passes: vec![PassHeader {
                support: numbers.support,
                patch: numbers.patch,
                floor: numbers.floor,
                lambda: numbers.lambda,
                with_linear: false,
                anchored: numbers.anchored,
            }],
        });
        if let Some(n) = numbers.network {
            networks.push(NetworkHeader {
                model: i as u32,
                pass: 0,
                support: n.support,
                floor: n.floor,
                side_inputs: n.side_inputs.into_iter().map(Into::into).collect(),
                filters_per_input: n.filters_per_input,
                layers: n.layers,
            });
        }
    }
    let header = Header {
        tool: format!("lenslet {}", env!("CARGO_PKG_VERSION")),
        recipe: serde_json::to_string(&dictionary.recipe).map_err(|e| Error::Parameter(e.to_string()))?,
        storage: dictionary.storage.into(),
        models,
        tables: payload.tables,
        sha256: Sha256::digest(&payload.bytes).into(),
    };
    let version = match networks.iter().map(|n| n.side_inputs.iter().any(|s| matches!(s, SideInputCode::Noise))).max() {
        None => NETWORKS - 1,
        Some(false) => NETWORKS,
        Some(true) => NOISE,
    };
    let header = encode_header(&header, &networks).map_err(Error::Parameter)?;
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

fn table_name(model: usize, which: Matrix) -> String {
    format!("{model}.0.{}", which.lfd_name())
}

fn number<const N: usize>(bytes: &[u8], start: usize) -> Option<[u8; N]> {
    bytes.get(start..start + N)?.try_into().ok()
}

/// Reads the bytes of an `.lfd` file, which begin with [`MAGIC`]; errors call it `name`.
///
/// # Errors
/// As [`super::load`].
pub(super) fn read_lfd(bytes: &[u8], name: &str) -> Result<Dictionary, Error> {
    let malformed = |reason: String| Error::Malformed { path: name.into(), reason };
    let short = || malformed(format!("it ends after {} bytes", bytes.len()));
    let version = read_version(bytes, name)?;
    let bytes = if version < SEALED {
        bytes
    } else {
        let (body, seal) = bytes.split_last_chunk::<SEAL>().ok_or_else(short)?;
        if Sha256::digest(body).as_slice() != seal {
            return Err(malformed("it is cut short or damaged: its bytes do not match their checksum".into()));
        }
        body
    };
    let (header, networks, length) = read_header(bytes, version).map_err(malformed)?;
    let payload = bytes.get((FIXED + length).next_multiple_of(ALIGN)..).ok_or_else(short)?;
    if Sha256::digest(payload).as_slice() != header.sha256 {
        return Err(malformed("its matrices do not match their checksum".into()));
    }
    let unsupported = |what| Error::Unsupported { path: name.into(), what };
    if header.models.iter().any(|m| m.passes.len() > 1) {
        return Err(unsupported("a chain of several passes"));
    }
    if header.models.iter().flat_map(|m| &m.passes).any(|p| p.with_linear) {
        return Err(unsupported("codes on top of a ridge regressor (with_linear)"));
    }
    let recipe: Recipe =
        serde_json::from_str(&header.recipe).map_err(|e| malformed(format!("its recipe cannot be read ({e})")))?;
    let models = read_models(&header, &networks, payload).map_err(malformed)?;
    let dictionary = Dictionary { recipe, storage: header.storage.into(), models };
    validate(&dictionary).map_err(|e| malformed(e.to_string()))?;
    Ok(dictionary)
}

/// What the models of an `.lfd` file were trained for, from its header alone; checksums are not verified.
///
/// # Errors
/// As [`read_lfd`].
pub(super) fn read_lfd_kinds(bytes: &[u8], name: &str) -> Result<Vec<ModelKind>, Error> {
    let version = read_version(bytes, name)?;
    let (header, ..) = read_header(bytes, version).map_err(|reason| Error::Malformed { path: name.into(), reason })?;
    let kind = |m: &ModelHeader| ModelKind { footprint: m.footprint.into(), base: m.base.into(), pitch: m.pitch };
    Ok(header.models.iter().map(kind).collect())
}

fn read_version(bytes: &[u8], name: &str) -> Result<u32, Error> {
    let Some(version) = number(bytes, 8).map(u32::from_le_bytes) else {
        return Err(Error::Malformed { path: name.into(), reason: format!("it ends after {} bytes", bytes.len()) });
    };
    if (1..=FORMAT_VERSION).contains(&version) {
        return Ok(version);
    }
    let remedy = if version > FORMAT_VERSION {
        "use a newer lenslet, or train it again with `lenslet train-dict`"
    } else {
        "train it again with `lenslet train-dict`"
    };
    Err(Error::Version { path: name.into(), found: version, known: FORMAT_VERSION, remedy })
}

/// The header, the networks' numbers, and the header's length.
fn read_header(bytes: &[u8], version: u32) -> Result<(Header, Vec<NetworkHeader>, usize), String> {
    let short = || format!("it ends after {} bytes", bytes.len());
    let codec = u32::from_le_bytes(number(bytes, 12).ok_or_else(short)?);
    if codec != CODEC_BINCODE {
        return Err(format!("header codec {codec} is not known"));
    }
    let length = u64::from_le_bytes(number(bytes, 16).ok_or_else(short)?);
    let length = usize::try_from(length).ok().filter(|&l| l <= limits::HEADER);
    let length = length.ok_or("its header is too long")?;
    let encoded = bytes.get(FIXED..FIXED + length).ok_or_else(short)?;
    let (header, networks) = decode_header(encoded, version >= NETWORKS)?;
    Ok((header, networks, length))
}

fn read_models(header: &Header, networks: &[NetworkHeader], payload: &[u8]) -> Result<Vec<Model>, String> {
    if header.models.len() > limits::PARTS {
        return Err(format!("more than {} models", limits::PARTS));
    }
    if networks.iter().any(|n| n.pass != 0 || n.model as usize >= header.models.len()) {
        return Err("a network that belongs to no model".into());
    }
    let storage = header.storage.into();
    let reader = Reader { payload, tables: &header.tables, left: Cell::new(payload.len()) };
    let mut models = Vec::new();
    for (i, model) in header.models.iter().enumerate() {
        let [pass] = model.passes.as_slice() else { return Err("a model without a pass".into()) };
        let network = networks.iter().find(|n| n.model as usize == i).map(|n| NetworkNumbers {
            support: n.support,
            floor: n.floor,
            side_inputs: n.side_inputs.iter().map(|&code| code.into()).collect(),
            filters_per_input: n.filters_per_input.clone(),
            layers: n.layers,
        });
        let numbers = PatchNumbers {
            support: pass.support,
            patch: pass.patch,
            floor: pass.floor,
            lambda: pass.lambda,
            anchored: pass.anchored,
            network,
        };
        let patch_model = assemble(&numbers, &|which| reader.values(&table_name(i, which), which, storage))?;
        let (footprint, base) = (model.footprint.into(), model.base.into());
        models.push(Model { footprint, base, pitch: model.pitch, patch_model });
    }
    Ok(models)
}

struct Reader<'a> {
    payload: &'a [u8],
    tables: &'a [Table],
    /// Payload bytes not yet read: matrices that share bytes would let a small file take any amount of memory.
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

    fn f32s(&self, name: &str) -> Values {
        let (shape, bytes) = self.bytes(name, 4)?;
        Ok((shape, bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()))
    }

    fn values(&self, name: &str, which: Matrix, storage: Storage) -> Values {
        if !is_quantised(which, storage) {
            return self.f32s(name);
        }
        let (shape, bytes) = self.bytes(&format!("{name}.values"), 1)?;
        let (_, scales) = self.f32s(&format!("{name}.scales"))?;
        restored_maps(shape, bytes, &scales)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::predict::network_tests::random_network;
    use super::super::super::validate::tests::small_dictionary;
    use super::super::{from_bytes, load, save};
    use super::*;
    use crate::dictionary::SideInput;
    use proptest::prelude::*;

    /// A dictionary with a network that takes noise, which version 4 is written for.
    fn with_network() -> Dictionary {
        let mut dictionary = small_dictionary(1);
        dictionary.models[0].patch_model.network =
            Some(random_network(5, &[SideInput::Barycentric, SideInput::Cubic, SideInput::Noise]));
        dictionary
    }

    #[test]
    fn networks_come_back_and_need_version_3_or_4() {
        let bytes = to_bytes(&with_network()).unwrap();
        let mut without_noise = with_network();
        without_noise.models[0].patch_model.network = Some(random_network(5, &[SideInput::Cubic]));
        let versions = [small_dictionary(1), without_noise, with_network()].map(|d| to_bytes(&d).unwrap()[8]);
        assert_eq!(versions, [2, 3, 4]);
        assert_eq!(from_bytes(&bytes, "t").unwrap(), with_network());
        for n in (0..bytes.len()).step_by(7) {
            assert!(from_bytes(&bytes[..n], "t").is_err(), "{n} of {} bytes", bytes.len());
        }
        let mut bad = with_network();
        bad.models[0].patch_model.network.as_mut().unwrap().filters_per_input[0] += 1;
        assert!(to_bytes(&bad).is_err());
    }

    #[test]
    fn a_file_gives_back_what_was_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lfd");
        let dictionary = small_dictionary(3);
        save(&path, &dictionary, false).unwrap();
        assert_eq!(load(&path).unwrap(), dictionary);
        assert!(matches!(save(&path, &dictionary, false), Err(Error::Output(_))));
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes, to_bytes(&load(&path).unwrap()).unwrap());
        assert!(matches!(load(&folder.path().join("absent.lfd")), Err(Error::Io { .. })));
    }

    #[test]
    fn bytes_keep_maps_to_half_a_step() {
        let mut dictionary = small_dictionary(3);
        dictionary.storage = Storage::I8;
        let back = from_bytes(&to_bytes(&dictionary).unwrap(), "x").unwrap();
        let maps = |d: &Dictionary| d.models[0].patch_model.anchored.as_ref().unwrap().maps.clone();
        let (before, after) = (maps(&dictionary), maps(&back));
        for (b, a) in before.rows().into_iter().zip(after.rows()) {
            let step = b.iter().fold(0.0f32, |m, v| m.max(v.abs())) / 127.0;
            assert!(b.iter().zip(a).all(|(x, y)| (x - y).abs() <= 0.5001 * step));
        }
        assert_eq!(back.models[0].patch_model.low, dictionary.models[0].patch_model.low);
    }

    #[test]
    fn another_version_is_refused_with_advice() {
        let mut bytes = to_bytes(&small_dictionary(1)).unwrap();
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
        let bytes = to_bytes(&small_dictionary(1)).unwrap();
        for n in 0..bytes.len() {
            assert!(from_bytes(&bytes[..n], "t").is_err(), "{n} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn no_flipped_bit_is_accepted() {
        let whole = to_bytes(&small_dictionary(1)).unwrap();
        for at in 0..whole.len() {
            for bit in [0, 3, 7] {
                let mut bytes = whole.clone();
                bytes[at] ^= 1 << bit;
                // Read as version 1, the file is longer than its payload, so that version's checksum fails.
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
    fn a_header_with_wrong_sizes_is_refused() {
        let bytes = to_bytes(&small_dictionary(1)).unwrap();
        let length = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
        let (mut header, _) = decode_header(&bytes[FIXED..FIXED + length], false).unwrap();
        let rebuilt = |header: &Header| with_header(&small_dictionary(1), |h, _| *h = header.clone());
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

    /// The bytes of a dictionary whose header is changed, sealed again.
    fn with_header(dictionary: &Dictionary, change: impl Fn(&mut Header, &mut Vec<NetworkHeader>)) -> Vec<u8> {
        let bytes = to_bytes(dictionary).unwrap();
        let length = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
        let (mut header, mut networks) = decode_header(&bytes[FIXED..FIXED + length], bytes[8] >= 3).unwrap();
        change(&mut header, &mut networks);
        let encoded = encode_header(&header, &networks).unwrap();
        let mut out = bytes[..16].to_vec();
        out.extend_from_slice(&(encoded.len() as u64).to_le_bytes());
        out.extend_from_slice(&encoded);
        out.resize(out.len().next_multiple_of(ALIGN), 0);
        out.extend_from_slice(&bytes[(FIXED + length).next_multiple_of(ALIGN)..bytes.len() - SEAL]);
        let seal = Sha256::digest(&out);
        out.extend_from_slice(&seal);
        out
    }

    #[test]
    fn unsupported_contents_are_refused_with_advice() {
        let chain = with_header(&small_dictionary(1), |header, _| {
            let again = header.models[0].passes[0].clone();
            header.models[0].passes.push(again);
        });
        let linear = with_header(&small_dictionary(1), |header, _| header.models[0].passes[0].with_linear = true);
        for (bytes, what) in [(chain, "several passes"), (linear, "with_linear")] {
            let error = from_bytes(&bytes, "old.lfd").unwrap_err();
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
            let error = error.to_string();
            assert!(error.contains("old.lfd") && error.contains(what) && error.contains("train-dict"), "{error}");
        }
        let none = with_header(&small_dictionary(1), |header, _| header.models[0].passes.clear());
        assert!(matches!(from_bytes(&none, "t"), Err(Error::Malformed { .. })));
        for (model, pass) in [(1, 0), (0, 1)] {
            let lost = with_header(&with_network(), |_, n| (n[0].model, n[0].pass) = (model, pass));
            assert!(matches!(from_bytes(&lost, "t"), Err(Error::Malformed { .. })));
        }
    }

    #[test]
    fn the_codes_of_types_never_change() {
        use crate::dictionary::Footprint;
        let mut dictionary = small_dictionary(1);
        let at = |d: &Dictionary| to_bytes(d).unwrap();
        let first = at(&dictionary);
        for (k, base) in ["barycentric", "cubic", "bicubic", "multiview"].into_iter().enumerate() {
            for (j, footprint) in [Footprint::Point, Footprint::Lenslet, Footprint::Grid].into_iter().enumerate() {
                dictionary.models[0].base = base.parse().unwrap();
                dictionary.models[0].footprint = footprint;
                let bytes = at(&dictionary);
                let header = |b: &[u8]| b[..(FIXED + 2000).min(b.len())].to_vec();
                let changed: Vec<(u8, u8)> =
                    std::iter::zip(header(&first), header(&bytes)).filter(|(a, b)| a != b).take(2).collect();
                let expected: Vec<(u8, u8)> = [j, k].into_iter().filter(|&n| n > 0).map(|n| (0, n as u8)).collect();
                assert_eq!(changed[..expected.len()], expected, "{base} {footprint}");
            }
        }
    }

    /// A whole file whose bytes before the seal are changed, sealed again.
    fn resealed(dictionary: &Dictionary, change: impl Fn(&mut [u8])) -> Vec<u8> {
        let mut bytes = to_bytes(dictionary).unwrap();
        bytes.truncate(bytes.len() - SEAL);
        change(&mut bytes);
        let seal = Sha256::digest(&bytes);
        bytes.extend_from_slice(&seal);
        bytes
    }

    #[test]
    fn another_codec_and_a_long_header_are_named() {
        let said = |bytes: &[u8]| from_bytes(bytes, "t").unwrap_err().to_string();
        assert!(from_bytes(&resealed(&small_dictionary(1), |_| ()), "t").is_ok());
        let codec = resealed(&small_dictionary(1), |bytes| bytes[12] = 7);
        assert!(said(&codec).contains("codec 7"), "{}", said(&codec));
        let long = resealed(&small_dictionary(1), |bytes| bytes[19] = 1);
        assert!(said(&long).contains("too long"), "{}", said(&long));
    }

    #[test]
    fn matrices_that_share_bytes_are_refused() {
        let shared = with_header(&small_dictionary(1), |header, _| {
            // The first takes all bytes, those of the others too.
            let end = |t: &Table| t.offset + t.shape.iter().product::<u64>() * u64::from(t.bytes_per_value);
            let all = header.tables.iter().map(end).max().unwrap();
            (header.tables[0].offset, header.tables[0].shape) = (0, vec![all / 4, 1]);
        });
        let error = from_bytes(&shared, "t").unwrap_err().to_string();
        assert!(error.contains("overlap"), "{error}");
    }

    #[test]
    fn as_many_models_as_the_limit_says() {
        let mut dictionary = small_dictionary(1);
        let model = dictionary.models[0].clone();
        dictionary.models.resize(limits::PARTS, model.clone());
        assert_eq!(from_bytes(&to_bytes(&dictionary).unwrap(), "t").unwrap(), dictionary);
        dictionary.models.push(model);
        assert!(to_bytes(&dictionary).is_err());
    }

    proptest! {
        #[test]
        fn damage_to_version_1_never_panics(at in 0usize..4000, value: u8, cut in 0usize..4000) {
            let mut bytes = version_1(&small_dictionary(1));
            let n = bytes.len();
            prop_assert_eq!(from_bytes(&bytes, "t").unwrap(), small_dictionary(1));
            bytes[at % n] = value;
            // The payload is protected by its sha256; a header that can still be read must be consistent.
            if let Ok(d) = from_bytes(&bytes, "t") {
                prop_assert!(validate(&d).is_ok());
                prop_assert_eq!(&d.models[0].patch_model.low, &small_dictionary(1).models[0].patch_model.low);
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
