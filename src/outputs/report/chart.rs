//! Charts as inline SVG without a script. Colours come from the page's CSS (`c0` … `c5`, `axis`, `grid`), so light and
//! dark both work.
//!
//! Charts that are files of their own (spectra, and those of benchmarks) are drawn with the crate plotters. It writes
//! every colour and font into the picture, which a file without a style sheet needs, and which a page with a dark mode
//! cannot use. It has no classes, so it cannot draw these charts.

use crate::colour::{self, ColourScale};
use crate::number::{plain, significant, superscript};
use crate::stats::MapHistogram;
use std::fmt::Write;

/// A named curve.
#[derive(Debug, Clone)]
pub struct ChartSeries {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

/// Axis titles of a chart.
#[derive(Debug, Clone, Copy)]
pub struct AxisTitles<'a> {
    pub x: &'a str,
    pub y: &'a str,
    /// The description for readers who cannot see the picture.
    pub about: &'a str,
}

const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 40.0;

/// Escapes text for HTML and SVG.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\'', "&#39;")
}

/// A scale with its ends, middle and unit, as HTML: `ramp` is a class of the page's style (see [`ramps`]).
pub(crate) fn colour_bar(ramp: &str, (min, max): (f64, f64), unit: &str) -> String {
    let middle = 0.5 * (min + max);
    // A middle that is zero except for rounding is written as 0.
    let middle = if middle.abs() < 1e-9 * (max - min) { 0.0 } else { middle };
    let [low, middle, high] = [min, middle, max].map(|v| significant(v, 3));
    let unit = if unit.is_empty() { String::new() } else { format!(" {}", escape(unit)) };
    format!(
        "<div class=\"bar\"><i class=\"{ramp}\"></i>\
         <span>{low}</span><span>{middle}</span><span>{high}{unit}</span></div>"
    )
}

/// The style of the colour bars: one gradient a scale.
pub(crate) fn ramps() -> String {
    let gradient =
        |scale: &ColourScale| (0..=32).map(|k| colour::hex(scale, f64::from(k) / 32.0)).collect::<Vec<_>>().join(",");
    let scales = [
        ("ramp", gradient(colour::sequential())),
        ("ramp-signed", gradient(colour::diverging())),
        ("ramp-flip", colour::MAGMA.join(",")),
        ("ramp-grey", "#000,#808080,#fff".to_string()),
    ];
    scales.map(|(name, colours)| format!(".{name}{{background:linear-gradient(to right,{colours})}}")).concat()
}

/// Histograms over one axis: the first filled, the others outlined; `marks` are vertical lines with names; `normal`
/// draws the unit normal density.
pub fn histogram(parts: &[(&str, &MapHistogram)], titles: AxisTitles, marks: &[(f64, &str)], normal: bool) -> String {
    let Some((_, first)) = parts.first() else { return String::new() };
    let densities: Vec<Vec<f64>> = parts.iter().map(|(_, h)| h.density()).collect();
    let mut peak = densities.iter().flatten().copied().fold(0.0, f64::max);
    if normal {
        peak = peak.max(0.4);
    }
    let plot = Plot::new(360.0, 210.0, Axis::linear(first.min, first.max), Axis::linear(0.0, peak.max(1e-300) * 1.06));
    let mut out = plot.open(titles.about);
    plot.axes(&mut out, titles, false);
    for (k, ((_, h), density)) in parts.iter().zip(&densities).enumerate() {
        let step = (h.max - h.min) / density.len() as f64;
        let mut path = format!("M{:.1} {:.1}", plot.x(h.min), plot.y(0.0));
        for (b, d) in density.iter().enumerate() {
            let x0 = h.min + step * b as f64;
            let _ = write!(path, "V{:.1}H{:.1}", plot.y(*d), plot.x(x0 + step));
        }
        let _ = write!(path, "V{:.1}", plot.y(0.0));
        let style = if k == 0 { "fill" } else { "line" };
        let _ = write!(out, "<path class=\"{style} c{k}\" d=\"{path}\"/>");
    }
    if normal {
        let path: Vec<String> = (0..=120)
            .map(|k| {
                let x = first.min + (first.max - first.min) * f64::from(k) / 120.0;
                let y = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
                format!("{:.1} {:.1}", plot.x(x), plot.y(y))
            })
            .collect();
        let _ = write!(out, "<path class=\"line c1\" d=\"M{}\"/>", path.join("L"));
    }
    for (x, name) in marks.iter().filter(|(x, _)| *x >= first.min && *x <= first.max) {
        let at = plot.x(*x);
        let _ = write!(out, "<path class=\"mark\" d=\"M{at:.1} {TOP}V{:.1}\"/>", plot.y(0.0));
        let _ =
            write!(out, "<text class=\"note\" x=\"{:.1}\" y=\"{:.1}\">{}</text>", at + 3.0, TOP + 9.0, escape(name));
    }
    let names: Vec<&str> = parts.iter().map(|(n, _)| *n).chain(normal.then_some("normal")).collect();
    plot.legend(&mut out, &names, false);
    out.push_str("</svg>");
    out
}

/// Curves on logarithmic axes; points that a logarithm cannot show are left out.
pub(crate) fn log_log(series: &[ChartSeries], titles: AxisTitles) -> Option<String> {
    let usable = |p: &&(f64, f64)| p.0 > 0.0 && p.1 > 0.0 && p.0.is_finite() && p.1.is_finite();
    let shown: Vec<ChartSeries> = series
        .iter()
        .map(|s| ChartSeries { name: s.name.clone(), points: s.points.iter().filter(usable).copied().collect() })
        .filter(|s| !s.points.is_empty())
        .collect();
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let values = || shown.iter().flat_map(|s| s.points.iter().map(pick));
        (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max))
    };
    if shown.is_empty() {
        return None;
    }
    let (x, y) = (range(|p| p.0), range(|p| p.1));
    let plot = Plot::new(560.0, 320.0, Axis::log(x.0, x.1), Axis::log(y.0, y.1));
    let mut out = plot.open(titles.about);
    plot.axes(&mut out, titles, true);
    for (k, s) in shown.iter().enumerate() {
        let k = k % 6;
        let points: Vec<String> = s.points.iter().map(|p| format!("{:.1} {:.1}", plot.x(p.0), plot.y(p.1))).collect();
        let _ = write!(out, "<path class=\"line c{k}\" d=\"M{}\"/>", points.join("L"));
        for p in &s.points {
            let name = escape(&s.name);
            let (px, py) = (plot.x(p.0), plot.y(p.1));
            let _ = write!(
                out,
                "<circle class=\"dot c{k}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"3\"><title>{name}: {} at {} \
                 s</title></circle>",
                plain(p.1),
                plain(p.0)
            );
        }
    }
    let names: Vec<&str> = shown.iter().map(|s| s.name.as_str()).collect();
    plot.legend(&mut out, &names, true);
    out.push_str("</svg>");
    Some(out)
}

struct Axis {
    min: f64,
    max: f64,
    log: bool,
}

impl Axis {
    fn linear(min: f64, max: f64) -> Axis {
        Axis { min, max, log: false }
    }
    /// An axis of at least one decade, with margins at both ends.
    fn log(min: f64, max: f64) -> Axis {
        let (mut a, mut b) = (min.log10(), max.log10());
        if b - a < 1.0 {
            (a, b) = (0.5 * (a + b) - 0.5, 0.5 * (a + b) + 0.5);
        }
        let room = 0.05 * (b - a);
        Axis { min: a - room, max: b + room, log: true }
    }
    /// The place of a value along the axis, 0 … 1.
    fn place(&self, v: f64) -> f64 {
        let v = if self.log { v.log10() } else { v };
        (v - self.min) / (self.max - self.min)
    }
    /// Values and labels.
    fn ticks(&self, about: usize) -> Vec<(f64, String)> {
        if self.log {
            let (a, b) = (self.min.ceil() as i32, self.max.floor() as i32);
            let stride = (1 + (b - a).max(0) / about.max(1) as i32).max(1);
            return (a..=b).step_by(stride as usize).map(|e| (10f64.powi(e), power_of_ten(e))).collect();
        }
        let rough = (self.max - self.min) / about.max(1) as f64;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].iter().map(|m| m * decade).find(|s| *s >= rough).unwrap_or(rough);
        let mut out = Vec::new();
        let mut k = (self.min / step).ceil();
        while k * step <= self.max * (1.0 + 1e-12) + 1e-300 && out.len() < 40 {
            let v = k * step;
            // As many decimals as the step has; steps are 1, 2 or 5 times a power of ten.
            let decimals = -step.log10().floor();
            let label = if (0.0..=4.0).contains(&decimals) && self.max.abs().max(self.min.abs()) < 1e6 {
                format!("{v:.*}", decimals as usize).replacen('-', "\u{2212}", 1)
            } else {
                significant(v, ((v.abs().max(step) / step).log10().floor() as usize + 1).clamp(1, 9))
            };
            let zero = v.abs() < 1e-9 * step;
            out.push((v, if zero { "0".into() } else { label }));
            k += 1.0;
        }
        out
    }
}

fn power_of_ten(e: i32) -> String {
    match e {
        -2..=3 => plain_power(e),
        _ => format!("10{}", superscript(&e.to_string())),
    }
}

fn plain_power(e: i32) -> String {
    format!("{:.*}", (-e).max(0) as usize, 10f64.powi(e))
}

struct Plot {
    width: f64,
    height: f64,
    horizontal: Axis,
    vertical: Axis,
}

impl Plot {
    fn new(width: f64, height: f64, horizontal: Axis, vertical: Axis) -> Plot {
        Plot { width, height, horizontal, vertical }
    }
    fn x(&self, v: f64) -> f64 {
        LEFT + self.horizontal.place(v).clamp(0.0, 1.0) * (self.width - LEFT - RIGHT)
    }
    fn y(&self, v: f64) -> f64 {
        self.height - BOTTOM - self.vertical.place(v).clamp(0.0, 1.0) * (self.height - TOP - BOTTOM)
    }
    fn open(&self, about: &str) -> String {
        let about = escape(about);
        format!(
            "<svg class=\"chart\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{about}\"><title>{about}</title>",
            self.width, self.height
        )
    }
    fn axes(&self, out: &mut String, titles: AxisTitles, vertical_ticks: bool) {
        let (floor, left, right) = (self.height - BOTTOM, LEFT, self.width - RIGHT);
        for (v, label) in self.horizontal.ticks(if self.horizontal.log { 8 } else { 5 }) {
            let x = self.x(v);
            let _ = write!(out, "<path class=\"grid\" d=\"M{x:.1} {TOP}V{floor}\"/>");
            let _ = write!(out, "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>", floor + 14.0);
        }
        if vertical_ticks {
            for (v, label) in self.vertical.ticks(6) {
                let y = self.y(v);
                let _ = write!(out, "<path class=\"grid\" d=\"M{left} {y:.1}H{right}\"/>");
                let _ = write!(
                    out,
                    "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                    left - 6.0,
                    y + 3.5
                );
            }
        }
        let _ = write!(out, "<path class=\"axis\" d=\"M{left} {TOP}V{floor}H{right}\"/>");
        let _ = write!(
            out,
            "<text class=\"title\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            0.5 * (left + right),
            self.height - 6.0,
            escape(titles.x)
        );
        let (tx, ty) = (if vertical_ticks { 12.0 } else { 44.0 }, 0.5 * (TOP + floor));
        let _ = write!(
            out,
            "<text class=\"title\" transform=\"translate({tx} {ty:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            escape(titles.y)
        );
    }
    /// Names with their colours: at the upper right, or at the lower left (where falling curves leave room). A single
    /// curve without a name gets none.
    fn legend(&self, out: &mut String, names: &[&str], falling: bool) {
        if names.len() < 2 && names.iter().all(|n| n.is_empty()) {
            return;
        }
        for (k, name) in names.iter().enumerate() {
            let (class, name) = (k % 6, escape(name));
            let _ = if falling {
                let (x, y) = (LEFT + 8.0, self.height - BOTTOM - 8.0 - 14.0 * (names.len() - 1 - k) as f64);
                write!(out, "<text class=\"key c{class}\" x=\"{x}\" y=\"{y}\">● {name}</text>")
            } else {
                let (x, y) = (self.width - RIGHT - 4.0, TOP + 10.0 + 14.0 * k as f64);
                write!(out, "<text class=\"key c{class}\" x=\"{x}\" y=\"{y}\" text-anchor=\"end\">{name} ●</text>")
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_leave_its_element() {
        let s = [ChartSeries { name: "</text><script>".into(), points: vec![(1.0, 1.0), (2.0, 0.5)] }];
        let svg = log_log(&s, AxisTitles { x: "<x>", y: "&", about: "\"quoted\"" }).unwrap();
        assert!(!svg.contains("<script>") && !svg.contains("<x>") && svg.contains("&lt;/text&gt;"));
    }

    #[test]
    fn a_straight_line_on_log_axes_stays_straight() {
        let points: Vec<(f64, f64)> = (0..5).map(|k| (10f64.powi(k), 10f64.powi(-2 * k))).collect();
        let (ax, ay) = (Axis::log(1.0, 1e4), Axis::log(1e-8, 1.0));
        let placed: Vec<(f64, f64)> = points.iter().map(|p| (ax.place(p.0), ay.place(p.1))).collect();
        for w in placed.windows(3) {
            let slope = |a: (f64, f64), b: (f64, f64)| (b.1 - a.1) / (b.0 - a.0);
            assert!((slope(w[0], w[1]) - slope(w[1], w[2])).abs() < 1e-9);
        }
    }

    #[test]
    fn nothing_to_plot_is_nothing() {
        let zero = [ChartSeries { name: "a".into(), points: vec![(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0)] }];
        assert!(log_log(&zero, AxisTitles { x: "", y: "", about: "" }).is_none());
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let labels: Vec<String> = Axis::linear(0.013, 0.094).ticks(5).into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["0.02", "0.04", "0.06", "0.08"]);
        let labels: Vec<String> = Axis::linear(0.0, 2.2).ticks(5).into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["0", "0.5", "1.0", "1.5", "2.0"]);
        assert_eq!(Axis::linear(0.0, 90.0).ticks(5).last().map(|t| t.1.clone()), Some("80".into()));
        assert_eq!(Axis::linear(-4.0, 4.0).ticks(5).first().map(|t| t.1.clone()), Some("−4".into()));
    }
}
