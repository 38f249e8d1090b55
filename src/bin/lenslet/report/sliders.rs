//! The sliders of a report in a browser, where one is installed.

use ndarray::Array3;

use super::{EmbeddedPicture, Page, Stage, Table};

#[path = "../../../../tests/browser/mod.rs"]
mod browser;

use browser::Browser;

/// A picture of 120×90: its upper left pixel white, the rest of one colour.
fn stage(name: &str, colour: [f32; 3]) -> Stage {
    let view = Array3::from_shape_fn((90, 120, 3), |(t, s, c)| if (t, s) == (0, 0) { 1.0 } else { colour[c] });
    Stage { name: name.into(), picture: EmbeddedPicture::png(&view, 4).unwrap() }
}

#[test]
fn the_sliders_of_a_report_work_by_mouse_and_keyboard() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let mut page = Page::new("Sliders", "three colours");
    let cell = |k: usize| format!("{k}.25 ± 0.10");
    page.table(&Table {
        caption: "a wide one".into(),
        head: (0..14).map(|k| format!("score {k}")).collect(),
        rows: vec![(0..14).map(cell).collect()],
        best: vec![(0, 1)],
    });
    let stages = [stage("red", [0.8, 0.1, 0.1]), stage("green", [0.1, 0.8, 0.1]), stage("blue", [0.1, 0.1, 0.8])];
    page.compare("colours", &stages, [0.5, 0.5]);
    std::fs::write(&path, page.finish()).unwrap();
    let Some(mut browser) = Browser::start() else { return };
    for (width, dark) in [(1280, false), (400, true)] {
        browser.window(width, 900, dark);
        browser.open(&path, "");
        browser.wait(
            "document.querySelector('.compare.live .loupe canvas').getContext('2d').getImageData(9, 9, 1, 1).data[3]",
        );
        let whole = browser.value("document.documentElement.scrollWidth").as_u64().unwrap();
        assert!(whole <= u64::from(width), "the page is {whole} wide, the window {width}");
        let [x, y, w, h] = browser.place(".compare .frame");
        // The colour at a share of the picture's width: the largest of red (0), green (1), blue (2).
        let colour = |browser: &mut Browser, share: f64| {
            let shot = image::load_from_memory(&browser.screenshot(false)).unwrap().to_rgb8();
            let p = shot.get_pixel((x + w * (share - 0.5)) as u32, (y - 0.4 * h) as u32).0;
            (0..3).max_by_key(|&k| p[k]).unwrap()
        };
        assert_eq!([colour(&mut browser, 0.3), colour(&mut browser, 0.7)], [0, 1]);
        // The mouse takes the border along.
        browser.drag([x, y], [x + 0.4 * w, y], 5);
        assert_eq!([colour(&mut browser, 0.7), colour(&mut browser, 0.95)], [0, 1]);
        let cut = "Number(document.querySelector('.compare input').value)";
        assert!((browser.value(cut).as_f64().unwrap() - 90.0).abs() < 1.0);
        // The keyboard as well, from the first choice to the slider and on.
        browser.value("document.querySelector('.compare select').focus(), 0");
        browser.key("Tab");
        (0..100).for_each(|_| browser.key("ArrowLeft"));
        assert!((browser.value(cut).as_f64().unwrap() - 40.0).abs() < 1.0);
        assert_eq!([colour(&mut browser, 0.3), colour(&mut browser, 0.7)], [0, 1]);
        // Another picture to the right.
        browser.key("Tab");
        browser.key("ArrowDown");
        assert_eq!([colour(&mut browser, 0.3), colour(&mut browser, 0.7)], [0, 2]);
        // Arrow keys move the enlarged crop, to the corner with its white pixel.
        let white = "[...document.querySelectorAll('.loupe canvas')].map(c => c.getContext('2d').getImageData(1, 1, 1, 1).data.join()).join(' ')";
        let before = browser.value(white);
        browser.value("document.querySelector('.compare .frame').focus(), 0");
        (0..100).for_each(|_| browser.key("ArrowLeft"));
        (0..60).for_each(|_| browser.key("ArrowUp"));
        let corner = browser.value(white);
        assert_ne!(before, corner);
        assert_eq!(corner, ["255,255,255,255"; 3].join(" "));
        assert_eq!(browser.complaints(), [""; 0]);
    }
}
