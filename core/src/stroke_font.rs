//! Capital letters and digits as strokes: captions of pictures and lettering of drawn scenes, at any size.

/// Distance of (`x`, `y`) to the segment from `a` to `b`.
///
/// ```
/// use lenslet_core::stroke_font::distance_to_segment;
/// assert_eq!(distance_to_segment(1.0, 2.0, [0.0, 0.0], [4.0, 0.0]), 2.0);
/// assert_eq!(distance_to_segment(7.0, 4.0, [0.0, 0.0], [4.0, 0.0]), 5.0);
/// ```
#[inline]
pub fn distance_to_segment(x: f64, y: f64, a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let along = (((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy).max(1e-12)).clamp(0.0, 1.0);
    (x - a[0] - along * dx).hypot(y - a[1] - along * dy)
}

/// Strokes of the letters: points of a 4×6 grid (column, row from the top) as pairs of digits, strokes separated by
/// spaces.
const LETTERS: [(char, &str); 36] = [
    ('A', "062046 1434"),
    ('B', "00063645443303 0030414233"),
    ('C', "4130100105163645"),
    ('D', "0006264541200000"),
    ('E', "40000646 0333"),
    ('F', "400006 0333"),
    ('G', "41301001051636454323"),
    ('H', "0006 4046 0343"),
    ('I', "2026 1030 1636"),
    ('J', "4045361605"),
    ('K', "0006 400346"),
    ('L', "000646"),
    ('M', "0600234046"),
    ('N', "06004640"),
    ('O', "103041453616050110"),
    ('P', "06003041423303"),
    ('Q', "103041453616050110 2446"),
    ('R', "06003041423303 2346"),
    ('S', "41301001021333444536160504"),
    ('T', "0040 2026"),
    ('U', "000516364540"),
    ('V', "002640"),
    ('W', "0016233640"),
    ('X', "0046 4006"),
    ('Y', "002340 2326"),
    ('Z', "00400646"),
    ('0', "103041453616050110 0541"),
    ('1', "112026 1636"),
    ('2', "01103041420646"),
    ('3', "01103041423323 334445361605"),
    ('4', "36300444"),
    ('5', "400003334445361605"),
    ('6', "4130100105163645443303"),
    ('7', "004016"),
    ('8', "103041423313020110 3344453616050413"),
    ('9', "4313020110304145361605"),
];

/// Whether (`x`, `y`) lies on a stroke of `words`, written from (0, 0) to the right; y points down. Letters reach from
/// 0 to `height`; each takes `height` of width, its gap included. `weight` is the width of a stroke in sixths of the
/// height. Lower-case letters are drawn as capitals; anything but A to Z and 0 to 9 is a gap.
///
/// ```
/// use lenslet_core::stroke_font::is_on_text;
/// // The left stem of an H, the gap between its stems, and the stem of the I beside it.
/// assert!(is_on_text(0.0, 1.0, "HI", 6.0, 0.8));
/// assert!(!is_on_text(2.0, 1.0, "HI", 6.0, 0.8));
/// assert!(is_on_text(8.0, 1.0, "HI", 6.0, 0.8));
/// ```
pub fn is_on_text(x: f64, y: f64, words: &str, height: f64, weight: f64) -> bool {
    let unit = height / 6.0;
    let (gx, gy) = (x / unit, y / unit);
    if !(-1.0..=7.0).contains(&gy) || gx < -1.0 {
        return false;
    }
    let cell = (gx / 6.0).floor().max(0.0) as usize;
    [cell.checked_sub(1), Some(cell)].into_iter().flatten().any(|k| {
        let Some(letter) = words.chars().nth(k) else { return false };
        strokes(gx - 6.0 * k as f64, gy, letter.to_ascii_uppercase(), 0.5 * weight)
    })
}

/// Whether a position in letter units lies within `reach` of a stroke of `letter`.
fn strokes(x: f64, y: f64, letter: char, reach: f64) -> bool {
    let Some((_, path)) = LETTERS.iter().find(|(name, _)| *name == letter) else { return false };
    path.split(' ').any(|stroke| {
        stroke.as_bytes().windows(4).step_by(2).any(|p| {
            let at = |k: usize| f64::from(p[k].saturating_sub(b'0'));
            distance_to_segment(x, y, [at(0), at(1)], [at(2), at(3)]) <= reach
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_is_drawn_within_its_box_and_differs_from_the_others() {
        let mut seen = Vec::new();
        for (letter, path) in LETTERS {
            assert!(path.split(' ').all(|s| s.len() % 2 == 0 && s.len() >= 4), "{letter}");
            let bits: Vec<bool> = (0..35).map(|k| strokes(f64::from(k % 5), f64::from(k / 5), letter, 0.4)).collect();
            assert!(bits.iter().filter(|b| **b).count() >= 5, "{letter}");
            assert!(!strokes(5.5, 3.0, letter, 0.4) && !strokes(2.0, -1.0, letter, 0.4));
            assert!(!seen.contains(&(bits.clone(), path)), "{letter}");
            seen.push((bits, path));
        }
        assert!(
            is_on_text(0.0, 3.0, "HI", 6.0, 0.8)
                && is_on_text(8.0, 3.0, "HI", 6.0, 0.8)
                && !is_on_text(4.9, 3.0, "HI", 6.0, 0.8)
        );
        assert!(!is_on_text(14.0, 3.0, "HI", 6.0, 0.8));
    }
}
