//! Every parameter of training, with its default and range; written into the dictionary's recipe.

mod all;
mod anchors;
mod degradation;
mod dictionary;
mod network;
mod pairs;
mod range;
mod record;
mod refinement;

pub use all::Parameters;
pub use anchors::AnchorParameters;
pub use degradation::DegradationParameters;
pub use dictionary::{Algorithm, Coupling, DictionaryParameters, KsvdUpdate};
pub use network::NetworkParameters;
pub use pairs::PairParameters;
pub use refinement::RefinementParameters;
