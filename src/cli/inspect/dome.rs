//! `mesophyll inspect` of a capture under a dome.

use super::{Args, said, shown};
use crate::cli::CommonArgs;
use crate::cli::Result;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::dome::inspection::{DomeInspection, SideSummary, inspect};
use std::fmt::Write;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let found = inspect(&args.capture);
    shown(args, common, &found, text, found.problems.len())
}

fn text(f: &DomeInspection) -> String {
    let mut out = String::new();
    let mut line = |text: String| {
        let _ = writeln!(out, "{text}");
    };
    if let Some(m) = &f.manifest {
        line(format!(
            "{}: under a dome, {} × {} texels of {} mm, thickest place {} mm, front and back",
            m.name, m.width, m.height, m.texel_mm, m.thickness_max_mm
        ));
    }
    for p in &f.photographs {
        line(format!(
            "{:>22}  {:.4} … {:.4}, median {:.4} of its reference, no reading {:.2} %",
            p.name,
            p.low,
            p.high,
            p.median,
            100.0 * p.no_reading_share
        ));
    }
    f.sides.iter().for_each(|s| line(side(s)));
    if let Some(s) = &f.shape {
        let a = &s.alignment;
        let [thin, median, thick] = s.thickness_mm;
        line(format!(
            "thickness: {thin:.3} … {thick:.3} mm, median {median:.3}; zero ± {:.4} mm, a texel ± {:.4} mm",
            a.offset_err_mm, a.thickness_error_mm
        ));
        line(format!(
            "the two height scans are tilted by {:.3}° against each other, shifted by {:.3} mm sideways and {:.3} mm \
             in height; their noise is {:.4} mm ({}), which raised the highest point by {:.4} mm",
            a.tilt[0].hypot(a.tilt[1]).atan().to_degrees(),
            a.shift_mm[0].hypot(a.shift_mm[1]),
            a.offset_mm,
            a.height_noise_mm,
            if a.noise_stated { "stated" } else { "measured" },
            a.raised_mm
        ));
        line(format!(
            "smoothed by {:.3} mm for the thickness, {:.3} and {:.3} mm for the normals of front and back, which \
             leaves these ± {:.1}° and ± {:.1}°; holes {:.2} %",
            a.smooth_thickness_mm,
            a.smooth_height_mm[0],
            a.smooth_height_mm[1],
            a.slope_error[0].atan().to_degrees(),
            a.slope_error[1].atan().to_degrees(),
            100.0 * s.hole_share
        ));
    }
    if let Some(n) = f.leaf_texels {
        line(format!("leaf: {n} texels"));
    }
    out.push_str(&said([&f.notes, &f.warnings, &f.problems]));
    out
}

fn side(s: &SideSummary) -> String {
    let colour = |v: Rgb| v.0.map(|v| format!("{v:.4}")).join(" ");
    let defects: Vec<String> = s.defects.iter().map(|(name, n)| format!(", {n} {name}")).collect();
    format!(
        "{:>22}  albedo {}, transmittance {} (medians); highlight {:.4} ± {:.4}{}{}",
        s.side,
        colour(s.albedo),
        colour(s.transmittance),
        s.highlight.share,
        s.highlight.stderr,
        if s.highlight.stated { "" } else { " (a range)" },
        defects.concat()
    )
}
