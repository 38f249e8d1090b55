//! A small feed-forward network in place of a sparse code: features of the low image, and of other images of the same view
//! beside it, to the residual patch. What a code and Dh do with one layer of soft thresholds, it does with several of
//! rectified ones, fitted to the residual itself; and it can weigh two images of one thing against each other.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use ndarray::{Array1, Array2, ArrayView2, s};

use super::features::windows;
use super::{Error, Interpolation, limits};

/// One layer: `weights`·x + `bias`, and what is negative becomes 0 but in the last.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Outputs × inputs.
    pub weights: Array2<f32>,
    /// Outputs.
    pub bias: Array1<f32>,
}

/// A network that foretells residual patches.
///
/// Features `f`: of the low image's window as in [`super::Pass`]; of each image beside it, filters of its difference to the low
/// image. The first layer sees `f/n` and ln `n`, `n = max(‖f‖, floor)`; the last one's outputs times `n` are the residual.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Side of the windows (odd), pixels.
    pub support: usize,
    /// Which images of the view stand beside the low one.
    pub beside: Vec<Interpolation>,
    /// How many rows of `filters` belong to the low image, then to each image beside it.
    pub shares: Vec<usize>,
    /// Feature filters, m × support²; those of the low image sum to zero.
    pub filters: Array2<f32>,
    /// Smallest norm a feature vector is divided by.
    pub floor: f32,
    /// At least one; the first has m + 1 inputs, the last patch² outputs.
    pub layers: Vec<Layer>,
}

impl Network {
    /// Side of the residual patch, pixels.
    #[must_use]
    pub fn patch(&self) -> usize {
        self.layers.last().map_or(0, |l| l.bias.len()).isqrt()
    }

    /// Checks that shapes fit and numbers are finite.
    ///
    /// # Errors
    /// [`Error::Parameter`] with what is wrong.
    pub fn check(&self) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::Parameter(format!("network: {what}")));
        let m = self.filters.nrows();
        if self.support > limits::SIDE || self.support.is_multiple_of(2) {
            return wrong(format!("a window of {} pixels", self.support));
        }
        if m == 0 || m > limits::FEATURES || self.filters.ncols() != self.support * self.support {
            return wrong(format!("feature filters have shape {:?}", self.filters.dim()));
        }
        if self.shares.len() != self.beside.len() + 1 || self.shares.iter().sum::<usize>() != m {
            return wrong(format!("{m} filters of {} images are shared as {:?}", self.beside.len() + 1, self.shares));
        }
        if self.beside.iter().any(|b| !matches!(b, Interpolation::Barycentric | Interpolation::Cubic)) {
            return wrong("only interpolations of the view's own samples can stand beside it".into());
        }
        let patch = self.patch();
        let outputs = self.layers.last().map_or(0, |l| l.bias.len());
        if patch.is_multiple_of(2) || patch > self.support || patch * patch != outputs {
            return wrong(format!("{outputs} outputs are no patch"));
        }
        let mut inputs = m + 1;
        for layer in &self.layers {
            let rows = layer.bias.len();
            if layer.weights.dim() != (rows, inputs) || rows == 0 || rows > limits::ATOMS {
                return wrong(format!("a layer of shape {:?} where {inputs} inputs come", layer.weights.dim()));
            }
            inputs = rows;
        }
        let mut values = self.layers.iter().flat_map(|l| l.weights.iter().chain(&l.bias)).chain(&self.filters);
        if !(values.all(|v| v.is_finite()) && self.floor > 0.0 && self.floor.is_finite()) {
            return wrong("a value is not finite".into());
        }
        Ok(())
    }

    /// Features (n×m) of the windows at `corners` of padded planes: the low image, then the differences of those beside it.
    /// `scratch` is reused between calls.
    #[must_use]
    pub fn features(&self, padded: &[Array2<f32>], corners: &[(usize, usize)], scratch: &mut Vec<f32>) -> Array2<f32> {
        extract_beside(padded, self.support, &self.filters, &self.shares, corners, scratch)
    }

    /// Residual patches (n×patch²) of features (n×m).
    #[must_use]
    pub fn residuals(&self, features: &Array2<f32>) -> Array2<f32> {
        let (mut x, norms) = inputs(features, self.floor);
        let last = self.layers.len().saturating_sub(1);
        for (k, layer) in self.layers.iter().enumerate() {
            x = forward(layer, &x, k < last);
        }
        for (mut row, n) in x.rows_mut().into_iter().zip(&norms) {
            row *= *n;
        }
        x
    }
}

/// [`super::extract`] for several planes: the first `shares[0]` filters see the first plane, and so on.
///
/// # Panics
/// When a window leaves its plane.
#[must_use]
pub fn extract_beside(
    padded: &[Array2<f32>],
    support: usize,
    filters: &Array2<f32>,
    shares: &[usize],
    corners: &[(usize, usize)],
    scratch: &mut Vec<f32>,
) -> Array2<f32> {
    let (n, m, s2) = (corners.len(), filters.nrows(), support * support);
    let mut out = Array2::<f32>::zeros((n, m));
    let filters = filters.as_standard_layout();
    let (Some(f), Some(o)) = (filters.as_slice(), out.as_slice_mut()) else { return out };
    let mut first = 0;
    for (plane, &share) in padded.iter().zip(shares) {
        windows(plane, support, corners, scratch);
        let columns = MatMut::from_row_major_slice_mut(o, n, m).subcols_mut(first, share);
        let rows = MatRef::from_row_major_slice(&f[first * s2..(first + share) * s2], share, s2);
        let windows = MatRef::from_row_major_slice(scratch.as_slice(), n, s2);
        matmul(columns, Accum::Replace, windows, rows.transpose(), 1.0, Par::Seq);
        first += share;
    }
    out
}

/// What the first layer sees of features: unit vectors and the logarithm of their norms, both as if no norm were below
/// `floor` (n×(m+1)); and the norms.
#[must_use]
pub fn inputs(features: &Array2<f32>, floor: f32) -> (Array2<f32>, Vec<f32>) {
    let m = features.ncols();
    let norms: Vec<f32> = features.rows().into_iter().map(|f| f.dot(&f).sqrt()).collect();
    let mut x = Array2::zeros((features.nrows(), m + 1));
    for ((mut x, f), norm) in x.rows_mut().into_iter().zip(features.rows()).zip(&norms) {
        let n = norm.max(floor);
        x.slice_mut(s![..m]).zip_mut_with(&f, |x, f| *x = f / n);
        x[m] = n.ln();
    }
    (x, norms)
}

/// What a layer makes of its inputs (n×inputs), rectified where it is not the last.
#[must_use]
pub fn forward(layer: &Layer, x: &Array2<f32>, rectified: bool) -> Array2<f32> {
    let mut out = product(x.view(), layer.weights.t());
    for mut row in out.rows_mut() {
        row += &layer.bias;
        if rectified {
            row.mapv_inplace(|v| v.max(0.0));
        }
    }
    out
}

/// a·b on this thread.
#[must_use]
pub fn product(a: ArrayView2<'_, f32>, b: ArrayView2<'_, f32>) -> Array2<f32> {
    let ((n, k), m) = (a.dim(), b.ncols());
    let mut out = Array2::<f32>::zeros((n, m));
    // Rows are contiguous in one of the two orders, whichever way the matrix was turned.
    let (a, b) = (Plain::of(a), Plain::of(b));
    if let Some(o) = out.as_slice_mut() {
        let out = MatMut::from_row_major_slice_mut(o, n, m);
        matmul(out, Accum::Replace, a.matrix(n, k), b.matrix(k, m), 1.0, Par::Seq);
    }
    out
}

/// The values of a matrix in rows, or in columns where it stands on its side.
enum Plain<'a> {
    Rows(std::borrow::Cow<'a, [f32]>),
    Columns(&'a [f32]),
}

impl<'a> Plain<'a> {
    fn of(a: ArrayView2<'a, f32>) -> Plain<'a> {
        if let Some(rows) = a.to_slice() {
            return Plain::Rows(rows.into());
        }
        match a.reversed_axes().to_slice() {
            Some(columns) => Plain::Columns(columns),
            None => Plain::Rows(a.iter().copied().collect::<Vec<f32>>().into()),
        }
    }

    fn matrix(&self, rows: usize, columns: usize) -> MatRef<'_, f32> {
        match self {
            Plain::Rows(values) => MatRef::from_row_major_slice(values, rows, columns),
            Plain::Columns(values) => MatRef::from_column_major_slice(values, rows, columns),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::pad;
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// A network of random numbers: `beside` images, one hidden layer.
    pub(crate) fn random(seed: u64, beside: &[Interpolation]) -> Network {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut random = |r, c| Array2::from_shape_fn((r, c), |_| rng.random::<f32>() - 0.5);
        let shares: Vec<usize> = (0..=beside.len()).map(|i| 5 - i).collect();
        let m = shares.iter().sum();
        let mut filters = random(m, 49);
        filters.rows_mut().into_iter().take(shares[0]).for_each(|mut r| {
            let mean = r.sum() / 49.0;
            r -= mean;
        });
        let layer = |weights: Array2<f32>, bias: Array2<f32>| Layer { weights, bias: bias.row(0).to_owned() };
        let layers = vec![layer(random(7, m + 1), random(1, 7)), layer(random(9, 7), random(1, 9))];
        Network { support: 7, beside: beside.to_vec(), shares, filters, floor: 0.05, layers }
    }

    /// The definition for one place, in f64.
    fn plain(network: &Network, planes: &[Array2<f32>], corner: (usize, usize)) -> Vec<f64> {
        let mut f = Vec::new();
        let mut row = 0;
        for (plane, &share) in planes.iter().zip(&network.shares) {
            for r in row..row + share {
                let value = |j: usize| f64::from(plane[[corner.0 + j / 7, corner.1 + j % 7]]);
                f.push((0..49).map(|j| f64::from(network.filters[[r, j]]) * value(j)).sum::<f64>());
            }
            row += share;
        }
        let norm = f.iter().map(|v| v * v).sum::<f64>().sqrt();
        let n = norm.max(network.floor.into());
        let mut x: Vec<f64> = f.iter().map(|v| v / n).chain([n.ln()]).collect();
        for (k, layer) in network.layers.iter().enumerate() {
            let rows = layer.weights.rows().into_iter().zip(&layer.bias);
            x = rows
                .map(|(w, b)| w.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>() + f64::from(*b))
                .map(|v| if k + 1 < network.layers.len() { v.max(0.0) } else { v })
                .collect();
        }
        x.into_iter().map(|v| v * norm).collect()
    }

    #[test]
    fn it_equals_its_definition() {
        let plane = |k: usize| Array2::from_shape_fn((12, 15), |(y, x)| ((y * 31 + x * (17 + k)) % 23) as f32 / 23.0);
        for beside in [&[][..], &[Interpolation::Cubic], &[Interpolation::Barycentric, Interpolation::Cubic]] {
            let network = random(3, beside);
            network.check().unwrap();
            let padded: Vec<Array2<f32>> = (0..=beside.len()).map(|k| pad(plane(k).view(), 3)).collect();
            let corners: Vec<_> = (0..12).flat_map(|y| (0..15).map(move |x| (y, x))).collect();
            let found = network.residuals(&network.features(&padded, &corners, &mut Vec::new()));
            for (row, &corner) in found.rows().into_iter().zip(&corners) {
                for (a, b) in row.iter().zip(plain(&network, &padded, corner)) {
                    assert!((f64::from(*a) - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn products_of_turned_matrices() {
        let a = Array2::from_shape_fn((4, 6), |(i, j)| (i * 6 + j) as f32);
        let b = Array2::from_shape_fn((5, 6), |(i, j)| (i + 2 * j) as f32);
        assert_eq!(product(a.view(), b.t()), a.dot(&b.t()));
        assert_eq!(product(b.view(), a.t()), b.dot(&a.t()));
        let part = a.slice(ndarray::s![.., ..;2]);
        assert_eq!(product(part.t(), part), part.t().dot(&part));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let good = random(1, &[Interpolation::Cubic]);
        let wrong = |change: &dyn Fn(&mut Network)| {
            let mut bad = good.clone();
            change(&mut bad);
            bad.check().unwrap_err().to_string()
        };
        assert!(wrong(&|n| n.shares[0] += 1).contains("shared"));
        assert!(wrong(&|n| n.beside[0] = Interpolation::Multiview).contains("own samples"));
        assert!(wrong(&|n| n.layers[0].bias[0] = f32::NAN).contains("finite"));
        assert!(wrong(&|n| n.layers.truncate(1)).contains("patch"));
        assert!(wrong(&|n| n.support = 8).contains("window"));
        assert!(wrong(&|n| n.layers[1].weights = Array2::zeros((9, 8))).contains("layer"));
    }
}
