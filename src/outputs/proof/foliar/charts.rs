//! Pictures of the layered leaf: shares of light over the angle of incidence, and polar plots of where light leaves.

use crate::foliar::figures::{self, FoliarProofCurve};
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_optics::side::Side;
use mesophyll_report::COLORS;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::{Path, PathBuf};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = std::result::Result<(), String>;

fn text(e: impl std::fmt::Display) -> String {
    format!("cannot draw: {e}")
}

/// Draws `foliar-angles.svg` and `foliar-lobes.svg` into `folder`; returns the files.
///
/// # Errors
/// [`Error::Write`] where a file cannot be written.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut save = |name: &str, size: (u32, u32), draw: &dyn Fn(&[Area]) -> Drawn| -> Result<()> {
        let path = folder.join(name);
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            area.fill(&WHITE).map_err(|e| Error::write(&path, e))?;
            draw(&area.split_evenly((2, 2))).map_err(|e| Error::write(&path, e))?;
            area.present().map_err(|e| Error::write(&path, e))?;
        }
        atomic::write_bytes(&path, svg.as_bytes())?;
        files.push(path);
        Ok(())
    };
    let tables = figures::tables();
    save("foliar-angles.svg", (980, 700), &|panels| {
        panels.iter().zip(&tables).try_for_each(|(area, (title, curves))| angles(area, title, curves))
    })?;
    let plots: Vec<(String, Vec<FoliarProofCurve>)> = [30.0, 45.0]
        .into_iter()
        .flat_map(|incidence| {
            let [abm, fsm] = figures::lobes(Side::Front, incidence);
            [("ABM", abm), ("FSM", fsm)].map(|(name, c)| (format!("{name}, light from above at {incidence}°"), c))
        })
        .collect();
    save("foliar-lobes.svg", (980, 980), &|panels| {
        panels.iter().zip(&plots).try_for_each(|(area, (title, curves))| polar(area, title, curves))
    })?;
    Ok(files)
}

fn angles(area: &Area, title: &str, curves: &[FoliarProofCurve]) -> Drawn {
    let most = curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)).fold(0.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(40)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..180.0, 0.0..1.06 * most)
        .map_err(text)?;
    chart
        .configure_mesh()
        .x_desc("angle of incidence (degrees; from 90 on from below)")
        .y_desc("share of the light")
        .draw()
        .map_err(text)?;
    for (k, curve) in curves.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        chart
            .draw_series(LineSeries::new(curve.points.iter().copied(), color.stroke_width(2)))
            .map_err(text)?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().border_style(BLACK.mix(0.3)).background_style(WHITE.mix(0.8)).draw().map_err(text)
}

/// The distance from the middle is the BRDF or BTDF; the lit side is up, the mirror direction to the right.
fn polar(area: &Area, title: &str, curves: &[FoliarProofCurve]) -> Drawn {
    let most = 1.08 * curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)).fold(0.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(34)
        .y_label_area_size(48)
        .build_cartesian_2d(-most..most, -most..most)
        .map_err(text)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_desc("BRDF above, BTDF below (1/sr)")
        .x_labels(5)
        .y_labels(5)
        .draw()
        .map_err(text)?;
    let at = |degrees: f64, r: f64| (r * degrees.to_radians().sin(), r * degrees.to_radians().cos());
    let faint = BLACK.mix(0.18);
    for share in [0.25, 0.5, 0.75, 1.0] {
        let circle = (0..=180).map(|k| at(2.0 * f64::from(k), share * most));
        chart.draw_series(LineSeries::new(circle, faint)).map_err(text)?;
    }
    for degrees in (0..180).step_by(30).map(f64::from) {
        chart.draw_series(LineSeries::new([at(degrees, -most), at(degrees, most)], faint)).map_err(text)?;
    }
    for (k, curve) in curves.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let mut points: Vec<(f64, f64)> = curve.points.iter().map(|p| at(p.0, p.1)).collect();
        points.extend(points.first().copied());
        chart
            .draw_series(LineSeries::new(points, color.stroke_width(2)))
            .map_err(text)?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().border_style(BLACK.mix(0.3)).background_style(WHITE.mix(0.8)).draw().map_err(text)
}
