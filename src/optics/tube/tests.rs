use super::*;
use crate::optics::gloss::dot;

/// The cylinder's integral written down afresh: directions of the plane of travel across the tube, points along it, f_s from
/// its own definition.
#[allow(clippy::too_many_arguments)]
fn brute(
    tube: Tube,
    camera: [f64; 3],
    lobe: Lobe,
    travel: Travel,
    light: f64,
    texel: [f64; 2],
    n: [f64; 3],
    m: f64,
    cells: usize,
) -> [f64; 2] {
    let t = travel.local([texel[0], texel[1], 0.0]);
    let x = light - t[0];
    let distance = (x * x + tube.height_mm * tube.height_mm).sqrt();
    let theta = (x / tube.height_mm).atan();
    let beta = (tube.radius_mm / distance).asin();
    let across: usize = if tube.radius_mm > 0.0 { 16 } else { 1 };
    let simpson = |k: usize, n: usize| {
        (if k == 0 || k == n {
            1.0
        } else if k % 2 == 1 {
            4.0
        } else {
            2.0
        }) / (3.0 * n as f64)
    };
    let (mut d, mut s) = (0.0, 0.0);
    for i in 0..=across {
        let th = theta + beta * (2.0 * i as f64 / across as f64 - 1.0);
        let share = if across == 1 { 0.5 } else { simpson(i, across) };
        // The lit length ends on the cylinder's surface, met at this distance in the plane across.
        let (sin, cos) = (th - theta).sin_cos();
        let surface = distance * cos - (tube.radius_mm.powi(2) - (distance * sin).powi(2)).max(0.0).sqrt();
        let lo = ((-0.5 * tube.length_mm - t[1]) / surface).atan();
        let hi = ((0.5 * tube.length_mm - t[1]) / surface).atan();
        for k in 0..=cells {
            let phi = lo + (hi - lo) * k as f64 / cells as f64;
            let l = travel.local([th.sin() * phi.cos(), phi.sin(), th.cos() * phi.cos()]);
            let cos = dot(n, l);
            if cos <= 0.0 {
                continue;
            }
            // radiance × solid angle over (white's E/π): E0 = π a L0/H, dω = cosφ dφ dθ
            let dtheta = if tube.radius_mm > 0.0 { 2.0 * beta / tube.radius_mm } else { 2.0 / distance } * share;
            let w = tube.height_mm * dtheta * phi.cos() * (hi - lo) * simpson(k, cells) * cos;
            d += w / std::f64::consts::PI;
            s += w * lobe.value(n, l, camera, m);
        }
    }
    [d, s]
}

const TUBE: Tube = Tube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 };

fn camera() -> [f64; 3] {
    let c = 55f64.to_radians();
    [c.sin(), 0.0, c.cos()]
}

fn normal(b: f64, ty: f64) -> [f64; 3] {
    [b.sin() * ty.cos(), ty.sin(), b.cos() * ty.cos()]
}

/// Worst error over a trace, in units of the trace's peak.
fn worst(model: &Model, travel: Travel, texel: [f64; 2], n: [f64; 3], m: f64) -> [f64; 2] {
    let (mut err, mut peak) = ([0.0f64; 2], [0.0f64; 2]);
    for k in 0..26 {
        let light = -400.0 + 26.0 * k as f64;
        let r = model.response(travel, light, texel, n, m);
        let [d, s] = brute(model.tube, model.camera, model.lobe, travel, light, texel, n, m, 1000);
        for (j, (got, want)) in [(r.d, d), (r.s, s)].into_iter().enumerate() {
            err[j] = err[j].max((got - want).abs());
            peak[j] = peak[j].max(want);
        }
    }
    [err[0] / peak[0], err[1] / peak[1]]
}

#[test]
fn agrees_with_brute_force() {
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        let model = Model::new(TUBE, camera(), lobe, &Precision::default());
        for m in [0.02, 0.07, 0.2, 0.45, 0.9] {
            for (texel, n) in [([0.0, 0.0], normal(0.0, 0.0)), ([30.0, -25.0], normal(0.12, 0.1)), ([-30.0, 20.0], normal(-0.25, 0.4))] {
                for travel in [Travel::X, Travel::Y] {
                    let e = worst(&model, travel, texel, n, m);
                    println!("{lobe:?} m {m} {travel:?} {n:.2?}: D {:.1e} S {:.1e}", e[0], e[1]);
                }
            }
        }
    }
}

/// The vectorised pass against the plain evaluation with many nodes, every instruction set of this processor.
#[test]
fn fast_agrees_with_the_reference() {
    use super::fast::{COLUMNS, Lit, Pass};
    use super::lanes::Level;
    let positions: Vec<f64> = (0..100).map(|k| -400.0 + 650.0 * f64::from(k) / 99.0).collect();
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        let fine = Model::new(TUBE, camera(), lobe, &Precision::fine());
        let model = Model::new(TUBE, camera(), lobe, &Precision::default());
        for m in [0.02, 0.05, 0.12, 0.3, 0.6, 0.9] {
            for (texel, b, ty) in [([0.0, 0.0], 0.0, 0.0), ([0.0, 12.0], 0.1, 0.0), ([30.0, -25.0], 0.12, 0.1), ([-30.0, 20.0], -0.25, 0.4)]
            {
                for travel in [Travel::X, Travel::Y] {
                    let (n, [nb, ny]) = (
                        normal(b, ty),
                        [[b.cos() * ty.cos(), 0.0, -b.sin() * ty.cos()], [-b.sin() * ty.sin(), ty.cos(), -b.cos() * ty.sin()]],
                    );
                    let mut want: Vec<[f64; COLUMNS]> = Vec::new();
                    for &x in &positions {
                        let r = fine.response(travel, x, texel, n, m);
                        want.push([r.d, r.s, r.s_m, dot(r.d_n, nb), dot(r.s_n, nb), dot(r.d_n, ny), dot(r.s_n, ny)]);
                    }
                    let peak: [f64; COLUMNS] = std::array::from_fn(|c| want.iter().map(|w| w[c].abs()).fold(1e-9, f64::max));
                    for level in Level::available() {
                        let pass = Pass::new(&model, travel, &positions, Precision::default().along, level);
                        let mut lit = Lit::default();
                        pass.light(texel, &mut lit);
                        let mut columns = vec![vec![f64::NAN; pass.padded()]; COLUMNS];
                        let changes: &[[f64; 3]] = if ty == 0.0 && travel == Travel::X { &[nb] } else { &[nb, ny] };
                        let mut slices: [&mut [f64]; COLUMNS] =
                            columns.iter_mut().map(|c| &mut c[..]).collect::<Vec<_>>().try_into().unwrap();
                        pass.respond(&mut lit, n, changes, m, &mut slices);
                        for c in 0..3 + 2 * changes.len() {
                            let worst = (0..100).map(|k| (columns[c][k] - want[k][c]).abs()).fold(0.0, f64::max) / peak[c];
                            if !(worst < 1e-5) {
                                println!("{lobe:?} {level:?} m {m} {travel:?} b {b} ty {ty} column {c}: {worst:.1e}");
                            }
                        }
                    }
                }
            }
        }
    }
}
