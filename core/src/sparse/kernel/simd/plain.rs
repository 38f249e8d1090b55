//! Sixteen lanes in plain Rust: the reference that the other instruction sets are compared with.

use super::chunk::Chunk;
use super::lanes::Lanes;

/// Lanes of plain arrays; needs no processor feature.
#[derive(Clone, Copy)]
pub(crate) struct Plain;

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
