//! The recipe that a learned dictionary carries.

use lenslet_core::dictionary::{Photo, Recipe};

use crate::error::Error;
use crate::parameters::Parameters;
use crate::trace::Epoch;

/// The recipe of a finished run: parameters, photos with their hashes, held-out scores; no times, which differ from run
/// to run.
///
/// # Errors
/// [`Error::Parameter`] for numbers that JSON cannot hold.
pub fn training_recipe(parameters: &Parameters, photos: &[Photo], trace: &[Epoch]) -> Result<Recipe, Error> {
    let wrong = |e: serde_json::Error| Error::Parameter(e.to_string());
    let parameters_json = serde_json::to_value(parameters).map_err(wrong)?;
    let mut scores = serde_json::Map::new();
    for e in trace.iter().filter(|e| e.stage == "done") {
        let mut value = serde_json::json!({ "low": e.low_psnr, "learned": e.held_out_psnr });
        if let Some(psnr) = e.network_psnr {
            value["network"] = psnr.into();
        }
        scores.insert(format!("held-out PSNR, {}, pass {}", e.footprint, e.pass), value);
    }
    Ok(Recipe {
        tool: format!("lenslet {}", env!("CARGO_PKG_VERSION")),
        algorithm: serde_json::to_value(parameters.dictionary.algorithm)
            .map_err(wrong)?
            .as_str()
            .unwrap_or_default()
            .into(),
        seed: parameters.seed,
        generator: "ChaCha8".into(),
        parameters: parameters_json.as_object().cloned().unwrap_or_default(),
        photos: photos.to_vec(),
        scores,
    })
}
