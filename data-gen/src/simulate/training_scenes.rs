//! The drawn scenes that dictionaries are trained on, besides photos: what photos hardly have (thin things before others,
//! letters, gratings, sharp edges at several depths). Layout, shapes and materials all follow the seed, and none is of a
//! scene that results are scored on.

use std::f64::consts::{PI, TAU};

use lenslet_core::stroke_font::is_on_text;

use super::description::{Canvas, LayerSource, SceneDescription};
use super::draw::{Rgb, fractal_noise, hash_unit, mix_colours, rotate, shade_colour};

/// Paper of all sizes scattered over each other (a dead-leaves image) on four planes: the ground at −D, sparse scraps at
/// −D/3, D/3 and D.
pub fn collage(canvas: &Canvas) -> SceneDescription<'static> {
    let (seed, d) = (canvas.seed, canvas.disparity);
    let scraps = |disparity: f64, sizes: &'static [f64], share: f32, seed: u32| LayerSource {
        disparity: [disparity, 0.0, 0.0],
        bounds: None,
        paint: Box::new(move |x, y| {
            let found =
                sizes.iter().enumerate().find_map(|(k, &size)| scrap_at(x, y, size, share, seed ^ (k as u32 + 1)));
            found.map_or([0.0; 4], |[r, g, b]| [r, g, b, 1.0])
        }),
    };
    let ground = move |x: f64, y: f64| {
        let sizes = [2.5, 5.0, 9.0, 16.0, 28.0];
        let found = (0..5).find_map(|k| scrap_at(x, y, sizes[k], 0.75, seed ^ (0x100 + k as u32)));
        let [r, g, b] = found.unwrap_or_else(|| material(x, y, seed ^ 0x200));
        [r, g, b, 1.0]
    };
    SceneDescription {
        layers: vec![
            scraps(d, &[1.2, 11.0], 0.08, seed ^ 0x1000),
            scraps(d / 3.0, &[3.0, 17.0], 0.12, seed ^ 0x2000),
            scraps(-d / 3.0, &[6.0, 24.0], 0.2, seed ^ 0x3000),
            LayerSource { disparity: [-d, 0.0, 0.0], bounds: None, paint: Box::new(ground) },
        ],
        regions: Vec::new(),
    }
}

/// Curved stems from 0.3 to 3 pitches thick on three planes (D, D/3, −D/3), each plane's in another direction, before
/// scattered paper at −D.
pub fn thicket(canvas: &Canvas) -> SceneDescription<'static> {
    let (seed, d) = (canvas.seed, canvas.disparity);
    let stems = |disparity: f64, apart: f64, seed: u32| {
        let turn = PI * f64::from(hash_unit(1, 2, seed));
        LayerSource {
            disparity: [disparity, 0.0, 0.0],
            bounds: None,
            paint: Box::new(move |x, y| {
                let (u, v) = rotate(x, y, turn);
                stem_at(u, v, apart, seed).map_or([0.0; 4], |[r, g, b]| [r, g, b, 1.0])
            }),
        }
    };
    let ground = move |x: f64, y: f64| {
        let sizes = [4.0, 10.0, 22.0];
        let found = (0..3).find_map(|k| scrap_at(x, y, sizes[k], 0.6, seed ^ (0x400 + k as u32)));
        let [r, g, b] = found.unwrap_or_else(|| material(x, y, seed ^ 0x500));
        [r, g, b, 1.0]
    };
    SceneDescription {
        layers: vec![
            stems(d, 19.0, seed ^ 0x6000),
            stems(d / 3.0, 15.0, seed ^ 0x7000),
            stems(-d / 3.0, 12.0, seed ^ 0x8000),
            LayerSource { disparity: [-d, 0.0, 0.0], bounds: None, paint: Box::new(ground) },
        ],
        regions: Vec::new(),
    }
}

/// The colour of the uppermost scrap of about `size` pitches at (x, y), `None` where there is none. One scrap a cell of
/// 1.3 sizes, with probability `share`, anywhere in it.
fn scrap_at(x: f64, y: f64, size: f64, share: f32, seed: u32) -> Option<Rgb> {
    let cell = 1.3 * size;
    let (column, row) = ((x / cell).floor() as i32, (y / cell).floor() as i32);
    let mut best: Option<(f32, Rgb)> = None;
    for (i, j) in (-1..=1).flat_map(|i| (-1..=1).map(move |j| (column + i, row + j))) {
        let own = seed ^ (16_777_216.0 * hash_unit(i, j, seed)) as u32;
        let pick = |n: i32| hash_unit(n, 31, own);
        let height = pick(0);
        if pick(1) > share || best.is_some_and(|(other, _)| other > height) {
            continue;
        }
        let middle = |k: i32, n: i32| (f64::from(k) + f64::from(pick(n))) * cell;
        let (u, v) = rotate(x - middle(i, 2), y - middle(j, 3), TAU * f64::from(pick(4)));
        let reach = 0.5 * size * (0.5 + 0.5 * f64::from(pick(5)));
        if is_inside(u, v, reach, (6.0 * pick(6)) as u32, f64::from(pick(7))) {
            best = Some((height, material(u, v, own)));
        }
    }
    best.map(|(_, colour)| colour)
}

/// Whether (u, v) lies in a shape that reaches `reach` from its middle: a disc, a rectangle, a strip, a triangle, a ring
/// or letters; `form` (0..1) is its proportion.
fn is_inside(u: f64, v: f64, reach: f64, shape: u32, form: f64) -> bool {
    match shape {
        0 => u.hypot(v) < reach,
        1 => u.abs() < reach && v.abs() < reach * (0.3 + 0.7 * form),
        2 => u.abs() < 1.3 * reach && v.abs() < (0.15 + 0.1 * form) * reach.max(1.0),
        3 => v > -0.5 * reach && v < reach - (1.2 + form) * u.abs(),
        4 => (u.hypot(v) - 0.75 * reach).abs() < (0.1 + 0.15 * form) * reach,
        _ => {
            let height = (0.5 + 0.4 * form) * reach;
            let word = WORDS[(form * WORDS.len() as f64) as usize % WORDS.len()];
            is_on_text(u + 1.2 * reach, v + 0.5 * height, word, height, 0.7 + 0.6 * form)
        }
    }
}

const WORDS: [&str; 5] = ["QUARTZ", "BOX 52", "JUMPING", "WALTZ", "FJORD 7"];

/// The colour of a piece: even, shaded, speckled, ruled, chequered or waved, in colours of its own.
fn material(u: f64, v: f64, seed: u32) -> Rgb {
    let pick = |n: i32| hash_unit(n, 57, seed);
    let colour = |n: i32| -> Rgb {
        // From dark to light, and hardly ever pure.
        let (level, grey) = (0.02 + 0.8 * pick(n).powi(2), pick(n + 1));
        std::array::from_fn(|k| level * (grey + (1.0 - grey) * (0.2 + 1.4 * pick(n + 2 + k as i32))))
    };
    let (one, other) = (colour(10), colour(20));
    let (p, q) = rotate(u, v, PI * f64::from(pick(1)));
    let period = 1.6 * 8f64.powf(f64::from(pick(2)));
    let rough = 0.05 + 0.3 * pick(3).powi(2);
    let blend = match (7.0 * pick(0)) as u32 {
        0 => 0.0,
        1 => (0.5 + 0.04 * p) as f32,
        2 => 0.5 + 0.9 * fractal_noise(u, v, 24.0, 0.35, 0.8, seed ^ 5),
        3 => f32::from((p / period).rem_euclid(1.0) < 0.2 + 0.6 * f64::from(pick(4))),
        4 => f32::from(((p / period).floor() + (q / period).floor()).rem_euclid(2.0) < 1.0),
        5 => (0.5 + 0.5 * (TAU * p / period + 2.0 * (q / period).sin()).sin()) as f32,
        _ => 0.5 + 0.6 * fractal_noise(u, 0.2 * v, 6.0, 0.35, 0.8, seed ^ 6),
    };
    shade_colour(mix_colours(one, other, blend), 1.0 + rough * fractal_noise(u, v, 9.0, 0.4, 0.75, seed ^ 7))
}

/// The colour of the stem at (u, v), of those that run along v about `apart` pitches from each other.
fn stem_at(u: f64, v: f64, apart: f64, seed: u32) -> Option<Rgb> {
    let near = (u / apart).floor() as i32;
    (-1..=2).find_map(|i| {
        let k = near + i;
        let pick = |n: i32| f64::from(hash_unit(k, n, seed));
        let bend = 4.0 * (v / (9.0 + 30.0 * pick(0)) + TAU * pick(1)).sin();
        let middle = apart * (f64::from(k) + 0.6 * (pick(2) - 0.5)) + bend;
        let half = 0.15 + 1.4 * pick(3).powi(3);
        let across = (u - middle) / half;
        (across.abs() < 1.0).then(|| {
            let own = seed ^ (65_536.0 * pick(4)) as u32;
            let light = 0.6 + 0.5 * (1.0 - (across + 0.3).powi(2).min(1.0)).sqrt() as f32;
            shade_colour(material(0.7 * u, v, own), light)
        })
    })
}
