//! Learned reconstruction of a plane (paper section 4.4, eq. (4)): predict the residual of every overlapping patch of
//! the low image, add their weighted mean.

use std::sync::Arc;

use ndarray::{Array2, ArrayView2};

use super::error::Error;
use super::features::pad_mirrored;
use super::model::Model;
use super::options::ReconstructionOptions;
use super::overlap_add::{add_residuals, mirrored_copy};
use super::patch_model::PatchPredictor;
use super::predict::{self, PredictPatches};
use super::side_input::SideInput;

/// A model prepared for the reconstruction of planes.
///
/// ```
/// use lenslet_core::dictionary::{self, Footprint, PatchPredictor, PlaneReconstructor, ReconstructionOptions};
/// use ndarray::Array2;
///
/// # let bytes = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"));
/// let dictionary = dictionary::from_bytes(bytes, "golden-1.lfd")?;
/// let model = dictionary.model(Footprint::Point).ok_or("no model")?;
/// let options = ReconstructionOptions { predictor: PatchPredictor::Ridge, step: 1, ..Default::default() };
/// let low = Array2::from_shape_fn((24, 30), |(y, x)| 0.5 + 0.2 * (0.8 * x as f32 + 0.3 * y as f32).sin());
/// let sharp = PlaneReconstructor::new(model, &options)?.reconstruct_plane(low.view(), &[])?;
/// assert_eq!(sharp.dim(), (24, 30));
/// assert_ne!(sharp, low);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct PlaneReconstructor {
    model: Arc<Model>,
    options: ReconstructionOptions,
    predictor: Arc<dyn PredictPatches>,
}

impl PlaneReconstructor {
    /// Prepares a copy of a model.
    ///
    /// # Errors
    /// [`Error::Parameter`] for options out of range; [`Error::NoPredictor`] for a predictor that the model does not
    /// hold; [`Error::Sparse`] for atoms that the solver refuses.
    pub fn new(model: &Model, options: &ReconstructionOptions) -> Result<Self, Error> {
        options.check()?;
        let parts = &model.patch_model;
        let patch = match (options.predictor, &parts.network) {
            (PatchPredictor::Network, Some(network)) => network.patch().min(parts.patch),
            _ => parts.patch,
        };
        if options.step == 0 || options.step > patch {
            return Err(Error::Parameter(format!(
                "a step of {} pixels between patches of {patch}: it must be 1 to {patch}",
                options.step
            )));
        }
        let model = Arc::new(model.clone());
        let predictor = predict::prepare(&model, options)?;
        Ok(PlaneReconstructor { model, options: options.clone(), predictor })
    }

    /// The model in use.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The images of the view that the predictor in use takes besides the low one: only a network has any.
    #[must_use]
    pub fn side_inputs(&self) -> &[SideInput] {
        self.predictor.side_inputs()
    }

    /// Reconstructs a plane (t, s) of luminance, sRGB-encoded, 0..1. The result is not clamped.
    ///
    /// `low` is the low image, `side_inputs` are images of the same size in the order of
    /// [`PlaneReconstructor::side_inputs`]; further ones are not looked at. Values that are not finite count as 0.
    /// Memory: about ten planes.
    ///
    /// # Errors
    /// [`Error::NoSideInputs`] where the network's are missing; [`Error::Parameter`] for side inputs of another size;
    /// what the sparse solver reports.
    pub fn reconstruct_plane(
        &self,
        low: ArrayView2<'_, f32>,
        side_inputs: &[Array2<f32>],
    ) -> Result<Array2<f32>, Error> {
        if let Some(other) = side_inputs.iter().find(|side| side.dim() != low.dim()) {
            return Err(Error::Parameter(format!(
                "a side input of {:?} pixels for a low image of {:?}",
                other.dim(),
                low.dim()
            )));
        }
        let taken = self.side_inputs();
        if side_inputs.len() < taken.len() {
            return Err(Error::no_side_inputs(taken));
        }
        let side_inputs = &side_inputs[..taken.len()];
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        let mut sum = Array2::<f32>::zeros(low.dim());
        if low.is_empty() {
            return Ok(sum);
        }
        for copy in 0..self.options.ensemble {
            let inputs = std::iter::once(low.view()).chain(side_inputs.iter().map(|side| side.view()));
            let planes: Vec<Array2<f32>> = inputs.map(|plane| mirrored_copy(plane, copy).mapv(finite)).collect();
            let result = self.reconstruct_copy(&planes)?;
            sum += &mirrored_copy(result.view(), copy);
        }
        if self.options.ensemble > 1 {
            sum /= self.options.ensemble as f32;
        }
        Ok(sum)
    }

    /// One mirrored copy: the low image, then the side inputs there are.
    fn reconstruct_copy(&self, planes: &[Array2<f32>]) -> Result<Array2<f32>, Error> {
        let predictor = &self.predictor;
        let (low, margin) = (&planes[0], predictor.support() / 2);
        let mut padded = vec![pad_mirrored(low.view(), margin)];
        padded.extend(planes[1..].iter().map(|side| pad_mirrored((side - low).view(), margin)));
        add_residuals(low, predictor.patch(), self.options.step, self.options.spread, &|centres| {
            // A window's top left corner in the padded plane is where its centre is in the plane.
            predictor.predict(&padded, centres)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dictionary::features::extract_features;
    use crate::dictionary::patch_model::PatchModel;
    use crate::dictionary::predict::network_tests::random_network;
    use crate::dictionary::validate::tests::small_dictionary;
    use crate::sparse;

    fn plane(h: usize, w: usize) -> Array2<f32> {
        Array2::from_shape_fn((h, w), |(y, x)| 0.5 + 0.3 * ((x * x + 2 * y) as f32 * 0.11).sin())
    }

    /// The definition: every patch by itself, textbook solver, sums in f64.
    fn plain(parts: &PatchModel, low: &Array2<f32>, step: usize, predictor: PatchPredictor) -> Array2<f32> {
        let (h, w) = low.dim();
        let (m, p, r) = (parts.support / 2, parts.patch, parts.patch / 2);
        let padded = pad_mirrored(low.view(), m);
        let (mut sums, mut totals) = (Array2::<f64>::zeros((h, w)), Array2::<f64>::zeros((h, w)));
        let solver = sparse::prepare(parts.low.view()).unwrap();
        let centres = |n: usize| (0..n).filter(move |i| i % step == 0 || *i == n - 1);
        for y in centres(h) {
            for x in centres(w) {
                let f = extract_features(
                    std::slice::from_ref(&padded),
                    parts.support,
                    &parts.filters,
                    &[parts.filters.nrows()],
                    &[(y, x)],
                );
                let norm = f.row(0).dot(&f.row(0)).sqrt().max(parts.floor);
                let patch = match predictor {
                    PatchPredictor::NoCodes => ndarray::Array1::zeros(p * p),
                    PatchPredictor::Ridge | PatchPredictor::Network => f.row(0).dot(&parts.ridge),
                    PatchPredictor::Anchored => {
                        let a = parts.anchored.as_ref().unwrap();
                        let c = a.anchors.dot(&f.row(0)).mapv(f32::abs);
                        let best = (0..c.len()).max_by(|&i, &j| c[i].total_cmp(&c[j])).unwrap();
                        f.row(0).dot(&a.maps.index_axis(ndarray::Axis(0), best))
                    }
                    PatchPredictor::Lasso => {
                        let options = sparse::Options {
                            solver: sparse::Solver::CoordinateDescent,
                            penalty: sparse::Penalty::Lambda(parts.lambda),
                            tolerance: 1e-8,
                            ..sparse::Options::default()
                        };
                        let y = f.mapv(|v| v / norm);
                        let codes = sparse::solve(&solver, y.view(), &options).unwrap();
                        let mut t = ndarray::Array1::zeros(p * p);
                        codes.signal(0).for_each(|(k, v)| t.scaled_add(v * norm, &parts.high.row(k)));
                        t
                    }
                };
                for i in 0..p * p {
                    let (Some(v), Some(u)) = ((y + i / p).checked_sub(r), (x + i % p).checked_sub(r)) else { continue };
                    if v < h && u < w {
                        sums[[v, u]] += f64::from(patch[i]);
                        totals[[v, u]] += 1.0;
                    }
                }
            }
        }
        Array2::from_shape_fn((h, w), |i| low[i] + (sums[i] / totals[i]) as f32)
    }

    #[test]
    fn bands_equal_the_definition() {
        let model = &small_dictionary(4).models[0];
        for predictor in
            [PatchPredictor::Lasso, PatchPredictor::Anchored, PatchPredictor::Ridge, PatchPredictor::NoCodes]
        {
            for (h, w, step) in [(31, 23, 2), (20, 41, 1), (9, 9, 3), (1, 12, 2), (1, 1, 1)] {
                let low = plane(h, w);
                let options = ReconstructionOptions { predictor, step, ..ReconstructionOptions::default() };
                let fast =
                    PlaneReconstructor::new(model, &options).unwrap().reconstruct_plane(low.view(), &[]).unwrap();
                let slow = plain(&model.patch_model, &low, step, predictor);
                for (a, b) in fast.iter().zip(&slow) {
                    assert!((a - b).abs() < 2e-3, "{predictor:?} {h}x{w}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn the_network_takes_its_side_inputs_and_is_replaced_by_nothing() {
        let mut model = small_dictionary(4).models[0].clone();
        let lasso = PlaneReconstructor::new(&model, &ReconstructionOptions::default()).unwrap();
        let options =
            ReconstructionOptions { predictor: PatchPredictor::Network, step: 1, ..ReconstructionOptions::default() };
        let low = plane(21, 26);
        let other = low.mapv(|v| v * v);
        // A model without a network, or without anchors, says so and what it has.
        let refused = PlaneReconstructor::new(&model, &options).unwrap_err();
        assert_eq!(refused.to_string(), "the dictionary has no network; it has no codes, ridge, anchored, LASSO");
        let mut bare = model.clone();
        bare.patch_model.anchored = None;
        let anchored =
            ReconstructionOptions { predictor: PatchPredictor::Anchored, ..ReconstructionOptions::default() };
        let refused = PlaneReconstructor::new(&bare, &anchored).unwrap_err().to_string();
        assert_eq!(refused, "the dictionary has no anchored regressors; it has no codes, ridge, LASSO");
        let network = random_network(5, &[SideInput::Cubic]);
        model.patch_model.network = Some(network.clone());
        let r = PlaneReconstructor::new(&model, &options).unwrap();
        assert_eq!((r.side_inputs(), lasso.side_inputs()), (&[SideInput::Cubic][..], &[][..]));
        assert!(matches!(r.reconstruct_plane(low.view(), &[]), Err(Error::NoSideInputs { .. })));
        assert!(r.reconstruct_plane(low.view(), &[plane(3, 3)]).is_err());
        assert!(PlaneReconstructor::new(&model, &ReconstructionOptions { step: 4, ..options.clone() }).is_err());
        // With a network, the mean of the patches that the definition gives.
        let found = r.reconstruct_plane(low.view(), std::slice::from_ref(&other)).unwrap();
        let padded = [pad_mirrored(low.view(), 3), pad_mirrored((&other - &low).view(), 3)];
        for (y, x) in [(0, 0), (10, 11), (20, 25), (3, 24)] {
            let (mut sum, mut count) = (0.0, 0.0);
            for (dy, dx) in (0..9).map(|i| (i / 3, i % 3)) {
                let (Some(v), Some(u)) = ((y + dy as usize).checked_sub(1), (x + dx as usize).checked_sub(1)) else {
                    continue;
                };
                if v < 21 && u < 26 {
                    let patch = network.residuals(&network.features(&padded, &[(v, u)]));
                    sum += patch[[0, 8 - (3 * dy as usize + dx as usize)]];
                    count += 1.0;
                }
            }
            assert!((found[[y, x]] - low[[y, x]] - sum / count).abs() < 1e-4, "{y} {x}");
        }
        // A flat plane stays flat.
        let flat = Array2::from_elem((15, 15), 0.4f32);
        assert!(
            r.reconstruct_plane(flat.view(), std::slice::from_ref(&flat))
                .unwrap()
                .iter()
                .all(|v| (v - 0.4).abs() < 1e-3)
        );
    }

    #[test]
    fn threads_do_not_matter() {
        let model = &small_dictionary(4).models[0];
        let run = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                PlaneReconstructor::new(model, &ReconstructionOptions::default())
                    .unwrap()
                    .reconstruct_plane(plane(70, 50).view(), &[])
                    .unwrap()
            })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn flat_planes_stay_flat_and_odd_input_is_accepted() {
        let model = &small_dictionary(4).models[0];
        for ensemble in [1, 2, 4] {
            let options = ReconstructionOptions { ensemble, ..ReconstructionOptions::default() };
            let r = PlaneReconstructor::new(model, &options).unwrap();
            let flat = Array2::from_elem((20, 30), 0.25f32);
            assert!(r.reconstruct_plane(flat.view(), &[]).unwrap().iter().all(|v| (v - 0.25).abs() < 1e-3));
            assert_eq!(r.reconstruct_plane(Array2::zeros((0, 5)).view(), &[]).unwrap().dim(), (0, 5));
            let nan = Array2::from_elem((12, 9), f32::NAN);
            assert!(r.reconstruct_plane(nan.view(), &[]).unwrap().iter().all(|v| v.is_finite()));
        }
        assert!(
            PlaneReconstructor::new(model, &ReconstructionOptions { step: 0, ..ReconstructionOptions::default() })
                .is_err()
        );
        assert!(
            PlaneReconstructor::new(model, &ReconstructionOptions { step: 4, ..ReconstructionOptions::default() })
                .is_err()
        );
        assert!(
            PlaneReconstructor::new(model, &ReconstructionOptions { ensemble: 3, ..ReconstructionOptions::default() })
                .is_err()
        );
    }

    #[test]
    fn a_mirrored_plane_gives_the_mirrored_ensemble() {
        let model = &small_dictionary(4).models[0];
        let r = PlaneReconstructor::new(
            model,
            &ReconstructionOptions { ensemble: 4, step: 1, ..ReconstructionOptions::default() },
        )
        .unwrap();
        let low = plane(24, 18);
        let mut turned = low.clone();
        turned.invert_axis(ndarray::Axis(0));
        let a = r.reconstruct_plane(low.view(), &[]).unwrap();
        let mut b = r.reconstruct_plane(turned.view(), &[]).unwrap();
        b.invert_axis(ndarray::Axis(0));
        assert!((&a - &b).iter().all(|d| d.abs() < 1e-4));
    }
}
