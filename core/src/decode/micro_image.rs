//! Which pixels belong to a micro-image: those nearer to its centre than to the centres of the lenslets around it.

use crate::calibration::Lattice;

/// From a lenslet's centre to those of the eight around it, sensor pixels.
pub(super) fn neighbour_offsets(lattice: &Lattice) -> Vec<[f64; 2]> {
    let mut found = Vec::new();
    for j in -1..=1 {
        for i in -1..=1 {
            if (i, j) != (0, 0) {
                let (i, j) = (f64::from(i), f64::from(j));
                found.push([i * lattice.a[0] + j * lattice.b[0], i * lattice.a[1] + j * lattice.b[1]]);
            }
        }
    }
    found
}

/// Whether an offset from a lenslet's centre is nearer to it than to the centres around it.
pub(super) fn is_within(lattice: &Lattice, d: [f64; 2]) -> bool {
    neighbour_offsets(lattice).iter().all(|n| d[0] * n[0] + d[1] * n[1] <= (n[0] * n[0] + n[1] * n[1]) / 2.0)
}
