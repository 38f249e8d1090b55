//! Illumination of the sensor by the main lens, F(x, y), from the lenslets' own brightness: a robust polynomial of
//! degree 4 times a smoothed coarse grid of what the polynomial leaves. Its slope would bias every fitted centre
//! towards the sensor's centre, so measuring divides by it.

use crate::calibration::centres::measured::MeasuredLenslet;
use crate::geometry::Size;
use crate::image::{Cell, bilinear_by_weights};
use crate::linalg::solve_small;

/// Terms of the polynomial: degree 4 in x and y.
/// Source: chosen
const TERMS: usize = 15;
/// Steepest relative slope of the residual grid, 1/pixel; steeper ones (rims of shadows, dead lenslets) count as 0.
/// Source: chosen
const STEEPEST: f64 = 0.003;
/// A cell this many times brighter or darker than the polynomial is ignored.
/// Source: chosen
const ODD: f64 = 1.6;
/// Side of a cell of the residual grid, in pitches (at least 1/256 of the sensor's longer side).
/// Source: chosen
const CELL: f64 = 6.0;
/// Largest relative slope of the illumination, 1/pixel.
/// Source: chosen
const LARGEST_SLOPE: f64 = 0.05;
/// Rounds of reweighting of the polynomial.
/// Source: chosen
const ROUNDS: usize = 5;

/// Smooth brightness over the sensor: a polynomial times the residual brightness on a coarse grid of cells.
#[derive(Debug, Clone)]
pub struct Illumination {
    broad: [f64; TERMS],
    /// Lower bound of the polynomial, so that it stays positive.
    least: f64,
    middle: [f64; 2],
    half: f64,
    cell: f64,
    columns: usize,
    rows: usize,
    /// Brightness of each cell relative to the polynomial, `rows·columns` values.
    values: Vec<f64>,
}

impl Illumination {
    /// Fits the illumination to the usable lenslets of a sensor of `width`×`height` pixels: a robust polynomial, then
    /// medians of the ratio over cells of about six lenslets a side, holes filled from neighbours, smoothed twice.
    pub fn new(measured: &[MeasuredLenslet], size: Size, pitch: f64) -> Self {
        let Size { width, height } = size;
        let cell = (CELL * pitch).max(width.max(height) as f64 / 256.0);
        let columns = (width as f64 / cell).ceil().max(1.0) as usize;
        let rows = (height as f64 / cell).ceil().max(1.0) as usize;
        let middle = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
        let half = 0.5 * width.max(height) as f64;
        let lit: Vec<&MeasuredLenslet> = measured.iter().filter(|m| m.usable && m.gain > 0.0).collect();
        let (broad, least) = fit_broad_shape(&lit, middle, half);
        let mut illumination = Illumination { broad, least, middle, half, cell, columns, rows, values: Vec::new() };
        let mut lists: Vec<Vec<f64>> = vec![Vec::new(); columns * rows];
        for m in lit {
            let c = ((m.x / cell).max(0.0) as usize).min(columns - 1);
            let r = ((m.y / cell).max(0.0) as usize).min(rows - 1);
            lists[r * columns + c].push(m.gain / illumination.broad_at(m.x, m.y));
        }
        let mut values: Vec<f64> = lists
            .iter_mut()
            .map(|l| {
                l.sort_by(f64::total_cmp);
                let odd = |v: f64| !(1.0 / ODD..ODD).contains(&v);
                if l.len() < 4 || odd(l[l.len() / 2]) { f64::NAN } else { l[l.len() / 2] }
            })
            .collect();
        fill_holes(&mut values, columns, rows);
        for _ in 0..2 {
            values = smooth_cells(&values, columns, rows);
        }
        illumination.values = values;
        illumination
    }

    /// The polynomial at (`x`, `y`): the broad shape, without what single cells show.
    pub fn broad_at(&self, x: f64, y: f64) -> f64 {
        let p = quartic_terms(self.normalised(x, y));
        self.broad.iter().zip(p).map(|(c, p)| c * p).sum::<f64>().max(self.least)
    }

    /// Coordinates of the polynomial: 0 at the sensor's centre, ±1 at the ends of its longer side.
    fn normalised(&self, x: f64, y: f64) -> [f64; 2] {
        [(x - self.middle[0]) / self.half, (y - self.middle[1]) / self.half]
    }

    /// The residual grid at (`x`, `y`): bilinear between the cells' centres, constant beyond the border.
    fn rest_at(&self, x: f64, y: f64) -> f64 {
        let place = Cell::clamped(x / self.cell - 0.5, y / self.cell - 0.5, Size::new(self.columns, self.rows));
        bilinear_by_weights(place.corners(|c, r| self.values[r * self.columns + c]), place.fx, place.fy)
    }

    /// Brightness at (`x`, `y`).
    pub fn brightness_at(&self, x: f64, y: f64) -> f64 {
        self.broad_at(x, y) * self.rest_at(x, y)
    }

    /// Relative slope (∂F/∂x, ∂F/∂y)/F at (`x`, `y`), 1/pixel; that of the residual grid is taken over the distance of
    /// a cell, one-sided at the border.
    pub fn relative_slope(&self, x: f64, y: f64) -> [f64; 2] {
        let (right, bottom) = ((self.columns as f64 - 0.5) * self.cell, (self.rows as f64 - 0.5) * self.cell);
        let bounds = |p: f64, end: f64| {
            let (low, high) = ((p - self.cell).max(0.5 * self.cell), (p + self.cell).min(end));
            if high - low > 0.5 * self.cell { Some((low, high)) } else { None }
        };
        let here = self.rest_at(x, y);
        let rest = |range: Option<(f64, f64)>, horizontal: bool| {
            let Some((low, high)) = range else { return 0.0 };
            let (a, b) = if horizontal {
                (self.rest_at(low, y), self.rest_at(high, y))
            } else {
                (self.rest_at(x, low), self.rest_at(x, high))
            };
            let slope = (b - a) / ((high - low) * here);
            if slope.abs() < STEEPEST { slope } else { 0.0 }
        };
        let broad = self.broad_at(x, y);
        let step = 1.0;
        let along =
            |dx: f64, dy: f64| (self.broad_at(x + dx, y + dy) - self.broad_at(x - dx, y - dy)) / (2.0 * step * broad);
        [along(step, 0.0) + rest(bounds(x, right), true), along(0.0, step) + rest(bounds(y, bottom), false)]
            .map(|s| s.clamp(-LARGEST_SLOPE, LARGEST_SLOPE))
    }

    /// Full light: the brightness that the brightest hundredth of the cells exceeds.
    pub fn full_light(&self) -> f64 {
        let mut all: Vec<f64> = (0..self.values.len())
            .map(|k| {
                let (x, y) = ((k % self.columns) as f64 + 0.5, (k / self.columns) as f64 + 0.5);
                self.values[k] * self.broad_at(x * self.cell, y * self.cell)
            })
            .collect();
        all.sort_by(f64::total_cmp);
        all[(all.len() * 99 / 100).min(all.len() - 1)]
    }
}

fn quartic_terms([x, y]: [f64; 2]) -> [f64; TERMS] {
    let (x2, y2) = (x * x, y * y);
    [1.0, x, y, x2, x * y, y2, x2 * x, x2 * y, x * y2, y2 * y, x2 * x2, x2 * x * y, x2 * y2, x * y2 * y, y2 * y2]
}

/// Robust polynomial through the brightness and its lower bound; of degree 2 below 300 lenslets, constant below 60.
fn fit_broad_shape(lit: &[&MeasuredLenslet], middle: [f64; 2], half: f64) -> ([f64; TERMS], f64) {
    let mut gains: Vec<f64> = lit.iter().map(|m| m.gain).collect();
    gains.sort_by(f64::total_cmp);
    let median = gains.get(gains.len() / 2).copied().unwrap_or(1.0);
    let least = 0.02 * gains.get(gains.len() * 9 / 10).copied().unwrap_or(1.0);
    let mut terms = [0f64; TERMS];
    terms[0] = median;
    let used = match lit.len() {
        0..60 => return (terms, least),
        60..300 => 6,
        _ => TERMS,
    };
    let step = (lit.len() / 20_000).max(1);
    let mut scale = median;
    for _ in 0..ROUNDS {
        let mut normal = [[0f64; TERMS]; TERMS];
        let mut right = [0f64; TERMS];
        let mut offs = Vec::new();
        for (n, m) in lit.iter().enumerate() {
            // Shifted every 89 lenslets, so that the sampling step does not alias with the row length.
            if n % step != (n / 89) % step {
                continue;
            }
            let p = quartic_terms([(m.x - middle[0]) / half, (m.y - middle[1]) / half]);
            let off = m.gain - terms.iter().zip(p).map(|(c, p)| c * p).sum::<f64>();
            offs.push(off.abs());
            let w = 1.0 / (1.0 + (off / scale).powi(2)).powi(2);
            for a in 0..used {
                for b in 0..used {
                    normal[a][b] += w * p[a] * p[b];
                }
                right[a] += w * p[a] * m.gain;
            }
        }
        (used..TERMS).for_each(|k| normal[k][k] = 1.0);
        let Some(fitted) = solve_small(normal, right) else { return (terms, least) };
        terms = fitted;
        let middle = offs.len() / 2;
        scale = (3.0 * *offs.select_nth_unstable_by(middle, f64::total_cmp).1).max(1e-3 * median);
    }
    (terms, least)
}

fn fill_holes(values: &mut Vec<f64>, columns: usize, rows: usize) {
    for _ in 0..columns + rows {
        if values.iter().all(|v| v.is_finite()) {
            return;
        }
        *values = fill_holes_once(values, columns, rows);
    }
    for v in values.iter_mut().filter(|v| !v.is_finite()) {
        *v = 1.0;
    }
}

fn neighbour_sum(values: &[f64], columns: usize, rows: usize, k: usize) -> (f64, f64) {
    let (r, c) = ((k / columns) as i64, (k % columns) as i64);
    let (mut sum, mut weight) = (0.0, 0.0);
    for dr in -1..=1i64 {
        for dc in -1..=1i64 {
            let (r, c) = (r + dr, c + dc);
            if r < 0 || c < 0 || r >= rows as i64 || c >= columns as i64 {
                continue;
            }
            let v = values[r as usize * columns + c as usize];
            if v.is_finite() {
                let w = f64::from((2 - dr.abs() as i32) * (2 - dc.abs() as i32));
                sum += w * v;
                weight += w;
            }
        }
    }
    (sum, weight)
}

fn fill_holes_once(values: &[f64], columns: usize, rows: usize) -> Vec<f64> {
    (0..values.len())
        .map(|k| {
            if values[k].is_finite() {
                return values[k];
            }
            let (sum, weight) = neighbour_sum(values, columns, rows, k);
            if weight > 0.0 { sum / weight } else { f64::NAN }
        })
        .collect()
}

fn smooth_cells(values: &[f64], columns: usize, rows: usize) -> Vec<f64> {
    (0..values.len())
        .map(|k| {
            let (c, r) = (k % columns, k / columns);
            // The border keeps its values: a one-sided mean would flatten the slope there.
            if c == 0 || r == 0 || c + 1 == columns || r + 1 == rows {
                return values[k];
            }
            let (sum, weight) = neighbour_sum(values, columns, rows, k);
            sum / weight
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lenslets of a lattice of pitch 10 on 400×300 pixels, in this light.
    fn lit(light: impl Fn(f64, f64) -> f64) -> Vec<MeasuredLenslet> {
        (0..40 * 30)
            .map(|k| {
                let (x, y) = (f64::from(k % 40) * 10.0 + 4.5, f64::from(k / 40) * 10.0 + 4.5);
                MeasuredLenslet { gain: light(x, y), ..MeasuredLenslet::from_position(k % 40, k / 40, x, y) }
            })
            .collect()
    }

    fn fitted(light: impl Fn(f64, f64) -> f64) -> Illumination {
        Illumination::new(&lit(light), Size::new(400, 300), 10.0)
    }

    /// Coordinates from the sensor's middle, ±1 at the ends of its longer side.
    fn from_middle(x: f64, y: f64) -> (f64, f64) {
        ((x - 199.5) / 200.0, (y - 149.5) / 200.0)
    }

    #[test]
    fn quartic_light_comes_back_with_its_slope() {
        let light = |x: f64, y: f64| {
            let (u, v) = from_middle(x, y);
            0.8 + 0.1 * u - 0.05 * v - 0.2 * u * u + 0.1 * u * v - 0.15 * v * v + 0.05 * u * u * u - 0.04 * u * u * v
                + 0.03 * u * v * v
                - 0.02 * v * v * v
                - 0.06 * u.powi(4)
                + 0.02 * u * u * u * v
                - 0.03 * u * u * v * v
                + 0.01 * u * v * v * v
                - 0.05 * v.powi(4)
        };
        let found = fitted(light);
        for (x, y) in [(0.0, 0.0), (399.0, 0.0), (120.0, 250.0), (200.0, 150.0), (30.0, 299.0)] {
            assert!((found.brightness_at(x, y) / light(x, y) - 1.0).abs() < 1e-6, "({x}, {y})");
            let slope = found.relative_slope(x, y);
            let truth = [light(x + 1.0, y) - light(x - 1.0, y), light(x, y + 1.0) - light(x, y - 1.0)];
            let truth = truth.map(|d| d / 2.0 / light(x, y));
            assert!((slope[0] - truth[0]).abs() < 1e-7 && (slope[1] - truth[1]).abs() < 1e-7, "{slope:?} {truth:?}");
        }
        // Shadows of one lenslet in ten do not move it.
        let mut n = 0;
        let mut measured = lit(light);
        for m in &mut measured {
            n += 1;
            m.gain *= if n % 10 == 3 { 0.3 } else { 1.0 };
        }
        let robust = Illumination::new(&measured, Size::new(400, 300), 10.0);
        assert!((robust.brightness_at(200.0, 150.0) / light(200.0, 150.0) - 1.0).abs() < 0.01);
    }

    #[test]
    fn what_the_polynomial_leaves_is_in_the_cells() {
        // A bright half of a few cells; cells are 60 pixels wide.
        let light = |x: f64, y: f64| if (180.0..240.0).contains(&x) && (120.0..180.0).contains(&y) { 0.6 } else { 0.5 };
        let found = fitted(light);
        assert!((found.broad_at(210.0, 150.0) / 0.5 - 1.0).abs() < 0.02);
        // Smoothed twice by (1 2 1)/4 in both directions: 0.2 · (3/8)².
        let peak = found.rest_at(210.0, 150.0);
        assert!((peak - 1.0 - 0.2 * 0.140_625).abs() < 0.003, "{peak}");
        assert!(found.rest_at(210.0, 90.0) > found.rest_at(90.0, 150.0), "the cells above and below are nearer");
        // Towards the bright cell the light rises, from either side and direction.
        let rest = |x: f64, y: f64| {
            let slope = found.relative_slope(x, y);
            let broad = |x, y| found.broad_at(x, y);
            [
                slope[0] - (broad(x + 1.0, y) - broad(x - 1.0, y)) / (2.0 * broad(x, y)),
                slope[1] - (broad(x, y + 1.0) - broad(x, y - 1.0)) / (2.0 * broad(x, y)),
            ]
        };
        let expected =
            (found.rest_at(210.0, 150.0) - found.rest_at(90.0, 150.0)) / (120.0 * found.rest_at(150.0, 150.0));
        assert!((rest(150.0, 150.0)[0] - expected).abs() < 1e-12 && expected > 1e-5, "{expected}");
        assert!(rest(270.0, 150.0)[0] < -1e-5 && rest(210.0, 90.0)[1] > 1e-5 && rest(210.0, 210.0)[1] < -1e-5);
        // One-sided at the border, and between the cells' centres only.
        let border = (found.rest_at(390.0, 150.0) - found.rest_at(330.0, 150.0)) / (60.0 * found.rest_at(390.0, 150.0));
        assert!((rest(390.0, 150.0)[0] - border).abs() < 1e-9, "{} {border}", rest(390.0, 150.0)[0]);
    }

    #[test]
    fn steep_cells_and_odd_cells_do_not_count() {
        let mut broad = [0.0; TERMS];
        broad[0] = 1.0;
        let steps = |high: f64| Illumination {
            broad,
            least: 0.1,
            middle: [20.0, 15.0],
            half: 20.0,
            cell: 10.0,
            columns: 4,
            rows: 3,
            values: [1.0, 1.0, high, high].repeat(3),
        };
        assert_eq!(steps(2.0).relative_slope(20.0, 15.0), [0.0; 2]);
        let slope = steps(1.02).relative_slope(20.0, 15.0);
        assert!((slope[0] - 0.02 / (20.0 * 1.01)).abs() < 1e-12 && slope[1] == 0.0, "{slope:?}");
        let mut values = vec![f64::NAN, 2.0, 1.0, f64::NAN, 1.0, 1.0];
        fill_holes(&mut values, 3, 2);
        // (0, 0): right 2·2, below (a hole), diagonal 1·1 over the weights; the second hole likewise.
        assert_eq!(values, [5.0 / 3.0, 2.0, 1.0, 4.0 / 3.0, 1.0, 1.0]);
        let mut none = vec![f64::NAN; 4];
        fill_holes(&mut none, 2, 2);
        assert_eq!(none, [1.0; 4]);
        let cells: Vec<f64> = (0..12).map(|k| if k == 5 { 17.0 } else { 1.0 }).collect();
        // Four columns, three rows: only cells 5 and 6 are inside.
        let smooth = smooth_cells(&cells, 4, 3);
        assert_eq!((smooth[5], smooth[6]), (5.0, 3.0));
        assert!(smooth.iter().enumerate().all(|(k, v)| k == 5 || k == 6 || *v == 1.0));
    }

    #[test]
    fn full_light_is_that_of_the_brightest_hundredth_of_the_cells() {
        let found = fitted(|x, _| 0.3 + 0.001 * x);
        // Seven columns of cells, the last with its middle at 390.
        assert!((found.full_light() - 0.69).abs() < 1e-6, "{}", found.full_light());
        let few = Illumination::new(&lit(|_, _| 0.4)[..50], Size::new(400, 300), 10.0);
        assert!((few.brightness_at(300.0, 200.0) - 0.4).abs() < 1e-9);
        let none = Illumination::new(&[], Size::new(400, 300), 10.0);
        assert_eq!(none.brightness_at(10.0, 20.0), 1.0);
    }

    #[test]
    fn a_cell_takes_the_median_of_its_lenslets() {
        // The fourth row of six in each cell, in the middle of its list, is dark.
        let mut measured = lit(|_, _| 0.5);
        measured.iter_mut().filter(|m| m.j % 6 == 3).for_each(|m| m.gain = 0.38);
        let found = Illumination::new(&measured, Size::new(400, 300), 10.0);
        for (x, y) in [(30.0, 30.0), (210.0, 150.0), (390.0, 270.0)] {
            assert!((found.brightness_at(x, y) / 0.5 - 1.0).abs() < 0.02, "{}", found.brightness_at(x, y));
        }
    }
}
