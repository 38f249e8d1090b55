//! How disparity is estimated.

/// How disparity is estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Smallest and largest disparity to look for, output pixels per view step; `None`, the default: found
    /// from the light field.
    pub range: Option<(f32, f32)>,
    /// Usual search limit where `range` is `None`: ± this many output pixels per view step; default 4.
    pub limit: f32,
    /// How far the search goes beyond `limit` where the views agree better there: ± this many output pixels per view
    /// step; default 64. Not above `limit`: it stays within it.
    pub widest: f32,
    /// Weight of every view, row by row, 0 to 1: those of weight 0 are not used. `None`, the default: all are used, but
    /// for views that are dark (see [`ViewLight`](super::ViewLight)) where light fields are searched.
    pub weights: Option<Vec<f32>>,
    /// Distance between hypotheses, pixels at the outermost view; above 0, default 0.3.
    pub step: f32,
    /// Views whose longer side exceeds this many pixels are halved for the search until they fit; at least 16, default
    /// 640.
    pub side: usize,
    /// Whether values are linear light: matching then works on their square root, whose noise is nearly even; default
    /// no.
    pub linear: bool,
    /// Brightness differences are cut off at this value (of the range 0..1); above 0, default 0.04.
    pub truncation: f32,
    /// Reference view (row v, column u from 0); `None`, the default: the middle one.
    pub reference: Option<(usize, usize)>,
    /// Patches up to this share of the picture's longer side whose disparity differs from all around are filled from
    /// there; 0 to 1, default 0: nothing is filled.
    pub specks: f32,
}

impl Options {
    /// Whether view `k` is used.
    pub(super) fn uses(&self, k: usize) -> bool {
        self.weights.as_ref().is_none_or(|w| w.get(k).is_none_or(|w| *w > 0.0))
    }

    /// Options for maps that are displayed or pointed into, of light fields in linear light: specks up to a thirtieth
    /// of the longer side are filled.
    pub fn shown() -> Self {
        Options { linear: true, specks: 1.0 / 30.0, ..Options::default() }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options {
            range: None,
            limit: 4.0,
            widest: 64.0,
            weights: None,
            step: 0.3,
            side: 640,
            linear: false,
            truncation: 0.04,
            reference: None,
            specks: 0.0,
        }
    }
}
