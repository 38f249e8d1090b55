//! `report.html`: one file with nothing loaded from outside. Tables, plots, crops with a slider; light, dark, printed.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use base64::Engine as _;
use lenslet_core::output;

use super::check::Verdict;
use super::table::{Row, SCORES, Table, best, of_name, words};
use super::{picture, plot};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Scores that are plotted where an experiment has them.
const PLOTTED: [&str; 7] = ["psnr", "psnr_outer", "ssim", "hidden_psnr", "mtf50", "spurious", "consistency"];
/// Largest picture embedded, bytes.
const MAX_PICTURE: u64 = 4 << 20;

/// Text as HTML shows it literally.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// Writes the page of the tables. `about`: lines on how it was made (command, machine, date).
///
/// # Errors
/// When it cannot be written. Pictures that are gone are left out.
pub fn write(out: &Path, tables: &[Table], verdicts: &[Verdict], about: &[String]) -> Result<()> {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>lenslet: ablation</title>\n<style>{STYLE}</style></head><body>\n<main>\n<h1>What each step gives</h1>\n"
    );
    for line in about {
        let _ = writeln!(html, "<p class=\"about\">{}</p>", escape(line));
    }
    html.push_str("<nav>");
    for table in tables {
        let _ = write!(html, "<a href=\"#{0}\">{0}</a> ", escape(&table.experiment));
    }
    html.push_str("</nav>\n");
    orderings(&mut html, verdicts);
    for table in tables {
        section(&mut html, out, table);
    }
    legend(&mut html, tables);
    let _ = write!(html, "</main>\n<script>{SCRIPT}</script>\n</body></html>\n");
    output::write_file(&out.join("report.html"), true, html.as_bytes())?;
    Ok(())
}

fn orderings(html: &mut String, verdicts: &[Verdict]) {
    if verdicts.is_empty() {
        return;
    }
    html.push_str("<section id=\"orderings\"><h2>orderings</h2><p>Whether what should score more does: mean and spread over seeds of the paired differences.</p><div class=\"wide\"><table><thead><tr><th>experiment</th><th>subject</th><th>this</th><th>over this</th><th>margin dB</th><th></th></tr></thead><tbody>");
    for v in verdicts {
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"{}\">{}</td></tr>",
            escape(&v.experiment),
            escape(&v.subject),
            escape(&v.better),
            escape(&v.worse),
            words(&v.margin, 2),
            if v.holds { "yes" } else { "no" },
            if v.holds { "holds" } else { "does not hold" }
        );
    }
    html.push_str("</tbody></table></div></section>\n");
}

fn section(html: &mut String, out: &Path, table: &Table) {
    let _ = write!(
        html,
        "<section id=\"{0}\"><h2>{0}</h2><p>{1}</p>\n",
        escape(&table.experiment),
        escape(&table.question)
    );
    let plots: Vec<String> = PLOTTED.iter().filter_map(|name| plot::dots(table, name)).collect();
    if !plots.is_empty() {
        let _ = writeln!(html, "<div class=\"plots\">{}</div>", plots.concat());
    }
    html.push_str("<div class=\"wide\"><table><thead><tr><th>variant</th><th>subject</th>");
    for score in table.columns.iter().filter_map(|c| of_name(c)) {
        let _ = write!(html, "<th title=\"{}\">{}</th>", escape(score.meaning), escape(score.heading));
    }
    html.push_str("</tr></thead><tbody>");
    for (r, row) in table.rows.iter().enumerate() {
        let _ = write!(html, "<tr><td>{}</td><td>{}</td>", escape(&row.variant), escape(&row.subject));
        for (c, cell) in row.cells.iter().enumerate() {
            let digits = of_name(&table.columns[c]).map_or(3, |s| s.digits);
            let text = cell.as_ref().map(|c| words(c, digits)).unwrap_or_default();
            let class = if best(table, r, c) { "n best" } else { "n" };
            let _ = write!(html, "<td class=\"{class}\">{text}</td>");
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div>\n");
    for failure in &table.failures {
        let _ = writeln!(html, "<p class=\"no\">Not scored: {}</p>", escape(failure));
    }
    let mut subjects: Vec<&str> =
        table.rows.iter().filter(|r| !r.pictures.is_empty()).map(|r| r.subject.as_str()).collect();
    subjects.dedup();
    subjects.sort_unstable();
    subjects.dedup();
    for subject in subjects {
        let rows: Vec<&Row> = table.rows.iter().filter(|r| r.subject == subject && !r.pictures.is_empty()).collect();
        pictures(html, out, subject, &rows);
    }
    html.push_str("</section>\n");
}

/// The same crop of every variant, its difference from the truth, and a slider between any two.
fn pictures(html: &mut String, out: &Path, subject: &str, rows: &[&Row]) {
    let Some(truth) = rows.first().and_then(|r| embedded(out, r, "truth")) else { return };
    let crops: Vec<(&str, String, Option<String>)> = rows
        .iter()
        .filter_map(|r| Some((r.variant.as_str(), embedded(out, r, "crop")?, embedded(out, r, "difference"))))
        .collect();
    let subject = escape(subject);
    let names: Vec<&str> = crops.iter().map(|c| c.0).chain(std::iter::once("truth")).collect();
    let options = |chosen: usize| {
        let option = |(i, name): (usize, &&str)| {
            format!("<option value=\"{i}\"{}>{}</option>", if i == chosen { " selected" } else { "" }, escape(name))
        };
        names.iter().enumerate().map(option).collect::<String>()
    };
    let _ = write!(
        html,
        "<div class=\"compare\"><h3>{subject}</h3><div class=\"controls\"><label>left <select class=\"a\">{}</select></label> <label>right <select class=\"b\">{}</select></label></div>\
         <div class=\"stage\"><img class=\"under\" alt=\"\"><img class=\"over\" alt=\"\"><div class=\"cut\"></div></div>\
         <input type=\"range\" min=\"0\" max=\"100\" value=\"50\" aria-label=\"where the left picture ends\">\n<div class=\"crops\">",
        options(0),
        options(names.len().saturating_sub(2))
    );
    for (name, crop, difference) in &crops {
        let name = escape(name);
        let _ = write!(html, "<figure><img class=\"crop\" alt=\"{subject} by {name}\" src=\"{crop}\">");
        if let Some(difference) = difference {
            let _ = write!(html, "<img alt=\"its difference from the truth\" src=\"{difference}\">");
        }
        let _ = write!(html, "<figcaption>{name}</figcaption></figure>");
    }
    let _ = writeln!(
        html,
        "<figure><img class=\"crop\" alt=\"{subject}: truth\" src=\"{truth}\"><figcaption>truth</figcaption></figure></div>\
         <p class=\"about\">Beside each crop its difference from the truth, {} times, grey where there is none.</p></div>",
        picture::AMPLIFICATION
    );
}

/// A picture of a row as a data URI; none if it is gone or names a place outside of the folder.
fn embedded(out: &Path, row: &Row, what: &str) -> Option<String> {
    let name = row.pictures.get(what)?;
    let inside = Path::new(name).components().all(|c| matches!(c, std::path::Component::Normal(_)));
    let path = out.join(name);
    if !inside || std::fs::metadata(&path).ok()?.len() > MAX_PICTURE {
        return None;
    }
    let bytes = std::fs::read(path).ok()?;
    Some(format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes)))
}

fn legend(html: &mut String, tables: &[Table]) {
    html.push_str("<section id=\"scores\"><h2>scores</h2><dl>");
    for score in SCORES.iter().filter(|s| tables.iter().any(|t| t.columns.iter().any(|c| c == s.name))) {
        let _ = write!(html, "<dt>{}</dt><dd>{}</dd>", escape(score.heading), escape(score.meaning));
    }
    html.push_str("</dl></section>\n");
}

#[cfg(test)]
mod tests {
    use super::super::check;
    use super::super::table::{tables, tests::record};
    use super::*;

    #[test]
    fn a_page_of_its_own_with_everything_escaped() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("pictures")).unwrap();
        let mut records = vec![
            record("resampling", "bicubic", 1, Some(20.0)),
            record("resampling", "<script>alert(1)</script>", 1, Some(21.0)),
            record("resampling", "barycentric", 1, Some(22.0)),
        ];
        for (k, r) in records.iter_mut().enumerate() {
            for what in ["crop", "truth", "difference"] {
                let name = format!("pictures/{k}-{what}.png");
                std::fs::write(dir.path().join(&name), b"png").unwrap();
                r.pictures.insert(what.into(), name);
            }
        }
        records[0].pictures.insert("difference".into(), "../../etc/passwd".into());
        write(dir.path(), &tables(&records), &check::verdicts(&records), &["lenslet ablate & co".into()]).unwrap();
        let page = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
        assert!(page.contains("default-src 'none'") && page.contains("&amp; co"));
        assert!(!page.contains("<script>alert") && !page.contains("http://") && !page.contains("https://"));
        // Three crops, one truth, two differences.
        assert_eq!(page.matches("data:image/png").count(), 6);
        assert!(page.contains("+") || page.contains("2.00"), "no margin");
    }
}
