//! Spectra of several detectors that overlap, joined to one with ascending wavelengths.

/// A joined spectrum.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Joined {
    /// Which readings are kept; their wavelengths ascend.
    pub kept: Vec<usize>,
    /// Where the detectors change (nm) and how much more the longer detector reads there than the shorter one,
    /// relative to it (NaN where that cannot be said).
    pub joins: Vec<(f64, f64)>,
}

/// No instrument has more detectors.
const MOST_DETECTORS: usize = 8;

/// Joins the readings of detectors that follow each other. A detector begins where the wavelength goes back. Two
/// detectors share the range from the first wavelength of the longer one to the last of the shorter one, and the
/// detectors change in the middle of it: each detector is weak at its own end. `readings`: wavelength (nm) and value.
///
/// # Errors
/// Where a range that begins anew is not the continuation of the one before: the sentence that says so.
pub(super) fn joined(readings: &[[f64; 2]]) -> Result<Joined, String> {
    let starts = (1..readings.len()).filter(|&k| readings[k][0] <= readings[k - 1][0]);
    let edges: Vec<usize> = std::iter::once(0).chain(starts).chain([readings.len()]).collect();
    let spans: Vec<&[[f64; 2]]> = edges.windows(2).map(|e| &readings[e[0]..e[1]]).filter(|s| !s.is_empty()).collect();
    if spans.len() > MOST_DETECTORS {
        return Err(format!(
            "the wavelengths go back {} times; expected at most 7 joins of detectors",
            spans.len() - 1
        ));
    }
    let mut joins = Vec::new();
    for pair in spans.windows(2) {
        let ([[first, _], .., [end, _]], [[begin, _], .., [last, _]]) = (pair[0], pair[1]) else {
            return Err(format!("a single wavelength, {} nm, stands out of order", pair[1][0][0]));
        };
        if !(begin > first && last > end) {
            return Err(format!(
                "the wavelengths go back from {end} to {begin} nm and on to {last} nm, which continues no detector \
                 that reads {first} to {end} nm"
            ));
        }
        let mean = |span: &[[f64; 2]]| {
            let shared: Vec<f64> = span.iter().filter(|p| p[0] >= *begin && p[0] <= *end).map(|p| p[1]).collect();
            shared.iter().sum::<f64>() / shared.len() as f64
        };
        let (shorter, longer) = (mean(pair[0]), mean(pair[1]));
        let step = if shorter > 0.0 && longer > 0.0 { longer / shorter - 1.0 } else { f64::NAN };
        joins.push((0.5 * (begin + end), step));
    }
    if let Some(k) = (1..joins.len()).find(|&k| joins[k].0 <= joins[k - 1].0) {
        return Err(format!("the joins of detectors, {} and {} nm, do not ascend", joins[k - 1].0, joins[k].0));
    }
    let inside = |detector: usize, w: f64| {
        let after = detector == 0 || w >= joins[detector - 1].0;
        after && joins.get(detector).is_none_or(|(end, _)| w < *end)
    };
    let detector = |k: usize| edges.iter().filter(|e| **e <= k).count() - 1;
    let kept = (0..readings.len()).filter(|&k| inside(detector(k), readings[k][0])).collect();
    Ok(Joined { kept, joins })
}

impl Joined {
    /// What is said of the joins; a step below 2 % is not worth a word.
    pub fn notes(&self) -> Vec<String> {
        let places: Vec<String> = self.joins.iter().map(|(w, _)| format!("{w:.1} nm")).collect();
        let mut notes = Vec::new();
        if !places.is_empty() {
            notes.push(format!(
                "detectors overlap and are joined in the middle of their overlap, at {}",
                places.join(" and ")
            ));
        }
        for (w, step) in self.joins.iter().filter(|(_, step)| step.abs() >= 0.02) {
            let more = if *step > 0.0 { "more" } else { "less" };
            notes.push(format!(
                "at {w:.1} nm the next detector reads {:.1} % {more} than the one before: the spectrum has a step",
                100.0 * step.abs()
            ));
        }
        notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three detectors with an overlap of 40 and of 2 nm, the second one 10 % high.
    #[test]
    fn detectors_are_joined_in_the_middle_of_their_overlap() {
        let range = |from: f64, to: f64, step: f64, value: f64| {
            let n = ((to - from) / step).round() as usize;
            (0..=n).map(move |k| [from + k as f64 * step, value])
        };
        let spans: [Vec<[f64; 2]>; 3] = [
            range(340.0, 1010.0, 1.5, 0.4).collect(),
            range(970.0, 1910.0, 3.5, 0.44).collect(),
            range(1908.0, 2515.0, 2.5, 0.44).collect(),
        ];
        let readings = spans.concat();
        let found = joined(&readings).unwrap();
        let kept: Vec<[f64; 2]> = found.kept.iter().map(|&k| readings[k]).collect();
        assert!(kept.windows(2).all(|p| p[0][0] < p[1][0]));
        let end = |span: usize| spans[span].last().unwrap()[0];
        let middles = [0.5 * (970.0 + end(0)), 0.5 * (1908.0 + end(1))];
        for (join, want) in found.joins.iter().zip(middles) {
            assert!((join.0 - want).abs() < 1e-9, "{:?}", found.joins);
        }
        assert!((found.joins[0].1 - 0.1).abs() < 1e-9 && found.joins[1].1.abs() < 1e-9);
        // The value tells the detector.
        assert!(kept.iter().all(|p| (p[1] == 0.4) == (p[0] < middles[0])));
        assert_eq!(found.notes().len(), 2, "{:?}", found.notes());
    }

    #[test]
    fn what_is_no_overlap_is_named() {
        let ascending = [[400.0, 1.0], [401.0, 1.0]];
        assert_eq!(joined(&ascending).unwrap(), Joined { kept: vec![0, 1], joins: Vec::new() });
        assert_eq!(joined(&[]).unwrap().kept, [] as [usize; 0]);
        let twice = [ascending, ascending].concat();
        assert!(joined(&twice).unwrap_err().contains("continues no detector"));
        let back = [[402.0, 1.0], [401.0, 1.0], [400.0, 1.0]];
        assert!(joined(&back).unwrap_err().contains("out of order"));
        let saw: Vec<[f64; 2]> = (0..100).map(|k| [400.0 + f64::from(k % 2), 1.0]).collect();
        assert!(joined(&saw).unwrap_err().contains("go back"));
        assert!(joined(&[[f64::NAN, 1.0], [1.0, f64::NAN]]).is_ok());
    }
}
