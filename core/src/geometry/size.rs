//! The size of a picture.

use serde::{Deserialize, Serialize};

/// Width and height of a picture or a sensor, in pixels.
///
/// ```
/// use lenslet_core::geometry::Size;
/// let sensor = Size::new(3280, 3280);
/// assert_eq!(sensor.with_longer_side(1080), Size::new(1080, 1080));
/// assert_eq!(Size::new(400, 300).with_longer_side(100).to_string(), "100x75");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// `width` columns and `height` rows.
    #[must_use]
    pub const fn new(width: usize, height: usize) -> Self {
        Size { width, height }
    }

    /// The same shape with a longer side of `side` pixels; each side is rounded, and at least 1.
    #[must_use]
    pub fn with_longer_side(self, side: usize) -> Self {
        let longer = self.width.max(self.height).max(1) as f64;
        let scaled = |n: usize| ((n as f64 * side as f64 / longer).round() as usize).max(1);
        Size { width: scaled(self.width), height: scaled(self.height) }
    }

    /// Number of pixels; `None` when it exceeds a usize.
    #[must_use]
    pub const fn pixels(self) -> Option<usize> {
        self.width.checked_mul(self.height)
    }
}

/// From (width, height).
impl From<(usize, usize)> for Size {
    fn from((width, height): (usize, usize)) -> Self {
        Size { width, height }
    }
}

/// To (width, height).
impl From<Size> for (usize, usize) {
    fn from(size: Size) -> Self {
        (size.width, size.height)
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}
