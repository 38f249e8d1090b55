//! `report.html`, made of the tables: the questions, orderings, plots, numbers, and the same crop of every variant.

use std::path::{Component, Path};

use anyhow::Result;
use lenslet_core::input::read_regular;
use lenslet_core::output;
use ndarray::Array3;

use super::orderings::Verdict;
use super::table::{Row, SCORES, Table, format_cell, is_best, score_named, split_by_subject};
use super::{crops, plot};
use crate::report::embedded::most_detailed_place;
use crate::report::plot::{Series, line_plot};
use crate::report::{self, EmbeddedPicture, Page, Stage};

/// Scores that are plotted where an experiment has them.
const PLOTTED: [&str; 7] = ["psnr_y", "psnr_outer", "ssim", "rays_psnr", "mtf50", "spurious", "consistency"];
/// Largest picture embedded, bytes.
const MAX_PICTURE: u64 = 4 << 20;

/// Writes the page of the tables. `about`: lines on how it was made (command, machine, date).
///
/// # Errors
/// When it cannot be written. Pictures that are gone are left out.
pub fn write_page(out: &Path, tables: &[Table], verdicts: &[Verdict], about: &[String]) -> Result<()> {
    let mut page = Page::new("What each step gives", &about.join("; "));
    if !verdicts.is_empty() {
        page.heading("Orderings");
        page.paragraph("Whether what should score more does: mean and spread over seeds of the paired differences. It holds where the \
             mean is above 0.005 dB and above two standard errors; --check fails where it is not above the least margin given.");
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
    output::replace_listed(out, "report.html", page.finish().as_bytes())?;
    Ok(())
}

fn orderings(verdicts: &[Verdict]) -> report::Table {
    let row = |v: &Verdict| {
        vec![
            v.experiment.clone(),
            v.subject.clone(),
            v.better.clone(),
            v.worse.clone(),
            format_cell(&v.margin, 2),
            v.least_text(),
            v.name().into(),
        ]
    };
    report::Table {
        caption: "PSNR of the middle view's luminance, or at the rays or raw pixels of real captures".into(),
        head: ["experiment", "subject", "this", "over this", "margin dB", "least dB", ""].map(String::from).to_vec(),
        rows: verdicts.iter().map(row).collect(),
        best: Vec::new(),
    }
}

fn section(page: &mut Page, out: &Path, table: &Table) {
    page.heading(&table.experiment);
    page.paragraph(&table.question);
    let meaning = |name: &str| score_named(name).map_or(name.to_owned(), |s| format!("{}: {}", s.heading, s.meaning));
    let mut drawings: Vec<(String, String)> =
        PLOTTED.iter().filter_map(|name| Some((plot::dots(table, name)?, meaning(name)))).collect();
    drawings.extend(against_time(table).map(|svg| {
        (
            svg,
            "PSNR of the middle view's luminance over the seconds the dictionary took to train, each point a variant."
                .to_owned(),
        )
    }));
    for (which, name) in ["line_contrast", "spurious"].into_iter().enumerate() {
        drawings.extend(line_pairs(table, which + 1).map(|svg| (svg, meaning(name))));
    }
    page.drawings(&drawings);
    for (subject, part) in split_by_subject(table) {
        page.table(&shown(&subject, &part));
    }
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

/// A subject's rows as a table of the page.
fn shown(subject: &str, part: &Table) -> report::Table {
    let mut shown = report::Table {
        caption: format!("{subject}: mean ± standard deviation over seeds"),
        ..report::Table::default()
    };
    shown.head.push("variant".to_owned());
    shown.head.extend(part.columns.iter().filter_map(|c| score_named(c)).map(|s| s.heading.to_owned()));
    for (r, row) in part.rows.iter().enumerate() {
        let mut cells = vec![row.variant.clone()];
        for (c, cell) in row.cells.iter().enumerate() {
            let digits = score_named(&part.columns[c]).map_or(3, |s| s.digits);
            cells.push(cell.as_ref().map(|c| format_cell(c, digits)).unwrap_or_default());
            if is_best(part, r, c) {
                shown.best.push((r, c + 1));
            }
        }
        shown.rows.push(cells);
    }
    shown
}

/// Contrast (1) or what is not there (2) of the chart's line pairs over their frequency, a curve a variant.
fn line_pairs(table: &Table, which: usize) -> Option<String> {
    let series: Vec<Series> = table
        .rows
        .iter()
        .filter(|r| r.lines.len() > 1)
        .map(|r| Series { name: r.variant.clone(), points: r.lines.iter().map(|p| [p[0], p[which]]).collect() })
        .collect();
    let name = if which == 1 { "contrast, share of the truth's" } else { "not there, share of the truth's contrast" };
    // More curves than colours could not be distinguished.
    (2..=6).contains(&series.len()).then(|| line_plot("line pairs a lenslet", name, &series))
}

/// PSNR of luminance over seconds of training, a point a variant, on the first subject.
fn against_time(table: &Table) -> Option<String> {
    let column = |name: &str| table.columns.iter().position(|c| c == name);
    let (x, y) = (column("train_seconds")?, column("psnr_y")?);
    let subject = &table.rows.first()?.subject;
    let series: Vec<Series> = table
        .rows
        .iter()
        .filter(|r| r.subject == *subject)
        .filter_map(|r| Some((r, r.cells[x]?, r.cells[y]?)))
        .map(|(r, x, y)| Series { name: r.variant.clone(), points: vec![[x.mean, y.mean]] })
        .collect();
    (series.len() > 1).then(|| line_plot("training, seconds", "PSNR of luminance, dB", &series))
}

/// A slider between any two variants and the truth, then every difference from the truth.
fn pictures(page: &mut Page, out: &Path, subject: &str, rows: &[&Row]) {
    let stage =
        |row: &Row, what: &str, name: &str| Some(Stage { name: name.to_owned(), picture: embedded(out, row, what)? });
    let mut stages: Vec<Stage> = rows.iter().filter_map(|r| stage(r, "crop", &r.variant)).collect();
    stages.extend(rows.first().and_then(|r| stage(r, "truth", "truth")));
    if let [.., last] = stages.as_slice()
        && stages.len() > 1
    {
        page.compare(subject, &stages, start(&last.picture));
    }
    let differences: Vec<(EmbeddedPicture, String)> =
        rows.iter().filter_map(|r| Some((embedded(out, r, "difference")?, r.variant.clone()))).collect();
    if !differences.is_empty() {
        page.paragraph(&format!(
            "{subject}: differences from the truth, {} times; blue is darker, red brighter than it.",
            crops::GAIN
        ));
        page.figures(&differences);
    }
}

/// Where the enlarged crop starts: at the most detail.
fn start(picture: &EmbeddedPicture) -> [f64; 2] {
    let Ok(pixels) = image::load_from_memory(&picture.bytes) else { return [0.5; 2] };
    let pixels = pixels.into_luma8();
    let (width, height) = (pixels.width() as usize, pixels.height() as usize);
    let view = Array3::from_shape_vec((height, width, 1), pixels.into_raw().into_iter().map(f32::from).collect());
    view.map_or([0.5; 2], |view| most_detailed_place(&view, report::LOUPE))
}

/// A picture of a row; none if it is gone or names a place outside of the folder.
fn embedded(out: &Path, row: &Row, what: &str) -> Option<EmbeddedPicture> {
    let name = row.pictures.get(what)?;
    let inside = Path::new(name).components().all(|c| matches!(c, Component::Normal(_)));
    let path = out.join(name);
    if !inside {
        return None;
    }
    let bytes = read_regular(&path, MAX_PICTURE).ok()?;
    let (width, height) =
        image::ImageReader::new(std::io::Cursor::new(&bytes)).with_guessed_format().ok()?.into_dimensions().ok()?;
    Some(EmbeddedPicture { width: width as usize, height: height as usize, zoom: 3, kind: "image/png", bytes })
}

#[cfg(test)]
mod tests {
    use super::super::orderings;
    use super::super::table::{tabulate, tests::record};
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
        let png = EmbeddedPicture::png(&ndarray::Array3::zeros((4, 4, 3)), 1).unwrap().bytes;
        for (k, r) in records.iter_mut().enumerate() {
            for what in ["crop", "truth", "difference"] {
                let name = format!("pictures/{k}-{what}.png");
                std::fs::write(dir.path().join(&name), &png).unwrap();
                r.pictures.insert(what.into(), name);
            }
        }
        records[0].pictures.insert("difference".into(), "../../etc/passwd".into());
        // A capture's name is its subject, and a failure names files.
        let planted = "\"><img src=x onerror=alert(2)></style>'";
        let mut unscored = record("resampling", "cubic", 1, None);
        unscored.subject = planted.into();
        unscored.failed = Some(format!("{planted}.lfp is no capture"));
        records.push(unscored);
        let about = ["lenslet ablate & co".into(), planted.into()];
        write_page(dir.path(), &tabulate(&records), &orderings::judge_orderings(&records), &about).unwrap();
        let page = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
        assert!(page.contains("&amp; co") && page.contains("&lt;script&gt;alert") && !page.contains("<script>alert"));
        assert!(page.contains("&lt;img src=x") && !page.contains("<img src=x"));
        assert_eq!([page.matches("<script").count(), page.matches("</style>").count()], [1, 1]);
        // Three crops, one truth, two differences.
        assert_eq!(page.matches("src=\"data:image/png").count(), 6);
        assert!(page.contains("2.00") && page.contains("holds"), "no margin");
    }

    #[test]
    fn training_time_is_drawn_where_there_is_any() {
        let mut records =
            vec![record("dictionary", "small", 1, Some(20.0)), record("dictionary", "large <b>", 1, Some(21.0))];
        assert!(against_time(&tabulate(&records)[0]).is_none());
        for (k, r) in records.iter_mut().enumerate() {
            r.scores.insert("train_seconds".into(), 3.0 + k as f64);
        }
        let svg = against_time(&tabulate(&records)[0]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("large &lt;b&gt;"));
    }
}
