//! The same active set in f64 from residuals, slow and sure: min ½‖y − S Dᵀφ‖² + λ‖φ‖₁, S the identity or the signal's own.
//!
//! No Gram matrix of the dictionary is needed, so every signal may be seen through its own sampling S (weights, a mask, or
//! any matrix). Each move is the correction Δ = G_SS⁻¹(A_Sᵀr − λθ) for the residual at hand, so rounding does not build up.
//! Dependent atoms are exchanged along the null direction. The oracle of the fast path, and what it falls back on.

use super::prepared::Prepared;
use super::simd::{Kernel, Lanes, dispatch};
use super::solve::Finished;
use super::{Ended, gap};
use ndarray::ArrayView2;

/// How a signal is seen.
#[derive(Clone, Copy)]
pub(super) enum Seen<'a> {
    /// As it is.
    Whole,
    /// Value i of residual and atoms times √w_i.
    RootWeights(&'a [f64]),
    /// Through a matrix (p×m).
    Through(ArrayView2<'a, f32>),
}

/// One signal's problem.
pub(super) struct Task<'a> {
    pub dictionary: &'a Prepared,
    pub seen: Seen<'a>,
    /// The signal as seen (already times √w with weights).
    pub signal: &'a [f64],
    pub lambda: f64,
    pub goal: f64,
    pub max_rounds: u32,
    pub nonnegative: bool,
}

/// The answer: atoms, values, how it ended.
pub(super) struct Answer {
    pub support: Vec<u32>,
    pub values: Vec<f64>,
    pub finished: Finished,
}

/// One member of the support.
pub(super) struct Member {
    pub atom: usize,
    pub value: f64,
    pub sign: f64,
    /// The atom as seen.
    pub column: Vec<f64>,
}

/// Solves one signal.
pub(super) fn solve(task: &Task<'_>) -> Answer {
    let mut members: Vec<Member> = Vec::new();
    let mut correlations = vec![0.0f64; task.dictionary.atom_count()];
    let mut rounds = 0;
    let mut quiet = 0;
    let span = if task.lambda == 0.0 { span(task) } else { Vec::new() };
    let scale = {
        correlate(task.dictionary, task.seen, task.signal, &mut correlations);
        correlations.iter().fold(0.0f64, |m, c| m.max(c.abs()))
    };
    loop {
        let residual = residual(task, &members);
        correlate(task.dictionary, task.seen, &residual, &mut correlations);
        let gap = certificate(task, &members, &residual, &correlations, &span);
        if gap <= task.goal {
            return answer(members, gap, rounds, Ended::Converged);
        }
        if rounds >= task.max_rounds {
            return answer(members, gap, rounds, Ended::IterationCap);
        }
        rounds += 1;
        let newcomer = worst(task, &members, &correlations, scale);
        quiet = if newcomer.is_some() { 0 } else { quiet + 1 };
        if quiet > 3 {
            return answer(members, gap, rounds, Ended::Stalled);
        }
        let mut error: Vec<f64> = members.iter().map(|m| correlations[m.atom] - task.lambda * m.sign).collect();
        if let Some(atom) = newcomer {
            let sign = correlations[atom].signum();
            let column = seen_atom(task.dictionary, task.seen, atom);
            let Some(value) = make_room(&mut members, &mut error, &column, sign) else {
                return answer(members, gap, rounds, Ended::Stalled);
            };
            members.push(Member { atom, value, sign, column });
            error.push(correlations[atom] - task.lambda * sign);
        }
        walk(&mut members, &mut error, task.lambda > 0.0 || task.nonnegative);
    }
}

/// λ_max of a signal: max |D Sᵀy| (max D Sᵀy, at least 0, with non-negative codes).
pub(super) fn largest(dictionary: &Prepared, seen: Seen<'_>, signal: &[f64], nonnegative: bool) -> f64 {
    let mut correlations = vec![0.0f64; dictionary.atom_count()];
    correlate(dictionary, seen, signal, &mut correlations);
    correlations.iter().fold(0.0f64, |m, &c| m.max(if nonnegative { c } else { c.abs() }))
}

fn answer(members: Vec<Member>, gap: f64, rounds: u32, ended: Ended) -> Answer {
    let (support, values) = members.iter().map(|m| (m.atom as u32, m.value)).unzip();
    Answer { support, values, finished: Finished { gap, iterations: rounds, ended } }
}

/// The gap of a given code.
pub(super) fn gap_of(task: &Task<'_>, members: &[Member]) -> f64 {
    let span = if task.lambda == 0.0 { span(task) } else { Vec::new() };
    let residual = residual(task, members);
    let mut correlations = vec![0.0f64; task.dictionary.atom_count()];
    correlate(task.dictionary, task.seen, &residual, &mut correlations);
    certificate(task, members, &residual, &correlations, &span)
}

/// Whether a column is (all but) a combination of the members'.
pub(super) fn depends(members: &[Member], column: &[f64]) -> bool {
    let own = inner(column, column);
    let overlap: Vec<f64> = members.iter().map(|m| inner(&m.column, column)).collect();
    match solve_gram(members, &overlap) {
        Some(u) => own - u.iter().zip(&overlap).map(|(a, b)| a * b).sum::<f64>() <= 1e-10 * own,
        None => true,
    }
}

/// The atom outside the support that violates its condition most.
fn worst(task: &Task<'_>, members: &[Member], correlations: &[f64], scale: f64) -> Option<usize> {
    let mut best = (task.lambda + 1e-13 * scale, None);
    for (atom, &c) in correlations.iter().enumerate() {
        let size = if task.nonnegative { c } else { c.abs() };
        if size > best.0 && !members.iter().any(|m| m.atom == atom) {
            best = (size, Some(atom));
        }
    }
    best.1
}

/// Moves to the minimum for the signs at hand, dropping atoms that would change sign on the way (not with λ = 0, where
/// signs mean nothing).
fn walk(members: &mut Vec<Member>, error: &mut Vec<f64>, keep_signs: bool) {
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

/// The value the newcomer starts with: 0, or, where it depends on the support, what it takes over from the member that
/// its null direction brings to zero first (which leaves). None when there is no such member.
fn make_room(members: &mut Vec<Member>, error: &mut Vec<f64>, column: &[f64], sign: f64) -> Option<f64> {
    let own = inner(column, column);
    let overlap: Vec<f64> = members.iter().map(|m| inner(&m.column, column)).collect();
    let u = solve_gram(members, &overlap)?;
    let left = own - u.iter().zip(&overlap).map(|(a, b)| a * b).sum::<f64>();
    if left > 1e-10 * own {
        return Some(0.0);
    }
    // The newcomer grows by t in its sign, the others change by −t·sign·u: the residual stays.
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

/// G_SS x = rhs by Cholesky; none when G_SS is singular.
pub(super) fn solve_gram(members: &[Member], rhs: &[f64]) -> Option<Vec<f64>> {
    let n = members.len();
    let mut factor = vec![0.0f64; n * n];
    for i in 0..n {
        for j in 0..=i {
            let mut v = inner(&members[i].column, &members[j].column);
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

fn residual(task: &Task<'_>, members: &[Member]) -> Vec<f64> {
    let mut residual = task.signal.to_vec();
    for m in members {
        for (r, c) in residual.iter_mut().zip(&m.column) {
            *r -= m.value * c;
        }
    }
    residual
}

/// Atom `k` as seen.
pub(super) fn seen_atom(dictionary: &Prepared, seen: Seen<'_>, k: usize) -> Vec<f64> {
    let atom = dictionary.atom(k);
    match seen {
        Seen::Whole => atom.iter().map(|&v| f64::from(v)).collect(),
        Seen::RootWeights(w) => atom.iter().zip(w).map(|(&v, w)| f64::from(v) * w).collect(),
        Seen::Through(matrix) => matrix
            .rows()
            .into_iter()
            .map(|row| row.iter().zip(atom).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum())
            .collect(),
    }
}

/// D Sᵀ v for all atoms.
fn correlate(dictionary: &Prepared, seen: Seen<'_>, v: &[f64], out: &mut [f64]) {
    let back: Vec<f64> = match seen {
        Seen::Whole => v.to_vec(),
        Seen::RootWeights(w) => v.iter().zip(w).map(|(a, b)| a * b).collect(),
        Seen::Through(matrix) => {
            let mut back = vec![0.0; matrix.ncols()];
            for (row, &v) in matrix.rows().into_iter().zip(v) {
                for (b, &a) in back.iter_mut().zip(row) {
                    *b += f64::from(a) * v;
                }
            }
            back
        }
    };
    correlate_whole(dictionary, &back, out);
}

/// D v in f64 for all atoms.
pub(super) fn correlate_whole(dictionary: &Prepared, v: &[f64], out: &mut [f64]) {
    let mut padded = v.to_vec();
    padded.resize(v.len().next_multiple_of(16), 0.0);
    dispatch(dictionary.simd(), Correlate { dictionary, v: padded.as_chunks::<16>().0, out });
}

struct Correlate<'a> {
    dictionary: &'a Prepared,
    v: &'a [[f64; 16]],
    out: &'a mut [f64],
}

impl Kernel for Correlate<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        for (k, out) in self.out.iter_mut().enumerate() {
            *out = gap::dot(lanes, self.dictionary.padded_atom(k), self.v);
        }
    }
}

fn certificate(task: &Task<'_>, members: &[Member], residual: &[f64], correlations: &[f64], span: &[Vec<f64>]) -> f64 {
    if task.lambda == 0.0 && !task.nonnegative {
        // Without a penalty the best is the projection on the span: what is left of it in the residual is the gap.
        return 0.5 * span.iter().map(|q| inner(q, residual).powi(2)).sum::<f64>();
    }
    let largest = correlations.iter().fold(0.0f64, |m, &c| m.max(if task.nonnegative { c } else { c.abs() }));
    let norm1 = members.iter().map(|m| m.value.abs()).sum();
    let (yr, rr) = (inner(task.signal, residual), inner(residual, residual));
    gap::certify(yr, rr, norm1, task.lambda, largest)
}

/// An orthonormal basis of the span of all atoms as seen.
fn span(task: &Task<'_>) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for k in 0..task.dictionary.atom_count() {
        if basis.len() == task.signal.len() {
            break;
        }
        let mut v = seen_atom(task.dictionary, task.seen, k);
        let before = inner(&v, &v).sqrt();
        for _ in 0..2 {
            for q in &basis {
                let along = inner(q, &v);
                for (v, q) in v.iter_mut().zip(q) {
                    *v -= along * q;
                }
            }
        }
        let norm = inner(&v, &v).sqrt();
        if norm > 1e-6 * before {
            basis.push(v.iter().map(|v| v / norm).collect());
        }
    }
    basis
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
