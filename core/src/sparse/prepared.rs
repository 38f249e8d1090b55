//! A dictionary made ready for solving: atoms in padded rows and in panels for the product, and the Gram matrix G = D Dᵀ.

use super::Error;
use super::product::{self, GROUP};
use super::simd::{Chunk, Kernel, Lanes, Simd, dispatch, flat, flat_mut};
use ndarray::{Array2, ArrayView2};

/// Chunks of a panel: 64 atoms.
pub(super) const PANEL: usize = 4;
/// More atoms than this would need over a gibibyte of Gram matrix.
const MOST_ATOMS: usize = 16_384;
/// Longest signal accepted.
const LONGEST_SIGNAL: usize = 1 << 14;

/// A dictionary made ready for solving: atoms, Gram matrix, bounds.
#[derive(Debug, Clone)]
pub struct Prepared {
    atoms: Array2<f32>,
    /// Atoms again, rows padded with zeros to whole chunks.
    rows: Vec<Chunk>,
    /// For every 64 atoms, for every value of a signal, that value of the 64 atoms.
    panels: Vec<[Chunk; PANEL]>,
    /// K rows of `width` chunks, zero beyond K.
    gram: Vec<Chunk>,
    width: usize,
    simd: Simd,
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
    ///
    /// # Panics
    /// Without an atom `k`.
    pub fn gram_row(&self, k: usize) -> &[f32] {
        &flat(&self.gram[k * self.width..(k + 1) * self.width])[..self.atom_count()]
    }

    /// The instructions solving runs on: the processor's best unless changed.
    pub fn simd(&self) -> Simd {
        self.simd
    }

    /// Makes solving run on other instructions (plain ones where the processor lacks them); the answers stay the same.
    pub fn with_simd(mut self, simd: Simd) -> Prepared {
        self.simd = simd;
        self
    }

    /// Chunks of a row over all atoms (a multiple of [`PANEL`]).
    #[inline(always)]
    pub(super) fn width(&self) -> usize {
        self.width
    }

    #[inline(always)]
    pub(super) fn gram(&self) -> &[Chunk] {
        &self.gram
    }

    #[inline(always)]
    pub(super) fn panels(&self) -> impl Iterator<Item = &[[Chunk; PANEL]]> {
        self.panels.chunks_exact(self.signal_len())
    }

    /// Atom `k`, padded with zeros.
    #[inline(always)]
    pub(super) fn padded_atom(&self, k: usize) -> &[Chunk] {
        let chunks = self.signal_len().div_ceil(16);
        &self.rows[k * chunks..(k + 1) * chunks]
    }

    #[inline(always)]
    pub(super) fn atom(&self, k: usize) -> &[f32] {
        &flat(self.padded_atom(k))[..self.signal_len()]
    }
}

/// Prepares atoms (K×m, one unit-norm atom a row; norms within 1e-3 of 1) for solving.
///
/// # Errors
/// Non-finite atoms, empty shapes, norms far from one, more than 16,384 atoms or values a signal.
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
    let chunks = m.div_ceil(16);
    let width = k.div_ceil(16 * PANEL) * PANEL;
    let mut rows = vec![Chunk::ZERO; k * chunks];
    let mut panels = vec![[Chunk::ZERO; PANEL]; width / PANEL * m];
    for (row, atom) in atoms.rows().into_iter().enumerate() {
        let padded = flat_mut(&mut rows[row * chunks..(row + 1) * chunks]);
        let (panel, lane) = (row / (16 * PANEL), row % (16 * PANEL));
        for (i, &v) in atom.iter().enumerate() {
            padded[i] = v;
            panels[panel * m + i][lane / 16].0[lane % 16] = v;
        }
    }
    let atoms = atoms.as_standard_layout().into_owned();
    let mut prepared = Prepared { atoms, rows, panels, gram: Vec::new(), width, simd: Simd::best() };
    let mut gram = vec![Chunk::ZERO; k * width];
    let mut group = Vec::new();
    for (from, rows) in gram.chunks_mut(GROUP * width).enumerate() {
        let atoms = (from * GROUP..k.min((from + 1) * GROUP)).map(|row| prepared.atom(row));
        product::interleave(atoms, m, &mut group);
        dispatch(prepared.simd, Correlate { dictionary: &prepared, signals: &group, out: rows });
    }
    prepared.gram = gram;
    Ok(prepared)
}

/// The product of a block of signals with all atoms.
pub(super) struct Correlate<'a> {
    pub dictionary: &'a Prepared,
    pub signals: &'a [[f32; GROUP]],
    pub out: &'a mut [Chunk],
}

impl Kernel for Correlate<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        product::correlate(lanes, self.dictionary, self.signals, self.out);
    }
}
