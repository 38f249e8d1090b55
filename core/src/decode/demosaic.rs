//! Plain demosaics: by the filter array alone, without regard to lenslets.

use ndarray::Array3;
use rayon::prelude::*;

use super::mosaic::{Mosaic, mirror};
use crate::container::Cfa;

/// Reads with the border mirrored about the edge pixel, which keeps the colours in step.
struct Mirrored<'a>(&'a Mosaic);

impl Mirrored<'_> {
    #[inline]
    fn at(&self, y: isize, x: isize) -> f32 {
        self.0.data[mirror(y as i64, self.0.height) * self.0.width + mirror(x as i64, self.0.width)]
    }
}

/// One channel, as it is: (height, width, 1).
pub(super) fn mono(mosaic: &Mosaic) -> Array3<f32> {
    Array3::from_shape_fn((mosaic.height, mosaic.width, 1), |(y, x, _)| mosaic.data[y * mosaic.width + x])
}

/// Means of the nearest pixels of each colour.
pub(super) fn bilinear(mosaic: &Mosaic, cfa: Cfa) -> Array3<f32> {
    for_each_pixel(mosaic, |m, y, x| {
        let (yi, xi) = (y as isize, x as isize);
        let own = m.at(yi, xi);
        let row = (m.at(yi, xi - 1) + m.at(yi, xi + 1)) / 2.0;
        let column = (m.at(yi - 1, xi) + m.at(yi + 1, xi)) / 2.0;
        let corners = (m.at(yi - 1, xi - 1) + m.at(yi - 1, xi + 1) + m.at(yi + 1, xi - 1) + m.at(yi + 1, xi + 1)) / 4.0;
        to_rgb(cfa, y, x, own, (row + column) / 2.0, row, column, corners)
    })
}

/// Malvar, He, Cutler: "High-quality linear interpolation for demosaicing of Bayer-patterned color images", 2004.
///
/// Each filter is the bilinear mean plus a share of the Laplacian of the colour measured at the pixel:
/// ½ for green, ⅝ for red/blue at green, ¾ for red at blue and blue at red.
pub(super) fn malvar(mosaic: &Mosaic, cfa: Cfa) -> Array3<f32> {
    for_each_pixel(mosaic, |m, y, x| {
        let (yi, xi) = (y as isize, x as isize);
        let own = m.at(yi, xi);
        let row1 = m.at(yi, xi - 1) + m.at(yi, xi + 1);
        let column1 = m.at(yi - 1, xi) + m.at(yi + 1, xi);
        let row2 = m.at(yi, xi - 2) + m.at(yi, xi + 2);
        let column2 = m.at(yi - 2, xi) + m.at(yi + 2, xi);
        let corner = m.at(yi - 1, xi - 1) + m.at(yi - 1, xi + 1) + m.at(yi + 1, xi - 1) + m.at(yi + 1, xi + 1);
        let green = (row1 + column1) / 4.0 + (4.0 * own - row2 - column2) / 8.0;
        // The published filters in eighths: own 5, row ±1 4, corners −1, row ±2 −1, column ±2 ½.
        let row = (4.0 * row1 + 5.0 * own - corner - row2 + 0.5 * column2) / 8.0;
        let column = (4.0 * column1 + 5.0 * own - corner - column2 + 0.5 * row2) / 8.0;
        let corners = (2.0 * corner + 6.0 * own - 1.5 * (row2 + column2)) / 8.0;
        to_rgb(cfa, y, x, own, green, row, column, corners)
    })
}

/// Red, green and blue of the five estimates, by the pixel's place in the filter array.
#[allow(clippy::too_many_arguments)] // five numbers with a meaning each; a struct would only rename them
#[inline]
fn to_rgb(cfa: Cfa, y: usize, x: usize, own: f32, cross: f32, row: f32, column: f32, corners: f32) -> [f32; 3] {
    match cfa.plane(x, y) {
        0 => [own, cross, corners],
        1 => [row, own, column],
        2 => [column, own, row],
        _ => [corners, cross, own],
    }
}

fn for_each_pixel(mosaic: &Mosaic, pixel: impl Fn(&Mirrored<'_>, usize, usize) -> [f32; 3] + Sync) -> Array3<f32> {
    let mut out = Array3::zeros((mosaic.height, mosaic.width, 3));
    let source = Mirrored(mosaic);
    if let Some(flat) = out.as_slice_mut() {
        flat.par_chunks_mut(mosaic.width * 3).enumerate().for_each(|(y, row)| {
            for (x, o) in row.chunks_exact_mut(3).enumerate() {
                o.copy_from_slice(&pixel(&source, y, x));
            }
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene whose three colours are planes: every linear demosaic must return it away from the border.
    #[test]
    fn planes_come_back() {
        let f = |c: usize, y: usize, x: usize| 0.2 + 0.1 * c as f32 + 0.003 * x as f32 - 0.002 * y as f32;
        for cfa in [Cfa::Rggb, Cfa::Bggr, Cfa::Grbg, Cfa::Gbrg] {
            let (width, height) = (17, 14);
            let data = (0..width * height).map(|k| f(cfa.colour(k % width, k / width), k / width, k % width)).collect();
            let mosaic = Mosaic { width, height, data };
            for image in [bilinear(&mosaic, cfa), malvar(&mosaic, cfa)] {
                for y in 2..height - 2 {
                    for x in 2..width - 2 {
                        for c in 0..3 {
                            assert!((image[[y, x, c]] - f(c, y, x)).abs() < 1e-5, "{cfa:?} ({x}, {y}) colour {c}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn grey_stays_grey_up_to_the_corners() {
        let mosaic = Mosaic { width: 8, height: 9, data: vec![0.5; 72] };
        for image in [bilinear(&mosaic, Cfa::Bggr), malvar(&mosaic, Cfa::Bggr)] {
            assert!(image.iter().all(|v| (v - 0.5).abs() < 1e-6));
        }
    }
}
