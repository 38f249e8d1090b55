//! Time of calibration: a simulated white image of 1640x1640 pixels (a quarter of an F01's), pitch 9.93 px.
//! `cargo run --release --example centres -- IMAGE.png OUT.npy --times` splits a real one by stage.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lenslet_core::calibration::{Options, Variant, calibrate, from_captures};
use lenslet_core::container::{CameraFacts, Capture, Cfa, Levels};
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::{Camera, Lenslets, expose_white, record, white_pattern};

fn white() -> Option<Capture> {
    let camera = Camera { sensor: (1640, 1640), ..Camera::default() };
    let lenslets = Lenslets::new(&camera, 1).ok()?;
    let light = expose_white(&camera, &white_pattern(&camera, &lenslets));
    Some(Capture {
        mosaic: record(&light, camera.sensor, 0.7, 1, 0),
        cfa: Cfa::Bggr,
        levels: Levels { black: [168.0; 4], white: [4095.0; 4] },
        colour: camera.colour,
        camera: CameraFacts::default(),
        mla: None,
        source_sha256: String::new(),
        white: None,
        warnings: Vec::new(),
    })
}

fn calibration(c: &mut Criterion) {
    let Some(white) = white() else { return };
    let mut group = c.benchmark_group("calibrate 1640x1640");
    group.throughput(Throughput::Elements(1640 * 1640)).sample_size(10);
    for variant in [Variant::Full, Variant::Paper] {
        let options = Options { variant, without_vignetting: true };
        group.bench_function(variant.name(), |b| b.iter(|| calibrate(std::slice::from_ref(&white), &options, &Silent)));
    }
    let options = Options::default();
    group.bench_function("full with vignetting", |b| {
        b.iter(|| calibrate(std::slice::from_ref(&white), &options, &Silent))
    });
    group.bench_function("from 2 captures", |b| {
        b.iter(|| from_captures(&[white.clone(), white.clone()], &options, &Silent))
    });
    group.finish();
}

criterion_group!(benches, calibration);
criterion_main!(benches);
