//! Export of a dictionary as a folder: one .npy per matrix, and `dictionary.json` with everything else.

use std::io::Write;
use std::path::Path;

use ndarray_npy::WriteNpyExt;

use super::super::error::Error;
use super::super::model::Dictionary;
use super::super::patch_model::matrices;
use super::super::validate::validate;
use super::quantise::model_names;
use super::safetensors::metadata;
use crate::output::{Pending, create_part, write_part};

/// Writes a dictionary as a folder of .npy files, named as the tensors of a `.safetensors` file
/// (`point.lasso.low_atoms.npy`), and `dictionary.json`. Anchored maps are always f32.
///
/// # Errors
/// [`Error::Parameter`] when it is not a valid dictionary; [`Error::Output`] when the folder exists (without `force`)
/// or cannot be written.
///
/// ```
/// use lenslet_core::dictionary;
///
/// # let bytes = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"));
/// # let folder = tempfile::tempdir()?;
/// # let out = folder.path().join("npy");
/// let dictionary = dictionary::from_bytes(bytes, "golden-1.lfd")?;
/// dictionary::export_npy(&out, &dictionary, false)?;
/// let atoms: ndarray::Array2<f32> = ndarray_npy::read_npy(out.join("point.lasso.low_atoms.npy"))?;
/// assert_eq!(atoms, dictionary.models[0].patch_model.low);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn export_npy(path: &Path, dictionary: &Dictionary, force: bool) -> Result<(), Error> {
    validate(dictionary)?;
    let pending = Pending::directory(path, force)?;
    let io = |source| Error::Output(crate::output::Error::Io { path: path.to_path_buf(), source });
    for (name, model) in model_names(dictionary).into_iter().zip(&dictionary.models) {
        for (which, values) in matrices(&model.patch_model) {
            let file = format!("{name}.{}.npy", which.tensor_name());
            let part = create_part(&pending.path().join(file)).map_err(io)?;
            let mut part = std::io::BufWriter::new(part);
            values.write_npy(&mut part).map_err(|e| io(std::io::Error::other(e)))?;
            part.flush().map_err(io)?;
        }
    }
    let text = serde_json::to_string_pretty(&metadata(dictionary)?).map_err(|e| Error::Parameter(e.to_string()))?;
    write_part(&pending.path().join("dictionary.json"), text.as_bytes()).map_err(io)?;
    Ok(pending.commit()?)
}

#[cfg(test)]
mod tests {
    use super::super::super::model::Storage;
    use super::super::super::validate::tests::small_dictionary;
    use super::*;

    #[test]
    fn the_folder_has_every_matrix_and_all_else_as_json() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("npy");
        let dictionary = Dictionary { storage: Storage::I8, ..small_dictionary(1) };
        export_npy(&out, &dictionary, false).unwrap();
        let model = &dictionary.models[0].patch_model;
        let high: ndarray::Array2<f32> = ndarray_npy::read_npy(out.join("point.lasso.high_atoms.npy")).unwrap();
        assert_eq!(high, model.high);
        let maps: ndarray::Array3<f32> = ndarray_npy::read_npy(out.join("point.anchored.maps.npy")).unwrap();
        assert_eq!(maps, model.anchored.as_ref().unwrap().maps);
        let text = std::fs::read(out.join("dictionary.json")).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&text).unwrap();
        assert_eq!((&json["storage"], &json["recipe"]["seed"]), (&"i8".into(), &1.into()));
        assert_eq!((&json["models"][0]["name"], &json["models"][0]["pitch"]), (&"point".into(), &3.3.into()));
        let names = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        assert_eq!(names.filter(|n| n.ends_with(".npy")).count(), matrices(model).len());
        assert!(export_npy(&out, &dictionary, false).is_err());
        assert!(export_npy(&out, &dictionary, true).is_ok());
    }
}
