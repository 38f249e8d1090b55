//! Section 4.3: refinement using multiple views. Every sample of every view is copied along its ray to its true place
//! in the target view; the image is then fitted to all of them at their exact places, with single-view interpolation as
//! the prior.

mod cross_validation;
mod estimate;
mod holdout;
mod joint_disparity;
mod joint_fit;
mod local_light;
mod options;
mod rays;
mod refine_disparity;
mod refined_views;
mod sample_set;
mod smooth_fit;
mod triangulated;
mod trust;
mod view_disparities;
mod view_models;

pub use estimate::{depth_order_of, estimate_disparities};
pub use holdout::{HiddenScore, hidden_score};
pub use options::{Fit, Options};
pub use refined_views::RefinedViews;
pub use sample_set::SampleSet;
pub use view_disparities::ViewDisparities;
