//! The comparison of several stages of one picture: a slider between any two, and the same crop of every one.

use std::fmt::Write as _;

use lenslet::page::escape_html;

use super::embedded::EmbeddedPicture;

/// One stage: its name and its picture; all stages of a comparison have the same size.
#[derive(Debug, Clone)]
pub struct Stage {
    /// Shown beside the picture.
    pub name: String,
    /// The whole picture.
    pub picture: EmbeddedPicture,
}

/// The comparison as HTML. Without a script, and on paper, it is a grid of all pictures; the script makes the slider of
/// it.
pub fn comparison(label: &str, stages: &[Stage], start: [f64; 2]) -> String {
    let mut html = format!(
        "<section class=\"compare\" aria-label=\"{}\" data-x=\"{:.3}\" data-y=\"{:.3}\">\n<h3>{0}</h3>\n<div class=\"grid stages\">\n",
        escape_html(label),
        start[0],
        start[1]
    );
    for stage in stages {
        let _ = writeln!(
            html,
            "<figure>{}<figcaption>{}</figcaption></figure>",
            stage.picture.element(&format!("{label}: {}", stage.name)),
            escape_html(&stage.name)
        );
    }
    html.push_str("</div>\n</section>\n");
    html
}
