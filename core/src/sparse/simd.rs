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

/// Sixteen lanes in memory, one cache line.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Chunk(pub [f32; 16]);

impl Chunk {
    pub const ZERO: Chunk = Chunk([0.0; 16]);
}

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
    /// Whether any lane is below zero.
    fn any_negative(self, a: Self::V) -> bool;
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
    fn any_negative(self, a: [f32; 16]) -> bool {
        a.iter().any(|&v| v < 0.0)
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

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Chunk, Kernel, Lanes};
    use std::arch::x86_64::*;

    /// # Safety
    /// The processor has AVX-512 F, DQ, BW, VL, AVX2 and FMA.
    #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
    pub(super) unsafe fn on_avx512<K: Kernel>(kernel: K) -> K::Out {
        kernel.run(Avx512(()))
    }

    /// # Safety
    /// The processor has AVX2 and FMA.
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn on_avx2<K: Kernel>(kernel: K) -> K::Out {
        kernel.run(Avx2(()))
    }

    /// One 512-bit register. Made only in [`on_avx512`].
    #[derive(Clone, Copy)]
    pub(super) struct Avx512(());

    // SAFETY of every block below: an `Avx512` exists only inside `on_avx512`, so the instructions are there; pointers
    // come from references to exactly sixteen f32, and the unaligned forms are used.
    impl Lanes for Avx512 {
        type V = __m512;
        type D = [__m512d; 2];
        const WIDE: bool = true;
        #[inline(always)]
        fn splat(self, x: f32) -> __m512 {
            unsafe { _mm512_set1_ps(x) }
        }
        #[inline(always)]
        fn load(self, from: &Chunk) -> __m512 {
            unsafe { _mm512_loadu_ps(from.0.as_ptr()) }
        }
        #[inline(always)]
        fn store(self, to: &mut Chunk, v: __m512) {
            unsafe { _mm512_storeu_ps(to.0.as_mut_ptr(), v) }
        }
        #[inline(always)]
        fn add(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_add_ps(a, b) }
        }
        #[inline(always)]
        fn mul(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_mul_ps(a, b) }
        }
        #[inline(always)]
        fn fma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
            unsafe { _mm512_fmadd_ps(a, b, c) }
        }
        #[inline(always)]
        fn fnma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
            unsafe { _mm512_fnmadd_ps(a, b, c) }
        }
        #[inline(always)]
        fn abs(self, a: __m512) -> __m512 {
            unsafe { _mm512_abs_ps(a) }
        }
        #[inline(always)]
        fn keep_larger(self, best: (__m512, __m512), a: __m512, at: __m512) -> (__m512, __m512) {
            unsafe {
                let pick = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, best.0);
                (_mm512_mask_mov_ps(best.0, pick, a), _mm512_mask_mov_ps(best.1, pick, at))
            }
        }
        #[inline(always)]
        fn largest(self, best: (__m512, __m512)) -> (f32, f32, usize) {
            unsafe {
                let value = _mm512_reduce_max_ps(best.0);
                let mask = _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(best.0, _mm512_set1_ps(value));
                let lane = (mask.trailing_zeros() & 15) as usize;
                let mut at = [0.0f32; 16];
                _mm512_storeu_ps(at.as_mut_ptr(), best.1);
                (value, at[lane], lane)
            }
        }
        #[inline(always)]
        fn largest_of_each(self, a: [__m512; 4]) -> [f32; 4] {
            unsafe {
                let ab = _mm512_max_ps(_mm512_unpacklo_ps(a[0], a[1]), _mm512_unpackhi_ps(a[0], a[1]));
                let cd = _mm512_max_ps(_mm512_unpacklo_ps(a[2], a[3]), _mm512_unpackhi_ps(a[2], a[3]));
                let four = _mm512_max_ps(_mm512_shuffle_ps::<0x44>(ab, cd), _mm512_shuffle_ps::<0xEE>(ab, cd));
                let four = _mm256_max_ps(_mm512_castps512_ps256(four), _mm512_extractf32x8_ps::<1>(four));
                largest4(four)
            }
        }
        #[inline(always)]
        fn above(self, a: __m512, level: f32) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, _mm512_set1_ps(level)) }
        }
        #[inline(always)]
        fn sum(self, a: __m512) -> f32 {
            unsafe { sum8(_mm256_add_ps(_mm512_castps512_ps256(a), _mm512_extractf32x8_ps::<1>(a))) }
        }
        #[inline(always)]
        fn any_negative(self, a: __m512) -> bool {
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, _mm512_setzero_ps()) != 0 }
        }
        #[inline(always)]
        fn wide(self, from: &Chunk) -> Self::D {
            unsafe {
                let v = self.load(from);
                let high = _mm512_extractf32x8_ps::<1>(v);
                [_mm512_cvtps_pd(_mm512_castps512_ps256(v)), _mm512_cvtps_pd(high)]
            }
        }
        #[inline(always)]
        fn wide_splat(self, x: f64) -> Self::D {
            unsafe { [_mm512_set1_pd(x); 2] }
        }
        #[inline(always)]
        fn wide_load(self, from: &[f64; 16]) -> Self::D {
            unsafe { [_mm512_loadu_pd(from.as_ptr()), _mm512_loadu_pd(from.as_ptr().add(8))] }
        }
        #[inline(always)]
        fn wide_store(self, to: &mut [f64; 16], v: Self::D) {
            unsafe {
                _mm512_storeu_pd(to.as_mut_ptr(), v[0]);
                _mm512_storeu_pd(to.as_mut_ptr().add(8), v[1]);
            }
        }
        #[inline(always)]
        fn wide_fma(self, a: Self::D, b: Self::D, c: Self::D) -> Self::D {
            unsafe { [_mm512_fmadd_pd(a[0], b[0], c[0]), _mm512_fmadd_pd(a[1], b[1], c[1])] }
        }
        #[inline(always)]
        fn wide_sum(self, a: Self::D) -> f64 {
            unsafe {
                let b = _mm512_add_pd(a[0], a[1]);
                sum4(_mm256_add_pd(_mm512_castpd512_pd256(b), _mm512_extractf64x4_pd::<1>(b)))
            }
        }
        #[inline(always)]
        fn prefetch(self, chunk: &Chunk) {
            unsafe { _mm_prefetch::<_MM_HINT_T0>(chunk.0.as_ptr().cast()) }
        }
    }

    /// Two 256-bit registers. Made only in [`on_avx2`].
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    // SAFETY: as for `Avx512`, with `on_avx2`.
    impl Lanes for Avx2 {
        type V = [__m256; 2];
        type D = [__m256d; 4];
        const WIDE: bool = false;
        #[inline(always)]
        fn splat(self, x: f32) -> Self::V {
            unsafe { [_mm256_set1_ps(x); 2] }
        }
        #[inline(always)]
        fn load(self, from: &Chunk) -> Self::V {
            unsafe { [_mm256_loadu_ps(from.0.as_ptr()), _mm256_loadu_ps(from.0.as_ptr().add(8))] }
        }
        #[inline(always)]
        fn store(self, to: &mut Chunk, v: Self::V) {
            unsafe {
                _mm256_storeu_ps(to.0.as_mut_ptr(), v[0]);
                _mm256_storeu_ps(to.0.as_mut_ptr().add(8), v[1]);
            }
        }
        #[inline(always)]
        fn add(self, a: Self::V, b: Self::V) -> Self::V {
            unsafe { [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn mul(self, a: Self::V, b: Self::V) -> Self::V {
            unsafe { [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
            unsafe { [_mm256_fmadd_ps(a[0], b[0], c[0]), _mm256_fmadd_ps(a[1], b[1], c[1])] }
        }
        #[inline(always)]
        fn fnma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
            unsafe { [_mm256_fnmadd_ps(a[0], b[0], c[0]), _mm256_fnmadd_ps(a[1], b[1], c[1])] }
        }
        #[inline(always)]
        fn abs(self, a: Self::V) -> Self::V {
            unsafe {
                let sign = _mm256_set1_ps(-0.0);
                [_mm256_andnot_ps(sign, a[0]), _mm256_andnot_ps(sign, a[1])]
            }
        }
        #[inline(always)]
        fn keep_larger(self, best: (Self::V, Self::V), a: Self::V, at: Self::V) -> (Self::V, Self::V) {
            unsafe {
                let low = _mm256_cmp_ps::<_CMP_GT_OQ>(a[0], best.0[0]);
                let high = _mm256_cmp_ps::<_CMP_GT_OQ>(a[1], best.0[1]);
                (
                    [_mm256_blendv_ps(best.0[0], a[0], low), _mm256_blendv_ps(best.0[1], a[1], high)],
                    [_mm256_blendv_ps(best.1[0], at[0], low), _mm256_blendv_ps(best.1[1], at[1], high)],
                )
            }
        }
        #[inline(always)]
        fn largest(self, best: (Self::V, Self::V)) -> (f32, f32, usize) {
            unsafe {
                let four = _mm256_max_ps(best.0[0], best.0[1]);
                let four = _mm_max_ps(_mm256_castps256_ps128(four), _mm256_extractf128_ps::<1>(four));
                let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
                let value = _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps::<1>(two, two)));
                let all = _mm256_set1_ps(value);
                let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(best.0[0], all));
                let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(best.0[1], all));
                let lane = ((low | high << 8).trailing_zeros() & 15) as usize;
                let mut at = Chunk::ZERO;
                self.store(&mut at, best.1);
                (value, at.0[lane], lane)
            }
        }
        #[inline(always)]
        fn largest_of_each(self, v: [Self::V; 4]) -> [f32; 4] {
            unsafe {
                let (a, b) = (_mm256_max_ps(v[0][0], v[0][1]), _mm256_max_ps(v[1][0], v[1][1]));
                let (c, d) = (_mm256_max_ps(v[2][0], v[2][1]), _mm256_max_ps(v[3][0], v[3][1]));
                let ab = _mm256_max_ps(_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
                let cd = _mm256_max_ps(_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
                largest4(_mm256_max_ps(_mm256_shuffle_ps::<0x44>(ab, cd), _mm256_shuffle_ps::<0xEE>(ab, cd)))
            }
        }
        #[inline(always)]
        fn above(self, a: Self::V, level: f32) -> u16 {
            unsafe {
                let level = _mm256_set1_ps(level);
                let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(a[0], level));
                let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(a[1], level));
                (low | high << 8) as u16
            }
        }
        #[inline(always)]
        fn sum(self, a: Self::V) -> f32 {
            unsafe { sum8(_mm256_add_ps(a[0], a[1])) }
        }
        #[inline(always)]
        fn any_negative(self, a: Self::V) -> bool {
            unsafe {
                let zero = _mm256_setzero_ps();
                let low = _mm256_cmp_ps::<_CMP_LT_OQ>(a[0], zero);
                let high = _mm256_cmp_ps::<_CMP_LT_OQ>(a[1], zero);
                _mm256_movemask_ps(_mm256_or_ps(low, high)) != 0
            }
        }
        #[inline(always)]
        fn wide(self, from: &Chunk) -> Self::D {
            unsafe {
                let v = self.load(from);
                [
                    _mm256_cvtps_pd(_mm256_castps256_ps128(v[0])),
                    _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(v[0])),
                    _mm256_cvtps_pd(_mm256_castps256_ps128(v[1])),
                    _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(v[1])),
                ]
            }
        }
        #[inline(always)]
        fn wide_splat(self, x: f64) -> Self::D {
            unsafe { [_mm256_set1_pd(x); 4] }
        }
        #[inline(always)]
        fn wide_load(self, from: &[f64; 16]) -> Self::D {
            unsafe {
                let from = from.as_ptr();
                [
                    _mm256_loadu_pd(from),
                    _mm256_loadu_pd(from.add(4)),
                    _mm256_loadu_pd(from.add(8)),
                    _mm256_loadu_pd(from.add(12)),
                ]
            }
        }
        #[inline(always)]
        fn wide_store(self, to: &mut [f64; 16], v: Self::D) {
            unsafe {
                let to = to.as_mut_ptr();
                _mm256_storeu_pd(to, v[0]);
                _mm256_storeu_pd(to.add(4), v[1]);
                _mm256_storeu_pd(to.add(8), v[2]);
                _mm256_storeu_pd(to.add(12), v[3]);
            }
        }
        #[inline(always)]
        fn wide_fma(self, a: Self::D, b: Self::D, c: Self::D) -> Self::D {
            unsafe {
                [
                    _mm256_fmadd_pd(a[0], b[0], c[0]),
                    _mm256_fmadd_pd(a[1], b[1], c[1]),
                    _mm256_fmadd_pd(a[2], b[2], c[2]),
                    _mm256_fmadd_pd(a[3], b[3], c[3]),
                ]
            }
        }
        #[inline(always)]
        fn wide_sum(self, a: Self::D) -> f64 {
            unsafe { sum4(_mm256_add_pd(_mm256_add_pd(a[0], a[2]), _mm256_add_pd(a[1], a[3]))) }
        }
        #[inline(always)]
        fn prefetch(self, chunk: &Chunk) {
            unsafe { _mm_prefetch::<_MM_HINT_T0>(chunk.0.as_ptr().cast()) }
        }
    }

    /// # Safety
    /// The processor has AVX.
    #[inline(always)]
    unsafe fn sum8(b: __m256) -> f32 {
        // SAFETY: AVX by contract.
        unsafe {
            let c = _mm_add_ps(_mm256_castps256_ps128(b), _mm256_extractf128_ps::<1>(b));
            let d = _mm_add_ps(c, _mm_movehl_ps(c, c));
            _mm_cvtss_f32(_mm_add_ss(d, _mm_shuffle_ps::<1>(d, d)))
        }
    }

    /// # Safety
    /// The processor has AVX.
    #[inline(always)]
    unsafe fn sum4(c: __m256d) -> f64 {
        // SAFETY: AVX by contract.
        unsafe {
            let d = _mm_add_pd(_mm256_castpd256_pd128(c), _mm256_extractf128_pd::<1>(c));
            _mm_cvtsd_f64(_mm_add_sd(d, _mm_unpackhi_pd(d, d)))
        }
    }

    /// The larger half of each of four values.
    ///
    /// # Safety
    /// The processor has AVX.
    #[inline(always)]
    unsafe fn largest4(a: __m256) -> [f32; 4] {
        let mut out = [0.0f32; 4];
        // SAFETY: AVX by contract; the store writes the four values of `out`.
        unsafe {
            let four = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            _mm_storeu_ps(out.as_mut_ptr(), four);
        }
        out
    }
}
