//! Orthogonal matching pursuit (Batch-OMP, Rubinstein et al. 2008): greedy min ½‖y − Dᵀφ‖² with at most T non-zeros.
//!
//! The plain way, in f64, and a fast one in f32 beside it. Each step takes the atom most correlated with the residual, then refits all of them by least squares, through a
//! Cholesky factor of the support's Gram matrix grown by a row a step. Work happens in correlations, not in residuals.

use super::active::{self, State};
use super::near::{self, Newcomer};
use super::prepared::Prepared;
use super::simd::{Chunk, Lanes};
use super::solve::{Finished, Problem, Work};
use super::{Codes, Ended};

/// One signal in f32, on the state of the active set with λ = 0 (the refit is the same rank-one step, signs left alone).
/// False where a support is too ill-conditioned for it: then [`solve`].
#[inline(always)]
pub(super) fn pursue<S: Lanes, const C: usize>(
    lanes: S,
    task: &active::Task<'_>,
    correlations: &mut [Chunk],
    most: usize,
    stop: f32,
    state: &mut State<C>,
    peaks: &mut [Chunk],
) -> bool {
    let (width, gram) = (task.dictionary.width(), task.dictionary.gram());
    while state.n < most {
        let largest = near::look_everywhere(lanes, task, correlations, state.support(), state.values(), peaks);
        if largest <= stop {
            break;
        }
        let Some(chunk) = super::simd::flat(peaks).iter().position(|&p| p == largest) else { return false };
        state.near[0] = chunk as u32;
        let mut c = lanes.load(&correlations[chunk]);
        for member in 0..state.n {
            let part = gram[state.support()[member] as usize * width + chunk];
            c = lanes.fnma(lanes.splat(state.values()[member]), lanes.load(&part), c);
            state.near_rows.as_flattened_mut()[member][0] = part;
        }
        let lane = lanes.largest((lanes.abs(c), c)).2;
        let atom = chunk * 16 + lane;
        if state.support().contains(&(atom as u32)) {
            return false;
        }
        if !active::enter::<S, C, true>(lanes, task, correlations, state, Newcomer { atom, at: 0, lane }) {
            return false;
        }
    }
    true
}

/// Appends what [`pursue`] found.
#[inline(always)]
pub(super) fn take<const C: usize>(dictionary: &Prepared, state: &State<C>, codes: &mut Codes) {
    let mut entries: Vec<(u32, f32)> = state.support().iter().copied().zip(state.values().iter().copied()).collect();
    let finished = Finished { gap: f64::NAN, iterations: state.rounds, ended: Ended::Converged };
    super::solve::push(codes, dictionary, &mut entries, 0.0, &finished);
}

/// Solves one signal.
pub(super) fn solve(problem: &Problem<'_>, work: &mut Work) -> Finished {
    work.clear_code();
    let dictionary = problem.dictionary;
    let most = problem.most.min(dictionary.signal_len()).min(dictionary.atom_count());
    work.gradient.copy_from_slice(problem.correlations);
    let energy: f64 = problem.signal.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
    let stop = (1e-6 * energy.sqrt()) as f32;
    let (mut factor, mut rhs) = (vec![0.0f64; most * most], vec![0.0f64; most]);
    let mut iterations = 0;
    while work.support.len() < most {
        let mut best = (stop, usize::MAX);
        for (j, &c) in work.gradient.iter().enumerate() {
            let size = if problem.nonnegative { c } else { c.abs() };
            if size > best.0 && !work.support.contains(&(j as u32)) {
                best = (size, j);
            }
        }
        let Some(row) = (best.1 != usize::MAX).then(|| dictionary.gram_row(best.1)) else { break };
        iterations += 1;
        // A row of the Cholesky factor for the new atom.
        let n = work.support.len();
        for i in 0..n {
            let mut v = f64::from(row[work.support[i] as usize]);
            for l in 0..i {
                v -= factor[i * most + l] * factor[n * most + l];
            }
            factor[n * most + i] = v / factor[i * most + i];
        }
        let left: f64 = f64::from(row[best.1]) - (0..n).map(|l| factor[n * most + l].powi(2)).sum::<f64>();
        if left <= 1e-7 {
            break; // The atom adds nothing to the span so far.
        }
        factor[n * most + n] = left.sqrt();
        work.support.push(best.1 as u32);
        // Refit: forward, then backward.
        let n = n + 1;
        for i in 0..n {
            let mut v = f64::from(problem.correlations[work.support[i] as usize]);
            for l in 0..i {
                v -= factor[i * most + l] * rhs[l];
            }
            rhs[i] = v / factor[i * most + i];
        }
        for i in (0..n).rev() {
            for l in i + 1..n {
                rhs[i] -= factor[l * most + i] * rhs[l];
            }
            rhs[i] /= factor[i * most + i];
        }
        if problem.nonnegative && rhs[..n].iter().any(|&v| v < 0.0) {
            work.support.pop();
            break; // Going on would need a negative coefficient.
        }
        work.gradient.copy_from_slice(problem.correlations);
        for (i, &v) in rhs[..n].iter().enumerate() {
            let j = work.support[i] as usize;
            work.code[j] = v as f32;
            for (c, &g) in work.gradient.iter_mut().zip(dictionary.gram_row(j)) {
                *c -= v as f32 * g;
            }
        }
    }
    Finished { gap: f64::NAN, iterations, ended: Ended::Converged }
}
