//! Robustness of a calibration against hot pixels, wrong priors, bad images among good ones, any lattice and light.

use std::sync::Mutex;

use proptest::prelude::*;

use super::planted::{BLACK, PlantedCamera, WHITE, capture};
use super::{CENTRES, compare, lattice_distance, scenes};
use crate::calibration::*;
use crate::container::{Capture, MlaHint};
use crate::progress::Observer;
use crate::progress::Silent;

/// Collects the notes.
#[derive(Default)]
struct Notes(Mutex<Vec<String>>);

impl Observer for Notes {
    fn note(&self, text: &str) {
        self.0.lock().unwrap().push(text.to_string());
    }
}

#[test]
fn hot_pixels_of_black_images_are_left_out_of_centres_and_white_image() {
    let plant = PlantedCamera { jitter: 0.05, width: 400, height: 400, ..PlantedCamera::default() };
    let (clean, truth) = plant.white_image();
    // Near every twelfth centre a few pixels are slightly bright: not outliers, but enough to bias the centre.
    let near: Vec<[f64; 2]> =
        truth.iter().map(|t| t.1).enumerate().filter(|(k, _)| k % 12 == 0).map(|(_, c)| c).collect();
    let mut hot: Vec<u32> = near
        .iter()
        .flat_map(|c| [(2, 0), (2, 1), (2, 2), (3, 0), (3, 1)].map(|(x, y)| (c[0] as u32 + x, c[1] as u32 + y)))
        .filter(|&(x, y)| x < 400 && y < 400)
        .map(|(x, y)| y * 400 + x)
        .collect();
    hot.sort_unstable();
    let mut white = clean.clone();
    let mut black = capture(400, 400, (0..160_000).map(|k: u32| 165 + (k * 7919 % 7) as u16).collect());
    for &k in &hot {
        white.mosaic.data[k as usize] += 220;
        black.mosaic.data[k as usize] += 220;
    }
    let found = find_hot_pixels(&[black.clone(), black]).unwrap();
    assert_eq!(found, hot);
    let run = |white: &Capture, hot_pixels: &[u32]| {
        let options = CalibrationOptions { hot_pixels: hot_pixels.to_vec(), ..CalibrationOptions::default() };
        calibrate(std::slice::from_ref(white), &options, &Silent).unwrap()
    };
    let rms = |c: &Calibration| compare(c, &near, 20.0).0;
    let (known, unknown, never) = (run(&white, &hot), run(&white, &[]), run(&clean, &[]));
    let all = (rms(&known), rms(&unknown), rms(&never));
    assert!(all.0 < 1.25 * all.2 && all.1 > 1.5 * all.0, "known, unknown, never hot: {all:?}");
    assert_eq!((known.hot_pixels.as_slice(), unknown.hot_pixels.len()), (hot.as_slice(), 0));
    // In the white image they are filled from their neighbours.
    hot.iter().for_each(|&k| white.mosaic.data[k as usize] = 4095);
    let at = |c: &Calibration, k: u32| f64::from(c.vignetting.as_ref().unwrap().white[k as usize]) / 32768.0;
    let off = |c: &Calibration| hot.iter().map(|&k| (at(c, k) - at(&never, k)).powi(2)).sum::<f64>();
    let (known, unknown) = (off(&run(&white, &hot)), off(&run(&white, &[])));
    assert!(known < 0.1 * unknown, "{known} {unknown}");
    // In captures they are left out as well.
    let options = CalibrationOptions { hot_pixels: hot.clone(), ..CENTRES };
    let mut shots = scenes(&clean, 3);
    let clean_rms = rms(&calibrate_from_captures(&shots, &options, &Silent).unwrap());
    shots.iter_mut().for_each(|s| hot.iter().for_each(|&k| s.mosaic.data[k as usize] = 4095));
    assert!((rms(&calibrate_from_captures(&shots, &options, &Silent).unwrap()) - clean_rms).abs() < 1e-9);
    for wrong in [vec![7, 3], vec![160_000], (0..160_000).collect()] {
        let options = CalibrationOptions { hot_pixels: wrong, ..CENTRES };
        assert!(matches!(calibrate(std::slice::from_ref(&clean), &options, &Silent), Err(Error::Parameter(_))));
    }
}

#[test]
fn a_wrong_prior_changes_nothing() {
    for (grid, pitch) in [(Grid::HexRows, 10.0), (Grid::HexColumns, 14.286), (Grid::Square, 12.0)] {
        let plant = PlantedCamera { grid, pitch, width: 300, height: 280, ..PlantedCamera::default() };
        let (mut white, _) = plant.white_image();
        let blind = calibrate(std::slice::from_ref(&white), &CENTRES, &Silent).unwrap();
        // Other pitches, the pattern's own overtones and subharmonics among them, other angles.
        for factor in [0.5, 1.0 / 3f64.sqrt(), 0.8, 1.0, 1.2, 3f64.sqrt(), 2.0] {
            for rotation in [0.003, 0.3, -1.5] {
                white.mla = Some(MlaHint { pitch: pitch * factor, rotation, row_stretch: 1.3 });
                let lied = calibrate(std::slice::from_ref(&white), &CENTRES, &Silent).unwrap();
                assert_eq!(lied.lattice.grid, grid);
                assert!(
                    lattice_distance(&lied.lattice, &blind.lattice, 300, 280) < 1e-3,
                    "{grid:?} {factor} {rotation}"
                );
                assert_eq!(lied.lenslets.len(), blind.lenslets.len());
            }
        }
    }
    // A prior does not make a pattern where there is none.
    let noise = (0..300 * 300u32).map(|k| 900 + (k.wrapping_mul(2_654_435_761) >> 20) as u16 % 700).collect();
    let mut nothing = capture(300, 300, noise);
    nothing.mla = Some(MlaHint { pitch: 10.0, rotation: 0.003, row_stretch: 1.0004 });
    assert!(matches!(calibrate(&[nothing], &CENTRES, &Silent), Err(Error::NoPattern { .. })));
}

#[test]
fn a_true_prior_wins_over_other_periodic_patterns() {
    let plant = PlantedCamera { width: 400, height: 400, ..PlantedCamera::default() };
    let (clean, _) = plant.white_image();
    let right = |c: &Result<Calibration, Error>| {
        c.as_ref().is_ok_and(|c| lattice_distance(&c.lattice, &plant.lattice(), 400, 400) < 0.3)
    };
    let (mut gained, mut refused) = (0, 0);
    for strength in [0.1, 0.2, 0.3, 0.4] {
        // Light through a fence.
        let mut white = clean.clone();
        for (k, v) in white.mosaic.data.iter_mut().enumerate() {
            let turns = |p: usize| (2.0 * std::f64::consts::PI * p as f64 / 15.3).cos();
            let fence = 0.5 * (1.0 + strength * (turns(k % 400) + turns(k / 400)));
            *v = (BLACK + (f64::from(*v) - BLACK) * fence).clamp(0.0, WHITE) as u16;
        }
        let blind = calibrate(std::slice::from_ref(&white), &CENTRES, &Silent);
        white.mla = Some(MlaHint { pitch: 10.0, rotation: -0.003, row_stretch: 1.0 });
        let led = calibrate(&[white], &CENTRES, &Silent);
        // A fence that shows too much is a scene, and no white image.
        if strength > 0.1 && matches!(led, Err(Error::NotWhite { .. })) {
            refused += 1;
            continue;
        }
        assert!(right(&led), "{strength}");
        gained += usize::from(!right(&blind));
    }
    assert!(gained + refused >= 1, "{gained} {refused}");
}

#[test]
fn bad_images_among_good_ones_are_left_out_with_a_note() {
    let plant = PlantedCamera { jitter: 0.05, width: 400, height: 400, ..PlantedCamera::default() };
    let (white, _) = plant.white_image();
    let flat = |v: f64| capture(400, 400, vec![v as u16; 160_000]);
    // A quarter turn: its lenslets lie elsewhere.
    let mut turned = white.clone();
    turned.mosaic.data = (0..160_000).map(|k| white.mosaic.data[(399 - k % 400) * 400 + k / 400]).collect();
    let mut broken = white.clone();
    broken.mosaic.data.pop();
    let larger = PlantedCamera { width: 420, ..plant.clone() }.white_image().0;
    let good = scenes(&white, 4);
    let bad = [flat(BLACK), flat(WHITE), broken, larger, scenes(&turned, 1).remove(0), flat(1500.0)];
    let mut all = good.clone();
    for (k, b) in bad.iter().enumerate() {
        all.insert((2 * k) % (all.len() + 1), b.clone());
    }
    let notes = Notes::default();
    let options = CalibrationOptions { names: (0..all.len()).map(|k| format!("shot {k}")).collect(), ..CENTRES };
    let found = calibrate_from_captures(&all, &options, &notes).unwrap();
    let said = notes.0.into_inner().unwrap();
    assert_eq!(said.iter().filter(|n| n.starts_with("shot ") && n.contains("left out")).count(), bad.len(), "{said:?}");
    let expected = calibrate_from_captures(&good, &CENTRES, &Silent).unwrap();
    assert!(found.lenslets == expected.lenslets && found.origin.sources.len() == 4);
    assert!(matches!(calibrate_from_captures(&bad[..3], &CENTRES, &Silent), Err(Error::Black { .. })));
    assert!(matches!(
        calibrate_from_captures(&[bad[5].clone(), bad[5].clone()], &CENTRES, &Silent),
        Err(Error::NoPattern { .. })
    ));

    let whites = [bad[0].clone(), white.clone(), bad[1].clone(), white.clone(), bad[2].clone()];
    let found = calibrate(&whites, &CENTRES, &Silent).unwrap();
    assert_eq!(found, calibrate(&[white.clone(), white], &CENTRES, &Silent).unwrap());
    assert!(matches!(calibrate(&bad[..3], &CENTRES, &Silent), Err(Error::Black { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn any_camera_is_found(
        pitch in 8.0f64..30.0,
        rotation in -0.1f64..0.1,
        stretch in 0.999f64..1.002,
        kind in 0usize..3,
        vignetting in 0.0f64..0.8,
        offset in (-20.0f64..20.0, -20.0f64..20.0),
        seed in 0u64..1_000_000,
    ) {
        let grid = [Grid::HexRows, Grid::HexColumns, Grid::Square][kind];
        // The axes of a stretched square grid may come out exchanged; the centres are the same.
        let plant = PlantedCamera {
            grid, pitch, rotation, stretch, vignetting, seed,
            offset: [offset.0, offset.1], jitter: 0.03, width: 420, height: 360, ..PlantedCamera::default()
        };
        let (white, truth) = plant.white_image();
        let found = calibrate(&[white], &CENTRES, &Silent).unwrap();
        let truth: Vec<[f64; 2]> = truth.into_iter().map(|t| t.1).collect();
        let (rms, worst, wrong) = compare(&found, &truth, 20.0);
        prop_assert!(rms < 0.03 && worst < 0.2 && wrong == 0, "{:?}: {} {} {}", plant, rms, worst, wrong);
        prop_assert_eq!(found.lattice.grid, grid);
    }
}

#[test]
fn dust_biases_centres_little() {
    let plant = PlantedCamera { jitter: 0.05, width: 420, height: 400, ..PlantedCamera::default() };
    let (mut white, truth) = plant.white_image();
    let truth: Vec<[f64; 2]> = truth.into_iter().map(|t| t.1).collect();
    // Soft spots that take up to half of the light.
    let spots: Vec<[f64; 2]> =
        (0..12).map(|k| [40.0 + f64::from(k * 97 % 340), 40.0 + f64::from(k * 61 % 320)]).collect();
    let far = |x: f64, y: f64| spots.iter().map(|s| (x - s[0]).hypot(y - s[1])).fold(f64::INFINITY, f64::min);
    for (k, v) in white.mosaic.data.iter_mut().enumerate() {
        let taken = 0.5 * (-0.5 * (far((k % 420) as f64, (k / 420) as f64) / 5.0).powi(2)).exp();
        *v = (BLACK + (f64::from(*v) - BLACK) * (1.0 - taken)) as u16;
    }
    let found = calibrate(&[white], &CENTRES, &Silent).unwrap();
    let clear: Vec<[f64; 2]> = truth.iter().copied().filter(|c| far(c[0], c[1]) > 25.0).collect();
    let (clear, (all, worst, wrong)) = (compare(&found, &clear, 20.0).0, compare(&found, &truth, 20.0));
    assert!(clear < 0.03 && all < 0.06 && worst < 0.4 && wrong == 0, "{clear} {all} {worst} {wrong}");
    assert!(lattice_distance(&found.lattice, &plant.lattice(), 420, 400) < 0.02);
}
