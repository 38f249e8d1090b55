//! Correlations C = Y Dᵀ of a block of signals: six signals by 64 atoms in registers, the sums in the order of the
//! signal's values, each rounded once, so a signal's correlations do not depend on its neighbours or the processor.

use super::simd::{Chunk, Kernel, Lanes};

/// Signals in registers together.
///
/// Source: chosen; 6 × 4 sums, with what they are made of, fill the 32 registers of AVX-512.
pub(crate) const GROUP: usize = 6;
/// Chunks of a panel: 64 atoms.
///
/// Source: chosen; see [`GROUP`].
pub(crate) const PANEL: usize = 4;

/// Up to this many chunks (256 atoms), every round searches all of them.
///
/// Source: measured; up to 256 atoms searching all is faster (docs/sparse-coding.md).
pub(crate) const MAX_CHUNKS_SEARCHED_WHOLE: usize = 16;

/// Atoms laid out for the product.
#[derive(Debug, Clone)]
pub(crate) struct Panels {
    /// For every 64 atoms, for every value of a signal, that value of the 64 atoms; zero beyond K.
    pub values: Vec<[Chunk; PANEL]>,
    /// m, the values of a signal.
    pub signal_len: usize,
    /// Chunks of a row over all atoms, a multiple of [`PANEL`].
    pub width: usize,
}

/// The product of a block of signals with all atoms.
pub(crate) struct Correlate<'a> {
    pub panels: &'a Panels,
    pub signals: &'a [f32],
    /// Values from one signal to the next.
    pub stride: usize,
    /// A row of `panels.width` chunks for each signal.
    pub out: &'a mut [Chunk],
}

impl Kernel for Correlate<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        correlate(lanes, self.panels, self.signals, self.stride, self.out);
    }
}

/// Correlations of all signals (rows of `stride` values, of which the first m count), a row of `panels.width` chunks
/// each, into `out`.
#[inline(always)]
pub(crate) fn correlate<S: Lanes>(lanes: S, panels: &Panels, signals: &[f32], stride: usize, out: &mut [Chunk]) {
    if S::WIDE {
        correlate_panels::<S, 4>(lanes, panels, signals, stride, out);
    } else {
        correlate_panels::<S, 1>(lanes, panels, signals, stride, out);
    }
}

#[inline(always)]
fn correlate_panels<S: Lanes, const P: usize>(
    lanes: S,
    panels: &Panels,
    signals: &[f32],
    stride: usize,
    out: &mut [Chunk],
) {
    let (m, width) = (panels.signal_len, panels.width);
    for (p, panel) in panels.values.chunks_exact(m).enumerate() {
        for (signals, rows) in signals.chunks(GROUP * stride).zip(out.chunks_mut(GROUP * width)) {
            // An incomplete last group is filled up with its first signal; those results have no row and are dropped.
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

/// Inner products of one vector (m values) with all atoms, a row of `panels.width` chunks.
#[inline(always)]
pub(crate) fn correlate_one<S: Lanes>(lanes: S, panels: &Panels, vector: &[f32], out: &mut [Chunk]) {
    let vector = &vector[..panels.signal_len];
    let m = panels.signal_len;
    let mut from = 0;
    if S::WIDE {
        while from + 4 <= panels.width / PANEL {
            correlate_one_panels::<S, 4>(lanes, panels, vector, from, out);
            from += 4;
        }
        while from + 2 <= panels.width / PANEL {
            correlate_one_panels::<S, 2>(lanes, panels, vector, from, out);
            from += 2;
        }
    }
    while from < panels.values.len() / m {
        correlate_one_panels::<S, 1>(lanes, panels, vector, from, out);
        from += 1;
    }
}

#[inline(always)]
fn correlate_one_panels<S: Lanes, const P: usize>(
    lanes: S,
    panels: &Panels,
    vector: &[f32],
    from: usize,
    out: &mut [Chunk],
) {
    let m = vector.len();
    let rows: [&[[Chunk; PANEL]]; P] = std::array::from_fn(|p| &panels.values[(from + p) * m..][..m]);
    let mut sums = [[lanes.splat(0.0); PANEL]; P];
    for i in 0..m {
        let value = lanes.splat(vector[i]);
        for p in 0..P {
            for part in 0..PANEL {
                sums[p][part] = lanes.fma(value, lanes.load(&rows[p][i][part]), sums[p][part]);
            }
        }
    }
    for p in 0..P {
        for part in 0..PANEL {
            lanes.store(&mut out[(from + p) * PANEL + part], sums[p][part]);
        }
    }
}
