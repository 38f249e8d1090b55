//! A bounded queue of jobs on the rayon pool, so that encoding and writing overlap decoding.
//!
//! Nothing blocks while the caller could do the work: with a full queue [`WriteQueue::submit`] runs the job at once,
//! and [`WriteQueue::wait`] works on the pool's jobs when it is called on a pool thread, so one thread suffices.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use super::error::Error;

#[derive(Default)]
struct State {
    waiting: usize,
    failed: Option<Error>,
}

/// A bounded queue of jobs that can fail; the first failure is kept.
pub(super) struct WriteQueue {
    shared: Arc<(Mutex<State>, Condvar)>,
    bound: usize,
}

impl WriteQueue {
    /// At most two jobs per thread wait at any time.
    pub(super) fn new() -> Self {
        WriteQueue { shared: Arc::default(), bound: 2 * rayon::current_num_threads() }
    }

    /// Runs the job now or later. The error is that of an earlier job.
    pub(super) fn submit(&self, job: impl FnOnce() -> Result<(), Error> + Send + 'static) -> Result<(), Error> {
        {
            let mut state = self.shared.0.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(error) = state.failed.take() {
                return Err(error);
            }
            if state.waiting >= self.bound {
                drop(state);
                return job();
            }
            state.waiting += 1;
        }
        let ticket = Ticket(Arc::clone(&self.shared));
        rayon::spawn(move || {
            let result = job();
            if let Err(error) = result {
                let mut state = ticket.0.0.lock().unwrap_or_else(PoisonError::into_inner);
                state.failed.get_or_insert(error);
            }
            drop(ticket);
        });
        Ok(())
    }

    /// Waits for every job. The error is the first one.
    pub(super) fn wait(&self) -> Result<(), Error> {
        let (state, changed) = &*self.shared;
        loop {
            {
                let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
                if state.waiting == 0 {
                    return state.failed.take().map_or(Ok(()), Err);
                }
            }
            if rayon::yield_now() != Some(rayon::Yield::Executed) {
                let state = state.lock().unwrap_or_else(PoisonError::into_inner);
                if state.waiting > 0 {
                    // A job may be spawned onto this thread meanwhile, so the sleep is short.
                    drop(changed.wait_timeout(state, Duration::from_millis(2)));
                }
            }
        }
    }
}

/// Marks a job as finished when dropped, also when the job panics.
struct Ticket(Arc<(Mutex<State>, Condvar)>);

impl Drop for Ticket {
    fn drop(&mut self) {
        let mut state = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.waiting -= 1;
        self.0.1.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn every_job_runs_on_one_thread_too() {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let count = Arc::new(AtomicUsize::new(0));
            pool.install(|| {
                let queue = WriteQueue::new();
                for _ in 0..50 {
                    let count = Arc::clone(&count);
                    queue
                        .submit(move || {
                            count.fetch_add(1, Ordering::SeqCst);
                            Ok(())
                        })
                        .unwrap();
                }
                queue.wait().unwrap();
            });
            assert_eq!(count.load(Ordering::SeqCst), 50);
        }
    }

    #[test]
    fn a_failure_is_reported() {
        let queue = WriteQueue::new();
        queue.submit(|| Err(Error::Parameter("no".into()))).unwrap();
        assert!(matches!(queue.wait(), Err(Error::Parameter(_))));
    }
}
