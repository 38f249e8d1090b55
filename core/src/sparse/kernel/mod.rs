//! The solvers used by default: the active set in f32, in mixed precision and in f64, and matching pursuit.

pub(crate) mod active_set_f32;
pub(crate) mod active_set_f64;
pub(crate) mod active_set_mixed;
mod candidate_search;
mod certificate;
pub(crate) mod continuation;
pub(crate) mod gap;
pub(crate) mod product;
pub(crate) mod pursuit_f32;
pub(crate) mod scratch;
pub(crate) mod simd;
mod state;
mod support_f64;
mod update;
mod wide;
