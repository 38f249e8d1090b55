//! The broad light of the main lens, from the lenslets' own brightness: its slope would pull every paraboloid towards the
//! sensor's middle, so measuring divides by it.

use super::measure::Measured;

/// Smooth brightness on a coarse grid over the sensor.
#[derive(Debug, Clone)]
pub struct Field {
    cell: f64,
    columns: usize,
    rows: usize,
    values: Vec<f64>,
}

impl Field {
    /// Medians of the lenslets' brightness over cells of about six lenslets a side, holes filled from neighbours, smoothed.
    pub fn new(measured: &[Measured], width: usize, height: usize, pitch: f64) -> Self {
        let cell = (6.0 * pitch).max(width.max(height) as f64 / 256.0);
        let columns = (width as f64 / cell).ceil().max(1.0) as usize;
        let rows = (height as f64 / cell).ceil().max(1.0) as usize;
        let mut lists: Vec<Vec<f64>> = vec![Vec::new(); columns * rows];
        for m in measured {
            if m.usable && m.gain > 0.0 {
                let c = ((m.x / cell).max(0.0) as usize).min(columns - 1);
                let r = ((m.y / cell).max(0.0) as usize).min(rows - 1);
                lists[r * columns + c].push(m.gain);
            }
        }
        let mut values: Vec<f64> = lists
            .iter_mut()
            .map(|l| {
                l.sort_by(f64::total_cmp);
                if l.len() < 4 { f64::NAN } else { l[l.len() / 2] }
            })
            .collect();
        fill(&mut values, columns, rows);
        for _ in 0..2 {
            values = smooth(&values, columns, rows);
        }
        Field { cell, columns, rows, values }
    }

    /// Brightness at (`x`, `y`), bilinear between the cells' middles, held at the border.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let u = (x / self.cell - 0.5).clamp(0.0, (self.columns - 1) as f64);
        let v = (y / self.cell - 0.5).clamp(0.0, (self.rows - 1) as f64);
        let (c, r) = (u as usize, v as usize);
        let (c1, r1) = ((c + 1).min(self.columns - 1), (r + 1).min(self.rows - 1));
        let (fu, fv) = (u - c as f64, v - r as f64);
        let value = |r: usize, c: usize| self.values[r * self.columns + c];
        (value(r, c) * (1.0 - fu) + value(r, c1) * fu) * (1.0 - fv)
            + (value(r1, c) * (1.0 - fu) + value(r1, c1) * fu) * fv
    }

    /// Relative slope (∂F/∂x, ∂F/∂y)/F at (`x`, `y`), 1/pixel; over a cell's distance, one-sided at the border.
    pub fn slope(&self, x: f64, y: f64) -> [f64; 2] {
        let half = self.cell;
        let (right, bottom) = ((self.columns as f64 - 0.5) * self.cell, (self.rows as f64 - 0.5) * self.cell);
        let bounds = |p: f64, end: f64| {
            let (low, high) = ((p - half).max(0.5 * self.cell), (p + half).min(end));
            if high - low > 0.5 * self.cell { Some((low, high)) } else { None }
        };
        let here = self.at(x, y);
        let of = |range: Option<(f64, f64)>, horizontal: bool| {
            let Some((low, high)) = range else { return 0.0 };
            let (a, b) =
                if horizontal { (self.at(low, y), self.at(high, y)) } else { (self.at(x, low), self.at(x, high)) };
            ((b - a) / ((high - low) * here)).clamp(-0.05, 0.05)
        };
        [of(bounds(x, right), true), of(bounds(y, bottom), false)]
    }

    /// Brightness reached by the brightest hundredth of the sensor: full light.
    pub fn full(&self) -> f64 {
        let mut all = self.values.clone();
        all.sort_by(f64::total_cmp);
        all[(all.len() * 99 / 100).min(all.len() - 1)]
    }
}

fn fill(values: &mut Vec<f64>, columns: usize, rows: usize) {
    for _ in 0..columns + rows {
        if values.iter().all(|v| v.is_finite()) {
            return;
        }
        *values = smooth_holes(values, columns, rows);
    }
    for v in values.iter_mut().filter(|v| !v.is_finite()) {
        *v = 1.0;
    }
}

fn around(values: &[f64], columns: usize, rows: usize, k: usize) -> (f64, f64) {
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

fn smooth_holes(values: &[f64], columns: usize, rows: usize) -> Vec<f64> {
    (0..values.len())
        .map(|k| {
            if values[k].is_finite() {
                return values[k];
            }
            let (sum, weight) = around(values, columns, rows, k);
            if weight > 0.0 { sum / weight } else { f64::NAN }
        })
        .collect()
}

fn smooth(values: &[f64], columns: usize, rows: usize) -> Vec<f64> {
    (0..values.len())
        .map(|k| {
            let (c, r) = (k % columns, k / columns);
            // The rim keeps its values: a one-sided mean would flatten the slope there.
            if c == 0 || r == 0 || c + 1 == columns || r + 1 == rows {
                return values[k];
            }
            let (sum, weight) = around(values, columns, rows, k);
            sum / weight
        })
        .collect()
}
