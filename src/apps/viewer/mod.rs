//! The viewer page: a light field as one HTML file that loads nothing from outside. Refocusing and perspective in
//! WebGL2, in a plain canvas where there is none.

use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use lenslet_views::disparity::DepthOrder;
use ndarray::{Array2, ArrayView5, Axis, s};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::error::Error;
use crate::image_io::{Picture, shrink};
use crate::page::{self, base64_of};

/// Views as they go into the page.
#[derive(Debug, Clone)]
pub struct ViewSet {
    /// Shown on the button that chooses it.
    pub name: String,
    /// Pictures, row after row of views, all of one size.
    pub views: Vec<Picture>,
    /// Disparity of the middle view in pixels of the pictures per view step, of the pictures' size.
    pub disparity: Array2<f32>,
    /// Which disparities are in front.
    pub order: DepthOrder,
}

/// All that a page needs.
#[derive(Debug, Clone)]
pub struct ViewerContent {
    /// Heading and title.
    pub title: String,
    /// Rows and columns of views.
    pub views: (usize, usize),
    /// One or more light fields, of one size and number of views.
    pub sets: Vec<ViewSet>,
}

/// Views of a light field (v, u, t, s, c) in linear light as pictures of at most `side` pixels, under the name `name`, with
/// the disparity of its middle view (t, s), nearer by `order`.
pub fn shrink_views(
    name: &str,
    data: &ArrayView5<f32>,
    side: usize,
    disparity: &Array2<f32>,
    order: DepthOrder,
) -> ViewSet {
    let (rows, columns, ..) = data.dim();
    let one = |k: usize| {
        let view = data.slice(s![k / columns, k % columns, .., .., ..]);
        Picture::from_linear(&shrink(&view, side).view())
    };
    let small = shrink(&disparity.view().insert_axis(Axis(2)), side);
    let factor = small.dim().1 as f32 / disparity.dim().1.max(1) as f32;
    let disparity = small.index_axis(Axis(2), 0).mapv(|d| d * factor);
    let views = (0..rows * columns).into_par_iter().map(one).collect();
    ViewSet { name: name.to_string(), views, disparity, order }
}

/// The page, with the pictures as JPEG of at most `quality` (1 to 100); lower where the page would exceed `max_bytes`.
///
/// # Errors
/// [`Error::Shape`] for sets of different sizes or none at all, [`Error::Parameter`] for disparities that are not
/// numbers, [`Error::PageTooLarge`] where quality 30 or less does not keep the page within `max_bytes`.
///
/// ```
/// use lenslet::apps::viewer::{ViewerContent, shrink_views, viewer_page};
/// use lenslet::disparity::DepthOrder;
/// use ndarray::{Array2, Array5};
///
/// let field = Array5::from_elem((3, 3, 12, 16, 3), 0.2);
/// let content = ViewerContent {
///     title: "A wall & nothing else".into(),
///     views: (3, 3),
///     sets: vec![shrink_views("decoded", &field.view(), 720, &Array2::zeros((12, 16)), DepthOrder::NearerIsSmaller)],
/// };
/// let html = viewer_page(&content, 80, 1 << 20)?;
/// assert!(html.contains("<title>A wall &amp; nothing else</title>"));
/// # Ok::<(), lenslet::apps::Error>(())
/// ```
pub fn viewer_page(content: &ViewerContent, quality: u8, max_bytes: usize) -> Result<String, Error> {
    let (rows, columns) = content.views;
    let first = content
        .sets
        .first()
        .and_then(|s| s.views.first())
        .ok_or_else(|| Error::Shape("there is nothing to show".into()))?;
    let (width, height) = (first.width, first.height);
    for set in &content.sets {
        ensure!(
            Error::Shape,
            set.views.len() == rows * columns && set.views.iter().all(|p| (p.width, p.height) == (width, height)),
            "the light fields shown together must have the same views and size; {} differs",
            set.name
        );
    }
    let reliefs =
        content.sets.iter().map(|set| relief(set, Size::new(width, height))).collect::<Result<Vec<_>, Error>>()?;

    let mut quality = quality.clamp(1, 100);
    loop {
        let sets = content
            .sets
            .iter()
            .zip(&reliefs)
            .map(|(set, relief)| {
                let views = set
                    .views
                    .par_iter()
                    .map(|p| Ok(base64_of(&p.to_jpeg(quality)?)))
                    .collect::<Result<Vec<String>, Error>>()?;
                let mut one = relief.clone();
                one["name"] = json!(set.name);
                one["views"] = json!(views);
                Ok(one)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let data = json!({
            "rows": rows, "columns": columns, "width": width, "height": height, "sets": sets,
        });
        let html = fill(&content.title, &data.to_string());
        if html.len() <= max_bytes {
            return Ok(html);
        }
        if quality <= 30 {
            return Err(Error::PageTooLarge { needed: html.len(), quality, allowed: max_bytes });
        }
        quality -= 10;
    }
}

/// The disparity of a set as the page reads it.
fn relief(set: &ViewSet, size: Size) -> Result<Value, Error> {
    let name = &set.name;
    ensure!(
        Error::Shape,
        set.disparity.dim() == (size.height, size.width),
        "the disparity of {name} has another size than its pictures"
    );
    let low = set.disparity.iter().copied().fold(f32::INFINITY, f32::min);
    let high = set.disparity.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    ensure!(
        Error::Parameter,
        low.is_finite() && high.is_finite(),
        "the disparity of {name} has values that are not numbers"
    );
    let (low, high) = if high - low < 0.1 { (low - 0.05, high + 0.05) } else { (low, high) };
    let depth = grey_picture(&set.disparity, low, high).to_png()?;
    let mut list: Vec<f32> = set.disparity.iter().copied().collect();
    list.sort_unstable_by(f32::total_cmp);
    let start = list[list.len() / 2];
    Ok(json!({ "low": low, "high": high, "start": start, "front": set.order.sign(), "depth": base64_of(&depth) }))
}

fn grey_picture(disparity: &Array2<f32>, low: f32, high: f32) -> Picture {
    let (height, width) = disparity.dim();
    let rgb = disparity.iter().flat_map(|d| [((d - low) / (high - low) * 255.0 + 0.5) as u8; 3]).collect();
    Picture { width, height, rgb }
}

/// Puts the parts together; whatever comes from files is escaped here.
fn fill(title: &str, data: &str) -> String {
    let style = format!("{}{}", page::STYLE, include_str!("page.css"));
    let script = [page::COMMON_SCRIPT, include_str!("paint.js"), include_str!("page.js")].concat();
    // In JSON these characters occur within strings only, where they may be written like this.
    let data = data.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026");
    // The template is split before anything is inserted, so that inserted text is never searched for placeholders.
    let parts: Vec<&str> = include_str!("page.html").split('@').collect();
    let body: String = parts
        .iter()
        .map(|part| match *part {
            "TITLE" => page::escape_html(title),
            "DATA" => data.clone(),
            text => text.to_owned(),
        })
        .collect();
    page::html_document(title, &style, &body, &script)
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;

    use super::*;

    fn content(title: &str) -> ViewerContent {
        let views = (0..9).map(|k| Picture { width: 16, height: 12, rgb: vec![k as u8 * 20; 16 * 12 * 3] }).collect();
        let disparity = Array2::from_elem((12, 16), 0.5);
        let order = DepthOrder::NearerIsSmaller;
        let sets = vec![ViewSet { name: "</script><img src=x>".into(), views, disparity, order }];
        ViewerContent { title: title.into(), views: (3, 3), sets }
    }

    #[test]
    fn texts_from_files_are_escaped_and_nothing_is_loaded() {
        let html = viewer_page(&content("<b>\"x\" & @DATA@</b>"), 80, 1 << 20).unwrap();
        assert!(!html.contains("<b>") && !html.contains("</script><img"));
        assert!(
            html.contains("<title>&lt;b&gt;&quot;x") && html.contains("&lt;b&gt;&quot;x&quot; &amp; @DATA@&lt;/b&gt;")
        );
        assert_eq!(html.matches("</script>").count(), 2);
        for outside in ["http://", "https://", " src=\"", "href=", "@import", "url("] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn the_data_reads_back() {
        let html = viewer_page(&content("t"), 80, 1 << 20).unwrap();
        let start = html.find("application/json\">").unwrap() + "application/json\">".len();
        let end = start + html[start..].find("</script>").unwrap();
        let data: serde_json::Value = serde_json::from_str(&html[start..end]).unwrap();
        assert_eq!(data["sets"][0]["name"], "</script><img src=x>");
        let jpeg = STANDARD.decode(data["sets"][0]["views"][8].as_str().unwrap()).unwrap();
        let image = image::load_from_memory(&jpeg).unwrap().to_rgb8();
        assert_eq!(image.dimensions(), (16, 12));
        assert!((i32::from(image.get_pixel(5, 5)[0]) - 160).abs() < 4);
    }

    #[test]
    fn too_small_a_limit_is_refused() {
        assert!(viewer_page(&content("t"), 80, 1000).is_err());
        let mut other = content("t");
        other.sets[0].views.pop();
        assert!(viewer_page(&other, 80, 1 << 20).is_err());
    }
}
