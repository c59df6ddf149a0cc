//! A vein's shadow: the convolution compared with the walk through the relief.
//!
//! A straight ridge (a raised cosine) stands on one face of a flat lamina of the paper's tissue, and light falls across
//! it. Profiles are relative to the lamina beside the ridge, so that the error of a form's total does not count twice.
//! A row's error is the root mean square of the difference of the profiles. Standard errors come from a jackknife over
//! independent runs.

use super::plane::{inner_reflectance, medium};
use super::{OracleEffort, row};
use crate::bench::BenchRow;
use crate::{Error, Result};
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::side::Side;
use mesophyll_optics::translucency::blade::BladeMaps;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance};
use mesophyll_optics::walk::rough::RoughSurface;
use mesophyll_optics::walk::{
    Boundary, FieldRim, Histories, HistoryEstimate, IncidentLight, LeafHeightField, ReliefLeaf,
};
use std::time::Instant;

/// mm
const TEXEL: f64 = 0.04;
const LAMINA: f64 = 0.2;
/// Texels of a profile (one period of the oracle's relief).
const N: usize = 100;
/// Columns and rows of the model's map: the profile, and the distance that its kernels reach.
const WIDE: usize = 2 * N;
const LONG: usize = 121;
/// Independent runs of the oracle.
const RUNS: usize = 8;
/// Refractive index of the dielectric, and the slope of its facets.
const INDEX: f64 = 1.4;
const SLOPE: f64 = 0.35;

/// A straight ridge on a lamina of 0.2 mm: its height and its full width at half height, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProofVein {
    /// Its name in rows.
    pub name: &'static str,
    /// Height of the crest over the lamina (mm).
    pub rise: f64,
    /// Full width at half height (mm).
    pub width: f64,
}

/// Their slopes reach 50° and 15°.
pub const VEINS: [ProofVein; 2] =
    [ProofVein { name: "steep", rise: 0.3, width: 0.4 }, ProofVein { name: "gentle", rise: 0.1, width: 0.6 }];

impl ProofVein {
    /// Heights at the centres of texels; the crest is in the middle of `n` texels.
    fn heights(&self, n: usize) -> Vec<f64> {
        (0..n)
            .map(|k| {
                let x = (k as f64 + 0.5 - 0.5 * n as f64) * TEXEL;
                if x.abs() < self.width {
                    self.rise * (0.5 * std::f64::consts::PI * x / self.width).cos().powi(2)
                } else {
                    0.0
                }
            })
            .collect()
    }

    /// Height of one face over the mid plane, outward.
    fn face(&self, n: usize, face: RidgeFace, ridge: RidgeFace) -> Vec<f64> {
        self.heights(n).iter().map(|h| 0.5 * LAMINA + if face == ridge { *h } else { 0.0 }).collect()
    }
}

/// On which face the ridge stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RidgeFace {
    /// The face that the light enters.
    Lit,
    /// The face that the light leaves.
    Unlit,
}

/// How the oracle's faces treat light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OracleFaces {
    /// They do nothing; light goes straight in.
    Clear,
    /// Light enters and leaves Lambertian about the face.
    Spread,
    /// n = 1.4, slope .35.
    Dielectric,
}

impl OracleFaces {
    fn name(self) -> &'static str {
        match self {
            OracleFaces::Clear => "clear faces",
            OracleFaces::Spread => "spreading faces",
            OracleFaces::Dielectric => "rough dielectric",
        }
    }

    fn leaf(self, tissue: &Tissue) -> ReliefLeaf {
        let boundary = if self == OracleFaces::Dielectric {
            Boundary::Rough(RoughSurface { index: INDEX, slope: SLOPE })
        } else {
            Boundary::Matched
        };
        ReliefLeaf { medium: medium(tissue), boundary, spread: self == OracleFaces::Spread }
    }
}

/// Light from +x at this angle from the leaf's normal.
fn toward(degrees: f64) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [sin, 0.0, cos]
}

/// The oracle's profiles, one for each run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OracleRuns {
    /// The light that leaves each texel of the leaf's plane.
    pub exitance: Vec<Vec<f64>>,
    /// π times the radiance seen from straight in front.
    pub seen: Vec<Vec<f64>>,
}

/// The oracle's profiles of one vein.
pub fn oracle(
    vein: &ProofVein,
    ridge: RidgeFace,
    faces: OracleFaces,
    degrees: f64,
    effort: OracleEffort,
) -> Result<OracleRuns> {
    let back = vein.face(N, RidgeFace::Unlit, ridge).iter().map(|h| -h).collect();
    let field = LeafHeightField::new(N, 1, TEXEL, vein.face(N, RidgeFace::Lit, ridge), back, FieldRim::Periodic)?;
    let leaf = faces.leaf(&Tissue::TABLE);
    let Histories { count, seed } = effort.vein();
    let mut runs = OracleRuns::default();
    for run in 0..RUNS as u64 {
        let got = leaf.walk(
            &field,
            IncidentLight::Direction(toward(degrees)),
            Histories { count: count / RUNS as u64, seed: seed + run },
        )?;
        if got.lost.value > 0.0 {
            return Err(Error::Missed(format!("random walk: {} of the light was lost", got.lost.value)));
        }
        let values = |map: &[HistoryEstimate]| map.iter().map(|e| e.value).collect();
        runs.exitance.push(values(&got.exitance));
        runs.seen.push(values(&got.seen));
    }
    Ok(runs)
}

/// How the convolution uses the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConvolutionVariant {
    /// As in H9 Eq. 3.14: the thickness where light enters, and E over the texel's area in the leaf's plane.
    Printed,
    /// E over the area of the texel's facet, which is 1/n_z times larger: the flux that meets the facet.
    Facets,
    /// The same, with the thickness where light leaves.
    Exit,
}

/// The model of one vein: the blade, its light and the convolution, as the translucency maps are made.
pub struct VeinProofModel {
    blade: BladeMaps,
    horizon: Horizon,
}

impl VeinProofModel {
    /// The model of a ridge on that face.
    pub fn new(vein: &ProofVein, ridge: RidgeFace) -> VeinProofModel {
        let map = |face: RidgeFace| vein.face(WIDE, face, ridge).repeat(LONG);
        let all = || vec![1.0; WIDE * LONG];
        let heights = [map(RidgeFace::Lit), map(RidgeFace::Unlit)];
        let blade = BladeMaps::from_heights(WIDE, LONG, TEXEL, vec![true; WIDE * LONG], heights, [all(), all()]);
        let horizon = Horizon::new(&blade.lit(Side::Front));
        VeinProofModel { blade, horizon }
    }

    /// Kernels for the vein's thicknesses.
    pub fn kernels(&self, tissue: &Tissue, form: DipoleForm) -> Result<Convolver> {
        let settings = ConvolutionSettings { form, ..ConvolutionSettings::new(*tissue, TEXEL) };
        let none = || Error::Missed("the ridge has no thickness".into());
        Convolver::for_map(&settings, WIDE, &self.blade.thickness)?.ok_or_else(none)
    }

    /// The profile in the middle of the middle row.
    pub fn profile(&self, kernels: &Convolver, degrees: f64, take: ConvolutionVariant) -> Vec<f64> {
        let lit = self.blade.lit(Side::Front);
        let mut light = irradiance(&lit, &self.horizon, toward(degrees), Visibility::Hard);
        if take != ConvolutionVariant::Printed {
            light.iter_mut().zip(&lit.surface.normal).for_each(|(e, n)| *e /= n[2]);
        }
        let light = std::slice::from_ref(&light);
        // With the adjoint, the kernel is that of the thickness at the texel whose light is summed up, where light
        // leaves.
        let image = if take == ConvolutionVariant::Exit {
            kernels.adjoint(&lit.thickness, light)
        } else {
            kernels.run(&lit.thickness, light)
        };
        image.first().map_or_else(Vec::new, |m| m[(LONG / 2) * WIDE + N / 2..][..N].to_vec())
    }
}

/// Readings of a profile: the lamina's level; relative to it the crest and both feet; and the width of the shadow's
/// edge (mm).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VeinProfileReading {
    /// Level beside the vein, in the unit of the profile.
    pub lamina: f64,
    /// Level at the crest, as a share of the lamina's.
    pub crest: f64,
    /// Level 0.3 mm from the crest on the side towards the light, as a share of the lamina's.
    pub near: f64,
    /// The same on the side away from the light.
    pub far: f64,
    /// Distance over which the profile rises from 10 to 90 % of the way from crest to lamina, mean of both sides; NaN
    /// where it does not rise that far.
    pub edge: f64,
}

/// Reads these figures off a profile that runs across the vein.
pub fn read(profile: &[f64]) -> VeinProfileReading {
    let mean = |low: f64, high: f64| {
        let inside: Vec<f64> = (0..N).filter(|&k| (low..=high).contains(&x_of(k))).map(|k| profile[k]).collect();
        inside.iter().sum::<f64>() / inside.len() as f64
    };
    let lamina = mean(1.2, 1.6);
    // Both halves are averaged, three texels each, so that the noise of one texel does not decide an edge.
    let half: Vec<f64> = (0..N / 2).map(|k| 0.5 * (profile[N / 2 + k] + profile[N / 2 - 1 - k])).collect();
    let smooth: Vec<f64> =
        (0..N / 2).map(|k| (half[k.saturating_sub(1)] + half[k] + half[(k + 1).min(N / 2 - 1)]) / 3.0).collect();
    let flat = 0.5 * (lamina + mean(-1.6, -1.2));
    let crossing = |share: f64| {
        let level = smooth[0] + share * (flat - smooth[0]);
        let k = (1..N / 2).find(|&k| smooth[k] >= level)?;
        Some(TEXEL * (k as f64 - 0.5 - (smooth[k] - level) / (smooth[k] - smooth[k - 1])))
    };
    let edge = match (crossing(0.1), crossing(0.9)) {
        (Some(a), Some(b)) if smooth[0] < flat => b - a,
        _ => f64::NAN,
    };
    VeinProfileReading {
        lamina,
        crest: mean(-0.07, 0.07) / lamina,
        near: mean(0.24, 0.36) / lamina,
        far: mean(-0.36, -0.24) / lamina,
        edge,
    }
}

fn x_of(k: usize) -> f64 {
    (k as f64 + 0.5 - 0.5 * N as f64) * TEXEL
}

/// A reading of the mean of the runs, with the jackknife's standard error.
fn jackknife(runs: &[Vec<f64>], pick: impl Fn(&[f64]) -> f64) -> HistoryEstimate {
    let n = runs.len() as f64;
    let total: Vec<f64> = (0..N).map(|k| runs.iter().map(|r| r[k]).sum()).collect();
    let value = pick(&total.iter().map(|t| t / n).collect::<Vec<_>>());
    let left: Vec<f64> =
        runs.iter().map(|r| pick(&total.iter().zip(r).map(|(t, x)| (t - x) / (n - 1.0)).collect::<Vec<_>>())).collect();
    let mean = left.iter().sum::<f64>() / n;
    let error = ((n - 1.0) / n * left.iter().map(|x| (x - mean).powi(2)).sum::<f64>()).sqrt();
    HistoryEstimate { value, error }
}

/// Root mean square of model less oracle, both relative to their lamina, over |x| ≤ 1.6 mm, corrected for the oracle's
/// noise.
fn difference(model: &[f64], runs: &[Vec<f64>]) -> f64 {
    let (a, b) = (read(model).lamina, jackknife(runs, |p| read(p).lamina).value);
    let inside: Vec<usize> = (0..N).filter(|&k| x_of(k).abs() <= 1.6).collect();
    let sum: f64 = inside
        .iter()
        .map(|&k| {
            let o = jackknife(runs, |p| p[k]);
            (model[k] / a - o.value / b).powi(2) - (o.error / b).powi(2)
        })
        .sum();
    (sum / inside.len() as f64).max(0.0).sqrt()
}

/// The forms and ways that are compared.
const MODELS: [(&str, DipoleForm, ConvolutionVariant); 4] = [
    ("images", DipoleForm::Images, ConvolutionVariant::Printed),
    ("thin", DipoleForm::Thin, ConvolutionVariant::Printed),
    ("thin, facets' area", DipoleForm::Thin, ConvolutionVariant::Facets),
    ("thin, facets' area, exit's thickness", DipoleForm::Thin, ConvolutionVariant::Exit),
];

/// One row for each vein, case and model: the difference of the profiles, and the readings of both.
pub fn rows(effort: OracleEffort) -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    let inner = inner_reflectance(INDEX);
    let closed = Tissue { a: (1.0 + inner) / (1.0 - inner), ..Tissue::TABLE };
    for vein in &VEINS {
        for (ridge, side) in [(RidgeFace::Unlit, "unlit"), (RidgeFace::Lit, "lit")] {
            let model = VeinProofModel::new(vein, ridge);
            for tissue in [Tissue::TABLE, closed] {
                let kernels = [
                    (DipoleForm::Images, model.kernels(&tissue, DipoleForm::Images)?),
                    (DipoleForm::Thin, model.kernels(&tissue, DipoleForm::Thin)?),
                ];
                let cases: &[(OracleFaces, f64)] = if tissue.a == 1.0 {
                    // A flat lit face that spreads light loses the light's direction.
                    &[(OracleFaces::Clear, 0.0), (OracleFaces::Spread, 0.0), (OracleFaces::Spread, 75.0)]
                        [..if ridge == RidgeFace::Lit { 3 } else { 2 }]
                } else {
                    &[(OracleFaces::Dielectric, 0.0), (OracleFaces::Dielectric, 75.0)]
                };
                for &(faces, degrees) in cases {
                    mesophyll_files::progress::go_on()?;
                    let runs = oracle(vein, ridge, faces, degrees, effort)?;
                    let setting =
                        format!("{} vein on the {side} face, light at {degrees} deg, {}", vein.name, faces.name());
                    for (name, form, take) in MODELS {
                        if take == ConvolutionVariant::Facets && ridge == RidgeFace::Unlit {
                            continue; // With a flat lit face this is the same as the printed form.
                        }
                        let Some((_, convolver)) = kernels.iter().find(|(f, _)| *f == form) else { continue };
                        let start = Instant::now();
                        let profile = model.profile(convolver, degrees, take);
                        let us = start.elapsed().as_secs_f64() * 1e6;
                        let mut compare = |what: &str, runs: &[Vec<f64>]| {
                            let note = readings(&profile, runs, degrees);
                            rows.push(row(
                                &format!("oracle: vein's {what}, {name}"),
                                &setting,
                                difference(&profile, runs),
                                us,
                                note,
                            ));
                        };
                        compare("exitance", &runs.exitance);
                        // Where light leaves through a flat face, the two differ only by the angles of exit, which are
                        // the same beside the ridge. Faces that do not spread light show the beam itself.
                        if ridge == RidgeFace::Unlit && faces == OracleFaces::Spread {
                            compare("radiance", &runs.seen);
                        }
                    }
                }
            }
        }
    }
    Ok(rows)
}

/// Model (oracle ± standard error) of each reading.
fn readings(profile: &[f64], runs: &[Vec<f64>], degrees: f64) -> String {
    let got = read(profile);
    let one = |what: &str, value: f64, pick: fn(&VeinProfileReading) -> f64| {
        let o = jackknife(runs, |p| pick(&read(p)));
        format!("{what} {value:.3} ({:.3} ± {:.3})", o.value, o.error)
    };
    let mut parts = vec![
        one("lamina", got.lamina, |r| r.lamina),
        one("crest", got.crest, |r| r.crest),
        one("foot to the light", got.near, |r| r.near),
        one("foot off the light", got.far, |r| r.far),
    ];
    if degrees == 0.0 {
        parts.push(one("edge in mm", got.edge, |r| r.edge));
    }
    parts.join(", ")
}
