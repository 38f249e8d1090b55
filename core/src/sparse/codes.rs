//! Sparse codes of many signals in compressed rows, and what is done with them.

use super::{Ended, Error, Prepared};
use ndarray::{Array2, ArrayView2, Axis};
use rayon::prelude::*;

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
    /// λ of each signal as it stands in the objective (0 for OMP).
    pub lambdas: Vec<f32>,
    /// Iterations of each signal.
    pub iterations: Vec<u32>,
    /// How each ended.
    pub ended: Vec<Ended>,
    /// Signals the f32 active set left to the f64 one (ill-conditioned supports, tight tolerances).
    pub redone_in_f64: usize,
}

impl Codes {
    /// None yet, with room for so many signals with so many entries together.
    pub(super) fn with_room(signals: usize, entries: usize) -> Codes {
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

    /// Mean number of non-zeros a signal (0 without signals).
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

    /// N×p: each signal's code times `other` (K×p) — with the dictionary itself the approximations, with the
    /// high-resolution twin of a coupled dictionary the reconstructed patches.
    ///
    /// # Errors
    /// A code that names an atom `other` does not have.
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

    /// ½‖y − Dᵀφ‖² + λ‖φ‖₁ of every signal, in f64, with the λ of each.
    ///
    /// # Errors
    /// Signals (N×m) or codes that do not fit the dictionary.
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
    /// A code that names an atom at or beyond `atom_count`, or a matrix beyond 2³¹ values.
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
