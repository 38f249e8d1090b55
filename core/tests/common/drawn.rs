// A white image drawn for the examples of the documentation: a hexagonal pattern of cosines, its maxima the lenslet centres.

/// Pitch of the lenslets drawn, pixels.
pub const PITCH: f64 = 10.0;

/// A white image of 160x128 pixels, without noise.
pub fn drawn_white() -> lenslet_core::container::Capture {
    drawn_capture(|_, _| 1.0)
}

/// The same lenslets under the light of a scene, 0 to 1.
pub fn drawn_capture(scene: impl Fn(f64, f64) -> f64) -> lenslet_core::container::Capture {
    use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic};
    let (width, height, row) = (160, 128, PITCH * 3f64.sqrt() / 2.0);
    let light = |x: f64, y: f64| {
        let (i, j) = ((x - 2.5) / PITCH - 0.5 * (y - 3.25) / row, (y - 3.25) / row);
        let waves: f64 = [i, j, i + j].iter().map(|t| (std::f64::consts::TAU * t).cos()).sum();
        (0.4 + 0.16 * waves) * scene(x, y)
    };
    let data = (0..width * height).map(|k| (4000.0 * light((k % width) as f64, (k / width) as f64)) as u16).collect();
    let levels = Levels { black: [0.0; 4], white: [4095.0; 4] };
    Capture::bare(RawMosaic { width, height, data }, Cfa::Bggr, levels)
}
