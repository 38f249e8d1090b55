//! What the fitting of a predictor is told.

use lenslet_core::dictionary::Footprint;
use lenslet_core::progress::Observer;
use rand::rngs::ChaCha8Rng;

use crate::parameters::Parameters;

/// What the fitting of a predictor is told besides what it is fitted to.
pub(crate) struct Fitting<'a> {
    pub(crate) footprint: Footprint,
    pub(crate) parameters: &'a Parameters,
    pub(crate) observer: &'a dyn Observer,
    /// The random stream of the current model by a number that no other stage uses.
    pub(crate) random_stream: &'a dyn Fn(u64) -> ChaCha8Rng,
}
