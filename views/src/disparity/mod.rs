//! Disparity of a light field (paper 4.3): plane sweep over the views that see a point, regularised with edges kept, made sub-pixel by
//! the structure tensor of the epipolar images.
//!
//! Disparity D is in output pixels per view step: the scene point at x of the reference view appears at x + D·u,
//! y + D·v in the view (v, u) steps away. The HCI benchmark counts the other way round: its disparity is −D.

mod carry;
mod depth_order;
mod error;
mod errors;
mod estimate;
mod find_order;
mod hidden;
mod light;
mod options;
mod planes;
mod range;
mod regularise;
mod search;
mod specks;
mod sweep;
mod tensor;
mod volume;

pub use carry::{carry_plane_to_view, carry_to_view};
pub use depth_order::DepthOrder;
pub use error::Error;
pub use errors::{ConfidenceBin, DisparityErrors, compare_with_truth, confidence_curve};
pub use estimate::{Disparity, estimate_disparity, estimate_planes, find_disparity_range};
pub(crate) use find_order::corners_of;
pub use find_order::find_depth_order;
pub use light::ViewLight;
pub use options::Options;
pub use planes::luminance;
