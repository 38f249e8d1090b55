//! The f64 certificate of an f32 code: the duality gap from an f64 residual, and the errors of the support's
//! conditions.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::gap;
use super::simd::{Chunk, Lanes};
use super::state::{State, Task};
use crate::sparse::prepared::Prepared;

/// A signal whose support is final, with the values that its certificate is computed from.
pub(crate) struct Settled<'a> {
    /// The largest |c| (or c) outside the support.
    pub outside: f32,
    /// ‖y‖.
    pub norm: f64,
    /// The gap to reach.
    pub goal: f64,
    /// Whether λ of the rounds is that of the problem.
    pub is_last: bool,
    /// The signal, padded with zeros.
    pub signal: &'a [Chunk],
}

/// The duality gap of the code in `state`; leaves the errors of the support's conditions in `state.error`.
#[inline(always)]
pub(crate) fn certified_gap<S: Lanes, const C: usize>(
    lanes: S,
    task: &Task<'_>,
    settled: &Settled<'_>,
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
    let chunks = settled.signal.len();
    let (yr, rr, mut largest) = match chunks {
        3 if S::WIDE => residual_in_registers::<S, C, 3>(lanes, task, settled.signal, state, residual),
        4 if S::WIDE => residual_in_registers::<S, C, 4>(lanes, task, settled.signal, state, residual),
        _ => {
            let mut sums = (lanes.wide_splat(0.0), lanes.wide_splat(0.0));
            let mut from = 0;
            while from + 2 <= chunks {
                residual_part::<S, C, 2>(lanes, dictionary, settled.signal, from, state, residual, &mut sums);
                from += 2;
            }
            if from < chunks {
                residual_part::<S, C, 1>(lanes, dictionary, settled.signal, from, state, residual, &mut sums);
            }
            let mut largest = 0.0f64;
            for member in 0..state.n {
                let c = gap::inner_product(lanes, dictionary.padded_atom(state.support()[member] as usize), residual);
                largest = state.record_condition(task, member, c, largest);
            }
            (lanes.wide_sum(sums.0), lanes.wide_sum(sums.1), largest)
        }
    };
    // Bound on the rounding of the f32 correlations outside the support; where it could matter they are computed anew.
    let m = dictionary.signal_len() as f64;
    let terms = state.n as f64;
    let rounding = 6e-8 * ((m + 2.0) * settled.norm + (m + terms + 4.0) * norm1);
    if f64::from(settled.outside) + rounding > lambda {
        for k in 0..dictionary.atom_count() {
            let c = gap::inner_product(lanes, dictionary.padded_atom(k), residual);
            largest = largest.max(if task.nonnegative { c } else { c.abs() });
        }
    }
    gap::duality_gap(yr, rr, norm1, lambda, largest)
}

/// Puts y − Dᵀφ into `residual` and records the members' conditions, for signals of `B` chunks. Returns y·r, r·r and
/// the largest |c| (or c).
#[inline(always)]
fn residual_in_registers<S: Lanes, const C: usize, const B: usize>(
    lanes: S,
    task: &Task<'_>,
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
        largest = state.record_condition(task, member, lanes.wide_sum(sum), largest);
    }
    (lanes.wide_sum(sums.0), lanes.wide_sum(sums.1), largest)
}

/// Puts `B` chunks of y − Dᵀφ into `residual` and returns them; adds to the sums of y·r and r·r.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::kernel::simd::{Kernel, Simd, dispatch};
    use crate::sparse::prepared::prepare;

    struct Each<'a>(&'a Prepared);

    impl Kernel for Each<'_> {
        type Out = ();
        fn run<S: Lanes>(self, lanes: S) {
            let mut signal = [Chunk::ZERO];
            (signal[0].0[0], signal[0].0[1]) = (0.5, -1.0);
            let gap_of = |nonnegative: bool, outside: f32| {
                let task = Task {
                    dictionary: self.0,
                    lambda: 0.25,
                    threshold: 0.25,
                    nonnegative,
                    keep_signs: true,
                    max_rounds: 5,
                };
                let settled = Settled { outside, norm: 1.25f64.sqrt(), goal: 0.0, is_last: true, signal: &signal };
                certified_gap(lanes, &task, &settled, &mut State::<1>::new(), &mut [[0.0; 16]])
            };
            // Near λ the correlations outside the support are computed anew: the largest is 1, or 0.5 with its sign.
            for (nonnegative, largest) in [(false, 1.0), (true, 0.5)] {
                let expected = gap::duality_gap(1.25, 1.25, 0.0, 0.25, largest);
                assert!(expected > 0.1 && (gap_of(nonnegative, 0.25) - expected).abs() < 1e-9, "{nonnegative}");
                // Well below it they are believed.
                assert_eq!(gap_of(nonnegative, 0.2), 0.0);
            }
        }
    }

    #[test]
    fn correlations_near_lambda_are_computed_anew() {
        let dictionary = prepare(ndarray::arr2(&[[1.0, 0.0], [0.0, 1.0]]).view()).unwrap();
        dispatch(Simd::best(), Each(&dictionary));
        dispatch(Simd::Plain, Each(&dictionary));
    }
}
