//! Standard normal numbers from the generator that all random streams come from.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// Two standard normal numbers (Box and Muller 1958).
#[inline]
pub(crate) fn normal_pair(generator: &mut ChaCha8Rng) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - generator.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * generator.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

/// One standard normal number; the second of the pair is dropped.
pub(crate) fn standard_normal(generator: &mut ChaCha8Rng) -> f32 {
    normal_pair(generator)[0] as f32
}
