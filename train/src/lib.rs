//! Learning coupled dictionaries Dh, Dl from photos (paper section 4.4, eq. (3)).
//!
//! min over D = [Dh; Dl] and codes α of ½‖X − Dα‖² + λ‖α‖₁ (or at most `nonzeros` non-zeros a pair), where a column of X
//! stacks the normalised low features and the scaled residual of one pair. Three ways to the minimum ([`Algorithm`]); then
//! Dh by least squares on the codes that eq. (4) gives, both refined together through the active set ([`refine`]), and
//! regressors anchored in the feature space for the fast path ([`anchored`]) and,
//! where it is asked for, a small network ([`network`]).
//!
//! Nothing here prints. The same photos, parameters and seed give the same dictionary on any number of threads, and a
//! run resumed from its checkpoint gives what the uninterrupted run gives.

pub mod anchored;
mod atoms;
mod captured_crops;
mod checkpoint;
mod data;
pub mod ksvd;
pub mod linear;
pub mod network;
pub mod online;
mod parameters;
pub mod refine;
mod run;
mod statistics;

pub use captured_crops::captured_crops;
pub use data::Data;
pub use network::NetworkParameters;
pub use parameters::{Algorithm, Coupling, Parameters};
pub use run::{Epoch, Outcome, train, train_on};

/// What goes wrong in training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
    /// The photos do not give enough to learn from.
    #[error("{0}")]
    TooLittle(String),
    /// The caller's own crops could not be made.
    #[error("{0}")]
    Crops(String),
    /// Photos or pairs.
    #[error(transparent)]
    Pairs(#[from] lenslet_data_gen::pairs::Error),
    /// The dictionary itself.
    #[error(transparent)]
    Dictionary(#[from] lenslet_core::dictionary::Error),
    /// The solver.
    #[error(transparent)]
    Sparse(#[from] lenslet_core::sparse::Error),
    /// A checkpoint that cannot be used.
    #[error("checkpoint {path}: {reason}")]
    Checkpoint {
        /// Which file.
        path: String,
        /// Why, and what to do.
        reason: String,
    },
    /// Output failed.
    #[error(transparent)]
    Output(#[from] lenslet_core::output::Error),
    /// The caller asked to stop; the checkpoint, if any, holds the last whole epoch.
    #[error("interrupted")]
    Interrupted,
}
