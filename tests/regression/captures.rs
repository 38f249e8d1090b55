//! Captures whose metadata are unusual, damaged or contradict the pixels: read right, or refused with the reason.

use lenslet_core::container::Capture;
use lenslet_core::container::packing::{Packing, unpack};
use serde_json::json;

use super::bench::Bench;
use super::containers::{changed, edited};
use super::fields::aloud;

const DECODE: &str = "-c cam.calib --size 40 --views 3 --method barycentric --out";

/// The pixels of the stock capture.
fn pixels(bench: &Bench) -> Vec<u16> {
    Capture::open(bench.at("s1/capture.lfp")).unwrap().mosaic.data
}

/// Writes the stock capture with another stated packing and image.
fn repacked(bench: &Bench, name: &str, packing: serde_json::Value, shift: u32, image: &[u8]) {
    let bytes = edited(&bench.at("s1/capture.lfp"), |used, bytes| match used {
        "imageRef" => image.to_vec(),
        "metadataRef" => changed(&bytes, |m| {
            m["image"]["rawDetails"]["pixelPacking"] = packing.clone();
            m["image"]["rawDetails"]["pixelFormat"]["rightShift"] = shift.into();
        }),
        _ => bytes,
    });
    bench.put(name, bytes);
}

/// A packing that nothing reads was decoded as another one, to a picture of wrong colours, a black or a white one.
#[test]
fn packings_are_read_right_or_refused_by_name() {
    let bench = Bench::new();
    let values = pixels(&bench);
    let le12: Vec<u8> = values
        .chunks_exact(2)
        .flat_map(|p| [p[0] as u8, (p[0] >> 8) as u8 | ((p[1] & 15) << 4) as u8, (p[1] >> 4) as u8])
        .collect();
    repacked(&bench, "le12.lfp", json!({"bitsPerPixel": 12, "endianness": "little"}), 0, &le12);
    repacked(&bench, "be14.lfp", json!({"bitsPerPixel": 14, "endianness": "big"}), 0, &vec![0; values.len() * 14 / 8]);
    for (name, word) in [("le12", "12 bit, little"), ("be14", "14 bit, big")] {
        bench.refused(&format!("decode {name}.lfp {DECODE} x"), &[&format!("{name}.lfp"), "not supported", word]);
        bench.refused(&format!("calibrate {name}.lfp --out x.calib"), &["not supported", word]);
        assert!(
            bench.done(&format!("info {name}.lfp")).out.contains(word)
                || bench.run(&format!("--json info {name}.lfp")).out.contains(word)
        );
    }
    let shifted: Vec<u8> = values.iter().flat_map(|v| (v * 16).to_le_bytes()).collect();
    repacked(&bench, "shift4.lfp", json!({"bitsPerPixel": 16, "endianness": "little"}), 4, &shifted);
    assert_eq!(pixels(&bench), Capture::open(bench.at("shift4.lfp")).unwrap().mosaic.data);
    repacked(&bench, "shift16.lfp", json!({"bitsPerPixel": 16, "endianness": "little"}), 16, &shifted);
    bench.refused(&format!("decode shift16.lfp {DECODE} x"), &["shift16.lfp", "shift of 16"]);
    // Without a byte order there is one way only.
    let own = edited(&bench.at("s1/capture.lfp"), |used, bytes| match used {
        "metadataRef" => changed(&bytes, |m| {
            m["image"]["rawDetails"]["pixelPacking"].as_object_mut().unwrap().remove("endianness");
        }),
        _ => bytes,
    });
    bench.put("unordered.lfp", own);
    assert_eq!(pixels(&bench), Capture::open(bench.at("unordered.lfp")).unwrap().mosaic.data);
    // A depth that the bytes contradict.
    let wide: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    repacked(&bench, "wide.lfp", json!({"bitsPerPixel": 12, "endianness": "big"}), 0, &wide);
    bench.refused(&format!("decode wide.lfp {DECODE} x"), &["wide.lfp", "contradict"]);
    assert_eq!(unpack(Packing::Le16, &wide, values.len()), Some(values));
}

#[test]
fn filter_arrays_that_nothing_reads_are_refused_by_name() {
    let bench = Bench::new();
    for (tile, first) in [("x-trans", "b"), ("r,gr:gb,b", "white")] {
        let bytes = edited(&bench.at("s1/capture.lfp"), |used, bytes| match used {
            "metadataRef" => changed(&bytes, |m| {
                m["image"]["rawDetails"]["mosaic"] = json!({"tile": tile, "upperLeftPixel": first});
            }),
            _ => bytes,
        });
        bench.put("odd.lfp", bytes);
        bench.refused(&format!("decode odd.lfp {DECODE} x"), &["odd.lfp", "filter array", tile, first]);
    }
}

/// One odd byte, or one NaN, cost all facts, and nothing said so.
#[test]
fn damaged_metadata_keep_the_facts_that_can_be_read() {
    let bench = Bench::new();
    let expected = Capture::open(bench.at("s1/capture.lfp")).unwrap();
    let with = |name: &str, change: &dyn Fn(Vec<u8>) -> Vec<u8>| {
        let bytes = edited(
            &bench.at("s1/capture.lfp"),
            |used, bytes| if used == "metadataRef" { change(bytes) } else { bytes },
        );
        bench.put(name, bytes);
    };
    let inserted = |bytes: Vec<u8>, text: &[u8]| {
        let at = bytes.iter().position(|b| *b == b'{').unwrap() + 1;
        [&bytes[..at], text, &bytes[at..]].concat()
    };
    with("latin1.lfp", &|b| inserted(b, b"\"owner\": \"J\xfcrgen\",\n"));
    with("nan.lfp", &|b| inserted(b, b"\"lambda\": NaN, \"far\": -Infinity,\n"));
    with("huge.lfp", &|b| inserted(b, &[b"\"pad\": \"", "x".repeat(9 << 20).as_bytes(), b"\",\n"].concat()));
    for name in ["latin1.lfp", "nan.lfp", "huge.lfp"] {
        let capture = Capture::open(bench.at(name)).unwrap();
        assert_eq!((&capture.mosaic, &capture.camera), (&expected.mosaic, &expected.camera), "{name}");
        assert!(capture.warnings.iter().any(|w| w.contains("metadataRef")), "{name}: {:?}", capture.warnings);
        let answer = aloud(bench.path(), &format!("decode {name} {DECODE} o-{name}.lf"));
        assert!(answer.code == Some(0) && answer.err.contains("metadataRef"), "{name}: {}", answer.err);
    }
    // Beyond repair, the reason comes with the error.
    with("cut.lfp", &|b| b[..b.len() / 9].to_vec());
    bench.refused(&format!("decode cut.lfp {DECODE} x"), &["cut.lfp", "metadataRef", "not valid JSON"]);
}
