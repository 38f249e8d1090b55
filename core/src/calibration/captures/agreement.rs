//! Trust in a lenslet's own centre without white images: the variance between captures that are each measured alone
//! takes the place of the measurement's variance in shrinkage.

use super::flatten::flatten_capture;
use crate::calibration::centres::measure::measure_lenslets;
use crate::calibration::centres::measured::{self, MeasuredLenslet};
use crate::calibration::centres::predicted::PredictedLenslet;
use crate::calibration::error::Error;
use crate::calibration::locate::{self, LocatedLenslets};
use crate::calibration::photometric::hot_pixels;
use crate::calibration::screening::Screened;
use crate::calibration::smoothing::shrink;
use crate::geometry::Size;
use crate::progress::Observer;

/// Largest misfit of a lenslet in one capture, relative to the typical one.
/// Source: chosen
const FITS: f64 = 4.0;
/// Largest distance of a lenslet in one capture from the lattice, in pitches.
/// Source: chosen
const NEAR: f64 = 0.15;

/// Replaces the centres of `found` by the means over the captures, shrunk by the variance between captures, which is
/// due to the scenes. A single capture gives no variance: its centres are those of the lattice, with trust 0.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn weigh_by_agreement(
    captures: &[Screened],
    hot: &[u32],
    size: Size,
    found: &mut LocatedLenslets,
    observer: &dyn Observer,
) -> Result<(), Error> {
    let Size { width, height } = size;
    let grid = found.lattice;
    if captures.len() == 1 {
        for l in &mut found.lenslets {
            [l.x, l.y] = grid.centre(l.i, l.j);
            l.trust = 0.0;
        }
        let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
        found.lenslets.retain(|l| l.x >= 0.0 && l.y >= 0.0 && l.x <= right && l.y <= bottom);
        return Ok(());
    }
    let sites: Vec<PredictedLenslet> = grid
        .points_within(Size::new(width, height), 1.0)
        .index
        .into_iter()
        .map(|[i, j]| {
            let [x, y] = grid.centre(i, j);
            PredictedLenslet { i, j, x, y, gain: 1.0, slope: [0.0; 2] }
        })
        .collect();
    let mut sums = vec![[0f64; 5]; sites.len()];
    for (_, capture) in captures {
        let (mut image, _) = flatten_capture(capture, hot)?;
        hot_pixels::mask_hot_pixels(&mut image, hot);
        let measured = measure_lenslets(&image, &found.profile, &sites, f64::INFINITY);
        let typical = measured::typical_misfit(&measured).powi(2);
        for ((sum, m), site) in sums.iter_mut().zip(&measured).zip(&sites) {
            let (dx, dy) = (m.x - site.x, m.y - site.y);
            if m.usable && m.misfit < FITS * typical && dx.hypot(dy) < NEAR * grid.pitch() {
                for (slot, v) in sum.iter_mut().zip([1.0, dx, dy, dx * dx, dy * dy]) {
                    *slot += v;
                }
            }
        }
        observer.advance(1);
        observer.check()?;
    }
    // Variance between captures, pooled over all lenslets seen at least twice.
    let (mut within, mut degrees) = ([0f64; 2], 0f64);
    for s in sums.iter().filter(|s| s[0] >= 2.0) {
        within[0] += s[3] - s[1] * s[1] / s[0];
        within[1] += s[4] - s[2] * s[2] / s[0];
        degrees += s[0] - 1.0;
    }
    let measured: Vec<MeasuredLenslet> = sites
        .iter()
        .zip(&sums)
        .map(|(p, s)| {
            let n = s[0].max(1.0);
            let mut m = MeasuredLenslet::from_position(p.i, p.j, p.x + s[1] / n, p.y + s[2] / n);
            m.usable = s[0] >= 2.0 && degrees > 0.0;
            m.unit = within.map(|w| if m.usable { w / degrees / n } else { f64::INFINITY });
            m.misfit = 1.0;
            m
        })
        .collect();
    found.shrunk = shrink::shrink_centres(&grid, &measured, Size::new(width, height));
    found.lenslets = locate::lenslets_on_sensor(&measured, &found.shrunk, width, height);
    Ok(())
}
