//! `mesophyll import`: a plant of triangles in, tables of its branches and leaves out.

use crate::named::named;
use crate::{Common, Result};
use mesophyll_files::unit::Unit;
use mesophyll_files::{atomic, claim, progress};
use mesophyll_flora::import::{import, table};
use std::path::PathBuf;

/// Finds the branches and the leaves of a plant in a glTF file, also of one list of triangles without nodes.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  \
     mesophyll import out/elm.glb -o out/elm-branches\n\n\
     branches.csv: branch,parent,at,level,length_mm,root_radius_mm,tip_radius_mm,x,y,z,dx,dy,dz,confidence,status\n\
     leaves.csv: leaf,branch,at,x,y,z,nx,ny,nz,length_mm,width_mm,area_mm2,status\n\
     others.csv: pieces that are neither a tube nor a blade, with the reason\n\
     Places are in mm in the file's own frame. docs/plants.md says how they are found.")]
pub struct Args {
    /// The plant (.glb or .gltf)
    #[arg(value_name = "PLANT.glb")]
    plant: PathBuf,
    /// Folder for the tables
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = crate::place::folder())]
    out: PathBuf,
    /// What one unit of the file's lengths is; default: the metre, or what the file's asset.extras.unit says
    #[arg(long, value_name = "UNIT", value_parser = named::<Unit>())]
    unit: Option<Unit>,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let found = import(&args.plant, args.unit)?;
    let _claim = claim::folder(&args.out, claim::Kind::Import, &[&args.plant])?;
    claim::begin(&args.out, claim::Kind::Import)?;
    table::write(&found, &args.out)?;
    let unattached = found.branches.iter().filter(|b| b.unattached.is_some()).count();
    let above = found.branches.iter().filter(|b| b.level.is_none()).count() - unattached;
    let on_these = if above > 0 { format!(", {above} more on these") } else { String::new() };
    let hung = found.leaves.iter().filter(|l| l.joint.is_some()).count();
    let summary = serde_json::json!({
        "pieces": found.branches.len() + found.leaves.len() + found.others.len(),
        "branches": found.branches.len(), "unattached": unattached,
        "levels": found.branches.iter().filter_map(|b| b.level).max().map_or(0, |l| l + 1),
        "leaves": found.leaves.len(), "leaves_on_branches": hung, "others": found.others.len(),
        "degenerate_triangles": found.degenerate,
    });
    let text = serde_json::to_string_pretty(&summary).map_err(|e| crate::Error::write(&args.out, e))?;
    atomic::write_bytes(&args.out.join("import.json"), format!("{text}\n").as_bytes())?;
    claim::finish(&args.out)?;
    if common.json {
        crate::print_json(&summary)?;
    } else {
        progress::say(format!(
            "{}: {} branches ({unattached} not attached{on_these}), {} leaves ({hung} on branches), {} other pieces",
            args.out.display(),
            found.branches.len(),
            found.leaves.len(),
            found.others.len()
        ));
        if found.degenerate > 0 {
            progress::say(format!("{} triangles without an area were left out", found.degenerate));
        }
    }
    Ok(0)
}
