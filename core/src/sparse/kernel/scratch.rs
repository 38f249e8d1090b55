//! Scratch of one thread for the f32 kernels: correlations, the signals being solved, their results.

use super::active_set_mixed::MixedScratch;
use super::product::{GROUP, MAX_CHUNKS_SEARCHED_WHOLE};
use super::simd::Chunk;
use super::state::{Entering, LARGE_STATE_CHUNKS, State};
use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished};

/// Signals processed at once where every round searches all atoms. They start together and go through their rounds
/// together, so that branches can be predicted; the next start when all are finished.
///
/// Source: measured; four lose 3 % to the first cache (docs/sparse-coding.md).
const BATCH: usize = 3;
/// As [`BATCH`], where rounds search candidate chunks.
///
/// Source: measured.
const BATCH_WITH_CANDIDATES: usize = 2;
/// Scratch of one thread.
pub(crate) struct Scratch {
    pub correlations: Vec<Chunk>,
    pub slots: Vec<Slot>,
    /// For a support that outgrows that of its slot.
    pub large: Box<State<LARGE_STATE_CHUNKS>>,
    pub peaks: Vec<Chunk>,
    /// Signals, each padded with zeros to whole chunks.
    pub padded: Vec<Chunk>,
    pub residual: Vec<[f64; 16]>,
    pub solved: Vec<Solved>,
    /// Signals that f32 did not solve.
    pub unfinished: Vec<Unfinished>,
    pub mixed: MixedScratch,
}

/// A signal being solved.
pub(crate) struct Slot {
    pub state: Box<State<1>>,
    /// Which signal of the block.
    pub signal: usize,
    pub entering: Entering,
    /// λ of the problem.
    pub wanted: f32,
    /// λ of the rounds in f32, at least `wanted`.
    pub lambda: f32,
    pub threshold: f32,
    pub norm: f64,
    pub goal: f64,
}

/// A signal that f32 did not solve; the support that it had reached is in the entries of its [`Solved`].
pub(crate) struct Unfinished {
    /// Which signal of the block.
    pub signal: usize,
    pub lambda: f32,
    /// The λ to go on from, at least `lambda`.
    pub first_lambda: f64,
    /// The gap to reach.
    pub goal: f64,
    /// Rounds so far.
    pub rounds: u32,
}

/// A signal's result, kept until those of all earlier signals are ready.
pub(crate) struct Solved {
    pub entries: Vec<(u32, f32)>,
    pub finished: Finished,
}

impl Scratch {
    pub fn new(dictionary: &Prepared, block: usize) -> Scratch {
        let chunks = dictionary.signal_len().div_ceil(16);
        let slot = || Slot {
            state: Box::new(State::new()),
            signal: 0,
            entering: Entering { atom: 0, at: 0, lane: 0 },
            wanted: 0.0,
            lambda: 0.0,
            threshold: 0.0,
            norm: 0.0,
            goal: 0.0,
        };
        let batch = if dictionary.width() > MAX_CHUNKS_SEARCHED_WHOLE { BATCH_WITH_CANDIDATES } else { BATCH };
        let finished = Finished { gap: 0.0, lambda: 0.0, iterations: 0, ended: Ended::Stalled };
        Scratch {
            correlations: vec![Chunk::ZERO; block.next_multiple_of(GROUP) * dictionary.width()],
            slots: (0..batch).map(|_| slot()).collect(),
            large: Box::new(State::new()),
            peaks: vec![Chunk::ZERO; dictionary.width().div_ceil(16)],
            padded: vec![Chunk::ZERO; block * chunks],
            residual: vec![[0.0; 16]; chunks],
            solved: (0..block).map(|_| Solved { entries: Vec::with_capacity(64), finished }).collect(),
            unfinished: Vec::new(),
            mixed: MixedScratch::default(),
        }
    }
}
