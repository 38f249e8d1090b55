//! The arguments and the result that all commands share.

use super::progress::Progress;

/// The arguments that all commands share.
pub struct Context {
    /// Progress on stderr, and the interrupt flag.
    pub progress: Progress,
}

/// What a command prints: `json` with `--json`, else `text`.
pub struct Outcome {
    pub json: serde_json::Value,
    pub text: String,
}

/// The caller used the command wrongly (exit code 2).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);
