//! Parameters of the joint refinement of Dl and Dh.

use super::range::within;
use crate::error::Error;

/// The joint refinement of Dl and Dh.
///
/// | name | field | default | purpose | range |
/// |---|---|---|---|---|
/// | `refine` | `epochs` | 6 | epochs of refinement | 0 … 1000 |
/// | `rate` | | 0.03 | first learning rate of Adam, relative to the RMS of the atoms; annealed to a fiftieth | 0 … 1 |
/// | `emphasis` | | 1 | pairs are weighted by their norm to this power: 0 treats patches alike, 2 pixels | 0 … 2 |
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // in the table above
pub struct RefinementParameters {
    pub epochs: usize,
    pub rate: f32,
    pub emphasis: f32,
}

impl Default for RefinementParameters {
    fn default() -> Self {
        RefinementParameters { epochs: 6, rate: 0.03, emphasis: 1.0 }
    }
}

impl RefinementParameters {
    pub(super) fn check(&self) -> Result<(), Error> {
        within("refine", self.epochs, 0, 1000)?;
        within("rate", self.rate, 0.0, 1.0)?;
        within("emphasis", self.emphasis, 0.0, 2.0)
    }
}
