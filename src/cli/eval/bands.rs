//! `mesophyll eval bands`: spectra in, what bands see of them out.

use super::bands_response::{BandResponse, ResponseChoice};
use crate::cli::Result;
use crate::cli::fit::check_noise;
use crate::cli::{CommonArgs, batch, tables};
use mesophyll_files::spectra::{self, ReadingUnit, SpectrumColumn};
use mesophyll_files::table::{BatchIo, BatchSpec, InputTable, Omissions, OutputRow, PhysicalRange, RowTally, Status};

/// CSV columns `leaf,wavelength_nm,R,T` (a row a wavelength), or `R400,T400,R410,…` (a row a leaf) → the three bands of
/// a published response: `r_r,r_g,r_b` of R and `t_r,t_g,t_b` of T, their standard errors, `status`. Of bands of your
/// own, the columns have their names: `r_490`.
///
/// Scenes state a leaf by three such numbers (`uniform`). The light is that of CIE D65 for the published responses, and
/// even for bands of your own.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval bands"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// The bands: srgb is linear sRGB, unclamped, of which white is 1, 1, 1; cie-1931 is X, Y, Z of the CIE 1931
    /// standard observer; centre:width in nm are boxes, which see all their wavelengths alike; a table has the column
    /// wavelength_nm and a column with the response of each band, by any name
    #[arg(long, value_name = "srgb|cie-1931|490:65,560:35,…|FILE.csv", default_value = "srgb")]
    response: ResponseChoice,
    /// Absolute standard error of R and T, where a cell has none of its own; 0 for exact values (default: not known,
    /// the error cells stay empty)
    #[arg(long, value_name = "S")]
    noise: Option<f64>,
    /// R and T, and their errors, are in per cent; --noise stays a share of 1
    #[arg(long)]
    percent: bool,
}

/// What the command takes, for messages.
const TAKES: &str = "eval bands takes R and T with a wavelength in nm, such as R450, T450, or spectra in long form: \
                     leaf, wavelength_nm, R, T";

/// A reading: which quantity, the wavelength (nm), the value and its standard error.
type Sample = (usize, f64, f64, f64);

/// The quantities of a table, each with the beginning of its output columns.
struct Quantities(Vec<(bool, bool)>);

impl Quantities {
    fn of(columns: &[SpectrumColumn]) -> Quantities {
        let mut found: Vec<(bool, bool)> = columns.iter().map(|c| (c.through, c.is_abaxial())).collect();
        found.sort_unstable();
        found.dedup();
        Quantities(found)
    }

    fn place(&self, column: &SpectrumColumn) -> usize {
        self.0.iter().position(|q| *q == (column.through, column.is_abaxial())).unwrap_or(0)
    }

    fn outputs(&self, response: &BandResponse) -> Vec<String> {
        let of = |(through, back): &(bool, bool)| {
            let start = format!("{}{}", if *through { "t" } else { "r" }, if *back { "_abaxial" } else { "" });
            response.names().into_iter().map(|name| format!("{start}_{name}")).collect::<Vec<String>>()
        };
        let values: Vec<String> = self.0.iter().flat_map(of).collect();
        let errors = values.iter().map(|name| format!("{name}_err"));
        values.iter().cloned().chain(errors).collect()
    }

    /// The bands of one leaf; those of a quantity without a reading stay empty.
    fn answer(&self, response: &BandResponse, noise: Option<f64>, mut samples: Vec<Sample>) -> OutputRow {
        samples.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (mut values, mut errors, bands) = (Vec::new(), Vec::new(), response.names().len());
        for (k, (through, _)) in self.0.iter().enumerate() {
            let own: Vec<&Sample> = samples.iter().filter(|s| s.0 == k).collect();
            if own.is_empty() {
                values.extend(vec![f64::NAN; bands]);
                errors.extend(vec![f64::NAN; bands]);
                continue;
            }
            let name = if *through { "T" } else { "R" };
            let wavelengths: Vec<f64> = own.iter().map(|s| s.1).collect();
            if let Some(pair) = wavelengths.windows(2).find(|pair| pair[0] == pair[1]) {
                return OutputRow::refused(format!("{name} is given twice at {} nm", pair[0]));
            }
            let weights = match response.weights(&wavelengths) {
                Ok(weights) => weights,
                Err(why) => return OutputRow::refused(format!("{name}: {why}")),
            };
            let error = |s: &Sample| if s.3.is_nan() { noise.unwrap_or(f64::NAN) } else { s.3 };
            for weights in &weights {
                values.push(own.iter().zip(weights).map(|(s, w)| w * s.2).sum());
                let squares: f64 = own.iter().zip(weights).map(|(s, w)| (w * error(s)).powi(2)).sum();
                errors.push(squares.sqrt());
            }
        }
        if values.iter().all(|v| v.is_nan()) {
            return OutputRow::refused("no reading");
        }
        values.extend(errors);
        OutputRow { values, status: Status::Ok }
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    check_noise(args.noise)?;
    let response = args.response.read()?;
    let table = spectra::open(&args.io.input)?;
    let tally = match spectra::long(&table)? {
        Some(form) => long(args, &response, common, table, &form)?,
        None => wide(args, &response, common, table)?,
    };
    batch::say_tally(&tally, &args.io, common, "leaf")?;
    Ok(0)
}

fn spec(columns: &[SpectrumColumn], outputs: Vec<String>) -> BatchSpec {
    let readings: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let errors: Vec<String> = columns.iter().map(|c| c.error.clone()).collect();
    BatchSpec {
        optional: [&readings[..], &errors].concat(),
        outputs,
        readings: [&readings[..], &errors].concat(),
        physical: vec![PhysicalRange::shares(readings), PhysicalRange::not_negative(errors)],
        ..BatchSpec::default()
    }
}

/// A row a leaf.
fn wide(args: &Args, response: &BandResponse, common: &CommonArgs, table: InputTable) -> Result<RowTally> {
    let found = spectra::wide(&table);
    if found.readings.is_empty() {
        return Err(spectra::nothing(&table, &found, TAKES));
    }
    let (columns, n) = (&found.readings, found.readings.len());
    let quantities = Quantities::of(columns);
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&table, &names, args.percent)?;
    shares.check_noise(&table, &names, args.noise)?;
    let spec = spec(columns, quantities.outputs(response));
    let (name, left) = (table.name().to_path_buf(), Omissions::default());
    let tally = mesophyll_files::table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        if let Some(why) = shares.refuse_each(names.iter().map(String::as_str).zip(row.all().iter().copied())) {
            return out.push(OutputRow::refused(why));
        }
        row.faults().for_each(|(_, why)| left.add(row.line(), why.to_string()));
        let sample = |(k, c): (usize, &SpectrumColumn)| {
            let (value, err) = (shares.scale * row.get(k), shares.scale * row.get(n + k));
            value.is_finite().then(|| (quantities.place(c), c.wavelength, value, err))
        };
        let samples = columns.iter().enumerate().filter_map(sample).collect();
        out.push(quantities.answer(response, args.noise, samples));
    })?;
    left.say(&name);
    Ok(tally)
}

/// A row a wavelength.
fn long(
    args: &Args,
    response: &BandResponse,
    common: &CommonArgs,
    table: InputTable,
    form: &spectra::LongSpectra,
) -> Result<RowTally> {
    let (columns, n) = (&form.readings, form.readings.len());
    if columns.is_empty() {
        return Err(spectra::nothing(&table, &spectra::wide(&table), TAKES));
    }
    let quantities = Quantities::of(columns);
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&table, &names, args.percent)?;
    shares.check_noise(&table, &names, args.noise)?;
    let mut spec = spec(columns, quantities.outputs(response));
    spec.required = vec![form.wavelength.clone()];
    spec.physical.push(PhysicalRange::not_negative(spec.required.clone()));
    let groups = spectra::leaves(table, &spec)?;
    let tally = groups.run(&args.io.rows(common.json), &spec, |_, rows, _| {
        let mut samples = Vec::new();
        for row in rows {
            let cells = &row.values[1..];
            if let Some(why) = shares.refuse_each(names.iter().map(String::as_str).zip(cells.iter().copied())) {
                return OutputRow::refused(format!("line {}: {why}", row.line));
            }
            let nm = spectra::in_nm(row.values[0], form.unit_nm);
            for (k, c) in columns.iter().enumerate().filter(|(k, _)| cells[*k].is_finite()) {
                samples.push((quantities.place(c), nm, shares.scale * cells[k], shares.scale * cells[n + k]));
            }
        }
        quantities.answer(response, args.noise, samples)
    })?;
    Ok(tally)
}
