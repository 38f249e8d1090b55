//! The dictionaries that learned methods use: those inside the program, or others given in their place.

use std::sync::Arc;

use anyhow::Result;
use lenslet_core::dictionary::{self, Dictionary};
use lenslet_core::digest::sha256_hex;
use lenslet_core::interpolation::Interpolation;
use lenslet_views::reconstruct::embedded_dictionary_for;

use super::method::Method;
use super::render::FOOTPRINT;

/// A dictionary and its hash.
#[derive(Debug)]
pub struct UsedDictionary {
    pub(super) dictionary: Dictionary,
    /// SHA-256 of its `.lfd` file, hexadecimal.
    pub(super) sha256: String,
}

/// One dictionary for views interpolated from their own samples, and one for refined views.
#[derive(Debug, Clone, Default)]
pub struct UsedDictionaries {
    interpolated: Option<Arc<UsedDictionary>>,
    refined: Option<Arc<UsedDictionary>>,
}

impl UsedDictionaries {
    /// The embedded dictionaries, each replaced by the last of `given` that was trained for the same views.
    ///
    /// # Errors
    /// A dictionary that cannot be used.
    pub fn new(given: Vec<Dictionary>) -> Result<UsedDictionaries> {
        let mut used = UsedDictionaries::default();
        let embedded = [Interpolation::Barycentric, Interpolation::Multiview].map(embedded_dictionary_for);
        for dictionary in embedded.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().chain(given) {
            let sha256 = sha256_hex(&dictionary::to_bytes(&dictionary)?);
            let refined = dictionary.models.iter().any(|m| m.base == Interpolation::Multiview);
            let place = if refined { &mut used.refined } else { &mut used.interpolated };
            *place = Some(Arc::new(UsedDictionary { dictionary, sha256 }));
        }
        Ok(used)
    }

    /// The dictionary of a method; none of an interpolation.
    pub(super) fn of(&self, method: Method) -> Option<&UsedDictionary> {
        match method {
            Method::Learned(_) => self.interpolated.as_deref(),
            Method::LearnedMultiview(_) => self.refined.as_deref(),
            _ => None,
        }
    }

    /// Whether the method's dictionary holds its predictor, or it needs none.
    pub(super) fn can(&self, method: Method) -> bool {
        let Some(predictor) = method.predictor() else { return true };
        let model = self.of(method).and_then(|d| d.dictionary.model(FOOTPRINT));
        model.is_some_and(|m| m.patch_model.has(predictor))
    }
}
