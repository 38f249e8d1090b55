//! Correlations C = Y Dᵀ of a block of signals: six signals by 64 atoms in registers, the sums in the order of the
//! signal's values, each rounded once — so a signal's correlations do not depend on its neighbours or the processor.

use super::prepared::{PANEL, Prepared};
use super::simd::{Chunk, Lanes};

/// Signals in registers together.
pub(super) const GROUP: usize = 6;

/// Correlations of all signals (rows of `stride` values, of which the first m count), a row of `dictionary.width()` chunks
/// each, into `out`.
#[inline(always)]
pub(super) fn correlate<S: Lanes>(lanes: S, dictionary: &Prepared, signals: &[f32], stride: usize, out: &mut [Chunk]) {
    if S::WIDE {
        correlate_panels::<S, 4>(lanes, dictionary, signals, stride, out);
    } else {
        correlate_panels::<S, 1>(lanes, dictionary, signals, stride, out);
    }
}

#[inline(always)]
fn correlate_panels<S: Lanes, const P: usize>(
    lanes: S,
    dictionary: &Prepared,
    signals: &[f32],
    stride: usize,
    out: &mut [Chunk],
) {
    let (m, width) = (dictionary.signal_len(), dictionary.width());
    for (p, panel) in dictionary.panels().enumerate() {
        for (signals, rows) in signals.chunks(GROUP * stride).zip(out.chunks_mut(GROUP * width)) {
            // Where the last group lacks signals, its first stands in; there is no row for it.
            let row =
                |n: usize| if n * stride + m <= signals.len() { &signals[n * stride..][..m] } else { &signals[..m] };
            let [a, b, c, d, e, f] = [row(0), row(1), row(2), row(3), row(4), row(5)];
            for part in 0..PANEL / P {
                let mut sums = [[lanes.splat(0.0); P]; GROUP];
                for ((((((atoms, a), b), c), d), e), f) in panel.iter().zip(a).zip(b).zip(c).zip(d).zip(e).zip(f) {
                    let values = [*a, *b, *c, *d, *e, *f];
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
