//! A user's files are sacred: only what lenslet wrote, and nobody changed, is ever replaced.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::bench::{Bench, command};

/// Every command that writes to `--out`, without that option; and whether it writes a folder.
const WRITERS: [(&str, bool); 15] = [
    ("decode s1/capture.lfp -c cam.calib --size 30 --views 1", true),
    ("decode s1/capture.lfp -c cam.calib --size 30 --views 1 --npy", false),
    ("extract s1/capture.lfp", true),
    ("convert lf", true),
    ("convert lf --npy", false),
    ("convert lf --mat", false),
    ("convert lf --eslf", false),
    ("infer lf --fast", true),
    ("refine lf", true),
    ("depth lf", true),
    ("view lf", false),
    ("calibrate s1/white-00.lfp", false),
    ("gen-pairs s1/truth/views --pairs 50 --crop 48 --shrink 1", true),
    ("simulate --sensor 96 --size 32 --views 1 --whites 1", true),
    ("dict export default", true),
];

/// Everything below a folder, by path, with its bytes.
fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    fn walk(root: &Path, folder: &Path, found: &mut BTreeMap<String, Vec<u8>>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().display().to_string();
            if path.is_dir() && !path.is_symlink() {
                walk(root, &path, found);
            } else {
                found.insert(name, fs::read(&path).unwrap_or_default());
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(folder, folder, &mut found);
    found
}

/// Refused with and without `--force`; no message proposes it; nothing has changed.
fn keeps_all(bench: &Bench, line: &str, words: &[&str]) {
    let before = tree(bench.path());
    for more in ["", " --force"] {
        let answer = bench.refused(&format!("{line}{more}"), words);
        assert!(!answer.err.contains("--force"), "{line}{more}: {}", answer.err);
        assert!(tree(bench.path()) == before, "{line}{more} changed something");
    }
}

#[test]
fn a_folder_of_photos_is_kept_by_every_command() {
    let bench = Bench::new();
    for k in 1..4 {
        bench.put(&format!("photos/2019/IMG_{k}.jpg"), format!("p{k}"));
    }
    for (line, _) in WRITERS {
        keeps_all(&bench, &format!("{line} --out photos"), &["photos"]);
    }
    for line in ["refocus lf --disparity 0", "viewpoint lf --frames 2", "demo --size 128"] {
        keeps_all(&bench, &format!("{line} --out photos"), &["photos"]);
    }
}

#[test]
fn a_users_file_is_kept_by_every_command() {
    let bench = Bench::new();
    bench.put("mine", "not lenslet's");
    for (line, _) in WRITERS {
        keeps_all(&bench, &format!("{line} --out mine"), &["mine"]);
    }
    for (name, line) in [
        ("a.png", "refocus lf --disparity 0"),
        ("a.gif", "refocus lf --sweep -1:1:3"),
        ("a.apng", "viewpoint lf --frames 3"),
        ("a.npy", "convert lf"),
        ("a.mat", "convert lf"),
        ("a.html", "view lf"),
        ("a.lfd", "dict export default"),
        ("a.safetensors", "dict export default"),
        ("a.calib", "calibrate s1/white-00.lfp"),
    ] {
        bench.put(name, "mine");
        keeps_all(&bench, &format!("{line} --out {name}"), &[name]);
    }
}

#[test]
fn what_lenslet_wrote_is_replaced_by_every_command() {
    let bench = Bench::new();
    let more = [
        ("refocus lf --disparity 0", "p.png"),
        ("refocus lf --sweep -1:1:3", "p.gif"),
        ("refocus lf --sweep -1:1:3", "p.apng"),
        ("refocus lf --sweep -1:1:3", "slices"),
        ("viewpoint lf --frames 3", "frames"),
        ("dict export default", "d.lfd"),
        ("dict export default", "d.safetensors"),
    ];
    let numbered: Vec<String> = (0..WRITERS.len()).map(|k| format!("out{k}")).collect();
    let writers = WRITERS.iter().map(|w| w.0).zip(numbered.iter().map(String::as_str));
    for (line, out) in writers.chain(more) {
        bench.done(&format!("{line} --out {out}"));
        let refused = bench.refused(&format!("{line} --out {out}"), &[out]);
        assert!(refused.err.contains("--force"), "{line}: {}", refused.err);
        bench.done(&format!("{line} --out {out} --force"));
    }
    assert_eq!(bench.unfinished(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn notes_in_a_light_field_are_kept_and_named() {
    let bench = Bench::new();
    bench.done("convert lf --out own");
    bench.put("own/notes.txt", "mine");
    keeps_all(&bench, "convert lf --out own", &["own", "notes.txt"]);
    fs::remove_file(bench.at("own/notes.txt")).unwrap();
    bench.done("convert lf --out own --force");
    // A view that was retouched, and a link, are the user's.
    bench.put("own/view_00_00.png", "retouched");
    keeps_all(&bench, "convert lf --out own", &["own", "view_00_00.png"]);
    fs::remove_file(bench.at("own/view_00_00.png")).unwrap();
    std::os::unix::fs::symlink("/etc/hostname", bench.at("own/view_00_00.png")).unwrap();
    keeps_all(&bench, "convert lf --out own", &["own", "view_00_00.png"]);
}

#[test]
fn an_input_is_never_replaced_nor_what_holds_it() {
    let bench = Bench::new();
    let field = "convert lf --npy --out one.npy";
    bench.done(field);
    fs::hard_link(bench.at("one.npy"), bench.at("other.npy")).unwrap();
    std::os::unix::fs::symlink("lf", bench.at("link")).unwrap();
    std::os::unix::fs::symlink("one.npy", bench.at("link.npy")).unwrap();
    fs::create_dir(bench.at("deep")).unwrap();
    for line in [
        "convert lf --out lf",
        "convert link --out lf",
        "convert lf --out ./deep/../lf",
        "convert lf --out link",
        "refine lf --out lf",
        "infer lf --fast --out lf",
        "convert one.npy --out one.npy",
        "convert one.npy --out other.npy",
        "convert link.npy --out one.npy",
        "decode s1/capture.lfp -c cam.calib --size 30 --views 1 --out s1",
        "extract s1/capture.lfp --out s1",
        "gen-pairs s1/truth/views --pairs 50 --crop 48 --shrink 1 --out s1",
        "decode s1/capture.lfp -c cam.calib --size 30 --views 1 --format npy --out s1/capture.lfp",
    ] {
        keeps_all(&bench, line, &[]);
    }
    // The ending alone forbids these.
    for line in [
        "decode s1/capture.lfp -c cam.calib --size 30 --views 1 --out s1/capture.lfp",
        "calibrate s1/white-00.lfp --out s1/white-00.lfp",
    ] {
        let before = tree(bench.path());
        for more in ["", " --force"] {
            assert_eq!(bench.run(&format!("{line}{more}")).code, Some(2), "{line}{more}");
            assert!(tree(bench.path()) == before, "{line}{more} changed something");
        }
    }
}

#[test]
fn a_mounted_disk_is_kept() {
    let bench = Bench::new();
    bench.done("convert lf --out proj");
    fs::create_dir(bench.at("proj/nas")).unwrap();
    let mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "none"];
    let mounted = std::process::Command::new(mount[0]).args(&mount[1..]).arg(bench.at("proj/nas")).output();
    if !mounted.is_ok_and(|o| o.status.success()) {
        println!("without a mounted disk: mounting is not allowed here; an empty folder in its place");
    }
    bench.put("proj/nas/precious", "n");
    let line = "convert lf --out proj";
    bench.refused(&format!("{line} --force"), &["proj"]);
    let _ = std::process::Command::new("umount").arg(bench.at("proj/nas")).output();
    bench.put("proj/nas/precious", "n");
    keeps_all(&bench, line, &["proj", "nas"]);
}

#[test]
fn each_light_field_has_its_own_samples() {
    let bench = Bench::new();
    let decode = "-c cam.calib --size 40 --views 3";
    for k in [1, 2] {
        bench.done(&format!("decode s{k}/capture.lfp {decode} --npy --out night.{k}"));
        bench.done(&format!("decode s{k}/capture.lfp {decode} --out d{k}"));
        bench.done(&format!("refine d{k} --out ref{k}.npy"));
    }
    for k in [1, 2] {
        bench.done(&format!("refine night.{k} --out got{k}.npy"));
        assert!(bench.bytes(&format!("got{k}.npy")) == bench.bytes(&format!("ref{k}.npy")), "night.{k}");
    }
    assert!(bench.bytes("ref1.npy") != bench.bytes("ref2.npy"));
    bench.done(&format!("decode s1/capture.lfp {decode} --out shot.npy"));
    let samples = bench.bytes("shot.npy.samples.npz");
    bench.done(&format!("decode s2/capture.lfp {decode} --out shot.mat"));
    assert!(bench.bytes("shot.npy.samples.npz") == samples);
    // A user's file of that name is kept, and samples of another capture are not taken.
    bench.put("x.npy.samples.npz", "mine");
    bench.refused(&format!("decode s1/capture.lfp {decode} --out x.npy"), &["x.npy.samples.npz"]);
    bench.refused(&format!("decode s1/capture.lfp {decode} --out x.npy --force"), &["x.npy.samples.npz"]);
    assert_eq!(bench.bytes("x.npy.samples.npz"), b"mine");
    fs::copy(bench.at("night.2"), bench.at("night.1")).unwrap();
    bench.refused("refine night.1 --out wrong.npy", &["night.1", "--without-samples"]);
    // The name that earlier versions gave: taken where it belongs, refused where it does not.
    fs::rename(bench.at("shot.npy.samples.npz"), bench.at("shot.samples.npz")).unwrap();
    bench.done("refine shot.npy --out old.npy");
    assert!(bench.bytes("old.npy") == bench.bytes("ref1.npy"));
    fs::remove_file(bench.at("shot.mat.samples.npz")).unwrap();
    bench.refused("refine shot.mat --out wrong.npy", &["shot.samples.npz", "--without-samples"]);
}

#[test]
fn training_replaces_nothing_beside_its_dictionary() {
    let bench = Bench::new();
    let line = "train-dict s1/truth/views --atoms 8 --patch 3 --pairs 500 --epochs 1 --refine 0 --anchors 0 --shrink 1";
    for name in ["log.jsonl", "plot.svg", "atoms.png", "checkpoint"] {
        let file = format!("d.lfd.{name}");
        bench.put(&file, "mine");
        for more in ["", " --force"] {
            bench.refused(&format!("{line} --out d.lfd{more}"), &[&file]);
            assert_eq!(bench.bytes(&file), b"mine");
            assert!(!bench.at("d.lfd").exists());
        }
        fs::remove_file(bench.at(&file)).unwrap();
    }
}

#[test]
fn a_private_file_stays_private() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    let mode = |name: &str| fs::metadata(bench.at(name)).unwrap().permissions().mode() & 0o777;
    for (line, out, private) in [("convert lf", "a.npy", 0o600), ("convert lf", "a", 0o700)] {
        bench.done(&format!("{line} --out {out}"));
        fs::set_permissions(bench.at(out), fs::Permissions::from_mode(private)).unwrap();
        bench.done(&format!("{line} --out {out} --force"));
        assert_eq!(mode(out), private, "{out}");
    }
}

#[test]
fn long_names_are_written() {
    let bench = Bench::new();
    let name = "n".repeat(255);
    bench.done(&format!("convert lf --out {name}"));
    bench.done(&format!("convert lf --out {name} --force"));
}

/// A link planted under an output's name is not followed, and not replaced.
#[test]
fn a_planted_link_is_not_followed() {
    let bench = Bench::new();
    bench.put("victim", "precious");
    for name in ["o.mat", "o.npy", "o.png", "o"] {
        std::os::unix::fs::symlink("victim", bench.at(name)).unwrap();
        for more in ["", " --force"] {
            bench.refused(&format!("convert lf --out {name}{more}"), &[name, "link"]);
        }
        assert!(bench.at(name).is_symlink());
    }
    assert_eq!(bench.bytes("victim"), b"precious");
}

/// What a killed run left goes with the next one; what anybody put there stays.
#[test]
fn leftovers_go_and_foreign_files_in_them_stay() {
    let bench = Bench::new();
    let left = |bench: &Bench| {
        let mut found = bench.unfinished();
        found.retain(|p| p.file_name().unwrap().to_string_lossy().starts_with(".lenslet-tmp-"));
        found
    };
    for foreign in [false, true] {
        for _ in 0..50 {
            let mut child = command(bench.path(), "infer lf --scale 6 --out o").spawn().unwrap();
            while left(&bench).is_empty() && child.try_wait().unwrap().is_none() {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
            child.kill().unwrap();
            child.wait().unwrap();
            if !left(&bench).is_empty() {
                break;
            }
            bench.done("info lf");
            let _ = fs::remove_dir_all(bench.at("o"));
        }
        let folder = left(&bench).pop().expect("no run was killed while it wrote");
        if foreign {
            fs::write(folder.join("precious"), "mine").unwrap();
        }
        bench.done("convert lf --out next --force");
        assert_eq!(folder.join("precious").exists(), foreign);
        assert_eq!(left(&bench).len(), usize::from(foreign));
    }
}
