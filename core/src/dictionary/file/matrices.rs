//! The matrices of a model, enumerated once for every file format, and its other numbers.

use ndarray::{Array1, Array2, Array3, ArrayViewD};
use serde::{Deserialize, Serialize};

use super::super::limits;
use super::super::model::{Anchored, Dictionary, Footprint, Layer, Model, Network, PatchModel, Storage};
use crate::interpolation::Interpolation;

/// Which matrix of a [`PatchModel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Matrix {
    Filters,
    LowAtoms,
    HighAtoms,
    Ridge,
    Anchors,
    Maps,
    NetworkFilters,
    LayerWeights(usize),
    LayerBias(usize),
}

impl Matrix {
    /// The name of the tensor in a `.safetensors` file, after the model's; also that of the exported .npy file.
    pub(super) fn tensor_name(self) -> String {
        match self {
            Matrix::Filters => "features.filters".into(),
            Matrix::LowAtoms => "lasso.low_atoms".into(),
            Matrix::HighAtoms => "lasso.high_atoms".into(),
            Matrix::Ridge => "ridge.map".into(),
            Matrix::Anchors => "anchored.anchors".into(),
            Matrix::Maps => "anchored.maps".into(),
            Matrix::NetworkFilters => "network.filters".into(),
            Matrix::LayerWeights(k) => format!("network.layer_{k}.weights"),
            Matrix::LayerBias(k) => format!("network.layer_{k}.bias"),
        }
    }

    /// The name in the table of an `.lfd` file, after the numbers of the model and of its only pass.
    pub(super) fn lfd_name(self) -> String {
        match self {
            Matrix::Filters => "filters".into(),
            Matrix::LowAtoms => "low".into(),
            Matrix::HighAtoms => "high".into(),
            Matrix::Ridge => "linear".into(),
            Matrix::Anchors => "anchors".into(),
            Matrix::Maps => "maps".into(),
            Matrix::NetworkFilters => "network.filters".into(),
            Matrix::LayerWeights(k) => format!("network.{k}.weights"),
            Matrix::LayerBias(k) => format!("network.{k}.bias"),
        }
    }
}

/// Every matrix of a model, in the order of the `.lfd` file.
pub(super) fn matrices(parts: &PatchModel) -> Vec<(Matrix, ArrayViewD<'_, f32>)> {
    let mut all = vec![
        (Matrix::Filters, parts.filters.view().into_dyn()),
        (Matrix::LowAtoms, parts.low.view().into_dyn()),
        (Matrix::HighAtoms, parts.high.view().into_dyn()),
        (Matrix::Ridge, parts.ridge.view().into_dyn()),
    ];
    if let Some(a) = &parts.anchored {
        all.push((Matrix::Anchors, a.anchors.view().into_dyn()));
        all.push((Matrix::Maps, a.maps.view().into_dyn()));
    }
    if let Some(n) = &parts.network {
        all.push((Matrix::NetworkFilters, n.filters.view().into_dyn()));
        for (k, layer) in n.layers.iter().enumerate() {
            all.push((Matrix::LayerWeights(k), layer.weights.view().into_dyn()));
            all.push((Matrix::LayerBias(k), layer.bias.view().into_dyn()));
        }
    }
    all
}

/// The names of the models in tensor names: the footprint, followed by a running number where it repeats.
pub(super) fn model_names(dictionary: &Dictionary) -> Vec<String> {
    let footprints: Vec<Footprint> = dictionary.models.iter().map(|m| m.footprint).collect();
    (0..footprints.len())
        .map(|i| match footprints[..i].iter().filter(|f| **f == footprints[i]).count() {
            0 => footprints[i].to_string(),
            earlier => format!("{}_{}", footprints[i], earlier + 1),
        })
        .collect()
}

/// What a model is besides its matrices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModelNumbers {
    pub(super) footprint: Footprint,
    pub(super) base: Interpolation,
    pub(super) pitch: f64,
    pub(super) support: u32,
    pub(super) patch: u32,
    pub(super) floor: f32,
    pub(super) lambda: f32,
    pub(super) anchored: bool,
    pub(super) network: Option<NetworkNumbers>,
}

/// What a network is besides its matrices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NetworkNumbers {
    pub(super) support: u32,
    pub(super) floor: f32,
    pub(super) side_inputs: Vec<Interpolation>,
    pub(super) filters_per_input: Vec<u32>,
    pub(super) layers: u32,
}

impl ModelNumbers {
    pub(super) fn of(model: &Model) -> Self {
        let parts = &model.patch_model;
        ModelNumbers {
            footprint: model.footprint,
            base: model.base,
            pitch: model.pitch,
            support: parts.support as u32,
            patch: parts.patch as u32,
            floor: parts.floor,
            lambda: parts.lambda,
            anchored: parts.anchored.is_some(),
            network: parts.network.as_ref().map(|n| NetworkNumbers {
                support: n.support as u32,
                floor: n.floor,
                side_inputs: n.side_inputs.clone(),
                filters_per_input: n.filters_per_input.iter().map(|&c| c as u32).collect(),
                layers: n.layers.len() as u32,
            }),
        }
    }
}

/// Shape and values of a matrix, or what is wrong with it.
pub(super) type Values = Result<(Vec<usize>, Vec<f32>), String>;

/// A model from its numbers and the matrices that `read` returns. Shapes are checked by [`super::super::validate`], not
/// here.
///
/// # Errors
/// Numbers beyond [`limits`]; errors of `read`; matrices with a wrong number of dimensions.
pub(super) fn assemble_model(numbers: &ModelNumbers, read: &dyn Fn(Matrix) -> Values) -> Result<Model, String> {
    let matrix = |which| two_dimensional(which, read(which)?);
    let anchored = if numbers.anchored {
        Some(Anchored {
            anchors: matrix(Matrix::Anchors)?,
            maps: three_dimensional(Matrix::Maps, read(Matrix::Maps)?)?,
        })
    } else {
        None
    };
    let network = numbers.network.as_ref().map(|n| assemble_network(n, read)).transpose()?;
    let patch_model = PatchModel {
        support: side(numbers.support)?,
        patch: side(numbers.patch)?,
        filters: matrix(Matrix::Filters)?,
        floor: numbers.floor,
        lambda: numbers.lambda,
        low: matrix(Matrix::LowAtoms)?,
        high: matrix(Matrix::HighAtoms)?,
        ridge: matrix(Matrix::Ridge)?,
        anchored,
        network,
    };
    Ok(Model { footprint: numbers.footprint, base: numbers.base, pitch: numbers.pitch, patch_model })
}

fn assemble_network(numbers: &NetworkNumbers, read: &dyn Fn(Matrix) -> Values) -> Result<Network, String> {
    if numbers.layers as usize > limits::PARTS {
        return Err(format!("a network of {} layers", numbers.layers));
    }
    let mut layers = Vec::new();
    for k in 0..numbers.layers as usize {
        let (weights, bias) = (Matrix::LayerWeights(k), Matrix::LayerBias(k));
        layers
            .push(Layer { weights: two_dimensional(weights, read(weights)?)?, bias: Array1::from_vec(read(bias)?.1) });
    }
    Ok(Network {
        support: side(numbers.support)?,
        side_inputs: numbers.side_inputs.clone(),
        filters_per_input: numbers.filters_per_input.iter().map(|&c| c as usize).collect(),
        filters: two_dimensional(Matrix::NetworkFilters, read(Matrix::NetworkFilters)?)?,
        floor: numbers.floor,
        layers,
    })
}

fn side(pixels: u32) -> Result<usize, String> {
    if pixels as usize > limits::SIDE { Err(format!("a side of {pixels} pixels")) } else { Ok(pixels as usize) }
}

fn two_dimensional(which: Matrix, (shape, values): (Vec<usize>, Vec<f32>)) -> Result<Array2<f32>, String> {
    let &[rows, columns] = shape.as_slice() else {
        return Err(format!("matrix {} does not have two dimensions", which.tensor_name()));
    };
    Array2::from_shape_vec((rows, columns), values).map_err(|e| e.to_string())
}

fn three_dimensional(which: Matrix, (shape, values): (Vec<usize>, Vec<f32>)) -> Result<Array3<f32>, String> {
    let &[k, m, p] = shape.as_slice() else {
        return Err(format!("matrix {} does not have three dimensions", which.tensor_name()));
    };
    Array3::from_shape_vec((k, m, p), values).map_err(|e| e.to_string())
}

/// Values of anchored maps as [`Storage::I8`]: signed bytes and one scale per row; a row of zeros has scale 0.
///
/// Rows that were read from bytes give the same bytes and scales again.
pub(super) fn quantise(maps: &ArrayViewD<'_, f32>) -> (Vec<u8>, Vec<f32>) {
    let (mut bytes, mut scales) = (Vec::with_capacity(maps.len()), Vec::new());
    for row in maps.rows() {
        let largest = row.iter().fold(0.0f32, |a, b| a.max(b.abs())) / 127.0;
        let to_bytes = |scale: f32| {
            let inverse = if scale > 0.0 { 1.0 / scale } else { 0.0 };
            row.iter().map(move |v| (v * inverse).round().clamp(-127.0, 127.0) as i8 as u8)
        };
        let exact = |&scale: &f32| row.iter().zip(to_bytes(scale)).all(|(v, b)| f32::from(b as i8) * scale == *v);
        // (127·s)/127 is not always s, but then a neighbour of it.
        let scale = [largest, largest.next_up(), largest.next_down()].into_iter().find(exact).unwrap_or(largest);
        bytes.extend(to_bytes(scale));
        scales.push(scale);
    }
    (bytes, scales)
}

/// The values of [`quantise`], rows of `row` bytes.
pub(super) fn restore(bytes: &[u8], scales: &[f32], row: usize) -> Vec<f32> {
    let rows = bytes.chunks_exact(row.max(1)).zip(scales);
    rows.flat_map(|(bytes, scale)| bytes.iter().map(move |&b| f32::from(b as i8) * scale)).collect()
}

/// The values of maps stored as bytes, of this shape, and their scales.
///
/// # Errors
/// When there is not one scale per row.
pub(super) fn restored_maps(shape: Vec<usize>, bytes: &[u8], scales: &[f32]) -> Values {
    let row = shape.last().copied().unwrap_or(0).max(1);
    if scales.len() * row != bytes.len() {
        return Err(format!("{} bytes of anchored maps have {} scales", bytes.len(), scales.len()));
    }
    Ok((shape, restore(bytes, scales, row)))
}

/// Whether a matrix is stored as bytes.
pub(super) fn is_quantised(which: Matrix, storage: Storage) -> bool {
    which == Matrix::Maps && storage == Storage::I8
}
