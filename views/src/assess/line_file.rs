//! Lines given by hand: a polyline a row of text.

use lenslet_core::ensure;

use crate::Error;

/// Longest list that is read, rows.
///
/// Source: chosen.
const MOST: usize = 10_000;

/// Reads polylines, one a row: `x y x y …`, two places or more, in pixels of the view; `#` begins a comment.
///
/// ```
/// use lenslet_views::assess::parse_lines;
/// let lines = parse_lines("# strings\n465 12 440 165 # the first\n507 12 490 200 468 480\n")?;
/// assert_eq!(lines[1], [[507.0, 12.0], [490.0, 200.0], [468.0, 480.0]]);
/// assert!(parse_lines("465 12 440").is_err());
/// # Ok::<(), lenslet_views::Error>(())
/// ```
///
/// # Errors
/// [`Error::Parameter`] naming the row that is no polyline; none at all, or more than 10000.
pub fn parse_lines(text: &str) -> Result<Vec<Vec<[f64; 2]>>, Error> {
    let mut lines = Vec::new();
    for (k, row) in text.lines().enumerate() {
        let row = row.split('#').next().unwrap_or_default();
        if row.trim().is_empty() {
            continue;
        }
        let number = |word: &str| word.parse().ok().filter(|x: &f64| x.abs() <= 1e5);
        let numbers: Option<Vec<f64>> =
            row.split([' ', '\t', ',', '\r']).filter(|w| !w.is_empty()).map(number).collect();
        let is_polyline = numbers.as_ref().is_some_and(|n| n.len() >= 4 && n.len() % 2 == 0);
        ensure!(
            Error::Parameter,
            is_polyline,
            "row {} is no line: `x y x y …`, pixels of the view, two places or more",
            k + 1
        );
        lines.extend(numbers.map(|n| n.chunks_exact(2).map(|p| [p[0], p[1]]).collect()));
        ensure!(Error::Parameter, lines.len() <= MOST, "more than {MOST} lines");
    }
    ensure!(Error::Parameter, !lines.is_empty(), "there are no lines in it");
    Ok(lines)
}
