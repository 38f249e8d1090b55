//! Sparse codes of many signals in compressed rows, and what is done with them.

use ndarray::{Array2, ArrayView2, Axis};
use rayon::prelude::*;

use super::error::Error;
use super::prepared::Prepared;
use super::problem::{Ended, Finished};

/// Sparse codes of N signals in compressed rows: signal n has entries `indptr[n]..indptr[n+1]`.
#[derive(Debug, Clone, Default)]
pub struct Codes {
    /// N+1 offsets.
    pub indptr: Vec<usize>,
    /// Atom of each entry, ascending within a signal.
    pub atoms: Vec<u32>,
    /// Value of each entry.
    pub values: Vec<f32>,
    /// Duality gap of each signal (absolute, in f64); NaN for OMP.
    pub gaps: Vec<f64>,
    /// λ of each signal in the objective (0 for OMP).
    pub lambdas: Vec<f32>,
    /// Iterations of each signal.
    pub iterations: Vec<u32>,
    /// How the solve of each signal ended.
    pub ended: Vec<Ended>,
    /// Number of signals that f32 left, solved in mixed precision or f64 (ill-conditioned supports, small λ, tight
    /// tolerances).
    pub redone_in_f64: usize,
}

impl Codes {
    /// No signals yet; capacity for `signals` signals with `entries` entries in total.
    pub(crate) fn with_room(signals: usize, entries: usize) -> Codes {
        let mut indptr = Vec::with_capacity(signals + 1);
        indptr.push(0);
        Codes {
            indptr,
            atoms: Vec::with_capacity(entries),
            values: Vec::with_capacity(entries),
            gaps: Vec::with_capacity(signals),
            lambdas: Vec::with_capacity(signals),
            iterations: Vec::with_capacity(signals),
            ended: Vec::with_capacity(signals),
            redone_in_f64: 0,
        }
    }

    /// Appends one signal's code, `entries` in any order, atoms by their internal number; zeros are left out.
    pub(crate) fn push_unsorted(&mut self, dictionary: &Prepared, entries: &mut [(u32, f32)], finished: &Finished) {
        for entry in entries.iter_mut() {
            entry.0 = dictionary.outside(entry.0);
        }
        entries.sort_unstable_by_key(|e| e.0);
        self.push_sorted(entries, finished);
    }

    /// Appends one signal's code, atoms by the caller's numbers, ascending; zeros are left out.
    pub(crate) fn push_sorted(&mut self, entries: &[(u32, f32)], finished: &Finished) {
        if entries.iter().all(|e| e.1 != 0.0) {
            self.atoms.extend(entries.iter().map(|e| e.0));
            self.values.extend(entries.iter().map(|e| e.1));
        } else {
            self.atoms.extend(entries.iter().filter(|e| e.1 != 0.0).map(|e| e.0));
            self.values.extend(entries.iter().filter(|e| e.1 != 0.0).map(|e| e.1));
        }
        self.indptr.push(self.atoms.len());
        self.gaps.push(finished.gap);
        self.lambdas.push(finished.lambda);
        self.iterations.push(finished.iterations);
        self.ended.push(finished.ended);
    }

    /// Blocks of signals one after the other.
    pub(crate) fn concatenate(blocks: &[Codes]) -> Codes {
        let signals = blocks.iter().map(Codes::len).sum();
        let entries = blocks.iter().map(Codes::nonzeros).sum();
        let mut all = Codes::with_room(signals, entries);
        for block in blocks {
            let base = all.atoms.len();
            all.indptr.extend(block.indptr.iter().skip(1).map(|&p| p + base));
            all.atoms.extend_from_slice(&block.atoms);
            all.values.extend_from_slice(&block.values);
            all.gaps.extend_from_slice(&block.gaps);
            all.lambdas.extend_from_slice(&block.lambdas);
            all.iterations.extend_from_slice(&block.iterations);
            all.ended.extend_from_slice(&block.ended);
            all.redone_in_f64 += block.redone_in_f64;
        }
        all
    }

    /// Number of signals.
    pub fn len(&self) -> usize {
        self.indptr.len().saturating_sub(1)
    }

    /// Whether there is no signal.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The entries (atom, value) of signal `n`; empty when there is no such signal.
    pub fn signal(&self, n: usize) -> impl ExactSizeIterator<Item = (usize, f32)> + '_ {
        let range = match (self.indptr.get(n), self.indptr.get(n + 1)) {
            (Some(&from), Some(&to)) => from..to,
            _ => 0..0,
        };
        self.atoms[range.clone()].iter().zip(&self.values[range]).map(|(&k, &v)| (k as usize, v))
    }

    /// Number of non-zeros of all signals together.
    pub fn nonzeros(&self) -> usize {
        self.values.len()
    }

    /// Mean number of non-zeros per signal (0 without signals).
    pub fn mean_nonzeros(&self) -> f64 {
        if self.is_empty() { 0.0 } else { self.nonzeros() as f64 / self.len() as f64 }
    }

    /// The largest duality gap (0 without signals or without gaps, as after OMP).
    pub fn max_gap(&self) -> f64 {
        self.gaps.iter().copied().fold(0.0, f64::max)
    }

    /// Whether every signal ended by reaching the tolerance.
    pub fn all_converged(&self) -> bool {
        self.ended.iter().all(|&e| e == Ended::Converged)
    }

    /// `other`ᵀφ of every signal (N×p, for `other` K×p): with the dictionary itself the approximations Dᵀφ, with the
    /// high-resolution dictionary Dh of a coupled pair the reconstructed patches.
    ///
    /// # Errors
    /// [`Error::Shape`] for a code with an atom that `other` does not have.
    ///
    /// ```
    /// use lenslet_core::sparse::{self, Options, Penalty};
    /// use ndarray::array;
    ///
    /// let low = sparse::prepare(array![[1.0f32, 0.0], [0.0, 1.0]].view())?;
    /// let options = Options { penalty: Penalty::Lambda(0.5), ..Options::default() };
    /// let codes = sparse::solve(&low, array![[2.5, 0.0]].view(), &options)?;
    /// let high = array![[1.0f32, 2.0, 3.0], [0.0, 0.0, 1.0]];
    /// assert_eq!(codes.multiply(high.view())?, array![[2.0, 4.0, 6.0]]);
    /// # Ok::<(), sparse::Error>(())
    /// ```
    pub fn multiply(&self, other: ArrayView2<'_, f32>) -> Result<Array2<f32>, Error> {
        if let Some(&most) = self.atoms.iter().max()
            && most as usize >= other.nrows()
        {
            return Err(Error::Shape(format!("codes use atom {most}, the matrix has {} rows", other.nrows())));
        }
        let other = other.as_standard_layout();
        let p = other.ncols();
        let mut out = Array2::zeros((self.len(), p));
        let rows = other.as_slice().unwrap_or(&[]);
        out.axis_chunks_iter_mut(Axis(0), 256).into_par_iter().enumerate().for_each(|(chunk, mut block)| {
            for (i, mut row) in block.rows_mut().into_iter().enumerate() {
                let Some(row) = row.as_slice_mut() else { continue };
                for (k, v) in self.signal(chunk * 256 + i) {
                    for (o, &d) in row.iter_mut().zip(&rows[k * p..(k + 1) * p]) {
                        *o += v * d;
                    }
                }
            }
        });
        Ok(out)
    }

    /// ½‖y − Dᵀφ‖² + λ‖φ‖₁ of every signal, in f64, with the λ of each (in [`Codes::lambdas`]).
    ///
    /// # Errors
    /// [`Error::Shape`] for signals (N×m) or codes that do not fit the dictionary.
    ///
    /// The gap proves how near the minimum an objective is:
    /// ```
    /// use lenslet_core::sparse::{self, Options, Penalty};
    /// use ndarray::array;
    ///
    /// let dictionary = sparse::prepare(array![[1.0f32, 0.0], [0.6, 0.8]].view())?;
    /// let signals = array![[1.0f32, 1.0]];
    /// let options = Options { penalty: Penalty::Lambda(0.2), ..Options::default() };
    /// let codes = sparse::solve(&dictionary, signals.view(), &options)?;
    /// let objective = codes.objectives(&dictionary, signals.view())?[0];
    /// // The minimum is 0.275, at φ = (0.125, 1.125).
    /// assert!((objective - 0.275).abs() <= codes.gaps[0] + 1e-6 && codes.gaps[0] <= 1e-6);
    /// # Ok::<(), sparse::Error>(())
    /// ```
    pub fn objectives(&self, dictionary: &Prepared, signals: ArrayView2<'_, f32>) -> Result<Vec<f64>, Error> {
        if signals.dim() != (self.len(), dictionary.signal_len()) {
            return Err(Error::Shape(format!(
                "{} codes of {} values for {:?} signals",
                self.len(),
                dictionary.signal_len(),
                signals.dim()
            )));
        }
        if self.atoms.iter().any(|&k| k as usize >= dictionary.atom_count()) {
            return Err(Error::Shape("the codes belong to a larger dictionary".into()));
        }
        Ok((0..self.len())
            .into_par_iter()
            .map_init(Vec::new, |residual: &mut Vec<f64>, n| {
                residual.clear();
                residual.extend(signals.row(n).iter().map(|&v| f64::from(v)));
                let mut norm1 = 0.0;
                for (k, v) in self.signal(n) {
                    norm1 += f64::from(v).abs();
                    for (r, &d) in residual.iter_mut().zip(dictionary.atoms().row(k)) {
                        *r -= f64::from(v) * f64::from(d);
                    }
                }
                0.5 * residual.iter().map(|r| r * r).sum::<f64>() + f64::from(self.lambdas[n]) * norm1
            })
            .collect())
    }

    /// The codes as a dense N×K matrix (for small sets and tests).
    ///
    /// # Errors
    /// [`Error::Shape`] for a code with an atom at or beyond `atom_count`, or a matrix of more than 2³¹ values.
    pub fn to_dense(&self, atom_count: usize) -> Result<Array2<f32>, Error> {
        if self.len().checked_mul(atom_count).is_none_or(|size| size > 1 << 31) {
            return Err(Error::Shape(format!("{} × {atom_count} codes are too many to lay out densely", self.len())));
        }
        if self.atoms.iter().any(|&k| k as usize >= atom_count) {
            return Err(Error::Shape(format!("the codes use atoms beyond {atom_count}")));
        }
        let mut dense = Array2::zeros((self.len(), atom_count));
        for n in 0..self.len() {
            for (k, v) in self.signal(n) {
                dense[[n, k]] = v;
            }
        }
        Ok(dense)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::{Options, Penalty, prepare, solve};

    #[test]
    fn products_and_objectives_are_those_of_the_dense_codes() {
        let eye = Array2::from_shape_fn((20, 20), |(i, j)| f32::from(u8::from(i == j)));
        let dictionary = prepare(eye.view()).unwrap();
        // More signals than a block of the product has.
        let signals = Array2::from_shape_fn((300, 20), |(n, i)| ((n * 31 + i * 17) % 13) as f32 / 3.0 - 2.0);
        let options = Options { penalty: Penalty::Lambda(0.5), ..Options::default() };
        let codes = solve(&dictionary, signals.view(), &options).unwrap();
        let shrunk = signals.mapv(|v| v.signum() * (v.abs() - 0.5).max(0.0));
        let dense = codes.to_dense(20).unwrap();
        assert!(dense.iter().zip(&shrunk).all(|(a, b)| (a - b).abs() < 1e-5));
        assert_eq!((codes.len(), codes.gaps.len(), codes.lambdas.len(), codes.iterations.len()), (300, 300, 300, 300));
        assert_eq!(codes.nonzeros(), dense.iter().filter(|v| **v != 0.0).count());
        assert!((codes.mean_nonzeros() - codes.nonzeros() as f64 / 300.0).abs() < 1e-12);
        let other = Array2::from_shape_fn((20, 3), |(i, j)| (i * 3 + j) as f32 / 10.0);
        let product = codes.multiply(other.view()).unwrap();
        assert!(product.iter().zip(&dense.dot(&other)).all(|(a, b)| (a - b).abs() < 1e-4));
        let objectives = codes.objectives(&dictionary, signals.view()).unwrap();
        for (n, found) in objectives.iter().enumerate() {
            let rest = &signals.row(n) - &dense.row(n);
            let truth = 0.5 * rest.dot(&rest) + 0.5 * dense.row(n).iter().map(|v| v.abs()).sum::<f32>();
            assert!((found - f64::from(truth)).abs() < 1e-4, "{n}: {found} {truth}");
        }
        // What does not fit is refused: fewer signals, other lengths, fewer atoms.
        assert!(codes.objectives(&dictionary, signals.slice(ndarray::s![..299, ..])).is_err());
        assert!(codes.objectives(&dictionary, signals.slice(ndarray::s![.., ..19])).is_err());
        let nineteen = Array2::from_shape_fn((19, 20), |(i, j)| f32::from(u8::from(i == j)));
        assert!(codes.objectives(&prepare(nineteen.view()).unwrap(), signals.view()).is_err());
        assert!(codes.to_dense(19).is_err() && codes.multiply(nineteen.view()).is_err());
    }
}
