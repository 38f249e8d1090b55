//! The builder of renderers: `samples.renderer(method)`, size and observer, `prepare`.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::progress::{Observer, Silent};

use super::render::Renderer;
use crate::Error;
use crate::method::Method;
use crate::target::native_size;

/// Longer side of the views by default, pixels.
///
/// Source: paper, section 4 (1080 pixels).
const LONGER_SIDE: usize = 1080;

/// Method, size and observer of a [`Renderer`] to be prepared.
pub struct RendererBuilder<'a> {
    samples: &'a HexSamples,
    method: Method,
    size: Size,
    observer: &'a dyn Observer,
}

/// Rendering of hexagonal samples.
pub trait RenderSamples {
    /// A builder for the rendering of views by `method`; the default size is 1080 pixels along the longer side.
    fn renderer(&self, method: impl Into<Method>) -> RendererBuilder<'_>;
}

impl RenderSamples for HexSamples {
    fn renderer(&self, method: impl Into<Method>) -> RendererBuilder<'_> {
        let size = self.sensor.with_longer_side(LONGER_SIDE);
        RendererBuilder { samples: self, method: method.into(), size, observer: &Silent }
    }
}

impl<'a> RendererBuilder<'a> {
    /// Views whose longer side has `pixels` pixels, scene pixels square.
    #[must_use]
    pub fn longer_side(mut self, pixels: usize) -> Self {
        self.size = self.samples.sensor.with_longer_side(pixels);
        self
    }

    /// Views of exactly this size.
    #[must_use]
    pub fn size(mut self, size: Size) -> Self {
        self.size = size;
        self
    }

    /// Views of about one pixel a lenslet.
    #[must_use]
    pub fn native_size(mut self) -> Self {
        self.size = native_size(self.samples);
        self
    }

    /// The observer of progress, which can interrupt (default: [`Silent`]).
    #[must_use]
    pub fn observer(mut self, observer: &'a dyn Observer) -> Self {
        self.observer = observer;
        self
    }

    /// Prepares the rendering: interpolation tables, disparity for multi-view, dictionary for learned reconstruction.
    ///
    /// # Errors
    /// As [`Renderer::prepare`].
    pub fn prepare(self) -> Result<Renderer<'a>, Error> {
        Renderer::prepare(self.samples, &self.method, self.size, self.observer)
    }
}
