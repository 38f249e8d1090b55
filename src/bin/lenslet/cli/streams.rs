//! Where text leaves the program: the only place that writes to stdout and stderr.
//!
//! A message that cannot be told (its reader is gone, the disk of the log is full) changes nothing about the work. An
//! answer that is lost is a failure.

use std::io::{self, Write};

/// A line on stderr, whether or not anyone reads it.
pub fn tell(line: &str) {
    let mut text = line.to_string();
    text.push('\n');
    let mut out = io::stderr().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// The answer on stdout. A reader that has seen enough and closed the pipe is no error.
///
/// # Errors
/// When it cannot be written whole, as on a full disk.
pub fn answer(text: &str) -> io::Result<()> {
    let text = text.trim_end();
    if text.is_empty() {
        return Ok(());
    }
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}
