//! Writes what was found as tables: `branches.csv`, `leaves.csv` and `others.csv`.

use super::PlantPieces;
use crate::Result;
use mesophyll_files::{atomic, table::push_text};
use std::fmt::Write;
use std::path::Path;

/// Columns of `branches.csv`.
pub const BRANCHES: &str =
    "branch,parent,at,level,length_mm,root_radius_mm,tip_radius_mm,x,y,z,dx,dy,dz,confidence,status";
/// Columns of `leaves.csv`.
pub const LEAVES: &str = "leaf,branch,at,x,y,z,nx,ny,nz,length_mm,width_mm,area_mm2,status";
/// Columns of `others.csv`.
pub const OTHERS: &str = "piece,x,y,z,triangles,status";

/// Writes the tables into `folder`, each whole or not at all. Tables without rows are written too, so that none from an
/// earlier run stays.
///
/// # Errors
/// As [`atomic::write_bytes`].
pub fn write(found: &PlantPieces, folder: &Path) -> Result<()> {
    for (name, text) in
        [("leaves.csv", leaves(found)), ("others.csv", others(found)), ("branches.csv", branches(found))]
    {
        atomic::write_bytes(&folder.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// A cell of a table, quoted because it may hold a comma.
fn quoted(text: &str) -> String {
    let mut out = Vec::new();
    push_text(&mut out, text);
    String::from_utf8_lossy(&out).into_owned()
}

/// The text of `branches.csv`. The direction is from the root to the tip.
pub fn branches(found: &PlantPieces) -> String {
    let mut out = format!("{BRANCHES}\n");
    for (k, b) in found.branches.iter().enumerate() {
        let tube = &b.tube;
        let root = tube.axis.first().copied().unwrap_or_default();
        let d = (tube.axis.last().copied().unwrap_or_default() - root).normalize_or_zero();
        let (parent, at) = b.parent.map_or_else(Default::default, |p| (format!("b{p}"), format!("{}", b.at)));
        let level = b.level.map_or_else(String::new, |l| l.to_string());
        let status = match (&b.unattached, b.level) {
            (Some(why), _) => quoted(&format!("undetermined: parent ({why})")),
            (None, None) => "undetermined: level (what carries it is not attached)".into(),
            (None, Some(_)) => "ok".into(),
        };
        let _ = writeln!(
            out,
            "b{k},{parent},{at},{level},{},{},{},{},{},{},{},{},{},{:.4},{status}",
            tube.length(),
            tube.root_radius,
            tube.tip_radius,
            root.x,
            root.y,
            root.z,
            d.x,
            d.y,
            d.z,
            b.confidence
        );
    }
    out
}

fn leaves(found: &PlantPieces) -> String {
    let mut out = format!("{LEAVES}\n");
    for (k, leaf) in found.leaves.iter().enumerate() {
        let (branch, at) = leaf.joint.map_or_else(Default::default, |(b, at)| (format!("b{b}"), format!("{at}")));
        let status = if leaf.joint.is_some() {
            "ok".into()
        } else if leaf.gap.is_finite() {
            format!("undetermined: branch (the nearest is {:.3} mm away)", leaf.gap)
        } else {
            "undetermined: branch (there is none)".into()
        };
        let (c, n, [length, width]) = (leaf.centre, leaf.normal, leaf.size);
        let _ = writeln!(
            out,
            "l{k},{branch},{at},{},{},{},{},{},{},{length},{width},{},{status}",
            c.x, c.y, c.z, n.x, n.y, n.z, leaf.area
        );
    }
    out
}

fn others(found: &PlantPieces) -> String {
    let mut out = format!("{OTHERS}\n");
    for (k, other) in found.others.iter().enumerate() {
        let (c, why) = (other.centre, quoted(&format!("refused: {}", other.why)));
        let _ = writeln!(out, "p{k},{},{},{},{},{why}", c.x, c.y, c.z, other.triangles);
    }
    out
}
