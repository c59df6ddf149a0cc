//! The error histograms of the directional bases (H7 Fig. 12): how far the reconstruction by a few functions is from
//! the full convolution, at three light angles.

use crate::translucency::basis_study::BasisOutcome;
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_fits::translucency::spread::TranslucencySpread;
use mesophyll_report::COLORS;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::{Path, PathBuf};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = std::result::Result<(), String>;

/// Light angles over the blade, in the order of an outcome's spreads.
const ANGLES: [&str; 3] = ["π/2", "π/4", "π/8"];
/// Size of a panel, and height of the part above all panels.
const PANEL: (u32, u32) = (370, 240);
const HEAD: u32 = 74;
/// Colours and widths of the lines, in the order in which they are drawn. The second is wide, because the third lies on
/// it when the light is straight above.
const INKS: [RGBColor; 4] = [COLORS[6], COLORS[4], COLORS[1], COLORS[2]];
const WIDTHS: [u32; 4] = [2, 5, 2, 2];

/// Draws `translucency-basis.svg` into `folder`; returns the file.
///
/// # Errors
/// [`Error::Write`] where the file cannot be written.
pub fn write(folder: &Path, cases: &[Vec<BasisOutcome>]) -> Result<PathBuf> {
    let path = folder.join("translucency-basis.svg");
    let svg = draw(cases).map_err(|e| Error::write(&path, e))?;
    atomic::write_bytes(&path, svg.as_bytes())?;
    Ok(path)
}

fn text(e: impl std::fmt::Display) -> String {
    format!("cannot draw: {e}")
}

/// One row for each case, one column for each light angle, one line for each basis.
pub fn draw(cases: &[Vec<BasisOutcome>]) -> std::result::Result<String, String> {
    let mut svg = String::new();
    {
        let size = (3 * PANEL.0, HEAD + PANEL.1 * cases.len() as u32);
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        area.fill(&WHITE).map_err(text)?;
        let (head, body) = area.split_vertically(HEAD);
        legend(&head, cases.first().map_or(&[], Vec::as_slice))?;
        for (place, panel) in body.split_evenly((cases.len().max(1), 3)).iter().enumerate() {
            if let Some(outcomes) = cases.get(place / 3) {
                histogram(panel, outcomes, place % 3)?;
            }
        }
        area.present().map_err(text)?;
    }
    Ok(svg)
}

/// Title and names of the bases with their colours.
fn legend(area: &Area, outcomes: &[BasisOutcome]) -> Drawn {
    let title = "Error of what a basis holds, against the full convolution (in brackets: coefficients a texel)";
    area.draw(&Text::new(title, (16, 14), ("sans-serif", 19).into_font().color(&BLACK))).map_err(text)?;
    let mut x = 16;
    for ((outcome, ink), width) in outcomes.iter().zip(INKS).zip(WIDTHS) {
        let name = name(outcome);
        area.draw(&PathElement::new([(x, 54), (x + 26, 54)], ink.stroke_width(width))).map_err(text)?;
        area.draw(&Text::new(name.clone(), (x + 33, 46), ("sans-serif", 15).into_font().color(&ink))).map_err(text)?;
        x += 56 + 7 * name.chars().count() as i32;
    }
    Ok(())
}

/// The name of the candidate with its number of coefficients.
fn name(outcome: &BasisOutcome) -> String {
    format!("{} ({})", outcome.candidate.name(), outcome.candidate.basis.count())
}

/// The corners of a step line: error and share in per cent.
fn steps(spread: &TranslucencySpread) -> Vec<(f64, f64)> {
    let edge = |bin: usize| 100.0 * (bin as f64 * spread.step - spread.reach());
    let corners = spread
        .histogram
        .iter()
        .enumerate()
        .flat_map(|(k, share)| [(edge(k), 100.0 * share), (edge(k + 1), 100.0 * share)]);
    let [first, last] = [0, spread.histogram.len()].map(|bin| (edge(bin), 0.0));
    [first].into_iter().chain(corners).chain([last]).collect()
}

/// A share in per cent that is never rounded to zero.
fn share(value: f64) -> String {
    match 100.0 * value {
        0.0 => "0".into(),
        p if p < 0.1 => "< .1".into(),
        p if p < 9.95 => format!("{p:.1}"),
        p => format!("{p:.0}"),
    }
}

/// One panel: the step lines, and in the corners the shares that are beyond the axis.
fn histogram(area: &Area, outcomes: &[BasisOutcome], angle: usize) -> Drawn {
    let spreads: Vec<&TranslucencySpread> = outcomes.iter().map(|o| &o.spreads[angle]).collect();
    let Some(first) = outcomes.first() else { return Ok(()) };
    let (reach, step) = (100.0 * spreads[0].reach(), 100.0 * spreads[0].step);
    let peak = spreads.iter().flat_map(|s| s.histogram).fold(0.0, f64::max) * 100.0;
    let top = 1.12 * if peak > 0.0 { peak } else { 1.0 };
    // "elm, front lit, …": the last part is the same for all cases.
    let case = first.case.rsplit_once(", ").map_or(first.case.as_str(), |(c, _)| c);
    let mut chart = ChartBuilder::on(area)
        .caption(format!("{case}, light at {}", ANGLES[angle]), ("sans-serif", 15))
        .margin(8)
        .margin_right(14)
        .x_label_area_size(38)
        .y_label_area_size(50)
        .build_cartesian_2d(-reach..reach, 0.0..top)
        .map_err(text)?;
    chart
        .configure_mesh()
        .x_desc(format!("error (%), steps of {step} %"))
        .y_desc("texels (%)")
        .axis_desc_style(("sans-serif", 13))
        .label_style(("sans-serif", 12))
        .x_labels(7)
        .y_labels(5)
        .x_label_formatter(&|v| format!("{v:.0}").replacen('-', "−", 1))
        .y_label_formatter(&|v| if peak < 4.0 { format!("{v:.1}") } else { format!("{v:.0}") })
        .bold_line_style(RGBColor(224, 224, 224))
        .light_line_style(RGBAColor(0, 0, 0, 0.0))
        .draw()
        .map_err(text)?;
    chart.draw_series([PathElement::new([(0.0, 0.0), (0.0, top)], RGBColor(190, 190, 190))]).map_err(text)?;
    for ((spread, ink), width) in spreads.iter().zip(INKS).zip(WIDTHS) {
        chart.draw_series(LineSeries::new(steps(spread), ink.stroke_width(width))).map_err(text)?;
    }
    for (end, at, side) in [(0, -0.97 * reach, HPos::Left), (1, 0.97 * reach, HPos::Right)] {
        let style = |ink: &RGBColor| ("sans-serif", 13).into_font().color(ink).pos(Pos::new(side, VPos::Top));
        let line = |k: usize| top * (0.985 - 0.1 * k as f64);
        let word = ["% below", "% above"][end];
        chart.draw_series([Text::new(word, (at, line(0)), style(&RGBColor(110, 110, 110)))]).map_err(text)?;
        for (k, (spread, ink)) in spreads.iter().zip(INKS).enumerate() {
            chart.draw_series([Text::new(share(spread.beyond[end]), (at, line(k + 1)), style(&ink))]).map_err(text)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::translucency::basis_study;

    fn outcome(case: &str, which: usize, errors: &[f64]) -> BasisOutcome {
        let spread =
            |elevation: f64, step: f64| TranslucencySpread::of(elevation, step, errors.iter().map(|e| [1.0 + e, 1.0]));
        let spreads = [spread(1.6, 0.0025), spread(0.8, 0.01), spread(0.4, 0.02)];
        BasisOutcome { case: case.into(), candidate: basis_study::drawn()[which], spreads }
    }

    /// The area under the line and the shares in the corners together are all texels.
    #[test]
    fn lines_and_corners_hold_every_texel() {
        let errors: Vec<f64> = (0..200).map(|k| 0.01 * (f64::from(k) - 90.0)).collect();
        for spread in outcome("elm, front lit, x", 0, &errors).spreads {
            let corners = steps(&spread);
            // Each step has two corners at its height, 100·step apart.
            let area: f64 = corners.windows(2).map(|w| (w[1].0 - w[0].0) * w[0].1).sum::<f64>() / (100.0 * spread.step);
            assert!((area + 100.0 * (spread.beyond[0] + spread.beyond[1]) - 100.0).abs() < 1e-9, "{area}");
            assert!((corners[0].0 + 100.0 * spread.reach()).abs() < 1e-9 && corners[0].1 == 0.0);
            let inside = errors.iter().filter(|e| e.abs() < spread.reach()).count() as f64 / 200.0;
            assert!((area - 100.0 * inside).abs() < 1.01, "{area} {inside}");
        }
    }

    #[test]
    fn every_panel_and_basis_is_named() {
        let errors = [-0.9, -0.001, 0.0, 0.0005, 0.6];
        let cases: Vec<Vec<BasisOutcome>> = ["elm, front lit, x", "elm, back lit, x"]
            .iter()
            .map(|c| (0..4).map(|k| outcome(c, k, &errors)).collect())
            .collect();
        let svg = draw(&cases).unwrap();
        for case in ["elm, front lit", "elm, back lit"] {
            for angle in ANGLES {
                assert!(svg.contains(&format!("{case}, light at {angle}")), "{case} {angle}");
            }
        }
        for basis in basis_study::drawn() {
            assert!(svg.contains(&basis.name()), "{}", basis.name());
        }
        // 4 bases × 2 ends × 6 panels, each with a fifth of the texels; a tick of an axis may have the same number.
        assert!(svg.matches("\n20\n").count() >= 48, "{}", svg.matches("\n20\n").count());
        assert_eq!([share(0.0), share(2e-4), share(0.0314), share(0.4)], ["0", "< .1", "3.1", "40"]);
    }
}
