//! Products in f64 on lanes: a symmetric matrix of places times a vector, its rank-one update, a sum of atoms.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::simd::{Chunk, Lanes};
use crate::sparse::prepared::Prepared;

/// A place without an atom.
pub(super) const NO_ATOM: u32 = u32::MAX;

/// What atoms are subtracted from.
#[derive(Clone, Copy)]
pub(super) enum Begin<'a> {
    Signal(&'a [Chunk]),
    Wide(&'a [[f64; 16]]),
}

/// Puts `begin` less the atoms times their shares into `out`.
#[inline(always)]
pub(super) fn subtract_atoms<S: Lanes>(
    lanes: S,
    dictionary: &Prepared,
    atoms: &[u32],
    shares: &[f64],
    begin: Begin<'_>,
    out: &mut [[f64; 16]],
) {
    let chunks = out.len();
    let mut from = 0;
    while from < chunks {
        match chunks - from {
            1 => subtract_part::<S, 1>(lanes, dictionary, atoms, shares, begin, from, out),
            2 => subtract_part::<S, 2>(lanes, dictionary, atoms, shares, begin, from, out),
            3 => subtract_part::<S, 3>(lanes, dictionary, atoms, shares, begin, from, out),
            _ => subtract_part::<S, 4>(lanes, dictionary, atoms, shares, begin, from, out),
        }
        from += 4;
    }
}

#[inline(always)]
fn subtract_part<S: Lanes, const B: usize>(
    lanes: S,
    dictionary: &Prepared,
    atoms: &[u32],
    shares: &[f64],
    begin: Begin<'_>,
    from: usize,
    out: &mut [[f64; 16]],
) {
    let mut r = [lanes.wide_splat(0.0); B];
    for i in 0..B {
        r[i] = match begin {
            Begin::Signal(signal) => lanes.wide(&signal[from + i]),
            Begin::Wide(values) => lanes.wide_load(&values[from + i]),
        };
    }
    for (&atom, &share) in atoms.iter().zip(shares) {
        if atom != NO_ATOM {
            let atom = &dictionary.padded_atom(atom as usize)[from..][..B];
            let share = lanes.wide_splat(-share);
            for i in 0..B {
                r[i] = lanes.wide_fma(share, lanes.wide(&atom[i]), r[i]);
            }
        }
    }
    for i in 0..B {
        lanes.wide_store(&mut out[from + i], r[i]);
    }
}

/// The first `places` places of the symmetric `matrix` (rows of `stride` chunks) times `by`, into `out`.
#[inline(always)]
pub(super) fn multiply<S: Lanes>(
    lanes: S,
    matrix: &[[f64; 16]],
    stride: usize,
    places: usize,
    by: &[[f64; 16]],
    out: &mut [[f64; 16]],
) {
    let by = by.as_flattened();
    for v in 0..places.div_ceil(16) {
        let mut sums = [lanes.wide_splat(0.0); 4];
        // Fours of rows may reach past the places: there the matrix is zero.
        for first in (0..places).step_by(4) {
            for i in 0..4 {
                let row = lanes.wide_load(&matrix[(first + i) * stride + v]);
                sums[i] = lanes.wide_fma(lanes.wide_splat(by[first + i]), row, sums[i]);
            }
        }
        let one = lanes.wide_splat(1.0);
        let (a, b) = (lanes.wide_fma(one, sums[0], sums[2]), lanes.wide_fma(one, sums[1], sums[3]));
        lanes.wide_store(&mut out[v], lanes.wide_fma(one, a, b));
    }
}

/// Adds `scale` · x xᵀ to the first `places` places of a matrix of rows of `stride` chunks.
#[inline(always)]
pub(super) fn add_square<S: Lanes>(
    lanes: S,
    matrix: &mut [[f64; 16]],
    stride: usize,
    places: usize,
    x: &[[f64; 16]],
    scale: f64,
) {
    let chunks = places.div_ceil(16);
    for row in 0..places {
        let factor = lanes.wide_splat(scale * x.as_flattened()[row]);
        let to = &mut matrix[row * stride..][..chunks];
        for v in 0..chunks {
            let sum = lanes.wide_fma(factor, lanes.wide_load(&x[v]), lanes.wide_load(&to[v]));
            lanes.wide_store(&mut to[v], sum);
        }
    }
}
