//! What a network takes besides the low image.

use serde::{Deserialize, Serialize};

/// An image of a view that a network takes besides the low image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SideInput {
    /// The view's own samples, linear over triangles.
    Barycentric,
    /// The view's own samples, by a C¹ cubic surface.
    Cubic,
    /// The low image, brighter by the standard deviation of its samples' noise at each pixel's brightness: a window of
    /// a few pixels does not tell texture from noise.
    Noise,
}

impl SideInput {
    /// The name in files and messages.
    ///
    /// ```
    /// use lenslet_core::dictionary::SideInput;
    ///
    /// assert_eq!(SideInput::Noise.name(), "noise");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            SideInput::Barycentric => "barycentric",
            SideInput::Cubic => "cubic",
            SideInput::Noise => "noise",
        }
    }
}
