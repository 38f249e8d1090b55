//! How views are made of samples: one of four interpolations, and learned reconstruction on top or not.

use std::sync::Arc;

use lenslet_core::dictionary::Dictionary;
use lenslet_core::interpolation::Interpolation;

use crate::multiview::Fit;
use crate::reconstruct;

/// How samples become views (paper section 4).
///
/// ```
/// use lenslet_views::Method;
///
/// assert_eq!(Method::barycentric().name(), "barycentric");
/// assert_eq!(Method::multiview().learned().name(), "learned");
/// ```
#[derive(Debug, Clone)]
pub struct Method {
    /// How the samples are interpolated (sections 4.1 to 4.3).
    pub interpolation: Interpolation,
    /// How multi-view samples become pixels; other interpolations do not look at it. `None`: the fit that the dictionary
    /// was made for ([`Fit::for_dictionary`]), or the usual one where nothing is learned.
    pub fit: Option<Fit>,
    /// Learned reconstruction of the interpolated views (section 4.4).
    pub learned: Option<Learned>,
}

/// How interpolated views are reconstructed.
#[derive(Debug, Clone, Default)]
pub struct Learned {
    /// The dictionary; by default the one inside the program for views of the interpolation
    /// ([`reconstruct::embedded_dictionary_for`]).
    pub dictionary: Option<Arc<Dictionary>>,
    /// Mode, footprint, λ and further options.
    pub options: reconstruct::Options,
}

impl Method {
    /// One value a pitch on a regular grid, then bicubic (section 4.1).
    #[must_use]
    pub fn bicubic() -> Method {
        Interpolation::Bicubic.into()
    }

    /// Barycentric on the triangulation, at the target resolution (section 4.2).
    #[must_use]
    pub fn barycentric() -> Method {
        Interpolation::Barycentric.into()
    }

    /// A smooth cubic surface through the same samples.
    #[must_use]
    pub fn cubic() -> Method {
        Interpolation::Cubic.into()
    }

    /// Samples of the other views added at their exact places (section 4.3).
    #[must_use]
    pub fn multiview() -> Method {
        Interpolation::Multiview.into()
    }

    /// Multi-view samples put together by another fit: [`Fit::Triangulation`] is the paper's own.
    #[must_use]
    pub fn fitted_by(mut self, fit: Fit) -> Method {
        self.fit = Some(fit);
        self
    }

    /// Followed by learned reconstruction with the dictionary inside the program (section 4.4).
    #[must_use]
    pub fn learned(self) -> Method {
        self.learned_with(Learned::default())
    }

    /// Followed by learned reconstruction with the given dictionary and options.
    #[must_use]
    pub fn learned_with(mut self, learned: Learned) -> Method {
        self.learned = Some(learned);
        self
    }

    /// `learned`, or the interpolation's name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        if self.learned.is_some() { "learned" } else { self.interpolation.name() }
    }
}

impl From<Interpolation> for Method {
    fn from(interpolation: Interpolation) -> Method {
        Method { interpolation, fit: None, learned: None }
    }
}
