//! Learned reconstruction of views and whole light fields (paper section 4.4): eq. (4) on the luminance of every view,
//! colour differences of the interpolated view guided by it, and back-projection onto the measured samples.

mod data_consistent;
mod embedded;
mod guided;
mod light_field;
mod measurements;
mod noise;
mod options;
mod plan;
mod reconstructor;
mod sampling_operator;

pub use data_consistent::DataConsistent;
pub use embedded::{
    embedded_by_name, embedded_dictionary, embedded_dictionary_for, embedded_name_for, embedded_name_for_grid,
    embedded_names,
};
pub use light_field::{Enlargement, reconstruct_light_field};
pub use measurements::Measurements;
pub use options::{Mode, Options};
pub use plan::{Available, Plan};
pub use reconstructor::Reconstructor;
pub use sampling_operator::{SamplingOperator, back_project};
