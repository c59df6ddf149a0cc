//! Error against run time as SVG, one picture for each model. A model whose knobs are called `GROUP: KNOB` gets one
//! panel for each group.

use crate::bench::BenchRow;
use crate::tables::names;
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_report::COLORS;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::{Path, PathBuf};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = std::result::Result<(), String>;

/// Points without an order (peers, methods): no line joins them, and each is labelled.
const APART: [&str; 3] = ["peer", "method", "lobe"];

/// Groups whose settings are cases and not a knob: error and time of one tell nothing about the next. They are in the
/// table only.
const CASES: [&str; 5] = ["oracle", "basis", "form", "elevation", "distance"];

/// Size of a picture with one panel, and size of each of several panels.
const ONE: (u32, u32) = (860, 560);
const EACH: (u32, u32) = (620, 440);

/// Splits `GROUP: KNOB`; a knob without a group is its own group.
fn parts(knob: &str) -> (&str, &str) {
    knob.split_once(": ").unwrap_or((knob, knob))
}

/// Draws one plot for each model into `folder` (`bench-<model>.svg`): error against run time, one line for each knob,
/// both axes logarithmic. Models without a row of positive error and time get none. Returns the files.
///
/// # Errors
/// [`Error::Write`] where a file cannot be written.
pub fn write(rows: &[BenchRow], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for model in names(rows.iter().map(|r| r.model.as_str())) {
        let drawable = |r: &&BenchRow| {
            let finite = r.error > 0.0 && r.us > 0.0 && r.error.is_finite() && r.us.is_finite();
            r.model == model && finite && !CASES.contains(&parts(&r.knob).0)
        };
        let of: Vec<&BenchRow> = rows.iter().filter(drawable).collect();
        if of.is_empty() {
            continue;
        }
        let path = folder.join(format!("bench-{model}.svg"));
        let svg = picture(&model, &of).map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, svg.as_bytes())?;
        files.push(path);
    }
    Ok(files)
}

fn text(e: impl std::fmt::Display) -> String {
    format!("cannot draw: {e}")
}

fn picture(model: &str, rows: &[&BenchRow]) -> std::result::Result<String, String> {
    let title = format!("{model}: error against run time");
    let grouped = rows.iter().any(|r| r.knob.contains(": "));
    let groups = names(rows.iter().map(|r| parts(&r.knob).0));
    let lines = groups.len().div_ceil(2);
    let size = if grouped { (2 * EACH.0, EACH.1 * lines as u32 + 40) } else { ONE };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        area.fill(&WHITE).map_err(text)?;
        if grouped {
            let area = area.titled(&title, ("sans-serif", 20)).map_err(text)?;
            for (panel, group) in area.split_evenly((lines, 2)).iter().zip(&groups) {
                let of: Vec<&BenchRow> = rows.iter().filter(|r| parts(&r.knob).0 == group).copied().collect();
                plot(panel, (group, 16), &of)?;
            }
        } else {
            plot(&area, (&title, 20), rows)?;
        }
        area.present().map_err(text)?;
    }
    Ok(svg)
}

/// Range of values with margins at both ends of a logarithmic axis, at least a decade.
fn span(values: impl Iterator<Item = f64> + Clone) -> std::ops::Range<f64> {
    let low = values.clone().fold(f64::INFINITY, f64::min) / 1.6;
    let high = values.fold(0.0, f64::max) * 2.5;
    let widen = (10.0 * low / high).max(1.0).sqrt();
    low / widen..high * widen
}

fn plot(area: &Area, (title, size): (&str, i32), rows: &[&BenchRow]) -> Drawn {
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", size))
        .margin(14)
        .x_label_area_size(46)
        .y_label_area_size(72)
        .build_cartesian_2d(span(rows.iter().map(|r| r.us)).log_scale(), span(rows.iter().map(|r| r.error)).log_scale())
        .map_err(text)?;
    chart
        .configure_mesh()
        .x_desc("run time (µs)")
        .y_desc("error")
        // More labels would overlap.
        .x_labels(6)
        .x_label_formatter(&|v| format!("{v:.0e}"))
        .y_label_formatter(&|v| format!("{v:.0e}"))
        .bold_line_style(RGBColor(214, 214, 214))
        .light_line_style(RGBColor(240, 240, 240))
        .draw()
        .map_err(text)?;
    for (k, knob) in names(rows.iter().map(|r| r.knob.as_str())).into_iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let of: Vec<&&BenchRow> = rows.iter().filter(|r| r.knob == knob).collect();
        let points = of.iter().map(|r| (r.us, r.error));
        // Peers and the like are points without an order; the settings of a knob follow one another.
        let apart = APART.contains(&knob.as_str());
        if !apart {
            chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(2))).map_err(text)?;
        }
        chart
            .draw_series(points.map(|p| Circle::new(p, 4, color.filled())))
            .map_err(text)?
            .label(parts(&knob).1)
            .legend(move |(x, y)| Circle::new((x + 8, y), 4, color.filled()));
        // Only the ends of a knob are labelled, because labels of all settings would cover each other.
        let named = of.iter().enumerate().filter(|(k, _)| apart || *k == 0 || k + 1 == of.len()).map(|(_, r)| r);
        let style = ("sans-serif", 12).into_font().color(&color);
        chart
            .draw_series(named.map(|r| Text::new(r.setting.clone(), (r.us * 1.05, r.error), style.clone())))
            .map_err(text)?;
    }
    // The only knob of a panel is already its title.
    if rows.iter().all(|r| r.knob == title) {
        return Ok(());
    }
    chart
        .configure_series_labels()
        // Slow and inaccurate at once: this corner is usually empty.
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(180, 180, 180))
        .draw()
        .map_err(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bench(knob: &str, error: f64, us: f64) -> BenchRow {
        BenchRow { model: "m".into(), knob: knob.into(), setting: "4".into(), error, us, note: "a < b & c".into() }
    }

    #[test]
    fn a_plot_is_written_for_drawable_rows_only() {
        let folder = tempfile::tempdir().unwrap();
        let rows = [bench("nodes", 1e-3, 4.0), bench("nodes", 1e-6, 40.0), bench("exact", 0.0, 90.0)];
        let files = write(&rows, folder.path()).unwrap();
        let svg = std::fs::read_to_string(&files[0]).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("nodes") && svg.matches("<circle").count() >= 2);
        assert!(!svg.contains("exact"));
        assert!(write(&rows[2..], folder.path()).unwrap().is_empty());
    }

    #[test]
    fn groups_have_panels_and_cases_none() {
        let folder = tempfile::tempdir().unwrap();
        let rows = [bench("levels: linear", 1e-3, 4.0), bench("levels: cubic", 1e-5, 4.0), bench("size", 0.1, 9.0)];
        let cases = [bench("oracle: thickness, thin", 0.2, 1.0), bench("basis: elm", 0.1, 1.0)];
        let all: Vec<BenchRow> = rows.into_iter().chain(cases).collect();
        let svg = std::fs::read_to_string(&write(&all, folder.path()).unwrap()[0]).unwrap();
        for said in ["levels", "linear", "cubic", "size"] {
            assert!(svg.contains(&format!("\n{said}\n")), "{said}");
        }
        assert_eq!(svg.matches("run time (µs)").count(), 2, "a panel a group");
        assert!(!svg.contains("oracle") && !svg.contains("elm") && !svg.contains("levels: "));
        assert!(write(&all[3..], folder.path()).unwrap().is_empty());
    }
}
