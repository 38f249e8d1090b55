//! Types shared by the plain solvers: one signal's problem, scratch memory, and how a solve ended.

use super::kernel::gap;
use super::prepared::Prepared;

/// How a signal's solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Ended {
    /// The gap reached the tolerance.
    Converged,
    /// The iteration cap came first.
    IterationCap,
    /// Rounding stopped progress first.
    Stalled,
}

/// How a solve ended, with its certificate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Finished {
    /// Duality gap (absolute); NaN for OMP.
    pub gap: f64,
    /// λ of the objective.
    pub lambda: f32,
    pub iterations: u32,
    pub ended: Ended,
}

/// One signal's problem: min over φ of ½‖y − Dᵀφ‖² + λ‖φ‖₁.
pub(crate) struct Problem<'a> {
    pub dictionary: &'a Prepared,
    /// y, m values.
    pub signal: &'a [f32],
    /// D y, K values.
    pub correlations: &'a [f32],
    /// max |D y| (max D y with non-negative codes).
    pub lambda_max: f32,
    pub lambda: f32,
    /// The gap that ends the solve.
    pub goal: f64,
    pub max_iterations: u32,
    pub nonnegative: bool,
    /// The most non-zeros, where their number is given instead of λ.
    pub max_nonzeros: usize,
}

impl Problem<'_> {
    /// The end of a solve for this problem's λ.
    pub fn finished(&self, gap: f64, iterations: u32, ended: Ended) -> Finished {
        Finished { gap, lambda: self.lambda, iterations, ended }
    }
}

/// Scratch of one thread for the plain solvers.
pub(crate) struct Work {
    /// Dense code; zero outside `support`.
    pub code: Vec<f32>,
    pub support: Vec<u32>,
    /// D (y − Dᵀφ).
    pub gradient: Vec<f32>,
    pub residual: Vec<f64>,
    /// Bound on the largest eigenvalue of the Gram matrix; proximal gradient computes it at its first use.
    pub eigenvalue: Option<f32>,
}

impl Work {
    pub fn new(dictionary: &Prepared) -> Work {
        Work {
            code: vec![0.0; dictionary.atom_count()],
            support: Vec::with_capacity(dictionary.signal_len()),
            gradient: vec![0.0; dictionary.atom_count()],
            residual: vec![0.0; dictionary.signal_len()],
            eigenvalue: None,
        }
    }

    pub fn clear_code(&mut self) {
        for &j in &self.support {
            self.code[j as usize] = 0.0;
        }
        self.support.clear();
    }

    /// Puts y − Dᵀφ in f64 into `residual`; returns ‖φ‖₁.
    fn update_residual(&mut self, problem: &Problem<'_>) -> f64 {
        for (r, &y) in self.residual.iter_mut().zip(problem.signal) {
            *r = f64::from(y);
        }
        let mut norm1 = 0.0;
        for &j in &self.support {
            let v = f64::from(self.code[j as usize]);
            if v != 0.0 {
                norm1 += v.abs();
                for (r, &d) in self.residual.iter_mut().zip(problem.dictionary.atom(j as usize)) {
                    *r -= v * f64::from(d);
                }
            }
        }
        norm1
    }

    /// The duality gap in f64, all correlations computed anew into `gradient`.
    pub fn gap(&mut self, problem: &Problem<'_>) -> f64 {
        let norm1 = self.update_residual(problem);
        let mut correlations = vec![0.0; problem.dictionary.atom_count()];
        problem.dictionary.correlate_f64(&self.residual, &mut correlations);
        let mut largest = 0.0f64;
        for (g, &c) in self.gradient.iter_mut().zip(&correlations) {
            *g = c as f32;
            largest = largest.max(if problem.nonnegative { c } else { c.abs() });
        }
        let (mut yr, mut rr) = (0.0, 0.0);
        for (&y, &r) in problem.signal.iter().zip(&self.residual) {
            yr += f64::from(y) * r;
            rr += r * r;
        }
        gap::duality_gap(yr, rr, norm1, f64::from(problem.lambda), largest)
    }
}
