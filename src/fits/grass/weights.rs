//! Fits the weights: which optical depth slices should have in each direction, so that they cover as much as the blades
//! do.
//!
//! For blades that stand at random in slabs without thickness, the projection of the blades
//! ([`crate::grass::blades::LawnMeadow::projection`]) gives the answer. But real blades stand in tufts, and a small
//! number of slices means slabs that are thick compared with the height. So the projection that the weights are
//! computed from is fitted: one number at each of [`STEPS`] + 1 steps of |Ω_z|. The rays of the fit have other azimuths
//! than those of [`crate::grass::judge`].

use crate::grass::Result;
use crate::grass::blades::{LawnMeadow, STEPS};
use crate::grass::judge::{LawnRays, coverage_of_blades, coverage_of_slices, towards};
use crate::grass::march::LawnSlices;
use mesophyll_files::progress::{self, TaskProgress};
use serde::{Deserialize, Serialize};

/// The result at one step of |Ω_z|.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LawnProjection {
    /// The projection that the weights are computed from.
    pub value: f64,
    /// Its standard error, from the number of rays; infinite where the rays do not determine it.
    pub error: f64,
    /// The reason why the rays do not determine it, or why the slices cannot reach it.
    pub why: Option<String>,
}

/// Number of azimuths. The k-th lies in the k-th eighth of a quarter turn, and the four quarters are taken in turn.
const AZIMUTHS: usize = 8;
/// Above this coverage, the coverage says little about the optical depth.
const COVERED: f64 = 0.985;
/// A blade that shows a smaller share of its area is seen along its plane, and rounding errors alone make the share.
const SHOWN: f64 = 1e-9;
/// The coverage at a fitted step may differ from the wanted one by this many standard errors.
const OFF: f64 = 3.0;

/// Fits the projection of `slices`, which before is that of the blades, to the blades. The rays have `entries` points
/// of entry along each side of the rectangle.
///
/// # Errors
/// [`crate::grass::Error::Interrupted`] after a stop.
pub fn fit(meadow: &LawnMeadow, slices: &mut LawnSlices, entries: usize) -> Result<Vec<LawnProjection>> {
    let rays = LawnRays { side: entries, level: 0.0, sunlit: false };
    let bar = TaskProgress::new("weights", STEPS as u64 + 1);
    let mut known: Vec<Option<LawnProjection>> = vec![None; STEPS + 1];
    let mut why = [None; STEPS + 1];
    // Step 0 is left out: rays along the ground never leave the layer.
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
        // Slices cannot give more than all that they show. They show least along the axes.
        let vertical = k as f64 / STEPS as f64;
        let most = slices.shown[0] * (1.0 - vertical * vertical).sqrt() + slices.shown[1] * vertical;
        let own = meadow.projection[k];
        if own < SHOWN || wanted <= 0.0 {
            why[k] = Some("no ray ends on a blade");
            continue;
        }
        let mut off = |times: f64| {
            // Projections are linear between two steps, but these directions lie exactly at a step.
            slices.projection[k] = own * times;
            mean(&|[e, a]| coverage_of_slices(slices, rays, towards(e, a))) - wanted
        };
        let most = most / own;
        // Points that are spread over a grid have a smaller error than this. Blades and slices use the same points.
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
        known[k] =
            Some(LawnProjection { value: own * at.0, error: own * error / slope, why: why[k].map(String::from) });
    }
    // A step that is not determined takes the ratio of the nearest higher step that is.
    let mut ratio = 1.0;
    for k in (0..=STEPS).rev() {
        match &known[k] {
            Some(found) if found.why.is_none() => ratio = found.value / meadow.projection[k],
            Some(_) => {}
            None => {
                slices.projection[k] = meadow.projection[k] * ratio;
                let why = why[k].or(Some("all rays end on a blade")).map(String::from);
                known[k] = Some(LawnProjection { value: slices.projection[k], error: f64::INFINITY, why });
            }
        }
    }
    Ok(known.into_iter().flatten().collect())
}

/// Elevations and azimuths, in degrees, of directions with this |Ω_z|.
fn directions(vertical: f64) -> Vec<[f64; 2]> {
    let azimuth = |k: usize| 90.0 * k as f64 + 90.0 * (k as f64 + 0.5) / AZIMUTHS as f64;
    (0..AZIMUTHS).map(|k| [vertical.asin().to_degrees(), azimuth(k)]).collect()
}
