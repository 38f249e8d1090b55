//! The trace of training: one record an epoch.

use lenslet_core::dictionary::Footprint;
use serde::{Deserialize, Serialize};

/// The record of one epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Footprint of the model.
    pub footprint: Footprint,
    /// Always 1; kept for logs and checkpoints of earlier versions.
    pub pass: usize,
    /// `learn`, `refine`, or `done` for the finished model.
    pub stage: String,
    /// Epoch within the stage, from 1; 0 for `done`.
    pub epoch: usize,
    /// Mean objective a pair (learn: ½‖x − Dᵀα‖² + λ‖α‖₁, or ½‖x − Dᵀα‖² for K-SVD; refine: weighted ½‖e‖²).
    pub objective: f64,
    /// Mean number of non-zeros a pair.
    pub nonzeros: f64,
    /// Atoms replaced.
    pub replaced: usize,
    /// PSNR on the held-out crops by the LASSO path, dB; `None` without held-out photos.
    pub held_out_psnr: Option<f64>,
    /// PSNR of their low images, dB.
    pub low_psnr: Option<f64>,
    /// PSNR by the network, dB, of a finished model that has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network_psnr: Option<f64>,
    /// Seconds since the run (or its resumption) began.
    pub seconds: f64,
}

/// The summary of one epoch of learning.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EpochSummary {
    /// Mean objective a signal, codes and atoms as they were when each batch was coded.
    pub objective: f64,
    /// Mean number of non-zeros a signal.
    pub nonzeros: f64,
    /// Atoms replaced.
    pub replaced: usize,
}
