//! Taper, load over stiffness and root radius of a branch from measured deflections.
//!
//! Model: a clamped, linearly tapered circular branch under a load spread evenly along it. A mark at arc length s (mm)
//! from the root moves across by A u(x*), where x* is the place on the axis whose arc length in the bent branch is s
//! and A = F/(E′r₁⁴) = F L³/(E s₁⁴) (mm): the load F (N), the modulus E (N/mm²), the root radius s₁ (mm). Where
//! positions were read off along the straight axis instead, x* = s.
//!
//! Unknowns are ln α (α is the taper: radius at the tip over radius at the root) and A. **Load, modulus and root radius
//! cannot be told apart**, because deflections depend on F/(E s₁⁴) alone. With load and modulus given, the root radius
//! is (F L³/(E A))^¼, and their errors are carried along.
//!
//! Limits: the shape is that of the linear beam, laid out at its true length. A load that keeps its direction bends a
//! branch less than that once the tip moves by more than a quarter of the length. A root that gives way, a branch that
//! is crooked at rest, and a weight at one place are not in the model. A weight at the tip of an untapered branch looks
//! like a spread load on a taper of .65, to .2 % of the tip's deflection; so the kind of load has to be known.

use mesophyll_files::table::Status;
use mesophyll_plant::beam::{self, TAPER_MAX, TAPER_MIN};
use mesophyll_plant::length::settled;
use mesophyll_solve::{Closure, Fit, Noise, Options, Termination, global};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// One mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Distance from the root (mm), 0 to the branch's length.
    pub position: f64,
    /// How far the load moved the mark across the branch (mm).
    pub deflection: f64,
    /// Standard error of the deflection (mm); NaN: not known.
    pub error: f64,
}

/// A measured branch. NaN stands for what was not measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    /// Length of the branch (mm).
    pub length: f64,
    /// The marks, and how far each was deflected.
    pub readings: Vec<Reading>,
    /// The whole load (N), spread evenly, and its standard error.
    pub load: [f64; 2],
    /// Modulus of elasticity (GPa) and its standard error.
    pub modulus: [f64; 2],
}

/// What positions were measured along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum Along {
    /// Marks on the branch: positions are lengths of the branch, bent or not
    #[default]
    Branch,
    /// The straight axis: positions as a photograph or a plumb line shows them
    Axis,
}

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// The number, in the unit that its field states; NaN where nothing is known.
    pub value: f64,
    /// Its standard error, in the same unit; infinite where nothing is known.
    pub error: f64,
}

impl Known {
    const NOTHING: Known = Known { value: f64::NAN, error: f64::INFINITY };

    fn sure(&self) -> bool {
        self.error <= 0.1 * self.value.abs()
    }
}

/// A fitted branch.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Taper α: radius at the tip over radius at the root.
    pub taper: Known,
    /// F/(E′r₁⁴) = F L³/(E s₁⁴) (mm).
    pub load_over_stiffness: Known,
    /// Root radius (mm); nothing is known about it without load and modulus.
    pub root_radius: Known,
    /// Deflection of the tip across the branch (mm). Its error combines those of taper and load over stiffness.
    pub tip: Known,
    /// Correlation of ln α with F/(E′r₁⁴).
    pub correlation: f64,
    /// Unweighted root mean square of the residuals (mm).
    pub rms: f64,
    /// Whether the errors come from stated ones; otherwise they come from the scatter of the residuals.
    pub stated: bool,
    /// The solver's result.
    pub fit: Fit,
    /// Which of the numbers can be relied on.
    pub status: Status,
}

/// How many tapers are tried for the best start.
const STARTS: usize = 24;
/// Residuals beyond the stated noise: reduced χ² above 1 by this many of its standard deviations.
const EXCESS: f64 = 5.0;
const TIED: &str =
    "root_radius_mm (load, modulus and root radius enter only as F/(E' r1^4); give load_n and modulus_gpa)";

/// Fits one branch.
///
/// # Errors
/// Why nothing can be fitted, in words: a length that is not positive, marks beyond the ends, too few readings, no
/// deflection, or a solver that stopped.
pub fn fit(branch: &Branch, along: Along) -> Result<Measured, String> {
    let length = branch.length;
    if !(length > 0.0 && length.is_finite()) {
        return Err(format!("length_mm is {length}; expected more than 0"));
    }
    for r in &branch.readings {
        if !(0.0..=length * (1.0 + 1e-9)).contains(&r.position) {
            return Err(format!("position_mm is {}; expected 0 to length_mm, {length}", r.position));
        }
        if !r.deflection.is_finite() {
            return Err(format!("deflection_mm is {}; expected a number", r.deflection));
        }
        if r.error <= 0.0 || r.error.is_infinite() {
            return Err(format!("deflection_err_mm is {}; expected more than 0", r.error));
        }
    }
    for (name, [value, error]) in [("load_n", branch.load), ("modulus_gpa", branch.modulus)] {
        if value <= 0.0 || value.is_infinite() {
            return Err(format!("{name} is {value}; expected more than 0"));
        }
        if error < 0.0 || error.is_infinite() {
            return Err(format!("the error of {name} is {error}; expected 0 or more"));
        }
    }
    let stated = branch.readings.iter().filter(|r| !r.error.is_nan()).count();
    if stated != 0 && stated != branch.readings.len() {
        return Err("deflection_err_mm is given for some readings and not for others".into());
    }
    let stated = stated > 0;
    // The root itself never moves, so a reading there says nothing.
    let readings: Vec<Reading> = branch.readings.iter().copied().filter(|r| r.position > 0.0).collect();
    let needed = if stated { 2 } else { 3 };
    if readings.len() < needed {
        let what = if stated { "two unknowns" } else { "two unknowns and the noise" };
        return Err(format!(
            "too few readings: {} beyond the root; expected at least {needed} ({what})",
            readings.len()
        ));
    }
    if readings.iter().all(|r| r.deflection == 0.0) {
        return Err("no deflection: an unloaded branch shows neither taper nor stiffness".into());
    }
    let problem = Closure::new(2, readings.len(), |p: &[f64], out: &mut [f64]| {
        for (r, out) in readings.iter().zip(out) {
            let across = across(p[0].exp(), p[1], (r.position / length).min(1.0), along);
            *out = (length * across - r.deflection) / if stated { r.error } else { 1.0 };
        }
    });
    let noise = if stated { Noise::Known } else { Noise::Estimated };
    let options = Options {
        lower: vec![TAPER_MIN.ln(), f64::NEG_INFINITY],
        upper: vec![TAPER_MAX.ln(), f64::INFINITY],
        noise,
        max_iterations: 200,
        // This is far below any standard error.
        step_tolerance: 1e-9,
        ..Options::default()
    };
    let fit = global::minimize_scales(&problem, &start(&readings, length), &options);
    if !fit.converged() {
        return Err(format!("the fit stopped without a result: {}", fit.termination.name()));
    }
    Ok(measured(branch, fit, &readings, along, stated))
}

/// Deflection over length of the mark at x.
fn across(alpha: f64, amplitude: f64, x: f64, along: Along) -> f64 {
    match along {
        Along::Branch => settled(alpha, x, amplitude).across,
        Along::Axis => amplitude * beam::deflection(alpha, x),
    }
}

/// The best of a series of tapers, each with the amplitude that linear least squares gives.
fn start(readings: &[Reading], length: f64) -> Vec<f64> {
    let weight = |r: &Reading| if r.error.is_nan() { 1.0 } else { 1.0 / r.error };
    let mut best = (f64::INFINITY, vec![0.3f64.ln(), 0.1]);
    for k in 0..STARTS {
        // The tapers stay off the bounds.
        let ln_alpha = 0.95 * TAPER_MIN.ln() * (k as f64 + 0.5) / STARTS as f64;
        let u: Vec<f64> =
            readings.iter().map(|r| beam::deflection(ln_alpha.exp(), (r.position / length).min(1.0))).collect();
        let dot = |a: &dyn Fn(usize) -> f64, b: &dyn Fn(usize) -> f64| -> f64 {
            readings.iter().enumerate().map(|(i, r)| weight(r).powi(2) * a(i) * b(i)).sum()
        };
        let amplitude = dot(&|i| u[i], &|i| readings[i].deflection / length) / dot(&|i| u[i], &|i| u[i]);
        let miss = |i: usize| amplitude * u[i] - readings[i].deflection / length;
        let sum = dot(&miss, &miss);
        if sum < best.0 {
            best = (sum, vec![ln_alpha, amplitude]);
        }
    }
    best.1
}

fn measured(branch: &Branch, fit: Fit, readings: &[Reading], along: Along, stated: bool) -> Measured {
    let length = branch.length;
    let (ln_alpha, amplitude) = (fit.params[0], fit.params[1]);
    let alpha = ln_alpha.exp();
    let u = &fit.uncertainty;
    let taper = Known { value: alpha, error: alpha * u.stderr[0] };
    let load_over_stiffness = Known { value: amplitude * length, error: u.stderr[1] * length };
    let correlation = u.correlation(0, 1);
    let tip = {
        // Differences over a hundredth of a standard error, or of the value where the error is unknown.
        let at = |p: f64, a: f64| length * across(p.exp(), a, 1.0, along);
        let slope = |k: usize| {
            let h = if k == 0 { 1e-5 } else { 1e-5 * amplitude.abs().max(1e-12) };
            let step = |s: f64| if k == 0 { at(ln_alpha + s * h, amplitude) } else { at(ln_alpha, amplitude + s * h) };
            (step(1.0) - step(-1.0)) / (2.0 * h)
        };
        let g = [slope(0), slope(1)];
        let variance: f64 = (0..2).map(|i| (0..2).map(|j| g[i] * u.covariance[(i, j)] * g[j]).sum::<f64>()).sum();
        let error = if variance >= 0.0 { variance.sqrt() } else { f64::INFINITY };
        Known { value: at(ln_alpha, amplitude), error }
    };
    let given = [branch.load[0], branch.modulus[0]].iter().all(|v| v.is_finite());
    let root_radius = if given && load_over_stiffness.value != 0.0 {
        let stiffness = branch.modulus[0] * 1e3;
        let radius = (branch.load[0] * length.powi(3) / (stiffness * load_over_stiffness.value.abs())).powf(0.25);
        let share = |[v, e]: [f64; 2]| if e.is_nan() { 0.0 } else { e / v };
        let a = load_over_stiffness.error / load_over_stiffness.value.abs();
        Known {
            value: radius,
            error: 0.25 * radius * (a * a + share(branch.load).powi(2) + share(branch.modulus).powi(2)).sqrt(),
        }
    } else {
        Known::NOTHING
    };
    let rms = {
        let scale = |r: &Reading| if stated { r.error } else { 1.0 };
        (fit.residuals.iter().zip(readings).map(|(v, r)| (v * scale(r)).powi(2)).sum::<f64>() / readings.len() as f64)
            .sqrt()
    };
    let status = status(&fit, [taper, load_over_stiffness, root_radius, tip], given, stated);
    Measured { taper, load_over_stiffness, root_radius, tip, correlation, rms, stated, fit, status }
}

fn status(fit: &Fit, [taper, load, radius, tip]: [Known; 4], given: bool, stated: bool) -> Status {
    let u = &fit.uncertainty;
    let freedom = u.freedom as f64;
    if stated && freedom > 0.0 && u.reduced_chi2 > 1.0 + EXCESS * (2.0 / freedom).sqrt() {
        return Status::Undetermined(format!(
            "alpha load_over_stiffness_mm root_radius_mm tip_mm (residuals exceed the noise: reduced chi2 {:.3e})",
            u.reduced_chi2
        ));
    }
    let mut unknown: Vec<String> = Vec::new();
    let sigma = u.stderr[0];
    if fit.at_bound.contains(&0) || !taper.sure() {
        let upper = taper.value > (TAPER_MIN * TAPER_MAX).sqrt();
        // At a bound of the model's range, one side of the interval is known.
        unknown.push(match (fit.at_bound.contains(&0) && (2.0 * sigma) < 3.0, upper) {
            (true, true) => format!("alpha >= {:.3}", taper.value * (-2.0 * sigma).exp()),
            (true, false) => format!("alpha <= {:.3e}", taper.value * (2.0 * sigma).exp()),
            _ => "alpha".into(),
        });
    }
    if !load.sure() {
        unknown.push("load_over_stiffness_mm".into());
    }
    if !tip.sure() {
        unknown.push("tip_mm".into());
    }
    // The explanation ends the list of names.
    if !given {
        unknown.push(TIED.into());
    } else if !radius.sure() {
        unknown.push("root_radius_mm".into());
    }
    if unknown.is_empty() { Status::Ok } else { Status::Undetermined(unknown.join(" ")) }
}

/// The termination of a fit that ran, or the code for a fit that was refused.
pub fn termination(result: &Result<Measured, String>) -> Termination {
    result.as_ref().map_or(Termination::Refused, |m| m.fit.termination)
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{Truth, branch};
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn exact_readings_give_the_truth_back() {
        for (alpha, tip) in [(0.05, 0.1), (0.3, 0.75), (0.9, 0.3), (1e-3, 0.5), (1.0, 0.05)] {
            for along in [Along::Branch, Along::Axis] {
                let truth = Truth { alpha, tip, ..Truth::default() };
                let b = branch(&truth, 20, 1e-9, 1, along);
                let m = fit(&b, along).unwrap();
                assert!((m.taper.value / alpha - 1.0).abs() < 1e-5, "{alpha} {tip} {along:?}: {:?}", m.taper);
                assert!((m.load_over_stiffness.value / truth.load_over_stiffness() - 1.0).abs() < 1e-5);
                assert!((m.root_radius.value / truth.root_radius() - 1.0).abs() < 1e-5, "{:?}", m.root_radius);
                assert_eq!(m.status, Status::Ok);
            }
        }
    }

    /// 95 % intervals contain about 95 % of the truths. With 300 draws the share scatters by 1.3 %; 91 to 99 % is three
    /// times that.
    #[test]
    fn intervals_cover() {
        let truth = Truth { alpha: 0.25, tip: 0.4, ..Truth::default() };
        // Both kinds of position are tested, one with each kind of noise.
        for (stated, along) in [(true, Along::Branch), (false, Along::Axis)] {
            let draws: Vec<Measured> = (0..300u64)
                .into_par_iter()
                .map(|seed| {
                    let mut b = branch(&truth, 16, 0.01, 100 + seed, along);
                    if !stated {
                        b.readings.iter_mut().for_each(|r| r.error = f64::NAN);
                    }
                    fit(&b, along).unwrap()
                })
                .collect();
            // The quantile is normal where the noise is stated. Where it comes from the residuals, it is Student's with
            // the 14 degrees of freedom that 16 marks leave.
            let quantile = if stated { 1.96 } else { 2.145 };
            let tip = truth.tip_mm(along);
            for (name, want, get) in [
                ("taper", truth.alpha, (|m: &Measured| m.taper) as fn(&Measured) -> Known),
                ("load over stiffness", truth.load_over_stiffness(), |m| m.load_over_stiffness),
                ("tip", tip, |m| m.tip),
            ] {
                let inside = draws.iter().filter(|m| (get(m).value - want).abs() <= quantile * get(m).error).count();
                let share = inside as f64 / draws.len() as f64;
                println!(
                    "{name}, noise {}: {:.1} % inside 95 %",
                    if stated { "stated" } else { "estimated" },
                    100.0 * share
                );
                assert!((0.91..=0.99).contains(&share), "{name}: {share}");
            }
        }
    }

    #[test]
    fn what_cannot_be_told_apart_is_named() {
        let truth = Truth::default();
        let mut b = branch(&truth, 20, 1e-3, 3, Along::Branch);
        let known = fit(&b, Along::Branch).unwrap();
        assert_eq!(known.status, Status::Ok);
        // A tenth of error of the modulus makes a fortieth of error of the radius.
        b.modulus[1] = 0.1 * b.modulus[0];
        let m = fit(&b, Along::Branch).unwrap();
        assert!((m.root_radius.error / m.root_radius.value - 0.025).abs() < 2e-3, "{:?}", m.root_radius);
        b.modulus = [f64::NAN; 2];
        let m = fit(&b, Along::Branch).unwrap();
        assert!(m.root_radius.value.is_nan() && m.root_radius.error.is_infinite());
        assert!(
            m.status.to_string().starts_with("undetermined: root_radius_mm (load, modulus and root radius"),
            "{}",
            m.status
        );
        assert!((m.taper.value - known.taper.value).abs() < 1e-12, "the rest does not depend on it");
    }

    #[test]
    fn bad_measurements_are_refused_by_name() {
        let good = branch(&Truth::default(), 12, 0.01, 5, Along::Branch);
        let why = |spoil: &dyn Fn(&mut Branch)| {
            let mut b = good.clone();
            spoil(&mut b);
            fit(&b, Along::Branch).unwrap_err()
        };
        assert!(why(&|b| b.length = 0.0).contains("length_mm"));
        assert!(why(&|b| b.readings[2].position = 1e6).contains("position_mm"));
        assert!(why(&|b| b.readings[2].error = 0.0).contains("deflection_err_mm"));
        assert!(why(&|b| b.readings[2].error = f64::NAN).contains("some readings"));
        assert!(why(&|b| b.readings.truncate(1)).contains("too few"));
        assert!(why(&|b| b.readings.iter_mut().for_each(|r| r.deflection = 0.0)).contains("no deflection"));
        assert!(why(&|b| b.load[0] = -1.0).contains("load_n"));
    }

    /// A weight at the tip of an untapered branch looks much like a spread load on a tapered one. Precise readings show
    /// the difference.
    #[test]
    fn a_load_of_another_kind_is_noticed() {
        let mut b = branch(&Truth { alpha: 1.0, ..Truth::default() }, 24, 1e-4, 6, Along::Axis);
        let tip = 0.2 * b.length;
        for r in &mut b.readings {
            let x = r.position / b.length;
            r.deflection = tip * 0.5 * x * x * (3.0 - x);
        }
        let m = fit(&b, Along::Axis).unwrap();
        assert!(m.status != Status::Ok, "{m:?}");
    }
}
