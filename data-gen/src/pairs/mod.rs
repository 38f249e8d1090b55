//! Training pairs out of photos (paper section 4.4): photo → luminance crop → hexagonal samples → interpolation → pairs
//! of low features and residual patches.
//!
//! Random streams are named by (seed, photo, crop): a crop is the same whatever else is made.

mod camera_lattice;
mod crop;
mod degradation;
mod error;
mod extract;
mod filters;
mod near_duplicates;
mod options;
mod write;

pub use camera_lattice::CameraLattice;
pub use crop::{Crop, CropOptions, cut_crops};
pub use degradation::{Degradation, degrade_plane};
pub use error::Error;
pub use extract::{Pairs, extract_pairs};
pub use filters::{learn_difference_filters, learn_filters};
pub use options::PatchOptions;
pub use write::{Manifest, write_pairs};
