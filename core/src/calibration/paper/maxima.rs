//! Algorithm 1, "find local maxima": pixels that no pixel within a radius exceeds.

use rayon::prelude::*;

use crate::calibration::sensor_image::SensorImage;

/// Pixels (x, y), row by row, above `floor` and not below any pixel within `radius` pixels; of equal ones within the
/// radius only the first.
pub fn local_maxima(image: &SensorImage, radius: f64, floor: f32) -> Vec<[usize; 2]> {
    let reach = radius.max(1.0) as i64;
    let (width, height) = (image.width as i64, image.height as i64);
    let disc: Vec<(i64, i64)> = (-reach..=reach)
        .flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)))
        .filter(|&(dx, dy)| (dx, dy) != (0, 0) && (dx * dx + dy * dy) as f64 <= radius * radius)
        .collect();
    let rows: Vec<Vec<[usize; 2]>> = (0..image.height)
        .into_par_iter()
        .map(|y| {
            let mut found = Vec::new();
            for (x, &v) in image.row(y).iter().enumerate() {
                if v <= floor {
                    continue;
                }
                let top = disc.iter().all(|&(dx, dy)| {
                    let (nx, ny) = (x as i64 + dx, y as i64 + dy);
                    if nx < 0 || ny < 0 || nx >= width || ny >= height {
                        return true;
                    }
                    let other = image.at(nx as usize, ny as usize);
                    let earlier = dy < 0 || (dy == 0 && dx < 0);
                    other < v || (other == v && !earlier)
                });
                if top {
                    found.push([x, y]);
                }
            }
            found
        })
        .collect();
    rows.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maxima_at_tops_plateaus_and_borders() {
        let mut data = vec![0f32; 20 * 12];
        for (x, y, v) in [(3, 3, 5.0), (4, 3, 5.0), (12, 6, 2.0), (14, 6, 3.0), (0, 11, 1.0), (19, 0, 0.2)] {
            data[y * 20 + x] = v;
        }
        let image = SensorImage { width: 20, height: 12, data, limit: [f32::MAX; 4] };
        assert_eq!(local_maxima(&image, 2.5, 0.5), [[3, 3], [14, 6], [0, 11]]);
        assert_eq!(local_maxima(&image, 1.5, 0.5), [[3, 3], [12, 6], [14, 6], [0, 11]]);
    }

    #[test]
    fn a_pixel_below_any_neighbour_is_no_maximum() {
        for (dx, dy) in [(1, 0), (0, 1), (1, 1), (2, 0), (0, 2)] {
            for (first, second) in [(1.0, 2.0), (2.0, 1.0)] {
                let mut data = vec![0f32; 81];
                data[4 * 9 + 4] = first;
                data[(4 + dy) * 9 + 4 + dx] = second;
                let image = SensorImage { width: 9, height: 9, data, limit: [f32::MAX; 4] };
                let top = if first > second { [4, 4] } else { [4 + dx, 4 + dy] };
                assert_eq!(local_maxima(&image, 2.5, 0.5), [top]);
            }
        }
    }
}
