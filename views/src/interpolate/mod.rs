//! Single views from their own samples (paper sections 4.1 and 4.2), and a stronger plain way. Every way has the same shape:
//! prepare once for a lattice and a target size, then view after view, in linear light.

pub mod barycentric;
pub mod bicubic;
pub mod cubic;
