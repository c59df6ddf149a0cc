//! Directions of a goniometer: which of them tell most about the gloss of leaves like those that were measured.

use crate::gloss::samples::{GlossFitSettings, GlossSample, GlossSampleFit, MeasuredGloss, fit};
use crate::gloss::{M_RANGE, normal_of};
use mesophyll_base::selection::{DesignAim, DesignParameter, DesignProblem, DesignSituation};
use std::f64::consts::PI;

/// What is known before any reading: reflectances, slope, and tilts of a leaf that was laid level (rad).
const KNOWN: [f64; 4] = [0.3, 0.4, 0.2, 0.2];
/// What is known of a diffuse reflectance.
const DIFFUSE: f64 = 0.5;
/// Directions that differ by less than this (degrees) are one.
const SAME: f64 = 0.5;
/// Step of differences.
const STEP: f64 = 1e-5;

/// A direction towards the viewer: zenith angle and azimuth from the source's (degrees). Where leaves have more than
/// one source, the source's zenith angle belongs to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GonioDirection {
    /// Zenith angle of the source, where leaves have several.
    pub source_zenith_deg: Option<f64>,
    /// Zenith angle of the viewer.
    pub view_zenith_deg: f64,
    /// Azimuth of the viewer from the source's; 180 is the side of the mirror direction.
    pub view_azimuth_deg: f64,
}

/// Directions to choose from, and the leaves that they have to serve.
#[derive(Debug, Clone)]
pub struct GonioDesign {
    /// The directions.
    pub directions: Vec<GonioDirection>,
    /// The problem of choosing among them.
    pub problem: DesignProblem,
    /// Names of the leaves that are served.
    pub leaves: Vec<String>,
    /// Names of the leaves that could not be fitted, with the reason.
    pub left_out: Vec<(String, String)>,
}

fn angles(v: [f64; 3]) -> [f64; 2] {
    [v[2].clamp(-1.0, 1.0).acos().to_degrees(), v[1].atan2(v[0]).to_degrees()]
}

impl GonioDirection {
    fn of(sample: &GlossSample, several: bool) -> GonioDirection {
        let ([source, from], [zenith, azimuth]) = (angles(sample.light), angles(sample.view));
        let turned = (azimuth - from).rem_euclid(360.0);
        GonioDirection {
            source_zenith_deg: several.then_some(source),
            view_zenith_deg: zenith,
            // Straight up has no azimuth.
            view_azimuth_deg: if zenith < SAME { 0.0 } else { turned },
        }
    }

    fn same(&self, other: &GonioDirection) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() < SAME;
        let turn = (self.view_azimuth_deg - other.view_azimuth_deg).rem_euclid(360.0);
        let source = match (self.source_zenith_deg, other.source_zenith_deg) {
            (Some(a), Some(b)) => near(a, b),
            _ => true,
        };
        source && near(self.view_zenith_deg, other.view_zenith_deg) && turn.min(360.0 - turn) < SAME
    }
}

impl GonioDesign {
    /// Fits the leaves and finds the directions at which they were read. A leaf that was not read at a direction, as
    /// where the source stood, is not thought to be read there.
    ///
    /// # Errors
    /// In words, where no leaf can be fitted.
    pub fn of(leaves: &[MeasuredGloss], settings: &GlossFitSettings, aim: DesignAim) -> Result<GonioDesign, String> {
        let source = |s: &GlossSample| s.light;
        let several = leaves.iter().any(|l| {
            let first = l.samples.first().map(source);
            l.samples.iter().any(|s| first.is_some_and(|f| (0..3).any(|k| (f[k] - s.light[k]).abs() > 1e-6)))
        });
        let mut directions: Vec<GonioDirection> = Vec::new();
        for sample in leaves.iter().flat_map(|l| &l.samples) {
            let direction = GonioDirection::of(sample, several);
            if !directions.iter().any(|d| d.same(&direction)) {
                directions.push(direction);
            }
        }
        let bands = leaves.iter().flat_map(|l| &l.samples).map(|s| s.values.len()).max().unwrap_or(0);
        let (mut situations, mut names, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        for leaf in leaves {
            match fit(&leaf.samples, settings) {
                Ok(found) if found.rho_d.len() == bands && found.m < M_RANGE[1] => {
                    situations.push(situation(leaf, &found, &directions, several));
                    names.push(leaf.name.clone());
                }
                Ok(_) => left_out.push((leaf.name.clone(), "its lobe is at an end of what is searched".into())),
                Err(why) => left_out.push((leaf.name.clone(), why)),
            }
        }
        if situations.is_empty() {
            let why = left_out.first().map(|(name, why)| format!(": {name}: {why}")).unwrap_or_default();
            return Err(format!("no leaf could be fitted{why}"));
        }
        let parameter = |name: String, known: f64, wanted: bool| DesignParameter { name, known, wanted };
        let diffuse = (0..bands).map(|k| parameter(format!("rho_d_{k}"), DIFFUSE, false));
        let names_of = ["rho_s", "m", "tilt", "tilt_y"];
        let rest = names_of.iter().zip(KNOWN).map(|(name, known)| parameter((*name).into(), known, true));
        let parameters = diffuse.chain(rest).collect();
        let problem = DesignProblem { aim, parameters, situations, taken: Vec::new() };
        Ok(GonioDesign { directions, problem, leaves: names, left_out })
    }
}

/// What the directions say of one leaf.
fn situation(
    leaf: &MeasuredGloss,
    found: &GlossSampleFit,
    directions: &[GonioDirection],
    several: bool,
) -> DesignSituation {
    let bands = found.rho_d.len();
    let sd = found.rms.max(1e-4);
    let value = |s: &GlossSample, m: f64, tilt: [f64; 2]| PI * found.lobe.value(normal_of(tilt), s.light, s.view, m);
    let rows = |direction: &GonioDirection| {
        let Some(s) = leaf.samples.iter().find(|s| GonioDirection::of(s, several).same(direction)) else {
            return Vec::new();
        };
        let slope = |by: [f64; 3]| {
            let at = |sign: f64| {
                let tilt = [found.tilt[0] + sign * by[1], found.tilt[1] + sign * by[2]];
                value(s, found.m + sign * by[0], tilt)
            };
            found.rho_s * (at(1.0) - at(-1.0)) / (2.0 * STEP)
        };
        let shared =
            [value(s, found.m, found.tilt), slope([STEP, 0.0, 0.0]), slope([0.0, STEP, 0.0]), slope([0.0, 0.0, STEP])];
        let mut rows = vec![0.0; bands * (bands + 4)];
        for (k, row) in rows.chunks_mut(bands + 4).enumerate() {
            row[k] = 1.0 / sd;
            row[bands..].iter_mut().zip(shared).for_each(|(to, v)| *to = v / sd);
        }
        rows
    };
    let values = found.rho_d.iter().copied().chain([found.rho_s, found.m, found.tilt[0], found.tilt[1]]).collect();
    DesignSituation { values, rows: directions.iter().map(rows).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gloss::synthetic::GaussianDeviates;
    use mesophyll_base::selection::evenly;
    use mesophyll_optics::gloss::Lobe;

    /// A leaf read at a grid of directions, with the noise of `seed`.
    fn leaf(name: &str, [rho_s, m, tilt]: [f64; 3], seed: u64) -> MeasuredGloss {
        let mut noise = GaussianDeviates::new(seed);
        let mut samples = vec![];
        for zenith in 0..=6 {
            for azimuth in (0..=180).step_by(30).take(if zenith == 0 { 1 } else { 7 }) {
                let at = [f64::from(zenith * 10), f64::from(azimuth)].map(f64::to_radians);
                let mut s = GlossSample::from_angles(40f64.to_radians(), at[0], at[1], vec![]);
                let gloss = PI * Lobe::Beckmann.value(normal_of([tilt, 0.02]), s.light, s.view, m);
                s.values = [0.1, 0.3].iter().map(|d| d + rho_s * gloss + 0.004 * noise.normal()).collect();
                samples.push(s);
            }
        }
        MeasuredGloss { name: name.into(), samples }
    }

    /// Ten directions chosen for some leaves predict the other directions of other leaves nearly as well as all do.
    #[test]
    fn ten_directions_predict_the_others_of_leaves_they_were_not_chosen_for() {
        let settings = GlossFitSettings::default();
        let known = [leaf("a", [0.05, 0.25, 0.05], 1), leaf("b", [0.03, 0.35, -0.04], 2)];
        let design = GonioDesign::of(&known, &settings, DesignAim::Predictions).unwrap();
        assert_eq!(design.directions.len(), 43);
        let choice = design.problem.choose(10).unwrap();
        let predicted = |sample: &MeasuredGloss, chosen: &[usize]| {
            let some: Vec<GlossSample> = chosen.iter().map(|k| sample.samples[*k].clone()).collect();
            let found = fit(&some, &settings).unwrap();
            let (mut sum, mut count) = (0.0, 0.0);
            for (_, s) in sample.samples.iter().enumerate().filter(|(k, _)| !choice.chosen.contains(k)) {
                let gloss = PI * found.lobe.value(normal_of(found.tilt), s.light, s.view, found.m);
                for (v, d) in s.values.iter().zip(&found.rho_d) {
                    sum += (v - d - found.rho_s * gloss).powi(2);
                    count += 1.0;
                }
            }
            f64::sqrt(sum / count)
        };
        let all: Vec<usize> = (0..43).collect();
        for seed in 3..6 {
            let unseen = leaf("c", [0.04, 0.3, 0.03], seed);
            let (some, whole) = (predicted(&unseen, &choice.chosen), predicted(&unseen, &all));
            assert!(some < 1.25 * whole, "{some} {whole}");
        }
        let even = design.problem.judge(&evenly(43, 10)).unwrap();
        assert!(choice.ratio < 0.9 * even.ratio, "{} {}", choice.ratio, even.ratio);
    }

    /// Where the source stands nobody can look from; the direction is no choice for such a leaf.
    #[test]
    fn a_direction_that_no_leaf_has_is_no_direction() {
        let mut one = leaf("a", [0.05, 0.25, 0.05], 1);
        let other = one.clone();
        one.samples.remove(7);
        let design = GonioDesign::of(&[one, other], &GlossFitSettings::default(), DesignAim::Parameters).unwrap();
        let empty = |s: &DesignSituation| s.rows.iter().filter(|r| r.is_empty()).count();
        assert_eq!(design.problem.situations.iter().map(empty).collect::<Vec<_>>(), [1, 0]);
    }
}
