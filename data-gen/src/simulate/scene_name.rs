//! The drawn scenes, by name.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A scene by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SceneName {
    /// Wall, table, poster, leaves and wires at several depths.
    Natural,
    /// Four textured planes at even steps of disparity, overlapping.
    Planes,
    /// One textured plane whose disparity runs from one side to the other.
    Slanted,
    /// Thin bars and wires in front of a textured wall.
    Occluders,
    /// Resolution chart on one plane: sector star, line pairs, slanted edge, letters.
    Chart,
    /// Colour chart of 24 known patches, by default at disparity 0.
    Colour,
    /// Evenly lit white.
    White,
    /// One textured plane, by default at disparity 0.
    Flat,
}

impl SceneName {
    /// All of them.
    pub const ALL: [SceneName; 8] = [
        SceneName::Natural,
        SceneName::Planes,
        SceneName::Slanted,
        SceneName::Occluders,
        SceneName::Chart,
        SceneName::Colour,
        SceneName::White,
        SceneName::Flat,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SceneName::Natural => "natural",
            SceneName::Planes => "planes",
            SceneName::Slanted => "slanted",
            SceneName::Occluders => "occluders",
            SceneName::Chart => "chart",
            SceneName::Colour => "colour",
            SceneName::White => "white",
            SceneName::Flat => "flat",
        }
    }

    /// Default of the largest disparity, in pitches per sensor pixel.
    pub fn default_disparity(self) -> f64 {
        match self {
            SceneName::Natural | SceneName::Planes | SceneName::Slanted | SceneName::Occluders => 0.3,
            SceneName::Chart => 0.15,
            SceneName::Colour | SceneName::White | SceneName::Flat => 0.0,
        }
    }
}

impl FromStr for SceneName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        SceneName::ALL.into_iter().find(|k| k.name() == text).ok_or_else(|| {
            let names: Vec<_> = SceneName::ALL.iter().map(|k| k.name()).collect();
            format!("no scene is named {text:?}; there are {}", names.join(", "))
        })
    }
}
