//! Instruction sets, detected at run time, and the call of a kernel on one of them.

use std::sync::OnceLock;

use super::lanes::Kernel;
use super::plain::Plain;
#[cfg(target_arch = "x86_64")]
use super::x86;

/// The instruction set that the kernels run on.
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
    /// The fastest that this processor has.
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

/// Runs a kernel on `level`, or plainly where the processor lacks it.
pub(crate) fn dispatch<K: Kernel>(level: Simd, kernel: K) -> K::Out {
    if !level.available() {
        return kernel.run(Plain);
    }
    match level {
        // SAFETY: the features were detected just above.
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => unsafe { x86::on_avx512(kernel) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => unsafe { x86::on_avx2(kernel) },
        _ => kernel.run(Plain),
    }
}
