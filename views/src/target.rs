//! The size at which views are rendered, and where rendered views go.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::View;
use ndarray::Array3;

use crate::Error;

/// Mean distance of neighbouring lenslets in sensor pixels, from how densely they lie.
pub fn mean_pitch(samples: &HexSamples) -> f64 {
    let area = samples.sensor.width as f64 * samples.sensor.height as f64;
    (area / samples.centres.len().max(1) as f64 / (3f64.sqrt() / 2.0)).sqrt()
}

/// Mean distance of neighbouring lenslets in pixels of views `width` pixels wide.
#[must_use]
pub fn view_pitch(samples: &HexSamples, width: usize) -> f64 {
    mean_pitch(samples) * width as f64 / samples.sensor.width.max(1) as f64
}

/// The size at which views have about one pixel a lenslet: a pixel a pitch along the rows, scene pixels square.
#[must_use]
pub fn native_size(samples: &HexSamples) -> Size {
    let longer = samples.sensor.width.max(samples.sensor.height) as f64;
    let side = (longer / mean_pitch(samples).max(1.0)).round().max(1.0) as usize;
    samples.sensor.with_longer_side(side)
}

/// Where rendered views go: (row v, column u, counted from 0; the view). The sink's error type is the caller's.
pub type Sink<'a, E = Error> = &'a mut dyn FnMut(usize, usize, View) -> Result<(), E>;

/// As [`Sink`], for pixels (t, s, c) whose colour space is that of what they were made of.
pub type PixelSink<'a, E = Error> = &'a mut dyn FnMut(usize, usize, Array3<f32>) -> Result<(), E>;
