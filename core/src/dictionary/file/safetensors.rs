//! The `.safetensors` file of a dictionary: the same contents as `.lfd`, in a format that other tools read.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | length of the header, little-endian, such that the tensors begin at a multiple of 8 |
//! | … | header, JSON: `__metadata__` (strings), then name, type, shape and place of every tensor |
//! | … | tensors without gaps, rows contiguous, little-endian |
//!
//! Tensors are named `MODEL.PREDICTOR.MATRIX`, as `point.lasso.low_atoms`. All are f32, except anchored maps stored as
//! bytes (`MODEL.anchored.maps`, i8, times one value of `MODEL.anchored.map_scales` per row). Metadata are strings, all
//! but the first two and the last holding JSON:
//!
//! | key | what |
//! |---|---|
//! | `lenslet_dictionary` | version of this layout |
//! | `tool` | name and version of the program that wrote the file |
//! | `recipe` | how it was trained |
//! | `storage` | how anchored maps are stored |
//! | `models` | name, and what is not a matrix, of every model |
//! | `sha256` | checksum of all other metadata and all tensors, see [`checksum`]; a file without it is read unchecked |
//!
//! Metadata and tensors are written in order of their names (tensors of wider types first), so that the same dictionary
//! gives the same bytes in every run; the safetensors crate writes metadata in the random order of a hash map.

use std::collections::{BTreeMap, BTreeSet};

use ::safetensors::SafeTensors;
use ::safetensors::tensor::{Dtype, Metadata, TensorView};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::super::error::Error;
use super::super::limits;
use super::super::model::{Dictionary, Footprint, Model, ModelKind, Storage};
use super::super::patch_model::{Matrix, PatchNumbers, Values, assemble, matrices};
use super::super::recipe::Recipe;
use super::super::validate::validate;
use super::quantise::{is_quantised, model_names, quantise, restored_maps};
use crate::interpolation::Interpolation;

/// The latest version of the layout of metadata and tensors.
const LAYOUT_VERSION: u32 = 1;
/// The metadata key that marks a file as a dictionary; its value is the version.
const VERSION_KEY: &str = "lenslet_dictionary";
const CHECKSUM_KEY: &str = "sha256";
/// Bytes before the header.
const FIXED: usize = 8;

/// A model's name in tensor names, and what is not a matrix.
#[derive(Debug, Serialize, Deserialize)]
struct NamedModel {
    name: String,
    footprint: Footprint,
    base: Interpolation,
    pitch: f64,
    #[serde(flatten)]
    numbers: PatchNumbers,
}

/// A tensor to be written.
struct Tensor {
    dtype: &'static str,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// Everything but the tensors, by key.
pub(super) fn metadata(dictionary: &Dictionary) -> Result<BTreeMap<String, serde_json::Value>, Error> {
    let wrong = |e: serde_json::Error| Error::Parameter(e.to_string());
    let names = model_names(dictionary).into_iter().zip(&dictionary.models);
    let named = |(name, model): (String, &Model)| NamedModel {
        name,
        footprint: model.footprint,
        base: model.base,
        pitch: model.pitch,
        numbers: PatchNumbers::of(&model.patch_model),
    };
    let models: Vec<NamedModel> = names.map(named).collect();
    let mut all = BTreeMap::new();
    all.insert(VERSION_KEY.into(), LAYOUT_VERSION.to_string().into());
    all.insert("tool".into(), format!("lenslet {}", env!("CARGO_PKG_VERSION")).into());
    all.insert("recipe".into(), serde_json::to_value(&dictionary.recipe).map_err(wrong)?);
    all.insert("storage".into(), serde_json::to_value(dictionary.storage).map_err(wrong)?);
    all.insert("models".into(), serde_json::to_value(models).map_err(wrong)?);
    Ok(all)
}

fn tensors(dictionary: &Dictionary) -> BTreeMap<String, Tensor> {
    let to_bytes = |values: &mut dyn Iterator<Item = &f32>| values.flat_map(|v| v.to_le_bytes()).collect();
    let mut all = BTreeMap::new();
    for (name, model) in model_names(dictionary).into_iter().zip(&dictionary.models) {
        for (which, values) in matrices(&model.patch_model) {
            let shape = values.shape().to_vec();
            let tensor = if is_quantised(which, dictionary.storage) {
                let (bytes, scales) = quantise(&values);
                let scales = Tensor { dtype: "F32", shape: shape[..2].to_vec(), bytes: to_bytes(&mut scales.iter()) };
                all.insert(scales_name(&name), scales);
                Tensor { dtype: "I8", shape, bytes }
            } else {
                Tensor { dtype: "F32", shape, bytes: to_bytes(&mut values.iter()) }
            };
            all.insert(tensor_name(&name, which), tensor);
        }
    }
    all
}

fn tensor_name(model: &str, which: Matrix) -> String {
    format!("{model}.{}", which.tensor_name())
}

fn scales_name(model: &str) -> String {
    format!("{model}.anchored.map_scales")
}

/// SHA-256 (hexadecimal) of all metadata but itself, key, NUL, value, NUL each, then of all tensors, name, NUL, values
/// each; both in order of their names.
fn checksum<'a>(
    metadata: impl Iterator<Item = (&'a str, &'a str)>,
    tensors: impl Iterator<Item = (&'a str, &'a [u8])>,
) -> String {
    let mut hash = Sha256::new();
    for (key, value) in metadata.filter(|(key, _)| *key != CHECKSUM_KEY) {
        for part in [key, "\0", value, "\0"] {
            hash.update(part);
        }
    }
    for (name, bytes) in tensors {
        hash.update(name);
        hash.update("\0");
        hash.update(bytes);
    }
    format!("{:x}", hash.finalize())
}

/// A dictionary as the bytes of a `.safetensors` file. The same dictionary always gives the same bytes.
///
/// # Errors
/// [`Error::Parameter`] when it is not a valid dictionary.
pub(super) fn to_safetensors(dictionary: &Dictionary) -> Result<Vec<u8>, Error> {
    validate(dictionary)?;
    let wrong = |e: serde_json::Error| Error::Parameter(e.to_string());
    let mut metadata: BTreeMap<String, String> = metadata(dictionary)?
        .into_iter()
        .map(|(key, value)| (key, value.as_str().map_or_else(|| value.to_string(), String::from)))
        .collect();
    // The name of the storage is JSON as well, with its quotes.
    metadata.insert("storage".into(), serde_json::to_string(&dictionary.storage).map_err(wrong)?);
    let tensors = tensors(dictionary);
    let strings = metadata.iter().map(|(k, v)| (k.as_str(), v.as_str()));
    let sum = checksum(strings, tensors.iter().map(|(name, t)| (name.as_str(), t.bytes.as_slice())));
    metadata.insert(CHECKSUM_KEY.into(), sum);

    let mut header = serde_json::Map::new();
    header.insert("__metadata__".into(), serde_json::to_value(metadata).map_err(wrong)?);
    // f32 before i8, so that every value is aligned.
    let ordered = ["F32", "I8"].into_iter().flat_map(|dtype| tensors.iter().filter(move |(_, t)| t.dtype == dtype));
    let mut end = 0;
    for (name, tensor) in ordered.clone() {
        let start = end;
        end += tensor.bytes.len();
        let entry = serde_json::json!({ "dtype": tensor.dtype, "shape": tensor.shape, "data_offsets": [start, end] });
        header.insert(name.clone(), entry);
    }
    let mut header = serde_json::to_vec(&header).map_err(wrong)?;
    header.resize(header.len().next_multiple_of(FIXED), b' ');
    if header.len() > limits::HEADER {
        return Err(Error::Parameter(format!("the recipe takes {} bytes, too many", header.len())));
    }
    let mut bytes = Vec::with_capacity(FIXED + header.len() + end);
    bytes.extend_from_slice(&(header.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&header);
    for (_, tensor) in ordered {
        bytes.extend_from_slice(&tensor.bytes);
    }
    Ok(bytes)
}

/// Whether bytes begin as a `.safetensors` file does: a length, then JSON.
pub(super) fn begins_as_safetensors(bytes: &[u8]) -> bool {
    let Some(length) = bytes.first_chunk::<FIXED>() else { return false };
    // No other file format read here has a number below 2³² in these bytes.
    bytes.get(FIXED) == Some(&b'{') && u64::from_le_bytes(*length) <= u64::from(u32::MAX)
}

/// Reads the bytes of a `.safetensors` file; errors call it `name`.
///
/// # Errors
/// As [`super::load`].
pub(super) fn read_safetensors(bytes: &[u8], name: &str) -> Result<Dictionary, Error> {
    let malformed = |reason: String| Error::Malformed { path: name.into(), reason };
    let unread = |e: ::safetensors::SafeTensorError| malformed(format!("its header cannot be read ({e})"));
    let header = read_header(bytes, name)?;
    let metadata = strings(&header);
    let file = SafeTensors::deserialize(bytes).map_err(unread)?;
    let tensors: BTreeMap<&str, TensorView<'_>> = file.iter().collect();
    if let Some(sum) = metadata.get(CHECKSUM_KEY) {
        let strings = metadata.iter().map(|(k, v)| (*k, *v));
        if checksum(strings, tensors.iter().map(|(name, t)| (*name, t.data()))) != *sum {
            return Err(malformed("its contents do not match their checksum".into()));
        }
    }
    read_contents(&metadata, &tensors).map_err(malformed)
}

/// What the models of a `.safetensors` file were trained for, from its header alone; the checksum is not verified.
///
/// # Errors
/// As [`read_safetensors`].
pub(super) fn read_safetensors_kinds(bytes: &[u8], name: &str) -> Result<Vec<ModelKind>, Error> {
    let header = read_header(bytes, name)?;
    let named: Vec<NamedModel> =
        entry(&strings(&header), "models").map_err(|reason| Error::Malformed { path: name.into(), reason })?;
    let kind = |m: NamedModel| ModelKind { footprint: m.footprint, base: m.base, pitch: m.pitch };
    Ok(named.into_iter().map(kind).collect())
}

/// The header of a dictionary of this layout version.
fn read_header(bytes: &[u8], name: &str) -> Result<Metadata, Error> {
    let malformed = |reason: String| Error::Malformed { path: name.into(), reason };
    let length = bytes.first_chunk::<FIXED>().map_or(0, |length| u64::from_le_bytes(*length));
    if length > limits::HEADER as u64 {
        return Err(malformed("its header is too long".into()));
    }
    let unread = |e: ::safetensors::SafeTensorError| malformed(format!("its header cannot be read ({e})"));
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(unread)?;
    let Some(version) = header.metadata().as_ref().and_then(|metadata| metadata.get(VERSION_KEY)) else {
        return Err(Error::NotDictionary { path: name.into() });
    };
    match version.parse() {
        Ok(LAYOUT_VERSION) => Ok(header),
        Ok(found) => {
            let remedy = "use a newer lenslet, or train it again with `lenslet train-dict`";
            Err(Error::Version { path: name.into(), found, known: LAYOUT_VERSION, remedy })
        }
        Err(_) => Err(malformed(format!("{VERSION_KEY} {version:?} is not a version number"))),
    }
}

/// The metadata in order of their keys.
fn strings(header: &Metadata) -> BTreeMap<&str, &str> {
    header.metadata().iter().flatten().map(|(key, value)| (key.as_str(), value.as_str())).collect()
}

fn read_contents(
    metadata: &BTreeMap<&str, &str>,
    tensors: &BTreeMap<&str, TensorView<'_>>,
) -> Result<Dictionary, String> {
    let recipe: Recipe = entry(metadata, "recipe")?;
    let storage: Storage = entry(metadata, "storage")?;
    let named: Vec<NamedModel> = entry(metadata, "models")?;
    if named.len() > limits::PARTS {
        return Err(format!("more than {} models", limits::PARTS));
    }
    // Models that share tensors would let a small file take a multiple of its size in memory.
    let names: BTreeSet<&str> = named.iter().map(|m| m.name.as_str()).collect();
    if names.len() < named.len() {
        return Err("two models have the same name".into());
    }
    let model = |m: &NamedModel| {
        let patch_model = assemble(&m.numbers, &|which| values(tensors, &m.name, which, storage))?;
        Ok::<_, String>(Model { footprint: m.footprint, base: m.base, pitch: m.pitch, patch_model })
    };
    let models: Vec<Model> = named.iter().map(model).collect::<Result<_, _>>()?;
    let dictionary = Dictionary { recipe, storage, models };
    validate(&dictionary).map_err(|e| e.to_string())?;
    Ok(dictionary)
}

fn entry<T: for<'de> Deserialize<'de>>(metadata: &BTreeMap<&str, &str>, key: &str) -> Result<T, String> {
    let text = metadata.get(key).ok_or_else(|| format!("its metadata have no {key}"))?;
    serde_json::from_str(text).map_err(|e| format!("its {key} cannot be read ({e})"))
}

fn values(tensors: &BTreeMap<&str, TensorView<'_>>, model: &str, which: Matrix, storage: Storage) -> Values {
    let name = tensor_name(model, which);
    if !is_quantised(which, storage) {
        return f32s(tensors, &name);
    }
    let tensor = find(tensors, &name, Dtype::I8)?;
    let (_, scales) = f32s(tensors, &scales_name(model))?;
    restored_maps(tensor.shape().to_vec(), tensor.data(), &scales)
}

fn f32s(tensors: &BTreeMap<&str, TensorView<'_>>, name: &str) -> Values {
    let tensor = find(tensors, name, Dtype::F32)?;
    let values = tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok((tensor.shape().to_vec(), values))
}

fn find<'a, 'd>(
    tensors: &'a BTreeMap<&str, TensorView<'d>>,
    name: &str,
    dtype: Dtype,
) -> Result<&'a TensorView<'d>, String> {
    let tensor = tensors.get(name).ok_or_else(|| format!("tensor {name} is missing"))?;
    if tensor.dtype() != dtype {
        return Err(format!("tensor {name} is of type {:?}, not {dtype:?}", tensor.dtype()));
    }
    Ok(tensor)
}

#[cfg(test)]
mod tests {
    use super::super::super::predict::network_tests::random_network;
    use super::super::super::validate::tests::small_dictionary;
    use super::super::{from_bytes, to_bytes};
    use super::*;
    use crate::dictionary::SideInput;

    /// Two models, one of them with a network.
    fn two_models(storage: Storage) -> Dictionary {
        let mut dictionary = small_dictionary(1);
        dictionary.models.extend(small_dictionary(2).models);
        dictionary.models.extend(small_dictionary(3).models);
        dictionary.models[1].footprint = Footprint::Lenslet;
        dictionary.models[1].patch_model.anchored = None;
        dictionary.models[1].patch_model.network =
            Some(random_network(5, &[SideInput::Barycentric, SideInput::Cubic, SideInput::Noise]));
        dictionary.storage = storage;
        // As read from a file: storing maps as bytes has rounded them.
        from_bytes(&to_bytes(&dictionary).unwrap(), "t").unwrap()
    }

    #[test]
    fn both_formats_hold_the_same() {
        for storage in [Storage::F32, Storage::I8] {
            let dictionary = two_models(storage);
            let lfd = to_bytes(&dictionary).unwrap();
            let tensors = to_safetensors(&dictionary).unwrap();
            let back = from_bytes(&tensors, "t").unwrap();
            assert_eq!(back, dictionary);
            assert_eq!(to_bytes(&back).unwrap(), lfd);
            assert_eq!(to_safetensors(&back).unwrap(), tensors);
        }
    }

    #[test]
    fn shipped_and_old_dictionaries_are_equal_after_a_round_trip() {
        for file in [
            &include_bytes!("../../../../dictionaries/small.lfd")[..],
            include_bytes!("../../../../dictionaries/multiview.lfd"),
            include_bytes!("../../../../tests/reference/golden-1.lfd"),
            include_bytes!("../../../../tests/reference/golden-1-f32.lfd"),
        ] {
            let dictionary = from_bytes(file, "t").unwrap();
            let lfd = to_bytes(&dictionary).unwrap();
            let back = from_bytes(&to_safetensors(&dictionary).unwrap(), "t").unwrap();
            assert!(back == dictionary && to_bytes(&back).unwrap() == lfd);
            // Since version 2 a file that is read and written is the same file.
            assert!(file[8] < 2 || lfd == file);
        }
    }

    #[test]
    fn the_crate_reads_names_types_and_shapes() {
        let bytes = to_safetensors(&two_models(Storage::I8)).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let maps = file.tensor("point.anchored.maps").unwrap();
        assert_eq!((maps.dtype(), maps.shape()), (Dtype::I8, &[4, 5, 9][..]));
        let low = file.tensor("point_2.lasso.low_atoms").unwrap();
        assert_eq!((low.dtype(), low.shape()), (Dtype::F32, &[8, 5][..]));
        assert_eq!(file.tensor("lenslet.network.layer_0.bias").unwrap().shape(), [7]);
        assert!(file.tensor("lenslet.anchored.maps").is_err());
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        assert_eq!(length % 8, 0);
        let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
        let models: serde_json::Value =
            serde_json::from_str(header["__metadata__"]["models"].as_str().unwrap()).unwrap();
        assert_eq!((&models[1]["name"], &models[1]["base"]), (&"lenslet".into(), &"barycentric".into()));
    }

    #[test]
    fn another_tool_may_write_it_again() {
        // As the Python package would: through the crate, metadata in any order; then without the checksum.
        let dictionary = two_models(Storage::I8);
        let bytes = to_safetensors(&dictionary).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let mut metadata = header.metadata().clone().unwrap();
        let again = ::safetensors::serialize(file.tensors(), Some(metadata.clone())).unwrap();
        assert_eq!(from_bytes(&again, "t").unwrap(), dictionary);
        metadata.insert("storage".into(), "\"f32\"".into());
        let changed = ::safetensors::serialize(file.tensors(), Some(metadata.clone())).unwrap();
        assert!(from_bytes(&changed, "t").unwrap_err().to_string().contains("checksum"));
        metadata.insert("storage".into(), "\"i8\"".into());
        metadata.remove("sha256");
        metadata.insert("note".into(), "mine".into());
        let unchecked = ::safetensors::serialize(file.tensors(), Some(metadata.clone())).unwrap();
        assert_eq!(from_bytes(&unchecked, "t").unwrap(), dictionary);
        metadata.insert("lenslet_dictionary".into(), "7".into());
        let newer = ::safetensors::serialize(file.tensors(), Some(metadata.clone())).unwrap();
        assert!(from_bytes(&newer, "t").unwrap_err().to_string().contains("version 7"));
        metadata.remove("lenslet_dictionary");
        let other = ::safetensors::serialize(file.tensors(), Some(metadata)).unwrap();
        assert!(matches!(from_bytes(&other, "t"), Err(Error::NotDictionary { .. })));
    }

    #[test]
    fn no_truncation_and_no_flipped_bit_is_accepted() {
        let whole = to_safetensors(&two_models(Storage::I8)).unwrap();
        for n in (0..whole.len()).step_by(5) {
            assert!(from_bytes(&whole[..n], "t").is_err(), "{n} of {} bytes", whole.len());
        }
        let read = from_bytes(&whole, "t").unwrap();
        for at in (0..whole.len()).step_by(3) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (at % 8);
            // Blanks between the parts of the header have no meaning.
            assert!(from_bytes(&bytes, "t").map_or(true, |d| d == read), "byte {at}");
        }
        assert!(from_bytes(&[&whole[..], b"x"].concat(), "t").is_err());
    }

    #[test]
    fn models_that_share_tensors_are_refused() {
        let bytes = to_safetensors(&two_models(Storage::F32)).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let mut metadata = header.metadata().clone().unwrap();
        metadata.remove("sha256");
        let models = metadata["models"].replace("\"point_2\"", "\"point\"");
        metadata.insert("models".into(), models);
        let shared = ::safetensors::serialize(file.tensors(), Some(metadata)).unwrap();
        assert!(from_bytes(&shared, "t").unwrap_err().to_string().contains("same name"));
    }

    #[test]
    fn numbers_of_four_bytes_begin_at_multiples_of_four() {
        let mut dictionary = two_models(Storage::I8);
        // Maps of 4·5·9 bytes would hide it; five anchors do not.
        let anchored = dictionary.models[0].patch_model.anchored.as_mut().unwrap();
        anchored.anchors =
            ndarray::concatenate![ndarray::Axis(0), anchored.anchors, anchored.anchors.slice(ndarray::s![..1, ..])];
        anchored.maps =
            ndarray::concatenate![ndarray::Axis(0), anchored.maps, anchored.maps.slice(ndarray::s![..1, .., ..])];
        let bytes = to_safetensors(&dictionary).unwrap();
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
        let mut bytes_of_maps = 0;
        for (name, tensor) in header.as_object().unwrap().iter().filter(|(name, _)| *name != "__metadata__") {
            let [begin, end] = [0, 1].map(|k| tensor["data_offsets"][k].as_u64().unwrap());
            if tensor["dtype"] == "F32" {
                assert_eq!(begin % 4, 0, "{name}");
            } else {
                bytes_of_maps += end - begin;
            }
        }
        assert_ne!(bytes_of_maps % 4, 0);
        assert_eq!(from_bytes(&bytes, "t").unwrap().models[0].patch_model.anchored.as_ref().unwrap().maps.dim().0, 5);
    }

    #[test]
    fn the_first_nine_bytes_tell_the_format() {
        let head = |length: u64, next: u8| [&length.to_le_bytes()[..], &[next]].concat();
        assert!(begins_as_safetensors(&head(40, b'{')) && begins_as_safetensors(&head(u64::from(u32::MAX), b'{')));
        assert!(!begins_as_safetensors(&head(40, b'[')));
        assert!(!begins_as_safetensors(&head(1 << 32, b'{')));
        assert!(!begins_as_safetensors(&head(40, b'{')[..8]));
    }

    #[test]
    fn as_many_models_as_the_limit_says() {
        let mut dictionary = small_dictionary(1);
        let model = dictionary.models[0].clone();
        dictionary.models.resize(limits::PARTS, model.clone());
        assert_eq!(from_bytes(&to_safetensors(&dictionary).unwrap(), "t").unwrap(), dictionary);
        dictionary.models.push(model);
        assert!(to_safetensors(&dictionary).is_err());
    }
}
