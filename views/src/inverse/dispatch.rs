//! The widest vectors of the machine, for loops that the compiler vectorises. Sums keep their order and nothing is fused, so
//! results are the same on every machine.

/// Runs `work` compiled for the machine's vectors (AVX2 where there is one); what it calls takes part if it is inlined.
#[inline]
pub(crate) fn dispatched<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}
