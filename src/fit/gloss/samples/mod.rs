//! Gloss from goniometer samples of a leaf: reflectance factors at many directions for one or few sources.
//!
//! The model is value_k = ρd_k + π ρs f_s(n, l, v; m) for every value column k (the values are BRF = π f_r). ρs is the
//! same for all columns (grey), and so are the slope m and the normal. ρd_k ≥ 0 and ρs ≥ 0 are linear and eliminated.
//! m, tilt and tilt_y are searched globally: first a grid over all three, then argmin's Nelder–Mead from the best
//! distinct grid points, then Levenberg–Marquardt from the winner, which gives the last digits and the errors.
//!
//! The errors are computed from the scatter of the residuals. For a real leaf that scatter is misfit more than noise,
//! so the errors are lower bounds.

mod batch;

pub use batch::{answer, outputs, run, sample};

use super::{M_RANGE, normal_of};
use argmin::core::{CostFunction, Executor, State as _};
use argmin::solver::neldermead::NelderMead;
use mesophyll_optics::gloss::Lobe;
use mesophyll_solve::Termination;
use mesophyll_solve::damped::{self, Control, Damped};
use std::f64::consts::PI;

/// One direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Unit vector towards the source; z points out of the leaf.
    pub light: [f64; 3],
    /// Unit vector towards the viewer.
    pub view: [f64; 3],
    /// Reflectance factors, NaN = no reading.
    pub values: Vec<f64>,
}

impl Sample {
    /// The source is at azimuth 0 in the x–z plane, so that view azimuth 180° is the side of the mirror direction.
    /// Angles in radians.
    pub fn from_angles(source_zenith: f64, view_zenith: f64, view_azimuth: f64, values: Vec<f64>) -> Sample {
        let dir = |t: f64, p: f64| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
        Sample { light: dir(source_zenith, 0.0), view: dir(view_zenith, view_azimuth), values }
    }
}

/// A fitted leaf; errors are one standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct SamplesFit {
    /// Diffuse reflectance ρd, a value column each.
    pub rho_d: Vec<f64>,
    /// Gloss reflectance ρs, the same for all columns.
    pub rho_s: f64,
    /// Slope of the gloss, the same for all columns.
    pub m: f64,
    /// tilt, tilt_y (rad); normal = (sin tilt cos tilt_y, sin tilt_y, cos tilt cos tilt_y).
    pub tilt: [f64; 2],
    /// Root mean square of all residuals.
    pub rms: f64,
    /// Standard error of ρd, a value column each.
    pub rho_d_err: Vec<f64>,
    /// Standard error of ρs.
    pub rho_s_err: f64,
    /// Standard error of the slope.
    pub m_err: f64,
    /// Standard errors of tilt and tilt_y (rad).
    pub tilt_err: [f64; 2],
    /// Readings used.
    pub readings: usize,
}

/// Largest tilt that is searched (rad).
const TILT: f64 = 0.8;
/// How many local searches start from the grid.
const STARTS: usize = 8;

/// Fits one leaf.
///
/// # Errors
/// A reason in words where there are too few readings.
pub fn fit(samples: &[Sample], lobe: Lobe) -> std::result::Result<SamplesFit, String> {
    let bands = samples.first().map_or(0, |s| s.values.len());
    let readings = samples.iter().flat_map(|s| &s.values).filter(|v| v.is_finite()).count();
    let parameters = bands + 4;
    if readings <= parameters {
        return Err(format!("{readings} readings for {parameters} parameters"));
    }
    if let Some(k) = (0..bands).find(|&k| samples.iter().all(|s| !s.values[k].is_finite())) {
        return Err(format!("value column {} has no reading", k + 1));
    }
    let problem = Problem { samples, lobe, bands };
    let mut grid: Vec<(f64, [f64; 3])> = Vec::new();
    for i in 0..16 {
        let m = 0.03f64.ln() + (M_RANGE[1].ln() - 0.03f64.ln()) * f64::from(i) / 15.0;
        let pitch = (0.7 * m.exp()).clamp(0.03, 0.1);
        let count = (TILT / pitch).ceil() as i32;
        for a in -count..=count {
            for b in -count..=count {
                let p = [m, TILT * f64::from(a) / f64::from(count), TILT * f64::from(b) / f64::from(count)];
                grid.push((problem.sum(&p), p));
            }
        }
    }
    grid.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut starts: Vec<[f64; 3]> = Vec::new();
    for (_, p) in &grid {
        let near = |q: &[f64; 3]| (p[0] - q[0]).abs() < 0.5 && (p[1] - q[1]).abs() < 0.12 && (p[2] - q[2]).abs() < 0.12;
        if !starts.iter().any(near) {
            starts.push(*p);
        }
        if starts.len() == STARTS {
            break;
        }
    }
    let mut best: Option<(f64, [f64; 3])> = None;
    for start in starts {
        let found = problem.polish(problem.simplex(start));
        if best.is_none_or(|b| found.0 < b.0) {
            best = Some(found);
        }
    }
    let (sum, p) = best.ok_or_else(|| "no start".to_string())?;
    Ok(problem.report(&p, sum, readings, parameters))
}

struct Problem<'a> {
    samples: &'a [Sample],
    lobe: Lobe,
    bands: usize,
}

/// Linear solve at fixed m and normal.
struct Solved {
    rho_d: Vec<f64>,
    rho_s: f64,
    sum: f64,
}

impl Problem<'_> {
    /// π f_s of every sample.
    fn column(&self, p: &[f64; 3]) -> Vec<f64> {
        let (n, m) = (normal_of([p[1], p[2]]), p[0].exp());
        self.samples.iter().map(|s| PI * self.lobe.value(n, s.light, s.view, m)).collect()
    }

    fn solve(&self, column: &[f64]) -> Solved {
        // Each band is centred, then one common slope is fitted. A ρ below zero goes to its bound.
        let each = |k: usize| {
            self.samples
                .iter()
                .zip(column)
                .filter(move |(s, _)| s.values[k].is_finite())
                .map(move |(s, c)| (s.values[k], *c))
        };
        let (mut top, mut bottom) = (0.0, 0.0);
        let mut means = Vec::with_capacity(self.bands);
        for k in 0..self.bands {
            let n = each(k).count() as f64;
            let (y, c) = each(k).fold((0.0, 0.0), |(a, b), (y, c)| (a + y / n, b + c / n));
            means.push((y, c));
            for (v, x) in each(k) {
                top += (v - y) * (x - c);
                bottom += (x - c) * (x - c);
            }
        }
        let mut rho_s = if bottom > 0.0 { (top / bottom).max(0.0) } else { 0.0 };
        let mut rho_d: Vec<f64> = means.iter().map(|(y, c)| y - rho_s * c).collect();
        if rho_d.iter().any(|r| *r < 0.0) {
            // A band whose ρd is held at zero is no longer centred: a few sweeps of coordinate descent solve the
            // bounded problem.
            for _ in 0..200 {
                for (r, (y, c)) in rho_d.iter_mut().zip(&means) {
                    *r = (y - rho_s * c).max(0.0);
                }
                let (mut top, mut bottom) = (0.0, 0.0);
                for (k, r) in rho_d.iter().enumerate() {
                    for (v, x) in each(k) {
                        top += (v - r) * x;
                        bottom += x * x;
                    }
                }
                rho_s = if bottom > 0.0 { (top / bottom).max(0.0) } else { 0.0 };
            }
        }
        let sum =
            rho_d.iter().enumerate().map(|(k, r)| each(k).map(|(v, x)| (v - r - rho_s * x).powi(2)).sum::<f64>()).sum();
        Solved { rho_d, rho_s, sum }
    }

    /// Sum of squares at (ln m, tilt, tilt_y). Outside the allowed range it rises steeply.
    fn sum(&self, p: &[f64; 3]) -> f64 {
        let q = clamp(p);
        let outside: f64 = p.iter().zip(&q).map(|(a, b)| (a - b).powi(2)).sum();
        self.solve(&self.column(&q)).sum * (1.0 + 10.0 * outside) + outside
    }

    fn simplex(&self, start: [f64; 3]) -> [f64; 3] {
        let mut corners = vec![start.to_vec()];
        for (k, edge) in [0.15, 0.04, 0.04].into_iter().enumerate() {
            let mut corner = start.to_vec();
            corner[k] += edge;
            corners.push(corner);
        }
        let Ok(solver) = NelderMead::new(corners).with_sd_tolerance(1e-14) else { return start };
        let run = Executor::new(Simplex(self), solver).configure(|s| s.max_iters(300)).run();
        match run.ok().and_then(|r| r.state().get_best_param().cloned()) {
            Some(p) if p.len() == 3 => clamp(&[p[0], p[1], p[2]]),
            _ => start,
        }
    }

    /// Residuals of all readings at `p`, with the linear parameters at their best values.
    fn residuals(&self, p: &[f64; 3]) -> Vec<f64> {
        let column = self.column(p);
        let s = self.solve(&column);
        let rho = &s.rho_d;
        let readings = self
            .samples
            .iter()
            .zip(&column)
            .flat_map(|(sample, x)| sample.values.iter().zip(rho).map(move |(v, r)| v - r - s.rho_s * x));
        readings.filter(|r| r.is_finite()).collect()
    }

    /// Levenberg–Marquardt on the projected residuals, derivatives by central differences (a leaf has few samples).
    fn polish(&self, start: [f64; 3]) -> (f64, [f64; 3]) {
        let at = (self.solve(&self.column(&start)).sum, start);
        let control = Control { damping: 1e-3, tries: usize::MAX, most: 1e7, least: 0.0, ..Control::MARQUARDT };
        damped::minimize(&mut Polish { problem: self, normal: Default::default() }, at, &control).0
    }

    /// −∂residual/∂p of the projected residuals, a column a parameter.
    fn slopes(&self, p: &[f64; 3]) -> [Vec<f64>; 3] {
        std::array::from_fn(|k| {
            let step = 1e-5;
            let moved = |by: f64| {
                let mut q = *p;
                q[k] += by;
                self.residuals(&q)
            };
            moved(-step).iter().zip(moved(step)).map(|(a, b)| (a - b) / (2.0 * step)).collect()
        })
    }

    fn report(&self, p: &[f64; 3], sum: f64, readings: usize, parameters: usize) -> SamplesFit {
        let column = self.column(p);
        let solved = self.solve(&column);
        let variance = sum / (readings - parameters) as f64;
        // Full Jacobian: ρd a band, ρs, ln m, tilt, tilt_y.
        let n = self.bands + 4;
        let moved = |k: usize, by: f64| {
            let mut q = *p;
            q[k] += by;
            self.column(&q)
        };
        let slopes: [Vec<f64>; 3] = std::array::from_fn(|k| {
            let (hi, lo) = (moved(k, 1e-5), moved(k, -1e-5));
            hi.iter().zip(&lo).map(|(a, b)| (a - b) / 2e-5).collect()
        });
        let mut normal = nalgebra::DMatrix::<f64>::zeros(n, n);
        for (i, sample) in self.samples.iter().enumerate() {
            for k in (0..self.bands).filter(|&k| sample.values[k].is_finite()) {
                let mut row = nalgebra::DVector::<f64>::zeros(n);
                row[k] = 1.0;
                row[self.bands] = column[i];
                for j in 0..3 {
                    row[self.bands + 1 + j] = solved.rho_s * slopes[j][i];
                }
                normal += &row * row.transpose();
            }
        }
        let scale: Vec<f64> = (0..n).map(|k| normal[(k, k)].sqrt()).collect();
        let live: Vec<usize> = (0..n).filter(|&k| scale[k] > 0.0).collect();
        let scaled = nalgebra::DMatrix::from_fn(live.len(), live.len(), |i, j| {
            normal[(live[i], live[j])] / (scale[live[i]] * scale[live[j]])
        });
        let mut err = vec![f64::INFINITY; n];
        if let Some(inverse) = scaled.cholesky().map(|c| c.inverse()) {
            for (i, &k) in live.iter().enumerate() {
                err[k] = (variance * inverse[(i, i)]).sqrt() / scale[k];
            }
        }
        let m = p[0].exp();
        SamplesFit {
            rho_s: solved.rho_s,
            m,
            tilt: [p[1], p[2]],
            rms: (sum / readings as f64).sqrt(),
            rho_d_err: err[..self.bands].to_vec(),
            rho_s_err: err[self.bands],
            m_err: m * err[self.bands + 1],
            tilt_err: [err[self.bands + 2], err[self.bands + 3]],
            rho_d: solved.rho_d,
            readings,
        }
    }
}

/// The last refinement from a start close by. A point is the sum of squares together with its parameters.
struct Polish<'a, 'b> {
    problem: &'a Problem<'b>,
    normal: (nalgebra::Matrix3<f64>, nalgebra::Vector3<f64>),
}

impl Damped for Polish<'_, '_> {
    type Point = (f64, [f64; 3]);
    type Step = [f64; 3];

    fn linearise(&mut self, (_, p): &mut Self::Point) {
        self.normal = normal_equations(&self.problem.slopes(p), &self.problem.residuals(p));
    }

    fn step(&mut self, _: &Self::Point, damping: f64) -> Option<[f64; 3]> {
        let (a, g) = &self.normal;
        let damped = nalgebra::Matrix3::from_fn(|i, j| {
            a[(i, j)] * if i == j { 1.0 + damping } else { 1.0 } + if i == j { 1e-300 } else { 0.0 }
        });
        damped.cholesky().map(|c| c.solve(g).into())
    }

    fn end(&mut self, _: &mut Self::Point, _: &[f64; 3]) -> Option<Termination> {
        None
    }

    fn take(&mut self, (_, p): &Self::Point, step: &[f64; 3], _: f64) -> Self::Point {
        let next = clamp(&[p[0] + step[0], p[1] + step[1], p[2] + step[2]]);
        (self.problem.solve(&self.problem.column(&next)).sum, next)
    }

    fn better(&self, at: &Self::Point, trial: &Self::Point) -> bool {
        trial.0 < at.0
    }

    fn settled(&self, before: &Self::Point, now: &Self::Point) -> Option<Termination> {
        (before.0 - now.0 < 1e-14 * before.0).then_some(Termination::CostConverged)
    }
}

struct Simplex<'a, 'b>(&'a Problem<'b>);

impl CostFunction for Simplex<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, p: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.0.sum(&[p[0], p[1], p[2]]))
    }
}

fn clamp(p: &[f64; 3]) -> [f64; 3] {
    [p[0].clamp(M_RANGE[0].ln(), M_RANGE[1].ln()), p[1].clamp(-TILT, TILT), p[2].clamp(-TILT, TILT)]
}

fn normal_equations(jacobian: &[Vec<f64>; 3], r: &[f64]) -> (nalgebra::Matrix3<f64>, nalgebra::Vector3<f64>) {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    (
        nalgebra::Matrix3::from_fn(|i, j| dot(&jacobian[i], &jacobian[j])),
        nalgebra::Vector3::from_fn(|i, _| dot(&jacobian[i], r)),
    )
}
