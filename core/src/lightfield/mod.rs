//! The light field on disk and in memory: lenslet's directory, .npy, and the formats of other tools.
//!
//! [`LightField::open`] and [`LightField::save`] read and write whole ones; [`load`] takes options and a limit on the
//! size. [`create`] gives a [`ViewSink`] and [`open`] a [`ViewSource`], which take and give one view at a time.

mod axes;
mod block;
pub mod colour;
mod companion;
mod directory;
mod encode;
mod error;
mod eslf;
mod field;
mod find_order;
mod format;
mod image_file;
mod mat;
mod meta;
mod names;
mod npy;
mod numbered;
mod open;
mod origin;
mod parallax;
mod reordered;
mod sample;
mod single;
mod value_range;
mod view;
mod view_io;
mod view_order;
mod write_queue;

pub use axes::Axes;
pub use colour::ColourSpace;
pub use error::Error;
pub use field::LightField;
pub use format::{Format, ReadOptions};
pub use meta::{MAX_SIDE, MAX_VIEW_VALUES, MAX_VIEWS, Meta};
pub use open::{create, load, open, read_all};
pub use origin::ViewOrigin;
pub use view::{Encoding, Linear, Srgb, View};
pub use view_io::{Numbering, ViewSink, ViewSource};
pub use view_order::{ReadOrder, ViewOrder};
