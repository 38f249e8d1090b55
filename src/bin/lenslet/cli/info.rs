//! `lenslet info`: what a file or folder is, by its content.

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::calibration;
use lenslet_core::container::segments::{Container, MAGIC, Segment, SegmentKind};
use lenslet_core::container::{
    self, CameraFacts, Capture, ColourFacts, Error, Levels, MlaHint, json as find, locate_frame, metadata, references,
    whites,
};
use lenslet_core::decode::{HexSamples, SamplesOrigin};
use lenslet_core::dictionary;
use lenslet_core::input::open_regular;
use lenslet_core::lightfield::{self, Numbering, ReadOptions, ReadOrder, ViewSource};
use lenslet_core::progress::Observer;
use serde_json::{Map, Value, json};

use super::inputs::explain_folder;
use super::source::ReadArgs;
use super::{Context, Outcome};

/// Describe a capture, container, calibration, light field, file of samples, dictionary or camera profile
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: lenslet info IMG_0001.lfp")]
pub struct Args {
    /// A file, or the folder of a light field or of calibration images
    file: PathBuf,
    /// Camera profile (a name or the path of a .toml file), where the file does not name its camera
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    #[command(flatten)]
    read: ReadArgs,
}

/// Values of an array up to which it is read to find the order of its views; of folders a few pictures suffice.
/// Source: chosen; 128 MiB.
const LOOKED_AT: usize = 1 << 25;

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    let json = describe(args)?;
    if let Some(warnings) = json.get("warnings").and_then(Value::as_array) {
        for w in warnings.iter().filter_map(Value::as_str) {
            context.progress.note(&clean(w));
        }
    }
    let text = render(&json);
    Ok(Outcome { json, text })
}

fn describe(args: &Args) -> anyhow::Result<Value> {
    let path = &args.file;
    let unreadable = || format!("cannot read {}", path.display());
    let meta = std::fs::metadata(path).with_context(unreadable)?;
    if meta.is_dir() {
        return folder(path, args);
    }
    let mut head = [0u8; 512];
    let mut n = 0;
    {
        let (mut file, _) = open_regular(path).with_context(unreadable)?;
        while n < head.len() {
            match file.read(&mut head[n..]).with_context(unreadable)? {
                0 => break,
                k => n += k,
            }
        }
    }
    let head = &head[..n];
    let mut json = if head.starts_with(&MAGIC) {
        segments(path)?
    } else if head.starts_with(b"LENSCAL\0") {
        calibration_facts(path)?
    } else if dictionary::Format::detect(head).is_some() {
        super::dict::describe(&dictionary::load(path)?).0
    } else if head.starts_with(b"\x93NUMPY") || head.starts_with(b"MATLAB") || args.read.has_views() {
        light_field(path, args)?
    } else if head.starts_with(b"PK\x03\x04") && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz")) {
        samples_facts(path)?
    } else if let Some(found) = described_picture(head, path, args) {
        found
    } else if head.len() == 512 && &head[257..262] == b"ustar" {
        calibration_images("archive of calibration files", path)?
    } else if find::looks_like_object(head) {
        metadata_facts(path)?
    } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        let profile = container::CameraProfile::find(&path.to_string_lossy())?;
        json!({"kind": "camera profile", "profile": profile})
    } else {
        match container::open_capture(path, args.profile.as_deref()) {
            Ok(capture) => mosaic(&capture),
            // A colour picture is a light field of one view.
            Err(Error::Unsupported { .. }) if light_field(path, args).is_ok() => light_field(path, args)?,
            Err(e) => return Err(e.into()),
        }
    };
    json["bytes"] = meta.len().into();
    Ok(json)
}

/// Samples that a light field was made from.
fn samples_facts(path: &Path) -> anyhow::Result<Value> {
    let samples = HexSamples::load(path)?;
    let origin = SamplesOrigin::read(path)?.unwrap_or_default();
    Ok(json!({
        "kind": "measured samples",
        "views": [samples.views, samples.views],
        "lenslets": samples.centres.len(),
        "channels": samples.values.shape()[2],
        "sensor": [samples.sensor.width, samples.sensor.height],
        "view_step": samples.view_step,
        "capture_sha256": (!origin.capture_sha256.is_empty()).then_some(origin.capture_sha256),
    }))
}

/// A lenslet picture that says so itself.
fn described_picture(head: &[u8], path: &Path, args: &Args) -> Option<Value> {
    let found = head.starts_with(b"\x89PNG").then(|| light_field(path, args).ok()).flatten()?;
    (found["kind"] == "light field").then_some(found)
}

fn segments(path: &Path) -> anyhow::Result<Value> {
    let container = Container::open(path)?;
    let contents = container.contents()?;
    if contents.iter().any(|c| c.get("files").is_some_and(Value::is_array)) {
        return calibration_images("calibration bundle", path);
    }
    let named: Vec<_> = contents.iter().flat_map(references::collect_references).collect();
    let by_sha1 = references::by_sha1(&named);
    let mut warnings = container.warnings.clone();
    let mut list = Vec::new();
    for s in &container.segments {
        let (bytes, damaged) = container.checked(s)?;
        let intact = damaged.is_none();
        warnings.extend(damaged);
        list.push(json!({
            "kind": s.kind.name(),
            "offset": s.offset,
            "length": s.length,
            "sha1": s.sha1,
            "sha1_ok": intact,
            "used_as": used_as(s, by_sha1.get(s.sha1.as_str()).map(|r| r.path.as_str())),
            "content": content(&bytes),
        }));
    }
    let mut json = json!({"kind": "container", "segments": list});
    match locate_frame(&container) {
        Ok(found) => {
            warnings.extend(found.warnings.iter().filter(|w| !warnings.contains(w)).cloned().collect::<Vec<_>>());
            json["image_present"] = found.image.is_some().into();
            let missing: Vec<_> = found.missing.iter().map(|m| json!({"name": m.path, "sha1": m.sha1})).collect();
            json["missing"] = missing.into();
            warnings.extend(found.facts.unsupported.iter().cloned());
            frame(&mut json, &found.facts);
        }
        Err(e) => warnings.push(e.to_string()),
    }
    json["warnings"] = warnings.into();
    Ok(json)
}

fn used_as(segment: &Segment, reference: Option<&str>) -> Option<String> {
    match segment.kind {
        SegmentKind::Contents => Some("table of contents".into()),
        _ => reference.map(str::to_string),
    }
}

fn content(bytes: &[u8]) -> &'static str {
    if bytes.starts_with(&[0xff, 0xd8, 0xff]) {
        "JPEG"
    } else if bytes.starts_with(b"\x89PNG") {
        "PNG"
    } else if bytes.starts_with(&[0, 0, 0, 1]) {
        "H.264"
    } else if find::looks_like_object(bytes) {
        "JSON"
    } else {
        "data"
    }
}

fn frame(json: &mut Value, facts: &metadata::FrameFacts) {
    if let Some((width, height)) = facts.size {
        json["image"] = json!({
            "width": width,
            "height": height,
            "bits": facts.packing.map(|p| p.bits()),
            "endianness": facts.packing.map(|p| p.endianness()),
            "cfa": facts.cfa,
        });
    }
    let colour = facts.white_balance.is_some() || facts.ccm.is_some();
    let colour = colour.then(|| json!({"white_balance": facts.white_balance, "ccm": facts.ccm, "gamma": facts.gamma}));
    development(json, facts.levels.as_ref(), colour, facts.mla.as_ref(), &facts.camera);
}

fn development(
    json: &mut Value,
    levels: Option<&Levels>,
    colour: Option<Value>,
    mla: Option<&MlaHint>,
    camera: &CameraFacts,
) {
    if let Some(l) = levels {
        json["levels"] = json!(l);
    }
    if let Some(c) = colour {
        json["colour"] = c;
    }
    if let Some(m) = mla {
        json["lenslets"] = json!(m);
    }
    if *camera != CameraFacts::default() {
        let known: Map<String, Value> = match json!(camera) {
            Value::Object(m) => m.into_iter().filter(|(_, v)| !v.is_null()).collect(),
            _ => Map::new(),
        };
        json["camera"] = known.into();
    }
}

fn mosaic(capture: &Capture) -> Value {
    let data = &capture.mosaic.data;
    let sum: u64 = data.iter().map(|&v| u64::from(v)).sum();
    let white = capture.levels.white.iter().copied().fold(f32::INFINITY, f32::min);
    let saturated = data.iter().filter(|&&v| f32::from(v) >= white).count();
    let mut json = json!({
        "kind": "raw mosaic",
        "image": {"width": capture.mosaic.width, "height": capture.mosaic.height, "cfa": capture.cfa},
        "values": {
            "min": data.iter().min(),
            "max": data.iter().max(),
            "mean": sum as f64 / data.len().max(1) as f64,
            "saturated": saturated as f64 / data.len().max(1) as f64,
        },
    });
    let ColourFacts { white_balance, ccm, gamma } = &capture.colour;
    let colour = json!({"white_balance": white_balance, "ccm": ccm, "gamma": gamma});
    development(&mut json, Some(&capture.levels), Some(colour), capture.mla.as_ref(), &capture.camera);
    json["sha256"] = capture.source_sha256.as_str().into();
    json["warnings"] = json!(capture.warnings);
    json
}

fn calibration_facts(path: &Path) -> anyhow::Result<Value> {
    let c = calibration::load(path)?;
    let mut json = json!({"kind": "calibration"});
    if let (Value::Object(all), Some(json)) = (super::calibrate::summary(&c), json.as_object_mut()) {
        json.extend(all);
    }
    json["lattice"] = json!(c.lattice);
    json["vignetting"] = c.vignetting.is_some().into();
    Ok(json)
}

fn light_field(path: &Path, args: &Args) -> anyhow::Result<Value> {
    let (source, looked_at) = opened(path, &args.read.options())?;
    let m = source.meta();
    let mut json = json!({"kind": if m.views == [1, 1] { "picture" } else { "light field" }});
    if let (Value::Object(all), Some(json)) = (json!(m), json.as_object_mut()) {
        json.extend(all);
    }
    match source.order() {
        Some(ReadOrder { order, agreement: Some(agreement) }) => {
            json["order"] = json!({"views": order.to_string(), "found_by": "parallax", "agreement": agreement});
        }
        Some(ReadOrder { order, .. }) => {
            json["order"] = json!({"views": order.to_string(), "found_by": "--order"});
        }
        None if looked_at => {
            json["order"] = json!({"views": "rows", "found_by": "numbers alone, parallax does not tell"});
        }
        None => {}
    }
    if !source.notes().is_empty() {
        json["warnings"] = json!(source.notes());
    }
    Ok(json)
}

/// Opens a light field; whether the order of its views was looked for. Of a large array, and of what is damaged beyond
/// its headers, these alone are read.
fn opened(path: &Path, options: &ReadOptions) -> anyhow::Result<(Box<dyn ViewSource>, bool)> {
    let headers = || lightfield::open(path, &ReadOptions { header_only: true, ..options.clone() });
    let found_in =
        |source: &dyn ViewSource| source.meta().views != [1, 1] && source.numbering() != Numbering::Described;
    if path.is_dir() {
        let source = lightfield::open(path, options).or_else(|_| headers())?;
        let looked_at = found_in(&*source);
        return Ok((source, looked_at));
    }
    let source = headers()?;
    let m = source.meta();
    let values = m.view_shape().0 * m.view_shape().1 * m.channels * m.views[0] * m.views[1];
    if !found_in(&*source) || values > LOOKED_AT {
        return Ok((source, false));
    }
    Ok((lightfield::open(path, options).unwrap_or(source), true))
}

fn calibration_images(kind: &str, path: &Path) -> anyhow::Result<Value> {
    let found = whites::list_calibration_images(path)?;
    let files = container::members::list_members(path)?.list.len();
    let images: Vec<_> = found
        .images
        .iter()
        .map(|c| {
            let f = &c.frame.camera;
            json!({
                "name": c.member.name,
                "state": match c.class {
                    whites::ExposureClass::White => "white",
                    whites::ExposureClass::Dark => "too dark",
                    whites::ExposureClass::Saturated => "over-exposed",
                    whites::ExposureClass::Black => "black",
                },
                "mean": c.mean,
                "serial": f.serial,
                "zoom_step": f.zoom_step,
                "focus_step": f.focus_step,
            })
        })
        .collect();
    Ok(json!({"kind": kind, "files": files, "images": images, "warnings": found.warnings}))
}

fn folder(path: &Path, args: &Args) -> anyhow::Result<Value> {
    if path.join("lightfield.json").exists() {
        return light_field(path, args);
    }
    let images = calibration_images("folder of calibration images", path)?;
    if images["images"].as_array().is_some_and(|i| !i.is_empty()) {
        return Ok(images);
    }
    light_field(path, args).with_context(|| {
        format!("{}: neither a light field nor calibration images: {}", path.display(), explain_folder(path))
    })
}

fn metadata_facts(path: &Path) -> anyhow::Result<Value> {
    let mut bytes = Vec::new();
    open_regular(path)?.0.take(find::MAX_TEXT as u64 + 1).read_to_end(&mut bytes)?;
    let value = find::parse(&bytes).map_err(|e| anyhow::anyhow!("{}: {e}", path.display()))?;
    let (facts, warnings) = metadata::read_frame(&value, None);
    let known = facts != metadata::FrameFacts::default();
    anyhow::ensure!(known, "{}: JSON, but not the metadata of a light-field camera", path.display());
    let mut json = json!({"kind": "camera metadata"});
    frame(&mut json, &facts);
    json["warnings"] = warnings.into();
    Ok(json)
}

/// Text from files, safe for a terminal: control characters are escaped.
pub fn clean(text: &str) -> String {
    text.chars().flat_map(|c| if c.is_control() { c.escape_default().collect::<Vec<_>>() } else { vec![c] }).collect()
}

/// The facts as indented lines; segments as a table.
fn render(json: &Value) -> String {
    let mut out = String::new();
    if let Value::Object(map) = json {
        for (key, value) in map.iter().filter(|(k, _)| *k != "warnings") {
            match value.as_array() {
                Some(list) if key == "segments" => segment_table(list, &mut out),
                _ => line(key, value, 0, &mut out),
            }
        }
    }
    out
}

fn segment_table(list: &[Value], out: &mut String) {
    out.push_str(&format!(
        "segments ({})\n      offset      length  kind  content  sha1 (first digits)   used as\n",
        list.len()
    ));
    for s in list {
        let field = |key: &str| s.get(key).map(short).unwrap_or_default();
        let sha1: String = field("sha1").chars().skip("sha1-".len()).take(12).collect();
        let ok = if s["sha1_ok"] == true { "ok" } else { "DAMAGED" };
        let used = if s["used_as"].is_null() { "nothing".into() } else { field("used_as") };
        let (offset, length, kind, content) = (field("offset"), field("length"), field("kind"), field("content"));
        out.push_str(&format!("  {offset:>10}  {length:>10}  {kind:<4}  {content:<7}  {sha1} {ok:<7}  {used}\n"));
    }
}

fn line(key: &str, value: &Value, depth: usize, out: &mut String) {
    let indent = "  ".repeat(depth);
    let key = clean(key).replace('_', " ");
    match value {
        Value::Null => {}
        Value::Object(map) => {
            out.push_str(&format!("{indent}{key}\n"));
            map.iter().for_each(|(k, v)| line(k, v, depth + 1, out));
        }
        Value::Array(items) if items.iter().any(Value::is_object) => {
            out.push_str(&format!("{indent}{key} ({})\n", items.len()));
            for item in items {
                let parts: Vec<String> = match item {
                    Value::Object(map) => map
                        .iter()
                        .filter(|(_, v)| !v.is_null())
                        .map(|(k, v)| format!("{} {}", k.replace('_', " "), short(v)))
                        .collect(),
                    other => vec![short(other)],
                };
                out.push_str(&format!("{indent}  {}\n", parts.join(", ")));
            }
        }
        Value::Array(items) if items.is_empty() => {}
        other => out.push_str(&format!("{indent}{key}: {}\n", short(other))),
    }
}

fn short(value: &Value) -> String {
    match value {
        Value::String(s) => clean(s),
        Value::Number(n) => match n.as_f64() {
            Some(x) if x.fract() != 0.0 => {
                let text = format!("{x:.6}");
                if x.abs() < 0.001 { format!("{x:.4e}") } else { text.trim_end_matches('0').to_string() }
            }
            _ => n.to_string(),
        },
        Value::Array(items) => items.iter().map(short).collect::<Vec<_>>().join(" "),
        other => clean(&other.to_string()),
    }
}
