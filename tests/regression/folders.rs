//! Folders of pictures: which is which view, what is missing, and what kind of picture it is.

use super::bench::Bench;
use super::fields::{aloud, read_npy, save_view, scene, told};

/// Signs made another pattern of names: a quarter of the views was taken for the light field.
#[test]
fn signed_numbers_and_camera_positions() {
    let bench = Bench::new();
    let field = scene(5, 16, [0.4, -0.3, 0.8]);
    for v in 0..5 {
        for u in 0..5 {
            let (r, c) = (v as i32 - 2, u as i32 - 2);
            save_view(&field, v, u, &bench.at(&format!("centred/view_{r}_{c}.png")));
            let (x, y) = (8.4 * f64::from(c) + 0.113 + 0.02 * f64::from(r), 20.217 - 8.1 * f64::from(r));
            save_view(&field, v, u, &bench.at(&format!("gantry/out_{v:02}_{u:02}_{y:.6}_{x:.6}_.png")));
        }
    }
    save_view(&field, 2, 2, &bench.at("whole.png"));
    for name in ["centred", "gantry"] {
        assert_eq!(told(bench.path(), &format!("info {name}"))["views"], serde_json::json!([5, 5]), "{name}");
        bench.done(&format!("convert {name} --crop-views 1 --out {name}.lf"));
        assert_eq!(told(bench.path(), &format!("score {name}.lf whole.png"))["views"][0]["identical"], true, "{name}");
    }
}

/// A cross of 33 views was "no square"; the hint to give --views led to nonsense.
#[test]
fn numbers_with_gaps_are_absent_views() {
    let bench = Bench::new();
    let field = scene(9, 40, [0.8, -0.6, 1.5]);
    let cross = |v: usize, u: usize| v == 4 || u == 4 || v == u || v + u == 8;
    for k in 0..81 {
        if cross(k / 9, k % 9) {
            save_view(&field, k / 9, k % 9, &bench.at(&format!("cross/input_Cam{k:03}.png")));
        }
        if k < 64 {
            save_view(&field, k / 9, k % 9, &bench.at(&format!("first/input_Cam{k:03}.png")));
        }
        if k / 9 == 4 {
            save_view(&field, 4, k % 9, &bench.at(&format!("row/input_Cam{k:03}.png")));
        }
        save_view(&field, k / 9, k % 9, &bench.at(&format!("all/input_Cam{k:03}.png")));
    }
    let info = aloud(bench.path(), "info cross");
    assert!(info.out.contains("9 9") && info.err.contains("48 views of 9x9 are missing"), "{}{}", info.out, info.err);
    let answer = bench.refused("depth cross --views 3x11 --out d", &["33 pictures", "gaps"]);
    assert!(!answer.err.contains("no square"));
    // What is there suffices for depth; nothing is made of what is not there.
    let with = told(bench.path(), "depth cross --out d");
    let whole = told(bench.path(), "depth all --out e");
    let confidence = |json: &serde_json::Value| json["mean_confidence"].as_f64().unwrap();
    assert!(confidence(&with) > 0.8 * confidence(&whole), "{with} {whole}");
    bench.refused("depth first --out f", &["8x8", "rows of 9", "--views"]);
    bench.refused("depth row --out f", &["3x3", "single row", "--views"]);
    bench.done("depth first --views 9x9 --out f");
    bench.done("depth row --views 1x9 --out g");
}

/// A bitmap was taken for a raw file, upside down; a folder of them for nothing.
#[test]
fn bitmaps_are_pictures() {
    let bench = Bench::new();
    let field = scene(3, 16, [0.4, -0.3, 0.8]);
    for v in 0..3 {
        for u in 0..3 {
            save_view(&field, v, u, &bench.at(&format!("views/scene_{v}_{u}.bmp")));
        }
    }
    assert_eq!(told(bench.path(), "info views")["views"], serde_json::json!([3, 3]));
    let white = image::GrayImage::from_fn(200, 200, |x, y| {
        let row = (f64::from(y) / 10.392).round();
        let dx = (f64::from(x) - 5.0 * (row % 2.0)).rem_euclid(12.0) - 6.0;
        let dy = f64::from(y) - row * 10.392;
        image::Luma([(230.0 * (1.0 - 0.55 * (dx * dx + dy * dy) / 36.0).max(0.1)) as u8])
    });
    white.save(bench.at("w.bmp")).unwrap();
    white.save(bench.at("w.png")).unwrap();
    bench.put(
        "mono.toml",
        "format = 1\nname = \"mono\"\nmake = \"x\"\nmodels = [\"m\"]\n[sensor]\nwidth = 200\nheight = 200\npacking = \"u8\"\n\
         cfa = \"mono\"\nblack = [10,10,10,10]\nwhite = [255,255,255,255]\n",
    );
    let of = |name: &str| told(bench.path(), &format!("info {name} --profile mono.toml"))["values"].clone();
    assert_eq!(of("w.bmp"), of("w.png"));
    bench.put("w.webp", b"RIFF\x10\0\0\0WEBPVP8 aaaaaaaa");
    bench.refused("calibrate w.webp --profile mono.toml --out x.calib", &["WebP", "PNG"]);
    bench.put("w.raw", bench.bytes("w.png"));
    assert_eq!(of("w.raw"), of("w.png"), "a picture is one whatever its name");
}

#[test]
fn pictures_that_are_left_out_are_counted() {
    let bench = Bench::new();
    let field = scene(3, 16, [0.4, -0.3, 0.8]);
    for k in 0..9 {
        save_view(&field, k / 3, k % 3, &bench.at(&format!("f/v_{}_{}.png", k / 3, k % 3)));
        bench.put(&format!("w/v_{}_{}.webp", k / 3, k % 3), b"RIFF");
    }
    save_view(&field, 0, 0, &bench.at("f/disparity.png"));
    let answer = aloud(bench.path(), "convert f --out x");
    assert!(
        answer.code == Some(0) && answer.err.contains("1 pictures") && answer.err.contains("disparity.png"),
        "{}",
        answer.err
    );
    bench.refused("convert w --out y", &["WebP", "PNG"]);
}

/// Views numbered column by column, from below or back and forth were believed to be row by row, and depth was garbage.
#[test]
fn the_order_of_views_is_found() {
    let bench = Bench::new();
    let n = 7;
    let field = scene(n, 96, [-1.2, 0.3, 0.9]);
    type Name = fn(usize, usize, usize) -> String;
    let orders: [(&str, &str, Name); 6] = [
        ("rm", "rows", |v, u, n| format!("im{:03}", v * n + u)),
        ("cr", "columns", |v, u, _| format!("v_{u}_{v}")),
        ("cm", "columns", |v, u, n| format!("im{:03}", u * n + v)),
        ("bu", "mirror-v", |v, u, n| format!("im{:03}", (n - 1 - v) * n + u)),
        ("sp", "serpentine", |v, u, n| format!("im{:03}", v * n + if v % 2 == 0 { u } else { n - 1 - u })),
        ("sc", "columns,serpentine", |v, u, n| format!("im{:03}", u * n + if u % 2 == 0 { v } else { n - 1 - v })),
    ];
    for (folder, order, name) in orders {
        for v in 0..n {
            for u in 0..n {
                save_view(&field, v, u, &bench.at(&format!("{folder}/{}.png", name(v, u, n))));
            }
        }
        let info = told(bench.path(), &format!("info {folder}"));
        assert_eq!(
            (&info["order"]["views"], &info["order"]["found_by"]),
            (&order.into(), &"parallax".into()),
            "{info}"
        );
        bench.done(&format!("convert {folder} --out {folder}.npy"));
        let expected = field.mapv(|x| f32::from(x) / 255.0);
        let read = read_npy(&bench.at(&format!("{folder}.npy")));
        assert!((&read - &expected).iter().all(|d| d.abs() < 1e-4), "{folder}");
        // What the user says counts, and a description that is there.
        let stated = told(bench.path(), &format!("info {folder} --order rows"));
        assert_eq!(stated["order"]["views"], "rows");
        bench.done(&format!("convert {folder} --order rows --out stored.npy --force"));
        let stored = read_npy(&bench.at("stored.npy"));
        assert_eq!(order == "rows", (&stored - &expected).iter().all(|d| d.abs() < 1e-4), "{folder}");
        bench.done(&format!("convert stored.npy --order {order} --out again.npy --force"));
        let again = read_npy(&bench.at("again.npy"));
        assert!((&again - &expected).iter().all(|d| d.abs() < 1e-4), "{folder}");
        let warned = aloud(bench.path(), &format!("depth {folder} --out d --force"));
        assert_eq!(order == "rows", warned.err.is_empty(), "{folder}: {}", warned.err);
    }
    let answer = bench.run("convert cr --order column --out x.npy");
    assert!(answer.code == Some(2) && answer.err.contains("rows, or of columns"), "{}", answer.err);
}
