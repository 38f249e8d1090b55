//! Several runs that write to one output: one whole output or an error, never a mixture.

use std::collections::BTreeMap;
use std::fs;
use std::process::{Command, Stdio};
use std::time::Duration;

use lenslet_test_support::{Skip, skip};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::bench::{Bench, command};

/// Files of a folder by name; `None` where there is no folder.
fn files(bench: &Bench, name: &str) -> Option<BTreeMap<String, Vec<u8>>> {
    let entries = fs::read_dir(bench.at(name)).ok()?;
    Some(
        entries
            .map(|e| e.unwrap())
            .map(|e| (e.file_name().into_string().unwrap(), fs::read(e.path()).unwrap()))
            .collect(),
    )
}

/// Whether this process may start others in namespaces of their own, as containers have; what follows is skipped where
/// it may not.
fn namespaces() -> bool {
    let tried = Command::new("unshare").args(["-p", "-f", "--mount-proc", "true"]).stderr(Stdio::null()).status();
    let allowed = tried.is_ok_and(|s| s.success());
    if !allowed {
        skip(Skip::Excused, "namespaces of their own are not allowed here");
    }
    allowed
}

/// Rounds of two runs with one output, of which `kills` are killed at random moments; as run on one machine, or each in
/// its own namespaces.
fn compete(kills: usize, apart: bool, seed: u64) {
    let bench = Bench::new();
    bench.done("simulate --sensor 160 --size 120 --views 7 --whites 1 --out s3");
    bench.done("simulate --sensor 160 --size 120 --views 7 --whites 1 --seed 9 --out s4");
    let line = |input: &str, more: &str| format!("convert {input}/truth/views --out o {more}");
    let mut whole = Vec::new();
    let mut usual = Duration::ZERO;
    for input in ["s3", "s4"] {
        let begun = std::time::Instant::now();
        bench.done(&line(input, ""));
        usual = begun.elapsed();
        whole.push(files(&bench, "o").unwrap());
        fs::remove_dir_all(bench.at("o")).unwrap();
    }
    assert!(whole[0] != whole[1] && whole[0].len() == 51);
    let start = |input: &str, more: &str| {
        let plain = command(bench.path(), &line(input, more));
        let mut command = if apart {
            let mut command = Command::new("unshare");
            command.args(["-p", "-f", "--mount-proc", "--kill-child"]).arg(plain.get_program()).args(plain.get_args());
            command.current_dir(bench.path());
            command
        } else {
            plain
        };
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut killed, mut round, mut outcomes) = (0, 0, BTreeMap::<String, usize>::new());
    while killed < kills {
        round += 1;
        let more = if round % 2 == 0 { "--force" } else { "" };
        let mut runs = [start("s3", more), start("s4", more)];
        // One of the two is killed in most rounds.
        if round % 4 != 0 {
            std::thread::sleep(usual.mul_f64(rng.random_range(0.0..1.5)));
            let victim = &mut runs[round % 2];
            killed += usize::from(victim.try_wait().unwrap().is_none());
            let _ = victim.kill();
        }
        let codes = runs.map(|mut run| run.wait().unwrap().code());
        let now = files(&bench, "o");
        assert!(now.as_ref().is_none_or(|f| whole.contains(f)), "round {round}: a mixture, {codes:?}");
        assert!(now.is_some() || !codes.contains(&Some(0)), "round {round}: nothing there, {codes:?}");
        assert!(codes.iter().all(|c| matches!(c, Some(0 | 1 | 137) | None)), "{codes:?}");
        // Without --force nothing is replaced: one of the two at most has its way.
        assert!(more == "--force" || codes != [Some(0), Some(0)], "round {round}");
        *outcomes.entry(format!("{codes:?} {more}")).or_default() += 1;
        if round % 3 == 0 && now.is_some() {
            fs::remove_dir_all(bench.at("o")).unwrap();
        }
    }
    bench.run("convert s3/truth/views --out last");
    assert_eq!(bench.unfinished(), Vec::<std::path::PathBuf>::new());
    println!("{killed} kills in {round} rounds, apart: {apart}; exit codes: {outcomes:?}");
}

#[test]
fn two_runs_with_one_output() {
    compete(6, false, 1);
}

#[test]
fn two_containers_with_one_output() {
    if namespaces() {
        compete(6, true, 2);
    }
}

/// `cargo test --release --test regression -- --ignored fifty`: minutes.
#[test]
#[ignore = "minutes"]
fn fifty_kills_of_two_writers() {
    compete(50, false, 3);
    if namespaces() {
        compete(50, true, 4);
    }
}

/// Two runs of one ablation wrote every run twice.
#[test]
fn an_ablation_has_its_folder_to_itself() {
    let bench = Bench::new();
    let line = "ablate --out a --quick --experiment subpixel --seeds 1";
    fs::create_dir(bench.at("a")).unwrap();
    let lock = fs::File::open(bench.at("a")).unwrap();
    lock.lock().unwrap();
    bench.refused(line, &["another run"]);
    drop(lock);
    // A page of the user's is kept, and told before the work.
    bench.put("a/report.html", "mine");
    for more in ["", " --force"] {
        bench.refused(&format!("{line}{more}"), &["a"]);
        assert_eq!(bench.bytes("a/report.html"), b"mine");
    }
    bench.put("b/runs.jsonl", "a list of mine\n");
    bench.refused(&line.replace(" a ", " b "), &["runs.jsonl"]);
    bench.refused(&format!("{} --force", line.replace(" a ", " b ")), &["runs.jsonl"]);
    assert_eq!(bench.bytes("b/runs.jsonl"), b"a list of mine\n");
}
