//! The parameters of training, one type for all algorithms.

use lenslet_core::dictionary::{Footprint, Interpolation, Storage};
use serde::{Deserialize, Serialize};

use super::{Error, NetworkParameters};

/// How the dictionary of eq. (3) is learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// Approximate K-SVD with Batch-OMP codes (Aharon 2006, Rubinstein 2008).
    Ksvd,
    /// Online learning with LASSO codes (Mairal 2009).
    Online,
    /// Proximal gradient codes of the whole set in turn with block coordinate descent on the atoms.
    Ista,
}

/// How Dh and Dl are coupled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Coupling {
    /// Both at once on stacked pairs, eq. (3).
    Joint,
    /// Dl on the features alone, then Dh by least squares (Zeyde 2010).
    Low,
}

/// Parameters of training.
///
/// | name | default | purpose | range |
/// |---|---|---|---|
/// | `atoms` | 512 | atoms K of Dl and Dh | 2 … 8192 |
/// | `patch` | 9 | side of a residual patch, pixels | odd, 3 … 25 |
/// | `window` | 9 | side of the window whose gradients are features | odd, 3 … 25, ≥ patch − 4 |
/// | `features` | 48 | principal components kept, m | 2 … (window+4)² − 1 |
/// | `lambda` | 0.2 | λ of eq. (3) and (4), for unit signals | 0.001 … 0.9 |
/// | `nonzeros` | 4 | non-zeros a pair of `ksvd` | 1 … 64 |
/// | `algorithm` | online | see [`Algorithm`] | |
/// | `coupling` | joint | see [`Coupling`] | |
/// | `epochs` | 3 | passes over the pairs | 1 … 1000 |
/// | `batch` | 1024 | pairs between two updates of the atoms (`online`), and of a refinement step | 16 … 65536 |
/// | `refine` | 6 | epochs of joint refinement of Dl and Dh through the active set | 0 … 1000 |
/// | `rate` | 0.03 | first step of refinement, as a part of the atoms' own size | 0 … 1 |
/// | `emphasis` | 1 | weight of a pair in fitting: its feature norm to this power | 0 … 2 |
/// | `pairs` | 200 000 | training pairs | 100 … 20 000 000 |
/// | `crop` | 256 | side of a crop, pixels | 32 … 4096 |
/// | `crops` | 6 | crops a photo | 1 … 10 000 |
/// | `shrink` | 1.5 | photos are shrunk by this first | 1 … 16 |
/// | `footprints` | lenslet, point | one model each | |
/// | `base` | by footprint | interpolation of the low images: barycentric, bicubic for grids; multiview only where the caller makes them | |
/// | `pitch`, `rotation` | 1080/328, 0.002 | the lattice, output pixels and radians | pitch 1 … 64 |
/// | `noise` | 0 | standard deviation of noise on the samples (range 0..1) | 0 … 1 |
/// | `passes` | 1 | always 1 (kept for recipes of earlier versions) | 1 |
/// | `with_linear` | false | always false (kept for recipes of earlier versions) | false |
/// | `anchors` | 512 | anchored regressors of the fast path, 0 for none | 0 … 8192 |
/// | `neighbours` | 2048 | pairs each regressor is fitted to | 16 … 1 000 000 |
/// | `ridge` | 0.1 | regularisation of the anchored regressors, for unit features | > 0 |
/// | `held_out` | 8 | every n-th photo is kept for scores; of fewer photos the last one, or a quarter of each | 0 (none), 2 … |
/// | `linear_light` | false | photos hold linear light, not sRGB-encoded values | |
/// | `memory` | 4 | GiB that pairs and crops may take: fewer pairs where they would not fit | 0.05 … 1024 |
/// | `storage` | i8 | how anchored maps are stored | |
/// | `network` | none | a network beside the dictionary: see [`NetworkParameters`] | |
/// | `seed` | 1 | seed of the ChaCha8 generators | |
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // the table above says it
pub struct Parameters {
    pub atoms: usize,
    pub patch: usize,
    pub window: usize,
    pub features: usize,
    pub lambda: f32,
    pub nonzeros: usize,
    pub algorithm: Algorithm,
    pub coupling: Coupling,
    pub epochs: usize,
    pub batch: usize,
    pub refine: usize,
    pub rate: f32,
    pub emphasis: f32,
    pub pairs: usize,
    pub crop: usize,
    pub crops: usize,
    pub shrink: f64,
    pub footprints: Vec<Footprint>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<Interpolation>,
    pub pitch: f64,
    pub rotation: f64,
    pub noise: f32,
    pub passes: usize,
    pub with_linear: bool,
    pub anchors: usize,
    pub neighbours: usize,
    pub ridge: f32,
    pub held_out: usize,
    #[serde(skip_serializing_if = "no")]
    pub linear_light: bool,
    #[serde(skip_serializing_if = "usual")]
    pub memory: f64,
    pub storage: Storage,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<NetworkParameters>,
    pub seed: u64,
}

/// GiB of `memory` unless told otherwise.
const MEMORY: f64 = 4.0;

/// Options that came later are written only where they are used: recipes that do without them keep their bytes.
fn no(value: &bool) -> bool {
    !value
}

fn usual(memory: &f64) -> bool {
    *memory == MEMORY
}

impl Default for Parameters {
    fn default() -> Self {
        Parameters {
            atoms: 512,
            patch: 9,
            window: 9,
            features: 48,
            lambda: 0.2,
            nonzeros: 4,
            algorithm: Algorithm::Online,
            coupling: Coupling::Joint,
            epochs: 3,
            batch: 1024,
            refine: 6,
            rate: 0.03,
            emphasis: 1.0,
            pairs: 200_000,
            crop: 256,
            crops: 6,
            shrink: 1.5,
            footprints: vec![Footprint::Lenslet, Footprint::Point],
            base: None,
            pitch: 1080.0 / 328.0,
            rotation: 0.002,
            noise: 0.0,
            passes: 1,
            with_linear: false,
            anchors: 512,
            neighbours: 2048,
            ridge: 0.1,
            held_out: 8,
            linear_light: false,
            memory: MEMORY,
            storage: Storage::I8,
            network: None,
            seed: 1,
        }
    }
}

impl Parameters {
    /// Checks every range of the table.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the name, the value and the range.
    pub fn check(&self) -> Result<(), Error> {
        fn within<T: PartialOrd + std::fmt::Display>(name: &str, value: T, low: T, high: T) -> Result<(), Error> {
            if value >= low && value <= high {
                return Ok(());
            }
            Err(Error::Parameter(format!("{name} {value} is out of range ({low} to {high})")))
        }
        let odd = |name: &str, n: usize| {
            within(name, n, 3, 25)?;
            if n % 2 == 1 { Ok(()) } else { Err(Error::Parameter(format!("{name} {n} must be odd"))) }
        };
        within("atoms", self.atoms, 2, 8192)?;
        odd("patch", self.patch)?;
        odd("window", self.window)?;
        within("patch", self.patch, 3, self.window + 4)?;
        within("features", self.features, 2, (self.window + 4).pow(2) - 1)?;
        within("lambda", self.lambda, 0.001, 0.9)?;
        within("nonzeros", self.nonzeros, 1, 64)?;
        within("epochs", self.epochs, 1, 1000)?;
        within("batch", self.batch, 16, 65_536)?;
        within("refine", self.refine, 0, 1000)?;
        within("rate", self.rate, 0.0, 1.0)?;
        within("emphasis", self.emphasis, 0.0, 2.0)?;
        within("pairs", self.pairs, 100, 20_000_000)?;
        within("crop", self.crop, 32, 4096)?;
        within("crops", self.crops, 1, 10_000)?;
        within("shrink", self.shrink, 1.0, 16.0)?;
        within("pitch", self.pitch, 1.0, 64.0)?;
        within("rotation", self.rotation, -std::f64::consts::PI, std::f64::consts::PI)?;
        within("noise", self.noise, 0.0, 1.0)?;
        if self.passes != 1 || self.with_linear {
            return Err(Error::Parameter(
                "passes above 1 and with_linear are no longer supported: leave both out".into(),
            ));
        }
        within("anchors", self.anchors, 0, 8192)?;
        within("neighbours", self.neighbours, 16, 1_000_000)?;
        within("ridge", self.ridge, 1e-6, 1e6)?;
        within("memory", self.memory, 0.05, 1024.0)?;
        self.network.as_ref().map_or(Ok(()), NetworkParameters::check)?;
        if self.base != Some(Interpolation::Multiview) && self.network.as_ref().is_some_and(|n| !n.beside.is_empty()) {
            return Err(Error::Parameter("network: images beside the low one need the base multiview".into()));
        }
        if self.held_out == 1 {
            return Err(Error::Parameter("held_out 1 would leave no photo to learn from".into()));
        }
        if self.footprints.is_empty() || self.footprints.len() > 4 {
            return Err(Error::Parameter("one to four footprints are needed".into()));
        }
        Ok(())
    }

    /// Pairs that `memory` allows beside crops of `crop_bytes`: their features and residuals once, and once more where both
    /// are stacked.
    #[must_use]
    pub fn pairs_within(&self, crop_bytes: usize) -> usize {
        let copies = if self.coupling == Coupling::Joint { 2.0 } else { 1.5 };
        let each = copies * 4.0 * (self.features + self.patch * self.patch) as f64;
        self.pairs.min((self.left(crop_bytes) / each) as usize)
    }

    /// Pairs of a network that `memory` allows beside crops of `crop_bytes`: their inputs twice, their targets once.
    #[must_use]
    pub fn network_pairs_within(&self, network: &NetworkParameters, crop_bytes: usize) -> usize {
        let inputs = network.features.iter().sum::<usize>() + 1;
        let each = 4.0 * (2 * inputs + network.patch * network.patch) as f64;
        network.pairs.min((self.left(crop_bytes) / each) as usize)
    }

    /// Bytes of `memory` beside crops; a fifth is for statistics, codes in work and everything else.
    fn left(&self, crop_bytes: usize) -> f64 {
        (0.8 * self.memory * f64::from(1u32 << 30) - crop_bytes as f64).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_budget_allows_fewer_pairs() {
        let p = Parameters { pairs: 20_000_000, ..Parameters::default() };
        let most = p.pairs_within(0);
        assert!(most > 1_000_000 && most < 4_000_000, "{most}");
        let half = Parameters { memory: 2.0, ..p.clone() }.pairs_within(0);
        assert!((most as f64 / half as f64 - 2.0).abs() < 0.01);
        assert!(p.pairs_within(1 << 30) < most && p.pairs_within(usize::MAX) == 0);
        assert_eq!(Parameters::default().pairs_within(0), 200_000);
    }

    #[test]
    fn later_options_leave_old_recipes_as_they_were() {
        let text = serde_json::to_string(&Parameters::default()).unwrap();
        assert!(!text.contains("memory") && !text.contains("linear_light"));
        let back: Parameters = serde_json::from_str(r#"{"memory":1.5,"linear_light":true}"#).unwrap();
        assert!(serde_json::to_string(&back).unwrap().contains(r#""linear_light":true,"memory":1.5"#));
        assert!(Parameters { memory: f64::NAN, ..Parameters::default() }.check().is_err());
    }
}
