//! `mesophyll inspect` of photographs in open shade and on a light table.

use super::{Args, said, shown};
use crate::cli::CommonArgs;
use crate::cli::Result;
use mesophyll_capture::photo::{PhotoInspection, inspect};
use std::fmt::Write;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let found = inspect(&args.capture);
    shown(args, common, &found, text, found.problems.len())
}

fn text(f: &PhotoInspection) -> String {
    let mut out = String::new();
    if let (Some(m), Some((width, height, texel_mm))) = (&f.manifest, f.texels) {
        let [h, err] = m.thickness();
        let _ = writeln!(
            out,
            "{}: photographs in open shade and on a light table, {width} × {height} texels of {texel_mm:.4} mm, h = \
             {h:.4} ± {err:.4} mm",
            m.name
        );
    }
    for (side, figures) in &f.figures {
        let list: Vec<String> = figures.iter().map(|(name, v)| format!("{name} {v:.4}")).collect();
        let _ = writeln!(out, "{side:>11}  {}", list.join(", "));
    }
    if let Some(n) = f.leaf_texels {
        let _ = writeln!(out, "leaf: {n} texels");
    }
    out.push_str(&said([&f.notes, &f.warnings, &f.problems]));
    out
}
