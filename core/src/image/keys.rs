//! Keys' cubic convolution (1981) with a = −½, which is Catmull and Rom's spline: it passes through the samples and
//! reproduces parabolas. Signed values, nothing clamped.

/// The kernel at a distance of `d` samples, 0 from 2 on.
///
/// ```
/// use lenslet_core::image::keys_kernel;
/// assert_eq!([0.0, 1.0, 2.0].map(keys_kernel), [1.0, 0.0, 0.0]);
/// assert_eq!([-0.5, 1.5].map(keys_kernel), [0.5625, -0.0625]);
/// ```
#[inline]
#[must_use]
pub fn keys_kernel(d: f64) -> f64 {
    let d = d.abs();
    if d < 1.0 {
        near(d)
    } else if d < 2.0 {
        far(d)
    } else {
        0.0
    }
}

/// The free parameter a of Keys' kernel.
const A: f64 = -0.5;

#[inline]
fn near(d: f64) -> f64 {
    ((A + 2.0) * d - (A + 3.0)) * d * d + 1.0
}

#[inline]
fn far(d: f64) -> f64 {
    ((A * d - 5.0 * A) * d + 8.0 * A) * d - 4.0 * A
}

/// Weights of the four neighbours −1, 0, 1, 2 for a position `f` (0..1) past neighbour 0. They sum to one.
///
/// ```
/// use lenslet_core::image::keys_weights;
/// assert_eq!(keys_weights(0.5), [-0.0625, 0.5625, 0.5625, -0.0625]);
/// ```
#[inline]
#[must_use]
pub fn keys_weights(f: f64) -> [f64; 4] {
    [far(1.0 + f), near(f), near(1.0 - f), far(2.0 - f)]
}

/// As [`keys_weights`], in f32 and by powers of `f`, which takes fewer operations.
///
/// ```
/// use lenslet_core::image::catmull_rom_weights;
/// assert_eq!(catmull_rom_weights(0.5), [-0.0625, 0.5625, 0.5625, -0.0625]);
/// ```
#[inline]
#[must_use]
pub fn catmull_rom_weights(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (-f + 2.0 * f2 - f3), 0.5 * (2.0 - 5.0 * f2 + 3.0 * f3), 0.5 * (f + 4.0 * f2 - 3.0 * f3), 0.5 * (f3 - f2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_forms_agree_sum_to_one_and_interpolate() {
        for k in 0..=100 {
            let f = f64::from(k) / 100.0;
            let weights = keys_weights(f);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            for (n, (w, c)) in weights.iter().zip(catmull_rom_weights(f as f32)).enumerate() {
                assert!((w - keys_kernel(f + 1.0 - n as f64)).abs() < 1e-12);
                assert!((w - f64::from(c)).abs() < 1e-6);
            }
        }
        assert_eq!(keys_weights(0.0), [0.0, 1.0, 0.0, 0.0]);
        // Written out: 1.5d³ − 2.5d² + 1 within a sample, −0.5d³ + 2.5d² − 4d + 2 within two.
        for k in 0..200 {
            let d = f64::from(k) / 100.0;
            let plain = if d < 1.0 { (1.5 * d - 2.5) * d * d + 1.0 } else { ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0 };
            assert_eq!(keys_kernel(-d), plain);
        }
    }
}
