//! Tables of reflectance factors: of three channels, or of any number of bands.

use crate::photographs::{PixelUse, ReadingKind, ScenePhotograph};
use crate::{Error, Result};
use mesophyll_files::table::{BatchSpec, Groups, InputTable};
use mesophyll_scene::manifest::{SceneManifest, StatedFactors};

/// Most bands: all of their numbers are found at once.
const MOST_BANDS: usize = 64;
/// What the names of columns with reflectance factors begin with.
const FACTOR: &str = "brf_";
/// Columns of the three channels.
const CHANNELS: [&str; 3] = ["brf_r", "brf_g", "brf_b"];

/// The bands of a table: columns such as `brf_865`, each with its wavelength (nm).
fn bands(table: &InputTable) -> Result<Vec<(String, f64)>> {
    let mut out: Vec<(String, f64)> = Vec::new();
    for column in &table.header {
        let Some(Ok(nm)) = column.strip_prefix(FACTOR).map(str::parse::<f64>) else { continue };
        if !(100.0..=30_000.0).contains(&nm) {
            let what = "no wavelength; expected a number of nm from 100 to 30000 after brf_";
            return Err(Error::field(table.name(), column, what));
        }
        if let Some((other, _)) = out.iter().find(|(_, there)| *there == nm) {
            return Err(Error::field(
                table.name(),
                column,
                format!("the wavelength of {other} again; expected it once"),
            ));
        }
        out.push((column.clone(), nm));
    }
    if let (Some(own), Some(other)) = (out.first(), ["brf"].iter().chain(&CHANNELS).find(|c| table.column(c).is_some()))
    {
        let what = format!("found beside {}; expected factors of channels or of wavelengths, not of both", own.0);
        return Err(Error::field(table.name(), other, what));
    }
    Ok(out)
}

/// The wavelengths (nm) of all tables of reflectance factors, ascending. `None` where nothing but three channels was
/// measured.
///
/// # Errors
/// [`Error::Input`] where bands are measured beside channels, and for more bands than can be found.
pub fn wavelengths(manifest: &SceneManifest) -> Result<Option<Vec<f64>>> {
    let (mut found, mut with, mut without) = (Vec::new(), None, None);
    for factors in &manifest.factors {
        let own = bands(&InputTable::open(&manifest.resolve(&factors.file))?)?;
        let which = if own.is_empty() { &mut without } else { &mut with };
        which.get_or_insert(&factors.file);
        found.extend(own.into_iter().map(|(_, nm)| nm));
    }
    let Some(with) = with else { return Ok(None) };
    if let Some(other) = manifest.taken.first().map(|taken| &taken.file).or(without) {
        let [with, other] = [with, other].map(|file| file.display());
        let what = format!("{with} has wavelengths and {other} has channels; expected one or the other in a fit");
        return Err(Error::field(&manifest.path, "brf", what));
    }
    found.sort_by(f64::total_cmp);
    found.dedup();
    if found.len() > MOST_BANDS {
        let what = format!("its tables have {} wavelengths, expected at most {MOST_BANDS} in a fit", found.len());
        return Err(Error::field(&manifest.path, "brf", what));
    }
    Ok(Some(found))
}

/// A table of reflectance factors, number `k` of the scene. A table that lacks some of the fit's `wavelengths` has no
/// readings there.
///
/// # Errors
/// [`Error::Input`] for a table that is missing, has no readable row, no errors, or readings that are no factors.
pub fn read(
    manifest: &SceneManifest,
    k: usize,
    factors: &StatedFactors,
    wavelengths: Option<&[f64]>,
) -> Result<ScenePhotograph> {
    let path = manifest.resolve(&factors.file);
    let table = InputTable::open(&path)?;
    // `eval canopy` writes one channel at a time; where the table has one, it is that of all channels.
    let one = table.column("brf").is_some();
    let channels = || CHANNELS.iter().enumerate().map(|(c, name)| (if one { "brf" } else { name }.to_string(), c));
    let columns: Vec<(String, usize)> = match wavelengths {
        None => channels().collect(),
        Some(all) => {
            let place = |nm: f64| all.partition_point(|own| *own < nm);
            bands(&table)?.into_iter().map(|(name, nm)| (name, place(nm))).collect()
        }
    };
    let names: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    let errors: Vec<String> = names.iter().map(|name| format!("{name}_err")).collect();
    let (zenith, azimuth) = ("view_zenith_deg".to_string(), "view_azimuth_deg".to_string());
    // A band may lack readings in some directions; channels belong together.
    let (required, readings) =
        if wavelengths.is_some() { (Vec::new(), names.clone()) } else { (names.clone(), Vec::new()) };
    let spec = BatchSpec {
        required: std::iter::once(zenith).chain(required).collect(),
        optional: readings.into_iter().chain([azimuth]).chain(errors.iter().cloned()).collect(),
        ..BatchSpec::default()
    };
    let stated = errors.iter().all(|name| table.column(name).is_some());
    if let (Some(there), Some(missing)) = (
        errors.iter().find(|name| table.column(name).is_some()),
        errors.iter().find(|name| table.column(name).is_none()),
    ) {
        let what = format!("no such column, beside {there}; expected errors of all factors or of none");
        return Err(Error::field(table.name(), missing, what));
    }
    let table = Groups::one(table, &spec, "scene", &manifest.name)?;
    let sun = manifest.sun.as_ref().map_or(0.0, |sun| sun.azimuth_deg);
    let (m, n) = (columns.len(), wavelengths.map_or(CHANNELS.len(), <[f64]>::len));
    let (mut toward, mut seen, mut error) = (Vec::new(), Vec::new(), Vec::new());
    for row in table.rows() {
        let [zenith, azimuth] = [row.values[0], row.values[1 + m]];
        let (readings, errs) = (&row.values[1..=m], &row.values[2 + m..]);
        // As in `eval canopy`: without an azimuth, negative angles are on the sun's side.
        let angles = if azimuth.is_nan() { [-zenith, sun] } else { [zenith, azimuth] };
        let sound = |v: &f64| v.is_finite() && *v >= 0.0 || v.is_nan() && wavelengths.is_some();
        if !(zenith.abs() < 89.9) || !readings.iter().all(sound) {
            let found = readings.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
            let what = format!("line {}: found {zenith}° and {found}", row.line);
            return Err(Error::input(
                &path,
                format!("{what}, expected a zenith below 89.9° and factors of at least 0"),
            ));
        }
        let there = |(k, v): (usize, &f64)| !v.is_nan() && !(errs[k] >= 0.0);
        if stated && readings.iter().enumerate().any(there) {
            let what = format!("line {}: found the errors {errs:?}, expected numbers of at least 0 in each", row.line);
            return Err(Error::input(&path, what));
        }
        toward.push(angles.map(f64::to_radians));
        let at = seen.len();
        seen.resize(at + n, f64::NAN);
        error.resize(at + n, f64::NAN);
        for (k, (_, c)) in columns.iter().enumerate() {
            (seen[at + c], error[at + c]) = (readings[k], errs[k]);
        }
    }
    if toward.is_empty() || seen.iter().all(|v: &f64| v.is_nan()) {
        return Err(Error::input(&path, "found no readable row, expected directions with reflectance factors"));
    }
    if !stated && factors.noise.is_none() {
        let what = format!("missing; {} has no columns {}", path.display(), errors.join(", "));
        return Err(Error::field(&manifest.path, &format!("brf[{k}].noise"), what));
    }
    Ok(ScenePhotograph {
        name: format!("brf-{}", k + 1),
        size: [toward.len(), 1],
        uses: vec![if factors.held_out { PixelUse::Held } else { PixelUse::Fitted }; toward.len()],
        by: ReadingKind::Directions(toward),
        channels: n,
        seen,
        error: stated.then_some(error),
        noise: factors.noise.unwrap_or(0.0),
        floor: 0.0,
        exposure: None,
        sun_deg: None,
        saturated: 0,
    })
}
