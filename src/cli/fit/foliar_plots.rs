//! Pictures of what `fit foliar` made of a leaf: measured and computed spectra, and what is left between them.

use mesophyll_report::spectrum::{self, SpectrumLine, SpectrumPanel};

/// A reading with what was computed for it.
pub(super) struct PlottedReading {
    pub wavelength: f64,
    pub below: bool,
    pub through: bool,
    pub value: f64,
    pub err: f64,
    pub computed: f64,
}

/// R and T over wavelength, as measured and as computed for the fitted leaf, and measured less computed.
pub(super) fn panels(leaf: &str, readings: &[PlottedReading]) -> Vec<SpectrumPanel> {
    let words = |through: bool| if through { "transmittance" } else { "reflectance" };
    let sides: Vec<bool> =
        [false, true].into_iter().filter(|below| readings.iter().any(|r| r.below == *below)).collect();
    let of = |below: bool, through: bool, value: &dyn Fn(&PlottedReading) -> [f64; 2]| -> Vec<[f64; 3]> {
        let mut points: Vec<[f64; 3]> = readings
            .iter()
            .filter(|r| (r.below, r.through) == (below, through))
            .map(|r| [r.wavelength, value(r)[0], value(r)[1]])
            .collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points
    };
    let suffix = |below: bool| match (sides.len(), below) {
        (1, _) => "",
        (_, false) => ", from above",
        (_, true) => ", from below",
    };
    let panel = |title: String, axis: &str, lines: Vec<SpectrumLine>| SpectrumPanel {
        title,
        across: spectrum::WAVELENGTH.into(),
        axis: axis.into(),
        logarithmic: false,
        lines,
    };
    let mut out: Vec<SpectrumPanel> = [false, true]
        .map(|through| {
            let lines = |below: &bool| {
                let measured = of(*below, through, &|r| [r.value, r.err]);
                let fitted = of(*below, through, &|r| [r.computed, f64::NAN]);
                [("measured", measured, true), ("fitted", fitted, false)].map(|(name, points, dots)| SpectrumLine {
                    name: format!("{name}{}", suffix(*below)),
                    points,
                    dots,
                })
            };
            panel(format!("{leaf}: {}", words(through)), words(through), sides.iter().flat_map(lines).collect())
        })
        .into();
    let left = |(below, through): (bool, bool)| SpectrumLine {
        name: format!("{}{}", words(through), suffix(below)),
        points: of(below, through, &|r| [r.value - r.computed, f64::NAN]),
        dots: false,
    };
    let all = sides.iter().flat_map(|below| [false, true].map(|through| (*below, through)));
    let lines: Vec<SpectrumLine> = all.map(left).filter(|line| !line.points.is_empty()).collect();
    out.push(panel(format!("{leaf}: measured less fitted"), "measured less fitted", lines));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_measured_less_fitted_of_each_side() {
        let of = |wavelength: f64, below: bool, through: bool| PlottedReading {
            wavelength,
            below,
            through,
            value: 0.5,
            err: f64::NAN,
            computed: 0.4 + 1e-4 * wavelength,
        };
        let panels = panels("a", &[of(600.0, false, false), of(500.0, false, false), of(500.0, true, true)]);
        assert_eq!(panels.len(), 3);
        let names: Vec<&str> = panels[2].lines.iter().map(|l| l.name.as_str()).collect();
        assert_eq!(names, ["reflectance, from above", "transmittance, from below"]);
        let points = &panels[2].lines[0].points;
        assert!(points[0][0] == 500.0 && (points[0][1] - 0.05).abs() < 1e-12 && points.len() == 2, "{points:?}");
    }
}
