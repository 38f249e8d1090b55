//! Anchored maps stored as bytes, and the names of models in files.

use ndarray::ArrayViewD;

use super::super::model::{Dictionary, Footprint, Storage};
use super::super::patch_model::{Matrix, Values};

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
