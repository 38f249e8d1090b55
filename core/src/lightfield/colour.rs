//! Colour spaces of views, and the conversion between them.

use ndarray::{ArrayBase, DataMut, Dimension};
use serde::{Deserialize, Serialize};

use crate::colour::{srgb_decode, srgb_encode};

/// How values relate to light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourSpace {
    /// sRGB primaries, sRGB transfer curve.
    Srgb,
    /// sRGB primaries, linear light.
    Linear,
}

/// Converts values in place from one colour space to another.
pub fn convert<S: DataMut<Elem = f32>, D: Dimension>(values: &mut ArrayBase<S, D>, from: ColourSpace, to: ColourSpace) {
    match (from, to) {
        (ColourSpace::Linear, ColourSpace::Srgb) => values.mapv_inplace(srgb_encode),
        (ColourSpace::Srgb, ColourSpace::Linear) => values.mapv_inplace(srgb_decode),
        _ => {}
    }
}
