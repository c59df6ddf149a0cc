//! The texels as CSV: `side,column,row,x_mm,y_mm,mask`, then every map and its standard error (`sigma_a_r`,
//! `sigma_a_r_err`).

use super::side::ExportSideMaps;
use crate::Result;
use mesophyll_base::image::ImageSize;
use mesophyll_files::atomic;
use mesophyll_files::quantity::{self, Quantity};
use mesophyll_fits::record::FitRecord;
use std::io::Write;
use std::path::Path;

/// A channel, where the side has it.
type Plane<'a> = Option<&'a [f32]>;

/// Writes every texel on the leaf, front first. Places are in mm where the fit states the size of a texel; otherwise
/// the cells are empty.
pub fn write(sides: &[ExportSideMaps], record: &FitRecord, path: &Path) -> Result<()> {
    let texel: Option<f64> = record.options.get("texel_mm").and_then(|t| t.parse().ok());
    let mut channels: Vec<&str> = Vec::new();
    for (name, _) in sides.iter().flat_map(|s| &s.maps.channels) {
        if *name != Quantity::Mask.channel(0) && !channels.contains(&name.as_str()) {
            channels.push(name);
        }
    }
    let with_error: Vec<bool> =
        channels.iter().map(|c| sides.iter().any(|s| s.errors.as_ref().is_some_and(|e| e.get(c).is_some()))).collect();
    atomic::write(path, |out| {
        write!(out, "side,column,row,x_mm,y_mm,mask")?;
        for (c, error) in channels.iter().zip(&with_error) {
            let name = column(c);
            write!(out, ",{name}")?;
            if *error {
                write!(out, ",{name}_err")?;
            }
        }
        writeln!(out)?;
        for side in sides {
            let size = ImageSize::new(side.maps.width, side.maps.height);
            let planes: Vec<(Plane, Plane)> =
                channels.iter().map(|c| (side.maps.get(c), side.errors.as_ref().and_then(|e| e.get(c)))).collect();
            for k in (0..size.texels()).filter(|k| side.mask[*k] != 0.0) {
                let [column, row] = size.position(k);
                write!(out, "{},{column},{row}", side.side.name())?;
                match texel {
                    Some(p) => {
                        let [x, y] = size.place_mm(p, k);
                        write!(out, ",{x},{y}")?;
                    }
                    None => write!(out, ",,")?,
                }
                write!(out, ",{}", side.mask[k])?;
                for ((value, error), has_error) in planes.iter().zip(&with_error) {
                    cell(out, value.map(|p| p[k]))?;
                    if *has_error {
                        cell(out, error.map(|p| p[k]))?;
                    }
                }
                writeln!(out)?;
            }
        }
        Ok(())
    })
}

/// A number that is read back exactly; empty where there is none.
fn cell(out: &mut dyn Write, value: Option<f32>) -> std::io::Result<()> {
    match value.filter(|v| v.is_finite()) {
        Some(v) => write!(out, ",{v}"),
        None => write!(out, ","),
    }
}

/// `sigma_a.R` → `sigma_a_r`, `thickness.Y` → `thickness`, `normal.Y` → `normal_y`.
fn column(channel: &str) -> String {
    match quantity::split(channel) {
        (q, "") => q.to_string(),
        (q, c) => format!("{q}_{}", c.to_lowercase()),
    }
}
