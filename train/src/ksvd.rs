//! K-SVD (Aharon, Elad and Bruckstein 2006): min over D, A of ‖X − AD‖² with unit atoms, the rows of D, and at most T
//! non-zeros in a row of A.
//!
//! Codes by Batch-OMP (Rubinstein, Zibulevsky and Elad 2008), then each atom with its coefficients, the others fixed.
//! With E the residual of the signals that use atom d (rows) without its part, and g its coefficients, both go to the
//! rank-one matrix g·dᵀ nearest to E: exactly by the leading singular pair of E, approximately by one alternation
//! d ← Eᵀg/‖Eᵀg‖, g ← E·d, which is one power iteration towards it (Rubinstein 2008, section 3).

use lenslet_core::linalg::thin_svd;
use lenslet_core::sparse::{self, Codes, Penalty, Solver};
use ndarray::{Array2, ArrayView2};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use crate::atoms::{atoms_to_replace, replace_atom};
use crate::error::Error;
use crate::parameters::KsvdUpdate;
use crate::trace::EpochSummary;

/// Candidates for each replaced atom: this many signals with the largest residuals, of which one is drawn at random.
/// Source: chosen.
const CANDIDATES: usize = 4;

/// Candidates at least, for all replaced atoms together.
/// Source: chosen.
const LEAST_CANDIDATES: usize = 16;

/// Codes all signals (N×m) with at most `nonzeros` atoms of `dictionary` (K×m, unit rows), updates every atom, replaces
/// those that are unused or coherent. The summary's objective is ½‖x − Dᵀα‖², mean over the signals, after the update;
/// without replacements it never rises between epochs by more than OMP's own inconsistency. `step` is called once.
///
/// # Errors
/// Errors of the solver, errors of `step`.
///
/// ```
/// use lenslet_train::{KsvdUpdate, ksvd::ksvd_epoch};
/// use ndarray::{Array2, array};
/// use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// // Multiples of the two axes; the first atoms lie between them.
/// let signals = Array2::from_shape_fn((200, 2), |(n, j)| if n % 2 == j { 0.5 + rng.random::<f32>() } else { 0.0 });
/// for update in [KsvdUpdate::Approximate, KsvdUpdate::Exact] {
///     let mut atoms = array![[0.8f32, 0.6], [0.6, 0.8]];
///     let epoch = ksvd_epoch(&mut atoms, signals.view(), 1, update, &mut rng, &mut |_| Ok(()))?;
///     assert!(atoms[[0, 0]].abs() > 0.999 && atoms[[1, 1]].abs() > 0.999 && epoch.objective < 1e-5);
/// }
/// # Ok::<(), lenslet_train::Error>(())
/// ```
pub fn ksvd_epoch(
    dictionary: &mut Array2<f32>,
    signals: ArrayView2<'_, f32>,
    nonzeros: usize,
    update: KsvdUpdate,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<EpochSummary, Error> {
    let n = signals.nrows();
    let prepared = sparse::prepare(dictionary.view())?;
    let options =
        sparse::Options { solver: Solver::Omp, penalty: Penalty::NonZeros(nonzeros), ..sparse::Options::default() };
    let mut codes = sparse::solve(&prepared, signals, &options)?;
    step(n)?;
    let mut residuals = residuals_of(dictionary, signals, &codes);
    let uses = update_atoms(dictionary, &mut residuals, &mut codes, update)?;
    let errors: Vec<f64> = residuals.rows().into_iter().map(|r| f64::from(r.dot(&r))).collect();
    let mut summary = EpochSummary {
        objective: 0.5 * errors.iter().sum::<f64>() / n.max(1) as f64,
        nonzeros: codes.nonzeros() as f64 / n.max(1) as f64,
        replaced: 0,
    };
    // The signals with the largest residuals make the best new atoms.
    let chosen = atoms_to_replace(dictionary, &uses, 1);
    if !chosen.is_empty() {
        let mut worst: Vec<usize> = (0..n).collect();
        worst.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
        worst.truncate((CANDIDATES * chosen.len()).max(LEAST_CANDIDATES).min(n));
        for &k in &chosen {
            let pick = worst.swap_remove(rng.random_range(0..worst.len()));
            if replace_atom(dictionary, k, signals.row(pick)) {
                summary.replaced += 1;
            }
            if worst.is_empty() {
                break;
            }
        }
    }
    Ok(summary)
}

/// x − Dᵀα of every signal, one a row.
fn residuals_of(dictionary: &Array2<f32>, signals: ArrayView2<'_, f32>, codes: &Codes) -> Array2<f32> {
    let mut residuals = signals.as_standard_layout().into_owned();
    residuals.outer_iter_mut().into_par_iter().enumerate().for_each(|(n, mut row)| {
        for (k, v) in codes.signal(n) {
            row.scaled_add(-v, &dictionary.row(k));
        }
    });
    residuals
}

/// Updates each atom in turn, with its coefficients and the residuals. Returns how many signals use each atom.
fn update_atoms(
    dictionary: &mut Array2<f32>,
    residuals: &mut Array2<f32>,
    codes: &mut Codes,
    update: KsvdUpdate,
) -> Result<Vec<u64>, Error> {
    let (k, m) = dictionary.dim();
    let mut users: Vec<Vec<(u32, u32)>> = vec![Vec::new(); k];
    for n in 0..codes.len() {
        for entry in codes.indptr[n]..codes.indptr[n + 1] {
            users[codes.atoms[entry] as usize].push((n as u32, entry as u32));
        }
    }
    let uses = users.iter().map(|u| u.len() as u64).collect();
    let Some(residuals) = residuals.as_slice_mut() else { return Ok(uses) };
    for (mut atom, users) in dictionary.rows_mut().into_iter().zip(&users) {
        if users.is_empty() {
            continue;
        }
        let mut occurrence = Occurrence { atom: atom.to_vec(), users, residuals: &mut *residuals, codes: &mut *codes };
        let new = match update {
            KsvdUpdate::Approximate => occurrence.alternated_atom(),
            KsvdUpdate::Exact => occurrence.singular_atom(m)?,
        };
        if let Some(new) = new {
            occurrence.assign(&new);
            atom.iter_mut().zip(&new).for_each(|(a, v)| *a = *v);
        }
    }
    Ok(uses)
}

/// An atom where it occurs: the signals that use it, each with the index of its coefficient, and their residuals.
struct Occurrence<'a> {
    atom: Vec<f32>,
    users: &'a [(u32, u32)],
    residuals: &'a mut [f32],
    codes: &'a mut Codes,
}

impl Occurrence<'_> {
    /// Eᵀg/‖Eᵀg‖; `None` when that is zero.
    fn alternated_atom(&self) -> Option<Vec<f32>> {
        let m = self.atom.len();
        let mut new = vec![0f64; m];
        let mut square = 0f64;
        for &(n, entry) in self.users {
            let g = self.codes.values[entry as usize];
            square += f64::from(g) * f64::from(g);
            let row = &self.residuals[n as usize * m..(n as usize + 1) * m];
            new.iter_mut().zip(row).for_each(|(o, r)| *o += f64::from(g * r));
        }
        new.iter_mut().zip(&self.atom).for_each(|(o, d)| *o += square * f64::from(*d));
        let norm = new.iter().map(|v| v * v).sum::<f64>().sqrt();
        (norm > 1e-12 && norm.is_finite()).then(|| new.iter().map(|v| (v / norm) as f32).collect())
    }

    /// The right singular vector of E of the largest singular value, on the side of the old atom; `None` when E is
    /// zero.
    fn singular_atom(&self, m: usize) -> Result<Option<Vec<f32>>, Error> {
        let e = Array2::from_shape_fn((self.users.len(), m), |(i, j)| {
            let (n, entry) = self.users[i];
            f64::from(self.residuals[n as usize * m + j] + self.codes.values[entry as usize] * self.atom[j])
        });
        let svd = thin_svd(e.view())?;
        if !(svd.s[0] > 1e-12) {
            return Ok(None);
        }
        let direction = svd.v.column(0);
        let along: f64 = direction.iter().zip(&self.atom).map(|(v, d)| v * f64::from(*d)).sum();
        let sign = if along < 0.0 { -1.0 } else { 1.0 };
        Ok(Some(direction.iter().map(|v| (sign * v) as f32).collect()))
    }

    /// Puts a new atom in place: its coefficients g = E·d, and the residuals that are left.
    fn assign(&mut self, new: &[f32]) {
        let m = self.atom.len();
        let overlap: f32 = self.atom.iter().zip(new).map(|(a, b)| a * b).sum();
        for &(n, entry) in self.users {
            let row = &mut self.residuals[n as usize * m..(n as usize + 1) * m];
            let g = self.codes.values[entry as usize];
            let h = row.iter().zip(new).map(|(r, d)| r * d).sum::<f32>() + g * overlap;
            for ((r, o), d) in row.iter_mut().zip(&self.atom).zip(new) {
                *r += g * o - h * d;
            }
            self.codes.values[entry as usize] = h;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atoms::{initial_atoms, normalise_atoms};
    use crate::planted::{found_share, planted_signals};
    use rand::SeedableRng;

    const BOTH: [KsvdUpdate; 2] = [KsvdUpdate::Approximate, KsvdUpdate::Exact];

    fn omp(dictionary: &Array2<f32>, signals: &Array2<f32>, nonzeros: usize) -> Codes {
        let prepared = sparse::prepare(dictionary.view()).unwrap();
        let options =
            sparse::Options { solver: Solver::Omp, penalty: Penalty::NonZeros(nonzeros), ..sparse::Options::default() };
        sparse::solve(&prepared, signals.view(), &options).unwrap()
    }

    fn energy(a: &Array2<f32>) -> f64 {
        a.iter().map(|v| f64::from(*v).powi(2)).sum()
    }

    #[test]
    fn planted_atoms_are_recovered() {
        let (signals, truth) = planted_signals(4000, 24, 16, 2, 5);
        for update in BOTH {
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let mut dictionary = initial_atoms(&signals, 24, &mut rng).unwrap();
            let mut errors = Vec::new();
            for _ in 0..25 {
                let epoch = ksvd_epoch(&mut dictionary, signals.view(), 2, update, &mut rng, &mut |_| Ok(())).unwrap();
                errors.push(epoch.objective);
            }
            assert!(errors[24] < 0.2 * errors[0], "{update:?}: {errors:?}");
            let part = found_share(&dictionary, &truth);
            assert!(part >= 0.85, "{update:?}: {part}");
        }
    }

    #[test]
    fn the_kept_residual_is_the_true_one_and_shrinks() {
        let (signals, _) = planted_signals(500, 12, 10, 3, 9);
        for update in BOTH {
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let mut dictionary = initial_atoms(&signals, 12, &mut rng).unwrap();
            let mut codes = omp(&dictionary, &signals, 3);
            let mut residuals = residuals_of(&dictionary, signals.view(), &codes);
            let before = energy(&residuals);
            update_atoms(&mut dictionary, &mut residuals, &mut codes, update).unwrap();
            assert!(energy(&residuals) <= before);
            let plain = residuals_of(&dictionary, signals.view(), &codes);
            assert!((&plain - &residuals).iter().all(|d| d.abs() < 1e-4));
        }
    }

    #[test]
    fn no_exact_update_of_an_atom_raises_the_objective_and_none_is_better() {
        let (signals, _) = planted_signals(400, 12, 10, 3, 9);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut dictionary = initial_atoms(&signals, 12, &mut rng).unwrap();
        let mut codes = omp(&dictionary, &signals, 3);
        let mut residuals = residuals_of(&dictionary, signals.view(), &codes);
        for _ in 0..6 {
            let before = energy(&residuals);
            update_atoms(&mut dictionary, &mut residuals, &mut codes, KsvdUpdate::Exact).unwrap();
            let after = energy(&residuals);
            assert!(after <= before * (1.0 + 1e-6), "{after} after {before}");
        }
        let first = |update| {
            let start = initial_atoms(&signals, 12, &mut ChaCha8Rng::seed_from_u64(3)).unwrap();
            let mut codes = omp(&start, &signals, 3);
            let mut residuals = residuals_of(&start, signals.view(), &codes);
            // Only the first atom is updated.
            let mut one = start.clone();
            let users: Vec<(u32, u32)> = (0..codes.len())
                .flat_map(|n| (codes.indptr[n]..codes.indptr[n + 1]).map(move |entry| (n as u32, entry as u32)))
                .filter(|&(_, entry)| codes.atoms[entry as usize] == 0)
                .collect();
            let atom = one.row(0).to_vec();
            let mut occurrence =
                Occurrence { atom, users: &users, residuals: residuals.as_slice_mut().unwrap(), codes: &mut codes };
            let new = match update {
                KsvdUpdate::Approximate => occurrence.alternated_atom(),
                KsvdUpdate::Exact => occurrence.singular_atom(10).unwrap(),
            };
            let new = new.unwrap();
            occurrence.assign(&new);
            one.row_mut(0).assign(&ndarray::Array1::from(new));
            energy(&residuals_of(&one, signals.view(), &codes))
        };
        assert!(first(KsvdUpdate::Exact) <= first(KsvdUpdate::Approximate) * (1.0 + 1e-6));
    }

    #[test]
    fn both_updates_end_in_the_same_fixed_point() {
        // Supports are those of the planted atoms and stay; both ways start from the atoms with some noise.
        let (signals, truth) = planted_signals(1200, 12, 32, 2, 9);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut start = truth.mapv(|v| v + 0.1 * (rng.random::<f32>() - 0.5));
        normalise_atoms(&mut start);
        let ends = BOTH.map(|update| {
            let mut dictionary = start.clone();
            let mut codes = omp(&truth, &signals, 2);
            let mut residuals = residuals_of(&dictionary, signals.view(), &codes);
            for _ in 0..80 {
                update_atoms(&mut dictionary, &mut residuals, &mut codes, update).unwrap();
            }
            assert!(energy(&residuals) < 1e-5 * energy(&signals), "{update:?}");
            dictionary
        });
        assert!((&ends[0] - &ends[1]).iter().all(|d| d.abs() < 1e-3));
    }
}
