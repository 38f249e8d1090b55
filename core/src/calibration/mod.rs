//! Algorithm 1 of the paper (section 3.2): from white images to the centre of every lenslet.

mod model;
pub use model::*;
