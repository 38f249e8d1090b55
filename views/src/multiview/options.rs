//! How views are refined by all the others.

use lenslet_core::dictionary::Footprint;

use crate::disparity;
use crate::inverse::SampleFootprint;

/// How the image is made of the scattered samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fit {
    /// Every sample a point of the picture: weighted least-squares pixels, single-view interpolation as the prior.
    LeastSquares,
    /// As in the paper: triangulate all samples, interpolate barycentrically. Takes seconds a view; kept for
    /// comparison.
    Triangulation,
    /// Every sample the mean over its footprint, the picture found by [`crate::inverse`]; views may differ from it by gain,
    /// offset and a smooth shift, and by their light from place to place. `None` (the default): the footprint that samples of
    /// their kind usually have, a disc of one pitch for a lenslet's, the pixels of the target that it covers for a pixel.
    Joint(Option<SampleFootprint>),
}

impl Default for Fit {
    fn default() -> Self {
        Fit::Joint(None)
    }
}

impl Fit {
    /// The fit of a light field whose views are enlarged `scale` times: pixels are means over `scale`×`scale` pixels of
    /// the result; least squares where there is nothing to enlarge.
    #[must_use]
    pub fn for_enlargement(scale: f64) -> Self {
        if scale >= LEAST_ENLARGEMENT { Fit::Joint(None) } else { Fit::LeastSquares }
    }

    /// The fit whose views a dictionary sharpens that takes a sample for this footprint: the joint fit where it is the mean
    /// over a lenslet, least squares where it is a point.
    ///
    /// ```
    /// use lenslet_core::dictionary::Footprint;
    /// use lenslet_views::multiview::Fit;
    /// assert_eq!(Fit::for_dictionary(Footprint::Lenslet), Fit::Joint(None));
    /// assert_eq!(Fit::for_dictionary(Footprint::Point), Fit::LeastSquares);
    /// ```
    #[must_use]
    pub fn for_dictionary(footprint: Footprint) -> Self {
        match footprint {
            Footprint::Lenslet => Fit::Joint(None),
            Footprint::Point | Footprint::Grid => Fit::LeastSquares,
        }
    }

    /// What to say where a dictionary that was made for views by this fit is used on those by the fit of another name.
    #[must_use]
    pub fn note_of_other(self, by: &str) -> Option<String> {
        let made_for = self.name();
        let text = || {
            format!("the dictionary was made for views by the fit {made_for}, these are by {by}: expect lower quality")
        };
        (by != made_for).then(text)
    }

    /// Name on the command line and in records.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Fit::LeastSquares => "least-squares",
            Fit::Triangulation => "triangulation",
            Fit::Joint(_) => "joint",
        }
    }
}

/// Enlargement from which a pixel counts as a mean over several of the result.
///
/// Source: chosen.
const LEAST_ENLARGEMENT: f64 = 1.2;

/// How views are refined.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How the image is made of the samples; default [`Fit::Joint`].
    pub fit: Fit,
    /// How disparity is estimated; `range` and `limit` are in pixels of the target view per view step. The default is
    /// that of [`disparity::Options`], for linear light.
    pub disparity: disparity::Options,
    /// Disparity of the middle view where it is known beforehand, shape (t, s) of any size, pixels of the target view
    /// per view step; `None`, the default: estimated.
    pub known: Option<ndarray::Array2<f32>>,
}

impl Default for Options {
    fn default() -> Self {
        let disparity = disparity::Options { linear: true, side: SIDE, ..disparity::Options::default() };
        Options { fit: Fit::default(), disparity, known: None }
    }
}

/// Longer side of the views in which disparity is searched, pixels.
///
/// Source: chosen for speed.
const SIDE: usize = 640;
