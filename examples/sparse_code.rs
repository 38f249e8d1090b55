//! Times sparse coding: `sparse_code D.npy Y.npy LAMBDA [--threads N] [--tol T] [--objectives FILE.npy] [--solver NAME]
//! [--nonzeros T] [--nonnegative] [--weights W.npy] [--repeats R]` prints one JSON object, times being medians over the
//! repeats (see docs/sparse-coding.md).

use anyhow::{Context, bail};
use clap::Parser as _;
use lenslet_core::sparse::{self, Options, Penalty, Solver};
use ndarray::{Array1, Array2};
use std::time::Instant;

/// Times sparse coding
#[derive(clap::Parser)]
struct Arguments {
    /// Atoms, K×m, one a row, of unit norm
    atoms: String,
    /// Signals, N×m, one a row
    signals: String,
    /// λ of min ½‖y − Dᵀφ‖² + λ‖φ‖₁
    lambda: f32,
    /// Threads
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Tolerance
    #[arg(long)]
    tol: Option<f64>,
    /// Times are medians over so many solutions
    #[arg(long, default_value_t = 1)]
    repeats: usize,
    /// At most so many non-zeros a signal, instead of λ
    #[arg(long)]
    nonzeros: Option<usize>,
    /// Codes without negative values
    #[arg(long)]
    nonnegative: bool,
    /// Weights, N×m
    #[arg(long)]
    weights: Option<String>,
    /// Where to write the objective of each signal
    #[arg(long, value_name = "FILE.npy")]
    objectives: Option<String>,
    /// auto, active-set, cd, ista, fista, homotopy or omp
    #[arg(long, default_value = "auto", value_parser = parse_solver)]
    solver: Solver,
}

fn main() -> anyhow::Result<()> {
    let a = Arguments::parse();
    let read = |file: &str| -> anyhow::Result<Array2<f32>> {
        ndarray_npy::read_npy(file).with_context(|| format!("cannot read {file}"))
    };
    let (atoms, signals) = (read(&a.atoms)?, read(&a.signals)?);
    let weights = a.weights.as_deref().map(read).transpose()?;
    let penalty = a.nonzeros.map_or(Penalty::Lambda(a.lambda), Penalty::NonZeros);
    let mut options = Options { penalty, solver: a.solver, nonnegative: a.nonnegative, ..Options::default() };
    options.tolerance = a.tol.unwrap_or(options.tolerance);

    let pool = rayon::ThreadPoolBuilder::new().num_threads(a.threads).build()?;
    let (mut walls, mut cpus) = (Vec::new(), Vec::new());
    let mut solved = None;
    for _ in 0..a.repeats.max(1) {
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
    if let Some(file) = &a.objectives {
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
    if let (Some(file), Some(map)) = (a.objectives, json.as_object_mut()) {
        map.insert("objectives_file".into(), file.into());
    }
    #[allow(clippy::print_stdout)]
    {
        println!("{json}");
    }
    Ok(())
}

fn parse_solver(name: &str) -> Result<Solver, String> {
    let found = Solver::ALL.into_iter().find(|solver| solver.name() == name);
    found.ok_or_else(|| format!("one of {}", Solver::ALL.map(Solver::name).join(", ")))
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
