//! Exact active set on the Gram matrix: min ½‖y − Dᵀφ‖² + λ‖φ‖₁ by feature signs (after Lee et al., NIPS 2006).
//!
//! The support S with its signs θ holds φ_S = G_SS⁻¹(b_S − λθ). Each round looks in c = b − G φ for the atom that violates
//! |c| ≤ λ most, lets it in, and moves to the new minimum; where a coefficient would change sign on the way, the move
//! stops there and the atom leaves. The inverse of G_SS is kept explicitly and updated by rank one. Rounds look only at
//! the few chunks of atoms that violated most when all were last looked at; when those are satisfied all are looked at
//! again. All in f32: the result is a candidate for the f64 certificate; where that fails the f64 solver takes over.

use super::prepared::Prepared;
use super::simd::{Chunk, Lanes, flat, flat_mut};

/// Most chunks of atoms that rounds look at.
const MOST_NEAR: usize = 8;

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
    /// The support is full.
    GaveUp,
}

/// Scratch of one signal; afterwards the code is in `support` and `values()`.
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
    /// The chunks of atoms that rounds look at.
    near: [u32; MOST_NEAR],
    /// Those chunks of the support's Gram rows, `W` a member.
    near_rows: Vec<Chunk>,
    /// Whether `near` belongs to this signal.
    chosen: bool,
    /// The largest condition of each chunk of atoms, when all were last looked at.
    peaks: Vec<Chunk>,
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
            near: [0; MOST_NEAR],
            near_rows: vec![Chunk::ZERO; wide * 16 * MOST_NEAR],
            chosen: false,
            peaks: vec![Chunk::ZERO; dictionary.width().div_ceil(16)],
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

    /// Ready for another signal.
    #[inline(always)]
    pub fn clear(&mut self) {
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
        self.chosen = false;
    }
}

/// What the next move is.
pub(super) enum Next {
    /// An atom enters; see [`enter`].
    Enter(Newcomer),
    /// Over.
    Over(End),
}

/// The atom that enters: lane `lane` of the near chunk at place `at`.
#[derive(Clone, Copy)]
pub(super) struct Newcomer {
    atom: usize,
    at: usize,
    lane: usize,
}

/// Looks for the atom that violates its condition most. `correlations` are those of the signal less λθ on the support.
#[inline(always)]
pub(super) fn look<S: Lanes, const W: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    state: &mut State,
) -> Next {
    if state.chosen
        && let Some(next) = look_near::<S, W>(lanes, task, correlations, state)
    {
        return next;
    }
    let outside = look_everywhere(lanes, task, correlations, state);
    if outside <= task.threshold {
        return Next::Over(End::Settled { outside });
    }
    choose::<S, W>(lanes, task, outside, state);
    look_near::<S, W>(lanes, task, correlations, state).unwrap_or(Next::Over(End::GaveUp))
}

/// The same among the near chunks; none when all there are satisfied.
#[inline(always)]
fn look_near<S: Lanes, const W: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    state: &State,
) -> Option<Next> {
    let mut c = [lanes.splat(0.0); W];
    for (c, &chunk) in c.iter_mut().zip(&state.near) {
        *c = lanes.load(&correlations[chunk as usize]);
    }
    for (row, &value) in state.near_rows.chunks_exact(W).zip(state.values()) {
        let value = lanes.splat(value);
        for i in 0..W {
            c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
        }
    }
    let mut best = (lanes.splat(-1.0), lanes.splat(0.0));
    for (i, &c) in c.iter().enumerate() {
        let size = if task.nonnegative { c } else { lanes.abs(c) };
        best = lanes.keep_larger(best, size, lanes.splat(i as f32));
    }
    let (value, at, lane) = lanes.largest(best);
    if value <= task.threshold {
        return None;
    }
    if state.rounds >= task.max_rounds {
        return Some(Next::Over(End::Cap));
    }
    if state.support.len() >= state.wide * 16 {
        return Some(Next::Over(End::GaveUp));
    }
    let at = at as usize;
    let newcomer = Newcomer { atom: state.near[at] as usize * 16 + lane, at, lane };
    let width = task.dictionary.width();
    let row = &task.dictionary.gram()[newcomer.atom * width..][..width];
    for &chunk in &state.near[..W] {
        lanes.prefetch(&row[chunk as usize]);
    }
    Some(Next::Enter(newcomer))
}

/// The largest |c| (or c) over all atoms; that of each chunk goes into `state.peaks`.
#[inline(always)]
fn look_everywhere<S: Lanes>(lanes: S, task: &Task<'_>, correlations: &[Chunk], state: &mut State) -> f32 {
    let mut from = 0;
    if S::WIDE {
        while from + 8 <= correlations.len() {
            look_at_part::<S, 8>(lanes, task, correlations, from, state);
            from += 8;
        }
    }
    while from + 4 <= correlations.len() {
        look_at_part::<S, 4>(lanes, task, correlations, from, state);
        from += 4;
    }
    let mut most = (lanes.splat(0.0), lanes.splat(0.0));
    for peaks in &state.peaks {
        most = lanes.keep_larger(most, lanes.load(peaks), most.1);
    }
    lanes.largest(most).0
}

#[inline(always)]
fn look_at_part<S: Lanes, const B: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    from: usize,
    state: &mut State,
) {
    let (width, gram) = (correlations.len(), task.dictionary.gram());
    let own = &correlations[from..from + B];
    let mut c = [lanes.splat(0.0); B];
    for (c, own) in c.iter_mut().zip(own) {
        *c = lanes.load(own);
    }
    for (&k, &value) in state.support.iter().zip(flat(&state.phi)) {
        let row = &gram[k as usize * width + from..][..B];
        let value = lanes.splat(value);
        for i in 0..B {
            c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
        }
    }
    let peaks = &mut flat_mut(&mut state.peaks)[from..from + B];
    for (c, peaks) in c.chunks_exact(4).zip(peaks.chunks_exact_mut(4)) {
        let mut sizes = [c[0], c[1], c[2], c[3]];
        if !task.nonnegative {
            for size in &mut sizes {
                *size = lanes.abs(*size);
            }
        }
        peaks.copy_from_slice(&lanes.largest_of_each(sizes));
    }
}

/// Makes (about) the `W` chunks with the highest peaks near; there is one above the threshold.
#[inline(always)]
fn choose<S: Lanes, const W: usize>(lanes: S, task: &Task<'_>, most: f32, state: &mut State) {
    // A level that so many are above, by bisection; what does not fit is left for later.
    let mut level = task.threshold;
    if count_above(lanes, &state.peaks, level) > W as u32 {
        let mut high = most;
        for _ in 0..6 {
            let middle = 0.5 * (level + high);
            if count_above(lanes, &state.peaks, middle) > W as u32 {
                level = middle;
            } else {
                high = middle;
            }
        }
        if high < most {
            level = high;
        }
    }
    let mut chosen = 0;
    for (i, peaks) in state.peaks.iter().enumerate() {
        let mut mask = lanes.above(lanes.load(peaks), level);
        while mask != 0 && chosen < W {
            state.near[chosen] = i as u32 * 16 + mask.trailing_zeros();
            mask &= mask - 1;
            chosen += 1;
        }
    }
    for i in chosen..W {
        state.near[i] = state.near[0];
    }
    state.chosen = true;
    let (width, gram) = (task.dictionary.width(), task.dictionary.gram());
    for (near, &k) in state.near_rows.chunks_exact_mut(W).zip(&state.support) {
        let row = &gram[k as usize * width..][..width];
        for (near, &chunk) in near.iter_mut().zip(&state.near) {
            *near = row[chunk as usize];
        }
    }
}

#[inline(always)]
fn count_above<S: Lanes>(lanes: S, peaks: &[Chunk], level: f32) -> u32 {
    let mut count = 0;
    for peaks in peaks {
        count += lanes.above(lanes.load(peaks), level).count_ones();
    }
    count
}

/// Lets an atom into the support and moves to the new minimum. False when that is too ill-conditioned for f32.
#[inline(always)]
pub(super) fn enter<S: Lanes, const W: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &mut [Chunk],
    state: &mut State,
    newcomer: Newcomer,
) -> bool {
    let Newcomer { atom, at, lane } = newcomer;
    let (width, wide) = (task.dictionary.width(), state.wide);
    state.rounds += 1;
    let n = state.support.len();
    let chunks = n / 16 + 1;
    // g = G[j, S], u = G_SS⁻¹ g; rows and values beyond the support are zero, so fours may reach past it.
    state.column[..chunks].fill(Chunk::ZERO);
    for (g, row) in flat_mut(&mut state.column)[..n].iter_mut().zip(state.near_rows.chunks_exact(W)) {
        *g = row[at].0[lane];
    }
    let fours = n.div_ceil(4);
    let (mut fit, mut overlap) = (lanes.splat(0.0), lanes.splat(0.0));
    for v in 0..chunks {
        let mut sums = [lanes.splat(0.0); 4];
        let column = flat(&state.column).chunks_exact(4).take(fours);
        for (rows, g) in state.inverse.chunks_exact(4 * wide).zip(column) {
            for i in 0..4 {
                sums[i] = lanes.fma(lanes.splat(g[i]), lanes.load(&rows[i * wide + v]), sums[i]);
            }
        }
        let u = lanes.add(lanes.add(sums[0], sums[2]), lanes.add(sums[1], sums[3]));
        lanes.store(&mut state.step[v], u);
        let g = lanes.load(&state.column[v]);
        fit = lanes.fma(g, lanes.load(&state.phi[v]), fit);
        overlap = lanes.fma(g, u, overlap);
    }
    let row = &task.dictionary.gram()[atom * width..][..width];
    let own = flat(correlations)[atom];
    let pull = own - lanes.sum(fit);
    let left = row[atom / 16].0[lane] - lanes.sum(overlap);
    if left < 1e-4 {
        return false;
    }
    let sign = 1.0f32.copysign(pull);
    let inverse_left = 1.0 / left;
    let alpha = (pull - task.lambda * sign) * inverse_left;
    if alpha * sign <= 0.0 {
        return false;
    }
    // With u extended by −1 for the newcomer, everything below is one rank-one formula.
    flat_mut(&mut state.step)[n] = -1.0;
    flat_mut(&mut state.signs)[n] = sign;
    state.support.push(atom as u32);
    state.held.push(own);
    flat_mut(correlations)[atom] = own - task.lambda * sign;
    for (near, &chunk) in state.near_rows[n * W..(n + 1) * W].iter_mut().zip(&state.near) {
        *near = row[chunk as usize];
    }
    let mut flipped = false;
    for v in 0..chunks {
        let phi = lanes.fnma(lanes.splat(alpha), lanes.load(&state.step[v]), lanes.load(&state.phi[v]));
        lanes.store(&mut state.target[v], phi);
        flipped |= lanes.any_negative(lanes.mul(phi, lanes.load(&state.signs[v])));
    }
    let fours = (n + 1).div_ceil(4);
    for v in 0..chunks {
        let u = lanes.load(&state.step[v]);
        let steps = flat(&state.step).chunks_exact(4).take(fours);
        for (rows, ui) in state.inverse.chunks_exact_mut(4 * wide).zip(steps) {
            for i in 0..4 {
                let row = &mut rows[i * wide + v];
                let sum = lanes.fma(lanes.splat(ui[i] * inverse_left), u, lanes.load(row));
                lanes.store(row, sum);
            }
        }
    }
    if flipped {
        return walk::<S, W>(lanes, state, correlations);
    }
    state.phi[..chunks].copy_from_slice(&state.target[..chunks]);
    true
}

/// The largest |c| (or c, at least 0).
#[inline(always)]
pub(super) fn largest<S: Lanes>(lanes: S, task: &Task<'_>, correlations: &[Chunk], state: &mut State) -> f32 {
    look_everywhere(lanes, task, correlations, state)
}

/// Moves from φ towards `target`, dropping the atoms whose coefficient would change sign on the way; false when it
/// does not end.
#[inline(always)]
fn walk<S: Lanes, const W: usize>(lanes: S, state: &mut State, correlations: &mut [Chunk]) -> bool {
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
            let chunks = n.div_ceil(16);
            state.phi[..chunks].copy_from_slice(&state.target[..chunks]);
            return true;
        }
        for (p, &to) in flat_mut(&mut state.phi)[..n].iter_mut().zip(flat(&state.target)) {
            *p += t * (to - *p);
        }
        remove::<S, W>(lanes, state, correlations, first);
    }
    false
}

/// Takes the atom at place `k` out of the support: rank-one downdate, then the last takes its place.
#[inline(always)]
fn remove<S: Lanes, const W: usize>(lanes: S, state: &mut State, correlations: &mut [Chunk], k: usize) {
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
        for i in 0..W {
            state.near_rows[k * W + i] = state.near_rows[last * W + i];
        }
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
