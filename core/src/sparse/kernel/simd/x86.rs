//! The instructions of x86-64: AVX-512 and AVX2 with FMA.
use super::chunk::{Chunk, UNITS};
use super::lanes::{Kernel, Lanes};
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
    fn sum_both(self, a: __m512, b: __m512) -> (f32, f32) {
        unsafe {
            // The same additions as in `sum`, those of a and b side by side.
            let a = _mm256_add_ps(_mm512_castps512_ps256(a), _mm512_extractf32x8_ps::<1>(a));
            let b = _mm256_add_ps(_mm512_castps512_ps256(b), _mm512_extractf32x8_ps::<1>(b));
            let c = _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
            let d = _mm256_add_ps(c, _mm256_permute_ps::<0b01_00_11_10>(c));
            let e = _mm256_add_ps(d, _mm256_permute_ps::<0b10_11_00_01>(d));
            (_mm256_cvtss_f32(e), _mm_cvtss_f32(_mm256_extractf128_ps::<1>(e)))
        }
    }
    #[inline(always)]
    fn negative(self, a: __m512) -> u16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, _mm512_setzero_ps()) }
    }
    #[inline(always)]
    fn tag(self, a: __m512, keep: __m512, tag: __m512) -> __m512 {
        unsafe {
            let (a, keep, tag) = (_mm512_castps_si512(a), _mm512_castps_si512(keep), _mm512_castps_si512(tag));
            // The table of (a and keep) or tag.
            _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<0xEA>(a, keep, tag))
        }
    }
    #[inline(always)]
    fn larger_bits(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_castsi512_ps(_mm512_max_epi32(_mm512_castps_si512(a), _mm512_castps_si512(b))) }
    }
    #[inline(always)]
    fn largest_bits(self, a: __m512) -> u32 {
        unsafe { _mm512_reduce_max_epi32(_mm512_castps_si512(a)) as u32 }
    }
    #[inline(always)]
    fn clear_lane(self, a: __m512, k: usize) -> __m512 {
        unsafe { _mm512_maskz_mov_ps(!(1 << (k & 15)), a) }
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
    fn negative(self, a: Self::V) -> u16 {
        unsafe {
            let zero = _mm256_setzero_ps();
            let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a[0], zero));
            let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a[1], zero));
            (low | high << 8) as u16
        }
    }
    #[inline(always)]
    fn tag(self, a: Self::V, keep: Self::V, tag: Self::V) -> Self::V {
        unsafe {
            [_mm256_or_ps(_mm256_and_ps(a[0], keep[0]), tag[0]), _mm256_or_ps(_mm256_and_ps(a[1], keep[1]), tag[1])]
        }
    }
    #[inline(always)]
    fn larger_bits(self, a: Self::V, b: Self::V) -> Self::V {
        unsafe {
            [
                _mm256_castsi256_ps(_mm256_max_epi32(_mm256_castps_si256(a[0]), _mm256_castps_si256(b[0]))),
                _mm256_castsi256_ps(_mm256_max_epi32(_mm256_castps_si256(a[1]), _mm256_castps_si256(b[1]))),
            ]
        }
    }
    #[inline(always)]
    fn largest_bits(self, a: Self::V) -> u32 {
        unsafe {
            let eight = _mm256_max_epi32(_mm256_castps_si256(a[0]), _mm256_castps_si256(a[1]));
            let four = _mm_max_epi32(_mm256_castsi256_si128(eight), _mm256_extracti128_si256::<1>(eight));
            let two = _mm_max_epi32(four, _mm_shuffle_epi32::<0b01_00_11_10>(four));
            _mm_cvtsi128_si32(_mm_max_epi32(two, _mm_shuffle_epi32::<0b10_11_00_01>(two))) as u32
        }
    }
    #[inline(always)]
    fn clear_lane(self, a: Self::V, k: usize) -> Self::V {
        unsafe {
            let unit = self.load(&UNITS[k & 15]);
            let zero = _mm256_setzero_ps();
            [
                _mm256_and_ps(a[0], _mm256_cmp_ps::<_CMP_EQ_OQ>(unit[0], zero)),
                _mm256_and_ps(a[1], _mm256_cmp_ps::<_CMP_EQ_OQ>(unit[1], zero)),
            ]
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
