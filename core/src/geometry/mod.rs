//! Positions: sizes, lattices, the map from a sensor to a view, triangulations.
//!
//! One convention holds everywhere: x to the right, y down, pixel centres at whole numbers. A picture of width W
//! therefore reaches from −½ to W − ½.

mod lattice;
mod sensor_to_view;
mod size;
mod triangulation;

pub use lattice::{Grid, Lattice, LatticePoints};
pub use sensor_to_view::SensorToView;
pub use size::Size;
pub use triangulation::{Triangulation, TriangulationError, triangulate};
