//! Light fields of other tools: .npy of every kind, MATLAB files, folders of numbered pictures, lenslet pictures.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::fs;
use std::path::{Path, PathBuf};

use lenslet_core::lightfield::{
    ColourSpace, Error, Format, LightField, Meta, ReadOptions, ViewOrder, create, load, open,
};
use ndarray::{Array2, Array4, Array5, ArrayD, Axis, ShapeBuilder, s};
use ndarray_npy::write_npy;

fn reference(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name)
}

fn read(path: &Path) -> Result<LightField, Error> {
    load(path, &ReadOptions::default())
}

/// A different number everywhere, exact in 16 bits and 8 bits alike.
fn numbered(shape: (usize, usize, usize, usize, usize)) -> Array5<u8> {
    Array5::from_shape_fn(shape, |(v, u, t, s, c)| (97 * v + 41 * u + 13 * t + 5 * s + c) as u8)
}

fn save(data: &Array5<f32>, path: &Path, format: Format) {
    let (v, u, t, s, c) = data.dim();
    let meta = Meta::new([v, u], [t, s], c, ColourSpace::Srgb);
    let mut sink = create(path, meta, format, false).unwrap();
    for (v, row) in data.outer_iter().enumerate() {
        for (u, view) in row.outer_iter().enumerate() {
            sink.write(v, u, &view.to_owned()).unwrap();
        }
    }
    sink.finish().unwrap();
}

#[test]
fn npy_of_every_type_and_order() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.npy");
    let numbers = numbered((3, 2, 4, 5, 3));
    let expected = numbers.mapv(|x| f32::from(x) / 255.0);
    let check = |what: &str| {
        let field = read(&path).unwrap();
        let worst = (&field.data - &expected).mapv(f32::abs).fold(0.0f32, |a, &b| a.max(b));
        assert!(worst < 1e-7, "{what}: {worst}");
    };
    write_npy(&path, &numbers).unwrap();
    check("u8");
    write_npy(&path, &numbers.mapv(|x| u16::from(x) * 257)).unwrap();
    check("u16");
    write_npy(&path, &expected).unwrap();
    check("f32");
    write_npy(&path, &numbers.mapv(|x| f64::from(x) / 255.0)).unwrap();
    check("f64");
    let mut columns = Array5::<f32>::zeros(expected.dim().f());
    columns.assign(&expected);
    write_npy(&path, &columns).unwrap();
    assert!(fs::read(&path).unwrap().windows(4).any(|w| w == b"True"), "not in Fortran order");
    check("Fortran f32");

    // Big-endian, with a header as NumPy writes it.
    let mut bytes =
        b"\x93NUMPY\x01\x00\x76\x00{'descr': '>f4', 'fortran_order': False, 'shape': (3, 2, 4, 5, 3), }".to_vec();
    bytes.resize(127, b' ');
    bytes.push(b'\n');
    bytes.extend(expected.iter().flat_map(|x| x.to_be_bytes()));
    fs::write(&path, bytes).unwrap();
    check("big-endian f32");
}

#[test]
fn npy_of_fewer_dimensions() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.npy");
    let five = numbered((2, 2, 6, 7, 3));
    let expected = five.mapv(|x| f32::from(x) / 255.0);

    let grey: Array4<u8> = five.index_axis(Axis(4), 1).to_owned();
    write_npy(&path, &grey).unwrap();
    assert_eq!(read(&path).unwrap().data, expected.slice(s![.., .., .., .., 1..2]));

    for fortran in [false, true] {
        let mut running = Array4::<u8>::zeros((4, 6, 7, 3).set_f(fortran));
        running.assign(&five.to_shape((4, 6, 7, 3)).unwrap());
        write_npy(&path, &running).unwrap();
        assert_eq!(read(&path).unwrap().data, expected, "views in a row, fortran {fortran}");
        let options = ReadOptions { views: Some([1, 4]), ..ReadOptions::default() };
        let field = load(&path, &options).unwrap();
        assert_eq!(field.meta.views, [1, 4]);
        assert_eq!(field.data.slice(s![0, 3, .., .., ..]), expected.slice(s![1, 1, .., .., ..]));
    }
    write_npy(&path, &five.slice(s![0, 1, .., .., ..]).to_owned()).unwrap();
    assert_eq!(read(&path).unwrap().data.slice(s![0, 0, .., .., ..]), expected.slice(s![0, 1, .., .., ..]));
    write_npy(&path, &five.slice(s![0, 1, .., .., 0]).to_owned()).unwrap();
    assert_eq!(read(&path).unwrap().data.slice(s![0, 0, .., .., 0]), expected.slice(s![0, 1, .., .., 0]));
}

#[test]
fn npy_that_is_no_light_field() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.npy");
    let fails = |words: &str| {
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    write_npy(&path, &ArrayD::<f32>::zeros(vec![2, 2, 2, 2, 2])).unwrap();
    fails("a light field has shape");
    write_npy(&path, &ArrayD::<f32>::zeros(vec![3, 4, 4, 3])).unwrap();
    fails("--views");
    write_npy(&path, &ArrayD::<i64>::zeros(vec![2, 2, 4, 4, 3])).unwrap();
    fails("numbers of type");
    write_npy(&path, &ArrayD::<f32>::zeros(vec![0, 2, 4, 4, 3])).unwrap();
    fails("views");
    let header = |shape: &str| {
        let text = format!("{{'descr': '<f4', 'fortran_order': True, 'shape': ({shape}), }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        fs::write(&path, bytes).unwrap();
    };
    header("9223372036854775807, 9223372036854775807, 2, 2, 3");
    fails("each must be");
    header("1000, 1000, 9000, 9000, 3");
    fails("ends early");
    header("99999999999999999999999999, 3");
    fails("shape has");
}

#[test]
fn matlab_files_written_by_scipy() {
    let expected = Array5::from_shape_fn((3, 2, 4, 5, 3), |(v, u, t, s, c)| {
        let x = 65535.0 * ((1000 * v + 100 * u + 10 * t + s) as f64 + 0.1 * c as f64) / 4000.0;
        (x.round_ties_even() / 65535.0) as f32
    });
    for name in ["lf_uint16_compressed.mat", "lf_uint16_plain.mat", "lf_double_other_name.mat"] {
        let field = read(&reference(name)).unwrap();
        let worst = (&field.data - &expected).mapv(f32::abs).fold(0.0f32, |a, &b| a.max(b));
        assert!(worst < 1e-7, "{name}: {worst}");
    }
}

#[test]
fn matlab_of_the_hdf5_kind_says_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.mat");
    let mut bytes = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".to_vec();
    bytes.resize(512, b' ');
    bytes.extend(b"\x89HDF\r\n\x1a\n");
    fs::write(&path, &bytes).unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("-v7"));
    fs::write(&path, &bytes[512..]).unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("h5py"));
}

#[test]
fn mat_and_eslf_round_trips() {
    let dir = tempfile::tempdir().unwrap();
    for channels in [1, 3] {
        let data = numbered((3, 2, 5, 7, channels)).mapv(|x| f32::from(x) / 255.0);
        let mat = dir.path().join(format!("{channels}.mat"));
        save(&data, &mat, Format::Mat);
        assert_eq!(read(&mat).unwrap().data, data);
        let eslf = dir.path().join(format!("{channels}.png"));
        save(&data, &eslf, Format::Eslf);
        let options = ReadOptions { views: Some([3, 2]), ..ReadOptions::default() };
        assert_eq!(load(&eslf, &options).unwrap().data, data);
    }
    // It says so itself; saved by another program it is one picture, its views side by side in every lenslet.
    assert_eq!(read(&dir.path().join("1.png")).unwrap().meta.views, [3, 2]);
    let plain = dir.path().join("plain.png");
    image::open(dir.path().join("1.png")).unwrap().save(&plain).unwrap();
    let whole = read(&plain).unwrap();
    assert_eq!(whole.meta.size, [15, 14]);
    let data = numbered((3, 2, 5, 7, 1)).mapv(|x| f32::from(x) / 255.0);
    assert_eq!(whole.data[[0, 0, 3 * 4 + 2, 2 * 6 + 1, 0]], data[[2, 1, 4, 6, 0]]);
}

#[test]
fn folders_of_numbered_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let value = |v: usize, u: usize| (20 * v + 7 * u) as u8;
    for v in 0..3 {
        for u in 0..2 {
            let picture = image::GrayImage::from_pixel(6, 4, image::Luma([value(v, u)]));
            picture.save(dir.path().join(format!("view_{}_{}.png", v + 1, u + 1))).unwrap();
        }
    }
    fs::write(dir.path().join("LICENSE.txt"), "none").unwrap();
    let field = read(dir.path()).unwrap();
    assert_eq!((field.meta.views, field.meta.size, field.meta.channels), ([3, 2], [4, 6], 1));
    let corners = field.data.slice(s![.., .., 0, 0, 0]).mapv(|x| (x * 255.0).round() as u8);
    assert_eq!(corners, Array2::from_shape_fn((3, 2), |(v, u)| value(v, u)));
    // A view of another size is named.
    image::GrayImage::new(6, 5).save(dir.path().join("view_2_2.png")).unwrap();
    let message = open(dir.path(), &ReadOptions::default()).unwrap().read(1, 1).unwrap_err().to_string();
    assert!(message.contains("view_2_2.png") && message.contains("6x5"), "{message}");
}

#[test]
fn real_light_fields() {
    let Some(folder) = lenslet_test_support::data("lightfields") else { return };
    for (name, views, size) in [
        ("f01_jaramillo_IMG_0001", [10, 10], [256, 256]),
        ("kaist_checker_7x7", [7, 7], [328, 328]),
        ("hci_antinous_9x9", [9, 9], [512, 512]),
    ] {
        let source = open(&folder.join(name), &ReadOptions::default()).unwrap();
        assert_eq!((source.meta().views, source.meta().size, source.meta().channels), (views, size, 3), "{name}");
        // Neighbours differ less than opposite views of a row: the order is right.
        let middle = views[0] / 2;
        let row: Vec<_> = [0, 1, views[1] - 1].map(|u| source.read(middle, u).unwrap()).into();
        let difference = |a: usize, b: usize| (&row[a] - &row[b]).mapv(|x| x * x).sum();
        assert!(difference(0, 1) < difference(0, 2), "{name}");
    }
}

/// Each of them with its views numbered in eight ways, and the ways that are found.
#[test]
fn orders_of_real_light_fields_are_found() {
    let Some(folder) = lenslet_test_support::data("lightfields") else { return };
    for name in ["f01_jaramillo_IMG_0001", "kaist_checker_7x7", "hci_antinous_9x9", "hci_cotton_33"] {
        let options = ReadOptions { partial: true, ..ReadOptions::default() };
        let source = open(&folder.join(name), &options).unwrap();
        let views = source.meta().views;
        let own = source.order().map(|read| read.order);
        let expected = ViewOrder { columns_first: name.starts_with("f01"), ..ViewOrder::default() };
        assert_eq!(own, Some(expected), "{name}");
        for k in 0..8 {
            let order =
                ViewOrder { columns_first: k & 1 > 0, mirror_v: k & 2 > 0, mirror_u: k & 4 > 0, serpentine: false };
            let dir = tempfile::tempdir().unwrap();
            let [rows, columns] = order.stored_views(views);
            for at in 0..views[0] * views[1] {
                let [v, u] = [at / views[1], at % views[1]];
                let [a, b] = order.stored_place([v, u], views);
                // What looking for the order reads: a cross of views, and as many as make the others absent, not unknown.
                let on_cross =
                    a == rows / 2 || b == columns / 2 || [a, b] == [0, 0] || [a, b] == [rows - 1, columns - 1];
                if on_cross && !source.is_absent(v, u).unwrap() {
                    let view = source.read(v, u).unwrap();
                    let (h, w, _) = view.dim();
                    let bytes = view.iter().map(|x| (x * 255.0).round() as u8).collect();
                    let picture = image::RgbImage::from_raw(w as u32, h as u32, bytes).unwrap();
                    picture.save(dir.path().join(format!("view_{a:02}_{b:02}.png"))).unwrap();
                }
            }
            let found = open(dir.path(), &options).unwrap().order().unwrap();
            println!("{name}: {order} found as {} ({:.2})", found.order, found.agreement.unwrap());
            let expected = ViewOrder { mirror_v: order.mirror_v != order.mirror_u, mirror_u: false, ..order };
            assert_eq!(found.order, expected, "{name} {order}");
        }
    }
}
