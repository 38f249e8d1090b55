//! What most programs need: `use lenslet::prelude::*;`.
//!
//! From files to views:
//!
//! ```no_run
//! use lenslet::prelude::*;
//!
//! let camera = Calibration::from_whites(&["white.lfp"])?;
//! let samples = Capture::open("IMG_0001.lfp")?.decode(&camera)?; // refuses another camera's calibration
//! let learned = samples.renderer(Method::multiview().learned()).longer_side(1080).prepare()?;
//! let centre: View = learned.view(3, 3)?;
//! learned.save("IMG_0001.lf")?;
//! # let _ = centre;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub use crate::calibration::Calibration;
pub use crate::container::Capture;
pub use crate::decode::HexSamples;
pub use crate::dictionary::Dictionary;
pub use crate::interpolation::Interpolation;
pub use crate::lightfield::{ColourSpace, LightField, Linear, Srgb, View};
pub use crate::metrics::{Scores, Window};
pub use crate::progress::{Interrupted, Observer, Silent};
pub use crate::views::{Learned, Method, RenderSamples, Renderer};
