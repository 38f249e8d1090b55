//! Lenslet centres of a white image: `cargo run --release --example centres -- IMAGE.png OUT.npy`.
//! Writes N×2 f64 (x, y in sensor pixels, pixel centres at integers), prints one JSON object.

use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;
use lenslet_core::calibration::{self, Options};
use lenslet_core::container::{CameraFacts, Capture, Cfa, ColourFacts, Levels, RawMosaic};
use lenslet_core::progress::Silent;
use ndarray::Array2;

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [image, out] = arguments.as_slice() else {
        anyhow::bail!("usage: centres IMAGE.png OUT.npy");
    };
    let began = Instant::now();
    let white = open(Path::new(image))?;
    let options = Options { without_vignetting: true };
    let found = calibration::calibrate(&[white], &options, &Silent)?;
    let seconds = began.elapsed().as_secs_f64();
    let centres = Array2::from_shape_fn((found.lenslets.len(), 2), |(n, k)| {
        if k == 0 { found.lenslets[n].x } else { found.lenslets[n].y }
    });
    ndarray_npy::write_npy(out, &centres).with_context(|| format!("cannot write {out}"))?;
    let report = serde_json::json!({
        "seconds": seconds,
        "pitch": found.lattice.pitch(),
        "rotation": found.lattice.rotation(),
        "count": found.lenslets.len(),
    });
    println!("{report}");
    Ok(())
}

fn open(path: &Path) -> anyhow::Result<Capture> {
    let image = image::open(path)?;
    let (w, h) = (image.width() as usize, image.height() as usize);
    let (data, black, white) = match image {
        image::DynamicImage::ImageLuma16(i) => (i.into_raw(), 168.0, 4095.0),
        other => (other.to_luma8().into_raw().into_iter().map(u16::from).collect(), 10.5, 255.0),
    };
    Ok(Capture {
        mosaic: RawMosaic { width: w, height: h, data },
        cfa: Cfa::Bggr,
        levels: Levels { black: [black; 4], white: [white; 4] },
        colour: ColourFacts {
            white_balance: [1.0; 4],
            ccm: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            gamma: None,
        },
        camera: CameraFacts::default(),
        mla: None,
        source_sha256: String::new(),
        white: None,
        warnings: vec![],
    })
}
