//! What is done to a capture on the way to scored views: the parameters that experiments vary.

use lenslet_core::calibration::CalibrationVariant;
use lenslet_core::decode::{Demosaic, RawStep, Steps};
use lenslet_train::Algorithm;
use serde::{Serialize, Serializer};

use super::method::Method;

/// A dictionary trained for the run; what is not named is as the trainer has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Training {
    /// Atoms K.
    pub atoms: usize,
    /// Side of a patch.
    pub patch: usize,
    /// λ.
    pub lambda: f32,
    /// Principal components kept.
    pub features: usize,
    /// Training pairs.
    pub pairs: usize,
    /// Trainer.
    pub algorithm: Algorithm,
    /// Low and high part together (eq. (3)) or one after the other.
    pub joint: bool,
}

/// A chain of steps from a capture to views. Everything that is compared is a value of one of these.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chain {
    /// Which centres.
    #[serde(serialize_with = "calibration_name")]
    pub calibration: CalibrationVariant,
    /// Divide by the white image.
    pub vignetting: bool,
    /// How colours are filled in.
    #[serde(serialize_with = "demosaic_name")]
    pub demosaic: Demosaic,
    /// Rotate the demosaiced raw and resample it, as printed in Algorithm 1.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub rotate_raw: bool,
    /// Views a row and column.
    pub views: usize,
    /// Samples to views.
    #[serde(rename = "way")]
    pub method: Method,
    /// Strength of the simulated noise; 0.7 is the simulator's usual one.
    pub noise: f64,
    /// Train a dictionary for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub training: Option<Training>,
}

impl Default for Chain {
    fn default() -> Self {
        Chain {
            calibration: CalibrationVariant::Full,
            vignetting: true,
            demosaic: Demosaic::CoKriging,
            rotate_raw: false,
            views: 7,
            method: Method::Barycentric,
            noise: 0.7,
            training: None,
        }
    }
}

impl Chain {
    /// The decoder's steps for this chain.
    pub fn steps(&self) -> Steps {
        let mut steps = Steps { demosaic: self.demosaic, ..Steps::default() };
        steps.raw.retain(|s| self.vignetting || *s != RawStep::Vignetting);
        steps
    }
}

fn calibration_name<S: Serializer>(variant: &CalibrationVariant, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(variant.name())
}

fn demosaic_name<S: Serializer>(demosaic: &Demosaic, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(demosaic.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_turn_into_steps() {
        let chain = Chain { vignetting: false, demosaic: Demosaic::Bilinear, ..Chain::default() };
        let steps = chain.steps();
        assert!(!steps.raw.contains(&RawStep::Vignetting) && steps.demosaic == Demosaic::Bilinear);
    }

    #[test]
    fn records_keep_their_names() {
        let json = serde_json::to_string(&Chain::default()).unwrap();
        let expected = r#"{"calibration":"full","vignetting":true,"demosaic":"lenslet","views":7,"way":"barycentric","noise":0.7}"#;
        assert_eq!(json, expected);
    }
}
