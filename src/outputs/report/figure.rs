//! What every figure of a `fit.toml` is called on the page: a plain name, its unit, and a sentence on what it means
//! (`figures.txt`). A figure that is not listed there is never shown under its raw key; [`unnamed`] finds such figures
//! for the tests.

use crate::number::{count, percent, plain};
use crate::quantity::channel_word;
use mesophyll_fits::record::FitRecord;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// One line of the page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ReportFigure {
    /// What the figure is called on the page.
    pub name: String,
    /// The figure as it is printed, with its unit.
    pub value: String,
    /// The meaning of the figure in one sentence.
    pub meaning: &'static str,
}

/// A row of `figures.txt`: key, name, unit, meaning.
type Row = [&'static str; 4];

fn catalogue() -> &'static [Row] {
    static ROWS: OnceLock<Vec<Row>> = OnceLock::new();
    ROWS.get_or_init(|| rows(include_str!("figures.txt")))
}

/// The cells of every line, which are separated by `|`; remarks follow a `#`.
fn rows<const N: usize>(text: &'static str) -> Vec<[&'static str; N]> {
    let lines = text.lines().filter(|l| !l.starts_with('#'));
    lines.filter_map(|l| l.split('|').map(str::trim).collect::<Vec<_>>().try_into().ok()).collect()
}

/// Row and colour channel or wavelength of a key: `sigma_a.R_relative_error`, `slope_noise`, `slab_sigma_a_550nm`.
fn entry(key: &str) -> Option<(usize, &str)> {
    let find = |key: &str| catalogue().iter().position(|row| row[0] == key);
    if let Some(at) = find(key) {
        return Some((at, ""));
    }
    if let Some((head, channel @ ("R" | "G" | "B"))) = key.rsplit_once('.') {
        return Some((find(head)?, channel));
    }
    if let Some((head, tail)) = key.split_once('.') {
        let (channel, tail) = tail.split_once('_')?;
        return Some((find(&format!("{head}_{tail}"))?, channel));
    }
    key.rmatch_indices('_').find_map(|(at, _)| Some((find(&key[..at])?, &key[at + 1..])))
}

/// The line of a figure; `None` for one that has no name.
pub fn figure(key: &str, value: f64) -> Option<ReportFigure> {
    let (at, channel) = entry(key)?;
    let [_, name, unit, meaning] = catalogue()[at];
    let name = if channel.is_empty() { name.to_string() } else { format!("{name}, {}", channel_word(channel)) };
    let value = match unit {
        "%" => percent(value),
        "#" if value >= 0.0 => count(value as usize),
        "#" | "" => plain(value),
        "°" => format!("{}°", plain(value)),
        unit => format!("{} {unit}", plain(value)),
    };
    Some(ReportFigure { name, value, meaning })
}

/// The figures that are shown by themselves, in the catalogue's order, and the number of figures without a name.
pub fn lines<'a>(all: impl Iterator<Item = (&'a String, &'a f64)>) -> (Vec<ReportFigure>, usize) {
    let mut keys: Vec<_> = all.collect();
    keys.sort_by_key(|(key, _)| entry(key).map_or(usize::MAX, |e| e.0));
    let found: Vec<ReportFigure> = keys.iter().filter_map(|(key, v)| figure(key, **v)).collect();
    let without = keys.len() - found.len();
    (found, without)
}

/// The keys of a record's figures that have no name. The errors of a basis have their own table and are left out.
pub fn unnamed(record: &FitRecord) -> Vec<String> {
    let figures = record.sections.values().flat_map(|s| &s.figures);
    figures
        .filter(|(key, v)| !key.starts_with("basis_") && figure(key, **v).is_none())
        .map(|(key, _)| key.clone())
        .collect()
}

/// A key in words: `iteration_limit` → `stopped at the iteration limit`. In a key that is not in `words.txt`,
/// underscores become spaces.
pub fn words(key: &str) -> String {
    static WORDS: OnceLock<BTreeMap<&str, &str>> = OnceLock::new();
    if let Some((problem, ending)) = key.split_once(':') {
        return format!("{}: {}", words(problem), words(ending.trim_start()));
    }
    let all = WORDS.get_or_init(|| rows::<2>(include_str!("words.txt")).into_iter().map(|[k, w]| (k, w)).collect());
    all.get(key).map_or_else(|| key.replace('_', " "), |w| (*w).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_names_units_and_meanings() {
        let shown = |key: &str, value: f64| figure(key, value).map(|f| (f.name, f.value)).unwrap();
        assert_eq!(shown("sigma_a.R_relative_error", -0.0123), ("error of σa, red".into(), "−1.2 %".into()));
        assert_eq!(shown("sigma_a_off_slab_in_errors_550nm", 1.25).1, "1.25 combined standard errors");
        assert_eq!(shown("slab_sigma_a_G", 3.5), ("σa by the slab fit, green".into(), "3.5 1/mm".into()));
        assert_eq!(shown("blade_area_mm2", 2.5).1, "2.5 mm²");
        let apart = shown("apart_in_errors.sigma_a.R", 2.5);
        assert_eq!(
            apart,
            ("σa, front against back, in errors of the noise, red".into(), "2.5 combined standard errors".into())
        );
        assert_eq!(figure("a_new_key_that_nobody_named", 1.0), None);
        assert!(catalogue().len() > 60);
        let text = include_str!("figures.txt").lines().filter(|l| !l.starts_with('#')).count();
        assert_eq!(text, catalogue().len(), "a line without its four cells");
        for [key, name, _, meaning] in catalogue() {
            assert!(!name.contains('_') && meaning.ends_with('.'), "{key}");
        }
    }

    #[test]
    fn a_figure_without_a_name_is_counted_and_not_printed() {
        let all = BTreeMap::from([("error_worst".to_string(), 1e-5), ("nobody_named_this".to_string(), 3.0)]);
        let (found, without) = lines(all.iter());
        assert_eq!((found.len(), without), (1, 1));
    }

    #[test]
    fn endings_are_said_in_words() {
        assert_eq!(words("leaf_wide:step_small"), "the common fit of σa and σs: converged: the step is negligible");
        assert_eq!(words("front: fit texels"), "front: fit texels");
    }
}
