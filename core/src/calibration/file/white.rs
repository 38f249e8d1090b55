//! The white image in a file. A pixel is coded as the square root of its light in 1/1024: shot noise grows with the
//! square root, so the rounding error is the same share of the noise everywhere. Stored are differences from the same
//! position in an earlier micro-image: micro-images repeat, so the differences are mostly noise.

/// Light 1.0 (32768 in memory) has code 1024: code c is c²/2⁵.
/// Source: file format version 2
const SHIFT: u32 = 5;
/// Longest lag tried, pixels; lags are even, so that pixels of one colour are compared.
/// Source: file format version 2
const LONGEST: usize = 128;
/// Pixels compared to choose the lag, about.
/// Source: chosen
const SAMPLE: usize = 100_000;

/// Codes of the pixels.
pub fn codes(white: &[u16]) -> Vec<u16> {
    let table: Vec<u16> = (0..=u32::from(u16::MAX)).map(|v| f64::from(v << SHIFT).sqrt().round() as u16).collect();
    white.iter().map(|&v| table[usize::from(v)]).collect()
}

fn value(code: u16) -> u16 {
    let c = u32::from(code).min(1448);
    ((c * c + (1 << (SHIFT - 1))) >> SHIFT) as u16
}

/// The pixel one lag earlier; at the border the one two to the left, else two above, else 0.
#[inline]
fn predicted(codes: &[u16], k: usize, width: usize, lag: [usize; 2]) -> u16 {
    let (x, y) = (k % width, k / width);
    let back = if lag != [0, 0] && x >= lag[0] && y >= lag[1] {
        lag[1] * width + lag[0]
    } else if x >= 2 {
        2
    } else {
        2 * width
    };
    if back <= k { codes[k - back] } else { 0 }
}

/// Differences from the prediction, zigzagged.
pub fn differences(codes: &[u16], width: usize, lag: [usize; 2]) -> Vec<u16> {
    (0..codes.len())
        .map(|k| {
            let d = codes[k].wrapping_sub(predicted(codes, k, width, lag)) as i16;
            ((d << 1) ^ (d >> 15)) as u16
        })
        .collect()
}

/// The pixels that have these differences.
pub fn values(differences: &[u16], width: usize, lag: [usize; 2]) -> Vec<u16> {
    let mut codes: Vec<u16> = Vec::with_capacity(differences.len());
    // A lag longer than the writer tries is invalid and is treated as none.
    let lag = if lag.iter().all(|&l| l <= LONGEST) { lag } else { [0, 0] };
    for (k, &d) in differences.iter().enumerate() {
        let d = (d >> 1) as i16 ^ -((d & 1) as i16);
        codes.push(predicted(&codes, k, width, lag).wrapping_add(d as u16));
    }
    codes.into_iter().map(value).collect()
}

/// The lag along a row or a column with the smallest sum of absolute differences.
pub fn best_lag(codes: &[u16], width: usize) -> [usize; 2] {
    let step = (codes.len() / SAMPLE).max(1);
    let left = |lag: [usize; 2]| {
        let chosen = (0..codes.len()).step_by(step);
        chosen.map(|k| u64::from(codes[k].abs_diff(predicted(codes, k, width, lag)))).sum::<u64>()
    };
    let along = (2..=LONGEST).step_by(2);
    along.flat_map(|l| [[l, 0], [0, l]]).min_by_key(|&lag| left(lag)).unwrap_or([0, 0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_light_within_their_step_and_come_back_the_same() {
        for v in 0..=u16::MAX {
            let code = codes(&[v])[0];
            let again = value(code);
            let step = f64::from(v).sqrt() * 2.0 / 32f64.sqrt();
            assert!(f64::from(again.abs_diff(v)) <= 0.5 * step + 1.0 && value(codes(&[again])[0]) == again, "{v}");
        }
        assert_eq!((codes(&[32768])[0], value(1024)), (1024, 32768));
    }

    #[test]
    fn any_lag_gives_the_pixels_back_and_the_best_finds_the_period() {
        let width = 60;
        let codes: Vec<u16> = (0..60 * 40).map(|k| ((k % 60) % 12 * 100 + (k / 60) * 7919 % 997) as u16).collect();
        for lag in [[0, 0], [2, 0], [12, 0], [0, 14], [128, 128]] {
            let white = values(&differences(&codes, width, lag), width, lag);
            assert!(white.iter().zip(&codes).all(|(&w, &c)| w == value(c)), "{lag:?}");
        }
        assert_eq!(best_lag(&codes, width), [12, 0]);
    }

    #[test]
    fn a_pixel_is_predicted_from_one_lag_before_or_its_neighbours() {
        // Four columns: 0 1 2 3 / 4 5 6 7 / 8 …
        let codes: Vec<u16> = (100..120).collect();
        let from = |k: usize, lag: [usize; 2]| predicted(&codes, k, 4, lag);
        assert_eq!((from(6, [2, 1]), from(14, [0, 2])), (100, 106));
        // Too near the left or the upper border for the lag: two to the left, else two above, else nothing.
        assert_eq!((from(3, [0, 1]), from(2, [3, 0]), from(7, [0, 2])), (101, 100, 105));
        assert_eq!((from(9, [2, 0]), from(8, [2, 0]), from(4, [2, 0]), from(0, [0, 0])), (101, 100, 0, 0));
        assert_eq!((from(6, [0, 0]), from(9, [0, 0])), (104, 101));
    }
}
