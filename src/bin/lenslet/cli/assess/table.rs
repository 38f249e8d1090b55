//! An assessment as JSON and as Markdown tables.

use std::fmt::Write as _;

use lenslet_views::assess::{Difference, Median};
use serde_json::{Map, Value, json};

use super::measured::{Assessment, MethodMeasures};

/// The object of one capture: `rays`, `edges`, `lines`, `holes` by method, `raw` by calibration; what was not measured is
/// absent, and null where it could not be.
pub(super) fn to_json(a: &Assessment) -> Value {
    let mut out = Map::new();
    let mut put = |key: &str, value: Value| out.insert(key.to_owned(), value);
    put("capture", json!(a.capture));
    put("calibration", json!(a.calibration));
    put("size", json!([a.size.height, a.size.width]));
    put("reference", json!("barycentric"));
    let by_method = |of: &dyn Fn(&MethodMeasures) -> Option<Value>| -> Option<Value> {
        let all: Map<String, Value> = a.methods.iter().filter_map(|m| Some((m.name.to_owned(), of(m)?))).collect();
        (!all.is_empty()).then_some(Value::Object(all))
    };
    let rays = by_method(&|m| {
        let own = m.rays.as_ref()?;
        let over = own.over(a.reference()?.rays.as_ref()?);
        Some(json!({ "psnr": own.psnr(), "over": over.mean, "error": over.error, "rays": a.counts[0] }))
    });
    let edges = by_method(&|m| {
        let (own, other) = (m.edges.as_ref()?, a.reference()?.edges.as_ref()?);
        let over = own.over(other);
        let mut one = Map::from_iter([("edges".to_owned(), json!(a.counts[1]))]);
        put_median(&mut one, "mtf50", own.median_mtf50(), over.map(|o| o.0));
        put_median(&mut one, "rough", own.median_rough(), over.map(|o| o.1));
        Some(Value::Object(one))
    });
    let lines = by_method(&|m| {
        let (own, other) = (m.lines.as_ref()?, a.reference()?.lines.as_ref()?);
        let (medians, over) = (own.medians(), own.over(other));
        let mut one = Map::from_iter([("lines".to_owned(), json!(a.counts[2]))]);
        for (k, name) in ["rough", "width", "ripple"].into_iter().enumerate() {
            put_median(&mut one, name, medians.map(|m| m[k]), over.map(|o| o[k]));
        }
        Some(Value::Object(one))
    });
    let holes = by_method(&|m| m.holes.map(|h| json!({ "psnr": h.psnr, "lenslets": h.lenslets })));
    for (key, value) in [("rays", rays), ("edges", edges), ("lines", lines), ("holes", holes)] {
        if let Some(value) = value {
            put(key, value);
        }
    }
    if !a.raw.is_empty() {
        let one = |(name, s): &(String, lenslet_views::assess::RawScore)| {
            let value = json!({ "rms": s.rms, "over": s.over.mean, "error": s.over.error, "pixels": s.pixels });
            (name.clone(), value)
        };
        put("raw", Value::Object(a.raw.iter().map(one).collect()));
    }
    Value::Object(out)
}

/// `name`, `name_error`, and the difference from the reference `name_over`, `name_over_error`.
fn put_median(out: &mut Map<String, Value>, name: &str, median: Option<Median>, over: Option<Difference>) {
    out.insert(name.to_owned(), json!(median.map(|m| m.median)));
    out.insert(format!("{name}_error"), json!(median.map(|m| m.error)));
    out.insert(format!("{name}_over"), json!(over.map(|d| d.mean)));
    out.insert(format!("{name}_over_error"), json!(over.map(|d| d.error)));
}

/// The tables of one capture.
pub(super) fn to_markdown(a: &Assessment) -> String {
    let mut out = format!("## {}\n\nCalibration: {}\n", a.capture, a.calibration);
    if !a.methods.is_empty() {
        let [rays, edges, lines] = a.counts;
        let _ = writeln!(
            out,
            "\n| {rays} rays, {edges} edges, {lines} lines | rays dB | over barycentric | MTF50 c/px | edges rough px | \
             lines rough px | width px | ripple | holes dB |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|"
        );
    }
    for m in &a.methods {
        let rays = m.rays.as_ref().map(|r| format!("{:.2}", r.psnr())).unwrap_or_default();
        let over = m.rays.as_ref().zip(a.reference().and_then(|r| r.rays.as_ref())).map(|(own, other)| {
            let over = own.over(other);
            format!("{:+.2} ± {:.2}", over.mean, over.error)
        });
        let median = |m: Option<Median>| m.map(|m| format!("{:.3} ± {:.3}", m.median, m.error)).unwrap_or_default();
        let edges = m.edges.as_ref();
        let lines = m.lines.as_ref().and_then(|l| l.medians());
        let _ = writeln!(
            out,
            "| {} | {rays} | {} | {} | {} | {} | {} | {} | {} |",
            m.name,
            over.unwrap_or_default(),
            median(edges.and_then(|e| e.median_mtf50())),
            median(edges.and_then(|e| e.median_rough())),
            median(lines.map(|l| l[0])),
            median(lines.map(|l| l[1])),
            median(lines.map(|l| l[2])),
            m.holes.map(|h| format!("{:.2}", h.psnr)).unwrap_or_default(),
        );
    }
    if let Some((first, score)) = a.raw.first() {
        let _ =
            writeln!(out, "\n| {} raw pixels | RMS, digital numbers | dB over {first} |\n|---|--:|--:|", score.pixels);
        for (name, s) in &a.raw {
            let _ = writeln!(out, "| {name} | {:.3} | {:+.2} ± {:.2} |", s.rms, s.over.mean, s.over.error);
        }
    }
    out
}
