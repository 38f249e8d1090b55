//! Points sorted into square cells, to find those near a place.

use ndarray::NdFloat;

/// Cells along an axis at most.
///
/// Source: chosen for the memory they take.
const MOST_CELLS: usize = 1 << 15;

/// Points sorted into square cells; those left of and above 0 lie in the first, those beyond the last in that.
pub(crate) struct Buckets<T> {
    side: T,
    columns: usize,
    rows: usize,
    /// Where each cell's points begin in `order`.
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl<T: NdFloat> Buckets<T> {
    /// Of `points` (x, y), in cells of this `side`, above 0.
    pub(crate) fn new(points: &[[T; 2]], side: T) -> Self {
        let far = |axis: usize| points.iter().fold(T::zero(), |most, p| most.max(p[axis]));
        let cells = |axis: usize| (far(axis) / side).to_usize().map_or(MOST_CELLS, |k| k.min(MOST_CELLS)) + 1;
        let (columns, rows) = (cells(0), cells(1));
        let mut out = Buckets { side, columns, rows, starts: vec![0; columns * rows + 1], order: Vec::new() };
        let cell_of = |p: &[T; 2]| out.cell(p[1], rows) * columns + out.cell(p[0], columns);
        let cell_of: Vec<usize> = points.iter().map(cell_of).collect();
        cell_of.iter().for_each(|&cell| out.starts[cell + 1] += 1);
        (0..columns * rows).for_each(|k| out.starts[k + 1] += out.starts[k]);
        let mut next = out.starts.clone();
        out.order = vec![0; points.len()];
        for (k, &cell) in cell_of.iter().enumerate() {
            out.order[next[cell] as usize] = k as u32;
            next[cell] += 1;
        }
        out
    }

    fn cell(&self, x: T, cells: usize) -> usize {
        (x / self.side).max(T::zero()).to_usize().map_or(cells - 1, |k| k.min(cells - 1))
    }

    /// The points of all cells that the square about `place`, `reach` each way, touches, row by row of cells, in their order.
    pub(crate) fn around(&self, place: [T; 2], reach: T) -> impl Iterator<Item = u32> + '_ {
        let touched = |x: T, cells: usize| self.cell(x - reach, cells)..=self.cell(x + reach, cells);
        let columns = touched(place[0], self.columns);
        touched(place[1], self.rows).flat_map(move |row| {
            let (first, last) = (row * self.columns + columns.start(), row * self.columns + columns.end());
            self.order[self.starts[first] as usize..self.starts[last + 1] as usize].iter().copied()
        })
    }
}
