//! How disparity is estimated.

/// How disparity is estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Smallest and largest disparity to look for, output pixels per view step; `None`: found from the light field.
    pub range: Option<(f32, f32)>,
    /// How far to look when `range` is `None`: ± so many output pixels per view step.
    pub limit: f32,
    /// Distance between hypotheses: this many pixels at the outermost view.
    pub step: f32,
    /// Views larger than this (longer side) are halved for the search until they fit.
    pub side: usize,
    /// Values are linear light (matching works on their square root, nearer to equal noise).
    pub linear: bool,
    /// Brightness differences beyond this count no more.
    pub truncation: f32,
    /// Reference view (row v, column u from 0); `None`: the middle.
    pub reference: Option<(usize, usize)>,
    /// Patches up to this share of the picture's longer side that differ from all around are filled from there; 0 to 1, 0
    /// leaves everything as it was found.
    pub specks: f32,
}

impl Options {
    /// For maps that people look at or point into, of light fields in linear light: without specks.
    pub fn shown() -> Self {
        Options { linear: true, specks: 1.0 / 30.0, ..Options::default() }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options {
            range: None,
            limit: 4.0,
            step: 0.3,
            side: 640,
            linear: false,
            truncation: 0.04,
            reference: None,
            specks: 0.0,
        }
    }
}
