//! Thin curves in a picture: pixels where a strength is largest across its direction, kept by two thresholds and linked.

use lenslet_core::image::Plane;

/// How strong a picture is at each pixel (an edge, a ridge), and the direction across it.
pub(super) struct Strength {
    pub(super) strength: Plane,
    /// Unit vector across, or (0, 0).
    pub(super) across: Vec<[f32; 2]>,
}

impl Strength {
    /// Pixels whose strength is largest across their direction and above the quantile `high` of all, or above `low` and
    /// linked with such; none within `border` pixels of the border (J. Canny, 1986).
    pub(super) fn thin(&self, low: f64, high: f64, border: usize) -> Vec<bool> {
        let (w, h) = (self.strength.width, self.strength.height);
        let mut sorted = self.strength.data.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let quantile = |q: f64| sorted.get((q * sorted.len() as f64) as usize).copied().unwrap_or(f32::INFINITY);
        let (low, high) = (quantile(low).max(1e-6), quantile(high).max(1e-6));
        let border = border.max(1);
        let mut mark = vec![false; w * h];
        let mut strong = Vec::new();
        for t in border..h.saturating_sub(border) {
            for s in border..w.saturating_sub(border) {
                let k = t * w + s;
                let own = self.strength.data[k];
                let [dx, dy] = self.across[k];
                let at = |sign: f32| self.strength.bilinear_at(s as f32 + sign * dx, t as f32 + sign * dy);
                if own >= low && own >= at(1.0) && own > at(-1.0) {
                    mark[k] = true;
                    if own >= high {
                        strong.push(k);
                    }
                }
            }
        }
        let mut kept = vec![false; w * h];
        strong.iter().for_each(|&k| kept[k] = true);
        while let Some(k) = strong.pop() {
            for n in neighbours(k, w) {
                if mark[n] && !kept[n] {
                    kept[n] = true;
                    strong.push(n);
                }
            }
        }
        kept
    }
}

/// The eight pixels around one that is not on the border, the nearer ones first.
fn neighbours(k: usize, w: usize) -> [usize; 8] {
    [k + 1, k + w, k - 1, k - w, k + w + 1, k + w - 1, k - w + 1, k - w - 1]
}

/// The marked pixels of a picture `width` pixels wide, linked to chains (x, y); none is marked on the border.
pub(super) fn link_chains(mut marked: Vec<bool>, width: usize) -> Vec<Vec<[f64; 2]>> {
    let place = |k: usize| [(k % width) as f64, (k / width) as f64];
    let mut chains = Vec::new();
    for first in 0..marked.len() {
        if !marked[first] {
            continue;
        }
        marked[first] = false;
        let mut arm = || {
            let (mut arm, mut at) = (Vec::new(), first);
            while let Some(next) = neighbours(at, width).into_iter().find(|&n| marked[n]) {
                marked[next] = false;
                arm.push(place(next));
                at = next;
            }
            arm
        };
        let (ahead, mut chain) = (arm(), arm());
        chain.reverse();
        chain.push(place(first));
        chain.extend(ahead);
        chains.push(chain);
    }
    chains
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ridge_becomes_one_chain() {
        // A ridge along x = 20 + t/4, and weak noise elsewhere.
        let (w, h) = (60, 50);
        let data = (0..w * h).map(|k| {
            let (s, t) = ((k % w) as f32, (k / w) as f32);
            (-(s - 20.0 - 0.25 * t).powi(2) / 4.0).exp() + 0.001 * ((k * 7919) % 97) as f32 / 97.0
        });
        let strength = Plane { width: w, height: h, data: data.collect() };
        let across = vec![[0.970, -0.243]; w * h];
        let kept = Strength { strength, across }.thin(0.95, 0.98, 3);
        let chains = link_chains(kept, w);
        let longest = chains.iter().max_by_key(|c| c.len()).unwrap();
        assert!(longest.len() >= 40, "{} of {} chains", longest.len(), chains.len());
        assert!(longest.iter().all(|[x, y]| (x - 20.0 - 0.25 * y).abs() <= 1.0));
    }
}
