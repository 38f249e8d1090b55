//! Captures into containers: the F01's layout (contents first) or, for captures with a white image, the Illum's.

use std::io::Write;
use std::path::Path;

use serde_json::{Value, json};

use super::capture::Capture;
use super::cfa::Cfa;
use super::error::Error;
use super::packing::{Packing, pack};
use super::references;
use super::segments::{HEADER, MAGIC, sha1_of};
use crate::output::Pending;

/// Pixel pitch, metres: lenslet pitches are written in metres, as pixels times this; reading divides by it again.
/// Source: the F01's and the Illum's.
const PIXEL_PITCH: f64 = 1.4e-6;

/// Writes a capture as a container. Pixels are packed as the white level allows: 10 bit (up to 1023), 12 bit (up to
/// 4095), else 16 bit. Reading it again gives the same capture, but for `source_sha256` and `warnings`.
///
/// # Errors
/// When a pixel is above what the white level's packing holds, the sizes disagree, or the file cannot be put in place.
pub fn write_lfp(path: &Path, capture: &Capture, force: bool) -> Result<(), Error> {
    let segments = segments_of(capture)?;
    let pending = Pending::file(path, force)?;
    let write = || -> std::io::Result<()> {
        let mut out = pending.handle().map_err(std::io::Error::other)?;
        out.write_all(&MAGIC)?;
        out.write_all(&[0, 0, 0, 1, 0, 0, 0, 0])?;
        for (letter, payload) in &segments {
            let length =
                u32::try_from(payload.len()).map_err(|_| std::io::Error::other("a segment is longer than 4 GiB"))?;
            let mut header = Vec::with_capacity(HEADER as usize);
            header.extend([MAGIC[0], b'L', b'F', *letter, b'\r', b'\n', 0x1a, b'\n', 0, 0, 0, 0]);
            header.extend(length.to_be_bytes());
            header.extend(sha1_of(payload).bytes());
            header.resize(HEADER as usize, 0);
            out.write_all(&header)?;
            out.write_all(payload)?;
            let padding = payload.len().next_multiple_of(16) - payload.len();
            out.write_all(&[0; 16][..padding])?;
        }
        out.sync_all()
    };
    write().map_err(|source| Error::Io { path: path.to_path_buf(), source })?;
    Ok(pending.commit()?)
}

/// Letter and payload of each segment, in file order.
fn segments_of(capture: &Capture) -> Result<Vec<(u8, Vec<u8>)>, Error> {
    let image = pack_image(capture)?;
    let metadata = json_text(&frame_document(capture, image.0));
    let private = json_text(&private_document(capture));
    let reference = |bytes: &[u8]| Value::from(sha1_of(bytes));
    let ancestors = match &capture.camera.white_ref {
        Some(r) if references::is_sha1(r) => json!([r]),
        _ => json!([]),
    };
    let mut frame = json!({
        "metadataRef": reference(&metadata),
        "privateMetadataRef": reference(&private),
        "imageRef": reference(&image.1),
    });
    // Only white images have the sensor's response to white.
    let is_white = capture.camera.normalized_response.is_some();
    let Some(white) = &capture.white else {
        let contents = json!({
            "picture": {
                "frameArray": [{
                    "frame": frame,
                    "parameters": {"vendorContent": {"com.lytro.tags": {"darkFrame": false, "modulationFrame": is_white}}},
                }],
                "viewArray": [],
                "accelerationArray": [],
                "derivationArray": ancestors,
            },
            "thumbnailArray": [],
            "version": {"major": 1, "minor": 0, "provisionalDate": "2011-08-03"},
        });
        return Ok(vec![(b'M', json_text(&contents)), (b'C', metadata), (b'C', image.1), (b'C', private)]);
    };
    let white_image = pack_image(white)?;
    let white_metadata = json_text(&json!({"master": {"picture": {"frameArray": [{
        "frame": {"metadata": frame_document(white, white_image.0), "privateMetadata": private_document(white)},
        "parameters": {"vendorContent": {"com.lytro.tags": {"darkFrame": false, "modulationFrame": true}}},
    }]}}}));
    frame["modulationDataRef"] = reference(&white_image.1);
    frame["modulationDataMetadataRef"] = reference(&white_metadata);
    let contents = json!({"frames": [{"frame": frame}], "derivations": ancestors, "views": [], "thumbnails": []});
    Ok(vec![
        (b'C', metadata),
        (b'C', private),
        (b'C', image.1),
        (b'C', white_metadata),
        (b'C', white_image.1),
        (b'M', json_text(&contents)),
    ])
}

fn json_text(value: &Value) -> Vec<u8> {
    // Writing a `Value` to memory cannot fail.
    serde_json::to_vec_pretty(value).unwrap_or_default()
}

/// What a container says of a capture's frame, as JSON: size, levels, filters, colours, camera. A file of that text beside
/// a picture or raw file of the same name (`NAME.json`) is read with it.
pub fn frame_metadata(capture: &Capture) -> Vec<u8> {
    json_text(&frame_document(capture, packing_for(capture)))
}

/// As the white level allows.
fn packing_for(capture: &Capture) -> Packing {
    let white = capture.levels.white.iter().copied().fold(0.0, f32::max);
    if white <= 1023.0 {
        Packing::Le10
    } else if white <= 4095.0 {
        Packing::Be12
    } else {
        Packing::Le16
    }
}

fn pack_image(capture: &Capture) -> Result<(Packing, Vec<u8>), Error> {
    let (m, packing) = (&capture.mosaic, packing_for(capture));
    if m.data.len() != m.width * m.height {
        return Err(Error::Parameter(format!("{} pixels are not {}x{}", m.data.len(), m.width, m.height)));
    }
    let bytes = pack(packing, &m.data).ok_or_else(|| {
        Error::Parameter(format!("a pixel is above {}, the most that {} bit hold", packing.max(), packing.bits()))
    })?;
    Ok((packing, bytes))
}

fn four_channels(v: [f32; 4]) -> Value {
    json!({"r": v[0], "gr": v[1], "gb": v[2], "b": v[3]})
}

fn private_document(capture: &Capture) -> Value {
    match &capture.camera.serial {
        Some(serial) => json!({"camera": {"serialNumber": serial}}),
        None => json!({"camera": {}}),
    }
}

fn frame_document(capture: &Capture, packing: Packing) -> Value {
    let (camera, colour) = (&capture.camera, &capture.colour);
    let mosaic = match capture.cfa {
        Cfa::Mono => json!({"tile": "monochrome", "upperLeftPixel": "gr"}),
        cfa => json!({"tile": "r,gr:gb,b", "upperLeftPixel": match cfa {
            Cfa::Rggb => "r",
            Cfa::Grbg => "gr",
            Cfa::Gbrg => "gb",
            _ => "b",
        }}),
    };
    let mut value = json!({
        "type": "lightField",
        "image": {
            "width": capture.mosaic.width,
            "height": capture.mosaic.height,
            "orientation": 1,
            "representation": "rawPacked",
            "rawDetails": {
                "pixelFormat": {"rightShift": 0, "black": four_channels(capture.levels.black), "white": four_channels(capture.levels.white)},
                "pixelPacking": {"endianness": packing.endianness(), "bitsPerPixel": packing.bits()},
                "mosaic": mosaic.clone(),
            },
            "color": {"ccmRgbToSrgbArray": colour.ccm, "applied": {}, "whiteBalanceGain": four_channels(colour.white_balance)},
        },
        "devices": {"sensor": {"bitsPerPixel": packing.bits(), "mosaic": mosaic, "pixelPitch": PIXEL_PITCH}, "lens": {}, "shutter": {}},
        "camera": {},
    });
    let mut set = |pointer: &str, key: &str, v: Option<Value>| {
        if let (Some(v), Some(node)) = (v, value.pointer_mut(pointer)) {
            node[key] = v;
        }
    };
    set("/image/color", "gamma", colour.gamma.map(Value::from));
    set("/image", "modulationExposureBias", camera.exposure_bias.map(Value::from));
    set("/devices/sensor", "iso", camera.iso.map(Value::from));
    set(
        "/devices/sensor",
        "normalizedResponses",
        camera.normalized_response.map(|r| {
            let mut response = four_channels(r);
            response["cct"] = json!(5100);
            json!([response])
        }),
    );
    set("/devices/lens", "zoomStep", camera.zoom_step.map(Value::from));
    set("/devices/lens", "focusStep", camera.focus_step.map(Value::from));
    set("/devices/shutter", "pixelExposureDuration", camera.exposure_seconds.map(Value::from));
    set(
        "/devices",
        "mla",
        capture.mla.as_ref().map(|m| {
            json!({
                "tiling": "hexUniformRowMajor",
                "lensPitch": m.pitch * PIXEL_PITCH,
                "rotation": m.rotation,
                "scaleFactor": {"x": 1, "y": m.row_stretch},
                "defectArray": [],
            })
        }),
    );
    set("/camera", "make", camera.make.clone().map(Value::from));
    set("/camera", "model", camera.model.clone().map(Value::from));
    value
}
