//! Whether a lobe describes a leaf's readings: patterns of the residuals over the directions.

use super::GlossSample;
use super::scatter::{Part, Residuals};
use crate::gloss::normal_of;
use mesophyll_base::solvers::ResidualNoise;
use mesophyll_base::solvers::adequacy::{self, ReadingOrder, SolutionResiduals};
use mesophyll_optics::gloss::{dot, tan2_half};

/// A reading that is farther from the rest than this many standard deviations is no noise: of a million readings with
/// noise, two are.
const FAR: f64 = 5.0;
/// With fewer contrasts between columns than this, noise that grows with the reading looks like a pattern of them.
const CONTRASTS: usize = 60;
/// Directions whose angles differ by less than this (rad) stand in one line of the goniometer.
const SAME: f64 = 0.01;

/// How well a fit describes its readings.
#[derive(Debug, Clone, Default)]
pub(super) struct Judgement {
    /// Why it does not, as a part of a sentence; `None` where it does.
    pub why: Option<String>,
    /// Factor by which the standard error of each parameter has to be multiplied, 1 or more.
    pub widening: Vec<f64>,
}

/// Judges a fit whose normal has these tilts. `floor`: residuals whose root mean square is below it are rounding.
pub(super) fn judge(samples: &[GlossSample], fit: &Residuals, tilts: [f64; 2], floor: f64) -> Judgement {
    let common = patterns(samples, &fit.common, tilts, floor);
    let contrasts = patterns(samples, &fit.contrasts, tilts, floor);
    // A single column has no contrasts.
    let widening = common.widening.iter().enumerate().map(|(k, w)| contrasts.widening.get(k).map_or(*w, |c| w.max(*c)));
    let widening = widening.collect();
    let enough = fit.contrasts.freedom() >= CONTRASTS;
    let between = contrasts
        .why
        .filter(|_| enough)
        .map(|why| format!("the value columns differ in more than their diffuse level: {why}"));
    Judgement { why: common.why.or(between).or_else(|| stray(samples, fit, floor)), widening }
}

fn patterns(samples: &[GlossSample], part: &Part, tilts: [f64; 2], floor: f64) -> Judgement {
    let parameters = part.rows.first().map_or(0, Vec::len);
    if part.freedom() < 3 {
        return Judgement { why: None, widening: vec![1.0; parameters] };
    }
    let along = orders(samples, part, tilts);
    let jacobian = part.jacobian();
    let mut found = adequacy::judge(&SolutionResiduals {
        residuals: &part.r,
        jacobian: &jacobian,
        noise: ResidualNoise::Estimated,
        floor,
        along: &along,
    });
    // The first findings say enough.
    found.findings.truncate(2);
    let why = found.why("leaf").map(|why| why.replacen("the model does not describe this leaf: ", "", 1));
    Judgement { why, widening: found.widening }
}

/// Lines of directions in which neighbours would agree if the lobe were wrong.
fn orders(samples: &[GlossSample], part: &Part, tilts: [f64; 2]) -> Vec<ReadingOrder> {
    let normal = normal_of(tilts);
    let of = |i: &usize| &samples[part.sample[*i]];
    let azimuth = |d: [f64; 3]| if d[2] > 1.0 - 1e-9 { 0.0 } else { d[1].atan2(d[0]) };
    let zenith = |d: [f64; 3]| d[2].clamp(-1.0, 1.0).acos();
    let source = |s: &GlossSample| [zenith(s.light), azimuth(s.light)];
    // Through the zenith from one side to the other: azimuths that differ by half a turn are one plane.
    let plane = |d: [f64; 3]| {
        let a = azimuth(d).rem_euclid(std::f64::consts::PI);
        if std::f64::consts::PI - a < SAME { 0.0 } else { a }
    };
    let signed = |d: [f64; 3]| {
        let a = azimuth(d);
        let back = !(-SAME..std::f64::consts::PI - SAME).contains(&a);
        if back { -zenith(d) } else { zenith(d) }
    };
    let from_mirror =
        |s: &GlossSample| tan2_half(dot(normal, s.light) + dot(normal, s.view), 1.0 + dot(s.light, s.view));
    let all: Vec<usize> = (0..part.r.len()).collect();
    let grouped = |key: &dyn Fn(&GlossSample) -> Vec<f64>, by: &dyn Fn(&GlossSample) -> f64, least: usize| {
        let mut runs: Vec<(Vec<f64>, Vec<usize>)> = Vec::new();
        for &i in &all {
            // Different contrasts do not follow one another.
            let key: Vec<f64> = key(of(&i)).into_iter().chain([part.which[i] as f64]).collect();
            let same = |other: &Vec<f64>| other.iter().zip(&key).all(|(a, b)| (a - b).abs() < SAME);
            match runs.iter_mut().find(|run| same(&run.0)) {
                Some(run) => run.1.push(i),
                None => runs.push((key, vec![i])),
            }
        }
        let sorted = |mut run: Vec<usize>| {
            run.sort_by(|a, b| by(of(a)).total_cmp(&by(of(b))));
            run
        };
        runs.into_iter().map(|run| run.1).filter(|run| run.len() >= least).map(sorted).collect::<Vec<_>>()
    };
    let mut out = Vec::new();
    let mut add = |name, runs: Vec<Vec<usize>>| {
        if runs.iter().map(Vec::len).sum::<usize>() >= 5 {
            out.push(ReadingOrder { name, runs });
        }
    };
    add("view zenith", grouped(&|s| source(s).into_iter().chain([plane(s.view)]).collect(), &|s| signed(s.view), 3));
    add("view azimuth", grouped(&|s| source(s).into_iter().chain([zenith(s.view)]).collect(), &|s| azimuth(s.view), 4));
    let by_source = grouped(&|s| source(s).to_vec(), &from_mirror, 5);
    // Scattered directions have a source each: then all of them are one line.
    let whole = if by_source.is_empty() { grouped(&|_| Vec::new(), &from_mirror, 5) } else { by_source };
    add("angle from the mirror direction", whole);
    if all.len() >= 40 {
        // Fresnel's reflectance and masking depend on how obliquely the facets are met, where the lobe is bright.
        let rings = |run: Vec<usize>| {
            let count = run.len().div_ceil(6);
            run.chunks(count).take(4).map(<[usize]>::to_vec).collect::<Vec<_>>()
        };
        let rings: Vec<Vec<usize>> = grouped(&|_| Vec::new(), &from_mirror, 1).into_iter().flat_map(rings).collect();
        let sorted = |mut ring: Vec<usize>| {
            ring.sort_by(|a, b| dot(of(b).light, of(b).view).total_cmp(&dot(of(a).light, of(a).view)));
            ring
        };
        add("angle of incidence", rings.into_iter().map(sorted).collect());
    }
    out
}

/// A single reading that does not belong to the others.
fn stray(samples: &[GlossSample], fit: &Residuals, floor: f64) -> Option<String> {
    let n = fit.plain.len() as f64;
    let square = |r: &super::scatter::Plain| r.weight * r.residual * r.residual;
    let sum: f64 = fit.plain.iter().map(square).sum();
    let freedom = n - (fit.common.rank + fit.contrasts.rank) as f64;
    if freedom < 8.0 || !(sum > n * floor * floor) {
        return None;
    }
    // Each is compared with the scatter of the others.
    let far = |r: &super::scatter::Plain| {
        let own = square(r) / (1.0 - r.leverage).max(1e-3);
        (own / ((sum - own).max(0.0) / (freedom - 1.0)).max(floor * floor)).sqrt()
    };
    let worst = fit.plain.iter().map(|r| (far(r), r)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    // With few degrees of freedom the ratio has the long tails of Student's distribution.
    let limit = FAR * (1.0 + 12.0 / freedom);
    (worst.0 > limit).then(|| {
        let sample = &samples[worst.1.sample];
        let angle = |d: [f64; 3]| d[2].clamp(-1.0, 1.0).acos().to_degrees();
        format!(
            "the reading {:.4} at source zenith {:.0} and view zenith {:.0} lies {:.0} standard deviations from the \
             rest",
            sample.values[worst.1.column],
            angle(sample.light),
            angle(sample.view),
            worst.0
        )
    })
}
