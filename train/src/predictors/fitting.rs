//! What the fitting of a predictor is told.

use lenslet_core::dictionary::Footprint;
use lenslet_core::progress::Observer;
use rand::rngs::ChaCha8Rng;

use crate::error::Error;
use crate::parameters::Parameters;

/// What the fitting of a predictor is told besides what it is fitted to.
pub(crate) struct Fitting<'a> {
    pub(crate) footprint: Footprint,
    pub(crate) parameters: &'a Parameters,
    pub(crate) observer: &'a dyn Observer,
    /// The random stream of the current model by a number that no other stage uses.
    pub(crate) random_stream: &'a dyn Fn(u64) -> ChaCha8Rng,
}

impl Fitting<'_> {
    /// Counts `n` pairs as done.
    ///
    /// # Errors
    /// Interruption.
    pub(super) fn advance(&self, n: usize) -> Result<(), Error> {
        self.observer.advance(n as u64);
        Ok(self.observer.check()?)
    }
}
