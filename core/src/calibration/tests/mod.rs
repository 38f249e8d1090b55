//! The whole calibration against planted truth: accuracy, any lattice, faults of the sensor, symmetries, refusals.

use crate::calibration::error::Error;
use crate::calibration::*;
use crate::container::Capture;
use crate::progress::Silent;
use planted::{BLACK, PlantedCamera, WHITE, capture};

pub(super) mod planted;
mod robustness;

pub(super) const CENTRES: CalibrationOptions = CalibrationOptions {
    variant: CalibrationVariant::Full,
    without_vignetting: true,
    hot_pixels: Vec::new(),
    names: Vec::new(),
};

fn centres(plant: &PlantedCamera) -> (Calibration, Vec<[f64; 2]>) {
    let (white, truth) = plant.white_image();
    let found = calibrate(&[white], &CENTRES, &Silent).unwrap();
    (found, truth.into_iter().map(|t| t.1).collect())
}

/// Over true centres at least `border` pixels inside: RMS distance to the nearest centre found, the largest distance,
/// and the number of errors (true centres without one found within a pixel, and surplus centres found).
pub(super) fn compare(found: &Calibration, truth: &[[f64; 2]], border: f64) -> (f64, f64, usize) {
    let (w, h) = (found.width as f64 - 1.0, found.height as f64 - 1.0);
    let inside = |x: f64, y: f64| x > border && y > border && x < w - border && y < h - border;
    let cell = 4.0;
    let key = |x: f64, y: f64| ((x / cell) as i64, (y / cell) as i64);
    let mut map: std::collections::HashMap<(i64, i64), Vec<[f64; 2]>> = std::collections::HashMap::new();
    for l in &found.lenslets {
        map.entry(key(l.x, l.y)).or_default().push([l.x, l.y]);
    }
    let (mut sum, mut worst, mut lost, mut n) = (0.0, 0f64, 0, 0);
    for c in truth.iter().filter(|c| inside(c[0], c[1])) {
        let (kx, ky) = key(c[0], c[1]);
        let mut least = f64::INFINITY;
        for dy in -1..=1 {
            for dx in -1..=1 {
                for f in map.get(&(kx + dx, ky + dy)).into_iter().flatten() {
                    least = least.min((f[0] - c[0]).hypot(f[1] - c[1]));
                }
            }
        }
        if least > 1.0 {
            lost += 1;
        } else {
            sum += least * least;
            worst = worst.max(least);
            n += 1;
        }
    }
    let expected = truth.iter().filter(|c| inside(c[0], c[1])).count();
    let got = found.lenslets.iter().filter(|l| inside(l.x, l.y)).count();
    // A lenslet on the border line may fall on either side of it.
    let invented = got.saturating_sub(expected + 2 + expected / 200);
    ((sum / f64::from(n.max(1))).sqrt(), worst, lost + invented)
}

/// Largest distance between two lattices over the sensor's corners and middle, up to whole lenslets.
pub(super) fn lattice_distance(found: &Lattice, truth: &Lattice, w: usize, h: usize) -> f64 {
    let (w, h) = (w as f64 - 1.0, h as f64 - 1.0);
    [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h], [w / 2.0, h / 2.0]]
        .iter()
        .map(|p| {
            let [i, j] = found.coordinates(p[0], p[1]).map(|v| v.round() as i32);
            let c = found.centre(i, j);
            let [u, v] = truth.coordinates(c[0], c[1]).map(|v| v.round() as i32);
            let t = truth.centre(u, v);
            (c[0] - t[0]).hypot(c[1] - t[1])
        })
        .fold(0.0, f64::max)
}

#[test]
fn regular_lenslets_are_found_to_hundredths() {
    let plant = PlantedCamera::default();
    let (found, truth) = centres(&plant);
    let (rms, worst, wrong) = compare(&found, &truth, 20.0);
    assert!(rms < 0.01 && worst < 0.05 && wrong == 0, "rms {rms} worst {worst} wrong {wrong}");
    assert!(lattice_distance(&found.lattice, &plant.lattice(), 640, 640) < 0.01);
    assert!((found.lattice.row_stretch() - 1.0004).abs() < 5e-5);
    assert!(found.quality.scatter < 0.006 && found.quality.rejected < 0.01 && found.quality.confidence > 0.9);
}

#[test]
fn lenslets_displaced_from_the_lattice_are_found() {
    let plant = PlantedCamera { jitter: 0.1, rotation: 0.01, ..PlantedCamera::default() };
    let (found, truth) = centres(&plant);
    let (rms, _, wrong) = compare(&found, &truth, 20.0);
    assert!(rms < 0.03 && wrong == 0, "rms {rms} wrong {wrong}");
    assert!((found.quality.scatter - 0.1).abs() < 0.01, "{:?}", found.quality);
    assert!(found.lenslets.iter().filter(|l| l.x > 20.0 && l.x < 620.0).all(|l| l.trust > 0.5));
}

#[test]
fn in_noise_the_shrunk_centre_beats_both_measurement_and_lattice() {
    let plant = PlantedCamera { jitter: 0.1, noise: 2.5, exposure: 0.35, ..PlantedCamera::default() };
    let (found, truth) = centres(&plant);
    let (rms, _, wrong) = compare(&found, &truth, 20.0);
    let lattice_alone = 0.1 * std::f64::consts::SQRT_2;
    let measured_alone = found.quality.noise * std::f64::consts::SQRT_2;
    assert!(rms < 0.10 && rms < lattice_alone && rms < measured_alone && wrong == 0, "{rms} {measured_alone}");
}

#[test]
fn any_pitch_rotation_and_packing_without_a_hint() {
    let mut seed = 0;
    for grid in [Grid::HexRows, Grid::HexColumns, Grid::Square] {
        for (pitch, rotation) in [
            (8.0, 0.0),
            (8.0, -0.1),
            (8.7, 0.04),
            (10.0, 0.0),
            (12.5, 0.1),
            (14.286, -0.02),
            (20.0, 0.07),
            (30.0, -0.05),
            (30.0, 0.1),
        ] {
            seed += 1;
            let plant =
                PlantedCamera { grid, pitch, rotation, seed, width: 560, height: 500, ..PlantedCamera::default() };
            let (found, truth) = centres(&plant);
            let (rms, worst, wrong) = compare(&found, &truth, 20.0);
            let l = found.lattice;
            let said = format!("{grid:?} {pitch} {rotation}: rms {rms:.4} worst {worst:.3} wrong {wrong} {l:?}");
            assert!(
                l.grid == grid && (l.pitch() - pitch).abs() < 0.005 && (l.rotation() - rotation).abs() < 3e-4,
                "{said}"
            );
            assert!(rms < 0.02 && wrong == 0, "{said}");
        }
    }
}

#[test]
fn faults_of_the_sensor_do_no_harm() {
    let plant = PlantedCamera { jitter: 0.05, ..PlantedCamera::default() };
    let (mut white, truth) = plant.white_image();
    let w = plant.width;
    // Dead lenslets, hot pixels, a scratch, a saturated corner, a dark border.
    for (k, (_, c)) in truth.iter().enumerate() {
        if k % 97 == 0 {
            for y in (c[1] - 5.0).max(0.0) as usize..((c[1] + 6.0) as usize).min(plant.height) {
                for x in (c[0] - 5.0).max(0.0) as usize..((c[0] + 6.0) as usize).min(w) {
                    white.mosaic.data[y * w + x] = 180;
                }
            }
        }
        if k % 31 == 5 {
            white.mosaic.data[(c[1] as usize) * w + c[0] as usize] = 4095;
        }
    }
    for y in 0..plant.height {
        for x in 300 + y / 8..303 + y / 8 {
            white.mosaic.data[y * w + x] /= 3;
        }
    }
    for y in 0..90 {
        for x in 0..110 {
            white.mosaic.data[y * w + x] = 4095;
        }
    }
    for y in 600..640 {
        for x in 0..w {
            white.mosaic.data[y * w + x] = 170;
        }
    }
    let found = calibrate(&[white], &CENTRES, &Silent).unwrap();
    let sound: Vec<[f64; 2]> = truth
        .iter()
        .enumerate()
        .filter(|(k, (_, c))| {
            let scratched = c[0] > 285.0 + c[1] / 8.0 && c[0] < 318.0 + c[1] / 8.0;
            k % 97 != 0 && !scratched && !(c[0] < 125.0 && c[1] < 105.0) && c[1] < 590.0
        })
        .map(|t| t.1.1)
        .collect();
    let (rms, _, _) = compare(&found, &sound, 20.0);
    assert!(rms < 0.03, "sound lenslets: {rms}");
    let all: Vec<[f64; 2]> = truth.iter().map(|t| t.1).collect();
    let (rms, worst, wrong) = compare(&found, &all, 20.0);
    assert!(rms < 0.06 && worst < 0.4 && wrong == 0, "all lenslets: {rms} {worst} {wrong}");
    assert!(lattice_distance(&found.lattice, &plant.lattice(), 640, 640) < 0.02);
    // Dead lenslets lie on the lattice and have no trust.
    let dead = truth[97 * 3].1;
    let l = found.lenslets.iter().min_by(|p, q| {
        let d = |l: &Lenslet| (l.x - dead[0]).hypot(l.y - dead[1]);
        d(p).total_cmp(&d(q))
    });
    assert!(l.unwrap().trust < 0.2);
}

#[test]
fn vignetting_does_not_bias_centres() {
    let strong = PlantedCamera { vignetting: 0.85, noise: 0.0, ..PlantedCamera::default() };
    let (found, truth) = centres(&strong);
    let (rms, worst, _) = compare(&found, &truth, 20.0);
    assert!(rms < 0.01 && worst < 0.05, "{rms} {worst}");
}

#[test]
fn a_cropped_image_has_shifted_centres() {
    let plant = PlantedCamera { jitter: 0.1, ..PlantedCamera::default() };
    let (white, _) = plant.white_image();
    let whole = calibrate(std::slice::from_ref(&white), &CENTRES, &Silent).unwrap();
    // An even shift keeps the colours where they are.
    let (dx, dy, w, h) = (38, 64, 520, 480);
    let data = (0..w * h).map(|k| white.mosaic.data[(k / w + dy) * plant.width + k % w + dx]).collect();
    let part = calibrate(&[capture(w, h, data)], &CENTRES, &Silent).unwrap();
    let moved: Vec<[f64; 2]> = whole.lenslets.iter().map(|l| [l.x - dx as f64, l.y - dy as f64]).collect();
    let (rms, _, wrong) = compare(&part, &moved, 20.0);
    assert!(rms < 0.006 && wrong == 0, "{rms} {wrong}");
}

#[test]
fn a_turned_image_has_turned_centres() {
    let plant = PlantedCamera { jitter: 0.1, width: 560, height: 480, ..PlantedCamera::default() };
    let (white, _) = plant.white_image();
    let upright = calibrate(std::slice::from_ref(&white), &CENTRES, &Silent).unwrap();
    let (w, h) = (plant.width, plant.height);
    // A quarter turn clockwise: (x, y) goes to (h−1−y, x).
    let mut data = vec![0u16; w * h];
    for y in 0..h {
        for x in 0..w {
            data[x * h + (h - 1 - y)] = white.mosaic.data[y * w + x];
        }
    }
    let turned = calibrate(&[capture(h, w, data)], &CENTRES, &Silent).unwrap();
    assert_eq!(turned.lattice.grid, Grid::HexColumns);
    let moved: Vec<[f64; 2]> = upright.lenslets.iter().map(|l| [(h - 1) as f64 - l.y, l.x]).collect();
    let (rms, _, wrong) = compare(&turned, &moved, 20.0);
    assert!(rms < 0.006 && wrong == 0, "{rms} {wrong}");
}

#[test]
fn several_whites_beat_one() {
    let plant =
        PlantedCamera { jitter: 0.1, noise: 2.5, exposure: 0.35, width: 400, height: 400, ..PlantedCamera::default() };
    let (first, truth) = plant.white_image();
    let truth: Vec<[f64; 2]> = truth.into_iter().map(|t| t.1).collect();
    // The same camera, other noise: rows of the noise generator start elsewhere, the lenslets' generator does not.
    let mut whites = vec![first];
    let clean = PlantedCamera { noise: 0.0, ..plant.clone() }.white_image().0;
    for n in 1..4u64 {
        let mut other = clean.clone();
        let noise = PlantedCamera { seed: 100 + n, jitter: 0.0, ..plant.clone() };
        let (with, without) = (noise.white_image().0, PlantedCamera { noise: 0.0, ..noise.clone() }.white_image().0);
        for ((v, a), b) in other.mosaic.data.iter_mut().zip(&with.mosaic.data).zip(&without.mosaic.data) {
            *v = (i32::from(*v) + i32::from(*a) - i32::from(*b)).clamp(0, 4095) as u16;
        }
        whites.push(other);
    }
    let one = compare(&calibrate(&whites[..1], &CENTRES, &Silent).unwrap(), &truth, 20.0).0;
    let four = compare(&calibrate(&whites, &CENTRES, &Silent).unwrap(), &truth, 20.0).0;
    assert!(four < 0.75 * one, "{one} {four}");
}

#[test]
fn threads_change_nothing() {
    let (white, _) = PlantedCamera { jitter: 0.1, ..PlantedCamera::default() }.white_image();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| calibrate(std::slice::from_ref(&white), &CalibrationOptions::default(), &Silent).unwrap())
    };
    let one = run(1);
    assert!(one == run(2) && one == run(3));
}

#[test]
fn the_white_pattern_is_one_at_centres_in_full_light() {
    let plant = PlantedCamera { vignetting: 0.0, noise: 0.0, ..PlantedCamera::default() };
    let (white, _) = plant.white_image();
    let found = calibrate(&[white], &CalibrationOptions::default(), &Silent).unwrap();
    let v = found.vignetting.as_ref().unwrap();
    assert_eq!((v.width, v.height, v.white.len()), (640, 640, 640 * 640));
    let mut middle = Vec::new();
    for l in &found.lenslets {
        // Lenslets whose centre is close to a pixel's middle, on every colour.
        if (l.x - l.x.round()).abs() < 0.1 && (l.y - l.y.round()).abs() < 0.1 {
            middle.push(f64::from(v.white[l.y.round() as usize * 640 + l.x.round() as usize]) / 32768.0);
        }
    }
    assert!(middle.len() > 20 && middle.iter().all(|m| (m - 1.0).abs() < 0.02), "{middle:?}");
}

/// RMS of the lattice's own centres.
fn found_on_lattice(found: &Calibration, truth: &[[f64; 2]]) -> f64 {
    let mut on = found.clone();
    for l in &mut on.lenslets {
        [l.x, l.y] = found.lattice.centre(l.i, l.j);
    }
    compare(&on, truth, 20.0).0
}

#[test]
fn algorithm1_as_printed_works_and_is_less_accurate() {
    let plant = PlantedCamera { jitter: 0.1, ..PlantedCamera::default() };
    let (white, truth) = plant.white_image();
    let truth: Vec<[f64; 2]> = truth.into_iter().map(|t| t.1).collect();
    let run = |variant| {
        let options = CalibrationOptions { variant, without_vignetting: true, ..CalibrationOptions::default() };
        let found = calibrate(std::slice::from_ref(&white), &options, &Silent).unwrap();
        let rms = compare(&found, &truth, 20.0).0;
        (found, rms)
    };
    let (full, best) = run(CalibrationVariant::Full);
    let (paper, rms) = run(CalibrationVariant::Paper);
    // Better than the lattice alone, by what erosion and paraboloids measure of every lenslet: 0.063 against 0.146 px.
    let on_lattice = found_on_lattice(&paper, &truth);
    assert!(rms < 0.08 && rms < 0.6 * on_lattice && rms > best, "paper {rms}, lattice {on_lattice}, full {best}");
    let index = |c: &Calibration| c.lenslets.iter().map(|l| [l.i, l.j]).collect::<std::collections::HashSet<_>>();
    assert!(index(&full).symmetric_difference(&index(&paper)).count() < 40);
    let (integer, rms) = run(CalibrationVariant::Integer);
    assert!(rms > 0.3 && integer.lenslets.iter().all(|l| l.x.fract() == 0.0 && l.y.fract() == 0.0));
    let (rotation, _) = run(CalibrationVariant::RotationOnly);
    assert!((rotation.lattice.row_stretch() - 1.0).abs() < 1e-9);
    let (none, _) = run(CalibrationVariant::None);
    assert_eq!((none.lattice.rotation(), none.lattice.pitch()), (0.0, 10.0));
    assert!(none.origin.method.contains("none"));
}

#[test]
fn algorithm1_takes_the_gamma_of_the_header() {
    // White images whose numbers are light to the power 1/γ, and whose header says so: γ makes them linear again.
    let gamma = 0.45f32;
    let plant = PlantedCamera { jitter: 0.1, noise: 0.3, ..PlantedCamera::default() };
    let (linear, truth) = plant.white_image();
    let truth: Vec<[f64; 2]> = truth.into_iter().map(|t| t.1).collect();
    let mut encoded = linear.clone();
    for v in &mut encoded.mosaic.data {
        let light = ((f64::from(*v) - BLACK) / (WHITE - BLACK)).max(0.0);
        *v = (BLACK + (WHITE - BLACK) * light.powf(1.0 / f64::from(gamma))).round() as u16;
    }
    encoded.colour.gamma = Some(gamma);
    let stages = paper::run_algorithm1(std::slice::from_ref(&encoded), &Silent).unwrap();
    let mut off = 0f64;
    for (k, v) in stages.average.data.iter().enumerate() {
        let light = (f64::from(linear.mosaic.data[k]) - BLACK) / (WHITE - BLACK);
        if light > 0.1 {
            off = off.max((f64::from(*v) - light).abs());
        }
    }
    assert!(off < 0.002, "{off}");
    // Without the header's number the exponent is another one's.
    let mut silent = encoded.clone();
    silent.colour.gamma = None;
    let other = paper::run_algorithm1(&[silent], &Silent).unwrap();
    let pairs = stages.average.data.iter().zip(&other.average.data);
    let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0f32, f32::max);
    assert!(apart > 0.02, "{apart}");
    // The centres are those of the linear image.
    let inside = |c: &&[f64; 2]| c.iter().all(|v| (20.0..620.0).contains(v));
    let near =
        |c: &[f64; 2]| truth.iter().map(|t| (t[0] - c[0]).powi(2) + (t[1] - c[1]).powi(2)).fold(f64::MAX, f64::min);
    let squares: Vec<f64> = stages.centres.iter().filter(inside).map(near).collect();
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!(rms < 0.16, "{rms}");
}

#[test]
fn algorithm1_erodes_and_fits_paraboloids() {
    let plant =
        PlantedCamera { jitter: 0.1, pitch: 11.0, rotation: 0.02, width: 400, height: 360, ..PlantedCamera::default() };
    let (white, truth) = plant.white_image();
    let stages = paper::run_algorithm1(std::slice::from_ref(&white), &Silent).unwrap();
    // Every eroded pixel is the least of the rotated image within a fifth of a pitch.
    let mut changed = 0;
    for (x, y) in (10..350).step_by(7).flat_map(|y| (10..390).step_by(11).map(move |x| (x, y))) {
        let disc =
            (-2i64..=2).flat_map(|dy| (-2i64..=2).map(move |dx| (dx, dy))).filter(|(dx, dy)| dx * dx + dy * dy <= 4);
        let read = |(dx, dy)| stages.turned.at((x as i64 + dx) as usize, (y as i64 + dy) as usize);
        let least = disc.map(read).fold(f32::INFINITY, f32::min);
        assert_eq!(stages.eroded.at(x, y), least);
        changed += usize::from(least < stages.turned.at(x, y));
    }
    assert!(changed > 1000, "{changed}");
    // The tops of the paraboloids are much nearer to the lenslets than the brightest eroded pixels are.
    let rms = |centres: &[[f64; 2]]| {
        let near = |c: &[f64; 2]| {
            truth.iter().map(|(_, t)| (t[0] - c[0]).powi(2) + (t[1] - c[1]).powi(2)).fold(f64::MAX, f64::min)
        };
        let inside = |c: &&[f64; 2]| (20.0..380.0).contains(&c[0]) && (20.0..340.0).contains(&c[1]);
        let squares: Vec<f64> = centres.iter().filter(inside).map(near).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let whole: Vec<[f64; 2]> = stages.centres.iter().map(|c| c.map(f64::round)).collect();
    let (fitted, whole) = (rms(&stages.centres), rms(&whole));
    assert!(fitted < 0.16 && whole > 2.0 * fitted, "{fitted} {whole}");
}

/// Scenes: broad colour changes and edges, in light that falls on the same lenslets.
pub(super) fn scenes(white: &Capture, count: u32) -> Vec<Capture> {
    let width = white.mosaic.width;
    let of = |n: u32| {
        let n = f64::from(n);
        let mut scene = white.clone();
        for (k, v) in scene.mosaic.data.iter_mut().enumerate() {
            let (x, y) = ((k % width) as f64, (k / width) as f64);
            let broad = 0.45 + 0.3 * (x / 90.0 + n).sin() * (y / 70.0 - 2.0 * n).cos();
            let bars = if ((x * (1.0 + 0.3 * n) + y) / 37.0).sin() > 0.3 { 0.55 } else { 1.0 };
            *v = (BLACK + (f64::from(*v) - BLACK) * broad * bars).clamp(0.0, WHITE) as u16;
        }
        scene
    };
    (0..count).map(of).collect()
}

#[test]
fn captures_without_whites_give_the_lattice() {
    let plant = PlantedCamera { jitter: 0.1, width: 700, height: 600, ..PlantedCamera::default() };
    let (white, truth) = plant.white_image();
    let scenes = scenes(&white, 4);
    let found = calibrate_from_captures(&scenes, &CalibrationOptions::default(), &Silent).unwrap();
    assert!(lattice_distance(&found.lattice, &plant.lattice(), 700, 600) < 0.1);
    let truth: Vec<[f64; 2]> = truth.into_iter().map(|t| t.1).collect();
    let (rms, _, wrong) = compare(&found, &truth, 20.0);
    assert!(rms < 0.13 && wrong == 0, "{rms} {wrong}");
    let one = calibrate_from_captures(&scenes[..1], &CalibrationOptions::default(), &Silent).unwrap();
    assert!(lattice_distance(&one.lattice, &plant.lattice(), 700, 600) < 0.2);
    assert!(one.lenslets.iter().all(|l| l.trust == 0.0) && one.quality.confidence > 0.3, "{:?}", one.quality);
    // The mean micro-image is bright in the middle and dark at the rim.
    let v = found.vignetting.unwrap();
    let at = |x: f64, y: f64| f64::from(v.white[y.round() as usize * 700 + x.round() as usize]) / 32768.0;
    let l = found.lattice;
    let (mut middle, mut rim) = (0.0, 0.0);
    for i in -20..20 {
        let (c, next) = (l.centre(i, 3), l.centre(i + 1, 3));
        middle += at(c[0], c[1]) / 40.0;
        rim += at(0.5 * (c[0] + next[0]), 0.5 * (c[1] + next[1])) / 40.0;
    }
    assert!((middle - 1.0).abs() < 0.05 && rim < 0.5, "{middle} {rim}");
}

#[test]
fn images_without_lenslets_are_refused_with_the_reason() {
    let size = 256;
    let of = |f: &dyn Fn(usize, usize) -> f64| {
        capture(size, size, (0..size * size).map(|k| f(k % size, k / size).clamp(0.0, WHITE) as u16).collect())
    };
    let run = |c: Capture| calibrate(&[c], &CENTRES, &Silent).unwrap_err();
    assert!(matches!(calibrate(&[], &CENTRES, &Silent), Err(Error::NoImages)));
    assert!(matches!(run(of(&|_, _| BLACK + 2.0)), Error::Black { .. }));
    assert!(matches!(run(of(&|_, _| WHITE)), Error::Saturated { .. }));
    assert!(matches!(run(of(&|_, _| 2000.0)), Error::NoPattern { .. }));
    let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729 + x * y * 31) % 4001) as f64;
    assert!(matches!(run(of(&|x, y| 1000.0 + hash(x, y) * 0.3)), Error::NoPattern { .. }));
    // Smooth shapes with edges: a photograph. Stripes: a pattern in one direction only.
    let scene = |x: usize, y: usize| {
        let blob = ((x as f64 / 41.0).sin() + (y as f64 / 29.0).cos() > 0.4) as u8 as f64;
        900.0 + 1500.0 * blob + 3.0 * x as f64 + 0.1 * hash(x, y)
    };
    assert!(matches!(run(of(&scene)), Error::NoPattern { .. }));
    assert!(matches!(run(of(&|x, _| 1500.0 + 900.0 * (x as f64 * 0.628).cos())), Error::NoPattern { .. }));
    let small = capture(32, 32, vec![900; 1024]);
    assert!(matches!(run(small), Error::BadImage { .. }));
    let mut short = of(&|_, _| 900.0);
    short.mosaic.data.pop();
    assert!(matches!(run(short), Error::BadImage { .. }));
    let mut levels = of(&|_, _| 900.0);
    levels.levels.white = [f32::NAN; 4];
    assert!(matches!(run(levels), Error::BadImage { .. }));
}

#[test]
fn images_of_different_cameras_are_refused() {
    let (white, _) = PlantedCamera { width: 200, height: 200, ..PlantedCamera::default() }.white_image();
    let (other, _) = PlantedCamera { width: 220, height: 200, ..PlantedCamera::default() }.white_image();
    assert!(matches!(calibrate(&[white.clone(), other], &CENTRES, &Silent), Err(Error::SizesDiffer { index: 2, .. })));
    let named = |serial: &str| {
        let mut c = white.clone();
        c.camera.serial = Some(serial.into());
        c
    };
    let pair = [named("A1"), named("B2")];
    assert!(matches!(calibrate(&pair, &CENTRES, &Silent), Err(Error::CamerasDiffer { index: 2, .. })));

    let found = calibrate(&pair[..1], &CENTRES, &Silent).unwrap();
    assert!(check_compatible(&found, &pair[0]).is_ok() && check_compatible(&found, &white).is_ok());
    assert!(check_compatible(&found, &pair[1]).unwrap_err().to_string().contains("B2"));
    let mut larger = white.clone();
    larger.mosaic.width = 210;
    assert!(matches!(check_compatible(&found, &larger), Err(Error::WrongCamera(_))));
    let mut zoomed = white;
    zoomed.camera.zoom_step = Some(12);
    let mut at_nine = found;
    at_nine.origin.zoom_step = Some(9);
    assert_eq!(lens_setting_differences(&at_nine, &zoomed).len(), 1);
}

#[test]
fn interruption_ends_the_work() {
    struct Stop;
    impl crate::progress::Observer for Stop {
        fn cancelled(&self) -> bool {
            true
        }
    }
    let (white, _) = PlantedCamera { width: 200, height: 200, ..PlantedCamera::default() }.white_image();
    assert!(matches!(calibrate(std::slice::from_ref(&white), &CENTRES, &Stop), Err(Error::Interrupted(_))));
    assert!(matches!(calibrate_from_captures(&[white], &CENTRES, &Stop), Err(Error::Interrupted(_))));
}
