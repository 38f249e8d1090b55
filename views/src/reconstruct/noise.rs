//! Noise of samples as a function of their brightness, estimated from differences between neighbours in the flattest
//! parts.
//!
//! Texture is nearly the same in all colours, noise is not: where there are colours, differences between them show
//! noise that luminance hides in texture. The smaller of both estimates is taken.
//!
//! Where views refined by all the others are known, what they leave of a view's own samples shows noise even where all
//! colours share it: that of compressed mosaics, and of white images.
//!
//! For every sample, r = value − mean of its neighbours on the triangulation, whose variance is σ²(1 + 1/k) for k of
//! them; then the root mean square of r over the sample and its neighbours. Among samples of a brightness, the lowest
//! of these come from places with nothing but noise.

use lenslet_core::geometry::triangulate;
use lenslet_core::noise::NoiseCurve;
use lenslet_core::sampling;

/// Steps of brightness.
///
/// Source: chosen.
const BINS: usize = 16;
/// Share of a bin's samples that are assumed to lie in flat parts.
///
/// Source: chosen.
const FLAT: f32 = 0.1;
/// The `FLAT` quantile of the root mean square of seven neighbouring r of unit variance.
///
/// Source: measured on planted noise.
const QUANTILE: f32 = 0.62;
/// Noise of luminance as a part of that of red − green, both encoded.
///
/// Source: measured on simulated flat captures (0.26 to 0.37 by view and strength).
const OF_COLOURS: f32 = 0.33;
/// Fewest samples of a bin.
///
/// Source: chosen.
const FEWEST: usize = 200;

/// Which samples are neighbours.
#[derive(Debug, Clone)]
pub(super) struct Neighbours {
    triangles: Vec<[u32; 3]>,
    samples: usize,
}

impl Neighbours {
    pub(super) fn new(centres: &[[f64; 2]]) -> Result<Self, sampling::Error> {
        Ok(Neighbours { triangles: triangulate(centres)?.triangles, samples: centres.len() })
    }

    /// Mean of every sample's neighbours and their number; a neighbour counts once a triangle, so twice inside.
    fn means(&self, values: &[f32]) -> Vec<(f32, f32)> {
        let mut sums = vec![(0f32, 0f32); self.samples];
        for t in &self.triangles {
            let v = t.map(|k| values[k as usize]);
            for k in 0..3 {
                let (a, b) = (v[(k + 1) % 3], v[(k + 2) % 3]);
                if a.is_finite() && b.is_finite() {
                    let sum = &mut sums[t[k] as usize];
                    sum.0 += a + b;
                    sum.1 += 2.0;
                }
            }
        }
        sums.into_iter().map(|(sum, n)| if n > 0.0 { (sum / n, n / 2.0) } else { (f32::NAN, 0.0) }).collect()
    }
}

/// Standard deviation of the samples' noise over their brightness (both sRGB-encoded luminance), from the luminance of
/// the samples of one view and, where they have colours, from their red − green.
pub(super) fn estimate_noise(values: &[f32], colours: Option<&[f32]>, neighbours: &Neighbours) -> NoiseCurve {
    let fits = |values: &[f32]| values.len() == neighbours.samples;
    if !fits(values) || !colours.is_none_or(fits) {
        return NoiseCurve::constant(0.0);
    }
    let brightness = neighbours.means(values);
    let mut noise = noise_by_brightness(&squares_beside_neighbours(values, neighbours), &brightness, neighbours);
    if let Some(colours) = colours {
        let found = noise_by_brightness(&squares_beside_neighbours(colours, neighbours), &brightness, neighbours);
        for (own, other) in noise.iter_mut().zip(found) {
            *own = own.min(OF_COLOURS * other);
        }
    }
    curve_of(noise)
}

/// Standard deviation of the samples' noise over their brightness, from what a view refined by all the others `shows` at
/// their places.
pub(super) fn estimate_noise_beside(values: &[f32], shows: &[f32], neighbours: &Neighbours) -> NoiseCurve {
    if values.len() != neighbours.samples || shows.len() != neighbours.samples {
        return NoiseCurve::constant(0.0);
    }
    let squares: Vec<f32> = values.iter().zip(shows).map(|(v, s)| (v - s).powi(2)).collect();
    curve_of(noise_by_brightness(&squares, &neighbours.means(values), neighbours))
}

/// The noise of each bin as that of its middle.
fn curve_of(noise: [f32; BINS]) -> NoiseCurve {
    NoiseCurve::new(noise.into_iter().enumerate().map(|(k, n)| ((k as f32 + 0.5) / BINS as f32, n)).collect())
}

/// Square of what every value differs from the mean of its neighbours, as the variance of its own noise.
fn squares_beside_neighbours(values: &[f32], neighbours: &Neighbours) -> Vec<f32> {
    let square = |(v, (mean, n)): (&f32, (f32, f32))| {
        if n > 0.0 { (v - mean).powi(2) / (1.0 + 1.0 / n) } else { f32::NAN }
    };
    values.iter().zip(neighbours.means(values)).map(square).collect()
}

/// Standard deviation of the noise at each step of the `brightness` around samples, from its `squares`.
fn noise_by_brightness(squares: &[f32], brightness: &[(f32, f32)], neighbours: &Neighbours) -> [f32; BINS] {
    let spread = neighbours.means(squares);
    let mut bins: [Vec<f32>; BINS] = std::array::from_fn(|_| Vec::new());
    for ((&(mean, _), &own), &(others, n)) in brightness.iter().zip(squares).zip(&spread) {
        let square = (own + n * others) / (1.0 + n);
        if square.is_finite() {
            bins[((mean.clamp(0.0, 1.0) * BINS as f32) as usize).min(BINS - 1)].push(square);
        }
    }
    let found = bins.map(|mut bin| {
        let place = (FLAT * bin.len() as f32) as usize;
        (bin.len() >= FEWEST).then(|| bin.select_nth_unstable_by(place, f32::total_cmp).1.sqrt() / QUANTILE)
    });
    // A bin of too few samples takes the noise of the nearest bin with enough; 0 where no bin has enough.
    std::array::from_fn(|k| {
        let near = (0..BINS).filter(|&j| found[j].is_some()).min_by_key(|&j| j.abs_diff(k));
        near.and_then(|j| found[j]).unwrap_or(0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    fn lattice(n: usize) -> Vec<[f64; 2]> {
        let row = |j: usize| (0..n).map(move |i| [i as f64 + 0.5 * (j % 2) as f64, j as f64 * 0.866]);
        (0..n).flat_map(row).collect()
    }

    #[test]
    fn planted_noise_is_found() {
        let centres = lattice(110);
        let neighbours = Neighbours::new(&centres).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || lenslet_core::random::standard_normal(&mut rng) as f32;
        // Half of it flat at two levels with different noise, half textured.
        for (dark, bright) in [(0.02f32, 0.005f32), (0.01, 0.03)] {
            let values: Vec<f32> = centres
                .iter()
                .map(|c| {
                    let (level, sigma) = if c[1] < 47.0 { (0.15, dark) } else { (0.7, bright) };
                    let texture =
                        if c[0] > 55.0 { 0.1 * ((2.1 * c[0]).sin() * (1.7 * c[1]).cos()) as f32 } else { 0.0 };
                    level + texture + sigma * normal()
                })
                .collect();
            let noise = estimate_noise(&values, None, &neighbours);
            for (level, sigma) in [(0.15, dark), (0.7, bright)] {
                let found = noise.noise_at(level) / sigma;
                assert!((0.75..1.35).contains(&found), "{level}: {found} of {sigma}");
            }
        }
    }

    #[test]
    fn colours_separate_texture_from_noise() {
        let centres = lattice(110);
        let neighbours = Neighbours::new(&centres).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut noise = |sigma: f32| sigma * 12f32.sqrt() * (rng.random::<f32>() - 0.5);
        // Texture everywhere, the same in all colours.
        let texture = |c: &[f64; 2]| 0.4 + 0.1 * ((2.1 * c[0]).sin() * (1.7 * c[1]).cos()) as f32;
        let values: Vec<f32> = centres.iter().map(|c| texture(c) + noise(0.01)).collect();
        let colours: Vec<f32> = centres.iter().map(|_| noise(0.01 / OF_COLOURS)).collect();
        let misled = estimate_noise(&values, None, &neighbours).noise_at(0.4);
        let found = estimate_noise(&values, Some(&colours), &neighbours).noise_at(0.4);
        assert!(misled > 0.02 && (0.007..0.014).contains(&found), "{misled} and {found}");
        // Colours without noise: none at all.
        assert_eq!(estimate_noise(&values, Some(&vec![0.1; values.len()]), &neighbours).noise_at(0.4), 0.0);
    }

    #[test]
    fn a_refined_view_shows_noise_that_all_colours_share() {
        let centres = lattice(110);
        let neighbours = Neighbours::new(&centres).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || lenslet_core::random::standard_normal(&mut rng) as f32;
        let texture = |c: &[f64; 2]| 0.4 + 0.1 * ((2.1 * c[0]).sin() * (1.7 * c[1]).cos()) as f32;
        let shows: Vec<f32> = centres.iter().map(texture).collect();
        // A fifth of the view does not fit; noise is what the rest leaves.
        let off = |c: &[f64; 2]| if c[0] > 88.0 { 0.05 * (0.9 * c[1]).sin() as f32 } else { 0.0 };
        let values: Vec<f32> = centres.iter().map(|c| texture(c) + off(c) + 0.015 * normal()).collect();
        let found = estimate_noise_beside(&values, &shows, &neighbours).noise_at(0.4);
        assert!((0.75..1.35).contains(&(found / 0.015)), "{found}");
        let misled = estimate_noise(&values, Some(&vec![0.1; values.len()]), &neighbours).noise_at(0.4);
        assert_eq!(misled, 0.0);
        assert_eq!(estimate_noise_beside(&values, &shows[1..], &neighbours).noise_at(0.4), 0.0);
    }

    #[test]
    fn odd_samples_give_no_noise() {
        let centres = lattice(20);
        let neighbours = Neighbours::new(&centres).unwrap();
        for odd in [0.5, f32::NAN] {
            let noise = estimate_noise(&[odd; 400], None, &neighbours);
            assert!((0..=20).all(|k| noise.noise_at(k as f32 / 20.0) == 0.0));
        }
        assert_eq!(estimate_noise(&[0.5; 3], None, &neighbours).noise_at(f32::NAN), 0.0);
    }
}
