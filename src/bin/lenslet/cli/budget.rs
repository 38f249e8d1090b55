//! `--memory`: a run that exceeds its memory budget ends by itself, before the machine runs out of memory.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use super::progress;

/// How often the memory in use is read.
/// Source: chosen.
const EVERY: Duration = Duration::from_millis(5);
/// MiB beyond the budget at which the process ends without waiting for the work to stop.
/// Source: chosen.
const GRACE: usize = 64;

/// Memory in use, MiB, when the budget was found exceeded; 0 before that.
static SEEN: AtomicUsize = AtomicUsize::new(0);

/// Watches the memory of this process from now on. Once more than `mib` is in use, the work is interrupted as by
/// Ctrl-C; at [`GRACE`] more the process ends at once, and the next run removes its unfinished outputs. Without /proc
/// nothing is watched.
pub fn watch(mib: usize) -> std::io::Result<()> {
    let over = move || {
        while let Some(now) = resident() {
            if now > mib {
                let first = SEEN.swap(now, Ordering::SeqCst) == 0;
                if first {
                    progress::interrupt();
                }
                if now > mib + GRACE {
                    super::streams::tell(&format!("lenslet: {}", message(mib, now)));
                    std::process::exit(1);
                }
            }
            std::thread::sleep(EVERY);
        }
    };
    std::thread::Builder::new().name("memory".into()).spawn(over).map(|_| ())
}

/// The message where the work ended because of its memory.
pub fn exceeded(mib: Option<usize>) -> Option<String> {
    let seen = SEEN.load(Ordering::SeqCst);
    mib.filter(|_| seen > 0).map(|mib| message(mib, seen))
}

fn message(mib: usize, seen: usize) -> String {
    format!(
        "stopped at {seen} MiB, more than the {mib} of --memory: raise it, or use fewer --threads or smaller --size, \
         --views, --scale or --pairs; finished outputs are kept"
    )
}

/// Memory of this process in use, MiB.
fn resident() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<usize>().ok().map(|kib| kib / 1024)
}
