//! How the values of a view were made from samples.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// How a view's pixels are interpolated from hexagonal samples (paper sections 4.1 to 4.3). Learned reconstruction
/// (section 4.4) is not a fifth variant but a step after any of these.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// One value per pitch on a regular grid, then bicubic enlargement (section 4.1).
    Bicubic,
    /// Linear over the Delaunay triangles of the lenslet centres (section 4.2).
    Barycentric,
    /// A C¹ cubic surface through the same samples: a stronger single-view baseline.
    Cubic,
    /// Samples of all views at their places in one view (section 4.3).
    Multiview,
}

impl Interpolation {
    /// All of them, in the paper's order.
    pub const ALL: [Interpolation; 4] =
        [Interpolation::Bicubic, Interpolation::Barycentric, Interpolation::Cubic, Interpolation::Multiview];

    /// The name on the command line, in files and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Interpolation::Bicubic => "bicubic",
            Interpolation::Barycentric => "barycentric",
            Interpolation::Cubic => "cubic",
            Interpolation::Multiview => "multiview",
        }
    }
}

impl fmt::Display for Interpolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that does not belong to any [`Interpolation`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown interpolation \"{0}\": it must be bicubic, barycentric, cubic or multiview")]
pub struct UnknownInterpolation(pub String);

impl FromStr for Interpolation {
    type Err = UnknownInterpolation;

    fn from_str(name: &str) -> Result<Self, UnknownInterpolation> {
        Interpolation::ALL.into_iter().find(|i| i.name() == name).ok_or_else(|| UnknownInterpolation(name.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for interpolation in Interpolation::ALL {
            assert_eq!(interpolation.name().parse(), Ok(interpolation));
            let json = serde_json::to_string(&interpolation).unwrap();
            assert_eq!(json, format!("\"{interpolation}\""));
        }
        assert!("learned".parse::<Interpolation>().is_err());
    }
}
