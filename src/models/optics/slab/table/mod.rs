//! The fast slab: piecewise polynomials fitted to [`super::medium`], read from a committed table of some tens of
//! kilobytes.
//!
//! The coordinates follow the scales of the physics, so that few patches are enough: q = ln Δ, and ξ = ln(1 + (1−ω)
//! D²/…) / ln(1 + D²/…) in [0, 1], where D = Δ + 1.42 is the slab with its two extrapolated distances. As functions of
//! ω, the slab's only singularities are poles on ω ≥ 1 + (π/D)²/3, and the logarithm moves them far away. The table
//! stores G₁ = ρd / (ω h(Δ)), h = Δ/(1+Δ), and G₂ = −ln ρt / Δ. Slabs thinner than the table's range use a series in Δ
//! ln Δ; thicker ones use the exact solution.

use super::SlabResponse;
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::Lanes;
use mesophyll_base::processor::InstructionSet;
use std::sync::OnceLock;

pub mod construction;

/// Number of polynomial coefficients in each direction.
pub(crate) const ORDER: usize = 10;
/// How many numbers there are for one power of ξ.
const WIDTH: usize = 2 * ORDER;
/// Range of optical thickness that the table covers.
pub(crate) const DELTA_MIN: f64 = 1e-6;
pub(crate) const DELTA_MAX: f64 = 274_877.906_944;
const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;

/// ln(1 + (1−ω) D² SHARPNESS): the nearest pole lies at (1−ω) D² = −π²/3.
const SHARPNESS: f64 = 3.0 / (std::f64::consts::PI * std::f64::consts::PI);
const EXTRAPOLATED: f64 = 1.42;

/// G₁ and G₂ at a point, with their derivatives by 1−ω and by Δ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TablePoint {
    /// G₁ and G₂.
    pub g: [f64; 2],
    /// Their derivatives by 1 − ω.
    pub by_absorbed: [f64; 2],
    /// Their derivatives by Δ.
    pub by_delta: [f64; 2],
}

/// Polynomials over one rectangle of (q, ξ).
struct Patch {
    centre: [f64; 2],
    /// 1 / half width
    inverse: [f64; 2],
    /// Powers of the local ξ change slowest, then those of the local q, then G₁ and G₂.
    coefficients: Vec<[f64; WIDTH]>,
}

/// Patches in rows of q, a row's patches ordered by ξ.
pub struct SlabTable {
    /// Δ from and to which the table reaches.
    pub range: [f64; 2],
    /// Twice the extrapolated distance in [`coordinate`].
    extrapolated: f64,
    rows: Vec<Row>,
    /// Lowest q, number of cells in a unit of q, and the row of each cell. Every row covers a whole number of cells.
    lowest: f64,
    density: f64,
    row_of_cell: Vec<u16>,
}

struct Row {
    /// upper edges in ξ
    tops: Vec<f64>,
    patches: Vec<Patch>,
}

/// The coordinate ξ and its derivatives by 1−ω and Δ.
#[inline]
fn coordinate(absorbed: f64, delta: f64, extrapolated: f64) -> (f64, f64, f64) {
    let d = delta + extrapolated;
    let c = SHARPNESS * d * d;
    let whole = (1.0 + c).ln();
    let small = c * absorbed;
    let part = if small > 1e-2 { (1.0 + small).ln() } else { small.ln_1p() };
    let xi = part / whole;
    let by_absorbed = c / ((1.0 + c * absorbed) * whole);
    let by_delta = (2.0 * c / d) * (absorbed / (1.0 + c * absorbed) - xi / (1.0 + c)) / whole;
    (xi, by_absorbed, by_delta)
}

/// 1−ω at a coordinate.
fn absorbed_at(xi: f64, delta: f64, extrapolated: f64) -> f64 {
    let d = delta + extrapolated;
    let c = SHARPNESS * d * d;
    ((xi * c.ln_1p()).exp_m1() / c).min(1.0)
}

impl SlabTable {
    /// The committed table.
    pub fn committed() -> &'static SlabTable {
        static TABLE: OnceLock<SlabTable> = OnceLock::new();
        TABLE.get_or_init(|| {
            SlabTable::read(
                include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/slab/response.bin")),
                [DELTA_MIN, DELTA_MAX],
                EXTRAPOLATED,
            )
        })
    }

    /// G₁, G₂ and derivatives for DELTA_MIN ≤ Δ ≤ DELTA_MAX, 0 ≤ 1−ω ≤ 1.
    #[inline]
    pub fn at(&self, absorbed: f64, delta: f64) -> TablePoint {
        self.at_log(absorbed, delta, delta.ln())
    }

    /// [`SlabTable::at`] where q = ln Δ is known.
    #[inline]
    pub(crate) fn at_log(&self, absorbed: f64, delta: f64, q: f64) -> TablePoint {
        let (xi, xi_a, xi_d) = coordinate(absorbed, delta, self.extrapolated);
        let cell = ((q - self.lowest) * self.density) as usize;
        let row = &self.rows[usize::from(self.row_of_cell[cell.min(self.row_of_cell.len() - 1)])];
        let patch = &row.patches[row.tops.iter().take_while(|&&t| xi > t).count().min(row.patches.len() - 1)];
        let x = (xi - patch.centre[1]) * patch.inverse[1];
        let y = (q - patch.centre[0]) * patch.inverse[0];
        let (g, gx, gy) = patch.evaluate(x, y);
        let (sx, sy) = (patch.inverse[1], patch.inverse[0] / delta);
        TablePoint {
            g,
            by_absorbed: [gx[0] * sx * xi_a, gx[1] * sx * xi_a],
            by_delta: [gx[0] * sx * xi_d + gy[0] * sy, gx[1] * sx * xi_d + gy[1] * sy],
        }
    }

    /// A new table over Δ from `delta[0]` to `delta[1]` whose largest error is about `tolerance`. It serves the sweep
    /// over table sizes.
    pub fn made(delta: [f64; 2], tolerance: f64) -> SlabTable {
        SlabTable::of(&construction::Source {
            delta,
            extrapolated: EXTRAPOLATED,
            tolerance,
            checks: construction::CHECKS,
            scaled: &construction::matched,
        })
    }

    /// A table of any G₁ and G₂.
    pub(crate) fn of(source: &construction::Source) -> SlabTable {
        SlabTable::read(&construction::bytes_of(source, |_| {}), source.delta, source.extrapolated)
    }

    /// ρd and ρt within the table's range of Δ.
    pub fn response(&self, omega: f64, absorbed: f64, delta: f64) -> SlabResponse {
        let s = self.at(absorbed, delta);
        SlabResponse { rho_d: omega * delta / (1.0 + delta) * s.g[0], rho_t: (-delta * s.g[1]).exp() }
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        let patches: usize = self.rows.iter().map(|r| r.patches.len()).sum();
        8 * (1 + 3 * self.rows.len() + patches * (1 + ORDER * WIDTH))
    }

    /// Reads a table written by [`construction::bytes`].
    fn read(bytes: &[u8], range: [f64; 2], extrapolated: f64) -> SlabTable {
        let mut numbers =
            bytes.chunks_exact(8).map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]));
        let mut next = || numbers.next().unwrap_or(f64::NAN);
        let mut table =
            SlabTable { range, extrapolated, rows: Vec::new(), lowest: 0.0, density: 0.0, row_of_cell: Vec::new() };
        let mut spans = Vec::new();
        for _ in 0..next() as usize {
            let (low, high) = (next(), next());
            spans.push((low, high));
            let mut row = Row { tops: Vec::new(), patches: Vec::new() };
            let mut left = 0.0;
            for _ in 0..next() as usize {
                let right = next();
                let coefficients = (0..ORDER).map(|_| std::array::from_fn(|_| next())).collect();
                row.tops.push(right);
                row.patches.push(Patch::new([low, left], [high, right], coefficients));
                left = right;
            }
            table.rows.push(row);
        }
        table.lowest = spans.first().map_or(0.0, |s| s.0);
        let narrowest = spans.iter().map(|(low, high)| high - low).fold(f64::INFINITY, f64::min);
        table.density = 1.0 / narrowest;
        for (k, (low, high)) in spans.iter().enumerate() {
            let cells = ((high - low) / narrowest).round() as usize;
            table.row_of_cell.extend(std::iter::repeat_n(k as u16, cells));
        }
        table
    }
}

impl Patch {
    fn new(low: [f64; 2], high: [f64; 2], coefficients: Vec<[f64; WIDTH]>) -> Patch {
        let centre = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        Patch { centre, inverse: [2.0 / (high[0] - low[0]), 2.0 / (high[1] - low[1])], coefficients }
    }

    /// Value and derivatives by local ξ (x) and q (y).
    #[inline]
    fn evaluate(&self, x: f64, y: f64) -> Local {
        let patch = self;
        dispatch_lanes!(InstructionSet::detect(), F32, horner(patch: &Patch, x: f64, y: f64) -> Local)
    }
}

/// Horner's scheme in x over vectors of y powers, then in y. The compiler makes vectors of it.
#[inline(always)]
fn horner<L: Lanes>(patch: &Patch, x: f64, y: f64) -> Local {
    let fma = |a: f64, b: f64, c: f64| if L::FUSED { a.mul_add(b, c) } else { a * b + c };
    let mut value = [0.0; WIDTH];
    let mut slope = [0.0; WIDTH];
    for line in patch.coefficients.iter().rev() {
        for j in 0..WIDTH {
            slope[j] = fma(slope[j], x, value[j]);
            value[j] = fma(value[j], x, line[j]);
        }
    }
    let (mut g, mut gx, mut gy) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    for j in (0..ORDER).rev() {
        for s in 0..2 {
            gy[s] = fma(gy[s], y, g[s]);
            g[s] = fma(g[s], y, value[2 * j + s]);
            gx[s] = fma(gx[s], y, slope[2 * j + s]);
        }
    }
    (g, gx, gy)
}

/// G₁, G₂ and their derivatives by the local ξ and q.
type Local = ([f64; 2], [f64; 2], [f64; 2]);

/// For slabs thinner than the table's range: the first two terms in Δ and ln Δ (relative error below 3e-10), with
/// derivatives by 1−ω and Δ.
pub(crate) fn thin_series(omega: f64, absorbed: f64, delta: f64) -> (SlabResponse, [SlabResponse; 2]) {
    let log = if delta > 0.0 { delta.ln() } else { 0.0 };
    // ρ = (ω/2) ∫E₂(t)(1−t) dt + (ω/2)² ∫∫E₁(|t−s|) dt ds; to this order both sides give the same.
    let once = delta * (1.0 + 0.5 * delta * (log + EULER_GAMMA - 2.5));
    let once_by = 1.0 + delta * (log + EULER_GAMMA - 2.0);
    let twice = delta * delta * (1.5 - EULER_GAMMA - log);
    let twice_by = delta * (2.0 - 2.0 * EULER_GAMMA - 2.0 * log);
    let half = 0.5 * omega;
    let scattered = half * (once + half * twice);
    let by_omega = 0.5 * once + half * twice;
    let by_delta = half * (once_by + half * twice_by);
    let mut at = SlabResponse { rho_d: scattered, rho_t: (-delta).exp() + scattered };
    if absorbed == 0.0 {
        at.conserve();
    }
    (
        at,
        [
            SlabResponse { rho_d: -by_omega, rho_t: -by_omega },
            SlabResponse { rho_d: by_delta, rho_t: by_delta - (-delta).exp() },
        ],
    )
}
