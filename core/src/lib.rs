//! Types and algorithms that all crates of lenslet share: from opening a capture file to scoring views.
//!
//! Data flows one way: [`container`] → [`calibration`] → [`decode`] → [`sampling`]; [`sparse`] and
//! [`dictionary`] serve learned reconstruction, [`lightfield`] holds and stores the views, [`metrics`] scores them.
//! Nothing here prints or exits. Parallel loops run on the caller's rayon pool; progress and cancellation go
//! through [`progress::Observer`].

pub mod calibration;
pub mod colour;
pub mod container;
pub mod decode;
pub mod dictionary;
pub mod digest;
pub mod geometry;
pub mod image;
pub mod input;
pub mod interpolation;
pub mod lightfield;
pub mod linalg;
pub mod metrics;
pub mod noise;
pub mod output;
pub mod pfm;
pub mod picture_file;
pub mod progress;
pub mod random;
pub mod sampling;
pub mod sparse;
pub mod stroke_font;

/// Returns the error variant with a formatted message, a `String`, unless the condition holds; what the function
/// returns may be another error that is made from it.
///
/// ```
/// #[derive(Debug, PartialEq)]
/// enum Error {
///     Parameter(String),
/// }
/// fn half(n: i32) -> Result<i32, Error> {
///     lenslet_core::ensure!(Error::Parameter, n % 2 == 0, "{n} is odd");
///     Ok(n / 2)
/// }
/// assert_eq!(half(3), Err(Error::Parameter("3 is odd".into())));
/// ```
#[macro_export]
macro_rules! ensure {
    ($variant:path, $condition:expr, $($message:tt)+) => {
        if !$condition {
            return Err($variant(format!($($message)+)).into());
        }
    };
}
