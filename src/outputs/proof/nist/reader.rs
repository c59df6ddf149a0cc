//! Reader of the StRD files: starts and certified values from line 41, data from line 61, as each file's header says.

use crate::precise::DoubleDouble;
use crate::{Error, Result};
use std::path::Path;

/// One problem file.
#[derive(Debug, Clone, PartialEq)]
pub struct NistDataset {
    /// The problem's name, as NIST has it.
    pub name: String,
    /// The two starting points.
    pub starts: [Vec<f64>; 2],
    /// Certified parameter values.
    pub values: Vec<f64>,
    /// Certified standard deviations of the parameters.
    pub deviations: Vec<f64>,
    /// Certified residual sum of squares.
    pub sum_of_squares: f64,
    /// Certified residual standard deviation.
    pub residual_deviation: f64,
    /// Rows of response and predictors, kept to more digits than double precision holds.
    pub rows: Vec<Vec<DoubleDouble>>,
}

/// Reads the text of a StRD file; `place` names it in errors.
///
/// # Errors
/// [`Error::Input`] where a line does not hold what the format says.
pub fn parse(text: &str, place: &str) -> Result<NistDataset> {
    let lines: Vec<&str> = text.lines().collect();
    let wrong = |line: usize, what: String| Error::field(Path::new(place), &format!("line {line}"), what);
    let number = |line: usize, text: &str| -> Result<f64> {
        text.parse::<f64>()
            .ok()
            .filter(|v| v.is_finite())
            .ok_or_else(|| wrong(line, format!("{text:?} is not a number")))
    };
    let name = field(&lines, "Dataset Name:")
        .and_then(|rest| rest.split_whitespace().next())
        .ok_or_else(|| wrong(2, "no dataset name".into()))?
        .to_string();

    let mut starts = [Vec::new(), Vec::new()];
    let (mut values, mut deviations) = (Vec::new(), Vec::new());
    let mut line = 41;
    while let Some((label, rest)) = lines.get(line - 1).and_then(|l| l.split_once('=')) {
        if label.trim() != format!("b{}", values.len() + 1) {
            return Err(wrong(line, format!("parameter b{} expected, found {:?}", values.len() + 1, label.trim())));
        }
        let cells: Vec<&str> = rest.split_whitespace().collect();
        let [first, second, value, deviation] = cells[..] else {
            return Err(wrong(
                line,
                format!("two starts, a value and a deviation expected, found {} numbers", cells.len()),
            ));
        };
        starts[0].push(number(line, first)?);
        starts[1].push(number(line, second)?);
        values.push(number(line, value)?);
        deviations.push(number(line, deviation)?);
        line += 1;
    }
    if values.is_empty() {
        return Err(wrong(41, "no parameters".into()));
    }
    let labelled = |label: &str| -> Result<f64> {
        let text = field(&lines, label).ok_or_else(|| Error::input(Path::new(place), format!("no line {label:?}")))?;
        number(line, text.trim())
    };
    let sum_of_squares = labelled("Residual Sum of Squares:")?;
    let residual_deviation = labelled("Residual Standard Deviation:")?;
    let observations = labelled("Number of Observations:")? as usize;

    let mut rows: Vec<Vec<DoubleDouble>> = Vec::new();
    for (k, text) in lines.iter().enumerate().skip(60).filter(|(_, l)| !l.trim().is_empty()) {
        let row: Option<Vec<DoubleDouble>> = text.split_whitespace().map(DoubleDouble::parse).collect();
        let row = row.filter(|r| r.len() >= 2 && rows.first().is_none_or(|first| first.len() == r.len()));
        rows.push(row.ok_or_else(|| wrong(k + 1, format!("a response and its predictors expected, found {text:?}")))?);
    }
    if rows.len() != observations {
        return Err(wrong(61, format!("{observations} observations announced, {} found", rows.len())));
    }
    Ok(NistDataset { name, starts, values, deviations, sum_of_squares, residual_deviation, rows })
}

fn field<'a>(lines: &[&'a str], label: &str) -> Option<&'a str> {
    lines.iter().find_map(|l| l.trim_start().strip_prefix(label))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/nist/Nelson.dat"));

    #[test]
    fn a_file_with_two_predictors_is_read() {
        let set = parse(TEXT, "Nelson.dat").unwrap();
        assert_eq!(set.name, "Nelson");
        assert_eq!(set.starts, [vec![2.0, 0.0001, -0.01], vec![2.5, 5e-9, -0.05]]);
        assert_eq!((set.values[1], set.deviations[2]), (5.6177717026e-9, 3.9572366543e-3));
        assert_eq!((set.rows.len(), set.rows[0].len()), (128, 3));
    }

    #[test]
    fn damaged_files_are_named_by_line() {
        let damage = |from: &str, to: &str| parse(&TEXT.replacen(from, to, 1), "Nelson.dat").unwrap_err().to_string();
        assert!(damage("15.00E0", "15.0O").contains("line 61"));
        assert!(damage("b2 =", "b3 =").contains("line 42"));
        assert!(damage("0.000000005", "").contains("found 3 numbers"));
        assert!(damage("Observations:                           128", "Observations: 129").contains("128 found"));
        assert!(damage("Residual Sum of Squares:", "").contains("Residual Sum of Squares"));
    }
}
