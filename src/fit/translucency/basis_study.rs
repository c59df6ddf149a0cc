//! How well a few functions of direction hold what a leaf lets through (H7 Fig. 12, H9 Fig. 3.19): the reconstruction against the full convolution for
//! each of a set of light directions, on leaves with veins; bases against bytes and multiply-adds, light directions and horizon maps against time.
//!
//! The error is the paper's, f_rec/f − 1 over all texels, at elevations of π/2, π/4 and π/8 over the tangent plane, eight azimuths each. Bases are projected
//! from many directions, so that what is seen is theirs and not the directions' chance. Leaves are grown flat (no fold, droop or waves: those belong to the
//! mesh), cut to a piece of the lamina with its midrib, and go through heights integrated from their normals as fits do.

use crate::capture::synth::leaf::Leaf;
use crate::capture::synth::spec::{Model, Spec};
use crate::fit::bench::{BenchRow, median_us};
use crate::optics::dipole::Tissue;
use crate::optics::translucency::basis::{Basis, Projector, Weights};
use crate::optics::translucency::blade::{Blade, LitSide, Side, Surface, mirror};
use crate::optics::translucency::convolve::{Convolver, Settings};
use crate::optics::translucency::horizon::{self, Horizon};
use crate::optics::translucency::irradiance::{Visibility, irradiance, project};
use crate::optics::translucency::lights::{Lights, PAPER, Rule, raised};
use crate::optics::translucency::relief;
use crate::{Error, Result};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Elevations of H7 Fig. 12, from the tangent plane (rad).
pub const ELEVATIONS: [f64; 3] = [FRAC_PI_2, FRAC_PI_4, PI / 8.0];
/// Azimuths tried at each elevation but the first.
const AZIMUTHS: usize = 8;
/// Texels this close to the border of the piece are not judged (mm).
const MARGIN_MM: f64 = 1.5;
/// The directions that bases are judged with.
pub const FINE: Rule = Rule::Product { levels: 16, azimuths: 32 };

/// One lit side of a piece of leaf, ready to be judged.
pub struct Case {
    pub name: String,
    pub blade: Blade,
    pub side: Side,
    pub tissue: Tissue,
}

/// What is to be judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    pub basis: Basis,
    pub weights: Weights,
    pub lights: Rule,
}

/// Errors at one elevation, of texels that get at least [`FAINT`] of the mean at that elevation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    pub elevation: f64,
    /// Mean of |f_rec/f − 1|, and of f_rec/f − 1.
    pub mean: f64,
    pub bias: f64,
    /// Root mean square of f_rec/f − 1.
    pub rms: f64,
    /// Of |f_rec/f − 1|: median, 95th percentile, largest.
    pub median: f64,
    pub p95: f64,
    pub worst: f64,
    /// Root mean square of f_rec − f over the mean of f, all texels: what a picture at this elevation shows.
    pub visible: f64,
    /// Share of the texels judged in steps of [`STEP`] of f_rec/f − 1 from −[`REACH`] to [`REACH`], the ends holding what lies beyond.
    pub histogram: [f64; BINS],
    /// Share of texels left out as too faint.
    pub faint: f64,
}

/// Texels that get less than this share of the elevation's mean have no relative error worth the name (deep shadow over absorbing tissue: f goes to 0, its error does not).
pub const FAINT: f64 = 0.01;

pub const BINS: usize = 41;
/// Largest error that the histogram resolves.
pub const REACH: f64 = 0.41;
/// Width of a histogram's step.
pub const STEP: f64 = 2.0 * REACH / BINS as f64;

/// One candidate on one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    pub case: String,
    pub candidate: Candidate,
    pub spreads: [Spread; 3],
}

impl Outcome {
    /// Mean over the three elevations of the mean absolute error: the paper's "average reconstruction error" is 3 %.
    pub fn mean(&self) -> f64 {
        self.spreads.iter().map(|s| s.mean).sum::<f64>() / 3.0
    }
}

impl Candidate {
    pub fn name(&self) -> String {
        let weights = match self.weights {
            Weights::Gram => "",
            Weights::Plain => ", plain sums",
        };
        format!("{}{weights}", self.basis.name())
    }
}

/// A piece of a leaf, `size_mm` around `centre_mm` of its field (x right, y up from the middle), on texels of `texel_mm`.
///
/// # Errors
/// [`Error::Missed`] when nothing of the leaf lies there.
pub fn piece(spec: &Spec, texel_mm: f64, centre_mm: [f64; 2], size_mm: [f64; 2]) -> Result<Blade> {
    let mut spec = spec.clone();
    (spec.relief.fold_deg, spec.relief.droop_mm, spec.relief.wave_mm) = (0.0, 0.0, 0.0);
    // Only the piece is grown: its field is the leaf's, cut.
    let [w, h] = spec.field_mm.map(|f| (f / texel_mm).round() as usize);
    let missing = || Error::Missed(format!("{}: no leaf at {centre_mm:?} mm", spec.name));
    let leaf = Leaf::grow(&spec, Model::Exact, w, h).ok_or_else(missing)?;
    let [cw, ch] = size_mm.map(|s| (s / texel_mm).round() as usize);
    let left = ((0.5 * spec.field_mm[0] + centre_mm[0] - 0.5 * size_mm[0]) / texel_mm).round().max(0.0) as usize;
    let top = ((0.5 * spec.field_mm[1] - centre_mm[1] - 0.5 * size_mm[1]) / texel_mm).round().max(0.0) as usize;
    if left + cw > w || top + ch > h {
        return Err(missing());
    }
    // The back's maps in the front's columns, cut, and turned again.
    let cut = |k: usize| (top + k / cw) * w + left + k % cw;
    let of = |k: usize| w * (k / w) + w - 1 - k % w;
    let n = cw * ch;
    let mask: Vec<bool> = (0..n).map(|k| leaf.mask[cut(k)]).collect();
    if !mask.contains(&true) {
        return Err(missing());
    }
    let thickness: Vec<f64> = (0..n).map(|k| f64::from(leaf.front.thickness[cut(k)])).collect();
    let front = (0..n).map(|k| (leaf.front.normal[cut(k)], leaf.front.rho_d[cut(k)][1])).collect::<Vec<_>>();
    let back = mirror(&(0..n).map(|k| (leaf.back.normal[of(cut(k))], leaf.back.rho_d[of(cut(k))][1])).collect::<Vec<_>>(), cw);
    let surface = |maps: &[([f32; 3], f32)], mask: &[bool]| {
        let normal: Vec<[f64; 3]> =
            maps.iter().zip(mask).map(|((n, _), on)| if *on { n.map(f64::from) } else { [0.0, 0.0, 1.0] }).collect();
        let entry = maps.iter().map(|(_, r)| 1.0 - f64::from(*r)).collect();
        Surface { height: relief::heights(&normal, mask, cw, ch, texel_mm), normal, entry }
    };
    let (front, back) = (surface(&front, &mask), surface(&back, &mirror(&mask, cw)));
    Ok(Blade { width: cw, height: ch, texel_mm: leaf.texel_mm, mask, thickness, front, back })
}

/// A lit side with its horizons, its kernels, and the truth in the directions judged.
pub struct Judge<'a> {
    case: &'a Case,
    lit: LitSide<'a>,
    horizon: Horizon,
    convolver: Convolver,
    /// Texels that count.
    judged: Vec<usize>,
    /// The directions of each elevation and what comes through, at the judged texels.
    truth: Vec<Vec<([f64; 3], Vec<f64>)>>,
}

impl<'a> Judge<'a> {
    /// # Errors
    /// [`Error::Usage`] for a tissue or thicknesses out of range; [`Error::Missed`] for a blade without judged texels.
    pub fn new(case: &'a Case) -> Result<Judge<'a>> {
        let lit = case.blade.lit(case.side);
        let horizon = Horizon::new(&lit);
        let [thin, thick] = case.blade.thickness_range().ok_or_else(|| Error::Missed(format!("{}: no texel on the leaf", case.name)))?;
        let convolver = Convolver::with(&Settings::new(case.tissue, lit.texel_mm), lit.width, lit.height, thin, thick)?;
        let margin = (MARGIN_MM / lit.texel_mm).ceil() as usize;
        let inner = |k: usize| {
            let (i, j) = (k % lit.width, k / lit.width);
            i >= margin && j >= margin && i + margin < lit.width && j + margin < lit.height
        };
        let judged: Vec<usize> = (0..lit.mask.len()).filter(|&k| lit.mask[k] && inner(k)).collect();
        if judged.is_empty() {
            return Err(Error::Missed(format!("{}: no texel farther than {MARGIN_MM} mm from the border", case.name)));
        }
        let mut judge = Judge { case, lit, horizon, convolver, judged, truth: Vec::new() };
        for elevation in ELEVATIONS {
            let count = if elevation < FRAC_PI_2 { AZIMUTHS } else { 1 };
            // Off the slices' centres.
            let directions: Vec<[f64; 3]> = (0..count).map(|k| raised(elevation.sin(), TAU * (k as f64 + 0.3) / count as f64)).collect();
            let entered: Vec<Vec<f64>> = directions.iter().map(|d| irradiance(&judge.lit, &judge.horizon, *d, Visibility::Hard)).collect();
            let through = judge.through(&entered);
            judge.truth.push(directions.into_iter().zip(through).collect());
        }
        Ok(judge)
    }

    /// What leaves the judged texels.
    fn through(&self, entered: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let all = self.convolver.run(&self.lit.thickness, entered);
        all.iter().map(|image| self.judged.iter().map(|&k| image[k]).collect()).collect()
    }

    /// Coefficients at the judged texels, one image a function.
    ///
    /// # Errors
    /// [`Error::Usage`] when the lights do not determine the basis.
    pub fn coefficients(&self, candidate: Candidate) -> Result<Vec<Vec<f64>>> {
        let projector = Projector::new(candidate.basis, &Lights::new(candidate.lights), candidate.weights).map_err(Error::Usage)?;
        Ok(self.through(&project(&self.lit, &self.horizon, &projector, Visibility::Hard)))
    }

    /// # Errors
    /// As [`Judge::coefficients`].
    pub fn judge(&self, candidate: Candidate) -> Result<Outcome> {
        let images = self.coefficients(candidate)?;
        let spread = |which: usize| {
            let pairs = self.truth[which].iter().flat_map(|(d, truth)| {
                let weights: Vec<f64> = (0..images.len()).map(|i| candidate.basis.value(i, *d)).collect();
                let rec = |k: usize| weights.iter().zip(&images).map(|(w, image)| w * image[k]).sum::<f64>();
                truth.iter().enumerate().map(|(k, f)| [rec(k), *f]).collect::<Vec<[f64; 2]>>()
            });
            Spread::of(ELEVATIONS[which], &pairs.collect::<Vec<_>>())
        };
        Ok(Outcome { case: self.case.name.clone(), candidate, spreads: [spread(0), spread(1), spread(2)] })
    }
}

impl Spread {
    /// From pairs of reconstruction and truth.
    fn of(elevation: f64, pairs: &[[f64; 2]]) -> Spread {
        let all = pairs.len().max(1) as f64;
        let level = pairs.iter().map(|p| p[1]).sum::<f64>() / all;
        let visible = (pairs.iter().map(|[rec, f]| (rec - f).powi(2)).sum::<f64>() / all).sqrt() / level;
        let mut errors: Vec<f64> = pairs.iter().filter(|p| p[1] > 0.0 && p[1] >= FAINT * level).map(|[rec, f]| rec / f - 1.0).collect();
        let n = errors.len().max(1) as f64;
        let mut histogram = [0.0; BINS];
        for e in &errors {
            let bin = ((e + REACH) / STEP).floor().clamp(0.0, (BINS - 1) as f64);
            histogram[bin as usize] += 1.0 / n;
        }
        let bias = errors.iter().sum::<f64>() / n;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        errors.iter_mut().for_each(|e| *e = e.abs());
        errors.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            errors.get(((errors.len() as f64 * share) as usize).min(errors.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
        };
        let mean = errors.iter().sum::<f64>() / n;
        let faint = 1.0 - errors.len() as f64 / all;
        Spread { elevation, mean, bias, rms, median: at(0.5), p95: at(0.95), worst: at(1.0), visible, histogram, faint }
    }
}

/// The bases tried, in order of what they store, and the paper's own way of projecting.
pub fn candidates() -> Vec<Candidate> {
    let mut list: Vec<Candidate> = [
        Basis::HalfLife2,
        Basis::Bent { count: 3 },
        Basis::Cosine { degree: 2 },
        Basis::HBasis { count: 4 },
        Basis::Hemispherical { bands: 2 },
        Basis::HBasis { count: 6 },
        Basis::Cosine { degree: 3 },
        Basis::Bent { count: 6 },
        Basis::Spherical { bands: 3 },
        Basis::Hemispherical { bands: 3 },
    ]
    .map(|basis| Candidate { basis, weights: Weights::Gram, lights: FINE })
    .into();
    list.push(Candidate { basis: Basis::HalfLife2, weights: Weights::Plain, lights: Rule::default() });
    list
}

/// Pieces of elm and balata lit on either side, in their own green tissue and in the paper's.
///
/// # Errors
/// Damaged specifications.
pub fn cases(texel_mm: f64) -> Result<Vec<Case>> {
    let mut list = Vec::new();
    for (text, centre, size) in [
        (include_str!("../../../data/leaves/elm.toml"), [2.0, 2.0], [14.0, 12.0]),
        (include_str!("../../../data/leaves/balata.toml"), [2.0, 3.0], [14.0, 12.0]),
    ] {
        let spec: Spec = toml::from_str(text).map_err(|e| Error::Missed(e.to_string()))?;
        let blade = piece(&spec, texel_mm, centre, size)?;
        let own = Tissue { sigma_a: spec.interior.sigma_a[1], sigma_s: spec.interior.sigma_s[1], g: 0.0, a: 1.0 };
        for (name, tissue) in [("own tissue", own), ("H9's tissue", PAPER_TISSUE)] {
            for side in [Side::Front, Side::Back] {
                let name = format!("{}, {} lit, {name}", spec.name, side.name());
                list.push(Case { name, blade: blade.clone(), side, tissue });
            }
        }
    }
    Ok(list)
}

/// H9 Table 3.1, with a diffuse reflectance of .1.
const PAPER_TISSUE: Tissue = Tissue { sigma_a: 0.4, sigma_s: 10.2, g: 0.07, a: 1.1 / 0.9 };

/// Texel of the rows' leaves (mm): the resolution of the paper's scanner.
const TEXEL_MM: f64 = 0.1;

fn row(knob: String, setting: String, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "translucency".into(), knob, setting, error, us, note }
}

/// Bases by bytes and multiply-adds on every case, light directions, and azimuths a slice of the horizon.
///
/// # Errors
/// As [`cases`].
pub fn rows() -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    for case in cases(TEXEL_MM)? {
        let judge = Judge::new(&case)?;
        for candidate in candidates() {
            let outcome = judge.judge(candidate)?;
            let each = |f: &dyn Fn(&Spread) -> f64| outcome.spreads.iter().map(|s| format!("{:.4}", f(s))).collect::<Vec<_>>().join(" ");
            let [operations, roots] = candidate.basis.operations();
            let note = format!(
                "mean |rec/full - 1|; {} bytes, {operations} multiply-adds, {roots} roots; at pi/2, pi/4, pi/8: mean {}; median {}; 95 % {}; RMS over mean {}; left out as faint {}",
                candidate.basis.bytes(),
                each(&|s| s.mean),
                each(&|s| s.median),
                each(&|s| s.p95),
                each(&|s| s.visible),
                each(&|s| s.faint),
            );
            let us = median_us(1.0, || judge.coefficients(candidate).map(|i| i.len()));
            rows.push(row(format!("basis: {}", case.name), candidate.name(), outcome.mean(), us, note));
        }
        if case.side == Side::Back && case.tissue == PAPER_TISSUE {
            rows.extend(light_rows(&judge)?);
            rows.extend(horizon_rows(&judge)?);
        }
    }
    Ok(rows)
}

/// Root mean square difference of two sets of images over the mean of the second.
fn apart(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let n = b.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let square: f64 = a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (x - y).powi(2)).sum();
    (square / n).sqrt() / (b.iter().flatten().sum::<f64>() / n)
}

fn light_rows(judge: &Judge) -> Result<Vec<BenchRow>> {
    let with = |lights: Rule, weights: Weights| Candidate { basis: Basis::HalfLife2, weights, lights };
    let truth = judge.coefficients(with(Rule::Product { levels: 32, azimuths: 64 }, Weights::Gram))?;
    let mut rows = Vec::new();
    let mut add = |name: String, rules: &[Rule], weights: Weights| -> Result<()> {
        let mut square = 0.0;
        for rule in rules {
            square += apart(&judge.coefficients(with(*rule, weights))?, &truth).powi(2) / rules.len() as f64;
        }
        let projector = Projector::new(Basis::HalfLife2, &Lights::new(rules[0]), weights).map_err(Error::Usage)?;
        let us = median_us(5.0, || project(&judge.lit, &judge.horizon, &projector, Visibility::Hard));
        let note = format!("RMS of the coefficients over their mean, against 2048 directions; {}; time of the projection", judge.case.name);
        rows.push(row("light directions".into(), name, square.sqrt(), us, note));
        Ok(())
    };
    for count in [32, 64, PAPER, 256, 512] {
        let seeds: Vec<Rule> = (1..=4).map(|seed| Rule::Stratified { count, seed }).collect();
        add(format!("stratified {count}"), &seeds, Weights::Gram)?;
        if count == PAPER {
            add(format!("stratified {count}, plain sums"), &seeds, Weights::Plain)?;
        }
        add(format!("spiral {count}"), &[Rule::Spiral { count }], Weights::Gram)?;
    }
    for (levels, azimuths) in [(4, 8), (4, 16), (8, 16), (4, 32), (8, 32), (16, 32)] {
        add(format!("product {levels}x{azimuths}"), &[Rule::Product { levels, azimuths }], Weights::Gram)?;
    }
    Ok(rows)
}

/// What slices and their interpolation cost against the horizon in the light's own azimuth, at the lowest elevation.
fn horizon_rows(judge: &Judge) -> Result<Vec<BenchRow>> {
    let lit = &judge.lit;
    let directions: Vec<[f64; 3]> = judge.truth[2].iter().map(|(d, _)| *d).collect();
    let exact: Vec<Vec<f64>> = directions
        .iter()
        .map(|d| {
            let sines = horizon::towards(lit, d[1].atan2(d[0]));
            let open = irradiance(lit, &judge.horizon, *d, Visibility::Off);
            open.iter().zip(&sines).map(|(e, s)| if d[2] > f64::from(*s) { *e } else { 0.0 }).collect()
        })
        .collect();
    let truth = judge.through(&exact);
    let mut rows = Vec::new();
    for lines in [1, 2, 4, 8] {
        let horizon = Horizon::sampled(lit, lines);
        let us = median_us(5.0, || Horizon::sampled(lit, lines));
        for (name, visibility) in [("hard", Visibility::Hard), ("soft .05", Visibility::Soft { width: 0.05 })] {
            let entered: Vec<Vec<f64>> = directions.iter().map(|d| irradiance(lit, &horizon, *d, visibility)).collect();
            let error = apart(&judge.through(&entered), &truth);
            let note =
                format!("RMS of what comes through at pi/8 over its mean, against the horizon in the light's azimuth; {}", judge.case.name);
            rows.push(row("horizon: azimuths a slice".into(), format!("{lines}, {name}"), error, us, note));
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn elm() -> Spec {
        toml::from_str(include_str!("../../../data/leaves/elm.toml")).unwrap()
    }

    /// A flat uniform leaf is held exactly by every basis that holds the cosine, whatever the tissue.
    #[test]
    fn a_flat_leaf_has_no_error() {
        let case = Case { name: "flat".into(), blade: Blade::flat(40, 36, 0.1, 0.2, 0.9), side: Side::Back, tissue: PAPER_TISSUE };
        let judge = Judge::new(&case).unwrap();
        for candidate in candidates().into_iter().filter(|c| c.weights == Weights::Gram) {
            for s in judge.judge(candidate).unwrap().spreads {
                assert!(s.worst < 1e-9 && s.visible < 1e-9 && s.faint == 0.0, "{}: {}", candidate.name(), s.worst);
                assert!((s.histogram[BINS / 2] - 1.0).abs() < 1e-12);
            }
        }
    }

    /// On veins: more functions hold more, the bent light's three more than the straight one's, and the paper's plain sums less than the Gram matrix.
    #[test]
    fn veins_need_more_than_a_vector() {
        let blade = piece(&elm(), 0.2, [2.0, 2.0], [9.0, 8.0]).unwrap();
        blade.validate().unwrap();
        let case = Case { name: "elm".into(), blade, side: Side::Front, tissue: PAPER_TISSUE };
        let judge = Judge::new(&case).unwrap();
        let visible = |basis: Basis, weights: Weights, lights: Rule| {
            let spreads = judge.judge(Candidate { basis, weights, lights }).unwrap().spreads;
            (spreads.iter().map(|s| s.visible.powi(2)).sum::<f64>() / 3.0).sqrt()
        };
        let straight = visible(Basis::HalfLife2, Weights::Gram, FINE);
        assert!(straight > 0.01, "there is relief: {straight}");
        assert!(visible(Basis::Bent { count: 3 }, Weights::Gram, FINE) < 0.8 * straight);
        assert!(visible(Basis::Hemispherical { bands: 3 }, Weights::Gram, FINE) < 0.8 * straight);
        // The same 128 directions, with and without their Gram matrix: the mean level.
        let mean = |weights: Weights| {
            let images = judge.coefficients(Candidate { basis: Basis::HalfLife2, weights, lights: Rule::default() }).unwrap();
            let fine = judge.coefficients(Candidate { basis: Basis::HalfLife2, weights: Weights::Gram, lights: FINE }).unwrap();
            apart(&images, &fine)
        };
        assert!(mean(Weights::Gram) < mean(Weights::Plain), "{} {}", mean(Weights::Gram), mean(Weights::Plain));
    }

    /// The heights that fits use, integrated from normals, give those normals back.
    #[test]
    fn heights_and_normals_agree() {
        let blade = piece(&elm(), 0.2, [2.0, 2.0], [9.0, 8.0]).unwrap();
        let again = relief::normals(&blade.back.height, &mirror(&blade.mask, blade.width), blade.width, blade.height, blade.texel_mm);
        let off: f64 = again.iter().zip(&blade.back.normal).map(|(a, b)| (0..2).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>()).sum();
        let size: f64 = blade.back.normal.iter().map(|n| n[0] * n[0] + n[1] * n[1]).sum();
        // Two central differences in a row soften veins of a few texels.
        assert!(off < 0.25 * size, "{off} of {size}");
        assert!(piece(&elm(), 0.5, [30.0, 26.0], [4.0, 4.0]).is_err(), "off the field");
    }
}
