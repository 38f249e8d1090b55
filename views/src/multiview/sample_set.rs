//! All samples of all views, of a capture or of a light field, and the interpolation of one view alone.

use lenslet_core::colour::{LUMINANCE, srgb_decode, srgb_encode};
use lenslet_core::decode::HexSamples;
use lenslet_core::ensure;
use lenslet_core::geometry::SensorToView;
use lenslet_core::geometry::Size;
use lenslet_core::image::Plane;
use lenslet_core::lightfield::LightField;
use lenslet_core::sampling::{Cubic, bicubic};
use ndarray::{Array3, ArrayView1, ArrayView3, Axis, CowArray, Ix3};

use crate::Error;
use crate::disparity::ViewLight;
use crate::inverse::SampleFootprint;
use crate::target::mean_pitch;

/// Samples of every view at common places, and the target they are to fill.
pub struct SampleSet<'a> {
    rows: usize,
    columns: usize,
    /// Where the samples lie in their own view, pixels of the target.
    pub(super) points: Vec<[f32; 2]>,
    /// Values, shape (views, samples, channels).
    values: CowArray<'a, f32, Ix3>,
    /// Weight of each view, 0 to 1: its light as a share of the brightest view's.
    pub(super) weights: Vec<f32>,
    /// The values again, four lanes each (unused ones 0), all views in a row.
    pub(super) lanes: Vec<[f32; 4]>,
    pub(super) target: Size,
    pub(super) kind: Kind,
    /// Pixels of the target between neighbouring samples.
    pub(super) pitch: f32,
    single_view: SingleView,
    /// Factors by which the light of views was raised to that of the others; empty where it was not.
    gains: Vec<f32>,
    /// Whether a sample (all views in a row) is kept from other views; empty where none is.
    withheld: Vec<bool>,
}

/// Whether the values are linear light or sRGB-encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Linear,
    Encoded,
}

impl Kind {
    /// A value whose light is `gain` times that of `x`.
    fn amplified(self, x: f32, gain: f32) -> f32 {
        match self {
            Kind::Linear => gain * x,
            Kind::Encoded => srgb_encode(gain * srgb_decode(x)),
        }
    }
}

/// Interpolation of a single view.
enum SingleView {
    Mesh(Cubic),
    Grid { width: usize, height: usize },
}

impl<'a> SampleSet<'a> {
    /// The samples of a decoded capture.
    ///
    /// # Errors
    /// Samples whose shapes contradict each other, that cannot be triangulated, or that have other than 1 or 3
    /// channels.
    pub fn hexagonal(samples: &'a HexSamples, target: &Size) -> Result<Self, Error> {
        let n = samples.centres.len();
        let (views, count, _) = samples.values.dim();
        ensure!(
            Error::Shape,
            views == samples.views * samples.views && count == n,
            "the samples contradict each other: {views} views of {count} values at {n} places"
        );
        let single_view = SingleView::Mesh(Cubic::new(&samples.centres, samples.sensor, *target)?);
        let map = SensorToView::new(samples.sensor, *target);
        let points = samples.centres.iter().map(|&c| map.to_view(c).map(|p| p as f32)).collect();
        let pitch = (mean_pitch(samples) * map.scale()[0]) as f32;
        Self::checked(
            samples.views,
            samples.views,
            points,
            samples.values.view().into(),
            samples.weights.clone(),
            *target,
            Kind::Linear,
            pitch,
            single_view,
        )
    }

    /// The pixels of a decoded light field.
    ///
    /// # Errors
    /// Light fields of other than 1 or 3 channels, empty ones.
    pub fn rectangular(field: &'a LightField, target: &Size) -> Result<Self, Error> {
        let (rows, columns, height, width, channels) = field.data.dim();
        ensure!(Error::Shape, width > 0 && height > 0, "the views are empty");
        let (fx, fy) = (target.width as f32 / width as f32, target.height as f32 / height as f32);
        let points = (0..height)
            .flat_map(|t| (0..width).map(move |s| [(s as f32 + 0.5) * fx - 0.5, (t as f32 + 0.5) * fy - 0.5]))
            .collect();
        let mut values = field.data.to_shape((rows * columns, height * width, channels))?;
        let kind = match field.meta.colour {
            lenslet_core::lightfield::ColourSpace::Linear => Kind::Linear,
            lenslet_core::lightfield::ColourSpace::Srgb => Kind::Encoded,
        };
        let light = ViewLight::of(&field.data.view(), kind == Kind::Linear, field.meta.weights.as_deref());
        for (k, &gain) in light.gains.iter().enumerate().filter(|(_, g)| **g != 1.0) {
            let mut view = values.index_axis_mut(Axis(0), k);
            view.mapv_inplace(|x| kind.amplified(x, gain));
        }
        let mut set = Self::checked(
            rows,
            columns,
            points,
            values,
            light.weights,
            *target,
            kind,
            fx,
            SingleView::Grid { width, height },
        )?;
        set.gains = light.gains;
        Ok(set)
    }

    /// Keeps the samples at the places for which `withheld` says so from the refinement of other views, in all views but the
    /// one numbered `but`.
    pub(crate) fn withholding(mut self, withheld: impl Fn(usize) -> bool, but: usize) -> Self {
        let count = self.points.len();
        self.withheld = (0..self.lanes.len()).map(|k| k / count != but && withheld(k % count)).collect();
        self
    }

    /// Whether other views do without this sample.
    #[inline(always)]
    pub(super) fn is_withheld(&self, sample: usize) -> bool {
        self.withheld.get(sample).is_some_and(|&withheld| withheld)
    }

    /// Whether view `k` is too dark to be refined, or to refine others.
    pub(super) fn is_dark(&self, k: usize) -> bool {
        matches!(self.single_view, SingleView::Grid { .. }) && self.weights[k] <= 0.0
    }

    /// Weights for the search of disparities, where some of the views are not used.
    pub(super) fn search_weights(&self) -> Option<Vec<f32>> {
        matches!(self.single_view, SingleView::Grid { .. }).then(|| self.weights.clone())
    }

    /// Brings the values of the view `k` back to the light that it had.
    pub(super) fn restore_light(&self, k: usize, image: &mut Array3<f32>) {
        let gain = self.gains.get(k).copied().unwrap_or(1.0);
        if gain != 1.0 {
            image.mapv_inplace(|x| self.kind.amplified(x, 1.0 / gain));
        }
    }

    #[allow(clippy::too_many_arguments)] // both constructors meet here
    fn checked(
        rows: usize,
        columns: usize,
        points: Vec<[f32; 2]>,
        values: CowArray<'a, f32, Ix3>,
        weights: Vec<f32>,
        target: Size,
        kind: Kind,
        pitch: f32,
        single_view: SingleView,
    ) -> Result<Self, Error> {
        let channels = values.len_of(Axis(2));
        ensure!(
            Error::Shape,
            channels == 1 || channels == 3,
            "multi-view refinement needs 1 or 3 channels, not {channels}"
        );
        ensure!(Error::Shape, rows * columns >= 1 && !points.is_empty(), "there are no samples");
        let strange = values.iter().filter(|v| !v.is_finite()).count();
        ensure!(Error::Shape, strange == 0, "{strange} values of the samples are not numbers");
        ensure!(
            Error::Shape,
            (1..=16384).contains(&target.width) && (1..=16384).contains(&target.height),
            "views of {}x{} pixels are out of range: 1 to 16384 a side",
            target.width,
            target.height
        );
        let lane = |v: ArrayView1<f32>| if channels == 3 { [v[0], v[1], v[2], 0.0] } else { [v[0], 0.0, 0.0, 0.0] };
        let lanes = values.rows().into_iter().map(lane).collect();
        ensure!(
            Error::Shape,
            weights.len() == rows * columns && weights.iter().all(|w| (0.0..=1.0).contains(w)),
            "{} weights (0 to 1) for {} views",
            weights.len(),
            rows * columns
        );
        Ok(SampleSet {
            rows,
            columns,
            points,
            values,
            weights,
            lanes,
            target,
            kind,
            pitch,
            single_view,
            gains: Vec::new(),
            withheld: Vec::new(),
        })
    }

    /// Rows and columns of views.
    pub fn views(&self) -> (usize, usize) {
        (self.rows, self.columns)
    }

    /// Channels, 1 or 3.
    pub fn channels(&self) -> usize {
        self.values.len_of(Axis(2))
    }

    /// What a sample averages: a lenslet a disc of one pitch, a pixel those of the target that it covers.
    pub(super) fn usual_footprint(&self) -> SampleFootprint {
        match self.single_view {
            SingleView::Mesh(_) => SampleFootprint::Disc { diameter: f64::from(self.pitch) },
            SingleView::Grid { width, height } => SampleFootprint::Box {
                width: self.target.width as f64 / width as f64,
                height: self.target.height as f64 / height as f64,
            },
        }
    }

    /// Samples of a view.
    pub(super) fn view(&self, v: usize, u: usize) -> ndarray::ArrayView2<'_, f32> {
        self.values.index_axis(Axis(0), v * self.columns + u)
    }

    /// Interpolation of one view from its own samples, (t, s, c).
    pub(super) fn single(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        let values = self.view(v, u);
        match &self.single_view {
            SingleView::Mesh(weights) => Ok(weights.apply(values)?),
            SingleView::Grid { width, height } => {
                let image = values.to_shape((*height, *width, self.channels()))?;
                if (*width, *height) == (self.target.width, self.target.height) {
                    return Ok(image.to_owned());
                }
                Ok(bicubic::resize_bicubic(image.view(), self.target)?)
            }
        }
    }

    /// Brightness of every view, nearly evenly noisy, no longer than about `side`; and pixels of the target per pixel
    /// of these.
    pub(super) fn brightness(&self, side: usize) -> Result<(Vec<Vec<Plane>>, f32), Error> {
        let longer = self.target.width.max(self.target.height);
        let side = match self.single_view {
            // Windows of disparity are to hold the same samples, however far views are enlarged.
            SingleView::Grid { width, height } => side.min((1.5 * width.max(height) as f32).round() as usize),
            SingleView::Mesh(_) => side,
        };
        let (width, height) = if longer > side {
            let f = side as f64 / longer as f64;
            (
                ((self.target.width as f64 * f).round() as usize).max(1),
                ((self.target.height as f64 * f).round() as usize).max(1),
            )
        } else {
            (self.target.width, self.target.height)
        };
        let table = match &self.single_view {
            SingleView::Mesh(_) => {
                let centres: Vec<[f64; 2]> = self.points.iter().map(|p| [f64::from(p[0]), f64::from(p[1])]).collect();
                Some(Cubic::new(&centres, self.target, Size::new(width, height))?)
            }
            SingleView::Grid { .. } => None,
        };
        let mut grid = Vec::with_capacity(self.rows);
        for v in 0..self.rows {
            let mut row = Vec::with_capacity(self.columns);
            for u in 0..self.columns {
                let light = Array3::from_shape_fn((1, self.points.len(), 1), |(_, k, _)| {
                    self.match_brightness(self.values.slice(ndarray::s![v * self.columns + u, k, ..]))
                });
                let plane = match (&table, &self.single_view) {
                    (Some(table), _) => table.apply(light.index_axis(Axis(0), 0))?,
                    (None, SingleView::Grid { width: w, height: h }) => {
                        shrink(light.to_shape((*h, *w, 1))?.view(), width, height)?
                    }
                    (None, SingleView::Mesh(_)) => continue,
                };
                row.push(Plane { width, height, data: plane.into_raw_vec_and_offset().0 });
            }
            grid.push(row);
        }
        Ok((grid, self.target.width as f32 / width as f32))
    }

    /// Upper bound for the variance of the noise (channels together) of the samples of a view: what a lenslet sees
    /// moves by a fraction of the lenslets' pitch from view to view, so that second differences over three views are
    /// mostly noise. Infinite where there are no three views in a row.
    pub(super) fn noise(&self, at: (usize, usize)) -> f32 {
        let n = self.points.len();
        let middle = |k: usize, count: usize| k.clamp(1, count.max(3) - 2);
        let triple = if self.columns >= 3 {
            let k = at.0 * self.columns + middle(at.1, self.columns);
            [k - 1, k, k + 1]
        } else if self.rows >= 3 {
            let k = middle(at.0, self.rows) * self.columns + at.1;
            [k - self.columns, k, k + self.columns]
        } else {
            return f32::INFINITY;
        };
        let squares = (0..n).step_by(7).map(|i| {
            let [a, b, c] = triple.map(|k| self.lanes[k * n + i]);
            (0..3).map(|l| (a[l] - 2.0 * b[l] + c[l]).powi(2)).sum::<f32>()
        });
        let mut squares: Vec<f32> = squares.filter(|s| s.is_finite()).collect();
        squares.sort_unstable_by(f32::total_cmp);
        let median = squares.get(squares.len() / 2).copied().unwrap_or(f32::INFINITY);
        // A second difference has six times the variance of a sample, and less where neighbouring views share pixels;
        // the median of squares is 0.455 (one channel) to 0.79 (three) of their mean. Where less light falls, values
        // are continued outwards, and neighbours share more pixels.
        let light = self.weights[at.0 * self.columns + at.1].max(0.1);
        4.0 * median / (6.0 * 0.455) / (light * light)
    }

    /// Brightness of every sample, views one after the other.
    pub(super) fn light(&self) -> Vec<f32> {
        self.values.rows().into_iter().map(|v| self.match_brightness(v)).collect()
    }

    /// Brightness of one sample for matching: luminance, its square root where it is linear.
    fn match_brightness(&self, value: ArrayView1<f32>) -> f32 {
        let y = if value.len() == 3 {
            LUMINANCE[0] * value[0] + LUMINANCE[1] * value[1] + LUMINANCE[2] * value[2]
        } else {
            value[0]
        };
        let y = if y.is_finite() { y.max(0.0) } else { 0.0 };
        if self.kind == Kind::Linear { y.sqrt() } else { y }
    }
}

/// To a smaller or larger size; the same size stays untouched.
fn shrink(image: ArrayView3<f32>, width: usize, height: usize) -> Result<Array3<f32>, Error> {
    if image.dim() == (height, width, image.dim().2) {
        return Ok(image.to_owned());
    }
    Ok(bicubic::resize_bicubic(image, Size::new(width, height))?)
}
