//! `mesophyll fit gloss`: traces of a linear light source, or goniometer samples, from CSV.

use crate::cli::names::{named, named_or};
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use clap::builder::TypedValueParser;
use mesophyll_capture::goniometer;
use mesophyll_files::progress::say;
use mesophyll_files::table::{self, BatchIo, InputTable, Omissions, RowTally};
use mesophyll_fits::gloss::geometry::{GlossGeometry, trace_columns};
use mesophyll_fits::gloss::samples::{self, GlossFitSettings, INDEX, LobeChoice, TiltChoice};
use mesophyll_fits::gloss::{GlossTexelFit, GlossTexelFitter, RobustWeighting};
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_optics::tube::TubePrecision;
use std::cell::RefCell;
use std::path::PathBuf;

/// Traces of a linear light source (`--geometry`), or goniometer samples (`--samples`), from CSV: diffuse and glossy
/// reflectance, slope and normal.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit gloss"))]
pub struct Args {
    /// The device (TOML); the input has a trace a row: r0 … r{n-1}, optionally g0 …, b0 …
    #[arg(long, value_name = "GEOMETRY.toml", required_unless_present = "samples", conflicts_with = "samples")]
    geometry: Option<PathBuf>,
    /// The input holds goniometer samples: leaf, source_zenith_deg, view_zenith_deg, view_azimuth_deg and value
    /// columns; or it is a file of a public database, MERL (.binary) or RGL (.bsdf)
    #[arg(long)]
    samples: bool,
    /// With --samples: columns of reflectance factors, by comma (default: those whose names begin with brf)
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',', requires = "samples")]
    values: Vec<String>,
    /// Surface. Where none is named, it is beckmann, and the status says where another one describes a leaf far better
    #[arg(long, value_name = "LOBE", value_parser = lobe_or_auto())]
    lobe: Option<LobeChoice>,
    /// Refractive index of a surface with Fresnel reflectance [default: 1.45]. With --samples also `fit`: it is fitted,
    /// between 1.2 and 1.7
    #[arg(long, value_name = "N|fit", value_parser = index)]
    index: Option<Index>,
    /// With --samples: which tilts of the normal are fitted [default: free]
    #[arg(long, value_parser = named::<TiltChoice>(), requires = "samples")]
    tilt: Option<TiltChoice>,
    /// With --samples: the view azimuth, counted from the source's, at which the mirror side lies [default: 180].
    /// Where it is stated, leaves that seem to lean far are believed
    #[arg(long, value_name = "0|180", value_parser = mirror, requires = "samples")]
    mirror_azimuth: Option<u16>,
    /// With --samples: the readings are per cent
    #[arg(long, requires = "samples")]
    percent: bool,
    /// Gauss-Legendre nodes on half the tube
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(2..=256))]
    quadrature: u16,
    /// Rejection of outliers. auto: only where the stated noise does not explain the residuals; off: never; on: always
    #[arg(long, value_parser = named::<RobustWeighting>(), default_value_t = RobustWeighting::Auto)]
    robust: RobustWeighting,
    #[command(flatten)]
    io: BatchIo,
}

/// What `--lobe auto` does, for the help.
const AUTO: &str = "With --samples: the one that describes a leaf best; by how much is said";

/// An index of refraction, or that it is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Index {
    Of(f64),
    Fit,
}

fn index(text: &str) -> std::result::Result<Index, String> {
    if text == "fit" {
        return Ok(Index::Fit);
    }
    let read: Option<f64> = text.parse().ok();
    read.filter(|n| *n > 1.0 && *n < 4.0)
        .map(Index::Of)
        .ok_or_else(|| "expected more than 1 and less than 4, or fit".to_string())
}

fn lobe_or_auto() -> impl TypedValueParser<Value = LobeChoice> {
    named_or::<LobeKind>("auto", AUTO).map(|kind| kind.map_or(LobeChoice::Auto, LobeChoice::Of))
}

fn mirror(text: &str) -> std::result::Result<u16, String> {
    match text {
        "0" => Ok(0),
        "180" => Ok(180),
        _ => Err("expected 0 or 180".into()),
    }
}

/// The lobe, as every verb takes it.
#[derive(Debug, Clone, clap::Args)]
pub struct LobeArgs {
    /// Surface: W's Beckmann form, the long-tailed one, and both with Fresnel reflectance and masking
    #[arg(long, value_parser = named::<LobeKind>(), default_value_t = LobeKind::Beckmann)]
    lobe: LobeKind,
    /// Refractive index of the surface, with --lobe cook-torrance or ggx-fresnel
    #[arg(long, value_name = "N", default_value_t = 1.45)]
    index: f64,
}

impl LobeArgs {
    pub fn lobe(&self) -> Result<Lobe> {
        if self.lobe.has_index() && !(self.index > 1.0 && self.index < 4.0) {
            return Err(Error::Usage(format!("--index: found {}, expected more than 1 and less than 4", self.index)));
        }
        Ok(Lobe::of(self.lobe, self.index))
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (tally, row) = match &args.geometry {
        Some(path) => (traces(args, common, &GlossGeometry::read(path)?, args.one_lobe()?)?, "row"),
        None => {
            let settings = args.settings()?;
            let (table, values) = directions(args)?;
            (samples::run(table, &args.io.rows(common.json), &values, &settings)?, "leaf")
        }
    };
    batch::say_tally(&tally, &args.io, common, row)?;
    if args.geometry.is_some() && args.lobe.is_none() {
        say(format!(
            "no lobe was stated and {} taken: another one may describe a trace as well, with another m and rho_s; \
             --lobe states it",
            LobeKind::default()
        ));
    }
    Ok(0)
}

impl Args {
    /// The lobe of traces, which is one for all.
    fn one_lobe(&self) -> Result<Lobe> {
        let kind = match self.lobe.unwrap_or_default() {
            LobeChoice::Auto => return Err(Error::Usage("--lobe auto: only --samples has it".into())),
            LobeChoice::Usual => LobeKind::default(),
            LobeChoice::Of(kind) => kind,
        };
        match self.index {
            Some(Index::Fit) => Err(Error::Usage("--index fit: only --samples has it".into())),
            Some(Index::Of(index)) => Ok(Lobe::of(kind, index)),
            None => Ok(Lobe::of(kind, INDEX)),
        }
    }

    /// How goniometer samples are fitted.
    fn settings(&self) -> Result<GlossFitSettings> {
        let surface = self.lobe.unwrap_or_default();
        let without = match surface {
            LobeChoice::Of(kind) => (!kind.has_index() && self.index.is_some()).then_some(kind),
            LobeChoice::Usual => (self.index == Some(Index::Fit)).then(LobeKind::default),
            LobeChoice::Auto => None,
        };
        if let Some(lobe) = without {
            return Err(Error::Usage(format!(
                "--index: the {lobe} lobe has no refractive index; expected --lobe cook-torrance, ggx-fresnel or auto \
                 with it"
            )));
        }
        let index = match self.index {
            Some(Index::Fit) => None,
            Some(Index::Of(index)) => Some(index),
            None => Some(INDEX),
        };
        Ok(GlossFitSettings {
            surface,
            index,
            tilts: self.tilt.unwrap_or_default(),
            mirror_azimuth: self.mirror_azimuth,
            percent: self.percent,
        })
    }
}

/// Goniometer samples from a table or from a file of a public database, and the columns that are fitted.
fn directions(args: &Args) -> Result<(InputTable, Vec<String>)> {
    let path = &args.io.input;
    if !goniometer::is_goniometer(path) {
        return Ok((InputTable::open(path)?, args.values.clone()));
    }
    let readings = goniometer::GoniometerReadings::read(path)?;
    let leaf = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let csv = std::io::Cursor::new(readings.csv(&leaf).into_bytes());
    let values = if args.values.is_empty() { readings.chosen } else { args.values.clone() };
    Ok((InputTable::from_reader(Box::new(csv), path.clone())?, values))
}

fn traces(args: &Args, common: &CommonArgs, geometry: &GlossGeometry, lobe: Lobe) -> Result<RowTally> {
    let table = InputTable::open(&args.io.input)?;
    let frames = geometry.frames_u().len();
    let columns = trace_columns(&table, frames)?;
    let channels = columns.len();
    let mut fitter = GlossTexelFitter::with_precision(
        &geometry.device(lobe),
        &geometry.positions_mm(),
        None,
        &TubePrecision { along: args.quadrature.into(), ..TubePrecision::default() },
    );
    fitter.robust = args.robust;
    let columns: Vec<String> = columns.concat();
    let spec = table::BatchSpec {
        // An empty cell is no reading.
        optional: columns.clone(),
        readings: columns.clone(),
        // The status of an earlier step (`eval gloss`) is replaced by that of this one.
        dropped: columns.into_iter().chain(["status".into()]).collect(),
        outputs: GlossTexelFit::outputs(channels),
        ..table::BatchSpec::default()
    };
    let (name, left) = (table.name().to_path_buf(), Omissions::default());
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        row.faults().for_each(|(_, why)| left.add(row.line(), why));
        let value = |c: usize, k: usize| if c < channels { row.get(c * frames + k) as f32 } else { f32::NAN };
        let trace: Vec<[f32; 3]> = (0..frames).map(|k| std::array::from_fn(|c| value(c, k))).collect();
        thread_local!(static SCRATCH: RefCell<mesophyll_fits::gloss::GlossFitWorkspace> = RefCell::default());
        let (fit, found) = SCRATCH.with_borrow_mut(|ws| {
            let fit = fitter.fit(ws, [0.0; 2], &trace, None);
            let found = fitter.judge(ws, &trace, &fit);
            (fit, found)
        });
        out.push(fit.judged(found.as_ref(), channels));
    })?;
    left.say(&name);
    Ok(tally)
}
