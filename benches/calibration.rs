//! Time of calibration: a simulated white image of 1640x1640 pixels (a quarter of an F01's), pitch 9.93 px, and one of
//! 7728x5368 (an Illum's), pitch 14.29 px.
//! `cargo run --release --example centres -- IMAGE.png OUT.npy --times` splits a real one by stage.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lenslet_core::calibration::{CalibrationOptions, CalibrationVariant, calibrate, calibrate_from_captures};
use lenslet_core::container::{Capture, Cfa, Levels};
use lenslet_core::geometry::Size;
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::{Camera, LensletGrid, Lenslets, expose_white, record_mosaic, white_pattern};

/// A white image of a sensor of this size, with lenslets of this pitch.
fn white(sensor: Size, pitch: f64) -> Option<Capture> {
    let camera = Camera { sensor, lenslets: LensletGrid { pitch, ..LensletGrid::default() }, ..Camera::default() };
    let lenslets = Lenslets::new(&camera, 1).ok()?;
    let light = expose_white(&camera, &white_pattern(&camera, &lenslets));
    let levels = Levels { black: [168.0; 4], white: [4095.0; 4] };
    Some(Capture::bare(record_mosaic(&light, &camera, 0.7, 1, 0), Cfa::Bggr, levels))
}

/// As large as an Illum's.
fn large(c: &mut Criterion) {
    let Some(white) = white(Size::new(7728, 5368), 14.2857) else { return };
    let mut group = c.benchmark_group("calibrate 7728x5368");
    group.throughput(Throughput::Elements(7728 * 5368)).sample_size(10);
    for (name, without_vignetting) in [("full", true), ("full with vignetting", false)] {
        let options = CalibrationOptions { without_vignetting, ..CalibrationOptions::default() };
        group.bench_function(name, |b| b.iter(|| calibrate(std::slice::from_ref(&white), &options, &Silent)));
    }
    group.finish();
}

fn calibration(c: &mut Criterion) {
    let Some(white) = white(Size::new(1640, 1640), Camera::default().lenslets.pitch) else { return };
    let mut group = c.benchmark_group("calibrate 1640x1640");
    group.throughput(Throughput::Elements(1640 * 1640)).sample_size(10);
    for variant in [CalibrationVariant::Full, CalibrationVariant::Paper] {
        let options = CalibrationOptions { variant, without_vignetting: true, ..CalibrationOptions::default() };
        group.bench_function(variant.name(), |b| b.iter(|| calibrate(std::slice::from_ref(&white), &options, &Silent)));
    }
    let options = CalibrationOptions::default();
    group.bench_function("full with vignetting", |b| {
        b.iter(|| calibrate(std::slice::from_ref(&white), &options, &Silent))
    });
    group.bench_function("from 2 captures", |b| {
        b.iter(|| calibrate_from_captures(&[white.clone(), white.clone()], &options, &Silent))
    });
    group.finish();
}

criterion_group!(benches, calibration, large);
criterion_main!(benches);
