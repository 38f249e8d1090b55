//! What the demo's light field is for: refocused near and far, everything in focus, depth, and the page to play with.

use std::path::Path;

use crate::report::EmbeddedPicture;
use crate::report::embedded::captioned_strip;
use lenslet::apps::depth;
use lenslet::apps::refocus::{self, ApertureShape};
use lenslet::apps::viewer::{self, ViewerContent};
use lenslet::image_io::{Picture, shrink};
use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::View;
use lenslet_core::output;
use lenslet_core::progress::Observer;
use lenslet_views::disparity::{self, DepthOrder};
use lenslet_views::{RenderSamples as _, multiview};
use ndarray::{Array3, Array5, s};

/// The page, and the pictures of the report.
pub(super) const PAGE: &str = "viewer.html";
/// Longer side of the views on the page, pixels.
const SIDE: usize = 540;
/// Height and width of each picture of the strip, pixels at most.
const SMALL: usize = 260;
/// The page may be this large, bytes.
const LIMIT: usize = 20_000_000;

/// Pictures made of all views together, sRGB-encoded, with their names.
pub(super) type Pictures = Vec<(String, Array3<f32>)>;

/// Writes `viewer.html` and `refocus.png`; gives the pictures of the latter.
pub(super) fn write(
    root: &Path,
    samples: &HexSamples,
    target: &Size,
    observer: &dyn Observer,
) -> anyhow::Result<Pictures> {
    let n = samples.views;
    let mut field = Stack::new(n);
    samples
        .renderer(Interpolation::Barycentric)
        .size(*target)
        .observer(observer)
        .prepare()?
        .render_all(&mut |v, u, view: View| field.put(v, u, view.pixels()))?;
    let barycentric = field.data.clone();
    samples
        .renderer(Interpolation::Multiview)
        .size(*target)
        .observer(observer)
        .prepare()?
        .render_all(&mut |v, u, view: View| field.put(v, u, view.pixels()))?;
    let data = field.data.view();
    let found = disparity::estimate_disparity(&data, &disparity::Options::shown(), observer)?;
    let order = multiview::depth_order_of(&data, &found.disparity)?;
    let content = ViewerContent {
        title: "A simulated light field to play with".to_owned(),
        views: (n, n),
        // The same scene from the same samples: one depth.
        sets: [("multiview", data), ("barycentric", barycentric.view())]
            .map(|(name, data)| viewer::shrink_views(name, &data, SIDE, &found.disparity, order))
            .into(),
    };
    output::write_file(&root.join(PAGE), false, viewer::viewer_page(&content, 88, LIMIT)?.as_bytes())?;

    let aperture = refocus::aperture_weights((n, n), 1.0, ApertureShape::Round);
    let mut sorted: Vec<f32> = found.disparity.iter().copied().collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let share = |f: f32| sorted[(f * (sorted.len() - 1) as f32) as usize];
    let (near, far) = match order {
        DepthOrder::NearerIsSmaller => (share(0.05), share(0.95)),
        DepthOrder::NearerIsLarger => (share(0.95), share(0.05)),
    };
    let small = |image: &Array3<f32>| {
        let screen = Picture::from_linear(&shrink(&image.view(), SMALL).view());
        let values = screen.rgb.iter().map(|&b| f32::from(b) / 255.0).collect();
        Array3::from_shape_vec((screen.height, screen.width, 3), values)
    };
    let at = |d: f32| refocus::refocus(&data, d, &aperture.view());
    let sharp = refocus::all_in_focus(&data, &found.disparity.view(), &aperture.view())?;
    // What is nearer is brighter.
    let nearness = found.disparity.mapv(|d| d * order.sign());
    let (one, other) = (share(0.01) * order.sign(), share(0.99) * order.sign());
    let colours = depth::colour_map(&nearness.view(), (one.min(other), one.max(other)));
    let depth = Array3::from_shape_vec(
        (colours.height, colours.width, 3),
        colours.rgb.iter().map(|&b| f32::from(b) / 255.0).collect(),
    )?;
    let pictures = vec![
        ("focus near".to_owned(), small(&at(near)?)?),
        ("focus far".to_owned(), small(&at(far)?)?),
        ("all in focus".to_owned(), small(&sharp)?),
        ("depth".to_owned(), shrink(&depth.view(), SMALL)),
    ];
    let image = captioned_strip(&pictures, 6, 12)?;
    output::write_file(&root.join("refocus.png"), false, &EmbeddedPicture::png(&image, 1)?.bytes)?;
    Ok(pictures)
}

/// Views (v, u, t, s, c) of a square of them, shrunk as they come.
struct Stack {
    views: usize,
    data: Array5<f32>,
}

impl Stack {
    fn new(views: usize) -> Stack {
        Stack { views, data: Array5::zeros((0, 0, 0, 0, 0)) }
    }

    fn put(&mut self, v: usize, u: usize, view: &Array3<f32>) -> anyhow::Result<()> {
        let small = shrink(&view.view(), SIDE);
        if self.data.is_empty() {
            let (h, w, c) = small.dim();
            self.data = Array5::zeros((self.views, self.views, h, w, c));
        }
        self.data.slice_mut(s![v, u, .., .., ..]).assign(&small);
        Ok(())
    }
}
