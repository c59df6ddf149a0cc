use super::evaluator::{COLUMNS, PassEvaluator, TubeGeometry};
use super::*;
use crate::gloss::dot;
use mesophyll_base::processor::InstructionSet;
use std::f64::consts::PI;

const TUBE: Tube = Tube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 };
const COOK_TORRANCE: Lobe = Lobe::CookTorrance { index: 1.45 };
const LOBES: [Lobe; 4] = [Lobe::Beckmann, Lobe::Ggx, COOK_TORRANCE, Lobe::GgxFresnel { index: 1.45 }];

fn camera() -> [f64; 3] {
    let c = 55f64.to_radians();
    [c.sin(), 0.0, c.cos()]
}

fn normal(b: f64, ty: f64) -> [f64; 3] {
    [b.sin() * ty.cos(), ty.sin(), b.cos() * ty.cos()]
}

fn slopes(b: f64, ty: f64) -> [[f64; 3]; 2] {
    [[b.cos() * ty.cos(), 0.0, -b.sin() * ty.cos()], [-b.sin() * ty.sin(), ty.cos(), -b.cos() * ty.sin()]]
}

/// Where a texel lies and looks, on and off the axes.
const PLACES: [([f64; 2], [f64; 2]); 4] =
    [([0.0, 0.0], [0.0, 0.0]), ([0.0, 12.0], [0.1, 0.0]), ([30.0, -25.0], [0.12, 0.1]), ([-30.0, 20.0], [-0.05, 0.12])];

/// The cylinder's integral, written independently from the definition: Simpson's rule over directions in the plane of
/// travel across the tube and over angles along it, with f_s from its own formula.
fn brute(lobe: Lobe, travel: Travel, light: f64, texel: [f64; 2], n: [f64; 3], m: f64) -> [f64; 2] {
    const ACROSS: usize = 32;
    const ALONG: usize = 800;
    let t = travel.local([texel[0], texel[1], 0.0]);
    let distance = (light - t[0]).hypot(TUBE.height_mm);
    let theta = ((light - t[0]) / TUBE.height_mm).atan();
    let beta = (TUBE.radius_mm / distance).asin();
    let simpson = |k: usize, n: usize| {
        (if k == 0 || k == n {
            1.0
        } else if k % 2 == 1 {
            4.0
        } else {
            2.0
        }) / (3.0 * n as f64)
    };
    let lo = ((-0.5 * TUBE.length_mm - t[1]) / distance).atan();
    let hi = ((0.5 * TUBE.length_mm - t[1]) / distance).atan();
    let (mut d, mut s) = (0.0, 0.0);
    for i in 0..=ACROSS {
        let th = theta + beta * (2.0 * i as f64 / ACROSS as f64 - 1.0);
        for k in 0..=ALONG {
            let phi = lo + (hi - lo) * k as f64 / ALONG as f64;
            let l = travel.local([th.sin() * phi.cos(), phi.sin(), th.cos() * phi.cos()]);
            let cos = dot(n, l);
            if cos <= 0.0 {
                continue;
            }
            // radiance · dω over white's E/π: E0 = π a L0/H, dω = cosφ dφ dθ
            let w = TUBE.height_mm * 2.0 * beta / TUBE.radius_mm
                * simpson(i, ACROSS)
                * phi.cos()
                * (hi - lo)
                * simpson(k, ALONG)
                * cos;
            d += w / PI;
            s += w * lobe.value(n, l, camera(), m);
        }
    }
    [d, s]
}

#[test]
fn agrees_with_brute_force() {
    for lobe in LOBES {
        // Cook–Torrance has kinks, and the brute force does not split its range there.
        let (model, bound) = (
            TubeModel::new(TUBE, camera(), lobe, &TubePrecision::fine()),
            if lobe.index().is_some() { 1e-4 } else { 2e-6 },
        );
        for m in [0.03, 0.2, 0.9] {
            for (texel, [b, ty]) in PLACES {
                for travel in [Travel::X, Travel::Y] {
                    let (n, mut err, mut peak) = (normal(b, ty), [0.0f64; 2], [0.0f64; 2]);
                    for light in [-290.0, -160.0, -140.0, -120.0, -60.0, 0.0, 70.0, 150.0] {
                        let r = model.response(travel, light, texel, n, m);
                        for (j, (got, want)) in
                            [r.d, r.s].into_iter().zip(brute(lobe, travel, light, texel, n, m)).enumerate()
                        {
                            err[j] = err[j].max((got - want).abs());
                            peak[j] = peak[j].max(want);
                        }
                    }
                    assert!(err[0] < 1e-9 * peak[0], "{lobe:?} m {m} {travel:?} D: {:.1e}", err[0] / peak[0]);
                    assert!(
                        err[1] < bound * peak[1],
                        "{lobe:?} m {m} {travel:?} {texel:?} {b} {ty} S: {:.1e}",
                        err[1] / peak[1]
                    );
                }
            }
        }
    }
}

#[test]
fn thin_tube_closed_forms() {
    // G3; W §3: D in closed form; the white texel under an infinite tube at u = 0 is 1, under 500 mm .977.
    let thin = Tube { radius_mm: 0.0, ..TUBE };
    let model = TubeModel::new(thin, camera(), Lobe::Beckmann, &TubePrecision::default());
    for (x, b) in [(-250.0, 0.1), (0.0, 0.0), (130.0, -0.2)] {
        let u: f64 = x / 100.0;
        let r = u.hypot(1.0);
        let phi = (2.5 / r).atan();
        let want = (u * f64::sin(b) + f64::cos(b)).max(0.0) * 2.0 / PI / (r * r) * (phi + phi.sin() * phi.cos());
        assert!((model.response(Travel::X, x, [0.0; 2], normal(b, 0.0), 0.2).d - want).abs() < 1e-14);
    }
    for radius_mm in [0.0, 2.5] {
        for (length_mm, want, within) in [(500.0, 0.977, 5e-4), (1e9, 1.0, 1e-6)] {
            let model = TubeModel::new(
                Tube { length_mm, radius_mm, ..TUBE },
                camera(),
                Lobe::Beckmann,
                &TubePrecision::default(),
            );
            let d = model.response(Travel::X, 0.0, [0.0; 2], normal(0.0, 0.0), 0.2).d;
            assert!((d - want).abs() < within, "radius {radius_mm}, length {length_mm}: {d}");
        }
    }
}

#[test]
fn mirror_peak_and_passes_are_alike() {
    let model = TubeModel::new(TUBE, camera(), Lobe::Beckmann, &TubePrecision::default());
    // Mirror peak at θ = 2b − θc.
    for b in [-0.05, 0.0, 0.1] {
        let x = 100.0 * (2.0 * b - 55f64.to_radians()).tan();
        let s = |dx: f64| model.response(Travel::X, x + dx, [0.0; 2], normal(b, 0.0), 0.02).s;
        assert!(s(0.0) > s(-6.0) && s(0.0) > s(6.0));
    }
    // A camera in the y–z plane sees in pass y what a camera in the x–z plane sees in pass x.
    let c = camera();
    let turned = TubeModel::new(TUBE, [0.0, c[0], c[2]], Lobe::Ggx, &TubePrecision::default());
    let model = TubeModel::new(TUBE, c, Lobe::Ggx, &TubePrecision::default());
    let (n, t) = (normal(0.1, -0.2), [12.0, -7.0]);
    let a = model.response(Travel::X, -130.0, t, n, 0.2);
    let b = turned.response(Travel::Y, -130.0, [t[1], t[0]], [n[1], n[0], n[2]], 0.2);
    assert_eq!((a.d, a.s, a.s_m), (b.d, b.s, b.s_m));
}

#[test]
fn derivatives_against_differences() {
    for lobe in LOBES {
        let model = TubeModel::new(TUBE, camera(), lobe, &TubePrecision::fine());
        for m in [0.05, 0.3, 0.8] {
            for (texel, [b, ty]) in PLACES {
                for travel in [Travel::X, Travel::Y] {
                    for light in [-200.0, -130.0, -20.0, 90.0] {
                        let at = |m: f64, b: f64, ty: f64| model.response(travel, light, texel, normal(b, ty), m);
                        let r = at(m, b, ty);
                        let [nb, ny] = slopes(b, ty);
                        let h = 1e-5;
                        let diff =
                            |p: TubeResponse, q: TubeResponse| [(p.d - q.d) / (2.0 * h), (p.s - q.s) / (2.0 * h)];
                        let by_m = diff(at(m + h, b, ty), at(m - h, b, ty));
                        let by_b = diff(at(m, b + h, ty), at(m, b - h, ty));
                        let by_y = diff(at(m, b, ty + h), at(m, b, ty - h));
                        let pairs = [
                            (r.s_m, by_m[1]),
                            (dot(r.d_n, nb), by_b[0]),
                            (dot(r.s_n, nb), by_b[1]),
                            (dot(r.d_n, ny), by_y[0]),
                            (dot(r.s_n, ny), by_y[1]),
                        ];
                        // Scale: the response itself over the width of the lobe. G's kinks move with the normal in
                        // Cook–Torrance.
                        let loose = if lobe.index().is_some() { 2e-3 } else { 1e-5 };
                        for (k, (got, want)) in pairs.into_iter().enumerate() {
                            assert!(
                                (got - want).abs() < loose * (r.s / m + r.d + want.abs()),
                                "{lobe:?} m {m} {travel:?} {light} {b} {ty}: {k}: {got} {want}"
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Compares the vectorised pass at default precision with the plain evaluation with many nodes, on every
/// instruction set. Cook–Torrance has a kink where G's branches meet, and its changes by tilt jump there. The few nodes
/// across a thick tube's radius sample this coarsely; a thin tube has no such error.
#[test]
fn fast_agrees_with_the_reference() {
    let positions: Vec<f64> = (0..100).map(|k| -400.0 + 650.0 * f64::from(k) / 99.0).collect();
    let thin = Tube { radius_mm: 0.0, ..TUBE };
    for (lobe, tube, value, slope) in [
        (Lobe::Beckmann, TUBE, 1e-5, 1e-4),
        (Lobe::Ggx, TUBE, 1e-5, 6e-4),
        (COOK_TORRANCE, thin, 1e-5, 6e-4),
        (COOK_TORRANCE, TUBE, 2e-4, f64::INFINITY),
    ] {
        let fine = TubeModel::new(tube, camera(), lobe, &TubePrecision::fine());
        let model = TubeModel::new(tube, camera(), lobe, &TubePrecision::default());
        for m in [0.02, 0.05, 0.12, 0.3, 0.6, 0.9] {
            for (texel, [b, ty]) in PLACES {
                for travel in [Travel::X, Travel::Y] {
                    if lobe == COOK_TORRANCE && (ty != 0.0 || travel == Travel::Y) {
                        // This case is not vectorised: the reference would be compared with itself.
                        continue;
                    }
                    let (n, [nb, ny]) = (normal(b, ty), slopes(b, ty));
                    let want: Vec<[f64; COLUMNS]> = positions
                        .iter()
                        .map(|&x| {
                            let r = fine.response(travel, x, texel, n, m);
                            [r.d, r.s, r.s_m, dot(r.d_n, nb), dot(r.s_n, nb), dot(r.d_n, ny), dot(r.s_n, ny)]
                        })
                        .collect();
                    let most = |c: usize| want.iter().map(|w| w[c].abs()).fold(1e-9, f64::max);
                    // A change by tilt is judged relative to the trace itself.
                    let peak: [f64; COLUMNS] =
                        std::array::from_fn(|c| if c < 3 { most(c) } else { most(c).max(most((c + 1) % 2)) });
                    // A set that the processor lacks is answered by a smaller one.
                    for level in InstructionSet::ALL {
                        let pass =
                            PassEvaluator::new(&model, travel, &positions, TubePrecision::default().along, level);
                        let mut lit = TubeGeometry::default();
                        pass.light(texel, &mut lit);
                        let mut columns = vec![vec![f64::NAN; pass.padded()]; COLUMNS];
                        let changes: &[[f64; 3]] = if ty == 0.0 && travel == Travel::X { &[nb] } else { &[nb, ny] };
                        let mut slices: [&mut [f64]; COLUMNS] =
                            columns.iter_mut().map(|c| &mut c[..]).collect::<Vec<_>>().try_into().unwrap();
                        pass.respond(&mut lit, n, changes, m, &mut slices);
                        for c in 0..3 + 2 * changes.len() {
                            let bound = if c < 2 { value } else { slope };
                            let worst =
                                (0..100).map(|k| (columns[c][k] - want[k][c]).abs()).fold(0.0, f64::max) / peak[c];
                            assert!(
                                worst < bound,
                                "{lobe:?} {level:?} m {m} {travel:?} b {b} ty {ty} column {c}: {worst:.1e}"
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Normals so steep that the horizon cuts the tube, in every column and either direction.
#[test]
fn frames_cut_by_the_horizon() {
    let positions: Vec<f64> = (0..60).map(|k| -400.0 + 13.0 * f64::from(k)).collect();
    let tilts = [(-0.4, 0.6), (0.7, -0.5), (0.5, 0.75), (0.8, 0.0), (0.0, -0.9), (-0.35, 0.02)];
    let mut cut = 0;
    for lobe in LOBES {
        let model = TubeModel::new(TUBE, camera(), lobe, &TubePrecision::default());
        for (travel, (b, ty)) in [Travel::X, Travel::Y].into_iter().flat_map(|t| tilts.map(|tilt| (t, tilt))) {
            let (n, changes) = (normal(b, ty), slopes(b, ty));
            let pass = PassEvaluator::new(&model, travel, &positions, 8, InstructionSet::detect());
            let (mut lit, mut columns) = (TubeGeometry::default(), vec![vec![0.0; pass.padded()]; COLUMNS]);
            for (m, texel) in [(0.5, [5.0, 9.0]), (0.15, [-30.0, 20.0])] {
                pass.light(texel, &mut lit);
                let mut slices: [&mut [f64]; COLUMNS] =
                    columns.iter_mut().map(|c| &mut c[..]).collect::<Vec<_>>().try_into().unwrap();
                pass.respond(&mut lit, n, &changes, m, &mut slices);
                let responses: Vec<TubeResponse> =
                    positions.iter().map(|&x| model.response(travel, x, texel, n, m)).collect();
                let wanted = |r: &TubeResponse| {
                    let along = |v: [f64; 3], k: usize| dot(v, changes[k]);
                    [r.d, r.s, r.s_m, along(r.d_n, 0), along(r.s_n, 0), along(r.d_n, 1), along(r.s_n, 1)]
                };
                let peaks: [f64; COLUMNS] =
                    std::array::from_fn(|c| responses.iter().map(|r| wanted(r)[c].abs()).fold(1e-3, f64::max));
                for ((k, &x), r) in positions.iter().enumerate().zip(&responses) {
                    let t = travel.local([texel[0], texel[1], 0.0]);
                    let ends = [-250.0 - t[1], 250.0 - t[1]].map(|y| dot(travel.local(n), [x - t[0], y, 100.0]) > 0.0);
                    cut += usize::from(ends[0] != ends[1]);
                    for (c, want) in wanted(r).into_iter().enumerate() {
                        let got = columns[c][k];
                        // Derivatives only steer the solver, so one digit less is enough.
                        let bound = if c < 2 { 2e-5 } else { 2e-4 } * peaks[c];
                        assert!(
                            (got - want).abs() < bound,
                            "{lobe:?} {travel:?} tilt {b} {ty} m {m} at {x}, column {c}: {got} for {want}"
                        );
                    }
                }
            }
        }
    }
    assert!(cut > 500, "only {cut} frames were cut");
}

/// What one pass has filled is filled again for another pass, also at the same texel and with as many frames.
#[test]
fn passes_that_share_their_scratch_do_not_share_their_light() {
    let positions: Vec<f64> = (0..20).map(|k| -300.0 + 30.0 * f64::from(k)).collect();
    let model = TubeModel::new(TUBE, camera(), Lobe::Beckmann, &TubePrecision::default());
    let (n, texel) = (normal(0.1, 0.2), [5.0, 9.0]);
    let mut shared = TubeGeometry::default();
    for travel in [Travel::X, Travel::Y] {
        let pass = PassEvaluator::new(&model, travel, &positions, 8, InstructionSet::detect());
        let [common, own] = [&mut shared, &mut TubeGeometry::default()].map(|lit| {
            pass.light(texel, lit);
            let mut columns = vec![vec![0.0; pass.padded()]; COLUMNS];
            let mut slices: [&mut [f64]; COLUMNS] =
                columns.iter_mut().map(|c| &mut c[..]).collect::<Vec<_>>().try_into().unwrap();
            pass.respond(lit, n, &[], 0.3, &mut slices);
            columns
        });
        assert_eq!(common, own, "{travel:?}");
    }
}
