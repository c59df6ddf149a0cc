//! `mesophyll import`: a plant of triangles in, tables of its branches and leaves out, or a plant that bends; or the
//! pictures of a leaf in, and a leaf whose look is stated out.

use crate::cli::names::named;
use crate::cli::{CommonArgs, Result};
use mesophyll_files::table::counted;
use mesophyll_files::unit::LengthUnit;
use mesophyll_files::{atomic, claim, progress};
use mesophyll_fits::look::{self, Look};
use mesophyll_plants::file::write;
use mesophyll_plants::import::{PlantPieces, import, plant, strange, table};
use std::path::PathBuf;

/// Finds the branches and the leaves of a plant in a glTF file, also of one list of triangles without nodes; or makes a
/// leaf of pictures, whose look is stated and not fitted.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
     mesophyll import out/elm.glb -o out/elm-branches\n  \
     mesophyll import out/elm.glb -o out/elm-plant.glb\n  \
     mesophyll import data/looks/elm.toml -o out/elm-look\n\n\
     A name that ends in .glb is a plant for scenes, which bends in their wind.\n\
     A folder has tables:\n\
     branches.csv: branch,parent,at,level,length_mm,root_radius_mm,tip_radius_mm,x,y,z,dx,dy,dz,confidence,status\n\
     leaves.csv: leaf,branch,at,x,y,z,nx,ny,nz,length_mm,width_mm,area_mm2,status\n\
     others.csv: pieces that are neither a tube nor a blade, with the reason\n\
     Places are in mm in the file's own frame. docs/plants-import.md says how they are found.\n\n\
     A .toml file states a leaf by pictures (albedo, opacity, translucency, normal), as `look` of a scene does. The \
     folder is like that of a fit: scenes name it by `fit`, and `export`, `dress` and `report` take it. \
     docs/looks.md has the fields.")]
pub struct Args {
    /// The plant (.glb or .gltf), or a leaf's look (.toml)
    #[arg(value_name = "PLANT.glb|LOOK.toml")]
    plant: PathBuf,
    /// Folder for the tables or the leaf, or a file (.glb) for the plant with branches
    #[arg(short, long, alias = "output", value_name = "DIR|FILE.glb", value_parser = crate::cli::destination::folder())]
    out: PathBuf,
    /// What one unit of the file's lengths is; default: the metre, or what the file's asset.extras.unit says
    #[arg(long, value_name = "UNIT", value_parser = named::<LengthUnit>())]
    unit: Option<LengthUnit>,
}

/// The maps and the blade of a leaf whose look is stated.
fn look(args: &Args, common: &CommonArgs) -> Result<u8> {
    if let Some(unit) = args.unit {
        return Err(crate::cli::Error::argument("--unit", format!("{unit:?}"), "a plant; a look states width_mm"));
    }
    let name = args.plant.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let record = look::run(&Look::read(&args.plant)?, &name, &args.out, false)?;
    let stated = record.stated();
    if common.json {
        crate::cli::print_json(&serde_json::json!({"written": args.out, "kind": record.kind, "stated": stated}))?;
        return Ok(0);
    }
    progress::say(format!("{}: a leaf that is stated, not fitted", args.out.display()));
    stated.into_iter().for_each(|said| progress::say(format!("  {said}")));
    Ok(0)
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.plant.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        return look(args, common);
    }
    let (soup, found) = import(&args.plant, args.unit)?;
    let warnings = strange(&soup, &found);
    let mut summary = summary(&found);
    let mut notes = Vec::new();
    if args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
        claim::file(&args.out, &["glb"], &[&args.plant])?;
        let name = args.plant.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let (plant, made) = plant::plant(&soup, &found, &name);
        write(&plant, &args.out)?;
        summary["blades"] = plant.blades.len().into();
        let [leaves, shapes] = [counted(plant.leaves.len(), "leaf"), counted(plant.blades.len(), "shape")];
        notes.push(format!("{leaves} as instances of {shapes}"));
        for (count, what) in [
            (made.near_branches, "branches that are not attached hang on the nearest one"),
            (made.near_leaves, "leaves that are on no branch hang on the nearest one"),
            (made.still, "other pieces are wood that does not bend, on the nearest branch"),
        ] {
            if count > 0 {
                notes.push(format!("{count} {what}"));
            }
        }
    } else {
        let _claim = claim::folder(&args.out, claim::OutputKind::Import, &[&args.plant])?;
        claim::begin(&args.out, claim::OutputKind::Import)?;
        table::write(&found, &args.out)?;
        let text = serde_json::to_string_pretty(&summary).map_err(|e| crate::cli::Error::write(&args.out, e))?;
        atomic::write_bytes(&args.out.join("import.json"), format!("{text}\n").as_bytes())?;
        claim::finish(&args.out)?;
    }
    for (count, what) in [(found.degenerate, "without an area"), (found.doubled, "that repeat another, as backs do,")] {
        if count > 0 {
            notes.push(format!("{count} triangles {what} were left out"));
        }
    }
    if common.json {
        summary["warnings"] = warnings.into();
        crate::cli::print_json(&summary)?;
        return Ok(0);
    }
    let count = |key: &str| summary[key].as_u64().unwrap_or(0);
    let above = found.branches.iter().filter(|b| b.level.is_none()).count() as u64 - count("unattached");
    let on_these = if above > 0 { format!(", {above} more on these") } else { String::new() };
    progress::say(format!(
        "{}: {} ({} not attached{on_these}), {} ({} on branches), {}",
        args.out.display(),
        counted(found.branches.len(), "branch"),
        count("unattached"),
        counted(found.leaves.len(), "leaf"),
        count("leaves_on_branches"),
        counted(found.others.len(), "other piece")
    ));
    notes.into_iter().for_each(progress::say);
    warnings.into_iter().for_each(|warning| progress::say(format!("warning: {warning}")));
    Ok(0)
}

fn summary(found: &PlantPieces) -> serde_json::Value {
    serde_json::json!({
        "pieces": found.pieces.len(),
        "branches": found.branches.len(),
        "unattached": found.branches.iter().filter(|b| b.unattached.is_some()).count(),
        "levels": found.branches.iter().filter_map(|b| b.level).max().map_or(0, |l| l + 1),
        "leaves": found.leaves.len(),
        "leaves_on_branches": found.leaves.iter().filter(|l| l.joint.is_some()).count(),
        "others": found.others.len(),
        "degenerate_triangles": found.degenerate,
        "doubled_triangles": found.doubled,
    })
}
