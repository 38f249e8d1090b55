//! How the views of a light field were made, as recorded in `lightfield.json`.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::interpolation::Interpolation;

/// What made the values of the views: `method` in `lightfield.json`, a single word there.
///
/// ```
/// use lenslet_core::interpolation::Interpolation;
/// use lenslet_core::lightfield::ViewOrigin;
///
/// let origin: ViewOrigin = serde_json::from_str("\"multiview\"")?;
/// assert_eq!(origin, ViewOrigin::Interpolated(Interpolation::Multiview));
/// assert_eq!(serde_json::to_string(&ViewOrigin::Learned)?, "\"learned\"");
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum ViewOrigin {
    /// Interpolated from samples.
    Interpolated(Interpolation),
    /// Learned reconstruction of interpolated views.
    Learned,
    /// The scene itself, drawn by a simulation.
    Truth,
    /// What another program calls its method.
    Other(String),
}

impl ViewOrigin {
    /// The word in the file.
    pub fn name(&self) -> &str {
        match self {
            ViewOrigin::Interpolated(interpolation) => interpolation.name(),
            ViewOrigin::Learned => "learned",
            ViewOrigin::Truth => "truth",
            ViewOrigin::Other(name) => name,
        }
    }
}

impl From<Interpolation> for ViewOrigin {
    fn from(interpolation: Interpolation) -> Self {
        ViewOrigin::Interpolated(interpolation)
    }
}

impl From<String> for ViewOrigin {
    fn from(name: String) -> Self {
        match name.parse() {
            Ok(interpolation) => ViewOrigin::Interpolated(interpolation),
            Err(_) => match name.as_str() {
                "learned" => ViewOrigin::Learned,
                "truth" => ViewOrigin::Truth,
                _ => ViewOrigin::Other(name),
            },
        }
    }
}

impl From<&str> for ViewOrigin {
    fn from(name: &str) -> Self {
        name.to_string().into()
    }
}

impl From<ViewOrigin> for String {
    fn from(origin: ViewOrigin) -> Self {
        match origin {
            ViewOrigin::Other(name) => name,
            known => known.name().to_string(),
        }
    }
}

impl fmt::Display for ViewOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_is_written_as_it_was_read() {
        for word in
            ["bicubic", "barycentric", "cubic", "multiview", "learned", "truth", "Multiview", "", "someone's own"]
        {
            let json = serde_json::to_string(word).unwrap();
            let origin: ViewOrigin = serde_json::from_str(&json).unwrap();
            assert_eq!(serde_json::to_string(&origin).unwrap(), json);
            assert_eq!(origin.to_string(), word);
            let known = !matches!(origin, ViewOrigin::Other(_));
            assert_eq!(known, ["learned", "truth"].contains(&word) || word.parse::<Interpolation>().is_ok());
        }
    }
}
