//! Learning of coupled dictionaries Dh, Dl from photos (paper section 4.4, eq. (3)).
//!
//! min over D = [Dh; Dl] and codes α of ½‖X − Dα‖² + λ‖α‖₁ (or at most `nonzeros` non-zeros a pair), where a column of
//! X stacks the normalised low features and the scaled residual of one pair. Three ways to the minimum ([`Algorithm`]);
//! then Dh by least squares on the codes of eq. (4), both refined together through the active set ([`refine`]),
//! regressors anchored in the feature space for the fast path ([`anchored`]) and, where it is asked for, a small
//! network ([`network`]).
//!
//! [`train_dictionary`] does all of it; the modules are its parts, for experiments with one of them.
//!
//! Nothing here prints. The same photos, parameters and seed give the same dictionary on any number of threads, and a
//! run resumed from its checkpoint gives what the uninterrupted run gives.

mod api;
mod atoms;
mod captured_crops;
mod checkpoint;
mod error;
pub mod ksvd;
mod normalised_pairs;
mod observed;
pub mod online;
pub mod optimiser;
mod parameters;
#[cfg(test)]
mod planted;
mod predictors;
mod recipe;
pub mod refine;
pub mod regression;
mod run;
mod scorer;
mod stacked_pairs;
mod statistics;
mod trace;
mod training_crops;

pub use api::{TrainingOutcome, train_dictionary, train_on_crops};
pub use captured_crops::captured_crops;
pub use error::Error;
pub use parameters::{
    Algorithm, AnchorParameters, Coupling, DegradationParameters, DictionaryParameters, KsvdUpdate, NetworkParameters,
    PairParameters, Parameters, RefinementParameters,
};
pub use predictors::{anchored, network};
pub use trace::{Epoch, EpochSummary};
pub use training_crops::TrainingCrops;
