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
