//! `mesophyll eval abm`: a leaf's layers, and the light that they reflect, absorb and let through.

use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::progress;
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputRow, InputTable, OutputRow};
use mesophyll_fits::foliar::pigments;
use mesophyll_optics::foliar::goniometer::{self, RINGS, SECTORS};
use mesophyll_optics::foliar::pigments::{LeafContents, OpticalSpectrum, SUBSTANCES};
use mesophyll_optics::foliar::shares::{FoliarMethod, MethodKind, own_seed, shares as of_light, unsettled};
use mesophyll_optics::foliar::{LayeredLeaf, MesophyllPath, Oblateness, fsm, walk};
use mesophyll_optics::side::Side;
use std::path::PathBuf;

/// CSV columns `incidence_deg,side,absorption_per_mm,mesophyll_thickness_mm,n_cuticle,n_mesophyll,n_antidermal` →
/// `reflectance,transmittance,absorptance,surface_reflectance,reflectance_err,transmittance_err,status`.
///
/// The algorithmic BDF model of Baranoski & Rokne (2001): rays meet six interfaces and are turned at random. The exact
/// method solves the equation that the mean of all rays obeys.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval abm"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// monte-carlo: random rays; exact: no noise, 2e-5
    #[arg(long, value_parser = named::<MethodKind>(), default_value_t = MethodKind::MonteCarlo)]
    method: MethodKind,
    /// Rays a row, with the method monte-carlo (default: 1000000, and 10000000 with --goniometer)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    rays: Option<u64>,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Table of specific absorptions and refractive indices; the rows then give wavelength and contents in place of
    /// absorption_per_mm
    #[arg(long, value_name = "TABLE.csv")]
    pigments: Option<PathBuf>,
    /// Write the directions in which light leaves, on patches of 9 by 9 degrees: 800 rows for each case
    #[arg(long, conflicts_with = "table")]
    goniometer: bool,
    /// Write the shares of light that the foliar scattering model looks up, in steps of one degree, at 608, 551 and 465
    /// nm: 181 rows for each case
    #[arg(long)]
    table: bool,
}

const INDICES: [&str; 3] = ["n_cuticle", "n_mesophyll", "n_antidermal"];
const OBLATENESS: [&str; 4] =
    ["oblateness_cuticle", "oblateness_epidermis", "oblateness_palisade", "oblateness_spongy"];
const CONTENTS: [&str; 5] =
    ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "protein_ug_cm2", "cellulose_lignin_ug_cm2", "water_g_cm2"];
const TEXTS: [&str; 2] = ["side", "path"];
const RESULTS: [&str; 6] =
    ["reflectance", "transmittance", "absorptance", "surface_reflectance", "reflectance_err", "transmittance_err"];
const PATCH: [&str; 8] =
    ["patch_zenith", "patch_azimuth", "zenith_deg", "azimuth_deg", "fraction", "fraction_err", "bdf", "bdf_err"];

/// Where the columns of a row are.
struct Reader<'a> {
    names: Vec<String>,
    spectrum: Option<&'a OpticalSpectrum>,
}

/// A row as it is given: everything but the wavelength's part.
struct Case<'a> {
    row: &'a InputRow<'a>,
    reader: &'a Reader<'a>,
}

impl Reader<'_> {
    /// Position of a column in [`InputRow::get`].
    fn place(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }
}

impl Case<'_> {
    /// A number; NaN where the cell is blank or no such column is read.
    fn number(&self, name: &str) -> f64 {
        self.reader.place(name).map_or(f64::NAN, |k| self.row.get(k))
    }

    /// A number of at least 0.
    fn amount(&self, name: &str) -> std::result::Result<f64, String> {
        let x = self.number(name);
        if x >= 0.0 && x.is_finite() { Ok(x) } else { Err(format!("{name} is {x}; expected 0 or more")) }
    }

    /// The light of the row.
    fn light(&self) -> std::result::Result<(Side, f64), String> {
        let incidence = self.number("incidence_deg");
        if !(0.0..90.0).contains(&incidence) {
            return Err(format!("incidence_deg is {incidence}; expected 0 to below 90"));
        }
        let side = self.row.text(0).unwrap_or_default();
        let side = match Side::of_botanical(side) {
            Some(side) => side,
            None if side.is_empty() => return Err("side is empty".into()),
            None => return Err(format!("side is {side:?}; expected adaxial or abaxial")),
        };
        Ok((side, incidence.to_radians()))
    }

    /// The leaf at a wavelength (nm), which only a table of pigments asks for, and its absorption per mm.
    fn leaf(&self, wavelength: f64) -> std::result::Result<(LayeredLeaf, f64), String> {
        let thickness = self.amount("mesophyll_thickness_mm")?;
        let mut indices = INDICES.map(|name| self.number(name));
        let depth = match self.reader.spectrum {
            None => self.amount("absorption_per_mm")? * thickness,
            Some(spectrum) => {
                let Some(constants) = spectrum.at(wavelength) else {
                    let [low, high] = spectrum.range();
                    return Err(format!("wavelength_nm is {wavelength}; the table of pigments has {low} to {high}"));
                };
                let mut per_area = [0.0; SUBSTANCES.len()];
                for (content, name) in per_area.iter_mut().zip(CONTENTS) {
                    *content = self.amount(name)?;
                }
                let scale = match self.reader.place("pigment_scale") {
                    Some(_) => self.amount("pigment_scale")?,
                    None => 1.0,
                };
                for (n, of_table) in indices.iter_mut().zip(constants.indices) {
                    *n = if n.is_nan() { of_table } else { *n };
                }
                constants.depth(&LeafContents { per_area, scale })
            }
        };
        let usual = Oblateness::USUAL;
        let usual = [usual.cuticle, usual.epidermis, usual.palisade, usual.spongy];
        let given = OBLATENESS.map(|name| self.number(name));
        let [cuticle, epidermis, palisade, spongy] =
            std::array::from_fn(|k| if given[k].is_nan() { usual[k] } else { given[k] });
        let path = match self.row.text(1).unwrap_or_default() {
            "" => MesophyllPath::Slant,
            word => word.parse().map_err(|_| format!("path is {word:?}; expected slant or sieve"))?,
        };
        let [n_cuticle, n_mesophyll, n_antidermal] = indices;
        let oblateness = Oblateness { cuticle, epidermis, palisade, spongy };
        let leaf = LayeredLeaf { depth, n_cuticle, n_mesophyll, n_antidermal, oblateness, path };
        match leaf.fault() {
            Some(fault) => Err(fault),
            None => Ok((leaf, if depth == 0.0 { 0.0 } else { depth / thickness })),
        }
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.goniometer && args.method == MethodKind::Exact {
        return Err(Error::Usage(
            "--goniometer needs --method monte-carlo; the exact method knows how much light leaves, not where".into(),
        ));
    }
    let spectrum = args.pigments.as_deref().map(pigments::read).transpose()?;
    let table = InputTable::open(&args.io.input)?;
    let text = |names: &[&str]| names.iter().map(|s| s.to_string()).collect::<Vec<_>>();
    let mut required = text(if args.table { &[] } else { &["incidence_deg"] });
    let mut optional = text(&OBLATENESS);
    required.push("mesophyll_thickness_mm".into());
    if spectrum.is_some() {
        required.extend(text(&CONTENTS));
        if !args.table {
            required.push("wavelength_nm".into());
        }
        if table.column("pigment_scale").is_some() {
            required.push("pigment_scale".into());
        }
        optional.extend(text(&INDICES));
    } else {
        required.push("absorption_per_mm".into());
        required.extend(text(&INDICES));
    }
    if !args.table {
        table.require("side")?;
    }
    let reader = Reader { names: required.iter().chain(&optional).cloned().collect(), spectrum: spectrum.as_ref() };
    let mut spec = BatchSpec { required, optional, texts: text(&TEXTS), ..BatchSpec::default() };
    if args.goniometer || args.table {
        // A case has many rows, so each row states only what tells the cases apart.
        spec.dropped = reader.names.iter().cloned().chain(text(&TEXTS)).collect();
        spec.dropped.extend(text(&["incidence_deg", "wavelength_nm"]));
        if table.column("id").is_none() {
            spec.outputs.push("id".into());
            spec.whole.push("id".into());
        }
    }
    let numbered = !spec.outputs.is_empty();
    if args.goniometer {
        spec.outputs.extend(text(&PATCH));
        spec.whole.extend(text(&PATCH[..2]));
    } else if args.table {
        spec.outputs.push("theta_i_deg".into());
        spec.whole.push("theta_i_deg".into());
        for share in ["rho_s", "rho_d", "tau"] {
            spec.outputs.extend(["r", "g", "b"].map(|channel| format!("{share}_{channel}")));
        }
    } else {
        spec.outputs.extend(text(&RESULTS));
        if spectrum.is_some() {
            spec.outputs.push("absorption_used_per_mm".into());
        }
    }
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        let case = Case { row, reader: &reader };
        let begin = || if numbered { vec![row.number() as f64] } else { Vec::new() };
        let found = if args.table {
            channels(args, &case, begin)
        } else if args.goniometer {
            patches(args, &case, begin)
        } else {
            shares(args, &case).map(|values| vec![values])
        };
        match found {
            Ok(rows) => out.extend(rows.into_iter().map(OutputRow::ok)),
            Err(why) => out.push(OutputRow::refused(why)),
        }
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

/// How the shares are found.
fn method(args: &Args) -> FoliarMethod {
    match args.method {
        MethodKind::Exact => FoliarMethod::Exact,
        MethodKind::MonteCarlo => FoliarMethod::MonteCarlo { rays: args.rays.unwrap_or(1_000_000), seed: args.seed },
    }
}

/// Shares of the light: reflectance, transmittance and their standard errors.
fn outcome(
    args: &Args,
    leaf: &LayeredLeaf,
    side: Side,
    incidence: f64,
) -> std::result::Result<[(f64, f64); 2], String> {
    of_light(leaf, side, incidence, method(args), &progress::stop_requested)
}

fn shares(args: &Args, case: &Case) -> std::result::Result<Vec<f64>, String> {
    let (side, incidence) = case.light()?;
    let (leaf, absorption) = case.leaf(case.number("wavelength_nm"))?;
    let [(r, r_err), (t, t_err)] = outcome(args, &leaf, side, incidence)?;
    let mut values = vec![r, t, 1.0 - r - t, leaf.surface_reflectance(incidence), r_err, t_err];
    if case.reader.spectrum.is_some() {
        values.push(absorption);
    }
    Ok(values)
}

fn patches(args: &Args, case: &Case, begin: impl Fn() -> Vec<f64>) -> std::result::Result<Vec<Vec<f64>>, String> {
    let (side, incidence) = case.light()?;
    let (leaf, _) = case.leaf(case.number("wavelength_nm"))?;
    let rays = args.rays.unwrap_or(10_000_000);
    let seed = own_seed(args.seed, &leaf, side, incidence);
    let seen = walk::directions(&leaf, side, incidence, rays, seed, &progress::stop_requested);
    let row = |ring: usize, sector: usize| {
        let (zenith, azimuth) = goniometer::middle(ring, sector);
        let reading = seen.reading(ring, sector);
        let mut values = begin();
        values.extend([ring as f64, sector as f64, zenith.to_degrees(), azimuth.to_degrees()]);
        values.extend([reading.fraction.0, reading.fraction.1, reading.bdf.0, reading.bdf.1]);
        values
    };
    Ok((0..RINGS).flat_map(|ring| (0..SECTORS).map(move |sector| (ring, sector))).map(|(r, s)| row(r, s)).collect())
}

fn channels(args: &Args, case: &Case, begin: impl Fn() -> Vec<f64>) -> std::result::Result<Vec<Vec<f64>>, String> {
    let mut columns = Vec::new();
    for wavelength in fsm::WAVELENGTHS {
        let (leaf, _) = case.leaf(wavelength)?;
        columns.push(match args.method {
            MethodKind::Exact => fsm::table(&leaf).ok_or_else(unsettled)?,
            MethodKind::MonteCarlo => {
                let row = |k: usize| {
                    let (side, incidence) = fsm::light(k);
                    let [(r, _), (through, _)] = outcome(args, &leaf, side, incidence)?;
                    let surface = leaf.surface_reflectance(incidence);
                    Ok(fsm::FoliarShares { surface, diffuse: (r - surface).max(0.0), through })
                };
                (0..fsm::ROWS).map(row).collect::<std::result::Result<Vec<_>, String>>()?
            }
        });
    }
    let row = |k: usize| {
        let mut values = begin();
        values.push(k as f64);
        values.extend(columns.iter().map(|c| c[k].surface));
        values.extend(columns.iter().map(|c| c[k].diffuse));
        values.extend(columns.iter().map(|c| c[k].through));
        values
    };
    Ok((0..fsm::ROWS).map(row).collect())
}
