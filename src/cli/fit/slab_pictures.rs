//! σa and σs over wavelength, a picture for each leaf.

use mesophyll_report::spectrum::{self, SpectrumLine, SpectrumPanel};
use std::collections::HashMap;

/// One picture for each leaf, in order of first appearance. The rows may be in any order; each has its number, leaf,
/// wavelength and answer.
pub fn panels(mut rows: Vec<(usize, String, f64, Vec<f64>)>) -> Vec<(String, Vec<SpectrumPanel>)> {
    rows.sort_by_key(|r| r.0);
    let mut leaves: Vec<(String, Vec<(f64, Vec<f64>)>)> = Vec::new();
    let mut places = HashMap::new();
    for (_, leaf, wavelength, values) in rows {
        let place = *places.entry(leaf.clone()).or_insert_with(|| {
            leaves.push((leaf, Vec::new()));
            leaves.len() - 1
        });
        leaves[place].1.push((wavelength, values));
    }
    let panels = |(leaf, mut points): (String, Vec<(f64, Vec<f64>)>)| {
        points.retain(|p| p.0.is_finite());
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let panel = |k: usize, name: &str, word: &str| SpectrumPanel {
            title: format!("{leaf}: {word}"),
            across: spectrum::WAVELENGTH.into(),
            axis: format!("{name} (1/mm)"),
            logarithmic: true,
            lines: vec![SpectrumLine {
                name: name.into(),
                points: points.iter().map(|(w, v)| [*w, v[k], v[k + 2]]).collect(),
                dots: false,
            }],
        };
        let both = vec![panel(0, "σa", "absorption"), panel(1, "σs", "scattering")];
        (leaf, both)
    };
    leaves.into_iter().map(panels).collect()
}
