//! The pictures of a finished training run: convergence as SVG, atoms as PNG.

use std::fmt::Write as _;

use crate::report::plot::{Series, line_plot};
use crate::report::{EmbeddedPicture, embedded};
use lenslet_core::dictionary::{Dictionary, PatchModel};
use lenslet_train::Epoch;
use ndarray::{Array2, Array3, ArrayView2, s};

/// Atoms side by side in a mosaic.
/// Source: chosen.
const ACROSS: usize = 32;
/// Pixels a side that an atom's value is shown as.
/// Source: chosen.
const ZOOM: usize = 2;

/// Style of a plot that is a separate file; on pages the page has it.
const STYLE: &str = "<style>svg{background:#fff}text{font:13px sans-serif;fill:#1c1e22}.axis{stroke:#5b6068;fill:none}\
.grid-line{stroke:#dcdad4;fill:none}.curve{stroke:currentColor;stroke-width:2;fill:none}.dot{fill:currentColor}\
.s0{color:#0b7f88}.s1{color:#c2571a}.s2{color:#5a55b8}.s3{color:#2f8a3d}.s4{color:#b0397a}.s5{color:#8a7420}</style>";

/// Held-out PSNR and the objectives over the epochs, one plot above the other. An objective is shown as a part of its
/// stage's first: those of different stages do not compare.
pub fn convergence(trace: &[Epoch]) -> String {
    let mut models: Vec<(String, Vec<&Epoch>)> = Vec::new();
    for epoch in trace {
        let name = format!("{}, pass {}", epoch.footprint, epoch.pass);
        match models.iter_mut().find(|m| m.0 == name) {
            Some(model) => model.1.push(epoch),
            None => models.push((name, vec![epoch])),
        }
    }
    let (mut psnr, mut objectives) = (Vec::new(), Vec::new());
    for (name, epochs) in &models {
        let numbered = || epochs.iter().enumerate().map(|(n, e)| (n as f64 + 1.0, e));
        let of = |value: &dyn Fn(&Epoch) -> Option<f64>| -> Vec<[f64; 2]> {
            numbered().filter_map(|(n, e)| Some([n, value(e)?])).collect()
        };
        psnr.push(Series { name: format!("{name}, learned"), points: of(&|e| e.held_out_psnr) });
        psnr.push(Series { name: format!("{name}, low"), points: of(&|e| e.low_psnr) });
        for stage in ["learn", "refine"] {
            let first = epochs.iter().find(|e| e.stage == stage).map(|e| e.objective);
            let share = |e: &Epoch| first.filter(|f| e.stage == stage && *f > 0.0).map(|f| e.objective / f);
            objectives.push(Series { name: format!("{name}, {stage}"), points: of(&share) });
        }
    }
    psnr.retain(|s| !s.points.is_empty());
    objectives.retain(|s| !s.points.is_empty());
    let plots = [
        line_plot("epoch", "held-out PSNR, dB", &psnr),
        line_plot("epoch", "objective / first of its stage", &objectives),
    ];
    let (mut body, mut top) = (String::new(), 0.0);
    for plot in &plots {
        // viewBox="0 0 WIDTH HEIGHT"
        let size = plot.split("viewBox=\"0 0 ").nth(1).and_then(|t| t.split('"').next()).unwrap_or("760 420");
        let height: f64 = size.split(' ').nth(1).and_then(|h| h.parse().ok()).unwrap_or(420.0);
        let _ = write!(body, "{}", plot.replacen("<svg ", &format!("<svg y=\"{top}\" height=\"{height}\" "), 1));
        top += height + 10.0;
    }
    format!("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 760 {top}\">{STYLE}{body}</svg>\n")
}

/// The atoms of all models: on the left an atom of Dl as a window of the low image (its features taken back to pixels),
/// on the right the residual patch of Dh that it adds; each atom stretched to its own range, zero is grey.
///
/// # Errors
/// When the dictionary has no atoms, or the picture cannot be encoded.
pub fn mosaic(dictionary: &Dictionary) -> anyhow::Result<EmbeddedPicture> {
    let panels: Vec<(Array2<f32>, Array2<f32>)> = dictionary
        .models
        .iter()
        .map(|m| &m.patch_model)
        .map(|parts| (tiles(low(parts).view(), parts.support), tiles(parts.high.view(), parts.patch)))
        .collect();
    const GAP: usize = 6;
    let height = panels.iter().map(|(l, h)| l.nrows().max(h.nrows()) + GAP).sum::<usize>().max(1);
    let width = panels.iter().map(|(l, h)| l.ncols() + GAP + h.ncols()).max().unwrap_or(1);
    let mut all = Array3::<f32>::ones((height, width, 1));
    let mut top = 0;
    for (l, h) in &panels {
        let mut put = |left: usize, panel: &Array2<f32>| {
            let (rows, columns) = panel.dim();
            all.slice_mut(s![top..top + rows, left..left + columns, 0]).assign(panel);
        };
        put(0, l);
        put(l.ncols() + GAP, h);
        top += l.nrows().max(h.nrows()) + GAP;
    }
    EmbeddedPicture::png(&embedded::enlarge(&all, ZOOM), 1)
}

fn low(parts: &PatchModel) -> Array2<f32> {
    parts.low.dot(&parts.filters)
}

/// Atoms (rows of `side`² values) as tiles, [`ACROSS`] in a row, one white pixel between them.
fn tiles(atoms: ArrayView2<'_, f32>, side: usize) -> Array2<f32> {
    let rows = atoms.nrows().div_ceil(ACROSS);
    let cell = side + 1;
    let mut out = Array2::<f32>::ones((rows * cell, ACROSS.min(atoms.nrows()) * cell));
    for (n, atom) in atoms.rows().into_iter().enumerate() {
        let largest = atom.iter().fold(1e-12f32, |l, v| l.max(v.abs()));
        let (top, left) = (n / ACROSS * cell, n % ACROSS * cell);
        for (i, v) in atom.iter().enumerate().take(side * side) {
            out[[top + i / side, left + i % side]] = 0.5 + 0.5 * v / largest;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::dictionary::Footprint;

    fn epoch(stage: &str, number: usize, objective: f64, psnr: Option<f64>) -> Epoch {
        Epoch {
            footprint: Footprint::Lenslet,
            pass: 1,
            stage: stage.into(),
            epoch: number,
            objective,
            nonzeros: 3.0,
            replaced: 0,
            held_out_psnr: psnr,
            low_psnr: psnr.map(|p| p - 1.0),
            network_psnr: None,
            seconds: 1.0,
        }
    }

    #[test]
    fn every_epoch_is_a_point() {
        let trace =
            [epoch("learn", 1, 2.0, Some(30.0)), epoch("learn", 2, 1.0, Some(31.0)), epoch("refine", 1, 5.0, None)];
        let svg = convergence(&trace);
        // Two of the PSNR, two of the low image, two objectives of learning and one of refinement.
        assert_eq!(svg.matches("<circle").count(), 7);
        assert_eq!(svg.matches("<svg").count(), svg.matches("</svg>").count());
        assert!(svg.contains("lenslet, pass 1, refine") && !svg.contains("NaN"));
        assert!(!convergence(&[]).contains("NaN"));
    }

    #[test]
    fn tiles_show_each_atom_in_its_place() {
        let atoms = Array2::from_shape_fn((35, 9), |(k, i)| if i == k % 9 { -2.0 } else { 0.0 });
        let picture = tiles(atoms.view(), 3);
        assert_eq!(picture.dim(), (8, 128));
        // Atom 33 is the second of the second row, its value 33 % 9 = 6 the first of its third row.
        assert_eq!(picture[[4 + 2, 4]], 0.0);
        assert_eq!(picture[[4, 4]], 0.5);
        assert_eq!(picture[[3, 0]], 1.0);
    }
}
