//! Pictures of spectra: quantities over wavelength, or over another quantity, one picture for each leaf.

use super::COLORS;
use crate::{Error, Result};
use mesophyll_files::atomic;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// One quantity over another.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectrumLine {
    /// Name of the quantity.
    pub name: String,
    /// Wavelength (nm) or the other quantity of the panel, value, and standard error (NaN where none is known). The
    /// points of a line are in order of rising wavelength.
    pub points: Vec<[f64; 3]>,
    /// Dots instead of a line.
    pub dots: bool,
}

/// Quantities over one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectrumPanel {
    /// Title of the panel.
    pub title: String,
    /// The horizontal axis with its unit, mostly [`WAVELENGTH`].
    pub across: String,
    /// The vertical axis with its unit.
    pub axis: String,
    /// Whether the axis is logarithmic; values of 0 and less are then left out.
    pub logarithmic: bool,
    /// What is drawn.
    pub lines: Vec<SpectrumLine>,
}

/// The axis of spectra.
pub const WAVELENGTH: &str = "wavelength (nm)";

const SIZE: (u32, u32) = (980, 380);

/// Draws one picture for each leaf into `folder`, with its panels side by side, and returns the files. A file has the
/// leaf's name, with `_` for characters that file names do not allow.
///
/// # Errors
/// [`Error::Write`] where a file cannot be written.
pub fn pictures(folder: &Path, leaves: &[(String, Vec<SpectrumPanel>)]) -> Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).map_err(|e| Error::write(folder, e))?;
    let mut taken = HashSet::new();
    let mut files = Vec::new();
    for (leaf, panels) in leaves {
        let plain = |c: char| if c.is_alphanumeric() || c == '-' || c == '.' { c } else { '_' };
        let word: String = leaf.trim_start_matches('.').chars().map(plain).collect();
        let word = if word.is_empty() { "leaf".to_string() } else { word };
        let mut name = word.clone();
        let mut k = 2;
        while !taken.insert(name.clone()) {
            name = format!("{word}-{k}");
            k += 1;
        }
        let path = folder.join(format!("{name}.svg"));
        let svg = picture(panels).map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, svg.as_bytes())?;
        files.push(path);
    }
    Ok(files)
}

fn picture(panels: &[SpectrumPanel]) -> std::result::Result<String, String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(text)?;
        for (area, panel) in area.split_evenly((1, panels.len().max(1))).iter().zip(panels) {
            draw(area, panel)?;
        }
        area.present().map_err(text)?;
    }
    Ok(svg)
}

fn text(e: impl std::fmt::Display) -> String {
    format!("cannot draw: {e}")
}

fn draw(area: &DrawingArea<SVGBackend, Shift>, panel: &SpectrumPanel) -> std::result::Result<(), String> {
    let shown = |p: &&[f64; 3]| p[1].is_finite() && (!panel.logarithmic || p[1] > 0.0);
    let points = || panel.lines.iter().flat_map(|l| l.points.iter().filter(shown));
    let fold = |k: usize, from: f64, f: fn(f64, f64) -> f64| points().map(|p| p[k]).fold(from, f);
    let (left, right) = (fold(0, f64::INFINITY, f64::min), fold(0, f64::NEG_INFINITY, f64::max));
    let (low, high) = (fold(1, f64::INFINITY, f64::min), fold(1, f64::NEG_INFINITY, f64::max));
    if !(left <= right) {
        return Ok(());
    }
    let across = if left < right { left..right } else { left - 1.0..right + 1.0 };
    if panel.logarithmic {
        on(area, panel, across, (0.8 * low..1.4 * high).log_scale(), |p| shown(&p))
    } else {
        let room = 0.06 * (high - low.min(0.0)).max(1e-6);
        on(area, panel, across, low.min(0.0)..high + room, |p| shown(&p))
    }
}

fn on<Y>(
    area: &DrawingArea<SVGBackend, Shift>,
    panel: &SpectrumPanel,
    across: std::ops::Range<f64>,
    up: Y,
    shown: impl Fn(&[f64; 3]) -> bool,
) -> std::result::Result<(), String>
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
{
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(40)
        .y_label_area_size(56)
        .build_cartesian_2d(across, up)
        .map_err(text)?;
    chart.configure_mesh().x_desc(&panel.across).y_desc(&panel.axis).draw().map_err(text)?;
    for (k, line) in panel.lines.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let points = || line.points.iter().filter(|p| shown(p));
        // One standard error to each side; where the axis has no room for it, as far as the axis goes.
        let least = points().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        let bars = points().filter(|p| p[2].is_finite() && p[2] > 0.0).map(|p| {
            let down = if panel.logarithmic { (p[1] - p[2]).max(0.8 * least) } else { p[1] - p[2] };
            PathElement::new(vec![(p[0], down), (p[0], p[1] + p[2])], color.mix(0.35))
        });
        chart.draw_series(bars).map_err(text)?;
        let legend = move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], color.stroke_width(2));
        let drawn = if line.dots {
            chart.draw_series(points().map(|p| Circle::new((p[0], p[1]), 2, color.filled()))).map_err(text)?
        } else {
            chart.draw_series(LineSeries::new(points().map(|p| (p[0], p[1])), color.stroke_width(2))).map_err(text)?
        };
        drawn.label(&line.name).legend(legend);
    }
    // The axis names a single quantity, and a legend would cover it.
    if panel.lines.len() < 2 {
        return Ok(());
    }
    let places = panel.lines.iter().flat_map(|l| l.points.iter().filter(|p| shown(p)));
    let places: Vec<(i32, i32)> = places.map(|p| chart.backend_coord(&(p[0], p[1]))).collect();
    let (wide, high) = chart.plotting_area().get_pixel_range();
    let corner = freest([wide.start, high.start], [wide.end, high.end], &places);
    chart
        .configure_series_labels()
        .position(corner)
        .border_style(BLACK.mix(0.3))
        .background_style(WHITE.mix(0.8))
        .draw()
        .map_err(text)
}

/// Approximate size of a legend (pixels).
const LEGEND: [i32; 2] = [140, 70];

/// The corner of a plot from `start` to `end` (pixels, y down) that contains the fewest of the places.
fn freest(start: [i32; 2], end: [i32; 2], places: &[(i32, i32)]) -> SeriesLabelPosition {
    use SeriesLabelPosition::{LowerLeft, LowerRight, UpperLeft, UpperRight};
    let corners =
        [(UpperRight, true, false), (UpperLeft, false, false), (LowerRight, true, true), (LowerLeft, false, true)];
    let in_it = |right: bool, low: bool| {
        let near = |at: i32, k: usize, far: bool| if far { end[k] - at < LEGEND[k] } else { at - start[k] < LEGEND[k] };
        places.iter().filter(|(x, y)| near(*x, 0, right) && near(*y, 1, low)).count()
    };
    let best = corners.into_iter().min_by_key(|(_, right, low)| in_it(*right, *low));
    best.map_or(UpperRight, |(corner, ..)| corner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_a_leaf_even_where_names_are_alike() {
        let dir = tempfile::tempdir().unwrap();
        let line = |dots| SpectrumLine {
            name: "sigma_a".into(),
            points: vec![[450.0, 3.0, 0.1], [550.0, 0.0, f64::NAN]],
            dots,
        };
        let panel = |logarithmic| SpectrumPanel {
            title: "elm".into(),
            across: WAVELENGTH.into(),
            axis: "1/mm".into(),
            logarithmic,
            lines: vec![line(logarithmic)],
        };
        let leaves: Vec<_> =
            ["a/b", "a b", "..", "empty"].map(|n| (n.to_string(), vec![panel(true), panel(false)])).into();
        let files = pictures(dir.path(), &leaves).unwrap();
        let names: Vec<_> = files.iter().map(|f| f.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a_b.svg", "a_b-2.svg", "leaf.svg", "empty.svg"]);
        // A legend covers a curve, so there is one only where two must be told apart.
        assert!(!std::fs::read_to_string(&files[0]).unwrap().contains("sigma_a"));
        let two = SpectrumPanel { lines: vec![line(true), line(false)], ..panel(true) };
        let files = pictures(dir.path(), &[("two".to_string(), vec![two])]).unwrap();
        assert_eq!(std::fs::read_to_string(&files[0]).unwrap().matches("sigma_a").count(), 2);
        let nothing = [("none".to_string(), vec![SpectrumPanel { lines: vec![], ..panel(true) }])];
        assert_eq!(pictures(dir.path(), &nothing).unwrap().len(), 1);
    }
}
