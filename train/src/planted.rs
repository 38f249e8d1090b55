//! Signals of planted atoms, for tests.

use ndarray::Array2;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::atoms::normalise_atoms;

/// Signals of `nonzeros` planted atoms each, and the atoms.
pub(crate) fn planted_signals(n: usize, k: usize, m: usize, nonzeros: usize, seed: u64) -> (Array2<f32>, Array2<f32>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut truth = Array2::from_shape_fn((k, m), |_| rng.random::<f32>() - 0.5);
    normalise_atoms(&mut truth);
    let mut signals = Array2::zeros((n, m));
    for mut row in signals.rows_mut() {
        for _ in 0..nonzeros {
            let v = (0.5 + rng.random::<f32>()) * if rng.random::<bool>() { 1.0 } else { -1.0 };
            row.scaled_add(v, &truth.row(rng.random_range(0..k)));
        }
    }
    (signals, truth)
}

/// The part of the planted atoms that were found, |cosine| above 0.95.
pub(crate) fn found_share(atoms: &Array2<f32>, truth: &Array2<f32>) -> f64 {
    let products = truth.dot(&atoms.t());
    let hits = products.rows().into_iter().filter(|r| r.iter().any(|v| v.abs() > 0.95)).count();
    hits as f64 / truth.nrows() as f64
}
