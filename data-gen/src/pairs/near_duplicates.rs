//! Near duplicates among pairs: those of repeated patterns add nothing new, and would get too much weight.

use std::collections::HashMap;

/// Two pairs are near duplicates when both their features and their residuals differ by less than this part of the
/// norm.
/// Source: chosen.
const NEAR: f32 = 0.1;
/// Leading features, the strongest components, whose rounded values name the bucket that is searched.
/// Source: chosen.
const LEADING: usize = 6;
/// Members of a bucket that a pair is compared with, the latest ones.
/// Source: chosen; bounds the time for buckets of many members.
const COMPARED: usize = 16;

/// The pairs so far, in buckets of rounded unit features. Near duplicates on two sides of a rounding border are missed;
/// what is found depends only on the pairs and their order.
#[derive(Debug, Default)]
pub(super) struct NearDuplicates {
    buckets: HashMap<[i8; LEADING + 1], Vec<u32>>,
    seen: u32,
}

impl NearDuplicates {
    /// Whether the last row of `features` (rows of `m`) and `residuals` (rows of `p`) has no near duplicate before it;
    /// then it is kept in a bucket, otherwise the caller must remove the row.
    pub(super) fn is_new(&mut self, features: &[f32], residuals: &[f32], m: usize, p: usize) -> bool {
        let row = self.seen as usize;
        let (f, r) = (&features[row * m..(row + 1) * m], &residuals[row * p..(row + 1) * p]);
        let bucket = self.buckets.entry(key(f)).or_default();
        let twin = bucket.iter().rev().take(COMPARED).any(|&other| {
            let other = other as usize;
            near(f, &features[other * m..(other + 1) * m]) && near(r, &residuals[other * p..(other + 1) * p])
        });
        if !twin {
            bucket.push(self.seen);
            self.seen += 1;
        }
        !twin
    }
}

fn key(features: &[f32]) -> [i8; LEADING + 1] {
    let norm = features.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-6);
    let mut key = [0; LEADING + 1];
    for (k, v) in key.iter_mut().zip(features.iter().take(LEADING)) {
        *k = (4.0 * v / norm).round() as i8;
    }
    key[LEADING] = (2.0 * norm.log2()).round() as i8;
    key
}

fn near(a: &[f32], b: &[f32]) -> bool {
    let norm: f32 = a.iter().map(|v| v * v).sum();
    let apart: f32 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    apart <= NEAR * NEAR * norm
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pairs_alike_in_both_halves_are_twins() {
        let mut twins = NearDuplicates::default();
        let (mut f, mut r) = (vec![1.0f32, 0.1, 0.3], vec![0.5f32, -0.5]);
        assert!(twins.is_new(&f, &r, 3, 2));
        let mut add = |features: [f32; 3], residuals: [f32; 2]| {
            let at = (f.len(), r.len());
            f.extend(features);
            r.extend(residuals);
            let new = twins.is_new(&f, &r, 3, 2);
            if !new {
                f.truncate(at.0);
                r.truncate(at.1);
            }
            new
        };
        assert!(!add([1.0, 0.1, 0.3], [0.5, -0.5]));
        assert!(!add([1.01, 0.1, 0.29], [0.52, -0.5]));
        assert!(add([1.0, 0.1, 0.3], [0.5, 0.5]), "another residual");
        assert!(add([1.5, 0.15, 0.45], [0.5, -0.5]), "another contrast");
        assert!(add([0.0, 0.1, 1.0], [0.5, -0.5]), "other features");
        assert!(!add([1.5, 0.15, 0.45], [0.5, -0.5]));
    }
}
