//! The scenes with texture: drawn from formulas, in lenslet pitches, so that a small sensor sees the same detail as a
//! large one.

use lenslet_core::stroke_font::{distance_to_segment, is_on_text};

use super::description::{Canvas, LayerSource, Paint, SceneDescription};
use super::draw::{
    Rgb, brick_colour, cloth_colour, depth_in_leaf, fractal_noise, hash_unit, in_bright_sector, mix_colours,
    on_bright_line, rotate, shade_colour, stone_colour, wood_colour,
};

/// A layer at constant disparity over the whole canvas.
fn whole<'a>(disparity: f64, paint: Box<Paint<'a>>) -> LayerSource<'a> {
    LayerSource { disparity: [disparity, 0.0, 0.0], bounds: None, paint }
}

/// A layer at constant disparity that has nothing beyond `reach` (x, y) of `centre`.
fn piece<'a>(disparity: f64, centre: [f64; 2], reach: [f64; 2], paint: Box<Paint<'a>>) -> LayerSource<'a> {
    let bounds = [centre[0] - reach[0], centre[1] - reach[1], centre[0] + reach[0], centre[1] + reach[1]];
    LayerSource { disparity: [disparity, 0.0, 0.0], bounds: Some(bounds), paint }
}

const CLEAR: [f32; 4] = [0.0; 4];

fn solid(c: Rgb) -> [f32; 4] {
    [c[0], c[1], c[2], 1.0]
}

/// Many materials side by side, in tiles of about 40 pitches: edges, texture, letters at every place.
fn patchwork(x: f64, y: f64, seed: u32) -> Rgb {
    const TILE: f64 = 38.0;
    let bend = 2.0 * f64::from(fractal_noise(x, y, 40.0, 10.0, 0.5, seed ^ 31));
    let (i, j) = (((x + bend) / TILE).floor(), ((y - bend) / TILE).floor());
    let (u, v) = (x - (i + 0.5) * TILE, y - (j + 0.5) * TILE);
    let pick = (hash_unit(i as i32, j as i32, seed) * 7.0) as u32;
    let own = seed ^ (hash_unit(j as i32, i as i32, seed ^ 1) * 65536.0) as u32;
    let (tu, tv) = rotate(u, v, f64::from(hash_unit(i as i32, j as i32, seed ^ 2)) * 1.2 - 0.6);
    match pick {
        0 => brick_colour(tu, tv, 6.0, own),
        1 => wood_colour(tu, tv, 11.0, own),
        2 => cloth_colour(tu, tv, 1.6, [[0.08, 0.16, 0.42], [0.62, 0.55, 0.4]], own),
        3 => stone_colour(tu, tv, [[0.12, 0.13, 0.12], [0.55, 0.52, 0.46]], own),
        4 => {
            let rough = fractal_noise(x, y, 12.0, 0.5, 0.6, own);
            let ink =
                (0..6).any(|k| is_on_text(tu + 24.0, tv + 15.0 - 6.4 * f64::from(k), WORDS[k as usize], 3.6, 0.9));
            shade_colour(if ink { [0.03, 0.03, 0.05] } else { [0.7, 0.67, 0.58] }, 1.0 + 0.06 * rough)
        }
        5 => {
            let rough = fractal_noise(x, y, 12.0, 0.5, 0.7, own);
            let bright = tu.hypot(tv) < 15.0 && in_bright_sector(tu, tv, 18.0);
            shade_colour(if bright { [0.82, 0.72, 0.2] } else { [0.1, 0.22, 0.16] }, 1.0 + 0.1 * rough)
        }
        _ => {
            let green = fractal_noise(tu, tv, 16.0, 0.35, 0.8, own);
            let blade = fractal_noise(tu, tv * 0.15, 1.6, 0.4, 0.8, own ^ 8);
            shade_colour(mix_colours([0.05, 0.14, 0.03], [0.3, 0.42, 0.1], 0.5 + 0.35 * green), 1.0 + 0.4 * blade)
        }
    }
}

const WORDS: [&str; 6] = ["LIGHT FIELD", "LATTICE 0123", "HEXAGON 456", "MICRO LENS 7", "PARALLAX 89", "DISPARITY"];

/// One plane of many materials.
pub fn flat(canvas: &Canvas) -> SceneDescription<'static> {
    let seed = canvas.seed;
    SceneDescription {
        layers: vec![whole(canvas.disparity, Box::new(move |x, y| solid(patchwork(x, y, seed))))],
        regions: Vec::new(),
    }
}

/// One plane, disparity from −D at the left border to D at the right one.
pub fn slanted(canvas: &Canvas) -> SceneDescription<'static> {
    let seed = canvas.seed;
    let layer = LayerSource {
        disparity: [0.0, canvas.disparity / canvas.half[0], 0.0],
        bounds: None,
        paint: Box::new(move |x, y| solid(patchwork(x, y, seed))),
    };
    SceneDescription { layers: vec![layer], regions: Vec::new() }
}

/// Four planes at D, D/3, −D/3 and −D.
pub fn planes(canvas: &Canvas) -> SceneDescription<'static> {
    let (seed, d) = (canvas.seed, canvas.disparity);
    let [hx, hy] = canvas.half;
    let r = hx.min(hy);
    let disc = move |x: f64, y: f64| {
        let (x, y) = (x - 0.42 * hx, y + 0.38 * hy);
        if x.hypot(y) > 0.4 * r {
            CLEAR
        } else {
            solid(stone_colour(x, y, [[0.5, 0.2, 0.08], [0.75, 0.6, 0.4]], seed ^ 11))
        }
    };
    let card = move |x: f64, y: f64| {
        let (x, y) = rotate(x + 0.35 * hx, y - 0.3 * hy, 0.2);
        if x.abs() > 0.45 * r || y.abs() > 0.36 * r {
            return CLEAR;
        }
        let (line, ink) = (((y + 0.33 * r) / 6.0).floor(), 0.6 * (x * 0.3).sin().abs());
        let word = WORDS[line.rem_euclid(6.0) as usize];
        let written = is_on_text(x + 0.42 * r, y + 0.33 * r - 6.0 * line, word, 3.6, 0.9);
        solid(if written { [0.05, 0.05, 0.2] } else { shade_colour([0.75, 0.72, 0.6], 1.0 - 0.2 * ink as f32) })
    };
    let beam = move |x: f64, y: f64| {
        let (x, y) = rotate(x - 0.25 * hx, y - 0.45 * hy, -0.35);
        if x.abs() > 0.55 * r || y.abs() > 0.16 * r { CLEAR } else { solid(wood_colour(x, y, 9.0, seed ^ 12)) }
    };
    SceneDescription {
        layers: vec![
            piece(d, [0.25 * hx, 0.45 * hy], [0.62 * r, 0.4 * r], Box::new(beam)),
            piece(d / 3.0, [-0.35 * hx, 0.3 * hy], [0.55 * r, 0.5 * r], Box::new(card)),
            piece(-d / 3.0, [0.42 * hx, -0.38 * hy], [0.41 * r, 0.41 * r], Box::new(disc)),
            whole(-d, Box::new(move |x, y| solid(patchwork(x, y, seed)))),
        ],
        regions: Vec::new(),
    }
}

/// Bars and wires from 0.4 to 4 pitches thick at D, before a wall at −D.
pub fn occluders(canvas: &Canvas) -> SceneDescription<'static> {
    let (seed, d) = (canvas.seed, canvas.disparity);
    let hy = canvas.half[1];
    let bars = move |x: f64, y: f64| {
        for k in -40..=40i32 {
            let centre = f64::from(k) * 22.0 + 6.0 * f64::from(hash_unit(k, 0, seed) - 0.5);
            let lean = 0.25 * f64::from(hash_unit(k, 1, seed) - 0.5);
            let half = 0.2 + 1.8 * f64::from(hash_unit(k, 2, seed)).powi(2);
            let across = x - centre - lean * y;
            if across.abs() < half {
                let round = (1.0 - (across / half).powi(2)).sqrt() as f32;
                let rust = fractal_noise(x, y, 6.0, 0.5, 0.7, seed ^ 40);
                return solid(shade_colour(
                    mix_colours([0.3, 0.12, 0.05], [0.35, 0.36, 0.38], hash_unit(k, 3, seed)),
                    0.5 + 0.6 * round + 0.2 * rust,
                ));
            }
        }
        CLEAR
    };
    let wires = move |x: f64, y: f64| {
        for k in -16..=16i32 {
            let sag = 4.0 * (0.03 * x + f64::from(k)).sin() + f64::from(k) * hy.max(30.0) / 5.0;
            if (y - sag).abs() < 0.3 + 0.25 * f64::from(hash_unit(k, 5, seed)) {
                return solid([0.04, 0.04, 0.045]);
            }
        }
        CLEAR
    };
    let edgeless = |disparity: f64, paint: Box<Paint<'static>>| whole(disparity, paint);
    SceneDescription {
        layers: vec![
            edgeless(d, Box::new(bars)),
            edgeless(d / 3.0, Box::new(wires)),
            whole(-d, Box::new(move |x, y| solid(patchwork(x, y, seed)))),
        ],
        regions: Vec::new(),
    }
}

/// A brick wall far off, a table that comes nearer, a poster, fruit, leaves and wires in front.
pub fn natural(canvas: &Canvas) -> SceneDescription<'static> {
    let (seed, d) = (canvas.seed, canvas.disparity);
    let [hx, hy] = canvas.half;
    let r = hx.min(hy);
    let wall = move |x: f64, y: f64| {
        let light = (1.0 - 0.35 * (x / hx + 0.4).powi(2) - 0.15 * y / hy).max(0.3) as f32;
        let ivy =
            fractal_noise(x, y, 0.5 * r, 0.4, 0.75, seed ^ 21) - 0.9 + 0.7 * (x / hx) as f32 - 0.4 * (y / hy) as f32;
        if ivy > 0.25 {
            let tone = fractal_noise(x, y, 5.0, 0.35, 0.85, seed ^ 22);
            return solid(shade_colour(mix_colours([0.03, 0.09, 0.02], [0.25, 0.36, 0.08], 0.45 + 0.4 * tone), light));
        }
        solid(shade_colour(brick_colour(x, y, 7.0, seed ^ 23), 1.25 * light))
    };
    let horizon = 0.42 * hy;
    let table = move |x: f64, y: f64| {
        let depth = (y - horizon) / (hy - horizon).max(1.0);
        if depth < 0.0 {
            return CLEAR;
        }
        // Boards run away from the viewer: they narrow towards the edge at the back.
        let narrow = 0.62 + 0.38 * depth;
        solid(shade_colour(wood_colour(y / narrow, x / narrow, 14.0, seed ^ 24), 0.75 + 0.35 * depth as f32))
    };
    // The table's disparity rises from −0.4 D at its back edge to 0.8 D at the front.
    let slope = (1.2 * d) / (hy - horizon).max(1.0);
    let table = LayerSource {
        disparity: [-0.4 * d - slope * horizon, 0.0, slope],
        bounds: Some([-2.0 * hx - 40.0, horizon - 2.0, 2.0 * hx + 40.0, 2.0 * hy + 40.0]),
        paint: Box::new(table),
    };
    let (px, py, pw, ph) = (-0.34 * hx, -0.18 * hy, 0.46 * r, 0.56 * r);
    let poster = move |x: f64, y: f64| {
        let (x, y) = rotate(x - px, y - py, -0.06);
        if x.abs() > pw || y.abs() > ph {
            return CLEAR;
        }
        if x.abs() > pw - 1.6 || y.abs() > ph - 1.6 {
            return solid(shade_colour(wood_colour(x, y, 30.0, seed ^ 25), 0.6));
        }
        let (sx, sy) = (x, y + 0.42 * ph);
        if sx.hypot(sy) < 0.42 * ph {
            return solid(if in_bright_sector(sx, sy, 24.0) { [0.85, 0.84, 0.8] } else { [0.06, 0.07, 0.12] });
        }
        let size = (0.066 * ph).max(2.0);
        let line = ((y - 0.06 * ph) / (1.6 * size)).floor();
        let shrink = size * (1.0 - 0.09 * line.max(0.0));
        let written = line >= 0.0
            && is_on_text(
                x + pw - 4.5,
                y - 0.06 * ph - 1.6 * size * line,
                WORDS[line.rem_euclid(6.0) as usize],
                shrink,
                0.95,
            );
        let paper = [0.72, 0.66, 0.5];
        solid(if written {
            [0.12, 0.03, 0.03]
        } else {
            shade_colour(paper, 1.0 + 0.05 * fractal_noise(x, y, 9.0, 0.6, 0.7, seed ^ 26))
        })
    };
    let fruit = move |x: f64, y: f64| {
        for (k, (fx, fy, radius)) in
            [(0.2, 0.5, 0.17), (0.5, 0.56, 0.14), (0.36, 0.63, 0.13)].into_iter().enumerate().rev()
        {
            let (u, v) = ((x - fx * hx) / (radius * r), (y - fy * hy) / (radius * r));
            if u * u + v * v < 1.0 {
                let shine = (1.0 - (u + 0.3).powi(2) - (v + 0.35).powi(2)).max(0.1).sqrt() as f32;
                let glint = (-((u + 0.38).powi(2) + (v + 0.42).powi(2)) * 40.0).exp() as f32;
                let skin = fractal_noise(x, y, 7.0, 0.5, 0.7, seed ^ (30 + k as u32));
                let base = [[0.62, 0.1, 0.04], [0.72, 0.4, 0.03], [0.25, 0.42, 0.06]][k];
                let lit = shade_colour(base, (0.25 + 0.85 * shine) * (1.0 + 0.14 * skin));
                return solid(mix_colours(lit, [0.9, 0.9, 0.88], 0.8 * glint));
            }
        }
        CLEAR
    };
    let leaves = move |x: f64, y: f64| {
        for k in (0..16i32).rev() {
            let pick = |n: i32| f64::from(hash_unit(k, n, seed ^ 50));
            let (lx, ly) = (hx * (0.35 + 0.75 * pick(0)), -hy * (1.05 - 0.75 * pick(1)));
            let length = r * (0.16 + 0.14 * pick(2));
            let (u, v) = rotate(x - lx, y - ly, 1.2 + 1.9 * pick(3));
            if let Some(inside) = depth_in_leaf(u, v, length, 0.42 * length) {
                let vein = on_bright_line(u + 0.8 * v.abs(), v, 0.16, 0.0) && inside < 0.85;
                let tone = fractal_noise(x, y, 8.0, 0.4, 0.75, seed ^ (60 + k as u32));
                let base = mix_colours([0.07, 0.2, 0.02], [0.33, 0.45, 0.05], hash_unit(k, 9, seed));
                let ridge = if inside > 0.9 { 1.5 } else { 1.0 };
                return solid(shade_colour(base, ridge * (if vein { 0.8 } else { 1.0 }) * (1.0 + 0.22 * tone)));
            }
        }
        for (a, b) in [([0.2, -1.1], [0.95, -0.45]), ([0.55, -0.8], [1.1, -0.9]), ([0.75, -0.62], [0.6, -0.2])] {
            if distance_to_segment(x, y, [a[0] * hx, a[1] * hy], [b[0] * hx, b[1] * hy]) < 0.9 {
                return solid(shade_colour(
                    [0.16, 0.1, 0.06],
                    1.0 + 0.4 * fractal_noise(x, y, 4.0, 0.5, 0.8, seed ^ 70),
                ));
            }
        }
        CLEAR
    };
    let wires = move |x: f64, y: f64| {
        let sag = |level: f64| level * hy + 0.05 * hy * (x / hx).powi(2) + 0.09 * x;
        let thin = [(-0.72, 0.45), (-0.62, 0.3), (0.18, 0.6)];
        if thin.iter().any(|(level, half)| (y - sag(*level)).abs() < *half) {
            solid([0.03, 0.03, 0.035])
        } else {
            CLEAR
        }
    };
    SceneDescription {
        layers: vec![
            whole(d, Box::new(wires)),
            piece(0.7 * d, [0.7 * hx, -0.6 * hy], [0.9 * hx, 0.75 * hy], Box::new(leaves)),
            piece(0.45 * d, [0.35 * hx, 0.55 * hy], [0.4 * hx, 0.32 * hy], Box::new(fruit)),
            table,
            piece(-0.4 * d, [px, py], [pw + 0.08 * r, ph + 0.08 * r], Box::new(poster)),
            whole(-d, Box::new(wall)),
        ],
        regions: Vec::new(),
    }
}
