//! Checks of ranges, with one wording for all of them.

use std::fmt::Display;

use crate::error::Error;

/// Refuses a value outside low..=high.
pub(super) fn within<T: PartialOrd + Display>(name: &str, value: T, low: T, high: T) -> Result<(), Error> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(Error::Parameter(format!("{name} {value} is out of range ({low} to {high})")))
}

/// Refuses an even value, and one outside 3..=25.
pub(super) fn odd_side(name: &str, value: usize) -> Result<(), Error> {
    within(name, value, 3, 25)?;
    if value % 2 == 1 { Ok(()) } else { Err(Error::Parameter(format!("{name} {value} must be odd"))) }
}
