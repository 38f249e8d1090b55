//! From samples to views: the methods that are compared.

use lenslet_core::interpolation::Interpolation;
use lenslet_views::multiview::Fit;
use serde::Serialize;

/// How views are made of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Section 4.1.
    Bicubic,
    /// Section 4.1 as printed: one raw value a low pixel.
    BicubicDownsampled,
    /// Section 4.2.
    Barycentric,
    /// A C¹ surface through the samples of one view.
    Cubic,
    /// Section 4.3, fitted by least squares.
    Multiview,
    /// Section 4.3 as in the paper: barycentric on the triangulation of the samples of all views.
    MultiviewTriangulated,
    /// Section 4.4 on the interpolation the dictionary was trained for.
    Learned,
    /// Section 4.4 on top of section 4.3.
    LearnedMultiview,
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

impl Method {
    /// All, in the order of the tables.
    pub const ALL: [Method; 8] = [
        Method::BicubicDownsampled,
        Method::Bicubic,
        Method::Barycentric,
        Method::Cubic,
        Method::MultiviewTriangulated,
        Method::Multiview,
        Method::Learned,
        Method::LearnedMultiview,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Method::Bicubic => "bicubic",
            Method::BicubicDownsampled => "bicubic, raw downsampled",
            Method::Barycentric => "barycentric",
            Method::Cubic => "cubic",
            Method::Multiview => "multiview",
            Method::MultiviewTriangulated => "multiview, triangulated",
            Method::Learned => "learned",
            Method::LearnedMultiview => "learned on multiview",
        }
    }

    /// The interpolation of the samples; none where the method starts from another one's views, or has its own.
    pub fn interpolation(self) -> Option<Interpolation> {
        match self {
            Method::Bicubic => Some(Interpolation::Bicubic),
            Method::Barycentric => Some(Interpolation::Barycentric),
            Method::Cubic => Some(Interpolation::Cubic),
            Method::Multiview | Method::MultiviewTriangulated => Some(Interpolation::Multiview),
            Method::BicubicDownsampled | Method::Learned | Method::LearnedMultiview => None,
        }
    }

    /// How multi-view samples become pixels.
    pub fn fit(self) -> Fit {
        if self == Method::MultiviewTriangulated { Fit::Triangulation } else { Fit::Smooth }
    }

    /// Whether a view takes seconds even on a small sensor; quick runs leave these methods out.
    pub fn is_slow(self) -> bool {
        self == Method::MultiviewTriangulated
    }
}
