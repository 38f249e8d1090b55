//! The active set in f64 from residuals, slow and exact: min ½‖y − S Dᵀφ‖² + λ‖φ‖₁, S the identity or a matrix that
//! differs from signal to signal.
//!
//! No Gram matrix of the dictionary is needed, so every signal may have its own sampling S (weights, a mask, or any
//! matrix). Each move is the correction Δ = G_SS⁻¹(A_Sᵀr − λθ) for the current residual r, so rounding does not
//! accumulate. Linearly dependent atoms are exchanged along the null direction. The oracle of the
//! others, and their last resort.

use ndarray::ArrayView2;

use super::gap;
use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished};

/// How a signal is observed: the S of the objective.
#[derive(Clone, Copy)]
pub(crate) enum Observation<'a> {
    /// All of its values with equal weight: S is the identity.
    Full,
    /// Value i with weight w_i (0 hides it): S is diagonal. Holds the √w_i.
    Weighted(&'a [f64]),
    /// Through this p×m matrix S.
    Sampled(ArrayView2<'a, f32>),
}

/// One signal's problem, in f64.
pub(crate) struct ObservedProblem<'a> {
    pub dictionary: &'a Prepared,
    pub observation: Observation<'a>,
    /// S y: with weights already times √w_i.
    pub signal: &'a [f64],
    pub lambda: f64,
    pub goal: f64,
    pub max_rounds: u32,
    pub nonnegative: bool,
}

/// A code: atoms by their internal number, values, how the solve ended.
pub(crate) struct Solution {
    pub support: Vec<u32>,
    pub values: Vec<f64>,
    pub finished: Finished,
}

/// One member of the support.
pub(crate) struct Member {
    pub atom: usize,
    pub value: f64,
    pub sign: f64,
    /// S dₖ: the atom as observed.
    pub column: Vec<f64>,
}

/// Solves one signal.
pub(crate) fn solve(problem: &ObservedProblem<'_>) -> Solution {
    let mut members: Vec<Member> = Vec::new();
    let mut correlations = vec![0.0f64; problem.dictionary.atom_count()];
    let mut rounds = 0;
    let mut quiet = 0;
    let span = if problem.lambda == 0.0 {
        orthonormal_basis(problem.dictionary, problem.observation, problem.signal.len())
    } else {
        Vec::new()
    };
    let scale = {
        correlate(problem.dictionary, problem.observation, problem.signal, &mut correlations);
        correlations.iter().fold(0.0f64, |m, c| m.max(c.abs()))
    };
    loop {
        let residual = residual(problem, &members);
        correlate(problem.dictionary, problem.observation, &residual, &mut correlations);
        let gap = certified_gap(problem, &members, &residual, &correlations, &span);
        if gap <= problem.goal {
            return solution(problem, members, gap, rounds, Ended::Converged);
        }
        if rounds >= problem.max_rounds {
            return solution(problem, members, gap, rounds, Ended::IterationCap);
        }
        rounds += 1;
        let entering = most_violating_atom(problem, &members, &correlations, scale);
        quiet = if entering.is_some() { 0 } else { quiet + 1 };
        if quiet > 3 {
            return solution(problem, members, gap, rounds, Ended::Stalled);
        }
        let mut error: Vec<f64> = members.iter().map(|m| correlations[m.atom] - problem.lambda * m.sign).collect();
        if let Some(atom) = entering {
            let sign = correlations[atom].signum();
            let column = observed_atom(problem.dictionary, problem.observation, atom);
            let Some(value) = starting_value(&mut members, &mut error, &column, sign) else {
                return solution(problem, members, gap, rounds, Ended::Stalled);
            };
            members.push(Member { atom, value, sign, column });
            error.push(correlations[atom] - problem.lambda * sign);
        }
        move_to_minimum(&mut members, &mut error, problem.lambda > 0.0 || problem.nonnegative);
    }
}

/// λ_max of a signal: max |D Sᵀy| (max D Sᵀy, at least 0, with non-negative codes).
pub(crate) fn lambda_max(
    dictionary: &Prepared,
    observation: Observation<'_>,
    signal: &[f64],
    nonnegative: bool,
) -> f64 {
    let mut correlations = vec![0.0f64; dictionary.atom_count()];
    correlate(dictionary, observation, signal, &mut correlations);
    correlations.iter().fold(0.0f64, |m, &c| m.max(if nonnegative { c } else { c.abs() }))
}

fn solution(problem: &ObservedProblem<'_>, members: Vec<Member>, gap: f64, rounds: u32, ended: Ended) -> Solution {
    let (support, values) = members.iter().map(|m| (m.atom as u32, m.value)).unzip();
    let finished = Finished { gap, lambda: problem.lambda as f32, iterations: rounds, ended };
    Solution { support, values, finished }
}

/// The duality gap of a given code.
pub(crate) fn gap_of_members(problem: &ObservedProblem<'_>, members: &[Member]) -> f64 {
    let span = if problem.lambda == 0.0 {
        orthonormal_basis(problem.dictionary, problem.observation, problem.signal.len())
    } else {
        Vec::new()
    };
    let residual = residual(problem, members);
    let mut correlations = vec![0.0f64; problem.dictionary.atom_count()];
    correlate(problem.dictionary, problem.observation, &residual, &mut correlations);
    certified_gap(problem, members, &residual, &correlations, &span)
}

/// Whether a column is, within rounding, a linear combination of the members'.
pub(crate) fn is_dependent(members: &[Member], column: &[f64]) -> bool {
    let own = inner_product(column, column);
    let overlap: Vec<f64> = members.iter().map(|m| inner_product(&m.column, column)).collect();
    match solve_gram(members, &overlap) {
        Some(u) => own - u.iter().zip(&overlap).map(|(a, b)| a * b).sum::<f64>() <= 1e-10 * own,
        None => true,
    }
}

/// The atom outside the support that violates its condition most.
fn most_violating_atom(
    problem: &ObservedProblem<'_>,
    members: &[Member],
    correlations: &[f64],
    scale: f64,
) -> Option<usize> {
    let mut best = (problem.lambda + 1e-13 * scale, None);
    for (atom, &c) in correlations.iter().enumerate() {
        let size = if problem.nonnegative { c } else { c.abs() };
        if size > best.0 && !members.iter().any(|m| m.atom == atom) {
            best = (size, Some(atom));
        }
    }
    best.1
}

/// Moves to the minimum for the current signs, removing atoms that would change sign on the way (not with λ = 0, where
/// the objective does not depend on signs).
fn move_to_minimum(members: &mut Vec<Member>, error: &mut Vec<f64>, keep_signs: bool) {
    while !members.is_empty() {
        let Some(step) = solve_gram(members, error) else { return };
        let (mut t, mut first) = (1.0f64, usize::MAX);
        if keep_signs {
            for (i, (m, d)) in members.iter().zip(&step).enumerate() {
                if (m.value + d) * m.sign < 0.0 {
                    let crossing = (m.value / -d).clamp(0.0, 1.0);
                    if crossing < t || first == usize::MAX {
                        (t, first) = (crossing, i);
                    }
                }
            }
        }
        for ((m, d), e) in members.iter_mut().zip(&step).zip(error.iter_mut()) {
            m.value += t * d;
            *e *= 1.0 - t;
        }
        if first == usize::MAX {
            return;
        }
        members.swap_remove(first);
        error.swap_remove(first);
    }
}

/// The value an entering atom starts with: 0, or, where it depends linearly on the support, the value at which its null
/// direction brings the first member to zero (which leaves). `None` when there is no such member.
fn starting_value(members: &mut Vec<Member>, error: &mut Vec<f64>, column: &[f64], sign: f64) -> Option<f64> {
    let own = inner_product(column, column);
    let overlap: Vec<f64> = members.iter().map(|m| inner_product(&m.column, column)).collect();
    let u = solve_gram(members, &overlap)?;
    let left = own - u.iter().zip(&overlap).map(|(a, b)| a * b).sum::<f64>();
    if left > 1e-10 * own {
        return Some(0.0);
    }
    // The entering atom grows by t in its sign, the others change by −t·sign·u: the residual stays.
    let (mut t, mut first) = (f64::INFINITY, usize::MAX);
    for (i, (m, u)) in members.iter().zip(&u).enumerate() {
        let rate = sign * u * m.sign;
        if rate > 1e-12 && m.value.abs() / rate < t {
            (t, first) = (m.value.abs() / rate, i);
        }
    }
    if first == usize::MAX {
        return None;
    }
    for (m, u) in members.iter_mut().zip(&u) {
        m.value -= t * sign * u;
    }
    members.swap_remove(first);
    error.swap_remove(first);
    Some(t * sign)
}

/// Solves G_SS x = rhs by Cholesky; `None` when G_SS is singular.
pub(crate) fn solve_gram(members: &[Member], rhs: &[f64]) -> Option<Vec<f64>> {
    let n = members.len();
    let mut factor = vec![0.0f64; n * n];
    for i in 0..n {
        for j in 0..=i {
            let mut v = inner_product(&members[i].column, &members[j].column);
            for l in 0..j {
                v -= factor[i * n + l] * factor[j * n + l];
            }
            if i == j {
                if v <= 0.0 || v.is_nan() {
                    return None;
                }
                factor[i * n + i] = v.sqrt();
            } else {
                factor[i * n + j] = v / factor[j * n + j];
            }
        }
    }
    let mut x = rhs.to_vec();
    for i in 0..n {
        for l in 0..i {
            x[i] -= factor[i * n + l] * x[l];
        }
        x[i] /= factor[i * n + i];
    }
    for i in (0..n).rev() {
        for l in i + 1..n {
            x[i] -= factor[l * n + i] * x[l];
        }
        x[i] /= factor[i * n + i];
    }
    Some(x)
}

fn residual(problem: &ObservedProblem<'_>, members: &[Member]) -> Vec<f64> {
    let mut residual = problem.signal.to_vec();
    for m in members {
        for (r, c) in residual.iter_mut().zip(&m.column) {
            *r -= m.value * c;
        }
    }
    residual
}

/// S dₖ: atom `k` as observed.
pub(crate) fn observed_atom(dictionary: &Prepared, observation: Observation<'_>, k: usize) -> Vec<f64> {
    let atom = dictionary.atom(k);
    match observation {
        Observation::Full => atom.iter().map(|&v| f64::from(v)).collect(),
        Observation::Weighted(w) => atom.iter().zip(w).map(|(&v, w)| f64::from(v) * w).collect(),
        Observation::Sampled(matrix) => matrix
            .rows()
            .into_iter()
            .map(|row| row.iter().zip(atom).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum())
            .collect(),
    }
}

/// D Sᵀ v for all atoms.
fn correlate(dictionary: &Prepared, observation: Observation<'_>, v: &[f64], out: &mut [f64]) {
    let back: Vec<f64> = match observation {
        Observation::Full => v.to_vec(),
        Observation::Weighted(w) => v.iter().zip(w).map(|(a, b)| a * b).collect(),
        Observation::Sampled(matrix) => {
            let mut back = vec![0.0; matrix.ncols()];
            for (row, &v) in matrix.rows().into_iter().zip(v) {
                for (b, &a) in back.iter_mut().zip(row) {
                    *b += f64::from(a) * v;
                }
            }
            back
        }
    };
    dictionary.correlate_f64(&back, out);
}

fn certified_gap(
    problem: &ObservedProblem<'_>,
    members: &[Member],
    residual: &[f64],
    correlations: &[f64],
    span: &[Vec<f64>],
) -> f64 {
    if problem.lambda == 0.0 && !problem.nonnegative {
        return gap_in_span(span, residual);
    }
    let largest = correlations.iter().fold(0.0f64, |m, &c| m.max(if problem.nonnegative { c } else { c.abs() }));
    let norm1 = members.iter().map(|m| m.value.abs()).sum();
    let (yr, rr) = (inner_product(problem.signal, residual), inner_product(residual, residual));
    gap::duality_gap(yr, rr, norm1, problem.lambda, largest)
}

/// An orthonormal basis of the span of all atoms as observed, in `len` values.
pub(crate) fn orthonormal_basis(dictionary: &Prepared, observation: Observation<'_>, len: usize) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for k in 0..dictionary.atom_count() {
        if basis.len() == len {
            break;
        }
        let mut v = observed_atom(dictionary, observation, k);
        let before = inner_product(&v, &v).sqrt();
        for _ in 0..2 {
            for q in &basis {
                let along = inner_product(q, &v);
                for (v, q) in v.iter_mut().zip(q) {
                    *v -= along * q;
                }
            }
        }
        let norm = inner_product(&v, &v).sqrt();
        if norm > 1e-6 * before {
            basis.push(v.iter().map(|v| v / norm).collect());
        }
    }
    basis
}

/// The gap without a penalty: the minimum is the projection on the span, so ½‖·‖² of the residual's part in it.
pub(crate) fn gap_in_span(span: &[Vec<f64>], residual: &[f64]) -> f64 {
    0.5 * span.iter().map(|q| inner_product(q, residual).powi(2)).sum::<f64>()
}

fn inner_product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::prepared::prepare;

    fn member(column: &[f64]) -> Member {
        Member { atom: 0, value: 0.0, sign: 1.0, column: column.to_vec() }
    }

    #[test]
    fn gram_systems_are_solved_and_singular_ones_refused() {
        let members = [member(&[2.0, 0.0, 1.0]), member(&[1.0, 1.0, 0.0]), member(&[0.0, 1.0, 3.0])];
        let truth = [0.7, -1.2, 0.4];
        let gram = |i: usize, j: usize| inner_product(&members[i].column, &members[j].column);
        let rhs: Vec<f64> = (0..3).map(|i| (0..3).map(|j| gram(i, j) * truth[j]).sum()).collect();
        let found = solve_gram(&members, &rhs).unwrap();
        assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let same = [member(&[1.0, 2.0]), member(&[1.0, 2.0])];
        assert!(solve_gram(&same, &[1.0, 1.0]).is_none());
        assert!(is_dependent(&members[..2], &[3.0, 1.0, 1.0]) && !is_dependent(&members[..2], &[3.0, 1.0, 1.1]));
    }

    #[test]
    fn a_dependent_atom_replaces_the_first_that_comes_to_zero() {
        // The column is a + 2b: growing by t takes t of the first and 2t of the second, which is at zero first.
        let mut members = vec![member(&[1.0, 0.0]), member(&[0.0, 1.0])];
        (members[0].value, members[1].value) = (3.0, 4.0);
        let mut error = vec![0.1, 0.2];
        let value = starting_value(&mut members, &mut error, &[1.0, 2.0], 1.0).unwrap();
        assert!((value - 2.0).abs() < 1e-12);
        assert_eq!((members.len(), error.as_slice()), (1, &[0.1][..]));
        assert!((members[0].value - 1.0).abs() < 1e-12 && members[0].column == [1.0, 0.0]);
        // In the other sign both grow, and nothing comes to zero.
        let mut members = vec![member(&[1.0, 0.0])];
        members[0].value = 3.0;
        assert!(starting_value(&mut members, &mut vec![0.0], &[2.0, 0.0], -1.0).is_none());
        assert_eq!(starting_value(&mut members, &mut vec![0.0], &[2.0, 1.0], 1.0), Some(0.0));
    }

    #[test]
    fn members_that_would_change_sign_leave_on_the_way() {
        let set = || {
            let mut members = vec![member(&[1.0, 0.0, 0.0]), member(&[0.0, 1.0, 0.0]), member(&[0.0, 0.0, 1.0])];
            (members[0].value, members[1].value, members[2].value) = (1.0, 2.0, 1.0);
            members
        };
        // The first is at zero after a half, the second after 4/5, the third moves freely.
        let (mut members, mut error) = (set(), vec![-2.0, -2.5, 0.5]);
        move_to_minimum(&mut members, &mut error, true);
        assert!(members.len() == 1 && (members[0].value - 1.5).abs() < 1e-12);
        let (mut members, mut error) = (set(), vec![-2.0, -2.5, 0.5]);
        move_to_minimum(&mut members, &mut error, false);
        let values: Vec<f64> = members.iter().map(|m| m.value).collect();
        assert_eq!(values, [-1.0, -0.5, 1.5]);
    }

    #[test]
    fn a_basis_has_a_vector_for_each_dimension_of_the_span() {
        let s = 0.5f32.sqrt();
        let atoms = ndarray::arr2(&[[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [s, s, 0.0], [0.0, 1.0, 0.0]]);
        let dictionary = prepare(atoms.view()).unwrap();
        let basis = orthonormal_basis(&dictionary, Observation::Full, 3);
        assert_eq!(basis.len(), 2);
        assert!(
            (inner_product(&basis[0], &basis[0]) - 1.0).abs() < 1e-12
                && inner_product(&basis[0], &basis[1]).abs() < 1e-12
        );
        assert!((gap_in_span(&basis, &[3.0, 4.0, 7.0]) - 12.5).abs() < 1e-6);
        // Values that are hidden have no part.
        assert_eq!(orthonormal_basis(&dictionary, Observation::Weighted(&[1.0, 0.0, 1.0]), 3).len(), 1);
    }

    #[test]
    fn the_first_to_change_sign_leaves_and_the_rest_turns_back() {
        // Inner product −1/2. Towards (−1, −0.1) from (1, 1) the first is at zero half way; without it the second goes
        // to 0.4. The other order by symmetry.
        let (one, two) = ([1.0, 0.0], [-0.5, 0.75f64.sqrt()]);
        for (columns, error) in [([one, two], [-1.45, -0.1]), ([two, one], [-0.1, -1.45])] {
            let mut members: Vec<Member> = columns.iter().map(|c| member(c)).collect();
            members.iter_mut().for_each(|m| m.value = 1.0);
            move_to_minimum(&mut members, &mut error.to_vec(), true);
            assert_eq!(members.len(), 1);
            assert!(members[0].column == two && (members[0].value - 0.4).abs() < 1e-9, "{}", members[0].value);
        }
    }
}
