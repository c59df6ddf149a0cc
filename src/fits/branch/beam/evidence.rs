//! Which kind of load the readings speak for.
//!
//! A load of another kind looks much like an even one on another taper: a load at the tip of an untapered branch like
//! an even load on a taper of .65, to .2 % of the tip's deflection. So readings seldom tell loads apart, and the load
//! is stated ([`Load`]) or taken as even. Where it is taken as even, the taper is known only if no other load that the
//! readings leave open gives another one.
//!
//! Each load is weighed by the probability with which it foretells the readings. Whether the branch tapers is not known
//! beforehand either: it is taken, at even chances, as untapered (a rod, a stick of one thickness) or as of any taper.
//! A load that describes the readings without a taper is then likelier than one that describes them equally well with a
//! taper made to measure, by the range that was open for the taper over its standard error (Occam's factor: D. J. C.
//! MacKay, Neural Computation 4 (1992), 415–447). The place of a single load is open too, so its probability is the
//! mean over places.

use super::curve::{BranchFitMarks, PRECISION};
use super::fit::{BranchEstimate, DeflectionMark, PositionReference};
use crate::rivals::{POSSIBLE, SUBSTANTIAL, how_well};
use mesophyll_base::solvers::Fit;
use mesophyll_plants::mechanics::load::Load;

/// Places of a single load that are tried, as shares of the length.
const PLACES: [f64; 4] = [0.45, 0.6, 0.75, 0.9];
/// Standard errors of a taper beyond which it is not 1.
const FAR: f64 = 6.0;
/// The least taper of a branch: tips of a fiftieth of the root's radius.
const LEAST: f64 = 0.02;

/// What the readings say of a load that was not assumed.
#[derive(Debug, Clone, PartialEq)]
pub struct AlternativeLoad {
    /// The load.
    pub load: Load,
    /// The taper that it gives; 1 without an error where the readings need none.
    pub taper: BranchEstimate,
    /// The load over stiffness (mm) that it gives.
    pub load_over_stiffness: f64,
    /// χ² of that fit.
    pub chi2: f64,
    /// How many times as probable it is as the load that was assumed.
    pub odds: f64,
}

impl AlternativeLoad {
    /// Whether it speaks against the load that was assumed. Of simulated branches with twelve marks that carry an even
    /// load, at most 4 % come to that for tapers of .15, .3 and .5, and 11 % for .8; of tapers near .65 most do,
    /// because those are what a rod with a load at its tip looks like. Of such rods 96 % come to that. A load at the
    /// tip of a branch that tapers seldom does: only `--load` can tell.
    pub fn stronger(&self) -> bool {
        self.odds > SUBSTANTIAL
    }

    /// How well it explains the readings beside the load that was assumed.
    pub fn how_well(&self) -> &'static str {
        how_well(self.odds)
    }

    /// The error (in the unit of `found`) of a number that the assumed load puts at `found` and this one at `other`:
    /// beside its own error, their distance, weighed by the probability that this load is the right one.
    pub fn widened(&self, found: BranchEstimate, other: f64) -> BranchEstimate {
        let share = if self.odds.is_finite() { self.odds / (1.0 + self.odds) } else { 1.0 };
        BranchEstimate { error: found.error.hypot((other - found.value) * share.sqrt()), ..found }
    }

    /// What it says, as a part of a sentence.
    pub fn words(&self) -> String {
        let taper = if self.taper.error > 0.0 {
            format!("alpha {:.2} ± {:.2}", self.taper.value, self.taper.error)
        } else {
            "no taper at all".into()
        };
        let load = match self.load {
            Load::Tip => "a load at the tip".into(),
            Load::OwnWeight => "the branch's own weight".into(),
            Load::Even => "an even load".into(),
            Load::Share(at) | Load::Millimetres(at) => format!("a load near {at} of the length"),
        };
        format!("{load} with {taper} (chi2 {:.3})", self.chi2)
    }
}

/// One load's fits, with the taper free and held at 1.
struct Weighed {
    load: Load,
    taper: BranchEstimate,
    /// Load over stiffness (mm) with the taper free, and held at 1.
    over_stiffness: [f64; 2],
    chi2: f64,
    rod: f64,
}

/// The other load that the readings speak for most, of those that they leave open and that give a taper which differs
/// by more than the errors or are clearly more probable than an even load. `stated`: whether deflections have errors.
pub fn against_even(
    readings: &[DeflectionMark],
    length: f64,
    along: PositionReference,
    stated: bool,
) -> Option<AlternativeLoad> {
    let marks = BranchFitMarks { readings, length, along, load: Load::Even, stated, untapered: false };
    let weigh = |load: Load| -> Option<Weighed> {
        let free = BranchFitMarks { load, ..marks }.glance();
        if !free.converged() {
            return None;
        }
        let taper = free.params.first()?.exp();
        let error = taper * free.uncertainty.stderr.first()?;
        // Where 1 is far from the taper that fits, so is the fit with it.
        let far = (taper - 1.0).abs() > FAR * error;
        let held = (!far).then(|| BranchFitMarks { load, untapered: true, ..marks }.glance());
        let rod = held.as_ref().map_or(f64::INFINITY, |held| 2.0 * held.cost);
        let rod = if rod.is_nan() { f64::INFINITY } else { rod };
        let amplitude = |fit: &Fit| length * fit.params.last().copied().unwrap_or(f64::NAN);
        let over_stiffness = [amplitude(&free), held.as_ref().map_or(f64::NAN, amplitude)];
        let taper = BranchEstimate { value: taper, error };
        Some(Weighed { load, taper, over_stiffness, chi2: 2.0 * free.cost, rod })
    };
    let even = weigh(Load::Even)?;
    let single = [Load::Tip, Load::OwnWeight].map(|load| weigh(load).into_iter().collect::<Vec<_>>());
    let placed: Vec<Weighed> = PLACES.into_iter().filter_map(|at| weigh(Load::Share(at))).collect();
    let all = || single.iter().flatten().chain(&placed).chain([&even]);
    let n = readings.len() as f64;
    // A noise that is understated would overstate every difference.
    let least = all().map(|w| w.chi2.min(w.rod)).fold(f64::INFINITY, f64::min);
    let temper = (least / (n - 2.0).max(1.0)).max(1.0);
    let nothing = n * (PRECISION * length).powi(2);
    let log = |chi2: f64| {
        if stated { -0.5 * chi2 / temper } else { -0.5 * (n - 1.0) * (chi2 + nothing).ln() }
    };
    // The share of all tapers, evenly in their logarithm, that the readings leave.
    let left = even.taper.error / even.taper.value * std::f64::consts::TAU.sqrt() / -LEAST.ln();
    let left = if left.is_finite() { left.clamp(1e-300, 1.0) } else { 1.0 };
    let parts = |w: &Weighed| -> [f64; 2] {
        let tapered = if w.taper.value < LEAST { f64::NEG_INFINITY } else { log(w.chi2) + left.ln() };
        [tapered, log(w.rod)]
    };
    let total = |w: &Weighed| -> f64 {
        let [a, b] = parts(w);
        let top = a.max(b).max(f64::MIN);
        top + (0.5 * (a - top).exp() + 0.5 * (b - top).exp()).ln()
    };
    let reference = total(&even);
    if !reference.is_finite() || reference <= f64::MIN {
        return None;
    }
    let other = |group: &[Weighed]| -> Option<AlternativeLoad> {
        let best = group.iter().max_by(|a, b| total(a).total_cmp(&total(b)))?;
        let odds = group.iter().map(|w| (total(w) - reference).exp()).sum::<f64>() / group.len() as f64;
        let [tapered, rod] = parts(best);
        let [free, held] = best.over_stiffness;
        let (taper, load_over_stiffness, chi2) = match rod > tapered {
            true => (BranchEstimate { value: 1.0, error: 0.0 }, held, best.rod),
            false => (best.taper, free, best.chi2),
        };
        Some(AlternativeLoad { load: best.load, taper, load_over_stiffness, chi2, odds })
    };
    let open = |other: &AlternativeLoad| {
        let apart = (other.taper.value - even.taper.value).abs() > other.taper.error.hypot(even.taper.error);
        other.odds >= POSSIBLE && (apart || other.stronger())
    };
    let groups = single.iter().chain([&placed]);
    groups.filter_map(|g| other(g)).filter(open).max_by(|a, b| a.odds.total_cmp(&b.odds))
}
