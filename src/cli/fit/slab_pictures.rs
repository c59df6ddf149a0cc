//! σa and σs over wavelength, a picture for each leaf.

use mesophyll_report::spectrum::{self, SpectrumLine, SpectrumPanel};
use std::collections::HashMap;

/// A row with an answer, for the picture of its leaf.
pub struct PlottedRow {
    pub number: usize,
    pub leaf: String,
    /// Wavelength (nm); NaN where it is not known.
    pub wavelength: f64,
    /// The answer: σa, σs and their errors.
    pub values: Vec<f64>,
}

/// One picture for each leaf, in order of first appearance. The rows may be in any order.
pub fn panels(mut rows: Vec<PlottedRow>) -> Vec<(String, Vec<SpectrumPanel>)> {
    rows.sort_by_key(|r| r.number);
    let mut leaves: Vec<(String, Vec<PlottedRow>)> = Vec::new();
    let mut places = HashMap::new();
    for row in rows {
        let place = *places.entry(row.leaf.clone()).or_insert_with(|| {
            leaves.push((row.leaf.clone(), Vec::new()));
            leaves.len() - 1
        });
        leaves[place].1.push(row);
    }
    let panels = |(leaf, mut points): (String, Vec<PlottedRow>)| {
        points.retain(|p| p.wavelength.is_finite());
        points.sort_by(|a, b| a.wavelength.total_cmp(&b.wavelength));
        let panel = |k: usize, name: &str, word: &str| SpectrumPanel {
            title: format!("{leaf}: {word}"),
            across: spectrum::WAVELENGTH.into(),
            axis: format!("{name} (1/mm)"),
            logarithmic: true,
            lines: vec![SpectrumLine {
                name: name.into(),
                points: points.iter().map(|p| [p.wavelength, p.values[k], p.values[k + 2]]).collect(),
                dots: false,
            }],
        };
        let both = vec![panel(0, "σa", "absorption"), panel(1, "σs", "scattering")];
        (leaf, both)
    };
    leaves.into_iter().map(panels).collect()
}
