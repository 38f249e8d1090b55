//! Sharpness and jaggedness of a straight edge.
//!
//! MTF50 after ISO 12233's slanted-edge method: pixels are binned by their distance from the fitted edge (four
//! bins per pixel), the derivative of that profile is the line spread, and the modulus of its Fourier transform the
//! MTF. Jaggedness is the RMS distance of the rows' own edge positions from the straight line through them all.

use ndarray::ArrayView2;

/// Bins per pixel.
/// Source: ISO 12233.
const OVERSAMPLING: f64 = 4.0;
/// Half the width of the profile around the edge, pixels, at most.
/// Source: chosen.
const REACH: f64 = 16.0;
/// Smallest difference between the two sides, values 0..1.
/// Source: chosen.
const LEAST_CONTRAST: f64 = 0.02;

/// Sharpness, jaggedness and contrast of a straight edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Frequency at which the MTF falls to one half, cycles per pixel; NaN if it stays above up to 0.5 cycles per
    /// pixel.
    pub mtf50: f64,
    /// RMS distance of the rows' edge positions from the straight line, pixels.
    pub jaggedness: f64,
    /// Difference of the two sides, values 0..1.
    pub contrast: f64,
}

/// Measures the one edge in `window` (t, s), which runs within 30° of straight down. For an edge that runs across, pass
/// the transposed window. `None` where there is no such edge, or the window is smaller than 8 rows or 12 columns.
///
/// ```
/// use lenslet_core::metrics::slanted_edge;
/// use ndarray::Array2;
///
/// // A ramp of 4 pixels: the MTF |sin(4πf)/(4πf)| is one half at 0.151 cycles per pixel.
/// let ramp = Array2::from_shape_fn((40, 40), |(t, s)| ((s as f32 - 18.0 - 0.1 * t as f32) / 4.0).clamp(0.0, 1.0));
/// let edge = slanted_edge(ramp.view()).unwrap();
/// assert!((edge.mtf50 - 0.151).abs() < 0.01 && edge.jaggedness < 0.05 && edge.contrast > 0.9);
/// assert_eq!(slanted_edge(Array2::zeros((40, 40)).view()), None);
/// ```
pub fn slanted_edge(window: ArrayView2<f32>) -> Option<Edge> {
    let (rows, columns) = window.dim();
    if rows < 8 || columns < 12 || window.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let quarter = columns / 4;
    let side = |from: usize, to: usize| mean(window.slice(ndarray::s![.., from..to]).iter().map(|&x| f64::from(x)));
    let (left, right) = (side(0, quarter), side(columns - quarter, columns));
    let contrast = (right - left).abs();
    if contrast < LEAST_CONTRAST {
        return None;
    }
    let level = (left + right) / 2.0;
    let rising = right > left;

    // First guess: the line through the rows' centres of slope; then every row's own crossing nearest to it, twice.
    let mut line = fit_line(&(0..rows).map(|t| centre_of_slope(window, t, rising)).collect::<Vec<_>>())?;
    let mut crossings = Vec::new();
    for _ in 0..2 {
        crossings = (0..rows).map(|t| level_crossing(window, t, level, rising, line.0 + line.1 * t as f64)).collect();
        line = fit_line(&crossings)?;
    }
    if line.1.abs() > 0.58 {
        return None;
    }
    let residuals = crossings.iter().enumerate().filter_map(|(t, &x)| Some((x? - line.0 - line.1 * t as f64).powi(2)));
    let jaggedness = mean(residuals).sqrt();

    let profile = edge_profile(window, line)?;
    Some(Edge { mtf50: mtf50(&profile), jaggedness, contrast })
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0usize), |(s, n), x| (s + x, n + 1));
    sum / n.max(1) as f64
}

/// Centre of a row's slope in the edge's direction.
fn centre_of_slope(window: ArrayView2<f32>, t: usize, rising: bool) -> Option<f64> {
    let row = window.row(t);
    let (mut sum, mut moment) = (0.0, 0.0);
    for s in 1..row.len() - 1 {
        let slope = f64::from(row[s + 1] - row[s - 1]) * if rising { 1.0 } else { -1.0 };
        // Squared, so that the edge has more weight than the noise of the flat parts.
        let weight = slope.max(0.0).powi(2);
        sum += weight;
        moment += weight * s as f64;
    }
    (sum > 0.0).then(|| moment / sum)
}

/// Where a row crosses `level` in the edge's direction, nearest to `near`.
fn level_crossing(window: ArrayView2<f32>, t: usize, level: f64, rising: bool, near: f64) -> Option<f64> {
    let row = window.row(t);
    let mut best: Option<f64> = None;
    for s in 0..row.len() - 1 {
        let (a, b) = (f64::from(row[s]) - level, f64::from(row[s + 1]) - level);
        let crosses = if rising { a < 0.0 && b >= 0.0 } else { a >= 0.0 && b < 0.0 };
        if crosses {
            let x = s as f64 + a / (a - b);
            if best.is_none_or(|old| (x - near).abs() < (old - near).abs()) {
                best = Some(x);
            }
        }
    }
    best
}

/// Least-squares line (offset, slope) through positions by row; `None` when fewer than six rows have one.
fn fit_line(positions: &[Option<f64>]) -> Option<(f64, f64)> {
    let points: Vec<(f64, f64)> = positions.iter().enumerate().filter_map(|(t, x)| Some((t as f64, (*x)?))).collect();
    if points.len() < 6 {
        return None;
    }
    let n = points.len() as f64;
    let (mt, mx) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let covariance: f64 = points.iter().map(|p| (p.0 - mt) * (p.1 - mx)).sum();
    let variance: f64 = points.iter().map(|p| (p.0 - mt).powi(2)).sum();
    let slope = covariance / variance;
    Some((mx - slope * mt, slope))
}

/// Mean value by distance across the edge, [`OVERSAMPLING`] bins per pixel; empty bins take their neighbours' mean.
fn edge_profile(window: ArrayView2<f32>, line: (f64, f64)) -> Option<Vec<f64>> {
    let cosine = 1.0 / line.1.hypot(1.0);
    let reach = REACH.min(window.ncols() as f64 / 2.0 - 2.0);
    let bins = (2.0 * reach * OVERSAMPLING) as usize;
    let mut sums = vec![(0.0, 0usize); bins];
    for ((t, s), &x) in window.indexed_iter() {
        let distance = (s as f64 - line.0 - line.1 * t as f64) * cosine;
        let bin = ((distance + reach) * OVERSAMPLING).floor();
        if bin >= 0.0 && (bin as usize) < bins {
            let sum = &mut sums[bin as usize];
            *sum = (sum.0 + f64::from(x), sum.1 + 1);
        }
    }
    let filled: Vec<Option<f64>> = sums.iter().map(|&(sum, n)| (n > 0).then(|| sum / n as f64)).collect();
    (0..bins)
        .map(|i| {
            filled[i].or_else(|| {
                let before = filled[..i].iter().rev().find_map(|&x| x)?;
                let after = filled[i + 1..].iter().find_map(|&x| x)?;
                Some((before + after) / 2.0)
            })
        })
        .collect()
}

/// First frequency, cycles per pixel, at which the MTF of an edge profile is one half.
fn mtf50(profile: &[f64]) -> f64 {
    let n = profile.len();
    let spread: Vec<f64> = (1..n - 1)
        .map(|i| {
            // Flat over the middle half, so that a wide spread is not narrowed; falling to 0 at the ends.
            let from_middle = (2.0 * i as f64 / (n - 1) as f64 - 1.0).abs();
            let window = 0.5 + 0.5 * (2.0 * std::f64::consts::PI * (from_middle - 0.5).max(0.0)).cos();
            window * (profile[i + 1] - profile[i - 1])
        })
        .collect();
    let total: f64 = spread.iter().sum();
    let step = 0.002;
    let mut before = 1.0;
    for k in 1..=250 {
        let frequency = f64::from(k) * step;
        let omega = 2.0 * std::f64::consts::PI * frequency / OVERSAMPLING;
        let (re, im) = spread.iter().enumerate().fold((0.0, 0.0), |(re, im), (i, &x)| {
            (re + x * (omega * i as f64).cos(), im + x * (omega * i as f64).sin())
        });
        // The difference over two bins is also a low-pass filter; its response is divided out.
        let now = re.hypot(im) / total.abs() * omega / omega.sin();
        if now < 0.5 {
            return frequency - step * (0.5 - now) / (before - now);
        }
        before = now;
    }
    f64::NAN
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// An edge leaning by `slope` columns per row, blurred by a Gaussian, each row displaced by `shift(row)`.
    fn edge(slope: f64, sigma: f64, shift: impl Fn(usize) -> f64) -> Array2<f32> {
        // The logistic curve with 1.702 approximates the Gaussian's integral to within 0.01.
        let integral = |x: f64| {
            let n = 400;
            let (low, width) = (-6.0, (x / sigma + 6.0).max(0.0));
            let h = width / f64::from(n);
            (0..n).map(|i| (-0.5 * (low + (f64::from(i) + 0.5) * h).powi(2)).exp() * h).sum::<f64>() / 2.506_628_3
        };
        Array2::from_shape_fn((60, 48), |(t, s)| {
            (0.2 + 0.6 * integral(s as f64 - 22.3 - slope * (t as f64 - 30.0) - shift(t))) as f32
        })
    }

    #[test]
    fn mtf50_of_gaussian_edges() {
        for sigma in [1.0, 1.5, 2.5] {
            // exp(−2π²σ²f²) = 1/2 across the edge; a lean of 5° changes distances by 0.4 %.
            let expected = (2f64.ln() / 2.0).sqrt() / (std::f64::consts::PI * sigma);
            let cosine = 1.0 / 0.0875f64.hypot(1.0);
            let got = slanted_edge(edge(0.0875, sigma, |_| 0.0).view()).unwrap();
            assert!((got.mtf50 / (expected / cosine) - 1.0).abs() < 0.03, "σ {sigma}: {} {expected}", got.mtf50);
            assert!(got.jaggedness < 0.02 && (got.contrast - 0.6).abs() < 0.01);
        }
    }

    #[test]
    fn falling_edges_and_zigzags() {
        let zigzag = edge(-0.1, 1.0, |t| if t % 6 < 3 { 0.4 } else { -0.4 });
        let got = slanted_edge(zigzag.mapv(|x| 1.0 - x).view()).unwrap();
        assert!((got.jaggedness - 0.4).abs() < 0.02, "{}", got.jaggedness);
        let straight = slanted_edge(edge(-0.1, 1.0, |_| 0.0).view()).unwrap();
        assert!(straight.mtf50 > got.mtf50);
    }

    #[test]
    fn without_an_edge_nothing_is_measured() {
        assert_eq!(slanted_edge(Array2::from_elem((40, 40), 0.5).view()), None);
        assert_eq!(slanted_edge(Array2::from_elem((4, 4), 0.5).view()), None);
        assert_eq!(slanted_edge(Array2::from_elem((40, 40), f32::NAN).view()), None);
    }
}
