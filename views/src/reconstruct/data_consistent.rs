//! Reconstruction of views whose measured samples are available: views are back-projected onto them, to within their
//! noise.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{Srgb, View};
use ndarray::{Array2, ArrayView2};

use super::guided;
use super::measurements::Measurements;
use super::reconstructor::{Reconstructor, checked_luminance};
use crate::Error;

/// Reconstruction of views whose measured samples are available.
#[derive(Debug, Clone)]
pub struct DataConsistent {
    reconstructor: Reconstructor,
    measurements: Measurements,
    refined: bool,
}

impl DataConsistent {
    /// For views of (width, height) pixels that `interpolation` made of the samples; `noise` as in
    /// [`super::Options::noise`].
    ///
    /// # Errors
    /// Samples that cannot be triangulated, a size out of range.
    pub fn new(
        reconstructor: Reconstructor,
        samples: &HexSamples,
        interpolation: Interpolation,
        size: Size,
        noise: Option<f32>,
    ) -> Result<Self, Error> {
        let model = reconstructor.model();
        let (footprint, pitch) = (model.footprint, model.pitch);
        let measurements = Measurements::new(samples, footprint, pitch, size, noise, reconstructor.side_inputs())?;
        Ok(DataConsistent { reconstructor, measurements, refined: interpolation == Interpolation::Multiview })
    }

    /// Reconstructs a view made from samples of which its own are `values` (lenslets, c), in linear light. Clamped to
    /// 0..1.
    ///
    /// Sampled again at the lenslet centres, a reconstructed interpolated view gives its samples to within their noise
    /// and about 0.001, except where it is clamped. A refined view is moved to its samples where it is clearly off:
    /// before the reconstruction, and after it unless a network with the samples as side inputs made it.
    ///
    /// # Errors
    /// Shapes that do not belong together, errors of the solver.
    pub fn reconstruct_view(&self, low: &View<Srgb>, values: ArrayView2<'_, f32>) -> Result<View<Srgb>, Error> {
        let y = checked_luminance(low.pixels())?;
        let (measurements, wanted) = (&self.measurements, self.reconstructor.side_inputs());
        let noise = measurements.noise(values, self.refined.then_some(&y))?;
        let project = |plane: &Array2<f32>| measurements.project_onto_samples(plane, values, &noise, self.refined);
        // First, since features computed where a refined view is clearly off would be wrong.
        let kept = if self.refined { &project(&y)? } else { &y };
        let inputs = measurements.side_inputs(wanted, kept, values, &noise)?;
        let sharp = self.reconstructor.reconstruct_plane(kept.view(), &inputs)?;
        // A network with side inputs takes account of the samples itself.
        let sharp = if wanted.is_empty() { project(&sharp)? } else { sharp };
        Ok(View::new(guided::with_luminance(low.pixels(), &y, &sharp, self.reconstructor.colour_radius())))
    }

    /// The dictionary's model made ready.
    #[must_use]
    pub fn reconstructor(&self) -> &Reconstructor {
        &self.reconstructor
    }

    /// The measured samples and their noise.
    #[must_use]
    pub fn measurements(&self) -> &Measurements {
        &self.measurements
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolate::prepare_interpolator;
    use crate::reconstruct::measurements::encoded_luminance;
    use crate::reconstruct::{Available, Options, embedded_dictionary};
    use lenslet_core::colour::luminance;
    use lenslet_core::dictionary::SideInput;
    use lenslet_core::geometry::Size;
    use lenslet_core::lightfield::Linear;
    use ndarray::Array3;

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
            sensor: Size::new(side, side),
            index: vec![[0, 0]; centres.len()],
            centres,
            views: 1,
            view_step: 1.0,
            values,
            weights: vec![1.0],
        }
    }

    /// The first view of the samples, interpolated barycentrically.
    fn interpolated(samples: &HexSamples, target: &Size) -> View<Srgb> {
        let interpolator = prepare_interpolator(Interpolation::Barycentric, samples, target).unwrap();
        let values = samples.values.index_axis(ndarray::Axis(0), 0);
        View::<Linear>::new(interpolator.interpolate_view(values).unwrap()).encode()
    }

    #[test]
    fn measured_samples_stay_true() {
        let samples = samples();
        let dictionary = embedded_dictionary().unwrap();
        let reconstructor = Reconstructor::new(&dictionary, &Options::default()).unwrap();
        let target = Size { width: 200, height: 200 };
        let values = samples.values.index_axis(ndarray::Axis(0), 0);
        let low = interpolated(&samples, &target);
        let wanted = encoded_luminance(values).unwrap();
        let off = |consistent: &DataConsistent, view: &View<Srgb>| -> (f32, f32) {
            let found = consistent.measurements().sample_plane(&luminance(view.pixels().view())).unwrap();
            let errors: Vec<f32> = found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).collect();
            let rms = (errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32).sqrt();
            (rms, errors.iter().fold(0.0, |a, &b| a.max(b)))
        };
        let exact = DataConsistent::new(
            reconstructor.clone(),
            &samples,
            Interpolation::Barycentric,
            Size::new(200, 200),
            Some(0.0),
        )
        .unwrap();
        let (plain, _) = off(&exact, &reconstructor.reconstruct_view(&low).unwrap());
        let (rms, worst) = off(&exact, &exact.reconstruct_view(&low, values).unwrap());
        assert!(rms < 0.001 && worst < 0.02 && rms < 0.3 * plain, "{rms} {worst} against {plain}");
        // With noise given, differences within it are left alone, and larger ones reduced to it.
        let noisy = DataConsistent::new(
            reconstructor.clone(),
            &samples,
            Interpolation::Barycentric,
            Size::new(200, 200),
            Some(0.02),
        )
        .unwrap();
        let (_, worst) = off(&noisy, &noisy.reconstruct_view(&low, values).unwrap());
        assert!(worst < 0.03, "{worst}");
        // With noise larger than every difference the dictionary's view is unchanged.
        let blind = DataConsistent::new(
            reconstructor.clone(),
            &samples,
            Interpolation::Barycentric,
            Size::new(200, 200),
            Some(10.0),
        )
        .unwrap();
        let free = reconstructor.reconstruct_view(&low).unwrap();
        assert!(
            (blind.reconstruct_view(&low, values).unwrap().pixels() - free.pixels()).iter().all(|d| d.abs() < 1e-5)
        );
        assert!(exact.reconstruct_view(&low, values.slice(ndarray::s![1.., ..])).is_err());
    }

    #[test]
    fn a_refined_view_is_reconstructed_with_its_own_samples() {
        let samples = samples();
        let dictionary = crate::reconstruct::embedded_dictionary_for(Interpolation::Multiview).unwrap();
        let reconstructor = Reconstructor::with(&dictionary, &Options::default(), Available::Samples).unwrap();
        assert_eq!(reconstructor.side_inputs(), [SideInput::Barycentric, SideInput::Cubic, SideInput::Noise]);
        let target = Size { width: 200, height: 200 };
        let values = samples.values.index_axis(ndarray::Axis(0), 0);
        let low = interpolated(&samples, &target);
        let faithful =
            DataConsistent::new(reconstructor.clone(), &samples, Interpolation::Multiview, Size::new(200, 200), None)
                .unwrap();
        let found = luminance(faithful.reconstruct_view(&low, values).unwrap().pixels().view());
        let truth = faithful.measurements();
        let refined = luminance(low.pixels().view());
        let noise = truth.noise(values, Some(&refined)).unwrap();
        let kept = truth.project_onto_samples(&refined, values, &noise, true).unwrap();
        let beside = truth.side_inputs(reconstructor.side_inputs(), &kept, values, &noise).unwrap();
        let by_hand = reconstructor.reconstruct_plane(kept.view(), &beside).unwrap();
        assert!((&found - &by_hand).iter().all(|d| d.abs() < 1e-3));
        // It does not run without its side inputs.
        assert!(reconstructor.reconstruct_plane(kept.view(), &[]).is_err());
        // No codes: nothing but the samples put back.
        let options = Options {
            mode: crate::reconstruct::Mode::Only(lenslet_core::dictionary::PatchPredictor::NoCodes),
            ..Options::default()
        };
        let nothing = Reconstructor::with(&dictionary, &options, Available::Samples).unwrap();
        assert_eq!(nothing.reconstruct_plane(kept.view(), &[]).unwrap(), kept);
    }
}
