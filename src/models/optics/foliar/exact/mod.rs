//! Reflectance and transmittance without random numbers.
//!
//! Let v(θ) be the share of the light at the angle θ in one layer that finally leaves on a given side. Just after a
//! lobe, v follows from what Fresnel's formula sends on at the next interface and what the next lobe does with it: v =
//! F · L v′ + (1 − F) · L v″, where L is the mean over a lobe ([`kernel`]). This is one linear integral equation in θ
//! for all layers together. v is smooth between the angles of total reflection whatever the lobes are, so a few nodes
//! are enough for it ([`grid`]). The lobes are integrated on finer nodes of their own. Three parts of the leaf are
//! combined first, in closed form or by elimination: the antidermal wall, everything above the mesophyll, and
//! everything below it. There remains an equation as large as the number of the mesophyll's nodes.
//!
//! Light is conserved to rounding: every lobe's weights add up to 1.

mod convergence;
mod grid;
mod kernel;
mod matrix;

pub use convergence::{PARAMETERS, by_depth, derivatives, is_plain, prepared, response, responses};

use super::{LayeredLeaf, LeafResponse, MesophyllPath, Oblateness, Side, enter, fresnel};
use crate::number::Real;
use grid::AngleGrid;
use kernel::{AngleNode, LobeRules};
use matrix::Matrix;

/// How finely the equation is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resolution {
    /// Nodes a panel of angles.
    pub order: usize,
    /// Nodes over each smooth piece of a lobe.
    pub piece: usize,
    /// Nodes over azimuth.
    pub azimuth: usize,
}

impl Resolution {
    /// Better than 2e-5 in R and T of leaves with wide lobes.
    pub const USUAL: Resolution = Resolution { order: 18, piece: 13, azimuth: 16 };
    /// For narrow lobes and indices that nearly agree, one after the other until two agree.
    pub const FINER: [Resolution; 3] = [
        Resolution { order: 26, piece: 16, azimuth: 20 },
        Resolution { order: 38, piece: 22, azimuth: 28 },
        Resolution { order: 56, piece: 30, azimuth: 40 },
    ];
}

/// Lobes of a larger oblateness than this turn light only a little: it leaves near the angle at which it came.
const NARROW: f64 = 6.0;

/// The lobe around each of a medium's nodes, as fine nodes; `Straight` where the lobe does not turn light.
enum Lobe<N> {
    Straight,
    Points(Vec<Vec<AngleNode<N>>>),
}

/// The optics of a leaf except for the mesophyll's absorption. It is solved once and serves any number of absorptions.
pub struct LeafOperator<N = f64> {
    leaf: LayeredLeaf<N>,
    grid: AngleGrid<N>,
    rules: LobeRules,
    palisade: Lobe<N>,
    /// Of the light that goes up at the upper end of the mesophyll: what comes back down into it. `below` is the same
    /// for light going down at the lower end.
    above: Matrix<N>,
    below: Matrix<N>,
    /// Of the same light: what leaves the leaf instead.
    out_above: Matrix<N>,
    out_below: Matrix<N>,
    /// For light going down in the upper epidermis: what enters the mesophyll, and what leaves the leaf upward.
    upper: Matrix<N>,
    upper_out: Matrix<N>,
    /// For light going up in the lower epidermis: what goes up into the mesophyll, and what leaves the leaf downward.
    lower: Matrix<N>,
    lower_out: Matrix<N>,
}

/// A leaf with a given absorption, solved for light from all angles.
pub struct LeafSolution<'a, N = f64> {
    prepared: &'a LeafOperator<N>,
    /// Shares of the light going down in the upper epidermis that leave the leaf upward and downward, at its nodes.
    upper: Matrix<N>,
    /// The same of the light going up in the lower epidermis.
    lower: Matrix<N>,
}

impl<N: Real> LeafOperator<N> {
    /// Prepares a leaf. The leaf's own absorption `depth` is not used.
    pub fn new(leaf: &LayeredLeaf<N>, resolution: Resolution) -> LeafOperator<N> {
        let LayeredLeaf { n_cuticle: nc, n_mesophyll: nm, n_antidermal: na, .. } = *leaf;
        let Oblateness { epidermis, palisade, .. } = leaf.oblateness;
        let mut bends: Vec<N> =
            [(nc, nm, epidermis), (nm, nc, palisade)].iter().flat_map(|b| bends(b.0, b.1, b.2)).collect();
        if epidermis.value().is_infinite() {
            // Light that comes in without being turned is interpolated between the nodes. The nodes are dense near the
            // normal: there the end of the next lobe lies at grazing light, which the mesophyll absorbs.
            bends.extend([0.02, 0.15].map(N::of));
        } else if leaf.path == MesophyllPath::Slant && epidermis.value() > NARROW {
            // Light that is turned only a little depends nearly on the angle of a single node, and slant paths absorb
            // grazing light more. So the nodes must be denser near the normal here, too; one more panel is enough.
            bends.push(N::of(0.4));
        }
        let grid = AngleGrid::new(&[nc, nm], &[na], &bends, resolution.order);
        LeafOperator::on(leaf, grid, LobeRules::new(resolution.azimuth, resolution.piece))
    }

    /// The same for a leaf whose lobes do not turn light, for light at one angle (radians from the normal): the closed
    /// form of six smooth plates.
    fn straight(leaf: &LayeredLeaf<N>, incidence: f64) -> LeafOperator<N> {
        let grid = AngleGrid::single(&[leaf.n_cuticle, leaf.n_mesophyll], incidence.cos());
        LeafOperator::on(leaf, grid, LobeRules::new(1, 1))
    }

    fn on(leaf: &LayeredLeaf<N>, grid: AngleGrid<N>, rules: LobeRules) -> LeafOperator<N> {
        let LayeredLeaf { n_cuticle: nc, n_mesophyll: nm, n_antidermal: na, .. } = *leaf;
        let Oblateness { epidermis, palisade, spongy, .. } = leaf.oblateness;
        let air = N::of(1.0);
        let (in_air, in_epidermis, in_mesophyll) = (grid.len(air), grid.len(nc), grid.len(nm));
        // Reflectances at the nodes; beyond the last node of the other medium reflection is total.
        let between = |n1: N, n2: N| -> Vec<N> {
            let shared = grid.len(n1).min(grid.len(n2));
            let at = |k: usize| fresnel(n1, grid.angle(n1, k).1, n2, grid.angle(n2, k).1);
            (0..grid.len(n1)).map(|k| if k < shared { at(k) } else { N::of(1.0) }).collect()
        };
        let rest = |f: &[N]| -> Vec<N> { f.iter().map(|&x| N::of(1.0) - x).collect() };
        let lobes = |n: N, ob: N, grazing: bool| lobes(&grid, &rules, n, ob, grazing);
        let mean = |n: N, lobe: &Lobe<N>| mean(&grid, n, lobe, |_| N::of(1.0));

        let turn_epidermis = mean(nc, &lobes(nc, epidermis, false));
        let turn_spongy = mean(air, &lobes(air, spongy, false));
        let palisade = lobes(nm, palisade, true);

        // Above the mesophyll, light goes down (d) and up (u) in the epidermis, and y goes down in the mesophyll. u =
        // F0 L d + (1 − F0) and d = F1 L u + T1 y. The last column is the light that leaves through the upper face.
        let f0 = between(nc, air);
        let f1 = between(nc, nm);
        let t1 = rest(&f1);
        let bounce = turn_epidermis.times(&turn_epidermis.clone().scaled(&f0)).scaled(&f1);
        let leaving = Matrix { rows: in_epidermis, columns: 1, entries: rest(&f0) };
        let enter_mesophyll =
            Matrix::from_fn(in_epidermis, in_mesophyll, |i, j| if i == j { t1[i] } else { N::of(0.0) });
        let upper = bounce.solve_rest(enter_mesophyll);
        let upper_out = bounce.solve_rest(turn_epidermis.times(&leaving).scaled(&f1));
        // Light that goes up in the mesophyll meets interface 1: the share F is reflected, the rest is refracted into u
        // of the epidermis.
        let f1_up = between(nm, nc);
        let t1_up = rest(&f1_up);
        let into_upper = |d: &Matrix<N>| turn_epidermis.times(&turn_epidermis.times(d).scaled(&f0));
        let shared = in_epidermis.min(in_mesophyll);
        let extended = |m: &Matrix<N>, rows: usize| {
            Matrix::from_fn(rows, m.columns, |i, j| if i < m.rows { m.at(i, j) } else { N::of(0.0) })
        };
        let above = extended(&into_upper(&upper).head(shared), in_mesophyll).scaled(&t1_up);
        let diagonal = Matrix::from_fn(in_mesophyll, in_mesophyll, |i, j| if i == j { f1_up[i] } else { N::of(0.0) });
        let above = above.plus(&diagonal);
        let out_above = into_upper(&upper_out).plus(&turn_epidermis.times(&leaving));
        let out_above = extended(&out_above.head(shared), in_mesophyll).scaled(&t1_up);

        // Below the mesophyll, the antidermal wall acts as one film with all its reflections.
        let film = |k: usize| {
            let [(_, c1), (_, ca), (_, ce)] = [air, na, nc].map(|n| grid.angle(n, k));
            let (f3, f4) = (fresnel(air, c1, na, ca), fresnel(na, ca, nc, ce));
            let one = N::of(1.0);
            let (t3, t4, series) = (one - f3, one - f4, one / (one - f3 * f4));
            [f3 + t3 * t3 * f4 * series, f4 + t4 * t4 * f3 * series, t3 * t4 * series]
        };
        let films: Vec<[N; 3]> = (0..in_air).map(film).collect();
        let film_down: Vec<N> = films.iter().map(|f| f[0]).collect();
        let film_up: Vec<N> = (0..in_epidermis).map(|k| films.get(k).map_or(N::of(1.0), |f| f[1])).collect();
        let film_through: Vec<N> = films.iter().map(|f| f[2]).collect();
        // u = Fup L (F5 L u + (1 − F5)) + T a for light going up in the epidermis, with a going up in the air below
        // the mesophyll.
        let f5 = &f0;
        let bounce = turn_epidermis.times(&turn_epidermis.clone().scaled(f5)).scaled(&film_up);
        let into_air = Matrix::from_fn(in_epidermis, in_air, |i, j| if i == j { film_through[i] } else { N::of(0.0) });
        let u_by_air = bounce.solve_rest(into_air);
        let u_out = bounce.solve_rest(turn_epidermis.times(&leaving).scaled(&film_up));
        // Light going down in the air: d = Fdown a + T L (F5 L u + (1 − F5)).
        let into_lower = |u: &Matrix<N>| turn_epidermis.times(&turn_epidermis.times(u).scaled(f5)).head(in_air);
        let diagonal = Matrix::from_fn(in_air, in_air, |i, j| if i == j { film_down[i] } else { N::of(0.0) });
        let d_by_air = into_lower(&u_by_air).scaled(&film_through).plus(&diagonal);
        let d_out = into_lower(&u_out).plus(&turn_epidermis.times(&leaving).head(in_air)).scaled(&film_through);
        // a = F2 L d + T2 y for light going up in the air, y going up in the mesophyll.
        let f2_up = between(air, nm);
        let t2_up = rest(&f2_up);
        let returned = turn_spongy.times(&d_by_air).scaled(&f2_up);
        let enter_mesophyll = Matrix::from_fn(in_air, in_mesophyll, |i, j| if i == j { t2_up[i] } else { N::of(0.0) });
        let a_by_y = returned.solve_rest(enter_mesophyll);
        let a_out = returned.solve_rest(turn_spongy.times(&d_out).scaled(&f2_up));
        // Light that goes down in the mesophyll meets interface 2.
        let f2 = between(nm, air);
        let t2 = rest(&f2);
        let below = extended(&turn_spongy.times(&d_by_air.times(&a_by_y)), in_mesophyll).scaled(&t2);
        let diagonal = Matrix::from_fn(in_mesophyll, in_mesophyll, |i, j| if i == j { f2[i] } else { N::of(0.0) });
        let below = below.plus(&diagonal);
        let out_below = turn_spongy.times(&d_by_air.times(&a_out).plus(&d_out));
        let out_below = extended(&out_below, in_mesophyll).scaled(&t2);
        let lower = u_by_air.times(&a_by_y);
        let lower_out = u_by_air.times(&a_out).plus(&u_out);

        LeafOperator {
            leaf: *leaf,
            grid,
            rules,
            palisade,
            above,
            below,
            out_above,
            out_below,
            upper,
            upper_out,
            lower,
            lower_out,
        }
    }

    /// The leaf that was prepared.
    pub fn leaf(&self) -> &LayeredLeaf<N> {
        &self.leaf
    }

    /// Solves for a mesophyll of the given absorption times thickness.
    pub fn solve(&self, depth: N) -> LeafSolution<'_, N> {
        let path: MesophyllPath = self.leaf.path;
        let through = |cos: N| {
            if depth.value() == 0.0 && !N::DIFFERENTIATES { N::of(1.0) } else { (-(depth * path.length(cos))).exp() }
        };
        // One crossing after a lobe.
        let cross = mean(&self.grid, self.leaf.n_mesophyll, &self.palisade, |q| through(q.cos));
        // y_d = L (below y_u + out_below), y_u = L (above y_d + out_above), with L the crossing.
        let (up, down) = (cross.times(&self.above), cross.times(&self.below));
        let (up_out, down_out) = (cross.times(&self.out_above), cross.times(&self.out_below));
        // columns: leaves the leaf upward, downward
        let rows = cross.rows;
        let two = |a: &[N], b: &[N]| Matrix::from_fn(rows, 2, |i, j| if j == 0 { a[i] } else { b[i] });
        let zero = vec![N::of(0.0); rows];
        let source = two(&down.times(&up_out).entries, &down_out.entries);
        let y_down = down.times(&up).solve_rest(source);
        let y_up = up.times(&y_down).plus(&two(&up_out.entries, &zero));
        let with = |m: &Matrix<N>, y: &Matrix<N>, out: &Matrix<N>, column: usize| {
            let mut found = m.times(y);
            for (row, &x) in found.entries.chunks_exact_mut(2).zip(&out.entries) {
                row[column] = row[column] + x;
            }
            found
        };
        LeafSolution {
            prepared: self,
            upper: with(&self.upper, &y_down, &self.upper_out, 0),
            lower: with(&self.lower, &y_up, &self.lower_out, 1),
        }
    }
}

impl<N: Real> LeafSolution<'_, N> {
    /// What happens to light at `incidence` (radians from the normal, 0 to π/2) onto one side.
    pub fn response(&self, side: Side, incidence: f64) -> LeafResponse<N> {
        let LeafOperator { leaf, grid, rules, .. } = self.prepared;
        let (surface, sin, cos) = enter(leaf.n_cuticle, incidence);
        let ob = leaf.oblateness.epidermis;
        let points = if ob.value().is_infinite() {
            vec![AngleNode { sin, cos, weight: N::of(1.0) }]
        } else {
            kernel::spread(rules, &grid.breaks(leaf.n_cuticle), sin, cos, ob, false)
        };
        let inside = kernel::row(grid, leaf.n_cuticle, &points, |_| N::of(1.0));
        let entered = N::of(1.0) - surface;
        let [lit, other] = match side {
            Side::Front => [0, 1].map(|k| (self.upper.applied(&inside)[k], k)),
            Side::Back => [1, 0].map(|k| (self.lower.applied(&inside)[k], k)),
        };
        LeafResponse { reflectance: surface + entered * lit.0, transmittance: entered * other.0 }
    }
}

/// Values of s where the mean over a lobe is not smooth in the angle of the ray, in a medium of the index `n` next to
/// another medium and to air. A lobe of a small oblateness ends abruptly a quarter turn away from the ray, and this end
/// passes an angle of total reflection.
fn bends<N: Real>(n: N, other: N, ob: N) -> Vec<N> {
    const SMOOTH: f64 = 2.0;
    let below = [N::of(1.0), other].into_iter().filter(|m| m.value() < n.value() && ob.value() < SMOOTH);
    below.map(|m| (n * n - m * m).sqrt()).collect()
}

/// The lobe around every node of a medium of the index `n`.
fn lobes<N: Real>(grid: &AngleGrid<N>, rules: &LobeRules, n: N, ob: N, grazing: bool) -> Lobe<N> {
    if ob.value().is_infinite() {
        return Lobe::Straight;
    }
    let breaks = grid.breaks(n);
    let around = |k: usize| {
        let (sin, cos) = grid.angle(n, k);
        kernel::spread(rules, &breaks, sin, cos, ob, grazing)
    };
    Lobe::Points((0..grid.len(n)).map(around).collect())
}

/// The matrix that turns the values at the nodes into their means over the lobe around each node.
fn mean<N: Real>(grid: &AngleGrid<N>, n: N, lobe: &Lobe<N>, through: impl Fn(&AngleNode<N>) -> N) -> Matrix<N> {
    let size = grid.len(n);
    match lobe {
        Lobe::Straight => Matrix::from_fn(size, size, |i, j| {
            let (sin, cos) = grid.angle(n, i);
            if i == j { through(&AngleNode { sin, cos, weight: N::of(1.0) }) } else { N::of(0.0) }
        }),
        Lobe::Points(points) => {
            let entries = points.iter().flat_map(|p| kernel::row(grid, n, p, &through)).collect();
            Matrix { rows: size, columns: size, entries }
        }
    }
}
