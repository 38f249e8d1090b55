//! Files of lenslet cameras: LFP/LFR containers, raw mosaics, metadata, camera profiles.
//!
//! [`Capture::open`] turns any capture file into a [`Capture`]; [`segments`] and [`references`] read the parts of a
//! container, [`write_lfp`] writes one; [`whites`] finds the white image of a capture; [`CameraProfile`] holds the
//! facts of a camera model. Types are below, dispatch above: `capture`, `cfa`, `facts` ← `metadata`, `profile` ←
//! `assemble` ← one file per kind of capture (`lfp`, `raw`, `picture`) ← `open`.

mod assemble;
mod capture;
mod cfa;
mod depth;
mod error;
pub mod extract;
mod facts;
mod file;
pub mod json;
mod lfp;
pub mod members;
pub mod metadata;
mod open;
pub mod packing;
mod picture;
mod profile;
mod raw;
pub mod references;
pub mod segments;
mod sidecar;
pub mod whites;
mod write;

pub use capture::{Capture, RawMosaic};
pub use cfa::Cfa;
pub use error::Error;
pub use facts::{CameraFacts, ColourFacts, Levels, MlaHint};
pub use lfp::{LocatedFrame, locate_frame};
pub use open::open_capture;
pub use profile::{CameraProfile, MeasuredBody, Sensor, same_model};
pub use write::{frame_metadata, write_lfp};
