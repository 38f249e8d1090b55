//! Random numbers whose streams never change: the recipes and simulated captures of earlier versions stay reproducible.
//!
//! Generators are arguments; reproducible data uses ChaCha8, whose output is the same on every machine.

use rand::{Rng, RngExt};

/// Two independent standard normal numbers (Box and Muller 1958) from two uniform ones.
///
/// ```
/// use lenslet_core::random::standard_normal_pair;
/// use rand::SeedableRng;
/// let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(1);
/// let squares: f64 = (0..1000).flat_map(|_| standard_normal_pair(&mut rng)).map(|v| v * v).sum();
/// assert!((squares / 2000.0 - 1.0).abs() < 0.1);
/// ```
#[inline]
pub fn standard_normal_pair<R: Rng + ?Sized>(rng: &mut R) -> [f64; 2] {
    // 1 − u is above 0, so its logarithm is finite.
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

/// One standard normal number: the first of [`standard_normal_pair`]; the second is discarded.
///
/// ```
/// use lenslet_core::random::{standard_normal, standard_normal_pair};
/// use rand::SeedableRng;
/// let rng = || rand::rngs::ChaCha8Rng::seed_from_u64(7);
/// assert_eq!(standard_normal(&mut rng()), standard_normal_pair(&mut rng())[0]);
/// ```
#[inline]
pub fn standard_normal<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    standard_normal_pair(rng)[0]
}

/// 0..n in random order (Fisher and Yates, from the last place to the second).
///
/// ```
/// use lenslet_core::random::shuffled_indices;
/// use rand::SeedableRng;
/// let mut order = shuffled_indices(10, &mut rand::rngs::ChaCha8Rng::seed_from_u64(3));
/// order.sort_unstable();
/// assert_eq!(order, (0..10).collect::<Vec<_>>());
/// ```
#[must_use]
pub fn shuffled_indices<R: Rng + ?Sized>(n: usize, rng: &mut R) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, rng.random_range(0..=i));
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    /// The same bits as the earlier code of the simulator, the pairs, the trainer and the tests.
    #[test]
    fn streams_equal_those_of_the_earlier_code() {
        let mut rngs: [ChaCha8Rng; 3] = std::array::from_fn(|_| ChaCha8Rng::seed_from_u64(42));
        for _ in 0..20_000 {
            let found = standard_normal(&mut rngs[0]);
            let (u, v) = (1.0 - rngs[1].random::<f64>(), rngs[1].random::<f64>());
            let plain = (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos();
            let (u, v) = (rngs[2].random::<f64>(), rngs[2].random::<f64>());
            let other = (-2.0 * (1.0 - u).ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos();
            assert!(found.is_finite() && found.to_bits() == plain.to_bits() && found.to_bits() == other.to_bits());
        }
    }

    #[test]
    fn pairs_are_normal_and_uncorrelated() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let pairs: Vec<[f64; 2]> = (0..40_000).map(|_| standard_normal_pair(&mut rng)).collect();
        let mean = |f: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(f).sum::<f64>() / pairs.len() as f64;
        assert!(mean(&|p| p[0]).abs() < 0.02 && mean(&|p| p[1]).abs() < 0.02);
        assert!((mean(&|p| p[0] * p[0]) - 1.0).abs() < 0.03 && (mean(&|p| p[1] * p[1]) - 1.0).abs() < 0.03);
        assert!(mean(&|p| p[0] * p[1]).abs() < 0.02);
        assert!((mean(&|p| p[0].powi(4)) - 3.0).abs() < 0.2);
    }

    #[test]
    fn orders_are_permutations_and_differ() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let orders: Vec<Vec<usize>> = (0..20).map(|_| shuffled_indices(30, &mut rng)).collect();
        for order in &orders {
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.iter().copied().eq(0..30));
        }
        assert!(orders.windows(2).all(|w| w[0] != w[1]));
        assert!(shuffled_indices(0, &mut rng).is_empty());
    }
}
