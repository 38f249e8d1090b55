//! The default solver of a block of signals: min ½‖y − Dᵀφ‖² + λ‖φ‖₁ by an f32 active set with an f64 certificate.
//!
//! Exact active set by feature signs (after Lee et al., NIPS 2006). For a support S with signs θ the minimum is at
//! φ_S = G_SS⁻¹(b_S − λθ), b = D y, G = D Dᵀ. Each round finds the atom that violates |c| ≤ λ most (c = b − G φ, see
//! [`super::candidate_search`]), adds it and moves to the new minimum (see [`super::update`]). All in f32; the duality
//! gap of the final code is computed in f64 (see [`super::certificate`]). What it does not certify is left, with the
//! support so far, to [`super::active_set_mixed`].
//!
//! Two or three signals are processed at once, in turns, so that the processor computes for one while another waits for
//! memory or for a chain of additions. Their numbers are independent of each other.

use super::candidate_search::{self, Search, find_entering};
use super::certificate::{Settled, certified_gap};
use super::continuation::Continuation;
use super::product::{self, MAX_CHUNKS_SEARCHED_WHOLE};
use super::scratch::{Scratch, Slot, Solved, Unfinished};
use super::simd::{Chunk, Kernel, Lanes, flat};
use super::state::{LARGE_STATE_CHUNKS, State, Task};
use super::update::{add_atom, lower_lambda};
use crate::sparse::penalty::Penalty;
use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished};

/// The share of ‖y‖ below which λ does not fall in f32, which has no digits left of correlations as small.
///
/// Source: chosen; a hundred times the rounding of f32.
const LAST_SHARE_IN_F32: f64 = 1e-5;

/// The penalty and the stopping conditions of every signal of a block.
#[derive(Clone, Copy)]
pub(crate) struct Settings {
    pub penalty: Penalty,
    /// Ends a solve when the gap is at most this times ½‖y‖².
    pub tolerance: f64,
    pub max_rounds: u32,
    pub nonnegative: bool,
    /// The way to a small λ.
    pub steps: Continuation,
}

/// A block of signals (rows of m values) to be solved; codes go into `scratch.solved`, what is left to do into
/// `scratch.unfinished`.
pub(crate) struct LassoBlock<'a> {
    pub dictionary: &'a Prepared,
    pub signals: &'a [f32],
    pub settings: Settings,
    pub scratch: &'a mut Scratch,
}

impl Kernel for LassoBlock<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        if self.dictionary.width() > MAX_CHUNKS_SEARCHED_WHOLE {
            self.run_rounds::<S, true>(lanes)
        } else {
            self.run_rounds::<S, false>(lanes)
        }
    }
}

impl LassoBlock<'_> {
    #[inline(always)]
    fn run_rounds<S: Lanes, const CANDIDATES: bool>(self, lanes: S) {
        let LassoBlock { dictionary, signals, settings, scratch } = self;
        let (m, width) = (dictionary.signal_len(), dictionary.width());
        let count = signals.len() / m;
        let Scratch { correlations, slots, large, peaks, padded, residual, solved, unfinished, .. } = scratch;
        unfinished.clear();
        let chunks = m.div_ceil(16);
        for (padded, signal) in padded.chunks_exact_mut(chunks).zip(signals.chunks_exact(m)) {
            let (whole, rest) = signal.as_chunks::<16>();
            for (to, from) in padded.iter_mut().zip(whole) {
                to.0 = *from;
            }
            if let Some(last) = padded.last_mut() {
                for (to, &from) in last.0.iter_mut().zip(rest) {
                    *to = from;
                }
            }
        }
        let padded = &padded[..count * chunks];
        product::correlate(lanes, dictionary.panels(), flat(padded), 16 * chunks, correlations);
        let mut task = Task {
            dictionary,
            lambda: 0.0,
            threshold: 0.0,
            nonnegative: settings.nonnegative,
            keep_signs: true,
            max_rounds: settings.max_rounds,
        };
        // The first `live` slots are in work.
        let (mut live, mut next) = (0, 0);
        loop {
            if live == 0 {
                while live < slots.len() && next < count {
                    let row = &correlations[next * width..(next + 1) * width];
                    let signal = &padded[next * chunks..(next + 1) * chunks];
                    start_signal(lanes, &task, &mut slots[live], signal, row, peaks, settings);
                    slots[live].signal = next;
                    live += 1;
                    next += 1;
                }
            }
            if live == 0 {
                break;
            }
            let mut at = 0;
            while at < live {
                let slot = &mut slots[at];
                let n = slot.signal;
                (task.lambda, task.threshold) = (slot.lambda, slot.threshold);
                let row = &mut correlations[n * width..(n + 1) * width];
                let mut grown = false;
                let outside = match find_entering::<S, 1, CANDIDATES>(lanes, &task, row, &mut slot.state, peaks) {
                    Search::Enter(entering) => {
                        slot.entering = entering;
                        at += 1;
                        continue;
                    }
                    Search::Satisfied { outside } => {
                        let next = next_lambda(&settings.steps, slot);
                        if let Some(next) = next
                            && lower_lambda(lanes, slot.lambda, next, row, &mut slot.state)
                        {
                            (slot.lambda, slot.threshold) = (next, entry_threshold(next, slot.norm));
                            continue;
                        }
                        if next.is_some() { f32::INFINITY } else { outside }
                    }
                    Search::Full => {
                        grown = true;
                        large.grow_from(&slot.state);
                        finish_in_large_state::<S, CANDIDATES>(
                            lanes,
                            &mut task,
                            &settings.steps,
                            row,
                            slot,
                            large,
                            peaks,
                        )
                    }
                    Search::Failed => f32::INFINITY,
                };
                let signal = &padded[n * chunks..(n + 1) * chunks];
                let settled =
                    Settled { outside, norm: slot.norm, goal: slot.goal, signal, is_last: slot.lambda == slot.wanted };
                let taken = if grown {
                    accept_if_certified(lanes, &task, settled, large, residual, &mut solved[n])
                } else {
                    accept_if_certified(lanes, &task, settled, &mut slot.state, residual, &mut solved[n])
                };
                if !taken && grown {
                    unfinished.push(leave_unfinished(
                        &settings.steps,
                        slot,
                        large,
                        outside < f32::INFINITY,
                        &mut solved[n],
                    ));
                } else if !taken {
                    unfinished.push(leave_unfinished(
                        &settings.steps,
                        slot,
                        &slot.state,
                        outside < f32::INFINITY,
                        &mut solved[n],
                    ));
                }
                live -= 1;
                slots.swap(at, live);
            }
            at = 0;
            while at < live {
                let slot = &mut slots[at];
                let n = slot.signal;
                (task.lambda, task.threshold) = (slot.lambda, slot.threshold);
                let row = &mut correlations[n * width..(n + 1) * width];
                if add_atom::<S, 1, CANDIDATES>(lanes, &task, row, &mut slot.state, slot.entering) {
                    at += 1;
                } else {
                    unfinished.push(leave_unfinished(&settings.steps, slot, &slot.state, false, &mut solved[n]));
                    live -= 1;
                    slots.swap(at, live);
                }
            }
        }
    }
}

/// Continues with a support that has outgrown its slot, down to the wanted λ. Returns the largest |c| outside the support, or infinity for
/// failure.
#[inline(always)]
fn finish_in_large_state<S: Lanes, const CANDIDATES: bool>(
    lanes: S,
    task: &mut Task<'_>,
    steps: &Continuation,
    correlations: &mut [Chunk],
    slot: &mut Slot,
    state: &mut State<LARGE_STATE_CHUNKS>,
    peaks: &mut [Chunk],
) -> f32 {
    loop {
        match find_entering::<S, LARGE_STATE_CHUNKS, CANDIDATES>(lanes, task, correlations, state, peaks) {
            Search::Enter(entering) => {
                if !add_atom::<S, LARGE_STATE_CHUNKS, CANDIDATES>(lanes, task, correlations, state, entering) {
                    return f32::INFINITY;
                }
            }
            Search::Satisfied { outside } => {
                let Some(next) = next_lambda(steps, slot) else { return outside };
                if !lower_lambda(lanes, slot.lambda, next, correlations, state) {
                    return f32::INFINITY;
                }
                (slot.lambda, slot.threshold) = (next, entry_threshold(next, slot.norm));
                (task.lambda, task.threshold) = (slot.lambda, slot.threshold);
            }
            Search::Full | Search::Failed => return f32::INFINITY,
        }
    }
}

/// Sets a new signal's λ, entry threshold and gap to reach.
#[inline(always)]
fn start_signal<S: Lanes>(
    lanes: S,
    task: &Task<'_>,
    slot: &mut Slot,
    signal: &[Chunk],
    correlations: &[Chunk],
    peaks: &mut [Chunk],
    settings: Settings,
) {
    slot.state.clear();
    let mut energy = lanes.wide_splat(0.0);
    for part in signal {
        let v = lanes.wide(part);
        energy = lanes.wide_fma(v, v, energy);
    }
    let energy = lanes.wide_sum(energy);
    slot.norm = energy.sqrt();
    let lambda_max = match settings.penalty {
        Penalty::FractionOfMax(_) => candidate_search::lambda_max(lanes, task, correlations, peaks),
        _ => 0.0,
    };
    slot.wanted = settings.penalty.lambda(f64::from(lambda_max));
    slot.lambda = slot.wanted;
    if f64::from(slot.wanted) < settings.steps.smallest_share_at_once * slot.norm && slot.wanted > 0.0 {
        slot.lambda = (settings.steps.first_share * slot.norm) as f32;
    }
    slot.threshold = entry_threshold(slot.lambda, slot.norm);
    slot.goal = settings.tolerance * 0.5 * energy;
    if slot.lambda == 0.0 || !(slot.norm == 0.0 || (1e-12..1e12).contains(&slot.norm)) {
        // Squares out of the range of f32, or λ = 0: no atom enters, the certificate fails, and f64 solves the signal.
        slot.threshold = f32::INFINITY;
        slot.norm = f64::INFINITY;
    }
}

/// What |c| must exceed for an atom to enter: λ, and what rounding can add.
#[inline(always)]
fn entry_threshold(lambda: f32, norm: f64) -> f32 {
    (f64::from(lambda) * (1.0 + 1e-6) + 4e-7 * norm) as f32
}

/// The next λ on the way down to the wanted one; none where f32 ends.
#[inline(always)]
fn next_lambda(steps: &Continuation, slot: &Slot) -> Option<f32> {
    let next = (slot.lambda / steps.factor as f32).max(slot.wanted);
    (next < slot.lambda && f64::from(next) > LAST_SHARE_IN_F32 * slot.norm).then_some(next)
}

/// Accepts the code when its gap is small enough, if need be after one correction of its values. False where the signal
/// must be solved in f64.
#[inline(always)]
fn accept_if_certified<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    settled: Settled<'_>,
    state: &mut State<C>,
    residual: &mut [[f64; 16]],
    solved: &mut Solved,
) -> bool {
    if settled.norm == f64::INFINITY || settled.outside == f32::INFINITY || !settled.is_last {
        return false;
    }
    for _ in 0..2 {
        let found = certified_gap(lanes, task, &settled, state, residual);
        if found <= settled.goal {
            collect_entries(task.dictionary, state, &mut solved.entries);
            let (lambda, iterations) = (task.lambda, state.rounds);
            solved.finished = Finished { gap: found, lambda, iterations, ended: Ended::Converged };
            return true;
        }
        if !state.correct_values() {
            return false;
        }
    }
    false
}

/// The entries of a code, atoms by the caller's numbers, ascending.
#[inline(always)]
fn collect_entries<const C: usize>(dictionary: &Prepared, state: &State<C>, entries: &mut Vec<(u32, f32)>) {
    let n = state.n;
    entries.clear();
    let each = state.support().iter().zip(state.values());
    if n > 16 {
        entries.extend(each.map(|(&k, &v)| (dictionary.outside(k), v)));
        entries.sort_unstable_by_key(|e| e.0);
        return;
    }
    // Few entries: the place of each is the count of smaller ones, without branches. Zeros go last and are dropped.
    let mut numbers = [u32::MAX; 16];
    for ((number, &k), &value) in numbers.iter_mut().zip(state.support()).zip(state.values()) {
        *number = if value == 0.0 { u32::MAX } else { dictionary.outside(k) };
    }
    let mut places = [0u32; 16];
    for &other in numbers.iter().take(n) {
        for (place, &own) in places.iter_mut().zip(&numbers) {
            *place += u32::from(other < own);
        }
    }
    entries.resize(n, (0, 0.0));
    for ((&number, &place), &value) in numbers.iter().zip(&places).zip(state.values()) {
        entries[place as usize] = (number, value);
    }
}

/// Leaves a signal with the members whose value has their sign, by their internal numbers.
#[inline(never)]
fn leave_unfinished<const C: usize>(
    steps: &Continuation,
    slot: &Slot,
    state: &State<C>,
    reached: bool,
    solved: &mut Solved,
) -> Unfinished {
    solved.entries.clear();
    let each = state.support().iter().zip(state.values()).zip(flat(&state.signs));
    solved.entries.extend(each.filter(|((_, value), sign)| **value * **sign > 0.0).map(|((&k, &v), _)| (k, v)));
    // Below λ of the rounds in f32 where these went through.
    let first_lambda = f64::from(slot.lambda) / if reached { steps.factor } else { 1.0 };
    Unfinished { signal: slot.signal, lambda: slot.wanted, first_lambda, goal: slot.goal, rounds: state.rounds }
}
