//! Dots with whiskers as SVG: a row a variant, a colour a subject.

use std::fmt::Write as _;

use super::table::{Table, score_named};
use lenslet::page::escape_html;

const ROW: f64 = 22.0;
const WIDTH: f64 = 520.0;
const RIGHT: f64 = 20.0;

/// One score of a table; nothing where fewer than two rows have it.
pub(super) fn dots(table: &Table, name: &str) -> Option<String> {
    let column = table.columns.iter().position(|c| c == name)?;
    let mut variants: Vec<&str> = Vec::new();
    let mut subjects: Vec<&str> = Vec::new();
    for row in table.rows.iter().filter(|r| r.cells[column].is_some()) {
        if !variants.contains(&row.variant.as_str()) {
            variants.push(&row.variant);
        }
        if !subjects.contains(&row.subject.as_str()) {
            subjects.push(&row.subject);
        }
    }
    if variants.len() < 2 {
        return None;
    }
    let cells = || table.rows.iter().filter_map(|r| r.cells[column]);
    let low = cells().map(|c| c.mean - c.spread).fold(f64::INFINITY, f64::min);
    let high = cells().map(|c| c.mean + c.spread).fold(f64::NEG_INFINITY, f64::max);
    let step = tick(high - low);
    let (from, to) =
        ((low / step).floor() * step, ((high / step).ceil() * step).max((low / step).floor() * step + step));
    // Room for the longest name, in letters large enough for a small screen.
    let longest = variants.iter().map(|v| v.chars().count()).max().unwrap_or(0);
    let left = (24.0 + 8.6 * longest as f64).min(0.5 * WIDTH);
    let x = |value: f64| left + (value - from) / (to - from) * (WIDTH - left - RIGHT);
    let bottom = 8.0 + ROW * variants.len() as f64;
    let heading = score_named(name).map_or(name, |s| s.heading);

    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" viewBox=\"0 0 {WIDTH} {:.0}\" aria-label=\"{} of {}\">",
        bottom + 40.0,
        escape_html(heading),
        escape_html(&table.experiment)
    );
    let digits = if step >= 1.0 { 0 } else { (-step.log10()).ceil().clamp(0.0, 4.0) as usize };
    let mut k = 0;
    while k <= 12 && from + f64::from(k) * step <= to + 0.01 * step {
        let value = from + f64::from(k) * step;
        let _ = write!(
            svg,
            "<path class=\"grid-line\" d=\"M{0:.1} 4V{bottom:.0}\"/><text x=\"{0:.1}\" y=\"{1:.0}\" text-anchor=\"middle\">{value:.digits$}</text>",
            x(value),
            bottom + 15.0
        );
        k += 1;
    }
    for (i, variant) in variants.iter().enumerate() {
        let y = 4.0 + ROW * (i as f64 + 0.5);
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 10.0,
            y + 4.0,
            escape_html(variant)
        );
        for row in table.rows.iter().filter(|r| r.variant == *variant) {
            let Some(cell) = row.cells[column] else { continue };
            let subject = subjects.iter().position(|s| *s == row.subject).unwrap_or(0);
            // Subjects side by side within a row, so that none hides another.
            let y = y + (subject as f64 - (subjects.len() as f64 - 1.0) / 2.0) * (12.0 / subjects.len() as f64);
            let _ = write!(
                svg,
                "<g class=\"s{}\"><path class=\"curve\" d=\"M{:.1} {y:.1}H{:.1}\"/><circle class=\"dot\" cx=\"{:.1}\" cy=\"{y:.1}\" r=\"3.5\"/></g>",
                subject % 6,
                x(cell.mean - cell.spread),
                x(cell.mean + cell.spread),
                x(cell.mean)
            );
        }
    }
    let mut at = left;
    for (i, subject) in subjects.iter().enumerate() {
        let _ = write!(
            svg,
            "<g class=\"s{}\"><circle class=\"dot\" cx=\"{at:.0}\" cy=\"{:.0}\" r=\"3.5\"/></g><text x=\"{:.0}\" y=\"{:.0}\">{}</text>",
            i % 6,
            bottom + 30.0,
            at + 8.0,
            bottom + 34.0,
            escape_html(subject)
        );
        at += 26.0 + 9.0 * subject.chars().count() as f64;
    }
    svg.push_str("</svg>");
    Some(svg)
}

/// A round step that divides the range into 1.5 to 4 parts.
fn tick(range: f64) -> f64 {
    if !(range.is_finite() && range > 1e-9) {
        return 1.0;
    }
    let raw = range / 4.0;
    let power = 10f64.powf(raw.log10().floor());
    let part = raw / power;
    power
        * if part <= 1.0 {
            1.0
        } else if part <= 2.0 {
            2.0
        } else if part <= 5.0 {
            5.0
        } else {
            10.0
        }
}

#[cfg(test)]
mod tests {
    use super::super::table::{tabulate, tests::record};
    use super::*;

    #[test]
    fn a_dot_for_every_cell_and_names_escaped() {
        let records = [
            record("noise", "<b>", 1, Some(30.0)),
            record("noise", "c", 1, Some(31.0)),
            record("noise", "d", 1, Some(31.0)),
        ];
        let svg = dots(&tabulate(&records)[0], "psnr").unwrap();
        // One circle a cell, one in the legend.
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(svg.contains("&lt;b&gt;") && !svg.contains("<b>") && !svg.contains("NaN"));
        assert!(dots(&tabulate(&records[..1])[0], "psnr").is_none());
        for range in [0.0, 1e-3, 0.7, 5.0, 123.0, f64::NAN] {
            let parts = if range > 0.0 { range / tick(range) } else { 3.0 };
            assert!((1.5..=4.0).contains(&parts), "{range} {parts}");
        }
    }
}
