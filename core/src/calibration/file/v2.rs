//! Format version 2, compact: lenslets as steps in (i, j) and residuals from the lattice, the white image as
//! differences from itself a micro-image earlier. Arrays of N-byte numbers are stored as N planes (all first bytes, all
//! second bytes …), since the upper planes are almost all zero and compress well. Signed numbers are zigzagged: 0, -1,
//! 1, -2 … are 0, 1, 2, 3 …
//!
//! ```text
//! u32 ×2   lag of the white image (x, y), pixels; 0 0 without one
//! i32 ×n   i minus the i of the lenslet before; then j likewise
//! i32 ×n   x minus the lattice's x, in 1/16384 px; then y likewise
//! u8  ×n   trust·255
//! u32 ×h   hot pixels: index minus the index before
//! i16 ×p   white image: code minus the code predicted (see `white`)
//! ```

use super::header::{self, Header, Payload};
use super::white;
use crate::calibration::model::{Calibration, Lattice, Lenslet};

/// Steps per pixel in which residuals from the lattice are stored.
/// Source: file format version 2
const STEPS: f64 = 16384.0;
/// Bytes a lenslet takes.
const LENSLET: usize = 4 * 4 + 1;

/// Length of what [`write`] adds.
pub fn bytes_of(lenslets: usize, hot_pixels: usize, pixels: usize) -> usize {
    8 + lenslets * LENSLET + 4 * hot_pixels + 2 * pixels
}

/// Appends lenslets, hot pixels and white image of a calibration.
pub fn write(calibration: &Calibration, out: &mut Vec<u8>) {
    let lenslets = &calibration.lenslets;
    let codes = calibration.vignetting.as_ref().map(|v| (v.width, white::codes(&v.white)));
    let lag = codes.as_ref().map_or([0; 2], |(width, codes)| white::best_lag(codes, *width));
    out.extend(lag.iter().flat_map(|&l| (l as u32).to_le_bytes()));
    let steps = |of: fn(&Lenslet) -> i32| {
        let before = std::iter::once(0).chain(lenslets.iter().map(of));
        lenslets.iter().map(of).zip(before).map(|(now, before)| zigzag(now.wrapping_sub(before))).collect::<Vec<u32>>()
    };
    planes(&steps(|l| l.i).iter().map(|v| v.to_le_bytes()).collect::<Vec<_>>(), out);
    planes(&steps(|l| l.j).iter().map(|v| v.to_le_bytes()).collect::<Vec<_>>(), out);
    for axis in 0..2 {
        let off = lenslets.iter().map(|l| {
            let d = [l.x, l.y][axis] - calibration.lattice.centre(l.i, l.j)[axis];
            zigzag((d * STEPS).round() as i32).to_le_bytes()
        });
        planes(&off.collect::<Vec<_>>(), out);
    }
    out.extend(lenslets.iter().map(|l| (l.trust * 255.0).round() as u8));
    let hot = &calibration.hot_pixels;
    let before = std::iter::once(0).chain(hot.iter().copied());
    planes(
        &hot.iter().zip(before).map(|(now, before)| now.wrapping_sub(before).to_le_bytes()).collect::<Vec<_>>(),
        out,
    );
    if let Some((width, codes)) = codes {
        planes(&white::differences(&codes, width, lag).iter().map(|d| d.to_le_bytes()).collect::<Vec<_>>(), out);
    }
}

/// Reads what [`write`] wrote; `from` has the length that [`bytes_of`] gives.
///
/// # Errors
/// Hot pixels out of order or off the sensor.
pub fn read(from: &[u8], header: &Header, lattice: &Lattice, pixels: usize) -> Result<Payload, &'static str> {
    let n = header.lenslets;
    let (lag, rest) = from.split_at(8);
    let lag = [0, 1].map(|k| u32::from_le_bytes(header::item_bytes(lag, k)) as usize);
    let (i, rest) = rest.split_at(4 * n);
    let (j, rest) = rest.split_at(4 * n);
    let (x, rest) = rest.split_at(4 * n);
    let (y, rest) = rest.split_at(4 * n);
    let (trust, rest) = rest.split_at(n);
    let (hot, image) = rest.split_at(4 * header.hot_pixels);
    let (right, bottom) = (header.width as f64 - 1.0, header.height as f64 - 1.0);
    let number = |of: &[u8], k: usize| unzigzag(u32::from_le_bytes(plane(of, n, k)));
    let mut at = [0i32; 2];
    let lenslets = (0..n)
        .map(|k| {
            at = [at[0].wrapping_add(number(i, k)), at[1].wrapping_add(number(j, k))];
            let c = lattice.centre(at[0], at[1]);
            Lenslet {
                i: at[0],
                j: at[1],
                x: within(c[0] + f64::from(number(x, k)) / STEPS, right),
                y: within(c[1] + f64::from(number(y, k)) / STEPS, bottom),
                trust: f32::from(trust[k]) / 255.0,
            }
        })
        .collect();
    let mut hot_pixels: Vec<u32> = Vec::with_capacity(header.hot_pixels);
    let sensor = (header.width * header.height) as u64;
    for k in 0..header.hot_pixels {
        let step = u32::from_le_bytes(plane(hot, header.hot_pixels, k));
        let index = hot_pixels.last().map_or(0, |&b| u64::from(b)) + u64::from(step);
        if index >= sensor || (k > 0 && step == 0) {
            return Err("its hot pixels are not on its sensor, or not in order");
        }
        hot_pixels.push(index as u32);
    }
    let differences: Vec<u16> = (0..pixels).map(|k| u16::from_le_bytes(plane(image, pixels, k))).collect();
    Ok(Payload { lenslets, hot_pixels, white: white::values(&differences, header.width, lag) })
}

/// Moves a centre that rounding put off the sensor, by less than a step, back to its edge.
fn within(v: f64, end: f64) -> f64 {
    let near = |edge: f64| (v - edge).abs() < 1.0 / STEPS;
    if v < 0.0 && near(0.0) {
        0.0
    } else if v > end && near(end) {
        end
    } else {
        v
    }
}

/// All first bytes, then all second bytes …
fn planes<const N: usize>(values: &[[u8; N]], out: &mut Vec<u8>) {
    for b in 0..N {
        out.extend(values.iter().map(|v| v[b]));
    }
}

/// The `k`th of `n` numbers stored as planes.
fn plane<const N: usize>(from: &[u8], n: usize, k: usize) -> [u8; N] {
    std::array::from_fn(|b| from[b * n + k])
}

fn zigzag(v: i32) -> u32 {
    ((v << 1) ^ (v >> 31)) as u32
}

fn unzigzag(v: u32) -> i32 {
    (v >> 1) as i32 ^ -((v & 1) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zigzag_goes_both_ways() {
        assert_eq!([0, -1, 1, -2, 2].map(zigzag), [0, 1, 2, 3, 4]);
        for v in [0, 1, -1, 77, -77, i32::MAX, i32::MIN] {
            assert_eq!(unzigzag(zigzag(v)), v);
        }
    }

    #[test]
    fn planes_go_both_ways() {
        let values: Vec<[u8; 4]> = (0..9u32).map(|k| (k * 0x0102_0305).to_le_bytes()).collect();
        let mut out = Vec::new();
        planes(&values, &mut out);
        assert!((0..9).all(|k| plane::<4>(&out, 9, k) == values[k]));
    }

    #[test]
    fn centres_that_rounding_put_off_the_sensor_come_back_to_its_edge() {
        let step = 1.0 / STEPS;
        assert_eq!((within(-0.5 * step, 9.0), within(9.0 + 0.5 * step, 9.0)), (0.0, 9.0));
        assert_eq!((within(3.25, 9.0), within(0.5 * step, 9.0)), (3.25, 0.5 * step));
        assert_eq!((within(-2.0 * step, 9.0), within(9.5, 9.0)), (-2.0 * step, 9.5));
        assert_eq!(within(9.0 - 0.5 * step, 9.0), 9.0 - 0.5 * step);
    }
}
