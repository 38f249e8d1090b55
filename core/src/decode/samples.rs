//! Hexagonal samples: what decoding produces and resampling starts from.

use crate::geometry::Size;
use ndarray::{Array3, ArrayView2, ArrayView5, Axis};

use crate::sampling::{self, Footprint, lattice_samples};

/// Hexagonal samples: one value per lenslet for each view, before any resampling. Linear light.
#[derive(Debug, Clone, PartialEq)]
pub struct HexSamples {
    /// Sensor size (width, height) in pixels: the frame of `centres`.
    pub sensor: Size,
    /// Lenslet centres (x, y) in sensor pixels, pixel centres at integers. They are the places of the samples of
    /// *every* view.
    pub centres: Vec<[f64; 2]>,
    /// Lattice index (i, j) of each lenslet.
    pub index: Vec<[i32; 2]>,
    /// Views per row and per column, n (odd).
    pub views: usize,
    /// Sensor pixels between neighbouring views.
    pub view_step: f64,
    /// How reliable each view is, 0..=1 in the order of the views: its share of the light of the brightest one, 0
    /// where it lies beyond the border of its micro-image.
    pub weights: Vec<f32>,
    /// Values, shape (n², lenslets, channels), channels 1 or 3. See [`HexSamples::view_index`] for the order of the
    /// views.
    pub values: Array3<f32>,
}

impl HexSamples {
    /// What a lenslet camera would have sampled of the views (v, u, t, s, c) of a light field, rows as many as columns and
    /// one channel or three: each at the points of one hexagonal lattice ([`lattice_samples`]). The views' pixels are the
    /// sensor's.
    ///
    /// # Errors
    /// As [`lattice_samples`]; [`sampling::Error::Parameter`] for other numbers of views.
    ///
    /// ```
    /// use lenslet_core::decode::HexSamples;
    /// use lenslet_core::sampling::Footprint;
    /// let views = ndarray::Array5::from_shape_fn((3, 3, 20, 30, 1), |(v, u, _, s, _)| (100 * (3 * v + u) + s) as f32);
    /// let samples = HexSamples::of_views(views.view(), 3.3, 0.0, [0.0; 2], Footprint::Point)?;
    /// let middle = samples.index.iter().position(|&k| k == [0, 0]).unwrap();
    /// assert!((samples.view(1, 2)[[middle, 0]] - 514.5).abs() < 1e-3);
    /// # Ok::<(), lenslet_core::sampling::Error>(())
    /// ```
    pub fn of_views(
        views: ArrayView5<'_, f32>,
        pitch: f64,
        rotation: f64,
        phase: [f64; 2],
        footprint: Footprint,
    ) -> Result<Self, sampling::Error> {
        let (rows, columns, height, width, channels) = views.dim();
        if rows != columns || rows == 0 {
            return Err(sampling::Error::Parameter(format!(
                "{rows}x{columns} views: as many rows as columns are needed"
            )));
        }
        let (mut centres, mut index, mut found) = (Vec::new(), Vec::new(), Vec::new());
        for view in views.outer_iter().flat_map(|row| row.into_outer_iter()) {
            let (points, values) = lattice_samples(view, pitch, rotation, phase, footprint)?;
            (centres, index) = (points.centres, points.index);
            found.push(values);
        }
        let shape = (rows * columns, centres.len(), channels);
        let values = Array3::from_shape_fn(shape, |(view, lenslet, channel)| found[view][[lenslet, channel]]);
        let weights = vec![1.0; rows * columns];
        Ok(HexSamples {
            sensor: Size::new(width, height),
            centres,
            index,
            views: rows,
            view_step: 1.0,
            weights,
            values,
        })
    }

    /// Index of view (v, u) in `values` and `weights`: row v and column u from the top left, both in `0..n`; the
    /// middle view is (n/2, n/2).
    ///
    /// # Panics
    /// If v or u is not below n.
    pub fn view_index(&self, v: usize, u: usize) -> usize {
        assert!(v < self.views && u < self.views, "view ({v}, {u}) of {0}x{0}", self.views);
        v * self.views + u
    }

    /// The samples of view (v, u), lenslets×channels.
    ///
    /// # Panics
    /// If v or u is not below the number of views per row.
    ///
    /// ```
    /// use lenslet_core::geometry::Size;
    /// use lenslet_core::decode::HexSamples;
    /// use ndarray::Array3;
    ///
    /// let samples = HexSamples {
    ///     sensor: Size::new(40, 30),
    ///     centres: vec![[10.0, 10.0], [20.0, 10.0]],
    ///     index: vec![[0, 0], [1, 0]],
    ///     views: 3,
    ///     view_step: 1.0,
    ///     weights: vec![1.0; 9],
    ///     values: Array3::from_shape_fn((9, 2, 1), |(view, lenslet, _)| (10 * view + lenslet) as f32),
    /// };
    /// // The middle view, then the one at its left.
    /// assert_eq!(samples.view(1, 1)[[1, 0]], 41.0);
    /// assert_eq!(samples.view(1, 0)[[1, 0]], 31.0);
    /// ```
    pub fn view(&self, v: usize, u: usize) -> ArrayView2<'_, f32> {
        self.values.index_axis(Axis(0), self.view_index(v, u))
    }

    /// Offset of view `index` (in the order of `values`) from a lenslet's centre, sensor pixels: u to the right, v
    /// down.
    pub fn view_offset(&self, index: usize) -> [f64; 2] {
        view_offset(self.views, self.view_step, index)
    }
}

/// As [`HexSamples::view_offset`], for `views` a row, `step` pixels apart.
pub(super) fn view_offset(views: usize, step: f64, index: usize) -> [f64; 2] {
    let half = (views / 2) as f64;
    [((index % views) as f64 - half) * step, ((index / views) as f64 - half) * step]
}
