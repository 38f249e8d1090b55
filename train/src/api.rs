//! The way into the crate: photos or crops in, a dictionary out.

use std::path::{Path, PathBuf};

use lenslet_core::dictionary::{Dictionary, Footprint};
use lenslet_core::progress::Observer;

use crate::checkpoint::{Checkpoint, Key, load_checkpoint};
use crate::error::Error;
use crate::parameters::Parameters;
use crate::recipe::training_recipe;
use crate::run::Run;
use crate::trace::Epoch;
use crate::training_crops::{TrainingCrops, cut_training_crops};

/// What a run gives.
#[derive(Debug, Clone)]
pub struct TrainingOutcome {
    /// The dictionary.
    pub dictionary: Dictionary,
    /// All epochs.
    pub trace: Vec<Epoch>,
    /// Photos left out, and why.
    pub skipped: Vec<String>,
}

/// Trains a dictionary on the photos (files, or folders that are searched).
///
/// With a `checkpoint` file, the state is saved there after every epoch; with `resume` a run goes on from it, to the
/// very dictionary that the uninterrupted run gives. `log` is called with every epoch, first with those of the
/// checkpoint. A checkpoint that cannot be written is noted, and training goes on.
///
/// # Errors
/// Parameters out of range, no usable photo, a checkpoint of another run, [`Error::Interrupted`].
pub fn train_dictionary(
    photos: &[PathBuf],
    parameters: &Parameters,
    checkpoint: Option<&Path>,
    resume: bool,
    observer: &dyn Observer,
    log: &mut dyn FnMut(&Epoch),
) -> Result<TrainingOutcome, Error> {
    let mut gather = |footprint, observer: &dyn Observer| cut_training_crops(photos, parameters, footprint, observer);
    train_on_crops(&mut gather, parameters, checkpoint, resume, observer, log)
}

/// [`train_dictionary`] on crops that `gather` makes for a footprint, the same ones at every call. Their low images are
/// `parameters.degradation.base`.
///
/// # Errors
/// As [`train_dictionary`]; errors of `gather`.
pub fn train_on_crops(
    gather: &mut dyn FnMut(Footprint, &dyn Observer) -> Result<TrainingCrops, Error>,
    parameters: &Parameters,
    checkpoint: Option<&Path>,
    resume: bool,
    observer: &dyn Observer,
    log: &mut dyn FnMut(&Epoch),
) -> Result<TrainingOutcome, Error> {
    parameters.check()?;
    let mut crops = gather(parameters.degradation.footprints[0], observer)?;
    let skipped = crops.skipped.clone();
    let key = Key { version: 1, parameters: parameters.clone(), photos: crops.photos.clone() };
    let state = match checkpoint {
        Some(path) if resume => load_checkpoint(path, &key)?,
        _ => Checkpoint { key, done: None, at: (0, 0), stage: None, trace: Vec::new() },
    };
    state.trace.iter().for_each(&mut *log);
    let mut run = Run::new(parameters, observer, log, checkpoint, state);
    for (m, &footprint) in parameters.degradation.footprints.iter().enumerate() {
        if run.state().at.0 != m {
            continue;
        }
        if m > 0 {
            crops = gather(footprint, &Quiet(observer))?;
        }
        run.learn_model(footprint, &crops)?;
    }
    let state = run.into_state();
    let Some(mut dictionary) = state.done else { return Err(Error::TooLittle("nothing was trained".into())) };
    dictionary.recipe = training_recipe(parameters, &state.key.photos, &state.trace)?;
    dictionary.storage = parameters.storage;
    Ok(TrainingOutcome { dictionary, trace: state.trace, skipped })
}

/// Passes everything on but notes, so that a photo that is left out is noted once.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::{
        Algorithm, AnchorParameters, DegradationParameters, DictionaryParameters, NetworkParameters, PairParameters,
        RefinementParameters,
    };
    use lenslet_core::progress::Silent;
    use ndarray::Array2;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
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
            dictionary: DictionaryParameters {
                atoms: 32,
                patch: 5,
                window: 5,
                features: 16,
                epochs: 2,
                batch: 128,
                ..DictionaryParameters::default()
            },
            refinement: RefinementParameters { epochs: 2, ..RefinementParameters::default() },
            pairs: PairParameters {
                count: 3000,
                crop: 100,
                crops: 2,
                shrink: 1.0,
                held_out: 3,
                ..PairParameters::default()
            },
            anchors: AnchorParameters { count: 16, neighbours: 300, ..AnchorParameters::default() },
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

    /// [`tiny`] for one footprint.
    fn tiny_with(footprint: Footprint, algorithm: Algorithm) -> Parameters {
        let degradation = DegradationParameters { footprints: vec![footprint], ..DegradationParameters::default() };
        let dictionary = DictionaryParameters { algorithm, ..tiny().dictionary };
        Parameters { dictionary, degradation, ..tiny() }
    }

    fn bytes(outcome: &TrainingOutcome) -> Vec<u8> {
        lenslet_core::dictionary::to_bytes(&outcome.dictionary).unwrap()
    }

    #[test]
    fn training_beats_the_low_image_on_photos_it_never_saw() {
        let folder = tempfile::tempdir().unwrap();
        let photos = photos(folder.path(), 6);
        for algorithm in [Algorithm::Online, Algorithm::Ksvd, Algorithm::Ista] {
            let parameters = tiny_with(Footprint::Lenslet, algorithm);
            let outcome = train_dictionary(&photos, &parameters, None, false, &Silent, &mut |_| ()).unwrap();
            let last = outcome.trace.last().unwrap();
            assert_eq!(last.stage, "done");
            let (learned, low) = (last.held_out_psnr.unwrap(), last.low_psnr.unwrap());
            assert!(learned > low + 0.5, "{algorithm:?}: {learned} dB from {low} dB");
            let network = last.network_psnr.unwrap();
            assert!(network > low + 0.1, "{network} dB from {low} dB by the network");
            assert!(lenslet_core::dictionary::validate(&outcome.dictionary).is_ok());
        }
    }

    #[test]
    fn threads_do_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let photos = photos(folder.path(), 3);
        let parameters = tiny_with(Footprint::Point, Algorithm::Online);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bytes(&train_dictionary(&photos, &parameters, None, false, &Silent, &mut |_| ()).unwrap()))
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
        let whole = train_dictionary(&photos, &parameters, None, false, &Silent, &mut |_| ()).unwrap();
        let path = folder.path().join("checkpoint");
        for after in [1, 3, 5, 6, 9] {
            let stop = Stop(AtomicUsize::new(0), after);
            let cut = train_dictionary(&photos, &parameters, Some(&path), false, &stop, &mut |_| ());
            assert!(matches!(cut, Err(Error::Interrupted(_))), "after {after}");
            let resumed = train_dictionary(&photos, &parameters, Some(&path), true, &Silent, &mut |_| ()).unwrap();
            assert_eq!(bytes(&resumed), bytes(&whole), "after {after}");
            assert_eq!(resumed.trace.len(), whole.trace.len());
        }
        let other = Parameters { seed: 2, ..tiny() };
        let refused = train_dictionary(&photos, &other, Some(&path), true, &Silent, &mut |_| ());
        assert!(matches!(refused, Err(Error::Checkpoint { .. })));
        std::fs::write(&path, b"no checkpoint").unwrap();
        let refused = train_dictionary(&photos, &parameters, Some(&path), true, &Silent, &mut |_| ());
        assert!(matches!(refused, Err(Error::Checkpoint { .. })));
    }

    #[test]
    fn photos_that_cannot_train_are_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("text.png"), b"text").unwrap();
        image::GrayImage::from_pixel(200, 200, image::Luma([9])).save(folder.path().join("flat.png")).unwrap();
        let all = [folder.path().to_path_buf()];
        let error = train_dictionary(&all, &tiny(), None, false, &Silent, &mut |_| ()).unwrap_err().to_string();
        assert!(error.contains("flat.png") && error.contains("text.png"), "{error}");
        let wrong = Parameters { dictionary: DictionaryParameters { atoms: 1, ..tiny().dictionary }, ..tiny() };
        assert!(matches!(train_dictionary(&all, &wrong, None, false, &Silent, &mut |_| ()), Err(Error::Parameter(_))));
    }
}
