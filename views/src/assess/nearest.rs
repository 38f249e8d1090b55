//! The nearest of many places.

use crate::buckets::Buckets;

/// Places, and where to look for the nearest.
pub(super) struct NearestPlace<'a> {
    places: &'a [[f64; 2]],
    cell: f64,
    buckets: Buckets<f64>,
}

impl<'a> NearestPlace<'a> {
    /// Cells of side `cell`; places at or right of and below 0.
    pub(super) fn new(places: &'a [[f64; 2]], cell: f64) -> NearestPlace<'a> {
        NearestPlace { places, cell, buckets: Buckets::new(places, cell) }
    }

    /// The nearest place within a cell's side of `at` and its distance.
    pub(super) fn find(&self, at: [f64; 2]) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for p in self.buckets.around(at, self.cell) {
            let place = self.places[p as usize];
            let distance = (place[0] - at[0]).hypot(place[1] - at[1]);
            if distance <= self.cell && best.is_none_or(|b| distance < b.1) {
                best = Some((p as usize, distance));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_that_of_all() {
        let places: Vec<[f64; 2]> =
            (0..500).map(|k| [f64::from(k * 37 % 101), f64::from(k * 53 % 89)].map(|x| 0.7 * x)).collect();
        let nearest = NearestPlace::new(&places, 5.0);
        for k in 0..200 {
            let at = [f64::from(k * 7 % 71) + 0.3, f64::from(k * 11 % 62) - 1.2];
            let plain = places.iter().map(|p| (p[0] - at[0]).hypot(p[1] - at[1])).fold(f64::INFINITY, f64::min);
            let found = nearest.find(at).map_or(f64::INFINITY, |f| f.1);
            assert!(found == plain || (plain > 5.0 && found == f64::INFINITY), "{at:?}: {found} {plain}");
        }
    }
}
