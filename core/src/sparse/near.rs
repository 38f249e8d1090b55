//! Which atom enters next: the largest |c| of c = b − G φ, sought among the few chunks of atoms that matter.
//!
//! Atoms that resemble each other share chunks of sixteen, so what a signal needs lies in few of them. A look at all
//! atoms finds the largest |c| of each chunk; the eight chunks with the highest become near, with copies of those parts of
//! the support's Gram rows, small enough to stay in the first cache. Rounds look there until all is satisfied, then
//! everywhere again; when that is satisfied, too, the support is final. The order of entry differs from a search over
//! all atoms, the answer does not.

use super::active::{State, Task};
use super::simd::{Chunk, Lanes, flat, flat_mut};

/// Most chunks of atoms that are near.
pub(super) const NEAR: usize = 8;

/// How a search ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum End {
    /// No atom outside the support is above the threshold; `outside` is the largest of them.
    Settled { outside: f32 },
    /// The cap on rounds.
    Cap,
    /// The support is full.
    Full,
    /// Rounding.
    Stuck,
}

/// What the next move is.
pub(super) enum Next {
    /// An atom enters.
    Enter(Newcomer),
    /// Over.
    Over(End),
}

/// The atom that enters: lane `lane` of the near chunk at place `at`.
#[derive(Clone, Copy)]
pub(super) struct Newcomer {
    pub atom: usize,
    pub at: usize,
    pub lane: usize,
}

/// Looks for the atom that violates its condition most. `correlations` are those of the signal less λθ on the support;
/// `peaks` is scratch of a value a chunk. With `NEAR_ROWS` among the near chunks, otherwise among all (at most [`FEW`]).
#[inline(always)]
pub(super) fn look<S: Lanes, const C: usize, const NEAR_ROWS: bool>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    state: &mut State<C>,
    peaks: &mut [Chunk],
) -> Next {
    if !NEAR_ROWS || state.chosen {
        let tagged = if NEAR_ROWS {
            look_near(lanes, task, correlations, state)
        } else {
            look_at_all(lanes, task, correlations, state)
        };
        if f32::from_bits(tagged & !TAG) > task.threshold {
            return admit::<S, C, NEAR_ROWS>(lanes, task, state, tagged & TAG);
        }
        let outside = f32::from_bits(tagged | TAG);
        if !NEAR_ROWS && outside <= task.threshold {
            return Next::Over(End::Settled { outside: outside.max(0.0) });
        }
    }
    let outside = look_everywhere(lanes, task, correlations, state.support(), state.values(), peaks);
    if outside <= task.threshold {
        return Next::Over(End::Settled { outside });
    }
    let Some(chunk) = flat(peaks).iter().position(|&p| p == outside) else { return Next::Over(End::Stuck) };
    let at = if NEAR_ROWS {
        choose::<S, C>(lanes, task, chunk, outside, state, peaks);
        0
    } else {
        chunk as u32
    };
    let mut c = lanes.load(&correlations[chunk]);
    for (&k, &value) in state.support().iter().zip(state.values()) {
        let part = &task.dictionary.gram()[k as usize * correlations.len() + chunk];
        c = lanes.fnma(lanes.splat(value), lanes.load(part), c);
    }
    let size = if task.nonnegative { c } else { lanes.abs(c) };
    let lane = lanes.largest((size, c)).2;
    admit::<S, C, NEAR_ROWS>(lanes, task, state, at * 16 + lane as u32)
}

/// Bits of a tag: the place of a chunk times 16 plus a lane, in place of the last bits of a number.
const TAG: u32 = 0xFF;
/// Most chunks that are looked at without a choice.
pub(super) const FEW: usize = 16;
/// The tags of all lanes of that many chunks.
static TAGS: [Chunk; FEW] = {
    let mut tags = [Chunk::ZERO; FEW];
    let mut i = 0;
    while i < 16 * FEW {
        tags[i / 16].0[i % 16] = f32::from_bits(i as u32);
        i += 1;
    }
    tags
};

/// What is left of a number when its last bits make room for a tag, and its sign where that does not matter.
#[inline(always)]
fn kept<S: Lanes>(lanes: S, task: &Task<'_>) -> S::V {
    lanes.splat(f32::from_bits(!TAG & if task.nonnegative { u32::MAX } else { 0x7FFF_FFFF }))
}

/// The atom at a tag enters, if it may.
#[inline(always)]
fn admit<S: Lanes, const C: usize, const NEAR_ROWS: bool>(
    lanes: S,
    task: &Task<'_>,
    state: &State<C>,
    tag: u32,
) -> Next {
    if state.rounds >= task.max_rounds {
        return Next::Over(End::Cap);
    }
    if state.free().is_none() {
        return Next::Over(End::Full);
    }
    let (at, lane) = (tag as usize / 16, tag as usize % 16);
    let chunk = if NEAR_ROWS { state.near[at & (NEAR - 1)] as usize } else { at };
    let newcomer = Newcomer { atom: chunk * 16 + lane, at, lane };
    let width = task.dictionary.width();
    let row = &task.dictionary.gram()[newcomer.atom * width..][..width];
    if NEAR_ROWS {
        for &chunk in &state.near {
            lanes.prefetch(&row[chunk as usize]);
        }
    }
    Next::Enter(newcomer)
}

/// The largest |c| (or c) of the near chunks, tagged with where it is.
#[inline(always)]
fn look_near<S: Lanes, const C: usize>(lanes: S, task: &Task<'_>, correlations: &[Chunk], state: &State<C>) -> u32 {
    let mut c = [lanes.splat(0.0); NEAR];
    for i in 0..NEAR {
        c[i] = lanes.load(&correlations[state.near[i] as usize]);
    }
    for member in 0..state.n {
        let (block, place) = ((member / 16) & (C - 1), member & 15);
        let row = &state.near_rows[block][place];
        let value = lanes.splat(state.phi[block].0[place]);
        for i in 0..NEAR {
            c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
        }
    }
    let keep = kept(lanes, task);
    for i in 0..NEAR {
        c[i] = lanes.tag(c[i], keep, lanes.load(&TAGS[i]));
    }
    lanes.largest_bits(tree::<S, NEAR>(lanes, c))
}

/// The same of all chunks, at most [`FEW`], a multiple of four.
#[inline(always)]
fn look_at_all<S: Lanes, const C: usize>(lanes: S, task: &Task<'_>, correlations: &[Chunk], state: &State<C>) -> u32 {
    let mut best = lanes.splat(f32::from_bits(1 << 31));
    let mut from = 0;
    if S::WIDE {
        if correlations.len() == 16 {
            best = look_at_some::<S, C, 16>(lanes, task, correlations, 0, state);
            from = 16;
        }
        while from + 8 <= correlations.len() {
            best = lanes.larger_bits(best, look_at_some::<S, C, 8>(lanes, task, correlations, from, state));
            from += 8;
        }
    }
    while from + 4 <= correlations.len() {
        best = lanes.larger_bits(best, look_at_some::<S, C, 4>(lanes, task, correlations, from, state));
        from += 4;
    }
    lanes.largest_bits(best)
}

#[inline(always)]
fn look_at_some<S: Lanes, const C: usize, const B: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    from: usize,
    state: &State<C>,
) -> S::V {
    let gram = task.dictionary.gram();
    let own = &correlations[from..from + B];
    let mut c = [lanes.splat(0.0); B];
    for i in 0..B {
        c[i] = lanes.load(&own[i]);
    }
    for first in (0..state.n).step_by(2) {
        for member in [first, first + 1] {
            let (block, place) = ((member / 16) & (C - 1), member & 15);
            let row = &gram[state.rows[block][place] as usize + from..][..B];
            let value = lanes.splat(state.phi[block].0[place]);
            for i in 0..B {
                c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
            }
        }
    }
    let keep = kept(lanes, task);
    let tags = &TAGS[from & (FEW - B)..][..B];
    for i in 0..B {
        c[i] = lanes.tag(c[i], keep, lanes.load(&tags[i]));
    }
    tree::<S, B>(lanes, c)
}

/// Lane by lane the largest of a power of two of vectors.
#[inline(always)]
fn tree<S: Lanes, const B: usize>(lanes: S, mut c: [S::V; B]) -> S::V {
    let mut half = B / 2;
    while half > 0 {
        for i in 0..half {
            c[i] = lanes.larger_bits(c[i], c[i + half]);
        }
        half /= 2;
    }
    c[0]
}

/// The largest |c| (or c, at least 0) over all atoms; that of each chunk goes into `peaks`.
#[inline(always)]
pub(super) fn look_everywhere<S: Lanes>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    support: &[u32],
    values: &[f32],
    peaks: &mut [Chunk],
) -> f32 {
    let mut from = 0;
    if S::WIDE {
        while from + 8 <= correlations.len() {
            look_at_part::<S, 8>(lanes, task, correlations, from, support, values, peaks);
            from += 8;
        }
    }
    while from + 4 <= correlations.len() {
        look_at_part::<S, 4>(lanes, task, correlations, from, support, values, peaks);
        from += 4;
    }
    let mut most = (lanes.splat(0.0), lanes.splat(0.0));
    for peaks in peaks.iter() {
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
    support: &[u32],
    values: &[f32],
    peaks: &mut [Chunk],
) {
    let (width, gram) = (correlations.len(), task.dictionary.gram());
    let mut c = [lanes.splat(0.0); B];
    for (c, own) in c.iter_mut().zip(&correlations[from..from + B]) {
        *c = lanes.load(own);
    }
    for (&k, &value) in support.iter().zip(values) {
        let row = &gram[k as usize * width + from..][..B];
        let value = lanes.splat(value);
        for i in 0..B {
            c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
        }
    }
    let peaks = &mut flat_mut(peaks)[from..from + B];
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

/// Makes (about) the [`NEAR`] chunks with the highest peaks near, first of all `top`, whose peak is `most`.
#[inline(always)]
fn choose<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    top: usize,
    most: f32,
    state: &mut State<C>,
    peaks: &[Chunk],
) {
    // A level that so many are above, by bisection; what does not fit is left for later.
    let mut level = task.threshold;
    if count_above(lanes, peaks, level) > NEAR as u32 {
        let mut high = most;
        for _ in 0..6 {
            let middle = 0.5 * (level + high);
            if count_above(lanes, peaks, middle) > NEAR as u32 {
                level = middle;
            } else {
                high = middle;
            }
        }
        if high < most {
            level = high;
        }
    }
    state.near[0] = top as u32;
    let mut chosen = 1;
    for (i, peaks) in peaks.iter().enumerate() {
        let mut mask = lanes.above(lanes.load(peaks), level);
        if i == top / 16 {
            mask &= !(1 << (top % 16));
        }
        while mask != 0 && chosen < NEAR {
            state.near[chosen] = i as u32 * 16 + mask.trailing_zeros();
            mask &= mask - 1;
            chosen += 1;
        }
    }
    for i in chosen..NEAR {
        state.near[i] = state.near[0];
    }
    state.chosen = true;
    let (width, gram) = (task.dictionary.width(), task.dictionary.gram());
    let n = state.n;
    for i in 0..n {
        let row = &gram[state.support()[i] as usize * width..][..width];
        let near = &mut state.near_rows.as_flattened_mut()[i];
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

/// λ_max of a signal: the largest |c| (or c, at least 0) without any support.
#[inline(always)]
pub(super) fn largest<S: Lanes>(lanes: S, task: &Task<'_>, correlations: &[Chunk], peaks: &mut [Chunk]) -> f32 {
    look_everywhere(lanes, task, correlations, &[], flat(&[]), peaks)
}
