//! The demo's report: comparison of the methods, scores, crops, differences, calibration, and how it was made.

use anyhow::Context as _;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::metrics::BORDER;
use lenslet_data_gen::simulate::Camera;
use ndarray::Array3;

use super::play;
use super::results::{CROPS, Calibrated, Reconstruction, Simulated, mean};
use crate::report::embedded::{self, Crop};
use crate::report::plot::{self, Bar};
use crate::report::{EmbeddedPicture, Page, Stage, Table};

pub(super) fn page(
    made: &Simulated,
    calibrated: &Calibrated,
    results: &[Reconstruction],
    truth: &Array3<f32>,
    played: &play::Pictures,
) -> anyhow::Result<String> {
    let Simulated { size, seed, camera, seconds: simulated } = made;
    let mut page = Page::new(
        "From a raw capture to sharp views",
        &format!(
            "A simulated capture of {0}x{0} sensor pixels, reconstructed to views of {1}x{1} by every method and compared with the truth.",
            camera.sensor.width, size
        ),
    );
    page.heading("The same view by every method");
    let mut stages = Vec::new();
    for (name, view) in results.iter().map(|r| (r.name.as_str(), &r.views[0])).chain([("truth", truth)]) {
        stages.push(Stage { name: name.to_owned(), picture: EmbeddedPicture::png(view, 1)? });
    }
    page.compare("central view", &stages, [CROPS[0].1, CROPS[0].2]);
    scores_section(&mut page, results);
    page.heading("Close up");
    page.paragraph("The same piece of the central view, every pixel enlarged, nothing smoothed.");
    let side = (truth.dim().0 / 5).clamp(24, 64);
    for (name, x, y) in CROPS {
        let crop = Crop::about(truth.dim(), x, y, side, side);
        let figures = results
            .iter()
            .map(|r| (r.name.as_str(), &r.views[0]))
            .chain([("truth", truth)])
            .map(|(method, view)| Ok((EmbeddedPicture::png(&crop.of(view), 3)?, format!("{name}: {method}"))))
            .collect::<anyhow::Result<Vec<_>>>()?;
        page.figures(&figures);
    }
    page.heading("Where each method is wrong");
    page.paragraph(
        "Difference from the truth, five times as strong: red is too bright, blue too dark, white is right.",
    );
    let figures = results
        .iter()
        .map(|r| Ok((EmbeddedPicture::jpeg(&embedded::difference_map(&r.views[0], truth, 5.0), 85)?, r.name.clone())))
        .collect::<anyhow::Result<Vec<_>>>()?;
    page.figures(&figures);
    page.heading("What a light field is for");
    page.paragraph("All 7x7 views together: focus chosen after the fact, and how far away everything is.");
    let figures = played
        .iter()
        .map(|(name, view)| Ok((EmbeddedPicture::png(view, 1)?, name.clone())))
        .collect::<anyhow::Result<Vec<_>>>()?;
    page.figures(&figures);
    page.link(play::PAGE, "The same light field to play with: click to focus, drag to look around.");
    calibration_section(&mut page, camera, calibrated);
    page.heading("How it was made");
    let best = results.iter().max_by(|a, b| a.scores[0].psnr_y.total_cmp(&b.scores[0].psnr_y));
    let best = best.context("there is no result")?;
    page.paragraph(&format!(
        "Scene, capture, two white images and the 7x7 truth views took {simulated:.1} s, calibration {:.1} s. The truth is the \
         scene behind the lenslets' own low-pass (a Gaussian of a quarter pitch), seen from exactly one direction. Sensor \
         noise, optical blur, vignetting, colour filters and errors of single lenslets are in the capture. The same steps by hand, to the best row ({}):",
        calibrated.seconds, best.name
    ));
    page.code(&format!(
        "lenslet simulate --sensor {} --size {} --seed {} --out sim\n\
         lenslet calibrate sim/white-*.lfp --out sim/camera.calib\n\
         lenslet decode sim/capture.lfp --calibration sim/camera.calib {} --size {} --out sim/views\n\
         lenslet score sim/views sim/truth/views --border {BORDER}",
        camera.sensor.width,
        size,
        seed,
        best.decode_options(),
        size
    ));
    Ok(page.finish())
}

/// A column of the score table: its head, its value, its decimals.
type Column = (&'static str, fn(&Reconstruction) -> f64, usize);

fn scores_section(page: &mut Page, results: &[Reconstruction]) {
    page.heading("Scores against the truth");
    let columns: [Column; 5] = [
        ("PSNR RGB, dB", |r| r.scores[0].psnr_rgb, 2),
        ("PSNR luminance, dB", |r| r.scores[0].psnr_y, 2),
        ("SSIM luminance", |r| r.scores[0].ssim_y, 4),
        ("five views, PSNR luminance", |r| mean(&r.scores, |s| s.psnr_y), 2),
        ("five views, SSIM", |r| mean(&r.scores, |s| s.ssim_y), 4),
    ];
    let mut head = vec!["method".to_owned()];
    head.extend(columns.iter().map(|c| c.0.to_owned()));
    head.push("seconds".to_owned());
    let mut rows = Vec::new();
    for r in results {
        let mut row = vec![r.name.clone()];
        row.extend(columns.iter().map(|(_, of, decimals)| format!("{:.*}", *decimals, of(r))));
        row.push(format!("{:.2}", r.seconds));
        rows.push(row);
    }
    let mut best = Vec::new();
    for (c, (_, of, _)) in columns.iter().enumerate() {
        let top = results.iter().enumerate().max_by(|a, b| of(a.1).total_cmp(&of(b.1)));
        best.extend(top.map(|(r, _)| (r, c + 1)));
    }
    let caption = format!(
        "Central view unless said otherwise, sRGB-encoded, {BORDER} pixels left out on each side. Five views: the centre \
         and the corners of 7x7. Seconds: for these five views."
    );
    page.table(&Table { caption, head, rows, best });
    // One colour for interpolations, one for what is learned on each of them.
    let group = |r: &Reconstruction| match (r.predictor, r.base) {
        (None, _) => 0,
        (Some(_), Interpolation::Multiview) => 2,
        (Some(_), _) => 1,
    };
    let bar = |r: &Reconstruction| Bar { name: r.name.clone(), value: r.scores[0].psnr_y, group: group(r) };
    let bars: Vec<Bar> = results.iter().map(bar).collect();
    let base = bars.iter().map(|b| b.value).fold(f64::INFINITY, f64::min).floor() - 1.0;
    page.drawing(
        &plot::bar_chart("dB", base, &bars),
        &format!(
            "PSNR of the central view's luminance; the bars begin at {base:.0} dB. A colour each: interpolations, \
             learned on barycentric views, learned on refined ones."
        ),
    );
    page.list(&results.iter().map(|r| (r.name.as_str(), r.about)).collect::<Vec<_>>());
    page.paragraph(
        "The rows from no codes to network are learned reconstruction of the barycentric views, those on multiview of the \
         refined ones: the same steps around another predictor, so that what a dictionary gives is its margin over no \
         codes. Of these, decode --method learned runs LASSO; learned on multiview runs the network. No dictionary was \
         trained on a scene of this kind.",
    );
}

fn calibration_section(page: &mut Page, camera: &Camera, calibrated: &Calibrated) {
    page.heading("Calibration");
    let lattice = &calibrated.found.lattice;
    let row = |name: &str, found: String, truth: String| vec![name.to_owned(), found, truth];
    let rows = vec![
        row("pitch, px", format!("{:.4}", lattice.pitch()), format!("{:.4}", camera.lenslets.pitch)),
        row("rotation, rad", format!("{:.6}", lattice.rotation()), format!("{:.6}", camera.lenslets.rotation)),
        row("row stretch", format!("{:.6}", lattice.row_stretch()), format!("{:.6}", camera.lenslets.row_stretch)),
        row("lenslets", calibrated.found.lenslets.len().to_string(), calibrated.truth.to_string()),
        row("centres, px RMS from the truth", format!("{:.4}", calibrated.rms), "0".to_owned()),
    ];
    page.table(&Table {
        caption: format!(
            "Found from two white images with noise; every lenslet has its own error of {:.2} px (standard deviation) in x and y.",
            camera.lenslets.jitter
        ),
        head: ["", "found", "true"].map(str::to_owned).to_vec(),
        rows,
        best: Vec::new(),
    });
}
