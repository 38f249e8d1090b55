//! Algorithm 1, "gamma correction": light is encoded by the camera's exponent before averaging. The default method
//! leaves it out: centres are measured in linear light, where vignetting is a factor and the noise variance is linear
//! in the light.

use crate::container::Capture;

/// Exponent where the metadata give none.
/// Source: metadata of Lytro F01 captures, 0.41666
pub const DEFAULT_EXPONENT: f32 = 1.0 / 2.4;

/// The exponent in a capture's metadata if it lies within 0.05 to 1, else [`DEFAULT_EXPONENT`].
pub fn gamma_exponent(capture: &Capture) -> f32 {
    match capture.colour.gamma {
        Some(g) if g.is_finite() && (0.05..=1.0).contains(&g) => g,
        _ => DEFAULT_EXPONENT,
    }
}

/// `light` raised to `exponent`; light below the black level becomes 0.
#[inline]
pub fn encode_gamma(light: f32, exponent: f32) -> f32 {
    light.max(0.0).powf(exponent)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::{Cfa, Levels, RawMosaic};

    #[test]
    fn exponents_out_of_range_are_replaced() {
        let levels = Levels { black: [0.0; 4], white: [1023.0; 4] };
        let mut capture = Capture::bare(RawMosaic { width: 2, height: 2, data: vec![0; 4] }, Cfa::Bggr, levels);
        for (stated, used) in [
            (None, DEFAULT_EXPONENT),
            (Some(0.5), 0.5),
            (Some(0.05), 0.05),
            (Some(1.0), 1.0),
            (Some(2.2), DEFAULT_EXPONENT),
            (Some(0.01), DEFAULT_EXPONENT),
            (Some(f32::NAN), DEFAULT_EXPONENT),
        ] {
            capture.colour.gamma = stated;
            assert_eq!(gamma_exponent(&capture), used, "{stated:?}");
        }
        assert_eq!((encode_gamma(0.25, 0.5), encode_gamma(-0.1, 0.5)), (0.5, 0.0));
    }
}
