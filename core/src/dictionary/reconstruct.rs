//! Learned reconstruction of a plane (paper section 4.4, eq. (4)): code every overlapping patch of the low image with Dl,
//! substitute Dh, add the weighted mean of the residuals. The anchored path replaces the code by a regressor.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use super::{Anchored, Error, Interpolation, Model, Network, Pass, extract, pad};
use crate::sparse;

/// How the residual of a patch is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// LASSO code of eq. (4), then Dh.
    Lasso,
    /// The regressor of the nearest anchor; passes without anchors use the LASSO code.
    Anchored,
    /// One ridge regressor for all patches.
    Linear,
    /// The network; passes without one, or without the images that it wants beside the low one, use the LASSO code.
    Network,
}

/// Options of reconstruction.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How residuals are found.
    pub path: Path,
    /// Pixels between patches, 1 to the patch's side (that of the network's patches where it is used).
    pub step: usize,
    /// Standard deviation of the Gaussian that weighs a patch's pixels, as a fraction of its side; infinite = all the same.
    pub spread: f32,
    /// Patches whose features have a smaller norm stay as they are in the low image.
    pub flat: f32,
    /// λ instead of the trained one.
    pub lambda: Option<f32>,
    /// Averages the results of this many mirrored copies of the plane: 1, 2 (turned by half) or 4 (also mirrored).
    pub ensemble: usize,
    /// Use only this many passes.
    pub passes: Option<usize>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            path: Path::Lasso,
            step: 2,
            spread: f32::INFINITY,
            flat: 0.0,
            lambda: None,
            ensemble: 1,
            passes: None,
        }
    }
}

/// Rows of patches that are solved together; the result does not depend on it beyond the grouping of float sums, which
/// is why it is fixed.
const BAND: usize = 8;

/// A model made ready for use.
#[derive(Debug, Clone)]
pub struct Reconstructor {
    model: Model,
    solvers: Vec<Option<sparse::Prepared>>,
    options: Options,
}

impl Reconstructor {
    /// Prepares a model.
    ///
    /// # Errors
    /// Options out of range, or atoms that the solver refuses.
    pub fn new(model: &Model, options: &Options) -> Result<Self, Error> {
        let mut model = model.clone();
        if let Some(n) = options.passes {
            model.passes.truncate(n.max(1));
        }
        let wrong = |what: String| Err(Error::Parameter(what));
        if !matches!(options.ensemble, 1 | 2 | 4) {
            return wrong(format!("an ensemble of {} copies: 1, 2 or 4", options.ensemble));
        }
        if !(options.spread > 0.01 && options.flat >= 0.0) || options.lambda.is_some_and(|l| !(0.0..=1.0).contains(&l))
        {
            return wrong("spread, flatness or λ is out of range".into());
        }
        let mut solvers = Vec::new();
        for pass in &model.passes {
            let patch = match (options.path, &pass.network) {
                (Path::Network, Some(network)) => network.patch().min(pass.patch),
                _ => pass.patch,
            };
            if options.step == 0 || options.step > patch {
                return wrong(format!("a step of {} pixels between patches of {patch}", options.step));
            }
            let needed = match options.path {
                Path::Lasso | Path::Network => true,
                Path::Anchored => pass.anchored.is_none(),
                Path::Linear => false,
            };
            solvers.push(if needed { Some(sparse::prepare(pass.low.view())?) } else { None });
        }
        Ok(Reconstructor { model, solvers, options: options.clone() })
    }

    /// The model in use.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Reconstructs a plane (t, s) of luminance, sRGB-encoded, 0..1. The result is not clamped.
    ///
    /// Values that are not finite count as 0. Memory: about ten planes.
    ///
    /// # Errors
    /// Only what the sparse solver reports.
    pub fn plane(&self, low: ArrayView2<'_, f32>) -> Result<Array2<f32>, Error> {
        self.plane_beside(low, &[])
    }

    /// The images that the network in use wants beside the low one; none where the path is another.
    #[must_use]
    pub fn beside(&self) -> &[Interpolation] {
        if self.options.path != Path::Network {
            return &[];
        }
        let network = self.model.passes.iter().find_map(|p| p.network.as_ref());
        network.map_or(&[], |n| &n.beside)
    }

    /// [`Reconstructor::plane`] with other images of the same view beside the low one, in the order of
    /// [`Reconstructor::beside`].
    ///
    /// # Errors
    /// As [`Reconstructor::plane`]; images of another size.
    pub fn plane_beside(&self, low: ArrayView2<'_, f32>, beside: &[Array2<f32>]) -> Result<Array2<f32>, Error> {
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        let low = low.mapv(finite);
        if low.is_empty() {
            return Ok(low);
        }
        if let Some(other) = beside.iter().find(|b| b.dim() != low.dim()) {
            return Err(Error::Parameter(format!("an image of {:?} beside one of {:?}", other.dim(), low.dim())));
        }
        let mut sum = Array2::<f32>::zeros(low.dim());
        for copy in 0..self.options.ensemble {
            let mut view = low.view();
            // The lattice maps to itself under these (but for its small rotation), so the training fits the copies too.
            let (down, across) = ([1, -1, -1, 1][copy], [1, -1, 1, -1][copy]);
            let turn = |v: &mut ArrayView2<'_, f32>| {
                v.invert_axis_if(0, down < 0);
                v.invert_axis_if(1, across < 0);
            };
            turn(&mut view);
            let mut current = view.as_standard_layout().into_owned();
            let turned = |b: &Array2<f32>| {
                let mut view = b.view();
                turn(&mut view);
                view.mapv(finite)
            };
            let beside: Vec<Array2<f32>> = beside.iter().map(turned).collect();
            for (pass, solver) in self.model.passes.iter().zip(&self.solvers) {
                current = self.pass(pass, solver.as_ref(), &current, &beside)?;
            }
            let mut result = current.view();
            turn(&mut result);
            sum += &result;
        }
        if self.options.ensemble > 1 {
            sum /= self.options.ensemble as f32;
        }
        Ok(sum)
    }

    fn pass(
        &self,
        pass: &Pass,
        solver: Option<&sparse::Prepared>,
        low: &Array2<f32>,
        beside: &[Array2<f32>],
    ) -> Result<Array2<f32>, Error> {
        let (h, w) = low.dim();
        let wanted = |n: &&Network| self.options.path == Path::Network && n.beside.len() <= beside.len();
        let network = pass.network.as_ref().filter(wanted);
        let (side, support) = network.map_or((pass.patch, pass.support), |n| (n.patch(), n.support));
        let (step, margin, r) = (self.options.step, support / 2, side / 2);
        let mut padded = vec![pad(low.view(), margin)];
        if let Some(network) = network {
            padded.extend(beside[..network.beside.len()].iter().map(|b| pad((b - low).view(), margin)));
        }
        let places = |n: usize| -> Vec<usize> {
            let mut p: Vec<usize> = (0..n).step_by(step).collect();
            if p.last() != Some(&(n - 1)) {
                p.push(n - 1);
            }
            p
        };
        let (ys, xs) = (places(h), places(w));
        let weights = window(side, self.options.spread);
        let bands: Vec<&[usize]> = ys.chunks(BAND).collect();
        let mut sums = low.mapv(|_| 0.0f32);
        let mut totals = sums.clone();
        // Bands in groups, so that only a few partial planes exist at a time; added in order.
        for group in bands.chunks(2 * rayon::current_num_threads().max(1)) {
            let parts: Vec<Result<Part, Error>> = group
                .par_iter()
                .map(|rows| {
                    let corners: Vec<(usize, usize)> =
                        rows.iter().flat_map(|&y| xs.iter().map(move |&x| (y, x))).collect();
                    let patches = match network {
                        Some(n) => n.residuals(&n.features(&padded, &corners, &mut Vec::new())),
                        None => {
                            let features = extract(&padded[0], support, &pass.filters, &corners, &mut Vec::new());
                            self.patches(pass, solver, &features)?
                        }
                    };
                    let first = rows[0].saturating_sub(r);
                    let last = (rows[rows.len() - 1] + r + 1).min(h);
                    let mut part = Part {
                        first,
                        sums: Array2::zeros((last - first, w)),
                        totals: Array2::zeros((last - first, w)),
                    };
                    part.add(side, &weights, &patches, &corners);
                    Ok(part)
                })
                .collect();
            for part in parts {
                let part = part?;
                let rows = part.first..part.first + part.sums.nrows();
                let mut target = sums.slice_mut(ndarray::s![rows.clone(), ..]);
                target += &part.sums;
                let mut target = totals.slice_mut(ndarray::s![rows, ..]);
                target += &part.totals;
            }
        }
        // Every pixel is covered: patches stand on every row and column multiple of the step and on the last ones.
        ndarray::Zip::from(&mut sums).and(&totals).and(low).for_each(|s, &t, &l| *s = l + *s / t);
        Ok(sums)
    }

    fn patches(
        &self,
        pass: &Pass,
        solver: Option<&sparse::Prepared>,
        features: &Array2<f32>,
    ) -> Result<Array2<f32>, Error> {
        match (self.options.path, &pass.anchored, solver) {
            (Path::Linear, _, _) | (Path::Anchored, None, None) => Ok(features.dot(&pass.linear)),
            (Path::Anchored, Some(anchored), _) => Ok(regress(anchored, features, self.options.flat)),
            (_, _, Some(solver)) => {
                let lambda = self.options.lambda.unwrap_or(pass.lambda);
                lasso(pass, solver, features, lambda, self.options.flat)
            }
            (Path::Lasso | Path::Network, _, None) => Err(Error::Parameter("the dictionary was not prepared".into())),
        }
    }
}

trait InvertIf {
    fn invert_axis_if(&mut self, axis: usize, yes: bool);
}

impl InvertIf for ArrayView2<'_, f32> {
    fn invert_axis_if(&mut self, axis: usize, yes: bool) {
        if yes {
            self.invert_axis(ndarray::Axis(axis));
        }
    }
}

/// The rows of the result that one band of patches touches.
struct Part {
    first: usize,
    sums: Array2<f32>,
    totals: Array2<f32>,
}

impl Part {
    /// Adds patches centred at `centres`, cut off at the plane's borders.
    fn add(&mut self, patch: usize, weights: &[f32], patches: &Array2<f32>, centres: &[(usize, usize)]) {
        let (rows, w) = self.sums.dim();
        let r = patch / 2;
        let (Some(sums), Some(totals)) = (self.sums.as_slice_mut(), self.totals.as_slice_mut()) else { return };
        let Some(values) = patches.as_slice() else { return };
        for (values, &(y, x)) in values.chunks_exact(patch * patch).zip(centres) {
            let (left, right) = (r.saturating_sub(x), patch.min(w + r - x));
            for dy in 0..patch {
                let Some(row) = (y + dy).checked_sub(r + self.first).filter(|&row| row < rows) else { continue };
                let at = row * w + x + left - r;
                let n = right - left;
                let from = dy * patch + left;
                let target = sums[at..at + n].iter_mut().zip(&mut totals[at..at + n]);
                for ((s, t), (v, k)) in target.zip(values[from..from + n].iter().zip(&weights[from..from + n])) {
                    *s += k * v;
                    *t += k;
                }
            }
        }
    }
}

fn window(patch: usize, spread: f32) -> Vec<f32> {
    let r = (patch / 2) as f32;
    let scale = if spread.is_finite() { 0.5 / (spread * patch as f32).powi(2) } else { 0.0 };
    let square = |i: usize| (i as f32 - r).powi(2);
    (0..patch * patch).map(|i| (-(square(i / patch) + square(i % patch)) * scale).exp().max(1e-6)).collect()
}

fn norms(features: &Array2<f32>) -> Vec<f32> {
    features.rows().into_iter().map(|f| f.dot(&f).sqrt()).collect()
}

fn lasso(
    pass: &Pass,
    solver: &sparse::Prepared,
    features: &Array2<f32>,
    lambda: f32,
    flat: f32,
) -> Result<Array2<f32>, Error> {
    let norms = norms(features);
    // Flat patches code to nothing: |Dl y| ≤ ‖y‖ ≤ λ there, so the solver need not see them.
    let least = (lambda * pass.floor).max(flat);
    let kept: Vec<usize> = (0..norms.len()).filter(|&n| norms[n] > least).collect();
    let mut out = if pass.with_linear {
        features.dot(&pass.linear)
    } else {
        Array2::zeros((features.nrows(), pass.high.ncols()))
    };
    if kept.is_empty() {
        return Ok(out);
    }
    let mut signals = features.select(ndarray::Axis(0), &kept);
    for (mut row, &n) in signals.rows_mut().into_iter().zip(&kept) {
        row /= norms[n].max(pass.floor);
    }
    let options =
        sparse::Options { penalty: sparse::Penalty::Lambda(lambda), tolerance: 1e-4, ..sparse::Options::default() };
    let codes = sparse::solve(solver, signals.view(), &options)?;
    for (i, &n) in kept.iter().enumerate() {
        let scale = norms[n].max(pass.floor);
        let mut row = out.row_mut(n);
        let range = codes.indptr[i]..codes.indptr[i + 1];
        for (&atom, &value) in codes.atoms[range.clone()].iter().zip(&codes.values[range]) {
            row.scaled_add(scale * value, &pass.high.row(atom as usize));
        }
    }
    Ok(out)
}

fn regress(anchored: &Anchored, features: &Array2<f32>, flat: f32) -> Array2<f32> {
    let (n, m) = features.dim();
    let p2 = anchored.maps.dim().2;
    let mut out = Array2::zeros((n, p2));
    let nearest = nearest(&anchored.anchors, features);
    // By anchor, so that a regressor is read once for all its patches.
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_by_key(|&i| nearest[i as usize]);
    let norms = if flat > 0.0 { norms(features) } else { Vec::new() };
    let (Some(maps), Some(f), Some(o)) = (anchored.maps.as_slice(), features.as_slice(), out.as_slice_mut()) else {
        return out;
    };
    for i in order {
        let i = i as usize;
        if norms.get(i).is_some_and(|&n| n < flat) {
            continue;
        }
        let map = &maps[nearest[i] as usize * m * p2..][..m * p2];
        let row = &mut o[i * p2..(i + 1) * p2];
        for (value, weights) in f[i * m..(i + 1) * m].iter().zip(map.chunks_exact(p2)) {
            for (o, w) in row.iter_mut().zip(weights) {
                *o += value * w;
            }
        }
    }
    out
}

/// The anchor of largest |correlation| for each feature vector; the first of equals.
#[must_use]
pub(crate) fn nearest(anchors: &Array2<f32>, features: &Array2<f32>) -> Vec<u32> {
    use faer::linalg::matmul::matmul;
    use faer::{Accum, MatMut, MatRef, Par};
    let ((n, m), k) = (features.dim(), anchors.nrows());
    let mut nearest = Vec::with_capacity(n);
    const CHUNK: usize = 256;
    let mut products = vec![0.0f32; CHUNK.min(n) * k];
    let (Some(f), Some(a)) = (features.as_slice(), anchors.as_slice()) else { return vec![0; n] };
    for chunk in f.chunks(CHUNK * m) {
        let rows = chunk.len() / m;
        let products = &mut products[..rows * k];
        matmul(
            MatMut::from_row_major_slice_mut(products, rows, k),
            Accum::Replace,
            MatRef::from_row_major_slice(chunk, rows, m),
            MatRef::from_row_major_slice(a, k, m).transpose(),
            1.0,
            Par::Seq,
        );
        for row in products.chunks_exact(k) {
            let mut best = (0, -1.0f32);
            for (j, v) in row.iter().enumerate() {
                if v.abs() > best.1 {
                    best = (j as u32, v.abs());
                }
            }
            nearest.push(best.0);
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dictionary::network::tests::random;
    use crate::dictionary::tests::small;

    fn plane(h: usize, w: usize) -> Array2<f32> {
        Array2::from_shape_fn((h, w), |(y, x)| 0.5 + 0.3 * ((x * x + 2 * y) as f32 * 0.11).sin())
    }

    /// The definition: every patch by itself, textbook solver, sums in f64.
    fn plain(pass: &Pass, low: &Array2<f32>, step: usize, path: Path) -> Array2<f32> {
        let (h, w) = low.dim();
        let (m, p, r) = (pass.support / 2, pass.patch, pass.patch / 2);
        let padded = pad(low.view(), m);
        let (mut sums, mut totals) = (Array2::<f64>::zeros((h, w)), Array2::<f64>::zeros((h, w)));
        let solver = sparse::prepare(pass.low.view()).unwrap();
        let at = |n: usize| (0..n).filter(move |i| i % step == 0 || *i == n - 1);
        for y in at(h) {
            for x in at(w) {
                let f = extract(&padded, pass.support, &pass.filters, &[(y, x)], &mut Vec::new());
                let norm = f.row(0).dot(&f.row(0)).sqrt().max(pass.floor);
                let patch = match path {
                    Path::Linear | Path::Network => f.row(0).dot(&pass.linear),
                    Path::Anchored => {
                        let a = pass.anchored.as_ref().unwrap();
                        let c = a.anchors.dot(&f.row(0)).mapv(f32::abs);
                        let best = (0..c.len()).max_by(|&i, &j| c[i].total_cmp(&c[j])).unwrap();
                        f.row(0).dot(&a.maps.index_axis(ndarray::Axis(0), best))
                    }
                    Path::Lasso => {
                        let options = sparse::Options {
                            solver: sparse::Solver::CoordinateDescent,
                            penalty: sparse::Penalty::Lambda(pass.lambda),
                            tolerance: 1e-8,
                            ..sparse::Options::default()
                        };
                        let y = f.mapv(|v| v / norm);
                        let codes = sparse::solve(&solver, y.view(), &options).unwrap();
                        let mut t = ndarray::Array1::zeros(p * p);
                        codes.signal(0).for_each(|(k, v)| t.scaled_add(v * norm, &pass.high.row(k)));
                        t
                    }
                };
                for i in 0..p * p {
                    let (Some(v), Some(u)) = ((y + i / p).checked_sub(r), (x + i % p).checked_sub(r)) else { continue };
                    if v < h && u < w {
                        sums[[v, u]] += f64::from(patch[i]);
                        totals[[v, u]] += 1.0;
                    }
                }
            }
        }
        Array2::from_shape_fn((h, w), |i| low[i] + (sums[i] / totals[i]) as f32)
    }

    #[test]
    fn bands_equal_the_definition() {
        let model = &small(4).models[0];
        for path in [Path::Lasso, Path::Anchored, Path::Linear] {
            for (h, w, step) in [(31, 23, 2), (20, 41, 1), (9, 9, 3), (1, 12, 2), (1, 1, 1)] {
                let low = plane(h, w);
                let options = Options { path, step, ..Options::default() };
                let fast = Reconstructor::new(model, &options).unwrap().plane(low.view()).unwrap();
                let slow = plain(&model.passes[0], &low, step, path);
                for (a, b) in fast.iter().zip(&slow) {
                    assert!((a - b).abs() < 2e-3, "{path:?} {h}x{w}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn the_network_stands_in_for_the_code_where_it_has_its_images() {
        let mut model = small(4).models[0].clone();
        let lasso = Reconstructor::new(&model, &Options::default()).unwrap();
        let options = Options { path: Path::Network, step: 1, ..Options::default() };
        let low = plane(21, 26);
        let other = low.mapv(|v| v * v);
        let plain = Reconstructor::new(&model, &Options { step: 1, ..Options::default() }).unwrap();
        // Without a network the code.
        let without = Reconstructor::new(&model, &options).unwrap();
        assert!(without.beside().is_empty());
        assert_eq!(without.plane(low.view()).unwrap(), plain.plane(low.view()).unwrap());
        let network = random(5, &[Interpolation::Cubic]);
        model.passes[0].network = Some(network.clone());
        let r = Reconstructor::new(&model, &options).unwrap();
        assert_eq!((r.beside(), lasso.beside()), (&[Interpolation::Cubic][..], &[][..]));
        assert_eq!(r.plane(low.view()).unwrap(), plain.plane(low.view()).unwrap());
        assert!(r.plane_beside(low.view(), &[plane(3, 3)]).is_err());
        assert!(Reconstructor::new(&model, &Options { step: 4, ..options.clone() }).is_err());
        // With it, the mean of the patches that the definition gives.
        let found = r.plane_beside(low.view(), std::slice::from_ref(&other)).unwrap();
        let padded = [pad(low.view(), 3), pad((&other - &low).view(), 3)];
        for (y, x) in [(0, 0), (10, 11), (20, 25), (3, 24)] {
            let (mut sum, mut count) = (0.0, 0.0);
            for (dy, dx) in (0..9).map(|i| (i / 3, i % 3)) {
                let (Some(v), Some(u)) = ((y + dy as usize).checked_sub(1), (x + dx as usize).checked_sub(1)) else {
                    continue;
                };
                if v < 21 && u < 26 {
                    let patch = network.residuals(&network.features(&padded, &[(v, u)], &mut Vec::new()));
                    sum += patch[[0, 8 - (3 * dy as usize + dx as usize)]];
                    count += 1.0;
                }
            }
            assert!((found[[y, x]] - low[[y, x]] - sum / count).abs() < 1e-4, "{y} {x}");
        }
        // Nothing is made of nothing.
        let flat = Array2::from_elem((15, 15), 0.4f32);
        assert!(
            r.plane_beside(flat.view(), std::slice::from_ref(&flat)).unwrap().iter().all(|v| (v - 0.4).abs() < 1e-3)
        );
    }

    #[test]
    fn threads_do_not_matter() {
        let model = &small(4).models[0];
        let run = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                Reconstructor::new(model, &Options::default()).unwrap().plane(plane(70, 50).view()).unwrap()
            })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn flat_planes_stay_flat_and_odd_input_is_borne() {
        let model = &small(4).models[0];
        for ensemble in [1, 2, 4] {
            let options = Options { ensemble, ..Options::default() };
            let r = Reconstructor::new(model, &options).unwrap();
            let flat = Array2::from_elem((20, 30), 0.25f32);
            assert!(r.plane(flat.view()).unwrap().iter().all(|v| (v - 0.25).abs() < 1e-3));
            assert_eq!(r.plane(Array2::zeros((0, 5)).view()).unwrap().dim(), (0, 5));
            let nan = Array2::from_elem((12, 9), f32::NAN);
            assert!(r.plane(nan.view()).unwrap().iter().all(|v| v.is_finite()));
        }
        assert!(Reconstructor::new(model, &Options { step: 0, ..Options::default() }).is_err());
        assert!(Reconstructor::new(model, &Options { step: 4, ..Options::default() }).is_err());
        assert!(Reconstructor::new(model, &Options { ensemble: 3, ..Options::default() }).is_err());
    }

    #[test]
    fn a_mirrored_plane_gives_the_mirrored_ensemble() {
        let model = &small(4).models[0];
        let r = Reconstructor::new(model, &Options { ensemble: 4, step: 1, ..Options::default() }).unwrap();
        let low = plane(24, 18);
        let mut turned = low.clone();
        turned.invert_axis(ndarray::Axis(0));
        let a = r.plane(low.view()).unwrap();
        let mut b = r.plane(turned.view()).unwrap();
        b.invert_axis(ndarray::Axis(0));
        assert!((&a - &b).iter().all(|d| d.abs() < 1e-4));
    }
}
