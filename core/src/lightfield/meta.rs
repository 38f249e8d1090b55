//! The description of a light field: sizes, colour space, lattice and origin of its views.

use ndarray::Array3;
use serde::{Deserialize, Serialize};

use super::colour::ColourSpace;
use super::error::Error;
use super::origin::ViewOrigin;

/// Most views along one axis.
/// Source: chosen.
pub const MAX_VIEWS: usize = 1024;
/// Longest side of a view, pixels.
/// Source: chosen.
pub const MAX_SIDE: usize = 1 << 16;
/// Most values (t·s·c) of one view: 1 GiB as f32.
/// Source: chosen.
pub const MAX_VIEW_VALUES: usize = 1 << 28;

/// The description of a light field (`lightfield.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Format version, 1.
    pub version: u32,
    /// Views (rows v, columns u).
    pub views: [usize; 2],
    /// View size (height t, width s).
    pub size: [usize; 2],
    /// Channels, 1 or 3.
    pub channels: usize,
    /// Colour space.
    pub colour: ColourSpace,
    /// Output pixels between neighbouring lenslets of a row, if the views were resampled from a lattice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<f64>,
    /// Rotation of that lattice, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<f64>,
    /// Weight of each view, 0..=1, row by row: its light relative to that of the brightest view, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Vec<f32>>,
    /// How the views were made, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<ViewOrigin>,
    /// What predicted the detail of views that are learned: `LASSO`, `network`, `anchored`, `ridge`, `no codes`, or two
    /// of them joined by ` and `.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predictor: Option<String>,
    /// What was done, oldest first: free JSON objects (tool, version, parameters, source hashes).
    #[serde(default)]
    pub provenance: Vec<serde_json::Value>,
}

impl Meta {
    /// A light field of `views` (rows, columns) of `size` (height, width) pixels; optional fields are empty.
    ///
    /// ```
    /// use lenslet_core::lightfield::{ColourSpace, Meta};
    ///
    /// let meta = Meta::new([7, 7], [1080, 1080], 3, ColourSpace::Srgb);
    /// assert_eq!(meta.view_shape(), (1080, 1080, 3));
    /// assert!(meta.check().is_ok() && Meta::new([7, 7], [1080, 1080], 4, ColourSpace::Srgb).check().is_err());
    /// ```
    pub fn new(views: [usize; 2], size: [usize; 2], channels: usize, colour: ColourSpace) -> Self {
        Meta {
            version: 1,
            views,
            size,
            channels,
            colour,
            pitch: None,
            rotation: None,
            weights: None,
            method: None,
            predictor: None,
            provenance: Vec::new(),
        }
    }

    /// Checks sizes against the limits of this module.
    ///
    /// # Errors
    /// [`Error::Parameter`] with what is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let bad = |what: String| Err(Error::Parameter(what));
        if self.views.iter().any(|&n| n == 0 || n > MAX_VIEWS) {
            return bad(format!("{}x{} views: each must be 1 to {MAX_VIEWS}", self.views[0], self.views[1]));
        }
        if self.size.iter().any(|&n| n == 0 || n > MAX_SIDE) {
            return bad(format!(
                "views of {}x{} pixels: each side must be 1 to {MAX_SIDE}",
                self.size[1], self.size[0]
            ));
        }
        if self.channels != 1 && self.channels != 3 {
            return bad(format!("{} channels: the number must be 1 or 3", self.channels));
        }
        if let Some(w) = &self.weights
            && (w.len() != self.views[0] * self.views[1] || !w.iter().all(|w| (0.0..=1.0).contains(w)))
        {
            return bad(format!(
                "{} weights for {}x{} views, or some not 0 to 1",
                w.len(),
                self.views[0],
                self.views[1]
            ));
        }
        // The limits above keep this product far below the range of usize.
        if self.size[0] * self.size[1] * self.channels > MAX_VIEW_VALUES {
            return bad(format!("views of {}x{} pixels are too large", self.size[1], self.size[0]));
        }
        Ok(())
    }

    /// The weight of view `k`, counted row by row; 1 where weights are not known.
    #[must_use]
    pub fn weight(&self, k: usize) -> f32 {
        self.weights.as_ref().and_then(|w| w.get(k)).copied().unwrap_or(1.0)
    }

    /// Shape of one view (t, s, c).
    pub fn view_shape(&self) -> (usize, usize, usize) {
        (self.size[0], self.size[1], self.channels)
    }

    /// Fails for a view that is not there.
    pub(super) fn check_place(&self, v: usize, u: usize) -> Result<(), Error> {
        let [rows, columns] = self.views;
        if v < rows && u < columns {
            return Ok(());
        }
        Err(Error::Parameter(format!("view ({v}, {u}) is outside of {rows}x{columns} views")))
    }

    /// Fails for a view that is not there, or one of another shape.
    pub(super) fn check_view(&self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error> {
        self.check_place(v, u)?;
        if view.dim() != self.view_shape() {
            let (got, expected) = (view.dim(), self.view_shape());
            return Err(Error::Parameter(format!("view ({v}, {u}) has shape {got:?}, expected {expected:?}")));
        }
        Ok(())
    }
}
