//! Numbers at and beyond the ends of their ranges: a message that says what is wrong, or a sound result; never a panic, and
//! never a result of another number than was given.

use std::fs;

use lenslet_core::dictionary;

use super::bench::Bench;
use super::fields::{read_npy, save_view, scene};

/// With two photos in `photos/`, one of 64 pixels a side in `small.png`.
fn with_photos() -> Bench {
    let bench = Bench::new();
    let field = scene(2, 140, [0.8, -0.6, 1.5]);
    save_view(&field, 0, 0, &bench.at("photos/a.png"));
    save_view(&field, 1, 1, &bench.at("photos/b.png"));
    save_view(&scene(1, 64, [0.8, -0.6, 1.5]), 0, 0, &bench.at("small.png"));
    bench
}

/// Runs what must end with exit code 2, or 1, with all of `words`; nothing is written.
fn fails(bench: &Bench, line: &str, code: i32, words: &[&str]) {
    let answer = bench.run(&format!("{line} --out o.out"));
    assert_eq!(answer.code, Some(code), "{line}: {}", answer.err);
    assert!(!answer.err.contains("panicked") && !answer.err.is_empty(), "{line}: {}", answer.err);
    for word in words {
        assert!(answer.err.contains(word), "{line} should say {word:?}: {}", answer.err);
    }
    let left =
        fs::read_dir(bench.path()).unwrap().flatten().filter(|e| e.file_name().to_string_lossy().starts_with("o."));
    assert_eq!(left.count(), 0, "{line} left something");
}

const TRAIN: &str = "train-dict photos --pairs 400 --anchors 0 --refine 0";

#[test]
fn training_refuses_what_it_cannot_do() {
    let bench = with_photos();
    let train = |bench: &Bench, more: &str, code: i32, words: &[&str]| {
        let answer = bench.run(&format!("{TRAIN} {more} --out o.lfd"));
        assert_eq!(answer.code, Some(code), "{more}: {}", answer.err);
        for word in words {
            assert!(answer.err.contains(word), "{more} should say {word:?}: {}", answer.err);
        }
        assert!(!bench.at("o.lfd").exists(), "{more}");
    };
    // Beyond its range: wrong use, with the range.
    let small = "--atoms 16 --epochs 1";
    for (name, values, range) in [
        ("patch", &["0", "1", "2", "27", "141", "100000", "18446744073709551615"][..], "(3 to 25)"),
        ("lambda", &["0", "-1", "1e30", "0.95"][..], "(0.001 to 0.9)"),
        ("shrink", &["0", "-2", "17"][..], "(1 to 16)"),
        ("noise", &["-1", "1e9"][..], "(0 to 1)"),
        ("pairs-memory", &["0", "-1", "1e30"][..], "(0.05 to 1024)"),
    ] {
        for value in values {
            train(&bench, &format!("{small} --{name}={value}"), 2, &[range, value.split('e').next().unwrap()]);
        }
    }
    train(&bench, &format!("{small} --patch 4"), 2, &["patch 4 must be odd"]);
    train(&bench, &format!("{small} --grid 100"), 2, &["--grid 100", "1.5 to 8"]);
    for (more, range) in [
        ("--epochs 1 --atoms 0", "(2 to 8192)"),
        ("--epochs 1 --atoms 100000000", "(2 to 8192)"),
        ("--atoms 16 --epochs 0", "(1 to 1000)"),
        ("--atoms 16 --epochs 1000000000", "(1 to 1000)"),
    ] {
        train(&bench, more, 2, &[range]);
    }
    for option in ["lambda", "shrink", "noise", "grid", "pairs-memory"] {
        for value in ["nan", "inf", "-inf", "NaN"] {
            train(&bench, &format!("{small} --{option}={value}"), 2, &["not a finite number"]);
        }
    }
    for pairs in ["0", "1", "99", "1000000000000"] {
        let line = format!("train-dict photos --atoms 16 --pairs {pairs} --out o.lfd");
        let answer = bench.run(&line);
        assert!(answer.code == Some(2) && answer.err.contains("(100 to 20000000)"), "{line}: {}", answer.err);
    }
    // Within its range, but more than the photos give: failed, with what to change.
    train(&bench, "--epochs 1 --atoms 5000", 1, &["too few for 5000 atoms", "--atoms", "more or larger photos"]);
    let line = "train-dict photos --pairs 300 --atoms 16 --epochs 1 --anchors 4000 --out o.lfd";
    bench.refused(line, &["too few for 4000 anchors", "--anchors"]);
}

/// `--patch 3` ended with "48 features of a window of 3 pixels".
#[test]
fn the_smallest_and_largest_patches_make_sound_dictionaries() {
    let bench = with_photos();
    for patch in [3, 25] {
        bench.done(&format!("{TRAIN} --atoms 8 --epochs 1 --patch {patch} --out p{patch}.lfd"));
        let found = dictionary::load(&bench.at(&format!("p{patch}.lfd"))).unwrap();
        for model in &found.models {
            let parts = &model.patch_model;
            assert_eq!(parts.patch, patch);
            assert!(parts.low.iter().chain(parts.high.iter()).all(|x| x.is_finite()));
        }
        bench.done(&format!("infer lf --dictionary p{patch}.lfd --without-samples --step 1 --out i{patch}.npy"));
        let (made, from) = (read_npy(&bench.at(&format!("i{patch}.npy"))), {
            bench.done(&format!("convert lf --out from{patch}.npy"));
            read_npy(&bench.at(&format!("from{patch}.npy")))
        });
        let off = (&made - &from).mapv(f32::abs).mean().unwrap();
        assert!(made.iter().all(|x| x.is_finite()) && off < 0.1, "patch {patch}: {off}");
    }
    // A photo hardly larger than a patch.
    bench.done("train-dict small.png --patch 25 --atoms 8 --pairs 400 --epochs 1 --anchors 0 --refine 0 --out s.lfd");
}

#[test]
fn inference_refuses_what_it_cannot_do() {
    let bench = Bench::new();
    for option in ["lambda", "scale", "noise"] {
        for value in ["nan", "inf", "-inf"] {
            fails(&bench, &format!("infer lf --{option}={value} --format npy"), 2, &["not a finite number"]);
        }
    }
    for (option, values, words) in [
        ("lambda", &["-1", "1.5", "1e30"][..], "--lambda must be 0 to 1"),
        ("scale", &["0", "0.5", "-2", "17", "1000"][..], "--scale must be 1 to 16"),
        ("noise", &["-1", "2", "1e9"][..], "--noise must be 0 to 1"),
        ("step", &["0"][..], "--step"),
    ] {
        for value in values {
            fails(&bench, &format!("infer lf --{option}={value} --format npy"), 2, &[words]);
        }
    }
    for step in ["10", "1000", "100000000000"] {
        fails(&bench, &format!("infer lf --step {step} --format npy"), 1, &[step, "1 to 9"]);
    }
    // The ends themselves. λ of 0 leaves least squares; of 1 no code is left, and the view is what it was.
    for lambda in ["0", "1", "1e-30"] {
        bench.done(&format!("infer lf --without-samples --lambda {lambda} --out l{lambda}.npy"));
        assert!(read_npy(&bench.at(&format!("l{lambda}.npy"))).iter().all(|x| x.is_finite()));
    }
}

#[test]
fn refinement_and_decoding_refuse_what_they_cannot_do() {
    let bench = Bench::new();
    for value in ["nan", "inf"] {
        fails(
            &bench,
            &format!("refine lf --without-samples --scale {value} --format npy"),
            2,
            &["not a finite number"],
        );
    }
    for value in ["0", "-1", "0.999", "8.001", "1000"] {
        fails(&bench, &format!("refine lf --scale={value} --format npy"), 2, &["--scale must be 1 to 8"]);
    }
    for range in ["1:1", "5:-5", "nan:1", "-1e9:1e9", "1", ":"] {
        for command in ["refine lf --format npy", "depth lf"] {
            fails(&bench, &format!("{command} --range={range}"), 2, &["--range", "FROM:TO"]);
        }
    }
    let decode = "decode s1/capture.lfp -c cam.calib --format npy";
    for views in ["0", "2", "17", "1000"] {
        fails(&bench, &format!("{decode} --size 30 --views {views}"), 2, &["--views", "odd, 1 to 15"]);
    }
    for views in ["-1", "x", "99999999999999999999"] {
        fails(&bench, &format!("{decode} --size 30 --views={views}"), 2, &["--views"]);
    }
    for size in ["0", "-1", "0x10", "65537", "99999999999", "nan"] {
        fails(&bench, &format!("{decode} --size={size}"), 2, &["--size"]);
    }
    for exposure in ["nan", "inf", "33", "-1e9"] {
        fails(&bench, &format!("{decode} --size 30 --exposure={exposure}"), 2, &["--exposure", "-32 to 32"]);
    }
    // The smallest are sound, by every method.
    for method in ["bicubic", "barycentric", "cubic", "multiview", "learned"] {
        bench.done(&format!("{decode} --size 1 --views 1 --method {method} --out {method}.npy"));
        assert!(read_npy(&bench.at(&format!("{method}.npy"))).iter().all(|x| x.is_finite()), "{method}");
    }
}

#[test]
fn the_other_commands_refuse_what_they_cannot_do() {
    let bench = with_photos();
    ndarray_npy::write_npy(bench.at("truth.npy"), &ndarray::Array2::<f32>::zeros((40, 40))).unwrap();
    for (line, code, words) in [
        ("gen-pairs photos --pairs 0", 2, &["--pairs"][..]),
        ("gen-pairs photos --crop 0", 2, &["--crop"][..]),
        ("gen-pairs photos --crops 0", 2, &["--crops"][..]),
        ("gen-pairs photos --shrink 0", 2, &["shrunk by 0", "1 to 1000"][..]),
        ("gen-pairs photos --shrink nan", 2, &["not a finite number"][..]),
        ("gen-pairs photos --patch 0", 2, &["patch"][..]),
        ("gen-pairs photos --patch 100000", 2, &["patch"][..]),
        ("gen-pairs photos --window 0", 2, &["window"][..]),
        ("gen-pairs photos --window 100000", 2, &["window"][..]),
        ("gen-pairs photos --features 0", 2, &["0 features"][..]),
        ("gen-pairs photos --features 100000", 2, &["100000 features", "1 to"][..]),
        ("gen-pairs photos --noise=-1", 2, &["noise"][..]),
        ("simulate --sensor 0 --size 32", 2, &["sensor"][..]),
        ("simulate --sensor 100000x100000", 2, &["sensor"][..]),
        ("simulate --sensor 96 --size 0", 2, &["size"][..]),
        ("simulate --sensor 96 --pitch 0", 2, &["pitch"][..]),
        ("simulate --sensor 96 --pitch nan", 2, &["pitch"][..]),
        ("simulate --sensor 96 --views 0", 2, &["views"][..]),
        ("simulate --sensor 96 --noise=-1", 2, &["noise"][..]),
        ("refocus lf --disparity nan", 2, &["--disparity"][..]),
        ("refocus lf --disparity 1e9", 2, &["--disparity"][..]),
        ("refocus lf --disparity 0 --aperture 2", 2, &["--aperture must be from 0 to 1"][..]),
        ("refocus lf --disparity 0 --aperture nan", 2, &["--aperture"][..]),
        ("refocus lf --disparity 0 --side 0", 2, &["--side"][..]),
        ("refocus lf --sweep 0:1:1", 2, &["--sweep"][..]),
        ("refocus lf --sweep 0:1:100000", 2, &["--sweep"][..]),
        ("refocus lf --sweep nan:1:5", 2, &["--sweep"][..]),
        ("refocus lf --at nan,1", 2, &["--at"][..]),
        ("depth lf --specks 2", 2, &["--specks must be 0 to 1"][..]),
        ("depth lf --specks nan", 2, &["--specks"][..]),
        ("viewpoint lf --frames 0", 2, &["--frames"][..]),
        ("viewpoint lf --radius nan", 2, &["--radius"][..]),
        ("viewpoint lf --hold 1e30", 2, &["--hold"][..]),
        ("depth lf --confident 5", 2, &["--confident must be 0 to 1"][..]),
        ("depth lf --truth truth.npy --border 20", 2, &["--border 20 leaves nothing"][..]),
        ("viewpoint lf --radius 100", 2, &["view steps"][..]),
        ("convert lf --crop-views 0", 2, &["--crop-views"][..]),
        ("convert lf --crop-views 100", 2, &["only 3x3 views"][..]),
        ("convert lf --full-scale 0", 2, &["--full-scale"][..]),
        ("convert lf --full-scale nan", 2, &["--full-scale"][..]),
        ("demo --size 0", 2, &["--size"][..]),
    ] {
        let answer = bench.run(&format!("{line} --out o"));
        assert_eq!(answer.code, Some(code), "{line}: {}", answer.err);
        for word in words {
            assert!(answer.err.contains(word), "{line} should say {word:?}: {}", answer.err);
        }
        assert!(!bench.at("o").exists(), "{line}");
    }
    for (line, word) in [
        ("score lf lf --border 20", "--border"),
        ("score lf lf --border 18446744073709551615", "--border"),
        ("info lf --threads 0", "--threads"),
        ("info lf --memory 0", "--memory"),
        ("assess s1/capture.lfp -c cam.calib --size 0", "--size"),
    ] {
        let answer = bench.run(line);
        assert!(answer.code == Some(2) && answer.err.contains(word), "{line}: {:?} {}", answer.code, answer.err);
    }
}
