//! Pictures for pages and files: views and crops as PNG or JPEG, difference maps, strips of crops with names.

use anyhow::ensure;
use ndarray::{Array3, s};

use lenslet::image_io::Picture;
use lenslet::page::{base64_of, escape_html};

/// An encoded picture, ready to be embedded.
#[derive(Debug, Clone)]
pub struct EmbeddedPicture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Each pixel is shown as this many, unsmoothed.
    pub zoom: usize,
    /// `image/png` or `image/jpeg`.
    pub kind: &'static str,
    /// The file's bytes.
    pub bytes: Vec<u8>,
}

/// A part of a picture: left, top, width, height in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Crop {
    /// The crop of the given size about shares (`x`, `y`) of a picture of (height, width, …), kept within it.
    pub fn about(shape: (usize, usize, usize), x: f64, y: f64, width: usize, height: usize) -> Crop {
        let (width, height) = (width.min(shape.1), height.min(shape.0));
        let place = |share: f64, side: usize, all: usize| {
            ((share * all as f64 - side as f64 / 2.0).max(0.0) as usize).min(all - side)
        };
        Crop { left: place(x, width, shape.1), top: place(y, height, shape.0), width, height }
    }

    /// That part of `view`, or an empty picture where it does not lie within.
    pub fn of(&self, view: &Array3<f32>) -> Array3<f32> {
        let (h, w, _) = view.dim();
        let (right, bottom) = ((self.left + self.width).min(w), (self.top + self.height).min(h));
        view.slice(s![self.top.min(bottom)..bottom, self.left.min(right)..right, ..]).to_owned()
    }
}

impl EmbeddedPicture {
    /// Encodes a view (t, s, c) of encoded values 0..1 as PNG; every pixel is shown as `zoom` of them.
    ///
    /// # Errors
    /// When the view is empty or cannot be encoded.
    pub fn png(view: &Array3<f32>, zoom: usize) -> anyhow::Result<EmbeddedPicture> {
        let (height, width) = size(view)?;
        let bytes = Picture::from_srgb(&view.view()).to_png()?;
        Ok(EmbeddedPicture { width, height, zoom, kind: "image/png", bytes })
    }

    /// As [`EmbeddedPicture::png`], as JPEG of `quality` 1..=100.
    ///
    /// # Errors
    /// As [`EmbeddedPicture::png`].
    pub fn jpeg(view: &Array3<f32>, quality: u8) -> anyhow::Result<EmbeddedPicture> {
        let (height, width) = size(view)?;
        let bytes = Picture::from_srgb(&view.view()).to_jpeg(quality.clamp(1, 100))?;
        Ok(EmbeddedPicture { width, height, zoom: 1, kind: "image/jpeg", bytes })
    }

    /// The picture as an address that holds it whole.
    pub fn address(&self) -> String {
        format!("data:{};base64,{}", self.kind, base64_of(&self.bytes))
    }

    /// An `<img>` element.
    pub fn element(&self, description: &str) -> String {
        let zoom = if self.zoom > 1 { " class=\"pixels\"" } else { "" };
        format!(
            "<img{zoom} width=\"{}\" height=\"{}\" alt=\"{}\" src=\"{}\">",
            self.width * self.zoom.max(1),
            self.height * self.zoom.max(1),
            escape_html(description),
            self.address()
        )
    }
}

/// Height and width of a view that has any pixels.
fn size(view: &Array3<f32>) -> anyhow::Result<(usize, usize)> {
    let (height, width, channels) = view.dim();
    ensure!(height > 0 && width > 0 && channels > 0, "a picture of {width}x{height} pixels cannot be written");
    Ok((height, width))
}

/// Difference of two pictures, mean over the channels, times `gain`: blue where `result` is darker, red where it is
/// brighter, white where they agree.
pub fn difference_map(result: &Array3<f32>, reference: &Array3<f32>, gain: f32) -> Array3<f32> {
    let (h, w, c) = result.dim();
    if reference.dim() != result.dim() || c == 0 {
        return Array3::zeros((h, w, 3));
    }
    let mut out = Array3::ones((h, w, 3));
    for y in 0..h {
        for x in 0..w {
            let mean = (0..c).map(|k| result[[y, x, k]] - reference[[y, x, k]]).sum::<f32>() / c as f32;
            let strength = (gain * mean.abs()).min(1.0);
            let ink = if mean > 0.0 { [0.1, 0.85, 0.85] } else { [0.85, 0.6, 0.1] };
            for k in 0..3 {
                out[[y, x, k]] = 1.0 - ink[k] * strength;
            }
        }
    }
    out
}

/// Where a view (t, s, c) shows most detail: the middle, as shares of width and height, of the square of `side` pixels
/// in which neighbours differ most, of squares half a side apart. The middle of a view too small to choose.
pub fn most_detailed_place(view: &Array3<f32>, side: usize) -> [f64; 2] {
    let (height, width, channels) = view.dim();
    let side = side.max(2);
    if height < side || width < side {
        return [0.5; 2];
    }
    let places = |n: usize| (0..=(n - side) / (side / 2)).map(move |k| k * (side / 2));
    let mut most = (f32::NEG_INFINITY, [0.5; 2]);
    for top in places(height) {
        for left in places(width) {
            let mut sum = 0.0;
            for t in top + 1..top + side {
                for s in left + 1..left + side {
                    for c in 0..channels {
                        let own = view[[t, s, c]];
                        sum += (own - view[[t, s - 1, c]]).abs() + (own - view[[t - 1, s, c]]).abs();
                    }
                }
            }
            if sum > most.0 {
                let middle = |corner: usize, n: usize| (corner as f64 + side as f64 / 2.0) / n as f64;
                most = (sum, [middle(left, width), middle(top, height)]);
            }
        }
    }
    most.1
}

/// Every pixel repeated `times` to the right and down.
pub fn enlarge(view: &Array3<f32>, times: usize) -> Array3<f32> {
    let (h, w, c) = view.dim();
    let times = times.max(1);
    Array3::from_shape_fn((h * times, w * times, c), |(y, x, k)| view[[y / times, x / times, k]])
}

/// Pictures of equal height side by side, `gap` white columns between them, each with its name written above.
///
/// # Errors
/// When there is no picture, or they differ in height.
pub fn captioned_strip(pictures: &[(String, Array3<f32>)], gap: usize, letters: usize) -> anyhow::Result<Array3<f32>> {
    let height = pictures.first().map_or(0, |(_, p)| p.dim().0);
    ensure!(
        height > 0 && pictures.iter().all(|(_, p)| p.dim().0 == height && p.dim().2 == 3),
        "pictures do not fit together"
    );
    let head = letters * 2;
    // As large as the longest name allows: letters are as wide as high, and half of one is left at both sides.
    let room = |(name, p): &(String, Array3<f32>)| p.dim().1 as f64 / (name.chars().count() + 1) as f64;
    let letter = pictures.iter().map(room).fold(letters as f64, f64::min);
    let width: usize = pictures.iter().map(|(_, p)| p.dim().1 + gap).sum::<usize>() - gap;
    let mut out = Array3::ones((height + head, width, 3));
    let mut left = 0;
    for (name, picture) in pictures {
        let w = picture.dim().1;
        out.slice_mut(s![head.., left..left + w, ..]).assign(picture);
        for y in 0..head {
            for x in 0..w {
                // Four positions a pixel keep the letters' edges smooth.
                let ink = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]
                    .iter()
                    .filter(|(dx, dy)| {
                        // Half a letter from the picture's left edge, in the middle of the head.
                        let (tx, ty) = (x as f64 + dx - 0.5 * letter, y as f64 + dy - 0.5 * (head as f64 - letter));
                        lenslet_core::stroke_font::is_on_text(tx, ty, name, letter, 1.0)
                    })
                    .count() as f32;
                out.slice_mut(s![y, left + x, ..]).fill(1.0 - 0.22 * ink);
            }
        }
        left += w + gap;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_png_holds_the_pixels_it_was_given() {
        let view = Array3::from_shape_fn((5, 7, 3), |(y, x, c)| (y * 7 + x + c) as f32 / 40.0);
        let picture = EmbeddedPicture::png(&view, 2).unwrap();
        let back = image::load_from_memory(&picture.bytes).unwrap().into_rgb8();
        assert_eq!((back.width(), back.height()), (7, 5));
        assert_eq!(back.into_raw(), Picture::from_srgb(&view.view()).rgb);
        assert!(picture.element("x").contains("width=\"14\" height=\"10\""));
        assert!(EmbeddedPicture::png(&Array3::zeros((0, 3, 3)), 1).is_err());
    }

    #[test]
    fn difference_is_red_where_brighter_blue_where_darker_white_where_equal() {
        let a = Array3::from_elem((2, 2, 3), 0.5);
        let mut b = a.clone();
        b.slice_mut(s![0, 0, ..]).fill(0.6);
        b.slice_mut(s![1, 1, ..]).fill(0.4);
        let d = difference_map(&a, &b, 5.0);
        assert!(d[[0, 0, 2]] > d[[0, 0, 0]] && d[[1, 1, 0]] > d[[1, 1, 2]]);
        assert!((0..3).all(|c| d[[0, 1, c]] == 1.0));
    }

    #[test]
    fn crops_stay_within_the_picture() {
        let shape = (40, 60, 3);
        for (x, y) in [(0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (-3.0, 9.0)] {
            let crop = Crop::about(shape, x, y, 20, 100);
            assert_eq!((crop.width, crop.height), (20, 40));
            assert_eq!(crop.of(&Array3::zeros(shape)).dim(), (40, 20, 3));
        }
    }

    #[test]
    fn a_strip_shows_every_picture_under_its_name() {
        let one = Array3::from_elem((10, 12, 3), 0.25);
        let strip = captioned_strip(&[("A".into(), one.clone()), ("B".into(), one)], 3, 6).unwrap();
        assert_eq!(strip.dim(), (22, 27, 3));
        assert_eq!(strip[[15, 5, 0]], 0.25);
        assert_eq!(strip[[15, 13, 0]], 1.0);
        assert!(strip.slice(s![..12, ..12, ..]).iter().any(|v| *v < 0.3));
    }
}
