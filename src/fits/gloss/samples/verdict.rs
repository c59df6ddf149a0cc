//! What a fitted leaf's row promises: whether its numbers are possible, whether the lobe describes it, and which values
//! are determined.

use super::leaf::Leaf;
use super::{GlossFitSettings, GlossSample, GlossSampleFit, LobeChoice, TILT, TiltChoice};
use crate::gloss::normal_of;
use mesophyll_files::table::Status;
use mesophyll_optics::gloss::{LobeKind, dot};

/// A normal that leans farther than this (rad, 25°) is not that of a leaf that lies flat.
const LEANS: f64 = 0.436;
/// A diffuse reflectance above this is no reflectance in shares of one.
const PER_CENT: f64 = 1.5;

/// Why the readings are no reflectance factors, if so.
pub(super) fn not_reflectance(
    samples: &[GlossSample],
    f: &GlossSampleFit,
    values: &[String],
    settings: &GlossFitSettings,
) -> Option<String> {
    let most = samples.iter().flat_map(|s| &s.values).filter(|v| v.is_finite()).copied().fold(0.0, f64::max);
    if settings.percent {
        return (100.0 * most <= PER_CENT).then(|| {
            format!("the largest reading is {:.3}; is it a share already? Then leave --percent out", 100.0 * most)
        });
    }
    let (k, rho_d) = f.rho_d.iter().enumerate().find(|(_, d)| **d > PER_CENT)?;
    let guess = if most > 300.0 { "are these counts of the instrument?" } else { "per cent? add --percent" };
    Some(format!("{} reflects {rho_d:.3} diffusely; expected at most 1 ({guess})", values[k]))
}

/// A reason to doubt the directions of a leaf whose normal leans.
#[derive(Debug, Default)]
pub(super) struct Suspicion(Option<String>);

impl Suspicion {
    /// Tries the conventions of azimuth that other tables have.
    pub fn of(samples: &[GlossSample], f: &GlossSampleFit, settings: &GlossFitSettings) -> Suspicion {
        // Who states the convention knows it.
        if settings.mirror_azimuth.is_some() {
            return Suspicion(None);
        }
        let lean = f.leaning();
        let normal = normal_of(f.tilt);
        let angle = |a: [f64; 3], b: [f64; 3]| dot(a, b).clamp(-1.0, 1.0).acos();
        let zenith = |s: &GlossSample| angle(s.light, [0.0, 0.0, 1.0]);
        // A mirror side on the wrong side looks like a normal that points at the source.
        let facing = |s: &GlossSample| zenith(s) > 0.05 && angle(s.light, normal) < 0.4 * zenith(s);
        let turned = samples.iter().any(|s| s.light[1].abs() > 0.01 || s.light[0] < -0.01);
        let doubtful = lean > LEANS || f.misfit.is_some() || samples.iter().any(facing) || (turned && lean > 0.14);
        if !doubtful {
            return Suspicion(None);
        }
        let better = |change: &dyn Fn(&GlossSample) -> GlossSample| {
            let other: Vec<GlossSample> = samples.iter().map(change).collect();
            let kind = LobeKind::from(f.lobe);
            Leaf::fit(&other, f.rho_d.len(), kind, settings).is_ok_and(|leaf| {
                let there = leaf.report();
                let flatter = there.leaning() < 0.4 * lean && there.rms < 1.5 * f.rms + 1e-6;
                flatter || there.rms < 0.5 * f.rms
            })
        };
        let opposite = |s: &GlossSample| GlossSample { view: [-s.view[0], -s.view[1], s.view[2]], ..s.clone() };
        let relative = |s: &GlossSample| {
            let across = s.light[0].hypot(s.light[1]);
            GlossSample { light: [across, 0.0, s.light[2]], ..s.clone() }
        };
        let mut why = String::new();
        // A lobe that does not describe the leaf may lean for that.
        let leans = lean > LEANS && f.misfit.is_none() && f.better.is_none();
        if leans {
            why = format!(
                "the normal leans by {:.0} degrees, more than that of a leaf that lies flat",
                lean.to_degrees()
            );
        }
        let mut guess = |text: &str| {
            why = if why.is_empty() { text.to_string() } else { format!("{why}: {text}") };
        };
        if better(&opposite) {
            guess("is the mirror side at view azimuth 0? Then add --mirror-azimuth 0");
        } else if turned && better(&relative) {
            guess("are view azimuths counted from the source? Then leave source_azimuth_deg out");
        } else if leans {
            guess("if it does lean so, add --mirror-azimuth 180");
        }
        Suspicion((!why.is_empty()).then_some(why))
    }
}

/// The status of a fitted leaf.
pub(super) fn status(
    f: &GlossSampleFit,
    values: &[String],
    samples: &[GlossSample],
    settings: &GlossFitSettings,
    suspicion: &Suspicion,
) -> Status {
    let mut reasons: Vec<String> = Vec::new();
    let mut all = false;
    if let Some(why) = &f.misfit {
        all = true;
        let better = match (&f.better, settings.surface) {
            (Some((kind, true)), _) => format!("; --lobe {kind} describes it"),
            (Some((kind, false)), _) => format!("; --lobe {kind} describes it better, but not to its noise either"),
            (None, LobeChoice::Auto) => "; no other lobe does".into(),
            _ => String::new(),
        };
        reasons.push(format!("the model does not describe this leaf: {why}{better}"));
    } else if let Some((kind, _)) = &f.better {
        all = true;
        let own = LobeKind::from(f.lobe);
        let gain = f.evidence[*kind as usize] - f.evidence[own as usize];
        reasons.push(format!(
            "the lobe does not describe this leaf: the readings are e^{gain:.0} times as likely with --lobe {kind} as \
             with {own}"
        ));
    }
    if let Some(why) = &f.rival {
        all = true;
        reasons.push(why.clone());
    }
    if let Some(why) = &suspicion.0 {
        all = true;
        reasons.push(why.clone());
    }
    if let Some(why) = impossible(f, values, samples) {
        all = true;
        reasons.push(why);
    }
    let unsure = |err: f64, value: f64| err.is_nan() || err > 0.1 * value;
    let [slope_ends, index_ends] = f.ends();
    let mut names: Vec<String> = Vec::new();
    let mut name = |open: bool, name: &str| {
        if open {
            names.push(name.to_string());
        }
    };
    for (k, v) in values.iter().enumerate() {
        name(all || unsure(f.rho_d_err[k], f.rho_d[k]), &format!("rho_d_{v}"));
    }
    name(all || unsure(f.rho_s_err, f.rho_s), "rho_s");
    name(all || slope_ends || unsure(f.m_err, f.m), "m");
    let stated = [settings.tilts == TiltChoice::Level, settings.tilts != TiltChoice::Free];
    for (k, tilt) in ["tilt", "tilt_y"].into_iter().enumerate() {
        let open = f.tilt[k].abs() >= TILT - 1e-9 || unsure(f.tilt_err[k], f.tilt[k].abs().max(0.35));
        name((all && !stated[k]) || open, tilt);
    }
    if settings.index.is_none() {
        // What reflects is n − 1, so that is what has to be known to a tenth.
        let open = f.lobe.index().is_none_or(|n| unsure(f.index_err, n - 1.0));
        name(all || index_ends || open, "index");
    }
    if names.is_empty() {
        return Status::Ok;
    }
    reasons.extend(f.taken.clone());
    if !f.tied.is_empty() {
        let tied: Vec<String> = f.tied.iter().map(ToString::to_string).collect();
        let tied = tied.join(" and ");
        reasons.push(format!("{} and {tied} describe the leaf equally well; --lobe states which", f.lobe.name()));
    }
    Status::undetermined(names, &reasons.join("; "))
}

/// What no leaf has.
fn impossible(f: &GlossSampleFit, values: &[String], samples: &[GlossSample]) -> Option<String> {
    let (k, most) = f.rho_d.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    let sure = |value: f64, error: f64| value - 2.0 * if error.is_finite() { error } else { 0.0 } > 1.0;
    if sure(*most, f.rho_d_err[k]) {
        return Some(format!(
            "{} reflects {most:.2} diffusely, more than all light: per cent? add --percent",
            values[k]
        ));
    }
    // The source nearest to the zenith, where the lobe's albedo is the surest.
    let cos = samples.iter().map(|s| s.light[2]).fold(0.0, f64::max);
    let gloss = f.lobe.albedo(cos, f.m);
    let whole = most + f.rho_s * gloss;
    sure(whole, f.rho_d_err[k].hypot(f.rho_s_err * gloss)).then(|| {
        format!("{} and the gloss reflect {whole:.2} together, more than all light: per cent? add --percent", values[k])
    })
}
