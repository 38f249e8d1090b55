//! Medians and paired differences with their standard errors.

/// Standard deviation of a normal distribution over its median absolute deviation.
///
/// Source: P. Rousseeuw and C. Croux, Alternatives to the median absolute deviation, 1993.
const DEVIATION_OF_MAD: f64 = 1.4826;

/// Standard error of the median over that of the mean, of a normal distribution: √(π/2).
///
/// Source: the variance of the sample median, π σ²/(2 n).
const ERROR_OF_MEDIAN: f64 = 1.2533;

/// A difference of two pictures on the same places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// The first picture's value minus the second's.
    pub mean: f64,
    /// Its standard error.
    pub error: f64,
}

impl Difference {
    /// Whether it lies above 0 by more than `errors` standard errors.
    #[must_use]
    pub fn is_above_zero(&self, errors: f64) -> bool {
        self.mean > errors * self.error
    }
}

/// A median over places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Median {
    /// The median.
    pub median: f64,
    /// Its standard error.
    pub error: f64,
}

/// The median of finite values and its standard error, from the median absolute deviation; `None` of fewer than 3.
///
/// ```
/// use lenslet_views::assess::median_with_error;
/// let m = median_with_error(&[1.0, 2.0, 3.0, 4.0, 100.0]).unwrap();
/// assert_eq!(m.median, 3.0);
/// assert!((m.error - 1.2533 * 1.4826 / 5f64.sqrt()).abs() < 1e-9);
/// ```
#[must_use]
pub fn median_with_error(values: &[f64]) -> Option<Median> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    if sorted.len() < 3 {
        return None;
    }
    let median = median_of(&mut sorted)?;
    let mut apart: Vec<f64> = sorted.iter().map(|x| (x - median).abs()).collect();
    let spread = DEVIATION_OF_MAD * median_of(&mut apart)?;
    Some(Median { median, error: ERROR_OF_MEDIAN * spread / (sorted.len() as f64).sqrt() })
}

/// The median of a − b over the places where both are finite, with its standard error; `None` of fewer than 3.
#[must_use]
pub fn median_of_differences(a: &[f64], b: &[f64]) -> Option<Difference> {
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    median_with_error(&differences).map(|m| Difference { mean: m.median, error: m.error })
}

/// Sets every place to NaN that one of the lists has no finite value of; returns how many places are left.
pub(super) fn keep_common(lists: &mut [&mut Vec<f64>]) -> usize {
    let n = lists.iter().map(|l| l.len()).min().unwrap_or(0);
    let mut left = 0;
    for k in 0..n {
        if lists.iter().all(|l| l[k].is_finite()) {
            left += 1;
        } else {
            lists.iter_mut().for_each(|l| l[k] = f64::NAN);
        }
    }
    left
}

/// RMS of a − b, their mean taken out.
pub(super) fn rms_apart(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len()).max(1) as f64;
    let mean = a.iter().zip(b).map(|(a, b)| a - b).sum::<f64>() / n;
    (a.iter().zip(b).map(|(a, b)| (a - b - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// The median of finite values, which are sorted; the mean of the middle two where their number is even.
pub(super) fn median_of(values: &mut [f64]) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let n = values.len();
    let (low, high) = (*values.get(n.checked_sub(1)? / 2)?, *values.get(n / 2)?);
    Some(0.5 * (low + high))
}

/// Sums of squared errors by lenslet, of one picture.
#[derive(Debug, Clone)]
pub(super) struct SquaredErrors {
    pub(super) by_lenslet: Vec<f64>,
    pub(super) count: usize,
}

/// dB of one mean square over another.
const DECIBEL: f64 = 10.0 / std::f64::consts::LN_10;

impl SquaredErrors {
    pub(super) fn new(lenslets: usize) -> Self {
        SquaredErrors { by_lenslet: vec![0.0; lenslets], count: 0 }
    }

    pub(super) fn add(&mut self, lenslet: usize, error: f64) {
        self.by_lenslet[lenslet] += error * error;
        self.count += 1;
    }

    pub(super) fn sum(&self) -> f64 {
        self.by_lenslet.iter().sum()
    }

    pub(super) fn mean(&self) -> f64 {
        self.sum() / self.count.max(1) as f64
    }

    /// By how many dB these errors are smaller than `other`'s on the same places; the standard error takes lenslets for
    /// independent.
    pub(super) fn over(&self, other: &SquaredErrors) -> Difference {
        let (a, b) = (self.sum().max(1e-300), other.sum().max(1e-300));
        let apart = self.by_lenslet.iter().zip(&other.by_lenslet).map(|(x, y)| (x / a - y / b).powi(2));
        Difference { mean: DECIBEL * (b / a).ln(), error: DECIBEL * apart.sum::<f64>().sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_differences() {
        assert_eq!(median_of(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(median_with_error(&[1.0, f64::NAN, 2.0]), None);
        let a: Vec<f64> = (0..101).map(|k| f64::from(k % 7)).collect();
        let b: Vec<f64> = a.iter().map(|x| x - 0.25).collect();
        let d = median_of_differences(&a, &b).unwrap();
        assert_eq!((d.mean, d.error), (0.25, 0.0));
        assert!(d.is_above_zero(2.0) && !Difference { mean: 0.1, error: 0.06 }.is_above_zero(2.0));
    }

    #[test]
    fn the_standard_error_of_decibels_is_that_of_repeated_draws() {
        // Lenslets whose squared errors are 1 and 2 on the average, independent of each other.
        use lenslet_core::random::standard_normal;
        use rand::SeedableRng;
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(5);
        let mut draw = || {
            let mut one = |scale: f64| {
                let mut sum = SquaredErrors::new(400);
                (0..400).for_each(|k| sum.add(k, scale * standard_normal(&mut rng)));
                sum
            };
            one(1.0).over(&one(2f64.sqrt()))
        };
        let all: Vec<Difference> = (0..300).map(|_| draw()).collect();
        let mean = all.iter().map(|d| d.mean).sum::<f64>() / 300.0;
        let spread = (all.iter().map(|d| (d.mean - mean).powi(2)).sum::<f64>() / 299.0).sqrt();
        let told = all.iter().map(|d| d.error).sum::<f64>() / 300.0;
        assert!((mean - 3.01).abs() < 0.1 && (told / spread - 1.0).abs() < 0.15, "{mean} {spread} {told}");
    }
}
