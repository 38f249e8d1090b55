//! Atoms: the first ones, and the replacement of dead, duplicate and coherent ones.

use lenslet_core::linalg::{Par, gram};
use ndarray::{Array2, ArrayView1, Axis};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use crate::error::Error;

/// |cosine| above which two atoms count as one.
/// Source: Aharon, Elad and Bruckstein 2006, whose software replaces atoms from 0.99 on.
const COHERENT: f32 = 0.99;

/// `count` signals chosen at random, made unit; those nearly parallel to an earlier one are passed over as long as
/// there is a choice.
///
/// # Errors
/// [`Error::TooLittle`] when there are fewer signals than atoms.
pub fn initial_atoms(signals: &Array2<f32>, count: usize, rng: &mut ChaCha8Rng) -> Result<Array2<f32>, Error> {
    let n = signals.nrows();
    if n < count {
        return Err(Error::TooLittle(format!(
            "{n} training pairs are too few for {count} atoms: give more or larger photos, or fewer --atoms"
        )));
    }
    let mut atoms = Array2::<f32>::zeros((count, signals.ncols()));
    let (mut filled, mut tries) = (0, 0);
    while filled < count {
        let row = signals.row(rng.random_range(0..n));
        tries += 1;
        let norm = row.dot(&row).sqrt();
        if !(norm > 1e-6) {
            if tries > 100 * count {
                return Err(Error::TooLittle("the training pairs are all flat".into()));
            }
            continue;
        }
        let unit = row.mapv(|v| v / norm);
        let twin = tries < 20 * count && atoms.rows().into_iter().take(filled).any(|a| a.dot(&unit).abs() > COHERENT);
        if !twin {
            atoms.row_mut(filled).assign(&unit);
            filled += 1;
        }
    }
    Ok(atoms)
}

/// Makes rows unit; a row of zeros becomes the first axis.
pub fn normalise_atoms(atoms: &mut Array2<f32>) {
    for mut row in atoms.rows_mut() {
        let norm = row.dot(&row).sqrt();
        if norm > 1e-12 && norm.is_finite() {
            row /= norm;
        } else {
            row.fill(0.0);
            row[0] = 1.0;
        }
    }
}

/// Atoms to replace: those used less than `least` times, and of each coherent couple the less used.
#[must_use]
pub fn atoms_to_replace(atoms: &Array2<f32>, uses: &[u64], least: u64) -> Vec<usize> {
    let gram = gram(atoms.t(), Par::Seq);
    let mut marked = vec![false; atoms.nrows()];
    for (k, &n) in uses.iter().enumerate() {
        marked[k] = n < least;
    }
    for i in 0..marked.len() {
        for j in 0..i {
            if !marked[i] && !marked[j] && gram[[i, j]].abs() > COHERENT {
                marked[if uses[i] < uses[j] { i } else { j }] = true;
            }
        }
    }
    (0..marked.len()).filter(|&k| marked[k]).collect()
}

/// Puts a signal, made unit, in place of atom `k`; false when the signal is zero.
pub fn replace_atom(atoms: &mut Array2<f32>, k: usize, signal: ArrayView1<'_, f32>) -> bool {
    let norm = signal.dot(&signal).sqrt();
    if !(norm > 1e-6) {
        return false;
    }
    atoms.index_axis_mut(Axis(0), k).assign(&signal.mapv(|v| v / norm));
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn first_atoms_are_unit_and_apart() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut signals = Array2::from_shape_fn((300, 5), |_| rng.random::<f32>() - 0.5);
        for i in 0..100 {
            let row = signals.row(0).to_owned();
            signals.row_mut(i).assign(&row);
        }
        let atoms = initial_atoms(&signals, 20, &mut rng).unwrap();
        let gram = atoms.dot(&atoms.t());
        for i in 0..20 {
            assert!((gram[[i, i]] - 1.0).abs() < 1e-5);
            assert!((0..i).all(|j| gram[[i, j]].abs() <= COHERENT));
        }
        assert!(initial_atoms(&signals, 301, &mut rng).is_err());
        assert!(initial_atoms(&Array2::zeros((9, 5)), 3, &mut rng).is_err());
    }

    #[test]
    fn dead_and_double_atoms_are_named() {
        let atoms = ndarray::array![[1.0f32, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.6, 0.8]];
        assert_eq!(atoms_to_replace(&atoms, &[5, 9, 6, 0], 1), [0, 3]);
        assert!(atoms_to_replace(&atoms, &[5, 9, 4, 3], 1) == [2]);
    }
}
