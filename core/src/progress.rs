//! Progress and cancellation of long work, as an argument.

/// Receives the progress of long work and says whether it should stop.
pub trait Observer: Sync {
    /// A stage begins; `total` is its number of steps (0 when unknown).
    fn begin(&self, _stage: &str, _total: u64) {}
    /// `n` more steps of the current stage are done.
    fn advance(&self, _n: u64) {}
    /// A line of news worth keeping (an epoch's scores, a warning).
    fn note(&self, _text: &str) {}
    /// True once the work should end early; functions then return their `Interrupted` error.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Says nothing, never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}
