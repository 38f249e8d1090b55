//! Smoothing over lenslets: the illumination of the sensor, and centres shrunk towards the lattice.

pub mod illumination;
pub mod shrink;
