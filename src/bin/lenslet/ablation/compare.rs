//! What changed between two runs: every cell of the tables that both have.

use std::fmt::Write as _;

use serde::Serialize;

use super::record::Record;
use super::table::{Table, score_named, tabulate};

/// A cell in both runs.
#[derive(Debug, Clone, Serialize)]
pub struct Change {
    /// Experiment.
    pub experiment: String,
    /// Row.
    pub variant: String,
    /// Scene or file.
    pub subject: String,
    /// Score.
    pub score: String,
    /// Mean before.
    pub old: f64,
    /// Mean now.
    pub new: f64,
    /// Whether the difference is larger than both spreads together.
    pub clear: bool,
    /// 1 better, −1 worse, 0 neither (or not clear).
    pub direction: i8,
}

/// Changes from `old` to `new`, seconds aside.
pub fn compare_runs(old: &[Record], new: &[Record]) -> Vec<Change> {
    let (old, new) = (tabulate(old), tabulate(new));
    let mut changes = Vec::new();
    for table in &new {
        let Some(before) = old.iter().find(|t| t.experiment == table.experiment) else { continue };
        for row in &table.rows {
            let Some(same) = before.rows.iter().find(|r| r.variant == row.variant && r.subject == row.subject) else {
                continue;
            };
            compare_rows(table, row, before, same, &mut changes);
        }
    }
    changes
}

fn compare_rows(
    table: &Table,
    row: &super::table::Row,
    before: &Table,
    same: &super::table::Row,
    changes: &mut Vec<Change>,
) {
    for (name, cell) in table.columns.iter().zip(&row.cells) {
        let at = before.columns.iter().position(|c| c == name);
        let (Some(a), Some(b)) = (at.and_then(|k| same.cells[k]), *cell) else { continue };
        if name.ends_with("seconds") || name == "failed" {
            continue;
        }
        let clear = (b.mean - a.mean).abs() > a.spread + b.spread && a.mean != b.mean;
        let better = score_named(name).map_or(0, |s| s.better);
        let direction = if clear { better * if b.mean > a.mean { 1 } else { -1 } } else { 0 };
        changes.push(Change {
            experiment: table.experiment.clone(),
            variant: row.variant.clone(),
            subject: row.subject.clone(),
            score: name.clone(),
            old: a.mean,
            new: b.mean,
            clear,
            direction,
        });
    }
}

/// In words: what differs, the clear changes marked.
pub fn describe_changes(changes: &[Change]) -> String {
    let mut out = String::new();
    let different: Vec<&Change> = changes.iter().filter(|c| c.old != c.new).collect();
    let _ = writeln!(out, "{} scores compared, {} differ", changes.len(), different.len());
    for c in different {
        let mark = match c.direction {
            1 => "better",
            -1 => "worse",
            _ => "within the spread",
        };
        let _ = writeln!(
            out,
            "{} / {} / {}: {} {:.4} -> {:.4} ({:+.4}, {mark})",
            c.experiment,
            c.variant,
            c.subject,
            c.score,
            c.old,
            c.new,
            c.new - c.old
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::record;
    use super::*;

    #[test]
    fn clear_changes_are_told_from_the_spread() {
        let old = [
            record("noise", "a", 1, Some(30.0)),
            record("noise", "a", 2, Some(30.2)),
            record("noise", "b", 1, Some(25.0)),
            record("noise", "gone", 1, Some(1.0)),
        ];
        let new = [
            record("noise", "a", 1, Some(31.0)),
            record("noise", "a", 2, Some(31.2)),
            record("noise", "b", 1, Some(25.0)),
            record("noise", "fresh", 1, Some(1.0)),
        ];
        let changes = compare_runs(&old, &new);
        // PSNR of colour and of luminance, of both rows that both runs have.
        assert_eq!(changes.len(), 4);
        assert!(changes[..2].iter().all(|c| c.clear && c.direction == 1) && changes[2..].iter().all(|c| !c.clear));
        assert!(describe_changes(&changes).contains("4 scores compared, 2 differ"));
        assert!(super::compare_runs(&new, &old)[0].direction == -1);
    }
}
