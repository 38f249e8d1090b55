//! The picture that all samples together determine (paper section 4.3 as one inverse problem).
//!
//! A sample is y = Σ over its footprint of the picture as its view sees it. With x the sample's place in the target view
//! and k the kernel of its footprint, y = B(x)·(k ∗ I), B interpolation by B-splines. The picture I minimises
//!
//! Σ_i w_i ρ_i (y_i − B(x_i)·(k ∗ I))² + Σ_e a_e (I_e₁ − I_e₂)²,
//!
//! e running over pairs of neighbouring pixels. ρ_i (samples that nothing explains) and a_e (edges of the picture) are
//! reweighted a few times; each time the normal equations are solved by conjugate gradients on the pixel grid, so that a
//! step costs the same however many views there are.

mod basis;
mod conjugate_gradients;
mod dispatch;
mod footprint;
mod forward;
mod kernel;
mod normal_stencil;
mod prior;
mod solve;

pub use basis::Basis;
pub(crate) use dispatch::dispatched;
pub use footprint::SampleFootprint;
pub use forward::{Grid, Row};
pub use kernel::Kernel;
pub(crate) use solve::{LEAST_RESIDUAL, quantile, sample_luminance};
pub use solve::{Predicted, Problem, Solution, SolveOptions, encoding_slope, mean_contrast, solve};
