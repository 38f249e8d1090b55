//! The light field on disk and in memory: our directory, .npy, and the formats of other tools.
//!
//! [`LightField::open`] and [`LightField::save`] move whole ones. Views can also travel one at a time: [`create`] gives a
//! [`ViewSink`], [`open`] a [`ViewSource`]; [`load`] reads a whole one, with options and a limit on its size.

mod block;
pub mod colour;
mod directory;
mod encode;
mod error;
mod eslf;
mod field;
mod format;
mod image_file;
mod mat;
mod meta;
mod npy;
mod numbered;
mod open;
mod origin;
mod sample;
mod single;
mod view;
mod view_io;
mod write_queue;

pub use colour::ColourSpace;
pub use error::Error;
pub use field::LightField;
pub use format::{Format, ReadOptions};
pub use meta::{MAX_SIDE, MAX_VIEW_VALUES, MAX_VIEWS, Meta};
pub use open::{create, load, open};
pub use origin::ViewOrigin;
pub use view::{Encoding, Linear, Srgb, View};
pub use view_io::{ViewSink, ViewSource};
