//! Drawing by formula: noise, materials, shapes. Positions are lenslet pitches; everything is a pure function of them.

use std::f64::consts::{PI, TAU};

/// A colour in linear light.
pub type Rgb = [f32; 3];

/// A number in 0..1 that belongs to (`x`, `y`, `seed`).
#[inline]
pub fn hash_unit(x: i32, y: i32, seed: u32) -> f32 {
    let mut h =
        (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed.wrapping_mul(0xc2b2_ae3d);
    for _ in 0..2 {
        h ^= h >> 15;
        h = h.wrapping_mul(0x2c1b_3c6d);
        h ^= h >> 12;
        h = h.wrapping_mul(0x297a_2d39);
        h ^= h >> 15;
    }
    (h >> 8) as f32 / 16_777_216.0
}

/// The largest whole number not above `x`; without a call into the mathematical library, in which noise would spend
/// most of its time.
#[inline]
pub fn floor_i32(x: f64) -> i32 {
    let whole = x as i32;
    whole - i32::from(f64::from(whole) > x)
}

/// Smooth noise of period about 1, in −1..1.
#[inline]
pub fn value_noise(x: f64, y: f64, seed: u32) -> f32 {
    let (i, j) = (floor_i32(x), floor_i32(y));
    let (u, v) = ((x - f64::from(i)) as f32, (y - f64::from(j)) as f32);
    let (su, sv) = (u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v));
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let top = mix(hash_unit(i, j, seed), hash_unit(i.wrapping_add(1), j, seed), su);
    let bottom = mix(hash_unit(i, j.wrapping_add(1), seed), hash_unit(i.wrapping_add(1), j.wrapping_add(1), seed), su);
    2.0 * mix(top, bottom, sv) - 1.0
}

/// Octaves of noise from `period` down to `finest` (pitches), each weighed by `fall` against the one before; about
/// −1..1.
pub fn fractal_noise(x: f64, y: f64, period: f64, finest: f64, fall: f32, seed: u32) -> f32 {
    const COS: f64 = 0.764_842_187_284_488_5;
    const SIN: f64 = 0.644_217_687_237_691;
    let (mut tx, mut ty) = (x, y);
    let (mut sum, mut weight, mut total, mut scale, mut k) = (0f32, 1f32, 0f32, period, 0u32);
    while scale >= finest && k < 16 {
        sum += weight * value_noise(tx / scale, ty / scale, seed.wrapping_add(k * 101));
        // Turned by 0.7 each octave, so that the lattice of one does not line up with the next.
        (tx, ty) = (COS * tx - SIN * ty, SIN * tx + COS * ty);
        total += weight * weight;
        weight *= fall;
        scale *= 0.5;
        k += 1;
    }
    sum / total.sqrt().max(1e-6)
}

/// `a` at 0, `b` at 1.
#[inline]
pub fn mix_colours(a: Rgb, b: Rgb, t: f32) -> Rgb {
    let t = t.clamp(0.0, 1.0);
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t]
}

/// `colour` made lighter or darker, kept within what paper and paint reflect.
#[inline]
pub fn shade_colour(colour: Rgb, factor: f32) -> Rgb {
    colour.map(|c| (c * factor).clamp(0.01, 0.92))
}

/// (`x`, `y`) turned by `angle` about the origin.
#[inline]
pub fn rotate(x: f64, y: f64, angle: f64) -> (f64, f64) {
    let (s, c) = angle.sin_cos();
    (c * x + s * y, c * y - s * x)
}

/// Boards of wood along x: grain, rings, gaps every `board` pitches.
pub fn wood_colour(x: f64, y: f64, board: f64, seed: u32) -> Rgb {
    let plank = (y / board).floor();
    let within = y - plank * board;
    let tint = hash_unit(plank as i32, 7, seed);
    let bend = 3.0 * f64::from(fractal_noise(x + 91.0 * plank, y, 60.0, 8.0, 0.5, seed));
    let ring = ((within + bend) * 0.9 + 0.02 * x).sin() as f32;
    let grain = fractal_noise(x * 0.12, y, 3.0, 0.4, 0.75, seed ^ 5);
    let base = mix_colours([0.36, 0.19, 0.085], [0.22, 0.105, 0.045], tint);
    let gap = if within < 0.7 { 0.25 } else { 1.0 };
    shade_colour(base, gap * (1.0 + 0.22 * ring + 0.3 * grain))
}

/// A wall of bricks, each its own red.
pub fn brick_colour(x: f64, y: f64, size: f64, seed: u32) -> Rgb {
    let wobble = 0.25 * f64::from(fractal_noise(x, y, 9.0, 2.0, 0.6, seed));
    let row = (y / size).floor();
    let shift = if (row as i64).rem_euclid(2) == 0 { 0.0 } else { 1.1 };
    let column = (x / (2.2 * size) + 0.5 * shift).floor();
    let within_x = x - (column - 0.5 * shift) * 2.2 * size;
    let within_y = y - row * size;
    let mortar = 0.11 * size + wobble;
    let rough = fractal_noise(x, y, 6.0, 0.35, 0.72, seed ^ 9);
    if within_x < mortar || within_y < mortar {
        return shade_colour([0.46, 0.43, 0.38], 1.0 + 0.2 * rough);
    }
    let tint = hash_unit(column as i32, row as i32, seed);
    let base = mix_colours([0.36, 0.11, 0.06], [0.24, 0.13, 0.09], tint);
    shade_colour(base, (0.8 + 0.5 * hash_unit(row as i32, column as i32, seed ^ 3)) * (1.0 + 0.3 * rough))
}

/// Woven cloth with stripes: threads `thread` pitches wide.
pub fn cloth_colour(x: f64, y: f64, thread: f64, colours: [Rgb; 2], seed: u32) -> Rgb {
    let over = ((x / thread).floor() + (y / thread).floor()).rem_euclid(2.0) < 1.0;
    let lie = if over { (PI * x / thread).sin().abs() } else { (PI * y / thread).sin().abs() } as f32;
    let stripe = ((x / (9.0 * thread)).rem_euclid(1.0) < 0.5) ^ ((y / (15.0 * thread)).rem_euclid(1.0) < 0.35);
    let rough = fractal_noise(x, y, 20.0, 0.6, 0.6, seed);
    shade_colour(colours[usize::from(stripe)], (0.55 + 0.5 * lie) * (1.0 + 0.15 * rough))
}

/// Stone: coarse to fine speckle between two colours.
pub fn stone_colour(x: f64, y: f64, colours: [Rgb; 2], seed: u32) -> Rgb {
    let coarse = fractal_noise(x, y, 50.0, 0.35, 0.78, seed);
    let vein = 1.0 - (fractal_noise(x, y, 30.0, 1.0, 0.6, seed ^ 77).abs() * 6.0).min(1.0);
    shade_colour(mix_colours(colours[0], colours[1], 0.5 + 0.4 * coarse), 1.0 - 0.5 * vein)
}

/// A star of `spokes` bright and dark sectors: true on the bright ones.
pub fn in_bright_sector(x: f64, y: f64, spokes: f64) -> bool {
    (spokes * y.atan2(x)).sin() > 0.0
}

/// Whether a line pattern of `frequency` (pairs a pitch) across direction `angle` is bright at the position.
pub fn on_bright_line(x: f64, y: f64, frequency: f64, angle: f64) -> bool {
    let (along, _) = rotate(x, y, angle);
    (TAU * frequency * along).sin() > 0.0
}

/// A leaf from stem (0, 0) to tip (`length`, 0): how far inside (0 at the rim, 1 on the midrib), or `None` outside.
pub fn depth_in_leaf(x: f64, y: f64, length: f64, width: f64) -> Option<f64> {
    let along = x / length;
    if !(0.0..=1.0).contains(&along) {
        return None;
    }
    let half = 0.5 * width * (PI * along.powf(0.8)).sin();
    (y.abs() < half).then(|| 1.0 - y.abs() / half.max(1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_centred_and_fills_its_range() {
        let values: Vec<f32> =
            (0..20000).map(|k| fractal_noise(f64::from(k) * 0.37, f64::from(k % 97), 8.0, 0.5, 0.6, 1)).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt();
        assert!(mean.abs() < 0.05 && (0.2..0.8).contains(&spread), "{mean} {spread}");
    }

    #[test]
    fn lines_have_the_frequency_asked_for() {
        let changes = (0..10_000)
            .filter(|k| {
                on_bright_line(f64::from(*k) * 0.01, 0.0, 0.4, 0.0)
                    != on_bright_line(f64::from(*k + 1) * 0.01, 0.0, 0.4, 0.0)
            })
            .count();
        assert_eq!(changes, 80);
    }
}
