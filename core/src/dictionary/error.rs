//! Errors of dictionaries, by cause.

use super::side_input::SideInput;

/// Errors of reading, writing and using dictionaries.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading failed.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Which file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// Not a dictionary file.
    #[error("{path} is not a lenslet dictionary (.lfd or .safetensors); train one with `lenslet train-dict`")]
    NotDictionary {
        /// Which file.
        path: String,
    },
    /// A dictionary of another format version.
    #[error("{path} is a dictionary of format version {found}, and this lenslet reads version {known}: {remedy}")]
    Version {
        /// Which file.
        path: String,
        /// Its version.
        found: u32,
        /// The newest version that this library reads.
        known: u32,
        /// What to do.
        remedy: &'static str,
    },
    /// A valid file with contents that are no longer supported.
    #[error("{path} holds {what}, which this lenslet no longer runs: train it again with `lenslet train-dict`")]
    Unsupported {
        /// Which file.
        path: String,
        /// What it holds.
        what: &'static str,
    },
    /// Truncated or damaged.
    #[error("{path} is damaged: {reason}; fetch or train it again")]
    Malformed {
        /// Which file.
        path: String,
        /// What is wrong.
        reason: String,
    },
    /// Writing failed.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
    /// A parameter out of range, or shapes that do not fit each other.
    #[error("{0}")]
    Parameter(String),
    /// A predictor was asked for by name that the model does not hold.
    #[error("the dictionary has no {wanted}; it has {held}")]
    NoPredictor {
        /// What was asked for.
        wanted: &'static str,
        /// The names of what there is.
        held: String,
    },
    /// A network was asked for where its side inputs are not available.
    #[error(
        "the network's inputs ({inputs}) are made of the view's own samples, which are not there: \
         samples.npz belongs beside the light field"
    )]
    NoSideInputs {
        /// Their names.
        inputs: String,
    },
    /// The sparse solver refused its input.
    #[error(transparent)]
    Sparse(#[from] crate::sparse::Error),
}

impl Error {
    /// That a network's side inputs are missing.
    #[must_use]
    pub fn no_side_inputs(inputs: &[SideInput]) -> Error {
        let names: Vec<&str> = inputs.iter().map(|i| i.name()).collect();
        let inputs = match names.split_last() {
            Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
            _ => names.concat(),
        };
        Error::NoSideInputs { inputs }
    }
}
