//! What lenslets have in common: the broad light over the sensor, and how far each centre is trusted against the lattice.

pub mod illumination;
pub mod shrink;
