//! From samples to views: the methods that are compared.

use lenslet_core::dictionary::PatchPredictor;
use lenslet_core::interpolation::Interpolation;
use lenslet_views::multiview::Fit;
use serde::{Serialize, Serializer};

/// How views are made of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Section 4.1.
    Bicubic,
    /// Section 4.1 as printed: one raw value a low pixel.
    BicubicDownsampled,
    /// Section 4.2.
    Barycentric,
    /// A C¹ surface through the samples of one view.
    Cubic,
    /// Section 4.3: the picture of which every sample is the mean over its lenslet.
    Multiview,
    /// Section 4.3, the picture in which every sample is a point, by least squares.
    MultiviewLeastSquares,
    /// Section 4.3 as in the paper: barycentric on the triangulation of the samples of all views.
    MultiviewTriangulated,
    /// Section 4.4 on the interpolation the dictionary was trained for, by one of its predictors.
    Learned(PatchPredictor),
    /// Section 4.4 on top of section 4.3, by one of the dictionary's predictors.
    LearnedMultiview(PatchPredictor),
}

impl From<Interpolation> for Method {
    fn from(interpolation: Interpolation) -> Method {
        match interpolation {
            Interpolation::Bicubic => Method::Bicubic,
            Interpolation::Barycentric => Method::Barycentric,
            Interpolation::Cubic => Method::Cubic,
            Interpolation::Multiview => Method::Multiview,
        }
    }
}

impl Serialize for Method {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name().replace(", ", "-").replace(' ', "-").to_lowercase())
    }
}

impl Method {
    /// All, in the order of the tables.
    pub fn all() -> impl Iterator<Item = Method> {
        [
            Method::BicubicDownsampled,
            Method::Bicubic,
            Method::Barycentric,
            Method::Cubic,
            Method::MultiviewTriangulated,
            Method::MultiviewLeastSquares,
            Method::Multiview,
        ]
        .into_iter()
        .chain(PatchPredictor::ALL.map(Method::Learned))
        .chain(PatchPredictor::ALL.map(Method::LearnedMultiview))
    }

    /// Name in tables: of learned reconstruction that of the predictor.
    pub fn name(self) -> String {
        match self {
            Method::Bicubic => "bicubic".into(),
            Method::BicubicDownsampled => "bicubic, raw downsampled".into(),
            Method::Barycentric => "barycentric".into(),
            Method::Cubic => "cubic".into(),
            Method::Multiview => "multiview".into(),
            Method::MultiviewTriangulated => "multiview, triangulated".into(),
            Method::MultiviewLeastSquares => "multiview, least squares".into(),
            Method::Learned(predictor) => predictor.name().into(),
            Method::LearnedMultiview(predictor) => format!("{predictor} on multiview"),
        }
    }

    /// The predictor of learned reconstruction; none of an interpolation.
    pub fn predictor(self) -> Option<PatchPredictor> {
        match self {
            Method::Learned(predictor) | Method::LearnedMultiview(predictor) => Some(predictor),
            _ => None,
        }
    }

    /// The interpolation of the samples; none where the method starts from another one's views, or has its own.
    pub fn interpolation(self) -> Option<Interpolation> {
        match self {
            Method::Bicubic => Some(Interpolation::Bicubic),
            Method::Barycentric => Some(Interpolation::Barycentric),
            Method::Cubic => Some(Interpolation::Cubic),
            Method::Multiview | Method::MultiviewLeastSquares | Method::MultiviewTriangulated => {
                Some(Interpolation::Multiview)
            }
            Method::BicubicDownsampled | Method::Learned(_) | Method::LearnedMultiview(_) => None,
        }
    }

    /// Whether a view is made of the samples of other views too.
    pub fn uses_other_views(self) -> bool {
        self.interpolation() == Some(Interpolation::Multiview) || matches!(self, Method::LearnedMultiview(_))
    }

    /// How multi-view samples become pixels.
    pub fn fit(self) -> Fit {
        match self {
            Method::MultiviewTriangulated => Fit::Triangulation,
            Method::MultiviewLeastSquares => Fit::LeastSquares,
            _ => Fit::default(),
        }
    }

    /// Multi-view by this fit.
    pub fn multiview_by(fit: Fit) -> Method {
        match fit {
            Fit::Triangulation => Method::MultiviewTriangulated,
            Fit::LeastSquares => Method::MultiviewLeastSquares,
            Fit::Joint(_) => Method::Multiview,
        }
    }

    /// Whether a view takes seconds even on a small sensor; quick runs leave these methods out.
    pub fn is_slow(self) -> bool {
        self == Method::MultiviewTriangulated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_predictor_has_its_row() {
        let names: Vec<String> = Method::all().map(Method::name).collect();
        for name in ["no codes", "LASSO", "network on multiview", "no codes on multiview", "ridge", "anchored"] {
            assert!(names.iter().any(|n| n == name), "{name} of {names:?}");
        }
        let json = serde_json::to_string(&Method::LearnedMultiview(PatchPredictor::NoCodes)).unwrap();
        assert_eq!(json, "\"no-codes-on-multiview\"");
    }
}
