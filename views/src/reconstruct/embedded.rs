//! The dictionaries inside the program.

use lenslet_core::dictionary::{self, Dictionary, Interpolation};

/// Names and files; the first is the default.
const SHELF: [(&str, &[u8]); 5] = [
    ("default", include_bytes!("../../../dictionaries/default.lfd")),
    ("multiview", include_bytes!("../../../dictionaries/multiview.lfd")),
    ("small", include_bytes!("../../../dictionaries/small.lfd")),
    ("x2", include_bytes!("../../../dictionaries/x2.lfd")),
    ("x3", include_bytes!("../../../dictionaries/x3.lfd")),
];

/// The names of [`named`], the default first.
pub fn names() -> impl Iterator<Item = &'static str> {
    SHELF.iter().map(|(name, _)| *name)
}

/// A dictionary inside the program by its name; `None` where no such is.
#[must_use]
pub fn named(name: &str) -> Option<Result<Dictionary, dictionary::Error>> {
    let (name, bytes) = SHELF.iter().find(|(known, _)| *known == name)?;
    Some(dictionary::from_bytes(bytes, &format!("the embedded dictionary {name}")))
}

/// The name of the dictionary for views of the final size that `base` made.
#[must_use]
pub fn name_for(base: Interpolation) -> &'static str {
    if base == Interpolation::Multiview { "multiview" } else { "default" }
}

/// The dictionary for views of the final size that `base` made: one of its own for refined views, the default for all
/// others.
///
/// # Errors
/// When the build embedded a file that is no dictionary.
pub fn embedded_for(base: Interpolation) -> Result<Dictionary, dictionary::Error> {
    let name = name_for(base);
    named(name).unwrap_or_else(|| Err(dictionary::Error::Parameter(format!("no dictionary {name} is embedded"))))
}

/// The dictionary embedded in the program: `dictionaries/default.lfd`.
///
/// # Errors
/// As [`embedded_for`].
pub fn embedded() -> Result<Dictionary, dictionary::Error> {
    embedded_for(Interpolation::Barycentric)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_dictionary_is_whole_and_made_for_what_it_is_taken_for() {
        for name in names() {
            assert!(named(name).unwrap().is_ok(), "{name}");
        }
        assert!(named("nothing").is_none());
        for base in [Interpolation::Barycentric, Interpolation::Multiview] {
            let found = embedded_for(base).unwrap();
            assert!(found.models.iter().all(|m| m.base == base), "{base}");
        }
        assert_eq!(name_for(Interpolation::Cubic), name_for(Interpolation::Barycentric));
    }
}
