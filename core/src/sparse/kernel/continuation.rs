//! The way down to a small λ: by steps, so that fewer atoms enter in vain.

use crate::sparse::prepared::Prepared;

/// From which λ on, and by what factor, λ falls to that of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Continuation {
    /// Below this share of ‖y‖ λ is reached by steps.
    pub smallest_share_at_once: f64,
    /// The share of ‖y‖ that it falls from.
    pub first_share: f64,
    /// By which each step divides it.
    pub factor: f64,
}

/// Atoms for each value of a signal from which on many enter in vain.
///
/// Source: measured; `benches/sparse_spams.py` has dictionaries of 0.7, 1.3, 5.2, 6.3, 7, 10 and 41, and from 6.3 on the short
/// steps took less time, at λ = 0.01 up to half.
const MANY_ATOMS: usize = 6;

/// Of many atoms.
///
/// Source: measured; the least time of those tried, factors of 2.5 to 10 from shares of 0.03 to 0.2.
const SHORT_STEPS: Continuation = Continuation { smallest_share_at_once: 0.05, first_share: 0.2, factor: 2.5 };

/// Of few.
///
/// Source: chosen; with λ at once small λ took longer on nearly all sets of `benches/sparse_spams.py`.
const LONG_STEPS: Continuation = Continuation { smallest_share_at_once: 0.005, first_share: 0.03, factor: 10.0 };

impl Continuation {
    /// For signals that `dictionary` is to code.
    pub fn of(dictionary: &Prepared) -> Self {
        let many = dictionary.atom_count() >= MANY_ATOMS * dictionary.signal_len();
        if many { SHORT_STEPS } else { LONG_STEPS }
    }
}
