//! Which atom enters next: the largest |c| of c = b − G φ, sought among a few chunks of candidate atoms.
//!
//! Atoms that resemble each other share chunks of sixteen, so the atoms that a signal needs lie in few chunks. A
//! search of all atoms finds the largest |c| of each chunk; the eight chunks with the highest become the candidates,
//! with copies of those parts of the support's Gram rows, small enough to stay in the first cache. Rounds search the
//! candidates until the optimality conditions hold on them, then all atoms are checked; when they hold there, too, the
//! support is final. The order of entry differs from that of a search over all atoms; the result does not.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::product::MAX_CHUNKS_SEARCHED_WHOLE;
use super::simd::{Chunk, Lanes, flat, flat_mut};
use super::state::{CANDIDATE_CHUNKS, Entering, LARGE_STATE_CHUNKS, State, Task};

/// Result of a search.
pub(crate) enum Search {
    /// An atom enters.
    Enter(Entering),
    /// No atom outside the support is above the threshold; `outside` is the largest |c| of them.
    Satisfied { outside: f32 },
    /// An atom should enter, but the state has no free place.
    Full,
    /// Too many rounds, or rounding: f32 cannot go on.
    Failed,
}

/// Finds the atom that violates its condition most. `correlations` are those of the signal less λθ on the support;
/// `peaks` is scratch of one value per chunk. With `CANDIDATES` it is sought among the candidate chunks, otherwise
/// among all (at most [`MAX_CHUNKS_SEARCHED_WHOLE`]).
#[inline(always)]
pub(crate) fn find_entering<S: Lanes, const C: usize, const CANDIDATES: bool>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    state: &mut State<C>,
    peaks: &mut [Chunk],
) -> Search {
    if !CANDIDATES || state.has_candidates {
        let tagged = if CANDIDATES {
            search_candidates(lanes, task, correlations, state)
        } else {
            search_all_tagged(lanes, task, correlations, state)
        };
        if f32::from_bits(tagged & !TAG) > task.threshold {
            return admit_atom::<S, C, CANDIDATES>(lanes, task, state, tagged & TAG);
        }
        let outside = f32::from_bits(tagged | TAG);
        if !CANDIDATES && outside <= task.threshold {
            return Search::Satisfied { outside: outside.max(0.0) };
        }
    }
    let outside = search_all(lanes, task, correlations, state.support(), state.values(), peaks);
    if outside <= task.threshold {
        return Search::Satisfied { outside };
    }
    let Some(chunk) = flat(peaks).iter().position(|&p| p == outside) else { return Search::Failed };
    let at = if CANDIDATES {
        choose_candidates::<S, C>(lanes, task, chunk, outside, state, peaks);
        0
    } else {
        chunk as u32
    };
    let mut c = lanes.load(&correlations[chunk]);
    for (&k, &value) in state.support().iter().zip(state.values()) {
        let part = &task.dictionary.gram_chunks(k as usize)[chunk];
        c = lanes.fnma(lanes.splat(value), lanes.load(part), c);
    }
    let size = if task.nonnegative { c } else { lanes.abs(c) };
    let lane = lanes.largest((size, c)).2;
    admit_atom::<S, C, CANDIDATES>(lanes, task, state, at * 16 + lane as u32)
}

/// Bits of a tag: the place of a chunk times 16 plus a lane, in place of the last bits of a number.
const TAG: u32 = 0xFF;
/// The tags of all lanes of that many chunks.
static TAGS: [Chunk; MAX_CHUNKS_SEARCHED_WHOLE] = {
    let mut tags = [Chunk::ZERO; MAX_CHUNKS_SEARCHED_WHOLE];
    let mut i = 0;
    while i < 16 * MAX_CHUNKS_SEARCHED_WHOLE {
        tags[i / 16].0[i % 16] = f32::from_bits(i as u32);
        i += 1;
    }
    tags
};

/// The bits of a number that stay when its last ones make room for a tag; without the sign where only |c| counts.
#[inline(always)]
fn magnitude_bits<S: Lanes>(lanes: S, task: &Task<'_>) -> S::V {
    lanes.splat(f32::from_bits(!TAG & if task.nonnegative { u32::MAX } else { 0x7FFF_FFFF }))
}

/// The atom at a tag, if a round and a place are left.
#[inline(always)]
fn admit_atom<S: Lanes, const C: usize, const CANDIDATES: bool>(
    lanes: S,
    task: &Task<'_>,
    state: &State<C>,
    tag: u32,
) -> Search {
    if state.rounds >= task.max_rounds {
        return Search::Failed;
    }
    if state.free_place().is_none() {
        return Search::Full;
    }
    let (at, lane) = (tag as usize / 16, tag as usize % 16);
    let chunk = if CANDIDATES { state.candidates[at & (CANDIDATE_CHUNKS - 1)] as usize } else { at };
    let entering = Entering { atom: chunk * 16 + lane, at, lane };
    if CANDIDATES {
        let row = task.dictionary.gram_chunks(entering.atom);
        for &chunk in &state.candidates {
            lanes.prefetch(&row[chunk as usize]);
        }
    }
    Search::Enter(entering)
}

/// The largest |c| (or c) of the candidate chunks, tagged with where it is.
#[inline(always)]
fn search_candidates<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    state: &State<C>,
) -> u32 {
    let mut c = [lanes.splat(0.0); CANDIDATE_CHUNKS];
    for i in 0..CANDIDATE_CHUNKS {
        c[i] = lanes.load(&correlations[state.candidates[i] as usize]);
    }
    for member in 0..state.n {
        let (block, place) = ((member / 16) & (C - 1), member & 15);
        let row = &state.candidate_rows[block][place];
        let value = lanes.splat(state.phi[block].0[place]);
        for i in 0..CANDIDATE_CHUNKS {
            c[i] = lanes.fnma(value, lanes.load(&row[i]), c[i]);
        }
    }
    let keep = magnitude_bits(lanes, task);
    for i in 0..CANDIDATE_CHUNKS {
        c[i] = lanes.tag(c[i], keep, lanes.load(&TAGS[i]));
    }
    lanes.largest_bits(reduce_tree::<S, CANDIDATE_CHUNKS>(lanes, c))
}

/// The same over all chunks, at most [`MAX_CHUNKS_SEARCHED_WHOLE`], a multiple of four.
#[inline(always)]
fn search_all_tagged<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    state: &State<C>,
) -> u32 {
    let mut best = lanes.splat(f32::from_bits(1 << 31));
    let mut from = 0;
    if S::WIDE {
        if correlations.len() == 16 {
            best = search_chunks_tagged::<S, C, 16>(lanes, task, correlations, 0, state);
            from = 16;
        }
        while from + 8 <= correlations.len() {
            best = lanes.larger_bits(best, search_chunks_tagged::<S, C, 8>(lanes, task, correlations, from, state));
            from += 8;
        }
    }
    while from + 4 <= correlations.len() {
        best = lanes.larger_bits(best, search_chunks_tagged::<S, C, 4>(lanes, task, correlations, from, state));
        from += 4;
    }
    lanes.largest_bits(best)
}

#[inline(always)]
fn search_chunks_tagged<S: Lanes, const C: usize, const B: usize>(
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
    let keep = magnitude_bits(lanes, task);
    let tags = &TAGS[from & (MAX_CHUNKS_SEARCHED_WHOLE - B)..][..B];
    for i in 0..B {
        c[i] = lanes.tag(c[i], keep, lanes.load(&tags[i]));
    }
    reduce_tree::<S, B>(lanes, c)
}

/// Lane by lane the largest of a power of two of vectors.
#[inline(always)]
fn reduce_tree<S: Lanes, const B: usize>(lanes: S, mut c: [S::V; B]) -> S::V {
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
pub(crate) fn search_all<S: Lanes>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    support: &[u32],
    values: &[f32],
    peaks: &mut [Chunk],
) -> f32 {
    // Those of a small support in fewer places, which are written each time.
    let (mut few, mut many): ([&[Chunk]; 16], [&[Chunk]; 16 * LARGE_STATE_CHUNKS]);
    let rows: &mut [&[Chunk]] = if support.len() <= 16 {
        few = [&[]; 16];
        &mut few
    } else {
        many = [&[]; 16 * LARGE_STATE_CHUNKS];
        &mut many
    };
    for (row, &k) in rows.iter_mut().zip(support) {
        *row = task.dictionary.gram_chunks(k as usize);
    }
    let mut from = 0;
    let rows = &rows[..support.len()];
    if S::WIDE {
        while from + 8 <= correlations.len() {
            search_chunks::<S, 8>(lanes, task, correlations, from, rows, values, peaks);
            from += 8;
        }
    }
    while from + 4 <= correlations.len() {
        search_chunks::<S, 4>(lanes, task, correlations, from, rows, values, peaks);
        from += 4;
    }
    let mut most = (lanes.splat(0.0), lanes.splat(0.0));
    for peaks in peaks.iter() {
        most = lanes.keep_larger(most, lanes.load(peaks), most.1);
    }
    lanes.largest(most).0
}

#[inline(always)]
fn search_chunks<S: Lanes, const B: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &[Chunk],
    from: usize,
    rows: &[&[Chunk]],
    values: &[f32],
    peaks: &mut [Chunk],
) {
    let mut c = [lanes.splat(0.0); B];
    for (c, own) in c.iter_mut().zip(&correlations[from..from + B]) {
        *c = lanes.load(own);
    }
    for (row, &value) in rows.iter().zip(values) {
        let row = &row[from..][..B];
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

/// Makes about the [`CANDIDATE_CHUNKS`] chunks with the highest peaks the candidates; `top`, whose peak is `most`, is
/// always among them.
#[inline(always)]
fn choose_candidates<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    top: usize,
    most: f32,
    state: &mut State<C>,
    peaks: &[Chunk],
) {
    // Bisection finds a level that about `CANDIDATE_CHUNKS` peaks exceed; chunks left out wait for the next search of
    // all.
    let mut level = task.threshold;
    if count_above(lanes, peaks, level) > CANDIDATE_CHUNKS as u32 {
        let mut high = most;
        for _ in 0..6 {
            let middle = 0.5 * (level + high);
            if count_above(lanes, peaks, middle) > CANDIDATE_CHUNKS as u32 {
                level = middle;
            } else {
                high = middle;
            }
        }
        if high < most {
            level = high;
        }
    }
    state.candidates[0] = top as u32;
    let mut chosen = 1;
    for (i, peaks) in peaks.iter().enumerate() {
        let mut mask = lanes.above(lanes.load(peaks), level);
        if i == top / 16 {
            mask &= !(1 << (top % 16));
        }
        while mask != 0 && chosen < CANDIDATE_CHUNKS {
            state.candidates[chosen] = i as u32 * 16 + mask.trailing_zeros();
            mask &= mask - 1;
            chosen += 1;
        }
    }
    for i in chosen..CANDIDATE_CHUNKS {
        state.candidates[i] = state.candidates[0];
    }
    state.has_candidates = true;
    let n = state.n;
    for i in 0..n {
        let row = task.dictionary.gram_chunks(state.support()[i] as usize);
        let parts = &mut state.candidate_rows.as_flattened_mut()[i];
        for (part, &chunk) in parts.iter_mut().zip(&state.candidates) {
            *part = row[chunk as usize];
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
pub(crate) fn lambda_max<S: Lanes>(lanes: S, task: &Task<'_>, correlations: &[Chunk], peaks: &mut [Chunk]) -> f32 {
    search_all(lanes, task, correlations, &[], flat(&[]), peaks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::kernel::simd::{Kernel, Simd, dispatch};
    use crate::sparse::prepared::{Prepared, prepare};
    use ndarray::Array2;

    struct Each<'a>(&'a Prepared);

    impl Kernel for Each<'_> {
        type Out = ();
        fn run<S: Lanes>(self, lanes: S) {
            let dictionary = self.0;
            let mut correlations = vec![Chunk::ZERO; dictionary.width()];
            (flat_mut(&mut correlations)[3], flat_mut(&mut correlations)[37]) = (0.25, -0.5);
            for (nonnegative, threshold, atom) in [(false, 0.375, 37), (true, 0.125, 3)] {
                let task =
                    Task { dictionary, lambda: threshold, threshold, nonnegative, keep_signs: true, max_rounds: 5 };
                let mut peaks = vec![Chunk([-1.0; 16]); dictionary.width().div_ceil(16)];
                let mut state = State::<1>::new();
                let found = find_entering::<S, 1, false>(lanes, &task, &correlations, &mut state, &mut peaks);
                assert!(matches!(found, Search::Enter(e) if e.atom == atom && 16 * e.at + e.lane == atom));
                // One search is enough: that of all chunks' peaks was not needed.
                assert!(flat(&peaks).iter().all(|&p| p == -1.0));
                let satisfied = Task { threshold: 0.75, ..task };
                let found = find_entering::<S, 1, false>(lanes, &satisfied, &correlations, &mut state, &mut peaks);
                assert!(matches!(found, Search::Satisfied { .. }));
            }
        }
    }

    #[test]
    fn the_largest_atom_enters_after_one_search() {
        let dictionary = prepare(Array2::<f32>::eye(40).view()).unwrap();
        dispatch(Simd::best(), Each(&dictionary));
        dispatch(Simd::Plain, Each(&dictionary));
    }
}
