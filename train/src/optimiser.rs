//! Adam (Kingma and Ba 2015, algorithm 1), with the authors' decay rates of 0.9 and 0.999, and the fall of its step.

use ndarray::{Array, Dimension, ShapeBuilder, Zip};

/// Decay of the first and of the second moments.
/// Source: Kingma and Ba 2015, section 2.
const DECAY: [f32; 2] = [0.9, 0.999];

/// Steps from which the correction of the moments' bias is 1 to rounding.
const UNBIASED: u64 = 100_000;

/// Share of the first step that the last one has.
/// Source: chosen.
const LAST: f32 = 0.02;

/// Factor of the first step at `done` (0..1) of the way, falling from 1 to 0.02 as half a cosine (Loshchilov and Hutter
/// 2017).
///
/// ```
/// use lenslet_train::optimiser::cosine_annealed;
/// assert_eq!(cosine_annealed(0.0), 1.0);
/// assert!((cosine_annealed(0.5) - 0.51).abs() < 1e-6 && (cosine_annealed(1.0) - 0.02).abs() < 1e-6);
/// ```
#[must_use]
pub fn cosine_annealed(done: f32) -> f32 {
    LAST + (1.0 - LAST) * 0.5 * (1.0 + (std::f32::consts::PI * done).cos())
}

/// The moments of the gradients of one parameter array, of its shape.
#[derive(Debug, Clone)]
pub struct Adam<D: Dimension> {
    /// Running mean of the gradients.
    pub first: Array<f32, D>,
    /// Running mean of their squares.
    pub second: Array<f32, D>,
}

impl<D: Dimension> Adam<D> {
    /// Moments of zero.
    ///
    /// ```
    /// use lenslet_train::optimiser::Adam;
    /// // min (x − 3)²: the gradient is 2(x − 3).
    /// let mut x = ndarray::Array1::<f32>::zeros(1);
    /// let mut adam = Adam::new(1);
    /// for step in 1..=400 {
    ///     let gradient = x.mapv(|x| 2.0 * (x - 3.0));
    ///     adam.step(&mut x, &gradient, 0.05, 1e-8, step);
    /// }
    /// assert!((x[0] - 3.0).abs() < 1e-2);
    /// ```
    #[must_use]
    pub fn new<S: ShapeBuilder<Dim = D> + Clone>(shape: S) -> Self {
        Adam { first: Array::zeros(shape.clone()), second: Array::zeros(shape) }
    }

    /// One step: `parameter` ← `parameter` − `rate`·m̂/(√v̂ + `epsilon`). `step` counts from 1.
    pub fn step(
        &mut self,
        parameter: &mut Array<f32, D>,
        gradient: &Array<f32, D>,
        rate: f32,
        epsilon: f32,
        step: u64,
    ) {
        let step = step.min(UNBIASED) as i32;
        let correction = DECAY.map(|decay| 1.0 - decay.powi(step));
        let update = |p: &mut f32, m: &mut f32, v: &mut f32, &g: &f32| {
            *m = 0.9 * *m + 0.1 * g;
            *v = 0.999 * *v + 0.001 * g * g;
            *p -= rate * (*m / correction[0]) / ((*v / correction[1]).sqrt() + epsilon);
        };
        Zip::from(parameter).and(&mut self.first).and(&mut self.second).and(gradient).for_each(update);
    }
}
