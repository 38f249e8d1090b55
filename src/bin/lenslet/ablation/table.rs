//! Tables made of records: a row a variant and subject, a column a score, each cell mean and spread over seeds.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use super::experiment::Experiment;
use super::record::Record;

/// A score that tables show.
#[derive(Debug, Clone, Copy)]
pub struct Score {
    /// Name in records.
    pub name: &'static str,
    /// Heading.
    pub heading: &'static str,
    /// What it is, for the legend.
    pub meaning: &'static str,
    /// Digits after the point.
    pub digits: usize,
    /// 1: more is better, −1: less is better, 0: neither.
    pub better: i8,
}

/// All scores, in the order of columns.
pub const SCORES: [Score; 28] = [
    score("psnr", "PSNR dB", "colour, middle view, sRGB-encoded, 12 px border left out", 2, 1),
    score("psnr_y", "PSNR Y dB", "luminance, middle view, sRGB-encoded, 12 px border left out", 2, 1),
    score(
        "ssim",
        "SSIM",
        "luminance, Gaussian window 11x11, σ 1.5 (scikit-image: gaussian_weights=True, sigma=1.5, use_sample_covariance=False)",
        4,
        1,
    ),
    score("psnr_outer", "outer dB", "PSNR, mean of a view at the rim and a corner view", 2, 1),
    score(
        "consistency",
        "agreement dB",
        "PSNR between the middle view and an outer one moved onto it by the true disparity",
        2,
        1,
    ),
    score("mtf50", "MTF50 lp/lenslet", "slanted edge (ISO 12233), line pairs a lenslet pitch, linear light", 3, 1),
    score("mtf50_truth", "of truth", "MTF50 of the truth itself", 3, 0),
    score("jaggedness", "jagged px", "RMS distance of an edge's rows from the straight line, output pixels", 3, -1),
    score(
        "line_contrast",
        "lines",
        "contrast of line pairs as a share of the truth's, mean over 0.12 to 0.6 pairs a lenslet",
        3,
        1,
    ),
    score(
        "spurious",
        "spurious",
        "what line pairs show that is not there, as a share of the truth's contrast (aliasing)",
        3,
        -1,
    ),
    score(
        "rays_psnr",
        "rays dB",
        "real captures: samples of other views between the view's own (docs/assessing.md)",
        2,
        1,
    ),
    score("rays_over", "over barycentric dB", "the same over the barycentric view", 2, 1),
    score("rays_over_error", "±", "its standard error", 2, 0),
    score(
        "edges_mtf50",
        "edges MTF50 c/px",
        "real captures: edges of the scene, median; only beside their roughness",
        3,
        0,
    ),
    score("edges_rough", "edges rough px", "RMS distance of these edges from smooth curves, median", 3, 0),
    score(
        "lines_rough",
        "lines rough px",
        "real captures: RMS distance of thin lines from straight ones, median",
        3,
        -1,
    ),
    score("lines_width", "lines width px", "full width at half maximum of these lines, median", 2, 0),
    score(
        "holes_psnr",
        "holes dB",
        "lenslets hidden and filled by their neighbours' mean; biased, judges nothing",
        2,
        0,
    ),
    score("raw_over", "raw dB", "real captures: raw pixels foretold, over the full calibration", 2, 1),
    score("raw_over_error", "±", "its standard error", 2, 0),
    score("raw_rms", "raw RMS", "the error of these raw pixels, digital numbers", 2, -1),
    score("centres_rms", "centres px", "RMS distance of lenslet centres from the truth, sensor pixels", 4, -1),
    score("align_px", "moved px", "how far the alignment moves the middle of the picture, pixels of the truth", 2, 0),
    score("align_scale", "scaled", "how much larger the alignment makes it than the same field of view would", 4, 0),
    score("align_gain", "gain", "what the alignment multiplies values by, mean of the channels, sRGB-encoded", 3, 0),
    score("train_seconds", "training s", "seconds the dictionary took", 1, -1),
    score(
        "step_seconds",
        "render s",
        "seconds to render the views that are scored (three; one of a real capture)",
        2,
        -1,
    ),
    score("failed", "failed", "runs without a score", 0, 0),
];

const fn score(name: &'static str, heading: &'static str, meaning: &'static str, digits: usize, better: i8) -> Score {
    Score { name, heading, meaning, digits, better }
}

/// Mean over seeds and its spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cell {
    /// Mean.
    pub mean: f64,
    /// Standard deviation over seeds (n − 1), 0 for one.
    pub spread: f64,
    /// Number of seeds.
    pub n: usize,
}

/// A variant on a subject.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Variant.
    pub variant: String,
    /// Scene or file.
    pub subject: String,
    /// A cell a column of the table, none where the score does not exist.
    pub cells: Vec<Option<Cell>>,
    /// Line pairs of the chart: pairs a lenslet, contrast as a share of the truth's, what is not there; means over
    /// seeds.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<[f64; 3]>,
    /// Pictures of the first seed, by what they show.
    #[serde(skip_serializing_if = "std::collections::BTreeMap::is_empty")]
    pub pictures: std::collections::BTreeMap<String, String>,
}

/// An experiment's table.
#[derive(Debug, Clone, Serialize)]
pub struct Table {
    /// Experiment.
    pub experiment: String,
    /// Its question.
    pub question: String,
    /// Names of the scores.
    pub columns: Vec<String>,
    /// Rows in the plan's order.
    pub rows: Vec<Row>,
    /// The reasons of failed runs, each once.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<String>,
}

/// Mean and spread of values; none of an empty list.
pub fn summarise(values: &[f64]) -> Option<Cell> {
    let n = values.len();
    if n == 0 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    Some(Cell { mean, spread: if n > 1 { (squares / (n - 1) as f64).sqrt() } else { 0.0 }, n })
}

/// Turns records, in the plan's order, into a table an experiment.
pub fn tabulate(records: &[Record]) -> Vec<Table> {
    let experiments = Experiment::ALL.into_iter();
    experiments
        .filter_map(|e| table(e, &records.iter().filter(|r| r.experiment == e.name()).collect::<Vec<_>>()))
        .collect()
}

fn table(experiment: Experiment, records: &[&Record]) -> Option<Table> {
    let mut rows: Vec<(String, String, Vec<&Record>)> = Vec::new();
    for record in records {
        match rows.iter_mut().find(|(v, s, _)| *v == record.variant && *s == record.subject) {
            Some(row) => row.2.push(record),
            None => rows.push((record.variant.clone(), record.subject.clone(), vec![record])),
        }
    }
    if rows.is_empty() {
        return None;
    }
    let value = |record: &Record, name: &str| match name {
        // Peers' files were rendered elsewhere.
        "step_seconds" => (record.failed.is_none() && record.step_seconds > 0.0).then_some(record.step_seconds),
        _ => record.scores.get(name).copied(),
    };
    let of = |row: &[&Record], name: &str| -> Option<Cell> {
        if name == "failed" {
            let failed = row.iter().filter(|r| r.failed.is_some()).count();
            return (failed > 0).then_some(Cell { mean: failed as f64, spread: 0.0, n: row.len() });
        }
        summarise(&row.iter().filter_map(|r| value(r, name)).collect::<Vec<_>>())
    };
    let columns: Vec<&Score> =
        SCORES.iter().filter(|s| rows.iter().any(|(_, _, records)| of(records, s.name).is_some())).collect();
    let mut failures: Vec<String> = records.iter().filter_map(|r| r.failed.clone()).collect();
    failures.sort();
    failures.dedup();
    Some(Table {
        experiment: experiment.name().to_owned(),
        question: match experiment {
            Experiment::Peers => experiment.question().to_owned(),
            _ => format!("{} Simulated captures: against {}.", experiment.question(), experiment.truth().name()),
        },
        columns: columns.iter().map(|s| s.name.to_owned()).collect(),
        rows: rows
            .into_iter()
            .map(|(variant, subject, records)| Row {
                variant,
                subject,
                cells: columns.iter().map(|s| of(&records, s.name)).collect(),
                lines: lines(&records),
                pictures: records
                    .iter()
                    .find(|r| !r.pictures.is_empty())
                    .map(|r| r.pictures.clone())
                    .unwrap_or_default(),
            })
            .collect(),
        failures,
    })
}

/// The scores of the line pairs, which records name `line_contrast_0.40` and `spurious_0.40`, by rising frequency.
fn lines(records: &[&Record]) -> Vec<[f64; 3]> {
    let mut by_name: BTreeMap<&str, [Vec<f64>; 2]> = BTreeMap::new();
    for (name, &value) in records.iter().flat_map(|r| &r.scores) {
        for (k, what) in ["line_contrast_", "spurious_"].iter().enumerate() {
            if let Some(frequency) = name.strip_prefix(what) {
                by_name.entry(frequency).or_default()[k].push(value);
            }
        }
    }
    let point = |(name, [contrast, spurious]): (&str, [Vec<f64>; 2])| {
        Some([name.parse().ok()?, summarise(&contrast)?.mean, summarise(&spurious)?.mean])
    };
    let mut points: Vec<[f64; 3]> = by_name.into_iter().filter_map(point).collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    points
}

/// A table's parts, one a subject: its name, and its rows with the columns that have a value in one of them.
pub fn split_by_subject(table: &Table) -> Vec<(String, Table)> {
    let mut subjects: Vec<&str> = Vec::new();
    for row in &table.rows {
        if !subjects.contains(&row.subject.as_str()) {
            subjects.push(&row.subject);
        }
    }
    let part = |subject: &str| {
        let rows: Vec<&Row> = table.rows.iter().filter(|r| r.subject == subject).collect();
        let kept: Vec<usize> =
            (0..table.columns.len()).filter(|&c| rows.iter().any(|r| r.cells[c].is_some())).collect();
        let short = |row: &&Row| Row { cells: kept.iter().map(|&c| row.cells[c]).collect(), ..(*row).clone() };
        Table {
            columns: kept.iter().map(|&c| table.columns[c].clone()).collect(),
            rows: rows.iter().map(short).collect(),
            failures: Vec::new(),
            ..table.clone()
        }
    };
    subjects.into_iter().map(|subject| (subject.to_owned(), part(subject))).collect()
}

/// The score of that name.
pub fn score_named(name: &str) -> Option<&'static Score> {
    SCORES.iter().find(|s| s.name == name)
}

/// A cell in words: `27.31 ± 0.12`, or `27.31` from one seed.
pub fn format_cell(cell: &Cell, digits: usize) -> String {
    if cell.n > 1 {
        format!("{:.digits$} ± {:.digits$}", cell.mean, cell.spread)
    } else {
        format!("{:.digits$}", cell.mean)
    }
}

/// Whether a row's cell is the best of its subject in this column.
pub fn is_best(table: &Table, row: usize, column: usize) -> bool {
    let better = table.columns.get(column).and_then(|c| score_named(c)).map_or(0, |s| s.better);
    let Some(own) = table.rows[row].cells[column] else { return false };
    let others = || table.rows.iter().filter(|r| r.subject == table.rows[row].subject).filter_map(|r| r.cells[column]);
    // Rows that differ in the capture's noise, not in what is done with it, do not compete.
    let margin = |o: Cell| f64::from(better) * (own.mean - o.mean);
    table.experiment != "noise" && others().all(|o| margin(o) >= 0.0) && others().any(|o| margin(o) > 0.0)
}

/// All tables as CSV: a line a cell.
pub fn tables_to_csv(tables: &[Table]) -> String {
    let mut out = String::from("experiment,variant,subject,score,mean,spread,seeds\n");
    // A spreadsheet computes what begins like a formula.
    let formula = |text: &str| text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let quoted = |text: &str| format!("\"{}{}\"", if formula(text) { "'" } else { "" }, text.replace('"', "\"\""));
    for table in tables {
        for row in &table.rows {
            for (name, cell) in table.columns.iter().zip(&row.cells) {
                if let Some(c) = cell {
                    let (variant, subject) = (quoted(&row.variant), quoted(&row.subject));
                    let _ = writeln!(
                        out,
                        "{},{variant},{subject},{name},{},{},{}",
                        table.experiment, c.mean, c.spread, c.n
                    );
                }
            }
        }
    }
    out
}

/// All tables as Markdown; the best of each subject in bold.
pub fn tables_to_markdown(tables: &[Table]) -> String {
    let mut out = String::new();
    let safe = |text: &str| {
        let text =
            ['|', '`', '[', '*'].iter().fold(text.replace('\\', "\\\\"), |t, c| t.replace(*c, &format!("\\{c}")));
        text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace(['\n', '\r'], " ")
    };
    for table in tables {
        let _ = writeln!(out, "### {}\n\n{}\n", table.experiment, table.question);
        for (subject, part) in split_by_subject(table) {
            let headings: Vec<&str> = part.columns.iter().filter_map(|c| score_named(c)).map(|s| s.heading).collect();
            let _ = writeln!(out, "| {} | {} |", safe(&subject), headings.join(" | "));
            let _ = writeln!(out, "|---|{}", "--:|".repeat(headings.len()));
            for (r, row) in part.rows.iter().enumerate() {
                let _ = write!(out, "| {} |", safe(&row.variant));
                for (c, cell) in row.cells.iter().enumerate() {
                    let digits = score_named(&part.columns[c]).map_or(3, |s| s.digits);
                    let text = cell.as_ref().map(|c| format_cell(c, digits)).unwrap_or_default();
                    let _ = if is_best(&part, r, c) { write!(out, " **{text}** |") } else { write!(out, " {text} |") };
                }
                out.push('\n');
            }
            out.push('\n');
        }
        for failure in &table.failures {
            let _ = writeln!(out, "Not scored: {}\n", safe(failure));
        }
    }
    out
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use serde_json::json;

    pub(crate) fn record(experiment: &str, variant: &str, seed: u64, psnr: Option<f64>) -> Record {
        Record {
            key: format!("{experiment}{variant}{seed}"),
            experiment: experiment.into(),
            variant: variant.into(),
            subject: "natural".into(),
            seed,
            parameters: json!({}),
            scores: ["psnr", "psnr_y"].into_iter().filter_map(|name| Some((name.to_owned(), psnr?))).collect(),
            failed: psnr.is_none().then(|| "broke | badly".to_owned()),
            step_seconds: 1.5,
            seconds: 2.0,
            version: "0".into(),
            hashes: Default::default(),
            pictures: Default::default(),
            notes: None,
        }
    }

    #[test]
    fn names_are_neither_formulas_nor_markup() {
        let records = [
            record("demosaic", "=HYPERLINK(\"x\")", 1, Some(30.0)),
            record("demosaic", "@SUM(1)", 1, Some(30.0)),
            record("demosaic", "<img src=x> [a](b) `c`", 1, Some(30.0)),
        ];
        let tables = tabulate(&records);
        let csv = tables_to_csv(&tables);
        assert!(csv.contains("\"'=HYPERLINK(\"\"x\"\")\"") && csv.contains("\"'@SUM(1)\""), "{csv}");
        let markdown = tables_to_markdown(&tables);
        assert!(markdown.contains("&lt;img src=x&gt; \\[a](b) \\`c\\`"), "{markdown}");
    }

    #[test]
    fn means_spreads_and_the_best() {
        let records = [
            record("demosaic", "a", 1, Some(30.0)),
            record("demosaic", "a", 2, Some(32.0)),
            record("demosaic", "b, \"c\"", 1, Some(29.0)),
            record("demosaic", "b, \"c\"", 2, None),
            record("views", "3x3", 1, Some(20.0)),
        ];
        let tables = tabulate(&records);
        assert_eq!(tables.iter().map(|t| t.experiment.as_str()).collect::<Vec<_>>(), ["demosaic", "views"]);
        assert_eq!(tables[0].columns, ["psnr", "psnr_y", "step_seconds", "failed"]);
        let first = tables[0].rows[0].cells[0].unwrap();
        assert_eq!((first.mean, first.n), (31.0, 2));
        assert!((first.spread - 2f64.sqrt()).abs() < 1e-12);
        assert!(is_best(&tables[0], 0, 0) && !is_best(&tables[0], 1, 0) && !is_best(&tables[1], 0, 0));
        let csv = tables_to_csv(&tables);
        assert!(csv.contains("demosaic,\"a\",\"natural\",psnr,31,") && csv.contains("\"b, \"\"c\"\"\""));
        let markdown = tables_to_markdown(&tables);
        assert!(markdown.contains("**31.00 ± 1.41**") && markdown.contains("Not scored: broke \\| badly"));
    }
}
