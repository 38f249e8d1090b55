//! What numbers in files mean: ranges, orders of axes, colour spaces, what is no number; names of outputs and numbers in flags.

use ndarray::{Array2, Axis, s};

use super::bench::Bench;
use super::fields::{aloud, psnr_of_middle, read_npy, scene, told};

/// Floats of 0..255 once came out all white, and 10-bit numbers in 16 bits nearly black, without a word.
#[test]
fn codes_in_other_types_are_recognised_or_refused() {
    let bench = Bench::new();
    let field = scene(3, 24, [0.4, -0.3, 0.8]);
    let truth = field.mapv(|x| f32::from(x) / 255.0);
    ndarray_npy::write_npy(bench.at("f.npy"), &field.mapv(f32::from)).unwrap();
    let answer = aloud(bench.path(), "convert f.npy --out a.npy");
    assert!(answer.code == Some(0) && answer.err.contains("0..255"), "{}", answer.err);
    assert!(psnr_of_middle(&read_npy(&bench.at("a.npy")), &truth) > 80.0);
    ndarray_npy::write_npy(bench.at("odd.npy"), &field.mapv(|x| f32::from(x) * 3.0)).unwrap();
    bench.refused("convert odd.npy --out b.npy", &["--full-scale"]);
    bench.done("convert odd.npy --full-scale 765 --out b.npy");
    assert!(psnr_of_middle(&read_npy(&bench.at("b.npy")), &truth) > 80.0);
    ndarray_npy::write_npy(bench.at("ten.npy"), &field.mapv(|x| u16::from(x) * 4)).unwrap();
    assert!(aloud(bench.path(), "convert ten.npy --out c.npy").err.contains("--full-scale 1023"));
    bench.done("convert ten.npy --full-scale 1020 --out d.npy");
    assert!(psnr_of_middle(&read_npy(&bench.at("d.npy")), &truth) > 80.0);
    for command in ["infer", "refine", "depth", "view", "viewpoint", "refocus --disparity 0"] {
        bench.refused(
            &format!("{command} odd.npy --out x{}", if command == "view" { ".html" } else { "" }),
            &["--full-scale"],
        );
    }
}

/// Arrays of other orders were taken for another light field.
#[test]
fn axes_in_another_order_are_named() {
    let bench = Bench::new();
    let field = scene(3, 24, [0.4, -0.3, 0.8]);
    let truth = field.mapv(|x| f32::from(x) / 255.0);
    for (order, axes) in [("tsvuc", [2, 3, 0, 1, 4]), ("cvuts", [4, 0, 1, 2, 3]), ("vucts", [0, 1, 4, 2, 3])] {
        let turned = field.view().permuted_axes(axes).as_standard_layout().into_owned();
        ndarray_npy::write_npy(bench.at("t.npy"), &turned).unwrap();
        bench.refused("convert t.npy --out refused.npy", &["--axes", order]);
        bench.done(&format!("convert t.npy --axes {order} --out a.npy --force"));
        assert!(psnr_of_middle(&read_npy(&bench.at("a.npy")), &truth) > 80.0, "{order}");
    }
    let row = field.to_shape((9, 24, 24, 3)).unwrap().permuted_axes([0, 3, 1, 2]).as_standard_layout().into_owned();
    ndarray_npy::write_npy(bench.at("n.npy"), &row).unwrap();
    bench.refused("convert n.npy --out b.npy", &["--axes ncts"]);
    bench.done("convert n.npy --axes ncts --out b.npy");
    assert!(psnr_of_middle(&read_npy(&bench.at("b.npy")), &truth) > 80.0);
}

/// Linear light, pitch and method were lost in .npy, .mat and ESLF: 12 dB.
#[test]
fn arrays_keep_their_description() {
    let bench = Bench::new();
    let before = told(bench.path(), "info lf");
    for name in ["a.npy", "a.mat", "a.png"] {
        bench.done(&format!("convert lf --linear --out {name}"));
        let info = told(bench.path(), &format!("info {name}"));
        assert_eq!((&info["colour"], &info["method"]), (&"linear".into(), &"barycentric".into()), "{name}");
        assert_eq!(info["pitch"], before["pitch"], "{name}");
        let score = told(bench.path(), &format!("score {name} lf"));
        assert!(score["mean"]["psnr_rgb"].as_f64().unwrap() > 60.0, "{name}: {score}");
    }
    // One that does not belong is left alone, with a word.
    let mut other = read_npy(&bench.at("a.npy"));
    other[[0, 0, 0, 0, 0]] += 0.25;
    ndarray_npy::write_npy(bench.at("a.npy"), &other).unwrap();
    let answer = aloud(bench.path(), "convert a.npy --out b.lf");
    assert!(answer.err.contains("left alone") && answer.err.contains("--input-linear"), "{}", answer.err);
    assert_eq!(told(bench.path(), "info b.lf")["colour"], "srgb");
}

/// NaN was read from samples and written into results.
#[test]
fn what_is_no_number_is_refused_with_its_place() {
    let bench = Bench::new();
    let mut field = scene(3, 24, [0.4, -0.3, 0.8]).mapv(|x| f32::from(x) / 255.0);
    field[[1, 2, 3, 4, 0]] = f32::NAN;
    field[[2, 2, 3, 4, 0]] = f32::INFINITY;
    ndarray_npy::write_npy(bench.at("n.npy"), &field).unwrap();
    for command in ["convert", "refine", "depth", "infer"] {
        bench.refused(&format!("{command} n.npy --out x"), &["2 of its", "[1, 2, 3, 4, 0]"]);
    }
    let mut samples = lenslet_core::decode::HexSamples::load(&bench.at("lf/samples.npz")).unwrap();
    samples.values[[3, 5, 1]] = f32::NAN;
    samples.save(&bench.at("lf/samples.npz"), true).unwrap();
    for command in ["refine", "infer"] {
        bench.refused(&format!("{command} lf --out x"), &["1 of", "view 3, lenslet 5, channel 1"]);
    }
    let mut truth = Array2::<f32>::zeros((24, 24));
    truth[[2, 7]] = f32::NAN;
    ndarray_npy::write_npy(bench.at("truth.npy"), &truth).unwrap();
    ndarray_npy::write_npy(bench.at("f.npy"), &scene(3, 24, [0.4, -0.3, 0.8])).unwrap();
    bench.refused("depth f.npy --truth truth.npy --out d", &["row 2, column 7"]);
}

/// A description was believed whatever the pictures said: views of 16384 pixels took 10 GiB.
#[test]
fn a_description_that_contradicts_its_pictures_is_refused() {
    let bench = Bench::new();
    let text = String::from_utf8(bench.bytes("lf/lightfield.json")).unwrap();
    let good: serde_json::Value = serde_json::from_str(&text).unwrap();
    let commands =
        ["info lf", "convert lf --out x", "refine lf --out x", "infer lf --out x", "depth lf --out x", "score lf lf"];
    for (key, value, word) in [
        ("size", serde_json::json!([4096, 4096]), "40x40"),
        ("views", serde_json::json!([5, 5]), "view_00_03"),
        ("views", serde_json::json!([2, 3]), "view_02_00"),
        ("channels", serde_json::json!(1), "1 channel"),
    ] {
        let mut bad = good.clone();
        // Weights would give another number of views away.
        bad.as_object_mut().unwrap().remove("weights");
        bad[key] = value;
        bench.put("lf/lightfield.json", bad.to_string());
        for command in commands {
            bench.refused(command, &["lightfield.json", word]);
        }
    }
    for (key, value, word) in
        [("colour", serde_json::json!("linear"), "linear"), ("pitch", serde_json::json!(9.5), "pitch")]
    {
        let mut bad = good.clone();
        bad[key] = value;
        bench.put("lf/lightfield.json", bad.to_string());
        for command in ["refine", "infer"] {
            bench.refused(&format!("{command} lf --out x"), &[word, "samples"]);
        }
    }
}

/// Learning a light field again loses 5 dB.
#[test]
fn learned_views_are_not_learned_again() {
    let bench = Bench::new();
    bench.done("infer lf --dictionary small --fast --out sharp");
    bench.refused("infer sharp --dictionary small --fast --out again", &["learned already", "decode"]);
    bench.done("convert sharp --out sharp.npy");
    bench.refused("infer sharp.npy --dictionary small --out again", &["learned already"]);
}

/// `--out a.jpg` made a folder of that name.
#[test]
fn endings_that_are_not_written_are_refused() {
    let bench = Bench::new();
    ndarray_npy::write_npy(bench.at("f.npy"), &scene(3, 24, [0.4, -0.3, 0.8])).unwrap();
    for line in [
        "convert f.npy --out a.jpg",
        "refine f.npy --out a.jpg",
        "infer f.npy --out a.tif",
        "decode s1/capture.lfp -c cam.calib --out a.jpg",
        "refocus f.npy --disparity 0 --out a.jpg",
        "viewpoint f.npy --out a.mp4",
        "depth f.npy --out a.png",
        "view f.npy --out a.jpg",
        "simulate --out a.png",
        "demo --out a.html",
        "gen-pairs s1/truth/views --out a.npz",
        "extract s1/capture.lfp --out a.tar",
        "ablate --out a.html",
        "calibrate s1/white-00.lfp --out a.png",
        "train-dict s1/truth/views --out a.npy",
    ] {
        let answer = bench.run(line);
        assert_eq!(answer.code, Some(2), "{line}: {}", answer.err);
        assert!(answer.err.contains("a."), "{line}: {}", answer.err);
    }
    assert!(!bench.at("a.jpg").exists());
}

#[test]
fn numbers_in_flags_are_finite() {
    let bench = Bench::new();
    ndarray_npy::write_npy(bench.at("f.npy"), &scene(3, 24, [0.4, -0.3, 0.8])).unwrap();
    for line in [
        "depth f.npy --out x --range=nan:1",
        "depth f.npy --out x --truth-scale nan",
        "depth f.npy --out x --confident inf",
        "depth f.npy --out x --specks nan",
        "refocus f.npy --out x.png --disparity nan",
        "refocus f.npy --out x.png --disparity 0 --aperture nan",
        "refocus f.npy --out x --sweep=nan:1:3",
        "viewpoint f.npy --out x --radius inf",
        "viewpoint f.npy --out x --hold nan",
        "view f.npy --out x.html --max-mb nan",
        "refine f.npy --out x --scale nan",
        "infer f.npy --out x --scale inf",
        "infer f.npy --out x --lambda nan",
        "convert f.npy --out x --full-scale nan",
        "simulate --out x --noise nan",
        "simulate --out x --rotation inf",
        "gen-pairs p.png --out x --shrink nan",
        "train-dict p.png --out x.lfd --noise nan",
        "decode s1/capture.lfp -c cam.calib --out x --view-step nan",
    ] {
        let answer = bench.run(line);
        assert_eq!(answer.code, Some(2), "{line}: {}", answer.err);
    }
}

/// All buttons had the first light field's depth, and the methods' names.
#[test]
fn light_fields_on_one_page_keep_their_names_and_depths() {
    let bench = Bench::new();
    for (name, d) in [("near", 1.2), ("far", -1.2)] {
        ndarray_npy::write_npy(bench.at(&format!("{name}.npy")), &scene(3, 48, [d, d, d])).unwrap();
    }
    bench.done("view near.npy far.npy --out page.html");
    let html = String::from_utf8(bench.bytes("page.html")).unwrap();
    let from = html.find("application/json\">").unwrap() + "application/json\">".len();
    let data: serde_json::Value =
        serde_json::from_str(&html[from..from + html[from..].find("</script>").unwrap()]).unwrap();
    let set = |k: usize| &data["sets"][k];
    assert_eq!((set(0)["name"].as_str(), set(1)["name"].as_str()), (Some("near"), Some("far")));
    let start = |k: usize| set(k)["start"].as_f64().unwrap();
    assert!((start(0) - 1.2).abs() < 0.15 && (start(1) + 1.2).abs() < 0.15, "{} {}", start(0), start(1));
}

#[test]
fn a_view_of_an_array_in_another_order_is_the_same_view() {
    let bench = Bench::new();
    let field = scene(3, 24, [0.4, -0.3, 0.8]);
    let swapped = field.view().permuted_axes([1, 0, 2, 3, 4]).as_standard_layout().into_owned();
    ndarray_npy::write_npy(bench.at("uv.npy"), &swapped).unwrap();
    bench.done("convert uv.npy --axes uvtsc --out a.npy");
    let found = read_npy(&bench.at("a.npy"));
    let off = &found.index_axis(Axis(0), 2).slice(s![0, .., .., ..])
        - &field.slice(s![2, 0, .., .., ..]).mapv(|x| f32::from(x) / 255.0);
    assert!(off.iter().all(|x| x.abs() < 1e-6));
}
