//! Charts: resolution (sector star, line pairs, slanted edge, letters), 24 colours, plain white. Their places are
//! known.

use std::f64::consts::FRAC_PI_2;

use lenslet_core::stroke_font::is_on_text;

use super::description::{Bounds, Canvas, LayerSource, Region, SceneDescription};
use super::draw::{in_bright_sector, on_bright_line, rotate};

/// Dark and bright of the resolution chart, linear light.
const LEVELS: [f32; 2] = [0.04, 0.8];

/// Line pairs a pitch of the bundles; a hexagonal lattice carries at most about 0.58.
pub const FREQUENCIES: [f64; 6] = [0.12, 0.2, 0.28, 0.36, 0.46, 0.6];

/// Directions across the lines, radians from x.
const DIRECTIONS: [f64; 3] = [0.0, FRAC_PI_2, 0.6];

/// The slanted edges lean by 5 degrees.
const LEAN: f64 = 0.087_266_46;

/// Linear sRGB of the colour chart's patches, row by row: skin, foliage, sky, saturated colours, six greys.
pub const PATCHES: [[f32; 3]; 24] = [
    [0.17, 0.085, 0.055],
    [0.54, 0.31, 0.22],
    [0.12, 0.19, 0.33],
    [0.10, 0.15, 0.05],
    [0.23, 0.21, 0.43],
    [0.13, 0.51, 0.40],
    [0.68, 0.20, 0.03],
    [0.07, 0.10, 0.38],
    [0.52, 0.09, 0.12],
    [0.11, 0.045, 0.14],
    [0.33, 0.50, 0.05],
    [0.75, 0.36, 0.03],
    [0.03, 0.05, 0.28],
    [0.06, 0.29, 0.07],
    [0.42, 0.035, 0.045],
    [0.80, 0.57, 0.02],
    [0.49, 0.09, 0.30],
    [0.04, 0.23, 0.37],
    [0.85, 0.85, 0.85],
    [0.59, 0.59, 0.59],
    [0.36, 0.36, 0.36],
    [0.19, 0.19, 0.19],
    [0.09, 0.09, 0.09],
    [0.03, 0.03, 0.03],
];

/// Reflectance of the white scene.
pub const WHITE: f32 = 0.9;

/// Evenly lit white, without end.
pub fn white() -> SceneDescription<'static> {
    let layer = LayerSource { disparity: [0.0; 3], bounds: None, paint: Box::new(|_, _| [WHITE, WHITE, WHITE, 1.0]) };
    SceneDescription { layers: vec![layer], regions: Vec::new() }
}

fn region(kind: &str, bounds: Bounds) -> Region {
    Region { kind: kind.to_owned(), bounds, frequency: None, angle: None, colour: None, levels: None }
}

/// The tile's elements, from the middle of the tile: centre and half size as shares of the tile.
const STAR: ([f64; 2], f64) = ([-0.25, -0.25], 0.21);
const EDGE: ([f64; 2], f64) = ([0.25, -0.25], 0.13);
const BUNDLES: ([f64; 2], f64) = ([-0.25, 0.25], 0.21);
const LETTERS: ([f64; 2], f64) = ([0.25, 0.25], 0.22);

/// The resolution chart: a tile of at most about 110 pitches, repeated over the canvas.
pub fn resolution(canvas: &Canvas) -> SceneDescription<'static> {
    let [hx, hy] = canvas.half;
    let side = 2.0 * hx.min(hy);
    let tile = side / (side / 110.0).round().max(1.0);
    let (columns, rows) = ((2.0 * hx / tile).round().max(1.0), (2.0 * hy / tile).round().max(1.0));
    let middle = move |x: f64, y: f64| {
        let i = ((x + hx) / tile).floor().clamp(0.0, columns - 1.0);
        let j = ((y + hy) / tile).floor().clamp(0.0, rows - 1.0);
        [(i + 0.5) * tile - hx, (j + 0.5) * tile - hy]
    };
    let paint = move |x: f64, y: f64| {
        let [mx, my] = middle(x, y);
        let level = LEVELS[usize::from(bright(x - mx, y - my, tile))];
        [level, level, level, 1.0]
    };
    let mut regions = Vec::new();
    for j in 0..rows as usize {
        for i in 0..columns as usize {
            regions.extend(tile_regions(tile, [(i as f64 + 0.5) * tile - hx, (j as f64 + 0.5) * tile - hy]));
        }
    }
    let layer = LayerSource { disparity: [canvas.disparity, 0.0, 0.0], bounds: None, paint: Box::new(paint) };
    SceneDescription { layers: vec![layer], regions }
}

/// Whether the chart's tile is bright at (`x`, `y`) from its middle.
fn bright(x: f64, y: f64, tile: f64) -> bool {
    let local = |element: ([f64; 2], f64)| (x - element.0[0] * tile, y - element.0[1] * tile, element.1 * tile);
    let (u, v, radius) = local(STAR);
    if u.hypot(v) < radius {
        return in_bright_sector(u, v, 36.0);
    }
    let (u, v, half) = local(EDGE);
    let (u, v) = rotate(u, v, LEAN);
    if u.abs() < half && v.abs() < half {
        return false;
    }
    let (u, v, half) = local(BUNDLES);
    if u.abs() < half && v.abs() < half {
        let (k, cu) = cell(u, half, FREQUENCIES.len());
        let (l, cv) = cell(v, half, DIRECTIONS.len());
        let (half_u, half_v) = (0.84 * half / FREQUENCIES.len() as f64, 0.84 * half / DIRECTIONS.len() as f64);
        return !(cu.abs() < half_u && cv.abs() < half_v && on_bright_line(cu, cv, FREQUENCIES[k], DIRECTIONS[l]));
    }
    let (u, v, half) = local(LETTERS);
    let (mut top, mut height) = (-half, 0.07 * tile);
    for words in
        ["LENS", "LATTICE", "HEXAGON 37", "LIGHT FIELD 108", "RAW TO VIEWS 1080 328", "SHARP OR BLURRED 0123456789"]
    {
        if is_on_text(u + half, v - top, words, height, 0.9) && u < half {
            return false;
        }
        top += 1.45 * height;
        height *= 0.78;
    }
    true
}

/// Which of `n` cells across −half..half a position is in, and its distance from the cell's middle.
fn cell(x: f64, half: f64, n: usize) -> (usize, f64) {
    let width = 2.0 * half / n as f64;
    let k = ((x + half) / width).floor().clamp(0.0, n as f64 - 1.0);
    (k as usize, x + half - (k + 0.5) * width)
}

/// Where the elements of the tile with its middle at `middle` are.
fn tile_regions(tile: f64, middle: [f64; 2]) -> Vec<Region> {
    let around = |centre: [f64; 2], half: [f64; 2]| -> Bounds {
        let (x, y) = (middle[0] + centre[0] * tile, middle[1] + centre[1] * tile);
        [x - half[0], y - half[1], x + half[0], y + half[1]]
    };
    let both = |half: f64| [half * tile, half * tile];
    let mut regions = vec![
        Region { levels: Some(LEVELS), ..region("star", around(STAR.0, both(STAR.1))) },
        Region { levels: Some(LEVELS), ..region("letters", around(LETTERS.0, both(LETTERS.1))) },
    ];
    // The square's left and top edge: a window half as long as the side, across the edge's middle.
    for angle in [LEAN, LEAN + FRAC_PI_2] {
        let (sin, cos) = angle.sin_cos();
        let centre = [EDGE.0[0] - EDGE.1 * cos, EDGE.0[1] - EDGE.1 * sin];
        regions.push(Region {
            angle: Some(angle),
            levels: Some(LEVELS),
            ..region("edge", around(centre, [0.5 * EDGE.1 * tile, 0.5 * EDGE.1 * tile]))
        });
    }
    let cells = (FREQUENCIES.len() as f64, DIRECTIONS.len() as f64);
    for (k, frequency) in FREQUENCIES.into_iter().enumerate() {
        for (l, angle) in DIRECTIONS.into_iter().enumerate() {
            let centre = [
                BUNDLES.0[0] + BUNDLES.1 * ((2.0 * k as f64 + 1.0) / cells.0 - 1.0),
                BUNDLES.0[1] + BUNDLES.1 * ((2.0 * l as f64 + 1.0) / cells.1 - 1.0),
            ];
            let half = [0.84 * BUNDLES.1 * tile / cells.0, 0.84 * BUNDLES.1 * tile / cells.1];
            regions.push(Region {
                frequency: Some(frequency),
                angle: Some(angle),
                levels: Some(LEVELS),
                ..region("lines", around(centre, half))
            });
        }
    }
    regions
}

/// 24 patches, 6 by 4, on a dark ground.
pub fn colour(canvas: &Canvas) -> SceneDescription<'static> {
    let [hx, hy] = canvas.half;
    let size = [2.0 * hx / 6.0, 2.0 * hy / 4.0];
    let paint = move |x: f64, y: f64| {
        let (k, cx) = cell(x, hx, 6);
        let (l, cy) = cell(y, hy, 4);
        if cx.abs() < 0.42 * size[0] && cy.abs() < 0.42 * size[1] {
            let [r, g, b] = PATCHES[6 * l + k];
            [r, g, b, 1.0]
        } else {
            [0.02, 0.02, 0.02, 1.0]
        }
    };
    let regions = PATCHES.iter().enumerate().map(|(n, colour)| {
        let (x, y) = (((n % 6) as f64 + 0.5) * size[0] - hx, ((n / 6) as f64 + 0.5) * size[1] - hy);
        let bounds = [x - 0.42 * size[0], y - 0.42 * size[1], x + 0.42 * size[0], y + 0.42 * size[1]];
        Region { colour: Some(*colour), ..region("patch", bounds) }
    });
    let regions = regions.collect();
    let layer = LayerSource { disparity: [canvas.disparity, 0.0, 0.0], bounds: None, paint: Box::new(paint) };
    SceneDescription { layers: vec![layer], regions }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chart_regions_contain_their_pattern() {
        let canvas = Canvas { half: [165.0, 165.0], disparity: 0.0, seed: 1 };
        let scene = resolution(&canvas);
        let paint = &scene.layers[0].paint;
        let mut kinds = std::collections::BTreeMap::new();
        for region in &scene.regions {
            *kinds.entry(region.kind.clone()).or_insert(0) += 1;
            let [left, top, right, bottom] = region.bounds;
            assert!(left >= -165.0 && top >= -165.0 && right <= 165.0 && bottom <= 165.0 && right - left > 3.0);
            let (mut dark, mut all) = (0, 0);
            for k in 0..10_000 {
                let x = left + (right - left) * (f64::from(k % 100) + 0.5) / 100.0;
                let y = top + (bottom - top) * (f64::from(k / 100) + 0.5) / 100.0;
                all += 1;
                dark += usize::from(paint(x, y)[0] < 0.1);
            }
            let share = dark as f64 / f64::from(all);
            let expected = match region.kind.as_str() {
                "lines" | "edge" => 0.38..0.62,
                "star" => 0.3..0.5,
                _ => 0.05..0.4,
            };
            assert!(expected.contains(&share), "{region:?}: {share}");
        }
        assert_eq!(kinds["star"], 9);
        assert_eq!(kinds["lines"], 9 * 18);
        assert_eq!(kinds["edge"], 18);
    }

    #[test]
    fn every_colour_patch_is_at_its_stated_place() {
        let scene = colour(&Canvas { half: [60.0, 40.0], disparity: 0.0, seed: 1 });
        assert_eq!(scene.regions.len(), 24);
        for region in &scene.regions {
            let [left, top, right, bottom] = region.bounds;
            for (x, y) in [(left + 0.1, top + 0.1), (right - 0.1, bottom - 0.1)] {
                let seen = (scene.layers[0].paint)(x, y);
                assert_eq!(Some([seen[0], seen[1], seen[2]]), region.colour);
            }
        }
    }
}
