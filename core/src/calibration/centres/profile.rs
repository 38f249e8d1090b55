//! The micro-image profile: light as a polynomial of r², one for the whole sensor, fitted to the image itself.
//! The paper fits a paraboloid (degree 1 in r²) to each lenslet; degree 4 keeps wide windows unbiased. The profile is
//! rotationally symmetric, so its centre is the lenslet's centre.

use rayon::prelude::*;

use super::predicted::PredictedLenslet;
use crate::calibration::sensor_image::SensorImage;
use crate::linalg::solve_small;

/// Degree of the profile in r².
/// Source: chosen
const DEGREE: usize = 4;
/// Number of coefficients.
pub const TERMS: usize = DEGREE + 1;
/// Lenslets the profile is fitted to, about.
/// Source: chosen
const SAMPLE: usize = 30_000;

/// T(r) = Σ_k terms[k]·(r/radius)^(2k), valid up to `radius`; T(0) = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MicroImageProfile {
    /// Coefficients.
    pub terms: [f64; TERMS],
    /// Radius up to which the profile holds, pixels.
    pub radius: f64,
}

impl MicroImageProfile {
    /// A paraboloid that falls to 0.4 at `radius`: the start before a profile is fitted.
    pub fn paraboloid(radius: f64) -> Self {
        let mut terms = [0f64; TERMS];
        (terms[0], terms[1]) = (1.0, -0.6);
        MicroImageProfile { terms, radius }
    }

    /// T at r² = `u`·radius².
    #[inline]
    pub fn at(&self, u: f64) -> f64 {
        self.terms.iter().rev().fold(0.0, |sum, t| sum * u + t)
    }

    /// Contrast between centre and rim: 1 − T(radius)/T(0).
    pub fn contrast(&self) -> f64 {
        1.0 - self.at(1.0) / self.terms[0]
    }
}

/// Least-squares profile over a sample of the lenslets at `sites`, each divided by its gain and slope; `None` where the
/// system is singular or the centre is not bright.
pub fn fit_profile(image: &SensorImage, sites: &[PredictedLenslet], radius: f64) -> Option<MicroImageProfile> {
    let step = (sites.len() / SAMPLE).max(1);
    // A step that is a multiple of the row length would pick lenslets of one column only.
    let chosen: Vec<&PredictedLenslet> =
        sites.iter().enumerate().filter(|(n, s)| n % step == (n / 97) % step && s.gain > 0.0).map(|(_, s)| s).collect();
    let inverse = 1.0 / (radius * radius);
    let parts: Vec<([[f64; TERMS]; TERMS], [f64; TERMS])> = chosen
        .par_chunks(512)
        .map(|chunk| {
            let mut normal = [[0f64; TERMS]; TERMS];
            let mut right = [0f64; TERMS];
            for site in chunk {
                let x0 = (site.x - radius).ceil().max(0.0) as usize;
                let x1 = ((site.x + radius).floor() as usize).min(image.width - 1);
                let y0 = (site.y - radius).ceil().max(0.0) as usize;
                let y1 = ((site.y + radius).floor() as usize).min(image.height - 1);
                for y in y0..=y1 {
                    let dy = y as f64 - site.y;
                    for x in x0..=x1 {
                        let dx = x as f64 - site.x;
                        let u = (dx * dx + dy * dy) * inverse;
                        let v = image.at(x, y);
                        if u > 1.0 || v >= image.limit[(y & 1) * 2 + (x & 1)] {
                            continue;
                        }
                        let v = f64::from(v) / (site.gain * (1.0 + dx * site.slope[0] + dy * site.slope[1]));
                        let mut row = [1f64; TERMS];
                        for k in 1..TERMS {
                            row[k] = row[k - 1] * u;
                        }
                        for r in 0..TERMS {
                            for c in 0..=r {
                                normal[r][c] += row[r] * row[c];
                            }
                            right[r] += row[r] * v;
                        }
                    }
                }
            }
            (normal, right)
        })
        .collect();
    let mut normal = [[0f64; TERMS]; TERMS];
    let mut right = [0f64; TERMS];
    for (n, r) in &parts {
        for k in 0..TERMS {
            for c in 0..=k {
                normal[k][c] += n[k][c];
                if c < k {
                    normal[c][k] += n[k][c];
                }
            }
            right[k] += r[k];
        }
    }
    let terms = solve_small(normal, right)?;
    (terms[0] > 0.0).then(|| MicroImageProfile { terms: terms.map(|t| t / terms[0]), radius })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_profile_that_made_the_image_comes_back() {
        let truth = MicroImageProfile { terms: [1.0, -0.5, -0.2, 0.1, -0.15], radius: 5.0 };
        assert!((truth.at(0.5) - (1.0 - 0.25 - 0.05 + 0.0125 - 0.009_375)).abs() < 1e-12);
        assert!((truth.contrast() - 0.75).abs() < 1e-12);
        let start = MicroImageProfile::paraboloid(4.0);
        assert!((start.at(1.0) - 0.4).abs() < 1e-12 && start.at(0.0) == 1.0);
        // Lenslets up to the borders, each with its gain and slope; one is dark.
        let sites: Vec<PredictedLenslet> = (0..12)
            .map(|k| {
                let (i, j) = (k % 4, k / 4);
                PredictedLenslet {
                    i,
                    j,
                    x: f64::from(i) * 12.0 + 5.3,
                    y: f64::from(j) * 12.0 + 5.1,
                    gain: 0.5 + 0.03 * f64::from(k),
                    slope: [0.004, -0.003 * f64::from(i)],
                }
            })
            .collect();
        let (width, height) = (47, 34);
        let mut data = vec![0f32; width * height];
        for (k, v) in data.iter_mut().enumerate() {
            let (x, y) = ((k % width) as f64, (k / width) as f64);
            let near = sites.iter().min_by(|p, q| (p.x - x).hypot(p.y - y).total_cmp(&(q.x - x).hypot(q.y - y)));
            let s = near.unwrap();
            let (dx, dy) = (x - s.x, y - s.y);
            *v = (s.gain * truth.at((dx * dx + dy * dy) / 25.0) * (1.0 + s.slope[0] * dx + s.slope[1] * dy)) as f32;
        }
        let mut image = SensorImage { width, height, data, limit: [f32::INFINITY; 4] };
        let close = |found: MicroImageProfile| {
            (0..=10).all(|k| (found.at(f64::from(k) / 10.0) - truth.at(f64::from(k) / 10.0)).abs() < 1e-4)
        };
        assert!(close(fit_profile(&image, &sites, 5.0).unwrap()));
        // A saturated pixel of one place of the tile is left out.
        image.data[5 * width + 5] = 9.0;
        assert!(!close(fit_profile(&image, &sites, 5.0).unwrap()));
        image.limit[3] = 8.0;
        assert!(close(fit_profile(&image, &sites, 5.0).unwrap()));
        image.data.iter_mut().for_each(|v| *v = -*v);
        assert!(fit_profile(&image, &sites, 5.0).is_none());
        let dark: Vec<PredictedLenslet> = sites.iter().map(|s| PredictedLenslet { gain: 0.0, ..*s }).collect();
        assert!(fit_profile(&image, &dark, 5.0).is_none());
    }
}
