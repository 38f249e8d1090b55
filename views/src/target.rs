//! The size at which views are rendered, and where rendered views go.

use lenslet_core::decode::HexSamples;
use lenslet_core::lightfield::View;
use ndarray::Array3;

use crate::Error;

/// Size of the views, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Target {
    /// The longer side `side` pixels, scene pixels square.
    pub fn longer(sensor: (usize, usize), side: usize) -> Target {
        let longer = sensor.0.max(sensor.1).max(1) as f64;
        let scaled = |n: usize| ((n as f64 * side as f64 / longer).round() as usize).max(1);
        Target { width: scaled(sensor.0), height: scaled(sensor.1) }
    }

    /// About one value a lenslet: a pixel a pitch along the rows.
    pub fn native(samples: &HexSamples) -> Target {
        let pitch = mean_pitch(samples).max(1.0);
        let longer = samples.sensor.0.max(samples.sensor.1) as f64;
        Target::longer(samples.sensor, (longer / pitch).round().max(1.0) as usize)
    }
}

/// Mean distance of neighbouring lenslets in sensor pixels, from how densely they lie.
pub fn mean_pitch(samples: &HexSamples) -> f64 {
    let area = samples.sensor.0 as f64 * samples.sensor.1 as f64;
    (area / samples.centres.len().max(1) as f64 / (3f64.sqrt() / 2.0)).sqrt()
}

/// Where rendered views go: (row v, column u, counted from 0; the view). The sink's error type is the caller's.
pub type Sink<'a, E = Error> = &'a mut dyn FnMut(usize, usize, View) -> Result<(), E>;

/// As [`Sink`], for pixels (t, s, c) whose colour space is that of what they were made of.
pub type PixelSink<'a, E = Error> = &'a mut dyn FnMut(usize, usize, Array3<f32>) -> Result<(), E>;
