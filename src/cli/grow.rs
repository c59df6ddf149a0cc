//! `mesophyll grow`: a description in, a plant out.

use crate::cli::{CommonArgs, Result};
use mesophyll_files::{claim, progress};
use mesophyll_plants::file;
use mesophyll_plants::form::Plant;
use mesophyll_plants::growth::described;
use std::path::PathBuf;

/// Grows a plant or a meadow from its description and writes it as glTF: a node a branch, leaves as instances.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
     mesophyll grow data/plants/wych-elm.toml -o out/elm.glb\n  \
     mesophyll grow data/plants/bird-cherry-sapling.toml -o out/sapling.glb --seed 3\n  \
     mesophyll grow data/grass/lawn.toml -o out/lawn.glb\n\n\
     The description is explained in data/plants/README.md and data/grass/README.md, the file in docs/plants.md.")]
pub struct Args {
    /// Description of the plant, such as data/plants/wych-elm.toml or data/grass/lawn.toml
    #[arg(value_name = "SPEC.toml")]
    spec: PathBuf,
    /// File to write (.glb)
    #[arg(short, long, alias = "output", value_name = "PLANT.glb")]
    out: PathBuf,
    /// Another plant of the same kind; default: the description's own seed
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let plant = described(&args.spec, args.seed)?;
    claim::file(&args.out, &["glb"], &[&args.spec])?;
    file::write(&plant, &args.out)?;
    let [vertices, triangles] = size(&plant);
    let levels = plant.branches.iter().map(|b| b.level + 1).max().unwrap_or(0);
    let (branches, leaves) = (plant.branches.len(), plant.leaves.len());
    if common.json {
        crate::cli::print_json(&serde_json::json!({
            "file": args.out, "name": plant.name, "branches": branches, "levels": levels, "leaves": leaves,
            "vertices": vertices, "triangles": triangles,
        }))?;
    } else {
        progress::say(format!(
            "{}: {branches} branches of {levels} levels, {leaves} leaves, {vertices} vertices, {triangles} triangles",
            args.out.display()
        ));
    }
    Ok(0)
}

/// Number of vertices and triangles as they are drawn: those of a blade count for every leaf.
fn size(plant: &Plant) -> [usize; 2] {
    let blades = plant.leaves.iter().map(|leaf| &plant.blades[leaf.blade].mesh);
    let meshes = plant.branches.iter().map(|b| &b.wood).chain(blades);
    meshes.fold([0, 0], |[v, t], mesh| [v + mesh.positions.len(), t + mesh.triangles()])
}
