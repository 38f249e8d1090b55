//! Where rows of views end, by the pictures: neighbours in a row differ by one step of the camera, the last view of a row
//! and the first of the next by many.

use std::path::Path;

use rayon::prelude::*;

use super::error::Error;
use super::image_file;

/// Side to which pictures are reduced, pixels.
/// Source: chosen; parallax of a pixel of a view of 512 remains visible.
const SIDE: usize = 256;
/// Most pictures that are compared.
/// Source: chosen.
const MOST: usize = 1024;
/// Jump at the ends of rows, of the usual difference, that confirms rows, and that finds others.
/// Source: chosen; 1.9 and more on the light fields of HCI.
const JUMP: [f64; 2] = [1.25, 1.5];
/// Least mean difference of neighbours, of the range 0..1: below it the pictures are all the same.
/// Source: chosen.
const SAME: f64 = 1e-3;

/// What the pictures say about rows of `columns` views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rows {
    /// Rows end there.
    Confirmed,
    /// Nothing: there is too little parallax.
    Unknown,
    /// Rows end after this many views; one row of all, if it is their number.
    Other(usize),
}

/// Compares the pictures `names` of `folder`, in the order of views.
pub(super) fn rows_of(folder: &Path, names: &[&str], columns: usize) -> Result<Rows, Error> {
    if columns < 2 || names.len() <= columns || names.len() > MOST {
        return Ok(Rows::Unknown);
    }
    // The first ends of rows settle it, nearly always.
    let ends: Vec<usize> = (1..4).map(|k| k * columns - 1).filter(|&k| k + 2 < names.len() && k >= 1).collect();
    let wanted: Vec<usize> = ends.iter().flat_map(|&k| [k - 1, k, k + 1, k + 2]).collect();
    let small = reduced(folder, names, &wanted)?;
    let step = |k: usize| difference(&small[k], &small[k + 1]);
    let (mut jumps, mut steps) = (0.0, 0.0);
    for &k in &ends {
        jumps += step(k);
        steps += 0.5 * (step(k - 1) + step(k + 1));
    }
    if !ends.is_empty() && jumps > JUMP[0] * steps && jumps > SAME * ends.len() as f64 {
        return Ok(Rows::Confirmed);
    }
    let all: Vec<usize> = (0..names.len()).collect();
    let small = reduced(folder, names, &all)?;
    let steps: Vec<f64> = small.windows(2).map(|w| difference(&w[0], &w[1])).collect();
    let far: Vec<f64> = (0..names.len() - columns).map(|k| difference(&small[k], &small[k + columns])).collect();
    let back: Vec<f64> = above_backwards(names.len(), columns).map(|(a, b)| difference(&small[a], &small[b])).collect();
    Ok(judge(&steps, &far, &back, columns))
}

/// Views and those that lie below them where every second row runs backwards.
fn above_backwards(count: usize, columns: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..count).map(move |k| (k, 2 * (k / columns + 1) * columns - 1 - k)).filter(move |&(_, below)| below < count)
}

/// By the differences of neighbours (`steps`), of views `columns` apart (`far`), and of those one above the other if
/// every second row runs backwards (`back`).
fn judge(steps: &[f64], far: &[f64], back: &[f64], columns: usize) -> Rows {
    let count = steps.len() + 1;
    // Mean jump at the ends of rows of `n` over the median of the other steps.
    let jump = |n: usize| {
        let (mut ends, mut others) = (Vec::new(), Vec::new());
        steps.iter().enumerate().for_each(|(k, &d)| if (k + 1) % n == 0 { ends.push(d) } else { others.push(d) });
        others.sort_unstable_by(f64::total_cmp);
        let usual = others.get(others.len() / 2).copied().unwrap_or(0.0);
        // The least of the jumps, so that single large differences do not count.
        let least = ends.iter().copied().fold(f64::INFINITY, f64::min);
        if ends.is_empty() || usual < SAME { 0.0 } else { least / usual }
    };
    let own = jump(columns);
    if own > JUMP[0] {
        return Rows::Confirmed;
    }
    // The shortest rows that explain the jumps: multiples of them explain some.
    let best = (2..count).find(|&n| jump(n) > JUMP[1]);
    if let Some(n) = best.filter(|&n| n != columns) {
        return Rows::Other(n);
    }
    let mean = |d: &[f64]| d.iter().sum::<f64>() / d.len().max(1) as f64;
    // In one long row views far apart differ by far, and no step is a jump.
    if mean(steps) > SAME && mean(far) > JUMP[1] * mean(steps) && own < 1.1 && own > 0.0 {
        return if mean(back) < JUMP[1] * mean(steps) { Rows::Confirmed } else { Rows::Other(count) };
    }
    Rows::Unknown
}

/// The pictures `wanted`, small and grey; the others empty.
fn reduced(folder: &Path, names: &[&str], wanted: &[usize]) -> Result<Vec<Vec<f32>>, Error> {
    let mut out = vec![Vec::new(); names.len()];
    let mut list = wanted.to_vec();
    list.sort_unstable();
    list.dedup();
    let found: Vec<Result<Vec<f32>, Error>> = list.par_iter().map(|&k| small_picture(&folder.join(names[k]))).collect();
    for (k, picture) in list.into_iter().zip(found) {
        out[k] = picture?;
    }
    Ok(out)
}

fn small_picture(path: &Path) -> Result<Vec<f32>, Error> {
    let picture = image_file::read_picture(path)?;
    let (height, width, channels) = picture.dim();
    let by = height.max(width).div_ceil(SIDE);
    let mut out = Vec::with_capacity((height / by + 1) * (width / by + 1));
    for t in (0..height).step_by(by) {
        for s in (0..width).step_by(by) {
            let block = picture.slice(ndarray::s![t..(t + by).min(height), s..(s + by).min(width), ..]);
            out.push(block.sum() / (block.len() / channels.max(1)).max(1) as f32 / channels.max(1) as f32);
        }
    }
    Ok(out)
}

/// Mean absolute difference; 0 of pictures of different sizes, which reading refuses.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    if a.len() != b.len() || a.is_empty() {
        return 0.0;
    }
    a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>() / a.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Differences of views of a grid of `columns`, of which `count` are there from `first` on.
    fn of(columns: usize, first: usize, count: usize, assumed: usize, noise: f64) -> Rows {
        judged(|k| (((first + k) / columns) as f64, ((first + k) % columns) as f64), count, assumed, noise)
    }

    fn judged(place: impl Fn(usize) -> (f64, f64), count: usize, assumed: usize, noise: f64) -> Rows {
        let d = |a: usize, b: usize| {
            let ((r, c), (q, e)) = (place(a), place(b));
            // Differences grow with distance, and saturate.
            let far = (r - q).hypot(c - e);
            0.02 * far / (1.0 + 0.2 * far) + noise
        };
        let steps: Vec<f64> = (0..count - 1).map(|k| d(k, k + 1)).collect();
        let far: Vec<f64> = (0..count - assumed).map(|k| d(k, k + assumed)).collect();
        let back: Vec<f64> = above_backwards(count, assumed).map(|(a, b)| d(a, b)).collect();
        judge(&steps, &far, &back, assumed)
    }

    #[test]
    fn rows_end_where_views_jump() {
        assert_eq!(of(9, 0, 81, 9, 0.002), Rows::Confirmed);
        assert_eq!(of(3, 0, 9, 3, 0.002), Rows::Confirmed);
        assert_eq!(of(9, 0, 64, 8, 0.002), Rows::Other(9));
        assert_eq!(of(9, 36, 9, 3, 0.002), Rows::Other(9), "a middle row of nine");
        assert_eq!(of(9, 0, 81, 9, 10.0), Rows::Unknown, "noise alone");
        let back_and_forth =
            |k: usize| ((k / 7) as f64, if (k / 7).is_multiple_of(2) { k % 7 } else { 6 - k % 7 } as f64);
        assert_eq!(judged(back_and_forth, 49, 7, 0.002), Rows::Confirmed, "every second row backwards");
        assert_eq!(of(49, 0, 49, 7, 0.002), Rows::Other(49), "one row");
    }
}
