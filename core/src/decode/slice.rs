//! Slicing: every view's value at every lenslet, read from a demosaiced image at sub-pixel places.

use ndarray::Array3;
use rayon::prelude::*;

use super::error::Error;
use super::samples::HexSamples;
use crate::progress::Observer;
use crate::sampling::bicubic::bicubic_at;

/// Views `(views², lenslets, channels)` of `image` (height, width, channels): view (v, u) reads at
/// centre + (u, v)·view_step, bicubic; `place_of` gives the place in `image` of a place on the sensor.
pub(super) fn slice_views(
    image: &Array3<f32>,
    samples: &HexSamples,
    place_of: &(dyn Fn([f64; 2]) -> [f64; 2] + Sync),
    observer: &dyn Observer,
) -> Result<Array3<f32>, Error> {
    let channels = image.dim().2;
    let (n, lenslets) = (samples.views, samples.centres.len());
    let mut values = Array3::zeros((n * n, lenslets, channels));
    observer.begin("slicing views", (n * n) as u64);
    if let Some(flat) = values.as_slice_mut() {
        for (k, view) in flat.chunks_mut((lenslets * channels).max(1)).enumerate() {
            observer.check()?;
            let [du, dv] = samples.view_offset(k);
            view.par_chunks_mut(channels * 1024).zip(samples.centres.par_chunks(1024)).for_each(|(out, centres)| {
                for (o, c) in out.chunks_exact_mut(channels).zip(centres) {
                    let [x, y] = place_of([c[0] + du, c[1] + dv]);
                    bicubic_at(image.view(), x, y, o);
                }
            });
            observer.advance(1);
        }
    }
    Ok(values)
}
