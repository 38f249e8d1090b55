//! The development steps as data: one list per stage, so that a step can only be listed in the stage it runs in.
//!
//! The raw stage works on the mosaic, the demosaic turns it into samples, the view stage works on samples. Any step
//! can be left out, to measure what it contributes.

use crate::container::Capture;

/// How the two missing colours of a pixel are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Demosaic {
    /// Means of the nearest pixels of each colour.
    Bilinear,
    /// Malvar, He and Cutler's gradient-corrected 5×5 filters (2004): the plain alternative.
    Malvar,
    /// Each micro-image by itself, colours and views in one least-error estimate (co-kriging). The default.
    CoKriging,
}

impl Demosaic {
    /// All kinds.
    pub const ALL: [Demosaic; 3] = [Demosaic::CoKriging, Demosaic::Malvar, Demosaic::Bilinear];

    /// The name in flags and files: lenslet, malvar or bilinear.
    pub fn name(self) -> &'static str {
        match self {
            Demosaic::Bilinear => "bilinear",
            Demosaic::Malvar => "malvar",
            Demosaic::CoKriging => "lenslet",
        }
    }

    /// The kind of that name; `cokriging` is another name of `lenslet`.
    ///
    /// ```
    /// use lenslet_core::decode::Demosaic;
    /// assert_eq!(Demosaic::from_name("lenslet"), Some(Demosaic::CoKriging));
    /// assert_eq!(Demosaic::from_name("cokriging"), Some(Demosaic::CoKriging));
    /// assert_eq!(Demosaic::from_name("nearest"), None);
    /// ```
    pub fn from_name(name: &str) -> Option<Demosaic> {
        let name = if name == "cokriging" { "lenslet" } else { name };
        Demosaic::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// A step on the mosaic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawStep {
    /// Subtract the black level of each colour. Without it black counts as light. It is part of reading the digital
    /// numbers, at whatever place in the list.
    BlackLevel,
    /// Divide by the white image, where the calibration has one.
    Vignetting,
    /// Replace the pixels that the calibration lists as hot, and single ones far above all their neighbours of the
    /// same colour.
    HotPixels,
    /// Multiply by the white balance.
    WhiteBalance,
    /// Cut every colour where the first one saturates, so that highlights stay neutral.
    Highlights,
}

/// A step on the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ViewStep {
    /// Smooth the colours, not the light: for mosaics whose colours a JPEG coder damaged, and very noisy ones. Among
    /// the default steps of such captures only (see [`steps_for`]).
    ChromaDenoise,
    /// Camera colours to linear sRGB.
    ColourMatrix,
    /// Multiply by 2^EV: the exposure bias of the capture plus the offset in its camera's profile.
    ExposureBias,
    /// Multiply by 2^EV; EV within ±32.
    Exposure(f32),
    /// Move colours outside sRGB into 0..=1, hue kept. Without this step values are unbounded, as in scene-linear
    /// output.
    Gamut,
}

/// The steps from digital numbers to linear colour, in the order in which they run.
#[derive(Debug, Clone, PartialEq)]
pub struct Steps {
    /// Steps on the mosaic.
    pub raw: Vec<RawStep>,
    /// From the mosaic to samples of three colours.
    pub demosaic: Demosaic,
    /// Steps on the samples.
    pub view: Vec<ViewStep>,
}

impl Default for Steps {
    /// Black level, vignetting, hot pixels, white balance, highlights; co-kriging; colour matrix, exposure bias, gamut.
    fn default() -> Self {
        use {RawStep::*, ViewStep::*};
        Steps {
            raw: vec![BlackLevel, Vignetting, HotPixels, WhiteBalance, Highlights],
            demosaic: Demosaic::CoKriging,
            view: vec![ColourMatrix, ExposureBias, Gamut],
        }
    }
}

impl Steps {
    /// The steps' names in the order in which they run, as a light field's description lists them. Two are those of the
    /// first version: `Demosaic(Lenslet)` for co-kriging, `CalmColours` for chroma denoising.
    ///
    /// ```
    /// use lenslet_core::decode::Steps;
    /// let names = Steps::default().names();
    /// assert_eq!((names[0].as_str(), names[5].as_str()), ("BlackLevel", "Demosaic(Lenslet)"));
    /// ```
    pub fn names(&self) -> Vec<String> {
        let demosaic = match self.demosaic {
            Demosaic::CoKriging => "Demosaic(Lenslet)".into(),
            plain => format!("Demosaic({plain:?})"),
        };
        let view = self.view.iter().map(|step| match step {
            ViewStep::ChromaDenoise => "CalmColours".into(),
            other => format!("{other:?}"),
        });
        self.raw.iter().map(|step| format!("{step:?}")).chain([demosaic]).chain(view).collect()
    }

    /// Adds [`ViewStep::ChromaDenoise`], which comes first of the steps on samples, unless it is there.
    pub fn add_chroma_denoise(&mut self) {
        if !self.view.contains(&ViewStep::ChromaDenoise) {
            self.view.insert(0, ViewStep::ChromaDenoise);
        }
    }
}

/// The usual steps for a capture: [`Steps::default`], with [`ViewStep::ChromaDenoise`] where its pixels went through a
/// JPEG coder.
///
/// ```
/// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic};
/// use lenslet_core::decode::{Steps, ViewStep, steps_for};
///
/// let mosaic = RawMosaic { width: 8, height: 8, data: vec![0; 64] };
/// let levels = Levels { black: [0.0; 4], white: [255.0; 4] };
/// let mut capture = Capture::bare(mosaic, Cfa::Bggr, levels);
/// assert_eq!(steps_for(&capture), Steps::default());
/// capture.jpeg = true;
/// assert_eq!(steps_for(&capture).view[0], ViewStep::ChromaDenoise);
/// ```
pub fn steps_for(capture: &Capture) -> Steps {
    let mut steps = Steps::default();
    if capture.jpeg {
        steps.add_chroma_denoise();
    }
    steps
}
