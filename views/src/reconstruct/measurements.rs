//! What was measured in every view: samples at their places, their noise, and how a view is moved towards them.

use lenslet_core::colour::{LUMINANCE, srgb_encode};
use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::{Footprint, SideInput};
use lenslet_core::ensure;
use lenslet_core::geometry::SensorToView;
use lenslet_core::geometry::Size;
use lenslet_core::noise::NoiseCurve;
use lenslet_core::sampling::Cubic;
use ndarray::{Array2, ArrayView2, Axis};

use super::noise::{Neighbours, estimate_noise, estimate_noise_beside};
use super::sampling_operator::{SamplingOperator, back_project};
use crate::Error;

/// Rounds of back-projection.
///
/// Source: chosen; what is left after four is below 0.001 RMS without noise (`measured_samples_stay_true`).
const ROUNDS: usize = 4;
/// Tolerance for views interpolated from the samples themselves, in parts of σ: differences up to it are left alone.
///
/// Source: chosen on simulated captures of four noise levels (docs/learned-reconstruction.md).
const OWN: f32 = 0.5;
/// Tolerance for multiview-refined views, in parts of the noise and of the range: many samples made them, so they are
/// off by less than one sample is, mismatches excepted.
///
/// Source: chosen on simulated captures.
const REFINED: (f32, f32) = (1.5, 0.01);

/// What was measured in every view, and how noisy it is.
#[derive(Debug, Clone)]
pub struct Measurements {
    operator: SamplingOperator,
    cubic: Option<Cubic>,
    neighbours: Neighbours,
    given: Option<f32>,
}

impl Measurements {
    /// Samples that see `footprint` (`pitch` output pixels wide), for views of (width, height) pixels; `noise` as in
    /// [`super::Options::noise`]; `wanted`: what [`Measurements::side_inputs`] can then give.
    ///
    /// # Errors
    /// Samples that cannot be triangulated, a size out of range.
    pub fn new(
        samples: &HexSamples,
        footprint: Footprint,
        pitch: f64,
        size: Size,
        noise: Option<f32>,
        wanted: &[SideInput],
    ) -> Result<Self, Error> {
        let centres = SensorToView::new(samples.sensor, size).all_to_view(&samples.centres);
        let neighbours = Neighbours::new(&centres)?;
        let cubic = if wanted.contains(&SideInput::Cubic) { Some(Cubic::new(&centres, size, size)?) } else { None };
        Ok(Measurements {
            operator: SamplingOperator::new(centres, footprint, pitch, size)?,
            cubic,
            neighbours,
            given: noise,
        })
    }

    /// Noise of a view's samples (lenslets, 1 or 3 channels; linear light) over their brightness, both sRGB-encoded:
    /// what was given, or what a view that all the others made (`refined`, its luminance) leaves of the samples where it
    /// fits best, or an estimate from the samples themselves.
    ///
    /// # Errors
    /// Another number of channels, an empty view.
    pub fn noise(&self, values: ArrayView2<'_, f32>, refined: Option<&Array2<f32>>) -> Result<NoiseCurve, Error> {
        if let Some(sigma) = self.given {
            return Ok(NoiseCurve::constant(if sigma.is_finite() { sigma.max(0.0) } else { 0.0 }));
        }
        let samples = encoded_luminance(values)?;
        if let Some(plane) = refined {
            return Ok(estimate_noise_beside(&samples, &self.sample_plane(plane)?, &self.neighbours));
        }
        let encode = |v: f32| srgb_encode(v.clamp(0.0, 1.0));
        let colours: Option<Vec<f32>> =
            (values.ncols() == 3).then(|| values.rows().into_iter().map(|v| encode(v[0]) - encode(v[1])).collect());
        Ok(estimate_noise(&samples, colours.as_deref(), &self.neighbours))
    }

    /// Moves a view's luminance (t, s), sRGB-encoded, towards its samples: differences within the noise are left. Views
    /// that all the others made (`refined`) are moved only where they are clearly off.
    ///
    /// # Errors
    /// Shapes that do not belong together.
    pub fn project_onto_samples(
        &self,
        plane: &Array2<f32>,
        values: ArrayView2<'_, f32>,
        noise: &NoiseCurve,
        refined: bool,
    ) -> Result<Array2<f32>, Error> {
        let samples = encoded_luminance(values)?;
        let (part, least) = if refined { REFINED } else { (OWN, 0.0) };
        let left: Vec<f32> = samples.iter().map(|&s| part * noise.noise_at(s) + least).collect();
        Ok(back_project(plane, &self.operator, ndarray::aview1(&samples), ROUNDS, &left)?.0)
    }

    /// What a network takes besides the luminance `low` of a view, sRGB-encoded, whose own samples are `values`: images of
    /// its shape, in the order of `wanted`.
    ///
    /// # Errors
    /// Another number of samples; a cubic image where none was wanted of [`Measurements::new`].
    pub fn side_inputs(
        &self,
        wanted: &[SideInput],
        low: &Array2<f32>,
        values: ArrayView2<'_, f32>,
        noise: &NoiseCurve,
    ) -> Result<Vec<Array2<f32>>, Error> {
        let samples = encoded_luminance(values)?;
        let image = |input: &SideInput| match (input, &self.cubic) {
            (SideInput::Noise, _) => Ok(low.mapv(|v| v + noise.noise_at(v))),
            (SideInput::Barycentric, _) => Ok(self.operator.interpolate(&samples)?),
            (SideInput::Cubic, Some(cubic)) => {
                let plane = cubic.apply(ndarray::aview1(&samples).insert_axis(Axis(1)))?;
                Ok(plane.index_axis_move(Axis(2), 0).mapv(|v| v.clamp(0.0, 1.0)))
            }
            (SideInput::Cubic, None) => {
                Err(Error::Parameter("no cubic image of a view's own samples was prepared".into()))
            }
        };
        wanted.iter().map(image).collect()
    }

    /// A view's luminance sampled at the lenslet centres.
    ///
    /// # Errors
    /// An empty plane.
    pub fn sample_plane(&self, plane: &Array2<f32>) -> Result<Vec<f32>, Error> {
        Ok(self.operator.sample(plane)?.into_raw_vec_and_offset().0)
    }
}

/// Luminance of samples (lenslets, 1 or 3 channels) in linear light, as encoded views have it.
pub(super) fn encoded_luminance(values: ArrayView2<'_, f32>) -> Result<Vec<f32>, Error> {
    let channels = values.ncols();
    ensure!(Error::Shape, channels == 1 || channels == 3, "samples of {channels} channels: 1 or 3 are needed");
    let encode = |v: f32| srgb_encode(v.clamp(0.0, 1.0));
    Ok(values
        .rows()
        .into_iter()
        .map(|v| match channels {
            1 => encode(v[0]),
            _ => v.iter().zip(LUMINANCE).map(|(&v, w)| w * encode(v)).sum(),
        })
        .collect())
}
