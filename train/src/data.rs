//! Photos to crops, split into those that train and those held out for scores.

use std::path::PathBuf;

use lenslet_core::dictionary::{Base, Footprint, Photo};
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::{Crop, Degradation, crops, find_photos, load_photo};

use super::{Error, Parameters};

/// Crops of one footprint.
#[derive(Debug, Clone)]
pub struct Data {
    /// Crops that train.
    pub train: Vec<Crop>,
    /// Crops of photos that do not.
    pub held_out: Vec<Crop>,
    /// The photos used.
    pub photos: Vec<Photo>,
    /// The photos left out, and why.
    pub skipped: Vec<String>,
}

/// How one footprint's low images come about.
pub fn degradation(parameters: &Parameters, footprint: Footprint) -> Degradation {
    let plain = if footprint == Footprint::Grid { Base::Bicubic } else { Base::Barycentric };
    let base = parameters.base.unwrap_or(plain);
    Degradation { pitch: parameters.pitch, rotation: parameters.rotation, footprint, base, noise: parameters.noise }
}

/// Reads the photos and cuts crops. A photo that cannot be used is noted and left out. One photo is in memory at a time.
///
/// # Errors
/// When no photo is left, or paths or parameters are wrong.
pub fn gather(
    inputs: &[PathBuf],
    parameters: &Parameters,
    footprint: Footprint,
    observer: &dyn Observer,
) -> Result<Data, Error> {
    let files = find_photos(inputs)?;
    let degradation = degradation(parameters, footprint);
    let mut data = Data { train: Vec::new(), held_out: Vec::new(), photos: Vec::new(), skipped: Vec::new() };
    observer.begin("photos", files.len() as u64);
    for path in &files {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        observer.advance(1);
        let photo = match load_photo(path, 64) {
            Ok(photo) => photo,
            Err(e) => {
                let note = format!("left out: {e}");
                observer.note(&note);
                data.skipped.push(note);
                continue;
            }
        };
        let index = data.photos.len();
        let keep = parameters.held_out >= 2 && index % parameters.held_out == parameters.held_out - 1;
        let count = if keep { 1 } else { parameters.crops };
        let cut = crops(&photo, index, count, parameters.crop, parameters.shrink, &degradation, parameters.seed)?;
        if keep { &mut data.held_out } else { &mut data.train }.extend(cut);
        data.photos.push(Photo { file: photo.name, sha256: photo.sha256 });
    }
    if data.train.is_empty() {
        let of = files.len();
        return Err(Error::TooLittle(format!("none of {of} files is a usable photo: {}", data.skipped.join("; "))));
    }
    Ok(data)
}
