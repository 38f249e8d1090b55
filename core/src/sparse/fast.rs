//! The default solver of a block of signals: D y as one product, the f32 active set, the f64 certificate, f64 where needed.

use super::active::{self, End, State};
use super::exact::{self, Seen};
use super::prepared::Prepared;
use super::product::{self, GROUP};
use super::simd::{Chunk, Kernel, Lanes};
use super::solve::{Finished, push};
use super::{Codes, Ended, Options, Penalty, gap};

/// Scratch of one thread.
pub(super) struct Scratch {
    pub interleaved: Vec<[f32; GROUP]>,
    pub correlations: Vec<Chunk>,
    state: State,
    signal: Vec<[f64; 16]>,
    residual: Vec<[f64; 16]>,
    error: Vec<f32>,
    entries: Vec<(u32, f32)>,
}

impl Scratch {
    pub fn new(dictionary: &Prepared, block: usize) -> Scratch {
        let chunks = dictionary.signal_len().div_ceil(16);
        Scratch {
            interleaved: Vec::new(),
            correlations: vec![Chunk::ZERO; block.next_multiple_of(GROUP) * dictionary.width()],
            state: State::new(dictionary),
            signal: vec![[0.0; 16]; chunks],
            residual: vec![[0.0; 16]; chunks],
            error: Vec::new(),
            entries: Vec::new(),
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
        let Fast { dictionary, signals, options, scratch, codes } = self;
        let (m, width) = (dictionary.signal_len(), dictionary.width());
        product::interleave(signals.chunks_exact(m), m, &mut scratch.interleaved);
        product::correlate(lanes, dictionary, &scratch.interleaved, &mut scratch.correlations);
        for (n, signal) in signals.chunks_exact(m).enumerate() {
            solve_one(lanes, dictionary, signal, n * width, options, scratch, codes);
        }
    }
}

#[inline(always)]
fn solve_one<S: Lanes>(
    lanes: S,
    dictionary: &Prepared,
    signal: &[f32],
    at: usize,
    options: &Options,
    scratch: &mut Scratch,
    codes: &mut Codes,
) {
    let correlations = &mut scratch.correlations[at..at + dictionary.width()];
    let mut energy = 0.0;
    for (wide, part) in scratch.signal.iter_mut().zip(signal.chunks(16)) {
        for (w, &v) in wide.iter_mut().zip(part) {
            *w = f64::from(v);
        }
        energy += gap::sum(&std::array::from_fn(|i| wide[i] * wide[i]));
    }
    let norm = energy.sqrt();
    let lambda = match options.penalty {
        Penalty::Lambda(lambda) => lambda,
        Penalty::FractionOfMax(fraction) => fraction * active::largest(lanes, correlations, options.nonnegative),
        Penalty::NonZeros(_) => 0.0,
    };
    let goal = options.tolerance * 0.5 * energy;
    let max_rounds = u32::try_from(options.max_iterations).unwrap_or(u32::MAX);
    let task = active::Task {
        dictionary,
        lambda,
        threshold: (f64::from(lambda) * (1.0 + 1e-6) + 4e-7 * norm) as f32,
        nonnegative: options.nonnegative,
        max_rounds,
    };
    // Outside this range f32 squares over- or underflow.
    if lambda > 0.0 && (norm == 0.0 || (1e-12..1e12).contains(&norm)) {
        let end = active::solve(lanes, &task, correlations, &mut scratch.state);
        if let End::Settled { outside } = end {
            for _ in 0..2 {
                let found = certify(&task, outside, norm, scratch);
                if found <= goal {
                    let state = &scratch.state;
                    scratch.entries.clear();
                    scratch.entries.extend(state.support.iter().copied().zip(state.values().iter().copied()));
                    let finished = Finished { gap: found, iterations: state.rounds, ended: Ended::Converged };
                    return push(codes, &mut scratch.entries, lambda, &finished);
                }
                scratch.state.refine(&scratch.error);
                if scratch.state.values().iter().zip(scratch.state.signs()).any(|(&v, &s)| v * s < 0.0) {
                    break;
                }
            }
        }
        codes.redone_in_f64 += 1;
    }
    redo(dictionary, signal, lambda, goal, max_rounds, options.nonnegative, scratch, codes);
}

/// The gap of the code in `scratch.state`; leaves the errors of the support's conditions in `scratch.error`.
#[inline(always)]
fn certify(task: &active::Task<'_>, outside: f32, norm: f64, scratch: &mut Scratch) -> f64 {
    let dictionary = task.dictionary;
    let Scratch { state, signal, residual, error, .. } = scratch;
    residual.copy_from_slice(signal);
    let mut norm1 = 0.0;
    for (&k, &v) in state.support.iter().zip(state.values()) {
        norm1 += f64::from(v.abs());
        gap::subtract(residual, f64::from(v), dictionary.padded_atom(k as usize));
    }
    let (mut yr, mut rr) = (0.0, 0.0);
    for (y, r) in signal.iter().zip(residual.iter()) {
        yr += gap::sum(&std::array::from_fn(|i| y[i] * r[i]));
        rr += gap::sum(&std::array::from_fn(|i| r[i] * r[i]));
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
    gap::certify(yr, rr, norm1, lambda, largest)
}

/// In f64 from scratch.
#[allow(clippy::too_many_arguments)]
#[inline(never)]
fn redo(
    dictionary: &Prepared,
    signal: &[f32],
    lambda: f32,
    goal: f64,
    max_rounds: u32,
    nonnegative: bool,
    scratch: &mut Scratch,
    codes: &mut Codes,
) {
    let signal: Vec<f64> = signal.iter().map(|&v| f64::from(v)).collect();
    let answer = exact::solve(&exact::Task {
        dictionary,
        seen: Seen::Whole,
        signal: &signal,
        lambda: f64::from(lambda),
        goal,
        max_rounds,
        nonnegative,
    });
    scratch.entries.clear();
    scratch.entries.extend(answer.support.iter().zip(&answer.values).map(|(&k, &v)| (k, v as f32)));
    push(codes, &mut scratch.entries, lambda, &answer.finished);
}
