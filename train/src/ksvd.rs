//! Approximate K-SVD (Aharon 2006; Rubinstein, Zibulevsky and Elad 2008): min ‖X − AD‖² with at most T non-zeros a row of A.
//!
//! Codes by Batch-OMP, then each atom with its coefficients by one alternation on the residual of the signals that use it.

use lenslet_core::sparse::{self, Codes, Penalty, Solver};
use ndarray::{Array2, ArrayView2};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use super::online::Summary;
use super::{Error, atoms};

/// Codes all signals with at most `nonzeros` atoms, updates every atom, replaces the weak ones. The summary's objective is
/// the mean squared error a signal, ½‖x − Dᵀα‖², after the update; without replacements it never rises between epochs by
/// more than OMP's own inconsistency.
///
/// # Errors
/// What the solver reports.
pub fn epoch(
    dictionary: &mut Array2<f32>,
    signals: ArrayView2<'_, f32>,
    nonzeros: usize,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Summary, Error> {
    let n = signals.nrows();
    let prepared = sparse::prepare(dictionary.view())?;
    let options =
        sparse::Options { solver: Solver::Omp, penalty: Penalty::NonZeros(nonzeros), ..sparse::Options::default() };
    let mut codes = sparse::solve(&prepared, signals, &options)?;
    step(n)?;
    let mut rest = residual(dictionary, signals, &codes);
    let uses = update(dictionary, &mut rest, &mut codes);
    let errors: Vec<f64> = rest.rows().into_iter().map(|r| f64::from(r.dot(&r))).collect();
    let mut summary = Summary {
        objective: 0.5 * errors.iter().sum::<f64>() / n.max(1) as f64,
        nonzeros: codes.nonzeros() as f64 / n.max(1) as f64,
        replaced: 0,
    };
    // The worst explained signals make the best new atoms; chance decides among them.
    let weak = atoms::weak(dictionary, &uses, 1);
    if !weak.is_empty() {
        let mut worst: Vec<usize> = (0..n).collect();
        worst.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
        worst.truncate((4 * weak.len()).max(16).min(n));
        for &k in &weak {
            let pick = worst.swap_remove(rng.random_range(0..worst.len()));
            if atoms::replace(dictionary, k, signals.row(pick)) {
                summary.replaced += 1;
            }
            if worst.is_empty() {
                break;
            }
        }
    }
    Ok(summary)
}

fn residual(dictionary: &Array2<f32>, signals: ArrayView2<'_, f32>, codes: &Codes) -> Array2<f32> {
    let mut rest = signals.as_standard_layout().into_owned();
    rest.outer_iter_mut().into_par_iter().enumerate().for_each(|(n, mut row)| {
        for (k, v) in codes.signal(n) {
            row.scaled_add(-v, &dictionary.row(k));
        }
    });
    rest
}

/// Each atom in turn: d ← E·g/‖E·g‖, g ← Eᵀd, where E is the residual of its users without it. Returns the uses.
fn update(dictionary: &mut Array2<f32>, rest: &mut Array2<f32>, codes: &mut Codes) -> Vec<u64> {
    let (k, m) = dictionary.dim();
    let mut users: Vec<Vec<(u32, u32)>> = vec![Vec::new(); k];
    for n in 0..codes.len() {
        for entry in codes.indptr[n]..codes.indptr[n + 1] {
            users[codes.atoms[entry] as usize].push((n as u32, entry as u32));
        }
    }
    let uses = users.iter().map(|u| u.len() as u64).collect();
    let Some(rest) = rest.as_slice_mut() else { return uses };
    for (mut atom, list) in dictionary.rows_mut().into_iter().zip(&users) {
        if list.is_empty() {
            continue;
        }
        let old = atom.to_vec();
        let mut new = vec![0f64; m];
        let mut square = 0f64;
        for &(n, entry) in list {
            let g = codes.values[entry as usize];
            square += f64::from(g) * f64::from(g);
            let row = &rest[n as usize * m..(n as usize + 1) * m];
            new.iter_mut().zip(row).for_each(|(o, r)| *o += f64::from(g * r));
        }
        new.iter_mut().zip(&old).for_each(|(o, d)| *o += square * f64::from(*d));
        let norm = new.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(norm > 1e-12 && norm.is_finite()) {
            continue;
        }
        let new: Vec<f32> = new.iter().map(|v| (v / norm) as f32).collect();
        let overlap: f32 = old.iter().zip(&new).map(|(a, b)| a * b).sum();
        for &(n, entry) in list {
            let row = &mut rest[n as usize * m..(n as usize + 1) * m];
            let g = codes.values[entry as usize];
            let h = row.iter().zip(&new).map(|(r, d)| r * d).sum::<f32>() + g * overlap;
            for ((r, o), d) in row.iter_mut().zip(&old).zip(&new) {
                *r += g * o - h * d;
            }
            codes.values[entry as usize] = h;
        }
        atom.iter_mut().zip(&new).for_each(|(a, v)| *a = *v);
    }
    uses
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::online::tests::{found, planted};
    use rand::SeedableRng;

    #[test]
    fn planted_atoms_are_recovered() {
        let (signals, truth) = planted(4000, 24, 16, 2, 5);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut dictionary = atoms::initial(&signals, 24, &mut rng).unwrap();
        let mut errors = Vec::new();
        for _ in 0..25 {
            errors.push(epoch(&mut dictionary, signals.view(), 2, &mut rng, &mut |_| Ok(())).unwrap().objective);
        }
        assert!(errors[24] < 0.2 * errors[0], "{errors:?}");
        let part = found(&dictionary, &truth);
        assert!(part >= 0.85, "{part}");
    }

    #[test]
    fn the_kept_residual_is_the_true_one_and_shrinks() {
        let (signals, _) = planted(500, 12, 10, 3, 9);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut dictionary = atoms::initial(&signals, 12, &mut rng).unwrap();
        let prepared = sparse::prepare(dictionary.view()).unwrap();
        let options =
            sparse::Options { solver: Solver::Omp, penalty: Penalty::NonZeros(3), ..sparse::Options::default() };
        let mut codes = sparse::solve(&prepared, signals.view(), &options).unwrap();
        let mut rest = residual(&dictionary, signals.view(), &codes);
        let before = rest.iter().map(|v| v * v).sum::<f32>();
        update(&mut dictionary, &mut rest, &mut codes);
        let after = rest.iter().map(|v| v * v).sum::<f32>();
        assert!(after <= before);
        let plain = residual(&dictionary, signals.view(), &codes);
        assert!((&plain - &rest).iter().all(|d| d.abs() < 1e-4));
    }
}
