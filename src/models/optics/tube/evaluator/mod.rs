//! The tube integral for all frames of a pass at once, vectorised over frames. It has the formulas and node sets of
//! [`super::arc`], but no trigonometry. [`super::TubeModel`] is the reference that it is tested against. In frames that
//! the texel's horizon cuts, every node across the radius gets its own ends. A Cook–Torrance lobe whose normal leans
//! along the tube is left to the reference: its G has up to four kinks, whose places are roots of a quartic.

mod arc;
mod horizon;
mod light;
mod response;
mod rules;

use super::{Travel, TubeModel};
use crate::gloss::{Lobe, dot};
use light::light;
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::padded;
use mesophyll_base::processor::InstructionSet;
use mesophyll_base::quadrature::symmetric;
use response::respond;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many columns a pass has for one normal and slope of a texel: D, S, ∂S/∂m, then ∂D and ∂S along one or two
/// changes of the normal. Columns are padded with zeros to whole vectors.
pub const COLUMNS: usize = 7;

/// The tube's positions as seen from one texel; each list has one value a frame, and padding.
#[derive(Debug, Clone, Default)]
pub struct TubeGeometry {
    /// The pass that filled it, and the texel (mm).
    pass: u64,
    texel: [f64; 2],
    /// sin θ, cos θ; tangents, sines and cosines of the ends; asin(radius/distance); height/distance · (β/sin β).
    sin: Vec<f64>,
    cos: Vec<f64>,
    ends: [Vec<f64>; 2],
    end_sin: [Vec<f64>; 2],
    end_cos: [Vec<f64>; 2],
    beta: Vec<f64>,
    scale: Vec<f64>,
    /// D = n · (along · sin θ, skew, along · cos θ).
    along: Vec<f64>,
    skew: Vec<f64>,
}

/// Number of the next pass; 0 is that of no pass.
static PASSES: AtomicU64 = AtomicU64::new(1);

/// A pass of a device, ready for many texels.
#[derive(Debug, Clone)]
pub struct PassEvaluator {
    /// Tells passes apart that share a [`TubeGeometry`].
    id: u64,
    model: TubeModel,
    travel: Travel,
    positions: Vec<f64>,
    level: InstructionSet,
    /// Nodes across the radius, by count.
    across: Vec<Vec<(f64, f64)>>,
    nodes: Nodes,
}

/// Node tables. Bell nodes are whole numbers; Gauss nodes lie in [−1, 1].
#[derive(Debug, Clone)]
struct Nodes {
    bell: Vec<(f64, f64)>,
    half_bell: Vec<(f64, f64)>,
    /// Gauss–Legendre rules on [−1, 1] and on [0, 1], by order.
    gauss: Vec<Vec<(f64, f64)>>,
    half_gauss: Vec<Vec<(f64, f64)>>,
    along: f64,
    step: f64,
    reach: f64,
}

/// The normal, its changes and the slope, in the frame of the pass.
#[derive(Debug, Clone, Copy)]
struct Point {
    n: [f64; 3],
    change: [[f64; 3]; 2],
    changes: usize,
    c: [f64; 3],
    b: f64,
    m: f64,
}

/// The rule of order `n` on [0, 1], with weights for half of that stretch.
fn halved(n: usize) -> Vec<(f64, f64)> {
    symmetric(n.max(1)).into_iter().map(|(x, w)| (0.5 * (1.0 + x), w)).collect()
}

impl Nodes {
    /// Nodes for a stretch of `widths` widths of e^(−x²). 3 + 1.6 · widths nodes give 2e-6 of a bell; three more serve
    /// what is not a bell.
    #[inline(always)]
    pub fn over(&self, widths: f64) -> &[(f64, f64)] {
        let n = ((5.0 + 1.6 * widths) * self.along / 8.0 + 1.5) as usize;
        &self.gauss[n.clamp(2, self.gauss.len() - 1)]
    }
    /// The same where the bell's top is at the stretch's lower end.
    #[inline(always)]
    pub(crate) fn over_half(&self, widths: f64) -> &[(f64, f64)] {
        let n = ((3.5 + 1.5 * widths) * self.along / 8.0 + 1.5) as usize;
        &self.half_gauss[n.clamp(2, self.half_gauss.len() - 1)]
    }
}

impl PassEvaluator {
    /// A pass of `model` with the tube at these positions (mm). `along` is the number of nodes along the tube, and
    /// `level` the largest instruction set that may be used.
    pub fn new(
        model: &TubeModel,
        travel: Travel,
        positions_mm: &[f64],
        along: usize,
        level: InstructionSet,
    ) -> PassEvaluator {
        let rule = super::arc::ArcRule::new(along);
        let full = |k: i32| (f64::from(k), 1.0);
        let half = |k: i32| (f64::from(k), if k == 0 { 1.0 } else { 2.0 });
        let radius = model.tube.radius_mm;
        PassEvaluator {
            id: PASSES.fetch_add(1, Ordering::Relaxed),
            model: model.clone(),
            travel,
            positions: positions_mm.to_vec(),
            level,
            across: (0..=8).map(|k| if radius > 0.0 { symmetric(k.max(1)) } else { symmetric(1) }).collect(),
            nodes: Nodes {
                bell: (-rule.bell..=rule.bell).map(full).collect(),
                half_bell: (0..=rule.bell).map(half).collect(),
                gauss: (0..=2 * along.max(1)).map(|n| symmetric(n.max(1))).collect(),
                half_gauss: (0..=along.max(1)).map(halved).collect(),
                along: along.max(1) as f64,
                step: rule.step,
                reach: rule.step * f64::from(rule.bell + 1),
            },
        }
    }

    /// How many frames the pass has.
    pub fn frames(&self) -> usize {
        self.positions.len()
    }

    /// Length of the columns.
    pub fn padded(&self) -> usize {
        padded(self.positions.len())
    }

    /// Where the tube stands in each frame (mm).
    pub fn positions(&self) -> &[f64] {
        &self.positions
    }

    /// Fills `lit` with the tube's positions as seen from `texel_mm`.
    pub fn light(&self, texel_mm: [f64; 2], lit: &mut TubeGeometry) {
        let n = self.padded();
        if (lit.pass, lit.texel) == (self.id, texel_mm) {
            return;
        }
        (lit.pass, lit.texel) = (self.id, texel_mm);
        for list in [&mut lit.sin, &mut lit.cos, &mut lit.beta, &mut lit.scale, &mut lit.along, &mut lit.skew] {
            list.resize(n, 0.0);
        }
        for list in lit.ends.iter_mut().chain(&mut lit.end_sin).chain(&mut lit.end_cos) {
            list.resize(n, 0.0);
        }
        let pass = self;
        dispatch_lanes!(self.level, F64, light(pass: &PassEvaluator, texel_mm: [f64; 2], lit: &mut TubeGeometry));
    }

    /// Nodes across the radius for slope `m`. The mean of a bell of width σ over ±β needs few nodes where β/σ is small.
    fn across(&self, m: f64) -> &[(f64, f64)] {
        let camera = self.travel.local(self.model.camera);
        // A lobe's width across the tube is about √2 m; the tube looks widest where it is nearest.
        let near = if self.travel == Travel::X { camera[2].max(0.3) } else { 1.0 };
        // A lobe with a long tail has a sharper top.
        let sharp = if self.model.lobe.is_long_tailed() { 2.0 } else { 1.2 };
        let x = sharp * near * self.model.tube.radius_mm / self.model.tube.height_mm / (std::f64::consts::SQRT_2 * m);
        let count = match x {
            x if x < 1e-4 => 1,
            x if x < 0.15 => 2,
            x if x < 0.47 => 3,
            x if x < 0.85 => 4,
            x if x < 1.3 => 5,
            x if x < 1.8 => 6,
            _ => 8,
        };
        &self.across[count]
    }

    /// Fills `columns` (each at least [`PassEvaluator::padded`] long) for a unit normal `n`, its changes (none to two)
    /// and slope `m`.
    pub fn respond(
        &self,
        lit: &mut TubeGeometry,
        n: [f64; 3],
        changes: &[[f64; 3]],
        m: f64,
        columns: &mut [&mut [f64]; COLUMNS],
    ) {
        let local = |v: &[f64; 3]| self.travel.local(*v);
        let point = Point {
            n: local(&n),
            change: std::array::from_fn(|k| changes.get(k).map_or([0.0; 3], local)),
            changes: changes.len().min(2),
            c: local(&self.model.camera),
            b: dot(n, self.model.camera),
            m,
        };
        if point.b <= 0.0 {
            for column in columns.iter_mut() {
                column[..self.padded()].fill(0.0);
            }
            return;
        }
        let symmetric = point.n[1] == 0.0 && point.c[1] == 0.0 && point.change.iter().all(|v| v[1] == 0.0);
        // The vector code has the kernels of these lobes only.
        let known = matches!(self.model.lobe, Lobe::Beckmann | Lobe::Ggx | Lobe::CookTorrance { .. });
        if known && (symmetric || self.model.lobe.index().is_none()) {
            let (pass, point, across) = (self, &point, self.across(m));
            dispatch_lanes!(
                self.level, F64,
                respond(
                    pass: &PassEvaluator,
                    lit: &TubeGeometry,
                    point: &Point,
                    across: &[(f64, f64)],
                    symmetric: bool,
                    columns: &mut [&mut [f64]; COLUMNS]
                )
            );
        } else {
            // The number of nodes across the radius depends on the lobe's width.
            let across = self.across(m);
            let more = across.len() > self.model.across.len();
            let model = TubeModel {
                across: if more { across.to_vec() } else { self.model.across.clone() },
                ..self.model.clone()
            };
            for (k, &light) in self.positions.iter().enumerate() {
                let r = model.response(self.travel, light, lit.texel, n, m);
                (columns[0][k], columns[1][k], columns[2][k]) = (r.d, r.s, r.s_m);
                for (j, change) in changes.iter().enumerate().take(2) {
                    (columns[3 + 2 * j][k], columns[4 + 2 * j][k]) = (dot(r.d_n, *change), dot(r.s_n, *change));
                }
            }
        }
        for column in columns.iter_mut() {
            column[self.positions.len()..self.padded()].fill(0.0);
        }
    }
}
