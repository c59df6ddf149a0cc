//! Which command takes a table, by the names of its columns.

use super::spectra::{Spectrum, reading};
use super::{Found, listed, quoted};
use crate::Result;
use mesophyll_files::table::{Record, Table};
use std::collections::HashSet;
use std::path::Path;

/// Tables of the commands: the columns that tell them, what a row is, and the command with `FILE` for the table. The
/// first one whose columns are all there is taken, so a table with more columns stands before one with fewer. `A|B`
/// is one of two names.
const KINDS: [(&[&str], &str, &str); 16] = [
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
    (&["time_s", "u_mm"], "deflections of a branch over time", "mesophyll fit motion --in FILE"),
    (&["alpha", "x"], "places on bent branches", "mesophyll eval beam --in FILE"),
    (&["alpha"], "tapers of branches", "mesophyll fit beam --in FILE"),
    (&["thickness", "radius"], "places on the far side of a leaf", "mesophyll eval dipole --in FILE"),
    (&["sun_zenith|sun_zenith_deg", "turbidity"], "clear skies", "mesophyll eval sky --in FILE"),
    (&["view_zenith_deg"], "directions of view", "mesophyll eval canopy SCENE.toml --directions FILE"),
];

/// Names of columns of thicknesses.
const THICKNESS: [&str; 5] = ["h", "thickness_mm", "thickness_um", "thickness_m", "thickness"];
const LEAF: [&str; 3] = ["leaf", "leaf_id", "sample"];

/// What a table holds, and which command takes it.
pub fn of(mut table: Table, path: &Path) -> Result<Found> {
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
    let (mut record, mut rows) = (Record::default(), 0);
    while table.next_record(&mut record)? {
        rows += 1;
    }
    found.rows = Some(rows);
    Ok(found)
}

/// A table of reflectances and transmittances, in long or wide form.
fn spectra(mut table: Table, mut found: Found, path: &Path) -> Result<Found> {
    let columns: Vec<(usize, bool, Option<f64>)> =
        table.header.iter().enumerate().filter_map(|(k, name)| reading(name).map(|(t, w)| (k, t, w))).collect();
    let across = table.column("wavelength_nm");
    // A table has one of the two forms; rho_d and rho_t stand without wavelengths.
    let wide = columns.iter().any(|c| c.2.is_some());
    let columns: Vec<_> = columns.into_iter().filter(|c| c.2.is_some() == wide).collect();
    let leaf = LEAF.iter().find_map(|name| table.column(name));
    let (mut leaves, mut wavelengths) = (HashSet::new(), HashSet::new());
    let (mut rows, mut readings, mut large, mut too_large) = (0, 0usize, 0usize, false);
    let mut record = Record::default();
    while table.next_record(&mut record)? {
        rows += 1;
        let number = |k: usize| record.shown(k).trim().parse::<f64>().ok().filter(|v| v.is_finite());
        if let Some(w) = across.and_then(number) {
            wavelengths.insert(w.to_bits());
        }
        leaves.insert(leaf.map_or_else(String::new, |k| record.shown(k).into_owned()));
        for v in columns.iter().filter_map(|c| number(c.0)) {
            readings += 1;
            large += usize::from(v > 1.5);
            too_large |= v > 150.0;
        }
    }
    found.rows = Some(rows);
    if columns.is_empty() {
        found.reason = Some(format!(
            "no command takes a table with the columns {}; `mesophyll fit slab --help` and the helps of the other \
             commands show theirs",
            listed(&table.header)
        ));
        return Ok(found);
    }
    if wide {
        wavelengths = columns.iter().filter_map(|c| c.2).map(f64::to_bits).collect();
    }
    let has = |through: bool| columns.iter().any(|c| c.1 == through);
    let spectrum = Spectrum {
        reflectance: has(false),
        transmittance: has(true),
        thickness: THICKNESS.iter().any(|name| table.column(name).is_some()),
        // A quarter of the readings is above any share, and none above per cent.
        percent: large > 0 && 4 * large >= readings && !too_large,
        wavelengths: !wavelengths.is_empty(),
        index: None,
    };
    let quantities = [(spectrum.reflectance, "reflectance"), (spectrum.transmittance, "transmittance")];
    found.holds = quantities.iter().filter(|(has, _)| *has).map(|(_, name)| name.to_string()).collect();
    found.unit = (readings > 0).then(|| if spectrum.percent { "per cent" } else { "share" }.into());
    found.form = match (spectrum.wavelengths, wide) {
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
        let samples = if wide { rows } else { leaves.len().min(rows) };
        let per_leaf = if wide { found.holds.len() } else { columns.len() };
        found.spectra = Some(samples * per_leaf);
    }
    spectrum.takes(&mut found, path);
    Ok(found)
}
