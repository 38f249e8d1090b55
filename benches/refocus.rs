//! Time of refocusing: one 1080x1080 RGB picture from 7x7 views that are in memory (686 MB of f32), all threads.
//! `cargo bench --bench refocus`; with `-- --json` one JSON object instead of criterion's statistics: wall and CPU seconds a
//! picture (the latter tell more on a machine that others use too).

#![allow(clippy::print_stdout)] // its findings

use std::time::Instant;

use criterion::{Criterion, Throughput};
use lenslet::apps::refocus::{ApertureShape, aperture_weights, refocus};
use lenslet::image_io::Picture;
use ndarray::{Array3, Array5};

const SIDE: usize = 1080;

fn field() -> Array5<f32> {
    // The same texture moved by 0.7 pixels a view; cheap to make, and no two values of a row alike.
    let line: Vec<f32> = (0..SIDE + 16).map(|k| 0.5 + 0.3 * (k as f32 * 0.37).sin()).collect();
    Array5::from_shape_fn((7, 7, SIDE, SIDE, 3), |(v, u, t, s, c)| line[s + u] * line[t + v] * (1.0 - 0.1 * c as f32))
}

/// Seconds of all threads of this process so far, in steps of 10 ms; only where there is a /proc.
fn cpu_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    Some((fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?) / 100.0)
}

fn main() {
    let field = field();
    let weights = aperture_weights((7, 7), 1.0, ApertureShape::Square);
    let run = |disparity: f32| {
        refocus(&field.view(), disparity, &weights.view()).unwrap_or_else(|_| Array3::zeros((1, 1, 3)))
    };
    if std::env::args().any(|a| a == "--json") {
        const TIMES: u32 = 20;
        run(0.73);
        let (wall, cpu) = (Instant::now(), cpu_seconds());
        (0..TIMES).for_each(|k| assert_eq!(run(0.73 + 0.01 * k as f32).dim(), (SIDE, SIDE, 3)));
        let each = |seconds: f64| seconds / f64::from(TIMES);
        let cpu = cpu.zip(cpu_seconds()).map(|(a, b)| each(b - a));
        println!("{}", serde_json::json!({ "seconds": each(wall.elapsed().as_secs_f64()), "cpu_seconds": cpu }));
        return;
    }
    let mut criterion = Criterion::default().configure_from_args().sample_size(10);
    let mut group = criterion.benchmark_group("refocus 1080x1080 RGB, 49 views");
    group.throughput(Throughput::Elements((SIDE * SIDE) as u64));
    group.bench_function("fractional shifts", |b| b.iter(|| run(0.73)));
    group.bench_function("whole shifts", |b| b.iter(|| run(1.0)));
    let image = run(0.73);
    group.bench_function("to 8-bit sRGB", |b| b.iter(|| Picture::from_linear(&image.view())));
    group.finish();
    criterion.final_summary();
}
