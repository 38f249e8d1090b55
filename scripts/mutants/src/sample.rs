//! Which candidates become mutants: a seeded share of each file, spread over the kinds and over the text.

use super::candidates::Candidate;

/// Of this many literals one is a candidate: there are as many as of all other kinds together.
const LITERALS_THINNED: usize = 4;
/// What every file contributes, if it has that many.
const LEAST_OF_A_FILE: usize = 2;

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Below `n`.
    fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next()) * n as u128) >> 64) as usize
    }
}

/// Removes most literals.
pub fn thin_literals(candidates: Vec<Candidate>, random: &mut Random) -> Vec<Candidate> {
    candidates.into_iter().filter(|c| c.kind != "literal" || random.below(LITERALS_THINNED) == 0).collect()
}

/// How many mutants each file gets of `total`, in proportion to its candidates, but at least [`LEAST_OF_A_FILE`].
pub fn allot(counts: &[usize], total: usize) -> Vec<usize> {
    let all: usize = counts.iter().sum();
    counts
        .iter()
        .map(|&n| ((n * total) as f64 / all.max(1) as f64).round() as usize)
        .zip(counts)
        .map(|(share, &n)| share.max(LEAST_OF_A_FILE).min(n))
        .collect()
}

/// `n` of the candidates at equal steps from a random beginning, in the order of kind and place.
pub fn choose(mut candidates: Vec<Candidate>, n: usize, random: &mut Random) -> Vec<Candidate> {
    candidates.sort_by_key(|c| (c.kind, c.range.start, c.range.end));
    let (count, begin) = (candidates.len(), random.below(1 << 20) as f64 / (1 << 20) as f64);
    let places = (0..n).map(|k| ((k as f64 + begin) * count as f64 / n as f64) as usize);
    let mut chosen: Vec<Candidate> = places.map(|k| candidates[k.min(count - 1)].clone()).collect();
    chosen.sort_by_key(|c| (c.range.start, c.range.end));
    chosen
}
