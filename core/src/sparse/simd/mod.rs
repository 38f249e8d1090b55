//! Sixteen f32 lanes on whatever the processor has, chosen at run time: AVX-512, AVX2 with FMA, NEON, or plain Rust.
//!
//! Every implementation does the same roundings in the same order (fused multiply-add, lane by lane, the same tree in
//! reductions), so all of them give the same bits and the plain one is the oracle of the others.
//!
//! The only module with unsafe code. Two reasons, both local: (1) an intrinsic may be called only where its processor
//! feature is on — a lanes token is made only inside the `#[target_feature]` function of its own feature set, and that
//! function is called only after the feature was detected; (2) vector loads and stores take pointers — they come from
//! references to [`Chunk`], which cover exactly the bytes touched, and unaligned instructions are used.
#![allow(unsafe_code)]

use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
mod x86;

/// Sixteen lanes in memory, one cache line.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Chunk(pub [f32; 16]);

impl Chunk {
    pub const ZERO: Chunk = Chunk([0.0; 16]);
}

/// Chunk i has a one in lane i.
pub(super) static UNITS: [Chunk; 16] = {
    let mut units = [Chunk::ZERO; 16];
    let mut i = 0;
    while i < 16 {
        units[i].0[i] = 1.0;
        i += 1;
    }
    units
};

/// Chunks as one row of f32.
#[inline(always)]
pub(super) fn flat(chunks: &[Chunk]) -> &[f32] {
    // SAFETY: `Chunk` is `repr(C)`, 64 bytes, without padding: n chunks are exactly 16·n f32, all initialised.
    unsafe { std::slice::from_raw_parts(chunks.as_ptr().cast(), chunks.len() * 16) }
}

/// Chunks as one row of f32, to be written.
#[inline(always)]
pub(super) fn flat_mut(chunks: &mut [Chunk]) -> &mut [f32] {
    // SAFETY: as in `flat`; the borrow stays exclusive.
    unsafe { std::slice::from_raw_parts_mut(chunks.as_mut_ptr().cast(), chunks.len() * 16) }
}

/// Which instructions the kernels run on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Simd {
    /// Plain Rust, any processor.
    Plain,
    /// AVX2 and FMA (x86-64).
    Avx2,
    /// AVX-512 F, DQ, BW, VL (x86-64).
    Avx512,
}

impl Simd {
    /// The best this processor has.
    pub fn best() -> Simd {
        static BEST: OnceLock<Simd> = OnceLock::new();
        *BEST.get_or_init(|| {
            [Simd::Avx512, Simd::Avx2].into_iter().find(|level| level.available()).unwrap_or(Simd::Plain)
        })
    }

    /// Whether this processor has it.
    pub fn available(self) -> bool {
        match self {
            Simd::Plain => true,
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => {
                Simd::Avx2.available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }
}

/// Operations on sixteen lanes. Values of the implementing types are proof that the instructions are there.
pub(super) trait Lanes: Copy {
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
pub(super) trait Kernel {
    type Out;
    fn run<S: Lanes>(self, lanes: S) -> Self::Out;
}

/// Runs a kernel on `level`, or plainly where the processor lacks it.
pub(super) fn dispatch<K: Kernel>(level: Simd, kernel: K) -> K::Out {
    if !level.available() {
        return kernel.run(Plain(()));
    }
    match level {
        // SAFETY: the features were detected just above.
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => unsafe { x86::on_avx512(kernel) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => unsafe { x86::on_avx2(kernel) },
        _ => kernel.run(Plain(())),
    }
}

/// Plain Rust: the twin of all others. (On 64-bit ARM the compiler turns this into NEON.)
#[derive(Clone, Copy)]
pub(super) struct Plain(());

impl Lanes for Plain {
    type V = [f32; 16];
    type D = [f64; 16];
    const WIDE: bool = false;
    #[inline(always)]
    fn splat(self, x: f32) -> [f32; 16] {
        [x; 16]
    }
    #[inline(always)]
    fn load(self, from: &Chunk) -> [f32; 16] {
        from.0
    }
    #[inline(always)]
    fn store(self, to: &mut Chunk, v: [f32; 16]) {
        to.0 = v;
    }
    #[inline(always)]
    fn add(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        std::array::from_fn(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn mul(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        std::array::from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn fma(self, a: [f32; 16], b: [f32; 16], c: [f32; 16]) -> [f32; 16] {
        std::array::from_fn(|i| a[i].mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn fnma(self, a: [f32; 16], b: [f32; 16], c: [f32; 16]) -> [f32; 16] {
        std::array::from_fn(|i| (-a[i]).mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn abs(self, a: [f32; 16]) -> [f32; 16] {
        a.map(f32::abs)
    }
    #[inline(always)]
    fn keep_larger(self, best: ([f32; 16], [f32; 16]), a: [f32; 16], at: [f32; 16]) -> ([f32; 16], [f32; 16]) {
        let pick: [bool; 16] = std::array::from_fn(|i| a[i] > best.0[i]);
        (
            std::array::from_fn(|i| if pick[i] { a[i] } else { best.0[i] }),
            std::array::from_fn(|i| if pick[i] { at[i] } else { best.1[i] }),
        )
    }
    #[inline(always)]
    fn largest(self, best: ([f32; 16], [f32; 16])) -> (f32, f32, usize) {
        let mut lane = 0;
        for i in 1..16 {
            if best.0[i] > best.0[lane] {
                lane = i;
            }
        }
        (best.0[lane], best.1[lane], lane)
    }
    #[inline(always)]
    fn largest_of_each(self, a: [[f32; 16]; 4]) -> [f32; 4] {
        a.map(|v| v.into_iter().fold(v[0], |m, x| if x > m { x } else { m }))
    }
    #[inline(always)]
    fn above(self, a: [f32; 16], level: f32) -> u16 {
        (0..16).fold(0, |mask, i| mask | u16::from(a[i] > level) << i)
    }
    #[inline(always)]
    fn sum(self, a: [f32; 16]) -> f32 {
        let b: [f32; 8] = std::array::from_fn(|i| a[i] + a[i + 8]);
        let c: [f32; 4] = std::array::from_fn(|i| b[i] + b[i + 4]);
        (c[0] + c[2]) + (c[1] + c[3])
    }
    #[inline(always)]
    fn negative(self, a: [f32; 16]) -> u16 {
        (0..16).fold(0, |mask, i| mask | u16::from(a[i] < 0.0) << i)
    }
    #[inline(always)]
    fn tag(self, a: [f32; 16], keep: [f32; 16], tag: [f32; 16]) -> [f32; 16] {
        std::array::from_fn(|i| f32::from_bits(a[i].to_bits() & keep[i].to_bits() | tag[i].to_bits()))
    }
    #[inline(always)]
    fn larger_bits(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        std::array::from_fn(|i| if (a[i].to_bits() as i32) > b[i].to_bits() as i32 { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn largest_bits(self, a: [f32; 16]) -> u32 {
        a.iter().fold(i32::MIN, |most, v| most.max(v.to_bits() as i32)) as u32
    }
    #[inline(always)]
    fn clear_lane(self, mut a: [f32; 16], k: usize) -> [f32; 16] {
        a[k & 15] = 0.0;
        a
    }
    #[inline(always)]
    fn wide(self, from: &Chunk) -> [f64; 16] {
        from.0.map(f64::from)
    }
    #[inline(always)]
    fn wide_splat(self, x: f64) -> [f64; 16] {
        [x; 16]
    }
    #[inline(always)]
    fn wide_load(self, from: &[f64; 16]) -> [f64; 16] {
        *from
    }
    #[inline(always)]
    fn wide_store(self, to: &mut [f64; 16], v: [f64; 16]) {
        *to = v;
    }
    #[inline(always)]
    fn wide_fma(self, a: [f64; 16], b: [f64; 16], c: [f64; 16]) -> [f64; 16] {
        std::array::from_fn(|i| a[i].mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn wide_sum(self, a: [f64; 16]) -> f64 {
        let b: [f64; 8] = std::array::from_fn(|i| a[i] + a[i + 8]);
        let c: [f64; 4] = std::array::from_fn(|i| b[i] + b[i + 4]);
        (c[0] + c[2]) + (c[1] + c[3])
    }
    #[inline(always)]
    fn prefetch(self, _chunk: &Chunk) {}
}
