//! Newton's method in (L, M) = (ln(σs/σa), ln Δ) on F₁ = ln(ρd/α) and F₂ = ln(−ln ρt), from a tabulated start.

use super::InversionPrecision;
use super::model::SlabModel;
use mesophyll_base::solvers::Termination;
use mesophyll_base::solvers::damping::{self, DampedProblem, DampingControl, newton_step};

/// A slab: ω, 1−ω and Δ, and ∂(F₁, F₂)/∂(L, M) there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabPoint {
    /// Single-scattering albedo ω = σs/(σa + σs).
    pub omega: f64,
    /// 1 − ω, with its own digits.
    pub absorbed: f64,
    /// Optical thickness Δ = (σa + σs) h.
    pub delta: f64,
    pub(super) jacobian: [[f64; 2]; 2],
}

/// Grid of the start: F₁ and F₂ from LOW in steps of STEP.
const LOW: [f64; 2] = [-13.0, -14.0];
const STEP: [f64; 2] = [0.5, 0.3];
const COUNT: [usize; 2] = [57, 63];

impl SlabPoint {
    /// ∂(ln σa, ln σs)/∂(ρd, ρt).
    pub fn log_sigma_by_measured(&self, model: &SlabModel, r: f64, t: f64) -> [[f64; 2]; 2] {
        let lost = 1.0 - r - t;
        let (floor, slope) = model.mirror.reflectance(t);
        let above = r - floor;
        let depth = model.log_clear - t.ln();
        let f = [[1.0 / above + 1.0 / lost, 1.0 / lost - slope / above], [0.0, -1.0 / (t * depth)]];
        let j = self.jacobian;
        let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        let inverse = [[j[1][1] / det, -j[0][1] / det], [-j[1][0] / det, j[0][0] / det]];
        let mut out = [[0.0; 2]; 2];
        for k in 0..2 {
            let l = inverse[0][0] * f[0][k] + inverse[0][1] * f[1][k];
            let m = inverse[1][0] * f[0][k] + inverse[1][1] * f[1][k];
            out[0][k] = m - self.omega * l;
            out[1][k] = m + self.absorbed * l;
        }
        out
    }
}

/// The slab whose reflectance is `above` what its faces reflect at this transmittance `t`, and `lost` = 1 − r − t, all
/// > 0.
/// `None` only where the range of numbers is exhausted.
pub fn solve(model: &SlabModel, above: f64, t: f64, lost: f64, precision: InversionPrecision) -> Option<SlabPoint> {
    let target = [(above / lost).ln(), (model.log_clear - t.ln()).ln()];
    if !(target[0].is_finite() && target[1].is_finite()) {
        return None;
    }
    let start = start(model, above, t, lost, target);
    let point = iterate(model, start, target)?;
    match precision {
        InversionPrecision::Fast => Some(point),
        InversionPrecision::Exact => refine(model, point, target),
    }
}

/// The result of `steps` plain Newton steps from the tabulated start, as (1−ω, ω, Δ), without reflecting faces. It
/// serves the sweep over the number of steps.
pub fn after_steps(r: f64, t: f64, lost: f64, steps: usize) -> [f64; 3] {
    let model = SlabModel::matched();
    let target = [(r / lost).ln(), (-t.ln()).ln()];
    let [mut l, mut m] = start(model, r, t, lost, target);
    for _ in 0..steps {
        let (f, point) = model.at(l, m);
        let step = newton_step(&point.jacobian, [target[0] - f[0], target[1] - f[1]]);
        (l, m) = (l + step[0], m + step[1]);
    }
    [1.0 / (1.0 + l.exp()), 1.0 / (1.0 + (-l).exp()), m.exp()]
}

/// The conservative slab (ω = 1) with transmittance `t` between 0 and the clear slab's; the Jacobian is left singular.
pub fn conservative(model: &SlabModel, t: f64) -> Option<SlabPoint> {
    let clear = model.mirror.clear();
    let mut m = two_flux(1.0 - t / clear, t / clear, 1e-300)[1];
    for _ in 0..60 {
        let (value, slope) = model.conservative(m);
        let miss = ((clear - t) / t).ln() - value;
        let step = (miss / slope).clamp(-2.0, 2.0);
        if !step.is_finite() {
            return None;
        }
        m += step;
        if step.abs() < 1e-9 {
            return Some(SlabPoint { omega: 1.0, absorbed: 0.0, delta: m.exp(), jacobian: [[0.0; 2]; 2] });
        }
    }
    None
}

/// Takes Newton steps towards the target F; a step is halved where the residual does not fall.
fn iterate(model: &SlabModel, start: [f64; 2], target: [f64; 2]) -> Option<SlabPoint> {
    let mut search = Search { model, target, evaluations: 0 };
    let start = search.place(start);
    let (found, end) = damping::minimize(&mut search, start, &DampingControl::HALVED);
    end.converged().then_some(found.point)
}

/// Largest number of evaluations of the model. If the search has not ended by then, it only follows rounding.
const EVALUATIONS: usize = 60;

/// The target F, and how often the model was evaluated.
struct Search<'a> {
    model: &'a SlabModel,
    target: [f64; 2],
    evaluations: usize,
}

/// A slab at (L, M), the two residuals to the target, and the larger of them.
struct Place {
    at: [f64; 2],
    point: SlabPoint,
    left: [f64; 2],
    size: f64,
}

impl Search<'_> {
    #[inline]
    fn place(&mut self, at: [f64; 2]) -> Place {
        self.evaluations += 1;
        let (f, point) = self.model.at(at[0], at[1]);
        let left = [self.target[0] - f[0], self.target[1] - f[1]];
        Place { at, point, left, size: left[0].abs().max(left[1].abs()) }
    }
}

impl DampedProblem for Search<'_> {
    type Point = Place;
    type Step = [f64; 2];

    #[inline]
    fn step(&mut self, at: &Place, _: f64) -> Option<[f64; 2]> {
        let step = newton_step(&at.point.jacobian, at.left);
        longest(&step).is_finite().then_some(step)
    }

    #[inline]
    fn end(&mut self, at: &mut Place, step: &[f64; 2]) -> Option<Termination> {
        if longest(step) < 2e-5 {
            // the next error is about the square of this step
            at.point = moved(&at.point, *step);
            return Some(Termination::StepSmall);
        }
        (self.evaluations >= EVALUATIONS).then_some(Termination::IterationLimit)
    }

    #[inline]
    fn take(&mut self, place: &Place, step: &[f64; 2], share: f64) -> Place {
        let (at, share) = (place.at, share * limit(step));
        self.place([at[0] + share * step[0], at[1] + share * step[1]])
    }

    #[inline]
    fn better(&self, at: &Place, trial: &Place) -> bool {
        trial.size < at.size
    }

    fn stalled(&self, at: &Place, step: &[f64; 2], share: f64) -> Option<Termination> {
        if at.size < 1e-9 {
            // rounding is reached
            return Some(Termination::CostConverged);
        }
        let short = 0.5 * share * limit(step) * longest(step) < 1e-14;
        (short || self.evaluations >= EVALUATIONS).then_some(Termination::NoProgress)
    }
}

#[inline]
fn longest(step: &[f64; 2]) -> f64 {
    step[0].abs().max(step[1].abs())
}

/// Limits a step to a length of 2.
#[inline]
fn limit(step: &[f64; 2]) -> f64 {
    (2.0 / longest(step)).min(1.0)
}

/// The point after a small step in (L, M), to second order.
#[inline]
fn moved(p: &SlabPoint, step: [f64; 2]) -> SlabPoint {
    let (l, m) = (step[0], step[1]);
    let up = |rate: f64, second: f64| 1.0 + rate * l + 0.5 * second * l * l;
    let swing = p.absorbed - p.omega;
    SlabPoint {
        omega: p.omega * up(p.absorbed, p.absorbed * swing),
        absorbed: p.absorbed * up(-p.omega, -p.omega * swing),
        delta: p.delta * (1.0 + m + 0.5 * m * m),
        jacobian: p.jacobian,
    }
}

/// Corrects a converged point by the exact model's residual with the fast model's Jacobian.
fn refine(model: &SlabModel, mut point: SlabPoint, target: [f64; 2]) -> Option<SlabPoint> {
    for _ in 0..4 {
        let f = model.exact(point.omega, point.absorbed, point.delta);
        let d = [target[0] - f[0], target[1] - f[1]];
        let step = newton_step(&point.jacobian, d);
        let long = longest(&step);
        if !long.is_finite() {
            return None;
        }
        point = moved(&point, step);
        if long < 1e-6 {
            return Some(point);
        }
    }
    Some(point)
}

/// Two-flux (Kubelka & Munk 1931) start, ln(S/K) and ln((K + 2S) h).
#[inline]
fn two_flux(r: f64, t: f64, lost: f64) -> [f64; 2] {
    let ratio = lost * (1.0 - r + t) / (2.0 * r); // K/S
    let b = (ratio * (ratio + 2.0)).sqrt();
    let s = if b > 1e-4 {
        // asinh(b/t) − asinh(b), where b/t may be past squaring
        let z = b / t;
        let rise = if z < 1e8 { (z + (z * z + 1.0).sqrt()).ln() } else { (2.0 * b).ln() - t.ln() };
        (rise - (b + (ratio + 1.0)).ln()) / b
    } else {
        (1.0 - t) / t
    };
    [-ratio.ln(), ((ratio + 2.0) * s.max(1e-300)).ln()]
}

/// The start: the two-flux estimate, corrected by a bicubic table of its errors.
#[inline]
fn start(model: &SlabModel, r: f64, t: f64, lost: f64, f: [f64; 2]) -> [f64; 2] {
    let grid = model.starts.get_or_init(|| corrections(model));
    let base = if model.mirror.is_none() { two_flux(r, t, lost) } else { two_flux_at(f) };
    let mut cell = [0usize; 2];
    let mut weight = [[0.0; 4]; 2];
    for d in 0..2 {
        let x = ((f[d] - LOW[d]) / STEP[d]).clamp(1.0, (COUNT[d] - 2) as f64 - 1e-9);
        cell[d] = x as usize - 1;
        let u = x - x.floor();
        weight[d] = [
            -u * (u - 1.0) * (u - 2.0) / 6.0,
            (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
            -(u + 1.0) * u * (u - 2.0) / 2.0,
            (u + 1.0) * u * (u - 1.0) / 6.0,
        ];
    }
    let mut out = base;
    for i in 0..4 {
        let line = &grid[(cell[0] + i) * COUNT[1] + cell[1]..][..4];
        for j in 0..4 {
            let w = weight[0][i] * weight[1][j];
            out[0] += w * line[j][0];
            out[1] += w * line[j][1];
        }
    }
    out
}

/// The two-flux estimate at F.
fn two_flux_at(f: [f64; 2]) -> [f64; 2] {
    let depth = f[1].exp();
    let lost = -(-depth).exp_m1() / (1.0 + f[0].exp());
    two_flux(lost * f[0].exp(), (-depth).exp(), lost)
}

/// The errors of the two-flux estimate over the grid. Each point starts from its neighbour's correction.
fn corrections(model: &SlabModel) -> Vec<[f64; 2]> {
    let mut grid: Vec<[f64; 2]> = Vec::with_capacity(COUNT[0] * COUNT[1]);
    for i in 0..COUNT[0] {
        for j in 0..COUNT[1] {
            let f = [LOW[0] + STEP[0] * i as f64, LOW[1] + STEP[1] * j as f64];
            let base = two_flux_at(f);
            let near = if j > 0 {
                grid[i * COUNT[1] + j - 1]
            } else if i > 0 {
                grid[(i - 1) * COUNT[1]]
            } else {
                [0.0, 0.0]
            };
            let start = [base[0] + near[0], base[1] + near[1]];
            let found = if model.is_quick(start[1]) { iterate(model, start, f) } else { None };
            grid.push(found.map_or(near, |p| [(p.omega / p.absorbed).ln() - base[0], p.delta.ln() - base[1]]));
        }
    }
    grid
}
