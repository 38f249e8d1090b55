//! Overlapping patches of a plane: taken out one a row, and put back averaged (paper section 4.4).

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use super::{Error, check_size};

/// Where patches of `size` start along a side of `len`, every `step`, the last one flush with the end.
///
/// # Errors
/// A size of 0 or larger than the side, a step of 0.
pub fn starts(len: usize, size: usize, step: usize) -> Result<Vec<usize>, Error> {
    if size == 0 || size > len || step == 0 {
        return Err(Error::Parameter(format!("patches of {size} every {step} pixels do not fit a side of {len}")));
    }
    let last = len - size;
    let mut starts: Vec<usize> = (0..=last).step_by(step).collect();
    if starts.last() != Some(&last) {
        starts.push(last);
    }
    Ok(starts)
}

/// Top left corners (y, x) of all patches of a `height`×`width` plane, row by row.
///
/// # Errors
/// As [`starts`].
pub fn corners(height: usize, width: usize, size: usize, step: usize) -> Result<Vec<[usize; 2]>, Error> {
    let (ys, xs) = (starts(height, size, step)?, starts(width, size, step)?);
    Ok(ys.iter().flat_map(|&y| xs.iter().map(move |&x| [y, x])).collect())
}

/// Takes the patches at `corners` out of `plane`: one patch a row, its pixels row by row.
///
/// # Errors
/// A corner whose patch leaves the plane.
pub fn extract(plane: ArrayView2<'_, f32>, size: usize, corners: &[[usize; 2]]) -> Result<Array2<f32>, Error> {
    let (height, width) = plane.dim();
    fits(height, width, size, corners)?;
    let mut out = Array2::zeros((corners.len(), size * size));
    if let Some(flat) = out.as_slice_mut()
        && size > 0
    {
        flat.par_chunks_mut(size * size).zip(corners.par_iter()).for_each(|(patch, &[y, x])| {
            for (dy, row) in patch.chunks_exact_mut(size).enumerate() {
                for (dx, p) in row.iter_mut().enumerate() {
                    *p = plane[[y + dy, x + dx]];
                }
            }
        });
    }
    Ok(out)
}

/// Averages overlapping patches (one a row) into a `height`×`width` plane. `window` (size², > 0) weighs the pixels of a
/// patch; without it all count the same. Pixels no patch covers are NaN, for the caller to fill knowingly.
///
/// The sum at a pixel runs over the patches in the order given, whatever the number of threads.
///
/// # Errors
/// A corner whose patch leaves the plane, shapes that do not fit, a window with a value that is not above zero.
pub fn overlap_add(
    patches: ArrayView2<'_, f32>,
    size: usize,
    corners: &[[usize; 2]],
    height: usize,
    width: usize,
    window: Option<&[f32]>,
) -> Result<Array2<f32>, Error> {
    check_size("plane", width, height)?;
    fits(height, width, size, corners)?;
    let area = size * size;
    if patches.dim() != (corners.len(), area) {
        return Err(Error::Shape(format!("{:?} values for {} patches of {size}x{size}", patches.dim(), corners.len())));
    }
    if window.is_some_and(|w| w.len() != area || !w.iter().all(|&w| w > 0.0 && w.is_finite())) {
        return Err(Error::Parameter(format!("a window needs {area} weights above zero")));
    }
    let mut out = Array2::from_elem((height, width), f32::NAN);
    if size == 0 {
        return Ok(out);
    }
    const BAND: usize = 32;
    let mut bucket: Vec<Vec<u32>> = vec![Vec::new(); height.div_ceil(BAND)];
    for (n, c) in corners.iter().enumerate() {
        for list in &mut bucket[c[0] / BAND..=(c[0] + size - 1) / BAND] {
            list.push(n as u32);
        }
    }
    let Some(flat) = out.as_slice_mut() else { return Ok(out) };
    flat.par_chunks_mut(width * BAND).zip(bucket.into_par_iter()).enumerate().for_each(|(band, (rows, list))| {
        let first = band * BAND;
        let count = rows.len() / width;
        let mut sums = vec![0f64; rows.len()];
        let mut weights = vec![0f64; rows.len()];
        for n in list {
            let [y, x] = corners[n as usize];
            let patch = patches.row(n as usize);
            for dy in 0..size {
                if y + dy < first || y + dy >= first + count {
                    continue;
                }
                let start = (y + dy - first) * width + x;
                for dx in 0..size {
                    let k = dy * size + dx;
                    let w = window.map_or(1.0, |w| f64::from(w[k]));
                    sums[start + dx] += w * f64::from(patch[k]);
                    weights[start + dx] += w;
                }
            }
        }
        for ((o, s), w) in rows.iter_mut().zip(&sums).zip(&weights) {
            if *w > 0.0 {
                *o = (s / w) as f32;
            }
        }
    });
    Ok(out)
}

fn fits(height: usize, width: usize, size: usize, corners: &[[usize; 2]]) -> Result<(), Error> {
    let inside = |c: &[usize; 2]| {
        c[0].checked_add(size).is_some_and(|b| b <= height) && c[1].checked_add(size).is_some_and(|r| r <= width)
    };
    match corners.iter().find(|c| !inside(c)) {
        None if size <= 4096 && u32::try_from(corners.len()).is_ok() => Ok(()),
        None => Err(Error::Parameter(format!("{} patches of {size}x{size} are out of range", corners.len()))),
        Some(c) => Err(Error::Shape(format!("the {size}x{size} patch at {c:?} leaves the {height}x{width} plane"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_taken_out_goes_back(height in 5usize..70, width in 5usize..40, size in 1usize..6, step in 1usize..9,
                                       windowed: bool) {
            let plane = Array2::from_shape_fn((height, width), |(y, x)| ((y * 31 + x * 17) % 23) as f32 - 11.0);
            let corners = corners(height, width, size, step).unwrap();
            let patches = extract(plane.view(), size, &corners).unwrap();
            let window: Vec<f32> = (0..size * size).map(|k| 1.0 + k as f32).collect();
            let back = overlap_add(patches.view(), size, &corners, height, width, windowed.then_some(&window[..])).unwrap();
            for (a, b) in back.iter().zip(&plane) {
                let same = (a - b).abs() < 1e-4;
                prop_assert!(same || (step > size && a.is_nan()));
            }
        }
    }

    #[test]
    fn an_average_is_an_average() {
        let patches = ndarray::array![[1.0f32, 1.0, 1.0, 1.0], [3.0, 3.0, 3.0, 3.0]];
        let out = overlap_add(patches.view(), 2, &[[0, 0], [0, 1]], 2, 3, None).unwrap();
        assert_eq!(out, ndarray::array![[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]);
    }

    #[test]
    fn bad_input_is_an_error() {
        let plane = Array2::<f32>::zeros((4, 4));
        assert!(starts(4, 5, 1).is_err() && starts(4, 0, 1).is_err() && starts(4, 2, 0).is_err());
        assert!(extract(plane.view(), 3, &[[2, 0]]).is_err());
        assert!(extract(plane.view(), 3, &[[usize::MAX, 0]]).is_err());
        let patches = Array2::<f32>::zeros((1, 4));
        assert!(overlap_add(patches.view(), 2, &[[0, 0]], 0, 4, None).is_err());
        assert!(overlap_add(patches.view(), 2, &[], 4, 4, None).is_err());
        assert!(overlap_add(patches.view(), 2, &[[0, 0]], 4, 4, Some(&[1.0, 0.0, 1.0, 1.0])).is_err());
    }
}
