//! The stages of a training run: pairs → atoms by eq. (3) → Dh → refinement → anchors → network, one model a footprint,
//! with checkpoints and scores. Each stage has a separate random stream, so that a resumed run draws what the whole
//! one draws.

use std::borrow::Cow;
use std::path::Path;
use std::time::Instant;

use lenslet_core::dictionary::{Dictionary, Footprint, Model, PatchModel, PatchPredictor, Recipe, Storage};
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::{Crop, Degradation};
use ndarray::Array2;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use crate::atoms::initial_atoms;
use crate::checkpoint::{Checkpoint, Stage, save_checkpoint};
use crate::error::Error;
use crate::ksvd::ksvd_epoch;
use crate::normalised_pairs::{NormalisedPairs, prepare_pairs};
use crate::observed::advance;
use crate::online::{OnlineState, batch_epoch, online_epoch};
use crate::optimiser::cosine_annealed;
use crate::parameters::{Algorithm, Coupling, Parameters};
use crate::predictors::{Fitting, fit_to_crops, fit_to_pairs};
use crate::refine::{RefinementProblem, RefinementState, least_squares_high, refinement_epoch};
use crate::scorer::Scorer;
use crate::stacked_pairs::{split_atoms, stack_pairs};
use crate::trace::{Epoch, EpochSummary};
use crate::training_crops::TrainingCrops;

/// Random streams of the stages; those of epochs count on from theirs, and those of [`crate::predictors`] follow.
const ATOM_STREAM: u64 = 0;
const LEARN_STREAM: u64 = 0x1000;
const REFINE_STREAM: u64 = 0x2000;

/// A training run: its parameters, and where it is.
pub struct Run<'a> {
    parameters: &'a Parameters,
    observer: &'a dyn Observer,
    log: &'a mut dyn FnMut(&Epoch),
    path: Option<&'a Path>,
    state: Checkpoint,
    started: Instant,
}

/// PSNR on the held-out crops, dB.
struct Scores {
    learned: Option<f64>,
    low: Option<f64>,
    network: Option<f64>,
}

impl<'a> Run<'a> {
    /// The run that starts from, or goes on from, `state`.
    pub fn new(
        parameters: &'a Parameters,
        observer: &'a dyn Observer,
        log: &'a mut dyn FnMut(&Epoch),
        path: Option<&'a Path>,
        state: Checkpoint,
    ) -> Self {
        Run { parameters, observer, log, path, state, started: Instant::now() }
    }

    /// Where the run is.
    pub fn state(&self) -> &Checkpoint {
        &self.state
    }

    /// Where the run ended.
    pub fn into_state(self) -> Checkpoint {
        self.state
    }

    /// Learns the model of one footprint and adds it to those that are done.
    ///
    /// # Errors
    /// As [`crate::train_dictionary`].
    pub fn learn_model(&mut self, footprint: Footprint, crops: &TrainingCrops) -> Result<(), Error> {
        let p = self.parameters;
        let degradation = p.degradation.for_footprint(footprint);
        if self.state.at.1 == 0 {
            let patch_model = self.learn_patch_model(footprint, &crops.train, &crops.held_out, &degradation)?;
            let finished = Model { footprint, base: degradation.base, pitch: degradation.pitch, patch_model };
            let done = self.state.done.get_or_insert_with(|| Dictionary {
                recipe: Recipe::default(),
                storage: Storage::F32,
                models: Vec::new(),
            });
            done.models.truncate(self.state.at.0);
            done.models.push(finished);
            self.state.at.1 = 1;
            self.state.stage = None;
            self.save_state();
        }
        self.state.at = (self.state.at.0 + 1, 0);
        self.save_state();
        Ok(())
    }

    /// Saves the checkpoint. When that fails (a full disk may have room again after the next epoch) training goes on,
    /// and the checkpoint before stays.
    fn save_state(&self) {
        if let Some(path) = self.path
            && let Err(e) = save_checkpoint(path, &self.state)
        {
            self.observer.note(&format!("no checkpoint of this epoch, training goes on: {e}"));
        }
    }

    /// The random stream named `what` of the current model.
    fn random_stream(&self, what: u64) -> ChaCha8Rng {
        let (model, pass) = self.state.at;
        let mut rng = ChaCha8Rng::seed_from_u64(self.parameters.seed);
        rng.set_stream((3 << 62) | ((model as u64) << 40) | ((pass as u64) << 32) | what);
        rng
    }

    fn learn_patch_model(
        &mut self,
        footprint: Footprint,
        train: &[Crop],
        held_out: &[Crop],
        degradation: &Degradation,
    ) -> Result<PatchModel, Error> {
        let p = self.parameters;
        let pairs = prepare_pairs(train, p, self.observer)?;
        let scorer = Scorer::new(footprint, degradation, held_out, &pairs, p);
        let problem = RefinementProblem {
            signals: pairs.signals.view(),
            targets: pairs.targets.view(),
            weights: &pairs.weights,
            lambda: p.dictionary.lambda,
        };
        let (done, state) = match self.state.stage.take() {
            Some(Stage::Refine(done, state)) => (done, state),
            Some(Stage::Learn(done, state)) => {
                (0, self.learn_atoms(footprint, &pairs, &problem, &scorer, done, state)?)
            }
            None => {
                let first = self.first_atoms(&pairs)?;
                (0, self.learn_atoms(footprint, &pairs, &problem, &scorer, 0, first)?)
            }
        };
        let state = self.refine_atoms(footprint, &problem, &scorer, done, state)?;
        let refined = p.refinement.epochs > 0;
        let high = if refined { self.least_squares_high(&state.low, &problem)? } else { state.high };
        let psnr = scorer.score(&state.low, &high)?;
        let mut learned = scorer.patch_model.clone();
        learned.low = state.low;
        learned.high = high;
        let random_stream = |what| self.random_stream(what);
        let with = Fitting { footprint, parameters: p, observer: self.observer, random_stream: &random_stream };
        fit_to_pairs(&mut learned, &pairs, &with)?;
        drop(pairs);
        fit_to_crops(&mut learned, train, &with)?;
        let by_network = match learned.network {
            Some(_) => scorer.score_by(learned.clone(), PatchPredictor::Network)?,
            None => None,
        };
        let scores = Scores { learned: psnr, low: scorer.low, network: by_network };
        self.report(footprint, "done", 0, EpochSummary::default(), scores);
        Ok(learned)
    }

    /// The learning of the atoms from epoch `done` on, then Dh by least squares.
    fn learn_atoms(
        &mut self,
        footprint: Footprint,
        pairs: &NormalisedPairs,
        problem: &RefinementProblem<'_>,
        scorer: &Scorer<'_>,
        mut done: usize,
        mut state: OnlineState,
    ) -> Result<RefinementState, Error> {
        let (d, observer) = (&self.parameters.dictionary, self.observer);
        let stacked = match d.coupling {
            Coupling::Joint => Cow::Owned(stack_pairs(pairs)),
            Coupling::Low => Cow::Borrowed(&pairs.signals),
        };
        let signals = stacked.view();
        let mut step = |n: usize| advance(observer, n);
        while done < d.epochs {
            let mut rng = self.random_stream(LEARN_STREAM + done as u64);
            observer.begin(&format!("{footprint}: learn {}/{}", done + 1, d.epochs), signals.nrows() as u64);
            let summary = match d.algorithm {
                Algorithm::Ksvd => {
                    ksvd_epoch(&mut state.atoms, signals, d.nonzeros, d.ksvd_update, &mut rng, &mut step)?
                }
                Algorithm::Online => online_epoch(&mut state, signals, d.lambda, d.batch, &mut rng, &mut step)?,
                Algorithm::Ista => batch_epoch(&mut state, signals, d.lambda, &mut rng, &mut step)?,
            };
            done += 1;
            let (low, high) = split_atoms(&state.atoms, pairs, d.coupling);
            // Dl alone has no Dh to be scored with before the least squares.
            let learned = match high {
                Some(high) => scorer.score(&low, &high)?,
                None => None,
            };
            self.report(footprint, "learn", done, summary, Scores { learned, low: scorer.low, network: None });
            self.state.stage = Some(Stage::Learn(done, state.clone()));
            self.save_state();
        }
        let (low, _) = split_atoms(&state.atoms, pairs, d.coupling);
        let high = self.least_squares_high(&low, problem)?;
        Ok(RefinementState::new(low, high))
    }

    /// The joint refinement from epoch `done` on.
    fn refine_atoms(
        &mut self,
        footprint: Footprint,
        problem: &RefinementProblem<'_>,
        scorer: &Scorer<'_>,
        mut done: usize,
        mut state: RefinementState,
    ) -> Result<RefinementState, Error> {
        let (r, batch, observer) = (&self.parameters.refinement, self.parameters.dictionary.batch, self.observer);
        let mut step = |n: usize| advance(observer, n);
        while done < r.epochs {
            let mut rng = self.random_stream(REFINE_STREAM + done as u64);
            observer.begin(&format!("{footprint}: refine {}/{}", done + 1, r.epochs), problem.signals.nrows() as u64);
            let rate = |epoch: usize| r.rate * cosine_annealed(epoch as f32 / r.epochs as f32);
            let rates = (rate(done), rate(done + 1));
            let (objective, nonzeros) = refinement_epoch(&mut state, problem, batch, rates, &mut rng, &mut step)?;
            done += 1;
            let learned = scorer.score(&state.low, &state.high)?;
            let summary = EpochSummary { objective, nonzeros, replaced: 0 };
            self.report(footprint, "refine", done, summary, Scores { learned, low: scorer.low, network: None });
            self.state.stage = Some(Stage::Refine(done, state.clone()));
            self.save_state();
        }
        Ok(state)
    }

    fn least_squares_high(&self, low: &Array2<f32>, problem: &RefinementProblem<'_>) -> Result<Array2<f32>, Error> {
        self.observer.begin("least squares Dh", problem.signals.nrows() as u64);
        least_squares_high(low, problem, &mut |n| advance(self.observer, n))
    }

    fn first_atoms(&self, pairs: &NormalisedPairs) -> Result<OnlineState, Error> {
        let (d, mut rng) = (&self.parameters.dictionary, self.random_stream(ATOM_STREAM));
        let atoms = match d.coupling {
            Coupling::Joint => initial_atoms(&stack_pairs(pairs), d.atoms, &mut rng)?,
            Coupling::Low => initial_atoms(&pairs.signals, d.atoms, &mut rng)?,
        };
        Ok(OnlineState::new(atoms))
    }

    /// Logs one epoch and adds it to the trace.
    fn report(&mut self, footprint: Footprint, stage: &str, epoch: usize, summary: EpochSummary, scores: Scores) {
        let record = Epoch {
            footprint,
            pass: 1,
            stage: stage.into(),
            epoch,
            objective: summary.objective,
            nonzeros: summary.nonzeros,
            replaced: summary.replaced,
            held_out_psnr: scores.learned,
            low_psnr: scores.low,
            network_psnr: scores.network,
            seconds: self.started.elapsed().as_secs_f64(),
        };
        let decibels = |v: Option<f64>| v.map_or("none".into(), |v| format!("{v:.3} dB"));
        let network = scores.network.map_or(String::new(), |v| format!(", by the network {v:.3} dB"));
        self.observer.note(&format!(
            "{footprint}, {stage} {epoch}: objective {:.6}, {:.2} non-zeros, {} replaced, \
             held-out {}{network} (low image {}), {:.0} s",
            summary.objective,
            summary.nonzeros,
            summary.replaced,
            decibels(scores.learned),
            decibels(scores.low),
            record.seconds
        ));
        (self.log)(&record);
        self.state.trace.push(record);
    }
}
