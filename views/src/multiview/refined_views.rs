//! Views refined by all the others (section 4.3), rendered one by one or side by side.

use lenslet_core::ensure;
use lenslet_core::progress::Observer;
use ndarray::Array3;
use rayon::prelude::*;

use super::estimate::estimate_disparities;
use super::joint_fit::JointFit;
use super::options::{Fit, Options};
use super::sample_set::SampleSet;
use super::view_disparities::ViewDisparities;
use super::{smooth_fit, triangulated};
use crate::Error;
use crate::target::PixelSink;

/// Views rendered side by side: each takes about 100 MiB at 1080×1080, however many threads there are.
///
/// Source: chosen for the memory it takes.
const ABREAST: usize = 4;

/// Samples of all views with the disparity of every view: any view can be rendered from them.
pub struct RefinedViews<'a> {
    set: SampleSet<'a>,
    disparities: ViewDisparities,
    fitted: Fitted,
}

/// A fit, and what it shares among all views.
enum Fitted {
    LeastSquares,
    Triangulation,
    Joint(Box<JointFit>),
}

impl Fitted {
    fn new(set: &SampleSet, fit: &Fit) -> Self {
        match fit {
            Fit::LeastSquares => Fitted::LeastSquares,
            Fit::Triangulation => Fitted::Triangulation,
            Fit::Joint(footprint) => {
                Fitted::Joint(Box::new(JointFit::new(set, &footprint.unwrap_or_else(|| set.usual_footprint()))))
            }
        }
    }
}

impl<'a> RefinedViews<'a> {
    /// Estimates the disparity of every view of `set`, unless `options.known` gives the middle one's.
    ///
    /// # Errors
    /// Options out of range, interruption.
    pub fn estimate(set: SampleSet<'a>, options: &Options, observer: &dyn Observer) -> Result<Self, Error> {
        let mut disparities = estimate_disparities(&set, options, observer)?;
        let mut fitted = Fitted::new(&set, &options.fit);
        if let Fitted::Joint(joint) = &mut fitted {
            let picture = joint.refine_disparities(&set, &mut disparities, options.known.is_none(), observer)?;
            joint.begin_with_middle(&set, &disparities, picture)?;
        }
        Ok(RefinedViews { set, disparities, fitted })
    }

    /// With the disparities of every view known; the joint fit takes them, and the views, as they are.
    ///
    /// # Errors
    /// Samples that cannot be interpolated.
    pub fn with_disparities(set: SampleSet<'a>, disparities: ViewDisparities, fit: Fit) -> Result<Self, Error> {
        let mut fitted = Fitted::new(&set, &fit);
        if let Fitted::Joint(joint) = &mut fitted {
            joint.begin_with_middle(&set, &disparities, None)?;
        }
        Ok(RefinedViews { set, disparities, fitted })
    }

    /// Rows and columns of views.
    pub fn views(&self) -> (usize, usize) {
        self.set.views()
    }

    /// How many views are too dark to be used.
    pub fn dark(&self) -> usize {
        let (rows, columns) = self.views();
        (0..rows * columns).filter(|&k| self.set.is_dark(k)).count()
    }

    /// The disparities in use.
    pub fn disparities(&self) -> &ViewDisparities {
        &self.disparities
    }

    /// Renders the view (row `v`, column `u`), (t, s, c); values as those of the samples (linear light, or encoded).
    ///
    /// # Errors
    /// A view that does not exist.
    pub fn render_view(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        let (rows, columns) = self.views();
        ensure!(
            Error::Parameter,
            v < rows && u < columns,
            "there is no view {v},{u}: there are only {rows}x{columns} views"
        );
        let view = v * columns + u;
        if self.set.is_dark(view) {
            return self.set.single(v, u);
        }
        let mut image = match &self.fitted {
            Fitted::LeastSquares => smooth_fit::render_view(&self.set, &self.disparities, (v, u)),
            Fitted::Triangulation => triangulated::render_view(&self.set, &self.disparities, (v, u)),
            Fitted::Joint(joint) => joint.render_view(&self.set, &self.disparities, (v, u)),
        }?;
        self.set.restore_light(view, &mut image);
        Ok(image)
    }

    /// Renders the views `wanted` (row, column), a few side by side, each handed to `sink` in the order wanted.
    ///
    /// # Errors
    /// Views that do not exist, errors of the sink, interruption.
    pub fn render_views<E: From<Error>>(
        &self,
        wanted: &[(usize, usize)],
        sink: PixelSink<'_, E>,
        observer: &dyn Observer,
    ) -> Result<(), E> {
        observer.begin("multi-view refinement", wanted.len() as u64);
        for some in wanted.chunks(ABREAST.min(rayon::current_num_threads()).max(1)) {
            let images: Vec<Result<Array3<f32>, Error>> = some
                .par_iter()
                .map(|&(v, u)| {
                    observer.check()?;
                    self.render_view(v, u)
                })
                .collect();
            for (&(v, u), image) in some.iter().zip(images) {
                sink(v, u, image?)?;
                observer.advance(1);
            }
        }
        Ok(())
    }
}
