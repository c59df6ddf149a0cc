//! Error against time of the two methods for the layers of a leaf, and rays a second and core.
//!
//! The leaves are the soybean leaf of Baranoski & Rokne (2001) at three absorptions, lit from both sides at three
//! angles; the reference is the exact method with more than twice the usual nodes.

use crate::bench::{BenchRow, median_us};
use crate::{Error, Result};
use mesophyll_optics::foliar::exact::{self, LeafOperator, Resolution};
use mesophyll_optics::foliar::{LayeredLeaf, LeafResponse, walk};
use mesophyll_optics::side::Side;
use std::time::Instant;

const DEPTHS: [f64; 3] = [0.05, 0.4, 2.0];
const INCIDENCE: [f64; 3] = [0.0, 0.8, 1.4];

/// Leaf, side, angle of incidence (radians) and the reference's answer.
type Case = (LayeredLeaf, Side, f64, LeafResponse);

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for depth in DEPTHS {
        let leaf = LayeredLeaf::soybean(depth);
        let prepared = LeafOperator::new(&leaf, Resolution { order: 44, piece: 30, azimuth: 40 });
        let solved = prepared.solve(depth);
        for side in [Side::Front, Side::Back] {
            cases.extend(INCIDENCE.map(|at| (leaf, side, at, solved.response(side, at))));
        }
    }
    cases
}

fn off(a: &LeafResponse, b: &LeafResponse) -> f64 {
    (a.reflectance - b.reflectance).abs().max((a.transmittance - b.transmittance).abs())
}

fn row(knob: &str, setting: String, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "abm".into(), knob: knob.into(), setting, error, us, note }
}

/// The rows.
///
/// # Errors
/// A pool of one thread that cannot be made.
pub fn rows() -> Result<Vec<BenchRow>> {
    let cases = cases();
    let mut rows = Vec::new();
    for (order, piece, azimuth) in [(6, 5, 8), (9, 7, 10), (12, 9, 12), (18, 13, 16), (26, 16, 20)] {
        let resolution = Resolution { order, piece, azimuth };
        let found =
            |&(leaf, side, at, _): &Case| LeafOperator::new(&leaf, resolution).solve(leaf.depth).response(side, at);
        let error = cases.iter().map(|c| off(&found(c), &c.3)).fold(0.0, f64::max);
        let us = median_us(60.0, || found(&cases[0]));
        let usual = if resolution == Resolution::USUAL { ", the usual one" } else { "" };
        let note = format!("R and T, absolute, worst of {}{usual}; time of one leaf and angle", cases.len());
        rows.push(row("nodes a panel, exact", order.to_string(), error, us, note));
    }
    let prepared = LeafOperator::new(&cases[0].0, Resolution::USUAL);
    let us = median_us(40.0, || prepared.solve(0.3).response(Side::Front, 0.3));
    rows.push(row(
        "one more absorption, exact",
        "18".into(),
        f64::NAN,
        us,
        "of a leaf whose lobes are prepared".into(),
    ));
    let us = median_us(60.0, || exact::derivatives(&cases[0].0, Side::Front, 0.3));
    rows.push(row("seven derivatives, exact", "18".into(), f64::NAN, us, "absorption, indices and oblateness".into()));

    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let alone = alone.map_err(|e| Error::Missed(format!("no pool of one thread: {e}")))?;
    for rays in [10_000u64, 100_000, 1_000_000] {
        let clock = Instant::now();
        let found: Vec<LeafResponse> = alone.install(|| {
            let one = |(leaf, side, at, _): &Case| {
                let counts = walk::count(leaf, *side, *at, rays, 1, &|| false);
                let share = |count: u64| counts.share(count).0;
                LeafResponse { reflectance: share(counts.reflected), transmittance: share(counts.transmitted) }
            };
            cases.iter().map(one).collect()
        });
        let us = clock.elapsed().as_secs_f64() * 1e6 / cases.len() as f64;
        let error = found.iter().zip(&cases).map(|(f, c)| off(f, &c.3)).fold(0.0, f64::max);
        let note =
            format!("R and T, absolute, worst of {}; on one core {:.1}e6 rays a second", cases.len(), rays as f64 / us);
        rows.push(row("rays", rays.to_string(), error, us, note));
    }
    for (name, depth) in [("soybean, green light", 0.4), ("soybean, clear", 0.0)] {
        let leaf = LayeredLeaf::soybean(depth);
        let rays = 1_000_000;
        let us = alone.install(|| median_us(600.0, || walk::count(&leaf, Side::Front, 0.0, rays, 1, &|| false)));
        let note = format!("adaxial, along the normal; on one core {:.1}e6 rays a second", rays as f64 / us);
        rows.push(row("rays a leaf", name.into(), f64::NAN, us, note));
    }
    Ok(rows)
}
