//! A whole training run: photos → pairs → eq. (3) → Dh → refinement → anchors → dictionary, with checkpoints and scores.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use lenslet_core::dictionary::{
    self, Dictionary, Footprint, Model, PatchModel, PatchPredictor, PlaneReconstructor, Recipe, ReconstructionOptions,
    Storage,
};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::{self, Crop, PatchOptions};
use ndarray::{Array2, Axis, concatenate, s};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::checkpoint::{self, Checkpoint, Key, Stage};
use super::data::{self, Data};
use super::{Algorithm, Coupling, Error, Parameters, anchored, atoms, ksvd, linear, network, online, refine};

/// One epoch's news.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Footprint of the model.
    pub footprint: Footprint,
    /// Pass, from 1.
    pub pass: usize,
    /// `learn`, `refine`, or `done` for the finished pass.
    pub stage: String,
    /// Epoch within the stage, from 1.
    pub epoch: usize,
    /// Mean objective a pair (learn: ½‖x − Dᵀα‖² + λ‖α‖₁, or ½‖x − Dᵀα‖² for K-SVD; refine: weighted ½‖e‖²).
    pub objective: f64,
    /// Mean number of non-zeros.
    pub nonzeros: f64,
    /// Atoms replaced.
    pub replaced: usize,
    /// PSNR on the held-out crops by the LASSO path, dB; None without held-out photos.
    pub held_out_psnr: Option<f64>,
    /// PSNR of their low images.
    pub low_psnr: Option<f64>,
    /// PSNR by the network, of a finished pass that has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network_psnr: Option<f64>,
    /// Seconds since the run (or its resumption) began.
    pub seconds: f64,
}

/// What a run gives.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The dictionary.
    pub dictionary: Dictionary,
    /// All epochs.
    pub trace: Vec<Epoch>,
    /// Photos left out, and why.
    pub skipped: Vec<String>,
}

/// Trains a dictionary on the photos (files, or folders that are searched).
///
/// With a `checkpoint` file, the state is saved there after every epoch; with `resume` a run goes on from it, to the very
/// dictionary that the uninterrupted run gives. `log` hears every epoch, first those of the checkpoint. A checkpoint that
/// cannot be written is noted, and training goes on.
///
/// # Errors
/// Parameters out of range, no usable photo, a checkpoint of another run, [`Error::Interrupted`].
pub fn train(
    photos: &[PathBuf],
    parameters: &Parameters,
    checkpoint: Option<&Path>,
    resume: bool,
    observer: &dyn Observer,
    log: &mut dyn FnMut(&Epoch),
) -> Result<Outcome, Error> {
    let mut gather = |footprint, observer: &dyn Observer| data::gather(photos, parameters, footprint, observer);
    train_on(&mut gather, parameters, checkpoint, resume, observer, log)
}

/// [`train`] on crops that `gather` makes for a footprint, the same ones whenever it is asked. What they start from is
/// `parameters.base`.
///
/// # Errors
/// As [`train`]; what `gather` returns.
pub fn train_on(
    gather: &mut dyn FnMut(Footprint, &dyn Observer) -> Result<Data, Error>,
    parameters: &Parameters,
    checkpoint: Option<&Path>,
    resume: bool,
    observer: &dyn Observer,
    log: &mut dyn FnMut(&Epoch),
) -> Result<Outcome, Error> {
    parameters.check()?;
    let started = std::time::Instant::now();
    let mut data = gather(parameters.footprints[0], observer)?;
    let skipped = data.skipped.clone();
    let key = Key { version: 1, parameters: parameters.clone(), photos: data.photos.clone() };
    let state = match checkpoint {
        Some(path) if resume => checkpoint::load(path, &key)?,
        _ => Checkpoint { key, done: None, at: (0, 0), stage: None, trace: Vec::new() },
    };
    state.trace.iter().for_each(&mut *log);
    let mut run = Run { parameters, observer, log, path: checkpoint, state, started };
    for (m, &footprint) in parameters.footprints.iter().enumerate() {
        if run.state.at.0 != m {
            continue;
        }
        if m > 0 {
            data = gather(footprint, &Quiet(observer))?;
        }
        run.model(footprint, &data)?;
    }
    let state = run.state;
    let Some(mut dictionary) = state.done else { return Err(Error::TooLittle("nothing was trained".into())) };
    dictionary.recipe = recipe(parameters, &state.key, &state.trace)?;
    dictionary.storage = parameters.storage;
    Ok(Outcome { dictionary, trace: state.trace, skipped })
}

/// Passes everything on but notes: what is wrong with a photo is said once.
struct Quiet<'a>(&'a dyn Observer);

impl Observer for Quiet<'_> {
    fn begin(&self, stage: &str, total: u64) {
        self.0.begin(stage, total);
    }
    fn advance(&self, n: u64) {
        self.0.advance(n);
    }
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

fn recipe(parameters: &Parameters, key: &Key, trace: &[Epoch]) -> Result<Recipe, Error> {
    let wrong = |e: serde_json::Error| Error::Parameter(e.to_string());
    let parameters_json = serde_json::to_value(parameters).map_err(wrong)?;
    let mut scores = serde_json::Map::new();
    for e in trace.iter().filter(|e| e.stage == "done") {
        // Times differ from run to run, the file must not: only scores go in.
        let mut value = serde_json::json!({ "low": e.low_psnr, "learned": e.held_out_psnr });
        if let Some(psnr) = e.network_psnr {
            value["network"] = psnr.into();
        }
        scores.insert(format!("held-out PSNR, {}, pass {}", e.footprint, e.pass), value);
    }
    Ok(Recipe {
        tool: format!("lenslet {}", env!("CARGO_PKG_VERSION")),
        algorithm: serde_json::to_value(parameters.algorithm).map_err(wrong)?.as_str().unwrap_or_default().into(),
        seed: parameters.seed,
        generator: "ChaCha8".into(),
        parameters: parameters_json.as_object().cloned().unwrap_or_default(),
        photos: key.photos.clone(),
        scores,
    })
}

struct Run<'a> {
    parameters: &'a Parameters,
    observer: &'a dyn Observer,
    log: &'a mut dyn FnMut(&Epoch),
    path: Option<&'a Path>,
    state: Checkpoint,
    started: std::time::Instant,
}

/// Pairs made ready: unit features, targets in their scale, weights.
struct Ready {
    filters: Array2<f32>,
    floor: f32,
    linear: Array2<f32>,
    signals: Array2<f32>,
    targets: Array2<f32>,
    weights: Vec<f32>,
}

impl Run<'_> {
    fn model(&mut self, footprint: Footprint, data: &Data) -> Result<(), Error> {
        let p = self.parameters;
        let degradation = data::degradation(p, footprint);
        if self.state.at.1 == 0 {
            let patch_model = self.patch_model(footprint, &data.train, &data.held_out, &degradation)?;
            let finished = Model { footprint, base: degradation.base, pitch: p.pitch, patch_model };
            let done = self.state.done.get_or_insert_with(|| Dictionary {
                recipe: Recipe::default(),
                storage: Storage::F32,
                models: Vec::new(),
            });
            done.models.truncate(self.state.at.0);
            done.models.push(finished);
            self.state.at.1 = 1;
            self.state.stage = None;
            self.save();
        }
        self.state.at = (self.state.at.0 + 1, 0);
        self.save();
        Ok(())
    }

    fn check(&self) -> Result<(), Error> {
        if self.observer.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// Saves the checkpoint. Training goes on without one (a full disk may have room again after the next epoch); the
    /// one before stays.
    fn save(&self) {
        if let Some(path) = self.path
            && let Err(e) = checkpoint::save(path, &self.state)
        {
            self.observer.note(&format!("no checkpoint of this epoch, training goes on: {e}"));
        }
    }

    fn rng(&self, what: u64) -> ChaCha8Rng {
        let (model, pass) = self.state.at;
        let mut rng = ChaCha8Rng::seed_from_u64(self.parameters.seed);
        rng.set_stream((3 << 62) | ((model as u64) << 40) | ((pass as u64) << 32) | what);
        rng
    }

    fn patch_model(
        &mut self,
        footprint: Footprint,
        train: &[Crop],
        held_out: &[Crop],
        degradation: &pairs::Degradation,
    ) -> Result<PatchModel, Error> {
        let p = self.parameters;
        let ready = self.prepare(train)?;
        let scorer = Scorer::new(footprint, degradation, held_out, &ready, p);
        let problem = refine::Problem {
            signals: ready.signals.view(),
            targets: ready.targets.view(),
            weights: &ready.weights,
            lambda: p.lambda,
        };
        let mut stage = match self.state.stage.take() {
            Some(stage) => stage,
            None => Stage::Learn(0, self.first_atoms(&ready)?),
        };
        if let Stage::Learn(mut done, mut state) = stage {
            let stacked = match p.coupling {
                Coupling::Joint => Cow::Owned(stack(&ready)),
                Coupling::Low => Cow::Borrowed(&ready.signals),
            };
            while done < p.epochs {
                let mut rng = self.rng(0x1000 + done as u64);
                self.observer.begin(&format!("{footprint}: learn {}/{}", done + 1, p.epochs), stacked.nrows() as u64);
                let observer = self.observer;
                let mut step = |n: usize| {
                    observer.advance(n as u64);
                    if observer.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
                };
                let summary = match p.algorithm {
                    Algorithm::Ksvd => ksvd::epoch(&mut state.atoms, stacked.view(), p.nonzeros, &mut rng, &mut step)?,
                    Algorithm::Online => {
                        online::epoch(&mut state, stacked.view(), p.lambda, p.batch, &mut rng, &mut step)?
                    }
                    Algorithm::Ista => online::batch_epoch(&mut state, stacked.view(), p.lambda, &mut rng, &mut step)?,
                };
                done += 1;
                let (low, high) = split(&state.atoms, &ready, p.coupling);
                // Scored as it stands when learned jointly; alone, Dl has no Dh before the least squares.
                let psnr = match high {
                    Some(high) => scorer.score(&low, &high)?,
                    None => None,
                };
                self.report(footprint, "learn", done, summary, psnr, scorer.low, None);
                self.state.stage = Some(Stage::Learn(done, state.clone()));
                self.save();
            }
            let (low, _) = split(&state.atoms, &ready, p.coupling);
            let high = self.fit_high(&low, &problem)?;
            stage = Stage::Refine(0, refine::State::new(low, high));
        }
        let Stage::Refine(mut done, mut state) = stage else {
            return Err(Error::Parameter("training is in no stage".into()));
        };
        while done < p.refine {
            let mut rng = self.rng(0x2000 + done as u64);
            self.observer
                .begin(&format!("{footprint}: refine {}/{}", done + 1, p.refine), ready.signals.nrows() as u64);
            let observer = self.observer;
            let mut step = |n: usize| {
                observer.advance(n as u64);
                if observer.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
            };
            // The step falls as a half cosine over all epochs.
            let rate = |e: usize| {
                let x = e as f32 / p.refine as f32;
                p.rate * (0.02 + 0.98 * 0.5 * (1.0 + (std::f32::consts::PI * x).cos()))
            };
            let (objective, nonzeros) =
                refine::epoch(&mut state, &problem, p.batch, (rate(done), rate(done + 1)), &mut rng, &mut step)?;
            done += 1;
            let psnr = scorer.score(&state.low, &state.high)?;
            let summary = online::Summary { objective, nonzeros, replaced: 0 };
            self.report(footprint, "refine", done, summary, psnr, scorer.low, None);
            self.state.stage = Some(Stage::Refine(done, state.clone()));
            self.save();
        }
        let high = if p.refine > 0 { self.fit_high(&state.low, &problem)? } else { state.high };
        let psnr = scorer.score(&state.low, &high)?;
        let mut learned = scorer.patch_model.clone();
        learned.anchored = self.anchors(&ready)?;
        drop(ready);
        learned.low = state.low;
        learned.high = high;
        learned.network = self.network(footprint, train)?;
        let by_network = match learned.network {
            Some(_) => scorer.score_by(learned.clone(), PatchPredictor::Network)?,
            None => None,
        };
        self.report(footprint, "done", 0, online::Summary::default(), psnr, scorer.low, by_network);
        Ok(learned)
    }

    fn network(&self, footprint: Footprint, crops: &[Crop]) -> Result<Option<dictionary::Network>, Error> {
        let p = self.parameters;
        let Some(wanted) = &p.network else { return Ok(None) };
        let most = p.network_pairs_within(wanted, crop_bytes(crops));
        if most < wanted.pairs {
            let (pairs, memory) = (wanted.pairs, p.memory);
            self.observer.note(&format!("network: {most} pairs instead of {pairs}: more do not fit into {memory} GiB"));
        }
        self.observer.begin(&format!("{footprint}: network"), (wanted.epochs * most.min(wanted.pairs)) as u64);
        let mut step = |n: usize| {
            self.observer.advance(n as u64);
            self.check()
        };
        let learned = network::learn(crops, wanted, p.emphasis, most, p.seed, &mut self.rng(0x4000), &mut step)?;
        Ok(Some(learned))
    }

    fn fit_high(&self, low: &Array2<f32>, problem: &refine::Problem<'_>) -> Result<Array2<f32>, Error> {
        self.observer.begin("least squares Dh", problem.signals.nrows() as u64);
        refine::fit_high(low, problem, &mut |n| {
            self.observer.advance(n as u64);
            self.check()
        })
    }

    fn anchors(&self, ready: &Ready) -> Result<Option<dictionary::Anchored>, Error> {
        let p = self.parameters;
        if p.anchors == 0 {
            return Ok(None);
        }
        self.observer.begin("anchored regressors", 0);
        let mut rng = self.rng(0x3000);
        let anchors = anchored::anchors(&ready.signals, p.anchors, 6, 60_000, &mut rng)?;
        let stop = || self.observer.cancelled();
        let fitted = anchored::fit(anchors, ready.signals.view(), ready.targets.view(), p.neighbours, p.ridge, &stop)?;
        Ok(Some(fitted))
    }

    fn prepare(&self, crops: &[Crop]) -> Result<Ready, Error> {
        let p = self.parameters;
        self.observer.begin("pairs", 0);
        let (filters, _) = pairs::learn_filters(crops, p.window, p.features)?;
        let most = p.pairs_within(crop_bytes(crops));
        if most < p.pairs {
            self.observer.note(&format!("{most} pairs instead of {}: more do not fit into {} GiB", p.pairs, p.memory));
        }
        let options = PatchOptions {
            patch: p.patch,
            window: p.window,
            per_crop: most.div_ceil(crops.len()),
            seed: p.seed,
            ..PatchOptions::default()
        };
        let pairs = pairs::pairs(crops, &filters, &options)?;
        if pairs.features.nrows() < p.atoms.max(p.anchors).max(100) {
            return Err(Error::TooLittle(format!(
                "{} textured patches are too few for {} atoms: give more or larger photos, or fewer --atoms",
                pairs.features.nrows(),
                p.atoms.max(p.anchors)
            )));
        }
        let floor = options.flat;
        let linear = linear::ridge(pairs.features.view(), pairs.residuals.view(), None)?;
        let (mut signals, mut targets) = (pairs.features, pairs.residuals);
        let mut weights = vec![0.0f32; signals.nrows()];
        let rows = signals.outer_iter_mut().into_par_iter().zip(targets.outer_iter_mut().into_par_iter());
        rows.zip(weights.par_iter_mut()).for_each(|((mut y, mut t), w)| {
            let norm = y.dot(&y).sqrt().max(floor);
            y /= norm;
            t /= norm;
            *w = norm.powf(p.emphasis);
        });
        let mean = weights.iter().map(|w| f64::from(*w)).sum::<f64>() / weights.len() as f64;
        weights.iter_mut().for_each(|w| *w /= mean as f32);
        self.check()?;
        Ok(Ready { filters, floor, linear, signals, targets, weights })
    }

    fn first_atoms(&self, ready: &Ready) -> Result<online::State, Error> {
        let mut rng = self.rng(0);
        let atoms = match self.parameters.coupling {
            Coupling::Joint => atoms::initial(&stack(ready), self.parameters.atoms, &mut rng)?,
            Coupling::Low => atoms::initial(&ready.signals, self.parameters.atoms, &mut rng)?,
        };
        Ok(online::State::new(atoms))
    }

    #[allow(clippy::too_many_arguments)] // one line of news
    fn report(
        &mut self,
        footprint: Footprint,
        stage: &str,
        epoch: usize,
        summary: online::Summary,
        psnr: Option<f64>,
        low: Option<f64>,
        by_network: Option<f64>,
    ) {
        let news = Epoch {
            footprint,
            pass: 1,
            stage: stage.into(),
            epoch,
            objective: summary.objective,
            nonzeros: summary.nonzeros,
            replaced: summary.replaced,
            held_out_psnr: psnr,
            low_psnr: low,
            network_psnr: by_network,
            seconds: self.started.elapsed().as_secs_f64(),
        };
        let decibels = |v: Option<f64>| v.map_or("none".into(), |v| format!("{v:.3} dB"));
        let network = by_network.map_or(String::new(), |v| format!(", by the network {v:.3} dB"));
        self.observer.note(&format!(
            "{footprint}, {stage} {epoch}: objective {:.6}, {:.2} non-zeros, {} replaced, held-out {}{network} (low image {}), {:.0} s",
            summary.objective,
            summary.nonzeros,
            summary.replaced,
            decibels(psnr),
            decibels(low),
            news.seconds
        ));
        (self.log)(&news);
        self.state.trace.push(news);
    }
}

fn crop_bytes(crops: &[Crop]) -> usize {
    crops.iter().map(|c| 4 * c.high.len() * (2 + c.beside.len())).sum()
}

/// The weight of the targets in a stacked pair: both halves get the same mean energy.
fn balance(ready: &Ready) -> f32 {
    let energy = |a: &Array2<f32>| a.rows().into_iter().map(|r| f64::from(r.dot(&r))).sum::<f64>();
    (energy(&ready.signals) / energy(&ready.targets).max(1e-30)).sqrt() as f32
}

/// Stacked pairs of eq. (3), [y, b·t]/√2: mean energy as that of y.
fn stack(ready: &Ready) -> Array2<f32> {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let b = balance(ready) * half;
    let (low, high) = (ready.signals.mapv(|v| v * half), ready.targets.mapv(|v| v * b));
    concatenate(Axis(1), &[low.view(), high.view()]).unwrap_or_else(|_| ready.signals.clone())
}

/// Dl (unit rows) and Dh of stacked atoms; an atom with hardly any low part becomes the first feature axis.
fn split(stacked: &Array2<f32>, ready: &Ready, coupling: Coupling) -> (Array2<f32>, Option<Array2<f32>>) {
    if coupling == Coupling::Low {
        return (stacked.clone(), None);
    }
    let m = ready.signals.ncols();
    let b = balance(ready);
    let mut low = stacked.slice(s![.., ..m]).to_owned();
    let mut high = stacked.slice(s![.., m..]).to_owned();
    for (l, mut h) in low.rows().into_iter().zip(high.rows_mut()) {
        let norm = l.dot(&l).sqrt();
        h /= b * norm.max(1e-3);
    }
    atoms::normalise(&mut low);
    (low, Some(high))
}

/// Scores dictionaries on the held-out crops.
struct Scorer<'a> {
    patch_model: PatchModel,
    footprint: Footprint,
    base: Interpolation,
    pitch: f64,
    crops: &'a [Crop],
    low: Option<f64>,
}

impl<'a> Scorer<'a> {
    fn new(
        footprint: Footprint,
        degradation: &pairs::Degradation,
        crops: &'a [Crop],
        ready: &Ready,
        p: &Parameters,
    ) -> Self {
        let patch_model = PatchModel {
            support: p.window + 4,
            patch: p.patch,
            filters: ready.filters.clone(),
            floor: ready.floor,
            lambda: p.lambda,
            low: Array2::zeros((0, 0)),
            high: Array2::zeros((0, 0)),
            ridge: ready.linear.clone(),
            anchored: None,
            network: None,
        };
        // A few crops are enough to see which way it goes.
        let crops = &crops[..crops.len().min(6)];
        let errors = crops.iter().map(|c| error(&c.low, &c.high));
        let low = mean_psnr(errors);
        let (base, pitch) = (degradation.base, degradation.pitch);
        Scorer { patch_model, footprint, base, pitch, crops, low }
    }

    fn score(&self, low: &Array2<f32>, high: &Array2<f32>) -> Result<Option<f64>, Error> {
        let patch_model = PatchModel { low: low.clone(), high: high.clone(), ..self.patch_model.clone() };
        self.score_by(patch_model, PatchPredictor::Lasso)
    }

    fn score_by(&self, patch_model: PatchModel, predictor: PatchPredictor) -> Result<Option<f64>, Error> {
        let model = Model { footprint: self.footprint, base: self.base, pitch: self.pitch, patch_model };
        let step = 3.min(self.patch_model.patch);
        let options = ReconstructionOptions { predictor, step, ..ReconstructionOptions::default() };
        let reconstructor = PlaneReconstructor::new(&model, &options)?;
        let mut errors = Vec::new();
        for crop in self.crops {
            errors.push(error(&reconstructor.reconstruct_plane(crop.low.view(), &crop.beside)?, &crop.high));
        }
        Ok(mean_psnr(errors.into_iter()))
    }
}

/// Mean squared error, values clamped to the range.
fn error(result: &Array2<f32>, truth: &Array2<f32>) -> f64 {
    let sum: f64 = result.iter().zip(truth).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b).powi(2)).sum();
    sum / truth.len().max(1) as f64
}

fn mean_psnr(errors: impl Iterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = errors.map(|e| -10.0 * e.max(1e-10).log10()).collect();
    if all.is_empty() { None } else { Some(all.iter().sum::<f64>() / all.len() as f64) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NetworkParameters;
    use lenslet_core::progress::Silent;
    use rand::RngExt;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Photos of overlapping discs and bars: edges of all directions.
    fn photos(folder: &Path, count: u64) -> Vec<PathBuf> {
        (0..count)
            .map(|n| {
                let mut rng = ChaCha8Rng::seed_from_u64(n);
                let mut plane = Array2::<f32>::from_elem((150, 150), 120.0);
                for _ in 0..60 {
                    let (cx, cy, r) = (
                        rng.random_range(0.0..150.0f32),
                        rng.random_range(0.0..150.0f32),
                        rng.random_range(4.0..25.0f32),
                    );
                    let (level, angle) = (rng.random_range(20.0..235.0f32), rng.random_range(0.0..3.2f32));
                    let bar = rng.random::<bool>();
                    for ((y, x), v) in plane.indexed_iter_mut() {
                        let (dx, dy) = (x as f32 - cx, y as f32 - cy);
                        let (along, across) =
                            (dx * angle.cos() + dy * angle.sin(), dy * angle.cos() - dx * angle.sin());
                        let inside = if bar { along.abs() < r && across.abs() < 3.0 } else { dx.hypot(dy) < r };
                        if inside {
                            *v = level;
                        }
                    }
                }
                let path = folder.join(format!("{n}.png"));
                image::GrayImage::from_fn(150, 150, |x, y| image::Luma([plane[[y as usize, x as usize]] as u8]))
                    .save(&path)
                    .unwrap();
                path
            })
            .collect()
    }

    fn tiny() -> Parameters {
        Parameters {
            atoms: 32,
            patch: 5,
            window: 5,
            features: 16,
            epochs: 2,
            refine: 2,
            batch: 128,
            pairs: 3000,
            crop: 100,
            crops: 2,
            shrink: 1.0,
            footprints: vec![Footprint::Lenslet, Footprint::Point],
            anchors: 16,
            neighbours: 300,
            held_out: 3,
            network: Some(NetworkParameters {
                features: vec![12],
                window: 5,
                patch: 3,
                hidden: vec![24, 16],
                batch: 64,
                pairs: 4000,
                ..NetworkParameters::default()
            }),
            ..Parameters::default()
        }
    }

    fn bytes(outcome: &Outcome) -> Vec<u8> {
        dictionary::to_bytes(&outcome.dictionary).unwrap()
    }

    #[test]
    fn training_beats_the_low_image_on_photos_it_never_saw() {
        let folder = tempfile::tempdir().unwrap();
        let photos = photos(folder.path(), 6);
        for algorithm in [Algorithm::Online, Algorithm::Ksvd, Algorithm::Ista] {
            let parameters = Parameters { algorithm, footprints: vec![Footprint::Lenslet], ..tiny() };
            let outcome = train(&photos, &parameters, None, false, &Silent, &mut |_| ()).unwrap();
            let last = outcome.trace.last().unwrap();
            assert_eq!(last.stage, "done");
            let (learned, low) = (last.held_out_psnr.unwrap(), last.low_psnr.unwrap());
            assert!(learned > low + 0.5, "{algorithm:?}: {learned} dB from {low} dB");
            let network = last.network_psnr.unwrap();
            assert!(network > low + 0.1, "{network} dB from {low} dB by the network");
            assert!(dictionary::validate(&outcome.dictionary).is_ok());
        }
    }

    #[test]
    fn threads_do_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let photos = photos(folder.path(), 3);
        let parameters = Parameters { footprints: vec![Footprint::Point], ..tiny() };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bytes(&train(&photos, &parameters, None, false, &Silent, &mut |_| ()).unwrap()))
        };
        assert_eq!(run(1), run(3));
    }

    /// Asks to stop once this many epochs have been reported.
    struct Stop(AtomicUsize, usize);

    impl Observer for Stop {
        fn note(&self, _: &str) {
            self.0.fetch_add(1, Ordering::SeqCst);
        }
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::SeqCst) >= self.1
        }
    }

    #[test]
    fn a_resumed_run_gives_what_the_uninterrupted_one_gives() {
        let folder = tempfile::tempdir().unwrap();
        let photos = photos(folder.path(), 3);
        let parameters = tiny();
        let whole = train(&photos, &parameters, None, false, &Silent, &mut |_| ()).unwrap();
        let path = folder.path().join("checkpoint");
        for after in [1, 3, 5, 6, 9] {
            let stop = Stop(AtomicUsize::new(0), after);
            let cut = train(&photos, &parameters, Some(&path), false, &stop, &mut |_| ());
            assert!(matches!(cut, Err(Error::Interrupted)), "after {after}");
            let resumed = train(&photos, &parameters, Some(&path), true, &Silent, &mut |_| ()).unwrap();
            assert_eq!(bytes(&resumed), bytes(&whole), "after {after}");
            assert_eq!(resumed.trace.len(), whole.trace.len());
        }
        let other = Parameters { seed: 2, ..tiny() };
        let refused = train(&photos, &other, Some(&path), true, &Silent, &mut |_| ());
        assert!(matches!(refused, Err(Error::Checkpoint { .. })));
        std::fs::write(&path, b"no checkpoint").unwrap();
        let refused = train(&photos, &parameters, Some(&path), true, &Silent, &mut |_| ());
        assert!(matches!(refused, Err(Error::Checkpoint { .. })));
    }

    #[test]
    fn what_cannot_be_learned_from_is_said() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("text.png"), b"text").unwrap();
        image::GrayImage::from_pixel(200, 200, image::Luma([9])).save(folder.path().join("flat.png")).unwrap();
        let all = [folder.path().to_path_buf()];
        let error = train(&all, &tiny(), None, false, &Silent, &mut |_| ()).unwrap_err().to_string();
        assert!(error.contains("flat.png") && error.contains("text.png"), "{error}");
        let wrong = Parameters { atoms: 1, ..tiny() };
        assert!(matches!(train(&all, &wrong, None, false, &Silent, &mut |_| ()), Err(Error::Parameter(_))));
    }
}
