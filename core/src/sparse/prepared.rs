//! A dictionary prepared for solving: atoms in padded rows and in panels for the product, and the Gram matrix G = D
//! Dᵀ.
//!
//! Internally, atoms have another order: sixteen atoms that resemble each other fill a chunk, so that the atoms a
//! signal needs lie in few chunks. Codes number atoms as the caller does.

use std::sync::OnceLock;

use ndarray::{Array2, ArrayView1, ArrayView2};

use super::error::Error;
use super::kernel::gap;
use super::kernel::product::{Correlate, GROUP, MAX_CHUNKS_SEARCHED_WHOLE, PANEL, Panels};
use super::kernel::simd::{Chunk, Kernel, Lanes, Simd, dispatch, flat, flat_mut};

/// Most atoms accepted: more would need over a gibibyte of Gram matrix.
const MOST_ATOMS: usize = 16_384;
/// Most atoms whose Gram matrix is computed beforehand.
///
/// Source: chosen; one of 512 costs as much as some hundred signals, and its rows are then found without a look whether
/// they are there.
const MOST_WITH_WHOLE_GRAM: usize = 512;
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
    /// K rows of chunks over all atoms, zero beyond K; empty where `groups_on_demand` are used.
    gram: Vec<Chunk>,
    /// The same rows in groups of [`GROUP`], each computed when it is first needed, where there are more atoms than
    /// [`MOST_WITH_WHOLE_GRAM`]: few signals need few of them.
    groups_on_demand: Vec<OnceLock<Vec<Chunk>>>,
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

    /// The whole Gram matrix, of dictionaries of at most [`MOST_WITH_WHOLE_GRAM`] atoms; empty for larger ones.
    #[inline(always)]
    pub(crate) fn gram(&self) -> &[Chunk] {
        &self.gram
    }

    /// Row `k` of the Gram matrix, padded with zeros, in the internal order.
    #[inline(always)]
    pub(crate) fn gram_chunks(&self, k: usize) -> &[Chunk] {
        let Some(group) = self.groups_on_demand.get(k / GROUP) else {
            return &self.gram[k * self.width()..][..self.width()];
        };
        let rows = group.get().unwrap_or_else(|| self.fill_group(k / GROUP, group));
        &rows[k % GROUP * self.width()..][..self.width()]
    }

    #[cold]
    #[inline(never)]
    fn fill_group<'a>(&self, number: usize, group: &'a OnceLock<Vec<Chunk>>) -> &'a Vec<Chunk> {
        group.get_or_init(|| {
            let atoms = number * GROUP..((number + 1) * GROUP).min(self.atom_count());
            let mut out = vec![Chunk::ZERO; atoms.len() * self.width()];
            let chunks = self.signal_len().div_ceil(16);
            self.correlate_padded(&self.rows[atoms.start * chunks..atoms.end * chunks], &mut out);
            out
        })
    }

    /// Inner products of `rows`, padded as atoms are, with all atoms into `out`, a row of chunks each.
    fn correlate_padded(&self, rows: &[Chunk], out: &mut [Chunk]) {
        // The rows of the atoms end in zeros: their stride is a whole number of chunks.
        let stride = 16 * self.signal_len().div_ceil(16);
        dispatch(self.simd, Correlate { panels: &self.panels, signals: flat(rows), stride, out });
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

/// Prepares atoms (K×m, one unit-norm atom per row; norms within 1e-3 of 1) for solving. Up to 512 atoms it
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
        let norm = norm_of(atom);
        if !norm.is_finite() {
            return Err(Error::NotFinite { what: "the dictionary", row });
        }
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
    if k <= MOST_WITH_WHOLE_GRAM {
        return Ok(Prepared { gram: gram(&prepared), ..prepared });
    }
    Ok(Prepared { groups_on_demand: (0..k.div_ceil(GROUP)).map(|_| OnceLock::new()).collect(), ..prepared })
}

/// The norm of an atom, by several sums at a time.
fn norm_of(atom: ArrayView1<'_, f32>) -> f64 {
    let mut sums = [0.0f64; 16];
    let square = |v: f32| f64::from(v) * f64::from(v);
    match atom.as_slice() {
        Some(values) => {
            let (whole, rest) = values.as_chunks::<16>();
            for part in whole {
                for (sum, &v) in sums.iter_mut().zip(part) {
                    *sum += square(v);
                }
            }
            for (sum, &v) in sums.iter_mut().zip(rest) {
                *sum += square(v);
            }
        }
        None => sums[0] = atom.iter().map(|&v| square(v)).sum(),
    }
    sums.iter().sum::<f64>().sqrt()
}

/// Everything but the Gram matrix, for atoms in `order`.
fn arrange(atoms: Array2<f32>, order: Vec<u32>) -> Prepared {
    let (k, m) = atoms.dim();
    let chunks = m.div_ceil(16);
    let width = k.div_ceil(16 * PANEL) * PANEL;
    let mut rows = vec![Chunk::ZERO; k * chunks];
    let mut values = vec![[Chunk::ZERO; PANEL]; width / PANEL * m];
    for (padded, &from) in rows.chunks_exact_mut(chunks).zip(&order) {
        for (to, &v) in flat_mut(padded).iter_mut().zip(atoms.row(from as usize)) {
            *to = v;
        }
    }
    let padded = flat(&rows);
    for (panel, values) in values.chunks_exact_mut(m).enumerate() {
        let first = panel * 16 * PANEL;
        for (part, rows) in padded[16 * chunks * first..].chunks(16 * 16 * chunks).take(PANEL).enumerate() {
            for (lane, row) in rows.chunks_exact(16 * chunks).enumerate() {
                for (value, &v) in values.iter_mut().zip(row) {
                    value[part].0[lane] = v;
                }
            }
        }
    }
    let panels = Panels { values, signal_len: m, width };
    Prepared { atoms, order, rows, panels, gram: Vec::new(), groups_on_demand: Vec::new(), simd: Simd::best() }
}

/// Rows of `width` chunks: inner products of all atoms with all atoms, in the internal order.
fn gram(prepared: &Prepared) -> Vec<Chunk> {
    let mut gram = vec![Chunk::ZERO; prepared.atom_count() * prepared.width()];
    prepared.correlate_padded(&prepared.rows, &mut gram);
    gram
}

/// An order that puts atoms that resemble each other (by |inner product|) into the same chunk: the first atom left, then the
/// fifteen of those left that resemble it most; of equals the lowest number. The products of the first six are computed
/// together.
fn similarity_order(prepared: &Prepared) -> Vec<u32> {
    let (k, width) = (prepared.atom_count(), prepared.width());
    let mut left: Vec<u32> = (0..k as u32).collect();
    let mut is_left = vec![true; k];
    let mut order = Vec::with_capacity(k);
    let mut rows = vec![Chunk::ZERO; GROUP * width];
    let mut atoms = Vec::new();
    let mut ranked: Vec<u64> = Vec::with_capacity(k);
    while !left.is_empty() {
        let first: Vec<u32> = left.iter().copied().take(GROUP).collect();
        atoms.clear();
        first.iter().for_each(|&i| atoms.extend_from_slice(prepared.padded_atom(i as usize)));
        prepared.correlate_padded(&atoms, &mut rows);
        for (&first, row) in first.iter().zip(rows.chunks(width)) {
            if !is_left[first as usize] {
                continue;
            }
            is_left[first as usize] = false;
            left.retain(|&i| is_left[i as usize]);
            // Sizes in front, whose bits ascend with them, turned round; numbers behind.
            let row = flat(row);
            ranked.clear();
            ranked.extend(left.iter().map(|&i| u64::from(!row[i as usize].abs().to_bits()) << 32 | u64::from(i)));
            if ranked.len() > 15 {
                ranked.select_nth_unstable(14);
                ranked.truncate(15);
            }
            ranked.sort_unstable();
            order.push(first);
            for &r in &ranked {
                is_left[r as u32 as usize] = false;
                order.push(r as u32);
            }
        }
        left.retain(|&i| is_left[i as usize]);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole, or in groups on demand, of which the last is incomplete; zero beyond the atoms.
    #[test]
    fn rows_of_the_gram_matrix_are_inner_products() {
        for k in [40usize, 257, 517] {
            let mut atoms = Array2::from_shape_fn((k, 9), |(i, j)| ((i * 37 + j * j * 11 + i * j) as f32).sin());
            atoms.rows_mut().into_iter().for_each(|mut r| r /= r.dot(&r).sqrt());
            let dictionary = prepare(atoms.view()).unwrap();
            assert_eq!(dictionary.gram().is_empty(), k > MOST_WITH_WHOLE_GRAM);
            let mut seen: Vec<u32> = (0..k as u32).map(|i| dictionary.outside(i)).collect();
            for i in [0, 5, 6, 7, k - 1] {
                for j in 0..k {
                    let product: f32 = dictionary.atom(i).iter().zip(dictionary.atom(j)).map(|(a, b)| a * b).sum();
                    assert!((dictionary.gram_row(i)[j] - product).abs() < 1e-5, "{k} atoms: {i}, {j}");
                }
                assert!(flat(dictionary.gram_chunks(i))[k..].iter().all(|v| *v == 0.0));
            }
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..k as u32));
        }
    }

    /// Four kinds of atoms, mixed: the first sixteen of a chunk are of one kind.
    #[test]
    fn atoms_that_resemble_each_other_share_a_chunk() {
        let mut atoms = Array2::from_shape_fn((320, 4), |(i, j)| if i % 4 == j { 1.0 } else { 0.01 * (i % 7) as f32 });
        atoms.rows_mut().into_iter().for_each(|mut r| r /= r.dot(&r).sqrt());
        let dictionary = prepare(atoms.view()).unwrap();
        for chunk in 0..20 {
            let kinds: Vec<u32> = (0..16).map(|lane| dictionary.outside(16 * chunk + lane) % 4).collect();
            assert!(kinds.iter().all(|k| *k == kinds[0]), "{kinds:?}");
        }
    }

    #[test]
    fn solving_runs_on_the_instructions_that_are_asked_for() {
        let atoms = ndarray::arr2(&[[0.6f32, 0.8], [1.0, 0.0]]);
        let dictionary = prepare(atoms.view()).unwrap();
        assert_eq!(dictionary.simd(), Simd::best());
        assert_eq!(dictionary.with_simd(Simd::Plain).simd(), Simd::Plain);
    }
}
