//! What most programs need: `use lenslet::prelude::*;`.

pub use crate::lightfield::{ColourSpace, LightField};
pub use crate::progress::{Interrupted, Observer, Silent};
