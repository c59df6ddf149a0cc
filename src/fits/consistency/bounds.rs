//! What the mask says, and numbers that no leaf can have.

use super::{CAUSE, Off, Seen, Setup, figure};
use crate::leaf_folder::filling;
use mesophyll_files::quantity::Quantity;
use std::collections::BTreeMap;

/// Single precision of a normal's three components.
const UNIT: f64 = 1e-5;
/// A texel with a ρt below zero by six of its standard errors, or with ρd + ρt above 1 by three, is a defect for the
/// fit. Rounding to single precision may move one that is just within.
const ENERGY: f64 = 6.5;

pub(super) fn look(seen: &Seen, out: &mut Vec<String>) {
    counts(seen, out);
    values(seen, out);
    normals(seen, out);
    if matches!(seen.setup, Setup::Unknown) {
        return;
    }
    errors(seen, out);
    filled(seen, out);
}

/// What is bounded by its own standard error: light that came through, and energy.
pub(super) fn light(seen: &Seen, out: &mut Vec<String>) {
    below_zero(seen, out);
    energy(seen, out);
}

/// The codes of the mask against the counts of `fit.toml`.
fn counts(seen: &Seen, out: &mut Vec<String>) {
    let mut codes = BTreeMap::<i64, usize>::new();
    seen.mask.iter().for_each(|m| *codes.entry(m.round() as i64).or_default() += 1);
    let named = seen.record.defects.iter().filter_map(|(code, name)| Some((code.parse::<i64>().ok()?, name.as_str())));
    for (code, name) in [(1, "good"), (0, "outside")].into_iter().chain(named) {
        let (found, Some(told)) = (codes.get(&code).copied().unwrap_or(0), seen.section.counts.get(name)) else {
            continue;
        };
        if found != *told {
            out.push(format!(
                "{}: mask.Y has {found} texels of code {code} ({name}), but fit.toml counts {told}; {CAUSE}",
                seen.path.display()
            ));
        }
    }
}

/// Good texels hold finite numbers of at least the value that the quantity can have.
fn values(seen: &Seen, out: &mut Vec<String>) {
    use Quantity::{Gamma, M, RhoD, RhoS, RhoT, SigmaA, SigmaS, Thickness};
    for quantity in [RhoD, RhoT, RhoS, Gamma, M, Thickness, SigmaA, SigmaS] {
        for c in 0..quantity.letters().len() {
            let Some(plane) = seen.maps.plane(quantity, c) else { continue };
            let mut off = 0;
            let mut first = None;
            for &k in &seen.good {
                let v = f64::from(plane[k]);
                // The slab of a texel may be unknown, and Eq. 5 of the paper has no γ for some.
                let may_lack = matches!(quantity, SigmaA | SigmaS) || (seen.setup == Setup::Paper && quantity == Gamma);
                let bad = match v {
                    v if v.is_nan() => !may_lack,
                    v if v.is_infinite() => true,
                    // These are measured and scatter about zero where there is no light. The others have bounds.
                    _ if matches!(quantity, RhoT | Gamma) => false,
                    v => v < 0.0 || (v == 0.0 && matches!(quantity, M | Thickness)),
                };
                if bad {
                    off += 1;
                    first = first.or(Some(k));
                }
            }
            if let Some(k) = first {
                out.push(format!(
                    "{}: {} holds {} at texel {}, which the mask calls good, and {} more like it; {}",
                    seen.path.display(),
                    quantity.channel(c),
                    plane[k],
                    seen.at(k),
                    off - 1,
                    "the map was changed after the fit, which writes no such value there"
                ));
            }
        }
    }
}

/// Normals have the length 1 and point out of their side.
fn normals(seen: &Seen, out: &mut Vec<String>) {
    let Some([x, y, z]) = seen.maps.three(Quantity::Normal) else { return };
    let (mut length, mut inwards) = (Off::default(), Off::default());
    for &k in &seen.good {
        let n = [x[k], y[k], z[k]].map(f64::from);
        length.add(k, n.iter().map(|v| v * v).sum::<f64>().sqrt(), 1.0, UNIT);
        inwards.within(k, n[2], 0.0, 1.0 + UNIT);
    }
    out.extend(seen.told(&length, &seen.path, "the length of normal", "1"));
    out.extend(seen.told(&inwards, &seen.path, "normal.Z", "a direction out of the leaf"));
}

/// Standard errors are not negative, and nothing that was not measured has one.
fn errors(seen: &Seen, out: &mut Vec<String>) {
    let Some(errors) = &seen.errors else { return };
    for (name, plane) in &errors.channels {
        if let Some(&k) = seen.good.iter().find(|&&k| plane[k] < 0.0) {
            out.push(format!(
                "{}: {name} is {} at texel {}, expected a standard error of 0 or more",
                seen.errors_path.display(),
                plane[k],
                seen.at(k)
            ));
        }
        // NaN is an error that is not known: where the slab of a texel is not known either.
        let known = seen.maps.get(name);
        let lacks = |k: &&usize| plane[**k].is_nan() && known.is_some_and(|v| v[**k].is_finite());
        let may_lack = matches!(seen.setup, Setup::Paper | Setup::Edited | Setup::Dome);
        if let Some(&k) = seen.good.iter().filter(|_| !may_lack).find(lacks) {
            out.push(format!(
                "{}: {name} is NaN at texel {}, which the mask calls good; {CAUSE}",
                seen.errors_path.display(),
                seen.at(k)
            ));
        }
    }
}

/// Less light than none comes through by as much as noise makes of it.
fn below_zero(seen: &Seen, out: &mut Vec<String>) {
    for quantity in [Quantity::RhoT, Quantity::Gamma] {
        for c in 0..quantity.letters().len() {
            let error = seen.errors.as_ref().and_then(|e| e.plane(quantity, c));
            let (Some(plane), Some(error)) = (seen.maps.plane(quantity, c), error) else { continue };
            let mut off = Off::default();
            for &k in seen.good.iter().filter(|&&k| plane[k] < 0.0 && !error[k].is_nan()) {
                off.within(k, f64::from(plane[k]), -ENERGY * f64::from(error[k]), 0.0);
            }
            let by = format!("within {ENERGY} of its standard errors of 0");
            out.extend(seen.told(&off, &seen.path, &quantity.channel(c), &by));
        }
    }
}

/// A texel does not give back more light than it gets.
fn energy(seen: &Seen, out: &mut Vec<String>) {
    use Quantity::{RhoD, RhoT};
    // Under a dome and in photographs light falls on the other side from that whose albedo is in the map, so that the
    // fit judges energy with the other side's. In the window anything can be set.
    if matches!(seen.setup, Setup::Dome | Setup::Photo | Setup::Edited) {
        return;
    }
    for c in 0..3 {
        let (Some(d), Some(t)) = (seen.maps.plane(RhoD, c), seen.maps.plane(RhoT, c)) else { continue };
        let error = |q: Quantity, k: usize| {
            let plane = seen.errors.as_ref().and_then(|e| e.plane(q, c));
            plane.map_or(0.0, |e| if e[k].is_nan() { 0.0 } else { f64::from(e[k]) })
        };
        let mut off = Off::default();
        for &k in &seen.good {
            let most = 1.0 + ENERGY * error(RhoD, k).hypot(error(RhoT, k)) + UNIT;
            off.within(k, f64::from(d[k]) + f64::from(t[k]), f64::NEG_INFINITY, most);
        }
        let letter = RhoD.letters()[c];
        out.extend(seen.told(&off, &seen.path, &format!("rho_d.{letter} + rho_t.{letter}"), "at most 1"));
    }
}

/// Beyond the good texels, maps hold the values of their nearest good one.
fn filled(seen: &Seen, out: &mut Vec<String>) {
    use Quantity::{Gamma, Normal, RhoD, RhoS, RhoT, SigmaA, SigmaS, Thickness};
    let good: Vec<bool> = seen.mask.iter().map(|m| *m == 1.0).collect();
    let Some(source) = filling::sources(&good, seen.maps.width, seen.maps.height) else { return };
    for quantity in [RhoD, RhoT, RhoS, Normal, Gamma, Thickness, SigmaA, SigmaS] {
        for c in 0..quantity.letters().len() {
            let Some(plane) = seen.maps.plane(quantity, c) else { continue };
            let differs = |k: &usize| {
                let (v, from) = (plane[*k], plane[source[*k] as usize]);
                v != from && !(v.is_nan() && from.is_nan())
            };
            let mut off = (0..plane.len()).filter(|k| !good[*k]).filter(differs);
            if let Some(k) = off.next() {
                out.push(format!(
                    "{}: {} beyond the good texels is not that of the nearest good one at {} texels, such as {} at {}, \
                     where that is {}; {CAUSE}",
                    seen.path.display(),
                    quantity.channel(c),
                    1 + off.count(),
                    figure(f64::from(plane[k])),
                    seen.at(k),
                    figure(f64::from(plane[source[k] as usize]))
                ));
            }
        }
    }
}
