//! Algorithm 1, "gamma correction": light is encoded by the camera's exponent before averaging, as the paper has it. The default
//! way leaves it out: centres are measured in linear light, where vignetting is a factor and noise has a known shape.

use crate::container::Capture;

/// Exponent of a camera that does not say (Lytro F01).
pub const DEFAULT_EXPONENT: f32 = 1.0 / 2.4;

/// The exponent a capture's metadata give, if it is one at all.
pub fn gamma_exponent(capture: &Capture) -> f32 {
    match capture.colour.gamma {
        Some(g) if g.is_finite() && (0.05..=1.0).contains(&g) => g,
        _ => DEFAULT_EXPONENT,
    }
}

/// `light` raised to `exponent`; light below black is black.
#[inline]
pub fn encode_gamma(light: f32, exponent: f32) -> f32 {
    light.max(0.0).powf(exponent)
}
