//! Measures of rendered views that need no ground truth, for captures of real cameras (docs/assessing.md).
//!
//! - [`Rays`]: samples of other views foretell the middle view between its own lenslets.
//! - [`Edges`]: sharpness (MTF50) beside roughness; one alone says nothing.
//! - [`Lines`]: thin straight lines such as strings: roughness, width, ripple.
//! - [`compare_calibrations`]: raw pixels off the lenslets' middles, foretold by each calibration.
//! - [`holes_score`]: hidden lenslets, filled by the mean of their neighbours; biased, it judges nothing.
//!
//! [`MiddleViews`] renders what the measures of methods take. Each measure gives values for every picture alone and
//! paired differences of two pictures with their standard error.

mod chains;
mod edges;
mod fits;
mod holes;
mod line_file;
mod lines;
mod middle_views;
mod nearest;
mod picture;
mod raw;
mod ray_places;
mod rays;
mod segments;
mod statistics;
mod withheld;

pub use edges::{EdgeMeasures, Edges, keep_common_edges};
pub use holes::{HolesScore, holes_score};
pub use line_file::parse_lines;
pub use lines::{LineMeasures, Lines, keep_common_lines};
pub use middle_views::{MiddleView, MiddleViews};
pub use raw::{RawScore, compare_calibrations};
pub use rays::{RayErrors, Rays};
pub use statistics::{Difference, Median, median_of_differences, median_with_error};
