//! The forms of T(r, d) compared with the walk in a plane slab: totals, the spread of a spot, and the angles at which
//! light leaves.

use super::{OracleEffort, row};
use crate::bench::{BenchRow, median_us};
use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::slab;
use mesophyll_optics::walk::rough::RoughSurface;
use mesophyll_optics::walk::slab::EntryDirection;
use mesophyll_optics::walk::{Boundary, HistoryEstimate, Medium, Slab, SlabWalk};

/// The forms by name.
pub const FORMS: [(&str, DipoleForm); 3] =
    [("dipoles 3", DipoleForm::Dipoles(3)), ("images", DipoleForm::Images), ("thin", DipoleForm::Thin)];

/// An error means nothing where the oracle's relative standard error is larger than this.
const KNOWN: f64 = 0.1;

/// The remark on a form where the blade is too thin for it.
const UNDEFINED: &str = "the form is not defined here";

/// Inner reflectance ρ of both faces, from the tissue's A = (1 + ρ)/(1 − ρ).
fn boundary(tissue: &Tissue) -> Boundary {
    let reflectance = (tissue.a - 1.0) / (tissue.a + 1.0);
    if reflectance > 0.0 { Boundary::Diffuse { reflectance } } else { Boundary::Matched }
}

/// The medium that the walk uses for this tissue.
pub fn medium(tissue: &Tissue) -> Medium {
    Medium { sigma_a: tissue.sigma_a, sigma_s: tissue.sigma_s, g: tissue.g }
}

fn walk(tissue: &Tissue, d: f64, entry: EntryDirection, effort: OracleEffort, edges: &[f64]) -> Result<SlabWalk> {
    Slab { medium: medium(tissue), thickness_mm: d, boundary: boundary(tissue) }.walk(entry, effort.plane(), edges)
}

fn named(tissue: &Tissue, d: f64) -> String {
    let Tissue { sigma_a, sigma_s, g, a } = tissue;
    let faces = if *a > 1.0 { format!(", A {a:.3}") } else { String::new() };
    format!("sigma_a {sigma_a}, sigma_s {sigma_s:.4}, g {g}{faces}, d {d}")
}

/// Writes small totals in powers of ten.
fn digits(x: f64) -> String {
    if x.abs() < 0.01 { format!("{x:.3e}") } else { format!("{x:.5}") }
}

fn stated(e: HistoryEstimate) -> String {
    if e.value < 0.01 {
        format!("{:.3e} ± {:.1e}", e.value, e.error)
    } else {
        format!("{:.5} ± {:.5}", e.value, e.error)
    }
}

/// One row for each form: the relative error of its total.
fn totals(rows: &mut Vec<BenchRow>, knob: &str, tissue: &Tissue, d: f64, setting: &str, oracle: HistoryEstimate) {
    let sure = oracle.error < KNOWN * oracle.value;
    let of = |total: f64| if sure && total.is_finite() { total / oracle.value - 1.0 } else { f64::NAN };
    for (name, form) in FORMS {
        let total = tissue.total(d, form);
        // Where the form is not defined there is nothing to time.
        let us = if total.is_nan() { f64::NAN } else { median_us(1.0, || tissue.total(d, form)) };
        let found = if total.is_nan() { UNDEFINED.into() } else { format!("total {}", digits(total)) };
        rows.push(row(
            &format!("{knob}, {name}"),
            setting,
            of(total),
            us,
            format!("{found}, oracle {}", stated(oracle)),
        ));
    }
}

/// The transport equation with isotropic scattering σs′ instead of σs and g (matched faces, a normal beam).
fn similar(rows: &mut Vec<BenchRow>, knob: &str, tissue: &Tissue, d: f64, oracle: HistoryEstimate) {
    let total = slab::response(tissue.sigma_a, tissue.reduced_scattering(), d).rho_t;
    let us = median_us(1.0, || slab::response(tissue.sigma_a, tissue.reduced_scattering(), d));
    let error = if oracle.error < KNOWN * oracle.value { total / oracle.value - 1.0 } else { f64::NAN };
    rows.push(row(
        &format!("{knob}, slab"),
        &named(tissue, d),
        error,
        us,
        format!("total {}, oracle {}", digits(total), stated(oracle)),
    ));
}

/// Totals over thickness, absorption, scattering, anisotropy and inner reflectance.
pub fn total_rows(effort: OracleEffort) -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    let table = Tissue::TABLE;
    let reduced = table.reduced_scattering();
    let mut cases: Vec<(&str, Tissue, f64)> =
        [0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0].map(|d| ("oracle: thickness", table, d)).into();
    for d in [0.05, 0.2, 0.5] {
        cases.extend(
            [0.001, 0.01, 0.1, 1.0, 3.0, 10.0].map(|sigma_a| ("oracle: absorption", Tissue { sigma_a, ..table }, d)),
        );
        cases.extend([1.0, 3.0, 30.0].map(|sigma_s| ("oracle: scattering", Tissue { sigma_s, ..table }, d)));
        cases.extend([-0.9, -0.5, 0.5, 0.9].map(|g| {
            ("oracle: anisotropy at one sigma_s (1-g)", Tissue { sigma_s: reduced / (1.0 - g), g, ..table }, d)
        }));
        cases.extend(
            [0.2f64, 0.5, 0.7]
                .map(|rho| ("oracle: inner reflectance", Tissue { a: (1.0 + rho) / (1.0 - rho), ..table }, d)),
        );
    }
    for (knob, tissue, d) in cases {
        progress::go_on()?;
        let oracle = walk(&tissue, d, EntryDirection::NORMAL, effort, &[])?.transmitted;
        totals(&mut rows, knob, &tissue, d, &named(&tissue, d), oracle);
        if tissue.a == 1.0 {
            similar(&mut rows, knob, &tissue, d, oracle);
        }
    }
    // Light that a rough face has spread, and a dielectric face treated in full (relative to the flux that entered).
    for d in [0.05, 0.1, 0.2, 0.5] {
        let oracle = walk(&table, d, EntryDirection::Diffuse, effort, &[])?.transmitted;
        totals(&mut rows, "oracle: lambertian entry", &table, d, &named(&table, d), oracle);
        let face = RoughSurface { index: 1.4, slope: 0.35 };
        let slab = Slab { medium: medium(&table), thickness_mm: d, boundary: Boundary::Rough(face) };
        let got = slab.walk(EntryDirection::NORMAL, effort.plane(), &[])?;
        let entered = 1.0 - got.glossy.value;
        let inner = inner_reflectance(face.index);
        let tissue = Tissue { a: (1.0 + inner) / (1.0 - inner), ..table };
        let setting = format!("n {}, slope {}, {}", face.index, face.slope, named(&tissue, d));
        totals(
            &mut rows,
            "oracle: rough dielectric, A of the inner Fresnel reflectance",
            &tissue,
            d,
            &setting,
            got.transmitted.scaled(1.0 / entered),
        );
        totals(
            &mut rows,
            "oracle: rough dielectric, A = 1",
            &table,
            d,
            &setting,
            got.transmitted.scaled(1.0 / entered),
        );
    }
    Ok(rows)
}

/// Light at an angle: the share of a beam that comes through, divided by the share of light from everywhere (which ρt
/// was measured with). For a flat blade the maps say 1 at every angle, so a row's error is that of the picture. Where
/// faces are matched, the note also gives the exact slab at that incidence.
pub fn incidence_rows(effort: OracleEffort) -> Result<Vec<BenchRow>> {
    let table = Tissue::TABLE;
    let face = RoughSurface { index: 1.4, slope: 0.35 };
    let mut rows = Vec::new();
    for (name, boundary) in [("matched", Boundary::Matched), ("rough dielectric", Boundary::Rough(face))] {
        for d in [0.1, 0.2, 0.5] {
            let slab = Slab { medium: medium(&table), thickness_mm: d, boundary };
            for degrees in [0.0f64, 30.0, 45.0, 60.0, 75.0] {
                progress::go_on()?;
                let start = std::time::Instant::now();
                let ratio = beam_over_even(&slab, degrees, effort)?;
                let us = start.elapsed().as_secs_f64() * 1e6;
                let exact = match boundary {
                    Boundary::Matched => {
                        format!("; the slab at that incidence {:.4}", slant(&table, d, degrees.to_radians().cos()))
                    }
                    _ => String::new(),
                };
                let note = format!("beam over even light {}{exact}", stated(ratio));
                let setting = format!("{degrees} deg, {}", named(&table, d));
                rows.push(row(&format!("oracle: incidence, {name}"), &setting, 1.0 / ratio.value - 1.0, us, note));
            }
        }
    }
    Ok(rows)
}

/// Transmittance of a beam at this angle, divided by that of light from everywhere; both are relative to the incident
/// flux.
pub fn beam_over_even(slab: &Slab, degrees: f64, effort: OracleEffort) -> Result<HistoryEstimate> {
    let (sin, mu) = degrees.to_radians().sin_cos();
    let beam = slab.walk(EntryDirection::Beam([sin, 0.0, mu]), effort.plane(), &[])?.transmitted;
    let even = slab.walk(EntryDirection::Diffuse, effort.plane(), &[])?.transmitted;
    let value = beam.value / even.value;
    Ok(HistoryEstimate { value, error: value * (beam.error / beam.value).hypot(even.error / even.value) })
}

/// The same ratio from the transport equation with isotropic scattering σs′ (matched faces).
pub fn slant(tissue: &Tissue, d: f64, mu: f64) -> f64 {
    let at = |mu: f64| slab::medium::response_at(mu, tissue.sigma_a, tissue.reduced_scattering(), d).rho_t;
    let even: f64 = mesophyll_base::quadrature::unit(12).into_iter().map(|(m, w)| 2.0 * w * m * at(m)).sum();
    at(mu) / even
}

/// Share of Lambertian light that a smooth face of this index reflects back inside: ∫ 2 μ F dμ, by the midpoint rule.
pub fn inner_reflectance(index: f64) -> f64 {
    const N: usize = 20_000;
    let at = |k: usize| {
        let mu = (k as f64 + 0.5) / N as f64;
        2.0 * mu * mesophyll_optics::gloss::fresnel(mu, 1.0 / index)
    };
    (0..N).map(at).sum::<f64>() / N as f64
}

/// Root mean square distance of the scattered light (mm): −4 dT̂/d(k²)/T̂ at k = 0, extrapolated from two steps.
pub fn spread(tissue: &Tissue, d: f64, form: DipoleForm) -> f64 {
    let at = |k: f64| tissue.spectrum(k, d, form) - tissue.ballistic(d, form);
    let total = at(0.0);
    let k = 0.1 / (d + 2.0 * tissue.mean_free_path());
    let slope = |k: f64| 4.0 * (1.0 - at(k) / total) / (k * k);
    ((4.0 * slope(0.5 * k) - slope(k)) / 3.0).sqrt()
}

/// Radius that contains this share of the scattered light, by bisection on `beyond`. NaN where the form is not defined.
pub fn radius_of(tissue: &Tissue, d: f64, form: DipoleForm, share: f64) -> f64 {
    let total = tissue.beyond(0.0, d, form);
    if !(total > 0.0) {
        return f64::NAN;
    }
    let (mut low, mut high) = (0.0, 100.0);
    for _ in 0..60 {
        let r = 0.5 * (low + high);
        if tissue.beyond(r, d, form) > (1.0 - share) * total { low = r } else { high = r }
    }
    0.5 * (low + high)
}

/// The same for the walk, linear between the edges of the rings, with the standard error that follows from the
/// uncertainty of a ring.
fn radius_in(walk: &SlabWalk, share: f64) -> HistoryEstimate {
    let parts: Vec<f64> = rings(walk);
    let scattered = walk.transmitted.value - walk.unscattered.value;
    let mut sum = 0.0;
    for (k, part) in parts.iter().enumerate() {
        let (low, high) = (walk.edges[k], walk.edges[k + 1]);
        if sum + part >= share * scattered {
            let fraction = (share * scattered - sum) / part;
            // The share below is known to √(share (1 − share)) of the relative error of the scattered flux.
            let relative = walk.transmitted.error / scattered;
            let error = (share * (1.0 - share)).sqrt() * relative * scattered * (high - low) / part;
            return HistoryEstimate { value: low + fraction * (high - low), error };
        }
        sum += part;
    }
    HistoryEstimate { value: f64::NAN, error: f64::NAN }
}

fn rings(walk: &SlabWalk) -> Vec<f64> {
    let area = |e: &[f64]| std::f64::consts::PI * (e[1] * e[1] - e[0] * e[0]);
    walk.radial.iter().zip(walk.edges.windows(2)).map(|(t, e)| t.value * area(e)).collect()
}

/// Rings for a slab: evenly spaced in r up to 3 d, and beyond that geometric up to 40 mm.
fn edges(d: f64) -> Vec<f64> {
    let mut edges: Vec<f64> = (0..=90).map(|k| f64::from(k) * d / 30.0).collect();
    let mut r = 3.0 * d;
    while r < 40.0 {
        r *= 1.05;
        edges.push(r);
    }
    edges
}

/// Half-light radius, root mean square radius and the largest difference of the enclosed share, for several tissues
/// over thickness.
pub fn spot_rows(effort: OracleEffort) -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    let table = Tissue::TABLE;
    let mut cases: Vec<(Tissue, f64)> = [0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0].map(|d| (table, d)).into();
    cases.extend([0.01, 3.0, 10.0].map(|sigma_a| (Tissue { sigma_a, ..table }, 0.2)));
    cases.extend([3.0, 30.0].map(|sigma_s| (Tissue { sigma_s, ..table }, 0.2)));
    cases.push((Tissue { a: 3.0, ..table }, 0.2));
    for (tissue, d) in cases {
        progress::go_on()?;
        let oracle = walk(&tissue, d, EntryDirection::NORMAL, effort, &edges(d))?;
        let setting = named(&tissue, d);
        let half = radius_in(&oracle, 0.5);
        let square = oracle.mean_square_radius;
        let root = HistoryEstimate { value: square.value.sqrt(), error: 0.5 * square.error / square.value.sqrt() };
        let scattered = oracle.transmitted.value - oracle.unscattered.value;
        let parts = rings(&oracle);
        for (name, form) in FORMS {
            let total = tissue.beyond(0.0, d, form);
            let defined = total > 0.0;
            let us = if defined { median_us(1.0, || tissue.beyond(0.1, d, form)) } else { f64::NAN };
            let said = |r: f64| if r.is_nan() { UNDEFINED.to_string() } else { format!("{r:.4} mm") };
            let r = radius_of(&tissue, d, form, 0.5);
            let note = format!("{}, oracle {:.4} ± {:.4} mm", said(r), half.value, half.error);
            rows.push(row(&format!("oracle: half-light radius, {name}"), &setting, r / half.value - 1.0, us, note));
            let r = if tissue.total(d, form) > 0.0 { spread(&tissue, d, form) } else { f64::NAN };
            let note = format!("{}, oracle {:.4} ± {:.4} mm", said(r), root.value, root.error);
            rows.push(row(&format!("oracle: rms radius, {name}"), &setting, r / root.value - 1.0, us, note));
            let (mut sum, mut worst, mut place) = (0.0, f64::NAN, 0.0);
            for (k, part) in parts.iter().enumerate() {
                sum += part;
                let gap = 1.0 - tissue.beyond(oracle.edges[k + 1], d, form) / total - sum / scattered;
                if defined && !(gap.abs() <= f64::abs(worst)) {
                    (worst, place) = (gap, oracle.edges[k + 1]);
                }
            }
            let note = if defined {
                format!("at {place:.3} mm; form's share less the oracle's, of the scattered light")
            } else {
                UNDEFINED.into()
            };
            rows.push(row(&format!("oracle: enclosed share, {name}"), &setting, worst, us, note));
        }
    }
    Ok(rows)
}

/// How far the light that comes through is from Lambertian.
pub fn angle_rows(effort: OracleEffort) -> Result<Vec<BenchRow>> {
    let table = Tissue::TABLE;
    let forward = Tissue { sigma_s: table.reduced_scattering() / 0.1, g: 0.9, ..table };
    let mut rows = Vec::new();
    for (tissue, d) in
        [0.02, 0.05, 0.1, 0.2, 0.5].map(|d| (table, d)).into_iter().chain([0.05, 0.2].map(|d| (forward, d)))
    {
        let start = std::time::Instant::now();
        let oracle = walk(&tissue, d, EntryDirection::NORMAL, effort, &[])?;
        let us = start.elapsed().as_secs_f64() * 1e6;
        let cos = oracle.mean_cosine;
        let shares = oracle.angles.map(|a| format!("{:.3}", 10.0 * a.value)).join(" ");
        let note = format!(
            "mean cosine {:.4} ± {:.4}, 2/3 if Lambertian; radiance over Lambertian from grazing to normal: {shares}",
            cos.value, cos.error
        );
        rows.push(row("oracle: exit angles", &named(&tissue, d), cos.value / (2.0 / 3.0) - 1.0, us, note));
    }
    Ok(rows)
}

/// The oracle compared with the exact slab: how more histories reduce its error.
pub fn history_rows() -> Result<Vec<BenchRow>> {
    let (sigma_a, sigma_s, d) = (0.4, 9.486, 0.2);
    let exact = slab::medium::response(sigma_a, sigma_s, d).rho_t;
    let slab = Slab { medium: Medium { sigma_a, sigma_s, g: 0.0 }, thickness_mm: d, boundary: Boundary::Matched };
    let one = |count: u64| -> Result<BenchRow> {
        let start = std::time::Instant::now();
        let got = slab.walk(EntryDirection::NORMAL, mesophyll_optics::walk::Histories { count, seed: 3 }, &[])?;
        let us = start.elapsed().as_secs_f64() * 1e6;
        if got.lost.value > 0.0 {
            return Err(Error::Missed(format!("random walk: {} of the light was lost", got.lost.value)));
        }
        let note = format!("total against the exact slab; the walk says ± {:.1e}", got.transmitted.error / exact);
        Ok(row("random walk, histories", &count.to_string(), (got.transmitted.value / exact - 1.0).abs(), us, note))
    };
    [1_000, 10_000, 100_000, 1_000_000].into_iter().map(one).collect()
}
