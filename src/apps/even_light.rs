//! Views of unequal light: dim ones brightened to the others, dark and absent ones replaced or left out.

use lenslet_core::lightfield::LightField;
use lenslet_views::disparity::{DepthOrder, ViewLight, carry_to_view};
use ndarray::{Array2, s};

use super::viewpoint::sample_shifted;

/// Brings the dim views of a light field in linear light to the light of the others; the weight (v, u) of each view, 0
/// for those that are dark or absent.
///
/// ```
/// use lenslet::apps::even_out_light;
/// use lenslet::lightfield::{ColourSpace, LightField, Meta};
/// use ndarray::Array5;
///
/// let meta = Meta::new([1, 3], [16, 16], 1, ColourSpace::Linear);
/// let data = Array5::from_shape_fn((1, 3, 16, 16, 1), |(_, u, ..)| [0.5, 0.5, 0.4][u]);
/// let mut field = LightField { meta, data };
/// let weights = even_out_light(&mut field);
/// assert!((field.data[[0, 2, 3, 3, 0]] - 0.5).abs() < 1e-3 && weights[[0, 2]] < 1.0);
/// ```
pub fn even_out_light(field: &mut LightField) -> Array2<f32> {
    let (rows, columns, ..) = field.data.dim();
    let light = ViewLight::of(&field.data.view(), true, field.meta.weights.as_deref());
    for (k, &gain) in light.gains.iter().enumerate().filter(|(_, g)| **g != 1.0) {
        field.data.slice_mut(s![k / columns, k % columns, .., .., ..]).mapv_inplace(|x| gain * x);
    }
    Array2::from_shape_fn((rows, columns), |(v, u)| light.weights[v * columns + u])
}

/// Replaces the views of weight 0 by the middle view, every pixel of it moved by its disparity: for what shows single
/// views.
pub fn fill_dark_views(field: &mut LightField, weights: &Array2<f32>, disparity: &Array2<f32>, order: DepthOrder) {
    let (rows, columns) = weights.dim();
    let middle = field.data.slice(s![rows / 2, columns / 2, .., .., ..]).to_owned();
    if disparity.dim() != (middle.dim().0, middle.dim().1) {
        return;
    }
    for ((v, u), _) in weights.indexed_iter().filter(|(_, w)| **w <= 0.0) {
        let step = [u as f32 - (columns / 2) as f32, v as f32 - (rows / 2) as f32];
        let map = carry_to_view(disparity, step, order);
        field.data.slice_mut(s![v, u, .., .., ..]).assign(&sample_shifted(&middle.view(), &map, step));
    }
}

#[cfg(test)]
mod tests {
    use lenslet_core::lightfield::{ColourSpace, Meta};
    use ndarray::Array5;

    use super::*;

    #[test]
    fn a_black_view_is_filled_from_the_middle_one() {
        let whole = Array5::from_shape_fn((3, 3, 30, 40, 1), |(v, u, t, s, _)| {
            let (x, y) = (s as f32 - (u as f32 - 1.0), t as f32 - (v as f32 - 1.0));
            0.5 + 0.2 * (0.4 * x).sin() + 0.2 * (0.3 * y).cos()
        });
        let mut field = LightField { meta: Meta::new([3, 3], [30, 40], 1, ColourSpace::Linear), data: whole.clone() };
        field.data.slice_mut(s![0, 2, .., .., ..]).fill(0.0);
        let weights = even_out_light(&mut field);
        assert_eq!((weights[[0, 2]], weights.sum()), (0.0, 8.0));
        fill_dark_views(&mut field, &weights, &Array2::from_elem((30, 40), 1.0), DepthOrder::NearerIsSmaller);
        let off = &field.data.slice(s![0, 2, 2..28, 2..38, ..]) - &whole.slice(s![0, 2, 2..28, 2..38, ..]);
        assert!(off.iter().all(|d| d.abs() < 0.01));
    }
}
