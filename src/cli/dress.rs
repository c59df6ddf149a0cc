//! `mesophyll dress`: fitted leaves on a plant that another program wrote.

use crate::cli::{CommonArgs, Error, Result};
use mesophyll_export::dress::{LeafReplacement, Options, dress};
use mesophyll_files::table::counted;
use mesophyll_files::{claim, progress};
use std::path::PathBuf;

/// Puts fitted leaves on a plant from elsewhere: named materials of a glTF file become those of fits, all else stays.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
     mesophyll dress plant.glb --leaf Leaves=fits/elm -o out/plant.glb\n  \
     mesophyll dress out/cherry.glb --leaf leaf=fits/elm --make-uv -o out/cherry-elm.glb\n  \
     mesophyll dress plant.glb --leaf Leaves=fits/elm --leaf Buds=fits/balata --make-uv -o out/plant.glb\n\n\
     Every mesh with the material shows the fit's front on its front and the fit's back behind: colour, light that\n\
     shines through (KHR_materials_diffuse_transmission), gloss and normals. docs/export.md says what is lost, and\n\
     OUT.glb.loss.json keeps it as numbers. A material without a name is called by its number, from 0.\n\
     Where no material has the name, a mesh or a node of that name is dressed.")]
pub struct Args {
    /// The plant (.glb or .gltf)
    #[arg(value_name = "PLANT.glb")]
    plant: PathBuf,
    /// A material of the plant and the folder of the leaf fit that takes its place; may be repeated
    #[arg(long = "leaf", value_name = "MATERIAL=FIT", required = true, value_parser = leaf)]
    leaves: Vec<LeafReplacement>,
    /// Make texture coordinates along each flat piece also where the file has its own: for cards that show a part of a
    /// picture of many leaves, and for leaves of `mesophyll grow`
    #[arg(long)]
    make_uv: bool,
    /// Scatter leaves over flat pieces that are more than three times as long as the fitted blade, such as cards of
    /// whole twigs; where the former picture was cut out, leaves lie where it was opaque
    #[arg(long)]
    scatter: bool,
    /// File to write (.glb)
    #[arg(short, long, alias = "output", value_name = "OUT.glb")]
    out: PathBuf,
}

/// `MATERIAL=FIT`. Names of materials are free, so the last `=` divides.
fn leaf(text: &str) -> std::result::Result<LeafReplacement, String> {
    match text.rsplit_once('=') {
        Some((material, fit)) if !material.is_empty() && !fit.is_empty() => {
            Ok(LeafReplacement { material: material.into(), fit: fit.into() })
        }
        _ => Err("expected MATERIAL=FIT, a material of the plant and a fit folder".into()),
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.out.is_dir() {
        return Err(Error::Usage(format!("{}: found a folder, expected the name of a file", args.out.display())));
    }
    if crate::cli::destination::is_stdout(&args.out) {
        return Err(Error::Usage("-o -: two files are written; expected a name, not standard output".into()));
    }
    claim::file(&args.out, &["glb"], &[&args.plant])?;
    for leaf in &args.leaves {
        crate::cli::preparation::fit(&leaf.fit)?;
    }
    let options = Options { make_uv: args.make_uv, scatter: args.scatter };
    let done = dress(&args.plant, &args.leaves, options, &args.out)?;
    done.warnings.iter().for_each(progress::say);
    let [area, kept] = done.area;
    let share = (area > 0.0).then(|| kept / area);
    if common.json {
        let files: Vec<String> = done.exported.files.iter().map(|p| p.display().to_string()).collect();
        crate::cli::print_json(&serde_json::json!({
            "written": files, "primitives": done.primitives, "triangles": done.triangles,
            "triangles_with_made_uv": done.made, "scattered": done.scattered, "share_on_the_blade": share,
            "warnings": done.warnings, "undressed": done.undressed,
            "loss": done.exported.lost.as_ref().map(|lost| lost.json()),
        }))?;
        return Ok(0);
    }
    progress::say(format!(
        "{}: {} dressed in {}, {} of them with texture coordinates that were made",
        args.out.display(),
        counted(done.triangles, "triangle"),
        counted(done.primitives, "primitive"),
        done.made
    ));
    if done.scattered > 0 {
        progress::say(format!("{} scattered over cards of twigs", counted(done.scattered, "leaf")));
    }
    if let Some(share) = share {
        progress::say(format!("{:.0} % of the dressed area shows the fitted blade", 100.0 * share));
    }
    // What could not be dressed is among what is lost.
    done.exported.lost.iter().flat_map(|lost| lost.lines()).for_each(progress::say);
    Ok(0)
}
