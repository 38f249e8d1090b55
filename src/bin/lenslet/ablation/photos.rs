//! The photographs inside the program (`photos/` in the repository): some are scored, the others are trained on.

use std::path::PathBuf;

use anyhow::Result;

macro_rules! photo {
    ($folder:literal, $name:literal) => {
        ($name, include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/photos/", $folder, "/", $name)))
    };
}

/// A name and the JPEG file.
type Photo = (&'static str, &'static [u8]);

/// What the scene `photos` shows. The shipped dictionaries hold these photos out of training.
pub(super) const SCORED: [Photo; 3] = [
    photo!("score", "oakland-zoo-otters.jpg"),
    photo!("score", "cincinnati-bridge.jpg"),
    photo!("score", "beacon-street-sunset.jpg"),
];

/// What the dictionary experiment trains on where no other photos are given.
pub(super) const TRAINING: [Photo; 8] = [
    photo!("train", "casa-mila.jpg"),
    photo!("train", "european-honey-bee.jpg"),
    photo!("train", "kitten-on-lawn.jpg"),
    photo!("train", "motherboard-circuits.jpg"),
    photo!("train", "perched-osprey.jpg"),
    photo!("train", "piazza-gae-aulenti.jpg"),
    photo!("train", "tea-gardens.jpg"),
    photo!("train", "the-spices-of-life.jpg"),
];

/// Photos as files, in a folder that lasts as long as its value.
///
/// # Errors
/// When they cannot be written.
pub(super) fn write_photos(photos: &[Photo]) -> Result<(Vec<PathBuf>, tempfile::TempDir)> {
    let folder = tempfile::tempdir()?;
    let mut paths = Vec::new();
    for (name, bytes) in photos {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes)?;
        paths.push(path);
    }
    Ok((paths, folder))
}

#[cfg(test)]
mod tests {
    use lenslet_core::interpolation::Interpolation;
    use lenslet_views::reconstruct::{embedded_by_name, embedded_dictionary_for, embedded_names};

    use super::*;

    #[test]
    fn no_photo_is_scored_and_trained_on() {
        let stem = |name: &'static str| name.trim_end_matches(".jpg");
        assert!(SCORED.iter().all(|s| TRAINING.iter().all(|t| stem(s.0) != stem(t.0) && s.1 != t.1)));
        // Every eighth photo of a recipe is held out: those that are scored here are such in every shipped dictionary.
        for name in embedded_names() {
            let recipe = embedded_by_name(name).unwrap().unwrap().recipe;
            assert_eq!(recipe.parameters["held_out"], 8, "{name}");
            for (scored, _) in SCORED {
                let at = recipe.photos.iter().position(|p| p.file == scored);
                assert!(at.is_none_or(|at| at % 8 == 7), "{name} was trained on {scored}");
            }
        }
        assert!(embedded_dictionary_for(Interpolation::Multiview).is_ok());
    }
}
