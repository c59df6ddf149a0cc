//! Leaves of a database whose contents a laboratory measured, as `fit foliar` finds them by coefficients of the other
//! half of the species.
//!
//! The table is `leaves/lopex93_spectra.csv.gz` in the folder that `MESOPHYLL_DATA` names. LOPEX93 (Hosgood et al.
//! 1994) may not be used commercially, so neither it nor anything trained on it is part of the program.

use crate::Result;
use crate::bench::BenchRow;
use crate::peers::PeerInputs;
use mesophyll_base::statistics::{median_of, percentile};
use mesophyll_files::{progress, spectra};
use mesophyll_fits::plates::training::{self, PlateTraining};
use mesophyll_fits::plates::{CONTENTS, PlateFitModel, reading};
use mesophyll_report::spectrum::{self, SpectrumLine, SpectrumPanel};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

/// Where the table lies in the folder of data.
const TABLE: &str = "leaves/lopex93_spectra.csv.gz";
/// Every how many of its wavelengths is used: the table has one every 5 nm.
const EVERY: usize = 4;
/// Standard error of a reading.
const NOISE: f64 = 0.005;
/// Errors of the laboratory, as shares, that count beside those of the fit.
const LABORATORY: [f64; 4] = [0.1, 0.1, 0.0, 0.0];

/// A leaf whose species the coefficients had not seen.
struct UnseenLeaf {
    measured: [f64; 4],
    found: [f64; 4],
    errors: [f64; 4],
    rms: f64,
    /// Measured less computed R and T at each wavelength; NaN where missing.
    left: Vec<[f64; 2]>,
}

/// One half of the species, answered by coefficients of the other.
struct LeafHalf {
    /// How many species trained, how many leaves of them, and how many species were answered.
    counts: [usize; 3],
    wavelengths: Vec<f64>,
    leaves: Vec<UnseenLeaf>,
    us: f64,
}

/// The table with every [`EVERY`]th wavelength; `None`, and a word, where it is not at hand.
fn table() -> Result<Option<PlateTraining>> {
    let file = std::env::var_os("MESOPHYLL_DATA").map(|folder| PathBuf::from(folder).join(TABLE));
    let Some(file) = file.filter(|f| f.exists()) else {
        progress::say(format!("leaves with measured contents: skipped, MESOPHYLL_DATA names no folder with {TABLE}"));
        return Ok(None);
    };
    let mut all = reading::read(spectra::open(&file)?, false)?;
    let kept = |k: &usize| k.is_multiple_of(EVERY);
    let thin = |spectra: &[[f64; 2]]| (0..spectra.len()).filter(kept).map(|k| spectra[k]).collect();
    all.examples.iter_mut().for_each(|e| e.spectra = thin(&e.spectra));
    all.wavelengths = (0..all.wavelengths.len()).filter(kept).map(|k| all.wavelengths[k]).collect();
    Ok(Some(all))
}

/// The leaves of every second species by name, from the `first`.
fn half(all: &PlateTraining, first: usize) -> PlateTraining {
    let mut names = all.species.clone();
    names.sort();
    let species: Vec<String> = names.into_iter().skip(first).step_by(2).collect();
    let place = |k: usize| species.iter().position(|name| *name == all.species[k]);
    let own = all.examples.iter().filter_map(|e| {
        let species = place(e.species)?;
        Some(training::PlateExample { species, ..e.clone() })
    });
    PlateTraining { wavelengths: all.wavelengths.clone(), examples: own.collect(), species, ..PlateTraining::default() }
}

fn answered(all: &PlateTraining, first: usize) -> Result<LeafHalf> {
    let (train, judge) = (half(all, first), half(all, 1 - first));
    let trained = training::train(&train)?;
    let model = PlateFitModel::new(&trained.coefficients, &all.wavelengths, NOISE);
    let clock = Instant::now();
    let leaf = |e: &training::PlateExample| {
        let readings = training::readings(e);
        let (row, computed) = model.fit_with_spectra(&readings);
        let values = |from: usize| std::array::from_fn(|k| row.values.get(from + k).copied().unwrap_or(f64::NAN));
        let mut left = vec![[f64::NAN; 2]; e.spectra.len()];
        for (r, computed) in readings.iter().zip(computed) {
            left[r.light][usize::from(r.through)] = r.value - computed;
        }
        let rms = row.values.get(8).copied().unwrap_or(f64::NAN);
        UnseenLeaf { measured: e.measured, found: values(0), errors: values(4), rms, left }
    };
    let leaves: Vec<UnseenLeaf> = judge.examples.iter().map(leaf).collect();
    let us = clock.elapsed().as_secs_f64() * 1e6 / leaves.len().max(1) as f64;
    let counts = [train.species.len(), train.examples.len(), judge.species.len()];
    Ok(LeafHalf { counts, wavelengths: all.wavelengths.clone(), leaves, us })
}

/// Both halves; none where the table is not at hand.
fn halves() -> Result<&'static [LeafHalf]> {
    static HALVES: OnceLock<Vec<LeafHalf>> = OnceLock::new();
    if let Some(known) = HALVES.get() {
        return Ok(known);
    }
    let found = match table()? {
        Some(all) => vec![answered(&all, 0)?, answered(&all, 1)?],
        None => Vec::new(),
    };
    Ok(HALVES.get_or_init(|| found))
}

/// Correlation and bias of a content, and the share of leaves whose 95 % interval holds what was measured.
fn judged(leaves: &[&UnseenLeaf], k: usize) -> [f64; 3] {
    let known: Vec<&&UnseenLeaf> = leaves.iter().filter(|l| !l.measured[k].is_nan() && !l.found[k].is_nan()).collect();
    let count = known.len() as f64;
    let mean = |of: &dyn Fn(&UnseenLeaf) -> f64| known.iter().map(|l| of(l)).sum::<f64>() / count;
    let (found, measured) = (mean(&|l| l.found[k]), mean(&|l| l.measured[k]));
    let both = mean(&|l| (l.found[k] - found) * (l.measured[k] - measured));
    let squares = mean(&|l| (l.found[k] - found).powi(2)) * mean(&|l| (l.measured[k] - measured).powi(2));
    let held = mean(&|l| {
        let error = l.errors[k].hypot(LABORATORY[k] * l.measured[k]);
        f64::from(u8::from((l.found[k] - l.measured[k]).abs() <= 1.96 * error))
    });
    [both / squares.sqrt(), found / measured - 1.0, held]
}

/// The row of some leaves.
fn row(knob: &str, setting: String, leaves: &[&UnseenLeaf], us: f64) -> BenchRow {
    let pooled = (leaves.iter().map(|l| l.rms * l.rms).sum::<f64>() / leaves.len().max(1) as f64).sqrt();
    let median = median_of(leaves.iter().map(|l| l.rms)).unwrap_or(f64::NAN);
    let content = |(k, name): (usize, &&str)| {
        let [r, bias, held] = judged(leaves, k);
        format!("{name} r {r:.2}, bias {:+.0} %, in {:.0} % of intervals", 100.0 * bias, 100.0 * held)
    };
    let contents: Vec<String> = CONTENTS.iter().enumerate().map(content).collect();
    let note = format!("R and T, root mean square over leaves, median {median:.4}; {}", contents.join("; "));
    BenchRow { model: "foliar".into(), knob: knob.into(), setting, error: pooled, us, note }
}

/// The rows.
///
/// # Errors
/// A table of leaves that cannot be read or trained on.
pub fn rows() -> Result<Vec<BenchRow>> {
    let of = |half: &LeafHalf| {
        let [species, leaves, others] = half.counts;
        let all: Vec<&UnseenLeaf> = half.leaves.iter().collect();
        let setting = format!("{} leaves of {others} others, by {leaves} of {species}", all.len());
        row("species that were not seen", setting, &all, half.us)
    };
    Ok(halves()?.iter().map(of).collect())
}

/// The same leaves for peers, and our row for all of them.
///
/// # Errors
/// As [`rows`].
pub fn inputs() -> Result<PeerInputs> {
    let Some(all) = table()? else { return Ok(PeerInputs { files: Vec::new(), ours: Vec::new(), turn: None }) };
    let pair = |w: &f64| format!("R{w},T{w}");
    let mut text = all.wavelengths.iter().map(pair).chain(CONTENTS.map(String::from)).collect::<Vec<_>>().join(",");
    for e in &all.examples {
        let cells = e.spectra.iter().flatten().chain(&e.measured);
        let cells = cells.map(|x| if x.is_nan() { String::new() } else { x.to_string() });
        text = text + "\n" + &cells.collect::<Vec<_>>().join(",");
    }
    let leaves: Vec<&UnseenLeaf> = halves()?.iter().flat_map(|half| &half.leaves).collect();
    let us = median_of(halves()?.iter().map(|half| half.us)).unwrap_or(f64::NAN);
    let ours = row("peer", "mesophyll fit foliar, species that were not seen".into(), &leaves, us);
    Ok(PeerInputs { files: vec![("leaves.csv".into(), (text + "\n").into_bytes())], ours: vec![ours], turn: None })
}

/// What is left over wavelength: median, and the range of nine leaves in ten.
fn panel(half: &LeafHalf, through: usize) -> SpectrumPanel {
    let word = ["R", "T"][through];
    let line = |(name, share): (&str, f64)| {
        let at = |(w, wavelength): (usize, &f64)| {
            let mut all: Vec<f64> = half.leaves.iter().map(|l| l.left[w][through]).filter(|x| !x.is_nan()).collect();
            all.sort_by(f64::total_cmp);
            [*wavelength, percentile(&all, share).unwrap_or(f64::NAN), f64::NAN]
        };
        SpectrumLine { name: name.into(), points: half.wavelengths.iter().enumerate().map(at).collect(), dots: false }
    };
    let [species, _, others] = half.counts;
    SpectrumPanel {
        title: format!("{word}: {others} species, by {species} others"),
        across: spectrum::WAVELENGTH.into(),
        axis: format!("{word}, measured less fitted"),
        logarithmic: false,
        lines: [("median leaf", 0.5), ("95 % of leaves are below", 0.95), ("5 % of leaves are below", 0.05)]
            .map(line)
            .into(),
    }
}

/// Draws what is left of both halves over wavelength into `folder`; returns the files.
///
/// # Errors
/// As [`rows`], and a file that cannot be written.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let names = ["foliar-left-1", "foliar-left-2"].map(String::from);
    let of = |half: &LeafHalf| (0..2).map(|through| panel(half, through)).collect::<Vec<_>>();
    let all: Vec<(String, Vec<SpectrumPanel>)> = names.into_iter().zip(halves()?.iter().map(of)).collect();
    if all.is_empty() { Ok(Vec::new()) } else { spectrum::pictures(folder, &all) }
}
