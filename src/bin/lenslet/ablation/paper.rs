//! The rows of the experiment `paper`: every step as the paper prints it, beside what this program does instead.

use lenslet_core::calibration::CalibrationVariant;
use lenslet_core::decode::Demosaic;
use lenslet_core::dictionary::PatchPredictor;
use lenslet_train::Algorithm;

use super::chain::{Chain, Training};
use super::method::Method;

/// Pairs of the dictionaries of eq. (3): ISTA takes minutes for more.
/// Source: chosen.
const PAIRS: usize = 3_000;

/// The rows. A step as printed stands before this program's own; all other steps of both are the same.
pub(super) fn as_printed() -> Vec<(String, Chain)> {
    let base = Chain::default;
    let malvar = || Chain { demosaic: Demosaic::Malvar, ..base() };
    let by = |method| Chain { method, ..base() };
    let joint = |algorithm| Chain {
        method: Method::Learned(PatchPredictor::Lasso),
        training: Some(Training {
            atoms: 128,
            patch: 9,
            lambda: 0.1,
            features: 40,
            pairs: PAIRS,
            algorithm,
            joint: true,
        }),
        ..base()
    };
    let rows = [
        ("3.2: Algorithm 1, header gamma", Chain { calibration: CalibrationVariant::Paper, ..base() }),
        ("3.2: lattice and residual (ours)", base()),
        ("3.2: raw rotated and resampled", Chain { rotate_raw: true, ..malvar() }),
        ("3.2: coordinates turned (ours)", malvar()),
        ("4.1: raw downsampled, bicubic", by(Method::BicubicDownsampled)),
        ("4.1: bicubic (ours)", by(Method::Bicubic)),
        ("4.3: all samples triangulated", by(Method::MultiviewTriangulated)),
        ("4.3: least squares", by(Method::MultiviewLeastSquares)),
        ("4.3: joint fit (ours)", by(Method::Multiview)),
        ("4.4: eq. (3) by ksvd", joint(Algorithm::Ksvd)),
        ("4.4: eq. (3) by ista", joint(Algorithm::Ista)),
        ("4.4: eq. (3) online (ours)", joint(Algorithm::Online)),
        (
            "3.2 to 4.3, all as printed",
            Chain {
                calibration: CalibrationVariant::Paper,
                demosaic: Demosaic::Malvar,
                rotate_raw: true,
                method: Method::MultiviewTriangulated,
                ..base()
            },
        ),
    ];
    rows.into_iter().map(|(name, chain)| (name.to_owned(), chain)).collect()
}
