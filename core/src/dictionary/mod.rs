//! Coupled dictionaries Dl, Dh (paper section 4.4, eq. (3) and (4)): what is learned, its files, and its use on a
//! plane.
//!
//! A [`Dictionary`] holds a [`Model`] for each footprint it was trained for, and each of these one [`PatchModel`]:
//!
//! 1. features of the low image around each patch: `f = F·w`, where `w` is the square window of `support`² values and
//!    `F` (m × support²) are gradients of first and second order followed by their principal components (Zeyde 2010),
//!    folded into one matrix; every row of `F` sums to zero, so the mean of the window does not matter;
//! 2. norm: `n = max(‖f‖, floor)`, `y = f/n`;
//! 3. code: φ = argmin ½‖y − Dlᵀφ‖² + λ‖φ‖₁ (eq. (4)), or its replacement by anchored regression (A+), a small network,
//!    one ridge regressor or no codes at all;
//! 4. residual patch `n·Dhᵀφ` (`patch`² values), added to the low image where patches overlap by weighted mean.
//!
//! The mean of the patch comes from the low image, since the residual high − low is what is learned.
//!
//! # Adding a predictor
//! A [`PatchPredictor`] touches three files here, and two of the trainer where it needs more than the atoms:
//!
//! 1. `predict/NAME.rs` implements the trait and checks the shapes of its matrices;
//! 2. `predict/mod.rs` has a row for it;
//! 3. `patch_model.rs` has the enum's variant with its name and word, its matrices in [`PatchModel`], and their names in
//!    files: `.safetensors` needs no more, while an `.lfd` needs a section in `file/lfd_header.rs` and a new version;
//! 4. `predictors/NAME.rs` of the trainer fits it;
//! 5. `predictors/mod.rs` there calls it.
//!
//! Options, tables and pages take names, words and sentences from the enum.
//!
//! # Example
//! ```
//! use lenslet_core::dictionary::{self, PlaneReconstructor, ReconstructionOptions};
//! use ndarray::Array2;
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("mine.lfd");
//! # std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"), &path)?;
//! let dictionary = dictionary::load(&path)?;
//! let reconstructor = PlaneReconstructor::new(&dictionary.models[0], &ReconstructionOptions::default())?;
//! let flat = Array2::from_elem((20, 20), 0.5f32);
//! let same = reconstructor.reconstruct_plane(flat.view(), &[])?;
//! assert!(same.iter().all(|v| (v - 0.5).abs() < 1e-3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod features;
mod file;
pub mod limits;
mod model;
mod options;
mod overlap_add;
mod patch_model;
mod predict;
mod recipe;
mod reconstruct;
mod side_input;
mod validate;

pub use error::Error;
pub use features::{copy_windows, extract_features, gradient_operator, learn_components, learn_filters, pad_mirrored};
pub use file::{FORMAT_VERSION, Format, export_npy, from_bytes, load, read_kinds, save, to_bytes};
pub use model::{Dictionary, Footprint, Model, ModelKind, Storage};
pub use options::ReconstructionOptions;
pub use patch_model::{Anchored, Layer, Network, PatchModel, PatchPredictor};
pub use predict::{nearest_anchors, network_inputs};
pub use recipe::{Photo, Recipe};
pub use reconstruct::PlaneReconstructor;
pub use side_input::SideInput;
pub use validate::validate;
