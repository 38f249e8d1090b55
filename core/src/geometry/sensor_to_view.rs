//! The map from sensor pixels to output pixels: pictures cover the same area, whatever their number of pixels.

use super::Size;

/// Places of a sensor (or any picture) in a view of another size: x' = (x + ½)·W'/W − ½, and the same for y.
///
/// ```
/// use lenslet_core::geometry::{SensorToView, Size};
/// let map = SensorToView::new(Size::new(400, 300), Size::new(200, 150));
/// assert_eq!(map.to_view([0.5, 0.5]), [0.0, 0.0]);
/// assert_eq!(map.to_sensor([0.0, 0.0]), [0.5, 0.5]);
/// assert_eq!(map.scale(), [0.5, 0.5]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorToView {
    sensor: Size,
    view: Size,
}

impl SensorToView {
    /// From a sensor to a view of it; neither may be empty.
    pub fn new(sensor: impl Into<Size>, view: impl Into<Size>) -> Self {
        SensorToView { sensor: sensor.into(), view: view.into() }
    }

    /// View pixels per sensor pixel, along x and y.
    #[must_use]
    pub fn scale(&self) -> [f64; 2] {
        [self.view.width as f64 / self.sensor.width as f64, self.view.height as f64 / self.sensor.height as f64]
    }

    /// Where a place of the sensor lies in the view.
    #[inline]
    #[must_use]
    pub fn to_view(&self, place: [f64; 2]) -> [f64; 2] {
        let [fx, fy] = self.scale();
        [(place[0] + 0.5) * fx - 0.5, (place[1] + 0.5) * fy - 0.5]
    }

    /// Where a place of the view lies on the sensor.
    #[inline]
    #[must_use]
    pub fn to_sensor(&self, place: [f64; 2]) -> [f64; 2] {
        let back = |p: f64, from: usize, to: usize| (p + 0.5) * from as f64 / to as f64 - 0.5;
        [back(place[0], self.sensor.width, self.view.width), back(place[1], self.sensor.height, self.view.height)]
    }

    /// [`SensorToView::to_view`] of many places.
    #[must_use]
    pub fn all_to_view(&self, places: &[[f64; 2]]) -> Vec<[f64; 2]> {
        places.iter().map(|&p| self.to_view(p)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_map_to_corners_and_the_inverse_map_inverts() {
        let map = SensorToView::new(Size::new(3280, 2987), Size::new(1080, 983));
        let corner = map.to_view([3279.5, 2986.5]);
        assert!((corner[0] - 1079.5).abs() < 1e-9 && (corner[1] - 982.5).abs() < 1e-9);
        assert_eq!(map.to_view([-0.5, -0.5]), [-0.5, -0.5]);
        for p in [[0.0, 0.0], [17.3, 2000.9], [-4.0, 3300.0]] {
            let back = map.to_sensor(map.to_view(p));
            assert!((back[0] - p[0]).abs() < 1e-9 && (back[1] - p[1]).abs() < 1e-9);
        }
    }
}
