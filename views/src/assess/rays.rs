//! Rays: the samples of other views, each put where its ray meets the middle view, between that view's own samples.
//!
//! With x = p − D(x)·u the place of the sample f at p of view u, a picture I errs by e = I(x) − f, I(x) its mean over a disc
//! of one pitch around x, as a lenslet gathers it: of linear light, both then sRGB-encoded luminance. D is one map for all
//! pictures. The lenslets whose samples are foretold are
//! withheld from the refinement by other views; the middle view keeps all of its own. From e its local
//! mean by view is taken out (what white images leave), and the places that the mean of two methods misses most are left
//! out (surfaces hidden in one of the views).

use lenslet_core::decode::HexSamples;
use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use lenslet_core::image::Plane;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::progress::Observer;
use lenslet_core::sampling::{Footprint, sample_image};
use ndarray::{Array2, Array3, ArrayView3};

use super::nearest::NearestPlace;
use super::picture::{encode, encoded_light, light_of, linear_light, mean_of};
use super::ray_places::{RayPlaces, sample_points, view_steps};
use super::statistics::{Difference, SquaredErrors};
use super::withheld::{is_withheld, least_squares_without_foretold};
use crate::Error;
use crate::multiview::{self, Fit, RefinedViews, SampleSet};
use crate::renderer::InterpolatedViews;
use crate::target::{mean_pitch, view_pitch};

/// Offsets of the views whose samples are foretold, in pitches: the longer of |u| and |v|, and |u| + |v| at most.
///
/// Source: chosen: far enough that rays meet the middle view between its samples, and still in full light.
const OFFSETS: [f64; 3] = [0.19, 0.31, 0.52];

/// Least distance of a ray from every lenslet centre of the middle view, pitches.
///
/// Source: chosen.
const LEAST_DISTANCE: f64 = 0.3;

/// Share of the places of a view that are left out as hidden surfaces.
///
/// Source: chosen.
const LEFT_OUT: f64 = 0.02;

/// Standard deviation of the local mean that is taken out, pitches.
///
/// Source: chosen: far wider than what lenslets resolve.
const BROAD: f64 = 9.2;

/// Rays of a view from which it is measured.
///
/// Source: chosen.
const LEAST_RAYS: usize = 200;

/// A ray: whose sample, where, and what it measured.
#[derive(Debug, Clone, Copy)]
struct Ray {
    lenslet: u32,
    x: f32,
    y: f32,
    value: f32,
}

/// The rays of a capture that foretell its middle view. They depend on the capture alone, not on the methods compared.
pub struct Rays {
    size: Size,
    pitch: f64,
    lenslets: usize,
    /// By view.
    views: Vec<Vec<Ray>>,
    disparity: Array2<f32>,
    refined: Array3<f32>,
    refined_from_all: Array3<f32>,
    barycentric: Array3<f32>,
}

impl Rays {
    /// Finds the rays of `samples` in a middle view of `size`. Takes one search of disparity and a few
    /// refinements of the middle view.
    ///
    /// # Errors
    /// [`Error::Shape`] where fewer than 200 rays can be told; errors of the refinement; interruption.
    pub fn find(samples: &HexSamples, size: &Size, observer: &dyn Observer) -> Result<Rays, Error> {
        ensure!(
            Error::Shape,
            samples.index.len() == samples.centres.len(),
            "the samples contradict each other: {} lattice indices of {} lenslets",
            samples.index.len(),
            samples.centres.len()
        );
        observer.check()?;
        observer.begin("rays", 0);
        let middle = samples.views / 2;
        let set = SampleSet::hexagonal(samples, size)?;
        let options = multiview::Options { fit: Fit::LeastSquares, ..multiview::Options::default() };
        let all = RefinedViews::estimate(set, &options, observer)?;
        let refined_from_all = all.render_view(middle, middle)?;
        let disparity = all.disparities().middle.disparity.clone();
        drop(all);
        let refined = least_squares_without_foretold(samples, size, &disparity, observer)?;
        let barycentric = InterpolatedViews::prepare(samples, Interpolation::Barycentric, size, observer)?;
        let barycentric = barycentric.render_view(middle, middle)?.into_pixels();
        let mut rays = Rays {
            size: *size,
            pitch: view_pitch(samples, size.width),
            lenslets: samples.centres.len(),
            views: foretelling_rays(samples, size, &disparity),
            disparity,
            refined,
            refined_from_all,
            barycentric,
        };
        rays.leave_out_hidden()?;
        ensure!(
            Error::Shape,
            rays.count() >= LEAST_RAYS,
            "only {} samples of other views lie between those of the middle view on smooth surfaces, {LEAST_RAYS} are \
             needed: the scene is all but at disparity 0, or the capture too small",
            rays.count()
        );
        Ok(rays)
    }

    /// The middle view's disparity, pixels of the view per view step, from all samples.
    #[must_use]
    pub fn disparity(&self) -> &Array2<f32> {
        &self.disparity
    }

    /// The middle view refined by least squares without the samples that are foretold, (t, s, c), linear light.
    #[must_use]
    pub fn refined(&self) -> ArrayView3<'_, f32> {
        self.refined.view()
    }

    /// The middle view refined from all samples by least squares, (t, s, c), linear light.
    #[must_use]
    pub fn refined_from_all(&self) -> ArrayView3<'_, f32> {
        self.refined_from_all.view()
    }

    /// The middle view interpolated barycentrically, which others are compared with, (t, s, c), linear light.
    #[must_use]
    pub fn barycentric(&self) -> ArrayView3<'_, f32> {
        self.barycentric.view()
    }

    /// How many rays foretell.
    #[must_use]
    pub fn count(&self) -> usize {
        self.views.iter().map(Vec::len).sum()
    }

    /// Mean of the barycentric and the refined view: a picture that favours neither kind of method. Encoded luminance.
    pub(super) fn neutral(&self) -> Plane {
        mean_of([&encoded_light(self.barycentric.view()), &encoded_light(self.refined.view())])
    }

    /// The errors of a middle view (t, s, c) in linear light at the rays.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn measure(&self, picture: ArrayView3<'_, f32>) -> Result<RayErrors, Error> {
        self.sum_errors(picture, |view, k| self.views[view][k].value)
    }

    /// As [`Rays::measure`], but against what lenslets would gather of the picture `truth` at the rays' places: what the
    /// measure ought to tell where a truth is known.
    ///
    /// # Errors
    /// Pictures of another size.
    pub fn measure_against(
        &self,
        picture: ArrayView3<'_, f32>,
        truth: ArrayView3<'_, f32>,
    ) -> Result<RayErrors, Error> {
        ensure!(Error::Shape, picture.dim() == truth.dim(), "picture and truth have other sizes");
        let truth = self.gathered(&linear_light(truth))?;
        self.sum_errors(picture, |view, k| truth[view][k])
    }

    /// `wanted`: given the view and the ray's number.
    fn sum_errors(
        &self,
        picture: ArrayView3<'_, f32>,
        wanted: impl Fn(usize, usize) -> f32,
    ) -> Result<RayErrors, Error> {
        let (height, width, _) = picture.dim();
        ensure!(
            Error::Shape,
            (width, height) == (self.size.width, self.size.height),
            "a picture of {width}x{height} pixels, the rays were found for {}x{}",
            self.size.width,
            self.size.height
        );
        let gathered = self.gathered(&linear_light(picture))?;
        let mut sums = SquaredErrors::new(self.lenslets);
        for (view, (rays, gathered)) in self.views.iter().zip(&gathered).enumerate() {
            for (ray, e) in rays.iter().zip(self.errors(rays, gathered, |k| wanted(view, k))) {
                sums.add(ray.lenslet as usize, e);
            }
        }
        Ok(RayErrors { sums })
    }

    /// What lenslets at the rays' places would measure of a picture's luminance in linear light, by view: its mean over a disc
    /// of one pitch, encoded.
    fn gathered(&self, picture: &Plane) -> Result<Vec<Vec<f32>>, Error> {
        let pixels = ArrayView3::from_shape((picture.height, picture.width, 1), &picture.data)?;
        let of_view = |rays: &Vec<Ray>| {
            let places: Vec<[f64; 2]> = rays.iter().map(|r| [r.x, r.y].map(f64::from)).collect();
            let means = sample_image(pixels, &places, Footprint::Disc(self.pitch))?;
            Ok(means.iter().map(|m| encode(*m)).collect())
        };
        self.views.iter().map(of_view).collect()
    }

    /// What was gathered minus what is wanted, without its local mean.
    fn errors(&self, rays: &[Ray], gathered: &[f32], wanted: impl Fn(usize) -> f32) -> Vec<f64> {
        let errors: Vec<f64> = gathered.iter().enumerate().map(|(k, g)| f64::from(g - wanted(k))).collect();
        let means = self.local_means(rays, &errors);
        errors.iter().zip(means).map(|(e, m)| e - m).collect()
    }

    /// The local mean of values at the rays, from sums in cells of a third of its width.
    fn local_means(&self, rays: &[Ray], values: &[f64]) -> Vec<f64> {
        let sigma = BROAD * self.pitch;
        let side = (sigma / 3.0).max(1.0);
        let cells = |n: usize| (n as f64 / side).ceil() as usize;
        let (w, h) = (cells(self.size.width), cells(self.size.height));
        let cell = |r: &Ray| (f64::from(r.y) / side) as usize * w + (f64::from(r.x) / side) as usize;
        let mut sums = Plane::filled(Size::new(w, h), 0.0);
        let mut counts = Plane::filled(Size::new(w, h), 0.0);
        for (r, v) in rays.iter().zip(values) {
            sums.data[cell(r)] += *v as f32;
            counts.data[cell(r)] += 1.0;
        }
        let [sums, counts] = [sums, counts].map(|p| super::picture::gaussian(&p, sigma / side));
        rays.iter().map(|r| f64::from(sums.data[cell(r)] / (counts.data[cell(r)] + 1e-6))).collect()
    }

    /// Leaves out the rays that the mean of two methods misses most, and views with few rays.
    fn leave_out_hidden(&mut self) -> Result<(), Error> {
        self.views.retain(|rays| rays.len() >= LEAST_RAYS.div_ceil(10));
        let neutral = mean_of([&linear_light(self.barycentric.view()), &linear_light(self.refined.view())]);
        let gathered = self.gathered(&neutral)?;
        let mut views = std::mem::take(&mut self.views);
        for (rays, gathered) in views.iter_mut().zip(&gathered) {
            let missed: Vec<f64> = self.errors(rays, gathered, |k| rays[k].value).iter().map(|e| e.abs()).collect();
            let mut sorted = missed.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let limit = sorted[((1.0 - LEFT_OUT) * (sorted.len() - 1) as f64) as usize];
            let mut k = 0;
            rays.retain(|_| {
                k += 1;
                missed[k - 1] <= limit
            });
        }
        self.views = views;
        Ok(())
    }
}

/// The rays of withheld lenslets that meet the middle view between its samples, by view.
fn foretelling_rays(samples: &HexSamples, size: &Size, disparity: &Array2<f32>) -> Vec<Vec<Ray>> {
    let places = RayPlaces::new(samples, size, disparity);
    let points = sample_points(samples, size);
    let pitch = view_pitch(samples, size.width);
    let nearest = NearestPlace::new(&points, pitch);
    let in_pitches = |k: usize| samples.view_offset(k).map(|o| o.abs() / mean_pitch(samples));
    let is_used = |&k: &usize| {
        let [u, v] = in_pitches(k);
        let longer = u.max(v);
        (OFFSETS[0]..=OFFSETS[1]).contains(&longer) && u + v <= OFFSETS[2] && samples.weights[k] > 0.0
    };
    let of_view = |k: usize| {
        let steps = view_steps(samples, k);
        let values = samples.values.index_axis(ndarray::Axis(0), k);
        let ray = |i: usize| {
            let place = places.place(points[i], steps);
            let between = nearest.find([place.x, place.y]).is_none_or(|(_, d)| d >= LEAST_DISTANCE * pitch);
            (place.is_sure && between).then(|| Ray {
                lenslet: i as u32,
                x: place.x as f32,
                y: place.y as f32,
                value: encode(light_of(values.row(i))),
            })
        };
        (0..points.len()).filter(|&i| is_withheld(samples.index[i])).filter_map(ray).collect()
    };
    (0..samples.views * samples.views).filter(is_used).map(of_view).collect()
}

/// The errors of a picture at the rays.
#[derive(Debug, Clone)]
pub struct RayErrors {
    sums: SquaredErrors,
}

impl RayErrors {
    /// PSNR at the rays, dB, of sRGB-encoded luminance 0..1; the noise of the samples themselves is part of the error.
    #[must_use]
    pub fn psnr(&self) -> f64 {
        -10.0 * self.sums.mean().max(1e-20).log10()
    }

    /// dB over another picture at the same rays, with the standard error over lenslets.
    #[must_use]
    pub fn over(&self, other: &RayErrors) -> Difference {
        self.sums.over(&other.sums)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use lenslet_core::progress::Silent;

    use super::*;

    /// 7×7 views of 30×35 lenslets, each gathering over a disc, of a picture on a slanted plane, D = 0.4 + 0.002 x pixels of views
    /// of 100 pixels.
    pub(crate) fn slanted_samples() -> HexSamples {
        let lattice = lenslet_core::geometry::Lattice::hexagonal(10.0, 0.003, 1.0, [150.0, 150.0]);
        let points = lattice.points_within(Size { width: 300, height: 300 }, 0.0);
        let centres: Vec<[f64; 2]> = points.index.iter().map(|&[i, j]| lattice.centre(i, j)).collect();
        let views = 7;
        let values = Array3::from_shape_fn((views * views, centres.len(), 3), |(view, k, _)| {
            let [x, y] = centres[k].map(|c| (c + 0.5) / 3.0 - 0.5);
            let (u, v) = ((view % views) as f64 - 3.0, (view / views) as f64 - 3.0);
            // x = X + D(X)·u.
            let d = |at: f64| 0.4 + 0.002 * at;
            let at = (x - 0.4 * u) / (1.0 + 0.002 * u);
            gathered(at, y - d(at) * v)
        });
        HexSamples {
            sensor: Size::new(300, 300),
            index: points.index,
            centres,
            views,
            view_step: 1.0,
            weights: vec![1.0; views * views],
            values,
        }
    }

    /// Waves of eight to eleven pixels.
    fn scene(x: f64, y: f64) -> f32 {
        let wave = |a: f64, b: f64| (a * x + b * y).sin();
        (0.3 + 0.08 * (wave(0.5, 0.25) + wave(-0.4, 0.6) + wave(0.1, -0.75))) as f32
    }

    /// Mean of the scene over a disc of one pitch.
    fn gathered(x: f64, y: f64) -> f32 {
        let steps = || (-8..=8).map(|k| f64::from(k) * 10.0 / 3.0 / 17.0);
        let within = steps().flat_map(|b| steps().map(move |a| [a, b])).filter(|[a, b]| a.hypot(*b) <= 5.0 / 3.0);
        let values: Vec<f32> = within.map(|[a, b]| scene(x + a, y + b)).collect();
        values.iter().sum::<f32>() / values.len() as f32
    }

    #[test]
    fn the_scene_itself_scores_best_and_a_wrong_one_worst() {
        let samples = slanted_samples();
        let size = Size { width: 100, height: 100 };
        let rays = Rays::find(&samples, &size, &Silent).unwrap();
        let drawn =
            |f: &dyn Fn(f64, f64) -> f32| Array3::from_shape_fn((100, 100, 3), |(t, s, _)| f(s as f64, t as f64));
        let truth = rays.measure(drawn(&scene).view()).unwrap();
        let moved = rays.measure(drawn(&|x, y| scene(x + 0.5, y)).view()).unwrap();
        let barycentric = rays.measure(rays.barycentric()).unwrap();
        let refined = rays.measure(rays.refined()).unwrap();
        let psnr = [&truth, &refined, &barycentric, &moved].map(RayErrors::psnr);
        assert!(psnr[0] > psnr[1] + 1.0 && psnr[1] > psnr[2] + 1.0, "{psnr:?} from {} rays", rays.count());
        assert!(truth.over(&barycentric).is_above_zero(3.0) && !moved.over(&truth).is_above_zero(0.0));
        // A constant more of light is no error: white images leave such.
        let brighter = rays.measure(drawn(&|x, y| 1.02 * scene(x, y)).view()).unwrap();
        assert!(brighter.psnr() > psnr[1], "{} of {psnr:?}", brighter.psnr());
        assert!(rays.measure(Array3::zeros((9, 9, 3)).view()).is_err());
    }

    #[test]
    fn the_search_can_be_interrupted() {
        struct Stop;
        impl Observer for Stop {
            fn cancelled(&self) -> bool {
                true
            }
        }
        let found = Rays::find(&slanted_samples(), &Size { width: 100, height: 100 }, &Stop);
        assert!(matches!(found, Err(Error::Interrupted(_))));
    }
}
