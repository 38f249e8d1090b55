//! Planted surfaces seen by a small hexagonal camera: what refinement must gain, and where it must not lose.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, ColourSpace, Format, LightField, Meta, ReadOptions};
use lenslet_core::progress::Silent;
use lenslet_core::sampling::bicubic;
use lenslet_views::interpolate::prepare_interpolator;
use lenslet_views::inverse::SampleFootprint;
use lenslet_views::multiview::{Fit, Options, RefinedViews, SampleSet, hidden_score};
use ndarray::{Array2, Array3, Array5, ArrayView3, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

const SENSOR: usize = 600;
const SIDE: usize = 200;
const PITCH: f64 = 10.0;

/// Coarse shapes, and fine detail that lenslets 3.3 output pixels apart cannot hold; x, y in output pixels.
fn texture(x: f64, y: f64) -> f64 {
    let coarse = 0.12 * (0.21 * x + 0.35 * y).sin()
        + 0.1 * (0.43 * x - 0.17 * y).cos()
        + 0.06 * (0.31 * y + 0.02 * x * x.abs().sqrt()).sin();
    0.5 + coarse + 0.07 * (1.3 * x + 0.5 * y).sin() + 0.06 * (0.7 * y - 1.2 * x).cos()
}

/// Detail that lenslets 3.3 output pixels apart just hold: nothing below 8 pixels a period.
fn resolved(x: f64, y: f64) -> f64 {
    0.5 + 0.12 * (0.21 * x + 0.35 * y).sin()
        + 0.1 * (0.43 * x - 0.17 * y).cos()
        + 0.07 * (0.62 * x + 0.4 * y).sin()
        + 0.06 * (0.5 * y - 0.55 * x).cos()
}

/// What is seen at (s, t) of the view (u, v) steps from the middle one; output pixels.
type World = Box<dyn Fn(f64, f64, f64, f64) -> f64>;

/// A surface whose disparity at the middle view's pixel (x, y) is `d`.
fn surface(d: impl Fn(f64, f64) -> f64 + 'static) -> World {
    painted(d, texture)
}

fn painted(d: impl Fn(f64, f64) -> f64 + 'static, paint: fn(f64, f64) -> f64) -> World {
    Box::new(move |s, t, u, v| {
        let (mut x, mut y) = (s, t);
        for _ in 0..20 {
            let here = d(x, y);
            (x, y) = (s - here * u, t - here * v);
        }
        paint(x, y)
    })
}

/// What a small camera measures of a world; `noise`: width of an even distribution.
fn measured(world: &World, noise: f32) -> HexSamples {
    let scale = SIDE as f64 / SENSOR as f64;
    let mut centres = Vec::new();
    let mut index = Vec::new();
    for j in 0..70 {
        for i in 0..61 {
            let c = [(f64::from(i) + 0.5 * f64::from(j % 2)) * PITCH + 1.3, f64::from(j) * PITCH * 0.866 + 0.7];
            if c[0] < SENSOR as f64 && c[1] < SENSOR as f64 {
                centres.push(c);
                index.push([i, j]);
            }
        }
    }
    let mut generator = ChaCha8Rng::seed_from_u64(12345);
    let values = Array3::from_shape_fn((25, centres.len(), 1), |(k, n, _)| {
        let (v, u) = ((k / 5) as f64 - 2.0, (k % 5) as f64 - 2.0);
        let (s, t) = ((centres[n][0] + 0.5) * scale - 0.5, (centres[n][1] + 0.5) * scale - 0.5);
        world(s, t, u, v) as f32 + noise * (generator.random::<f32>() - 0.5)
    });
    HexSamples {
        sensor: Size::new(SENSOR, SENSOR),
        centres,
        index,
        views: 5,
        view_step: 1.0,
        weights: vec![1.0; 25],
        values,
    }
}

fn samples(d: impl Fn(f64, f64) -> f64 + 'static, noise: f32) -> HexSamples {
    measured(&surface(d), noise)
}

const TARGET: Size = Size { width: SIDE, height: SIDE };

/// The small camera measures points.
fn of_points() -> Options {
    Options { fit: Fit::LeastSquares, ..Options::default() }
}

/// PSNR of a view of the world, away from the border.
fn seen(image: &Array3<f32>, world: &World, (v, u): (usize, usize)) -> f64 {
    let (du, dv) = (u as f64 - 2.0, v as f64 - 2.0);
    let (mut sum, mut n) = (0.0, 0);
    for t in 20..SIDE - 20 {
        for s in 20..SIDE - 20 {
            sum += (f64::from(image[[t, s, 0]]) - world(s as f64, t as f64, du, dv)).powi(2);
            n += 1;
        }
    }
    -10.0 * (sum / f64::from(n)).log10()
}

fn psnr(image: &Array3<f32>, d: impl Fn(f64, f64) -> f64 + 'static, at: (usize, usize)) -> f64 {
    seen(image, &surface(d), at)
}

fn one(samples: &HexSamples, options: Options, at: (usize, usize)) -> Array3<f32> {
    let set = SampleSet::hexagonal(samples, &TARGET).unwrap();
    RefinedViews::estimate(set, &options, &Silent).unwrap().render_view(at.0, at.1).unwrap()
}

fn single(samples: &HexSamples, at: (usize, usize)) -> (Array3<f32>, Array3<f32>) {
    let values = samples.values.slice(s![at.0 * 5 + at.1, .., ..]);
    let by = |interpolation| {
        prepare_interpolator(interpolation, samples, &TARGET).unwrap().interpolate_view(values).unwrap()
    };
    let (b, c) = (by(Interpolation::Barycentric), by(Interpolation::Cubic));
    (b, c)
}

#[test]
fn without_texture_the_noise_goes_down() {
    let mut samples = samples(|_, _| 0.0, 0.1);
    let mut generator = ChaCha8Rng::seed_from_u64(7);
    samples.values.mapv_inplace(|_| 0.4 + 0.02 * (generator.random::<f32>() - 0.5));
    let error = |image: &Array3<f32>| image.iter().map(|v| (v - 0.4f32).powi(2)).sum::<f32>();
    let (b, _) = single(&samples, (2, 2));
    assert!(error(&one(&samples, of_points(), (2, 2))) < error(&b));
}

/// PSNR of barycentric interpolation, the cubic, and refinement, for one view of a world.
fn compared(world: &World, noise: f32, options: Options, at: (usize, usize)) -> [f64; 3] {
    let samples = measured(world, noise);
    let (b, c) = single(&samples, at);
    [b, c, one(&samples, options, at)].map(|image| seen(&image, world, at))
}

#[test]
fn planted_surfaces() {
    let fence = || -> World {
        Box::new(|s, t, u, v| {
            // Bars three lenslets wide, nearer than the wall behind.
            let (x, y) = (s + 1.2 * u, t + 1.2 * v);
            if (x / 30.0).fract() < 0.33 {
                resolved(1.3 * y + 40.0, x) + 0.2
            } else {
                resolved(s - 0.4 * u, t - 0.4 * v)
            }
        })
    };
    // Name, world, noise, gain in dB over barycentric and over the cubic at least.
    let slant = |x: f64, y: f64| 0.004 * (x - 100.0) + 0.002 * (y - 60.0);
    let all: Vec<(&str, World, f32, f64, f64)> = vec![
        ("no disparity", painted(|_, _| 0.0, resolved), 0.02, 9.0, 1.0),
        ("a plane", painted(|_, _| -0.9, resolved), 0.02, 14.0, 5.0),
        ("a noisy plane", painted(|_, _| -0.9, resolved), 0.15, 5.0, 4.0),
        ("detail too fine for one view", painted(|_, _| -0.9, texture), 0.02, 4.0, 5.0),
        ("two planes", painted(|x, _| if x < 100.0 { -0.8 } else { 0.6 }, resolved), 0.02, 5.0, 1.0),
        ("a slanted plane", painted(slant, resolved), 0.02, 3.0, -6.0),
        ("a fence", fence(), 0.02, 1.5, 0.2),
    ];
    for (name, world, noise, flat, smooth) in &all {
        for at in [(2, 2), (2, 4), (0, 0)] {
            let [b, c, m] = compared(world, *noise, of_points(), at);
            let told = format!("{name}, view {at:?}: barycentric {b:.2}, cubic {c:.2}, refined {m:.2} dB");
            assert!(m >= b + flat && m >= c + smooth, "{told}");
        }
    }
}

#[test]
fn triangulating_all_samples_gains_too_and_the_fit_more() {
    let plane = |_: f64, _: f64| -0.9;
    let samples = samples(plane, 0.01);
    let known = || Some(Array2::from_elem((20, 20), -0.9f32));
    let mesh = one(&samples, Options { fit: Fit::Triangulation, known: known(), ..Options::default() }, (2, 2));
    let smooth = one(&samples, Options { known: known(), ..of_points() }, (2, 2));
    let (b, _) = single(&samples, (2, 2));
    let [b, m, f] = [&b, &mesh, &smooth].map(|image| psnr(image, plane, (2, 2)));
    assert!(m > b + 2.0 && f > b + 2.0, "barycentric {b:.2}, triangulation {m:.2}, fit {f:.2}");
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let samples = samples(|x, _| 0.3 + 0.003 * x, 0.02);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| one(&samples, of_points(), (1, 3)))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn hidden_lenslets_are_foretold_better_with_the_other_views() {
    let samples = samples(|_, _| -0.9, 0.01);
    let score = |render: &mut dyn FnMut(&HexSamples) -> Result<Array3<f32>, lenslet_views::Error>| {
        hidden_score(&samples, &TARGET, 0.1, 3, (2, 2), render).unwrap()
    };
    let alone = score(&mut |rest| Ok(single(rest, (2, 2)).0));
    let together = score(&mut |rest| Ok(one(rest, of_points(), (2, 2))));
    assert_eq!(alone.lenslets, together.lenslets);
    assert!(together.psnr > alone.psnr + 3.0, "{alone:?} {together:?}");
}

#[test]
fn other_tools_light_fields_gain_in_size() {
    // Views of 100 pixels, each sampled at its own disparity; enlarged twice.
    let d = 0.45f64;
    let mut meta = Meta::new([5, 5], [100, 100], 1, ColourSpace::Linear);
    meta.method = None;
    let data = Array5::from_shape_fn((5, 5, 100, 100, 1), |(v, u, t, s, _)| {
        let (x, y) = (2.0 * (s as f64 - d * (u as f64 - 2.0)) + 0.5, 2.0 * (t as f64 - d * (v as f64 - 2.0)) + 0.5);
        texture(x, y) as f32
    });
    let field = LightField { meta, data };
    let set = SampleSet::rectangular(&field, &TARGET).unwrap();
    let image = RefinedViews::estimate(set, &of_points(), &Silent).unwrap().render_view(2, 2).unwrap();
    let alone = bicubic::resize_bicubic(field.data.slice(s![2, 2, .., .., ..]), Size::new(SIDE, SIDE)).unwrap();
    let flat = |_: f64, _: f64| 0.0;
    let (before, after) = (psnr(&alone, flat, (2, 2)), psnr(&image, flat, (2, 2)));
    assert!(after > before + 2.0, "{after:.2} dB after {before:.2}");
}

/// A light field of 5×5 views of textured surface at disparity `d` (pixels of the enlarged view), each pixel the mean over
/// `scale`² pixels of a view of `side` pixels; `seen(v, u, value)`: what the view at (v, u) makes of it, and its shift.
fn averaged(scale: usize, side: usize, d: f64, seen: impl Fn(usize, usize) -> (f64, f64, f64)) -> LightField {
    let low = side / scale;
    let mut meta = Meta::new([5, 5], [low, low], 1, ColourSpace::Srgb);
    meta.method = None;
    let data = Array5::from_shape_fn((5, 5, low, low, 1), |(v, u, t, s, _)| {
        let (gain, offset, shift) = seen(v, u);
        let mut sum = 0.0;
        for k in 0..scale * scale {
            let (x, y) = ((s * scale + k % scale) as f64, (t * scale + k / scale) as f64);
            sum += texture(x + shift - d * (u as f64 - 2.0), y - d * (v as f64 - 2.0));
        }
        (gain * sum / (scale * scale) as f64 + offset) as f32
    });
    LightField { meta, data }
}

/// PSNR of the middle view of `field`, refined.
fn refined_score(field: &LightField, side: usize, fit: Fit) -> f64 {
    refined_view_score(field, side, fit, (2, 2), texture)
}

/// PSNR of the view `at` of `field`, refined, against what it shows at (x, y).
fn refined_view_score(
    field: &LightField,
    side: usize,
    fit: Fit,
    at: (usize, usize),
    truth: impl Fn(f64, f64) -> f64,
) -> f64 {
    let target = Size::new(side, side);
    let set = SampleSet::rectangular(field, &target).unwrap();
    let image = RefinedViews::estimate(set, &Options { fit, ..Options::default() }, &Silent).unwrap();
    let image = image.render_view(at.0, at.1).unwrap();
    let (mut sum, mut n) = (0.0, 0);
    for t in 15..side - 15 {
        for s in 15..side - 15 {
            sum += (f64::from(image[[t, s, 0]]) - truth(s as f64, t as f64)).powi(2);
            n += 1;
        }
    }
    -10.0 * (sum / f64::from(n)).log10()
}

#[test]
fn pixels_are_means_over_what_they_replace() {
    for (scale, side, d) in [(2, 160, 0.83), (3, 180, 1.22)] {
        let field = averaged(scale, side, d, |_, _| (1.0, 0.0, 0.0));
        let points = refined_score(&field, side, Fit::LeastSquares);
        let means = refined_score(&field, side, Fit::for_enlargement(scale as f64));
        let disc = refined_score(&field, side, Fit::Joint(Some(SampleFootprint::Point)));
        println!("scale {scale}: least squares {points:.2}, joint {means:.2}, joint with points {disc:.2}");
        assert!(means > points + 3.0 && means > disc + 3.0, "scale {scale}: {means:.2}, {points:.2}, {disc:.2}");
    }
}

#[test]
fn views_may_differ_in_gain_offset_and_place() {
    let same = averaged(2, 160, 0.83, |_, _| (1.0, 0.0, 0.0));
    let other = averaged(2, 160, 0.83, |v, _| if v == 1 { (0.85, 0.06, 0.6) } else { (1.0, 0.0, 0.0) });
    let fit = Fit::for_enlargement(2.0);
    let (alike, different) = (refined_score(&same, 160, fit), refined_score(&other, 160, fit));
    let points = refined_score(&other, 160, Fit::LeastSquares);
    println!("alike {alike:.2}, different {different:.2}, least squares of the different {points:.2}");
    assert!(different > points + 5.0, "{different:.2} of {alike:.2}, {points:.2}");
}

#[test]
fn a_view_beside_the_middle_keeps_its_own_light() {
    let d = 0.83;
    let (gain, offset) = (0.85, 0.06);
    let field = averaged(2, 160, d, |v, u| if (v, u) == (1, 4) { (gain, offset, 0.0) } else { (1.0, 0.0, 0.0) });
    let shows = |x: f64, y: f64| texture(x - 2.0 * d, y + d);
    let score =
        |fit, light: &dyn Fn(f64) -> f64| refined_view_score(&field, 160, fit, (1, 4), |x, y| light(shows(x, y)));
    let own = |value: f64| gain * value + offset;
    let joint = Fit::for_enlargement(2.0);
    let (in_its_own, in_others) = (score(joint, &own), score(joint, &|value| value));
    let points = score(Fit::LeastSquares, &own);
    println!("own light {in_its_own:.2}, the others' {in_others:.2}, least squares {points:.2}");
    assert!(in_its_own > points + 3.0 && in_its_own > in_others + 10.0, "{in_its_own:.2}, {in_others:.2}, {points:.2}");
}

/// Views of a capture begin with the middle one's picture, in its light; their own comes back at the end.
#[test]
fn views_that_begin_with_the_middle_one_keep_their_own_light() {
    let (world, at) = (painted(|_, _| 0.83, resolved), (1, 4));
    let mut samples = measured(&world, 0.0);
    samples.values.slice_mut(s![at.0 * 5 + at.1, .., ..]).mapv_inplace(|x| 0.85 * x + 0.06);
    let own: World = Box::new(|s, t, u, v| 0.85 * painted(|_, _| 0.83, resolved)(s, t, u, v) + 0.06);
    let joint = Options { fit: Fit::Joint(Some(SampleFootprint::Point)), ..Options::default() };
    let (image, points) = (one(&samples, joint, at), one(&samples, of_points(), at));
    let (in_its_own, in_others, points) = (seen(&image, &own, at), seen(&image, &world, at), seen(&points, &own, at));
    println!("own light {in_its_own:.2}, the others' {in_others:.2}, least squares {points:.2}");
    assert!(in_its_own > points + 3.0 && in_its_own > in_others + 10.0, "{in_its_own:.2}, {in_others:.2}, {points:.2}");
}

#[test]
fn refine_enlarges_a_light_field_and_refuses_what_it_cannot() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (folder.path().join("plain"), folder.path().join("refined"));
    let mut sink =
        lightfield::create(&from, Meta::new([5, 5], [50, 50], 3, ColourSpace::Linear), Format::Directory, false)
            .unwrap();
    for (v, u) in (0..25).map(|k| (k / 5, k % 5)) {
        let (du, dv) = (u as f64 - 2.0, v as f64 - 2.0);
        let seen = |t: usize, s: usize| (2.0 * (s as f64 - 0.45 * du) + 0.5, 2.0 * (t as f64 - 0.45 * dv) + 0.5);
        let view = Array3::from_shape_fn((50, 50, 3), |(t, s, _)| texture(seen(t, s).0, seen(t, s).1) as f32);
        sink.write(v, u, &view).unwrap();
    }
    sink.finish().unwrap();
    let run = |more: &[&str]| {
        let mut all = vec!["refine", from.to_str().unwrap(), "--out", to.to_str().unwrap(), "--json", "-q"];
        all.extend(more);
        std::process::Command::new(env!("CARGO_BIN_EXE_lenslet")).args(all).output().unwrap()
    };
    assert_eq!(run(&["--scale", "0.5"]).status.code(), Some(2));
    let done = run(&["--linear"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let told: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!((&told["size"], &told["samples"]), (&serde_json::json!([100, 100]), &serde_json::json!(false)));
    let refined = lightfield::load(&to, &ReadOptions::default()).unwrap();
    assert_eq!(refined.meta.method, Some("multiview".into()));
    let plain = lightfield::load(&from, &ReadOptions::default()).unwrap();
    let alone = bicubic::resize_bicubic(plain.data.slice(s![2, 2, .., .., ..]), Size::new(100, 100)).unwrap();
    let error = |image: ArrayView3<f32>| -> f64 {
        let inner = image.slice(s![12..88, 12..88, ..]);
        inner
            .indexed_iter()
            .map(|((t, s, _), x)| (f64::from(*x) - texture((s + 12) as f64, (t + 12) as f64)).powi(2))
            .sum()
    };
    let (before, after) = (error(alone.view()), error(refined.data.slice(s![2, 2, .., .., ..])));
    assert!(after < 0.7 * before, "{before} {after}");
    // What stands there is not replaced unasked.
    assert_eq!(run(&[]).status.code(), Some(1));
}

#[test]
fn impossible_samples_are_refused() {
    let good = samples(|_, _| 0.0, 0.0);
    let mut fewer = good.clone();
    fewer.centres.pop();
    assert!(SampleSet::hexagonal(&fewer, &TARGET).is_err());
    let refined = |samples, options: Options| -> Result<RefinedViews, lenslet_views::Error> {
        RefinedViews::estimate(SampleSet::hexagonal(samples, &TARGET)?, &options, &Silent)
    };
    assert!(refined(&good, Options::default()).unwrap().render_view(5, 0).is_err());
    let options = Options { known: Some(Array2::from_elem((3, 3), f32::NAN)), ..Options::default() };
    assert!(refined(&good, options).is_err());
    let mut strange = good.clone();
    strange.values.fill(f32::NAN);
    // Samples that are no numbers make no picture.
    let picture = refined(&strange, Options::default()).and_then(|views| views.render_view(2, 2));
    assert!(picture.is_err(), "{:?}", picture.map(|p| p.iter().filter(|v| v.is_finite()).count()));
    assert!(hidden_score::<lenslet_views::Error>(&good, &TARGET, 0.9, 1, (2, 2), &mut |_| unreachable!()).is_err());
    assert!(hidden_score::<lenslet_views::Error>(&good, &TARGET, 0.1, 1, (9, 2), &mut |_| unreachable!()).is_err());
}
