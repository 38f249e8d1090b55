//! Weights of small and large micro-images.

use super::*;
use crate::calibration::{Grid, Lenslet};
use crate::geometry::Size;
use crate::progress::Silent;

/// A square lattice of `pitch` pixels on a sensor of 4x4 lenslets.
fn camera(pitch: f64) -> Calibration {
    let side = (4.0 * pitch) as usize;
    let lattice = Lattice { grid: Grid::Square, origin: [pitch / 2.0; 2], a: [pitch, 0.0], b: [0.0, pitch] };
    let places = (0..4).flat_map(|j| (0..4).map(move |i| (i, j)));
    let lenslet = |(i, j)| {
        let [x, y] = lattice.centre(i, j);
        Lenslet { i, j, x, y, trust: 1.0 }
    };
    Calibration {
        width: side,
        height: side,
        lattice,
        lenslets: places.map(lenslet).collect(),
        quality: Default::default(),
        vignetting: None,
        hot_pixels: Vec::new(),
        origin: Default::default(),
    }
}

fn samples_of(calibration: &Calibration, views: usize, view_step: f64) -> HexSamples {
    HexSamples {
        sensor: Size::new(calibration.width, calibration.height),
        index: calibration.lenslets.iter().map(|l| [l.i, l.j]).collect(),
        views,
        view_step,
        weights: vec![1.0; views * views],
        centres: calibration.centres().collect(),
        values: Array3::zeros((0, 0, 0)),
    }
}

/// Light that changes linearly, another way for each colour, comes out exactly, however large the micro-image, and far
/// from its middle, too.
#[test]
fn linear_light_is_exact_at_every_pitch() {
    let cfa = Cfa::Bggr;
    let light = |x: f64, y: f64, c: usize| 0.3 + 0.1 * c as f64 + 0.002 * x - 0.001 * y;
    for (pitch, views, step) in [(10.0, 7, 1.0), (24.0, 5, 2.0), (40.0, 7, 4.0)] {
        let calibration = camera(pitch);
        let side = calibration.width;
        let at = |k: usize| light((k % side) as f64, (k / side) as f64, cfa.colour(k % side, k / side)) as f32;
        let mosaic = Mosaic { width: side, height: side, data: (0..side * side).map(at).collect() };
        let samples = samples_of(&calibration, views, step);
        let values = sample_views(&mosaic, cfa, &calibration, &samples, &Silent).unwrap();
        for ((view, k, c), value) in values.indexed_iter() {
            let ([u, v], [x, y]) = (view_offset(views, step, view), samples.centres[k]);
            let expected = light(x + u, y + v, c);
            assert!((f64::from(*value) - expected).abs() < 1e-4, "{pitch} {view} {k} {c}: {value} {expected}");
        }
    }
}

/// The system of a view is bounded, whatever the pitch; small micro-images have one with all their pixels.
#[test]
fn far_pixels_are_left_out_of_large_micro_images() {
    for (pitch, bounded) in [(10.0, false), (14.3, false), (40.0, true), (64.0, true)] {
        let calibration = camera(pitch);
        let model = Model {
            lattice: &calibration.lattice,
            cfa: Cfa::Bggr,
            light: mean_profile(&calibration),
            reach: (pitch * 0.62).ceil() as i32,
            views: 3,
            view_step: 1.0,
        };
        let weights = solve_weights(&model, 0).unwrap();
        for o in 0..weights.outputs {
            let used = weights.rows.chunks_exact(weights.outputs).filter(|row| row[o] != 0.0).count();
            assert_eq!(used <= NEAREST && weights.pixels.len() > NEAREST, bounded, "{pitch}: {used}");
        }
    }
}
