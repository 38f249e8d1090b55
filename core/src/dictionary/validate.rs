//! Checks of a dictionary, applied whenever one is read or written; reconstruction relies on them.

use ndarray::Array2;

use super::error::Error;
use super::limits;
use super::model::Dictionary;
use super::patch_model::PatchModel;
use super::predict::check_predictors;

/// Checks that a dictionary's shapes fit each other and [`limits`], its numbers are finite and its atoms have unit norm
/// (to 1e-3). Every dictionary that is read or written is checked.
///
/// # Errors
/// [`Error::Parameter`] that says what is wrong.
pub fn validate(dictionary: &Dictionary) -> Result<(), Error> {
    let wrong = |what: String| Err(Error::Parameter(what));
    if dictionary.models.is_empty() || dictionary.models.len() > limits::PARTS {
        return wrong(format!("a dictionary has 1 to {} models, not {}", limits::PARTS, dictionary.models.len()));
    }
    for model in &dictionary.models {
        if !(model.pitch.is_finite() && model.pitch > 0.0) {
            return wrong(format!("pitch {} is not a positive number", model.pitch));
        }
        check_patch_model(&model.patch_model)?;
    }
    Ok(())
}

fn check_patch_model(parts: &PatchModel) -> Result<(), Error> {
    let wrong = |what: String| Err(Error::Parameter(what));
    let (p2, m) = (parts.patch * parts.patch, parts.filters.nrows());
    if parts.support > limits::SIDE
        || parts.patch > parts.support
        || parts.support.is_multiple_of(2)
        || parts.patch.is_multiple_of(2)
    {
        return wrong(format!("window of {} and patch of {} pixels do not fit", parts.support, parts.patch));
    }
    if m == 0 || m > limits::FEATURES || parts.filters.ncols() != parts.support * parts.support {
        return wrong(format!("feature filters have shape {:?}", parts.filters.dim()));
    }
    let k = parts.low.nrows();
    if k == 0 || k > limits::ATOMS || parts.low.ncols() != m || parts.high.dim() != (k, p2) {
        return wrong(format!("atoms have shapes {:?} and {:?}", parts.low.dim(), parts.high.dim()));
    }
    if parts.ridge.dim() != (m, p2) {
        return wrong(format!("the ridge regressor has shape {:?}", parts.ridge.dim()));
    }
    if !(parts.floor > 0.0 && parts.floor.is_finite() && parts.lambda >= 0.0 && parts.lambda.is_finite()) {
        return wrong(format!("floor {} or λ {} is out of range", parts.floor, parts.lambda));
    }
    let finite = |a: &Array2<f32>| a.iter().all(|v| v.is_finite());
    if !(finite(&parts.filters) && finite(&parts.low) && finite(&parts.high) && finite(&parts.ridge)) {
        return wrong("a value is not finite".into());
    }
    let unit = |a: &Array2<f32>| a.rows().into_iter().all(|r| (r.dot(&r).sqrt() - 1.0).abs() < 1e-3);
    if !unit(&parts.low) {
        return wrong("an atom of Dl does not have unit norm".into());
    }
    check_predictors(parts)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::model::{Footprint, Model, Storage};
    use super::super::patch_model::{Anchored, Network};
    use super::super::predict::network_tests::random_network;
    use super::super::recipe::{Photo, Recipe};
    use super::super::side_input::SideInput;
    use super::*;
    use crate::interpolation::Interpolation;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// A small valid dictionary of random numbers.
    pub(crate) fn small_dictionary(seed: u64) -> Dictionary {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (support, patch, m, k) = (7, 3, 5, 8);
        let mut random = |rows, columns| Array2::from_shape_fn((rows, columns), |_| rng.random::<f32>() - 0.5);
        let unit = |mut a: Array2<f32>| {
            a.rows_mut().into_iter().for_each(|mut r| {
                let n = r.dot(&r).sqrt();
                r /= n;
            });
            a
        };
        let mut filters = random(m, support * support);
        filters.rows_mut().into_iter().for_each(|mut r| {
            let mean = r.sum() / (support * support) as f32;
            r -= mean;
        });
        let maps = random(4 * m, patch * patch).into_shape_with_order((4, m, patch * patch)).unwrap();
        let patch_model = PatchModel {
            support,
            patch,
            filters,
            floor: 0.05,
            lambda: 0.1,
            low: unit(random(k, m)),
            high: random(k, patch * patch),
            ridge: random(m, patch * patch),
            anchored: Some(Anchored { anchors: unit(random(4, m)), maps }),
            network: None,
        };
        let model = Model { footprint: Footprint::Point, base: Interpolation::Barycentric, pitch: 3.3, patch_model };
        let mut recipe = Recipe { tool: "test".into(), seed, ..Recipe::default() };
        recipe.parameters.insert("atoms".into(), 8.into());
        recipe.photos.push(Photo { file: "a.jpg".into(), sha256: "00".into() });
        Dictionary { recipe, storage: Storage::F32, models: vec![model] }
    }

    #[test]
    fn invalid_dictionaries_are_named() {
        assert!(validate(&small_dictionary(1)).is_ok());
        let mut bad = small_dictionary(1);
        bad.models[0].patch_model.low[[0, 0]] += 1.0;
        assert!(validate(&bad).unwrap_err().to_string().contains("unit norm"));
        let mut bad = small_dictionary(1);
        bad.models[0].patch_model.high[[0, 0]] = f32::NAN;
        assert!(validate(&bad).unwrap_err().to_string().contains("not finite"));
        let mut bad = small_dictionary(1);
        bad.models[0].patch_model.patch = 9;
        assert!(validate(&bad).is_err());
        let mut bad = small_dictionary(1);
        bad.models.clear();
        assert!(validate(&bad).is_err());
    }

    #[test]
    fn networks_that_do_not_fit_are_named() {
        let good = random_network(1, &[SideInput::Cubic]);
        let wrong = |change: &dyn Fn(&mut Network)| {
            let mut bad = good.clone();
            change(&mut bad);
            let mut parts = small_dictionary(1).models[0].patch_model.clone();
            parts.network = Some(bad);
            check_predictors(&parts).unwrap_err().to_string()
        };
        assert!(wrong(&|n| n.filters_per_input[0] += 1).contains("groups"));
        assert!(wrong(&|n| n.layers[0].bias[0] = f32::NAN).contains("finite"));
        assert!(wrong(&|n| n.layers.truncate(1)).contains("patch"));
        assert!(wrong(&|n| n.support = 8).contains("window"));
        assert!(wrong(&|n| n.layers[1].weights = Array2::zeros((9, 8))).contains("layer"));
    }

    #[test]
    fn each_range_is_checked_by_itself() {
        let with = |change: fn(&mut PatchModel)| {
            let mut dictionary = small_dictionary(1);
            change(&mut dictionary.models[0].patch_model);
            validate(&dictionary).is_ok()
        };
        assert!(with(|p| p.lambda = 0.0) && with(|p| p.floor = 1e-6));
        assert!(!with(|p| p.lambda = -0.1) && !with(|p| p.lambda = f32::NAN));
        assert!(!with(|p| p.floor = 0.0) && !with(|p| p.floor = f32::INFINITY) && !with(|p| p.floor = -1.0));
        assert!(!with(|p| p.support = 9) && !with(|p| p.patch = 9) && !with(|p| p.support = 67));
        assert!(!with(|p| p.filters = Array2::zeros((5, 48))));
        let anchored = |p: &mut PatchModel| p.anchored.take().unwrap();
        let with_anchored = |change: fn(&mut Anchored)| {
            let mut dictionary = small_dictionary(1);
            let mut changed = anchored(&mut dictionary.models[0].patch_model);
            change(&mut changed);
            dictionary.models[0].patch_model.anchored = Some(changed);
            validate(&dictionary).is_ok()
        };
        assert!(with_anchored(|_| ()));
        assert!(!with_anchored(|a| a.maps = ndarray::Array3::zeros((3, 5, 9))));
        assert!(!with_anchored(|a| a.maps = ndarray::Array3::zeros((4, 5, 8))));
        assert!(!with_anchored(|a| a.anchors[[2, 1]] += 0.01));
        let mut network = small_dictionary(1);
        let mut bad = random_network(5, &[]);
        bad.floor = 0.0;
        network.models[0].patch_model.network = Some(bad);
        assert!(validate(&network).is_err());
    }
}
