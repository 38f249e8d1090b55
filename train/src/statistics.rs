//! Statistics of coded signals, A = Σ ααᵀ (K×K) and B = Σ αxᵀ (K×m), and the update of the atoms on them:
//! min over D of ½ tr(DDᵀA) − tr(DᵀB), one atom at a time (Mairal 2009, algorithm 2).

use lenslet_core::linalg::{Par, product};
use lenslet_core::sparse::Codes;
use ndarray::{Array2, ArrayView2, s};
use rayon::prelude::*;

use crate::atoms::normalise_atoms;

/// Atoms whose rows of A·D are found in one product; within the block they are corrected one by one.
/// Source: chosen; speed only.
const BLOCK: usize = 32;
/// Smallest Σ α² with which an atom moves.
/// Source: chosen; such an atom is as good as unused.
const LEAST: f64 = 1e-9;

/// Multiplies A and B by `fade`, adds Σ ααᵀ and Σ αxᵀ over the coded signals, and counts the uses of each atom.
///
/// Every row of A and B belongs to one atom and is summed in the order of the signals, by whichever thread.
pub fn accumulate_statistics(
    codes: &Codes,
    signals: ArrayView2<'_, f32>,
    fade: f64,
    a: &mut Array2<f64>,
    b: &mut Array2<f64>,
    uses: &mut [u64],
) {
    let (k, m) = b.dim();
    let signals = signals.as_standard_layout();
    let (Some(flat), Some(a), Some(b)) = (signals.as_slice(), a.as_slice_mut(), b.as_slice_mut()) else { return };
    let users = users_of_atoms(codes, k);
    let rows = a.par_chunks_mut(k).zip(b.par_chunks_mut(m)).zip(uses.par_iter_mut()).enumerate();
    rows.with_min_len(16).for_each_init(
        || (vec![0f32; k], vec![0f32; m]),
        |(pa, pb), (atom, ((a, b), uses))| {
            let list = users.of(atom);
            *uses += list.len() as u64;
            pa.fill(0.0);
            pb.fill(0.0);
            for &(n, u) in list {
                let n = n as usize;
                let range = codes.indptr[n]..codes.indptr[n + 1];
                for (&j, &v) in codes.atoms[range.clone()].iter().zip(&codes.values[range]) {
                    pa[j as usize] += u * v;
                }
                for (o, &x) in pb.iter_mut().zip(&flat[n * m..(n + 1) * m]) {
                    *o += u * x;
                }
            }
            a.iter_mut().zip(pa.iter()).for_each(|(t, p)| *t = *t * fade + f64::from(*p));
            b.iter_mut().zip(pb.iter()).for_each(|(t, p)| *t = *t * fade + f64::from(*p));
        },
    );
}

/// The transpose of codes: for each atom the signals that use it, with their coefficients.
struct Users {
    starts: Vec<usize>,
    entries: Vec<(u32, f32)>,
}

impl Users {
    /// Signals, ascending, with their coefficient of `atom`.
    fn of(&self, atom: usize) -> &[(u32, f32)] {
        &self.entries[self.starts[atom]..self.starts[atom + 1]]
    }
}

/// The users of each of `k` atoms.
fn users_of_atoms(codes: &Codes, k: usize) -> Users {
    let mut starts = vec![0usize; k + 1];
    for &atom in &codes.atoms {
        starts[atom as usize + 1] += 1;
    }
    for i in 0..k {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut entries = vec![(0u32, 0f32); codes.atoms.len()];
    for n in 0..codes.len() {
        for (atom, v) in codes.signal(n) {
            entries[next[atom]] = (n as u32, v);
            next[atom] += 1;
        }
    }
    Users { starts, entries }
}

/// One sweep of block coordinate descent on the atoms: each goes to its minimum within the unit ball, the others fixed.
/// Atoms without use stay. At the end all are made unit, which can only lower the objective once codes follow.
pub fn update_atoms(atoms: &mut Array2<f32>, a: &Array2<f64>, b: &Array2<f64>) {
    let (k, m) = atoms.dim();
    let a32 = a.mapv(|v| v as f32);
    let mut step = vec![0f32; m];
    for first in (0..k).step_by(BLOCK) {
        let last = (first + BLOCK).min(k);
        // The rows of A·D of this block, with the atoms as they are now.
        let mut pull = product(a32.slice(s![first..last, ..]), atoms.view(), Par::Seq);
        for j in first..last {
            let weight = a[[j, j]];
            if !(weight > LEAST) {
                continue;
            }
            let inverse = (1.0 / weight) as f32;
            let mut square = 0f32;
            for (((u, p), b), d) in step.iter_mut().zip(pull.row(j - first)).zip(b.row(j)).zip(atoms.row(j)) {
                *u = (*b as f32 - p) * inverse + d;
                square += *u * *u;
            }
            let norm = square.sqrt();
            if !(norm > 1e-12 && norm.is_finite()) {
                continue;
            }
            let scale = 1.0 / norm.max(1.0);
            for (u, d) in step.iter_mut().zip(atoms.row_mut(j)) {
                let new = *u * scale;
                *u = new - *d;
                *d = new;
            }
            for other in j + 1..last {
                let g = a32[[other, j]];
                pull.row_mut(other - first).iter_mut().zip(&step).for_each(|(p, u)| *p += g * u);
            }
        }
    }
    normalise_atoms(atoms);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::planted_signals;
    use lenslet_core::sparse::Solver;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    /// Coded signals and their statistics by the definition.
    fn coded() -> (Array2<f32>, Array2<f32>, Codes, Array2<f64>, Array2<f64>) {
        let (signals, _) = planted_signals(700, 90, 12, 3, 4);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let dictionary = crate::atoms::initial_atoms(&signals, 90, &mut rng).unwrap();
        let (codes, _) = crate::online::sparse_code(&dictionary, signals.view(), 0.1, Solver::Auto).unwrap();
        let dense = codes.to_dense(90).unwrap();
        let a = dense.t().dot(&dense).mapv(f64::from);
        let b = dense.t().dot(&signals).mapv(f64::from);
        (signals, dictionary, codes, a, b)
    }

    #[test]
    fn statistics_are_those_of_the_definition() {
        let (signals, _, codes, a, b) = coded();
        let (mut sa, mut sb) = (Array2::from_elem((90, 90), 2.0), Array2::from_elem((90, 12), 4.0));
        let mut uses = vec![1u64; 90];
        assert!(codes.nonzeros() > 2 * 700, "{}", codes.nonzeros());
        accumulate_statistics(&codes, signals.view(), 0.5, &mut sa, &mut sb, &mut uses);
        assert!((&sa - &(&a + 1.0)).iter().all(|d| d.abs() < 1e-3));
        assert!((&sb - &(&b + 2.0)).iter().all(|d| d.abs() < 1e-3));
        assert_eq!(uses.iter().sum::<u64>(), 90 + codes.nonzeros() as u64);
    }

    #[test]
    fn the_sweep_in_blocks_is_the_sweep_one_by_one() {
        let (_, dictionary, _, a, b) = coded();
        let mut plain = dictionary.mapv(f64::from);
        for j in 0..90 {
            if a[[j, j]] <= LEAST {
                continue;
            }
            let pull = plain.t().dot(&a.row(j));
            let u = (&b.row(j) - pull) / a[[j, j]] + plain.row(j);
            let norm = u.dot(&u).sqrt().max(1.0);
            plain.row_mut(j).assign(&(u / norm));
        }
        for mut row in plain.rows_mut() {
            let norm = row.dot(&row).sqrt();
            row /= norm;
        }
        let mut blocked = dictionary.clone();
        update_atoms(&mut blocked, &a, &b);
        assert!((&blocked.mapv(f64::from) - &plain).iter().all(|d| d.abs() < 1e-3));
        let moved = (&blocked - &dictionary).iter().fold(0.0f32, |m, d| m.max(d.abs()));
        assert!(moved > 0.05, "{moved}");
    }
}
