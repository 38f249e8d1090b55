//! Random orders.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// 0..n in random order (Fisher and Yates).
#[must_use]
pub fn shuffled_indices(n: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, rng.random_range(0..=i));
    }
    order
}
