//! The lattice in the frequency domain: power spectrum, its fundamental peaks, a prior from metadata, phases over the
//! sensor.

pub mod phase;
pub mod prior;
pub mod rotation;
pub mod spectrum;
