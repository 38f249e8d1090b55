//! Specks: small patches whose disparity differs from all around them. Highlights, dust and repeated texture make them,
//! and few objects are that small.

/// Fills every patch that is no longer than `side` pixels either way, and that jumps by more than `jump` all around,
/// with the median of what borders on it; its confidence becomes 0. `disparity` is `width` pixels a row.
pub fn fill(disparity: &mut [f32], confidence: &mut [f32], width: usize, jump: f32, side: usize) {
    if width == 0 || side == 0 {
        return;
    }
    let count = disparity.len();
    let around = |k: usize| {
        let s = k % width;
        let left = (s > 0).then(|| k - 1);
        let right = (s + 1 < width).then_some(k + 1);
        let below = Some(k + width).filter(|&k| k < count);
        [left, right, k.checked_sub(width), below].into_iter().flatten()
    };
    let mut seen = vec![false; disparity.len()];
    let mut fills: Vec<(Vec<usize>, f32)> = Vec::new();
    let mut patch = Vec::new();
    for first in 0..disparity.len() {
        if seen[first] {
            continue;
        }
        patch.clear();
        patch.push(first);
        seen[first] = true;
        let (mut left, mut right, mut bottom) = (first % width, first % width, first / width);
        let mut next = 0;
        while let Some(&k) = patch.get(next) {
            next += 1;
            (left, right, bottom) = (left.min(k % width), right.max(k % width), bottom.max(k / width));
            for n in around(k) {
                if !seen[n] && (disparity[n] - disparity[k]).abs() <= jump {
                    seen[n] = true;
                    patch.push(n);
                }
            }
        }
        // The first pixel found is in the topmost row.
        if right - left < side && bottom - first / width < side && patch.len() < disparity.len() {
            let inside: std::collections::HashSet<usize> = patch.iter().copied().collect();
            let mut border: Vec<f32> =
                patch.iter().flat_map(|&k| around(k)).filter(|n| !inside.contains(n)).map(|n| disparity[n]).collect();
            border.sort_unstable_by(f32::total_cmp);
            if let Some(&median) = border.get(border.len() / 2) {
                fills.push((patch.clone(), median));
            }
        }
    }
    // All at once, so that no patch is filled from one already filled.
    for (patch, value) in fills {
        for k in patch {
            disparity[k] = value;
            confidence[k] = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specks_are_filled_and_larger_patches_stay() {
        let (width, height) = (60usize, 40usize);
        let clean = |k: usize| {
            let (s, t) = ((k % width) as f32, (k / width) as f32);
            // A slope, a nearer plane to the right, and a long thin thing across.
            if s >= 40.0 {
                2.0
            } else if t == 20.0 {
                -1.5
            } else {
                0.02 * s
            }
        };
        let speck = |k: usize| {
            let (s, t) = (k % width, k / width);
            ((5..9).contains(&s) && (5..8).contains(&t)) || ((50..56).contains(&s) && (30..36).contains(&t)) || k == 0
        };
        let mut disparity: Vec<f32> = (0..width * height).map(|k| if speck(k) { -4.0 } else { clean(k) }).collect();
        let mut confidence = vec![0.7; width * height];
        fill(&mut disparity, &mut confidence, width, 0.3, 6);
        for k in 0..width * height {
            assert!((disparity[k] - clean(k)).abs() < 0.06, "{} at {k}", disparity[k]);
            assert_eq!(confidence[k], if speck(k) { 0.0 } else { 0.7 });
        }
        // Larger things, and all of a picture that is small, stay.
        let before = disparity.clone();
        fill(&mut disparity, &mut confidence, width, 0.3, 0);
        assert_eq!(disparity, before);
        let mut one = [1.0, 1.0];
        fill(&mut one, &mut [1.0, 1.0], 2, 0.3, 6);
        assert_eq!(one, [1.0, 1.0]);
    }
}
