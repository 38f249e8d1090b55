//! Light fields on disk: written, read back, refused when wrong.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::fs;
use std::path::Path;

use lenslet_core::lightfield::{
    ColourSpace, Error, Format, LightField, Meta, ReadOptions, ViewSink, create, load, open,
};
use ndarray::{Array5, s};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

/// A random light field whose values 16 bits can hold exactly.
fn random(views: [usize; 2], size: [usize; 2], channels: usize, seed: u64) -> LightField {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let shape = (views[0], views[1], size[0], size[1], channels);
    let data = Array5::from_shape_simple_fn(shape, || f32::from(rng.random::<u16>()) / 65535.0);
    LightField { meta: Meta::new(views, size, channels, ColourSpace::Srgb), data }
}

fn save(field: &LightField, path: &Path, format: Format) {
    let mut sink = create(path, field.meta.clone(), format, false).unwrap();
    write_all(field, sink.as_mut());
    sink.finish().unwrap();
}

fn write_all(field: &LightField, sink: &mut dyn ViewSink) {
    // Backwards: any order will do.
    for v in (0..field.meta.views[0]).rev() {
        for u in (0..field.meta.views[1]).rev() {
            sink.write(v, u, &field.data.slice(s![v, u, .., .., ..]).to_owned()).unwrap();
        }
    }
}

#[test]
fn round_trips_are_exact() {
    let dir = tempfile::tempdir().unwrap();
    for (format, channels) in [(Format::Directory, 3), (Format::Directory, 1), (Format::Npy, 3), (Format::Npy, 1)] {
        let mut field = random([3, 4], [9, 14], channels, 5);
        if format == Format::Directory {
            field.meta.pitch = Some(3.29);
            field.meta.colour = ColourSpace::Linear;
            field.meta.provenance.push(serde_json::json!({"tool": "test", "note": "ünïcode \"quoted\""}));
        }
        let path = dir.path().join(format!("{format} {channels}"));
        save(&field, &path, format);
        assert_eq!(load(&path, &ReadOptions::default()).unwrap(), field, "{format}");
    }
}

#[test]
fn values_outside_of_the_range_are_clamped_in_png_and_kept_in_npy() {
    let dir = tempfile::tempdir().unwrap();
    let mut field = random([1, 1], [2, 2], 1, 1);
    field.data.assign(&ndarray::arr3(&[[[-0.5], [1.5]], [[0.25], [1.0]]]).insert_axis(ndarray::Axis(0)));
    save(&field, &dir.path().join("a"), Format::Directory);
    save(&field, &dir.path().join("b.npy"), Format::Npy);
    let read =
        |name: &str| load(&dir.path().join(name), &ReadOptions::default()).unwrap().data.into_raw_vec_and_offset().0;
    assert_eq!(read("b.npy"), [-0.5, 1.5, 0.25, 1.0]);
    let png = read("a");
    assert_eq!((png[0], png[1], png[3]), (0.0, 1.0, 1.0));
    assert!((png[2] - 0.25).abs() < 1e-5);
}

#[test]
fn an_unfinished_light_field_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let field = random([2, 2], [8, 8], 3, 1);
    for format in [Format::Directory, Format::Npy] {
        let path = dir.path().join("out");
        let mut sink = create(&path, field.meta.clone(), format, false).unwrap();
        sink.write(0, 0, &field.data.slice(s![0, 0, .., .., ..]).to_owned()).unwrap();
        drop(sink);
        let mut sink = create(&path, field.meta.clone(), format, false).unwrap();
        sink.write(1, 1, &field.data.slice(s![1, 1, .., .., ..]).to_owned()).unwrap();
        let error = sink.finish().unwrap_err().to_string();
        assert!(error.contains("3 views were not written"), "{error}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}

#[test]
fn existing_output_wrong_shapes_and_wrong_places_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let field = random([1, 2], [8, 8], 3, 1);
    let path = dir.path().join("out");
    save(&field, &path, Format::Directory);
    assert!(matches!(create(&path, field.meta.clone(), Format::Npy, false), Err(Error::Output(_))));
    let mut sink = create(&path, field.meta.clone(), Format::Directory, true).unwrap();
    let view = field.data.slice(s![0, 0, .., .., ..]).to_owned();
    assert!(sink.write(0, 2, &view).is_err());
    assert!(sink.write(0, 0, &view.slice(s![..7, .., ..]).to_owned()).is_err());
    drop(sink);
    let source = open(&path, &ReadOptions::default()).unwrap();
    assert!(source.read(1, 0).is_err());
    for bad in [[0, 1], [1, 1025]] {
        let meta = Meta { views: bad, ..field.meta.clone() };
        assert!(matches!(create(&dir.path().join("x"), meta, Format::Npy, false), Err(Error::Parameter(_))));
    }
    let meta = Meta { size: [usize::MAX, 1], ..field.meta };
    assert!(create(&dir.path().join("x"), meta, Format::Npy, false).is_err());
}

#[test]
fn bad_directories_are_told_apart() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("lf");
    save(&random([2, 2], [12, 10], 3, 1), &path, Format::Directory);
    let description = path.join("lightfield.json");
    let text = fs::read_to_string(&description).unwrap();
    let message = |text: &str| {
        fs::write(&description, text).unwrap();
        match open(&path, &ReadOptions::default()) {
            Ok(source) => source.read(1, 0).unwrap_err().to_string(),
            Err(e) => e.to_string(),
        }
    };
    assert!(message(&text.replace("\"version\": 1", "\"version\": 2")).contains("newer lenslet"));
    assert!(message(&text.replace("10\n", "18446744073709551616\n")).contains("not a description"));
    assert!(message(&text.replace("10\n", "9223372036854775807\n")).contains("each side must be"));
    assert!(message(&text.replace("10\n", "11\n")).contains("views of 11x12, but"));
    assert!(message("").contains("not a description"));
    assert!(message(&"[".repeat(100_000)).contains("not a description"));
    fs::write(&description, &text).unwrap();
    fs::write(path.join("view_01_00.png"), b"no picture").unwrap();
    assert!(message(&text).contains("view_01_00.png: not a picture"));
    fs::remove_file(path.join("view_01_00.png")).unwrap();
    assert!(message(&text).contains("view_01_00.png"));
    save(&random([2, 2], [12, 10], 3, 1), &dir.path().join("whole"), Format::Directory);
    let path = dir.path().join("whole");
    let options = ReadOptions { max_bytes: 100, ..ReadOptions::default() };
    assert!(load(&path, &options).unwrap_err().to_string().contains("more than the limit"));
}

#[test]
fn not_numbers_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut field = random([1, 2], [4, 4], 1, 1);
    field.data[[0, 1, 2, 2, 0]] = f32::NAN;
    let path = dir.path().join("x.npy");
    save(&field, &path, Format::Npy);
    let message = open(&path, &ReadOptions::default()).err().unwrap().to_string();
    assert!(message.contains("1 of its 32 numbers are not finite") && message.contains("[0, 1, 2, 2, 0]"), "{message}");
}
