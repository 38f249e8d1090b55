//! Views reconstructed with their measured samples at hand: noise is known where it is, and what was measured stays true.

use crate::Error;
use crate::error::ensure_shape;
use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::{Footprint, Interpolation};
use lenslet_core::lightfield::colour;
use lenslet_core::metrics::LUMINANCE;
use lenslet_core::sampling::Cubic;
use ndarray::{Array2, Array3, ArrayView2, Axis};

use super::noise::Neighbours;
use super::{Noise, Reconstructor, SamplingOperator, back_project, checked_luminance, guided};

/// Rounds of back-projection: differences fall to about a thousandth of the range.
const ROUNDS: usize = 4;
/// Differences up to this part of the noise are left to views interpolated from the samples themselves.
const OWN: f32 = 0.5;
/// As much is left to refined views, in parts of the noise and of the range: many samples made them, so they are off by less
/// than one sample is, but where a neighbour was taken for what it is not.
const REFINED: (f32, f32) = (1.5, 0.01);

/// What was measured in every view, and how noisy it is.
#[derive(Debug, Clone)]
pub struct Measurements {
    measured: SamplingOperator,
    cubic: Option<Cubic>,
    neighbours: Neighbours,
    given: Option<f32>,
}

impl Measurements {
    /// Samples that see `footprint` (`pitch` output pixels wide), for views of (width, height) pixels; `noise` as in
    /// [`super::Options::noise`]; `alone` is what [`Measurements::interpolate_own_samples`] will be asked for.
    ///
    /// # Errors
    /// Samples that cannot be triangulated, a size out of range.
    pub fn new(
        samples: &HexSamples,
        footprint: Footprint,
        pitch: f64,
        size: (usize, usize),
        noise: Option<f32>,
        alone: &[Interpolation],
    ) -> Result<Self, Error> {
        let (fx, fy) = (size.0 as f64 / samples.sensor.0 as f64, size.1 as f64 / samples.sensor.1 as f64);
        let centres: Vec<[f64; 2]> =
            samples.centres.iter().map(|c| [(c[0] + 0.5) * fx - 0.5, (c[1] + 0.5) * fy - 0.5]).collect();
        let neighbours = Neighbours::new(&centres)?;
        let cubic = if alone.contains(&Interpolation::Cubic) { Some(Cubic::new(&centres, size, size)?) } else { None };
        Ok(Measurements {
            measured: SamplingOperator::new(centres, footprint, pitch, size)?,
            cubic,
            neighbours,
            given: noise,
        })
    }

    /// Noise of a view's samples (lenslets, 1 or 3 channels; linear light): what was given, or an estimate.
    ///
    /// # Errors
    /// Another number of channels.
    pub fn noise(&self, values: ArrayView2<'_, f32>) -> Result<Noise, Error> {
        if let Some(sigma) = self.given {
            return Ok(Noise::constant(sigma));
        }
        let encode = |v: f32| colour::encode(v.clamp(0.0, 1.0));
        let colours: Option<Vec<f32>> =
            (values.ncols() == 3).then(|| values.rows().into_iter().map(|v| encode(v[0]) - encode(v[1])).collect());
        Ok(Noise::estimate(&encoded_luminance(values)?, colours.as_deref(), &self.neighbours))
    }

    /// Moves a view's luminance (t, s), sRGB-encoded, towards its samples: differences that noise explains stay. Views made
    /// of the samples of all the others (`refined`) are moved only where they are clearly off.
    ///
    /// # Errors
    /// Shapes that do not belong together.
    pub fn project_onto_samples(
        &self,
        plane: &Array2<f32>,
        values: ArrayView2<'_, f32>,
        refined: bool,
    ) -> Result<Array2<f32>, Error> {
        let samples = encoded_luminance(values)?;
        let noise = self.noise(values)?;
        let (part, least) = if refined { REFINED } else { (OWN, 0.0) };
        let left: Vec<f32> = samples.iter().map(|&s| part * noise.at(s) + least).collect();
        Ok(back_project(plane, &self.measured, ndarray::aview1(&samples), ROUNDS, &left)?.0)
    }

    /// A view's luminance, sRGB-encoded, as `base` (barycentric or cubic) interpolates it from the view's own samples, 0..1.
    ///
    /// # Errors
    /// Another number of samples, another base.
    pub fn interpolate_own_samples(
        &self,
        values: ArrayView2<'_, f32>,
        base: Interpolation,
    ) -> Result<Array2<f32>, Error> {
        let samples = encoded_luminance(values)?;
        match (base, &self.cubic) {
            (Interpolation::Barycentric, _) => Ok(self.measured.interpolate(&samples)?),
            (Interpolation::Cubic, Some(cubic)) => {
                let plane = cubic.apply(ndarray::aview1(&samples).insert_axis(Axis(1)))?;
                Ok(plane.index_axis_move(Axis(2), 0).mapv(|v| v.clamp(0.0, 1.0)))
            }
            (other, _) => Err(Error::Parameter(format!("no {other} image of a view's own samples was prepared"))),
        }
    }

    /// What a view's luminance says at the lenslet centres.
    ///
    /// # Errors
    /// An empty plane.
    pub fn sample(&self, plane: &Array2<f32>) -> Result<Vec<f32>, Error> {
        Ok(self.measured.sample(plane)?.into_raw_vec_and_offset().0)
    }
}

/// Reconstruction of views whose samples are at hand.
#[derive(Debug, Clone)]
pub struct DataConsistent<'a> {
    reconstructor: &'a Reconstructor,
    truth: Measurements,
    refined: bool,
}

impl<'a> DataConsistent<'a> {
    /// For views of (width, height) pixels that `base` made of the samples; `noise` as in [`super::Options::noise`].
    ///
    /// # Errors
    /// Samples that cannot be triangulated, a size out of range.
    pub fn new(
        reconstructor: &'a Reconstructor,
        samples: &HexSamples,
        base: Interpolation,
        size: (usize, usize),
        noise: Option<f32>,
    ) -> Result<Self, Error> {
        let model = reconstructor.model();
        let truth = Measurements::new(samples, model.footprint, model.pitch, size, noise, reconstructor.beside())?;
        Ok(DataConsistent { reconstructor, truth, refined: base == Interpolation::Multiview })
    }

    /// Reconstructs an sRGB-encoded view (t, s, c) made from samples of which its own are `values` (lenslets, c), in linear
    /// light. Clamped to 0..1.
    ///
    /// Interpolated views return their samples where they are not clamped, but for noise and about a thousandth of the range.
    /// Refined views are put right where they are clearly off before they are reconstructed and, but by a network that was
    /// shown the samples as well, after it.
    ///
    /// # Errors
    /// Shapes that do not belong together, what the solver reports.
    pub fn view(&self, low: &Array3<f32>, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        let y = checked_luminance(low)?;
        let beside = self.reconstructor.beside().iter().map(|&base| self.truth.interpolate_own_samples(values, base));
        let beside = beside.collect::<Result<Vec<_>, Error>>()?;
        // Where a refined view is clearly off, features would be those of something else.
        let sharp = if self.refined {
            self.reconstructor.plane_beside(self.truth.project_onto_samples(&y, values, true)?.view(), &beside)?
        } else {
            self.reconstructor.plane_beside(y.view(), &beside)?
        };
        // A network that was shown the samples has weighed them already.
        let sharp =
            if beside.is_empty() { self.truth.project_onto_samples(&sharp, values, self.refined)? } else { sharp };
        Ok(guided::with_luminance(low, &y, &sharp, self.reconstructor.reach()))
    }

    /// What was measured.
    #[must_use]
    pub fn truth(&self) -> &Measurements {
        &self.truth
    }
}

/// Luminance of samples (lenslets, 1 or 3 channels) in linear light, as encoded views have it.
fn encoded_luminance(values: ArrayView2<'_, f32>) -> Result<Vec<f32>, Error> {
    let channels = values.ncols();
    ensure_shape!(channels == 1 || channels == 3, "samples of {channels} channels: 1 or 3 are needed");
    let encode = |v: f32| colour::encode(v.clamp(0.0, 1.0));
    Ok(values
        .rows()
        .into_iter()
        .map(|v| match channels {
            1 => encode(v[0]),
            _ => v.iter().zip(LUMINANCE).map(|(&v, w)| w * encode(v)).sum(),
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode;
    use crate::interpolate::barycentric;
    use crate::reconstruct::{Options, embedded};
    use crate::target::Target;
    use lenslet_core::metrics::luminance;

    /// A view of stripes and discs through lenslets three and a bit pixels apart.
    fn samples() -> HexSamples {
        let side = 200;
        let mut centres = Vec::new();
        for j in 0..64 {
            for i in 0..58 {
                let c = [3.293 * (i as f64 + 0.5 * (j % 2) as f64) + 1.0, 3.293 * 0.866 * j as f64 + 2.0];
                if c[0] < 199.0 && c[1] < 199.0 {
                    centres.push(c);
                }
            }
        }
        let light = |c: &[f64; 2], k: usize| {
            let disc = if (c[0] - 90.0).hypot(c[1] - 80.0) < 40.0 { 0.3 } else { 0.0 };
            (0.2 + disc + 0.1 * (0.35 * c[0] + 0.2 * c[1]).sin() + 0.05 * k as f64) as f32
        };
        let values = Array3::from_shape_fn((1, centres.len(), 3), |(_, n, k)| light(&centres[n], k));
        HexSamples {
            sensor: (side, side),
            index: vec![[0, 0]; centres.len()],
            centres,
            views: 1,
            view_step: 1.0,
            values,
            weights: vec![1.0],
        }
    }

    #[test]
    fn measured_samples_stay_true() {
        let samples = samples();
        let dictionary = embedded().unwrap();
        let reconstructor = Reconstructor::new(&dictionary, &Options::default()).unwrap();
        let target = Target { width: 200, height: 200 };
        let values = samples.values.index_axis(ndarray::Axis(0), 0);
        let low = encode::srgb(&barycentric::view(&barycentric::prepare(&samples, &target).unwrap(), values).unwrap());
        let wanted = encoded_luminance(values).unwrap();
        let off = |faithful: &DataConsistent, view: &Array3<f32>| -> (f32, f32) {
            let found = faithful.truth().sample(&luminance(view.view())).unwrap();
            let errors: Vec<f32> = found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).collect();
            let rms = (errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32).sqrt();
            (rms, errors.iter().fold(0.0, |a, &b| a.max(b)))
        };
        let exact =
            DataConsistent::new(&reconstructor, &samples, Interpolation::Barycentric, (200, 200), Some(0.0)).unwrap();
        let (plain, _) = off(&exact, &reconstructor.view(&low).unwrap());
        let (rms, worst) = off(&exact, &exact.view(&low, values).unwrap());
        assert!(rms < 0.001 && worst < 0.02 && rms < 0.3 * plain, "{rms} {worst} against {plain}");
        // Given noise, nothing is moved that noise explains, and the rest to within it.
        let noisy =
            DataConsistent::new(&reconstructor, &samples, Interpolation::Barycentric, (200, 200), Some(0.02)).unwrap();
        let (_, worst) = off(&noisy, &noisy.view(&low, values).unwrap());
        assert!(worst < 0.03, "{worst}");
        // Noise that explains everything leaves the dictionary's view as it is.
        let blind =
            DataConsistent::new(&reconstructor, &samples, Interpolation::Barycentric, (200, 200), Some(10.0)).unwrap();
        let free = reconstructor.view(&low).unwrap();
        assert!((&blind.view(&low, values).unwrap() - &free).iter().all(|d| d.abs() < 1e-5));
        assert!(exact.view(&low, values.slice(ndarray::s![1.., ..])).is_err());
    }

    #[test]
    fn a_refined_view_is_reconstructed_beside_its_own_samples() {
        let samples = samples();
        let dictionary = crate::reconstruct::embedded_for(Interpolation::Multiview).unwrap();
        let reconstructor = Reconstructor::new(&dictionary, &Options::default()).unwrap();
        assert_eq!(reconstructor.beside(), [Interpolation::Barycentric, Interpolation::Cubic]);
        let target = Target { width: 200, height: 200 };
        let values = samples.values.index_axis(ndarray::Axis(0), 0);
        let low = encode::srgb(&barycentric::view(&barycentric::prepare(&samples, &target).unwrap(), values).unwrap());
        let faithful =
            DataConsistent::new(&reconstructor, &samples, Interpolation::Multiview, (200, 200), None).unwrap();
        let found = luminance(faithful.view(&low, values).unwrap().view());
        let truth = faithful.truth();
        let kept = truth.project_onto_samples(&luminance(low.view()), values, true).unwrap();
        let beside: Vec<Array2<f32>> =
            reconstructor.beside().iter().map(|&b| truth.interpolate_own_samples(values, b).unwrap()).collect();
        let by_hand = reconstructor.plane_beside(kept.view(), &beside).unwrap();
        assert!((&found - &by_hand).iter().all(|d| d.abs() < 1e-3));
        // Without what it wants to see, the codes stand in.
        let blind = reconstructor.plane(kept.view()).unwrap();
        let codes = Options { mode: crate::reconstruct::Mode::Lasso, ..Options::default() };
        assert_eq!(blind, Reconstructor::new(&dictionary, &codes).unwrap().plane(kept.view()).unwrap());
        assert!((&blind - &by_hand).iter().any(|d| d.abs() > 1e-3));
        assert!(truth.interpolate_own_samples(values, Interpolation::Bicubic).is_err());
    }
}
