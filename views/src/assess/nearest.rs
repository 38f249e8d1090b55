//! The nearest of many places.

/// Places sorted into square cells.
pub(super) struct NearestPlace<'a> {
    places: &'a [[f64; 2]],
    cell: f64,
    columns: usize,
    rows: usize,
    /// Where each cell's places begin in `order`.
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl<'a> NearestPlace<'a> {
    /// Cells of side `cell`; places at or right of and below 0.
    pub(super) fn new(places: &'a [[f64; 2]], cell: f64) -> NearestPlace<'a> {
        let side = |axis: usize| {
            let most = places.iter().map(|p| p[axis]).fold(0.0, f64::max);
            (most / cell) as usize + 1
        };
        let (columns, rows) = (side(0), side(1));
        let cell_of = |p: &[f64; 2]| {
            let at = |x: f64, n: usize| ((x / cell).max(0.0) as usize).min(n - 1);
            at(p[1], rows) * columns + at(p[0], columns)
        };
        let mut starts = vec![0u32; columns * rows + 1];
        places.iter().for_each(|p| starts[cell_of(p) + 1] += 1);
        (0..columns * rows).for_each(|k| starts[k + 1] += starts[k]);
        let mut next = starts.clone();
        let mut order = vec![0u32; places.len()];
        for (k, p) in places.iter().enumerate() {
            let slot = &mut next[cell_of(p)];
            order[*slot as usize] = k as u32;
            *slot += 1;
        }
        NearestPlace { places, cell, columns, rows, starts, order }
    }

    /// The nearest place within a cell's side of `at` and its distance.
    pub(super) fn find(&self, at: [f64; 2]) -> Option<(usize, f64)> {
        let range = |x: f64, n: usize| {
            let k = (x / self.cell).floor();
            let inside = |k: f64| k.clamp(0.0, (n - 1) as f64) as usize;
            inside(k - 1.0)..=inside(k + 1.0)
        };
        let mut best: Option<(usize, f64)> = None;
        for row in range(at[1], self.rows) {
            for column in range(at[0], self.columns) {
                let k = row * self.columns + column;
                for &p in &self.order[self.starts[k] as usize..self.starts[k + 1] as usize] {
                    let place = self.places[p as usize];
                    let distance = (place[0] - at[0]).hypot(place[1] - at[1]);
                    if distance <= self.cell && best.is_none_or(|b| distance < b.1) {
                        best = Some((p as usize, distance));
                    }
                }
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
