//! One signal's state in the f32 active set: its support, values and signs, and the explicit inverse of the support's
//! Gram matrix.

use super::simd::{Chunk, flat, flat_mut};
use crate::sparse::prepared::Prepared;

/// Chunks of candidate atoms that a round searches where there are too many atoms to search all.
///
/// Source: measured; eight chunks of the members' Gram rows fit the first cache.
pub(crate) const CANDIDATE_CHUNKS: usize = 8;

/// Chunks of the large state: supports of up to 128 atoms; larger ones are solved in f64.
///
/// Source: chosen.
pub(crate) const LARGE_STATE_CHUNKS: usize = 8;

/// One signal's problem, as the rounds need it.
pub(crate) struct Task<'a> {
    pub dictionary: &'a Prepared,
    pub lambda: f32,
    /// Atoms enter above this (λ and what rounding can add).
    pub threshold: f32,
    pub nonnegative: bool,
    /// Whether atoms whose coefficient would change sign leave; not in greedy pursuit.
    pub keep_signs: bool,
    pub max_rounds: u32,
}

/// The state of one signal, for up to 16·C members of the support; C is a power of two, so that masks keep places
/// inside.
pub(crate) struct State<const C: usize> {
    /// Places in use: all members of the support are before this one. A place whose member left keeps its atom, with a
    /// value of zero.
    pub n: usize,
    /// Bit i of number b says whether place 16·b + i has a member.
    pub used: [u16; C],
    pub rounds: u32,
    /// Atoms; places beyond the support hold an arbitrary one.
    pub support: [[u32; 16]; C],
    /// Where their Gram rows begin.
    pub rows: [[u32; 16]; C],
    /// Correlations D y of the members.
    pub signal_correlations: [[f32; 16]; C],
    /// This and all that follows, except `candidate_rows`, is zero beyond the support.
    pub phi: [Chunk; C],
    pub signs: [Chunk; C],
    /// Errors of the members' conditions, as the last certificate found them.
    pub error: [[f32; 16]; C],
    pub inverse: [[[Chunk; C]; 16]; C],
    /// The chunks of atoms that rounds search.
    pub candidates: [u32; CANDIDATE_CHUNKS],
    /// Those chunks of the members' Gram rows.
    pub candidate_rows: [[[Chunk; CANDIDATE_CHUNKS]; 16]; C],
    /// Whether `candidates` belongs to this signal.
    pub has_candidates: bool,
}

impl<const C: usize> State<C> {
    pub fn new() -> State<C> {
        State {
            n: 0,
            used: [0; C],
            rounds: 0,
            support: [[0; 16]; C],
            rows: [[0; 16]; C],
            signal_correlations: [[0.0; 16]; C],
            phi: [Chunk::ZERO; C],
            signs: [Chunk::ZERO; C],
            error: [[0.0; 16]; C],
            inverse: [[[Chunk::ZERO; C]; 16]; C],
            candidates: [0; CANDIDATE_CHUNKS],
            candidate_rows: [[[Chunk::ZERO; CANDIDATE_CHUNKS]; 16]; C],
            has_candidates: false,
        }
    }

    /// The first place without a member.
    #[inline(always)]
    pub fn free_place(&self) -> Option<usize> {
        let block = if C == 1 { 0 } else { self.used.iter().position(|&used| used != u16::MAX)? };
        let lane = self.used[block].trailing_ones() as usize;
        (lane < 16).then_some(block * 16 + lane)
    }

    /// The support, in the order of its values.
    #[inline(always)]
    pub fn support(&self) -> &[u32] {
        &self.support.as_flattened()[..self.n]
    }

    #[inline(always)]
    pub fn values(&self) -> &[f32] {
        &flat(&self.phi)[..self.n]
    }

    /// Records the error of a member's optimality condition, given its correlation `c` in f64. Returns the larger of
    /// `largest` and |c| (or c).
    #[inline(always)]
    pub fn record_condition(&mut self, task: &Task<'_>, member: usize, c: f64, largest: f64) -> f64 {
        let (block, place) = ((member / 16) & (C - 1), member & 15);
        self.error[block][place] = (c - f64::from(task.lambda) * f64::from(self.signs[block].0[place])) as f32;
        let size = if task.nonnegative { c } else { c.abs() };
        if size > largest { size } else { largest }
    }

    /// φ_S += G_SS⁻¹ ρ: one step of refinement for the errors ρ of the members' conditions. False when a sign changes.
    pub fn correct_values(&mut self) -> bool {
        for (row, &e) in self.inverse.as_flattened().iter().zip(self.error.as_flattened()).take(self.n) {
            for (p, &v) in flat_mut(&mut self.phi).iter_mut().zip(flat(row)) {
                *p += e * v;
            }
        }
        self.values().iter().zip(flat(&self.signs)).all(|(&v, &s)| v * s >= 0.0)
    }

    /// Empties the state for another signal.
    #[inline(always)]
    pub fn clear(&mut self) {
        let chunks = self.n.div_ceil(16);
        for row in &mut self.inverse.as_flattened_mut()[..self.n] {
            row[..chunks].fill(Chunk::ZERO);
        }
        self.phi[..chunks].fill(Chunk::ZERO);
        self.signs[..chunks].fill(Chunk::ZERO);
        self.n = 0;
        self.used = [0; C];
        self.rounds = 0;
        self.has_candidates = false;
    }

    /// Takes over the signal of a smaller state.
    pub fn grow_from(&mut self, small: &State<1>) {
        self.clear();
        self.n = small.n;
        self.used[0] = small.used[0];
        self.rounds = small.rounds;
        self.support[0] = small.support[0];
        self.rows[0] = small.rows[0];
        self.signal_correlations[0] = small.signal_correlations[0];
        self.phi[0] = small.phi[0];
        self.signs[0] = small.signs[0];
        for (to, from) in self.inverse[0].iter_mut().zip(&small.inverse[0]) {
            to[0] = from[0];
        }
        self.candidates = small.candidates;
        self.candidate_rows[0] = small.candidate_rows[0];
        self.has_candidates = small.has_candidates;
    }
}

/// The atom that enters the support.
#[derive(Clone, Copy)]
pub(crate) struct Entering {
    /// Its internal number.
    pub atom: usize,
    /// The place of its chunk among the candidates, or among all chunks where all are searched.
    pub at: usize,
    /// Its lane in that chunk.
    pub lane: usize,
}
