//! Sixteen f32 lanes on the best instructions of the processor, chosen at run time: AVX-512, AVX2 with FMA, or plain
//! Rust.
//!
//! Every implementation does the same roundings in the same order (fused multiply-add, lane by lane, the same tree in
//! reductions), so all of them give the same bits and the plain one is the oracle of the others. On 64-bit ARM there is
//! only the plain one, which the compiler turns into NEON.
//!
//! The only module with unsafe code. Two reasons, both local: (1) an intrinsic may be called only where its processor
//! feature is on: a lanes token is made only inside the `#[target_feature]` function of its own feature set, and that
//! function is called only after the feature was detected; (2) vector loads and stores take pointers: they come from
//! references to [`Chunk`], which cover exactly the bytes touched, and unaligned instructions are used.
#![allow(unsafe_code)]

mod chunk;
mod lanes;
mod level;
mod plain;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use chunk::{Chunk, UNITS, flat, flat_mut};
pub(crate) use lanes::{Kernel, Lanes};
pub use level::Simd;
pub(crate) use level::dispatch;
