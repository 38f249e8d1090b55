//! Views that hold little light, or none.

use ndarray::{Array5, s};

use super::bench::Bench;
use super::fields::{aloud, psnr_of_middle, read_npy, scene, told};

fn corner(v: usize, u: usize) -> bool {
    (v as i32 - 3).pow(2) + (u as i32 - 3).pow(2) > 12
}

/// `field` with its corner views times `light`, and with them marked absent by a fourth channel.
fn darkened(field: &Array5<u8>, light: f32) -> (Array5<u8>, Array5<u8>) {
    let (n, _, h, w, _) = field.dim();
    let mut dark = field.clone();
    let mut absent = Array5::zeros((n, n, h, w, 4));
    for v in 0..n {
        for u in 0..n {
            if corner(v, u) {
                dark.slice_mut(s![v, u, .., .., ..]).mapv_inplace(|x| (f32::from(x) * light) as u8);
            }
            absent.slice_mut(s![v, u, .., .., ..3]).assign(&field.slice(s![v, u, .., .., ..]));
            absent.slice_mut(s![v, u, .., .., 3]).fill(if corner(v, u) { 0 } else { 255 });
        }
    }
    (dark, absent)
}

/// Dark corner views made the refined middle view dark, with bright lines.
#[test]
fn dark_corner_views_leave_the_middle_view_as_it_is() {
    let bench = Bench::new();
    let field = scene(7, 64, [-1.2, 0.3, 0.9]);
    let (_, absent) = darkened(&field, 0.0);
    ndarray_npy::write_npy(bench.at("without.npy"), &absent).unwrap();
    bench.done("refine without.npy --scale 1 --out without-refined.npy");
    let without = read_npy(&bench.at("without-refined.npy"));
    bench.done("refocus without.npy --disparity 0.3 --shape square --out without.png");
    let picture = |name: &str| image::open(bench.at(name)).unwrap().into_rgb8();
    let confidence =
        |name: &str| told(bench.path(), &format!("depth {name} --out d --force"))["mean_confidence"].as_f64().unwrap();
    let usual = confidence("without.npy");
    for (k, light) in [0.0, 0.3, 0.5].into_iter().enumerate() {
        ndarray_npy::write_npy(bench.at("dark.npy"), &darkened(&field, light).0).unwrap();
        let answer = aloud(bench.path(), &format!("refine dark.npy --scale 1 --out r{k}.npy"));
        assert!(answer.code == Some(0) && answer.err.contains("12 of 49"), "{}", answer.err);
        let psnr = psnr_of_middle(&read_npy(&bench.at(&format!("r{k}.npy"))), &without);
        assert!(psnr > 50.0, "light {light}: {psnr} dB");
        bench.done(&format!("refocus dark.npy --disparity 0.3 --shape square --out f{k}.png"));
        assert!(picture(&format!("f{k}.png")) == picture("without.png"), "light {light}");
        assert!((confidence("dark.npy") - usual).abs() < 0.01, "light {light}");
        bench.done(&format!("viewpoint dark.npy --frames 4 --out v{k}"));
        let mean = |name: &str| {
            let p = picture(name);
            p.as_raw().iter().map(|&b| f64::from(b)).sum::<f64>() / p.as_raw().len() as f64
        };
        assert!((mean(&format!("v{k}/frame_000.png")) - mean("without.png")).abs() < 12.0, "light {light}");
    }
}

/// The alpha of an ESLF picture was dropped.
#[test]
fn alpha_of_a_lenslet_picture_is_a_weight() {
    let bench = Bench::new();
    let field = scene(3, 20, [0.4, -0.3, 0.8]);
    let picture = image::RgbaImage::from_fn(60, 60, |x, y| {
        let (v, u) = (y as usize % 3, x as usize % 3);
        let at = |c: usize| field[[v, u, y as usize / 3, x as usize / 3, c]];
        image::Rgba([at(0), at(1), at(2), if (v, u) == (0, 0) { 0 } else { 255 }])
    });
    picture.save(bench.at("eslf.png")).unwrap();
    let answer = aloud(bench.path(), "depth eslf.png --views 3 --out d");
    assert!(answer.code == Some(0) && answer.err.contains("1 of 9 views are dark or absent"), "{}", answer.err);
}
