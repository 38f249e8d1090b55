//! Lenslet centres of a white image: `cargo run --release --example centres -- IMAGE.png OUT.npy`.
//! Writes N×2 f64 (x, y in sensor pixels, pixel centres at integers), prints one JSON object.

use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Instant;

use anyhow::Context as _;
use clap::Parser as _;
use lenslet_core::calibration::{Calibration, CalibrationVariant};
use lenslet_core::progress::Observer;
use ndarray::Array2;

/// Lenslet centres of a white image
#[derive(clap::Parser)]
struct Arguments {
    /// White image
    image: PathBuf,
    /// Centres to write, .npy
    out: PathBuf,
    /// full, paper, integer, rotation-only or none
    #[arg(long, default_value_t)]
    variant: CalibrationVariant,
    /// Seconds of each stage
    #[arg(long)]
    times: bool,
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let Arguments { image, out, variant, times } = Arguments::parse();
    let calibrator = Calibration::calibrator().variant(variant).without_vignetting();
    let began = Instant::now();
    let watch = Watch::default();
    watch.begin("read", 0);
    let found = calibrator.observer(&watch).from_whites(&[&image])?;
    let seconds = began.elapsed().as_secs_f64();
    let centres = Array2::from_shape_fn((found.lenslets.len(), 2), |(n, k)| {
        if k == 0 { found.lenslets[n].x } else { found.lenslets[n].y }
    });
    ndarray_npy::write_npy(&out, &centres).with_context(|| format!("cannot write {}", out.display()))?;
    let mut report = serde_json::json!({
        "seconds": seconds,
        "pitch": found.lattice.pitch(),
        "rotation": found.lattice.rotation(),
        "count": found.lenslets.len(),
    });
    if times {
        report["stages"] = watch.stages();
    }
    println!("{report}");
    Ok(())
}

/// Notes when each stage began.
#[derive(Default)]
struct Watch(Mutex<Vec<(String, Instant)>>);

impl Watch {
    /// Seconds of each stage.
    fn stages(&self) -> serde_json::Value {
        let Ok(mut marks) = self.0.lock() else { return serde_json::Value::Null };
        marks.push((String::new(), Instant::now()));
        let seconds = |w: &[(String, Instant)]| serde_json::json!((w[1].1 - w[0].1).as_secs_f64());
        serde_json::Value::Object(marks.windows(2).map(|w| (w[0].0.clone(), seconds(w))).collect())
    }
}

impl Observer for Watch {
    fn begin(&self, stage: &str, _total: u64) {
        if let Ok(mut marks) = self.0.lock() {
            marks.push((stage.to_string(), Instant::now()));
        }
    }
}
