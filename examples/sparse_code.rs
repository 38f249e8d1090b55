//! Times sparse coding: `sparse_code D.npy Y.npy LAMBDA [--threads N] [--tol T] [--objectives FILE.npy] [--solver NAME]`
//! [--nonzeros T] [--nonnegative] [--weights W.npy] [--repeats R] prints one JSON object, times being medians over the
//! repeats (see docs/sparse-coding.md).

use anyhow::{Context, anyhow, bail};
use lenslet_core::sparse::{self, Options, Penalty, Solver};
use ndarray::{Array1, Array2};
use std::time::Instant;

fn main() -> anyhow::Result<()> {
    let mut plain = Vec::new();
    let (mut threads, mut objectives_file, mut repeats) = (1usize, None, 1usize);
    let mut options = Options::default();
    let (mut nonzeros, mut weights) = (None, None);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| anyhow!("{arg} needs a value"));
        match arg.as_str() {
            "--threads" => threads = value()?.parse().context("--threads takes a number")?,
            "--tol" => options.tolerance = value()?.parse().context("--tol takes a number")?,
            "--repeats" => repeats = value()?.parse().context("--repeats takes a number")?,
            "--nonzeros" => nonzeros = Some(value()?.parse().context("--nonzeros takes a number")?),
            "--nonnegative" => options.nonnegative = true,
            "--weights" => weights = Some(value()?),
            "--objectives" => objectives_file = Some(value()?),
            "--solver" => options.solver = solver(&value()?)?,
            other if other.starts_with("--") => bail!("unknown option {other}"),
            _ => plain.push(arg),
        }
    }
    let [atoms, signals, lambda] = plain.as_slice() else {
        bail!("usage: sparse_code D.npy Y.npy LAMBDA [--threads N] [--tol T] [--objectives FILE.npy] [--solver NAME]");
    };
    let atoms: Array2<f32> = ndarray_npy::read_npy(atoms).with_context(|| format!("cannot read {atoms}"))?;
    let signals: Array2<f32> = ndarray_npy::read_npy(signals).with_context(|| format!("cannot read {signals}"))?;
    let weights: Option<Array2<f32>> = match &weights {
        Some(file) => Some(ndarray_npy::read_npy(file).with_context(|| format!("cannot read {file}"))?),
        None => None,
    };
    options.penalty = match nonzeros {
        Some(most) => Penalty::NonZeros(most),
        None => Penalty::Lambda(lambda.parse().context("LAMBDA is a number")?),
    };

    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let (mut walls, mut cpus) = (Vec::new(), Vec::new());
    let mut solved = None;
    for _ in 0..repeats.max(1) {
        let (wall, cpu) = (Instant::now(), cpu_seconds());
        let dictionary = sparse::prepare(atoms.view())?;
        let codes = pool.install(|| match &weights {
            Some(weights) => sparse::solve_weighted(&dictionary, signals.view(), weights.view(), &options),
            None => sparse::solve(&dictionary, signals.view(), &options),
        })?;
        walls.push(wall.elapsed().as_secs_f64());
        cpus.push(cpu_seconds() - cpu);
        solved = Some((dictionary, codes));
    }
    let Some((dictionary, codes)) = solved else { bail!("nothing was solved") };
    let objectives = codes.objectives(&dictionary, signals.view())?;
    let mean = objectives.iter().sum::<f64>() / objectives.len().max(1) as f64;
    if let Some(file) = &objectives_file {
        ndarray_npy::write_npy(file, &Array1::from(objectives)).with_context(|| format!("cannot write {file}"))?;
    }
    let (wall, cpu) = (median(&mut walls), median(&mut cpus));
    let mut json = serde_json::json!({
        "seconds": wall,
        "cpu_seconds": cpu,
        "patches_per_second": codes.len() as f64 / wall,
        "mean_objective": mean,
        "max_gap": codes.max_gap(),
        "mean_nonzeros": codes.mean_nonzeros(),
        "mean_iterations": codes.iterations.iter().map(|&i| f64::from(i)).sum::<f64>() / codes.len().max(1) as f64,
        "patches_per_cpu_second": codes.len() as f64 / cpu,
        "redone_in_f64": codes.redone_in_f64,
        "converged": codes.all_converged(),
    });
    if let (Some(file), Some(map)) = (objectives_file, json.as_object_mut()) {
        map.insert("objectives_file".into(), file.into());
    }
    #[allow(clippy::print_stdout)]
    {
        println!("{json}");
    }
    Ok(())
}

fn solver(name: &str) -> anyhow::Result<Solver> {
    Ok(match name {
        "auto" => Solver::Auto,
        "active-set" => Solver::ActiveSet,
        "cd" => Solver::CoordinateDescent,
        "ista" => Solver::Ista,
        "fista" => Solver::Fista,
        "homotopy" => Solver::Homotopy,
        "omp" => Solver::Omp,
        _ => bail!("--solver is one of auto, active-set, cd, ista, fista, homotopy, omp"),
    })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// CPU seconds of this process's threads (Linux; elsewhere 0).
fn cpu_seconds() -> f64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0.0 };
    tasks
        .filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok())
        .filter_map(|line| line.split_whitespace().next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}
