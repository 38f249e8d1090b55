//! Export of dictionaries to formats that other tools read: safetensors, and one .npy a matrix.

use std::collections::HashMap;
use std::path::Path;

use ndarray::ArrayViewD;
use safetensors::tensor::{Dtype, TensorView};

use super::{Dictionary, Error};
use crate::output::Pending;

/// Every matrix with its name: `MODEL.PASS.WHAT`, as in the .lfd file; anchored maps always as f32.
fn matrices(dictionary: &Dictionary) -> Vec<(String, ArrayViewD<'_, f32>)> {
    let mut all = Vec::new();
    for (i, model) in dictionary.models.iter().enumerate() {
        for (j, pass) in model.passes.iter().enumerate() {
            let name = |what: &str| format!("{i}.{j}.{what}");
            for (what, a) in
                [("filters", &pass.filters), ("low", &pass.low), ("high", &pass.high), ("linear", &pass.linear)]
            {
                all.push((name(what), a.view().into_dyn()));
            }
            if let Some(a) = &pass.anchored {
                all.push((name("anchors"), a.anchors.view().into_dyn()));
                all.push((name("maps"), a.maps.view().into_dyn()));
            }
            if let Some(n) = &pass.network {
                all.push((name("network.filters"), n.filters.view().into_dyn()));
                for (k, layer) in n.layers.iter().enumerate() {
                    all.push((name(&format!("network.{k}.weights")), layer.weights.view().into_dyn()));
                    all.push((name(&format!("network.{k}.bias")), layer.bias.view().into_dyn()));
                }
            }
        }
    }
    all
}

/// What is not a matrix, as strings: recipe (JSON), and for every pass its numbers.
fn metadata(dictionary: &Dictionary) -> Result<Vec<(String, String)>, Error> {
    let recipe = serde_json::to_string(&dictionary.recipe).map_err(|e| Error::Parameter(e.to_string()))?;
    let mut all = vec![("recipe".to_string(), recipe)];
    for (i, model) in dictionary.models.iter().enumerate() {
        all.push((
            format!("{i}"),
            format!("footprint {}, base {}, pitch {}", model.footprint, model.base, model.pitch),
        ));
        for (j, pass) in model.passes.iter().enumerate() {
            let (s, p, floor, lambda, linear) = (pass.support, pass.patch, pass.floor, pass.lambda, pass.with_linear);
            let text = format!("support {s}, patch {p}, floor {floor}, lambda {lambda}, with_linear {linear}");
            all.push((format!("{i}.{j}"), text));
            if let Some(n) = &pass.network {
                let beside: Vec<String> = n.beside.iter().map(ToString::to_string).collect();
                let text = format!(
                    "support {}, floor {}, filters {:?} of the low image and of its differences to: {}",
                    n.support,
                    n.floor,
                    n.shares,
                    beside.join(", ")
                );
                all.push((format!("{i}.{j}.network"), text));
            }
        }
    }
    Ok(all)
}

/// Writes a dictionary as one .safetensors file.
///
/// # Errors
/// When it cannot be encoded or written.
pub fn export_safetensors(path: &Path, dictionary: &Dictionary, force: bool) -> Result<(), Error> {
    let wrong = |e: safetensors::SafeTensorError| Error::Parameter(e.to_string());
    let bytes: Vec<(String, Vec<usize>, Vec<u8>)> = matrices(dictionary)
        .into_iter()
        .map(|(name, a)| (name, a.shape().to_vec(), a.iter().flat_map(|v| v.to_le_bytes()).collect()))
        .collect();
    let mut views = Vec::new();
    for (name, shape, bytes) in &bytes {
        views.push((name.as_str(), TensorView::new(Dtype::F32, shape.clone(), bytes).map_err(wrong)?));
    }
    let information: HashMap<String, String> = metadata(dictionary)?.into_iter().collect();
    let file = safetensors::serialize(views, Some(information)).map_err(wrong)?;
    Ok(crate::output::write_file(path, force, &file)?)
}

/// Writes a dictionary as a folder of .npy files and `dictionary.json`.
///
/// # Errors
/// When it cannot be encoded or written.
pub fn export_npy(path: &Path, dictionary: &Dictionary, force: bool) -> Result<(), Error> {
    let pending = Pending::directory(path, force)?;
    let io = |source| Error::Output(crate::output::Error::Io { path: path.to_path_buf(), source });
    for (name, a) in matrices(dictionary) {
        ndarray_npy::write_npy(pending.path().join(format!("{name}.npy")), &a)
            .map_err(|e| io(std::io::Error::other(e)))?;
    }
    let information: serde_json::Map<String, serde_json::Value> =
        metadata(dictionary)?.into_iter().map(|(k, v)| (k, v.into())).collect();
    let text = serde_json::to_string_pretty(&information).map_err(|e| Error::Parameter(e.to_string()))?;
    std::fs::write(pending.path().join("dictionary.json"), text).map_err(io)?;
    Ok(pending.commit()?)
}
