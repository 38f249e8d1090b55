//! How the views of a light field are numbered.

use std::fmt;
use std::str::FromStr;

use super::error::Error;

/// How views are numbered, against this project's order: row v from above, then column u from the left. That is the
/// default. Each field is one departure from it.
///
/// ```
/// use lenslet_core::lightfield::ViewOrder;
///
/// let order: ViewOrder = "columns,mirror-u".parse()?;
/// assert!(order.columns_first && order.mirror_u && !order.mirror_v);
/// assert_eq!((order.to_string(), ViewOrder::default().to_string()), ("columns,mirror-u".into(), "rows".into()));
/// // Ten rows of eight views, stored as eight columns of ten:
/// assert_eq!(order.stored_views([10, 8]), [8, 10]);
/// assert_eq!(order.stored_place([3, 0], [10, 8]), [7, 3]);
/// # Ok::<(), lenslet_core::lightfield::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ViewOrder {
    /// The first number is the column, the second the row.
    pub columns_first: bool,
    /// Rows are counted from below.
    pub mirror_v: bool,
    /// Columns are counted from the right.
    pub mirror_u: bool,
    /// The second number runs backwards wherever the first, counted from 0, is odd.
    pub serpentine: bool,
}

/// The words of an order.
const WORDS: [&str; 4] = ["columns", "mirror-v", "mirror-u", "serpentine"];

impl ViewOrder {
    /// Whether views are numbered in this project's order.
    #[must_use]
    pub fn is_own(self) -> bool {
        self == ViewOrder::default()
    }

    /// The stored grid of a light field of `views` (rows, columns).
    #[must_use]
    pub fn stored_views(self, [rows, columns]: [usize; 2]) -> [usize; 2] {
        if self.columns_first { [columns, rows] } else { [rows, columns] }
    }

    /// The two numbers, from 0, of the view in row v, column u of `views` (rows, columns).
    #[must_use]
    pub fn stored_place(self, [v, u]: [usize; 2], views: [usize; 2]) -> [usize; 2] {
        let reversed = |place: usize, count: usize, yes: bool| if yes { count - 1 - place } else { place };
        let (v, u) = (reversed(v, views[0], self.mirror_v), reversed(u, views[1], self.mirror_u));
        let [first, second] = if self.columns_first { [u, v] } else { [v, u] };
        let length = self.stored_views(views)[1];
        [first, reversed(second, length, self.serpentine && first % 2 == 1)]
    }

    fn has(self) -> [bool; 4] {
        [self.columns_first, self.mirror_v, self.mirror_u, self.serpentine]
    }
}

impl FromStr for ViewOrder {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let mut order = ViewOrder::default();
        for word in text.split(',').map(str::trim) {
            match word {
                "rows" => {}
                "columns" => order.columns_first = true,
                "mirror-v" => order.mirror_v = true,
                "mirror-u" => order.mirror_u = true,
                "serpentine" => order.serpentine = true,
                _ => {
                    let words = WORDS.join(", ");
                    return Err(Error::Parameter(format!(
                        "`{word}` is no order of views: rows, or of {words} those that hold, joined by commas"
                    )));
                }
            }
        }
        Ok(order)
    }
}

impl fmt::Display for ViewOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<&str> =
            WORDS.into_iter().zip(self.has()).filter(|(_, yes)| *yes).map(|(word, _)| word).collect();
        f.write_str(&if words.is_empty() { "rows".to_string() } else { words.join(",") })
    }
}

/// The order in which a light field is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadOrder {
    /// How its views are numbered.
    pub order: ViewOrder,
    /// Found by the parallax of the pictures: the share, 0..1, of the evidence that agrees. `None` where it was stated.
    pub agreement: Option<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_names_each_view_once_and_reads_back_as_written() {
        for k in 0..16 {
            let order =
                ViewOrder { columns_first: k & 1 > 0, mirror_v: k & 2 > 0, mirror_u: k & 4 > 0, serpentine: k & 8 > 0 };
            assert_eq!(order.to_string().parse::<ViewOrder>().unwrap(), order);
            let [rows, columns] = order.stored_views([3, 4]);
            let mut seen = [false; 12];
            for v in 0..3 {
                for u in 0..4 {
                    let [a, b] = order.stored_place([v, u], [3, 4]);
                    assert!(a < rows && b < columns);
                    assert!(!std::mem::replace(&mut seen[a * columns + b], true), "{order} {v} {u}");
                }
            }
        }
        let snake = ViewOrder { columns_first: true, serpentine: true, ..ViewOrder::default() };
        // Down the first column, up the second.
        assert_eq!([[0, 1], [2, 1], [0, 2]].map(|at| snake.stored_place(at, [3, 3])), [[1, 2], [1, 0], [2, 0]]);
        assert!("row".parse::<ViewOrder>().is_err() && "".parse::<ViewOrder>().is_err());
    }
}
