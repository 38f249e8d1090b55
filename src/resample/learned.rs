//! Section 4.4 on top of another method: every view is interpolated, then reconstructed with the dictionary.
//!
//! A dictionary knows one pitch. Where the target's pitch differs from it by more than a tenth, the view is interpolated
//! and reconstructed at the dictionary's own pitch and then resized bicubically to the target.
//!
//! Views interpolated from their own samples keep these true. Views refined by all the others have a dictionary of their own,
//! and are put right by their samples only where they are clearly off: elsewhere they are nearer to the scene than a single
//! noisy sample is.

use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::{Dictionary, Interpolation};
use lenslet_core::lightfield::{ColourSpace, colour};
use lenslet_core::progress::Observer;
use lenslet_core::sampling::{MAX_PIXELS, bicubic};
use ndarray::{Array3, Axis};

use super::{Method, RenderOptions, Sink, Target, pitch, render as render_plain};
use crate::infer::{self, Faithful, Reconstructor};

/// Difference of pitch that a dictionary bears.
const TOLERANCE: f64 = 0.1;

/// The size at which views are reconstructed for `target`, given the pitch of the samples on the sensor and of the model.
#[must_use]
pub fn working_size(samples: &HexSamples, target: &Target, trained: f64) -> Target {
    let actual = pitch(samples) * target.width as f64 / samples.sensor.0.max(1) as f64;
    let ratio = trained / actual;
    if !ratio.is_finite() || (ratio - 1.0).abs() <= TOLERANCE {
        return *target;
    }
    let side = |n: usize| ((n as f64 * ratio).round().max(1.0)) as usize;
    let (width, height) = (side(target.width), side(target.height));
    if width.checked_mul(height).is_some_and(|n| n <= MAX_PIXELS) { Target { width, height } } else { *target }
}

/// What a dictionary calls a method that views can be made with.
fn base(method: Method) -> Interpolation {
    match method {
        Method::Multiview => Interpolation::Multiview,
        Method::Cubic => Interpolation::Cubic,
        Method::Bicubic => Interpolation::Bicubic,
        Method::Barycentric | Method::Learned => Interpolation::Barycentric,
    }
}

/// Renders every view by `options.base`, reconstructs it with the dictionary (the embedded one for such views unless given), and hands it
/// to `sink` in linear light.
///
/// # Errors
/// As the base method; a dictionary that cannot be used.
pub fn render(
    samples: &HexSamples,
    target: &Target,
    options: &RenderOptions,
    sink: Sink<'_>,
    observer: &dyn Observer,
) -> anyhow::Result<()> {
    anyhow::ensure!(options.base != Method::Learned, "learned reconstruction cannot start from itself");
    let embedded: Dictionary;
    let dictionary = match &options.dictionary {
        Some(given) => given,
        None => {
            embedded = infer::embedded_for(base(options.base))?;
            &embedded
        }
    };
    let reconstructor = Reconstructor::new(dictionary, &options.infer)?;
    let trained = reconstructor.model().base;
    if (trained == Interpolation::Multiview) != (options.base == Method::Multiview) {
        observer
            .note(&format!("the dictionary was trained on {trained} views, these are {}: expect less", options.base));
    }
    let working = working_size(samples, target, reconstructor.model().pitch);
    if working != *target {
        observer.note(&format!(
            "the dictionary was trained for another pitch: views are reconstructed at {}x{} and resized",
            working.width, working.height
        ));
    }
    let faithful = match options.base {
        Method::Barycentric | Method::Cubic | Method::Multiview => {
            let size = (working.width, working.height);
            Some(Faithful::new(&reconstructor, samples, base(options.base), size, options.infer.noise)?)
        }
        _ => None,
    };
    let mut learned = |v: usize, u: usize, view: &Array3<f32>| -> anyhow::Result<()> {
        let encoded = super::encode::srgb(view);
        let mut sharp = match &faithful {
            Some(f) => f.view(&encoded, samples.values.index_axis(Axis(0), v * samples.views + u))?,
            None => reconstructor.view(&encoded)?,
        };
        if working != *target {
            sharp = bicubic::resize(sharp.view(), target.width, target.height)?;
            sharp.mapv_inplace(|p| p.clamp(0.0, 1.0));
        }
        colour::convert(&mut sharp, ColourSpace::Srgb, ColourSpace::Linear);
        sink(v, u, &sharp)
    };
    render_plain(samples, &working, options.base, options, &mut learned, observer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_pitches_are_worked_at_the_trained_one() {
        let lenslets = 30 * 30;
        let samples = HexSamples {
            sensor: (300, 300),
            centres: vec![[0.0, 0.0]; lenslets],
            index: vec![[0, 0]; lenslets],
            views: 1,
            view_step: 1.0,
            weights: vec![1.0],
            values: Array3::zeros((1, lenslets, 1)),
        };
        let sensor_pitch = pitch(&samples);
        let at = |width| Target { width, height: width };
        let fit = (3.293 * 300.0 / sensor_pitch).round() as usize;
        assert_eq!(working_size(&samples, &at(fit), 3.293), at(fit));
        assert_eq!(working_size(&samples, &at(fit + 5), 3.293), at(fit + 5));
        let working = working_size(&samples, &at(2 * fit), 3.293);
        assert!(working.width.abs_diff(fit) <= 1);
    }
}
