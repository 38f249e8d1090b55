//! Correlations C = Y Dᵀ of a block of signals: six signals by 64 atoms in registers, the sums in the order of the
//! signal's values, each rounded once — so a signal's correlations do not depend on its neighbours or the processor.

use super::prepared::{PANEL, Prepared};
use super::simd::{Chunk, Lanes};

/// Signals in registers together.
pub(super) const GROUP: usize = 6;

/// Signals interleaved by six: value k of signals 6g..6g+6 at `[g·m + k]`; missing signals are zero.
pub(super) fn interleave<'a>(signals: impl Iterator<Item = &'a [f32]>, m: usize, out: &mut Vec<[f32; GROUP]>) {
    out.clear();
    for (n, signal) in signals.enumerate() {
        let (group, lane) = (n / GROUP, n % GROUP);
        if lane == 0 {
            out.resize((group + 1) * m, [0.0; GROUP]);
        }
        for (slot, &v) in out[group * m..].iter_mut().zip(signal) {
            slot[lane] = v;
        }
    }
}

/// Correlations of all interleaved signals, a row of `dictionary.width()` chunks each, into `out`.
#[inline(always)]
pub(super) fn correlate<S: Lanes>(lanes: S, dictionary: &Prepared, signals: &[[f32; GROUP]], out: &mut [Chunk]) {
    if S::WIDE {
        correlate_panels::<S, 4>(lanes, dictionary, signals, out);
    } else {
        correlate_panels::<S, 1>(lanes, dictionary, signals, out);
    }
}

#[inline(always)]
fn correlate_panels<S: Lanes, const P: usize>(
    lanes: S,
    dictionary: &Prepared,
    signals: &[[f32; GROUP]],
    out: &mut [Chunk],
) {
    let (m, width) = (dictionary.signal_len(), dictionary.width());
    for (p, panel) in dictionary.panels().enumerate() {
        for (signals, rows) in signals.chunks_exact(m).zip(out.chunks_mut(GROUP * width)) {
            for part in 0..PANEL / P {
                let mut sums = [[lanes.splat(0.0); P]; GROUP];
                for (values, atoms) in signals.iter().zip(panel) {
                    let mut loaded = [lanes.splat(0.0); P];
                    for i in 0..P {
                        loaded[i] = lanes.load(&atoms[part * P + i]);
                    }
                    for n in 0..GROUP {
                        let value = lanes.splat(values[n]);
                        for i in 0..P {
                            sums[n][i] = lanes.fma(value, loaded[i], sums[n][i]);
                        }
                    }
                }
                for (row, sums) in rows.chunks_exact_mut(width).zip(&sums) {
                    let to = p * PANEL + part * P;
                    for (out, &sum) in row[to..to + P].iter_mut().zip(sums) {
                        lanes.store(out, sum);
                    }
                }
            }
        }
    }
}
