//! Algorithm 1 as printed in the paper (section 3.2), and simplified variants, for comparison with the default method.
//! Only here is the sensor image resampled.

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
