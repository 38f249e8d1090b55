//! Parameters of the anchored regressors.

use super::range::within;
use crate::error::Error;

/// The anchored regressors of the fast path.
///
/// | name | field | default | purpose | range |
/// |---|---|---|---|---|
/// | `anchors` | `count` | 512 | anchors, each with a regressor; 0 for none | 0 … 8192 |
/// | `neighbours` | | 2048 | pairs each regressor is fitted to | 16 … 1 000 000 |
/// | `ridge` | | 0.1 | regularisation ρ of the regressors, for unit features | 1e-6 … 1e6 |
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // in the table above
pub struct AnchorParameters {
    pub count: usize,
    pub neighbours: usize,
    pub ridge: f32,
}

impl Default for AnchorParameters {
    fn default() -> Self {
        AnchorParameters { count: 512, neighbours: 2048, ridge: 0.1 }
    }
}

impl AnchorParameters {
    pub(super) fn check(&self) -> Result<(), Error> {
        within("anchors", self.count, 0, 8192)?;
        within("neighbours", self.neighbours, 16, 1_000_000)?;
        within("ridge", self.ridge, 1e-6, 1e6)
    }
}
