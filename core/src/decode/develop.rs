//! The steps that see the mosaic: levels, white image, hot pixels, white balance, neutral highlights.

use rayon::prelude::*;

use super::{Error, Options, Step, WhiteBalance, colour};
use crate::calibration::Calibration;
use crate::container::{Capture, Cfa};
use crate::progress::Observer;

/// A mosaic in linear light: one value a pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Mosaic {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` values, row-major; 1 = the light of a white surface that just saturates the first colour.
    pub data: Vec<f32>,
}

/// Where the white image is darker than this share of full light, dividing by it would only raise noise.
pub(super) const DARKEST: f32 = 1.0 / 24.0;

/// Runs the steps before the demosaic. The inputs are those of [`super::samples`], which checks them.
///
/// # Errors
/// Interruption.
pub fn mosaic(
    capture: &Capture,
    calibration: &Calibration,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Mosaic, Error> {
    super::check::check(capture, calibration, options)?;
    let (width, height) = (capture.mosaic.width, capture.mosaic.height);
    let black = if options.steps.contains(&Step::BlackLevel) { capture.levels.black } else { [0.0; 4] };
    let scale: [f32; 4] = std::array::from_fn(|k| 1.0 / (capture.levels.white[k] - black[k]));
    let mut out = Mosaic { width, height, data: vec![0.0; width * height] };
    let cfa = capture.cfa;
    rows(&mut out, |y, row| {
        let raw = &capture.mosaic.data[y * width..(y + 1) * width];
        let (even, odd) = (cfa.plane(0, y), cfa.plane(1, y));
        let (b, s) = ([black[even], black[odd]], [scale[even], scale[odd]]);
        for (x, (o, &r)) in row.iter_mut().zip(raw).enumerate() {
            *o = (f32::from(r) - b[x & 1]) * s[x & 1];
        }
    });
    let mut gains = [1.0f32; 4];
    for step in &options.steps {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        match step {
            Step::Vignetting => match &calibration.vignetting {
                Some(v) => rows(&mut out, |y, row| {
                    for (o, &w) in row.iter_mut().zip(&v.white[y * width..(y + 1) * width]) {
                        *o /= (f32::from(w) / 32768.0).max(DARKEST);
                    }
                }),
                None => observer.note("the calibration has no white image: vignetting stays"),
            },
            Step::HotPixels => {
                known_hot(&mut out, &calibration.hot_pixels);
                hot_pixels(&mut out);
            }
            Step::WhiteBalance if cfa != Cfa::Mono => {
                gains = match options.white_balance {
                    WhiteBalance::Camera => capture.colour.white_balance,
                    WhiteBalance::Gains([r, g, b]) => [r, g, g, b],
                    WhiteBalance::Auto => {
                        let [r, g, b] = colour::estimate_gains(&out, cfa);
                        observer.note(&format!("white balance estimated from the capture: {r:.3} {g:.3} {b:.3}"));
                        [r, g, g, b]
                    }
                };
                // The first colour to saturate keeps its scale, so that 1 stays the end of the range.
                let least = gains.iter().copied().fold(f32::INFINITY, f32::min);
                gains = gains.map(|g| g / least);
                rows(&mut out, |y, row| {
                    let g = [gains[cfa.plane(0, y)], gains[cfa.plane(1, y)]];
                    for (x, o) in row.iter_mut().enumerate() {
                        *o *= g[x & 1];
                    }
                });
            }
            Step::Highlights => {
                let least = gains.iter().copied().fold(f32::INFINITY, f32::min);
                rows(&mut out, |_, row| row.iter_mut().for_each(|o| *o = o.min(least)));
            }
            Step::Demosaic(_) => break,
            _ => {}
        }
    }
    Ok(out)
}

fn rows(mosaic: &mut Mosaic, change: impl Fn(usize, &mut [f32]) + Sync) {
    let width = mosaic.width;
    mosaic.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| change(y, row));
}

/// Pixels the calibration knows to be hot become the median of the nearest of their colour that it does not.
fn known_hot(mosaic: &mut Mosaic, hot: &[u32]) {
    let (width, height) = (mosaic.width, mosaic.height);
    let found: Vec<f32> = hot
        .iter()
        .map(|&k| {
            let (x, y) = (k as usize % width, k as usize / width);
            let around = |v: usize| [v.wrapping_sub(2), v, v + 2];
            let inside = around(y).into_iter().flat_map(|y| around(x).map(|x| (x, y)));
            let mut others: Vec<f32> = inside
                .filter(|&(x, y)| x < width && y < height && hot.binary_search(&((y * width + x) as u32)).is_err())
                .map(|(x, y)| mosaic.data[y * width + x])
                .collect();
            others.sort_unstable_by(f32::total_cmp);
            let n = others.len();
            // Without any, what the pixel says is all there is.
            if n == 0 { mosaic.data[k as usize] } else { (others[(n - 1) / 2] + others[n / 2]) / 2.0 }
        })
        .collect();
    for (&k, value) in hot.iter().zip(found) {
        mosaic.data[k as usize] = value;
    }
}

/// A pixel more than twice as bright as all eight nearest of its colour (and clearly so) becomes their median. Light of
/// that size cannot be so narrow: the lens blurs over more than a pixel.
fn hot_pixels(mosaic: &mut Mosaic) {
    let (width, height) = (mosaic.width, mosaic.height);
    let source = &mosaic.data;
    let found: Vec<(usize, f32)> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let near = move |v: usize, len: usize| {
                [if v >= 2 { v - 2 } else { v + 2 }, v, if v + 2 < len { v + 2 } else { v - 2 }]
            };
            let ys = near(y, height);
            (0..width).filter_map(move |x| {
                let value = source[y * width + x];
                // Cheap test first: nearly every pixel ends here.
                let left = source[y * width + if x >= 2 { x - 2 } else { x + 2 }];
                if value <= 2.0 * left.max(0.0) + 0.1 {
                    return None;
                }
                let mut others = [0f32; 8];
                let mut n = 0;
                for (a, &yy) in ys.iter().enumerate() {
                    for (b, &xx) in near(x, width).iter().enumerate() {
                        if (a, b) != (1, 1) {
                            others[n] = source[yy * width + xx];
                            n += 1;
                        }
                    }
                }
                others.sort_unstable_by(f32::total_cmp);
                (value > 2.0 * others[7].max(0.0) + 0.1).then_some((y * width + x, (others[3] + others[4]) / 2.0))
            })
        })
        .collect();
    for (k, value) in found {
        mosaic.data[k] = value;
    }
}
