use super::*;
use crate::mechanics::beam;

/// A beam that bends so little that it is linear, per unit of A.
fn linear(load: Load, alpha: f64, t: f64) -> f64 {
    Elastica::solve(load, alpha, 1e-6).unwrap().at(t).across / 1e-6
}

/// u″ = 4 m/(π w⁴) integrated twice by the midpoint rule in small steps, with m the moment of the load beyond t.
fn summed(alpha: f64, moment: impl Fn(f64) -> f64, t: f64) -> f64 {
    let n = 20_000;
    let h = t / f64::from(n);
    // u(t) = ∫ (t − s) u″(s) ds.
    (0..n)
        .map(|k| (f64::from(k) + 0.5) * h)
        .map(|s| h * (t - s) * 4.0 / PI * moment(s) / (1.0 + (alpha - 1.0) * s).powi(4))
        .sum()
}

#[test]
fn small_bends_are_those_of_the_linear_beam() {
    for alpha in [1e-3, 0.05, 0.3, 0.9, 1.0, 1.2] {
        for t in [0.2, 0.6, 0.95, 1.0] {
            let (got, want) = (linear(Load::Even, alpha, t), beam::deflection(alpha, t));
            assert!((got / want - 1.0).abs() < 1e-8, "α {alpha}, t {t}: {got} {want}");
        }
    }
    // Other loads, by the moment of what hangs beyond s: of the tip's load 1 − s; of a load at a, a − s; of the own
    // weight, ∫ (r − s) w² dr over ∫ w² dr.
    for alpha in [0.15, 0.6, 1.0] {
        let own = |s: f64| {
            let n = 400;
            let (mut moment, mut all) = (0.0, 0.0);
            for k in 0..n {
                let r = (f64::from(k) + 0.5) / f64::from(n);
                let w2 = (1.0 + (alpha - 1.0) * r).powi(2) / f64::from(n);
                all += w2;
                moment += w2 * (r - s).max(0.0);
            }
            moment / all
        };
        for t in [0.3, 0.8, 1.0] {
            let far = |load: Load, want: f64| (linear(load, alpha, t) / want - 1.0).abs();
            assert!(far(Load::Tip, summed(alpha, |s| 1.0 - s, t)) < 1e-6, "tip, α {alpha}, t {t}");
            assert!(far(Load::Share(0.45), summed(alpha, |s| (0.45 - s).max(0.0), t)) < 1e-6, "at, α {alpha}, t {t}");
            let tabled: Vec<f64> = (0..=400).map(|k| own(f64::from(k) / 400.0)).collect();
            let moment = |s: f64| {
                let k = (s * 400.0).min(399.0);
                let (k, part) = (k as usize, k.fract());
                tabled[k] * (1.0 - part) + tabled[k + 1] * part
            };
            assert!(far(Load::OwnWeight, summed(alpha, moment, t)) < 1e-4, "own weight, α {alpha}, t {t}");
        }
    }
}

/// An untapered branch with a load at its tip is Euler's: with the angle ψ of the tip, p² = (1 + sin ψ)/2 and φ =
/// asin(1/(p√2)), the load P L²/(E I) is (K(p) − F(φ, p))², and the tip moves by 1 − 2 (E(p) − E(φ, p))/(K(p) − F(φ,
/// p)) of the length (K. E. Bisshopp and D. C. Drucker, Quarterly of Applied Mathematics 3 (1945) 272).
#[test]
fn a_load_at_the_tip_of_an_untapered_branch_is_in_elliptic_integrals() {
    let rule = mesophyll_base::quadrature::unit(60);
    let between = |from: f64, f: &dyn Fn(f64) -> f64| -> f64 {
        let size = FRAC_PI_2 - from;
        rule.iter().map(|(x, g)| size * g * f(from + size * x)).sum()
    };
    for tip in [0.05, 0.4, 0.9, 1.3] {
        let p2 = 0.5 * (1.0 + f64::sin(tip));
        let phi = (1.0 / (2.0 * p2).sqrt()).asin();
        let root = |a: f64| (1.0 - p2 * a.sin().powi(2)).sqrt();
        let first = between(phi, &|a| 1.0 / root(a));
        let second = between(phi, &root);
        let bent = Elastica::solve(Load::Tip, 1.0, PI / 4.0 * first * first).unwrap().at(1.0);
        let across = 1.0 - 2.0 * second / first;
        let along = (2.0 * tip.sin()).sqrt() / first;
        assert!((bent.across - across).abs() < 1e-9 && (bent.along - along).abs() < 1e-9, "{tip}: {bent:?} {across}");
        assert!((bent.sin.atan2(bent.cos) - tip).abs() < 1e-9, "{tip}: {bent:?}");
    }
}

/// Runge and Kutta's method from the root, with the moment there found by halving: another method for the same beam.
fn shot(load: Load, alpha: f64, amplitude: f64, t: f64) -> [f64; 3] {
    let beyond = |s: f64| match load {
        Load::Even => 1.0 - s,
        Load::OwnWeight => {
            let cube = |s: f64| (1.0 + (alpha - 1.0) * s).powi(3);
            (cube(s) - alpha.powi(3)) / (1.0 - alpha.powi(3))
        }
        Load::Share(at) if s >= at => 0.0,
        _ => 1.0,
    };
    // `step`: the middle of the step, on one side of a single load.
    let rate = |s: f64, step: f64, [theta, m, _, _]: [f64; 4]| {
        let w4 = (1.0 + (alpha - 1.0) * s).powi(4);
        let share = if matches!(load, Load::Share(_)) { beyond(step) } else { beyond(s) };
        [m / w4, -4.0 * amplitude / PI * share * theta.cos(), theta.cos(), theta.sin()]
    };
    let run = |moment: f64, to: f64| {
        let n = 8000;
        let h = to / f64::from(n);
        let mut u = [0.0, moment, 0.0, 0.0];
        for k in 0..n {
            let s = f64::from(k) * h;
            let moved = |u: [f64; 4], d: [f64; 4], by: f64| std::array::from_fn(|i| u[i] + by * d[i]);
            let step = s + h / 2.0;
            let a = rate(s, step, u);
            let b = rate(step, step, moved(u, a, h / 2.0));
            let c = rate(step, step, moved(u, b, h / 2.0));
            let d = rate(s + h, step, moved(u, c, h));
            u = std::array::from_fn(|i| u[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
        u
    };
    // The moment at the root lies between 0 and that of the straight branch.
    let (mut low, mut high) = (0.0, 4.0 * amplitude / PI);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let end = run(middle, 1.0);
        // Too great a moment leaves some of it at the tip, or bends the branch beyond the vertical.
        if end[1] > 0.0 || end[0] > FRAC_PI_2 { high = middle } else { low = middle }
    }
    let end = run(0.5 * (low + high), t);
    [end[2], end[3], end[0]]
}

#[test]
fn strong_bends_are_those_of_another_method() {
    let mut worst = 0.0f64;
    for (load, alpha, amplitude) in [
        (Load::Even, 0.3, 1.3),
        (Load::Even, 0.15, 0.9),
        (Load::Even, 0.8, 5.0),
        (Load::Tip, 0.5, 0.8),
        (Load::OwnWeight, 0.3, 5.0),
        // The step of the load lies on a step of the other method.
        (Load::Share(0.5), 0.4, 2.0),
    ] {
        let beam = Elastica::solve(load, alpha, amplitude).unwrap();
        for t in [0.5, 1.0] {
            let (got, want) = (beam.at(t), shot(load, alpha, amplitude, t));
            let off = (got.along - want[0]).abs().max((got.across - want[1]).abs());
            worst = worst.max(off).max((got.sin.atan2(got.cos) - want[2]).abs());
        }
        println!("{load}, α {alpha}: tip {:.3} across", beam.at(1.0).across);
        assert!(beam.at(1.0).across > 0.2);
    }
    println!("against Runge and Kutta: {worst:.1e}");
    assert!(worst < 1e-8);
}

/// More elements change nothing, for the range of tapers and bends that the accuracy is promised for.
#[test]
fn a_finer_division_gives_the_same() {
    for load in [Load::Even, Load::Tip, Load::OwnWeight, Load::Share(0.7)] {
        for (alpha, promised) in [(1e-3, 1e-6), (0.03, 1e-9), (0.3, 1e-9), (1.0, 1e-9), (1.25, 1e-9)] {
            let mut worst = 0.0f64;
            // The load is raised until the tip has moved by .8, or the tip of a thin branch hangs.
            let mut amplitude = 1e-4;
            loop {
                let beam = Elastica::solve(load, alpha, amplitude).unwrap();
                if beam.at(1.0).across > 0.8 || amplitude > 10.0 {
                    break;
                }
                let mut fine = Elastica { ends: Vec::new(), ..beam.clone() };
                for pair in beam.ends.windows(2) {
                    fine.ends.extend([pair[0], 0.5 * (pair[0] + pair[1])]);
                }
                fine.ends.push(1.0);
                fine.theta = vec![0.3; fine.elements() * DEGREE + 1];
                fine.theta[0] = 0.0;
                let system = fine.system();
                let fine = fine.descend(&system).unwrap();
                for t in [0.3, 0.9, 1.0] {
                    let (a, b) = (beam.at(t), fine.at(t));
                    let off = (a.along - b.along).abs().max((a.across - b.across).abs()).max((a.sin - b.sin).abs());
                    worst = worst.max(off);
                }
                amplitude *= 3.0;
            }
            println!("{load}, α {alpha}: {worst:.1e}");
            assert!(worst < promised, "{load}, α {alpha}: {worst:e}");
        }
    }
}

#[test]
fn places_along_the_axis_and_neighbours_agree() {
    let beam = Elastica::solve(Load::Even, 0.25, 0.9).unwrap();
    for t in [0.0, 0.1, 0.5, 0.99, 1.0] {
        let (a, b) = (beam.at(t), beam.below(beam.at(t).along));
        assert!((a.across - b.across).abs() < 1e-11 && (a.along - b.along).abs() < 1e-11, "{a:?} {b:?}");
    }
    // Beyond the tip: the tangent.
    let (tip, beyond) = (beam.at(1.0), beam.below(beam.at(1.0).along + 0.1));
    assert!((beyond.across - tip.across - 0.1 * tip.sin / tip.cos).abs() < 1e-12);
    // The other side is the mirror image, and the search from a neighbour ends on the same curve.
    let other = Elastica::solve(Load::Even, 0.25, -0.9).unwrap().at(0.8);
    let same = beam.near(0.26, 0.92).unwrap().at(0.8);
    let fresh = Elastica::solve(Load::Even, 0.26, 0.92).unwrap().at(0.8);
    assert!((other.across + beam.at(0.8).across).abs() < 1e-14 && other.sin < 0.0 && other.curvature < 0.0);
    assert!((same.across - fresh.across).abs() < 1e-12, "{:e}", same.across - fresh.across);
    // The curvature is the derivative of the angle.
    let angle = |t: f64| beam.at(t).sin.asin();
    assert!((beam.at(0.6).curvature - (angle(0.6 + 1e-5) - angle(0.6 - 1e-5)) / 2e-5).abs() < 1e-8);
}

#[test]
fn what_is_no_beam_has_no_curve() {
    for (load, alpha, amplitude) in [
        (Load::Even, 0.0, 0.1),
        (Load::Even, f64::NAN, 0.1),
        (Load::Even, 2.0, 0.1),
        (Load::Tip, 0.5, f64::INFINITY),
        (Load::Share(1.5), 0.5, 0.1),
        (Load::Millimetres(100.0), 0.5, 0.1),
    ] {
        assert_eq!(Elastica::solve(load, alpha, amplitude), None);
    }
    let still = Elastica::solve(Load::Tip, 0.3, 0.0).unwrap().at(0.7);
    assert!((still.along - 0.7).abs() < 1e-14 && still.across == 0.0);
    // The greatest loads hang the branch from its root.
    for alpha in [0.05, 1.0] {
        let tip = Elastica::solve(Load::Even, alpha, 300.0).unwrap().at(1.0);
        assert!(tip.across > 0.9 && tip.across < 1.0 && tip.along > 0.0, "{tip:?}");
    }
}
