//! Something of another kind than a command takes: named for what it is, with what to do, before any work, by every
//! command and at every place where a file or folder is given.

use std::fs;

use super::bench::Bench;
use super::fields::{aloud, save_view, scene};

/// Every command that takes a file or folder, `@` where it stands, and what it takes there.
const PLACES: [(&str, &[&str]); 34] = [
    ("extract @ --out o", &["capture"]),
    ("simulate --photo @ --sensor 96 --size 32 --views 1 --whites 1 --out o", &["picture"]),
    ("calibrate @ --out o.calib", &["capture", "picture"]),
    ("calibrate --from-captures @ --out o.calib", &["capture", "picture"]),
    ("calibrate s1/white-00.lfp --black @ --out o.calib", &["capture", "picture"]),
    ("calibrate --bundle @ --out o", &["capture", "captures", "notes"]),
    ("decode @ -c cam.calib --size 30 --views 1 --out o", &["capture", "captures", "picture", "pictures"]),
    ("decode s1/capture.lfp -c @ --size 30 --views 1 --out o", &["calibration", "capture", "captures", "notes"]),
    ("decode s1/capture.lfp -c cam.calib --method learned --dictionary @ --size 64 --views 1 --out o", &["dictionary"]),
    ("convert @ --out o", &["field", "array", "picture", "pictures"]),
    ("gen-pairs @ --pairs 50 --crop 32 --out o", &["field", "picture", "pictures", "fields"]),
    ("train-dict @ --pairs 50 --out o.lfd", &["field", "picture", "pictures", "fields"]),
    ("train-dict pictures --parameters @ --out o.lfd", &[]),
    ("train-dict pictures --base multiview --calibration @ --out o.lfd", &["calibration"]),
    ("dict show @", &["dictionary"]),
    ("dict export @ --out o.lfd", &["dictionary"]),
    ("refine @ --out o", &["field", "array", "picture", "pictures"]),
    ("infer @ --fast --out o", &["field", "array", "picture", "pictures"]),
    ("infer lf --dictionary @ --out o", &["dictionary"]),
    ("score @ lf", &["field", "array", "picture", "pictures"]),
    ("score lf @", &["field", "array", "picture", "pictures"]),
    ("ablate --whites @ --captures s1/capture.lfp --out o", &["capture", "picture"]),
    ("ablate --calibration @ --captures s1/capture.lfp --out o", &["calibration"]),
    ("ablate --calibration cam.calib --captures @ --out o", &["capture", "picture"]),
    ("ablate --photos @ --out o", &["field", "picture", "pictures", "fields"]),
    ("ablate --dictionary @ --out o", &["dictionary"]),
    ("assess @ -c cam.calib", &["capture", "picture"]),
    ("assess s1/capture.lfp -c @", &["calibration", "capture", "captures", "notes"]),
    ("assess s1/capture.lfp -c cam.calib --lines @", &[]),
    ("refocus @ --disparity 0 --out o.png", &["field", "array", "picture", "pictures"]),
    ("depth @ --out o", &["field", "array", "picture", "pictures"]),
    ("depth lf --truth @ --out o", &["array"]),
    ("viewpoint @ --frames 2 --out o", &["field", "array", "picture", "pictures"]),
    ("view @ --out o.html", &["field", "array", "picture", "pictures"]),
];

/// One of each kind, by name, and what it is called.
const KINDS: [(&str, &str, &str); 12] = [
    ("capture", "s1/capture.lfp", "a raw capture"),
    ("field", "lf", "a light field"),
    ("array", "lf.npy", "a light field or array"),
    ("calibration", "cam.calib", "a calibration"),
    ("dictionary", "d.lfd", "a dictionary"),
    ("samples", "lf/samples.npz", "measured samples"),
    ("picture", "pictures/view_0_0.png", "a picture"),
    ("pictures", "pictures", "9 pictures"),
    ("captures", "captures", "2 captures"),
    ("fields", "fields", "1 light fields"),
    ("empty", "empty", "an empty folder"),
    ("notes", "notes", "a folder without captures, light fields or pictures"),
];

fn with_all_kinds() -> Bench {
    let bench = Bench::new();
    bench.done("convert lf --out lf.npy");
    bench.done("dict export small --out d.lfd");
    let field = scene(3, 80, [0.4, -0.3, 0.8]);
    for k in 0..9 {
        save_view(&field, k / 3, k % 3, &bench.at(&format!("pictures/view_{}_{}.png", k / 3, k % 3)));
    }
    for name in ["captures", "empty", "fields"] {
        fs::create_dir(bench.at(name)).unwrap();
    }
    fs::copy(bench.at("s1/capture.lfp"), bench.at("captures/a.lfp")).unwrap();
    fs::copy(bench.at("s2/capture.lfp"), bench.at("captures/b.lfp")).unwrap();
    bench.done("convert lf --out fields/one.lf");
    bench.put("notes/readme.txt", "words");
    bench
}

#[test]
fn every_command_names_what_it_was_given() {
    let bench = with_all_kinds();
    for (line, takes) in PLACES {
        for (kind, path, name) in KINDS {
            if takes.contains(&kind) {
                continue;
            }
            let line = line.replace('@', path);
            let began = std::time::Instant::now();
            let answer = bench.refused(&line, &[path]);
            assert!(answer.err.starts_with(&format!("lenslet: {path}: ")), "{line}: {}", answer.err);
            assert!(answer.err.contains(name) && answer.err.contains(", not a"), "{line}: {}", answer.err);
            // What to do: a command, or a file to give.
            let advice = answer.err.split_once("; ").map_or("", |parts| parts.1);
            assert!(
                ["`lenslet ", "give ", "files are needed"].iter().any(|word| advice.contains(word)),
                "{line}: {}",
                answer.err
            );
            assert!(began.elapsed().as_secs() < 20, "{line} took {:?}", began.elapsed());
            assert!(!bench.at("o").exists() && !bench.at("o.lfd").exists(), "{line}");
        }
    }
}

/// The list above has every command: those that take nothing are few.
#[test]
fn the_list_has_every_command() {
    let bench = Bench::new();
    let help = bench.done("--help").out;
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|l| *l != "Commands:")
        .skip(1)
        .take_while(|l| !l.is_empty())
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next())
        .collect();
    assert!(commands.len() > 15, "{help}");
    for command in commands {
        let known = PLACES.iter().any(|(line, _)| line.split(' ').next() == Some(command));
        assert!(known || ["demo", "info", "help"].contains(&command), "{command} is not in the list");
    }
}

#[test]
fn the_next_command_is_right() {
    let bench = with_all_kinds();
    bench.refused("infer captures --out o", &["lenslet decode captures --calibration", "decode them first"]);
    bench.refused("refine fields --out o", &["give the one in it: fields/one.lf"]);
    bench.refused("calibrate captures --out o.calib", &["captures/a.lfp", "--bundle captures"]);
    bench.refused("depth lf/samples.npz --out o", &["lies beside"]);
    bench.refused("decode lf -c cam.calib --out o", &["decoded already", "lenslet view lf"]);
    bench.refused("infer cam.calib --out o", &["lenslet decode CAPTURE --calibration cam.calib"]);
    bench.refused("gen-pairs notes --out o", &["notes", "photo"]);
    bench.refused("ablate --photos gone --out o", &["cannot read gone"]);
    let samples: serde_json::Value = serde_json::from_str(&bench.done("info lf/samples.npz --json").out).unwrap();
    assert!(samples["kind"] == "measured samples" && samples["views"] == serde_json::json!([3, 3]), "{samples}");
    assert!(samples["sensor"] == serde_json::json!([160, 160]) && samples["lenslets"] == 304, "{samples}");
    bench.put("odd.npz", b"PK\x03\x04 and no more");
    bench.refused("info odd.npz", &["odd.npz"]);
    let answer = aloud(bench.path(), "info captures");
    assert!(answer.code == Some(1) && answer.err.contains("lenslet info captures/a.lfp"), "{}", answer.err);
    // A folder that has the name of a dictionary within the program does not hide it.
    fs::create_dir(bench.at("small")).unwrap();
    bench.done("dict show small");
    // Among several images one of another kind is left out with a note.
    let answer = aloud(bench.path(), "calibrate s1/white-00.lfp lf.npy --out two.calib");
    assert!(answer.code == Some(0) && answer.err.contains("lf.npy"), "{}", answer.err);
}
