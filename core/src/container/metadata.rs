//! Frame metadata JSON into typed facts: F01 captures, Illum captures, the .TXT beside white images.
//!
//! Keys differ between cameras and programs; each fact is looked for under every key known for it.
//! Facts that are absent are `None`; facts out of range are dropped, with a warning.

use std::path::Path;

use serde_json::Value;

use super::cfa::Cfa;
use super::error::Error;
use super::facts::{CameraFacts, ColourFacts, Levels, MAX_SIDE, MlaHint, ccm_valid, gains_valid, gamma_valid};
use super::json::{integer_at, number_at, text_at, value_at};
use super::packing::Packing;
use super::references::is_sha1;

/// The facts of a frame in its metadata; `None` where absent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameFacts {
    /// Width and height in pixels.
    pub size: Option<(usize, usize)>,
    /// How the pixels are packed.
    pub packing: Option<Packing>,
    /// Low bits of every packed value that hold nothing (`rightShift`).
    pub right_shift: u32,
    /// How the image is stored where nothing here reads that, a line each: a packing, a filter array.
    pub unsupported: Vec<String>,
    /// Colour filter array.
    pub cfa: Option<Cfa>,
    /// Black and white levels.
    pub levels: Option<Levels>,
    /// White balance gains of R, Gr, Gb, B.
    pub white_balance: Option<[f32; 4]>,
    /// Camera RGB to linear sRGB, row-major.
    pub ccm: Option<[f32; 9]>,
    /// Encoding exponent (about 1/2.4).
    pub gamma: Option<f32>,
    /// Camera facts.
    pub camera: CameraFacts,
    /// Micro-lens array.
    pub mla: Option<MlaHint>,
    /// Pixel pitch in metres.
    pub pixel_pitch: Option<f64>,
    /// Whether the frame is tagged as a white image (`modulationFrame`).
    pub is_white: Option<bool>,
    /// Whether the frame is tagged as a dark image (`darkFrame`).
    pub is_dark: Option<bool>,
}

/// The frame inside a `master.picture` document (white images), or the document itself.
fn frame_nodes(root: &Value) -> (&Value, &Value) {
    let image = |v: &Value| value_at(v, "image.width").is_some() || value_at(v, "image.color").is_some();
    if image(root) {
        return (root, root);
    }
    for prefix in ["master.picture.frameArray.0", "picture.frameArray.0", "frames.0"] {
        if let Some(frame) = value_at(root, prefix).and_then(|entry| entry.get("frame")) {
            let metadata = frame.get("metadata").unwrap_or(frame);
            return (metadata, frame.get("privateMetadata").unwrap_or(root));
        }
    }
    (root, root)
}

/// Reads frame metadata; `private` is the document with the serial number, where that is another.
/// Returns the facts, and a warning for each that is out of range.
///
/// ```
/// use lenslet_core::container::{json, metadata};
///
/// let text = br#"{"image": {"width": 7728, "height": 5368, "iso": 80}, "camera": {"model": "ILLUM"}}"#;
/// let (facts, warnings) = metadata::read_frame(&json::parse(text)?, None);
/// assert_eq!((facts.size, facts.camera.iso), (Some((7728, 5368)), Some(80.0)));
/// assert!(facts.levels.is_none() && warnings.is_empty());
/// # Ok::<(), String>(())
/// ```
pub fn read_frame(root: &Value, private: Option<&Value>) -> (FrameFacts, Vec<String>) {
    let (m, own_private) = frame_nodes(root);
    let (is_white, is_dark) = frame_tags(root);
    let mut warnings = Vec::new();
    let mut drop = |what: &str, found: &dyn std::fmt::Debug| {
        warnings.push(format!("metadata: {what} is out of range ({found:?}) and was ignored"))
    };

    let size = match (integer_at(m, "image.width"), integer_at(m, "image.height")) {
        (Some(w), Some(h)) if (1..=MAX_SIDE as i64).contains(&w) && (1..=MAX_SIDE as i64).contains(&h) => {
            Some((w as usize, h as usize))
        }
        (None, None) => None,
        found => {
            drop("the image size", &found);
            None
        }
    };
    let image =
        |key: &str| value_at(m, &format!("image.rawDetails.{key}")).or_else(|| value_at(m, &format!("image.{key}")));
    let mut unsupported = Vec::new();
    let packing = image("pixelPacking").or_else(|| image("rawDetails.pixelPacking")).and_then(|p| {
        let order = p.get("endianness").and_then(Value::as_str);
        let bits = integer_at(p, "bitsPerPixel")?;
        let packing = u32::try_from(bits).ok().and_then(|bits| match order {
            Some(order) if order.eq_ignore_ascii_case("big") => Packing::new(bits, true),
            Some(order) if order.eq_ignore_ascii_case("little") => Packing::new(bits, false),
            Some(_) => None,
            // Without an order, the only one that there is.
            None => Packing::new(bits, false).or_else(|| Packing::new(bits, true)),
        });
        if packing.is_none() {
            let order = order.map_or(String::new(), |o| format!(", {o} endian"));
            unsupported.push(format!("this packing of the pixels is not supported: {bits} bit{order}"));
        }
        packing
    });
    let right_shift = image("pixelFormat").and_then(|f| integer_at(f, "rightShift")).unwrap_or(0);
    let right_shift =
        u32::try_from(right_shift).ok().filter(|s| *s < packing.map_or(16, Packing::bits)).unwrap_or_else(|| {
            unsupported.push(format!("a right shift of {right_shift} bits leaves nothing of the pixels"));
            0
        });
    let mosaic = image("mosaic").or_else(|| value_at(m, "devices.sensor.mosaic"));
    let cfa = mosaic.and_then(|m| {
        let cfa = read_cfa(m);
        if cfa.is_none() {
            let part =
                |key| m.get(key).and_then(Value::as_str).unwrap_or("not stated").chars().take(40).collect::<String>();
            let (tile, first) = (part("tile"), part("upperLeftPixel"));
            unsupported
                .push(format!("this colour filter array is not supported: tile {tile}, upper left pixel {first}"));
        }
        cfa
    });
    let levels = image("pixelFormat").and_then(|f| {
        let levels = Levels { black: four_channels(f, "black")?, white: four_channels(f, "white")? };
        levels.is_valid().then_some(levels).or_else(|| {
            drop("the black or white level", f);
            None
        })
    });
    let gains =
        four_channels(m, "image.color.whiteBalanceGain").or_else(|| four_channels(m, "algorithms.awb.computed.gain"));
    let ccm = ["image.color.ccmRgbToSrgbArray", "image.color.ccm"].iter().find_map(|p| matrix_entries(value_at(m, p)?));
    let gamma = number_at(m, "image.color.gamma").map(|g| g as f32);
    let mut keep = |what: &str, ok: bool, found: &dyn std::fmt::Debug| {
        if !ok {
            drop(what, found);
        }
        ok
    };
    let gains = gains.filter(|g| keep("the white balance", gains_valid(g), g));
    let ccm = ccm.filter(|c| keep("the colour matrix", ccm_valid(c), c));
    let gamma = gamma.filter(|g| keep("the gamma", gamma_valid(*g), g));

    let positive = |path: &str| number_at(m, path).filter(|x| *x > 0.0);
    let pixel_pitch = positive("devices.sensor.pixelPitch");
    let mla = positive("devices.mla.lensPitch").zip(pixel_pitch).and_then(|(lens, pixel)| {
        let hint = MlaHint {
            pitch: lens / pixel,
            rotation: number_at(m, "devices.mla.rotation").unwrap_or(0.0),
            row_stretch: number_at(m, "devices.mla.scaleFactor.y").unwrap_or(1.0),
        };
        hint.is_valid().then_some(hint).or_else(|| {
            drop("the lenslet pitch", &(lens, pixel));
            None
        })
    });

    let privates = [private, Some(own_private), Some(m), Some(root)];
    let first = |path: &str| privates.iter().flatten().find_map(|v| text_at(v, path));
    let response =
        four_channels(m, "devices.sensor.normalizedResponses.0").filter(|r| r.iter().all(|x| *x > 0.0 && *x < 100.0));
    let camera = CameraFacts {
        make: text_at(m, "camera.make"),
        model: text_at(m, "camera.model").or_else(|| text_at(root, "cameraModel")),
        serial: first("camera.serialNumber"),
        zoom_step: integer_at(m, "devices.lens.zoomStep").or_else(|| integer_at(m, "zoomStep")),
        focus_step: integer_at(m, "devices.lens.focusStep").or_else(|| integer_at(m, "focusStep")),
        iso: positive("devices.sensor.iso").or_else(|| positive("image.iso")),
        exposure_seconds: positive("devices.shutter.pixelExposureDuration")
            .or_else(|| positive("devices.shutter.frameExposureDuration")),
        exposure_bias: number_at(m, "image.modulationExposureBias").filter(|b| b.abs() < 100.0),
        normalized_response: response,
        white_ref: white_ref(root),
    };
    let frame = FrameFacts {
        size,
        packing,
        right_shift,
        unsupported,
        cfa,
        levels,
        white_balance: gains,
        ccm,
        gamma,
        camera,
        mla,
        pixel_pitch,
        is_white,
        is_dark,
    };
    (frame, warnings)
}

/// Whether a picture document tags its frame as a white image (`modulationFrame`), as a dark one (`darkFrame`).
pub fn frame_tags(root: &Value) -> (Option<bool>, Option<bool>) {
    let tags = ["picture.frameArray.0.parameters", "master.picture.frameArray.0.parameters", "frames.0.parameters"]
        .iter()
        .find_map(|p| value_at(root, p)?.get("vendorContent")?.get("com.lytro.tags"));
    let tag = |key: &str| tags.and_then(|t| t.get(key)).and_then(Value::as_bool);
    (tag("modulationFrame"), tag("darkFrame"))
}

/// The white image a picture document names: Illum by `geometryCorrectionRef`, else the first ancestor.
pub fn white_ref(root: &Value) -> Option<String> {
    [
        "frames.0.frame.geometryCorrectionRef",
        "picture.frameArray.0.frame.geometryCorrectionRef",
        "picture.derivationArray.0",
        "master.picture.derivationArray.0",
        "derivations.0",
    ]
    .iter()
    .filter_map(|p| text_at(root, p))
    .map(|s| s.to_ascii_lowercase())
    .find(|s| is_sha1(s) && s.bytes().skip(5).any(|b| b != b'0'))
}

fn read_cfa(mosaic: &Value) -> Option<Cfa> {
    let tile = mosaic.get("tile").and_then(Value::as_str).unwrap_or("r,gr:gb,b");
    if tile.eq_ignore_ascii_case("monochrome") {
        return Some(Cfa::Mono);
    }
    if !tile.eq_ignore_ascii_case("r,gr:gb,b") {
        return None;
    }
    match mosaic.get("upperLeftPixel")?.as_str()? {
        "r" => Some(Cfa::Rggb),
        "b" => Some(Cfa::Bggr),
        "gr" => Some(Cfa::Grbg),
        "gb" => Some(Cfa::Gbrg),
        _ => None,
    }
}

/// The numbers `r`, `gr`, `gb`, `b` of the object at `path`.
fn four_channels(value: &Value, path: &str) -> Option<[f32; 4]> {
    let node = value_at(value, path)?;
    let n = |key| number_at(node, key).map(|x| x as f32).filter(|x| x.is_finite());
    Some([n("r")?, n("gr")?, n("gb")?, n("b")?])
}

fn matrix_entries(value: &Value) -> Option<[f32; 9]> {
    let items: Vec<f32> = value.as_array()?.iter().filter_map(Value::as_f64).map(|x| x as f32).collect();
    <[f32; 9]>::try_from(items).ok()
}

impl FrameFacts {
    /// Refuses an image that is stored as nothing here reads.
    ///
    /// # Errors
    /// [`Error::Unsupported`], with what the metadata state.
    pub fn check_supported(&self, path: &Path) -> Result<(), Error> {
        match self.unsupported.first() {
            Some(what) => Err(Error::unsupported(path, what.clone())),
            None => Ok(()),
        }
    }

    /// Colour facts, the gaps filled from `fallback`.
    pub fn colour(&self, fallback: &ColourFacts) -> ColourFacts {
        ColourFacts {
            white_balance: self.white_balance.unwrap_or(fallback.white_balance),
            ccm: self.ccm.unwrap_or(fallback.ccm),
            gamma: self.gamma.or(fallback.gamma),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn levels(v: f64) -> Value {
        json!({"r": v, "gr": v, "gb": v, "b": v})
    }

    #[test]
    fn f01_metadata_are_read() {
        let m = json!({
            "image": {"width": 3280, "height": 3280.0,
                "rawDetails": {"pixelFormat": {"black": levels(168.0), "white": levels(4095.0)},
                    "pixelPacking": {"endianness": "big", "bitsPerPixel": 12},
                    "mosaic": {"tile": "r,gr:gb,b", "upperLeftPixel": "b"}},
                "color": {"ccmRgbToSrgbArray": [1,0,0,0,1,0,0,0,1], "gamma": 0.41666, "whiteBalanceGain": {"r": 1, "gr": 1.25, "gb": 1.25, "b": 1.75}},
                "modulationExposureBias": -1.125},
            "devices": {"sensor": {"iso": 200, "pixelPitch": 1.4e-6}, "lens": {"zoomStep": 981, "focusStep": 582},
                "shutter": {"pixelExposureDuration": 0.004},
                "mla": {"lensPitch": 1.4e-5, "rotation": 0.0019, "scaleFactor": {"x": 1, "y": 1.0005}}},
            "camera": {"make": "Lytro, Inc.", "model": "F01"}});
        let (f, warnings) = read_frame(&m, Some(&json!({"camera": {"serialNumber": "A1"}})));
        assert_eq!(warnings, Vec::<String>::new());
        assert_eq!(f.size, Some((3280, 3280)));
        assert_eq!(f.packing, Some(Packing::Be12));
        assert_eq!(f.cfa, Some(Cfa::Bggr));
        assert_eq!(f.white_balance, Some([1.0, 1.25, 1.25, 1.75]));
        assert_eq!(f.camera.serial.as_deref(), Some("A1"));
        assert_eq!((f.camera.zoom_step, f.camera.focus_step), (Some(981), Some(582)));
        assert!((f.mla.unwrap().pitch - 10.0).abs() < 1e-9);
    }

    #[test]
    fn values_out_of_range_are_dropped_with_a_warning() {
        let m = json!({
            "image": {"width": 1e18, "height": 5,
                "pixelFormat": {"black": levels(900.0), "white": levels(100.0)},
                "pixelPacking": {"endianness": "big", "bitsPerPixel": 13},
                "mosaic": {"tile": "x-trans", "upperLeftPixel": "b"},
                "color": {"ccm": [1e30,0,0,0,1,0,0,0,1], "gamma": -3, "whiteBalanceGain": levels(-1.0)}},
            "devices": {"sensor": {"pixelPitch": 1.4e-6}, "mla": {"lensPitch": 1e9}}});
        let (f, warnings) = read_frame(&m, None);
        assert_eq!(f.unsupported.len(), 2, "{:?}", f.unsupported);
        assert!(
            f.unsupported[0].contains("13 bit, big") && f.unsupported[1].contains("x-trans"),
            "{:?}",
            f.unsupported
        );
        let unsupported = f.unsupported.clone();
        assert_eq!(f, FrameFacts { pixel_pitch: Some(1.4e-6), unsupported, ..FrameFacts::default() });
        assert_eq!(warnings.len(), 6, "{warnings:#?}");
    }

    #[test]
    fn white_images_are_named_by_reference() {
        let a = format!("sha1-{}", "A".repeat(40));
        let zero = format!("sha1-{}", "0".repeat(40));
        assert_eq!(white_ref(&json!({"picture": {"derivationArray": [zero]}})), None);
        assert_eq!(white_ref(&json!({"picture": {"derivationArray": [a]}})), Some(a.to_lowercase()));
        let b = format!("sha1-{}", "b".repeat(40));
        let v = json!({"picture": {"derivationArray": [a]}, "frames": [{"frame": {"geometryCorrectionRef": b}}]});
        assert_eq!(white_ref(&v), Some(b));
    }
}
