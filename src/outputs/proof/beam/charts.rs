//! Pictures of branches for the documentation: error against coefficients, length errors, shapes and spectra.

use crate::beam::figures::{BranchProofCurve, BranchProofFigures};
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_report::COLORS;
use plotters::prelude::*;
use std::path::{Path, PathBuf};

/// Curves over one pair of axes.
pub(crate) struct Picture<'a> {
    pub title: &'a str,
    pub x: &'a str,
    pub y: &'a str,
    pub log_x: bool,
    pub log_y: bool,
    pub curves: &'a [BranchProofCurve],
}

/// Draws `beam-basis.svg`, `beam-shapes.svg`, `beam-length.svg` and `beam-motion.svg` into `folder`; returns the files.
///
/// # Errors
/// [`Error::Write`] where a file cannot be written.
pub fn write(folder: &Path, figures: &BranchProofFigures) -> Result<Vec<PathBuf>> {
    let [[plain, abel, directed], [plain_damped, abel_damped, directed_damped]] = figures.spectrum_errors;
    let motion_title = format!(
        "lines through a motion texture, RMS log10: {plain:.2} / {abel:.2} / {directed:.2} (0.1), {plain_damped:.2} / \
         {abel_damped:.2} / {directed_damped:.2} (0.5)"
    );
    let pictures = [
        (
            "beam-basis.svg",
            Picture {
                title: "worst error over tapers 1e-4 to 1, of the tip's deflection",
                x: "coefficients a branch",
                y: "error",
                log_x: false,
                log_y: true,
                curves: &figures.coefficients,
            },
        ),
        (
            "beam-shapes.svg",
            Picture {
                title: "deflection over the tip's",
                x: "x",
                y: "u(x)/u(1)",
                log_x: false,
                log_y: false,
                curves: &figures.shapes,
            },
        ),
        (
            "beam-length.svg",
            Picture {
                title: "length error of a bent branch",
                x: "tip deflection over length",
                y: "relative error of the length",
                log_x: false,
                log_y: true,
                curves: &figures.lengths,
            },
        ),
        (
            "beam-motion.svg",
            Picture {
                title: &motion_title,
                x: "frequency (Hz)",
                y: "power density of tip over length (1/Hz)",
                log_x: true,
                log_y: true,
                curves: &figures.spectra,
            },
        ),
    ];
    let mut files = Vec::new();
    for (name, picture) in pictures {
        let path = folder.join(name);
        let svg = draw(&picture).map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, svg.as_bytes())?;
        files.push(path);
    }
    Ok(files)
}

/// The values are logarithms where the axis is logarithmic; the axes themselves are linear, with ticks written as
/// powers.
pub(crate) fn draw(p: &Picture) -> std::result::Result<String, String> {
    let text = |e: &dyn std::fmt::Display| format!("cannot draw: {e}");
    let place = |log: bool, v: f64| if log { v.log10() } else { v };
    let curves: Vec<(&str, Vec<(f64, f64)>)> = p
        .curves
        .iter()
        .map(|(name, points)| {
            let shown = points
                .iter()
                .map(|(x, y)| (place(p.log_x, *x), place(p.log_y, *y)))
                .filter(|q| q.0.is_finite() && q.1.is_finite());
            (name.as_str(), shown.collect())
        })
        .collect();
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let all = || curves.iter().flat_map(|c| c.1.iter().map(pick));
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        let room = 0.04 * (high - low).max(1e-9);
        low - room..high + room
    };
    let label = |log: bool, v: f64| if log { format!("{:.1e}", 10f64.powf(v)) } else { format!("{v:.2}") };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (860, 560)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| text(&e))?;
        let mut chart = ChartBuilder::on(&area)
            .caption(p.title, ("sans-serif", 20))
            .margin(14)
            .x_label_area_size(46)
            .y_label_area_size(76)
            .build_cartesian_2d(range(|q| q.0), range(|q| q.1))
            .map_err(|e| text(&e))?;
        chart
            .configure_mesh()
            .x_desc(p.x)
            .y_desc(p.y)
            .x_label_formatter(&|v| label(p.log_x, *v))
            .y_label_formatter(&|v| label(p.log_y, *v))
            .bold_line_style(RGBColor(214, 214, 214))
            .light_line_style(RGBColor(240, 240, 240))
            .draw()
            .map_err(|e| text(&e))?;
        for (k, (name, points)) in curves.iter().enumerate() {
            let color = COLORS[k % COLORS.len()];
            chart
                .draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(2)))
                .map_err(|e| text(&e))?
                .label(*name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
            if points.len() <= 30 {
                chart.draw_series(points.iter().map(|q| Circle::new(*q, 3, color.filled()))).map_err(|e| text(&e))?;
            }
        }
        chart
            .configure_series_labels()
            .position(if p.log_y { SeriesLabelPosition::LowerLeft } else { SeriesLabelPosition::UpperLeft })
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(180, 180, 180))
            .draw()
            .map_err(|e| text(&e))?;
        area.present().map_err(|e| text(&e))?;
    }
    Ok(svg)
}
