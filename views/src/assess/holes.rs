//! Holes: lenslets hidden and filled by the mean of their six neighbours, then compared with what they measured.
//!
//! The score is biased: at a hole wide means win, so that bicubic interpolation scores above barycentric and that above
//! learned reconstruction on captures whose truth says the opposite. It judges no method (docs/assessing.md).

use std::collections::HashMap;

use lenslet_core::decode::HexSamples;
use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use ndarray::{Array3, ArrayView3, Axis};

use super::picture::{encode, encoded_light, light_of, read_between};
use super::ray_places::{BORDER, sample_points};
use super::withheld::hash_of;
use crate::Error;
use crate::target::view_pitch;

/// One lenslet in this many is a candidate; those next to another one are not hidden.
///
/// Source: chosen: 6 % are hidden.
const ONE_IN: u64 = 10;

/// Lattice steps to the six neighbours.
const NEIGHBOURS: [[i32; 2]; 6] = [[1, 0], [0, 1], [-1, 1], [-1, 0], [0, -1], [1, -1]];

/// The score at the hidden lenslets of a middle view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HolesScore {
    /// PSNR, dB, of sRGB-encoded luminance clamped to 0..1.
    pub psnr: f64,
    /// Lenslets hidden and compared.
    pub lenslets: usize,
}

/// Hides lenslets of a hexagonal lattice, the same ones for every method, by their lattice index; in every view their
/// samples become the mean of the six neighbours'. `render` makes the middle view (t, s, c) of `size`, linear light.
///
/// # Errors
/// Samples without inner lenslets, a picture of another size, errors of `render`.
pub fn holes_score<E: From<Error>>(
    samples: &HexSamples,
    size: &Size,
    render: &mut dyn FnMut(&HexSamples) -> Result<Array3<f32>, E>,
) -> Result<HolesScore, E> {
    let place: HashMap<[i32; 2], usize> = samples.index.iter().enumerate().map(|(k, i)| (*i, k)).collect();
    let candidate = |i: [i32; 2]| hash_of(i).is_multiple_of(ONE_IN);
    let around = |[i, j]: [i32; 2]| NEIGHBOURS.map(|[a, b]| [i + a, j + b]);
    let mut filled = samples.clone();
    let mut hidden = Vec::new();
    for (k, &index) in samples.index.iter().enumerate() {
        let near = around(index);
        let known: Vec<usize> = near.iter().filter_map(|n| place.get(n).copied()).collect();
        if !candidate(index) || known.len() < 6 || near.into_iter().any(candidate) {
            continue;
        }
        for (mut to, from) in filled.values.outer_iter_mut().zip(samples.values.outer_iter()) {
            let mean = from.select(Axis(0), &known).mean_axis(Axis(0));
            if let Some(mean) = mean {
                to.row_mut(k).assign(&mean);
            }
        }
        hidden.push(k);
    }
    let image = render(&filled)?;
    Ok(score_hidden(samples, size, &hidden, image.view())?)
}

fn score_hidden(
    samples: &HexSamples,
    size: &Size,
    hidden: &[usize],
    image: ArrayView3<'_, f32>,
) -> Result<HolesScore, Error> {
    let (height, width, _) = image.dim();
    ensure!(
        Error::Shape,
        (width, height) == (size.width, size.height),
        "the rendered view has another size: {width}x{height} instead of {}x{}",
        size.width,
        size.height
    );
    let plane = encoded_light(image);
    let points = sample_points(samples, size);
    let own = samples.view(samples.views / 2, samples.views / 2);
    let border = BORDER * view_pitch(samples, size.width);
    let inside = |x: f64, side: usize| x > border && x < side as f64 - 1.0 - border;
    let (mut sum, mut lenslets) = (0.0, 0);
    for &k in hidden.iter().filter(|&&k| inside(points[k][0], width) && inside(points[k][1], height)) {
        let error = read_between(&plane, points[k][0], points[k][1]) - encode(light_of(own.row(k)));
        sum += f64::from(error).powi(2);
        lenslets += 1;
    }
    ensure!(Error::Shape, lenslets > 0, "no lenslet was hidden away from the border");
    Ok(HolesScore { psnr: -10.0 * (sum / lenslets as f64).max(1e-20).log10(), lenslets })
}

#[cfg(test)]
mod tests {
    use lenslet_core::interpolation::Interpolation;
    use lenslet_core::progress::Silent;

    use super::*;
    use crate::renderer::InterpolatedViews;

    #[test]
    fn smooth_light_fills_holes_and_texture_does_not() {
        let size = Size { width: 100, height: 100 };
        let score = |light: &dyn Fn(f64, f64) -> f32| {
            let mut samples = crate::assess::rays::tests::slanted_samples();
            let centres = samples.centres.clone();
            for mut view in samples.values.outer_iter_mut() {
                for (mut value, [x, y]) in view.rows_mut().into_iter().zip(&centres) {
                    value.fill(light(*x, *y));
                }
            }
            holes_score::<Error>(&samples, &size, &mut |rest| {
                let views = InterpolatedViews::prepare(rest, Interpolation::Barycentric, &size, &Silent)?;
                Ok(views.render_view(3, 3)?.into_pixels())
            })
            .unwrap()
        };
        let smooth = score(&|x, y| (0.2 + 0.001 * x + 0.0005 * y) as f32);
        let rough = score(&|x, y| (0.3 + 0.2 * (0.4 * x).sin() * (0.3 * y).cos()) as f32);
        assert!(smooth.psnr > 60.0 && rough.psnr < 30.0 && smooth.lenslets > 30, "{smooth:?} {rough:?}");
        let samples = crate::assess::rays::tests::slanted_samples();
        let small = holes_score::<Error>(&samples, &size, &mut |_| Ok(Array3::zeros((9, 9, 3))));
        assert!(small.is_err());
    }
}
