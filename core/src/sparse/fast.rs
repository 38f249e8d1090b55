//! The default solver of a block of signals: D y as one product, the f32 active set, the f64 certificate, f64 where needed.
//!
//! A few signals are in work at once and take turns, so that the processor has something to do while one of them waits
//! for memory or for a chain of additions. They do not touch each other's numbers.

use super::active::{self, End, Next, State};
use super::exact::{self, Seen};
use super::prepared::Prepared;
use super::product::{self, GROUP};
use super::simd::{Chunk, Kernel, Lanes};
use super::solve::{Finished, push};
use super::{Codes, Ended, Options, Penalty, gap};

/// Signals in work at once.
const SLOTS: usize = 2;

/// Scratch of one thread.
pub(super) struct Scratch {
    pub interleaved: Vec<[f32; GROUP]>,
    pub correlations: Vec<Chunk>,
    slots: Vec<Slot>,
    signal: Vec<[f64; 16]>,
    residual: Vec<[f64; 16]>,
    error: Vec<f32>,
    solved: Vec<Solved>,
}

/// A signal in work.
struct Slot {
    state: State,
    /// Which signal of the block; none when there is no work left.
    signal: Option<usize>,
    entering: Option<active::Newcomer>,
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
            state: State::new(dictionary),
            signal: None,
            entering: None,
            lambda: 0.0,
            threshold: 0.0,
            norm: 0.0,
            goal: 0.0,
        };
        let finished = || Finished { gap: 0.0, iterations: 0, ended: Ended::Stalled };
        Scratch {
            interleaved: Vec::new(),
            correlations: vec![Chunk::ZERO; block.next_multiple_of(GROUP) * dictionary.width()],
            slots: (0..SLOTS).map(|_| slot()).collect(),
            signal: vec![[0.0; 16]; chunks],
            residual: vec![[0.0; 16]; chunks],
            error: Vec::new(),
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
        if self.dictionary.width() > 16 { self.run_near::<S, 8>(lanes) } else { self.run_near::<S, 4>(lanes) }
    }
}

impl Fast<'_> {
    /// With `W` chunks of atoms near.
    #[inline(always)]
    fn run_near<S: Lanes, const W: usize>(self, lanes: S) {
        let Fast { dictionary, signals, options, scratch, codes } = self;
        let (m, width) = (dictionary.signal_len(), dictionary.width());
        let count = signals.len() / m;
        product::interleave(signals.chunks_exact(m), m, &mut scratch.interleaved);
        product::correlate(lanes, dictionary, &scratch.interleaved, &mut scratch.correlations);
        let Scratch { correlations, slots, signal: wide, residual, error, solved, .. } = scratch;
        let mut next = 0;
        let mut task = active::Task {
            dictionary,
            lambda: 0.0,
            threshold: 0.0,
            nonnegative: options.nonnegative,
            max_rounds: u32::try_from(options.max_iterations).unwrap_or(u32::MAX),
        };
        loop {
            let mut busy = false;
            for slot in slots.iter_mut() {
                slot.entering = None;
                let n = match slot.signal {
                    Some(n) => n,
                    None if next < count => {
                        let n = next;
                        next += 1;
                        let row = &correlations[n * width..(n + 1) * width];
                        begin(lanes, &task, slot, &signals[n * m..(n + 1) * m], row, options);
                        slot.signal = Some(n);
                        n
                    }
                    None => continue,
                };
                busy = true;
                (task.lambda, task.threshold) = (slot.lambda, slot.threshold);
                let row = &correlations[n * width..(n + 1) * width];
                let signal = &signals[n * m..(n + 1) * m];
                let end = match active::look::<S, W>(lanes, &task, row, &mut slot.state) {
                    Next::Enter(j) => {
                        slot.entering = Some(j);
                        continue;
                    }
                    Next::Over(end) => end,
                };
                widen(signal, wide);
                if !settle(&task, end, slot, wide, residual, error, &mut solved[n]) {
                    codes.redone_in_f64 += 1;
                    redo(&task, signal, slot.goal, &mut solved[n]);
                }
                slot.signal = None;
            }
            if !busy {
                break;
            }
            for slot in slots.iter_mut() {
                let (Some(j), Some(n)) = (slot.entering, slot.signal) else { continue };
                (task.lambda, task.threshold) = (slot.lambda, slot.threshold);
                let row = &mut correlations[n * width..(n + 1) * width];
                if !active::enter::<S, W>(lanes, &task, row, &mut slot.state, j) {
                    codes.redone_in_f64 += 1;
                    redo(&task, &signals[n * m..(n + 1) * m], slot.goal, &mut solved[n]);
                    slot.signal = None;
                }
            }
        }
        for solved in &mut solved[..count] {
            push(codes, dictionary, &mut solved.entries, solved.lambda, &solved.finished);
        }
    }
}

/// A new signal's λ, threshold and goal.
#[inline(always)]
fn begin<S: Lanes>(
    lanes: S,
    task: &active::Task<'_>,
    slot: &mut Slot,
    signal: &[f32],
    correlations: &[Chunk],
    options: &Options,
) {
    slot.state.clear();
    let mut energy = [0.0f64; 16];
    for part in signal.chunks(16) {
        for (e, &v) in energy.iter_mut().zip(part) {
            *e = f64::from(v).mul_add(f64::from(v), *e);
        }
    }
    let energy = gap::sum(&energy);
    slot.norm = energy.sqrt();
    slot.lambda = match options.penalty {
        Penalty::Lambda(lambda) => lambda,
        Penalty::FractionOfMax(fraction) => fraction * active::largest(lanes, task, correlations, &mut slot.state),
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

#[inline(always)]
fn widen(signal: &[f32], wide: &mut [[f64; 16]]) {
    for (wide, part) in wide.iter_mut().zip(signal.chunks(16)) {
        for (w, &v) in wide.iter_mut().zip(part) {
            *w = f64::from(v);
        }
    }
}

/// Takes the answer when the certificate allows, if need be after a step of refinement.
#[inline(always)]
fn settle(
    task: &active::Task<'_>,
    end: End,
    slot: &mut Slot,
    signal: &[[f64; 16]],
    residual: &mut [[f64; 16]],
    error: &mut Vec<f32>,
    solved: &mut Solved,
) -> bool {
    let End::Settled { outside } = end else { return false };
    if slot.norm == f64::INFINITY {
        return false;
    }
    for _ in 0..2 {
        let found = certify(task, outside, slot.norm, &slot.state, signal, residual, error);
        if found <= slot.goal {
            let state = &slot.state;
            solved.entries.clear();
            solved.entries.extend(state.support.iter().copied().zip(state.values().iter().copied()));
            solved.lambda = task.lambda;
            solved.finished = Finished { gap: found, iterations: state.rounds, ended: Ended::Converged };
            return true;
        }
        slot.state.refine(error);
        if slot.state.values().iter().zip(slot.state.signs()).any(|(&v, &s)| v * s < 0.0) {
            return false;
        }
    }
    false
}

/// The gap of the code in `state`; leaves the errors of the support's conditions in `error`.
#[inline(always)]
fn certify(
    task: &active::Task<'_>,
    outside: f32,
    norm: f64,
    state: &State,
    signal: &[[f64; 16]],
    residual: &mut [[f64; 16]],
    error: &mut Vec<f32>,
) -> f64 {
    let dictionary = task.dictionary;
    let norm1: f64 = state.values().iter().map(|v| f64::from(v.abs())).sum();
    let (mut yr, mut rr) = ([0.0f64; 16], [0.0f64; 16]);
    for (at, (y, out)) in signal.iter().zip(residual.iter_mut()).enumerate() {
        let mut r = *y;
        for (&k, &v) in state.support.iter().zip(state.values()) {
            let atom = &dictionary.padded_atom(k as usize)[at].0;
            let v = -f64::from(v);
            for i in 0..16 {
                r[i] = v.mul_add(f64::from(atom[i]), r[i]);
            }
        }
        for i in 0..16 {
            yr[i] = y[i].mul_add(r[i], yr[i]);
            rr[i] = r[i].mul_add(r[i], rr[i]);
        }
        *out = r;
    }
    let lambda = f64::from(task.lambda);
    let mut largest = 0.0f64;
    error.clear();
    for (&k, &sign) in state.support.iter().zip(state.signs()) {
        let c = gap::dot(dictionary.padded_atom(k as usize), residual);
        largest = largest.max(if task.nonnegative { c } else { c.abs() });
        error.push((c - lambda * f64::from(sign)) as f32);
    }
    // Rounding of the f32 correlations outside the support; where it could matter they are computed anew.
    let m = dictionary.signal_len() as f64;
    let terms = state.support.len() as f64;
    let rounding = 6e-8 * ((m + 2.0) * norm + (m + terms + 4.0) * norm1);
    if f64::from(outside) + rounding > lambda {
        for k in 0..dictionary.atom_count() {
            let c = gap::dot(dictionary.padded_atom(k), residual);
            largest = largest.max(if task.nonnegative { c } else { c.abs() });
        }
    }
    gap::certify(gap::sum(&yr), gap::sum(&rr), norm1, lambda, largest)
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
    solved.entries.extend(answer.support.iter().zip(&answer.values).map(|(&k, &v)| (k, v as f32)));
    solved.lambda = task.lambda;
    solved.finished = answer.finished;
}
