//! A vein's shadow: the convolution, which takes the thickness where the light enters, against the walk through the relief.
//!
//! A straight ridge, raised cosine, on one face of a flat lamina of the paper's tissue; light falls across it. Profiles are relative to the
//! lamina beside, so that what a form's total is wrong by does not count twice. Standard errors by a jackknife over independent runs.

use super::plane::{inner_reflectance, medium};
use super::{Effort, row};
use crate::fit::bench::BenchRow;
use crate::optics::dipole::{Form, Tissue};
use crate::optics::translucency::blade::{Blade, Side};
use crate::optics::translucency::convolve::{Convolver, Settings};
use crate::optics::translucency::horizon::Horizon;
use crate::optics::translucency::irradiance::{Visibility, irradiance};
use crate::optics::walk::rough::Rough;
use crate::optics::walk::{Boundary, Estimate, Field, Histories, Leaf, Light, Rim};
use crate::{Error, Result};
use std::time::Instant;

/// mm
const TEXEL: f64 = 0.04;
const LAMINA: f64 = 0.2;
const RISE: f64 = 0.3;
/// Full width at half height, mm.
const WIDTH: f64 = 0.4;
/// Texels of a profile (one period of the oracle's relief).
const N: usize = 100;
/// Independent runs of the oracle.
const RUNS: usize = 8;

/// On which face the ridge stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ridge {
    Lit,
    Unlit,
}

/// What the oracle's faces do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Faces {
    /// Nothing; light goes straight in.
    Clear,
    /// Light enters and leaves Lambertian about the face.
    Spread,
    /// n = 1.4, slope .35.
    Dielectric,
}

impl Faces {
    fn name(self) -> &'static str {
        match self {
            Faces::Clear => "clear faces",
            Faces::Spread => "spreading faces",
            Faces::Dielectric => "rough dielectric",
        }
    }

    fn leaf(self, tissue: &Tissue) -> Leaf {
        let boundary = if self == Faces::Dielectric { Boundary::Rough(Rough { index: 1.4, slope: 0.35 }) } else { Boundary::Matched };
        Leaf { medium: medium(tissue), boundary, spread: self == Faces::Spread }
    }
}

/// Height of the ridge over texel centres; the middle of `n` texels is its crest.
fn ridge(n: usize) -> Vec<f64> {
    (0..n)
        .map(|k| {
            let x = (k as f64 + 0.5 - 0.5 * n as f64) * TEXEL;
            if x.abs() < WIDTH { RISE * (0.5 * std::f64::consts::PI * x / WIDTH).cos().powi(2) } else { 0.0 }
        })
        .collect()
}

/// Light from +x at this angle from the leaf's normal.
fn toward(degrees: f64) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [sin, 0.0, cos]
}

/// The oracle's profiles of exitance, one a run.
fn oracle(ridge_on: Ridge, faces: Faces, degrees: f64, effort: Effort) -> Result<Vec<Vec<f64>>> {
    let rise = ridge(N);
    let on = |face: Ridge| -> Vec<f64> { rise.iter().map(|h| 0.5 * LAMINA + if face == ridge_on { *h } else { 0.0 }).collect() };
    let back = on(Ridge::Unlit).iter().map(|h| -h).collect();
    let field = Field::new(N, 1, TEXEL, on(Ridge::Lit), back, Rim::Periodic)?;
    let leaf = faces.leaf(&Tissue::TABLE);
    let Histories { count, seed } = effort.vein();
    (0..RUNS as u64)
        .map(|run| {
            let got = leaf.walk(&field, Light::Direction(toward(degrees)), Histories { count: count / RUNS as u64, seed: seed + run })?;
            if got.lost.value > 0.0 {
                return Err(Error::Missed(format!("random walk: {} of the light was lost", got.lost.value)));
            }
            Ok(got.exitance.iter().map(|e| e.value).collect())
        })
        .collect()
}

/// How the convolution takes the thickness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Where {
    /// Of the texel where light enters (H9 Eq. 3.14).
    Entry,
    /// Of the texel where it leaves.
    Exit,
    /// The mean of the two images: the same both ways, as transport is.
    Both,
}

/// The model's profile: the middle row of a long ridge, from the blade's heights to the convolution.
pub fn model(tissue: &Tissue, form: Form, ridge_on: Ridge, degrees: f64, place: Where) -> Result<Vec<f64>> {
    const W: usize = 2 * N;
    const ROWS: usize = 121;
    let rise = ridge(W);
    let on = |face: Ridge| -> Vec<f64> { (0..W * ROWS).map(|k| 0.5 * LAMINA + if face == ridge_on { rise[k % W] } else { 0.0 }).collect() };
    let all = vec![1.0; W * ROWS];
    let blade = Blade::from_heights(W, ROWS, TEXEL, vec![true; W * ROWS], [on(Ridge::Lit), on(Ridge::Unlit)], [all.clone(), all]);
    let lit = blade.lit(Side::Front);
    let light = irradiance(&lit, &Horizon::new(&lit), toward(degrees), Visibility::Hard);
    let settings = Settings { form, ..Settings::new(*tissue, TEXEL) };
    let none = || Error::Missed("the ridge has no thickness".into());
    let convolver = Convolver::for_map(&settings, W, &lit.thickness)?.ok_or_else(none)?;
    let entry = || convolver.run(&lit.thickness, std::slice::from_ref(&light)).remove(0);
    let exit = || convolver.adjoint(&lit.thickness, std::slice::from_ref(&light)).remove(0);
    let image = match place {
        Where::Entry => entry(),
        Where::Exit => exit(),
        Where::Both => entry().iter().zip(exit()).map(|(a, b)| 0.5 * (a + b)).collect(),
    };
    Ok(image[(ROWS / 2) * W + N / 2..][..N].to_vec())
}

/// What is read off a profile: the lamina's level, and relative to it the crest, both feet, and the shadow's edge (mm).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    pub lamina: f64,
    pub crest: f64,
    /// 0.3 mm from the crest, towards the light and away from it.
    pub near: f64,
    pub far: f64,
    /// Distance over which the profile rises from 10 to 90 % of the way from crest to lamina, both sides' mean; NaN where it does not.
    pub edge: f64,
}

pub fn read(profile: &[f64]) -> Reading {
    let mean = |low: f64, high: f64| {
        let inside: Vec<f64> = (0..N).filter(|&k| (low..=high).contains(&x_of(k))).map(|k| profile[k]).collect();
        inside.iter().sum::<f64>() / inside.len() as f64
    };
    let lamina = mean(1.2, 1.6);
    // both halves, three texels each: what the noise of one texel leaves of an edge
    let half: Vec<f64> = (0..N / 2).map(|k| 0.5 * (profile[N / 2 + k] + profile[N / 2 - 1 - k])).collect();
    let smooth: Vec<f64> = (0..N / 2).map(|k| (half[k.saturating_sub(1)] + half[k] + half[(k + 1).min(N / 2 - 1)]) / 3.0).collect();
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
    Reading { lamina, crest: mean(-0.06, 0.06) / lamina, near: mean(0.24, 0.36) / lamina, far: mean(-0.36, -0.24) / lamina, edge }
}

fn x_of(k: usize) -> f64 {
    (k as f64 + 0.5 - 0.5 * N as f64) * TEXEL
}

/// A reading of the runs' mean, with the jackknife's standard error.
fn jackknife(runs: &[Vec<f64>], pick: impl Fn(&[f64]) -> f64) -> Estimate {
    let n = runs.len() as f64;
    let total: Vec<f64> = (0..N).map(|k| runs.iter().map(|r| r[k]).sum()).collect();
    let value = pick(&total.iter().map(|t| t / n).collect::<Vec<_>>());
    let left: Vec<f64> = runs.iter().map(|r| pick(&total.iter().zip(r).map(|(t, x)| (t - x) / (n - 1.0)).collect::<Vec<_>>())).collect();
    let mean = left.iter().sum::<f64>() / n;
    let error = ((n - 1.0) / n * left.iter().map(|x| (x - mean).powi(2)).sum::<f64>()).sqrt();
    Estimate { value, error }
}

/// Root mean square of model less oracle, both relative to their lamina, over |x| ≤ 1.6 mm; the oracle's noise taken out.
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

/// Crest, feet, edge and profile of each case and form.
pub fn rows(effort: Effort) -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    let inner = inner_reflectance(1.4);
    let closed = Tissue { a: (1.0 + inner) / (1.0 - inner), ..Tissue::TABLE };
    for on in [Ridge::Unlit, Ridge::Lit] {
        for (faces, degrees) in [(Faces::Clear, 0.0), (Faces::Spread, 0.0), (Faces::Spread, 75.0), (Faces::Dielectric, 0.0), (Faces::Dielectric, 75.0)] {
            let runs = oracle(on, faces, degrees, effort)?;
            let side = if on == Ridge::Lit { "lit" } else { "unlit" };
            let setting = format!("ridge on the {side} face, light at {degrees} deg, {}", faces.name());
            let tissue = if faces == Faces::Dielectric { closed } else { Tissue::TABLE };
            let models = [
                ("images", Form::Images, Where::Entry),
                ("thin", Form::Thin, Where::Entry),
                ("thin with the exit's thickness", Form::Thin, Where::Exit),
                ("thin with both", Form::Thin, Where::Both),
            ];
            for (name, form, place) in models {
                let start = Instant::now();
                let profile = model(&tissue, form, on, degrees, place)?;
                let us = start.elapsed().as_secs_f64() * 1e6;
                let got = read(&profile);
                let mut compare = |what: &str, value: f64, pick: fn(&Reading) -> f64, relative: bool, unit: &str| {
                    let o = jackknife(&runs, |p| pick(&read(p)));
                    let error = if relative { value / o.value - 1.0 } else { value - o.value };
                    let note = format!("{value:.4}{unit}, oracle {:.4} ± {:.4}{unit}", o.value, o.error);
                    rows.push(row(&format!("oracle: vein's {what}, {name}"), &setting, error, us, note));
                };
                compare("crest", got.crest, |r| r.crest, false, " of the lamina");
                compare("foot towards the light", got.near, |r| r.near, false, " of the lamina");
                compare("foot away from the light", got.far, |r| r.far, false, " of the lamina");
                if degrees == 0.0 {
                    compare("edge", got.edge, |r| r.edge, true, " mm");
                }
                let note = "root mean square over 3.2 mm, of the lamina".into();
                rows.push(row(&format!("oracle: vein's profile, {name}"), &setting, difference(&profile, &runs), us, note));
            }
        }
    }
    Ok(rows)
}
