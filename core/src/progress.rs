//! Progress and cancellation of long work, as an argument.

/// Receives the progress of long work and decides whether it should stop.
///
/// ```
/// use lenslet_core::progress::{Interrupted, Observer, Silent};
///
/// struct Stop;
/// impl Observer for Stop {
///     fn cancelled(&self) -> bool {
///         true
///     }
/// }
/// fn count(observer: &dyn Observer) -> Result<u32, Interrupted> {
///     observer.begin("counting", 3);
///     for _ in 0..3 {
///         observer.check()?;
///         observer.advance(1);
///     }
///     Ok(3)
/// }
/// assert_eq!((count(&Silent), count(&Stop)), (Ok(3), Err(Interrupted)));
/// ```
pub trait Observer: Sync {
    /// A stage begins; `total` is its number of steps (0 when unknown).
    fn begin(&self, _stage: &str, _total: u64) {}
    /// `n` more steps of the current stage are done.
    fn advance(&self, _n: u64) {}
    /// A message to be kept (an epoch's scores, a warning), one line.
    fn note(&self, _text: &str) {}
    /// True once the work should end early.
    fn cancelled(&self) -> bool {
        false
    }
    /// An error once the work should end early; call it as `observer.check()?`.
    ///
    /// # Errors
    /// [`Interrupted`] once [`Observer::cancelled`] is true.
    fn check(&self) -> Result<(), Interrupted> {
        if self.cancelled() { Err(Interrupted) } else { Ok(()) }
    }
}

/// The work was cancelled by its observer. The error type of every long computation has it as a transparent variant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// Ignores all progress and never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}
