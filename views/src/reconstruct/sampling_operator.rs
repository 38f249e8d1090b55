//! Back-projection onto measured samples: z ← z + U(y − S z), where S samples a plane as the camera does and U
//! interpolates the differences over the plane. A few rounds bring S z to y.

use lenslet_core::dictionary::Footprint;
use lenslet_core::geometry::Size;
use lenslet_core::sampling::{self, Weights, sample_image};
use ndarray::{Array2, ArrayView1, Axis};

/// The camera as an operator on the output plane: where it samples, and what each sample sees.
#[derive(Debug, Clone)]
pub struct SamplingOperator {
    centres: Vec<[f64; 2]>,
    table: Weights,
    footprint: sampling::Footprint,
}

impl SamplingOperator {
    /// Samples at `centres` (x, y in output pixels), each seeing `footprint` (`pitch` output pixels wide where it is
    /// the lenslet's), of a plane of (width, height).
    ///
    /// # Errors
    /// Centres that cannot be triangulated, a size out of range.
    pub fn new(centres: Vec<[f64; 2]>, footprint: Footprint, pitch: f64, size: Size) -> Result<Self, sampling::Error> {
        let table = Weights::new(&centres, size, size)?;
        let footprint = match footprint {
            Footprint::Lenslet => sampling::Footprint::Disc(pitch),
            Footprint::Point | Footprint::Grid => sampling::Footprint::Bilinear,
        };
        Ok(SamplingOperator { centres, table, footprint })
    }

    /// Interpolates one value a place to the whole plane.
    ///
    /// # Errors
    /// Another number of values.
    pub fn interpolate(&self, values: &[f32]) -> Result<Array2<f32>, sampling::Error> {
        let values = ndarray::ArrayView2::from_shape((values.len(), 1), values)
            .map_err(|e| sampling::Error::Shape(e.to_string()))?;
        Ok(self.table.apply(values)?.index_axis_move(Axis(2), 0))
    }

    /// The samples of a plane.
    ///
    /// # Errors
    /// An empty plane.
    pub fn sample(&self, plane: &Array2<f32>) -> Result<Array2<f32>, sampling::Error> {
        sample_image(plane.view().insert_axis(Axis(2)), &self.centres, self.footprint)
    }
}

/// Moves `plane` so that its samples approach `values`; returns it and the largest difference left.
///
/// A difference up to `noise` (standard deviation of each sample's noise; none where empty) is left as it is: it may be
/// noise.
///
/// # Errors
/// Shapes that do not belong together.
pub fn back_project(
    plane: &Array2<f32>,
    operator: &SamplingOperator,
    values: ArrayView1<'_, f32>,
    rounds: usize,
    noise: &[f32],
) -> Result<(Array2<f32>, f32), sampling::Error> {
    let n = operator.centres.len();
    if values.len() != n || !(noise.is_empty() || noise.len() == n) {
        return Err(sampling::Error::Shape(format!(
            "{} values and {} of noise for {n} measured places",
            values.len(),
            noise.len()
        )));
    }
    let mut current = plane.clone();
    let mut rest = difference(&current, operator, values, noise)?;
    for _ in 0..rounds {
        let correction = operator.table.apply(rest.view())?;
        let next = &current + &correction.index_axis(Axis(2), 0);
        let after = difference(&next, operator, values, noise)?;
        let energy = |a: &Array2<f32>| a.iter().map(|v| f64::from(v * v)).sum::<f64>();
        // Where a footprint is so wide that the rounds do not converge, the best plane so far is kept.
        if !(energy(&after) < energy(&rest)) {
            break;
        }
        (current, rest) = (next, after);
    }
    Ok((current, rest.iter().fold(0.0f32, |a, v| a.max(v.abs()))))
}

fn difference(
    plane: &Array2<f32>,
    operator: &SamplingOperator,
    values: ArrayView1<'_, f32>,
    noise: &[f32],
) -> Result<Array2<f32>, sampling::Error> {
    let mut rest = operator.sample(plane)?;
    for (k, (r, v)) in rest.iter_mut().zip(values).enumerate() {
        let d = v - *r;
        let allowed = noise.get(k).copied().unwrap_or(0.0);
        *r = if d.is_finite() { d.signum() * (d.abs() - allowed).max(0.0) } else { 0.0 };
    }
    Ok(rest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::sampling::lattice_samples;

    #[test]
    fn samples_come_back() {
        let truth =
            Array2::from_shape_fn((80, 90), |(y, x)| 0.5 + 0.2 * (x as f32 * 0.5).sin() * (y as f32 * 0.4).cos());
        for (footprint, core, tolerance) in [
            (Footprint::Point, sampling::Footprint::Bilinear, 0.01),
            (Footprint::Lenslet, sampling::Footprint::Disc(3.3), 0.02),
        ] {
            let (placed, values) =
                lattice_samples(truth.view().insert_axis(Axis(2)), 3.3, 0.002, [0.2, 0.6], core).unwrap();
            let operator = SamplingOperator::new(placed.centres, footprint, 3.3, Size::new(90, 80)).unwrap();
            let start = Array2::from_elem((80, 90), 0.5);
            let (result, left) = back_project(&start, &operator, values.column(0), 12, &[]).unwrap();
            assert!(left < tolerance, "{footprint}: {left}");
            let error = |p: &Array2<f32>| (p - &truth).mapv(|v| v * v).mean().unwrap();
            assert!(error(&result) < 0.2 * error(&start));
            // Differences within the noise are left alone.
            let noise = vec![1.0; values.nrows()];
            let (same, _) = back_project(&start, &operator, values.column(0), 5, &noise).unwrap();
            assert_eq!(same, start);
            assert!(back_project(&start, &operator, values.column(0), 5, &noise[1..]).is_err());
        }
        assert!(SamplingOperator::new(vec![[0.0, 0.0]], Footprint::Point, 3.3, Size::new(9, 9)).is_err());
    }
}
