//! The steps on samples: the interpreter of [`ViewStep`].

use super::colour::{apply_matrix, brighten, exposure_bias};
use super::samples::HexSamples;
use super::steps::ViewStep;
use super::{chroma_denoise, gamut};
use crate::calibration::{Calibration, Grid};
use crate::container::{Capture, Cfa};
use crate::progress::{Interrupted, Observer};

/// Applies `steps` to `samples`, in their order.
pub(super) fn apply_view_steps(
    samples: &mut HexSamples,
    steps: &[ViewStep],
    capture: &Capture,
    calibration: &Calibration,
    observer: &dyn Observer,
) -> Result<(), Interrupted> {
    for step in steps {
        observer.check()?;
        match step {
            ViewStep::ChromaDenoise => {
                let hexagonal = calibration.lattice.grid != Grid::Square;
                chroma_denoise::smooth_colours(&mut samples.values, &samples.index, hexagonal);
            }
            ViewStep::ColourMatrix => {
                if capture.cfa != Cfa::Mono {
                    apply_matrix(&mut samples.values, &capture.colour.ccm);
                }
            }
            ViewStep::ExposureBias => brighten(&mut samples.values, exposure_bias(&capture.camera)),
            ViewStep::Exposure(ev) => brighten(&mut samples.values, *ev),
            ViewStep::Gamut => gamut::fit_colours(&mut samples.values),
        }
    }
    Ok(())
}
