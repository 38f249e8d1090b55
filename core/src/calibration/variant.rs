//! Which centres a calibration gives: the default, the paper's own, or less, for comparison (paper section 5: results without
//! calibration, without sub-pixel precision).

use super::{Grid, Lattice, lattice};

/// How centres are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Variant {
    /// The whole way on the unrotated mosaic.
    #[default]
    Full,
    /// The paper's Algorithm 1 as written: gamma, rotated image, erosion, local maxima, paraboloids.
    Paper,
    /// The default's centres rounded to whole pixels (no sub-pixel step).
    Integer,
    /// An ideal grid of the pitch and rotation found, no row stretch, no lenslet of its own.
    RotationOnly,
    /// A fixed ideal grid of a whole number of pixels' pitch, not rotated (no calibration).
    None,
}

impl Variant {
    /// All of them, the default first.
    pub const ALL: [Variant; 5] =
        [Variant::Full, Variant::Paper, Variant::Integer, Variant::RotationOnly, Variant::None];

    /// Name as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Variant::Full => "full",
            Variant::Paper => "paper",
            Variant::Integer => "integer",
            Variant::RotationOnly => "rotation-only",
            Variant::None => "none",
        }
    }
}

impl std::fmt::Display for Variant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Variant {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Variant::ALL.into_iter().find(|v| v.name() == text).ok_or_else(|| {
            let names: Vec<&str> = Variant::ALL.iter().map(|v| v.name()).collect();
            format!("`{text}` is no variant; there are {}", names.join(", "))
        })
    }
}

/// The ideal grid with `found`'s packing and a lenslet where `found` has its (0, 0): pitch and rotation as given, no stretch.
pub fn ideal(found: &Lattice, pitch: f64, rotation: f64, width: usize, height: usize) -> Lattice {
    let (s, c) = rotation.sin_cos();
    let a = match found.grid {
        Grid::HexColumns => [-pitch * s, pitch * c],
        _ => [pitch * c, pitch * s],
    };
    let (s, c) = match found.grid {
        Grid::Square => (1.0, 0.0),
        _ => 60f64.to_radians().sin_cos(),
    };
    let b = [c * a[0] - s * a[1], s * a[0] + c * a[1]];
    lattice::centred(Lattice { grid: found.grid, origin: found.origin, a, b }, width, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back() {
        for v in Variant::ALL {
            assert_eq!(v.to_string().parse(), Ok(v));
        }
        assert!("x".parse::<Variant>().unwrap_err().contains("rotation-only"));
    }

    #[test]
    fn ideal_grids_have_what_was_asked() {
        for grid in [Grid::HexRows, Grid::HexColumns, Grid::Square] {
            let found = Lattice { grid, origin: [50.2, 49.1], a: [10.1, 0.3], b: [5.0, 8.9] };
            let l = ideal(&found, 10.0, 0.03, 100, 100);
            assert!((l.pitch() - 10.0).abs() < 1e-12 && (l.rotation() - 0.03).abs() < 1e-12);
            assert!((l.row_stretch() - 1.0).abs() < 1e-12);
            assert_eq!(l.grid, grid);
        }
    }
}
