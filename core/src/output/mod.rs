//! Outputs that are whole or absent, and that never cost a user a file.
//!
//! Everything is written under a temporary name and renamed when complete. Only what lenslet wrote, and nobody changed,
//! is ever replaced: folders are recognised by the list that lies in them, files by their marks.

mod error;
mod growing;
mod listing;
mod marks;
mod pending;
mod place;
mod rename;
mod temporary;

pub use error::Error;
pub use growing::{check_listed, is_listed, lock_folder, replace_listed};
pub use listing::LIST;
pub use marks::{NPY_HEADER, NPZ_MARK};
pub use pending::{Pending, create_part, write_at, write_file, write_part};
pub use place::{Kind, check_target};
