//! All parameters of a run together, and what must fit between their groups.

use lenslet_core::dictionary::Storage;
use lenslet_core::interpolation::Interpolation;
use lenslet_data_gen::pairs::CameraLattice;
use serde::{Deserialize, Serialize};

use super::anchors::AnchorParameters;
use super::degradation::DegradationParameters;
use super::dictionary::{Coupling, DictionaryParameters};
use super::network::NetworkParameters;
use super::pairs::PairParameters;
use super::record::ParametersRecord;
use super::refinement::RefinementParameters;
use crate::error::Error;

/// Parameters of a training run, in groups; each group has the table of its names, defaults and ranges. In JSON all
/// groups but `network` are one flat object whose members are the names of those tables.
///
/// ```
/// use lenslet_train::{Algorithm, DictionaryParameters, Parameters};
/// let parameters: Parameters = serde_json::from_str(r#"{ "atoms": 64, "algorithm": "ksvd", "pairs": 5000 }"#)?;
/// assert_eq!((parameters.dictionary.atoms, parameters.pairs.count), (64, 5000));
/// assert_eq!(parameters.dictionary.algorithm, Algorithm::Ksvd);
/// assert!(parameters.check().is_ok());
/// let even = DictionaryParameters { patch: 8, ..DictionaryParameters::default() };
/// assert!(Parameters { dictionary: even, ..parameters }.check().is_err());
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ParametersRecord", into = "ParametersRecord")]
pub struct Parameters {
    /// Atoms, and how they are learned.
    pub dictionary: DictionaryParameters,
    /// Joint refinement of Dl and Dh.
    pub refinement: RefinementParameters,
    /// Photos, crops and pairs.
    pub pairs: PairParameters,
    /// What the camera makes of a crop.
    pub degradation: DegradationParameters,
    /// Anchored regressors of the fast path.
    pub anchors: AnchorParameters,
    /// A network beside the dictionary; default none.
    pub network: Option<NetworkParameters>,
    /// How anchored maps are stored; default `i8`.
    pub storage: Storage,
    /// Seed of the ChaCha8 generators; default 1.
    pub seed: u64,
}

impl Default for Parameters {
    fn default() -> Self {
        Parameters {
            dictionary: DictionaryParameters::default(),
            refinement: RefinementParameters::default(),
            pairs: PairParameters::default(),
            degradation: DegradationParameters::default(),
            anchors: AnchorParameters::default(),
            network: None,
            storage: Storage::I8,
            seed: 1,
        }
    }
}

impl Parameters {
    /// Checks every range of the groups' tables.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the name, the value and the range.
    pub fn check(&self) -> Result<(), Error> {
        self.dictionary.check()?;
        self.refinement.check()?;
        self.pairs.check()?;
        self.degradation.check()?;
        self.anchors.check()?;
        let Some(network) = &self.network else { return Ok(()) };
        network.check()?;
        if self.degradation.base != Some(Interpolation::Multiview) && !network.side_inputs.is_empty() {
            return Err(Error::Parameter("network: side inputs (beside) need the base multiview".into()));
        }
        Ok(())
    }

    /// Pairs that `memory` allows beside crops of `crop_bytes`: their features and residuals once, and once more where
    /// both are stacked.
    #[must_use]
    pub fn pairs_within(&self, crop_bytes: usize) -> usize {
        let d = &self.dictionary;
        let copies = if d.coupling == Coupling::Joint { 2.0 } else { 1.5 };
        let bytes_of_pair = copies * 4.0 * (d.features + d.patch * d.patch) as f64;
        self.pairs.count.min((self.bytes_left(crop_bytes) / bytes_of_pair) as usize)
    }

    /// Pairs of a network that `memory` allows beside crops of `crop_bytes`: their inputs twice, their targets once.
    #[must_use]
    pub fn network_pairs_within(&self, network: &NetworkParameters, crop_bytes: usize) -> usize {
        let inputs = network.features.iter().sum::<usize>() + 1;
        let bytes_of_pair = 4.0 * (2 * inputs + network.patch * network.patch) as f64;
        network.pairs.min((self.bytes_left(crop_bytes) / bytes_of_pair) as usize)
    }

    /// Bytes of `memory` beside crops; a fifth is for statistics, codes in work and everything else.
    fn bytes_left(&self, crop_bytes: usize) -> f64 {
        (0.8 * self.pairs.memory * f64::from(1u32 << 30) - crop_bytes as f64).max(0.0)
    }
}

impl Default for ParametersRecord {
    fn default() -> Self {
        Parameters::default().into()
    }
}

impl From<Parameters> for ParametersRecord {
    fn from(parameters: Parameters) -> Self {
        let Parameters { dictionary, refinement, pairs, degradation, anchors, network, storage, seed } = parameters;
        ParametersRecord {
            atoms: dictionary.atoms,
            patch: dictionary.patch,
            window: dictionary.window,
            features: dictionary.features,
            lambda: dictionary.lambda,
            nonzeros: dictionary.nonzeros,
            algorithm: dictionary.algorithm,
            ksvd_update: dictionary.ksvd_update,
            coupling: dictionary.coupling,
            epochs: dictionary.epochs,
            batch: dictionary.batch,
            refine: refinement.epochs,
            rate: refinement.rate,
            emphasis: refinement.emphasis,
            pairs: pairs.count,
            crop: pairs.crop,
            crops: pairs.crops,
            shrink: pairs.shrink,
            footprints: degradation.footprints,
            base: degradation.base,
            pitch: degradation.pitch,
            rotation: degradation.rotation,
            noise: degradation.noise,
            lattice: degradation.lattice.map(|l| l.sha256().to_owned()),
            // No longer supported: chains of passes, and codes on top of a regressor. Recipes still have the keys.
            passes: 1,
            with_linear: false,
            anchors: anchors.count,
            neighbours: anchors.neighbours,
            ridge: anchors.ridge,
            held_out: pairs.held_out,
            linear_light: pairs.linear_light,
            memory: pairs.memory,
            storage,
            network,
            seed,
        }
    }
}

impl TryFrom<ParametersRecord> for Parameters {
    type Error = String;

    fn try_from(r: ParametersRecord) -> Result<Self, String> {
        if r.passes != 1 || r.with_linear {
            return Err("passes above 1 and with_linear are no longer supported: leave both out".into());
        }
        Ok(Parameters {
            dictionary: DictionaryParameters {
                atoms: r.atoms,
                patch: r.patch,
                window: r.window,
                features: r.features,
                lambda: r.lambda,
                nonzeros: r.nonzeros,
                algorithm: r.algorithm,
                ksvd_update: r.ksvd_update,
                coupling: r.coupling,
                epochs: r.epochs,
                batch: r.batch,
            },
            refinement: RefinementParameters { epochs: r.refine, rate: r.rate, emphasis: r.emphasis },
            pairs: PairParameters {
                count: r.pairs,
                crop: r.crop,
                crops: r.crops,
                shrink: r.shrink,
                held_out: r.held_out,
                linear_light: r.linear_light,
                memory: r.memory,
            },
            degradation: DegradationParameters {
                footprints: r.footprints,
                base: r.base,
                pitch: r.pitch,
                rotation: r.rotation,
                noise: r.noise,
                lattice: r.lattice.map(CameraLattice::named),
            },
            anchors: AnchorParameters { count: r.anchors, neighbours: r.neighbours, ridge: r.ridge },
            network: r.network,
            storage: r.storage,
            seed: r.seed,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_budget_allows_fewer_pairs() {
        let with_memory = |memory| {
            let pairs = PairParameters { count: 20_000_000, memory, ..PairParameters::default() };
            Parameters { pairs, ..Parameters::default() }
        };
        let p = with_memory(4.0);
        let most = p.pairs_within(0);
        assert!(most > 1_000_000 && most < 4_000_000, "{most}");
        let half = with_memory(2.0).pairs_within(0);
        assert!((most as f64 / half as f64 - 2.0).abs() < 0.01);
        assert!(p.pairs_within(1 << 30) < most && p.pairs_within(usize::MAX) == 0);
        assert_eq!(Parameters::default().pairs_within(0), 200_000);
        assert!(with_memory(f64::NAN).check().is_err());
    }

    #[test]
    fn later_options_leave_old_recipes_as_they_were() {
        let text = serde_json::to_string(&Parameters::default()).unwrap();
        assert_eq!(
            text,
            r#"{"atoms":512,"patch":9,"window":9,"features":48,"lambda":0.2,"nonzeros":4,"algorithm":"online","coupling":"joint","epochs":3,"batch":1024,"refine":6,"rate":0.03,"emphasis":1.0,"pairs":200000,"crop":256,"crops":6,"shrink":1.5,"footprints":["lenslet","point"],"pitch":3.292682926829268,"rotation":0.002,"noise":0.0,"passes":1,"with_linear":false,"anchors":512,"neighbours":2048,"ridge":0.1,"held_out":8,"storage":"i8","seed":1}"#
        );
        let back: Parameters = serde_json::from_str(r#"{"memory":1.5,"linear_light":true}"#).unwrap();
        assert!(serde_json::to_string(&back).unwrap().contains(r#""linear_light":true,"memory":1.5"#));
        let exact: Parameters = serde_json::from_str(r#"{"algorithm":"ksvd","ksvd_update":"exact"}"#).unwrap();
        assert!(serde_json::to_string(&exact).unwrap().contains(r#""algorithm":"ksvd","ksvd_update":"exact""#));
    }

    #[test]
    fn what_is_unknown_or_no_longer_supported_is_refused() {
        for text in [r#"{"atom":3}"#, r#"{"passes":2}"#, r#"{"with_linear":true}"#] {
            assert!(serde_json::from_str::<Parameters>(text).is_err(), "{text}");
        }
    }
}
