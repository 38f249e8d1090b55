//! Sub-pixel centres: where lenslets are predicted, how a micro-image looks, what is measured, and the lattice through
//! it.

pub mod lattice_fit;
pub mod measure;
pub mod measured;
pub mod predicted;
pub mod profile;
