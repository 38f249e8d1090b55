//! What every command is given, and what it returns.

use super::progress::Progress;

/// What every command is given.
pub struct Context {
    /// Progress on stderr, and the interrupt flag.
    pub progress: Progress,
}

/// What a command prints: `json` for machines, `text` for people.
pub struct Outcome {
    pub json: serde_json::Value,
    pub text: String,
}

/// The caller used the command wrongly (exit code 2).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);
