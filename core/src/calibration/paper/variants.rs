//! Variants of a calibration for comparison: the paper's own centres, or simplified ones of the default.

use super::algorithm1;
use crate::calibration::error::Error;
use crate::calibration::model::{Calibration, CalibrationQuality, Grid, Lattice, Lenslet};
use crate::calibration::options::CalibrationVariant;
use crate::container::Capture;
use crate::geometry::Size;
use crate::progress::Observer;

/// Replaces lattice and centres of a full calibration by those of `variant`; `captures` are what it was made from.
///
/// # Errors
/// As [`algorithm1::run_algorithm1`].
pub fn apply_variant(
    found: &mut Calibration,
    captures: &[&Capture],
    variant: CalibrationVariant,
    observer: &dyn Observer,
) -> Result<(), Error> {
    let (width, height) = (found.width, found.height);
    let on_grid = |grid: Lattice| -> Vec<Lenslet> {
        let place = |[i, j]: [i32; 2]| {
            let [x, y] = grid.centre(i, j);
            Lenslet { i, j, x, y, trust: 0.0 }
        };
        grid.points_within(Size::new(width, height), 0.0).index.into_iter().map(place).collect()
    };
    match variant {
        CalibrationVariant::Full => return Ok(()),
        CalibrationVariant::Paper => {
            let stages = algorithm1::run_algorithm1(captures, observer)?;
            found.lattice = stages.lattice;
            found.lenslets = stages.lenslets;
            found.quality.residual_rms = stages.residual_rms;
            found.quality.scatter = stages.residual_rms / std::f64::consts::SQRT_2;
            found.quality.noise = 0.0;
            let measured = found.lenslets.iter().filter(|l| l.trust > 0.0).count();
            found.quality.rejected = 1.0 - measured as f64 / found.lenslets.len().max(1) as f64;
            found.quality.confidence =
                CalibrationQuality::confidence_of(stages.coherence, stages.prominence, 1.0 - found.quality.rejected);
        }
        CalibrationVariant::Integer => {
            let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
            for l in &mut found.lenslets {
                (l.x, l.y) = (l.x.round().clamp(0.0, right), l.y.round().clamp(0.0, bottom));
            }
        }
        CalibrationVariant::RotationOnly => {
            let l = found.lattice;
            found.lattice = ideal_lattice(&l, l.pitch(), l.rotation(), Size::new(width, height));
            found.lenslets = on_grid(found.lattice);
        }
        CalibrationVariant::None => {
            let l = found.lattice;
            found.lattice = ideal_lattice(&l, l.pitch().round(), 0.0, Size::new(width, height));
            found.lenslets = on_grid(found.lattice);
        }
    }
    found.origin.method = format!("{} ({variant})", found.origin.method);
    Ok(())
}

/// The ideal grid with the packing and origin of `found`, of the given pitch (pixels) and rotation (radians), without
/// row stretch.
pub fn ideal_lattice(found: &Lattice, pitch: f64, rotation: f64, size: Size) -> Lattice {
    let Size { width, height } = size;
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
    Lattice { grid: found.grid, origin: found.origin, a, b }.centred_on(Size::new(width, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ideal_grids_have_what_was_asked() {
        for grid in [Grid::HexRows, Grid::HexColumns, Grid::Square] {
            let found = Lattice { grid, origin: [50.2, 49.1], a: [10.1, 0.3], b: [5.0, 8.9] };
            let l = ideal_lattice(&found, 10.0, 0.03, Size::new(100, 100));
            assert!((l.pitch() - 10.0).abs() < 1e-12 && (l.rotation() - 0.03).abs() < 1e-12);
            assert!((l.row_stretch() - 1.0).abs() < 1e-12);
            assert_eq!(l.grid, grid);
        }
    }

    #[test]
    fn whole_pixels_stay_on_the_sensor() {
        let lattice = Lattice { grid: Grid::Square, origin: [0.3, 0.3], a: [10.0, 0.0], b: [0.0, 10.0] };
        let places = [[99.7, 49.7], [-0.6, -0.6], [20.4, 30.6]];
        let mut found = Calibration {
            width: 100,
            height: 50,
            lattice,
            lenslets: places.map(|[x, y]| Lenslet { i: 0, j: 0, x, y, trust: 1.0 }).to_vec(),
            quality: CalibrationQuality::default(),
            vignetting: None,
            hot_pixels: Vec::new(),
            origin: Default::default(),
        };
        apply_variant(&mut found, &[], CalibrationVariant::Integer, &crate::progress::Silent).unwrap();
        let moved: Vec<[f64; 2]> = found.lenslets.iter().map(|l| [l.x, l.y]).collect();
        assert_eq!(moved, [[99.0, 49.0], [0.0, 0.0], [20.0, 31.0]]);
        assert!(found.origin.method.ends_with(&format!("({})", CalibrationVariant::Integer)));
    }
}
