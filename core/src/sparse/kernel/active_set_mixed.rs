//! Ends what the f32 active set could not: the same rounds, from the support that f32 had reached, in mixed precision.
//!
//! Every round computes the residual r = y − Dᵀφ in f64, scales it to norm one, and looks for the most violated
//! condition |dᵀr| ≤ λ in f32, whose rounding is then relative to ‖r‖ and not to ‖y‖. The support (values, signs, the
//! inverse of its Gram matrix) is f64. Conditions within the rounding bound of λ, and those of the support, are computed
//! in f64 when no other is violated; so is the duality gap. Errors come from the residual each time, so rounding of the
//! inverse does not accumulate.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::active_set_f64::gap_in_span;
use super::gap;
use super::product::correlate_one;
use super::simd::{Chunk, Kernel, Lanes, flat, flat_mut};
use super::support_f64::{Added, Support};
use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished};

/// Corrections of the values in a row, without an atom to enter, after which a solve ends.
///
/// Source: chosen; one is enough unless the inverse has lost its accuracy.
const MOST_CORRECTIONS: u32 = 4;

/// The correction in a row for which the inverse is made anew in f64.
///
/// Source: chosen.
const SURE_CORRECTION: u32 = 2;

/// One signal's problem, and where the f32 active set stopped.
pub(crate) struct MixedProblem<'a> {
    pub dictionary: &'a Prepared,
    /// The signal, padded with zeros to whole chunks.
    pub signal: &'a [Chunk],
    pub lambda: f64,
    /// The λ to begin with, at least `lambda`.
    pub first_lambda: f64,
    /// By which each step divides it.
    pub factor: f64,
    /// The gap to reach.
    pub goal: f64,
    pub rounds: u32,
    pub max_rounds: u32,
    pub nonnegative: bool,
    /// Atoms (by their internal number) and values to start from, in any order.
    pub start: &'a [(u32, f32)],
}

/// Scratch of one thread.
#[derive(Default)]
pub(crate) struct MixedScratch {
    pub support: Support,
    residual: Vec<[f64; 16]>,
    /// The residual scaled to norm one.
    scaled: Vec<Chunk>,
    /// Its inner products with all atoms.
    correlations: Vec<Chunk>,
    /// An orthonormal basis of the span of all atoms, for λ = 0; empty until it is needed.
    pub span: Vec<Vec<f64>>,
}

/// A solve on lanes. None where only the f64 solver can go on; the code is in `scratch.support`.
pub(crate) struct SolveMixed<'a> {
    pub problem: MixedProblem<'a>,
    pub scratch: &'a mut MixedScratch,
}

/// The residual of a round, and what its conditions are measured by.
struct Residual {
    /// y·r.
    yr: f64,
    /// ‖r‖².
    rr: f64,
    norm: f64,
    /// The largest |dᵀr| (or dᵀr) of all atoms is at most this.
    bound: f64,
    /// The atom outside the support with the largest, as f32 finds it.
    entering: Option<(u32, f64)>,
    /// What an inner product in f32 can be wrong by.
    rounding: f64,
}

impl Kernel for SolveMixed<'_> {
    type Out = Option<Finished>;
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) -> Option<Finished> {
        let SolveMixed { problem, scratch } = self;
        let without_penalty = problem.lambda == 0.0;
        if without_penalty && problem.nonnegative {
            return None;
        }
        scratch.start(lanes, &problem);
        let mut energy = lanes.wide_splat(0.0);
        for y in problem.signal {
            energy = lanes.wide_fma(lanes.wide(y), lanes.wide(y), energy);
        }
        let energy = lanes.wide_sum(energy);
        let keep_signs = !without_penalty;
        let (mut rounds, mut quiet, mut restarted) = (problem.rounds, 0, false);
        // That of the steps down to the problem's λ.
        let mut lambda = problem.first_lambda.max(problem.lambda);
        let finished =
            |gap, rounds, ended| Some(Finished { gap, lambda: problem.lambda as f32, iterations: rounds, ended });
        scratch.find_residual(lanes, &problem);
        if !scratch.support.is_empty() {
            scratch.record_errors(lanes, &problem, lambda);
            if !scratch.support.correct_values(lanes, keep_signs) {
                return None;
            }
            scratch.find_residual(lanes, &problem);
        }
        loop {
            let found = scratch.price(lanes, &problem);
            // Worse than no code at all: the inverse has lost its accuracy. Once more from nothing.
            let objective = 0.5 * found.rr + problem.lambda * scratch.support.norm1();
            if objective.is_nan() || objective > 0.5005 * energy {
                if restarted || rounds >= problem.max_rounds {
                    return None;
                }
                restarted = true;
                scratch.support.clear();
                scratch.find_residual(lanes, &problem);
                lambda = (energy.sqrt() / problem.factor).max(problem.lambda);
                continue;
            }
            let entering = found.entering.filter(|e| e.1.abs() > lambda + found.rounding);
            if entering.is_none() && lambda > problem.lambda {
                lambda = (lambda / problem.factor).max(problem.lambda);
                scratch.find_residual(lanes, &problem);
                scratch.record_errors(lanes, &problem, lambda);
                if !scratch.support.correct_values(lanes, keep_signs) {
                    return None;
                }
                scratch.find_residual(lanes, &problem);
                continue;
            }
            let gap_for = |largest: f64, scratch: &MixedScratch| {
                if without_penalty {
                    gap_in_span(&scratch.span, scratch.residual.as_flattened())
                } else {
                    gap::duality_gap(found.yr, found.rr, scratch.support.norm1(), problem.lambda, largest)
                }
            };
            let at_most = gap_for(found.bound, scratch);
            if at_most <= problem.goal {
                return finished(at_most, rounds, Ended::Converged);
            }
            let mut entering = entering.map(|e| e.0);
            let mut sure = f64::INFINITY;
            if entering.is_none() || rounds >= problem.max_rounds {
                let (largest, nearest) = scratch.check_closely(lanes, &problem, &found);
                sure = gap_for(largest, scratch);
                if sure <= problem.goal {
                    return finished(sure, rounds, Ended::Converged);
                }
                if rounds >= problem.max_rounds {
                    return finished(sure, rounds, Ended::IterationCap);
                }
                entering = entering.or(nearest);
            }
            rounds += 1;
            let moved = match entering {
                Some(atom) => {
                    quiet = 0;
                    scratch.enter(lanes, &problem, atom, lambda, keep_signs)
                }
                None if quiet < MOST_CORRECTIONS => {
                    quiet += 1;
                    if quiet == SURE_CORRECTION {
                        scratch.support.make_exact(lanes, problem.dictionary);
                        scratch.find_residual(lanes, &problem);
                        scratch.record_errors(lanes, &problem, problem.lambda);
                    }
                    let moved = scratch.support.correct_values(lanes, keep_signs);
                    scratch.find_residual(lanes, &problem);
                    moved
                }
                // Rounding of f64 ends it; the f64 solver gets no further.
                None if sure <= 1e-10 * energy => return finished(sure, rounds, Ended::Stalled),
                None => false,
            };
            if !moved {
                return None;
            }
        }
    }
}

impl MixedScratch {
    /// Takes over where f32 stopped: members whose value has a sign, as far as they are independent.
    #[inline(always)]
    fn start<S: Lanes>(&mut self, lanes: S, problem: &MixedProblem<'_>) {
        self.support.clear_for(problem.start.len(), problem.dictionary.signal_len());
        self.residual.resize(problem.signal.len(), [0.0; 16]);
        self.scaled.resize(problem.signal.len(), Chunk::ZERO);
        self.correlations.resize(problem.dictionary.width(), Chunk::ZERO);
        for &(atom, value) in problem.start {
            if value.is_finite() && value != 0.0 {
                self.support.take(lanes, problem.dictionary, atom, f64::from(value));
            }
        }
    }

    #[inline(always)]
    fn record_errors<S: Lanes>(&mut self, lanes: S, problem: &MixedProblem<'_>, lambda: f64) -> f64 {
        self.support.record_errors(lanes, problem.dictionary, &self.residual, lambda, problem.nonnegative)
    }

    /// The residual of the values.
    #[inline(always)]
    fn find_residual<S: Lanes>(&mut self, lanes: S, problem: &MixedProblem<'_>) {
        self.support.subtract_fit(lanes, problem.dictionary, problem.signal, &mut self.residual);
    }

    /// An atom enters, the values move to the new minimum, and the residual with them.
    #[inline(always)]
    fn enter<S: Lanes>(
        &mut self,
        lanes: S,
        problem: &MixedProblem<'_>,
        atom: u32,
        lambda: f64,
        keep_signs: bool,
    ) -> bool {
        let c = gap::inner_product(lanes, problem.dictionary.padded_atom(atom as usize), &self.residual);
        let error = c - lambda * 1.0f64.copysign(c);
        match self.support.add(lanes, problem.dictionary, atom, error, keep_signs) {
            Added::Failed => return false,
            Added::Along(step) => {
                for (r, along) in self.residual.iter_mut().zip(self.support.rest()) {
                    let sum = lanes.wide_fma(lanes.wide_splat(-step), lanes.wide_load(along), lanes.wide_load(r));
                    lanes.wide_store(r, sum);
                }
            }
            Added::Otherwise => self.find_residual(lanes, problem),
        }
        true
    }

    /// Inner products of the residual with all atoms in f32.
    #[inline(always)]
    fn price<S: Lanes>(&mut self, lanes: S, problem: &MixedProblem<'_>) -> Residual {
        let (mut yr, mut rr) = (lanes.wide_splat(0.0), lanes.wide_splat(0.0));
        for (r, y) in self.residual.iter().zip(problem.signal) {
            let r = lanes.wide_load(r);
            yr = lanes.wide_fma(lanes.wide(y), r, yr);
            rr = lanes.wide_fma(r, r, rr);
        }
        let (yr, rr) = (lanes.wide_sum(yr), lanes.wide_sum(rr));
        let norm = rr.sqrt();
        let scale = if norm > 0.0 { 1.0 / norm } else { 0.0 };
        for (to, from) in self.scaled.iter_mut().zip(&self.residual) {
            for lane in 0..16 {
                to.0[lane] = (from[lane] * scale) as f32;
            }
        }
        correlate_one(lanes, problem.dictionary.panels(), flat(&self.scaled), &mut self.correlations);
        let mut inside = 0.0f32;
        let correlations = flat_mut(&mut self.correlations);
        for (atom, _) in self.support.members() {
            let c = &mut correlations[atom as usize];
            inside = inside.max(if problem.nonnegative { *c } else { c.abs() });
            // Greater than nothing.
            *c = f32::NAN;
        }
        // The largest outside, with its chunk; of these numbers f32 holds all.
        let mut most = (lanes.splat(0.0), lanes.splat(0.0));
        for (chunk, c) in self.correlations.iter().enumerate() {
            let c = lanes.load(c);
            most =
                lanes.keep_larger(most, if problem.nonnegative { c } else { lanes.abs(c) }, lanes.splat(chunk as f32));
        }
        let (outside, chunk, lane) = lanes.largest(most);
        // Each of m products and sums is rounded once, relative to sums of at most the product of the norms, as are the
        // values of the scaled residual.
        let rounding = 6e-8 * (problem.dictionary.signal_len() + 3) as f64 * 1.001 * norm;
        let entering = (outside > 0.0).then(|| ((16.0 * chunk) as u32 + lane as u32, f64::from(outside) * norm));
        Residual { yr, rr, norm, bound: f64::from(inside.max(outside)) * norm + rounding, entering, rounding }
    }

    /// With conditions near λ, and those of the support, in f64: the largest |c| (or c), and the most violating atom
    /// outside the support. Records the errors of the support.
    #[inline(always)]
    fn check_closely<S: Lanes>(
        &mut self,
        lanes: S,
        problem: &MixedProblem<'_>,
        found: &Residual,
    ) -> (f64, Option<u32>) {
        self.find_residual(lanes, problem);
        let mut largest = self.record_errors(lanes, problem, problem.lambda);
        let mut nearest = None;
        let mut most = problem.lambda * (1.0 + 1e-12) + 1e-14 * found.norm;
        let level = ((problem.lambda - found.rounding) / found.norm.max(f64::MIN_POSITIVE)) as f32;
        for (chunk, c) in self.correlations.iter().enumerate() {
            let c = lanes.load(c);
            let mut mask = lanes.above(if problem.nonnegative { c } else { lanes.abs(c) }, level);
            while mask != 0 {
                let atom = 16 * chunk + mask.trailing_zeros() as usize;
                mask &= mask - 1;
                if atom >= problem.dictionary.atom_count() {
                    continue;
                }
                let c = gap::inner_product(lanes, problem.dictionary.padded_atom(atom), &self.residual);
                let size = if problem.nonnegative { c } else { c.abs() };
                largest = largest.max(size);
                if size > most {
                    (most, nearest) = (size, Some(atom as u32));
                }
            }
        }
        (largest, nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::kernel::simd::dispatch;
    use crate::sparse::prepared::prepare;

    /// From no support at all, and with a goal that cannot be reached.
    #[test]
    fn mixed_precision_starts_from_nothing_and_ends_at_its_rounding() {
        let h = 0.75f32.sqrt();
        let dictionary = prepare(ndarray::arr2(&[[1.0, 0.0], [-0.5, h]]).view()).unwrap();
        let mut signal = [Chunk::ZERO];
        (signal[0].0[0], signal[0].0[1]) = (1.0, 0.7);
        for (goal, ended) in [(1e-12, Ended::Converged), (-1.0, Ended::Stalled)] {
            let problem = MixedProblem {
                dictionary: &dictionary,
                signal: &signal,
                lambda: 0.05,
                first_lambda: 0.05,
                factor: 10.0,
                goal,
                rounds: 0,
                max_rounds: 100,
                nonnegative: false,
                start: &[],
            };
            let mut scratch = MixedScratch::default();
            let found = dispatch(dictionary.simd(), SolveMixed { problem, scratch: &mut scratch }).unwrap();
            assert_eq!(found.ended, ended);
            assert!(found.gap < 1e-12 && found.iterations < 10, "{found:?}");
            // b − λθ = (0.95, 0.106 − 0.05), by 4/3 (1, 1/2; 1/2, 1).
            let b = [0.95, 0.7 * f64::from(h) - 0.5 - 0.05];
            for (atom, value) in scratch.support.members() {
                let own = dictionary.outside(atom) as usize;
                let expected = 4.0 / 3.0 * (b[own] + 0.5 * b[1 - own]);
                assert!((value - expected).abs() < 1e-6, "{own}: {value} {expected}");
            }
            assert_eq!(scratch.support.members().count(), 2);
        }
    }
}
