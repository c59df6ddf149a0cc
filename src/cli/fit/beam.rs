//! `mesophyll fit beam`: coefficients of a taper, the basis of all tapers, or taper and stiffness from measured
//! deflections.

use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, destination, tables};
use crate::cli::{Error, Result};
use mesophyll_files::claim::{self, OutputKind};
use mesophyll_files::progress::say;
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputTable, TableSink};
use mesophyll_fits::branch::beam::fit::PositionReference;
use mesophyll_fits::branch::beam::record::BranchFitRequest;
use mesophyll_fits::branch::beam::{self, basis, deflections, record};
use mesophyll_plants::mechanics::load::Load;
use mesophyll_proof::beam::charts;
use mesophyll_proof::beam::figures;
use std::path::{Path, PathBuf};

/// CSV column `alpha` → `c2,c4,max_error` (u = c2 x² + c4 x⁴ by least squares over even samples; largest error over all
/// x), then `a2,a3,a4,a5,a_max_error`: u = a2 y² + a3 y³ + a4 y⁴ + a5 y⁵ with y = ln(1 + (alpha − 1)x)/ln(alpha), from
/// coefficients that are smooth in the taper.
///
/// With --deflections: CSV columns `branch,length_mm,position_mm,deflection_mm`, optionally `deflection_err_mm`,
/// `load_n`, `load_err_n`, `modulus_gpa`, `modulus_err_gpa` (the load is the whole load, spread evenly) → a row a
/// branch: `alpha`, `load_over_stiffness_mm` = F/(E′r1⁴) = F L³/(E s1⁴), `root_radius_mm` = s1, `tip_mm`, each with
/// `_err`, then `correlation,chi2,rms_mm,readings,status`. Load, modulus and root radius cannot be told apart by
/// deflections; the radius needs the other two.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit beam"))]
pub struct Args {
    /// CSV to read (`-`: standard input)
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    input: PathBuf,
    /// CSV to write (default and `-`: standard output). With --basis it is the folder of the fit. With --deflections it
    /// may be given twice: a name without a file ending is the folder of the fit, one with an ending (rows.csv) the CSV
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE|DIR")]
    output: Vec<PathBuf>,
    /// Even samples from x = 0 to 1, both included; 101 is the dissertation's
    #[arg(long, value_name = "N", default_value_t = 101, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    samples: u32,
    /// Measured deflections (CSV, `-`: standard input)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["basis", "pictures", "input"])]
    deflections: Option<PathBuf>,
    /// With --deflections: what positions were measured along
    #[arg(long, value_parser = named::<PositionReference>(), default_value_t = PositionReference::Branch,
        requires = "deflections")]
    positions: PositionReference,
    /// With --deflections: how the load hangs on the branch: tip, even (along the branch), own-weight (in proportion to
    /// the cross-section), or the distance of a single load from the root, up to 1 as a share of the length and above 1
    /// in mm. Without it the load is taken as even, and a branch whose readings leave another load with another taper
    /// open is undetermined
    #[arg(long, value_name = "LOAD", requires = "deflections")]
    load: Option<Load>,
    /// With --deflections: standard error of a deflection where the file states none (default: from the scatter)
    #[arg(long, value_name = "MM", requires = "deflections")]
    noise: Option<f64>,
    /// Fit the coefficients of all tapers and write them to the folder of -o
    #[arg(long, requires = "output")]
    basis: bool,
    /// Write the documentation pictures beam-*.svg into this folder
    #[arg(long, value_name = "DIR", value_parser = destination::folder())]
    pictures: Option<PathBuf>,
}

/// What `-o, --out` names: the place for rows, and the folder of the fit, if any.
fn places(args: &Args) -> Result<(PathBuf, Option<PathBuf>)> {
    let is_folder = |path: &&PathBuf| match args.deflections {
        Some(_) => !destination::is_stdout(path) && (path.is_dir() || (!path.exists() && path.extension().is_none())),
        None => args.basis,
    };
    let (folders, files): (Vec<&PathBuf>, Vec<&PathBuf>) = args.output.iter().partition(is_folder);
    if folders.len() > 1 || files.len() > 1 {
        let names: Vec<String> = args.output.iter().map(|p| p.display().to_string()).collect();
        let expected = "at most one CSV, and with --deflections one folder besides";
        return Err(Error::Usage(format!("-o, --out: found {}; expected {expected}", names.join(" and "))));
    }
    if let (true, Some(folder)) = (args.basis, folders.first().filter(|f| destination::is_stdout(f))) {
        return Err(Error::Usage(format!("-o {}: --basis writes a folder, expected its name", folder.display())));
    }
    Ok((files.first().map_or_else(|| "-".into(), |f| f.to_path_buf()), folders.first().map(|f| f.to_path_buf())))
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (output, folder) = places(args)?;
    let io = BatchIo { input: args.input.clone(), output };
    if let Some(path) = &args.deflections {
        return from_deflections(args, path, &io, folder.as_deref(), common);
    }
    if args.basis || args.pictures.is_some() {
        if let Some(folder) = &folder {
            basis_to(folder, common)?;
        }
        if let Some(folder) = &args.pictures {
            let _claim = claim::folder(folder, OutputKind::Pictures, &[])?;
            let files = charts::write(folder, &figures::all())?;
            if common.json && !args.basis {
                crate::cli::print_json(&serde_json::json!({ "written": files }))?;
            }
            files.iter().for_each(|file| say(format!("wrote {}", file.display())));
        }
        return Ok(0);
    }
    let spec = BatchSpec {
        required: vec!["alpha".into()],
        outputs: beam::OUTPUTS.iter().map(|s| s.to_string()).collect(),
        ..BatchSpec::default()
    };
    let tally = table::run(InputTable::open(&io.input)?, &io.rows(common.json), &spec, |row, out| {
        out.push(beam::coefficients(row.get(0), args.samples as usize));
    })?;
    batch::say_tally(&tally, &io, common, "row")?;
    Ok(0)
}

fn basis_to(folder: &Path, common: &CommonArgs) -> Result<()> {
    let (record, seconds) = record::basis_to(folder)?;
    if common.json {
        crate::cli::print_json(&record)?;
    } else {
        let (worst, at) = basis::smooth().1.worst();
        say(format!(
            "coefficients of all tapers: worst error {:.2} % of the tip's deflection, at alpha {at:.1e}; fitted in \
             {:.1} ms",
            100.0 * worst,
            1e3 * seconds
        ));
    }
    Ok(())
}

fn from_deflections(args: &Args, path: &Path, io: &BatchIo, folder: Option<&Path>, common: &CommonArgs) -> Result<u8> {
    deflections::check_noise(args.noise)?;
    let sink = TableSink::open(&io.rows(common.json), path)?;
    let (branches, fits) =
        record::branches_to(path, folder, args.noise, BranchFitRequest { along: args.positions, load: args.load })?;
    deflections::notes(&branches, &fits, args.load).into_iter().for_each(say);
    let tally = deflections::write(&branches, &fits, sink)?;
    batch::say_tally(&tally, io, common, "branch")?;
    Ok(0)
}
