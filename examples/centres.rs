//! Lenslet centres of a white image: `cargo run --release --example centres -- IMAGE.png OUT.npy`.
//! Writes N×2 f64 (x, y in sensor pixels, pixel centres at integers), prints one JSON object.

use std::sync::Mutex;
use std::time::Instant;

use anyhow::Context as _;
use lenslet_core::calibration::{self, CalibrationOptions};
use lenslet_core::container;
use lenslet_core::progress::Observer;
use ndarray::Array2;

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut options = CalibrationOptions { without_vignetting: true, ..CalibrationOptions::default() };
    if let Some(at) = arguments.iter().position(|a| a == "--variant") {
        let rest: Vec<String> = arguments.drain(at..).collect();
        options.variant = rest.get(1).map_or("", String::as_str).parse().map_err(anyhow::Error::msg)?;
    }
    let times = arguments.iter().position(|a| a == "--times").map(|at| arguments.remove(at)).is_some();
    let [image, out] = arguments.as_slice() else {
        anyhow::bail!("usage: centres IMAGE.png OUT.npy [--variant full|paper|integer|rotation-only|none] [--times]");
    };
    let began = Instant::now();
    let watch = Watch::default();
    watch.begin("read", 0);
    let white = container::Capture::open(image)?;
    let found = calibration::calibrate(&[white], &options, &watch)?;
    let seconds = began.elapsed().as_secs_f64();
    let centres = Array2::from_shape_fn((found.lenslets.len(), 2), |(n, k)| {
        if k == 0 { found.lenslets[n].x } else { found.lenslets[n].y }
    });
    ndarray_npy::write_npy(out, &centres).with_context(|| format!("cannot write {out}"))?;
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
