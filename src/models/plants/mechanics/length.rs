//! Keeps a bent branch as long as it was. A beam's deflection is transverse, so a strongly bent branch would be
//! stretched: by 15 % at a tip deflection of half its length. Everything here is in the plane of bending and in units
//! of the branch's length.
//!
//! There are three answers:
//!
//! - [`printed`] is H9 Eq. 4.9–4.11: the point slides back along its tangent. It over-corrects: −4.5 % (α = 0.3, tip
//!   0.5 L), −14 % (α = 0.1, tip 1 L). Eq. 4.9 divides by u′; d = u u′/(1+s) with s = √(1+u′²) is the same number
//!   without the 0/0 at the root.
//! - [`bend`] puts the point where the arc length from the root is what it was. It takes two Newton steps from the
//!   printed answer with a four-point rule for the arc, in the coordinate of [`super::taper`], in which the arc is
//!   smooth up to the tip of any taper. The error of the length is below 0.02 % for tip deflections up to 1 L. `f64`
//!   and `f32` use the same steps, and so does the shader.
//! - [`settled`] is the same curve from the exact u, with the arc solved to 1e-10. It is the reference of both.
//!
//! The bent axis is the graph of A u(x), where A is F/(E′r₁⁴) over L. A real branch under a load that keeps its
//! direction deviates from that graph as the tip deflection exceeds a quarter of its length. The geometrically
//! exact beam is [`super::elastica`], which a measurement sees.

use super::beam;
use super::quadrature::{NodeWeight, TWELVE, TWENTY_FOUR, four};
use super::taper::{TaperShape, coordinate, polynomial, position};
use mesophyll_base::number::FloatingPoint;

/// A place on the bent axis, in units of the branch's length: across and along are in the plane of bending.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisPoint<T> {
    /// Along the straight axis.
    pub along: T,
    /// In the direction of the load.
    pub across: T,
    /// Direction of the bent axis: cosine and sine of its angle to the straight one.
    pub cos: T,
    /// Sine of the same angle.
    pub sin: T,
    /// Curvature of the bent axis, positive towards the load.
    pub curvature: T,
}

/// H9 Eq. 4.9–4.11 at `x`, given A u(x) and A u′(x). Returns x − d/s, where Eq. 4.14 takes its slope and which is also
/// the place along the axis, and the place across.
pub fn printed<T: FloatingPoint>(x: T, u: T, du: T) -> (T, T) {
    let s = (T::one() + du * du).sqrt();
    // d/s with d = u (s−1)/u′ = u u′/(1+s).
    (x - u * du / ((T::one() + s) * s), u / s)
}

/// Newton steps of [`bend`].
pub const STEPS: usize = 2;

/// Where the point at arc length `x` (0 to 1) moves to for an amplitude A ≥ 0. The result is finite for finite input.
pub fn bend<T: FloatingPoint>(shape: &TaperShape<T>, x: T, amplitude: T) -> AxisPoint<T> {
    let nodes = four().map(|(t, g)| (T::of(t), T::of(g)));
    bend_with(shape, x, amplitude, &nodes, STEPS)
}

/// A step of Newton's method after which only rounding is left, because each step squares the error.
const LAST: f64 = 1e-7;

/// [`bend`] with any rule and at most so many steps.
pub fn bend_with<T: FloatingPoint>(
    shape: &TaperShape<T>,
    x: T,
    amplitude: T,
    nodes: &[(T, T)],
    steps: usize,
) -> AxisPoint<T> {
    let curve = Curve { shape, amplitude };
    let (u, du) = shape.at(x);
    let start = printed(x, amplitude * u, amplitude * du).0;
    let mut y = coordinate(shape, start.at_least(T::zero()));
    for _ in 0..steps {
        // The arc less the straight distance, which is known in closed form. So nothing moves at rest.
        let mut extra = T::zero();
        for (t, g) in nodes {
            let [a, b] = curve.velocity(y * *t);
            extra += *g * (b * b / ((a * a + b * b).sqrt() + a));
        }
        let arc = position(shape, y) + y * extra;
        let step = (arc - x) / curve.speed(y);
        y = (y - step).at_least(T::zero()).at_most(T::one());
        if step.abs() <= T::of(LAST) {
            break;
        }
    }
    curve.at(y)
}

/// The graph of A u in the coordinate y.
struct Curve<'a, T> {
    shape: &'a TaperShape<T>,
    amplitude: T,
}

impl<T: FloatingPoint> Curve<'_, T> {
    /// Velocity: d(along)/dy = α^y ℓ and d(across)/dy = A P′.
    fn velocity(&self, y: T) -> [T; 2] {
        [(y * self.shape.ln_alpha).exp() * self.shape.ell, self.amplitude * polynomial(&self.shape.a, y)[1]]
    }

    fn speed(&self, y: T) -> T {
        let [a, b] = self.velocity(y);
        (a * a + b * b).sqrt()
    }

    fn at(&self, y: T) -> AxisPoint<T> {
        let [p, dp, ddp] = polynomial(&self.shape.a, y);
        let [a, b] = self.velocity(y);
        let speed = (a * a + b * b).sqrt();
        AxisPoint {
            along: position(self.shape, y),
            across: self.amplitude * p,
            cos: a / speed,
            sin: b / speed,
            // (a b′ − b a′)/speed³ with a′ = a ln α.
            curvature: self.amplitude * a * (ddp - dp * self.shape.ln_alpha) / (speed * speed * speed),
        }
    }
}

/// Length of the bent axis between the root and the point that [`bend`] gives for `x`, divided by x. It is 1 where the
/// length is kept.
pub fn kept(shape: &TaperShape<f64>, bent: &AxisPoint<f64>, x: f64, amplitude: f64) -> f64 {
    let curve = Curve { shape, amplitude };
    let y = coordinate(shape, bent.along);
    y * TWENTY_FOUR.iter().map(|(t, g)| g * curve.speed(y * t)).sum::<f64>() / x
}

/// The graph of the exact A u, with the arc length solved to 1e-10: `alpha` as in [`beam::deflection`], any amplitude
/// (its sign is the side).
pub fn settled(alpha: f64, x: f64, amplitude: f64) -> AxisPoint<f64> {
    settled_with(&TWELVE, alpha, x, amplitude)
}

fn settled_with(nodes: &[NodeWeight], alpha: f64, x: f64, amplitude: f64) -> AxisPoint<f64> {
    let shape = TaperShape::new(alpha, [0.0; 4]);
    // d(along)/dy = w ℓ, so that the arc to y is the integral of ℓ w √(1 + (A u′)²): u′ w is smooth up to the tip.
    let speed = |y: f64| {
        let at = position(&shape, y).min(1.0);
        let w = (1.0 - at) + alpha * at;
        let rise = amplitude * beam::slope(alpha, at);
        shape.ell * w * (1.0 + rise * rise).sqrt()
    };
    let arc = |y: f64| y * nodes.iter().map(|(t, g)| g * speed(y * t)).sum::<f64>();
    let start = printed(x, amplitude.abs() * beam::deflection(alpha, x), amplitude.abs() * beam::slope(alpha, x)).0;
    let mut y = coordinate(&shape, start.max(0.0));
    for _ in 0..30 {
        let step = (arc(y) - x) / speed(y);
        y = (y - step).clamp(0.0, 1.0);
        // Newton's method squares the error: after a step of 1e-8 only rounding is left.
        if step.abs() < 1e-8 {
            break;
        }
    }
    let at = position(&shape, y).min(1.0);
    let rise = amplitude * beam::slope(alpha, at);
    let s = (1.0 + rise * rise).sqrt();
    AxisPoint {
        along: at,
        across: amplitude * beam::deflection(alpha, at),
        cos: 1.0 / s,
        sin: rise / s,
        curvature: amplitude * beam::curvature(alpha, at) / (s * s * s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The length of a polygon, which uses neither a derivative nor one of our quadrature rules.
    fn polygon(points: impl Iterator<Item = [f64; 2]>) -> f64 {
        let all: Vec<[f64; 2]> = points.collect();
        all.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum()
    }

    /// Places that become denser towards the tip, where thin tapers turn sharply.
    fn places(n: usize) -> impl Iterator<Item = f64> {
        (0..=n).map(move |k| {
            let t = k as f64 / n as f64;
            1.0 - (1.0 - t).powi(3)
        })
    }

    #[test]
    fn the_settled_curve_keeps_every_length() {
        for alpha in [1e-4, 0.1, 1.0] {
            for tip in [0.1, 0.75, 1.0] {
                let amplitude = tip / beam::deflection(alpha, 1.0);
                let points: Vec<[f64; 2]> =
                    places(3000).map(|x| settled(alpha, x, amplitude)).map(|b| [b.along, b.across]).collect();
                let length = polygon(points.iter().copied());
                assert!((length - 1.0).abs() < 1e-5, "α {alpha}, tip {tip}: {length}");
                // The length of the first half must be right as well.
                let half = places(3000).take_while(|x| *x <= 0.5).count();
                let partial = polygon(points[..half].iter().copied());
                let end = places(3000).nth(half - 1).unwrap();
                assert!((partial / end - 1.0).abs() < 1e-5, "α {alpha}, tip {tip}: {partial}");
            }
        }
    }

    /// Twelve nodes are enough: twice as many give the same result.
    #[test]
    fn the_arc_is_settled_to_rounding() {
        let mut worst = 0.0f64;
        for alpha in [1e-4, 1e-2, 0.1, 0.4, 1.0, 1.2] {
            for tip in [0.01, 0.3, 1.0] {
                let amplitude = tip / beam::deflection(alpha, 1.0);
                for x in [0.2, 0.7, 0.99, 1.0] {
                    let (a, b) = (settled(alpha, x, amplitude), settled_with(&TWENTY_FOUR, alpha, x, amplitude));
                    worst = worst.max((a.along - b.along).abs()).max((a.across - b.across).abs());
                }
            }
        }
        println!("12 against 24 nodes: {worst:.1e} L");
        assert!(worst < 1e-9);
    }

    #[test]
    fn the_printed_correction_errs_as_it_is_known_to() {
        let error = |alpha: f64, tip: f64| {
            let amplitude = tip / beam::deflection(alpha, 1.0);
            let plain = polygon(places(4000).map(|x| [x, amplitude * beam::deflection(alpha, x)]));
            let corrected = polygon(places(4000).map(|x| {
                let (a, b) = printed(x, amplitude * beam::deflection(alpha, x), amplitude * beam::slope(alpha, x));
                [a, b]
            }));
            (plain - 1.0, corrected - 1.0)
        };
        let (plain, corrected) = error(0.3, 0.5);
        assert!((plain - 0.15).abs() < 0.005 && (corrected + 0.045).abs() < 5e-4, "{plain} {corrected}");
        let (plain, corrected) = error(0.1, 1.0);
        assert!((plain - 0.53).abs() < 0.005 && (corrected + 0.14).abs() < 5e-3, "{plain} {corrected}");
    }

    #[test]
    fn nothing_moves_without_a_load_and_roots_stay() {
        for alpha in [1e-4, 0.4, 1.0] {
            let shape = TaperShape::new(alpha, [0.2, -0.05, 0.02, 0.01]);
            for x in [0.0, 0.3, 1.0] {
                let b = bend(&shape, x, 0.0);
                assert!((b.along - x).abs() < 1e-13 && b.across == 0.0 && b.sin == 0.0 && b.curvature == 0.0, "{b:?}");
                let b = settled(alpha, x, 0.0);
                assert!((b.along - x).abs() < 1e-13 && b.across == 0.0, "{b:?}");
            }
            let b = bend(&shape, 0.0, 2.0);
            assert!(b.along == 0.0 && b.across == 0.0 && b.cos == 1.0, "{b:?}");
        }
    }
}
