//! Which lenslet a point of the sensor belongs to, under which offset it sees the scene through it, and how much light
//! it gets.
//!
//! The centre of light of the micro-image behind the lenslet at c is c′ = m + (1 + e)·(c − m), m being the middle of
//! the sensor and e the pupil shift; a point p of it sees the scene at c under the offset p − c′. Without pupil shift
//! both are the lenslet's centre.

use super::camera::Camera;
use super::lenslets::Lenslets;

/// Width of the soft rim of the second aperture, as a share of its radius.
/// Source: chosen.
const SOFT_RIM: f64 = 0.15;

/// What a point of the sensor sees.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Centre of the lenslet, where it looks at the scene.
    pub lenslet: [f64; 2],
    /// Offset from the centre of light, sensor pixels.
    pub offset: [f64; 2],
    /// Light as a share of that at the centre.
    pub light: f64,
    /// Blur of the lenslet over that of the camera.
    pub spot: f64,
}

/// The micro-images behind the lenslets of a camera, for one pupil of its main lens.
#[derive(Debug, Clone, Copy)]
pub struct MicroImages<'a> {
    camera: &'a Camera,
    lenslets: &'a Lenslets,
    middle: [f64; 2],
    /// 1 + e.
    scale: f64,
    /// Diameter over the usual one.
    size: f64,
}

impl<'a> MicroImages<'a> {
    /// Those of captures.
    pub fn of_capture(camera: &'a Camera, lenslets: &'a Lenslets) -> MicroImages<'a> {
        Self::with_pupil(camera, lenslets, camera.imperfections.pupil_shift, 1.0)
    }

    /// Those of white images, which another zoom may have.
    pub fn of_white(camera: &'a Camera, lenslets: &'a Lenslets) -> MicroImages<'a> {
        let i = &camera.imperfections;
        Self::with_pupil(camera, lenslets, i.pupil_shift + i.white_shift, i.white_size)
    }

    fn with_pupil(camera: &'a Camera, lenslets: &'a Lenslets, shift: f64, size: f64) -> MicroImages<'a> {
        MicroImages { camera, lenslets, middle: camera.middle(), scale: camera.pupil_scale(shift), size }
    }

    /// The camera.
    pub fn camera(&self) -> &'a Camera {
        self.camera
    }

    /// What the point (`x`, `y`) sees through the lenslet whose micro-image it belongs to.
    #[inline]
    pub fn seen_from(&self, x: f64, y: f64) -> Seen {
        if self.scale == 1.0 {
            let (lenslet, d2, spot) = self.lenslets.nearest_with_spot(x, y);
            let offset = [x - lenslet[0], y - lenslet[1]];
            return Seen { lenslet, offset, light: self.light(lenslet, offset, d2), spot };
        }
        let at = |v: f64, axis: usize| self.middle[axis] + (v - self.middle[axis]) / self.scale;
        let (lenslet, _, spot) = self.lenslets.nearest_with_spot(at(x, 0), at(y, 1));
        let light_centre = self.light_centre(lenslet);
        let offset = [x - light_centre[0], y - light_centre[1]];
        let d2 = offset[0] * offset[0] + offset[1] * offset[1];
        Seen { lenslet, offset, light: self.light(lenslet, offset, d2), spot }
    }

    /// Centre of light of the micro-image behind the lenslet at `c`.
    #[inline]
    pub fn light_centre(&self, c: [f64; 2]) -> [f64; 2] {
        if self.scale == 1.0 {
            return c;
        }
        std::array::from_fn(|axis| self.middle[axis] + (c[axis] - self.middle[axis]) * self.scale)
    }

    /// Centres of light (x, y) on the sensor (0..=width−1, 0..=height−1), row by row.
    pub fn centres_on_sensor(&self) -> Vec<[f64; 2]> {
        let (w, h) = (self.camera.sensor.width as f64 - 1.0, self.camera.sensor.height as f64 - 1.0);
        let centres = self.lenslets.all_centres().iter().map(|c| self.light_centre(*c));
        centres.filter(|c| (0.0..=w).contains(&c[0]) && (0.0..=h).contains(&c[1])).collect()
    }

    /// Light at `offset` of the micro-image of the lenslet at `c`; `d2`: the offset's length squared.
    #[inline]
    fn light(&self, c: [f64; 2], offset: [f64; 2], d2: f64) -> f64 {
        let light = if self.size == 1.0 {
            self.camera.light_at(d2)
        } else {
            self.camera.light_at(d2 / (self.size * self.size))
        };
        let cut = self.camera.imperfections.cats_eye;
        if cut == 0.0 {
            return light;
        }
        let radius = 0.5 * self.camera.lenslets.pitch * self.size;
        let away = cut * radius / self.middle[0].hypot(self.middle[1]);
        let dx = offset[0] - away * (c[0] - self.middle[0]);
        let dy = offset[1] - away * (c[1] - self.middle[1]);
        let inside = ((radius - dx.hypot(dy)) / (SOFT_RIM * radius) + 0.5).clamp(0.0, 1.0);
        let floor = self.camera.optics.floor.min(light);
        floor + (light - floor) * inside * inside * (3.0 - 2.0 * inside)
    }
}

#[cfg(test)]
mod tests {
    use lenslet_core::geometry::Size;

    use super::*;
    use crate::simulate::{Imperfections, LensletGrid};

    fn camera(imperfections: Imperfections) -> Camera {
        let lenslets = LensletGrid { rotation: 0.02, jitter: 0.1, ..LensletGrid::default() };
        Camera { sensor: Size::new(400, 300), lenslets, imperfections, ..Camera::default() }
    }

    #[test]
    fn pupil_shift_moves_the_light_outwards_and_not_the_lenslets() {
        let shift = 0.3;
        let camera = camera(Imperfections { pupil_shift: shift, ..Imperfections::default() });
        let lenslets = Lenslets::new(&camera, 2).unwrap();
        let images = MicroImages::of_capture(&camera, &lenslets);
        let [mx, my] = camera.middle();
        let corner = mx.hypot(my);
        for c in lenslets.centres_on_sensor() {
            let at = images.light_centre(c);
            let far = (c[0] - mx).hypot(c[1] - my);
            let moved = (at[0] - c[0]).hypot(at[1] - c[1]);
            assert!((moved - shift * camera.lenslets.pitch * far / corner).abs() < 1e-9);
            assert!((at[0] - mx).hypot(at[1] - my) >= far);
            // From the centre of light a pixel looks straight through its own lenslet, in full light.
            let seen = images.seen_from(at[0], at[1]);
            assert_eq!(seen.lenslet, c);
            assert!(seen.offset[0].abs() < 1e-9 && seen.offset[1].abs() < 1e-9 && seen.light > 1.0 - 1e-9);
        }
    }

    #[test]
    fn a_cats_eye_takes_light_from_one_side_and_more_of_it_in_the_corners() {
        let camera = camera(Imperfections { cats_eye: 0.6, ..Imperfections::default() });
        let lenslets = Lenslets::new(&camera, 2).unwrap();
        let images = MicroImages::of_capture(&camera, &lenslets);
        // Light 3.5 px to the inner and to the outer side of the centre nearest to (x, y).
        let sides = |x: f64, y: f64| {
            let [cx, cy] = lenslets.nearest(x, y).0;
            let [mx, my] = camera.middle();
            let far = (cx - mx).hypot(cy - my);
            let (ux, uy) = ((cx - mx) / far, (cy - my) / far);
            [-3.5, 3.5].map(|s| images.seen_from(cx + s * ux, cy + s * uy).light)
        };
        let [inner, outer] = sides(20.0, 15.0);
        let untouched = camera.light_at(3.5 * 3.5);
        assert!((outer - untouched).abs() < 1e-9 && inner < 0.4 * untouched, "{inner} {outer} {untouched}");
        let [inner_middle, outer_middle] = sides(206.0, 150.0);
        assert!((inner_middle - outer_middle).abs() < 0.05 * untouched, "{inner_middle} {outer_middle}");
    }

    #[test]
    fn another_zoom_has_larger_micro_images_elsewhere() {
        let zoom = Imperfections { white_shift: 0.2, white_size: 1.2, ..Imperfections::default() };
        let camera = camera(zoom);
        let lenslets = Lenslets::new(&camera, 2).unwrap();
        let (capture, white) = (MicroImages::of_capture(&camera, &lenslets), MicroImages::of_white(&camera, &lenslets));
        let c = lenslets.nearest(30.0, 40.0).0;
        assert_eq!(capture.light_centre(c), c);
        let at = white.light_centre(c);
        assert!((at[0] - c[0]).hypot(at[1] - c[1]) > 1.0);
        // 1.2 times as far from the centre there is as much light.
        let (a, b) = (capture.seen_from(c[0] + 2.5, c[1]).light, white.seen_from(at[0] + 3.0, at[1]).light);
        assert!((a - b).abs() < 1e-9 && a < 0.9, "{a} {b}");
    }
}
