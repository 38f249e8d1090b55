//! Sub-pixel centres: the predicted lenslets, the profile of a micro-image, the measured lenslets, and the lattice
//! fitted to them.

pub mod lattice_fit;
pub mod measure;
pub mod measured;
pub mod predicted;
pub mod profile;
