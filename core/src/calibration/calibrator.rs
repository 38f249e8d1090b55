//! From files to a calibration in one call: captures are opened, checked and calibrated, and errors name the file.

use std::path::{Path, PathBuf};

use super::error::Error;
use super::file;
use super::model::Calibration;
use super::options::{CalibrationOptions, CalibrationVariant};
use super::pipeline;
use crate::container::{CameraProfile, Capture, open_capture};
use crate::progress::{Observer, Silent};

/// Calibrates a camera from files; made by [`Calibration::calibrator`]. Defaults: all steps, with vignetting, no hot
/// pixels, the camera profile found from the files, no progress.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// use lenslet_core::calibration::{Calibration, CalibrationVariant};
///
/// let folder = tempfile::tempdir()?;
/// let white = folder.path().join("white.lfp");
/// lenslet_core::container::write_lfp(&white, &drawn_white(), false)?;
/// let calibrator = Calibration::calibrator().variant(CalibrationVariant::Integer).without_vignetting();
/// let camera = calibrator.from_whites(&[white])?;
/// assert!(camera.centres().all(|[x, y]| x.fract() == 0.0 && y.fract() == 0.0));
/// assert!(camera.vignetting.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
#[must_use = "a calibrator does nothing until `from_whites` or `from_captures`"]
pub struct Calibrator<'a> {
    options: CalibrationOptions,
    profile: Option<String>,
    observer: &'a dyn Observer,
}

impl std::fmt::Debug for Calibrator<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Calibrator").field("options", &self.options).field("profile", &self.profile).finish()
    }
}

impl<'a> Calibrator<'a> {
    /// Which centres the calibration holds; the default is [`CalibrationVariant::Full`].
    pub fn variant(mut self, variant: CalibrationVariant) -> Self {
        self.options.variant = variant;
        self
    }

    /// Leaves out the vignetting pattern.
    pub fn without_vignetting(mut self) -> Self {
        self.options.without_vignetting = true;
        self
    }

    /// Pixels to leave out (`y·width + x`, ascending), as [`find_hot_pixels`](super::find_hot_pixels) gives them.
    pub fn hot_pixels(mut self, hot_pixels: Vec<u32>) -> Self {
        self.options.hot_pixels = hot_pixels;
        self
    }

    /// Camera profile (a name such as `lytro-f01`, or the path of a TOML file) of files that do not name their camera.
    pub fn profile(mut self, name: impl Into<String>) -> Self {
        self.profile = Some(name.into());
        self
    }

    /// Receives progress and notes, and can end the work early. Default: [`Silent`].
    pub fn observer<'b>(self, observer: &'b dyn Observer) -> Calibrator<'b> {
        Calibrator { options: self.options, profile: self.profile, observer }
    }

    /// Opens white images (`.lfp`, `.raw` with its metadata beside it, or mosaics as pictures) and calibrates from them
    /// with [`calibrate`](super::calibrate). Of several files, those that cannot be read or used are left out with a
    /// note.
    ///
    /// # Errors
    /// [`Error::Capture`] where no file can be read; [`Error::InFile`] with the file and what is wrong with it;
    /// [`Error::Interrupted`].
    pub fn from_whites<P: AsRef<Path>>(self, paths: &[P]) -> Result<Calibration, Error> {
        self.open_and_calibrate(paths, pipeline::calibrate)
    }

    /// Opens ordinary captures and calibrates from them with
    /// [`calibrate_from_captures`](super::calibrate_from_captures); five are typical. Of several files, those that
    /// cannot be read or used are left out with a note.
    ///
    /// # Errors
    /// As [`Calibrator::from_whites`].
    pub fn from_captures<P: AsRef<Path>>(self, paths: &[P]) -> Result<Calibration, Error> {
        self.open_and_calibrate(paths, pipeline::calibrate_from_captures)
    }

    fn open_and_calibrate<P: AsRef<Path>>(
        mut self,
        paths: &[P],
        calibrate: impl Fn(&[Capture], &CalibrationOptions, &dyn Observer) -> Result<Calibration, Error>,
    ) -> Result<Calibration, Error> {
        let (paths, captures) = open_captures(paths, self.profile.as_deref(), self.observer)?;
        self.options.names = paths.iter().map(|p| p.display().to_string()).collect();
        calibrate(&captures, &self.options, self.observer).map_err(|e| e.in_file_of(&paths))
    }
}

impl Calibration {
    /// Calibrates a camera from the files of one or several white images (captures of an evenly lit white surface),
    /// with default options; [`Calibration::calibrator`] has others.
    ///
    /// ```
    /// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
    /// # use drawn::*;
    /// use lenslet_core::calibration::{Calibration, Error};
    ///
    /// let folder = tempfile::tempdir()?;
    /// let white = folder.path().join("white.lfp");
    /// lenslet_core::container::write_lfp(&white, &drawn_white(), false)?;
    /// let camera = Calibration::from_whites(&[&white])?;
    /// assert!((camera.lattice.pitch() - PITCH).abs() < 0.01);
    ///
    /// // Errors name the file.
    /// let missing = Calibration::from_whites(&["no/such.lfp"]).unwrap_err();
    /// assert!(matches!(missing, Error::Capture(_)) && missing.to_string().contains("no/such.lfp"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`Calibrator::from_whites`].
    pub fn from_whites<P: AsRef<Path>>(paths: &[P]) -> Result<Calibration, Error> {
        Calibration::calibrator().from_whites(paths)
    }

    /// Calibrates a camera without white images, from the files of ordinary captures (five are typical), with default
    /// options.
    ///
    /// # Errors
    /// As [`Calibrator::from_whites`].
    pub fn from_captures<P: AsRef<Path>>(paths: &[P]) -> Result<Calibration, Error> {
        Calibration::calibrator().from_captures(paths)
    }

    /// A calibrator of files, to set options.
    pub fn calibrator() -> Calibrator<'static> {
        Calibrator { options: CalibrationOptions::default(), profile: None, observer: &Silent }
    }

    /// Reads a `.calib` file; as [`load`](super::load).
    ///
    /// # Errors
    /// As [`load`](super::load).
    pub fn load(path: impl AsRef<Path>) -> Result<Calibration, Error> {
        file::load(path.as_ref())
    }

    /// Writes a `.calib` file that does not exist yet; [`save`](super::save) can replace one.
    ///
    /// # Errors
    /// As [`save`](super::save).
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        file::save(path.as_ref(), self, false)
    }
}

/// Opens captures, with the paths of those that could be read: of several, an unreadable one is left out with a note.
/// Warnings of the files are noted too. `profile` is the camera profile of files that do not name their camera.
///
/// # Errors
/// [`Error::NoImages`] without paths; [`Error::Capture`] or [`Error::InFile`] of the first file where none can be read;
/// [`Error::Interrupted`].
pub fn open_captures<P: AsRef<Path>>(
    paths: &[P],
    profile: Option<&str>,
    observer: &dyn Observer,
) -> Result<(Vec<PathBuf>, Vec<Capture>), Error> {
    let (mut names, mut captures, mut first_error) = (Vec::new(), Vec::new(), None);
    for path in paths {
        let path = path.as_ref();
        match open_checked(path, profile) {
            Ok(capture) => {
                for warning in &capture.warnings {
                    observer.note(&format!("{}: {warning}", path.display()));
                }
                names.push(path.to_path_buf());
                captures.push(capture);
            }
            Err(e) => {
                if paths.len() > 1 {
                    observer.note(&format!("left out: {e}"));
                }
                first_error.get_or_insert(e);
            }
        }
        observer.check()?;
    }
    if captures.is_empty() {
        return Err(first_error.unwrap_or(Error::NoImages));
    }
    Ok((names, captures))
}

/// Opens a capture; refuses one larger than the sensor of the camera that it states.
fn open_checked(path: &Path, profile: Option<&str>) -> Result<Capture, Error> {
    let capture = open_capture(path, profile)?;
    if let Some(name) = profile {
        let sensor = CameraProfile::find(name)?.sensor;
        let (w, h) = (capture.mosaic.width, capture.mosaic.height);
        if w > sensor.width || h > sensor.height {
            let error = Error::Parameter(format!(
                "{w}x{h} pixels do not fit the {}x{} sensor of a {name}; give the profile of its camera, or none",
                sensor.width, sensor.height
            ));
            return Err(Error::InFile { path: path.to_path_buf(), error: Box::new(error) });
        }
    }
    Ok(capture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::{Cfa, Levels, RawMosaic, write_lfp};

    #[test]
    fn captures_larger_than_the_sensor_of_the_profile_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let sensor = CameraProfile::find("lytro-f01").unwrap().sensor;
        for (width, height, fits) in
            [(64, 32, true), (sensor.width, 16, true), (sensor.width + 2, 16, false), (16, sensor.height + 2, false)]
        {
            let path = folder.path().join(format!("{width}x{height}.lfp"));
            let mosaic = RawMosaic { width, height, data: vec![700; width * height] };
            let levels = Levels { black: [168.0; 4], white: [4095.0; 4] };
            write_lfp(&path, &Capture::bare(mosaic, Cfa::Bggr, levels), false).unwrap();
            assert!(open_captures(&[&path], None, &Silent).is_ok());
            match open_captures(&[&path], Some("lytro-f01"), &Silent) {
                Ok((names, _)) => assert!(fits && names == [path]),
                Err(e) => assert!(!fits && e.to_string().contains("do not fit"), "{width}x{height}: {e}"),
            }
        }
    }
}
