//! One thin tube seen from a texel: an arc of a great circle. Its parameter t = tan(ψ/2) is the tangent of half the
//! angle ψ from the point where the lobe peaks.
//!
//! Half vectors turn by ψ/2, so tan²α (α is the angle between half vector and normal) is nearly a parabola in t, and a
//! Beckmann lobe is nearly a bell in t, however wide it is. With light direction l, camera direction c, normal n and
//! latitude φ along the tube, E = 1 + l·c, M = n·l + n·c and q = cosφ are quadratic polynomials over (1 + t²), and that
//! divisor cancels:
//!
//! ```text
//! S = scale/(2B) ∫ D dsinφ = scale/(2B) · 1/(π m²) ∫ 8 E² q/M⁴ · K(τ) dt,   τ = tan²α = 2 (1 + t²) E/M² − 1
//! K = exp(−τ/m²) (Beckmann), (1 + τ/m²)⁻² (GGX);   D = scale · (2/π) ∫ (n·l) cosφ dφ;   B = n·c
//! ```
//!
//! This is the thin-tube integral of G3 and W §3 for any normal and any camera.

use crate::gloss::{Lobe, dot, fresnel};
use mesophyll_base::quadrature::symmetric;
use std::f64::consts::PI;

/// A thin tube from a texel, in the pass's frame (travel, tube, up).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TubeArc {
    /// Sine of the direction to the tube's nearest point, which is (sin, 0, cos).
    pub sin: f64,
    /// Cosine of that direction: its upward part.
    pub cos: f64,
    /// Tangents of the angles from that direction to the ends of the tube.
    pub ends: [f64; 2],
    /// Height over distance, times the weight of this arc in the average over the tube's radius.
    pub scale: f64,
}

/// An arc's share of a frame. Derivatives are with respect to a free vector n.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArcSums {
    /// Diffuse response D.
    pub d: f64,
    /// ∂D/∂n.
    pub d_n: [f64; 3],
    /// Glossy response S.
    pub s: f64,
    /// ∂S/∂m.
    pub s_m: f64,
    /// ∂S/∂n.
    pub s_n: [f64; 3],
}

impl ArcSums {
    /// Adds another share of the same frame.
    pub fn add(&mut self, o: &ArcSums) {
        self.d += o.d;
        self.s += o.s;
        self.s_m += o.s_m;
        for k in 0..3 {
            self.d_n[k] += o.d_n[k];
            self.s_n[k] += o.s_n[k];
        }
    }
}

/// Node sets of one precision.
#[derive(Debug, Clone)]
pub struct ArcRule {
    /// Gauss–Legendre on [−1, 1], for a lobe that the tube's ends cut.
    pub gauss: Vec<(f64, f64)>,
    /// Number of nodes of the trapezoid rule for a bell that fits between the ends: nodes k·step with |k| ≤ `bell`, in
    /// widths of the bell e^(−x²).
    pub bell: i32,
    /// Distance of the trapezoid's nodes, in widths of the bell.
    pub step: f64,
}

/// The Gaussian tail beyond this many widths is left out: e^(−4.2²) = 2e-8.
const TAIL: f64 = 4.2;

impl ArcRule {
    /// `along` nodes on half the lobe.
    pub fn new(along: usize) -> ArcRule {
        let bell = (along.max(2) / 2) as i32;
        // Aliasing e^(−π²/h²) and truncation e^(−((k+1)h)²) balance at h² = π/(k + 1).
        ArcRule { gauss: symmetric(2 * along.max(1)), bell, step: (PI / f64::from(bell + 1)).sqrt() }
    }
}

impl TubeArc {
    /// D and S of this arc for normal `n`, camera direction `c` and slope `m`.
    pub fn integrate(&self, lobe: Lobe, n: [f64; 3], c: [f64; 3], m: f64, rule: &ArcRule) -> ArcSums {
        let mut out = ArcSums::default();
        let b = dot(n, c);
        let a1 = n[0] * self.sin + n[2] * self.cos;
        let Some(ends) = self.visible(a1, n[1]) else { return out };
        if b <= 0.0 {
            return out;
        }
        let phi = ends.map(f64::atan);
        let (q, s) = (phi.map(f64::cos), phi.map(f64::sin));
        let along = 0.5 * (phi[1] - phi[0] + s[1] * q[1] - s[0] * q[0]);
        let skew = 0.5 * (s[1] * s[1] - s[0] * s[0]);
        out.d_n = [self.sin * along, skew, self.cos * along].map(|j| self.scale * 2.0 / PI * j);
        out.d = dot(out.d_n, n);
        let bow = Bow::new(self, n, c, b, [s, q], phi);
        bow.gloss(lobe, m, self.scale, rule, &mut out);
        self.horizon(lobe, n, c, m, ends, &mut out);
        out
    }

    /// The ends of the part of the tube above the texel's horizon, as tangents; `None` where nothing is above it.
    fn visible(&self, a1: f64, n_along: f64) -> Option<[f64; 2]> {
        let [mut lo, mut hi] = self.ends;
        if n_along.abs() < 1e-300 {
            return (a1 > 0.0).then_some([lo, hi]);
        }
        let horizon = -a1 / n_along;
        if n_along > 0.0 {
            lo = lo.max(horizon)
        } else {
            hi = hi.min(horizon)
        }
        (lo < hi).then_some([lo, hi])
    }

    /// Where the horizon cuts the tube, the cut moves with the normal. So ∂S/∂n gets a term with the integrand at the
    /// cut.
    fn horizon(&self, lobe: Lobe, n: [f64; 3], c: [f64; 3], m: f64, ends: [f64; 2], out: &mut ArcSums) {
        for (k, sign) in [(0, -1.0), (1, 1.0)] {
            if ends[k] == self.ends[k] {
                continue;
            }
            let (t, q) = (ends[k], 1.0 / (1.0 + ends[k] * ends[k]).sqrt());
            let l = [self.sin * q, t * q, self.cos * q];
            let b = dot(n, c);
            // D/(4 cosθi cosθr)·cosθi per dsinφ, with dsinφ = q³ dt and dt/dn = −(sin, t, cos)/n_y
            let e = 1.0 + dot(l, c);
            let shadow = if lobe.index().is_some() { 0.0 } else { 1.0 };
            let value = shadow * lobe.distribution(crate::gloss::tan2_half(b, e), m) * q * q * q;
            let factor = sign * self.scale / (2.0 * b) * value / -n[1];
            for (o, v) in out.s_n.iter_mut().zip([self.sin, t, self.cos]) {
                *o += factor * v;
            }
        }
    }
}

/// The arc turned so that t = 0 lies where tan²α is least, and the polynomials in t.
struct Bow {
    /// Directions at t = 0 and a quarter turn further.
    p1: [f64; 3],
    p2: [f64; 3],
    camera: [f64; 3],
    b: f64,
    a: [f64; 2],
    e: [f64; 3],
    m: [f64; 3],
    q: [f64; 3],
    limits: [f64; 2],
    /// tan²α at t = 0 and half its second derivative there with respect to the angle.
    tau: f64,
    bend: f64,
    slope: f64,
}

impl Bow {
    fn new(arc: &TubeArc, n: [f64; 3], c: [f64; 3], b: f64, [s, q]: [[f64; 2]; 2], phi: [f64; 2]) -> Bow {
        let (a1, c1) = (n[0] * arc.sin + n[2] * arc.cos, c[0] * arc.sin + c[2] * arc.cos);
        // Starts at the mirror direction 2 (n·c) n − c, projected on the arc's plane, and takes Newton steps on d
        // tan²α/dφ = 0.
        let mut peak = (2.0 * b * n[1] - c[1]).atan2(2.0 * b * a1 - c1).clamp(phi[0], phi[1]);
        let (mut tau, mut bend, mut slope) = (0.0, 0.0, 0.0);
        for step in 0..3 {
            let (sp, cp) = peak.sin_cos();
            let (e, m) = (1.0 + c1 * cp + c[1] * sp, b + a1 * cp + n[1] * sp);
            let (e1, m1) = (c[1] * cp - c1 * sp, n[1] * cp - a1 * sp);
            let f = e1 * m - 2.0 * e * m1;
            let f1 = -(e - 1.0) * m - e1 * m1 + 2.0 * e * (m - b);
            tau = (2.0 * e / (m * m) - 1.0).max(0.0);
            slope = 2.0 * f / (m * m * m);
            bend = (f1 / (m * m * m) - 1.5 * slope * m1 / m).max(1e-3);
            if step < 2 {
                let to = if f1 > 0.0 { peak - f / f1 } else { peak - f.signum() * 0.2 };
                peak = to.clamp(peak - 0.5, peak + 0.5).clamp(phi[0], phi[1]);
            }
        }
        let (sp, qp) = peak.sin_cos();
        let p1 = [arc.sin * qp, sp, arc.cos * qp];
        let p2 = [-arc.sin * sp, qp, -arc.cos * sp];
        let (a1, a2, c1, c2) = (dot(n, p1), dot(n, p2), dot(c, p1), dot(c, p2));
        let limit = |k: usize| {
            let (sin, cos) = (s[k] * qp - q[k] * sp, q[k] * qp + s[k] * sp);
            sin / (1.0 + cos)
        };
        Bow {
            p1,
            p2,
            camera: c,
            b,
            a: [a1, a2],
            e: [1.0 + c1, 2.0 * c2, 1.0 - c1],
            m: [a1 + b, 2.0 * a2, b - a1],
            q: [qp, -2.0 * sp, -qp],
            limits: [limit(0), limit(1)],
            tau,
            bend,
            slope,
        }
    }

    fn gloss(&self, lobe: Lobe, m: f64, scale: f64, rule: &ArcRule, out: &mut ArcSums) {
        let mut sums = Nodes::default();
        let m2 = m * m;
        if lobe.is_long_tailed() {
            // t = w·2y/(1 − y²) takes the Lorentzian's tail: in y the integrand's poles are at ±i.
            let w = 0.5 * ((m2 + self.tau) / self.bend).sqrt();
            let y = |t: f64| t / (w + w.hypot(t));
            let kinks = if lobe.index().is_some() { self.kinks(self.limits) } else { Vec::new() };
            let mut from = y(self.limits[0]);
            for to in kinks.into_iter().chain([self.limits[1]]).map(y) {
                let (mid, half) = (0.5 * (from + to), 0.5 * (to - from));
                for &(x, weight) in &rule.gauss {
                    let y = mid + half * x;
                    let f = 1.0 - y * y;
                    let dt = 2.0 * w * (1.0 + y * y) / (f * f);
                    self.node(lobe, m, 2.0 * w * y / f, weight * half * dt, &mut sums);
                }
                from = to;
            }
        } else if self.tau > 40.0 * m2 {
            return;
        } else if lobe.index().is_some() {
            let ends = self.window(m);
            let mut from = ends[0];
            for kink in self.kinks(ends).into_iter().chain([ends[1]]) {
                self.gauss(lobe, m, [from, kink], rule, &mut sums);
                from = kink;
            }
        } else {
            let width = m / (2.0 * self.bend.sqrt());
            let reach = width * rule.step * f64::from(rule.bell + 1);
            let steep = self.slope.abs() > 0.5 * m * self.bend.sqrt();
            if self.limits[0] <= -reach && self.limits[1] >= reach && !steep {
                let h = width * rule.step;
                for k in -rule.bell..=rule.bell {
                    self.node(lobe, m, h * f64::from(k), h, &mut sums);
                }
            } else {
                let ends = self.window(m);
                self.gauss(lobe, m, ends, rule, &mut sums);
            }
        }
        let factor = scale / (2.0 * self.b * PI * m2);
        out.s = factor * sums.value;
        out.s_m = factor * (sums.value_m - 2.0 / m * sums.value);
        let [x0, x1, x2] = sums.x;
        for k in 0..3 {
            let turned = self.p1[k] * (x0 - x2) + 2.0 * self.p2[k] * x1 + self.camera[k] * (x0 + x2);
            let masked = self.p1[k] * sums.masked[0] + self.p2[k] * sums.masked[1];
            out.s_n[k] = factor * (turned + masked + self.camera[k] * (sums.facing - sums.value) / self.b);
        }
    }

    /// The range of t that matters for a Beckmann lobe: there tan²α exceeds its smallest value by less than `TAIL`² m².
    fn window(&self, m: f64) -> [f64; 2] {
        // From d tan²α/dφ = slope and its bend: slope·φ + bend·φ² = TAIL² m² on either side, φ = 2 atan t ≥ 2 t − …
        let (reach, slope) = (TAIL * TAIL * m * m, self.slope);
        let root = (slope * slope + 4.0 * self.bend * reach).sqrt();
        let angle = [2.0 * reach / (root - slope), 2.0 * reach / (root + slope)];
        let tan = angle.map(|a| if a < 2.6 { (0.5 * a).tan() } else { f64::INFINITY });
        [self.limits[0].max(-tan[0]), self.limits[1].min(tan[1])]
    }

    fn gauss(&self, lobe: Lobe, m: f64, [from, to]: [f64; 2], rule: &ArcRule, sums: &mut Nodes) {
        let (mid, half) = (0.5 * (from + to), 0.5 * (to - from));
        if half <= 0.0 {
            return;
        }
        for &(x, weight) in &rule.gauss {
            self.node(lobe, m, mid + half * x, weight * half, sums);
        }
    }

    /// Adds the integrand at `t` times `weight`.
    fn node(&self, lobe: Lobe, m: f64, t: f64, weight: f64, sums: &mut Nodes) {
        let t2 = t * t;
        let poly = |p: &[f64; 3]| p[0] + p[1] * t + p[2] * t2;
        let (e, mm, q) = (poly(&self.e), poly(&self.m), poly(&self.q));
        let inverse = 1.0 / (mm * mm);
        let sec2 = 2.0 * (1.0 + t2) * e * inverse;
        let tau = (sec2 - 1.0).max(0.0);
        let over = 1.0 / (m * m);
        let mut shape = weight * 8.0 * e * e * q * inverse * inverse;
        let [kernel, fall] = lobe.kernel(tau * over);
        let fall = fall * over;
        let mut lean = 2.0 * sec2 * fall - 4.0;
        if let Some(index) = lobe.index() {
            let k = 1.0 / (1.0 + t2);
            let a = k * (self.a[0] * (1.0 - t2) + 2.0 * self.a[1] * t);
            shape *= fresnel((0.5 * k * e).max(0.0).sqrt(), index);
            let g = 2.0 * a.min(self.b) * mm / e;
            if g < 1.0 {
                shape *= g.max(0.0);
                lean += 1.0;
                let value = shape * kernel;
                if a < self.b {
                    let by = if a > 0.0 { value * k / a } else { 0.0 };
                    sums.masked[0] += by * (1.0 - t2);
                    sums.masked[1] += by * 2.0 * t;
                } else {
                    sums.facing += value;
                }
            }
        }
        let value = shape * kernel;
        let x = value * lean * mm * inverse;
        sums.value += value;
        sums.value_m += value * fall * 2.0 * tau / m;
        sums.x[0] += x;
        sums.x[1] += x * t;
        sums.x[2] += x * t2;
    }

    /// The places between `ends` where the V-cavity factor G has a kink, in ascending order.
    fn kinks(&self, ends: [f64; 2]) -> Vec<f64> {
        const CELLS: usize = 16;
        let branch = |t: f64| {
            let t2 = t * t;
            let poly = |p: &[f64; 3]| p[0] + p[1] * t + p[2] * t2;
            let a = (self.a[0] * (1.0 - t2) + 2.0 * self.a[1] * t) / (1.0 + t2);
            let ratio = 2.0 * poly(&self.m) / poly(&self.e);
            if a.min(self.b) * ratio >= 1.0 {
                0
            } else if a < self.b {
                1
            } else {
                2
            }
        };
        let mut found = Vec::new();
        let at = |k: usize| ends[0] + (ends[1] - ends[0]) * k as f64 / CELLS as f64;
        let mut before = branch(at(0));
        for k in 1..=CELLS {
            let now = branch(at(k));
            if now != before {
                let (mut lo, mut hi) = (at(k - 1), at(k));
                // The integrand is continuous at a kink, so an error of the kink's place enters squared.
                for _ in 0..16 {
                    let mid = 0.5 * (lo + hi);
                    if branch(mid) == before { lo = mid } else { hi = mid }
                }
                found.push(0.5 * (lo + hi));
                before = now;
            }
        }
        found
    }
}

/// Running sums over nodes.
#[derive(Default)]
struct Nodes {
    value: f64,
    value_m: f64,
    x: [f64; 3],
    masked: [f64; 2],
    facing: f64,
}
