//! Hot pixels: those that the calibration lists, and single ones far above all their neighbours of the same colour.

use rayon::prelude::*;

use super::mosaic::Mosaic;

/// A pixel is hot above this many times the brightest of its neighbours plus [`HOT_OFFSET`].
///
/// Source: chosen; the lens blurs light over more than a pixel.
const HOT_RATIO: f32 = 2.0;
/// See [`HOT_RATIO`]; share of full light.
///
/// Source: chosen.
const HOT_OFFSET: f32 = 0.1;

/// Listed hot pixels (ascending indices) become the median of their nearest neighbours of the same colour that are not
/// listed.
pub(super) fn replace_listed(mosaic: &mut Mosaic, hot: &[u32]) {
    let (width, height) = (mosaic.width, mosaic.height);
    let found: Vec<f32> = hot
        .iter()
        .map(|&k| {
            let (x, y) = (k as usize % width, k as usize / width);
            let around = |v: usize| [v.wrapping_sub(2), v, v + 2];
            let inside = around(y).into_iter().flat_map(|y| around(x).map(|x| (x, y)));
            let mut others: Vec<f32> = inside
                .filter(|&(x, y)| x < width && y < height && hot.binary_search(&((y * width + x) as u32)).is_err())
                .map(|(x, y)| mosaic.data[y * width + x])
                .collect();
            others.sort_unstable_by(f32::total_cmp);
            let n = others.len();
            // Without such a neighbour the pixel keeps its value.
            if n == 0 { mosaic.data[k as usize] } else { (others[(n - 1) / 2] + others[n / 2]) / 2.0 }
        })
        .collect();
    for (&k, value) in hot.iter().zip(found) {
        mosaic.data[k as usize] = value;
    }
}

/// A pixel more than twice as bright as each of its eight nearest neighbours of the same colour (plus an offset)
/// becomes their median.
pub(super) fn replace_outliers(mosaic: &mut Mosaic) {
    let (width, height) = (mosaic.width, mosaic.height);
    let source = &mosaic.data;
    let found: Vec<(usize, f32)> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let near = move |v: usize, len: usize| {
                [if v >= 2 { v - 2 } else { v + 2 }, v, if v + 2 < len { v + 2 } else { v - 2 }]
            };
            let ys = near(y, height);
            (0..width).filter_map(move |x| {
                let value = source[y * width + x];
                // Cheap test first: nearly every pixel ends here.
                let left = source[y * width + if x >= 2 { x - 2 } else { x + 2 }];
                if value <= HOT_RATIO * left.max(0.0) + HOT_OFFSET {
                    return None;
                }
                let mut others = [0f32; 8];
                let mut n = 0;
                for (a, &yy) in ys.iter().enumerate() {
                    for (b, &xx) in near(x, width).iter().enumerate() {
                        if (a, b) != (1, 1) {
                            others[n] = source[yy * width + xx];
                            n += 1;
                        }
                    }
                }
                others.sort_unstable_by(f32::total_cmp);
                (value > HOT_RATIO * others[7].max(0.0) + HOT_OFFSET)
                    .then_some((y * width + x, (others[3] + others[4]) / 2.0))
            })
        })
        .collect();
    for (k, value) in found {
        mosaic.data[k] = value;
    }
}
