//! The solvers used by default: the f32 active set and matching pursuit on SIMD lanes, certificates, the f64 active
//! set.

pub(crate) mod active_set_f32;
pub(crate) mod active_set_f64;
mod candidate_search;
mod certificate;
pub(crate) mod gap;
pub(crate) mod product;
pub(crate) mod pursuit_f32;
pub(crate) mod scratch;
pub(crate) mod simd;
mod state;
mod update;
