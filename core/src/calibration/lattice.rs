//! Which lattice points lie on a sensor, and which of them is called (0, 0).

use super::model::Lattice;

/// The same lattice with (0, 0) at the lenslet nearest the sensor's centre.
pub fn centred(lattice: Lattice, width: usize, height: usize) -> Lattice {
    let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
    let [i, j] = lattice.coordinates(middle[0], middle[1]).map(f64::round);
    let mut best = lattice.origin;
    let mut least = f64::INFINITY;
    for di in -1..=1 {
        for dj in -1..=1 {
            let (i, j) = (i + f64::from(di), j + f64::from(dj));
            let c = [
                lattice.origin[0] + i * lattice.a[0] + j * lattice.b[0],
                lattice.origin[1] + i * lattice.a[1] + j * lattice.b[1],
            ];
            let distance = (c[0] - middle[0]).hypot(c[1] - middle[1]);
            if distance < least {
                (least, best) = (distance, c);
            }
        }
    }
    Lattice { origin: best, ..lattice }
}

/// Indices (i, j) of every lenslet whose predicted centre lies on the sensor or at most `margin` pixels outside, by (j,
/// i).
pub fn indices(lattice: &Lattice, width: usize, height: usize, margin: f64) -> Vec<[i32; 2]> {
    let (right, bottom) = (width as f64 - 1.0 + margin, height as f64 - 1.0 + margin);
    let corners = [[-margin, -margin], [right, -margin], [-margin, bottom], [right, bottom]];
    let coordinates = corners.map(|c| lattice.coordinates(c[0], c[1]));
    let bound = |k: usize| {
        let low = coordinates.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
        let high = coordinates.iter().map(|c| c[k]).fold(f64::NEG_INFINITY, f64::max);
        (low.floor() as i32 - 1, high.ceil() as i32 + 1)
    };
    let ((i0, i1), (j0, j1)) = (bound(0), bound(1));
    let mut all = Vec::new();
    for j in j0..=j1 {
        for i in i0..=i1 {
            let [x, y] = lattice.centre(i, j);
            if x >= -margin && x <= right && y >= -margin && y <= bottom {
                all.push([i, j]);
            }
        }
    }
    all
}
