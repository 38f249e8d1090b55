//! Races dictionary learning against another program on the same data, from the same first atoms:
//! `cargo run --release --example train_race -- DIR [--algorithm online|ksvd] [--epochs N] [--batch N] [--nonzeros T]
//! [--threads N] [--rounds N] [--against COMMAND] [--out D.npy]`
//!
//! DIR holds train_raw49.npy (N×49, one patch a row), D0_raw49.npy (first atoms), test_raw49.npy and sub2k.npy (the rows
//! of it that are scored). Every epoch prints one JSON object: CPU seconds of learning so far, the mean LASSO objective of
//! the test patches (λ 0.1) and their error with at most `nonzeros` atoms, as root of the mean square over all values.
//! With `--against`, COMMAND is run in the shell after every round, so that both see the same machine; the last JSON line
//! that it prints must hold `cpu`, and the ratio of the CPU times is printed.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, anyhow, bail};
use clap::Parser as _;
use lenslet_core::sparse::{self, Options, Penalty, Solver};
use lenslet_train::KsvdUpdate;
use lenslet_train::ksvd::ksvd_epoch;
use lenslet_train::online::{OnlineState, online_epoch};
use ndarray::{Array1, Array2, Axis};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde_json::{Value, json};

const LAMBDA: f32 = 0.1;

/// Races dictionary learning against another program
#[derive(clap::Parser)]
struct Arguments {
    /// Folder of the data
    folder: PathBuf,
    /// online or ksvd
    #[arg(long, default_value = "online", value_parser = ["online", "ksvd"])]
    algorithm: String,
    /// Epochs a round
    #[arg(long, default_value_t = 2)]
    epochs: usize,
    /// Signals a mini-batch
    #[arg(long, default_value_t = 512)]
    batch: usize,
    /// Atoms a signal, of K-SVD and of the score
    #[arg(long, default_value_t = 8)]
    nonzeros: usize,
    /// Threads
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Rounds
    #[arg(long, default_value_t = 1)]
    rounds: usize,
    /// Shell command of the other program
    #[arg(long, value_name = "COMMAND")]
    against: Option<String>,
    /// Where to write the atoms
    #[arg(long, value_name = "D.npy")]
    out: Option<PathBuf>,
}

struct Race {
    train: Array2<f32>,
    first: Array2<f32>,
    test: Array2<f32>,
}

fn load(folder: &std::path::Path) -> anyhow::Result<Race> {
    let read = |name: &str| -> anyhow::Result<Array2<f32>> {
        let path = folder.join(name);
        ndarray_npy::read_npy(&path).with_context(|| format!("cannot read {}", path.display()))
    };
    let path = folder.join("sub2k.npy");
    let rows: Array1<i64> = ndarray_npy::read_npy(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let rows: Vec<usize> = rows.iter().map(|&r| usize::try_from(r)).collect::<Result<_, _>>()?;
    let test = read("test_raw49.npy")?;
    if rows.iter().any(|&r| r >= test.nrows()) {
        bail!("sub2k.npy names rows beyond test_raw49.npy");
    }
    Ok(Race { train: read("train_raw49.npy")?, first: read("D0_raw49.npy")?, test: test.select(Axis(0), &rows) })
}

/// The mean LASSO objective of the test patches, and their root mean square error with `nonzeros` atoms.
fn score(atoms: &Array2<f32>, test: &Array2<f32>, nonzeros: usize) -> anyhow::Result<(f64, f64)> {
    let prepared = sparse::prepare(atoms.view())?;
    let options = Options { penalty: Penalty::Lambda(LAMBDA), tolerance: 1e-8, ..Options::default() };
    let objectives = sparse::solve(&prepared, test.view(), &options)?.objectives(&prepared, test.view())?;
    let options = Options { solver: Solver::Omp, penalty: Penalty::NonZeros(nonzeros), ..Options::default() };
    let rest = test - &sparse::solve(&prepared, test.view(), &options)?.multiply(atoms.view())?;
    let square = rest.iter().map(|r| f64::from(*r).powi(2)).sum::<f64>() / rest.len() as f64;
    Ok((objectives.iter().sum::<f64>() / objectives.len() as f64, square.sqrt()))
}

/// CPU seconds of this process's threads, user and system (Linux; elsewhere 0), in clock ticks of a hundredth.
fn cpu_seconds() -> f64 {
    let Ok(text) = std::fs::read_to_string("/proc/self/stat") else { return 0.0 };
    let after = text.rsplit(')').next().unwrap_or("");
    after.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() / 100.0
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let a = Arguments::parse();
    let race = load(&a.folder)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(a.threads).build()?;
    let mut ratios: Vec<f64> = Vec::new();
    for round in 1..=a.rounds {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut state = OnlineState::new(race.first.clone());
        let mut cpu = 0.0;
        for epoch in 1..=a.epochs {
            let began = cpu_seconds();
            let signals = race.train.view();
            let summary = pool.install(|| match a.algorithm.as_str() {
                "ksvd" => ksvd_epoch(
                    &mut state.atoms,
                    signals,
                    a.nonzeros,
                    KsvdUpdate::Approximate,
                    &mut rng,
                    &mut |_| Ok(()),
                ),
                _ => online_epoch(&mut state, signals, LAMBDA, a.batch, &mut rng, &mut |_| Ok(())),
            })?;
            cpu += cpu_seconds() - began;
            let (objective, rmse) = score(&state.atoms, &race.test, a.nonzeros)?;
            let m = race.train.ncols() as f64;
            println!(
                "{}",
                json!({
                    "round": round, "algorithm": a.algorithm, "epoch": epoch, "cpu": cpu, "test_obj": objective,
                    "test_rmse": rmse, "train_objective": summary.objective, "nonzeros": summary.nonzeros,
                    "train_rmse": if a.algorithm == "ksvd" { Some((2.0 * summary.objective / m).sqrt()) } else { None },
                    "replaced": summary.replaced,
                })
            );
        }
        if let Some(out) = &a.out {
            ndarray_npy::write_npy(out, &state.atoms).with_context(|| format!("cannot write {}", out.display()))?;
        }
        if let Some(command) = &a.against {
            let output = Command::new("sh").args(["-c", command]).output().context("cannot run the shell")?;
            let text = String::from_utf8_lossy(&output.stdout);
            let theirs: Value = text
                .lines()
                .rev()
                .find_map(|line| serde_json::from_str(line).ok())
                .ok_or_else(|| anyhow!("{command}: no JSON line: {}", String::from_utf8_lossy(&output.stderr)))?;
            let time = theirs["cpu"].as_f64().ok_or_else(|| anyhow!("{command}: its JSON line holds no cpu"))?;
            ratios.push(time / cpu);
            println!("{}", json!({ "round": round, "theirs": theirs, "their_cpu_over_ours": time / cpu }));
        }
    }
    if !ratios.is_empty() {
        ratios.sort_by(f64::total_cmp);
        println!("{}", json!({ "rounds": ratios.len(), "median_ratio": ratios[ratios.len() / 2] }));
    }
    Ok(())
}
