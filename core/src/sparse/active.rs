//! Exact active set on the Gram matrix: min ½‖y − Dᵀφ‖² + λ‖φ‖₁ by feature signs (after Lee et al., NIPS 2006).
//!
//! The support S with its signs θ holds φ_S = G_SS⁻¹(b_S − λθ). Each round looks in c = b − G φ for the atom that violates
//! |c| ≤ λ most, lets it in, and moves to the new minimum; where a coefficient would change sign on the way, the move
//! stops there and the atom leaves. The inverse of G_SS is kept explicitly and updated by rank one. Rounds look only at
//! the few chunks of atoms that violated most when all were last looked at (see [`super::near`]). All in f32: the result
//! is a candidate for the f64 certificate; where that fails the f64 solver takes over.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::near::{NEAR, Newcomer};
use super::prepared::Prepared;
use super::simd::{Chunk, Lanes, UNITS, flat, flat_mut};

/// One signal's problem.
pub(super) struct Task<'a> {
    pub dictionary: &'a Prepared,
    pub lambda: f32,
    /// Atoms enter above this (λ and what rounding can add).
    pub threshold: f32,
    pub nonnegative: bool,
    /// Whether atoms whose coefficient would change sign leave; not in greedy pursuit.
    pub keep_signs: bool,
    pub max_rounds: u32,
}

/// The state of one signal, for up to 16·C members of the support; C is a power of two, so that masks keep places inside.
pub(super) struct State<const C: usize> {
    /// Places in use: all members of the support are before this one. A place whose member left keeps its atom, with a
    /// value of zero.
    pub n: usize,
    /// Bit i of number b says whether place 16·b + i has a member.
    used: [u16; C],
    pub rounds: u32,
    /// Atoms, in places beyond the support any of the dictionary.
    pub support: [[u32; 16]; C],
    /// Where their Gram rows begin.
    pub rows: [[u32; 16]; C],
    /// Correlations D y of the members.
    held: [[f32; 16]; C],
    /// What follows is zero beyond the support, except for `near_rows`.
    pub phi: [Chunk; C],
    pub signs: [Chunk; C],
    /// Errors of the members' conditions, as the last certificate found them.
    pub error: [[f32; 16]; C],
    inverse: [[[Chunk; C]; 16]; C],
    /// The chunks of atoms that rounds look at.
    pub near: [u32; NEAR],
    /// Those chunks of the members' Gram rows.
    pub near_rows: [[[Chunk; NEAR]; 16]; C],
    /// Whether `near` belongs to this signal.
    pub chosen: bool,
}

impl<const C: usize> State<C> {
    pub fn new() -> State<C> {
        State {
            n: 0,
            used: [0; C],
            rounds: 0,
            support: [[0; 16]; C],
            rows: [[0; 16]; C],
            held: [[0.0; 16]; C],
            phi: [Chunk::ZERO; C],
            signs: [Chunk::ZERO; C],
            error: [[0.0; 16]; C],
            inverse: [[[Chunk::ZERO; C]; 16]; C],
            near: [0; NEAR],
            near_rows: [[[Chunk::ZERO; NEAR]; 16]; C],
            chosen: false,
        }
    }

    /// The first place without a member.
    #[inline(always)]
    pub fn free(&self) -> Option<usize> {
        let block = if C == 1 { 0 } else { self.used.iter().position(|&used| used != u16::MAX)? };
        let lane = self.used[block].trailing_ones() as usize;
        (lane < 16).then_some(block * 16 + lane)
    }

    /// The support, in the order of its values.
    #[inline(always)]
    pub fn support(&self) -> &[u32] {
        &self.support.as_flattened()[..self.n]
    }

    #[inline(always)]
    pub fn values(&self) -> &[f32] {
        &flat(&self.phi)[..self.n]
    }

    /// Takes down the error of a member's condition, for its correlation `c` in f64; the larger of `largest` and |c| (or c).
    #[inline(always)]
    pub fn judge(&mut self, task: &Task<'_>, member: usize, c: f64, largest: f64) -> f64 {
        let (block, place) = ((member / 16) & (C - 1), member & 15);
        self.error[block][place] = (c - f64::from(task.lambda) * f64::from(self.signs[block].0[place])) as f32;
        let size = if task.nonnegative { c } else { c.abs() };
        if size > largest { size } else { largest }
    }

    /// φ_S += G_SS⁻¹ ρ: one step of refinement for the errors ρ of the members' conditions. False when a sign changes.
    pub fn refine(&mut self) -> bool {
        for (row, &e) in self.inverse.as_flattened().iter().zip(self.error.as_flattened()).take(self.n) {
            for (p, &v) in flat_mut(&mut self.phi).iter_mut().zip(flat(row)) {
                *p += e * v;
            }
        }
        self.values().iter().zip(flat(&self.signs)).all(|(&v, &s)| v * s >= 0.0)
    }

    /// Ready for another signal.
    #[inline(always)]
    pub fn clear(&mut self) {
        let chunks = self.n.div_ceil(16);
        for row in &mut self.inverse.as_flattened_mut()[..self.n] {
            row[..chunks].fill(Chunk::ZERO);
        }
        self.phi[..chunks].fill(Chunk::ZERO);
        self.signs[..chunks].fill(Chunk::ZERO);
        self.n = 0;
        self.used = [0; C];
        self.rounds = 0;
        self.chosen = false;
    }

    /// Takes over from a smaller state.
    pub fn grow_from(&mut self, small: &State<1>) {
        self.clear();
        self.n = small.n;
        self.used[0] = small.used[0];
        self.rounds = small.rounds;
        self.support[0] = small.support[0];
        self.rows[0] = small.rows[0];
        self.held[0] = small.held[0];
        self.phi[0] = small.phi[0];
        self.signs[0] = small.signs[0];
        for (to, from) in self.inverse[0].iter_mut().zip(&small.inverse[0]) {
            to[0] = from[0];
        }
        self.near = small.near;
        self.near_rows[0] = small.near_rows[0];
        self.chosen = small.chosen;
    }
}

/// Chunks that `n` members fill; known when compiling where there is but one.
#[inline(always)]
fn chunks_of<const C: usize>(n: usize) -> usize {
    if C == 1 { 1 } else { n.div_ceil(16).min(C) }
}

/// Lets an atom into the support and moves to the new minimum. False when that is too ill-conditioned for f32.
/// `correlations` are those of the signal less λθ on the support. With `NEAR_ROWS` the members' Gram rows are read from
/// their near parts, otherwise where they are.
#[inline(always)]
pub(super) fn enter<S: Lanes, const C: usize, const NEAR_ROWS: bool>(
    lanes: S,
    task: &Task<'_>,
    correlations: &mut [Chunk],
    state: &mut State<C>,
    newcomer: Newcomer,
) -> bool {
    let Newcomer { atom, at, lane } = newcomer;
    let (width, gram) = (task.dictionary.width(), task.dictionary.gram());
    state.rounds += 1;
    let Some(place) = state.free() else { return false };
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
                let near = if NEAR_ROWS {
                    &state.near_rows[block][row][at & 7]
                } else {
                    &gram[state.rows[block][row] as usize + atom / 16]
                };
                let gi = lanes.splat(near.0[lane & 15]);
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
    let row = &gram[atom * width..][..width];
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
    // With u extended by −1 for the newcomer, everything below is one rank-one formula.
    let (chunk, lane_of_place) = (if C == 1 { 0 } else { (place / 16) & (C - 1) }, place & 15);
    let unit = lanes.load(&UNITS[lane_of_place]);
    u[chunk] = lanes.fma(lanes.splat(-1.0), unit, u[chunk]);
    let signs = lanes.fma(lanes.splat(sign), unit, lanes.load(&state.signs[chunk]));
    lanes.store(&mut state.signs[chunk], signs);
    state.support[chunk][lane_of_place] = atom as u32;
    state.rows[chunk][lane_of_place] = (atom * width) as u32;
    state.held[chunk][lane_of_place] = own;
    state.used[chunk] |= 1 << lane_of_place;
    state.n = after;
    flat_mut(correlations)[atom] = own - task.lambda * sign;
    if NEAR_ROWS {
        for (near, &chunk) in state.near_rows[chunk][lane_of_place].iter_mut().zip(&state.near) {
            *near = row[chunk as usize];
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
        return walk::<S, C>(lanes, state, correlations, &mut target);
    }
    state.phi[..chunks].copy_from_slice(&target[..chunks]);
    true
}

/// Moves from φ towards `target`, dropping the atoms whose coefficient would change sign on the way; false when it
/// does not end.
#[inline(always)]
fn walk<S: Lanes, const C: usize>(
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
        remove::<S, C>(lanes, state, correlations, target, first);
    }
    false
}

/// Takes the member at place `k` out of the support: a rank-one downdate, which leaves zeros in row and column `k`.
#[inline(always)]
fn remove<S: Lanes, const C: usize>(
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
    flat_mut(correlations)[state.support[chunk][lane] as usize] = state.held[chunk][lane];
    state.used[chunk] &= !(1 << lane);
}
