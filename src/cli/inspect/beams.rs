//! `mesophyll inspect` of photographs under beams.

use super::{Args, said, shown};
use crate::cli::CommonArgs;
use crate::cli::Result;
use mesophyll_capture::beams::inspection::{BeamPhotographSummary, BeamsInspection, inspect};
use std::fmt::Write;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let found = inspect(&args.capture);
    shown(args, common, &found, text, found.problems.len())
}

fn text(f: &BeamsInspection) -> String {
    let mut out = String::new();
    let mut line = |text: String| {
        let _ = writeln!(out, "{text}");
    };
    if let (Some(m), Some([width_mm, height_mm])) = (&f.manifest, f.field_mm) {
        line(format!(
            "{}: {} photographs under beams, {} × {} texels of {} mm ({width_mm:.1} × {height_mm:.1} mm)",
            m.name,
            m.beams.len(),
            m.width,
            m.height,
            m.texel_mm
        ));
    }
    f.photographs.iter().for_each(|p| line(photograph(p)));
    if let Some(ratio) = f.noise_seen_over_stated {
        line(format!("measured noise: at most {ratio:.2} times the stated noise (fine texture counts as noise)"));
    }
    if let Some(n) = f.leaf_texels {
        line(format!("leaf: {n} texels"));
    }
    out.push_str(&said([&f.notes, &f.warnings, &f.problems]));
    out
}

fn photograph(p: &BeamPhotographSummary) -> String {
    let relative = p.noise.iter().zip(p.colour).filter_map(|(sd, level)| Some((*sd)? / level));
    let worst = relative.reduce(f64::max);
    let percent = |v: Option<f64>| v.map_or("unknown".to_string(), |v| format!("{:.1} %", 100.0 * v));
    format!(
        "{:>2}  {:<28} {:>5} lit {:>4}° up, {:>4}° around;  {:.4} … {:.4}, medians {}, noise at most {}, no reading \
         {:.2} %",
        p.beam,
        p.file,
        p.lit,
        p.elevation_deg,
        p.azimuth_deg,
        p.low,
        p.high,
        p.colour.map(|v| format!("{v:.4}")).join(" "),
        percent(worst),
        100.0 * p.no_reading_share
    )
}
