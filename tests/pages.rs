//! Pages made of files whose names and texts are markup: shown as they are, and even markup that got in does nothing.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::fs;
use std::process::Command;

use browser::Browser;
use ndarray::Array5;

mod browser;

/// Does something when it is taken for markup, wherever it stands.
const PLANTED: &str = "<img src=x onerror=globalThis.planted=1>'\"><script>planted=2<";

#[test]
fn names_and_texts_of_files_are_no_markup() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let data =
        Array5::from_shape_fn((3, 3, 24, 30, 3), |(v, u, t, s, _)| ((s + u) * 7 % 11 + (t + v) * 5 % 13) as f32 / 24.0);
    let file = at(&format!("{PLANTED}.npy"));
    ndarray_npy::write_npy(&file, &data).unwrap();
    // A folder whose description has it as well.
    let lenslet = |arguments: &[&str]| {
        let output =
            Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("-q").args(arguments).current_dir(folder.path()).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    lenslet(&["convert", file.to_str().unwrap(), "--out", "field"]);
    let description = fs::read_to_string(at("field/lightfield.json")).unwrap();
    let mut json: serde_json::Value = serde_json::from_str(&description).unwrap();
    json["method"] = PLANTED.into();
    fs::write(at("field/lightfield.json"), json.to_string()).unwrap();
    lenslet(&["view", file.to_str().unwrap(), "field", "--out", "page.html"]);

    let html = fs::read_to_string(at("page.html")).unwrap();
    assert!(html.contains("&lt;img src=x onerror=globalThis.planted=1&gt;") && html.contains("\\u003cimg src=x"));
    assert!(!html.contains("<img src=x") && !html.contains("<script>planted"));
    let Some(mut browser) = Browser::start() else { return };
    browser.open(&at("page.html"), "plain");
    browser.wait("document.documentElement.dataset.ready");
    assert_eq!(browser.value("document.title"), PLANTED);
    assert_eq!(browser.value("typeof planted"), "undefined");
    assert_eq!(browser.complaints(), [""; 0]);

    // Had it got in, the page's policy would keep it from doing anything.
    let broken =
        html.replacen("<body>", "<body><script>globalThis.planted = 3</script><p onclick=\"planted = 4\">x</p>", 1);
    assert_ne!(broken, html);
    fs::write(at("broken.html"), broken).unwrap();
    browser.open(&at("broken.html"), "plain");
    browser.wait("document.documentElement.dataset.ready");
    browser.value("document.querySelector('p[onclick]').click(), 0");
    assert_eq!(browser.value("typeof planted"), "undefined");
    assert!(browser.complaints().iter().any(|c| c.contains("Content Security Policy")), "{:?}", browser.complaints());
}
