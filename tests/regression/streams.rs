//! Streams that are closed or full, pipes and devices in the place of files, interrupted work, clocks that jump.

use std::fs::{self, File};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::bench::{Answer, Bench, command};

fn full() -> File {
    File::options().write(true).open("/dev/full").unwrap()
}

#[test]
fn a_log_that_cannot_be_written_changes_nothing() {
    let bench = Bench::new();
    for k in [1, 2] {
        fs::copy(bench.at("s1/capture.lfp"), bench.at(&format!("c{k}.lfp"))).unwrap();
    }
    let decode = |out: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenslet"));
        let line = format!("decode c1.lfp c2.lfp -c cam.calib --size 30 --out {out}");
        command.args(line.split_whitespace()).current_dir(bench.path()).stdout(Stdio::null());
        command
    };
    assert_eq!(decode("a").stderr(full()).status().unwrap().code(), Some(0));
    // The reader of the log is gone.
    let mut child = decode("b").stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stderr.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    for out in ["a", "b"] {
        for name in ["c1", "c2"] {
            assert!(bench.at(&format!("{out}/{name}/lightfield.json")).exists(), "{out}/{name}");
        }
    }
}

#[test]
fn exit_codes_hold_whatever_happens_to_the_streams() {
    let bench = Bench::new();
    let code = |line: &str, change: fn(&mut Command) -> &mut Command| {
        let mut command = command(bench.path(), line);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        change(&mut command).status().unwrap().code()
    };
    assert_eq!(code("info nothing", |c| c.stderr(full())), Some(1));
    assert_eq!(code("info --nothing", |c| c.stderr(full())), Some(2));
    assert_eq!(code("info s1/capture.lfp --json", |c| c.stderr(full())), Some(0));
    // An answer that is lost is a failure; what was written stays.
    assert_eq!(code("info s1/capture.lfp --json", |c| c.stdout(full())), Some(1));
    assert_eq!(code("--help", |c| c.stdout(full())), Some(1));
    assert_eq!(code("--version", |c| c.stdout(full())), Some(1));
    assert_eq!(code("convert lf --out kept", |c| c.stdout(full()).stderr(full())), Some(1));
    assert!(bench.at("kept/lightfield.json").exists());
}

/// One that was not told in time is killed, and has no exit code.
fn within(seconds: u64, mut command: Command) -> Answer {
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let end = Instant::now() + Duration::from_secs(seconds);
    while child.try_wait().unwrap().is_none() {
        if Instant::now() > end {
            child.kill().unwrap();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap().into()
}

#[test]
fn pipes_and_devices_are_refused_by_every_reader() {
    let bench = Bench::new();
    let pipe = |name: &str| assert!(Command::new("mkfifo").arg(bench.at(name)).status().unwrap().success());
    pipe("pipe.x");
    for folder in ["lf2", "lf3", "lf4"] {
        bench.done(&format!("convert lf --out {folder}"));
    }
    fs::remove_file(bench.at("lf2/view_01_01.png")).unwrap();
    pipe("lf2/view_01_01.png");
    for (name, to) in [("lf3/lightfield.json", "/dev/zero"), ("lf4/view_01_01.png", "/dev/zero")] {
        fs::remove_file(bench.at(name)).unwrap();
        std::os::unix::fs::symlink(to, bench.at(name)).unwrap();
    }
    let readers = [
        "info X",
        "extract X --out o",
        "convert X --out o",
        "convert X --views 3 --out o",
        "refine X --out o",
        "infer X --out o",
        "depth X --out o",
        "view X --out o",
        "refocus X --disparity 0 --out o",
        "viewpoint X --out o",
        "decode X -c cam.calib --out o",
        "decode s1/capture.lfp -c X --out o",
        "decode s1/capture.lfp -c cam.calib --method learned --dictionary X --out o",
        "calibrate X --out o",
        "calibrate s1/white-00.lfp --black X --out o",
        "infer lf --dictionary X --out o",
        "gen-pairs X --out o",
        "simulate --photo X --out o",
        "depth lf --truth X --out o",
        "score lf X",
        "score X lf",
        "dict show X",
        "dict export X --out o",
        "train-dict X --out o",
        "train-dict s1/truth/views --parameters X --out o",
        "train-dict s1/truth/views --calibration X --out o",
        "ablate --out o --quick --against X",
    ];
    for line in readers {
        for what in ["pipe.x", "/dev/zero"] {
            let line = line.replace('X', what);
            let answer = within(60, command(bench.path(), &line));
            assert_eq!(answer.code, Some(1), "{line}: {}", answer.err);
            assert!(answer.err.contains("regular file"), "{line}: {}", answer.err);
        }
    }
    for folder in ["lf2", "lf3", "lf4"] {
        let line = format!("convert {folder} --out o");
        let answer = within(60, command(bench.path(), &line));
        assert_eq!(answer.code, Some(1), "{line}: {}", answer.err);
        assert!(answer.err.contains("regular file"), "{line}: {}", answer.err);
    }
    assert!(!bench.at("o").exists());
}

#[test]
fn little_address_space_is_told() {
    let bench = Bench::new();
    let limited = |mib: u64, line: &str| -> Answer {
        let program = env!("CARGO_BIN_EXE_lenslet");
        let script = format!("ulimit -v {}; exec {program} -q {line}", mib << 10);
        Command::new("sh").arg("-c").arg(script).current_dir(bench.path()).output().unwrap().into()
    };
    let decode = "decode s1/capture.lfp -c cam.calib --size 30 --views 1 --out o";
    let answer = limited(1200, decode);
    assert_eq!(answer.code, Some(1), "{}", answer.err);
    assert!(answer.err.contains("1200 MiB") && !bench.at("o").exists(), "{}", answer.err);
    assert_eq!(limited(1200, "info s1/capture.lfp").code, Some(0));
    for (mib, line) in
        [(2048, decode), (4096, "--threads 16 infer lf --out i"), (4096, "--threads 64 convert lf --out c")]
    {
        let answer = limited(mib, line);
        assert_eq!(answer.code, Some(0), "{line} within {mib} MiB: {}", answer.err);
    }
}

/// The times in a report are differences of readings of the clock, which may stand still between two of them.
#[test]
fn times_add_up() {
    let bench = Bench::new();
    let answer = bench.done("decode s1/capture.lfp -c cam.calib --size 30 --views 1 --out o --json");
    let report: serde_json::Value = serde_json::from_str(&answer.out).unwrap();
    let of = |name: &str| report["seconds"][name].as_f64().unwrap();
    let parts = of("read") + of("sample") + of("render") + of("encode_and_write");
    assert!((parts - of("total")).abs() < 1e-3 && parts > 0.0, "{report}");
}

/// Ctrl-C early in commands that take seconds, and late in those that do not look often.
#[test]
fn an_interrupt_is_130_in_every_command() {
    use std::os::unix::process::ExitStatusExt;
    let bench = Bench::new();
    let lines = [
        "demo --size 256 --out o",
        "simulate --sensor 1600 --out o",
        "calibrate s1/white-00.lfp --out o",
        "decode s1/capture.lfp -c cam.calib --size 1500 --method learned --out o",
        "refine lf --scale 8 --out o",
        "infer lf --scale 12 --out o",
        "gen-pairs s1/truth/views --pairs 2000000 --crop 48 --shrink 1 --out o",
        "train-dict s1/truth/views --shrink 1 --out o",
        "ablate --quick --out o",
        "depth lf --out o",
        "view lf --out o",
        "viewpoint lf --frames 900 --out o",
        "refocus lf --sweep -1:1:900 --out o",
        "score lf lf",
        "info s1/capture.lfp",
        "convert lf --out o",
    ];
    let mut interrupted = 0;
    for line in lines {
        let mut child = command(bench.path(), line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(60));
        let _ = Command::new("kill").args(["-2", &child.id().to_string()]).stderr(Stdio::null()).status();
        let status = child.wait().unwrap();
        // One that was not yet under way dies of the signal itself; one that was done already has its result.
        let good = matches!(status.code(), Some(130 | 0)) || status.signal() == Some(2);
        assert!(good, "{line}: {status}");
        assert!(status.code() == Some(0) || line.starts_with("ablate") || !bench.at("o").exists(), "{line}");
        interrupted += usize::from(status.code() == Some(130));
        let _ = fs::remove_dir_all(bench.at("o"));
        let _ = fs::remove_file(bench.at("o"));
    }
    assert!(interrupted >= 3, "only {interrupted} were interrupted while they worked");
    bench.done("convert lf --out o");
    assert_eq!(bench.unfinished(), Vec::<std::path::PathBuf>::new());
}
