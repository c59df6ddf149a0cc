//! The angles at which the integral equation is solved.
//!
//! A smooth interface keeps s = n sin θ. So one set of values of s serves all media: each medium has those below its
//! own index, and reflected or refracted light goes from node to node. The refractive indices divide the axis of s into
//! panels, so total reflection begins exactly at a panel's end. In a panel below the index `hi`, all cosines are smooth
//! functions of c = √(hi² − s²), so the nodes are Gauss's nodes in c. Another index may lie so close above that the
//! cosine of its medium bends within the panel; then c = δ sinh t makes it smooth.

use crate::number::Real;
use mesophyll_base::quadrature;
use std::f64::consts::FRAC_PI_2;

/// A piece of the axis of s that ends at the index of a medium.
#[derive(Debug, Clone)]
struct Panel<N> {
    /// The index where it ends.
    hi: N,
    /// √(hi² − lo²): c at its lower end.
    c_end: N,
    /// √(m² − hi²) of the next index m above, where it is small.
    close: Option<N>,
    /// Whether `hi` is the index of a medium.
    of_medium: bool,
}

impl<N: Real> Panel<N> {
    /// c at t in [0, 1].
    fn c(&self, t: N) -> N {
        match self.close {
            None => self.c_end * t,
            Some(close) => close * ((self.c_end / close).asinh() * t).sinh(),
        }
    }

    /// t at c.
    fn t(&self, c: N) -> N {
        match self.close {
            None => c / self.c_end,
            Some(close) => (c / close).asinh() / (self.c_end / close).asinh(),
        }
    }
}

/// The nodes of all media.
#[derive(Debug, Clone)]
pub struct AngleGrid<N> {
    panels: Vec<Panel<N>>,
    /// t of the nodes, and the matrix that makes coefficients of Legendre polynomials of values at them.
    rule: Vec<(f64, f64)>,
}

/// Indices closer than this are taken for equal.
const SAME: f64 = 1e-12;
/// A panel that only bends within is not made narrower than this.
const NARROWEST: f64 = 1e-3;

impl<N: Real> AngleGrid<N> {
    /// For light between air and media of the indices `kept`. `others` are indices of further media whose cosines
    /// matter. `bends` are values of s at which functions are not smooth for another reason. Every panel has `order`
    /// nodes.
    pub fn new(kept: &[N], others: &[N], bends: &[N], order: usize) -> AngleGrid<N> {
        let mut levels: Vec<N> = vec![N::of(1.0)];
        let mut sorted = kept.to_vec();
        sorted.sort_by(|a, b| a.value().total_cmp(&b.value()));
        for n in sorted {
            if levels.last().is_none_or(|l| n.value() > l.value() + SAME) {
                levels.push(n);
            }
        }
        let mut ends: Vec<(N, bool)> = levels.iter().map(|&n| (n, true)).collect();
        for &s in bends {
            let far = |x: f64| (x - s.value()).abs() > NARROWEST;
            if far(0.0) && ends.iter().all(|e| far(e.0.value())) {
                ends.push((s, false));
            }
        }
        ends.sort_by(|a, b| a.0.value().total_cmp(&b.0.value()));
        let mut panels = Vec::new();
        let mut lo = N::of(0.0);
        for &(hi, of_medium) in &ends {
            let c_end = (hi * hi - lo * lo).sqrt();
            let above = levels.iter().chain(others).filter(|m| m.value() > hi.value() + SAME);
            let next = above.min_by(|a, b| a.value().total_cmp(&b.value()));
            let close = next.map(|&m| (m * m - hi * hi).sqrt()).filter(|d| d.value() < c_end.value());
            panels.push(Panel { hi, c_end, close, of_medium });
            lo = hi;
        }
        AngleGrid { panels, rule: quadrature::unit(order) }
    }

    /// The same with one node: that of light whose angle in air has the cosine `cos`. It serves a leaf without lobes,
    /// in which light keeps one angle in each medium.
    pub fn single(kept: &[N], cos: f64) -> AngleGrid<N> {
        let grid = AngleGrid::new(kept, &[], &[], 1);
        let panels = grid.panels.into_iter().map(|p| Panel { close: None, ..p }).collect();
        AngleGrid { panels, rule: vec![(cos, 1.0)] }
    }

    /// How many panels a medium of the index `n` has.
    fn panels_of(&self, n: N) -> usize {
        self.panels.iter().filter(|p| p.hi.value() <= n.value() + SAME).count()
    }

    /// How many nodes a medium of the index `n` has.
    pub fn len(&self, n: N) -> usize {
        self.panels_of(n) * self.rule.len()
    }

    /// Sine and cosine of node `k` in a medium of the index `n`.
    pub fn angle(&self, n: N, k: usize) -> (N, N) {
        let panel = &self.panels[k / self.rule.len()];
        let c = panel.c(N::of(self.rule[k % self.rule.len()].0));
        let square = (n * n - panel.hi * panel.hi) + c * c;
        ((panel.hi * panel.hi - c * c).sqrt() / n, square.sqrt() / n)
    }

    /// Angles in a medium of the index `n` at which functions on the grid are not smooth: the ends of panels, each with
    /// whether functions behave like a square root below it, and the places where functions bend.
    pub fn breaks(&self, n: N) -> Vec<(N, bool)> {
        let mut breaks = Vec::new();
        let inner = self.panels_of(n);
        for (k, panel) in self.panels.iter().take(inner).enumerate() {
            let sin = panel.hi / n;
            if k + 1 < inner {
                let cos = (n * n - panel.hi * panel.hi).sqrt() / n;
                breaks.push((sin.angle(cos), panel.of_medium));
            }
            if let Some(close) = panel.close {
                // The place where c is three times as long as the bend.
                let c = close.times(3.0);
                if c.value() < panel.c_end.value() {
                    let (s, cos) = ((panel.hi * panel.hi - c * c).sqrt(), (n * n - panel.hi * panel.hi + c * c).sqrt());
                    breaks.push((s.angle(cos), false));
                }
            }
        }
        breaks.push((N::of(FRAC_PI_2), false));
        breaks
    }

    /// Adds integration weights to `out`, one number a node. The values of a function at the nodes of a medium of the
    /// index `n`, times these weights, give Σ over `points` (sine, cosine, weight) of weight times function.
    ///
    /// Between nodes the function is the polynomial in t through the nodes of the panel. The sum uses Legendre
    /// polynomials: that needs one recurrence for each point instead of all pairs of nodes.
    pub fn integrate(&self, n: N, points: impl Iterator<Item = (N, N, N)>, out: &mut [N]) {
        let order = self.rule.len();
        let mut moments = vec![N::of(0.0); out.len()];
        let inner = self.panels_of(n);
        for (sin, cos, weight) in points {
            let s = (n * sin).value();
            let k = self.panels[..inner].iter().position(|p| s <= p.hi.value()).unwrap_or(inner - 1);
            let panel = &self.panels[k];
            let square = (panel.hi - n) * (panel.hi + n) + n * n * cos * cos;
            let c = if square.value() > 0.0 { square.sqrt() } else { N::of(0.0) };
            let x = panel.t(c).times(2.0) - N::of(1.0);
            let moments = &mut moments[k * order..(k + 1) * order];
            let (mut before, mut p) = (N::of(0.0), weight);
            for (m, moment) in moments.iter_mut().enumerate() {
                *moment = *moment + p;
                let m = m as f64;
                (before, p) = (p, (x * p).times((2.0 * m + 1.0) / (m + 1.0)) - before.times(m / (m + 1.0)));
            }
        }
        // The coefficient of P_m is (2m + 1) Σ w_j P_m(t_j) v_j, exactly, at Gauss's nodes.
        for (j, &(t, w)) in self.rule.iter().enumerate() {
            let x = 2.0 * t - 1.0;
            let (mut before, mut p) = (0.0, 1.0);
            for m in 0..order {
                let degree = m as f64;
                for k in 0..out.len() / order {
                    out[k * order + j] =
                        out[k * order + j] + moments[k * order + m].times((2.0 * degree + 1.0) * w * p);
                }
                (before, p) = (p, ((2.0 * degree + 1.0) * x * p - degree * before) / (degree + 1.0));
            }
        }
    }
}
