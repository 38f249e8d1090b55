//! Sparse coding over (m, K, λ) and over solvers, on random dictionaries: `cargo bench --bench sparse`.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use lenslet_core::sparse::{self, Options, Penalty, Simd, Solver};
use ndarray::Array2;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

/// Unit rows of random numbers.
fn rows(n: usize, m: usize, seed: u64) -> Array2<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut rows = Array2::from_shape_fn((n, m), |_| rng.random::<f32>() - 0.5);
    for mut row in rows.rows_mut() {
        let norm = row.dot(&row).sqrt();
        row /= norm;
    }
    rows
}

fn shapes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sparse/auto");
    group.sample_size(10);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for m in [20, 49, 144] {
        let signals = rows(480, m, 1);
        for k in [64, 256, 512, 1024, 2048] {
            let dictionary = sparse::prepare(rows(k, m, 2).view()).unwrap();
            for lambda in [0.1, 0.3] {
                let options = Options { penalty: Penalty::Lambda(lambda), ..Options::default() };
                group.throughput(Throughput::Elements(signals.nrows() as u64));
                group.bench_function(BenchmarkId::from_parameter(format!("m{m}_K{k}_lambda{lambda}")), |bench| {
                    bench.iter(|| pool.install(|| sparse::solve(&dictionary, signals.view(), &options)).unwrap());
                });
            }
        }
    }
}

fn solvers(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sparse/solvers_m49_K512_lambda0.3");
    group.sample_size(10);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let dictionary = sparse::prepare(rows(512, 49, 2).view()).unwrap();
    let signals = rows(48, 49, 1);
    for solver in [Solver::ActiveSet, Solver::CoordinateDescent, Solver::Ista, Solver::Fista, Solver::Homotopy] {
        let options = Options { solver, penalty: Penalty::Lambda(0.3), ..Options::default() };
        group.bench_function(format!("{solver:?}"), |bench| {
            bench.iter(|| pool.install(|| sparse::solve(&dictionary, signals.view(), &options)).unwrap());
        });
    }
    let options = Options { penalty: Penalty::NonZeros(8), ..Options::default() };
    group.bench_function("Omp, 8 non-zeros", |bench| {
        bench.iter(|| pool.install(|| sparse::solve(&dictionary, signals.view(), &options)).unwrap());
    });
    for simd in [Simd::Plain, Simd::Avx2, Simd::Avx512].into_iter().filter(|s| s.available()) {
        let dictionary = dictionary.clone().with_simd(simd);
        let options = Options { penalty: Penalty::Lambda(0.3), ..Options::default() };
        group.bench_function(format!("ActiveSet on {simd:?}"), |bench| {
            bench.iter(|| pool.install(|| sparse::solve(&dictionary, signals.view(), &options)).unwrap());
        });
    }
}

criterion_group!(benches, shapes, solvers);
criterion_main!(benches);
