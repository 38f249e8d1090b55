//! One move of the f32 active set: an atom enters, the values move to the new minimum, atoms whose sign would change
//! leave.
//!
//! The inverse of G_SS is kept explicitly and updated by rank one. Where a coefficient would change sign on the way to
//! the minimum φ_S = G_SS⁻¹(b_S − λθ), the move stops there and the atom leaves.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::simd::{Chunk, Lanes, UNITS, flat, flat_mut};
use super::state::{Entering, State, Task};

/// Chunks that `n` members fill; known at compile time where there is only one.
#[inline(always)]
fn chunks_of<const C: usize>(n: usize) -> usize {
    if C == 1 { 1 } else { n.div_ceil(16).min(C) }
}

/// Adds an atom to the support and moves to the new minimum. False when that is too ill-conditioned for f32.
/// `correlations` are those of the signal less λθ on the support. With `CANDIDATES` the members' Gram rows are read
/// from the copies of their candidate parts, otherwise from the Gram matrix.
#[inline(always)]
pub(crate) fn add_atom<S: Lanes, const C: usize, const CANDIDATES: bool>(
    lanes: S,
    task: &Task<'_>,
    correlations: &mut [Chunk],
    state: &mut State<C>,
    entering: Entering,
) -> bool {
    let Entering { atom, at, lane } = entering;
    let (width, gram) = (task.dictionary.width(), task.dictionary.gram());
    state.rounds += 1;
    let Some(place) = state.free_place() else { return false };
    let n = state.n;
    let after = n.max(place + 1);
    let chunks = chunks_of::<C>(after);
    // g = G[j, S] and u = G_SS⁻¹ g. Fours of rows may reach past the support: there the inverse is zero.
    let zero = lanes.splat(0.0);
    let (mut fit, mut overlap) = (zero, zero);
    let mut u = [zero; C];
    for v in 0..chunks {
        let (mut sums, mut g) = ([zero; 4], [zero; 4]);
        for first in (0..n).step_by(4) {
            for i in 0..4 {
                let (block, row) = (((first + i) / 16) & (C - 1), (first + i) & 15);
                let part = if CANDIDATES {
                    &state.candidate_rows[block][row][at & 7]
                } else {
                    &gram[state.rows[block][row] as usize + atom / 16]
                };
                let gi = lanes.splat(part.0[lane & 15]);
                sums[i] = lanes.fma(gi, lanes.load(&state.inverse[block][row][v]), sums[i]);
                if C == 1 || block == v {
                    g[i] = lanes.fma(gi, lanes.load(&UNITS[row]), g[i]);
                }
            }
        }
        u[v] = lanes.add(lanes.add(sums[0], sums[2]), lanes.add(sums[1], sums[3]));
        let g = lanes.add(lanes.add(g[0], g[2]), lanes.add(g[1], g[3]));
        fit = lanes.fma(g, lanes.load(&state.phi[v]), fit);
        overlap = lanes.fma(g, u[v], overlap);
    }
    let row = if CANDIDATES { task.dictionary.gram_chunks(atom) } else { &gram[atom * width..][..width] };
    let own = flat(correlations)[atom];
    let (fit, overlap) = if n == 0 { (0.0, 0.0) } else { lanes.sum_both(fit, overlap) };
    let pull = own - fit;
    let left = row[atom / 16].0[lane & 15] - overlap;
    let sign = 1.0f32.copysign(pull);
    let inverse_left = 1.0 / left;
    let alpha = (pull - task.lambda * sign) * inverse_left;
    // Also when something is not a number.
    if !(left >= 1e-4 && alpha * sign > 0.0) {
        return false;
    }
    // With u extended by −1 for the new atom, everything below is one rank-one formula.
    let (chunk, lane_of_place) = (if C == 1 { 0 } else { (place / 16) & (C - 1) }, place & 15);
    let unit = lanes.load(&UNITS[lane_of_place]);
    u[chunk] = lanes.fma(lanes.splat(-1.0), unit, u[chunk]);
    let signs = lanes.fma(lanes.splat(sign), unit, lanes.load(&state.signs[chunk]));
    lanes.store(&mut state.signs[chunk], signs);
    state.support[chunk][lane_of_place] = atom as u32;
    state.rows[chunk][lane_of_place] = (atom * width) as u32;
    state.signal_correlations[chunk][lane_of_place] = own;
    state.used[chunk] |= 1 << lane_of_place;
    state.n = after;
    flat_mut(correlations)[atom] = own - task.lambda * sign;
    if CANDIDATES {
        for (part, &chunk) in state.candidate_rows[chunk][lane_of_place].iter_mut().zip(&state.candidates) {
            *part = row[chunk as usize];
        }
    }
    let mut flipped = 0;
    let mut target = [Chunk::ZERO; C];
    let mut factors = [Chunk::ZERO; C];
    for v in 0..chunks {
        lanes.store(&mut factors[v], lanes.mul(u[v], lanes.splat(inverse_left)));
        let phi = lanes.fnma(lanes.splat(alpha), u[v], lanes.load(&state.phi[v]));
        lanes.store(&mut target[v], phi);
        flipped |= lanes.negative(lanes.mul(phi, lanes.load(&state.signs[v])));
    }
    for first in (0..after).step_by(4) {
        for i in 0..4 {
            let (block, row) = (((first + i) / 16) & (C - 1), (first + i) & 15);
            let factor = lanes.splat(factors[block].0[row]);
            for v in 0..chunks {
                let sum = lanes.fma(factor, u[v], lanes.load(&state.inverse[block][row][v]));
                lanes.store(&mut state.inverse[block][row][v], sum);
            }
        }
    }
    if flipped != 0 && task.keep_signs {
        return move_to::<S, C>(lanes, state, correlations, &mut target);
    }
    state.phi[..chunks].copy_from_slice(&target[..chunks]);
    true
}

/// Moves to the minimum for a lower λ with the same support, less atoms that would change sign. False when that does
/// not end.
#[inline(always)]
pub(crate) fn lower_lambda<S: Lanes, const C: usize>(
    lanes: S,
    from: f32,
    to: f32,
    correlations: &mut [Chunk],
    state: &mut State<C>,
) -> bool {
    let chunks = chunks_of::<C>(state.n);
    let mut target = [Chunk::ZERO; C];
    target[..chunks].copy_from_slice(&state.phi[..chunks]);
    // φ += (λ − λ')·G_SS⁻¹θ; places without a member have no sign.
    for place in 0..state.n {
        let (block, row) = ((place / 16) & (C - 1), place & 15);
        let sign = state.signs[block].0[row];
        if sign != 0.0 {
            let step = lanes.splat((from - to) * sign);
            for v in 0..chunks {
                let sum = lanes.fma(step, lanes.load(&state.inverse[block][row][v]), lanes.load(&target[v]));
                lanes.store(&mut target[v], sum);
            }
            let atom = state.support[block][row] as usize;
            flat_mut(correlations)[atom] = state.signal_correlations[block][row] - to * sign;
        }
    }
    move_to::<S, C>(lanes, state, correlations, &mut target)
}

/// Moves from φ towards `target`, dropping the atoms whose coefficient would change sign on the way; false when it
/// does not end.
#[inline(always)]
fn move_to<S: Lanes, const C: usize>(
    lanes: S,
    state: &mut State<C>,
    correlations: &mut [Chunk],
    target: &mut [Chunk; C],
) -> bool {
    let chunks = chunks_of::<C>(state.n);
    for _ in 0..64 * C {
        let (mut t, mut first) = (1.0f32, usize::MAX);
        for v in 0..chunks {
            let mut flipped = lanes.negative(lanes.mul(lanes.load(&target[v]), lanes.load(&state.signs[v])));
            while flipped != 0 {
                let lane = (flipped.trailing_zeros() & 15) as usize;
                flipped &= flipped - 1;
                let (phi, target) = (state.phi[v].0[lane], target[v].0[lane]);
                let crossing = phi / (phi - target);
                if crossing < t || first == usize::MAX {
                    (t, first) = (crossing, v * 16 + lane);
                }
            }
        }
        if first == usize::MAX {
            state.phi[..chunks].copy_from_slice(&target[..chunks]);
            return true;
        }
        for v in 0..chunks {
            let phi = lanes.load(&state.phi[v]);
            let way = lanes.fma(lanes.splat(-1.0), phi, lanes.load(&target[v]));
            lanes.store(&mut state.phi[v], lanes.fma(lanes.splat(t), way, phi));
        }
        remove_atom::<S, C>(lanes, state, correlations, target, first);
    }
    false
}

/// Removes the member at place `k` from the support: a rank-one downdate, which leaves zeros in row and column `k`.
#[inline(always)]
fn remove_atom<S: Lanes, const C: usize>(
    lanes: S,
    state: &mut State<C>,
    correlations: &mut [Chunk],
    target: &mut [Chunk; C],
    k: usize,
) {
    let chunks = chunks_of::<C>(state.n);
    let (chunk, lane) = (if C == 1 { 0 } else { (k / 16) & (C - 1) }, k & 15);
    let column = state.inverse[chunk][lane];
    let scale = 1.0 / column[chunk].0[lane];
    let excess = target[chunk].0[lane] * scale;
    for v in 0..chunks {
        let part = lanes.load(&column[v]);
        let scaled = lanes.mul(part, lanes.splat(scale));
        let moved = lanes.fnma(lanes.splat(excess), part, lanes.load(&target[v]));
        lanes.store(&mut target[v], moved);
        for first in (0..state.n).step_by(4) {
            for i in 0..4 {
                let (block, row) = (((first + i) / 16) & (C - 1), (first + i) & 15);
                let to = &mut state.inverse[block][row][v];
                let mut less = lanes.fnma(lanes.splat(column[block].0[row]), scaled, lanes.load(to));
                if C == 1 || chunk == v {
                    less = lanes.clear_lane(less, lane);
                }
                lanes.store(to, less);
            }
        }
    }
    for v in [&mut state.phi[chunk], &mut target[chunk], &mut state.signs[chunk]] {
        lanes.store(v, lanes.clear_lane(lanes.load(v), lane));
    }
    state.inverse[chunk][lane] = [Chunk::ZERO; C];
    flat_mut(correlations)[state.support[chunk][lane] as usize] = state.signal_correlations[chunk][lane];
    state.used[chunk] &= !(1 << lane);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::kernel::simd::{Kernel, Simd, dispatch};
    use crate::sparse::prepared::{Prepared, prepare};

    /// e₀, one with the inner product −1/2 with it, and e₂; the state of a signal with the first two.
    fn dictionary() -> Prepared {
        let h = 0.75f32.sqrt();
        prepare(ndarray::arr2(&[[1.0, 0.0, 0.0], [-0.5, h, 0.0], [0.0, 0.0, 1.0]]).view()).unwrap()
    }

    struct Each<'a>(&'a Prepared);

    impl Kernel for Each<'_> {
        type Out = ();
        fn run<S: Lanes>(self, lanes: S) {
            let dictionary = self.0;
            let number = |atom: u32| (0..3).find(|&k| dictionary.outside(k as u32) == atom).unwrap();
            let [a, b] = [0, 1].map(number);
            let task = |keep_signs: bool| Task {
                dictionary,
                lambda: 0.25,
                threshold: 0.25,
                nonnegative: false,
                keep_signs,
                max_rounds: 9,
            };
            let start = |correlations: &mut [Chunk]| {
                let mut state = State::<1>::new();
                (flat_mut(correlations)[a], flat_mut(correlations)[b]) = (1.0, 0.5);
                for atom in [a, b] {
                    let entering = Entering { atom, at: atom / 16, lane: atom % 16 };
                    assert!(add_atom::<S, 1, false>(lanes, &task(true), correlations, &mut state, entering));
                }
                state
            };
            let mut correlations = vec![Chunk::ZERO; dictionary.width()];
            // G⁻¹ is 4/3 (1, 1/2; 1/2, 1): of (0.75, 0.25) that is (7/6, 5/6).
            let mut state = start(&mut correlations);
            let near = |v: &[f32], to: &[f32]| v.iter().zip(to).all(|(a, b)| (a - b).abs() < 1e-5);
            assert!(near(state.values(), &[7.0 / 6.0, 5.0 / 6.0]), "{:?}", state.values());
            assert!(near(&[flat(&correlations)[a], flat(&correlations)[b]], &[0.75, 0.25]));
            // A lower λ moves both by 0.15 · 4/3 · 3/2, and so do their correlations less λθ by 0.15.
            assert!(lower_lambda(lanes, 0.25, 0.1, &mut correlations, &mut state));
            assert!(near(state.values(), &[7.0 / 6.0 + 0.3, 5.0 / 6.0 + 0.3]));
            assert!(near(&[flat(&correlations)[a], flat(&correlations)[b]], &[0.9, 0.4]));
            // Towards (−0.1, −1) from (1, 1) the second is at zero first, half way; the other goes to 0.4 then.
            for (target, stays) in [([-0.1, -1.0], 0), ([-1.0, -0.1], 1)] {
                let mut state = start(&mut correlations);
                (state.phi[0].0[0], state.phi[0].0[1]) = (1.0, 1.0);
                let mut to = [Chunk::ZERO; 1];
                (to[0].0[0], to[0].0[1]) = (target[0], target[1]);
                assert!(move_to::<S, 1>(lanes, &mut state, &mut correlations, &mut to));
                let mut expected = [0.0; 2];
                expected[stays] = 0.4;
                assert!(near(state.values(), &expected), "{:?}", state.values());
                assert_eq!(state.used, [1 << stays]);
                // Who left has the correlation of the signal again, and its place is free.
                assert_eq!(flat(&correlations)[[b, a][stays]], [0.5, 1.0][stays]);
                assert_eq!(state.free_place(), Some(1 - stays));
                // A place without a member has no sign that could change.
                state.error = [[0.0; 16]];
                assert!(state.correct_values());
                assert!(near(state.values(), &expected));
            }
        }
    }

    #[test]
    fn values_move_to_the_minimum_and_the_first_to_change_sign_leaves() {
        let dictionary = dictionary();
        dispatch(Simd::best(), Each(&dictionary));
        dispatch(Simd::Plain, Each(&dictionary));
    }
}
