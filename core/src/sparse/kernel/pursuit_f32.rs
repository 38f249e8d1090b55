//! Orthogonal matching pursuit in f32 for supports of up to 16 atoms: greedy min ½‖y − Dᵀφ‖² with at most T non-zeros.
//!
//! Batch-OMP (Rubinstein et al. 2008) on the state of the active set with λ = 0: the atom most correlated with the
//! residual enters, and the rank-one step of the inverse Gram matrix refits all of them. What is too ill-conditioned
//! for f32 is left to the plain solver.

use super::candidate_search::search_all;
use super::product;
use super::scratch::Scratch;
use super::simd::{Chunk, Kernel, Lanes, flat};
use super::state::{Entering, State, Task};
use super::update::add_atom;
use crate::sparse::codes::Codes;
use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished};

/// A block of signals (rows of m values), coded with at most `most` non-zeros each, appended to `codes`.
pub(crate) struct PursuitBlock<'a> {
    pub dictionary: &'a Prepared,
    pub signals: &'a [f32],
    /// Most non-zeros, up to [`MAX_PURSUIT_NONZEROS`].
    pub most: usize,
    pub scratch: &'a mut Scratch,
    /// Codes a signal that f32 cannot code, given its place in the block and its correlations.
    pub otherwise: &'a mut dyn FnMut(usize, &[Chunk], &mut Codes),
    pub codes: &'a mut Codes,
}

/// Most non-zeros that [`PursuitBlock`] can find: the places of the small state.
pub(crate) const MAX_PURSUIT_NONZEROS: usize = 16;

impl Kernel for PursuitBlock<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        let PursuitBlock { dictionary, signals, most, scratch, otherwise, codes } = self;
        let (m, width) = (dictionary.signal_len(), dictionary.width());
        let Scratch { correlations, slots, peaks, .. } = scratch;
        product::correlate(lanes, dictionary.panels(), signals, m, correlations);
        let Some(slot) = slots.first_mut() else { return };
        let most = most.min(m).min(dictionary.atom_count()).min(MAX_PURSUIT_NONZEROS);
        let task = Task {
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
            if fits && pursue(lanes, &task, row, most, 1e-6 * norm, &mut slot.state, peaks) {
                push_code(dictionary, &slot.state, codes);
            } else {
                codes.redone_in_f64 += 1;
                otherwise(n, row, codes);
            }
        }
    }
}

/// One signal, until it has `most` non-zeros or no correlation of its residual is above `stop`. False where its
/// support is too ill-conditioned for f32.
#[inline(always)]
fn pursue<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    correlations: &mut [Chunk],
    most: usize,
    stop: f32,
    state: &mut State<C>,
    peaks: &mut [Chunk],
) -> bool {
    while state.n < most {
        let largest = search_all(lanes, task, correlations, state.support(), state.values(), peaks);
        if largest <= stop {
            break;
        }
        let Some(chunk) = flat(peaks).iter().position(|&p| p == largest) else { return false };
        state.candidates[0] = chunk as u32;
        let mut c = lanes.load(&correlations[chunk]);
        for member in 0..state.n {
            let part = task.dictionary.gram_chunks(state.support()[member] as usize)[chunk];
            c = lanes.fnma(lanes.splat(state.values()[member]), lanes.load(&part), c);
            state.candidate_rows.as_flattened_mut()[member][0] = part;
        }
        let lane = lanes.largest((lanes.abs(c), c)).2;
        let atom = chunk * 16 + lane;
        if state.support().contains(&(atom as u32)) {
            return false;
        }
        if !add_atom::<S, C, true>(lanes, task, correlations, state, Entering { atom, at: 0, lane }) {
            return false;
        }
    }
    true
}

/// Appends the code that [`pursue`] found.
#[inline(always)]
fn push_code<const C: usize>(dictionary: &Prepared, state: &State<C>, codes: &mut Codes) {
    let mut entries: Vec<(u32, f32)> = state.support().iter().copied().zip(state.values().iter().copied()).collect();
    let finished = Finished { gap: f64::NAN, lambda: 0.0, iterations: state.rounds, ended: Ended::Converged };
    codes.push_unsorted(dictionary, &mut entries, &finished);
}
