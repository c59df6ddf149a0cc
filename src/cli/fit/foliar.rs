//! `mesophyll fit foliar`: R and T at some wavelengths in, pigments and the epidermis's oblateness out.

use super::foliar_plots::{self, PlottedReading};
use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::spectra::{self, LongSpectra, ReadingUnit, SpectrumColumn};
use mesophyll_files::table::{
    Batch, BatchIo, BatchSpec, GroupRow, InputTable, Omissions, OutputRow, PhysicalRange, RowTally, counted,
};
use mesophyll_files::{atomic, progress};
use mesophyll_fits::foliar::surface::{FoliarFitSetting, MOST_OBLATE};
use mesophyll_fits::foliar::{FoliarFitConstants, FoliarFitModel, FoliarParameter, FoliarReading, pigments};
use mesophyll_fits::plates;
use mesophyll_fits::plates::reading::side;
use mesophyll_optics::foliar::pigments::OpticalSpectrum;
use mesophyll_optics::foliar::{MesophyllPath, Oblateness};
use mesophyll_optics::side::Side;
use mesophyll_report::spectrum::{self, SpectrumPanel};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// CSV columns `R450,T450,R550,…` (reflectance and transmittance by wavelength in nm) → the parameters asked for, their
/// standard errors, `rms,minima,status`.
///
/// Or spectra in long form, a row a wavelength: `leaf,wavelength_nm,R,T` → a row a leaf.
///
/// The model is the layered leaf of `eval abm`. The errors need the noise of the measurements, as in `fit slab`:
/// `--noise S`, or columns `R450_err`; `--noise 0` says that the input is exact.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit foliar"))]
pub struct Args {
    #[command(flatten)]
    pub(super) io: BatchIo,
    /// Table of specific absorptions and refractive indices, or the coefficients of `fit coefficients`
    #[arg(long, value_name = "TABLE.csv")]
    pub(super) pigments: PathBuf,
    /// Absolute standard error of R and T, where a cell has none of its own; 0 for exact values (default: not known, no
    /// errors are printed)
    #[arg(long, value_name = "S")]
    pub(super) noise: Option<f64>,
    /// What is fitted; the rest is taken from columns of the same names, or is 0 (the oblateness: 5)
    #[arg(long = "fit", value_name = "NAME,…", value_delimiter = ',', value_parser = named::<FoliarParameter>(),
        default_values_t = USUAL)]
    asked: Vec<FoliarParameter>,
    /// How long a crossing of the mesophyll is: sieve (the public program's) or slant
    #[arg(long, value_parser = ["sieve", "slant"], default_value = "sieve")]
    path: String,
    /// Angle of the light from the normal, 0 to below 90
    #[arg(long, value_name = "DEGREES", default_value_t = 8.0)]
    incidence_deg: f64,
    /// Oblateness of the palisade's lobes, 0 to 12
    #[arg(long, value_name = "OB", default_value_t = Oblateness::USUAL.palisade)]
    oblateness_palisade: f64,
    /// Oblateness of the spongy tissue's lobes, 0 to 12
    #[arg(long, value_name = "OB", default_value_t = Oblateness::USUAL.spongy)]
    oblateness_spongy: f64,
    /// R and T, and their errors, are in per cent; --noise stays a share of 1
    #[arg(long)]
    pub(super) percent: bool,
    /// Draw measured and computed R and T over wavelength, and what is left, into this folder, a picture a leaf; for
    /// spectra in long form
    #[arg(long, value_name = "DIR")]
    pub(super) plots: Option<PathBuf>,
}

/// What is fitted where nothing is asked for.
const USUAL: [FoliarParameter; 3] =
    [FoliarParameter::Chlorophyll, FoliarParameter::Carotenoid, FoliarParameter::Oblateness];

impl Args {
    /// An option that only the layered leaf has and that differs from its default.
    pub(super) fn of_the_layers(&self) -> Option<&'static str> {
        let usual = Oblateness::USUAL;
        [
            ("--fit", self.asked != USUAL),
            ("--path", self.path != "sieve"),
            ("--incidence-deg", self.incidence_deg != 8.0),
            ("--oblateness-palisade", self.oblateness_palisade != usual.palisade),
            ("--oblateness-spongy", self.oblateness_spongy != usual.spongy),
        ]
        .into_iter()
        .find_map(|(name, given)| given.then_some(name))
    }
}

const SUBSTANCES: [FoliarParameter; 5] = [
    FoliarParameter::Chlorophyll,
    FoliarParameter::Carotenoid,
    FoliarParameter::Protein,
    FoliarParameter::CelluloseLignin,
    FoliarParameter::Water,
];

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    super::check_noise(args.noise)?;
    if !(0.0..90.0).contains(&args.incidence_deg) {
        return Err(Error::Usage(format!("--incidence-deg is {}; expected 0 to below 90", args.incidence_deg)));
    }
    for (name, x) in [("palisade", args.oblateness_palisade), ("spongy", args.oblateness_spongy)] {
        if !(0.0..=12.0).contains(&x) {
            return Err(Error::Usage(format!("--oblateness-{name} is {x}; expected 0 to 12")));
        }
    }
    if let Some((k, _)) = args.asked.iter().enumerate().find(|(k, p)| args.asked[..*k].contains(p)) {
        return Err(Error::Usage(format!("--fit names {} twice", args.asked[k])));
    }
    if args.asked.iter().all(|p| *p == FoliarParameter::Thickness) {
        return Err(Error::Usage(
            "--fit names no parameter that R and T determine; expected at least one content or oblateness".into(),
        ));
    }
    if args.pigments.is_file() && plates::table::is_one(&InputTable::open(&args.pigments)?) {
        return super::foliar_plates::run(args, common);
    }
    let spectrum = pigments::read(&args.pigments)?;
    let table = spectra::open(&args.io.input)?;
    let setting = FoliarFitSetting {
        palisade: args.oblateness_palisade,
        spongy: args.oblateness_spongy,
        path: if args.path == "slant" { MesophyllPath::Slant } else { MesophyllPath::Sieve },
        incidence: args.incidence_deg.to_radians(),
    };
    let given: Vec<FoliarParameter> =
        SUBSTANCES.into_iter().chain([FoliarParameter::Oblateness]).filter(|p| !args.asked.contains(p)).collect();
    let (tally, stated) = match spectra::long(&table)? {
        Some(form) => long(args, common, table, &form, &spectrum, setting, &given)?,
        None if args.plots.is_some() => {
            return Err(Error::Usage("--plots draws spectra in long form; expected a column wavelength_nm".into()));
        }
        None => wide(args, common, table, &spectrum, setting, &given)?,
    };
    batch::say_tally(&tally, &args.io, common, "leaf")?;
    progress::say(format!(
        "contents rest on the absorptions of {}: where these are off by a factor, contents are too, and the standard \
         errors do not hold that",
        args.pigments.display()
    ));
    if !stated {
        progress::say(
            "no noise is stated: the error cells are empty, and ok says only that the leaf could be fitted, not how \
             sure its numbers are; state the standard error of R and T by --noise S or by columns such as R450_err, \
             or exact input by --noise 0",
        );
    }
    Ok(0)
}

/// What is known of a leaf, from the cells of the columns that are `given`.
fn known(given: &[FoliarParameter], cells: &[f64]) -> std::result::Result<FoliarFitConstants, String> {
    let mut known = FoliarFitConstants { contents: [0.0; 5], oblateness: Oblateness::USUAL.epidermis };
    for (p, &x) in given.iter().zip(cells) {
        if x.is_nan() {
            continue;
        }
        if !(x >= 0.0 && x.is_finite()) {
            return Err(format!("{} is {x}; expected 0 or more", p.column()));
        }
        match SUBSTANCES.iter().position(|s| s == p) {
            Some(s) => known.contents[s] = x,
            None if x > MOST_OBLATE => return Err(format!("{} is {x}; expected 0 to {MOST_OBLATE}", p.column())),
            None => known.oblateness = x,
        }
    }
    Ok(known)
}

/// What the command takes, for messages.
const TAKES: &str = "fit foliar takes R and T with a wavelength in nm, such as R450, T450, or spectra in long form: \
                     leaf, wavelength_nm, R, T";

/// Why a share of light can be no reading of a leaf, if so; noise may carry it a little beyond 0 and 1.
pub(super) fn impossible(column: &SpectrumColumn, value: f64) -> Option<String> {
    (!(-0.1..=1.1).contains(&value)).then(|| format!("{} is {value}; expected 0 to 1", column.name))
}

/// What is asked of the columns of readings, their errors and the contents that are given.
pub(super) fn asked_of(columns: &[SpectrumColumn], given: &[FoliarParameter], outputs: Vec<String>) -> BatchSpec {
    let readings: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let errors: Vec<String> = columns.iter().map(|c| c.error.clone()).collect();
    let contents: Vec<String> = given.iter().map(|p| p.column().to_string()).collect();
    BatchSpec {
        optional: [&readings[..], &errors, &contents].concat(),
        outputs,
        whole: vec!["minima".into()],
        texts: vec!["side".into()],
        readings: [&readings[..], &errors].concat(),
        physical: vec![PhysicalRange::shares(readings), PhysicalRange::not_negative([errors, contents].concat())],
        ..BatchSpec::default()
    }
}

/// Whether the table has an error for each reading, or one was given for all.
pub(super) fn noise_is_stated(args: &Args, table: &InputTable, columns: &[SpectrumColumn]) -> bool {
    args.noise.is_some() || columns.iter().all(|c| table.column(&c.error).is_some())
}

/// One row for each leaf, one column for each reading. Also returns whether the noise is stated.
fn wide(
    args: &Args,
    common: &CommonArgs,
    table: InputTable,
    spectrum: &OpticalSpectrum,
    setting: FoliarFitSetting,
    given: &[FoliarParameter],
) -> Result<(RowTally, bool)> {
    let found = spectra::wide(&table);
    let [low, high] = spectrum.range();
    let (columns, outside): (Vec<SpectrumColumn>, Vec<SpectrumColumn>) =
        found.readings.iter().cloned().partition(|c| (low..=high).contains(&c.wavelength));
    if found.readings.is_empty() {
        return Err(spectra::nothing(&table, &found, TAKES));
    }
    // One light for each wavelength and side, so that R and T of one light share what is computed. A table whose
    // wavelengths are all outside the table of pigments is refused with one of them.
    let mut lights: Vec<(f64, Side)> = Vec::new();
    for c in if columns.is_empty() { &outside } else { &columns } {
        for side in [Side::Front, Side::Back] {
            if !lights.contains(&(c.wavelength, side)) {
                lights.push((c.wavelength, side));
            }
        }
    }
    let (name, file) = (table.name().to_path_buf(), table.name().display().to_string());
    let model = FoliarFitModel::new(spectrum, &lights, setting, &args.asked, args.noise)
        .map_err(|what| Error::input(&name, what))?;
    if !outside.is_empty() {
        let columns = counted(outside.len(), "column");
        progress::say(format!("{file}: {columns} outside {low} to {high} nm, the table of pigments, left out"));
    }
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&table, &names, args.percent)?;
    shares.check_noise(&table, &names, args.noise)?;
    let spec = asked_of(&columns, given, model.outputs());
    let front_only = table.column("side").is_none() && columns.iter().all(|c| !c.is_abaxial());
    let stated = noise_is_stated(args, &table, &columns);
    let batch = Batch::open(table, &args.io.rows(common.json), &spec)?;
    if front_only && !shares.refuses_all() {
        model.prepare(Side::Front);
    }
    let (n, left) = (columns.len(), Omissions::default());
    let tally = batch.run(|row, out| {
        if let Some(why) = shares.refuse(names.iter().map(String::as_str).zip(row.all().iter().copied())) {
            return out.push(OutputRow::refused(why));
        }
        let answer = side(row.text(0)).and_then(|lit| {
            let mut readings: Vec<FoliarReading> = Vec::new();
            let mut bad: Vec<String> = row.faults().map(|(_, why)| why.to_string()).collect();
            for (k, c) in columns.iter().enumerate() {
                let (value, err) = (shares.scale * row.get(k), shares.scale * row.get(n + k));
                let light = (c.wavelength, c.side.unwrap_or(lit));
                // A reading whose error cannot be read has no weight.
                if value.is_nan() || row.faults().any(|(place, _)| place == n + k) {
                    continue;
                }
                match impossible(c, value) {
                    Some(why) => bad.push(why),
                    None => {
                        let light = lights.iter().position(|l| *l == light).unwrap_or(0);
                        readings.push(FoliarReading { light, through: c.through, value, err });
                    }
                }
            }
            if readings.is_empty() && !bad.is_empty() {
                return Err(format!("no reading can be used: {}", bad[0]));
            }
            bad.into_iter().for_each(|why| left.add(row.line(), why));
            readings.sort_by_key(|r| r.light);
            Ok(model.fit(&readings, &known(given, &row.all()[2 * n..])?))
        });
        out.push(answer.unwrap_or_else(OutputRow::refused));
    })?;
    left.say(&name);
    Ok((tally, stated))
}

/// One row for each wavelength. Also returns whether the noise is stated.
fn long(
    args: &Args,
    common: &CommonArgs,
    table: InputTable,
    form: &LongSpectra,
    spectrum: &OpticalSpectrum,
    setting: FoliarFitSetting,
    given: &[FoliarParameter],
) -> Result<(RowTally, bool)> {
    let LongSpectra { wavelength, unit_nm, readings: columns } = form;
    let name = table.name().to_path_buf();
    if columns.is_empty() {
        let found = spectra::wide(&table);
        return Err(match found.replicates.is_empty() {
            true => Error::input(&name, format!("no columns of readings; expected R or T beside {wavelength}")),
            false => spectra::nothing(&table, &found, TAKES),
        });
    }
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&table, &names, args.percent)?;
    shares.check_noise(&table, &names, args.noise)?;
    let stated = noise_is_stated(args, &table, columns);
    let mut spec = asked_of(columns, given, Vec::new());
    spec.required = vec![wavelength.clone()];
    spec.physical.push(PhysicalRange::not_negative(spec.required.clone()));
    let groups = spectra::leaves(table, &spec)?;
    let sink = groups.open(&args.io.rows(common.json))?;
    if let Some(folder) = &args.plots {
        atomic::probe_folder(folder)?;
    }
    let light_of = |row: &GroupRow, c: &SpectrumColumn| {
        let side = c.side.map_or_else(|| side(row.texts[0].as_deref()), Ok);
        side.map(|side| (spectra::in_nm(row.values[0], *unit_nm), side))
    };
    let key = |(wavelength, side): (f64, Side)| (wavelength.to_bits(), side == Side::Back);
    // Readings outside the table of pigments are left out below.
    let [low, high] = spectrum.range();
    let all = groups.rows().flat_map(|row| columns.iter().filter_map(move |c| light_of(row, c).ok()));
    let mut lights: Vec<(f64, Side)> = all.filter(|(w, _)| (low..=high).contains(w)).collect();
    lights.sort_by(|a, b| a.0.total_cmp(&b.0).then(key(*a).cmp(&key(*b))));
    lights.dedup();
    let places: HashMap<_, _> = lights.iter().enumerate().map(|(k, l)| (key(*l), k)).collect();
    let model = FoliarFitModel::new(spectrum, &lights, setting, &args.asked, args.noise)
        .map_err(|what| Error::input(&name, what))?;
    spec.outputs = model.outputs();
    if !shares.refuses_all() {
        [Side::Front, Side::Back].into_iter().for_each(|side| model.prepare(side));
    }
    let n = columns.len();
    let drawn = DrawnLeaves::default();
    let tally = groups.run_into(sink, &spec, |leaf, rows, left| {
        let mut readings: Vec<FoliarReading> = Vec::new();
        for row in rows {
            let cells = &row.values[1..];
            if let Some(why) = shares.refuse(names.iter().map(String::as_str).zip(cells.iter().copied())) {
                return OutputRow::refused(format!("line {}: {why}", row.line));
            }
            for (k, c) in columns.iter().enumerate() {
                let (value, err) = (shares.scale * cells[k], shares.scale * cells[n + k]);
                if value.is_nan() {
                    continue;
                }
                let place = light_of(row, c).and_then(|light| {
                    let outside = || format!("{wavelength} is {}; the table of pigments has {low} to {high}", light.0);
                    places.get(&key(light)).copied().ok_or_else(outside)
                });
                match place.and_then(|place| impossible(c, value).map_or(Ok(place), Err)) {
                    Ok(light) => readings.push(FoliarReading { light, through: c.through, value, err }),
                    Err(why) => left.add(row.line, why),
                }
            }
        }
        readings.sort_by_key(|r| r.light);
        let known = match known(given, &rows[0].values[1 + 2 * n..]) {
            Ok(known) => known,
            Err(why) => return OutputRow::refused(format!("line {}: {why}", rows[0].line)),
        };
        let answer = model.fit(&readings, &known);
        if args.plots.is_some() && !answer.values.is_empty() {
            let computed = model.computed(&readings, &known, &answer.values);
            let of = |(r, computed): (&FoliarReading, &f64)| PlottedReading {
                wavelength: lights[r.light].0,
                below: lights[r.light].1 == Side::Back,
                through: r.through,
                value: r.value,
                err: r.err,
                computed: *computed,
            };
            let shown: Vec<PlottedReading> = readings.iter().zip(&computed).map(of).collect();
            let panels = foliar_plots::panels(leaf, &shown);
            drawn.lock().unwrap_or_else(PoisonError::into_inner).insert(leaf.to_string(), panels);
        }
        answer
    })?;
    draw(args, groups.names(), drawn)?;
    Ok((tally, stated))
}

/// Panels of leaves, by their names.
pub(super) type DrawnLeaves = Mutex<HashMap<String, Vec<SpectrumPanel>>>;

/// Draws what `--plots` asks for, in the order of the leaves.
pub(super) fn draw<'a>(args: &Args, names: impl Iterator<Item = &'a str>, drawn: DrawnLeaves) -> Result<()> {
    if let Some(folder) = &args.plots {
        let mut drawn = drawn.into_inner().unwrap_or_else(PoisonError::into_inner);
        let leaves: Vec<_> = names.filter_map(|name| drawn.remove_entry(name)).collect();
        let files = spectrum::pictures(folder, &leaves)?;
        progress::say(format!("{} in {}", counted(files.len(), "picture"), folder.display()));
    }
    Ok(())
}
