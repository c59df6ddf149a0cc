//! `mesophyll eval fsm`: the parts of the foliar scattering model, one a row.

use crate::cli::Result;
use crate::cli::{CommonArgs, batch, tables};
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputRow, InputTable, OutputRow};
use mesophyll_optics::foliar::goniometer::{RINGS, SECTORS};
use mesophyll_optics::foliar::{fsm, lobe};

/// CSV column `kind` and what that kind needs → `value` and others: lobes, rules and errors of the foliar scattering
/// model of Baranoski & Rokne (2001).
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval fsm"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
}

const INPUTS: [&str; 20] = [
    "oblateness",
    "xi1",
    "xi2",
    "incidence_deg",
    "zenith_deg",
    "azimuth_deg",
    "r",
    "g",
    "b",
    "source_deg",
    "rho_s",
    "rho_d",
    "tau",
    "nx",
    "ny",
    "nz",
    "rx",
    "ry",
    "rz",
    "patch_zenith",
];
const PATCH_AZIMUTH: &str = "patch_azimuth";
const OUTPUTS: [&str; 7] = ["alpha_e_deg", "beta_e_deg", "alpha_m_deg", "beta_m_deg", "value", "acceptance", "cut"];
const KINDS: &str = "angles, surface_pdf, luminance, direct, theta, rms or patch";

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let table = InputTable::open(&args.io.input)?;
    table.require("kind")?;
    let spec = BatchSpec {
        optional: INPUTS.iter().chain(&[PATCH_AZIMUTH]).map(|s| s.to_string()).collect(),
        outputs: OUTPUTS.iter().map(|s| s.to_string()).collect(),
        whole: vec!["cut".into()],
        texts: vec!["kind".into(), "differences".into()],
        ..BatchSpec::default()
    };
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        out.push(evaluate(row).map_or_else(OutputRow::refused, OutputRow::ok));
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

/// A number that must be there and in a range.
fn number(row: &InputRow, name: &str, least: f64, most: f64) -> std::result::Result<f64, String> {
    let k = INPUTS.iter().position(|n| *n == name).unwrap_or(INPUTS.len());
    let x = row.get(k);
    if x.is_nan() {
        Err(format!("{name} is empty"))
    } else if !(least..=most).contains(&x) {
        Err(format!("{name} is {x}; expected {least} to {most}"))
    } else {
        Ok(x)
    }
}

fn evaluate(row: &InputRow) -> std::result::Result<Vec<f64>, String> {
    let get = |name: &str, least: f64, most: f64| number(row, name, least, most);
    let any = |name: &str| number(row, name, -f64::MAX, f64::MAX);
    let angle = |name: &str, most: f64| Ok::<f64, String>(get(name, 0.0, most)?.to_radians());
    let oblateness = || get("oblateness", 0.0, f64::MAX);
    let mut values = vec![f64::NAN; OUTPUTS.len()];
    let kind = row.text(0).unwrap_or_default();
    match kind {
        "angles" => {
            let (ob, xi1, xi2) = (get("oblateness", 0.0, f64::INFINITY)?, get("xi1", 0.0, 1.0)?, get("xi2", 0.0, 1.0)?);
            values[0] = lobe::polar(xi1, ob).to_degrees();
            values[1] = 360.0 * xi2;
            // the Lambertian lobes of Eq. 3
            values[2] = xi1.sqrt().acos().to_degrees();
            values[3] = 360.0 * xi2;
        }
        "surface_pdf" => {
            let (incidence, ob) = (angle("incidence_deg", 90.0)?, oblateness()?);
            let (zenith, azimuth) = (angle("zenith_deg", 180.0)?, any("azimuth_deg")?.to_radians());
            let acceptance = lobe::acceptance(incidence, ob);
            values[4] = fsm::surface_density(incidence, ob, zenith, azimuth, acceptance);
            values[5] = acceptance;
        }
        "luminance" => {
            let rgb = [get("r", 0.0, f64::MAX)?, get("g", 0.0, f64::MAX)?, get("b", 0.0, f64::MAX)?];
            values[4] = fsm::luminance(rgb);
            values[6] = f64::from(values[4] < fsm::CUT);
        }
        "direct" => {
            let (incidence, source) = (angle("incidence_deg", 180.0)?, angle("source_deg", 180.0)?);
            values[4] = fsm::direct(incidence, source, get("rho_d", 0.0, 1.0)?, get("tau", 0.0, 1.0)?);
        }
        "theta" => {
            let normal = [any("nx")?, any("ny")?, any("nz")?];
            let ray = [any("rx")?, any("ry")?, any("rz")?];
            if let Some((what, names)) = [(normal, "nx, ny, nz"), (ray, "rx, ry, rz")].iter().find(|v| v.0 == [0.0; 3])
            {
                return Err(format!("{names} are {what:?}; expected a direction"));
            }
            values[4] = fsm::theta(normal, ray).to_degrees();
        }
        "rms" => {
            let text = row.text(1).unwrap_or_default();
            let differences: std::result::Result<Vec<f64>, String> = text
                .split_whitespace()
                .map(|word| match word.parse::<f64>() {
                    Ok(x) if x.is_finite() => Ok(x),
                    _ => Err(format!("differences has {word:?}; expected numbers with blanks between them")),
                })
                .collect();
            let differences = differences?;
            if differences.is_empty() {
                return Err("differences is empty".into());
            }
            let squares: f64 = differences.iter().map(|d| d * d).sum();
            values[4] = (squares / differences.len() as f64).sqrt();
        }
        "patch" => {
            let (incidence, ob) = (angle("incidence_deg", 90.0)?, oblateness()?);
            let shares = fsm::FoliarShares {
                surface: get("rho_s", 0.0, 1.0)?,
                diffuse: get("rho_d", 0.0, 1.0)?,
                through: get("tau", 0.0, 1.0)?,
            };
            let index = |name: &str, count: usize| -> std::result::Result<usize, String> {
                let x = get(name, 0.0, (count - 1) as f64)?;
                if x.fract() == 0.0 { Ok(x as usize) } else { Err(format!("{name} is {x}; expected a whole number")) }
            };
            let (ring, sector) = (index("patch_zenith", RINGS)?, index(PATCH_AZIMUTH, SECTORS)?);
            values[4] = fsm::patch(incidence, ob, shares, ring, sector);
        }
        "" => return Err("kind is empty".into()),
        _ => return Err(format!("kind is {kind:?}; expected {KINDS}")),
    }
    Ok(values)
}
