//! Algorithm 1 as the paper prints it, and lesser variants, for comparison with the default way. Nothing outside this folder
//! resamples the sensor image.

pub mod algorithm1;
pub mod erosion;
pub mod gamma;
pub mod maxima;
pub mod paraboloid;
pub mod rotate;
pub mod stretch;
pub mod triangulation;
pub mod variants;

pub use algorithm1::{Algorithm1Stages, run_algorithm1};
