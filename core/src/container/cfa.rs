//! The colour filter array of a sensor.

use serde::{Deserialize, Serialize};

/// Colour filter array of the 2×2 tile whose top left pixel is pixel (0,0).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cfa {
    /// R G / G B
    Rggb,
    /// B G / G R (Lytro F01)
    Bggr,
    /// G R / B G (Lytro Illum)
    Grbg,
    /// G B / R G
    Gbrg,
    /// No colour filter.
    Mono,
}

impl Cfa {
    /// Channel of the pixel at column `x`, row `y`: 0 red, 1 green on red rows, 2 green on blue rows, 3 blue; 1
    /// everywhere without a filter.
    #[inline]
    pub fn plane(self, x: usize, y: usize) -> usize {
        let k = (y & 1) * 2 + (x & 1);
        match self {
            Cfa::Rggb => [0, 1, 2, 3][k],
            Cfa::Bggr => [3, 2, 1, 0][k],
            Cfa::Grbg => [1, 0, 3, 2][k],
            Cfa::Gbrg => [2, 3, 0, 1][k],
            Cfa::Mono => 1,
        }
    }

    /// Colour of the pixel at column `x`, row `y`: 0 red, 1 green, 2 blue.
    ///
    /// ```
    /// use lenslet_core::container::Cfa;
    ///
    /// // An F01: blue in the corner, green beside it, red on the next row.
    /// assert_eq!([(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| Cfa::Bggr.colour(x, y)), [2, 1, 1, 0]);
    /// ```
    #[inline]
    pub fn colour(self, x: usize, y: usize) -> usize {
        [0, 1, 1, 2][self.plane(x, y)]
    }
}
