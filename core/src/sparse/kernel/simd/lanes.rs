//! The operations that kernels have on sixteen lanes, for every instruction set.

use super::chunk::Chunk;

/// Operations on sixteen lanes. Values of the implementing types are proof that the instructions are there.
pub(crate) trait Lanes: Copy {
    /// Sixteen f32.
    type V: Copy;
    /// Sixteen f64.
    type D: Copy;
    /// Whether there are registers for eight vectors and more.
    const WIDE: bool;
    fn splat(self, x: f32) -> Self::V;
    fn load(self, from: &Chunk) -> Self::V;
    fn store(self, to: &mut Chunk, v: Self::V);
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// a·b + c, rounded once.
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// c − a·b, rounded once.
    fn fnma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    fn abs(self, a: Self::V) -> Self::V;
    /// Lane by lane: where `a > best`, takes `a` and `at`.
    fn keep_larger(self, best: (Self::V, Self::V), a: Self::V, at: Self::V) -> (Self::V, Self::V);
    /// The largest lane of `best.0` (lowest lane of equals): its value, its `best.1`, its lane.
    fn largest(self, best: (Self::V, Self::V)) -> (f32, f32, usize);
    /// The largest lane of each of four vectors.
    fn largest_of_each(self, a: [Self::V; 4]) -> [f32; 4];
    /// Bit i says whether lane i is above `level`.
    fn above(self, a: Self::V, level: f32) -> u16;
    /// Sum of all lanes: halves added onto each other.
    fn sum(self, a: Self::V) -> f32;
    /// The sums of two vectors' lanes, each as [`Lanes::sum`] adds.
    #[inline(always)]
    fn sum_both(self, a: Self::V, b: Self::V) -> (f32, f32) {
        (self.sum(a), self.sum(b))
    }
    /// Bit i says whether lane i is below zero.
    fn negative(self, a: Self::V) -> u16;
    /// The bits of `a` that `keep` has, with those of `tag`.
    fn tag(self, a: Self::V, keep: Self::V, tag: Self::V) -> Self::V;
    /// Lane by lane the larger of bits read as signed integers; of numbers that are not negative, the larger number.
    fn larger_bits(self, a: Self::V, b: Self::V) -> Self::V;
    /// The largest lane, bits read as signed integers.
    fn largest_bits(self, a: Self::V) -> u32;
    /// Zero in lane `k`.
    fn clear_lane(self, a: Self::V, k: usize) -> Self::V;
    /// Sixteen f64 of sixteen f32.
    fn wide(self, from: &Chunk) -> Self::D;
    fn wide_splat(self, x: f64) -> Self::D;
    fn wide_load(self, from: &[f64; 16]) -> Self::D;
    fn wide_store(self, to: &mut [f64; 16], v: Self::D);
    /// a·b + c, rounded once.
    fn wide_fma(self, a: Self::D, b: Self::D, c: Self::D) -> Self::D;
    /// Sum of all lanes: halves added onto each other.
    fn wide_sum(self, a: Self::D) -> f64;
    /// Hints that this chunk will be read soon.
    fn prefetch(self, chunk: &Chunk);
}

/// Work to be run on lanes; `run` and all it calls with lanes must be `#[inline(always)]`.
pub(crate) trait Kernel {
    type Out;
    fn run<S: Lanes>(self, lanes: S) -> Self::Out;
}
