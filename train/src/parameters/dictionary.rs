//! Parameters of the atoms and of how they are learned.

use serde::{Deserialize, Serialize};

use super::range::{odd_side, within};
use crate::error::Error;

/// How the stacked dictionary of eq. (3) is learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// K-SVD: at most `nonzeros` atoms a pair ([`crate::ksvd`]).
    Ksvd,
    /// Online learning in batches ([`crate::online`]).
    Online,
    /// The batch method of the paper: proximal gradient codes of all pairs, then the atoms ([`crate::online`]).
    Ista,
}

/// How K-SVD updates an atom and its coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KsvdUpdate {
    /// One alternation between both (Rubinstein, Zibulevsky and Elad 2008).
    #[default]
    Approximate,
    /// The leading singular pair of the residual (Aharon, Elad and Bruckstein 2006): slower, and the best update of one
    /// atom.
    Exact,
}

/// What is learned first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Coupling {
    /// Dl and Dh together on stacked pairs, as eq. (3) writes it.
    Joint,
    /// Dl alone on the features; Dh afterwards by least squares (Zeyde 2010).
    Low,
}

/// The atoms, and how they are learned.
///
/// | name | default | purpose | range |
/// |---|---|---|---|
/// | `atoms` | 512 | atoms K | 2 … 8192 |
/// | `patch` | 9 | side of a residual patch, pixels | odd, 3 … 25, at most window + 4 |
/// | `window` | 9 | side of the window whose gradients are features, pixels | odd, 3 … 25 |
/// | `features` | 48 | principal components kept | 2 … (window+4)² − 1, at most 4·window² |
/// | `lambda` | 0.2 | λ of eq. (3) and (4), relative to unit features | 0.001 … 0.9 |
/// | `nonzeros` | 4 | most non-zeros of a pair's code in K-SVD | 1 … 64 |
/// | `algorithm` | online | how atoms are learned: ksvd, online, ista | |
/// | `ksvd_update` | approximate | update of an atom in K-SVD: approximate, exact | |
/// | `coupling` | joint | Dl and Dh together (joint), or Dl first and Dh by least squares (low) | |
/// | `epochs` | 3 | epochs of learning | 1 … 1000 |
/// | `batch` | 1024 | pairs a step, in learning and in refinement | 16 … 65536 |
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // in the table above
pub struct DictionaryParameters {
    pub atoms: usize,
    pub patch: usize,
    pub window: usize,
    pub features: usize,
    pub lambda: f32,
    pub nonzeros: usize,
    pub algorithm: Algorithm,
    pub ksvd_update: KsvdUpdate,
    pub coupling: Coupling,
    pub epochs: usize,
    pub batch: usize,
}

impl Default for DictionaryParameters {
    fn default() -> Self {
        DictionaryParameters {
            atoms: 512,
            patch: 9,
            window: 9,
            features: 48,
            lambda: 0.2,
            nonzeros: 4,
            algorithm: Algorithm::Online,
            ksvd_update: KsvdUpdate::Approximate,
            coupling: Coupling::Joint,
            epochs: 3,
            batch: 1024,
        }
    }
}

impl DictionaryParameters {
    /// Most features of a window: its gradients are as many numbers, of as many pixels less their mean.
    #[must_use]
    pub fn most_features(window: usize) -> usize {
        ((window + 4).pow(2) - 1).min(4 * window.pow(2))
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        within("atoms", self.atoms, 2, 8192)?;
        odd_side("patch", self.patch)?;
        odd_side("window", self.window)?;
        within("patch", self.patch, 3, self.window + 4)?;
        within("features", self.features, 2, Self::most_features(self.window))?;
        within("lambda", self.lambda, 0.001, 0.9)?;
        within("nonzeros", self.nonzeros, 1, 64)?;
        within("epochs", self.epochs, 1, 1000)?;
        within("batch", self.batch, 16, 65_536)
    }
}
