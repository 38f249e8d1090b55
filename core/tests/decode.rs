//! Decoding planted scenes: what a small simulated sensor saw must come back, view by view.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use lenslet_core::calibration::{Calibration, Vignetting};
use lenslet_core::container::{CameraFacts, Capture, Cfa, ColourFacts, Levels, RawMosaic};
use lenslet_core::decode::{self, Demosaic, Error, HexSamples, Options, RawStep, Steps, ViewStep, WhiteBalance};
use lenslet_core::geometry::{Lattice, Size};
use lenslet_core::progress::Silent;

const WIDTH: usize = 180;
const HEIGHT: usize = 150;
const PITCH: f64 = 10.0;
const BLACK: f32 = 168.0;
const WHITE: f32 = 4095.0;
const RESPONSE: [f32; 3] = [0.76, 1.0, 0.74];
const KINDS: [Demosaic; 3] = Demosaic::ALL;

/// Relative light at a pixel: bright at its lenslet's centre, dark at the border, and the lenslet's number.
fn micro_image(centres: &[[f64; 2]], x: usize, y: usize) -> (f32, usize) {
    let d = |c: &[f64; 2]| (c[0] - x as f64).hypot(c[1] - y as f64);
    let (k, c) = centres.iter().enumerate().min_by(|a, b| d(a.1).total_cmp(&d(b.1))).unwrap();
    let r = d(c) / (PITCH / 2.0);
    ((1.0 - 0.8 * r * r).max(0.06) as f32, k)
}

/// A camera, and a capture of `scene(x, y, colour)` seen where each pixel looks: at its lenslet's centre plus
/// `disparity` times the pixel's offset from it. `light` multiplies everything.
fn planted(cfa: Cfa, disparity: f64, light: f32, scene: impl Fn(f64, f64, usize) -> f64) -> (Capture, Calibration) {
    let lattice = Lattice::hexagonal(PITCH, 0.003, 1.0004, [91.3, 76.8]);
    // Lenslets whose centres lie off the sensor have micro-images on it, too.
    let mut wide = Lattice::hexagonal(PITCH, 0.003, 1.0004, [91.3 + 30.0, 76.8 + 30.0]);
    let all: Vec<[f64; 2]> = wide
        .points_within(Size::new(WIDTH + 60, HEIGHT + 60), 0.0)
        .centres
        .iter()
        .map(|c| [c[0] - 30.0, c[1] - 30.0])
        .collect();
    wide.origin = lattice.origin;
    assert_eq!(wide, lattice);
    let (mut data, mut white) = (Vec::new(), Vec::new());
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let (w, k) = micro_image(&all, x, y);
            let look = [0, 1].map(|n| all[k][n] + disparity * ([x, y][n] as f64 - all[k][n]));
            let c = cfa.colour(x, y);
            let response = if cfa == Cfa::Mono { 1.0 } else { RESPONSE[c] };
            let value = light * w * response * scene(look[0], look[1], c) as f32;
            data.push((BLACK + (WHITE - BLACK) * value).round().clamp(0.0, WHITE) as u16);
            white.push((w * 32768.0).round() as u16);
        }
    }
    let gains = RESPONSE.map(|r| 1.0 / r);
    let capture = Capture {
        mosaic: RawMosaic { width: WIDTH, height: HEIGHT, data },
        cfa,
        levels: Levels { black: [BLACK; 4], white: [WHITE; 4] },
        colour: ColourFacts {
            white_balance: [gains[0], gains[1], gains[1], gains[2]],
            ccm: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            gamma: None,
        },
        camera: CameraFacts::default(),
        mla: None,
        source_sha256: String::new(),
        jpeg: false,
        white: None,
        warnings: Vec::new(),
    };
    let mut calibration = Calibration::of_lattice(lattice, Size::new(WIDTH, HEIGHT));
    calibration.vignetting = Some(Vignetting { width: WIDTH, height: HEIGHT, white });
    (capture, calibration)
}

fn with(demosaic: Demosaic) -> Options {
    Options { steps: Steps { demosaic, ..Steps::default() }, ..Options::default() }
}

fn without_raw(step: RawStep) -> Options {
    let mut options = Options::default();
    options.steps.raw.retain(|s| *s != step);
    options
}

fn without_view(step: ViewStep) -> Options {
    let mut options = Options::default();
    options.steps.view.retain(|s| *s != step);
    options
}

fn decoded(capture: &Capture, calibration: &Calibration, options: &Options) -> HexSamples {
    decode::sample_views(capture, calibration, options, &Silent).unwrap()
}

/// Lenslets at least `margin` pixels from the sensor's border.
fn inner(samples: &HexSamples, margin: f64) -> Vec<usize> {
    let keep =
        |c: &[f64; 2]| c[0] > margin && c[1] > margin && c[0] < WIDTH as f64 - margin && c[1] < HEIGHT as f64 - margin;
    (0..samples.centres.len()).filter(|&k| keep(&samples.centres[k])).collect()
}

#[test]
fn a_white_scene_is_grey_in_every_view_with_every_demosaic() {
    for cfa in [Cfa::Bggr, Cfa::Grbg, Cfa::Rggb, Cfa::Gbrg] {
        let (capture, calibration) = planted(cfa, 0.3, 0.9, |_, _, _| 0.8);
        for kind in KINDS {
            let samples = decoded(&capture, &calibration, &with(kind));
            assert_eq!(samples.values.dim(), (49, calibration.lenslets.len(), 3));
            for view in samples.values.outer_iter() {
                let mean: Vec<f32> = (0..3).map(|c| view.column(c).mean().unwrap()).collect();
                for c in 0..3 {
                    assert!((mean[c] / 0.72 - 1.0).abs() < 0.005, "{kind:?} {mean:?}");
                    assert!((mean[c] / mean[1] - 1.0).abs() < 0.002, "{kind:?} {mean:?}");
                }
            }
        }
    }
}

#[test]
fn a_sensor_without_filters_gives_one_channel() {
    let (capture, calibration) = planted(Cfa::Mono, 0.0, 0.9, |_, _, _| 0.5);
    for kind in KINDS {
        let samples = decoded(&capture, &calibration, &with(kind));
        assert_eq!(samples.values.dim().2, 1);
        let mean = samples.values.mean().unwrap();
        assert!((mean / 0.45 - 1.0).abs() < 0.005, "{kind:?} {mean}");
    }
}

/// sRGB primaries, linear, to CIE L*a*b* (D65).
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let m = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
    let white = [0.9505, 1.0, 1.089];
    let f = |t: f64| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
    let [x, y, z]: [f64; 3] = std::array::from_fn(|k| f((0..3).map(|c| m[k][c] * rgb[c]).sum::<f64>() / white[k]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[test]
fn a_colour_chart_comes_back_within_one_delta_e() {
    // Camera colours are the inverse of this matrix times the chart's.
    let to_srgb = [1.8, -0.6, -0.2, -0.3, 1.6, -0.3, 0.1, -0.7, 1.6];
    let inverse = {
        let m: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| to_srgb[3 * r + c]));
        let minor = |r: usize, c: usize| {
            let (a, b, d, e) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
            m[a][d] * m[b][e] - m[a][e] * m[b][d]
        };
        let det: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
        let out: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / det));
        out
    };
    let chart = [
        [0.18, 0.085, 0.058],
        [0.57, 0.30, 0.22],
        [0.13, 0.51, 0.41],
        [0.71, 0.20, 0.03],
        [0.80, 0.80, 0.80],
        [0.05, 0.05, 0.05],
    ];
    for kind in KINDS {
        let mut worst: f64 = 0.0;
        for colour in chart {
            let camera: [f64; 3] = std::array::from_fn(|r| (0..3).map(|c| inverse[r][c] * colour[c]).sum());
            let (mut capture, calibration) = planted(Cfa::Bggr, 0.2, 1.0, |_, _, c| camera[c]);
            capture.colour.ccm = to_srgb.map(|v| v as f32);
            let samples = decoded(&capture, &calibration, &with(kind));
            for view in samples.values.outer_iter() {
                let got: [f64; 3] = std::array::from_fn(|c| f64::from(view.column(c).mean().unwrap()));
                let (a, b) = (lab(got), lab(colour));
                worst = worst.max((0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt());
            }
        }
        assert!(worst < 1.0, "{kind:?}: {worst}");
    }
}

#[test]
fn views_see_the_scene_from_their_own_side() {
    // A tilted plane of light: view (v, u) must see it shifted by disparity times (u, v).
    let plane = |x: f64, y: f64| 0.2 + 0.003 * x + 0.001 * y;
    let disparity = 1.5;
    let (capture, calibration) = planted(Cfa::Bggr, disparity, 0.9, |x, y, _| plane(x, y));
    for kind in KINDS {
        let samples = decoded(&capture, &calibration, &with(kind));
        for (view, values) in samples.values.outer_iter().enumerate() {
            let (u, v) = ((view % 7) as f64 - 3.0, (view / 7) as f64 - 3.0);
            let mut error = 0.0;
            let inner = inner(&samples, 12.0);
            for &k in &inner {
                let [x, y] = samples.centres[k];
                let truth = 0.9 * plane(x + disparity * u, y + disparity * v);
                for c in 0..3 {
                    error += (f64::from(values[[k, c]]) / truth - 1.0).powi(2);
                }
            }
            let rms = (error / (3 * inner.len()) as f64).sqrt();
            // The four corner views lie 4.2 pixels out, at the micro-image's border, where the plain demosaics mix.
            let limit = if kind == Demosaic::CoKriging || u.hypot(v) < 4.0 { 0.01 } else { 0.05 };
            assert!(rms < limit, "{kind:?} ({v}, {u}): {rms}");
        }
    }
}

#[test]
fn nothing_leaks_in_from_the_neighbouring_micro_image() {
    // Half the lenslets see white, half black, in columns of the lattice two lenslets wide.
    let (capture, calibration) =
        planted(Cfa::Bggr, 0.0, 0.9, |x, _, _| if (x / 20.0).floor() as i64 % 2 == 0 { 0.9 } else { 0.1 });
    let error = |kind| {
        let samples = decoded(&capture, &calibration, &with(kind));
        let mut worst: f64 = 0.0;
        for &k in &inner(&samples, 12.0) {
            let truth = 0.9 * if (samples.centres[k][0] / 20.0).floor() as i64 % 2 == 0 { 0.9 } else { 0.1 };
            for view in samples.values.outer_iter() {
                worst = worst.max((f64::from(view[[k, 1]]) - truth).abs());
            }
        }
        worst
    };
    assert!(error(Demosaic::CoKriging) < 0.01);
    assert!(error(Demosaic::Malvar) > 0.1);
}

#[test]
fn saturated_light_is_neutral_and_nothing_is_infinite() {
    let (capture, mut calibration) = planted(Cfa::Bggr, 0.0, 1.0, |_, _, _| 30.0);
    let samples = decoded(&capture, &calibration, &Options::default());
    let middle = samples.values.index_axis(ndarray::Axis(0), 24);
    assert!(middle.iter().all(|v| (v - 1.0).abs() < 0.005));
    // Without that step the colours end at different heights.
    let mut options = without_raw(RawStep::Highlights);
    options.steps.view.retain(|s| *s != ViewStep::Gamut);
    let samples = decoded(&capture, &calibration, &options);
    let middle = samples.values.index_axis(ndarray::Axis(0), 24);
    assert!(middle.column(0).mean().unwrap() / middle.column(1).mean().unwrap() > 1.2);
    // A white image with black pixels.
    calibration.vignetting.as_mut().unwrap().white.iter_mut().step_by(7).for_each(|w| *w = 0);
    for kind in KINDS {
        assert!(decoded(&capture, &calibration, &with(kind)).values.iter().all(|v| v.is_finite()));
    }
}

#[test]
fn each_step_does_its_part() {
    let (mut capture, mut calibration) = planted(Cfa::Bggr, 0.0, 0.9, |_, _, _| 0.5);
    let mean = |samples: &HexSamples, view: usize, c: usize| {
        samples.values.index_axis(ndarray::Axis(0), view).column(c).mean().unwrap()
    };
    let all = decoded(&capture, &calibration, &Options::default());
    let s = decoded(&capture, &calibration, &without_raw(RawStep::Vignetting));
    assert!(mean(&s, 0, 1) < 0.7 * mean(&s, 24, 1) && (mean(&all, 0, 1) / mean(&all, 24, 1) - 1.0).abs() < 0.01);
    let s = decoded(&capture, &calibration, &without_raw(RawStep::WhiteBalance));
    assert!((mean(&s, 24, 0) / mean(&s, 24, 1) - RESPONSE[0]).abs() < 0.01);
    let s = decoded(&capture, &calibration, &without_raw(RawStep::BlackLevel));
    assert!(mean(&s, 24, 1) > 1.04 * mean(&all, 24, 1));
    let mut brighter = Options::default();
    brighter.steps.view.push(ViewStep::Exposure(1.0));
    assert!((mean(&decoded(&capture, &calibration, &brighter), 24, 1) / mean(&all, 24, 1) - 2.0).abs() < 1e-4);
    let auto = Options { white_balance: WhiteBalance::Auto, ..Options::default() };
    let s = decoded(&capture, &calibration, &auto);
    assert!((mean(&s, 24, 0) / mean(&s, 24, 1) - 1.0).abs() < 0.01);
    let gains = Options { white_balance: WhiteBalance::Gains([1.0, 1.0, 2.0]), ..Options::default() };
    let s = decoded(&capture, &calibration, &gains);
    assert!((mean(&s, 24, 2) / mean(&s, 24, 1) - 2.0 * RESPONSE[2]).abs() < 0.02);
    // One hot pixel.
    capture.mosaic.data[75 * WIDTH + 90] = 4095;
    let hot = decoded(&capture, &calibration, &Options::default());
    let worst = hot.values.iter().zip(&all.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.02, "{worst}");
    let left = decoded(&capture, &calibration, &without_raw(RawStep::HotPixels));
    let worst = left.values.iter().zip(&all.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst > 0.1, "{worst}");
    // A warm one, too faint to stand out, and a cluster that hides its own: known from black images.
    let known: Vec<u32> = [(90, 75), (92, 75), (90, 77), (92, 77), (60, 61), (0, 0), (179, 149)]
        .iter()
        .map(|(x, y)| (y * WIDTH + x) as u32)
        .collect();
    known.iter().for_each(|&k| capture.mosaic.data[k as usize] += 900);
    let off = |calibration: &Calibration| {
        let s = decoded(&capture, calibration, &Options::default());
        s.values.iter().zip(&all.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let unknown = off(&calibration);
    calibration.hot_pixels = known;
    calibration.hot_pixels.sort_unstable();
    let worst = off(&calibration);
    assert!(worst < 0.05 && worst < 0.5 * unknown, "{worst} {unknown}");
    calibration.hot_pixels.reverse();
    assert!(matches!(
        decode::sample_views(&capture, &calibration, &Options::default(), &Silent),
        Err(Error::Calibration(_))
    ));
}

#[test]
fn threads_do_not_matter_and_neither_does_a_shift_of_everything() {
    let texture = |x: f64, y: f64, c: usize| 0.5 + 0.3 * (0.31 * x + 0.2 * c as f64).sin() * (0.23 * y).cos();
    let (capture, calibration) = planted(Cfa::Bggr, 0.4, 0.9, texture);
    for kind in KINDS {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| decoded(&capture, &calibration, &with(kind)))
        };
        let one = run(1);
        assert_eq!(one, run(3), "{kind:?}");
        // Two pixels cut off at the left and the top: the filter array stays in step, everything else moves along.
        let (mut cut, mut moved) = (capture.clone(), calibration.clone());
        let crop =
            |v: &[u16]| -> Vec<u16> { (2..HEIGHT).flat_map(|y| v[y * WIDTH + 2..(y + 1) * WIDTH].to_vec()).collect() };
        cut.mosaic = RawMosaic { width: WIDTH - 2, height: HEIGHT - 2, data: crop(&capture.mosaic.data) };
        let white = &calibration.vignetting.as_ref().unwrap().white;
        moved.vignetting = Some(Vignetting { width: WIDTH - 2, height: HEIGHT - 2, white: crop(white) });
        (moved.width, moved.height) = (WIDTH - 2, HEIGHT - 2);
        for l in &mut moved.lenslets {
            (l.x, l.y) = (l.x - 2.0, l.y - 2.0);
        }
        let shifted = decoded(&cut, &moved, &with(kind));
        for &k in &inner(&one, 14.0) {
            for view in 0..49 {
                for c in 0..3 {
                    let (a, b) = (one.values[[view, k, c]], shifted.values[[view, k, c]]);
                    assert!((a - b).abs() < 2e-3, "{kind:?} view {view} lenslet {k}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn bad_input_is_told_by_whose_fault_it_is() {
    let (capture, calibration) = planted(Cfa::Bggr, 0.0, 0.9, |_, _, _| 0.5);
    let run = |c: &Capture, k: &Calibration, o: &Options| decode::sample_views(c, k, o, &Silent).map(|_| ());
    let good = Options::default();
    let mut k = calibration.clone();
    k.width += 1;
    assert!(matches!(run(&capture, &k, &good), Err(Error::WrongCamera(_))));
    let mut c = capture.clone();
    c.mosaic.data.pop();
    assert!(matches!(run(&c, &calibration, &good), Err(Error::Capture(_))));
    let mut c = capture.clone();
    c.levels.white = [BLACK; 4];
    assert!(matches!(run(&c, &calibration, &good), Err(Error::Capture(_))));
    let mut c = capture.clone();
    c.colour.white_balance[2] = f32::NAN;
    assert!(matches!(run(&c, &calibration, &good), Err(Error::Capture(_))));
    let mut k = calibration.clone();
    k.lenslets.clear();
    assert!(matches!(run(&capture, &k, &good), Err(Error::Calibration(_))));
    let mut k = calibration.clone();
    k.lenslets[3].x = f64::NAN;
    assert!(matches!(run(&capture, &k, &good), Err(Error::Calibration(_))));
    let mut k = calibration.clone();
    k.vignetting.as_mut().unwrap().white.pop();
    assert!(matches!(run(&capture, &k, &good), Err(Error::Calibration(_))));
    let mut k = calibration.clone();
    k.lattice.a = [0.0, 0.0];
    assert!(matches!(run(&capture, &k, &good), Err(Error::Calibration(_))));
    for options in [
        Options { views: 6, ..Options::default() },
        Options { views: 17, ..Options::default() },
        Options { view_step: f64::NAN, ..Options::default() },
        Options { steps: Steps { view: vec![ViewStep::Exposure(f32::NAN)], ..Steps::default() }, ..Options::default() },
        Options { white_balance: WhiteBalance::Gains([0.0, 1.0, 1.0]), ..Options::default() },
    ] {
        assert!(matches!(run(&capture, &calibration, &options), Err(Error::Parameter(_))), "{options:?}");
    }
}

/// Light of one view of a decoded scene, green.
fn green(samples: &HexSamples, view: usize) -> f32 {
    samples.values.index_axis(ndarray::Axis(0), view).column(1).mean().unwrap()
}

#[test]
fn the_stated_exposure_bias_is_applied_with_the_offset_of_the_camera() {
    let (mut capture, calibration) = planted(Cfa::Bggr, 0.0, 0.9, |_, _, _| 0.4);
    let plain = green(&decoded(&capture, &calibration, &Options::default()), 24);
    capture.camera.exposure_bias = Some(-0.5);
    for (model, stops) in [(None, -0.5), (Some("ILLUM"), -0.5), (Some("F01"), 0.5)] {
        capture.camera.model = model.map(str::to_owned);
        let got = green(&decoded(&capture, &calibration, &Options::default()), 24);
        assert!((got / plain / f32::exp2(stops) - 1.0).abs() < 1e-3, "{model:?}: {got} {plain}");
        let left = green(&decoded(&capture, &calibration, &without_view(ViewStep::ExposureBias)), 24);
        assert!((left / plain - 1.0).abs() < 1e-4);
    }
}

#[test]
fn colours_out_of_reach_fit_only_with_that_step() {
    // Dark green as a strong matrix makes it: red and blue below 0.
    let (mut capture, calibration) = planted(Cfa::Bggr, 0.0, 0.9, |_, _, c| [0.06, 0.12, 0.05][c]);
    capture.colour.ccm = [3.1, -1.94, -0.16, -0.36, 1.64, -0.28, 0.08, -1.16, 2.08];
    let open = decoded(&capture, &calibration, &without_view(ViewStep::Gamut));
    assert!(open.values.iter().any(|v| *v < -0.02));
    let fitted = decoded(&capture, &calibration, &Options::default());
    assert!(fitted.values.iter().all(|v| (0.0..=1.0).contains(v)));
    for k in inner(&open, 12.0) {
        let luminance = |s: &HexSamples| {
            0.2126 * s.values[[24, k, 0]] + 0.7152 * s.values[[24, k, 1]] + 0.0722 * s.values[[24, k, 2]]
        };
        assert!((luminance(&open) - luminance(&fitted)).abs() < 1e-5);
        assert!(fitted.values[[24, k, 1]] > 2.0 * fitted.values[[24, k, 0]].max(fitted.values[[24, k, 2]]));
    }
}

#[test]
fn views_are_recentred_on_the_aperture() {
    let plane = |x: f64, y: f64, _: usize| 0.2 + 0.003 * x + 0.001 * y;
    let (capture, calibration) = planted(Cfa::Bggr, 1.5, 0.9, plane);
    let truth = decoded(&capture, &calibration, &Options::default());
    let off = |samples: &HexSamples, k: usize| {
        (0..2)
            .map(|n| (samples.centres[k][n] - [calibration.lenslets[k].x, calibration.lenslets[k].y][n]).abs())
            .fold(0.0, f64::max)
    };
    assert!((0..truth.centres.len()).all(|k| off(&truth, k) < 0.05));
    // A calibration whose centres are all off by the same: the white image knows better.
    let mut wrong = calibration.clone();
    for l in &mut wrong.lenslets {
        (l.x, l.y) = (l.x + 0.6, l.y - 0.4);
    }
    let again = decoded(&capture, &wrong, &Options::default());
    assert!((0..truth.centres.len()).all(|k| off(&again, k) < 0.08), "{}", off(&again, 0));
    let left = decoded(&capture, &wrong, &Options { recentre: false, ..Options::default() });
    let error = |s: &HexSamples| {
        inner(s, 14.0).iter().map(|&k| (s.values[[24, k, 1]] - truth.values[[24, k, 1]]).abs()).fold(0.0, f32::max)
    };
    // Seen from 0.6 pixels aside the plane is 0.6·1.5·0.003 brighter; that is what is mended.
    assert!(error(&again) < 0.0012 && error(&left) > 0.0015, "{} {}", error(&again), error(&left));
    // Nothing to go by: nothing is moved.
    wrong.vignetting = None;
    let blind = decoded(&capture, &wrong, &Options::default());
    assert_eq!(blind.centres[0], [wrong.lenslets[0].x, wrong.lenslets[0].y]);
}

#[test]
fn weights_tell_how_well_each_view_is_lit() {
    let (capture, calibration) = planted(Cfa::Bggr, 0.0, 0.9, |_, _, _| 0.5);
    let samples = decoded(&capture, &calibration, &Options { views: 11, ..Options::default() });
    assert_eq!(samples.weights.len(), 121);
    let at = |u: i32, v: i32| samples.weights[((v + 5) * 11 + u + 5) as usize];
    assert!(at(0, 0) > 0.98);
    // The planted micro-image: 1 − 0.8·(r/5)², at least 0.06.
    for (u, v) in [(2, 0), (0, -3), (2, 2), (-3, 1)] {
        let truth = (1.0 - 0.8 * f64::from(u * u + v * v) / 25.0) as f32;
        assert!((at(u, v) - truth).abs() < 0.05, "({u}, {v}): {} for {truth}", at(u, v));
    }
    // Seven pixels away another lenslet begins.
    assert_eq!([at(-5, 5), at(5, -5), at(5, 5)], [0.0; 3]);
    let mut blind = calibration.clone();
    blind.vignetting = None;
    assert!(decoded(&capture, &blind, &Options::default()).weights.iter().all(|w| *w == 1.0));
}
