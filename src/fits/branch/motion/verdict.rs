//! Which kind of motion a record shows, what its numbers are, and whether they can be relied on.

use super::cleaning::{self, CleanRecord};
use super::decay::DecayFit;
use super::gusts::GustFit;
use super::spectra::Periodograms;
use super::whittle::GustParameters;
use super::{MotionEstimate, MotionFit, MotionKind, MotionPrior, MotionRecord};
use crate::rivals::{POSSIBLE, how_well};
use mesophyll_base::error::Status;
use std::f64::consts::PI;

/// Largest relative standard error of a value that counts as found.
const FOUND: f64 = 0.1;
/// One kind of motion is taken where its log-likelihood is larger by this: odds of 400 to 1.
const CLEAR: f64 = 6.0;
/// No branch sways more slowly, or faster, than this (Hz): tall trees sway once in ten seconds, twigs of a
/// centimetre fifty times a second.
const RESONANCES: [f64; 2] = [0.03, 100.0];
/// Deflections (mm) that no branch's tip has: 30 m.
const FAR: f64 = 3e4;
/// Damping times length of a record in gusts below which the damping is not determined.
const REMEMBERED: f64 = 8.0;
/// A free decay read this often in a cycle is told from one above half the sampling rate by common sense alone, ...
const A_CYCLE: f64 = 10.0;
/// ... as is one whose alias lies above this frequency (Hz), where branches do not sway visibly.
const FAST: f64 = 10.0;

/// Decides between the two fits and makes the answer. `stepped` is `known` with the noise of rounding.
pub fn choose(
    record: &MotionRecord,
    known: &MotionPrior,
    stepped: &MotionPrior,
    cleaned: CleanRecord,
    gusts: Result<(GustFit, Vec<(usize, usize)>), String>,
    decay: Result<DecayFit, String>,
) -> Result<MotionFit, String> {
    let (mut motion, wild) = match (gusts, decay) {
        (Ok((gusts, wild)), Ok(decay)) => {
            let ahead = ahead(&gusts, &decay, record, stepped);
            let why = format!("its log-likelihood is {:.1} above that of", ahead.abs());
            // Where the likelihood does not tell, what describes the record.
            let free = match () {
                () if ahead.abs() > CLEAR => ahead > 0.0,
                () => gusts.lack.is_some() && decay.adequacy.describes(),
            };
            let as_decay = || of_decay(&decay, record, known, format!("{why} gusts"));
            let as_gusts = || of_gusts(&gusts, record, stepped, format!("{why} a free decay"));
            // Nobody stated the kind, so the other one counts unless it is clearly less likely or does not describe the
            // record.
            if free {
                let odds = (-ahead).exp();
                let left = odds >= POSSIBLE && gusts.lack.is_none();
                (beside(as_decay(), left.then(|| (as_gusts(), odds))), decay.wild)
            } else {
                let odds = ahead.exp();
                let left = odds >= POSSIBLE && decay.adequacy.describes();
                (beside(as_gusts(), left.then(|| (as_decay(), odds))), wild)
            }
        }
        (Ok((gusts, wild)), Err(why)) => {
            let why = if why.is_empty() { "--kind gusts".into() } else { format!("no free decay: {why}") };
            (of_gusts(&gusts, record, stepped, why), wild)
        }
        (Err(no_gusts), Ok(decay)) => {
            // A record too short for gusts is a free decay only where one describes it.
            let pulled = decay.adequacy.describes() && moved(&decay, &cleaned);
            if !(no_gusts.is_empty() || pulled) {
                return Err(no_gusts);
            }
            let why = if no_gusts.is_empty() { "--kind free-decay".into() } else { format!("no gusts: {no_gusts}") };
            (of_decay(&decay, record, known, why), decay.wild)
        }
        (Err(gusts), Err(decay)) => return Err(if gusts.is_empty() { decay } else { gusts }),
    };
    let (phrases, many) = cleaning::said(record, &wild);
    motion.taken_out.splice(0..0, cleaned.left_out.into_iter().chain(phrases));
    if let Some(doubt) = cleaned.doubt.or(many) {
        motion.status = open(&motion, |_| true, &doubt);
    }
    Ok(motion)
}

/// Whether most of the movement is the oscillation.
fn moved(decay: &DecayFit, cleaned: &CleanRecord) -> bool {
    let squares = |all: &[Vec<f64>]| {
        let one = |c: &Vec<f64>| {
            let there: Vec<f64> = c.iter().copied().filter(|v| !v.is_nan()).collect();
            let mean = there.iter().sum::<f64>() / there.len().max(1) as f64;
            there.iter().map(|v| (v - mean).powi(2)).sum::<f64>()
        };
        all.iter().map(one).sum::<f64>()
    };
    squares(&decay.residuals) < 0.1 * squares(&cleaned.channels)
}

/// By how much the log-likelihood of a free decay is above that of gusts, over the frequencies that gusts were fitted
/// to, less half of Schwarz's allowance for parameters. What a decay leaves is white noise.
fn ahead(gusts: &GustFit, decay: &DecayFit, record: &MotionRecord, known: &MotionPrior) -> f64 {
    let spectra = &gusts.spectra;
    let (taper, degree) = if gusts.drift { (super::gusts::TAPER, super::gusts::DEGREE) } else { (0.0, 0) };
    let channels = record.channels.len();
    let width = (gusts.band.1 + 1 - gusts.band.0) as f64;
    // A decay that begins later is compared on its own part, whose frequencies are others.
    let share = (spectra.readings - decay.before) as f64 / spectra.readings as f64;
    let at = |k: usize| (k as f64 * share).round() as usize;
    let rest: Vec<Vec<f64>> = decay.residuals.clone();
    let left = Periodograms::new(&rest, record.step, 0.0, taper, degree);
    let band = at(gusts.band.0).max(1)..=at(gusts.band.1).min(left.top());
    let free: f64 = left
        .powers
        .iter()
        .map(|p| {
            let mean = p[band.clone()].iter().sum::<f64>() / band.clone().count() as f64;
            width * (mean.max(spectra.floor).max(f64::MIN_POSITIVE).ln() + 1.0)
        })
        .sum();
    let parameters = |n: usize| 0.5 * n as f64 * (width * channels as f64).ln();
    let surprise = gusts.surprise(known) + parameters(gusts.found.0.len());
    surprise - free - parameters(2 + channels * (3 + decay.degree))
}

/// The status that leaves open all values for which `which` holds.
fn open(motion: &MotionFit, which: impl Fn(&MotionEstimate) -> bool, why: &str) -> Status {
    let gains = ["gain_u_mm_per_sqrt_hz", "gain_v_mm_per_sqrt_hz"].into_iter().zip(motion.gains.iter().copied());
    let named =
        [("resonance_hz", motion.resonance), ("damping_per_s", motion.damping), ("damping_ratio", motion.ratio)];
    Status::undetermined(named.into_iter().chain(gains).filter(|(_, value)| which(value)).map(|(name, _)| name), why)
}

/// The motion, with what the other kind puts elsewhere left open; that kind comes with its odds.
fn beside(mut motion: MotionFit, other: Option<(MotionFit, f64)>) -> MotionFit {
    let Some((other, odds)) = other else { return motion };
    let pairs = [(motion.resonance, other.resonance), (motion.damping, other.damping), (motion.ratio, other.ratio)];
    let differs = |(a, b): &(MotionEstimate, MotionEstimate)| (a.value - b.value).abs() > a.error.hypot(b.error);
    let apart: Vec<MotionEstimate> = pairs.into_iter().filter(differs).map(|(own, _)| own).collect();
    let all_open = ["resonance_hz", "damping_per_s"].iter().all(|name| motion.status.leaves_open(name));
    if apart.is_empty() || all_open {
        return motion;
    }
    let kind = match other.kind {
        MotionKind::FreeDecay => "a free decay",
        _ => "a motion in gusts",
    };
    let why = format!(
        "{kind} explains the record {}, with a resonance of {:.3} ± {:.3} Hz and a damping of {:.3} ± {:.3} 1/s; \
         --kind states which it is",
        how_well(odds),
        other.resonance.value,
        other.resonance.error,
        other.damping.value,
        other.damping.error
    );
    let unsure = |v: &MotionEstimate| !(v.error <= FOUND * v.value.abs());
    motion.status = open(&motion, |v| apart.contains(v) || unsure(v), &why);
    motion
}

/// Reasons to doubt any motion, the gravest first.
fn status(motion: &MotionFit, record: &MotionRecord, lack: Option<String>, alias: Option<String>) -> Status {
    let all = |why: &str| open(motion, |_| true, why);
    let f = motion.resonance.value;
    let largest = record.channels.iter().flatten().filter(|v| !v.is_nan()).map(|v| v.abs()).fold(0.0, f64::max);
    let spread = record.channels.iter().map(|c| spread(c)).fold(0.0, f64::max);
    if f < RESONANCES[0] {
        return all(&format!(
            "no branch sways once in {:.0} s; readings {} s apart: are the times in milliseconds?",
            1.0 / f,
            record.step
        ));
    }
    if f > RESONANCES[1] {
        return all(&format!(
            "no branch sways {f:.0} times a second; readings {:.3e} s apart: are the times in minutes or hours, or \
             does time_ms hold seconds?",
            record.step
        ));
    }
    if spread > FAR {
        return all(&format!("no tip moves by {largest:.0} mm: are the deflections in micrometres?"));
    }
    if let Some(why) = lack {
        return all(&why);
    }
    if motion.ratio.value >= 1.0 {
        return all(&format!(
            "a damping ratio of {:.2}: such a branch does not sway, and resonance and damping are not told apart",
            motion.ratio.value
        ));
    }
    if let Some(why) = alias {
        return all(&why);
    }
    open(motion, |v| !(v.error <= FOUND * v.value.abs()), "a standard error above 10 %")
}

/// Largest less smallest reading.
fn spread(readings: &[f64]) -> f64 {
    let there = readings.iter().copied().filter(|v| !v.is_nan());
    there.clone().fold(f64::NEG_INFINITY, f64::max) - there.fold(f64::INFINITY, f64::min)
}

fn of_decay(decay: &DecayFit, record: &MotionRecord, known: &MotionPrior, why: String) -> MotionFit {
    let [f, gamma] = decay.values;
    let ratio = gamma / (4.0 * PI * f);
    let mut taken_out = Vec::new();
    if decay.before > 0 {
        taken_out.push(format!("{} readings before the release", decay.before));
    }
    if decay.degree > 0 {
        taken_out.push(format!("drift (a polynomial of degree {})", decay.degree));
    }
    let mut motion = MotionFit {
        kind: MotionKind::FreeDecay,
        resonance: MotionEstimate { value: f, error: decay.errors[0] },
        damping: MotionEstimate { value: gamma, error: decay.errors[1] },
        ratio: MotionEstimate {
            value: ratio,
            error: if gamma > 0.0 { ratio * decay.ratio_error } else { f64::INFINITY },
        },
        gains: Vec::new(),
        slowness: MotionEstimate { value: f64::NAN, error: f64::NAN },
        bins: 0,
        deviance: f64::NAN,
        taken_out,
        why,
        status: Status::Ok,
    };
    let rate = 1.0 / record.step;
    // Evenly read, a decay at the rate less this frequency gives the very same numbers.
    let seen = f * (1.0 - ratio * ratio).max(0.0).sqrt();
    let alias = rate - seen;
    let told = rate >= A_CYCLE * seen || alias > FAST || known.band[1].is_some_and(|highest| highest < alias);
    let alias = (!told).then(|| {
        format!(
            "a resonance of {alias:.2} Hz, above half the sampling rate, explains the record as well: {:.1} readings a \
             cycle; --highest HZ states that none is above it",
            rate / seen
        )
    });
    let lack = decay.adequacy.why("branch");
    motion.status = status(&motion, record, lack, alias);
    motion
}

fn of_gusts(gusts: &GustFit, record: &MotionRecord, known: &MotionPrior, why: String) -> MotionFit {
    let expected = gusts.expected(known);
    let covariance = expected.covariance(&gusts.found);
    let found: &GustParameters = &gusts.found;
    let size = covariance.as_ref().map_or(0, |c| c.ncols());
    let variance = |weights: &[(usize, f64)]| match &covariance {
        Some(c) if weights.iter().all(|w| w.0 < size) => {
            weights.iter().flat_map(|a| weights.iter().map(|b| a.1 * b.1 * c[(a.0, b.0)])).sum::<f64>()
        }
        _ => f64::INFINITY,
    };
    // Logarithms were fitted, so their errors are relative errors.
    let log = |value: f64, weights: &[(usize, f64)]| {
        let relative = variance(weights).sqrt();
        MotionEstimate { value, error: if relative.is_finite() { value * relative } else { f64::INFINITY } }
    };
    let channels = expected.channels();
    let slowness = match known.speed {
        Some(speed) => MotionEstimate { value: 1.0 / speed, error: 0.0 },
        None => MotionEstimate { value: expected.slowness(found), error: variance(&[(2 + channels, 1.0)]).sqrt() },
    };
    let mut taken_out = Vec::new();
    if gusts.drift {
        taken_out.push(format!(
            "drift (a polynomial of degree {}, all below {:.4} Hz, and power as 1/f² above)",
            super::gusts::DEGREE,
            gusts.hertz(gusts.band.0)
        ));
    }
    let mut motion = MotionFit {
        kind: MotionKind::Gusts,
        resonance: log(found.resonance(), &[(0, 1.0)]),
        damping: log(found.damping(), &[(1, 1.0)]),
        ratio: log(found.damping() / (4.0 * PI * found.resonance()), &[(1, 1.0), (0, -1.0)]),
        gains: (0..channels).map(|c| log(found.gain(c), &[(2 + c, 1.0)])).collect(),
        slowness,
        bins: expected.bins(),
        deviance: gusts.deviance(),
        taken_out,
        why,
        status: Status::Ok,
    };
    for value in [&mut motion.resonance, &mut motion.damping, &mut motion.ratio].into_iter().chain(&mut motion.gains) {
        value.error *= gusts.widening;
    }
    // A motion that is remembered for longer than the record is no random one that could be told from it.
    let length = gusts.spectra.readings as f64 * record.step;
    let unresolved = (motion.damping.value * length < REMEMBERED).then(|| {
        format!(
            "it is remembered for {:.0} s or more, and the record has {length:.0} s: a longer record, or a line of a \
             machine",
            2.0 / motion.damping.value.max(1.0 / (1e3 * length))
        )
    });
    let lack = gusts.lack.clone().or(unresolved);
    motion.status = status(&motion, record, lack, None);
    // The search for a resonance above half the sampling rate is only worth while where all else is right, or where
    // such a resonance may be what is wrong.
    if (motion.status.is_ok() || gusts.lack.is_some())
        && let Some(f) = gusts.alias(known)
        && known.band[1].is_none_or(|highest| f <= highest)
    {
        let why = format!("a resonance of {f:.2} Hz, above half the sampling rate, explains the record as well");
        motion.status = status(&motion, record, None, Some(why));
    }
    motion
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(kind: MotionKind, resonance: [f64; 2], damping: [f64; 2]) -> MotionFit {
        let of = |[value, error]: [f64; 2]| MotionEstimate { value, error };
        MotionFit {
            kind,
            resonance: of(resonance),
            damping: of(damping),
            ratio: of([damping[0] / (4.0 * PI * resonance[0]), 0.003]),
            gains: Vec::new(),
            slowness: of([f64::NAN; 2]),
            bins: 0,
            deviance: f64::NAN,
            taken_out: Vec::new(),
            why: String::new(),
            status: Status::Ok,
        }
    }

    /// What the other kind puts elsewhere is open, with its numbers; what both say alike is not.
    #[test]
    fn what_another_kind_of_motion_puts_elsewhere_is_open() {
        let pulled = motion(MotionKind::FreeDecay, [2.0, 0.02], [0.9, 0.03]);
        let gusts = motion(MotionKind::Gusts, [2.01, 0.03], [1.4, 0.1]);
        let found = beside(pulled.clone(), Some((gusts.clone(), 1.0))).status;
        let open = ["resonance_hz", "damping_per_s", "damping_ratio"].map(|name| found.leaves_open(name));
        assert_eq!(open, [false, true, true], "{found}");
        let said = found.to_string();
        for words in ["a motion in gusts explains the record about as well", "1.400", "--kind"] {
            assert!(said.contains(words), "{said}");
        }
        // One that says the same, or none.
        let alike = motion(MotionKind::Gusts, [2.01, 0.03], [0.92, 0.1]);
        assert_eq!(beside(pulled.clone(), Some((alike, 1.0))).status, Status::Ok);
        assert_eq!(beside(gusts, None).status, Status::Ok);
    }
}
