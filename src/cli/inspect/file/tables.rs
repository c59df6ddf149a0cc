//! Which command takes a table, by the names of its columns.

use super::spectrum::SpectrumContents;
use super::{Found, listed, quoted};
use crate::cli::Result;
use mesophyll_files::spectra::{self, LEAF, ReadingUnit};
use mesophyll_files::table::{InputTable, TableRecord};
use std::collections::HashSet;
use std::path::Path;

/// Tables of the commands: the columns that tell them, what a row is, and the command with `FILE` for the table. The
/// first one whose columns are all there is taken, so a table with more columns stands before one with fewer. `A|B`
/// is one of two names.
const KINDS: [(&[&str], &str, &str); 17] = [
    (&["status"], "the answer of an earlier command", ""),
    (&["kind", "oblateness"], "cases of the foliar scattering model", "mesophyll eval fsm --in FILE"),
    (
        &["wavelength_nm", "chlorophyll_cm2_g"],
        "a table of pigments",
        "mesophyll fit foliar --pigments FILE --in SPECTRA.csv",
    ),
    (
        &["incidence_deg", "mesophyll_thickness_mm", "chlorophyll_ug_cm2"],
        "leaves of layers with their pigments",
        "mesophyll eval abm --pigments PIGMENTS.csv --in FILE",
    ),
    (&["absorption_per_mm", "mesophyll_thickness_mm"], "leaves of layers", "mesophyll eval abm --in FILE"),
    (
        &["rho_d|rho_d_r", "rho_s|rho_s_r", "m"],
        "texels of a leaf",
        "mesophyll eval gloss --geometry DEVICE.toml --in FILE",
    ),
    (&["omega", "delta"], "slabs by albedo and thickness", "mesophyll eval slab --in FILE"),
    (
        &["source_zenith_deg|source_zenith", "view_zenith_deg|view_zenith"],
        "samples of a goniometer",
        "mesophyll fit gloss --samples --in FILE",
    ),
    (&["r0", "r1"], "traces of texels", "mesophyll fit gloss --geometry DEVICE.toml --in FILE"),
    (&["length_mm", "position_mm", "deflection_mm"], "marks on bent branches", "mesophyll fit beam --deflections FILE"),
    (
        &["time_s|time_ms|time_us|time|timestamp|datetime|date_time", "u_mm"],
        "deflections of a branch over time",
        "mesophyll fit motion --in FILE",
    ),
    (&["alpha", "x"], "places on bent branches", "mesophyll eval beam --in FILE"),
    (&["alpha"], "tapers of branches", "mesophyll fit beam --in FILE"),
    (&["thickness", "radius"], "places on the far side of a leaf", "mesophyll eval dipole --in FILE"),
    (
        &["latitude_deg", "hour", "declination_deg|day_of_year"],
        "hours of a day at a latitude",
        "mesophyll eval sun --in FILE",
    ),
    (&["sun_zenith|sun_zenith_deg", "turbidity"], "clear skies", "mesophyll eval sky --in FILE"),
    (&["view_zenith_deg"], "directions of view", "mesophyll eval canopy SCENE.toml --directions FILE"),
];

/// What a table holds, and which command takes it.
pub fn of(mut table: InputTable, path: &Path) -> Result<Found> {
    let mut found = Found { form: "a table".into(), ..Found::default() };
    let there = |name: &&str| table.column(name).is_some();
    let matches = |columns: &&[&str]| columns.iter().all(|c| c.split('|').any(|name| there(&name)));
    let kind = KINDS.iter().find(|(columns, ..)| matches(columns));
    match kind {
        Some((_, what, command)) => {
            found.holds.push(what.to_string());
            if command.is_empty() {
                found.reason = Some("its rows end in a status, so it is an answer, which no command reads".into());
            } else {
                found.command = Some(command.replace("FILE", &quoted(path)));
            }
        }
        None => return spectra(table, found, path),
    }
    let (mut record, mut rows) = (TableRecord::default(), 0);
    while table.next_record(&mut record)? {
        rows += 1;
    }
    found.rows = Some(rows);
    Ok(found)
}

/// A table of reflectances and transmittances, in any form that the fits of spectra read.
fn spectra(mut table: InputTable, mut found: Found, path: &Path) -> Result<Found> {
    let wide = spectra::wide(&table);
    let (columns, across) = match spectra::long(&table)? {
        _ if !wide.readings.is_empty() => (wide.readings.clone(), None),
        Some(long) => (long.readings, Some((table.require(&long.wavelength)?, long.unit_nm))),
        None => (spectra::readings(&table)?, None),
    };
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    // With two rows a leaf the readings are found in another table; here they are unknown.
    let percent = !names.is_empty() && ReadingUnit::of(&table, &names, false).is_ok_and(|shares| shares.refuses_all());
    let places: Vec<usize> = names.iter().map(|name| table.require(name)).collect::<Result<_>>()?;
    let leaf = LEAF.iter().find_map(|name| table.column(name));
    let (mut leaves, mut wavelengths) = (HashSet::new(), HashSet::new());
    let (mut rows, mut read) = (0, vec![0usize; places.len()]);
    let mut record = TableRecord::default();
    while table.next_record(&mut record)? {
        rows += 1;
        let number = |k: usize| table.number(&record, k).ok().flatten().filter(|v| v.is_finite());
        if let Some(w) = across.and_then(|(k, unit)| Some(spectra::in_nm(number(k)?, unit))) {
            wavelengths.insert(w.to_bits());
        }
        leaves.insert(leaf.map_or_else(String::new, |k| record.shown(k).into_owned()));
        for (count, place) in read.iter_mut().zip(&places) {
            *count += usize::from(number(*place).is_some());
        }
    }
    found.rows = Some(rows);
    if columns.is_empty() {
        found.reason = Some(match spectra::has_others(&wide) {
            true => {
                spectra::nothing(&table, &wide, "the fits of spectra take columns such as R450 and T450").to_string()
            }
            false => format!(
                "no command takes a table with the columns {}; `mesophyll fit slab --help` and the helps of the other \
                 commands show theirs",
                listed(&table.header)
            ),
        });
        return Ok(found);
    }
    let is_wide = !wide.readings.is_empty();
    if is_wide {
        wavelengths = columns.iter().map(|c| c.wavelength.to_bits()).collect();
    }
    let has = |through: bool| columns.iter().zip(&read).any(|(c, n)| c.through == through && *n > 0);
    let usual = ["rho_d", "rho_t", "h", "", ""];
    let mut inputs = usual.map(String::from);
    spectra::find(&table, &usual, &mut inputs)?;
    let spectrum = SpectrumContents {
        reflectance: has(false),
        transmittance: has(true),
        thickness: table.column(&inputs[2]).is_some(),
        percent,
        wavelengths: !wavelengths.is_empty(),
        index: None,
    };
    let quantities = [(spectrum.reflectance, "reflectance"), (spectrum.transmittance, "transmittance")];
    found.holds = quantities.iter().filter(|(has, _)| *has).map(|(_, name)| name.to_string()).collect();
    if found.holds.is_empty() {
        found.reason = Some("its columns of reflectance and transmittance hold no number".into());
        return Ok(found);
    }
    found.unit = Some(if percent { "per cent" } else { "share" }.into());
    found.form = match (spectrum.wavelengths, is_wide) {
        (false, _) => "a table of reflectances and transmittances",
        (true, true) => "a table of spectra, a row a leaf",
        (true, false) => "a table of spectra, a row a wavelength",
    }
    .into();
    let all: Vec<f64> = wavelengths.iter().map(|bits| f64::from_bits(*bits)).collect();
    if spectrum.wavelengths {
        let extreme = |pick: fn(f64, f64) -> f64| all.iter().copied().reduce(pick).unwrap_or(f64::NAN);
        found.wavelength_nm = Some([extreme(f64::min), extreme(f64::max)]);
        found.wavelengths = Some(all.len());
        // In long form each column is a spectrum of each leaf, in wide form each quantity and side.
        let kinds: HashSet<(bool, bool)> = columns.iter().map(|c| (c.through, c.is_abaxial())).collect();
        found.spectra = Some(kinds.len() * if is_wide { rows } else { leaves.len() });
    }
    spectrum.takes(&mut found, path);
    Ok(found)
}
