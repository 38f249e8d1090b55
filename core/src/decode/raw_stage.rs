//! The steps on the mosaic: the interpreter of [`RawStep`].

use rayon::prelude::*;

use super::error::Error;
use super::hot_pixels;
use super::mosaic::Mosaic;
use super::options::{Options, WhiteBalance};
use super::steps::RawStep;
use super::white_balance::estimate_gains;
use crate::calibration::Calibration;
use crate::container::{Capture, Cfa};
use crate::progress::Observer;

/// Lower bound of the white image, as a share of full light: dividing by less would mostly amplify noise.
///
/// Source: chosen.
const MIN_WHITE: f32 = 1.0 / 24.0;

/// The mosaic in linear light after the raw steps of `options`. The inputs are checked ones.
///
/// # Errors
/// Interruption.
pub(super) fn develop_mosaic(
    capture: &Capture,
    calibration: &Calibration,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Mosaic, Error> {
    let mut out = read_numbers(capture, options.steps.raw.contains(&RawStep::BlackLevel));
    let (width, cfa) = (out.width, capture.cfa);
    let mut gains = [1.0f32; 4];
    for step in &options.steps.raw {
        observer.check()?;
        match step {
            RawStep::BlackLevel => {} // Part of reading the numbers, above.
            RawStep::Vignetting => match &calibration.vignetting {
                Some(v) => change_rows(&mut out, |y, row| {
                    for (o, &w) in row.iter_mut().zip(&v.white[y * width..(y + 1) * width]) {
                        *o /= (f32::from(w) / 32768.0).max(MIN_WHITE);
                    }
                }),
                None => observer.note("the calibration has no white image: vignetting is not corrected"),
            },
            RawStep::HotPixels => {
                hot_pixels::replace_listed(&mut out, &calibration.hot_pixels);
                hot_pixels::replace_outliers(&mut out);
            }
            RawStep::WhiteBalance => {
                if cfa != Cfa::Mono {
                    gains = balance(&mut out, capture, options.white_balance, observer);
                }
            }
            RawStep::Highlights => {
                let least = gains.iter().copied().fold(f32::INFINITY, f32::min);
                change_rows(&mut out, |_, row| row.iter_mut().for_each(|o| *o = o.min(least)));
            }
        }
    }
    Ok(out)
}

/// Digital numbers as light: (number − black)/(white − black); black is 0 unless `subtract_black`.
fn read_numbers(capture: &Capture, subtract_black: bool) -> Mosaic {
    let (width, height) = (capture.mosaic.width, capture.mosaic.height);
    let black = if subtract_black { capture.levels.black } else { [0.0; 4] };
    let scale: [f32; 4] = std::array::from_fn(|k| 1.0 / (capture.levels.white[k] - black[k]));
    let mut out = Mosaic { width, height, data: vec![0.0; width * height] };
    change_rows(&mut out, |y, row| {
        let raw = &capture.mosaic.data[y * width..(y + 1) * width];
        let (even, odd) = (capture.cfa.plane(0, y), capture.cfa.plane(1, y));
        let (b, s) = ([black[even], black[odd]], [scale[even], scale[odd]]);
        for (x, (o, &r)) in row.iter_mut().zip(raw).enumerate() {
            *o = (f32::from(r) - b[x & 1]) * s[x & 1];
        }
    });
    out
}

/// Multiplies by the white balance; returns the gains of the four planes, the least of them 1.
fn balance(out: &mut Mosaic, capture: &Capture, source: WhiteBalance, observer: &dyn Observer) -> [f32; 4] {
    let cfa = capture.cfa;
    let gains = match source {
        WhiteBalance::Camera => capture.colour.white_balance,
        WhiteBalance::Gains([r, g, b]) => [r, g, g, b],
        WhiteBalance::Auto => {
            let [r, g, b] = estimate_gains(out, cfa);
            observer.note(&format!("white balance estimated from the capture: {r:.3} {g:.3} {b:.3}"));
            [r, g, g, b]
        }
    };
    // The first colour to saturate keeps its scale, so that the range still ends at 1.
    let least = gains.iter().copied().fold(f32::INFINITY, f32::min);
    let gains = gains.map(|g| g / least);
    change_rows(out, |y, row| {
        let g = [gains[cfa.plane(0, y)], gains[cfa.plane(1, y)]];
        for (x, o) in row.iter_mut().enumerate() {
            *o *= g[x & 1];
        }
    });
    gains
}

fn change_rows(mosaic: &mut Mosaic, change: impl Fn(usize, &mut [f32]) + Sync) {
    let width = mosaic.width;
    mosaic.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| change(y, row));
}
