//! The default solver of a block of signals: D y as one product, the f32 active set, the f64 certificate, f64 where needed.
//!
//! A few signals are in work at once and take turns, so that the processor has something to do while one of them waits
//! for memory or for a chain of additions. They do not touch each other's numbers.

use super::active::{self, State};
use super::exact::{self, Seen};
use super::near::{self, End, Newcomer, Next};
use super::prepared::Prepared;
use super::product::{self, GROUP};
use super::simd::{Chunk, Kernel, Lanes, flat};
use super::solve::{Finished, push_sorted};
use super::{Codes, Ended, Options, Penalty, gap, omp};

/// Signals in work at once where all atoms are looked at. They start together and go through their rounds together, so
/// that branches can be foreseen; the next begin when all are finished.
const BATCH: usize = 3;
/// The same where near chunks are looked at.
const NEAR_BATCH: usize = 2;
/// Chunks of the large state: supports up to 128; what needs more is for the f64 solver.
const LARGE: usize = 8;

/// Scratch of one thread.
pub(super) struct Scratch {
    pub correlations: Vec<Chunk>,
    slots: Vec<Slot>,
    /// For a support that outgrows that of its slot.
    large: Box<State<LARGE>>,
    peaks: Vec<Chunk>,
    /// Signals, each padded with zeros to whole chunks.
    padded: Vec<Chunk>,
    residual: Vec<[f64; 16]>,
    solved: Vec<Solved>,
}

/// A signal in work.
struct Slot {
    state: Box<State<1>>,
    /// Which signal of the block.
    signal: usize,
    entering: Newcomer,
    lambda: f32,
    threshold: f32,
    norm: f64,
    goal: f64,
}

/// A signal's answer, until those before it are there too.
struct Solved {
    entries: Vec<(u32, f32)>,
    lambda: f32,
    finished: Finished,
}

impl Scratch {
    pub fn new(dictionary: &Prepared, block: usize) -> Scratch {
        let chunks = dictionary.signal_len().div_ceil(16);
        let slot = || Slot {
            state: Box::new(State::new()),
            signal: 0,
            entering: Newcomer { atom: 0, at: 0, lane: 0 },
            lambda: 0.0,
            threshold: 0.0,
            norm: 0.0,
            goal: 0.0,
        };
        let finished = || Finished { gap: 0.0, iterations: 0, ended: Ended::Stalled };
        Scratch {
            correlations: vec![Chunk::ZERO; block.next_multiple_of(GROUP) * dictionary.width()],
            slots: (0..if dictionary.width() > near::FEW { NEAR_BATCH } else { BATCH }).map(|_| slot()).collect(),
            large: Box::new(State::new()),
            peaks: vec![Chunk::ZERO; dictionary.width().div_ceil(16)],
            padded: vec![Chunk::ZERO; block * chunks],
            residual: vec![[0.0; 16]; chunks],
            solved: (0..block)
                .map(|_| Solved { entries: Vec::with_capacity(64), lambda: 0.0, finished: finished() })
                .collect(),
        }
    }
}

/// A block of signals (rows of m values), appended to `codes`.
pub(super) struct Fast<'a> {
    pub dictionary: &'a Prepared,
    pub signals: &'a [f32],
    pub options: &'a Options,
    pub scratch: &'a mut Scratch,
    pub codes: &'a mut Codes,
}

impl Kernel for Fast<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        if self.dictionary.width() > near::FEW {
            self.run_with::<S, true>(lanes)
        } else {
            self.run_with::<S, false>(lanes)
        }
    }
}

impl Fast<'_> {
    #[inline(always)]
    fn run_with<S: Lanes, const NEAR_ROWS: bool>(self, lanes: S) {
        let Fast { dictionary, signals, options, scratch, codes } = self;
        let (m, width) = (dictionary.signal_len(), dictionary.width());
        let count = signals.len() / m;
        let Scratch { correlations, slots, large, peaks, padded, residual, solved } = scratch;
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
        product::correlate(lanes, dictionary, flat(padded), 16 * chunks, correlations);
        let mut task = active::Task {
            dictionary,
            lambda: 0.0,
            threshold: 0.0,
            nonnegative: options.nonnegative,
            keep_signs: true,
            max_rounds: u32::try_from(options.max_iterations).unwrap_or(u32::MAX),
        };
        // The first `live` slots are in work.
        let (mut live, mut next) = (0, 0);
        loop {
            if live == 0 {
                while live < slots.len() && next < count {
                    let row = &correlations[next * width..(next + 1) * width];
                    let signal = &padded[next * chunks..(next + 1) * chunks];
                    begin(lanes, &task, &mut slots[live], signal, row, peaks, options);
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
                let outside = match near::look::<S, 1, NEAR_ROWS>(lanes, &task, row, &mut slot.state, peaks) {
                    Next::Enter(newcomer) => {
                        slot.entering = newcomer;
                        at += 1;
                        continue;
                    }
                    Next::Over(End::Settled { outside }) => outside,
                    Next::Over(End::Full) => {
                        grown = true;
                        large.grow_from(&slot.state);
                        finish_large::<S, NEAR_ROWS>(lanes, &task, row, large, peaks)
                    }
                    Next::Over(_) => f32::INFINITY,
                };
                let signal = &padded[n * chunks..(n + 1) * chunks];
                let candidate = Candidate { outside, norm: slot.norm, goal: slot.goal, signal };
                let taken = if grown {
                    settle(lanes, &task, candidate, large, residual, &mut solved[n])
                } else {
                    settle(lanes, &task, candidate, &mut slot.state, residual, &mut solved[n])
                };
                if !taken {
                    codes.redone_in_f64 += 1;
                    redo(&task, &flat(signal)[..m], slot.goal, &mut solved[n]);
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
                if active::enter::<S, 1, NEAR_ROWS>(lanes, &task, row, &mut slot.state, slot.entering) {
                    at += 1;
                } else {
                    codes.redone_in_f64 += 1;
                    redo(&task, &signals[n * m..(n + 1) * m], slot.goal, &mut solved[n]);
                    live -= 1;
                    slots.swap(at, live);
                }
            }
        }
        for solved in &mut solved[..count] {
            push_sorted(codes, &solved.entries, solved.lambda, &solved.finished);
        }
    }
}

/// Goes on with a support that has outgrown its slot, to the end. The largest condition outside, or infinity.
#[inline(always)]
fn finish_large<S: Lanes, const NEAR_ROWS: bool>(
    lanes: S,
    task: &active::Task<'_>,
    correlations: &mut [Chunk],
    state: &mut State<LARGE>,
    peaks: &mut [Chunk],
) -> f32 {
    loop {
        match near::look::<S, LARGE, NEAR_ROWS>(lanes, task, correlations, state, peaks) {
            Next::Enter(newcomer) => {
                if !active::enter::<S, LARGE, NEAR_ROWS>(lanes, task, correlations, state, newcomer) {
                    return f32::INFINITY;
                }
            }
            Next::Over(End::Settled { outside }) => return outside,
            Next::Over(_) => return f32::INFINITY,
        }
    }
}

/// A block of signals by greedy pursuit of at most `most` non-zeros (at most 16), appended to `codes`.
pub(super) struct Greedy<'a> {
    pub dictionary: &'a Prepared,
    pub signals: &'a [f32],
    pub most: usize,
    pub scratch: &'a mut Scratch,
    /// Takes a signal that f32 cannot do: its place, its correlations.
    pub otherwise: &'a mut dyn FnMut(usize, &[Chunk], &mut Codes),
    pub codes: &'a mut Codes,
}

/// Most non-zeros that [`Greedy`] does.
pub(super) const MOST_GREEDY: usize = 16;

impl Kernel for Greedy<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        let Greedy { dictionary, signals, most, scratch, otherwise, codes } = self;
        let (m, width) = (dictionary.signal_len(), dictionary.width());
        let Scratch { correlations, slots, peaks, .. } = scratch;
        product::correlate(lanes, dictionary, signals, m, correlations);
        let Some(slot) = slots.first_mut() else { return };
        let most = most.min(m).min(dictionary.atom_count()).min(MOST_GREEDY);
        let task = active::Task {
            dictionary,
            lambda: 0.0,
            threshold: 0.0,
            nonnegative: false,
            keep_signs: false,
            max_rounds: u32::MAX,
        };
        for (n, (signal, row)) in signals.chunks_exact(m).zip(correlations.chunks_exact_mut(width)).enumerate() {
            let norm = signal.iter().map(|v| v * v).sum::<f32>().sqrt();
            slot.state.clear();
            let fits = norm == 0.0 || (1e-12..1e12).contains(&norm);
            if fits && omp::pursue(lanes, &task, row, most, 1e-6 * norm, &mut slot.state, peaks) {
                omp::take(dictionary, &slot.state, codes);
            } else {
                codes.redone_in_f64 += 1;
                otherwise(n, row, codes);
            }
        }
    }
}

/// A new signal's λ, threshold and goal.
#[inline(always)]
fn begin<S: Lanes>(
    lanes: S,
    task: &active::Task<'_>,
    slot: &mut Slot,
    signal: &[Chunk],
    correlations: &[Chunk],
    peaks: &mut [Chunk],
    options: &Options,
) {
    slot.state.clear();
    let mut energy = lanes.wide_splat(0.0);
    for part in signal {
        let v = lanes.wide(part);
        energy = lanes.wide_fma(v, v, energy);
    }
    let energy = lanes.wide_sum(energy);
    slot.norm = energy.sqrt();
    slot.lambda = match options.penalty {
        Penalty::Lambda(lambda) => lambda,
        Penalty::FractionOfMax(fraction) => fraction * near::largest(lanes, task, correlations, peaks),
        Penalty::NonZeros(_) => 0.0,
    };
    slot.threshold = (f64::from(slot.lambda) * (1.0 + 1e-6) + 4e-7 * slot.norm) as f32;
    slot.goal = options.tolerance * 0.5 * energy;
    if slot.lambda == 0.0 || !(slot.norm == 0.0 || (1e-12..1e12).contains(&slot.norm)) {
        // Beyond f32 squares, or nothing to hold the signs: straight to f64, by way of a certificate that fails.
        slot.threshold = f32::INFINITY;
        slot.norm = f64::INFINITY;
    }
}

/// What a settled support is judged by.
struct Candidate<'a> {
    /// The largest condition outside the support.
    outside: f32,
    /// ‖y‖.
    norm: f64,
    /// The gap to reach.
    goal: f64,
    /// The signal, padded with zeros.
    signal: &'a [Chunk],
}

/// Takes the answer when the certificate allows, if need be after a step of refinement.
#[inline(always)]
fn settle<S: Lanes, const C: usize>(
    lanes: S,
    task: &active::Task<'_>,
    candidate: Candidate<'_>,
    state: &mut State<C>,
    residual: &mut [[f64; 16]],
    solved: &mut Solved,
) -> bool {
    if candidate.norm == f64::INFINITY || candidate.outside == f32::INFINITY {
        return false;
    }
    for _ in 0..2 {
        let found = certify(lanes, task, &candidate, state, residual);
        if found <= candidate.goal {
            take(task.dictionary, state, &mut solved.entries);
            solved.lambda = task.lambda;
            solved.finished = Finished { gap: found, iterations: state.rounds, ended: Ended::Converged };
            return true;
        }
        if !state.refine() {
            return false;
        }
    }
    false
}

/// The entries, atoms as known outside and ascending.
#[inline(always)]
fn take<const C: usize>(dictionary: &Prepared, state: &State<C>, entries: &mut Vec<(u32, f32)>) {
    let n = state.n;
    entries.clear();
    let each = state.support().iter().zip(state.values());
    if n > 16 {
        entries.extend(each.map(|(&k, &v)| (dictionary.outside(k), v)));
        entries.sort_unstable_by_key(|e| e.0);
        return;
    }
    // Few: each goes where the count of smaller ones says, without branches.
    // Zeros go last; they are not passed on.
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

/// The gap of the code in `state`; leaves the errors of the support's conditions in `error`.
#[inline(always)]
fn certify<S: Lanes, const C: usize>(
    lanes: S,
    task: &active::Task<'_>,
    candidate: &Candidate<'_>,
    state: &mut State<C>,
    residual: &mut [[f64; 16]],
) -> f64 {
    let dictionary = task.dictionary;
    // |φ| = φ times its sign.
    let mut norm1 = lanes.wide_splat(0.0);
    for v in 0..C {
        norm1 = lanes.wide_fma(lanes.wide(&state.phi[v]), lanes.wide(&state.signs[v]), norm1);
    }
    let norm1 = lanes.wide_sum(norm1);
    let lambda = f64::from(task.lambda);
    let chunks = candidate.signal.len();
    let (yr, rr, mut largest) = match chunks {
        3 if S::WIDE => residual_in_registers::<S, C, 3>(lanes, task, candidate.signal, state, residual),
        4 if S::WIDE => residual_in_registers::<S, C, 4>(lanes, task, candidate.signal, state, residual),
        _ => {
            let mut sums = (lanes.wide_splat(0.0), lanes.wide_splat(0.0));
            let mut from = 0;
            while from + 2 <= chunks {
                residual_part::<S, C, 2>(lanes, dictionary, candidate.signal, from, state, residual, &mut sums);
                from += 2;
            }
            if from < chunks {
                residual_part::<S, C, 1>(lanes, dictionary, candidate.signal, from, state, residual, &mut sums);
            }
            let mut largest = 0.0f64;
            for member in 0..state.n {
                let c = gap::dot(lanes, dictionary.padded_atom(state.support()[member] as usize), residual);
                largest = state.judge(task, member, c, largest);
            }
            (lanes.wide_sum(sums.0), lanes.wide_sum(sums.1), largest)
        }
    };
    // Rounding of the f32 correlations outside the support; where it could matter they are computed anew.
    let m = dictionary.signal_len() as f64;
    let terms = state.n as f64;
    let rounding = 6e-8 * ((m + 2.0) * candidate.norm + (m + terms + 4.0) * norm1);
    if f64::from(candidate.outside) + rounding > lambda {
        for k in 0..dictionary.atom_count() {
            let c = gap::dot(lanes, dictionary.padded_atom(k), residual);
            largest = largest.max(if task.nonnegative { c } else { c.abs() });
        }
    }
    gap::certify(yr, rr, norm1, lambda, largest)
}

/// Puts y − Dᵀφ into `residual` and judges the members by it, for signals of `B` chunks: y·r, r·r, the largest |c| (or c).
#[inline(always)]
fn residual_in_registers<S: Lanes, const C: usize, const B: usize>(
    lanes: S,
    task: &active::Task<'_>,
    signal: &[Chunk],
    state: &mut State<C>,
    residual: &mut [[f64; 16]],
) -> (f64, f64, f64) {
    let mut sums = (lanes.wide_splat(0.0), lanes.wide_splat(0.0));
    let r = residual_part::<S, C, B>(lanes, task.dictionary, signal, 0, state, residual, &mut sums);
    let mut largest = 0.0f64;
    for member in 0..state.n {
        let atom = &task.dictionary.padded_atom(state.support()[member] as usize)[..B];
        let mut sum = lanes.wide_splat(0.0);
        for i in 0..B {
            sum = lanes.wide_fma(lanes.wide(&atom[i]), r[i], sum);
        }
        largest = state.judge(task, member, lanes.wide_sum(sum), largest);
    }
    (lanes.wide_sum(sums.0), lanes.wide_sum(sums.1), largest)
}

/// Puts y − Dᵀφ of `B` chunks into `residual` and gives it; adds to the sums of y·r and r·r.
#[inline(always)]
fn residual_part<S: Lanes, const C: usize, const B: usize>(
    lanes: S,
    dictionary: &Prepared,
    signal: &[Chunk],
    from: usize,
    state: &State<C>,
    residual: &mut [[f64; 16]],
    sums: &mut (S::D, S::D),
) -> [S::D; B] {
    let signal = &signal[from..][..B];
    let mut r = [lanes.wide_splat(0.0); B];
    for i in 0..B {
        r[i] = lanes.wide(&signal[i]);
    }
    for (&k, &v) in state.support().iter().zip(state.values()) {
        let atom = &dictionary.padded_atom(k as usize)[from..][..B];
        let v = lanes.wide_splat(-f64::from(v));
        for i in 0..B {
            r[i] = lanes.wide_fma(v, lanes.wide(&atom[i]), r[i]);
        }
    }
    let residual = &mut residual[from..][..B];
    for i in 0..B {
        sums.0 = lanes.wide_fma(lanes.wide(&signal[i]), r[i], sums.0);
        sums.1 = lanes.wide_fma(r[i], r[i], sums.1);
        lanes.wide_store(&mut residual[i], r[i]);
    }
    r
}

/// In f64 from scratch.
#[inline(never)]
fn redo(task: &active::Task<'_>, signal: &[f32], goal: f64, solved: &mut Solved) {
    let signal: Vec<f64> = signal.iter().map(|&v| f64::from(v)).collect();
    let answer = exact::solve(&exact::Task {
        dictionary: task.dictionary,
        seen: Seen::Whole,
        signal: &signal,
        lambda: f64::from(task.lambda),
        goal,
        max_rounds: task.max_rounds,
        nonnegative: task.nonnegative,
    });
    solved.entries.clear();
    let entries = answer.support.iter().zip(&answer.values);
    solved.entries.extend(entries.map(|(&k, &v)| (task.dictionary.outside(k), v as f32)));
    solved.entries.sort_unstable_by_key(|e| e.0);
    solved.lambda = task.lambda;
    solved.finished = answer.finished;
}
