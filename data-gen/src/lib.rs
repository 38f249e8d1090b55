//! Training pairs from photos ([`pairs`]), and simulated captures with their truth ([`simulate`]); both read
//! [`photo`]s.
//!
//! Everything random comes from ChaCha8 streams named by seed and place, so that results depend neither on the order of
//! the work nor on the number of threads.

pub mod pairs;
pub mod photo;
pub mod simulate;
