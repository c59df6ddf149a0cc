//! The pictures of the sky's fits: the frontier, errors by band, the worst case and the ringing, as SVG.

use crate::sky::dome;
use crate::sky::figures::{
    DISSERTATION_BYTES, DISSERTATION_ERROR, DISSERTATION_FIT_S, DISSERTATION_TERMS, DISSERTATION_US, FrontierPoint,
    SkyProofCurve, SkyProofFigures,
};
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_report::COLORS;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type Drawn = std::result::Result<(), String>;

/// Draws `sky-frontier.svg`, `sky-error-by-band.svg`, `sky-worst.svg`, `sky-ringing.svg` and `sky-radiance.svg` into
/// `folder`; returns the files.
///
/// # Errors
/// [`Error::Write`] where a file cannot be written.
pub fn pictures(folder: &Path, figures: &SkyProofFigures) -> Result<Vec<PathBuf>> {
    let SkyProofFigures { points, bands, worst, ringing } = figures;
    let mut files = Vec::new();
    let mut save = |name: &str, size: (u32, u32), draw: &dyn Fn(&Area) -> Drawn| -> Result<()> {
        let path = folder.join(name);
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            area.fill(&WHITE).map_err(|e| Error::write(&path, e))?;
            draw(&area).map_err(|e| Error::write(&path, e))?;
            area.present().map_err(|e| Error::write(&path, e))?;
        }
        atomic::write_bytes(&path, svg.as_bytes())?;
        files.push(path);
        Ok(())
    };
    save("sky-frontier.svg", (980, 760), &|area| frontier(area, points))?;
    save("sky-error-by-band.svg", (760, 500), &|area| {
        let claims =
            [SkyProofCurve { name: "dissertation's claims, E_mean".into(), points: vec![(5.0, 5e-5), (7.0, 0.015)] }];
        by_band(area, bands, &claims)
    })?;
    save("sky-worst.svg", (860, 620), &|area| {
        let title = format!(
            "The worst sky of degree (13, 7) polynomials: sun {:.0}° from the zenith, turbidity {:.2}",
            worst.sun_zenith.to_degrees(),
            worst.turbidity
        );
        let (top, bottom) = area.split_vertically(330);
        lines(
            &top,
            &title,
            "luminance (kcd/m²), 7 bands",
            &[worst.correct.clone(), worst.reconstructed.clone()],
            SeriesLabelPosition::UpperLeft,
        )?;
        lines(
            &bottom,
            "",
            "difference (kcd/m²)",
            &[worst.difference.clone(), worst.fine.clone()],
            SeriesLabelPosition::LowerLeft,
        )
    })?;
    save("sky-ringing.svg", (860, 480), &|area| {
        lines(
            area,
            "Ringing of 7 bands below the horizon: sun 74.5° from the zenith, turbidity 3",
            "luminance over the sky's mean",
            ringing,
            SeriesLabelPosition::UpperLeft,
        )
    })?;
    save("sky-radiance.svg", (980, 460), &|area| dome::picture(area))?;
    Ok(files)
}

pub(super) fn text(e: impl std::fmt::Display) -> String {
    format!("cannot draw: {e}")
}

fn span(values: impl Iterator<Item = f64> + Clone) -> Range<f64> {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(0.0, f64::max);
    low / 2.0..high * 2.0
}

/// Four panels over one error: terms, bytes, fit time, evaluation time.
fn frontier(area: &Area, points: &[FrontierPoint]) -> Drawn {
    let title = "Sky fits, 7 bands: worst error over the smallest c00 (turbidity 2.5–6, sun from zenith to horizon)";
    let area = area.titled(title, ("sans-serif", 17)).map_err(text)?;
    type Of = fn(&FrontierPoint) -> f64;
    let panels: [(&str, Of, f64); 4] = [
        ("terms a function", |p| p.terms as f64, DISSERTATION_TERMS),
        ("bytes", |p| p.bytes as f64, DISSERTATION_BYTES),
        ("fit time (ms)", |p| p.fit_us / 1e3, DISSERTATION_FIT_S * 1e3),
        ("evaluation time (µs)", |p| p.evaluate_us, DISSERTATION_US),
    ];
    let families: [(&str, &str, RGBColor); 3] = [
        ("folded", "folded, Chebyshev staircase, f32", COLORS[0]),
        ("chebyshev", "Chebyshev tensor at nodes, f32", COLORS[2]),
        ("monomials f64", "monomials (13, 7), QR, f64 (singular in f32)", COLORS[1]),
    ];
    let errors = span(points.iter().map(|p| p.judged.worst).chain([DISSERTATION_ERROR]));
    for (k, (panel, (what, of, theirs))) in area.split_evenly((2, 2)).iter().zip(panels).enumerate() {
        let range = span(points.iter().map(of).chain([theirs]));
        let mut chart = ChartBuilder::on(panel)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(62)
            .build_cartesian_2d(range.log_scale(), errors.clone().log_scale())
            .map_err(text)?;
        chart
            .configure_mesh()
            .x_desc(what)
            .y_desc("worst error")
            .x_labels(6)
            .x_label_formatter(&|v| if (0.1..1e4).contains(v) { format!("{v}") } else { format!("{v:.0e}") })
            .y_label_formatter(&|v| format!("{v:.0e}"))
            .bold_line_style(RGBColor(220, 220, 220))
            .light_line_style(RGBColor(243, 243, 243))
            .draw()
            .map_err(text)?;
        for (family, name, color) in families {
            let mut of: Vec<(f64, f64)> =
                points.iter().filter(|p| p.family == family).map(|p| (of(p), p.judged.worst)).collect();
            of.sort_by(|a, b| a.0.total_cmp(&b.0));
            if k < 2 {
                chart.draw_series(LineSeries::new(of.clone(), color.stroke_width(2))).map_err(text)?;
            }
            chart
                .draw_series(of.into_iter().map(|p| Circle::new(p, 4, color.filled())))
                .map_err(text)?
                .label(name)
                .legend(move |(x, y)| Circle::new((x + 8, y), 4, color.filled()));
        }
        chart
            .draw_series([TriangleMarker::new((theirs, DISSERTATION_ERROR), 7, COLORS[6].filled())])
            .map_err(text)?
            .label("dissertation 2009 (Pentium 4)")
            .legend(|(x, y)| TriangleMarker::new((x + 8, y), 6, COLORS[6].filled()));
        // Slow fits that are accurate: this corner is empty.
        if k == 2 {
            legend(&mut chart, SeriesLabelPosition::LowerRight)?;
        }
    }
    Ok(())
}

type Chart<'a, 'b, X, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>;

fn legend<'b, X: Ranged, Y: Ranged>(chart: &mut Chart<'b, 'b, X, Y>, position: SeriesLabelPosition) -> Drawn {
    chart
        .configure_series_labels()
        .position(position)
        .label_font(("sans-serif", 12))
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(190, 190, 190))
        .draw()
        .map_err(text)
}

/// Errors by number of bands, with a logarithmic upward axis.
fn by_band(area: &Area, curves: &[SkyProofCurve], claims: &[SkyProofCurve]) -> Drawn {
    let all = || curves.iter().chain(claims).flat_map(|c| c.points.iter().map(|p| p.1)).filter(|e| *e > 0.0);
    let mut chart = ChartBuilder::on(area)
        .caption("Error by number of bands: the worst sky of the domain", ("sans-serif", 17))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(66)
        .build_cartesian_2d(0.8..7.2, span(all()).log_scale())
        .map_err(text)?;
    chart
        .configure_mesh()
        .x_desc("bands N")
        .y_desc("error over the smallest c00")
        .x_labels(8)
        .x_label_formatter(&|v| format!("{v:.0}"))
        .y_label_formatter(&|v| format!("{v:.0e}"))
        .bold_line_style(RGBColor(220, 220, 220))
        .light_line_style(WHITE)
        .draw()
        .map_err(text)?;
    for (k, c) in curves.iter().enumerate() {
        // E_max solid and full, E_mean of the same fit thin
        let color = COLORS[[1, 0, 2][(k / 2) % 3]];
        let width = if k % 2 == 0 { 3 } else { 1 };
        chart
            .draw_series(LineSeries::new(c.points.iter().copied().filter(|p| p.1 > 0.0), color.stroke_width(width)))
            .map_err(text)?
            .label(c.name.clone())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(width)));
    }
    for c in claims {
        chart
            .draw_series(c.points.iter().map(|p| TriangleMarker::new(*p, 6, COLORS[6].filled())))
            .map_err(text)?
            .label(c.name.clone())
            .legend(|(x, y)| TriangleMarker::new((x + 9, y), 6, COLORS[6].filled()));
    }
    legend(&mut chart, SeriesLabelPosition::MiddleLeft)
}

/// Curves along the meridian, with the half below the horizon shaded and the legend at `position`.
fn lines(area: &Area, title: &str, what: &str, curves: &[SkyProofCurve], position: SeriesLabelPosition) -> Drawn {
    let values = || curves.iter().flat_map(|c| c.points.iter().map(|p| p.1));
    let (low, high) = (values().fold(0.0, f64::min), values().fold(0.0, f64::max));
    let room = 0.06 * (high - low).max(1e-300);
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", if title.is_empty() { 1 } else { 17 }))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(66)
        .build_cartesian_2d(-180.0..180.0, low - room..high + room)
        .map_err(text)?;
    for side in [-180.0..-90.0, 90.0..180.0] {
        chart
            .draw_series([Rectangle::new(
                [(side.start, low - room), (side.end, high + room)],
                RGBColor(238, 236, 230).filled(),
            )])
            .map_err(text)?;
    }
    chart
        .configure_mesh()
        .x_desc(
            "angle from the zenith along the sun's meridian (°; the sun's side to the right; shaded: below the \
         horizon)",
        )
        .y_desc(what)
        .x_labels(13)
        .x_label_formatter(&|v| format!("{v:.0}"))
        .bold_line_style(RGBColor(214, 214, 214))
        .light_line_style(RGBAColor(0, 0, 0, 0.0))
        .draw()
        .map_err(text)?;
    for (k, c) in curves.iter().enumerate() {
        let color = COLORS[[6, 1, 3, 2, 0][k % 5]];
        let width = if k == 0 { 3 } else { 2 };
        chart
            .draw_series(LineSeries::new(c.points.iter().copied(), color.stroke_width(width)))
            .map_err(text)?
            .label(c.name.clone())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(width)));
    }
    legend(&mut chart, position)
}
