//! `mesophyll eval sun`: latitude, season and hour in, the sun's place out.

use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputTable, OutputRow, Status};
use mesophyll_sky::solar_path::{MOST_DECLINATION_DEG, declination_deg, sun_place};

/// CSV columns `latitude_deg,hour` and `declination_deg` or `day_of_year` → `sun_zenith_deg,sun_azimuth_deg,status`:
/// where the sun stands, for `[sun]` of a scene and `export --sun-zenith-deg`.
///
/// The hour is solar time: 12 is when the sun stands highest. The azimuth is 0 = +x = east and grows to +y = north.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval sun"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
}

/// Columns that say the season, of which a table has one.
const SEASONS: [&str; 2] = ["declination_deg", "day_of_year"];
/// What these may hold.
const RANGES: [[f64; 2]; 2] = [[-MOST_DECLINATION_DEG, MOST_DECLINATION_DEG], [1.0, 366.0]];

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let table = InputTable::open(&args.io.input)?;
    let has = SEASONS.map(|name| table.column(name).is_some());
    let by_day = match has {
        [true, false] => false,
        [false, true] => true,
        _ => {
            let found = if has[0] { "both are there" } else { "neither is there" };
            let what = format!("{found}; expected one of the two columns, which say the season");
            return Err(Error::field(table.name(), "declination_deg, day_of_year", what));
        }
    };
    let k = usize::from(by_day);
    let (season, range) = (SEASONS[k], RANGES[k]);
    let spec = BatchSpec {
        required: ["latitude_deg", "hour", season].map(String::from).to_vec(),
        outputs: ["sun_zenith_deg", "sun_azimuth_deg"].map(String::from).to_vec(),
        ..BatchSpec::default()
    };
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        let cells = [row.get(0), row.get(1), row.get(2)];
        let limits = [("latitude_deg", [-90.0, 90.0]), ("hour", [0.0, 24.0]), (season, range)];
        let beyond = cells.iter().zip(limits).find(|(v, (_, [low, high]))| !(*low..=*high).contains(*v));
        if let Some((value, (name, [low, high]))) = beyond {
            return out.push(OutputRow::refused(format!("{name} is {value}; expected {low} to {high}")));
        }
        let declination = if by_day { declination_deg(cells[2]) } else { cells[2] };
        let (zenith, azimuth) = sun_place(cells[0], declination, cells[1]);
        let status = if zenith.sin() < 1e-9 {
            Status::undetermined(["sun_azimuth_deg"], "the sun stands on the vertical")
        } else {
            Status::Ok
        };
        out.push(OutputRow { values: vec![zenith.to_degrees(), azimuth.to_degrees()], status });
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}
