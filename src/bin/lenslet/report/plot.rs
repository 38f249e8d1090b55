//! Plots as SVG: curves over an axis, and bars. Colours come from the page's style.

use std::fmt::Write as _;

use lenslet::page::escape_html;

/// One curve.
#[derive(Debug, Clone)]
pub struct Series {
    /// Shown in the legend.
    pub name: String,
    /// Points (x, y) in order; those that are not finite numbers are left out.
    pub points: Vec<[f64; 2]>,
}

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 52.0;

/// Round steps that divide low..high into about five parts.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let rough = (high - low).max(1e-12) / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|s| *s >= rough).unwrap_or(rough);
    let first = (low / step).ceil() as i64;
    (first..first + 12).map(|k| k as f64 * step).take_while(|t| *t <= high + 1e-9 * step).collect()
}

/// A number with as many decimals as its axis needs.
fn label(value: f64, span: f64) -> String {
    let decimals = (2.0 - span.max(1e-12).log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Curves with points over named axes.
pub fn line_plot(x_name: &str, y_name: &str, series: &[Series]) -> String {
    let points = || series.iter().flat_map(|s| &s.points).filter(|p| p[0].is_finite() && p[1].is_finite());
    let range = |axis: usize| {
        let (low, high) = points().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
        if low > high {
            return (0.0, 1.0);
        }
        let rim = if high > low { 0.05 * (high - low) } else { low.abs().max(1.0) * 0.1 };
        (low - rim, high + rim)
    };
    let ((x0, x1), (y0, y1)) = (range(0), range(1));
    let px = |x: f64| LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT);
    let py = |y: f64| HEIGHT - BOTTOM - (y - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM);
    let rows = series.iter().filter(|s| s.points.len() != 1).count().div_ceil(3) as f64;
    let full = HEIGHT + 22.0 * rows;
    let mut svg = open(full, &format!("{y_name} over {x_name}"));
    for t in ticks(y0, y1) {
        let y = py(t);
        let _ = write!(
            svg,
            "<path class=\"grid-line\" d=\"M{LEFT} {y:.1}H{:.1}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            WIDTH - RIGHT,
            LEFT - 8.0,
            y + 4.0,
            label(t, y1 - y0)
        );
    }
    for t in ticks(x0, x1) {
        let x = px(t);
        let _ = write!(
            svg,
            "<path class=\"axis\" d=\"M{x:.1} {:.1}v5\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            HEIGHT - BOTTOM,
            HEIGHT - BOTTOM + 19.0,
            label(t, x1 - x0)
        );
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT} {TOP}V{0:.1}H{1:.1}\"/><text x=\"{2:.1}\" y=\"{3:.1}\" text-anchor=\"middle\">{4}</text><text transform=\"translate(14 {5:.1}) rotate(-90)\" text-anchor=\"middle\">{6}</text>",
        HEIGHT - BOTTOM,
        WIDTH - RIGHT,
        (LEFT + WIDTH - RIGHT) / 2.0,
        HEIGHT - 12.0,
        escape_html(x_name),
        (TOP + HEIGHT - BOTTOM) / 2.0,
        escape_html(y_name)
    );
    for (k, s) in series.iter().enumerate() {
        let _ = write!(svg, "<g class=\"s{}\">", k % 6);
        let seen: Vec<_> = s.points.iter().filter(|p| p[0].is_finite() && p[1].is_finite()).collect();
        let mut path = String::new();
        for (n, p) in seen.iter().enumerate() {
            let _ = write!(path, "{}{:.1} {:.1}", if n == 0 { 'M' } else { 'L' }, px(p[0]), py(p[1]));
            let _ = write!(svg, "<circle class=\"dot\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\"/>", px(p[0]), py(p[1]));
        }
        let _ = write!(svg, "<path class=\"curve\" d=\"{path}\"/>");
        // A single point has its name beside it: colours repeat after six.
        if let [p] = seen[..] {
            let (x, anchor) = if px(p[0]) > 0.6 * WIDTH { (px(p[0]) - 8.0, "end") } else { (px(p[0]) + 8.0, "start") };
            let _ = write!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
                py(p[1]) - 4.0,
                escape_html(&s.name)
            );
            svg.push_str("</g>");
            continue;
        }
        let (x, y) = (LEFT + (k % 3) as f64 * 190.0, HEIGHT + 22.0 * (k / 3) as f64);
        let _ = write!(
            svg,
            "<path class=\"curve\" d=\"M{x:.1} {y:.1}h20\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text></g>",
            x + 26.0,
            y + 4.0,
            escape_html(&s.name)
        );
    }
    svg + "</svg>"
}

/// A bar: its name, its value, and the group whose colour it has.
pub struct Bar {
    pub name: String,
    pub value: f64,
    pub group: usize,
}

/// Horizontal bars from `base` on, each with its name and value.
pub fn bar_chart(unit: &str, base: f64, bars: &[Bar]) -> String {
    let high = bars.iter().map(|b| b.value).filter(|v| v.is_finite()).fold(base, f64::max);
    let full = 30.0 * bars.len() as f64 + 12.0;
    let mut svg = open(full, unit);
    let start = 230.0;
    for (k, Bar { name, value, group }) in bars.iter().enumerate() {
        let y = 8.0 + 30.0 * k as f64;
        let share =
            if high > base && value.is_finite() { ((value - base) / (high - base)).clamp(0.0, 1.0) } else { 0.0 };
        let width = share * (WIDTH - start - 110.0);
        let _ = write!(
            svg,
            "<g class=\"s{}\"><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text><rect class=\"bar\" x=\"{start:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"20\" rx=\"2\"/><text x=\"{:.1}\" y=\"{:.1}\">{value:.2} {}</text></g>",
            group % 6,
            start - 10.0,
            y + 15.0,
            escape_html(name),
            start + width + 8.0,
            y + 15.0,
            escape_html(unit)
        );
    }
    svg + "</svg>"
}

fn open(height: f64, name: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" aria-label=\"{}\">",
        escape_html(name)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_cover_the_range() {
        assert_eq!(ticks(0.0, 10.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        for (low, high) in [(24.9, 31.2), (-0.003, 0.002), (1e6, 3e6)] {
            let ticks = ticks(low, high);
            assert!((3..=12).contains(&ticks.len()) && ticks.iter().all(|t| (low..=high).contains(t)), "{ticks:?}");
        }
    }

    #[test]
    fn points_land_where_their_values_say_and_names_are_escaped() {
        let series = [Series { name: "<a>".into(), points: vec![[0.0, 1.0], [f64::NAN, 2.0], [10.0, 3.0]] }];
        let svg = line_plot("x", "y & z", &series);
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("&lt;a&gt;") && svg.contains("y &amp; z"));
        assert!(!svg.contains("NaN"));
        let empty = line_plot("x", "y", &[]);
        assert!(!empty.contains("NaN") && !empty.contains("inf"));
    }

    #[test]
    fn bars_are_as_long_as_their_values() {
        let bar = |name: &str, value, group| Bar { name: name.into(), value, group };
        let svg = bar_chart("dB", 20.0, &[bar("a", 25.0, 0), bar("b", 30.0, 1), bar("c", f64::NAN, 1)]);
        let widths: Vec<f64> =
            svg.split("width=\"").skip(1).filter_map(|w| w.split('"').next().and_then(|w| w.parse().ok())).collect();
        assert!((widths[1] / widths[0] - 2.0).abs() < 0.01, "{widths:?}");
        assert_eq!(widths[2], 0.0);
        assert_eq!([svg.matches("class=\"s0\"").count(), svg.matches("class=\"s1\"").count()], [1, 2]);
    }
}
