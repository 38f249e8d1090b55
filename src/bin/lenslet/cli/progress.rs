//! Progress on stderr: a bar on a terminal, nothing when quiet or piped; notes go above the bar. Ctrl-C is noticed
//! here.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lenslet_core::progress::Observer;

use super::streams::{tame, tell};

/// How long interrupted work may take to notice it, before the process ends all the same: an input that no longer answers
/// cannot be waited for.
/// Source: chosen; the longest step between two looks takes a second on a slow machine.
const PATIENCE: Duration = Duration::from_secs(10);

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Asks the work to end, as the first Ctrl-C does.
pub fn interrupt() {
    INTERRUPTED.store(true, Ordering::SeqCst);
}

/// Installs the Ctrl-C handler: the first asks the work to end, which is given [`PATIENCE`]; the second ends the process.
/// What an ended process leaves unfinished, the next run removes.
pub fn watch_interrupts() {
    let _ = ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
        let _ = std::thread::Builder::new().name("interrupt".into()).spawn(|| {
            std::thread::sleep(PATIENCE);
            tell("lenslet: interrupted");
            std::process::exit(130);
        });
    });
}

/// The command line's observer.
pub struct Progress {
    quiet: bool,
    bar: Mutex<Option<ProgressBar>>,
}

impl Progress {
    /// An observer that shows nothing when quiet.
    pub fn new(quiet: bool) -> Self {
        Progress { quiet, bar: Mutex::new(None) }
    }

    /// Removes the bar.
    pub fn clear(&self) {
        if let Ok(mut bar) = self.bar.lock()
            && let Some(bar) = bar.take()
        {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Progress {
    fn begin(&self, stage: &str, total: u64) {
        if self.quiet {
            return;
        }
        self.clear();
        let bar = ProgressBar::with_draw_target((total > 0).then_some(total), ProgressDrawTarget::stderr());
        let template = if total > 0 { "{msg:24} {wide_bar} {pos}/{len} {eta}" } else { "{msg:24} {spinner} {pos}" };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(stage.to_string());
        if let Ok(mut slot) = self.bar.lock() {
            *slot = Some(bar);
        }
    }

    fn advance(&self, n: u64) {
        if let Ok(bar) = self.bar.lock()
            && let Some(bar) = bar.as_ref()
        {
            bar.inc(n);
        }
    }

    fn note(&self, text: &str) {
        if self.quiet {
            return;
        }
        match self.bar.lock() {
            Ok(bar) => match bar.as_ref() {
                Some(bar) if !bar.is_hidden() => bar.println(tame(text)),
                _ => tell(text),
            },
            Err(_) => tell(text),
        }
    }

    fn cancelled(&self) -> bool {
        INTERRUPTED.load(Ordering::SeqCst)
    }
}
