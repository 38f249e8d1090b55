//! Parameters as JSON has them: one flat object, in recipes, checkpoints and the files of `train-dict --parameters`.

use lenslet_core::dictionary::{Footprint, Storage};
use lenslet_core::interpolation::Interpolation;
use serde::{Deserialize, Serialize};

use super::dictionary::{Algorithm, Coupling, KsvdUpdate};
use super::network::NetworkParameters;
use super::pairs::PairParameters;

/// Every parameter under its name in JSON. The order is that of all recipes so far. Parameters that came later are
/// written only where they are used, so that recipes without them keep their bytes.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ParametersRecord {
    pub(super) atoms: usize,
    pub(super) patch: usize,
    pub(super) window: usize,
    pub(super) features: usize,
    pub(super) lambda: f32,
    pub(super) nonzeros: usize,
    pub(super) algorithm: Algorithm,
    #[serde(skip_serializing_if = "is_default")]
    pub(super) ksvd_update: KsvdUpdate,
    pub(super) coupling: Coupling,
    pub(super) epochs: usize,
    pub(super) batch: usize,
    pub(super) refine: usize,
    pub(super) rate: f32,
    pub(super) emphasis: f32,
    pub(super) pairs: usize,
    pub(super) crop: usize,
    pub(super) crops: usize,
    pub(super) shrink: f64,
    pub(super) footprints: Vec<Footprint>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) base: Option<Interpolation>,
    pub(super) pitch: f64,
    pub(super) rotation: f64,
    pub(super) noise: f32,
    pub(super) passes: usize,
    pub(super) with_linear: bool,
    pub(super) anchors: usize,
    pub(super) neighbours: usize,
    pub(super) ridge: f32,
    pub(super) held_out: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) lattice: Option<String>,
    #[serde(skip_serializing_if = "is_default")]
    pub(super) linear_light: bool,
    #[serde(skip_serializing_if = "is_default_memory")]
    pub(super) memory: f64,
    pub(super) storage: Storage,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) network: Option<NetworkParameters>,
    pub(super) seed: u64,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn is_default_memory(memory: &f64) -> bool {
    *memory == PairParameters::default().memory
}
