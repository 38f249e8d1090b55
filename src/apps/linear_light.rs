//! Light fields to linear light, in which the applications add up.

use lenslet_core::colour::srgb_decode;
use lenslet_core::lightfield::{ColourSpace, LightField};
use ndarray::Zip;

/// Steps of the table: stored light fields have 16 bits a value.
const STEPS: usize = 65535;

/// Turns the values of a light field into linear light in place; one that is linear already stays as it is.
///
/// Encoded values are rounded to 16 bits and cut to 0..1; NaN becomes 0.
pub fn to_linear_light(field: &mut LightField) {
    if field.meta.colour == ColourSpace::Linear {
        return;
    }
    let table: Vec<f32> = (0..=STEPS).map(|k| srgb_decode(k as f32 / STEPS as f32)).collect();
    Zip::from(&mut field.data).par_for_each(|v| {
        // A NaN becomes 0 here.
        *v = table[(v.clamp(0.0, 1.0) * STEPS as f32 + 0.5) as usize];
    });
    field.meta.colour = ColourSpace::Linear;
}
