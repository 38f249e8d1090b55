//! The dictionaries inside the program: those of the folder `dictionaries` with a card and a recipe, listed by the
//! build script. Which of them is for which views is read from their headers.

use lenslet_core::dictionary::{self, Dictionary, Footprint, ModelKind};
use lenslet_core::interpolation::Interpolation;

// `INDEX`: names and files, the default first.
include!(concat!(env!("OUT_DIR"), "/embedded_index.rs"));

/// The names of [`embedded_by_name`], the default first.
///
/// ```
/// use lenslet_views::reconstruct::embedded_names;
///
/// assert_eq!(embedded_names().next(), Some("default"));
/// assert!(embedded_names().any(|name| name == "multiview"));
/// ```
pub fn embedded_names() -> impl Iterator<Item = &'static str> {
    INDEX.iter().map(|(name, _)| *name)
}

/// A dictionary inside the program by its name; `None` where there is none of that name.
#[must_use]
pub fn embedded_by_name(name: &str) -> Option<Result<Dictionary, dictionary::Error>> {
    let (name, bytes) = INDEX.iter().find(|(known, _)| *known == name)?;
    Some(dictionary::from_bytes(bytes, &format!("the embedded dictionary {name}")))
}

/// The first name all of whose models are of a wanted kind.
fn name_with(wanted: impl Fn(&ModelKind) -> bool) -> Option<&'static str> {
    let fits = |name, bytes| dictionary::read_kinds(bytes, name).is_ok_and(|kinds| kinds.iter().all(&wanted));
    INDEX.iter().find(|(name, bytes)| fits(name, bytes)).map(|(name, _)| *name)
}

/// The name of the dictionary for views of the final size that `base` made: the first that was trained for it, else the
/// default.
///
/// ```
/// use lenslet_core::interpolation::Interpolation;
/// use lenslet_views::reconstruct::embedded_name_for;
///
/// assert_eq!(embedded_name_for(Interpolation::Multiview), "multiview");
/// assert_eq!(embedded_name_for(Interpolation::Cubic), "default");
/// ```
#[must_use]
pub fn embedded_name_for(base: Interpolation) -> &'static str {
    name_with(|kind| kind.base == base && kind.footprint != Footprint::Grid).unwrap_or("default")
}

/// The name of the dictionary for rectangular grids that are enlarged by `scale`, where there is one.
///
/// ```
/// use lenslet_views::reconstruct::embedded_name_for_grid;
///
/// assert_eq!(embedded_name_for_grid(3.0), Some("x3"));
/// assert_eq!(embedded_name_for_grid(2.5), None);
/// ```
#[must_use]
pub fn embedded_name_for_grid(scale: f64) -> Option<&'static str> {
    name_with(|kind| kind.footprint == Footprint::Grid && kind.pitch == scale)
}

/// The dictionary of [`embedded_name_for`].
///
/// # Errors
/// When the build embedded a file that is no dictionary.
pub fn embedded_dictionary_for(base: Interpolation) -> Result<Dictionary, dictionary::Error> {
    let name = embedded_name_for(base);
    embedded_by_name(name)
        .unwrap_or_else(|| Err(dictionary::Error::Parameter(format!("no dictionary {name} is embedded"))))
}

/// The dictionary embedded in the program for views interpolated from their own samples: `dictionaries/default.lfd`.
///
/// # Errors
/// As [`embedded_dictionary_for`].
pub fn embedded_dictionary() -> Result<Dictionary, dictionary::Error> {
    embedded_dictionary_for(Interpolation::Barycentric)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_dictionary_is_whole_and_chosen_for_the_views_it_was_trained_on() {
        for (name, bytes) in INDEX {
            let kinds: Vec<ModelKind> =
                embedded_by_name(name).unwrap().unwrap().models.iter().map(|m| m.kind()).collect();
            assert_eq!(dictionary::read_kinds(bytes, name).unwrap(), kinds, "{name}");
        }
        assert_eq!(embedded_names().collect::<Vec<_>>(), ["default", "multiview", "small", "x2", "x3"]);
        assert!(embedded_by_name("nothing").is_none());
        for base in [Interpolation::Barycentric, Interpolation::Multiview] {
            let found = embedded_dictionary_for(base).unwrap();
            assert!(found.models.iter().all(|m| m.base == base), "{base}");
        }
        assert_eq!(embedded_name_for(Interpolation::Bicubic), "default");
        assert_eq!(embedded_name_for(Interpolation::Barycentric), "default");
        assert_eq!([2.0, 3.0, 4.0].map(embedded_name_for_grid), [Some("x2"), Some("x3"), None]);
    }
}
