//! The threads of a run: as many as asked for, fewer where the system limits the addresses of a process.
//!
//! Each thread that multiplies matrices reserves addresses for the packed parts of them, used or not; under `ulimit -v`,
//! or where memory is not overcommitted, they run out long before memory does.

use std::fs;

/// Addresses that one thread may reserve, MiB.
/// Source: measured; `decode --method cubic` of 320x320 pixels peaks (VmPeak) at 691, 1277 and 2449 MiB with 1, 2 and 4
/// threads, 586 MiB more for each.
const EACH: u64 = 592;
/// Addresses that a run takes besides, MiB.
/// Source: chosen; 105 MiB in the same decode, 639 MiB with `--method learned` in one thread, more for large captures.
const BASE: u64 = 1024;

/// Starts the pool: `asked` threads, or one a core; fewer under a limit where the command multiplies matrices.
///
/// # Errors
/// When the system allows too few addresses for one thread, or does not start the threads; as one line.
pub fn start(asked: Option<usize>, multiplies: bool) -> Result<(), String> {
    let wanted = asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get));
    let fitting = match addresses() {
        Some(mib) if multiplies && mib < BASE + EACH => {
            return Err(format!(
                "this process may use only {mib} MiB of addresses (ulimit -v, or memory that is not overcommitted); it needs {} or more",
                BASE + EACH
            ));
        }
        Some(mib) if multiplies => wanted.min(((mib - BASE) / EACH) as usize),
        _ => wanted,
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(fitting).build_global();
    pool.map_err(|e| format!("cannot start {fitting} threads: {e}; try --threads 1"))
}

/// Addresses that this process may still reserve, MiB; `None` where there is no limit.
fn addresses() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let limit = limit_of(&read("/proc/self/limits"));
    let left =
        if read("/proc/sys/vm/overcommit_memory").trim() == "2" { uncommitted(&read("/proc/meminfo")) } else { None };
    limit.into_iter().chain(left).min()
}

/// `Max address space` of /proc/self/limits, MiB.
fn limit_of(limits: &str) -> Option<u64> {
    let line = limits.lines().find_map(|l| l.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|bytes| bytes >> 20)
}

/// What /proc/meminfo says can still be committed, MiB.
fn uncommitted(memory: &str) -> Option<u64> {
    let of = |key: &str| {
        let line = memory.lines().find_map(|l| l.strip_prefix(key))?;
        line.split_whitespace().next()?.parse::<u64>().ok()
    };
    Some(of("CommitLimit:")?.saturating_sub(of("Committed_AS:")?) >> 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read() {
        let limits = "Limit  Soft Limit  Hard Limit  Units\nMax address space  4294967296  unlimited  bytes\n";
        assert_eq!(limit_of(limits), Some(4096));
        assert_eq!(limit_of(&limits.replace("4294967296", "unlimited")), None);
        let memory = "MemTotal: 8 kB\nCommitLimit: 4194304 kB\nCommitted_AS: 1048576 kB\n";
        assert_eq!(uncommitted(memory), Some(3072));
    }
}
