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
    /// Paper of all sizes scattered over each other on four planes.
    Collage,
    /// Curved stems on three planes before scattered paper.
    Thicket,
}

/// What a drawn scene is for. A scene that results are scored on is never trained on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SceneUse {
    /// Dictionaries are trained on it, besides photos; nothing is scored on it.
    Training,
    /// Results are scored on it, and tests run on it; nothing is trained on it.
    Scoring,
}

/// Every drawn scene, its name, and what it is for.
const SCENES: [(SceneName, &str, SceneUse); 10] = [
    (SceneName::Natural, "natural", SceneUse::Scoring),
    (SceneName::Planes, "planes", SceneUse::Scoring),
    (SceneName::Slanted, "slanted", SceneUse::Scoring),
    (SceneName::Occluders, "occluders", SceneUse::Scoring),
    (SceneName::Chart, "chart", SceneUse::Scoring),
    (SceneName::Colour, "colour", SceneUse::Scoring),
    (SceneName::White, "white", SceneUse::Scoring),
    (SceneName::Flat, "flat", SceneUse::Scoring),
    (SceneName::Collage, "collage", SceneUse::Training),
    (SceneName::Thicket, "thicket", SceneUse::Training),
];

impl SceneName {
    /// All of them.
    pub const ALL: [SceneName; SCENES.len()] = {
        let mut all = [SceneName::Natural; SCENES.len()];
        let mut k = 0;
        while k < SCENES.len() {
            all[k] = SCENES[k].0;
            k += 1;
        }
        all
    };

    /// The scenes for one use.
    ///
    /// ```
    /// use lenslet_data_gen::simulate::{SceneName, SceneUse};
    /// assert!(SceneName::of_use(SceneUse::Training).eq([SceneName::Collage, SceneName::Thicket]));
    /// assert_eq!(SceneName::Natural.scene_use(), SceneUse::Scoring);
    /// ```
    pub fn of_use(wanted: SceneUse) -> impl Iterator<Item = SceneName> {
        SCENES.into_iter().filter(move |s| s.2 == wanted).map(|s| s.0)
    }

    /// What it is for.
    pub fn scene_use(self) -> SceneUse {
        SCENES[self.row()].2
    }

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        SCENES[self.row()].1
    }

    /// Its row of [`SCENES`].
    fn row(self) -> usize {
        SCENES.iter().position(|s| s.0 == self).unwrap_or(0)
    }

    /// Default of the largest disparity, in pitches per sensor pixel.
    pub fn default_disparity(self) -> f64 {
        match self {
            SceneName::Natural | SceneName::Planes | SceneName::Slanted | SceneName::Occluders => 0.3,
            SceneName::Collage | SceneName::Thicket => 0.3,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_scene_is_both_trained_on_and_scored_on() {
        let (trained, scored): (Vec<_>, Vec<_>) =
            SceneName::ALL.into_iter().partition(|s| s.scene_use() == SceneUse::Training);
        assert!(!trained.is_empty() && trained.iter().all(|s| !scored.contains(s)));
        assert_eq!(trained, SceneName::of_use(SceneUse::Training).collect::<Vec<_>>());
        // Every scene has one row, and every name reads back.
        for (k, scene) in SceneName::ALL.into_iter().enumerate() {
            assert_eq!((scene.row(), scene.name().parse()), (k, Ok(scene)));
        }
        for scored_here in ["natural", "chart", "occluders", "planes", "slanted", "flat"] {
            assert_eq!(scored_here.parse::<SceneName>().map(SceneName::scene_use), Ok(SceneUse::Scoring));
        }
    }
}
