//! Pictures of a calibration: its centres over the white image, a map of its residuals, and the paper's figures 4 to 6.

use lenslet::image_io::Picture;
use lenslet_core::calibration::paper::{Algorithm1Stages, triangulation};
use lenslet_core::calibration::{Calibration, Lenslet, SensorImage};
use lenslet_core::container::Cfa;

/// Colour of a centre.
/// Source: chosen
const CENTRE: [u8; 3] = [255, 40, 30];
/// Colour of an edge of the triangulation.
/// Source: chosen
const EDGE: [u8; 3] = [40, 220, 70];
/// Side of the part of the sensor shown enlarged, pixels.
/// Source: chosen
const PART: usize = 160;
/// Picture pixels a sensor pixel in the enlarged part.
/// Source: chosen
const ZOOM: usize = 6;

/// An 8-bit RGB picture to draw on.
struct Canvas {
    width: usize,
    height: usize,
    /// `3·width·height` values, row-major.
    rgb: Vec<u8>,
}

impl Canvas {
    /// Colours every pixel by a function of (x, y).
    fn paint(width: usize, height: usize, of: impl Fn(usize, usize) -> [u8; 3]) -> Canvas {
        let mut rgb = Vec::with_capacity(3 * width * height);
        for y in 0..height {
            for x in 0..width {
                rgb.extend(of(x, y));
            }
        }
        Canvas { width, height, rgb }
    }

    fn into_picture(self) -> Picture {
        Picture { width: self.width, height: self.height, rgb: self.rgb }
    }

    /// Mixes `colour` into a pixel, 0 to 1 of it; pixels outside are ignored.
    fn blend(&mut self, x: i64, y: i64, colour: [u8; 3], share: f64) {
        if x < 0 || y < 0 || x >= self.width as i64 || y >= self.height as i64 {
            return;
        }
        let at = 3 * (y as usize * self.width + x as usize);
        for (v, c) in self.rgb[at..at + 3].iter_mut().zip(colour) {
            *v = (f64::from(*v) + share * (f64::from(c) - f64::from(*v))).round() as u8;
        }
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: [u8; 3], share: f64) {
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().clamp(1.0, 1e5);
        for k in 0..=steps as usize {
            let t = k as f64 / steps;
            let p = [0, 1].map(|a| (from[a] + t * (to[a] - from[a])).round() as i64);
            self.blend(p[0], p[1], colour, share);
        }
    }

    fn dot(&mut self, at: [f64; 2], radius: f64, colour: [u8; 3]) {
        let reach = radius.ceil() as i64;
        let (cx, cy) = (at[0].round() as i64, at[1].round() as i64);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let far = (((cx + dx) as f64 - at[0]).powi(2) + ((cy + dy) as f64 - at[1]).powi(2)).sqrt();
                self.blend(cx + dx, cy + dy, colour, (radius + 0.5 - far).clamp(0.0, 1.0));
            }
        }
    }

    /// Draws centres and triangulation, scaled by `zoom` about the corner `from`.
    fn overlay(&mut self, centres: &[[f64; 2]], edges: &[[usize; 2]], from: [usize; 2], zoom: usize, radius: f64) {
        let place = |c: &[f64; 2]| [0, 1].map(|k| (c[k] - from[k] as f64 + 0.5) * zoom as f64 - 0.5);
        for &[p, q] in edges {
            let (p, q) = (&centres[p], &centres[q]);
            // Long edges along the hull do not connect neighbours.
            let size = (self.width.max(self.height)) as f64 / zoom as f64;
            if (p[0] - q[0]).hypot(p[1] - q[1]) < size.min(60.0) {
                self.line(place(p), place(q), EDGE, if zoom > 1 { 0.8 } else { 0.5 });
            }
        }
        for c in centres {
            self.dot(place(c), radius, CENTRE);
        }
    }
}

fn grey(v: f32) -> [u8; 3] {
    [(v.clamp(0.0, 1.0) * 255.0).round() as u8; 3]
}

/// The corner of the part shown enlarged, and its size: the middle of the sensor.
fn enlarged_part(width: usize, height: usize) -> ([usize; 2], [usize; 2]) {
    let size = [PART.min(width), PART.min(height)];
    ([(width - size[0]) / 2, (height - size[1]) / 2], size)
}

fn enlarged(width: usize, height: usize, of: impl Fn(usize, usize) -> [u8; 3]) -> Canvas {
    let (from, size) = enlarged_part(width, height);
    Canvas::paint(size[0] * ZOOM, size[1] * ZOOM, |x, y| of(from[0] + x / ZOOM, from[1] + y / ZOOM))
}

fn background(calibration: &Calibration) -> impl Fn(usize, usize) -> [u8; 3] + '_ {
    move |x, y| match &calibration.vignetting {
        Some(v) => grey(f32::from(v.white[y * v.width + x]) / 32768.0),
        None => [30; 3],
    }
}

/// Centres and triangulation over the white image (figure 6c, d): the whole sensor, and the middle enlarged.
pub fn draw_centres(calibration: &Calibration) -> [Picture; 2] {
    let (w, h) = (calibration.width, calibration.height);
    let points: Vec<[f64; 2]> = calibration.lenslets.iter().map(|l| [l.x, l.y]).collect();
    let edges = triangulation::delaunay_edges(&points);
    let mut whole = Canvas::paint(w, h, background(calibration));
    whole.overlay(&points, &edges, [0, 0], 1, 0.7);
    let mut close = enlarged(w, h, background(calibration));
    close.overlay(&points, &edges, enlarged_part(w, h).0, ZOOM, 2.5);
    [whole, close].map(Canvas::into_picture)
}

/// Distance from the regular lattice that one lenslet in a hundred exceeds, pixels (at least 0.001): what to show as
/// full brightness.
pub fn residual_scale(calibration: &Calibration) -> f64 {
    let off = |l: &Lenslet| {
        let c = calibration.lattice.centre(l.i, l.j);
        (l.x - c[0]).hypot(l.y - c[1])
    };
    let mut all: Vec<f64> = calibration.lenslets.iter().map(off).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() * 99 / 100).copied().unwrap_or(0.0).max(0.001)
}

/// How far each lenslet lies from the regular lattice: hue is the direction, brightness the distance (full at `full`
/// pixels).
pub fn draw_residuals(calibration: &Calibration, full: f64) -> Picture {
    let (w, h) = (calibration.width, calibration.height);
    let scale = calibration.lattice.pitch().max(1.0) / 2.0;
    let (pw, ph) = ((w as f64 / scale).ceil() as usize, (h as f64 / scale).ceil() as usize);
    let mut picture = Canvas::paint(pw, ph, |_, _| [0; 3]);
    for l in &calibration.lenslets {
        let c = calibration.lattice.centre(l.i, l.j);
        let (dx, dy) = (l.x - c[0], l.y - c[1]);
        let value = (dx.hypot(dy) / full).min(1.0);
        let colour = hue(dy.atan2(dx)).map(|v| (v * value * 255.0) as u8);
        for oy in 0..2 {
            for ox in 0..2 {
                picture.blend((l.x / scale) as i64 + ox, (l.y / scale) as i64 + oy, colour, 1.0);
            }
        }
    }
    picture.into_picture()
}

fn hue(angle: f64) -> [f64; 3] {
    [0.0, 1.0, 2.0].map(|k: f64| 0.5 + 0.5 * (angle - k * 2.0 * std::f64::consts::PI / 3.0).cos())
}

/// The paper's figures 4, 5 and 6 as its own steps give them, by file name.
pub fn draw_algorithm1(stages: &Algorithm1Stages, cfa: Cfa) -> Vec<(&'static str, Picture)> {
    let (w, h) = (stages.average.width, stages.average.height);
    let show = |image: &SensorImage| {
        let top = near_brightest(image);
        enlarged(w, h, |x, y| grey(image.at(x, y) / top))
    };
    let average = &stages.average;
    let top = near_brightest(average);
    let coloured = enlarged(w, h, |x, y| {
        // Each quad of the filter array as one colour.
        let (x0, y0) = ((x & !1).min(w - 2), (y & !1).min(h - 2));
        let (mut sums, mut counts) = ([0f32; 3], [0f32; 3]);
        for (x, y) in [(x0, y0), (x0 + 1, y0), (x0, y0 + 1), (x0 + 1, y0 + 1)] {
            sums[cfa.colour(x, y)] += average.at(x, y) / top;
            counts[cfa.colour(x, y)] += 1.0;
        }
        if cfa == Cfa::Mono { grey(sums[1] / 4.0) } else { [0, 1, 2].map(|k| grey(sums[k] / counts[k].max(1.0))[0]) }
    });
    let side = stages.spectrum.side;
    let logs: Vec<f32> = stages.spectrum.power.iter().map(|&v| v.max(1e-12).ln()).collect();
    let (low, high) = logs.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
    let spectrum = Canvas::paint(side, side, |x, y| {
        // Zero frequency in the middle.
        let at = ((y + side - side / 2) % side) * side + (x + side - side / 2) % side;
        grey((logs[at] - low) / (high - low).max(1e-6))
    });
    let mut found = show(&stages.equalised);
    found.overlay(&stages.centres, &[], enlarged_part(w, h).0, ZOOM, 2.5);
    let mut triangles = show(&stages.equalised);
    triangles.overlay(&stages.centres, &stages.edges, enlarged_part(w, h).0, ZOOM, 2.5);
    let pictures = [
        ("4a-average.png", show(average)),
        ("4b-colours.png", coloured),
        ("4c-grey.png", show(&stages.equalised)),
        ("4d-stretched.png", show(&stages.stretched)),
        ("5a-spectrum.png", spectrum),
        ("5b-unrotated.png", show(&stages.stretched)),
        ("5c-rotated.png", show(&stages.turned)),
        ("6a-eroded.png", show(&stages.eroded)),
        ("6c-centres.png", found),
        ("6d-triangulation.png", triangles),
    ];
    pictures.into_iter().map(|(name, canvas)| (name, canvas.into_picture())).collect()
}

/// Near the brightest value of the middle of a plane.
fn near_brightest(image: &SensorImage) -> f32 {
    let (from, size) = enlarged_part(image.width, image.height);
    let mut all: Vec<f32> =
        (from[1]..from[1] + size[1]).flat_map(|y| image.row(y)[from[0]..from[0] + size[0]].iter().copied()).collect();
    all.sort_by(f32::total_cmp);
    all[all.len() * 199 / 200].max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::calibration::{CalibrationOptions, calibrate, paper};
    use lenslet_core::progress::Silent;

    mod drawn {
        #![allow(dead_code)]
        include!(concat!(env!("CARGO_MANIFEST_DIR"), "/core/tests/common/drawn.rs"));
    }

    #[test]
    fn centres_are_drawn_at_their_positions() {
        let white = drawn::drawn_white();
        let found = calibrate(std::slice::from_ref(&white), &CalibrationOptions::default(), &Silent).unwrap();
        let [whole, close] = draw_centres(&found);
        assert_eq!((whole.width, whole.height, close.width, close.height), (160, 128, PART * ZOOM, 128 * ZOOM));
        let (from, _) = enlarged_part(160, 128);
        let mut seen = 0;
        for l in &found.lenslets {
            let (x, y) = (l.x.round() as usize, l.y.round() as usize);
            let p = 3 * (y * 160 + x);
            assert!(whole.rgb[p] > whole.rgb[p + 1], "a red dot at {x},{y}");
            let (cx, cy) = (((l.x - from[0] as f64 + 0.5) * 6.0).round(), ((l.y - from[1] as f64 + 0.5) * 6.0).round());
            if cx > 3.0 && cy > 3.0 && cx < (PART * ZOOM - 4) as f64 && cy < (128 * ZOOM - 4) as f64 {
                let p = 3 * (cy as usize * close.width + cx as usize);
                assert_eq!(close.rgb[p..p + 3], CENTRE);
                seen += 1;
            }
        }
        assert!(seen > 150);
        let figures = draw_algorithm1(&paper::run_algorithm1(&[white], &Silent).unwrap(), Cfa::Bggr);
        assert_eq!(figures.len(), 10);
        assert!(figures.iter().all(|(_, p)| p.rgb.len() == 3 * p.width * p.height && p.rgb.iter().any(|&v| v > 200)));
        // In a picture of residuals only lenslets off the lattice are bright.
        let mut moved = found.clone();
        for l in &mut moved.lenslets {
            [l.x, l.y] = found.lattice.centre(l.i, l.j);
        }
        assert!(draw_residuals(&moved, 0.5).rgb.iter().all(|&v| v == 0));
        assert_eq!(residual_scale(&moved), 0.001);
        for l in moved.lenslets.iter_mut().step_by(20) {
            l.y += 0.3;
        }
        assert!((residual_scale(&moved) - 0.3).abs() < 1e-9);
        moved.lenslets[50].x += 0.5;
        assert!(draw_residuals(&moved, 0.5).rgb.iter().any(|&v| v > 200));
    }
}
