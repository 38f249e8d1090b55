//! Wall and CPU seconds of the viewer page of a 7x7x1080x1080 light field in headless Chromium, drawing in software: until the first
//! picture stands, and for every picture while the focus moves. `cargo bench --bench viewer [-- PAGE.html]` prints
//! one JSON object; without a Chromium it says so.

#![allow(clippy::print_stdout)] // its findings

use std::path::PathBuf;
use std::process::Command;

use ndarray::Array5;

#[allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr)]
#[path = "../tests/browser/mod.rs"]
mod browser;

const SIDE: usize = 1080;

/// Writes the page of a made-up light field with detail everywhere, so that its JPEGs are of ordinary size.
fn page(folder: &std::path::Path) -> Option<PathBuf> {
    let line: Vec<f32> =
        (0..SIDE + 16).map(|k| 0.5 + 0.2 * (k as f32 * 0.37).sin() + 0.2 * (k as f32 * 0.031).cos()).collect();
    let field = Array5::from_shape_fn((7, 7, SIDE, SIDE, 3), |(v, u, t, s, c)| {
        line[s + u] * line[t + v] * (1.0 - 0.1 * c as f32)
    });
    let (data, page) = (folder.join("field.npy"), folder.join("page.html"));
    ndarray_npy::write_npy(&data, &field).ok()?;
    let done =
        Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("-q").arg("view").arg(&data).arg("--out").arg(&page).status();
    done.ok()?.success().then_some(page)
}

fn main() {
    let Some(mut browser) = browser::Browser::start() else { return };
    let Ok(folder) = tempfile::tempdir() else { return };
    let given = std::env::args().skip(1).find(|a| a.ends_with(".html")).map(PathBuf::from);
    let Some(page) = given.and_then(|p| p.canonicalize().ok()).or_else(|| page(folder.path())) else { return };
    // The picture 720 pixels wide, the controls below it.
    browser.window(760, 1100, false);
    // Drawn as the page sees fit, then by a graphics processor done in software, which it avoids.
    for hash in ["", "webgl"] {
        let before = browser.cpu_seconds();
        browser.open(&page, hash);
        browser.wait("document.documentElement.dataset.opened");
        let opening = browser.cpu_seconds() - before;
        let opened = browser.value("Number(document.documentElement.dataset.opened)");
        browser.wait("document.documentElement.dataset.ready");
        let shown = browser.value("Math.round(document.querySelector('#view').getBoundingClientRect().width)");
        let before = browser.cpu_seconds();
        let moving = browser.value(
            "new Promise(done => {
               const slider = document.querySelector('#focus'), start = performance.now(), first = painted.frames, scales = [];
               const step = now => {
                 slider.value = 500 + 500 * Math.sin((now - start) / 300);
                 slider.dispatchEvent(new Event('input'));
                 scales.push(state.scale);
                 const t = now - start;
                 if (t < 4000) requestAnimationFrame(step);
                 else done({ frames: painted.frames - first, frames_per_second: (painted.frames - first) / t * 1000, scale: scales.sort()[scales.length >> 1] });
               };
               requestAnimationFrame(step);
             })",
        );
        let each = (browser.cpu_seconds() - before) / moving["frames"].as_f64().unwrap_or(f64::NAN);
        let full = browser.value(
            "(() => { state.scale = 1; const start = performance.now(); let n = 0;
               while (performance.now() - start < 2000) { state.focus = low + (high - low) * (n % 10) / 10; show(); painter.pixels(); n++; }
               return n / (performance.now() - start) * 1000; })()",
        );
        let painter = browser.value("painter.name");
        let line = serde_json::json!({
            "painter": painter, "shown_pixels": shown, "opened_ms": opened, "opening_cpu_seconds": opening,
            "moving": moving, "moving_cpu_seconds_a_frame": each, "full_size_frames_per_second": full,
            "complaints": browser.complaints(),
        });
        println!("{line}");
    }
}
