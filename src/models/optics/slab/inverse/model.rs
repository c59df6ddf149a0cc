//! The slab as the inversion sees it: F₁ and F₂ over L and M, for faces that reflect and for faces that do not.
//!
//! With reflecting faces, ρd is counted from what the faces reflect by themselves at the same ρt ([`FaceReflectance`]),
//! and −ln ρt from the clear slab's. In these numbers the map stays as close to linear as without reflection. Its table
//! is made when the index is first known, which takes a fraction of a second.

use super::newton::SlabPoint;
use crate::slab::faces::{FaceShares, SlabFaces};
use crate::slab::mirror::FaceReflectance;
use crate::slab::table::construction::Source;
use crate::slab::table::{SlabTable, TablePoint};
use crate::slab::{SlabResponse, medium, reduced};
use std::sync::OnceLock;

/// Range of Δ of a table for one index, and about its largest error.
const TABLE: [f64; 2] = [1e-6, 3e4];
const TOLERANCE: f64 = 1e-8;
/// Check points in each direction of a patch of such a table.
const CHECKS: usize = 5;
/// Relative error of the forward models in what scattering adds to ρd and in ln(clear/ρt): the committed table, a table
/// for one index, and one for an index so close to 1 that nearly grazing light decides where total reflection begins.
const COMMITTED_ERROR: f64 = 4e-9;
const FACES_ERROR: f64 = 4e-8;
const NEAR_ONE_ERROR: f64 = 3e-6;
/// Indices closer to 1 than this are near 1.
const NEAR_ONE: f64 = 2e-3;

/// A slab's faces, its table, and the starts of Newton's method.
pub struct SlabModel {
    /// Refractive index, in units of the surroundings'.
    pub index: f64,
    /// What the faces reflect.
    pub mirror: FaceReflectance,
    pub(super) log_clear: f64,
    pub(super) error: f64,
    kind: Kind,
    pub(super) starts: OnceLock<Vec<[f64; 2]>>,
}

enum Kind {
    Matched,
    Faces(Box<(SlabFaces, SlabTable)>),
}

impl SlabModel {
    /// The slab of the index of its surroundings.
    pub fn matched() -> &'static SlabModel {
        static MATCHED: OnceLock<SlabModel> = OnceLock::new();
        MATCHED.get_or_init(|| SlabModel::new(1.0, COMMITTED_ERROR, Kind::Matched))
    }

    /// A slab of `index` ≥ 1 in air.
    pub fn of_index(index: f64) -> SlabModel {
        if index == 1.0 {
            return SlabModel::new(1.0, COMMITTED_ERROR, Kind::Matched);
        }
        let (mirror, faces) = (FaceReflectance::of_index(index), SlabFaces::new(index, 1.0));
        // Without thickness the slab's pole is where light that total reflection keeps inside feeds itself: ω √(1−1/n²)
        // = 1.
        let kept = (1.0 - 1.0 / (index * index)).sqrt();
        let extrapolated = (std::f64::consts::PI.powi(2) / 3.0 * kept / (1.0 - kept)).sqrt().max(1.42);
        let scaled = |omega: f64, absorbed: f64, delta: f64| {
            let [above, _, depth] = parts(&mirror, &faces.shares(omega, absorbed, delta));
            [above * (1.0 + delta) / (omega * delta), depth / delta]
        };
        let table = SlabTable::of(&Source {
            delta: TABLE,
            extrapolated,
            tolerance: TOLERANCE,
            checks: CHECKS,
            scaled: &scaled,
        });
        let error = if index - 1.0 < NEAR_ONE { NEAR_ONE_ERROR } else { FACES_ERROR };
        SlabModel::new(index, error, Kind::Faces(Box::new((faces, table))))
    }

    fn new(index: f64, error: f64, kind: Kind) -> SlabModel {
        let mirror = FaceReflectance::of_index(index);
        SlabModel { index, mirror, log_clear: mirror.clear().ln(), error, kind, starts: OnceLock::new() }
    }

    /// R (with what the faces reflect) and T at albedo ω and optical thickness Δ ≥ 0; 1 − ω is passed separately.
    pub fn response(&self, omega: f64, absorbed: f64, delta: f64) -> SlabResponse {
        match &self.kind {
            Kind::Matched => reduced(omega, absorbed, delta).0,
            Kind::Faces(both) => {
                let (faces, table) = &**both;
                if !(table.range[0]..=table.range[1]).contains(&delta) {
                    return faces.shares(omega, absorbed, delta).response();
                }
                let s = table.at(absorbed, delta);
                let rho_t = (self.log_clear - delta * s.g[1]).exp();
                let above = omega * delta / (1.0 + delta) * s.g[0];
                let mut at = SlabResponse { rho_d: self.mirror.reflectance(rho_t).0 + above, rho_t };
                if absorbed == 0.0 {
                    at.conserve();
                }
                at
            }
        }
    }

    /// ln(above/lost) and ln ln(clear/T), nine digits and more.
    pub(super) fn exact(&self, omega: f64, absorbed: f64, delta: f64) -> [f64; 2] {
        match &self.kind {
            Kind::Matched => {
                let (r, log_t) = medium::solve_log(1.0, omega, absorbed, delta);
                let lost = -log_t.exp_m1() - r;
                [(r / lost).ln(), (-log_t).ln()]
            }
            Kind::Faces(both) => {
                let [above, lost, depth] = parts(&self.mirror, &both.0.shares(omega, absorbed, delta));
                [(above / lost).ln(), depth.ln()]
            }
        }
    }

    /// Whether F costs little at M = ln Δ: from a table or a series.
    pub(super) fn is_quick(&self, m: f64) -> bool {
        match &self.kind {
            Kind::Matched => true,
            Kind::Faces(both) => (both.1.range[0].ln()..=both.1.range[1].ln()).contains(&m),
        }
    }

    /// F and its Jacobian from the fast model at L = ln(σs/σa) and M = ln Δ.
    #[inline]
    pub(super) fn at(&self, l: f64, m: f64) -> ([f64; 2], SlabPoint) {
        let (omega, absorbed) = albedo(l);
        let delta = m.exp();
        let table = match &self.kind {
            Kind::Matched => SlabTable::committed(),
            Kind::Faces(both) => &both.1,
        };
        if (table.range[0]..=table.range[1]).contains(&delta) {
            let (r, depth, r_by, depth_by) = fluxes(&table.at_log(absorbed, delta, m), omega, absorbed, delta);
            let (missing, fall) = self.mirror.absorbed(depth);
            let clear = self.mirror.clear();
            let t = clear * (1.0 - -(-depth).exp_m1());
            let lost_by =
                |t: f64, depth_by: [f64; 2], r_by: [f64; 2]| [t * depth_by[0] - r_by[0], t * depth_by[1] - r_by[1]];
            let mut lost = missing - r;
            let mut change = lost_by(fall * t, depth_by, r_by);
            if absorbed < NEARLY_CONSERVATIVE {
                // At ω = 1 the table itself loses some of the light, which would hide a smaller true loss.
                let (r0, depth0, r0_by, depth0_by) = fluxes(&table.at_log(0.0, delta, m), 1.0, 0.0, delta);
                let t0 = clear * (-depth0).exp();
                let (missing0, fall0) = self.mirror.absorbed(depth0);
                lost -= missing0 - r0;
                change[1] -= lost_by(fall0 * t0, depth0_by, r0_by)[1];
            }
            let f1 = |k: usize| r_by[k] / r - change[k] / lost;
            let jacobian = [[f1(0), f1(1)], [depth_by[0] / depth, depth_by[1] / depth]];
            return ([(r / lost).ln(), depth.ln()], SlabPoint { omega, absorbed, delta, jacobian });
        }
        match &self.kind {
            Kind::Matched => {
                let (at, [by_a, by_d]) = reduced(omega, absorbed, delta);
                let (r, t) = (at.rho_d, at.rho_t.max(1e-300));
                let lost = 1.0 - r - t;
                let turn = -omega * absorbed;
                let (r_by, t_by) = ([by_a.rho_d * turn, by_d.rho_d * delta], [by_a.rho_t * turn, by_d.rho_t * delta]);
                let f1 = |k: usize| r_by[k] / r + (t_by[k] + r_by[k]) / lost;
                let jacobian = [[f1(0), f1(1)], [t_by[0] / (t * t.ln()), t_by[1] / (t * t.ln())]];
                ([(r / lost).ln(), (-t.ln()).ln()], SlabPoint { omega, absorbed, delta, jacobian })
            }
            Kind::Faces(_) => {
                let f = |l: f64, m: f64| {
                    let (omega, absorbed) = albedo(l);
                    self.exact(omega, absorbed, m.exp())
                };
                let by = |high: [f64; 2], low: [f64; 2]| [0, 1].map(|k| (high[k] - low[k]) / (2.0 * STEP));
                let (by_l, by_m) = (by(f(l + STEP, m), f(l - STEP, m)), by(f(l, m + STEP), f(l, m - STEP)));
                let jacobian = [[by_l[0], by_m[0]], [by_l[1], by_m[1]]];
                (f(l, m), SlabPoint { omega, absorbed, delta, jacobian })
            }
        }
    }

    /// ln((clear − T)/T) of the slab with ω = 1, and its derivative by ln Δ. It runs from −∞ to ∞.
    pub(super) fn conservative(&self, m: f64) -> (f64, f64) {
        let delta = m.exp();
        match &self.kind {
            Kind::Matched => {
                let (at, [_, by_delta]) = reduced(1.0, 0.0, delta);
                let slope = (by_delta.rho_d / at.rho_d - by_delta.rho_t / at.rho_t) * delta;
                ((at.rho_d / at.rho_t).ln(), slope)
            }
            Kind::Faces(both) => {
                let table = &both.1;
                if (table.range[0]..=table.range[1]).contains(&delta) {
                    let (_, depth, _, depth_by) = fluxes(&table.at_log(0.0, delta, m), 1.0, 0.0, delta);
                    let beyond = depth.exp_m1();
                    return (beyond.ln(), (beyond + 1.0) * depth_by[1] / beyond);
                }
                let value = |m: f64| {
                    let [_, _, depth] = parts(&self.mirror, &both.0.shares(1.0, 0.0, m.exp()));
                    depth.exp_m1().ln()
                };
                (value(m), (value(m + STEP) - value(m - STEP)) / (2.0 * STEP))
            }
        }
    }
}

/// Step of central differences in L and M.
const STEP: f64 = 1e-4;
/// Where 1−ω is below this, the table's own loss is subtracted.
const NEARLY_CONSERVATIVE: f64 = 1e-3;

/// ω and 1−ω at L.
#[inline]
fn albedo(l: f64) -> (f64, f64) {
    let e = (-l.abs()).exp();
    let (small, large) = (e / (1.0 + e), 1.0 / (1.0 + e));
    if l > 0.0 { (large, small) } else { (small, large) }
}

/// What scattering adds to the reflectance of the faces, what is absorbed, and ln(clear/T).
fn parts(mirror: &FaceReflectance, shares: &FaceShares) -> [f64; 3] {
    let above = mirror.excess(shares.scattered_back, shares.scattered_on, shares.passed);
    let depth = mirror.clear().ln() - shares.log_t;
    let depth = if depth < 0.1 { mirror.depth(above + shares.lost) } else { depth };
    [above, shares.lost, depth]
}

/// ρd, −ln ρt and their derivatives by L and M.
#[inline]
fn fluxes(s: &TablePoint, omega: f64, absorbed: f64, delta: f64) -> (f64, f64, [f64; 2], [f64; 2]) {
    let h = delta / (1.0 + delta);
    // by L: d(1−ω) = −ω(1−ω) dL; by M: dΔ = Δ dM
    let turn = -omega * absorbed;
    let r_by = [
        h * omega * (absorbed * s.g[0] + s.by_absorbed[0] * turn),
        omega * h * (s.g[0] / (1.0 + delta) + delta * s.by_delta[0]),
    ];
    let depth_by = [delta * s.by_absorbed[1] * turn, delta * (s.g[1] + delta * s.by_delta[1])];
    (omega * h * s.g[0], delta * s.g[1], r_by, depth_by)
}
