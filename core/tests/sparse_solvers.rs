//! The sparse solvers against other tools' answers, against each other, and against what must hold of any answer.
#![allow(clippy::unwrap_used)]

use lenslet_core::sparse::{self, Codes, Ended, Error, Options, Penalty, Prepared, Simd, Solver};
use ndarray::{Array1, Array2, Array3, Axis, s};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

fn read<T: ndarray_npy::ReadableElement, D: ndarray::Dimension>(name: &str) -> ndarray::Array<T, D> {
    let file = format!("{}/tests/reference/{name}.npy", env!("CARGO_MANIFEST_DIR"));
    ndarray_npy::read_npy(file).unwrap()
}

fn fixture() -> (Prepared, Array2<f32>) {
    let atoms: Array2<f32> = read("sparse_atoms");
    (sparse::prepare(atoms.view()).unwrap(), read("sparse_signals"))
}

fn normal(rng: &mut ChaCha8Rng) -> f32 {
    // Sum of uniforms: near enough to a normal.
    (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0
}

fn random_atoms(k: usize, m: usize, seed: u64) -> Array2<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut atoms = Array2::from_shape_fn((k, m), |_| normal(&mut rng));
    for mut atom in atoms.rows_mut() {
        let norm = atom.iter().map(|v| v * v).sum::<f32>().sqrt();
        atom /= norm;
    }
    atoms
}

fn random_signals(n: usize, m: usize, seed: u64) -> Array2<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    Array2::from_shape_fn((n, m), |_| normal(&mut rng) / (m as f32).sqrt())
}

fn options(solver: Solver, lambda: f32) -> Options {
    Options { solver, penalty: Penalty::Lambda(lambda), max_iterations: 100_000, ..Options::default() }
}

/// The largest violation of the optimality conditions, in f64, relative to λ.
fn kkt_violation(dictionary: &Prepared, signals: &Array2<f32>, codes: &Codes, nonnegative: bool) -> f64 {
    let atoms = dictionary.atoms().mapv(f64::from);
    let mut worst = 0.0f64;
    for n in 0..codes.len() {
        let mut residual: Array1<f64> = signals.row(n).mapv(f64::from);
        for (k, v) in codes.signal(n) {
            residual.scaled_add(-f64::from(v), &atoms.row(k));
        }
        let lambda = f64::from(codes.lambdas[n]);
        let c = atoms.dot(&residual);
        let mut inside = vec![false; atoms.nrows()];
        for (k, v) in codes.signal(n) {
            inside[k] = true;
            assert!(!nonnegative || v > 0.0);
            worst = worst.max((c[k] - lambda * f64::from(v).signum()).abs() / lambda);
        }
        for (k, &c) in c.iter().enumerate().filter(|(k, _)| !inside[*k]) {
            let size = if nonnegative { c } else { c.abs() };
            assert!(k < atoms.nrows());
            worst = worst.max((size - lambda) / lambda);
        }
    }
    worst
}

#[test]
fn objectives_equal_those_of_scikit_learn_and_spams() {
    let (dictionary, signals) = fixture();
    for lambda in ["0.05", "0.3", "1.0"] {
        let codes =
            sparse::solve(&dictionary, signals.view(), &options(Solver::Auto, lambda.parse().unwrap())).unwrap();
        let ours = codes.objectives(&dictionary, signals.view()).unwrap();
        for tool in ["sklearn", "spams"] {
            let theirs: Array1<f64> = read(&format!("sparse_{tool}_{lambda}"));
            for (a, b) in ours.iter().zip(&theirs) {
                assert!((a - b).abs() <= 1e-6 * b, "λ {lambda}, {tool}: {a} against {b}");
            }
        }
        assert!(kkt_violation(&dictionary, &signals, &codes, false) < 1e-4);
        assert!(codes.all_converged());
    }
}

#[test]
fn nonnegative_weighted_and_greedy_codes_equal_scikit_learns() {
    let (dictionary, signals) = fixture();
    let nonnegative = Options { nonnegative: true, ..options(Solver::Auto, 0.3) };
    let codes = sparse::solve(&dictionary, signals.view(), &nonnegative).unwrap();
    let theirs: Array1<f64> = read("sparse_sklearn_nonnegative_0.3");
    for (a, b) in codes.objectives(&dictionary, signals.view()).unwrap().iter().zip(&theirs) {
        assert!((a - b).abs() <= 1e-6 * b, "non-negative: {a} against {b}");
    }
    assert!(kkt_violation(&dictionary, &signals, &codes, true) < 1e-4);

    let weights: Array2<f32> = read("sparse_weights");
    let theirs: Array1<f64> = read("sparse_sklearn_weighted_0.3");
    let codes =
        sparse::solve_weighted(&dictionary, signals.view(), weights.view(), &options(Solver::Auto, 0.3)).unwrap();
    let fits = codes.multiply(dictionary.atoms()).unwrap();
    for n in 0..codes.len() {
        let data: f64 = (0..signals.ncols())
            .map(|i| f64::from(weights[[n, i]]) * f64::from(signals[[n, i]] - fits[[n, i]]).powi(2))
            .sum();
        let objective = 0.5 * data + 0.3 * codes.signal(n).map(|(_, v)| f64::from(v).abs()).sum::<f64>();
        assert!((objective - theirs[n]).abs() <= 2e-6 * theirs[n], "weighted: {objective} against {}", theirs[n]);
    }

    let greedy = Options { penalty: Penalty::NonZeros(5), solver: Solver::Omp, ..Options::default() };
    let codes = sparse::solve(&dictionary, signals.view(), &greedy).unwrap();
    let theirs: Array1<f64> = read("sparse_sklearn_omp_5");
    for (a, b) in codes.objectives(&dictionary, signals.view()).unwrap().iter().zip(&theirs) {
        assert!((a - b).abs() <= 1e-5 * b + 1e-9, "OMP: {a} against {b}");
    }
    assert!((0..codes.len()).all(|n| codes.signal(n).len() <= 5));
}

#[test]
fn all_solvers_agree() {
    let (dictionary, signals) = fixture();
    let signals = signals.slice(s![..12, ..]).to_owned();
    for nonnegative in [false, true] {
        let reference = Options { nonnegative, tolerance: 1e-7, ..options(Solver::Auto, 0.3) };
        let reference = sparse::solve(&dictionary, signals.view(), &reference).unwrap();
        let expected = reference.objectives(&dictionary, signals.view()).unwrap();
        let all = [Solver::ActiveSet, Solver::CoordinateDescent, Solver::Ista, Solver::Fista, Solver::Homotopy];
        for solver in all {
            let options = Options { nonnegative, ..options(solver, 0.3) };
            let codes = sparse::solve(&dictionary, signals.view(), &options).unwrap();
            assert!(codes.all_converged(), "{solver:?}");
            let objectives = codes.objectives(&dictionary, signals.view()).unwrap();
            for (n, (a, b)) in objectives.iter().zip(&expected).enumerate() {
                assert!(a - b <= codes.gaps[n] + 1e-7, "{solver:?}: {a} against {b}, gap {}", codes.gaps[n]);
            }
        }
    }
}

#[test]
fn planted_supports_come_back() {
    let atoms = random_atoms(128, 64, 1);
    let dictionary = sparse::prepare(atoms.view()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut signals = Array2::zeros((100, 64));
    let mut planted = Vec::new();
    for mut signal in signals.rows_mut() {
        let mut chosen: Vec<usize> = (0..4).map(|_| rng.random_range(0..128)).collect();
        chosen.sort_unstable();
        chosen.dedup();
        for &k in &chosen {
            let value = if rng.random::<bool>() { 1.0 } else { -1.5 };
            signal.scaled_add(value, &atoms.row(k));
        }
        planted.push(chosen);
    }
    let greedy = Options { penalty: Penalty::NonZeros(4), ..Options::default() };
    for options in [options(Solver::Auto, 0.02), greedy] {
        let codes = sparse::solve(&dictionary, signals.view(), &options).unwrap();
        let found = |n: usize| codes.signal(n).filter(|e| e.1.abs() > 0.3).map(|e| e.0).collect::<Vec<_>>();
        let right = (0..100).filter(|&n| found(n) == planted[n]).count();
        assert!(right >= 97, "{right} of 100 supports");
    }
}

#[test]
fn order_threads_and_instructions_change_nothing() {
    // Few atoms are looked at all together, many by what is near.
    for (atoms, nonnegative) in [(200, false), (300, false), (60, true)] {
        change_nothing(atoms, nonnegative);
    }
}

fn change_nothing(k: usize, nonnegative: bool) {
    // Supports from none to beyond the small state's sixteen, one after the other.
    let (atoms, mut signals) = (random_atoms(k, 49, 3), random_signals(301, 49, 4));
    for (n, mut signal) in signals.rows_mut().into_iter().enumerate() {
        signal *= [0.05, 0.3, 1.0, 4.0][n % 4];
    }
    let dictionary = sparse::prepare(atoms.view()).unwrap();
    let options = Options { nonnegative, ..options(Solver::Auto, 0.1) };
    let codes = sparse::solve(&dictionary, signals.view(), &options).unwrap();
    let sizes: Vec<usize> = (0..301).map(|n| codes.signal(n).len()).collect();
    assert!(sizes.contains(&0) && sizes.iter().any(|&s| s > 16), "{sizes:?}");
    let dense = codes.to_dense(k).unwrap();

    let backwards = signals.slice(s![..;-1, ..]).to_owned();
    let turned = sparse::solve(&dictionary, backwards.view(), &options).unwrap().to_dense(k).unwrap();
    assert_eq!(dense, turned.slice(s![..;-1, ..]));

    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let threaded = pool.install(|| sparse::solve(&dictionary, signals.view(), &options)).unwrap();
    assert_eq!(dense, threaded.to_dense(k).unwrap());

    for simd in [Simd::Plain, Simd::Avx2, Simd::Avx512] {
        let other = sparse::prepare(atoms.view()).unwrap().with_simd(simd);
        let codes = sparse::solve(&other, signals.view(), &options).unwrap();
        assert_eq!(dense, codes.to_dense(k).unwrap(), "{simd:?}");
    }
}

#[test]
fn long_signals_and_large_supports_converge() {
    let (atoms, signals) = (random_atoms(512, 144, 5), random_signals(24, 144, 6));
    let dictionary = sparse::prepare(atoms.view()).unwrap();
    for lambda in [0.003, 0.02, 0.1] {
        let codes = sparse::solve(&dictionary, signals.view(), &options(Solver::Auto, lambda)).unwrap();
        assert!(codes.all_converged());
        assert!(codes.gaps.iter().zip(signals.rows()).all(|(&g, y)| g <= 0.5e-6 * f64::from(y.dot(&y)) * 1.001));
    }
}

/// Random atoms with a spectrum from 1 to 1/`condition`, of unit norm.
fn ill_conditioned_atoms(k: usize, m: usize, condition: f32, seed: u64) -> Array2<f32> {
    let mut atoms = random_atoms(k, m, seed);
    for mut atom in atoms.rows_mut() {
        for (i, v) in atom.iter_mut().enumerate() {
            *v *= condition.powf(-(i as f32) / (m - 1) as f32);
        }
        let norm = atom.dot(&atom).sqrt();
        atom /= norm;
    }
    atoms
}

/// Atoms in pairs that differ by a hundredth, and copies.
fn coherent_atoms(k: usize, m: usize, seed: u64) -> Array2<f32> {
    let (base, other) = (random_atoms(k, m, seed), random_atoms(k, m, seed + 1));
    let mut atoms = base.clone();
    for n in (1..k).step_by(2) {
        let near = &base.row(n - 1) + &(0.01 * &other.row(n));
        atoms.row_mut(n).assign(&(&near / near.dot(&near).sqrt()));
    }
    let copy = atoms.row(0).to_owned();
    atoms.row_mut(k - 1).assign(&copy);
    atoms
}

#[test]
fn small_penalties_are_certified_on_any_dictionary() {
    let dictionaries = [
        ("random", random_atoms(150, 30, 20)),
        ("ill-conditioned", ill_conditioned_atoms(40, 30, 100.0, 21)),
        ("ill-conditioned, many", ill_conditioned_atoms(200, 30, 1000.0, 22)),
        ("coherent", coherent_atoms(80, 30, 23)),
        ("fewer than values", ill_conditioned_atoms(20, 30, 100.0, 24)),
    ];
    let mut signals = random_signals(16, 30, 25);
    // Beyond what f32 can square.
    signals.row_mut(5).mapv_inplace(|v| v * 1e-25);
    for (name, atoms) in dictionaries {
        let dictionary = sparse::prepare(atoms.view()).unwrap();
        let mut left_by_f32 = 0;
        for nonnegative in [false, true] {
            for lambda in [0.01, 1e-3, 1e-4, 1e-6, 0.0] {
                if lambda == 0.0 && nonnegative {
                    continue;
                }
                let options = Options { nonnegative, ..options(Solver::Auto, lambda) };
                let codes = sparse::solve(&dictionary, signals.view(), &options).unwrap();
                assert!(codes.all_converged(), "{name}, λ {lambda}: gap {}", codes.max_gap());
                left_by_f32 += codes.redone_in_f64;
                let ours = codes.objectives(&dictionary, signals.view()).unwrap();
                let ones = Array2::ones(signals.dim());
                let slow = sparse::solve_weighted(&dictionary, signals.view(), ones.view(), &options).unwrap();
                let oracle = slow.objectives(&dictionary, signals.view()).unwrap();
                for n in (0..16).filter(|&n| slow.ended[n] == Ended::Converged) {
                    let energy = 0.5 * signals.row(n).iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
                    // Each is within its gap of the minimum, 1e-6 of the energy, and the values are rounded to f32.
                    let difference = (ours[n] - oracle[n]).abs();
                    assert!(difference <= 1.1e-6 * energy, "{name}, λ {lambda}, signal {n}: {} {}", ours[n], oracle[n]);
                    assert!(codes.gaps[n] <= 1.001e-6 * energy);
                }
                for simd in [Simd::Plain, Simd::Avx2].into_iter().filter(|_| lambda == 1e-3) {
                    let other = dictionary.clone().with_simd(simd);
                    let plain = sparse::solve(&other, signals.view(), &options).unwrap();
                    assert_eq!(
                        (&plain.atoms, &plain.values),
                        (&codes.atoms, &codes.values),
                        "{name}, λ {lambda}, {simd:?}"
                    );
                }
            }
        }
        assert!(left_by_f32 > 16, "{name}: {left_by_f32} signals left by f32");
    }
}

#[test]
fn the_edges_of_lambda() {
    let (dictionary, mut signals) = fixture();
    signals.row_mut(3).fill(0.0);
    let most = dictionary.atoms().dot(&signals.t());
    let huge = sparse::solve(&dictionary, signals.view(), &options(Solver::Auto, 1e3)).unwrap();
    assert_eq!(huge.nonzeros(), 0);
    assert!(huge.max_gap() < 1e-9 && huge.all_converged());
    let above = Options { penalty: Penalty::FractionOfMax(1.0001), ..Options::default() };
    assert_eq!(sparse::solve(&dictionary, signals.view(), &above).unwrap().nonzeros(), 0);
    let below = Options { penalty: Penalty::FractionOfMax(0.99), ..Options::default() };
    let below = sparse::solve(&dictionary, signals.view(), &below).unwrap();
    for n in 0..signals.nrows() {
        let largest = most.column(n).fold(0.0f32, |m, c| m.max(c.abs()));
        assert!((below.lambdas[n] - 0.99 * largest).abs() <= 1e-5 * largest);
        assert_eq!(below.signal(n).len() > 0, n != 3);
    }
    // λ = 0: least squares; more atoms than values, so nothing may be left.
    let none = sparse::solve(&dictionary, signals.view(), &options(Solver::Auto, 0.0)).unwrap();
    assert!(none.all_converged());
    let left = &none.multiply(dictionary.atoms()).unwrap() - &signals;
    assert!(left.iter().all(|v| v.abs() < 1e-2));
    // Fewer atoms than values: the projection.
    let few = sparse::prepare(random_atoms(5, 30, 8).view()).unwrap();
    let none = sparse::solve(&few, signals.view(), &options(Solver::Auto, 0.0)).unwrap();
    let left = &signals - &none.multiply(few.atoms()).unwrap();
    assert!(left.dot(&few.atoms().t()).iter().all(|c| c.abs() < 1e-2));
    assert!(none.all_converged());
}

#[test]
fn duplicate_atoms_and_extreme_scales() {
    let mut atoms = random_atoms(40, 20, 9);
    let copy = atoms.slice(s![..10, ..]).to_owned();
    atoms.slice_mut(s![10..20, ..]).assign(&copy);
    atoms.slice_mut(s![20..30, ..]).assign(&(-&copy));
    let dictionary = sparse::prepare(atoms.view()).unwrap();
    let signals = random_signals(50, 20, 10);
    let all = [Solver::Auto, Solver::CoordinateDescent, Solver::Fista, Solver::Homotopy];
    let results: Vec<Vec<f64>> = all
        .iter()
        .map(|&solver| {
            let codes = sparse::solve(&dictionary, signals.view(), &options(solver, 0.05)).unwrap();
            // In f32 coordinate descent may stall just short of the tolerance where atoms are the same; it says so.
            let short = solver == Solver::CoordinateDescent && codes.max_gap() < 1e-5;
            assert!(codes.all_converged() || short, "{solver:?}: gap {}", codes.max_gap());
            codes.objectives(&dictionary, signals.view()).unwrap()
        })
        .collect();
    for other in &results[1..] {
        assert!(results[0].iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-5));
    }
    for scale in [1e-30f32, 1e-15, 1e15, 1e30] {
        let scaled = &signals * scale;
        let codes = sparse::solve(&dictionary, scaled.view(), &options(Solver::Auto, 0.05 * scale)).unwrap();
        assert!(codes.all_converged(), "scale {scale}");
        let objectives = codes.objectives(&dictionary, scaled.view()).unwrap();
        let square = f64::from(scale) * f64::from(scale);
        assert!(objectives.iter().zip(&results[0]).all(|(a, b)| (a / square - b).abs() < 2e-6), "scale {scale}");
    }
}

#[test]
fn samplings_of_their_own() {
    let (dictionary, signals) = fixture();
    let signals = signals.slice(s![..10, ..]).to_owned();
    let options = options(Solver::Auto, 0.2);
    // The identity, as weights and as a matrix, is the plain problem.
    let plain = sparse::solve(&dictionary, signals.view(), &options).unwrap();
    let expected = plain.objectives(&dictionary, signals.view()).unwrap();
    let identity = Array3::from_shape_fn((10, 30, 30), |(_, i, j)| f32::from(u8::from(i == j)));
    let ones = Array2::ones((10, 30));
    for codes in [
        sparse::solve_weighted(&dictionary, signals.view(), ones.view(), &options).unwrap(),
        sparse::solve_sampled(&dictionary, signals.view(), identity.view(), &options).unwrap(),
    ] {
        assert!(codes.all_converged());
        for (a, b) in codes.objectives(&dictionary, signals.view()).unwrap().iter().zip(&expected) {
            assert!((a - b).abs() < 2e-6 * b);
        }
    }
    // Hidden values do not matter; rows left out of a matrix are hidden values.
    let mut mask = Array2::ones((10, 30));
    mask.slice_mut(s![.., 20..]).fill(0.0);
    let mut spoiled = signals.clone();
    spoiled.slice_mut(s![.., 20..]).fill(99.0);
    let a = sparse::solve_weighted(&dictionary, signals.view(), mask.view(), &options).unwrap();
    let b = sparse::solve_weighted(&dictionary, spoiled.view(), mask.view(), &options).unwrap();
    assert_eq!(a.to_dense(96).unwrap(), b.to_dense(96).unwrap());
    let seen = signals.slice(s![.., ..20]).to_owned();
    let rows = identity.slice(s![.., ..20, ..]).to_owned();
    let c = sparse::solve_sampled(&dictionary, seen.view(), rows.view(), &options).unwrap();
    let difference = a.to_dense(96).unwrap() - c.to_dense(96).unwrap();
    assert!(difference.iter().all(|v| v.abs() < 1e-3));
}

#[test]
fn the_path_passes_through_the_answers() {
    let (dictionary, signals) = fixture();
    let knots = sparse::homotopy_path(&dictionary, signals.row(0), 0.05, 1000, false).unwrap();
    assert!(knots.windows(2).all(|w| w[0].lambda >= w[1].lambda));
    assert!((knots.last().unwrap().lambda - 0.05).abs() < 1e-12);
    let one = signals.slice(s![..1, ..]);
    for knot in knots.iter().skip(1) {
        let codes = sparse::solve(&dictionary, one, &options(Solver::Auto, knot.lambda as f32)).unwrap();
        let best = codes.objectives(&dictionary, one).unwrap()[0];
        let mut residual = one.row(0).mapv(f64::from);
        for (&k, &v) in knot.atoms.iter().zip(&knot.values) {
            residual.scaled_add(-v, &dictionary.atoms().row(k as usize).mapv(f64::from));
        }
        let objective = 0.5 * residual.dot(&residual) + knot.lambda * knot.values.iter().map(|v| v.abs()).sum::<f64>();
        assert!((objective - best).abs() < 1e-6 * best.max(0.01), "{objective} {best}");
    }
    let counted = Options { solver: Solver::Homotopy, penalty: Penalty::NonZeros(6), ..Options::default() };
    let codes = sparse::solve(&dictionary, signals.view(), &counted).unwrap();
    assert!((0..codes.len()).all(|n| codes.signal(n).len() <= 6));
    assert!(codes.mean_nonzeros() > 5.0 && codes.all_converged());
}

#[test]
fn bad_input_is_refused() {
    let (dictionary, mut signals) = fixture();
    let atoms = dictionary.atoms().to_owned();
    let mut bad = atoms.clone();
    bad[[7, 3]] = f32::NAN;
    assert!(matches!(sparse::prepare(bad.view()), Err(Error::NotFinite { row: 7, .. })));
    assert!(matches!(sparse::prepare((2.0 * &atoms).view()), Err(Error::Parameter(_))));
    assert!(matches!(sparse::prepare(Array2::zeros((0, 5)).view()), Err(Error::Shape(_))));
    assert!(matches!(sparse::prepare(Array2::zeros((5, 0)).view()), Err(Error::Shape(_))));
    assert!(matches!(sparse::prepare(Array2::zeros((20_000, 1)).view()), Err(Error::Shape(_))));
    let solve = |signals: &Array2<f32>, options: &Options| sparse::solve(&dictionary, signals.view(), options);
    assert!(matches!(solve(&Array2::zeros((3, 29)), &Options::default()), Err(Error::Shape(_))));
    for penalty in [Penalty::Lambda(-1.0), Penalty::Lambda(f32::NAN), Penalty::FractionOfMax(f32::INFINITY)] {
        assert!(matches!(solve(&signals, &Options { penalty, ..Options::default() }), Err(Error::Parameter(_))));
    }
    let options = Options { tolerance: f64::NAN, ..Options::default() };
    assert!(matches!(solve(&signals, &options), Err(Error::Parameter(_))));
    let options = Options { max_iterations: 0, ..Options::default() };
    assert!(matches!(solve(&signals, &options), Err(Error::Parameter(_))));
    let options = Options { solver: Solver::Omp, ..Options::default() };
    assert!(matches!(solve(&signals, &options), Err(Error::Parameter(_))));
    let options = Options { solver: Solver::Fista, penalty: Penalty::NonZeros(3), ..Options::default() };
    assert!(matches!(solve(&signals, &options), Err(Error::Parameter(_))));
    let weights = Array2::from_elem(signals.dim(), -1.0);
    let weighted = sparse::solve_weighted(&dictionary, signals.view(), weights.view(), &Options::default());
    assert!(matches!(weighted, Err(Error::Parameter(_))));
    signals[[11, 0]] = f32::INFINITY;
    assert!(matches!(solve(&signals, &Options::default()), Err(Error::NotFinite { row: 11, .. })));
    // No signals are no mistake.
    assert!(solve(&Array2::zeros((0, 30)), &Options::default()).unwrap().is_empty());
}

#[test]
fn the_cap_on_iterations_is_told() {
    let (dictionary, signals) = fixture();
    for solver in [Solver::Auto, Solver::CoordinateDescent, Solver::Ista, Solver::Homotopy] {
        let options = Options { max_iterations: 2, ..options(solver, 0.05) };
        let codes = sparse::solve(&dictionary, signals.view(), &options).unwrap();
        assert!(codes.ended.contains(&Ended::IterationCap), "{solver:?}");
        assert!(codes.max_gap() > 1e-4, "{solver:?}");
    }
}

#[test]
fn multiply_is_the_dense_product() {
    let (dictionary, signals) = fixture();
    let codes = sparse::solve(&dictionary, signals.view(), &options(Solver::Auto, 0.1)).unwrap();
    let other = random_atoms(96, 77, 12);
    let expected = codes.to_dense(96).unwrap().dot(&other);
    let product = codes.multiply(other.view()).unwrap();
    assert!((&product - &expected).iter().all(|d| d.abs() < 1e-5));
    assert!(matches!(codes.multiply(other.slice(s![..50, ..])), Err(Error::Shape(_))));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any shape, any λ: a certificate within the tolerance, and optimality to match.
    #[test]
    fn every_answer_is_certified(k in 1usize..150, m in 1usize..40, n in 0usize..40, seed: u64, lambda in 0.001f32..1.0, nonnegative: bool) {
        let dictionary = sparse::prepare(random_atoms(k, m, seed).view()).unwrap();
        let signals = random_signals(n, m, seed ^ 1);
        let options = Options { nonnegative, ..options(Solver::Auto, lambda) };
        let codes = sparse::solve(&dictionary, signals.view(), &options).unwrap();
        prop_assert_eq!(codes.len(), n);
        prop_assert!(codes.all_converged());
        for (y, &gap) in signals.axis_iter(Axis(0)).zip(&codes.gaps) {
            prop_assert!(gap <= 0.5e-6 * f64::from(y.dot(&y)) * 1.001);
        }
        let scaled = sparse::solve(&dictionary, (&signals * 2.0).view(), &Options { penalty: Penalty::Lambda(2.0 * lambda), ..options }).unwrap();
        let (a, b) = (codes.to_dense(k).unwrap(), scaled.to_dense(k).unwrap());
        prop_assert!((&a * 2.0 - &b).iter().all(|d| d.abs() < 2e-3));
    }
}
