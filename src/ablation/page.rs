//! `report.html`, made of the tables: what was asked, the orderings, plots, the numbers, the same crop of every variant.

use std::path::{Component, Path};

use anyhow::Result;
use lenslet_core::output;

use super::check::Verdict;
use super::table::{Row, SCORES, Table, best, of_name, words};
use super::{picture, plot};
use crate::report::plot::{Series, curves};
use crate::report::{self, Page, Picture, Stage};

/// Scores that are plotted where an experiment has them.
const PLOTTED: [&str; 7] = ["psnr", "psnr_outer", "ssim", "hidden_psnr", "mtf50", "spurious", "consistency"];
/// Largest picture embedded, bytes.
const MAX_PICTURE: u64 = 4 << 20;

/// Writes the page of the tables. `about`: lines on how it was made (command, machine, date).
///
/// # Errors
/// When it cannot be written. Pictures that are gone are left out.
pub fn write(out: &Path, tables: &[Table], verdicts: &[Verdict], about: &[String]) -> Result<()> {
    let mut page = Page::new("What each step gives", &about.join("; "));
    if !verdicts.is_empty() {
        page.heading("Orderings");
        page.paragraph("Whether what should score more does: mean and spread over seeds of the paired differences.");
        page.table(&orderings(verdicts));
    }
    for table in tables {
        section(&mut page, out, table);
    }
    page.heading("Scores");
    let shown = SCORES.iter().filter(|s| tables.iter().any(|t| t.columns.iter().any(|c| c == s.name)));
    let rows = shown.map(|s| vec![s.heading.to_owned(), s.meaning.to_owned()]).collect();
    page.table(&report::Table {
        caption: "What the columns are".into(),
        head: vec!["score".into(), String::new()],
        rows,
        best: Vec::new(),
    });
    output::write_file(&out.join("report.html"), true, page.finish().as_bytes())?;
    Ok(())
}

fn orderings(verdicts: &[Verdict]) -> report::Table {
    let row = |v: &Verdict| {
        let verdict = if v.holds { "holds" } else { "does not hold" };
        vec![
            v.experiment.clone(),
            v.subject.clone(),
            v.better.clone(),
            v.worse.clone(),
            words(&v.margin, 2),
            verdict.into(),
        ]
    };
    report::Table {
        caption: "PSNR of the middle view, or of hidden lenslets".into(),
        head: ["experiment", "subject", "this", "over this", "margin dB", ""].map(String::from).to_vec(),
        rows: verdicts.iter().map(row).collect(),
        best: Vec::new(),
    }
}

fn section(page: &mut Page, out: &Path, table: &Table) {
    page.heading(&table.experiment);
    page.paragraph(&table.question);
    for name in PLOTTED {
        if let Some(svg) = plot::dots(table, name) {
            let caption = of_name(name).map_or(name.to_owned(), |s| format!("{}: {}", s.heading, s.meaning));
            page.drawing(&svg, &caption);
        }
    }
    if let Some(svg) = against_time(table) {
        page.drawing(
            &svg,
            "PSNR of the middle view over the seconds the dictionary took to train, each point a variant.",
        );
    }
    let mut shown =
        report::Table { caption: "Mean ± standard deviation over seeds".into(), ..report::Table::default() };
    shown.head = ["variant", "subject"].map(String::from).to_vec();
    shown.head.extend(table.columns.iter().filter_map(|c| of_name(c)).map(|s| s.heading.to_owned()));
    for (r, row) in table.rows.iter().enumerate() {
        let mut cells = vec![row.variant.clone(), row.subject.clone()];
        for (c, cell) in row.cells.iter().enumerate() {
            let digits = of_name(&table.columns[c]).map_or(3, |s| s.digits);
            cells.push(cell.as_ref().map(|c| words(c, digits)).unwrap_or_default());
            if best(table, r, c) {
                shown.best.push((r, c + 2));
            }
        }
        shown.rows.push(cells);
    }
    page.table(&shown);
    for failure in &table.failures {
        page.paragraph(&format!("Not scored: {failure}"));
    }
    let mut subjects: Vec<&str> = Vec::new();
    for row in table.rows.iter().filter(|r| !r.pictures.is_empty()) {
        if !subjects.contains(&row.subject.as_str()) {
            subjects.push(&row.subject);
        }
    }
    for subject in subjects {
        let rows: Vec<&Row> = table.rows.iter().filter(|r| r.subject == subject && !r.pictures.is_empty()).collect();
        pictures(page, out, subject, &rows);
    }
}

/// What training time buys: PSNR over seconds, a point a variant, on the first subject.
fn against_time(table: &Table) -> Option<String> {
    let column = |name: &str| table.columns.iter().position(|c| c == name);
    let (x, y) = (column("train_seconds")?, column("psnr")?);
    let subject = &table.rows.first()?.subject;
    let series: Vec<Series> = table
        .rows
        .iter()
        .filter(|r| r.subject == *subject)
        .filter_map(|r| Some((r, r.cells[x]?, r.cells[y]?)))
        .map(|(r, x, y)| Series { name: r.variant.clone(), points: vec![[x.mean, y.mean]] })
        .collect();
    (series.len() > 1).then(|| curves("training, seconds", "PSNR, dB", &series))
}

/// A slider between any two variants and the truth, then every difference from the truth.
fn pictures(page: &mut Page, out: &Path, subject: &str, rows: &[&Row]) {
    let stage =
        |row: &Row, what: &str, name: &str| Some(Stage { name: name.to_owned(), picture: embedded(out, row, what)? });
    let mut stages: Vec<Stage> = rows.iter().filter_map(|r| stage(r, "crop", &r.variant)).collect();
    stages.extend(rows.first().and_then(|r| stage(r, "truth", "truth")));
    if stages.len() > 1 {
        page.compare(subject, &stages, [0.5, 0.5]);
    }
    let differences: Vec<(Picture, String)> =
        rows.iter().filter_map(|r| Some((embedded(out, r, "difference")?, r.variant.clone()))).collect();
    if !differences.is_empty() {
        page.paragraph(&format!(
            "{subject}: differences from the truth, {} times; blue is darker, red brighter than it.",
            picture::GAIN
        ));
        page.figures(&differences);
    }
}

/// A picture of a row; none if it is gone or names a place outside of the folder.
fn embedded(out: &Path, row: &Row, what: &str) -> Option<Picture> {
    let name = row.pictures.get(what)?;
    let inside = Path::new(name).components().all(|c| matches!(c, Component::Normal(_)));
    let path = out.join(name);
    if !inside || std::fs::metadata(&path).ok()?.len() > MAX_PICTURE {
        return None;
    }
    let bytes = std::fs::read(path).ok()?;
    let (width, height) =
        image::ImageReader::new(std::io::Cursor::new(&bytes)).with_guessed_format().ok()?.into_dimensions().ok()?;
    Some(Picture { width: width as usize, height: height as usize, zoom: 3, kind: "image/png", bytes })
}

#[cfg(test)]
mod tests {
    use super::super::check;
    use super::super::table::{tables, tests::record};
    use super::*;

    #[test]
    fn everything_is_on_the_page_and_escaped() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("pictures")).unwrap();
        let mut records = vec![
            record("resampling", "bicubic", 1, Some(20.0)),
            record("resampling", "<script>alert(1)</script>", 1, Some(21.0)),
            record("resampling", "barycentric", 1, Some(22.0)),
        ];
        let png = Picture::png(&ndarray::Array3::zeros((4, 4, 3)), 1).unwrap().bytes;
        for (k, r) in records.iter_mut().enumerate() {
            for what in ["crop", "truth", "difference"] {
                let name = format!("pictures/{k}-{what}.png");
                std::fs::write(dir.path().join(&name), &png).unwrap();
                r.pictures.insert(what.into(), name);
            }
        }
        records[0].pictures.insert("difference".into(), "../../etc/passwd".into());
        write(dir.path(), &tables(&records), &check::verdicts(&records), &["lenslet ablate & co".into()]).unwrap();
        let page = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
        assert!(page.contains("&amp; co") && page.contains("&lt;script&gt;alert") && !page.contains("<script>alert"));
        // Three crops, one truth, two differences.
        assert_eq!(page.matches("src=\"data:image/png").count(), 6);
        assert!(page.contains("2.00") && page.contains("holds"), "no margin");
    }

    #[test]
    fn training_time_is_drawn_where_there_is_any() {
        let mut records =
            vec![record("dictionary", "small", 1, Some(20.0)), record("dictionary", "large <b>", 1, Some(21.0))];
        assert!(against_time(&tables(&records)[0]).is_none());
        for (k, r) in records.iter_mut().enumerate() {
            r.scores.insert("train_seconds".into(), 3.0 + k as f64);
        }
        let svg = against_time(&tables(&records)[0]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("large &lt;b&gt;"));
    }
}
