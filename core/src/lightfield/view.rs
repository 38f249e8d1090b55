//! One view (sub-aperture image), with its colour space in its type, so that linear and encoded values cannot be mixed
//! up.

use std::marker::PhantomData;

use ndarray::Array3;

use super::colour::ColourSpace;
use super::encode::encode_srgb;
use crate::colour::srgb_decode;

mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Linear {}
    impl Sealed for super::Srgb {}
}

/// How the values of a [`View`] relate to light: [`Linear`] or [`Srgb`].
pub trait Encoding: sealed::Sealed + Copy + Send + Sync + 'static {
    /// The same as a value.
    const SPACE: ColourSpace;
}

/// Linear light, sRGB primaries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Linear;

/// sRGB primaries and transfer curve (IEC 61966-2-1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Srgb;

impl Encoding for Linear {
    const SPACE: ColourSpace = ColourSpace::Linear;
}

impl Encoding for Srgb {
    const SPACE: ColourSpace = ColourSpace::Srgb;
}

/// A view of shape (t, s, c): rows downwards, columns to the right, one or three channels; values usually 0..1.
///
/// ```
/// use lenslet_core::lightfield::{ColourSpace, Linear, Srgb, View};
/// use ndarray::Array3;
///
/// let view = View::<Linear>::new(Array3::from_elem((2, 3, 3), 0.214_041));
/// assert_eq!((view.width(), view.height(), view.channels()), (3, 2, 3));
/// let encoded: View<Srgb> = view.encode();
/// assert_eq!(encoded.colour_space(), ColourSpace::Srgb);
/// assert!((encoded.pixels()[[0, 0, 0]] - 0.5).abs() < 1e-5);
/// assert!((encoded.decode().pixels()[[1, 2, 2]] - 0.214_041).abs() < 1e-5);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct View<S: Encoding = Linear> {
    pixels: Array3<f32>,
    space: PhantomData<S>,
}

impl<S: Encoding> View<S> {
    /// Pixels (t, s, c) that are in the colour space `S`.
    #[must_use]
    pub fn new(pixels: Array3<f32>) -> Self {
        View { pixels, space: PhantomData }
    }

    /// The pixels, (t, s, c).
    #[must_use]
    pub fn pixels(&self) -> &Array3<f32> {
        &self.pixels
    }

    /// The pixels, (t, s, c), without the type.
    #[must_use]
    pub fn into_pixels(self) -> Array3<f32> {
        self.pixels
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.pixels.dim().1
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.pixels.dim().0
    }

    /// Channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.pixels.dim().2
    }

    /// The colour space as a value.
    #[must_use]
    pub fn colour_space(&self) -> ColourSpace {
        S::SPACE
    }
}

impl View<Linear> {
    /// The view encoded for a screen (sRGB). Values are clamped to 0..1, NaN becomes 0; within 2e-6 of the curve.
    #[must_use]
    pub fn encode(&self) -> View<Srgb> {
        View::new(encode_srgb(&self.pixels))
    }
}

impl View<Srgb> {
    /// The view in linear light. Values are not clamped.
    #[must_use]
    pub fn decode(&self) -> View<Linear> {
        View::new(self.pixels.mapv(srgb_decode))
    }
}
