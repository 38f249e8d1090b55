//! Exact active set on the Gram matrix: min ½‖y − Dᵀφ‖² + λ‖φ‖₁ by feature signs (after Lee et al., NIPS 2006).
//!
//! The support S with its signs θ holds φ_S = G_SS⁻¹(b_S − λθ). Each round scans c = b − G φ for the atom that violates
//! |c| ≤ λ most, lets it in, and moves to the new minimum; where a coefficient would change sign on the way, the move
//! stops there and the atom leaves. The inverse of G_SS is kept explicitly and updated by rank one. All in f32: what it
//! gives is a candidate for the f64 certificate, and whoever calls falls back on the f64 solver where that fails.

use super::prepared::Prepared;
use super::simd::{Chunk, Lanes, flat, flat_mut};

/// One signal's problem.
pub(super) struct Task<'a> {
    pub dictionary: &'a Prepared,
    pub lambda: f32,
    /// Atoms enter above this (λ and what rounding can add).
    pub threshold: f32,
    pub nonnegative: bool,
    pub max_rounds: u32,
}

/// How far it came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum End {
    /// No atom outside the support is above the threshold; `outside` is the largest of them.
    Settled { outside: f32 },
    /// The cap on rounds.
    Cap,
    /// Too ill-conditioned for f32.
    GaveUp,
}

/// Scratch of one thread; afterwards the code is in `support` and `values()`.
pub(super) struct State {
    pub support: Vec<u32>,
    pub rounds: u32,
    /// Correlations D y of the atoms of the support.
    held: Vec<f32>,
    /// Chunks of a row of the vectors below.
    wide: usize,
    phi: Vec<Chunk>,
    signs: Vec<Chunk>,
    /// Rows of `wide` chunks; zero beyond the support.
    inverse: Vec<Chunk>,
    column: Vec<Chunk>,
    step: Vec<Chunk>,
    target: Vec<Chunk>,
}

impl State {
    pub fn new(dictionary: &Prepared) -> State {
        let wide = dictionary.signal_len().min(dictionary.atom_count()).div_ceil(16);
        State {
            support: Vec::with_capacity(wide * 16),
            rounds: 0,
            held: Vec::with_capacity(wide * 16),
            wide,
            phi: vec![Chunk::ZERO; wide],
            signs: vec![Chunk::ZERO; wide],
            inverse: vec![Chunk::ZERO; wide * wide * 16],
            column: vec![Chunk::ZERO; wide],
            step: vec![Chunk::ZERO; wide],
            target: vec![Chunk::ZERO; wide],
        }
    }

    /// Values of the support, in its order.
    #[inline(always)]
    pub fn values(&self) -> &[f32] {
        &flat(&self.phi)[..self.support.len()]
    }

    /// Signs of the support, in its order.
    pub fn signs(&self) -> &[f32] {
        &flat(&self.signs)[..self.support.len()]
    }

    /// φ_S += G_SS⁻¹ ρ: one step of refinement for an error ρ of the support's conditions.
    pub fn refine(&mut self, error: &[f32]) {
        let wide = self.wide;
        for (row, &e) in self.inverse.chunks_exact(wide).zip(error) {
            for (p, &v) in flat_mut(&mut self.phi).iter_mut().zip(flat(row)) {
                *p += e * v;
            }
        }
    }

    #[inline(always)]
    fn clear(&mut self) {
        let used = self.support.len();
        let chunks = used.div_ceil(16);
        for row in self.inverse.chunks_exact_mut(self.wide).take(used) {
            row[..chunks].fill(Chunk::ZERO);
        }
        self.phi[..chunks].fill(Chunk::ZERO);
        self.signs[..chunks].fill(Chunk::ZERO);
        self.support.clear();
        self.held.clear();
        self.rounds = 0;
    }
}

/// Solves one signal; `correlations` (D y, `dictionary.width()` chunks) is used up.
#[inline(always)]
pub(super) fn solve<S: Lanes>(lanes: S, task: &Task<'_>, correlations: &mut [Chunk], state: &mut State) -> End {
    state.clear();
    let width = task.dictionary.width();
    let gram = task.dictionary.gram();
    loop {
        let (best, at, lane) = scan(lanes, correlations, gram, &state.support, flat(&state.phi), task.nonnegative);
        if best <= task.threshold {
            return End::Settled { outside: best };
        }
        if state.rounds >= task.max_rounds {
            return End::Cap;
        }
        state.rounds += 1;
        let j = at as usize * 16 + lane;
        let n = state.support.len();
        if n >= state.wide * 16 {
            return End::GaveUp;
        }
        let chunks = n / 16 + 1;
        // g = G[j, S], u = G_SS⁻¹ g.
        let row = flat(&gram[j * width..(j + 1) * width]);
        state.column[..chunks].fill(Chunk::ZERO);
        for (g, &k) in flat_mut(&mut state.column).iter_mut().zip(&state.support) {
            *g = row[k as usize];
        }
        let (mut fit, mut overlap) = (lanes.splat(0.0), lanes.splat(0.0));
        for v in 0..chunks {
            let (mut even, mut odd) = (lanes.splat(0.0), lanes.splat(0.0));
            let column = &flat(&state.column)[..n];
            let mut rows = state.inverse.chunks_exact(state.wide).zip(column);
            while let Some((row, &g)) = rows.next() {
                even = lanes.fma(lanes.splat(g), lanes.load(&row[v]), even);
                if let Some((row, &g)) = rows.next() {
                    odd = lanes.fma(lanes.splat(g), lanes.load(&row[v]), odd);
                }
            }
            let u = lanes.add(even, odd);
            lanes.store(&mut state.step[v], u);
            let g = lanes.load(&state.column[v]);
            fit = lanes.fma(g, lanes.load(&state.phi[v]), fit);
            overlap = lanes.fma(g, u, overlap);
        }
        let own = flat(correlations)[j];
        let pull = own - lanes.sum(fit);
        let left = row[j] - lanes.sum(overlap);
        if left < 1e-4 {
            return End::GaveUp;
        }
        let sign = 1.0f32.copysign(pull);
        let inverse_left = 1.0 / left;
        let alpha = (pull - task.lambda * sign) * inverse_left;
        if alpha * sign <= 0.0 {
            return End::GaveUp;
        }
        // With u extended by −1 for the newcomer, everything below is one rank-one formula.
        flat_mut(&mut state.step)[n] = -1.0;
        flat_mut(&mut state.signs)[n] = sign;
        state.support.push(j as u32);
        state.held.push(own);
        flat_mut(correlations)[j] = own - task.lambda * sign;
        let mut flipped = false;
        for v in 0..chunks {
            let phi = lanes.fnma(lanes.splat(alpha), lanes.load(&state.step[v]), lanes.load(&state.phi[v]));
            lanes.store(&mut state.target[v], phi);
            flipped |= lanes.any_negative(lanes.mul(phi, lanes.load(&state.signs[v])));
        }
        for v in 0..chunks {
            let u = lanes.load(&state.step[v]);
            let steps = &flat(&state.step)[..n + 1];
            for (row, &ui) in state.inverse.chunks_exact_mut(state.wide).zip(steps) {
                let sum = lanes.fma(lanes.splat(ui * inverse_left), u, lanes.load(&row[v]));
                lanes.store(&mut row[v], sum);
            }
        }
        if flipped {
            if !walk(lanes, state, correlations) {
                return End::GaveUp;
            }
        } else {
            state.phi[..chunks].copy_from_slice(&state.target[..chunks]);
        }
    }
}

/// The largest |c| (or c) of c = b − Σ φ_i G_i, and its place: (value, chunk, lane).
#[inline(always)]
fn scan<S: Lanes>(
    lanes: S,
    correlations: &[Chunk],
    gram: &[Chunk],
    support: &[u32],
    phi: &[f32],
    nonnegative: bool,
) -> (f32, f32, usize) {
    let mut best = (lanes.splat(-1.0), lanes.splat(0.0));
    let width = correlations.len();
    let mut from = 0;
    if S::WIDE {
        while from + 8 <= width {
            best = scan_part::<S, 8>(lanes, correlations, gram, from, support, phi, nonnegative, best);
            from += 8;
        }
    }
    while from + 4 <= width {
        best = scan_part::<S, 4>(lanes, correlations, gram, from, support, phi, nonnegative, best);
        from += 4;
    }
    lanes.largest(best)
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn scan_part<S: Lanes, const B: usize>(
    lanes: S,
    correlations: &[Chunk],
    gram: &[Chunk],
    from: usize,
    support: &[u32],
    phi: &[f32],
    nonnegative: bool,
    mut best: (S::V, S::V),
) -> (S::V, S::V) {
    let width = correlations.len();
    let own = &correlations[from..from + B];
    let mut c: [S::V; B] = std::array::from_fn(|i| lanes.load(&own[i]));
    for (&k, &value) in support.iter().zip(phi) {
        let row = &gram[k as usize * width + from..][..B];
        let value = lanes.splat(value);
        for i in 0..B {
            c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
        }
    }
    for (i, &c) in c.iter().enumerate() {
        let size = if nonnegative { c } else { lanes.abs(c) };
        best = lanes.keep_larger(best, size, lanes.splat((from + i) as f32));
    }
    best
}

/// The largest |c| (or c, at least 0).
#[inline(always)]
pub(super) fn largest<S: Lanes>(lanes: S, correlations: &[Chunk], nonnegative: bool) -> f32 {
    scan(lanes, correlations, &[], &[], &[], nonnegative).0.max(0.0)
}

/// Moves from φ towards `target`, dropping the atoms whose coefficient would change sign on the way; false when it
/// does not end.
#[inline(always)]
fn walk<S: Lanes>(lanes: S, state: &mut State, correlations: &mut [Chunk]) -> bool {
    for _ in 0..4 * state.wide * 16 {
        let n = state.support.len();
        let (mut t, mut first) = (1.0f32, usize::MAX);
        {
            let (phi, target, signs) = (flat(&state.phi), flat(&state.target), flat(&state.signs));
            for i in 0..n {
                if target[i] * signs[i] < 0.0 {
                    let crossing = phi[i] / (phi[i] - target[i]);
                    if crossing < t || first == usize::MAX {
                        (t, first) = (crossing, i);
                    }
                }
            }
        }
        if first == usize::MAX {
            state.phi.copy_from_slice(&state.target);
            return true;
        }
        for (p, &to) in flat_mut(&mut state.phi).iter_mut().zip(flat(&state.target)) {
            *p += t * (to - *p);
        }
        remove(lanes, state, correlations, first);
    }
    false
}

/// Takes the atom at place `k` out of the support: rank-one downdate, then the last takes its place.
#[inline(always)]
fn remove<S: Lanes>(lanes: S, state: &mut State, correlations: &mut [Chunk], k: usize) {
    let (n, wide) = (state.support.len(), state.wide);
    let chunks = n.div_ceil(16);
    state.column[..chunks].copy_from_slice(&state.inverse[k * wide..k * wide + chunks]);
    let scale = 1.0 / flat(&state.column)[k];
    let excess = flat(&state.target)[k] * scale;
    for v in 0..chunks {
        let column = lanes.load(&state.column[v]);
        let moved = lanes.fnma(lanes.splat(excess), column, lanes.load(&state.target[v]));
        lanes.store(&mut state.target[v], moved);
        let factors = &flat(&state.column)[..n];
        for (row, &f) in state.inverse.chunks_exact_mut(wide).zip(factors) {
            let less = lanes.fnma(lanes.splat(f * scale), column, lanes.load(&row[v]));
            lanes.store(&mut row[v], less);
        }
    }
    let last = n - 1;
    flat_mut(correlations)[state.support[k] as usize] = state.held[k];
    state.support.swap_remove(k);
    state.held.swap_remove(k);
    for vector in [&mut state.phi, &mut state.target, &mut state.signs] {
        let vector = flat_mut(vector);
        vector[k] = vector[last];
        vector[last] = 0.0;
    }
    if k != last {
        for v in 0..chunks {
            state.inverse[k * wide + v] = state.inverse[last * wide + v];
        }
    }
    state.inverse[last * wide..last * wide + chunks].fill(Chunk::ZERO);
    for row in state.inverse.chunks_exact_mut(wide).take(last) {
        let row = flat_mut(row);
        row[k] = row[last];
        row[last] = 0.0;
    }
    // The diagonal of the moved atom came over with its column.
}
