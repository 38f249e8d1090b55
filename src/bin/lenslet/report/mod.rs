//! One self-contained HTML page: headings, tables, plots, pictures, comparisons. Nothing is loaded from outside, every
//! text is escaped, light and dark follow the system, and without scripts or on paper all of it is still shown.

pub mod calibration_figures;
mod compare;
pub mod embedded;
pub mod plot;
#[cfg(test)]
mod sliders;

use std::fmt::Write as _;

use lenslet::page::{STYLE, escape_html, html_document};

pub use compare::{Stage, comparison};
pub use embedded::EmbeddedPicture;

/// Side of the crops that the script of the comparisons enlarges, pixels.
/// Source: chosen.
pub const LOUPE: usize = 48;
/// Script of the comparisons.
const SCRIPT: &str = concat!(include_str!("../../../page/common.js"), include_str!("script.js"));

/// A table of text; numbers are aligned right.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// What it shows.
    pub caption: String,
    /// Column heads.
    pub head: Vec<String>,
    /// Rows of cells; the first cell names the row.
    pub rows: Vec<Vec<String>>,
    /// Cells (row, column) in bold.
    pub best: Vec<(usize, usize)>,
}

/// A page being written.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// Starts a page with its title and a line below it.
    pub fn new(title: &str, subtitle: &str) -> Page {
        let body = format!("<header><h1>{}</h1><p>{}</p></header>\n", escape_html(title), escape_html(subtitle));
        Page { title: title.to_owned(), body }
    }

    /// A heading.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escape_html(text));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escape_html(text));
    }

    /// A list, each entry a name and its description.
    pub fn list(&mut self, entries: &[(&str, &str)]) {
        self.body.push_str("<ul>");
        for (name, text) in entries {
            let _ = write!(self.body, "<li><strong>{}</strong>: {}</li>", escape_html(name), escape_html(text));
        }
        self.body.push_str("</ul>\n");
    }

    /// A line with a link to a file beside the page.
    pub fn link(&mut self, file: &str, text: &str) {
        let _ = writeln!(self.body, "<p><a href=\"{}\">{}</a></p>", escape_html(file), escape_html(text));
    }

    /// Lines of code, as they are.
    pub fn code(&mut self, text: &str) {
        let _ = writeln!(self.body, "<pre><code>{}</code></pre>", escape_html(text));
    }

    /// A table; those too wide for the page scroll. Columns without any number are aligned left.
    pub fn table(&mut self, table: &Table) {
        let number = |cell: &String| cell.trim_start_matches(['-', '+', '−']).starts_with(|c: char| c.is_ascii_digit());
        let class = |column: usize, best: bool| {
            let text = !table.rows.iter().filter_map(|r| r.get(column)).any(number);
            match (text, best) {
                (true, true) => " class=\"text best\"",
                (true, false) => " class=\"text\"",
                (false, true) => " class=\"best\"",
                (false, false) => "",
            }
        };
        let _ = write!(
            self.body,
            "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\"><p>{0}</p><table><thead><tr>",
            escape_html(&table.caption)
        );
        for (c, cell) in table.head.iter().enumerate() {
            let _ = write!(self.body, "<th scope=\"col\"{}>{}</th>", class(c, false), escape_html(cell));
        }
        self.body.push_str("</tr></thead><tbody>\n");
        for (r, row) in table.rows.iter().enumerate() {
            self.body.push_str("<tr>");
            for (c, cell) in row.iter().enumerate() {
                let class = class(c, table.best.contains(&(r, c)));
                let _ = if c == 0 {
                    write!(self.body, "<th scope=\"row\"{class}>{}</th>", escape_html(cell))
                } else {
                    write!(self.body, "<td{class}>{}</td>", escape_html(cell))
                };
            }
            self.body.push_str("</tr>\n");
        }
        self.body.push_str("</tbody></table></div>\n");
    }

    /// Pictures beside each other, each with its caption.
    pub fn figures(&mut self, figures: &[(EmbeddedPicture, String)]) {
        self.body.push_str("<div class=\"grid\">\n");
        for (picture, caption) in figures {
            let _ = writeln!(
                self.body,
                "<figure>{}<figcaption>{}</figcaption></figure>",
                picture.element(caption),
                escape_html(caption)
            );
        }
        self.body.push_str("</div>\n");
    }

    /// A slider between any two stages of the same picture, with the same crop of all of them below; the crop starts
    /// about `start`, shares of the width and height.
    pub fn compare(&mut self, label: &str, stages: &[Stage], start: [f64; 2]) {
        self.body.push_str(&comparison(label, stages, start));
    }

    /// A drawing, such as one of [`plot`], with its caption.
    pub fn drawing(&mut self, svg: &str, caption: &str) {
        let _ = writeln!(
            self.body,
            "<figure class=\"plot\">{svg}<figcaption>{}</figcaption></figure>",
            escape_html(caption)
        );
    }

    /// Drawings beside each other where there is room, each with its caption.
    pub fn drawings(&mut self, drawings: &[(String, String)]) {
        self.body.push_str("<div class=\"plots\">\n");
        for (svg, caption) in drawings {
            self.drawing(svg, caption);
        }
        self.body.push_str("</div>\n");
    }

    /// The whole page.
    pub fn finish(self) -> String {
        html_document(&self.title, STYLE, &format!("<main>\n{}</main>", self.body), SCRIPT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    fn page() -> String {
        let mut page = Page::new("A <b>title</b>", "x & y");
        page.heading("\"quoted\"");
        page.paragraph("<script>alert(1)</script>");
        page.table(&Table {
            caption: "c'".into(),
            head: vec!["method".into(), "dB".into()],
            rows: vec![vec!["<i>".into(), "1.0".into()]],
            best: vec![(0, 1)],
        });
        let picture = EmbeddedPicture::png(&Array3::from_elem((4, 4, 3), 0.5), 1).unwrap();
        page.figures(&[(picture.clone(), "one <".into())]);
        let stage = |name: &str| Stage { name: name.into(), picture: picture.clone() };
        page.compare("stages", &[stage("a"), stage("b\" onload=\"x")], [0.5, 0.5]);
        page.finish()
    }

    #[test]
    fn every_text_is_escaped() {
        let page = page();
        for bad in ["<b>title", "<script>alert", "<i>", "one <<", "\" onload=\"", "c'\""] {
            assert!(!page.contains(bad), "{bad}");
        }
        assert!(page.contains("A &lt;b&gt;title&lt;/b&gt;") && page.contains("x &amp; y"));
    }

    #[test]
    fn nothing_is_loaded_from_outside() {
        let page = page();
        // The one address a drawing may name is the SVG name space, which is not fetched.
        let rest = page.replace("http://www.w3.org/2000/svg", "");
        for outside in ["http:", "https:", "url(", "@import", "<link", "src=\"/", "import("] {
            assert!(!rest.contains(outside), "{outside}");
        }
        assert_eq!(page.matches("<script").count(), 1);
        assert_eq!(page.matches(" style=").count(), 0, "the policy would drop inline styles");
    }
}
