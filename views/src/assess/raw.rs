//! Raw pixels foretold by calibrations, on data that no calibration touches.
//!
//! A raw pixel at offset u from the centre of its lenslet shows what the middle view shows at x = p − D(x)·u, p being that
//! centre. Each calibration decodes the capture (no white balance, colour matrix or calmed colours), makes its own
//! disparity and its own barycentric middle view, and foretells the pixel in its own colour, times one white image for all.
//! A gain by colour and distance from the centre is fitted to each; what is left is compared pixel by pixel.

use lenslet_core::calibration::Calibration;
use lenslet_core::container::Capture;
use lenslet_core::decode::{self, HexSamples, RawStep};
use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::progress::Observer;
use lenslet_core::sampling::bicubic::bicubic_at;
use ndarray::{Array2, Array3};

use super::nearest::NearestPlace;
use super::ray_places::{RayPlaces, sample_points};
use super::statistics::{Difference, SquaredErrors};
use super::withheld::hash_of;
use crate::Error;
use crate::multiview::{self, SampleSet, estimate_disparities};
use crate::renderer::InterpolatedViews;
use crate::target::mean_pitch;

/// Distances of pixels from their lenslet's centre by the first calibration, pitches.
///
/// Source: chosen, 2 to 3.4 pixels of an F01.
const DISTANCES: (f64, f64) = (0.201, 0.342);

/// The same by any calibration.
///
/// Source: chosen: whole pixels and uncalibrated lenslets are off by some tenths of a pixel to pixels.
const ANY_DISTANCES: (f64, f64) = (0.05, 0.5);

/// One pixel in this many is foretold.
///
/// Source: chosen.
const ONE_IN: u64 = 8;

/// Rings of distance that have a gain of their own.
///
/// Source: chosen.
const RINGS: usize = 3;

/// Share of the pixels, those missed most by all calibrations together, that are left out.
///
/// Source: chosen.
const LEFT_OUT: f64 = 0.02;

/// Least light of the white image at a pixel, a share of full light.
///
/// Source: chosen.
const LEAST_LIGHT: f32 = 0.2;

/// Pixels from which calibrations are compared.
///
/// Source: chosen.
const LEAST_PIXELS: usize = 500;

/// How well a calibration foretells raw pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawScore {
    /// RMS error, digital numbers of the capture; the pixels' own noise is part of it.
    pub rms: f64,
    /// dB over the first calibration, with the standard error over lenslets.
    pub over: Difference,
    /// Pixels foretold, the same ones for all.
    pub pixels: usize,
}

/// A raw pixel that all calibrations foretell.
struct Pixel {
    lenslet: usize,
    colour: usize,
    ring: usize,
    value: f32,
    white: f32,
    at: [usize; 2],
}

/// Compares calibrations of the camera of `capture`; the first is the reference, and its white image is taken for all.
/// `longer`: longer side of the views, pixels.
///
/// # Errors
/// A capture that cannot be decoded, fewer than two calibrations, too few pixels; interruption.
pub fn compare_calibrations(
    capture: &Capture,
    calibrations: &[&Calibration],
    longer: usize,
    observer: &dyn Observer,
) -> Result<Vec<RawScore>, Error> {
    ensure!(Error::Shape, calibrations.len() >= 2, "calibrations are compared with each other: two or more are needed");
    let size = Size::new(capture.mosaic.width, capture.mosaic.height).with_longer_side(longer);
    observer.begin("raw pixels", calibrations.len() as u64);
    let mut pixels: Vec<Pixel> = Vec::new();
    let mut foretold: Vec<Vec<f32>> = Vec::new();
    for (k, calibration) in calibrations.iter().enumerate() {
        observer.check()?;
        let model = Foretelling::new(capture, calibration, &size, observer)?;
        if k == 0 {
            pixels = model.choose_pixels(capture, calibration);
        }
        let nearest = NearestPlace::new(&model.samples.centres, model.pitch);
        foretold.push(pixels.iter().map(|p| model.foretell(p, &nearest).unwrap_or(f32::NAN)).collect());
        observer.advance(1);
    }
    let valid: Vec<bool> = (0..pixels.len()).map(|p| foretold.iter().all(|f| f[p].is_finite())).collect();
    let pixels = kept_of(pixels, &valid);
    let foretold: Vec<Vec<f32>> = foretold.into_iter().map(|f| kept_of(f, &valid)).collect();
    let errors: Vec<Vec<f64>> = foretold.iter().map(|f| errors_of(&pixels, f)).collect();
    let missed: Vec<f64> = (0..pixels.len()).map(|p| errors.iter().map(|e| e[p].abs()).sum()).collect();
    let mut sorted = missed.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    ensure!(
        Error::Shape,
        sorted.len() >= LEAST_PIXELS,
        "only {} raw pixels are foretold by all calibrations, {LEAST_PIXELS} are needed",
        sorted.len()
    );
    let limit = sorted[((1.0 - LEFT_OUT) * (sorted.len() - 1) as f64) as usize];
    let lenslets = calibrations[0].lenslets.len();
    let sums: Vec<SquaredErrors> = errors
        .iter()
        .map(|errors| {
            let mut sum = SquaredErrors::new(lenslets);
            for ((pixel, e), m) in pixels.iter().zip(errors).zip(&missed) {
                if *m <= limit {
                    sum.add(pixel.lenslet, *e);
                }
            }
            sum
        })
        .collect();
    Ok(sums.iter().map(|s| RawScore { rms: s.mean().sqrt(), over: s.over(&sums[0]), pixels: s.count }).collect())
}

fn kept_of<T>(all: Vec<T>, kept: &[bool]) -> Vec<T> {
    all.into_iter().zip(kept).filter(|(_, k)| **k).map(|(x, _)| x).collect()
}

/// What one calibration foretells.
struct Foretelling {
    samples: HexSamples,
    points: Vec<[f64; 2]>,
    places: RayPlaces,
    picture: Array3<f32>,
    /// Sensor pixels.
    pitch: f64,
}

impl Foretelling {
    fn new(
        capture: &Capture,
        calibration: &Calibration,
        size: &Size,
        observer: &dyn Observer,
    ) -> Result<Foretelling, Error> {
        let mut options = decode::Options::default();
        options.steps.raw.retain(|s| matches!(s, RawStep::BlackLevel | RawStep::Vignetting | RawStep::HotPixels));
        options.steps.view.clear();
        let samples = decode::sample_views(capture, calibration, &options, observer)?;
        let disparity: Array2<f32> = {
            let set = SampleSet::hexagonal(&samples, size)?;
            estimate_disparities(&set, &multiview::Options::default(), observer)?.middle.disparity
        };
        let middle = samples.views / 2;
        let views = InterpolatedViews::prepare(&samples, Interpolation::Barycentric, size, observer)?;
        let picture = views.render_view(middle, middle)?.into_pixels();
        let places = RayPlaces::new(&samples, size, &disparity);
        Ok(Foretelling { points: sample_points(&samples, size), places, picture, pitch: mean_pitch(&samples), samples })
    }

    /// A random share of the raw pixels around the lenslets' middles.
    fn choose_pixels(&self, capture: &Capture, calibration: &Calibration) -> Vec<Pixel> {
        let (width, height) = (capture.mosaic.width, capture.mosaic.height);
        let nearest = NearestPlace::new(&self.samples.centres, self.pitch);
        let white = |x: usize, y: usize| {
            calibration.vignetting.as_ref().map_or(1.0, |v| f32::from(v.white[y * width + x]) / 32768.0)
        };
        let mut pixels = Vec::new();
        for y in 0..height {
            for x in 0..width {
                if !hash_of([x as i32, y as i32]).is_multiple_of(ONE_IN) {
                    continue;
                }
                let Some((lenslet, distance)) = nearest.find([x as f64, y as f64]) else { continue };
                let share = (distance / self.pitch - DISTANCES.0) / (DISTANCES.1 - DISTANCES.0);
                let plane = capture.cfa.plane(x, y);
                let (black, full) = (capture.levels.black[plane], capture.levels.white[plane]);
                let value = f32::from(capture.mosaic.data[y * width + x]);
                let white = white(x, y);
                // Saturated pixels tell nothing.
                if !(0.0..1.0).contains(&share) || white < LEAST_LIGHT || value > 0.95 * full {
                    continue;
                }
                pixels.push(Pixel {
                    lenslet,
                    colour: [0, 1, 1, 2][plane],
                    ring: (share * RINGS as f64) as usize,
                    value: value - black,
                    white: white * (full - black),
                    at: [x, y],
                });
            }
        }
        pixels
    }

    /// What the pixel measures above black, were its gain 1, in digital numbers; `None` where no ray is sure.
    fn foretell(&self, pixel: &Pixel, nearest: &NearestPlace) -> Option<f32> {
        let at = pixel.at.map(|k| k as f64);
        let (nearest, _) = nearest.find(at)?;
        let centre = self.samples.centres[nearest];
        let offset = [at[0] - centre[0], at[1] - centre[1]];
        let distance = offset[0].hypot(offset[1]) / self.pitch;
        if !(ANY_DISTANCES.0..ANY_DISTANCES.1).contains(&distance) {
            return None;
        }
        let place = self.places.place(self.points[nearest], offset.map(|o| o / self.samples.view_step));
        if !place.is_sure {
            return None;
        }
        let mut value = vec![0f32; self.picture.dim().2];
        bicubic_at(self.picture.view(), place.x, place.y, &mut value);
        let colour = value.get(pixel.colour).or(value.first())?;
        Some(colour * pixel.white)
    }
}

/// Measured minus foretold, after a gain of each colour and ring, digital numbers.
fn errors_of(pixels: &[Pixel], foretold: &[f32]) -> Vec<f64> {
    let mut sums = [[[0f64; 2]; RINGS]; 3];
    for (p, f) in pixels.iter().zip(foretold) {
        let sum = &mut sums[p.colour][p.ring];
        sum[0] += f64::from(f * p.value);
        sum[1] += f64::from(f * f);
    }
    let gain = |p: &Pixel| sums[p.colour][p.ring][0] / sums[p.colour][p.ring][1].max(1e-12);
    pixels.iter().zip(foretold).map(|(p, f)| f64::from(p.value) - gain(p) * f64::from(*f)).collect()
}
