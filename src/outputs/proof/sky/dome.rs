//! What seven bands of harmonics show of the sky, direction by direction: why they are for lighting, and how far off a
//! picture of the sky by them would be.

use super::charts::{Area, Drawn, text};
use crate::bench::BenchRow;
use crate::{Error, Result};
use mesophyll_sky::harmonics::HarmonicBasis;
use mesophyll_sky::projection::direct;
use mesophyll_sky::truncation::{RadianceError, radiance_error};
use mesophyll_sky::{Preetham, Sky, SkyRefusal, colour};
use plotters::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};

/// The sky of the picture: a sun 40° from the zenith, turbidity 3.
const ZENITH_DEG: f64 = 40.0;
const TURBIDITY: f64 = 3.0;
/// Rings and sectors of a drawn hemisphere.
const RINGS: usize = 18;
const SECTORS: usize = 48;
/// The largest relative difference that has a colour of its own.
const MOST: f64 = 0.6;

/// The error of radiance by numbers of bands: the worst of suns from the zenith to the horizon, at the ends and in the
/// middle of the trusted turbidities.
///
/// # Errors
/// Only the model's.
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let refused = |e: SkyRefusal| Error::Missed(e.to_string());
    let mut rows = Vec::new();
    for bands in [3, 5, 7, 9, 12] {
        let mut worst = RadianceError { dome: 0.0, horizon: 0.0 };
        for sun in (0..=6).map(|k| FRAC_PI_2 * f64::from(k) / 6.0) {
            for turbidity in [2.5, 4.25, 6.0] {
                let sky = Preetham.at(sun, turbidity).map_err(refused)?;
                worst = worst.or_worse(radiance_error(&direct(&sky, bands), &sky));
            }
        }
        let sky = Preetham.at(ZENITH_DEG.to_radians(), TURBIDITY).map_err(refused)?;
        let one = radiance_error(&direct(&sky, bands), &sky);
        rows.push(BenchRow {
            model: "sky".into(),
            knob: "radiance by harmonics".into(),
            setting: format!("{bands} bands"),
            error: worst.dome,
            us: f64::NAN,
            note: format!(
                "root mean square over the dome, the worst of 21 skies; {:.0} % at the horizon; at {ZENITH_DEG}° and \
                 turbidity {TURBIDITY} {:.1} % and {:.0} %",
                1e2 * worst.horizon,
                1e2 * one.dome,
                1e2 * one.horizon
            ),
        });
    }
    Ok(rows)
}

/// The picture: the sky, seven bands of it, and the difference over the sky itself, seen from below with the sun's side
/// on the right.
pub(super) fn picture(area: &Area) -> Drawn {
    let sky = Preetham.at(ZENITH_DEG.to_radians(), TURBIDITY).map_err(text)?;
    let c = direct(&sky, 7);
    let (basis, error) = (HarmonicBasis::new(7), radiance_error(&c, &sky));
    let of_sky = |d: [f64; 3]| sky.xyz(d)[1];
    let of_bands = |d: [f64; 3]| colour::xyz_from_rgb(basis.sum(&c, d))[1];
    let title = format!(
        "Seven bands of a sky (sun {ZENITH_DEG}° from the zenith, turbidity {TURBIDITY}): radiance is off by {:.0} % \
         over the dome, {:.0} % at the horizon (rms)",
        1e2 * error.dome,
        1e2 * error.horizon
    );
    let area = area.titled(&title, ("sans-serif", 16)).map_err(text)?;
    let brightest = of_sky([ZENITH_DEG.to_radians().sin(), 0.0, ZENITH_DEG.to_radians().cos()]);
    let grey = |v: f64| {
        let level = (255.0 * (v / brightest).clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8;
        RGBColor(level, level, level)
    };
    type Paint<'a> = &'a dyn Fn([f64; 3]) -> RGBColor;
    let panels: [(&str, Paint); 3] = [
        ("the sky itself (luminance)", &|d| grey(of_sky(d))),
        ("seven bands", &|d| grey(of_bands(d))),
        ("seven bands less the sky, over the sky", &|d| signed(of_bands(d) / of_sky(d) - 1.0)),
    ];
    let (discs, scale) = area.split_vertically(352);
    for (panel, (name, paint)) in discs.split_evenly((1, 3)).iter().zip(panels) {
        dome(panel, name, paint)?;
    }
    legend(&scale)
}

/// Red where the harmonics are too bright, blue where they are too dark.
fn signed(share: f64) -> RGBColor {
    let strength = (share.abs() / MOST).min(1.0);
    let fade = (255.0 * (1.0 - strength)) as u8;
    if share > 0.0 { RGBColor(255 - (60.0 * strength) as u8, fade, fade) } else { RGBColor(fade, fade, 255) }
}

/// A hemisphere as a disc: the zenith in its middle, the horizon around it, angles from the zenith evenly spaced.
fn dome(panel: &Area, name: &str, paint: &dyn Fn([f64; 3]) -> RGBColor) -> Drawn {
    let mut chart = ChartBuilder::on(panel)
        .caption(name, ("sans-serif", 14))
        .margin(10)
        .build_cartesian_2d(-1.02..1.02, -1.02..1.02)
        .map_err(text)?;
    // From the outermost ring inwards, each sector from the middle on: no gaps between rings.
    for ring in (0..RINGS).rev() {
        let theta = FRAC_PI_2 * (ring as f64 + 0.5) / RINGS as f64;
        let reach = (ring + 1) as f64 / RINGS as f64;
        let sectors = (0..SECTORS).map(|k| {
            let phi = TAU * (k as f64 + 0.5) / SECTORS as f64;
            let color = paint([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]);
            // A little wider than it is, so that no gap shows between sectors.
            let edge = |more: f64| TAU * (k as f64 + more) / SECTORS as f64;
            let corner = |phi: f64| (reach * phi.cos(), reach * phi.sin());
            Polygon::new(vec![(0.0, 0.0), corner(edge(-0.04)), corner(edge(0.5)), corner(edge(1.04))], color.filled())
        });
        chart.draw_series(sectors).map_err(text)?;
    }
    let sun = (ZENITH_DEG / 90.0, 0.0);
    chart.draw_series([Circle::new(sun, 5, BLACK.stroke_width(2))]).map_err(text)?;
    Ok(())
}

/// The colours of differences.
fn legend(area: &Area) -> Drawn {
    let steps = 24;
    let mut chart = ChartBuilder::on(area)
        .margin_left(250)
        .margin_right(250)
        .x_label_area_size(44)
        .build_cartesian_2d(-100.0 * MOST..100.0 * MOST, 0.0..1.0)
        .map_err(text)?;
    let share = |k: usize| MOST * (2.0 * k as f64 / steps as f64 - 1.0);
    chart
        .draw_series((0..steps).map(|k| {
            let [from, to] = [share(k), share(k + 1)];
            Rectangle::new([(100.0 * from, 0.0), (100.0 * to, 1.0)], signed(0.5 * (from + to)).filled())
        }))
        .map_err(text)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .disable_y_axis()
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 13))
        .x_desc("difference of luminance (%); the ring is the sun, the rim the horizon")
        .x_label_formatter(&|v| format!("{v:+.0}"))
        .draw()
        .map_err(text)?;
    Ok(())
}
