//! The lenslets of one calibrated camera, each at its own place, as the sampling pattern of training pairs.

use std::sync::Arc;

use lenslet_core::calibration::Calibration;
use lenslet_core::digest::sha256_hex;
use lenslet_core::geometry::{LatticePoints, SensorToView, Size};

use super::error::Error;

/// Lenslet centres in pixels of a view. Two are equal when their hashes are.
#[derive(Debug, Clone)]
pub struct CameraLattice {
    sha256: String,
    size: Size,
    row_stretch: f64,
    points: Arc<LatticePoints>,
}

impl PartialEq for CameraLattice {
    fn eq(&self, other: &Self) -> bool {
        self.sha256 == other.sha256
    }
}

impl CameraLattice {
    /// The lenslets of `calibration`, residuals and row stretch included, in views whose longer side has `side` pixels.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a calibration without lenslets or a side of 0.
    pub fn of_calibration(calibration: &Calibration, side: usize) -> Result<CameraLattice, Error> {
        let sensor = Size::new(calibration.width, calibration.height);
        let size = sensor.with_longer_side(side);
        if side == 0 || calibration.lenslets.is_empty() {
            return Err(Error::Parameter("the calibration has no lenslets to sample with".into()));
        }
        let to_view = SensorToView::new(sensor, size);
        let centres: Vec<[f64; 2]> = calibration.lenslets.iter().map(|l| to_view.to_view([l.x, l.y])).collect();
        let index = calibration.lenslets.iter().map(|l| [l.i, l.j]).collect();
        let bytes: Vec<u8> = centres.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let row_stretch = calibration.lattice.row_stretch();
        let points = Arc::new(LatticePoints { index, centres });
        Ok(CameraLattice { sha256: sha256_hex(&bytes), size, row_stretch, points })
    }

    /// A lattice known by its hash only: equal to the one it names, but nothing can be sampled with it.
    pub fn named(sha256: String) -> CameraLattice {
        CameraLattice { sha256, size: Size::new(0, 0), row_stretch: 1.0, points: Arc::new(LatticePoints::default()) }
    }

    /// SHA-256 of the centres (x, y as little-endian f64), hexadecimal.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Whether there is something to sample with.
    pub fn has_points(&self) -> bool {
        !self.points.centres.is_empty()
    }

    /// Row distance over its ideal √3/2 of the pitch; 1 for a lattice known by its hash only.
    pub fn row_stretch(&self) -> f64 {
        self.row_stretch
    }

    /// The lenslets within a window of `width`×`height` pixels of the view, in the window's pixels; `place` (0..1 in x
    /// and y) says where between the first and the last possible whole pixel the window lies.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a window larger than the view, or a lattice known by its hash only.
    pub fn window(&self, width: usize, height: usize, place: [f64; 2]) -> Result<LatticePoints, Error> {
        if !self.has_points() {
            return Err(Error::Parameter(
                "the lattice is known by its hash only: name the calibration it comes from".into(),
            ));
        }
        let (Some(right), Some(down)) = (self.size.width.checked_sub(width), self.size.height.checked_sub(height))
        else {
            return Err(Error::Parameter(format!(
                "crops of {width}x{height} pixels do not fit into the camera's views of {}x{}",
                self.size.width, self.size.height
            )));
        };
        let corner = |room: usize, place: f64| ((place * (room + 1) as f64) as usize).min(room) as f64;
        let (x0, y0) = (corner(right, place[0]), corner(down, place[1]));
        let mut inside = LatticePoints::default();
        for (index, &[x, y]) in self.points.index.iter().zip(&self.points.centres) {
            let at = [x - x0, y - y0];
            if at[0] >= 0.0 && at[1] >= 0.0 && at[0] <= (width - 1) as f64 && at[1] <= (height - 1) as f64 {
                inside.index.push(*index);
                inside.centres.push(at);
            }
        }
        Ok(inside)
    }
}

#[cfg(test)]
mod tests {
    use lenslet_core::calibration::Lattice;

    use super::*;

    /// A camera with stretched rows and a displacement of its own for every lenslet.
    fn calibration() -> Calibration {
        let lattice = Lattice::hexagonal(10.0, 0.01, 1.02, [400.0, 300.0]);
        let own = |i: i32, j: i32| 0.2 * f64::from((7 * i + 13 * j).rem_euclid(5)) - 0.4;
        let mut calibration = Calibration::of_lattice(lattice, Size::new(800, 600));
        for l in &mut calibration.lenslets {
            l.x += own(l.i, l.j);
            l.y -= own(l.j, l.i);
        }
        calibration
    }

    #[test]
    fn a_window_shows_the_cameras_own_lenslets() {
        let calibration = calibration();
        let lattice = CameraLattice::of_calibration(&calibration, 400).unwrap();
        assert_eq!((lattice.size.width, lattice.size.height), (400, 300));
        for place in [[0.0, 0.0], [0.37, 0.81], [0.999_999, 0.999_999]] {
            let window = lattice.window(90, 70, place).unwrap();
            let corner = [(place[0] * 311.0) as i32, (place[1] * 231.0) as i32].map(f64::from);
            let mut expected = 0;
            for l in &calibration.lenslets {
                // Half the sensor's pixels a view pixel; pixel centres at integers.
                let at = [(l.x + 0.5) / 2.0 - 0.5 - corner[0], (l.y + 0.5) / 2.0 - 0.5 - corner[1]];
                if at[0] >= 0.0 && at[1] >= 0.0 && at[0] <= 89.0 && at[1] <= 69.0 {
                    expected += 1;
                    let k = window.index.iter().position(|k| *k == [l.i, l.j]).unwrap();
                    let [x, y] = window.centres[k];
                    assert!((x - at[0]).abs() < 1e-9 && (y - at[1]).abs() < 1e-9);
                }
            }
            assert_eq!(window.centres.len(), expected);
            assert!(expected > 250);
        }
        assert!(lattice.window(401, 10, [0.0; 2]).is_err());
    }

    #[test]
    fn a_name_is_equal_and_cannot_sample() {
        let lattice = CameraLattice::of_calibration(&calibration(), 400).unwrap();
        let name = CameraLattice::named(lattice.sha256().to_owned());
        assert!(name == lattice && !name.has_points() && name.window(10, 10, [0.0; 2]).is_err());
        let mut moved = calibration();
        moved.lenslets[7].x += 0.1;
        assert!(CameraLattice::of_calibration(&moved, 400).unwrap() != lattice);
        moved.lenslets.clear();
        assert!(CameraLattice::of_calibration(&moved, 400).is_err());
    }
}
