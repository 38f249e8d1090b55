//! A dictionary made ready for solving: atoms in rows, the Gram matrix G = D Dᵀ, and a bound on its largest eigenvalue.

use super::Error;
use ndarray::{Array2, ArrayView2};

/// Lanes every row is padded to, so that inner loops have no tail.
pub(super) const LANES: usize = 16;
/// More atoms than this would need over a gibibyte of Gram matrix.
const MOST_ATOMS: usize = 16_384;
/// Longest signal accepted.
const LONGEST_SIGNAL: usize = 1 << 16;

/// A dictionary made ready for solving: atoms, Gram matrix, bounds.
#[derive(Debug, Clone)]
pub struct Prepared {
    atoms: Array2<f32>,
    /// K rows of `stride` values, zero beyond K.
    gram: Vec<f32>,
    stride: usize,
}

impl Prepared {
    /// The atoms, K×m.
    pub fn atoms(&self) -> ArrayView2<'_, f32> {
        self.atoms.view()
    }

    /// K, the number of atoms.
    pub fn atom_count(&self) -> usize {
        self.atoms.nrows()
    }

    /// m, the length of a signal.
    pub fn signal_len(&self) -> usize {
        self.atoms.ncols()
    }

    /// Inner products of atom `k` with every atom (K values).
    pub fn gram_row(&self, k: usize) -> &[f32] {
        &self.gram[k * self.stride..k * self.stride + self.atom_count()]
    }

    pub(super) fn atom(&self, k: usize) -> &[f32] {
        let m = self.signal_len();
        self.atoms.as_slice().map_or(&[], |all| &all[k * m..(k + 1) * m])
    }
}

/// Prepares atoms (K×m, one unit-norm atom a row; norms within 1e-3 of 1) for solving.
///
/// # Errors
/// Non-finite atoms, empty shapes, norms far from one, more than 16,384 atoms.
pub fn prepare(atoms: ArrayView2<'_, f32>) -> Result<Prepared, Error> {
    let (k, m) = atoms.dim();
    if k == 0 || m == 0 {
        return Err(Error::Shape(format!("a dictionary of {k} atoms of {m} values has nothing to code with")));
    }
    if k > MOST_ATOMS || m > LONGEST_SIGNAL {
        return Err(Error::Shape(format!(
            "{k} atoms of {m} values are too many (at most {MOST_ATOMS} of {LONGEST_SIGNAL})"
        )));
    }
    for (row, atom) in atoms.rows().into_iter().enumerate() {
        if atom.iter().any(|v| !v.is_finite()) {
            return Err(Error::NotFinite { what: "the dictionary", row });
        }
        let norm = atom.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > 1e-3 {
            return Err(Error::Parameter(format!("atom {row} has norm {norm:.6}, expected 1")));
        }
    }
    let atoms = atoms.as_standard_layout().into_owned();
    let stride = k.next_multiple_of(LANES);
    let mut gram = vec![0.0f32; k * stride];
    let product = atoms.dot(&atoms.t());
    for (row, values) in product.rows().into_iter().enumerate() {
        for (out, &v) in gram[row * stride..].iter_mut().zip(values) {
            *out = v;
        }
    }
    Ok(Prepared { atoms, gram, stride })
}
