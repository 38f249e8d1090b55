//! Which white image is a capture's: never a capture, never another camera's.

use std::fs;
use std::path::PathBuf;

use lenslet_core::container::Capture;
use lenslet_test_support::data;

use super::bench::Bench;
use super::containers::{archive, changed, edited};
use super::fields::{aloud, told};

/// A capture given as white image was calibrated, and every picture divided by its scene.
#[test]
fn captures_are_no_white_images() {
    let bench = Bench::new();
    for scene in ["natural", "chart"] {
        bench.done(&format!("simulate --scene {scene} --sensor 328 --size 108 --views 1 --whites 2 --out {scene}"));
        bench.refused(&format!("calibrate {scene}/capture.lfp --out x.calib"), &["capture.lfp", "--from-captures"]);
        // Whites do not hide it.
        let mix = format!("calibrate {scene}/white-00.lfp {scene}/capture.lfp {scene}/white-01.lfp --out x.calib");
        bench.refused(&mix, &["capture.lfp", "--from-captures"]);
        bench.done(&format!("calibrate {scene}/white-00.lfp {scene}/white-01.lfp --out {scene}.calib"));
        bench.done(&format!("calibrate --from-captures {scene}/capture.lfp --out {scene}-own.calib"));
    }
    assert!(!bench.at("x.calib").exists());
    for noise in ["0", "4"] {
        bench.done(&format!("simulate --noise {noise} --sensor 328 --size 54 --views 1 --whites 1 --out n{noise}"));
        let answer = aloud(bench.path(), &format!("calibrate n{noise}/white-00.lfp --out n{noise}.calib"));
        assert!(answer.code == Some(0) && !answer.err.contains("no clean white image"), "{}", answer.err);
    }
}

/// Real light: a pattern composed of captures is taken with a word, a true white image without, captures are refused.
#[test]
fn real_white_images_are_told_from_real_captures() {
    let bench = Bench::new();
    let Some(folder) = data("f01") else { return };
    let calibrate = |name: &str| {
        let line = format!("calibrate {} --profile lytro-f01 --out {name}.calib", folder.join(name).display());
        aloud(bench.path(), &line)
    };
    for name in ["IMG_2.jpg", "IMG_3.jpg", "IMG_4.jpg"] {
        let answer = calibrate(name);
        assert!(answer.code == Some(1) && answer.err.contains("--from-captures"), "{name}: {}", answer.err);
    }
    let answer = calibrate("pseudo_white_8bit.png");
    assert!(answer.code == Some(0) && answer.err.contains("no clean white image"), "{}", answer.err);
    let answer = calibrate("f01_white_crop_161x161.png");
    assert!(answer.code == Some(0) && !answer.err.contains("no clean white image"), "{}", answer.err);
}

/// Archives and folders of two cameras, and a capture of each with and without its serial number.
fn two_cameras(bench: &Bench) -> [String; 2] {
    let serials = ["B5999900001".to_owned(), "B5111100002".to_owned()];
    for (k, serial) in serials.iter().enumerate() {
        let offset = ["0,0", "6.5,3.1"][k];
        bench.done(&format!(
            "simulate --camera lytro-illum --sensor 320x240 --size 108 --views 1 --whites 1 --offset {offset} --out cam{k}"
        ));
        let (mut raw, mut text) = (Vec::new(), Vec::new());
        let own = |with: bool, raw: &mut Vec<u8>, text: &mut Vec<u8>| {
            edited(&bench.at(&format!("cam{k}/capture.lfr")), |used, bytes| match used {
                "modulationDataRef" => {
                    raw.clone_from(&bytes);
                    bytes
                }
                "modulationDataMetadataRef" => {
                    *text = changed(&bytes, |m| {
                        m["master"]["picture"]["frameArray"][0]["frame"]["privateMetadata"]["camera"]["serialNumber"] =
                            serial.as_str().into();
                    });
                    bytes
                }
                "privateMetadataRef" => changed(&bytes, |m| {
                    m["camera"]["serialNumber"] = if with { serial.as_str().into() } else { serde_json::Value::Null };
                }),
                "contents" => {
                    let mut contents: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
                    strip(&mut contents);
                    serde_json::to_vec(&contents).unwrap()
                }
                _ => bytes,
            })
        };
        let named = own(true, &mut raw, &mut text);
        bench.put(&format!("cap{k}.lfr"), named);
        let unnamed = own(false, &mut raw, &mut text);
        bench.put(&format!("cap{k}-noserial.lfr"), unnamed);
        let files: [(&str, &[u8]); 2] = [("unitdata/MOD_0001.RAW", &raw), ("unitdata/MOD_0001.TXT", &text)];
        bench.put(&format!("two/caldata-{serial}.tar"), archive(&files));
        for (name, bytes) in files {
            bench.put(&format!("dirs/{serial}/{name}"), bytes);
        }
    }
    serials
}

/// Leaves the capture's own white image out of a table of contents.
fn strip(contents: &mut serde_json::Value) {
    match contents {
        serde_json::Value::Object(map) => {
            map.remove("modulationDataRef");
            map.remove("modulationDataMetadataRef");
            map.remove("geometryCorrectionRef");
            map.remove("derivationArray");
            map.values_mut().for_each(strip);
        }
        serde_json::Value::Array(list) => list.iter_mut().for_each(strip),
        _ => {}
    }
}

/// The .TXT of one archive was taken for the .RAW of both.
#[test]
fn two_cameras_side_by_side_keep_their_own_white_images() {
    let bench = Bench::new();
    let serials = two_cameras(&bench);
    for place in ["two", "dirs"] {
        let images = told(bench.path(), &format!("info {place}"));
        for serial in &serials {
            assert_eq!(images.to_string().matches(&format!("\"{serial}\"")).count(), 1, "{place}: {images}");
        }
        for (k, serial) in serials.iter().enumerate() {
            let out =
                told(bench.path(), &format!("decode cap{k}.lfr -c {place} --size 40 --views 1 --out {place}{k}.lf"));
            let reason = out["calibration"].as_str().unwrap();
            assert!(reason.contains(serial.as_str()), "{place} {k}: {reason}");
            // Without a serial number nothing says which camera's it is.
            bench.refused(
                &format!("decode cap{k}-noserial.lfr -c {place} --size 40 --views 1 --out x"),
                &[&serials[0], &serials[1]],
            );
        }
        bench.refused(&format!("calibrate --bundle {place} --out x"), &[&serials[0], &serials[1]]);
    }
    assert_eq!(Capture::open(bench.at("cap0.lfr")).unwrap().white, None);
    bench.done(&format!("calibrate --bundle two/caldata-{}.tar --out one", serials[1]));
    let made: Vec<PathBuf> = fs::read_dir(bench.at("one")).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(made.iter().any(|p| p.to_string_lossy().contains(serials[1].as_str())), "{made:?}");
}
