//! The options of decoding.

use super::steps::Steps;

/// Where the white balance comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WhiteBalance {
    /// The capture's own gains (metadata or profile).
    Camera,
    /// Estimated from the capture, by shades of grey.
    Auto,
    /// Gains of red, green, blue: each above 0, below 1000.
    Gains([f32; 3]),
}

/// Options of decoding.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Views per row and per column: odd, 1 to 15. Default 7, the paper's choice.
    pub views: usize,
    /// Sensor pixels between neighbouring views: above 0, up to 4. Default 1.
    pub view_step: f64,
    /// Where the white balance comes from. Default: the capture.
    pub white_balance: WhiteBalance,
    /// Move all views so that (0, 0) lies at the middle of the aperture as measured in the white image, which may
    /// differ from the calibration's centres. Default: yes.
    pub recentre: bool,
    /// Rotate the demosaiced raw by the lattice's angle and resample it before views are cut, as printed in the paper's
    /// Algorithm 1, instead of turning coordinates. Not for [`Demosaic::CoKriging`](super::Demosaic::CoKriging), which
    /// has no demosaiced raw. Default: no.
    pub rotate_raw: bool,
    /// The development steps. Default: [`Steps::default`]; [`steps_for`](super::steps_for) gives those of a capture.
    pub steps: Steps,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            views: 7,
            view_step: 1.0,
            white_balance: WhiteBalance::Camera,
            recentre: true,
            rotate_raw: false,
            steps: Steps::default(),
        }
    }
}
