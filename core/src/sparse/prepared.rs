//! A dictionary prepared for solving: atoms in padded rows and in panels for the product, and the Gram matrix G = D
//! Dᵀ.
//!
//! Internally, atoms have another order: sixteen atoms that resemble each other fill a chunk, so that the atoms a
//! signal needs lie in few chunks. Codes number atoms as the caller does.

use std::sync::OnceLock;

use ndarray::{Array2, ArrayView2};

use super::error::Error;
use super::kernel::gap;
use super::kernel::product::{Correlate, CorrelateOne, GROUP, MAX_CHUNKS_SEARCHED_WHOLE, PANEL, Panels};
use super::kernel::simd::{Chunk, Kernel, Lanes, Simd, dispatch, flat, flat_mut};

/// Most atoms accepted: more would need over a gibibyte of Gram matrix.
const MOST_ATOMS: usize = 16_384;
/// Longest signal accepted.
const LONGEST_SIGNAL: usize = 1 << 14;

/// A dictionary prepared for solving: atoms, Gram matrix, bounds.
#[derive(Debug, Clone)]
pub struct Prepared {
    atoms: Array2<f32>,
    /// The internal order, which all fields below follow: the place in `atoms` of each atom.
    order: Vec<u32>,
    /// Atoms, rows padded with zeros to whole chunks.
    rows: Vec<Chunk>,
    /// Atoms in the layout of the product.
    panels: Panels,
    /// K rows of chunks over all atoms, zero beyond K; empty where `rows_on_demand` are used.
    gram: Vec<Chunk>,
    /// The same rows, each computed when it is first needed, where there are more atoms than are searched whole: few
    /// signals need few of them.
    rows_on_demand: Vec<OnceLock<Box<[Chunk]>>>,
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

    /// The instructions that solving runs on. Default: the fastest that the processor has.
    pub fn simd(&self) -> Simd {
        self.simd
    }

    /// Makes solving run on other instructions (plain ones where the processor lacks them); the results stay the same.
    pub fn with_simd(mut self, simd: Simd) -> Prepared {
        self.simd = simd;
        self
    }

    /// Chunks of a row over all atoms.
    #[inline(always)]
    pub(crate) fn width(&self) -> usize {
        self.panels.width
    }

    /// The whole Gram matrix, of dictionaries of at most [`MAX_CHUNKS_SEARCHED_WHOLE`] chunks; empty for larger ones.
    #[inline(always)]
    pub(crate) fn gram(&self) -> &[Chunk] {
        &self.gram
    }

    /// Row `k` of the Gram matrix, padded with zeros, in the internal order.
    #[inline(always)]
    pub(crate) fn gram_chunks(&self, k: usize) -> &[Chunk] {
        match self.rows_on_demand.get(k) {
            None => &self.gram[k * self.width()..][..self.width()],
            Some(row) => row.get().map_or_else(|| self.fill_row(k, row), |row| row),
        }
    }

    #[cold]
    #[inline(never)]
    fn fill_row<'a>(&self, k: usize, row: &'a OnceLock<Box<[Chunk]>>) -> &'a [Chunk] {
        row.get_or_init(|| {
            let mut out = vec![Chunk::ZERO; self.width()].into_boxed_slice();
            self.correlate_atom(k, &mut out);
            out
        })
    }

    /// Inner products of atom `k` with all atoms into `out`, a row of chunks.
    fn correlate_atom(&self, k: usize, out: &mut [Chunk]) {
        let vector = self.atom(k);
        dispatch(self.simd, CorrelateOne { panels: &self.panels, vector, out });
    }

    #[inline(always)]
    pub(crate) fn panels(&self) -> &Panels {
        &self.panels
    }

    /// Inner products of atom `k` in the internal order with every atom.
    #[inline(always)]
    pub(crate) fn gram_row(&self, k: usize) -> &[f32] {
        &flat(self.gram_chunks(k))[..self.atom_count()]
    }

    /// The caller's number of atom `k` in the internal order.
    #[inline(always)]
    pub(crate) fn outside(&self, k: u32) -> u32 {
        self.order[k as usize]
    }

    /// Atom `k` in the internal order, padded with zeros.
    #[inline(always)]
    pub(crate) fn padded_atom(&self, k: usize) -> &[Chunk] {
        let chunks = self.signal_len().div_ceil(16);
        &self.rows[k * chunks..(k + 1) * chunks]
    }

    /// Atom `k` in the internal order.
    #[inline(always)]
    pub(crate) fn atom(&self, k: usize) -> &[f32] {
        &flat(self.padded_atom(k))[..self.signal_len()]
    }

    /// D v in f64 for all atoms, in the internal order.
    pub(crate) fn correlate_f64(&self, v: &[f64], out: &mut [f64]) {
        let mut padded = v.to_vec();
        padded.resize(v.len().next_multiple_of(16), 0.0);
        dispatch(self.simd, CorrelateF64 { dictionary: self, v: padded.as_chunks::<16>().0, out });
    }
}

struct CorrelateF64<'a> {
    dictionary: &'a Prepared,
    v: &'a [[f64; 16]],
    out: &'a mut [f64],
}

impl Kernel for CorrelateF64<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        for (k, out) in self.out.iter_mut().enumerate() {
            *out = gap::inner_product(lanes, self.dictionary.padded_atom(k), self.v);
        }
    }
}

/// Prepares atoms (K×m, one unit-norm atom per row; norms within 1e-3 of 1) for solving. Up to 256 atoms it
/// costs their K×K Gram matrix; of more, K²m/16 products, and solving computes the rows of the Gram matrix that it needs.
///
/// # Errors
/// Non-finite atoms, empty shapes, norms far from one, more than 16,384 atoms or values per signal.
///
/// ```
/// use lenslet_core::sparse::{self, Error};
/// use ndarray::array;
///
/// let dictionary = sparse::prepare(array![[0.6f32, 0.8], [1.0, 0.0], [0.0, 1.0]].view())?;
/// assert_eq!((dictionary.atom_count(), dictionary.signal_len()), (3, 2));
/// let long = sparse::prepare(array![[3.0f32, 4.0]].view());
/// assert!(matches!(long, Err(Error::Parameter(_))));
/// # Ok::<(), Error>(())
/// ```
pub fn prepare(atoms: ArrayView2<'_, f32>) -> Result<Prepared, Error> {
    let (k, m) = atoms.dim();
    if k == 0 || m == 0 {
        return Err(Error::Shape(format!("a dictionary of {k} atoms of {m} values is empty")));
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
    let as_given = arrange(atoms, (0..k as u32).collect());
    if as_given.width() <= MAX_CHUNKS_SEARCHED_WHOLE {
        // All atoms are searched together: their order does not matter.
        return Ok(Prepared { gram: gram(&as_given), ..as_given });
    }
    let order = similarity_order(&as_given);
    let prepared = arrange(as_given.atoms, order);
    Ok(Prepared { rows_on_demand: (0..k).map(|_| OnceLock::new()).collect(), ..prepared })
}

/// Everything but the Gram matrix, for atoms in `order`.
fn arrange(atoms: Array2<f32>, order: Vec<u32>) -> Prepared {
    let (k, m) = atoms.dim();
    let chunks = m.div_ceil(16);
    let width = k.div_ceil(16 * PANEL) * PANEL;
    let mut rows = vec![Chunk::ZERO; k * chunks];
    let mut values = vec![[Chunk::ZERO; PANEL]; width / PANEL * m];
    for (row, &from) in order.iter().enumerate() {
        let padded = flat_mut(&mut rows[row * chunks..(row + 1) * chunks]);
        let (panel, lane) = (row / (16 * PANEL), row % (16 * PANEL));
        for (i, &v) in atoms.row(from as usize).iter().enumerate() {
            padded[i] = v;
            values[panel * m + i][lane / 16].0[lane % 16] = v;
        }
    }
    let panels = Panels { values, signal_len: m, width };
    Prepared { atoms, order, rows, panels, gram: Vec::new(), rows_on_demand: Vec::new(), simd: Simd::best() }
}

/// Rows of `width` chunks: inner products of all atoms with all atoms, in the internal order.
fn gram(prepared: &Prepared) -> Vec<Chunk> {
    let (k, m, width) = (prepared.atom_count(), prepared.signal_len(), prepared.width());
    let mut gram = vec![Chunk::ZERO; k * width];
    // The rows of the atoms end in zeros: their stride is a whole number of chunks.
    let stride = 16 * m.div_ceil(16);
    for (rows, atoms) in gram.chunks_mut(GROUP * width).zip(flat(&prepared.rows).chunks(GROUP * stride)) {
        dispatch(prepared.simd, Correlate { panels: &prepared.panels, signals: atoms, stride, out: rows });
    }
    gram
}

/// An order that puts atoms that resemble each other (by |inner product|) into the same chunk: the first atom left, then the
/// fifteen of those left that resemble it most; of equals the lowest number.
fn similarity_order(prepared: &Prepared) -> Vec<u32> {
    let k = prepared.atom_count();
    let mut left: Vec<u32> = (0..k as u32).collect();
    let mut order = Vec::with_capacity(k);
    let mut row = vec![Chunk::ZERO; prepared.width()];
    let mut ranked: Vec<u64> = Vec::with_capacity(k);
    while let Some(&first) = left.first() {
        prepared.correlate_atom(first as usize, &mut row);
        let row = flat(&row);
        // Sizes in front, as their bits ascend with them; numbers behind. The first atom stays the first.
        ranked.clear();
        ranked.extend(left.iter().skip(1).map(|&i| u64::from(!row[i as usize].abs().to_bits()) << 32 | u64::from(i)));
        if ranked.len() > 15 {
            ranked.select_nth_unstable(14);
            ranked.truncate(15);
        }
        ranked.sort_unstable();
        order.push(first);
        order.extend(ranked.iter().map(|&r| r as u32));
        let taken = &order[order.len() - ranked.len() - 1..];
        let mut is_taken = std::mem::take(&mut left);
        is_taken.retain(|i| !taken.contains(i));
        left = is_taken;
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solving_runs_on_the_instructions_that_are_asked_for() {
        let atoms = ndarray::arr2(&[[0.6f32, 0.8], [1.0, 0.0]]);
        let dictionary = prepare(atoms.view()).unwrap();
        assert_eq!(dictionary.simd(), Simd::best());
        assert_eq!(dictionary.with_simd(Simd::Plain).simd(), Simd::Plain);
    }
}
