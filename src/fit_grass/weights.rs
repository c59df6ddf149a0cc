//! The fit of the weights: how much of their optical depth slices should have, direction by direction, so that they
//! cover what the blades cover.
//!
//! The projection of the blades ([`crate::blades::Meadow::projection`]) says it for blades that stand at random in
//! slabs without thickness. Real ones stand in tufts, and the slabs of few slices are thick beside the height. So the
//! projection that the weights are made from is fitted, a number at each of [`STEPS`] + 1 steps of |Ω_z|, by rays in
//! azimuths of their own.

use crate::Result;
use crate::blades::{Meadow, STEPS};
use crate::judge::{Rays, coverage_of_blades, coverage_of_slices, towards};
use crate::march::Slices;
use mesophyll_files::progress::{self, Bar};
use serde::{Deserialize, Serialize};

/// What is known at a step of |Ω_z|.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Known {
    /// The projection that the weights are made from.
    pub value: f64,
    /// Its standard error, from the number of rays; infinite where the rays do not determine it.
    pub error: f64,
    /// Why they do not.
    pub why: Option<String>,
}

/// Azimuths: one in each eighth of a quarter, quarter by quarter.
const AZIMUTHS: usize = 8;
/// Beyond this the coverage says little about an optical depth.
const COVERED: f64 = 0.985;
/// Less than this of its area is what rounding leaves of a blade that is seen along its plane.
const SHOWN: f64 = 1e-9;
/// A fitted step may be off by so many standard errors of its coverage.
const OFF: f64 = 3.0;

/// Fits the projection of `slices` (which has the blades' own until then) to the blades, by rays from so many points of
/// entry along each side of the rectangle.
///
/// # Errors
/// A stop that was asked for.
pub fn fit(meadow: &Meadow, slices: &mut Slices, entries: usize) -> Result<Vec<Known>> {
    let rays = Rays { side: entries, level: 0.0, sunlit: false };
    let bar = Bar::new("weights", STEPS as u64 + 1);
    let mut known: Vec<Option<Known>> = vec![None; STEPS + 1];
    let mut why = [None; STEPS + 1];
    // Along the ground no ray ends.
    for k in (1..=STEPS).rev() {
        progress::go_on()?;
        bar.step()?;
        let directions = directions(k as f64 / STEPS as f64);
        let mean = |of: &dyn Fn([f64; 2]) -> f64| directions.iter().map(|d| of(*d)).sum::<f64>() / AZIMUTHS as f64;
        let wanted = mean(&|[e, a]| coverage_of_blades(meadow, rays, towards(e, a)));
        if wanted > COVERED {
            why[k] = Some("nearly all rays end on a blade");
            continue;
        }
        // More than all that slices show, along the axes where that is least, is not to be had.
        let vertical = k as f64 / STEPS as f64;
        let most = slices.shown[0] * (1.0 - vertical * vertical).sqrt() + slices.shown[1] * vertical;
        let own = meadow.projection[k];
        if own < SHOWN || wanted <= 0.0 {
            why[k] = Some("no ray ends on a blade");
            continue;
        }
        let mut off = |times: f64| {
            // Between two steps straight lines are taken; here the direction is at a step.
            slices.projection[k] = own * times;
            mean(&|[e, a]| coverage_of_slices(slices, rays, towards(e, a))) - wanted
        };
        let most = most / own;
        // Points spread over a grid err less than this; both kinds of ray have it.
        let error = (wanted * (1.0 - wanted) / (entries * entries * AZIMUTHS) as f64).sqrt();
        let (mut low, mut high) = ((0.0, -wanted), (most, off(most)));
        let mut at = high;
        for _ in 0..12 {
            if high.1 <= 0.0 || at.1.abs() < 1e-4 {
                break;
            }
            let share = (-low.1 / (high.1 - low.1)).clamp(0.05, 0.95);
            let next = low.0 + share * (high.0 - low.0);
            at = (next, off(next));
            if at.1 < 0.0 { low = at } else { high = at }
        }
        let step = 0.05f64.min(0.5 * at.0);
        let slope = (at.1 - off(at.0 - step)) / step;
        if slope.is_nan() || slope * at.0 <= error {
            why[k] = Some("the coverage hardly depends on it");
            continue;
        }
        why[k] = match at.1 {
            off if off < -OFF * error => Some("slices cannot cover as much"),
            off if off > OFF * error => Some("slices cannot cover as little"),
            _ => None,
        };
        slices.projection[k] = own * at.0;
        known[k] = Some(Known { value: own * at.0, error: own * error / slope, why: why[k].map(String::from) });
    }
    // What is not determined keeps the ratio of the nearest step that is.
    let mut ratio = 1.0;
    for k in (0..=STEPS).rev() {
        match &known[k] {
            Some(found) if found.why.is_none() => ratio = found.value / meadow.projection[k],
            Some(_) => {}
            None => {
                slices.projection[k] = meadow.projection[k] * ratio;
                let why = why[k].or(Some("all rays end on a blade")).map(String::from);
                known[k] = Some(Known { value: slices.projection[k], error: f64::INFINITY, why });
            }
        }
    }
    Ok(known.into_iter().flatten().collect())
}

/// Elevations and azimuths (degrees) with this |Ω_z|.
fn directions(vertical: f64) -> Vec<[f64; 2]> {
    let azimuth = |k: usize| 90.0 * k as f64 + 90.0 * (k as f64 + 0.5) / AZIMUTHS as f64;
    (0..AZIMUTHS).map(|k| [vertical.asin().to_degrees(), azimuth(k)]).collect()
}
