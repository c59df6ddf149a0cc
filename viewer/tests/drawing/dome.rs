//! A sky as harmonics. Where its integrals are known in closed form, the drawn radiance agrees with them.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::Renderer;
use mesophyll_viewer::scene::{Lobe, Scene, SkyDome};
use std::f64::consts::PI;

/// A dome with these coefficients. Its visible sky is a grey of radiance 0.25 above the horizon and `ground` below.
fn dome(harmonics: Vec<[f32; 3]>) -> SkyDome {
    // A = C = E = 0 makes both of Perez's factors 1. Y is 0.25, and x and y are those of equal energy.
    SkyDome {
        harmonics,
        picture: None,
        perez: [[0.0; 5]; 3],
        scale: [0.25, 0.75, 0.25],
        ground: Some([0.02, 0.03, 0.04]),
        sun: Vec3::new(0.6, 0.0, 0.8),
        strength: 1.0,
        turbidity: 3.0,
    }
}

fn glossy() -> Scene {
    let mut leaf = uniform_leaf();
    leaf.sides.front.gloss = Some(vec![[0.08, 0.06, 0.05, 0.3]; 64]);
    on_mesh(bent(10.0, 12, -0.02), leaf)
}

/// The harmonics of an even sky light a leaf exactly like the constant sky: diffuse, through the blade, and glossy.
#[test]
fn an_even_dome_is_the_constant_sky() {
    let Some(mut renderer) = renderer() else { return };
    let sky = [0.4f32, 0.5, 0.6];
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        for view in [Vec3::new(0.3, -0.5, 1.0), Vec3::new(-0.3, 0.4, -1.0)] {
            let mut scene = glossy();
            leaf(&mut scene, 0).lobe = lobe;
            let draw = |renderer: &mut Renderer, scene: &Scene| {
                renderer.set_scene(scene).unwrap();
                renderer.render(&camera(view, 80.0), 64, 48).unwrap().hdr
            };
            scene.sky = Some(sky);
            let constant = draw(&mut renderer, &scene);
            scene.sky = None;
            for bands in [1, 3, 7] {
                let mut harmonics = vec![[0.0; 3]; bands * bands];
                harmonics[0] = sky.map(|v| v * (4.0 * std::f32::consts::PI).sqrt());
                scene.dome = Some(dome(harmonics));
                let domed = draw(&mut renderer, &scene);
                let mut compared = 0;
                for (a, b) in domed.iter().zip(&constant).filter(|(_, b)| b[3] == 1.0) {
                    agree(
                        &format!("{lobe:?} {bands} bands"),
                        *a,
                        [b[0], b[1], b[2]].map(f64::from),
                        held(&renderer, 1e-5),
                    );
                    compared += 1;
                }
                assert!(compared > 300, "{compared}");
            }
        }
    }
}

/// L = 1 + a·ω gives the irradiance π + 2π/3 a·n in closed form, and through the blade that of the opposite normal.
#[test]
fn a_gradient_lights_both_sides_by_its_closed_form() {
    let Some(mut renderer) = renderer() else { return };
    let a: [f64; 3] = [0.3, -0.5, 0.6];
    let (c0, c1) = ((4.0 * PI).sqrt() as f32, (4.0 * PI / 3.0).sqrt());
    let harmonics = vec![[c0; 3], [(a[1] * c1) as f32; 3], [(a[2] * c1) as f32; 3], [(a[0] * c1) as f32; 3]];
    let mut scene = scene_of(uniform_leaf());
    scene.dome = Some(dome(harmonics));
    for (towards, rho_d, rho_t) in [(1.0, RHO_D, BACK_T), (-1.0, BACK_D, RHO_T)] {
        for tilt in [0.0f32, 0.5, 1.2] {
            let turn = glam::Quat::from_rotation_x(tilt) * glam::Quat::from_rotation_z(0.4);
            scene.instances[0].transform = glam::Mat4::from_quat(turn);
            let normal = turn * Vec3::Z;
            renderer.set_scene(&scene).unwrap();
            let picture = renderer.render(&camera(normal * towards, 80.0), 16, 16).unwrap();
            let cosine = dot(a, wide(normal)) * f64::from(towards);
            let want = [0, 1, 2].map(|c| {
                f64::from(rho_d[c]) * (1.0 + 2.0 / 3.0 * cosine) + f64::from(rho_t[c]) * (1.0 - 2.0 / 3.0 * cosine)
            });
            agree(&format!("side {towards}, tilt {tilt}"), picture.hdr[8 * 16 + 8], want, held(&renderer, 2e-5));
        }
    }
}

/// The reflection of a linear sky equals an integral by brute force over the lobe as the papers write it: Beckmann's
/// density (Wang et al. 2005, Eq. 7) and the V-cavities of Cook and Torrance 1982. The integral uses no code of the
/// renderer. Two bands about the lobe's mean direction are exact.
#[test]
fn the_gloss_of_a_gradient_is_its_integral() {
    let Some(mut renderer) = renderer() else { return };
    let a: [f64; 3] = [0.4, 0.2, 0.5];
    let (c0, c1) = ((4.0 * PI).sqrt() as f32, (4.0 * PI / 3.0).sqrt());
    let mut leaf = uniform_leaf();
    let (rho_s, m) = (0.3f32, 0.35f32);
    for side in [&mut leaf.sides.front, &mut leaf.sides.back] {
        side.gamma_delta.iter_mut().for_each(|t| t[..3].fill(0.0));
        if let mesophyll_viewer::scene::Interior::Scalars(curve) = &mut side.interior {
            curve.rho_t.iter_mut().for_each(|t| *t = [0.0; 3]);
        }
    }
    leaf.sides.front.gloss = Some(vec![[rho_s, rho_s, rho_s, m]; 64]);
    let mut scene = scene_of(leaf);
    scene.dome = Some(dome(vec![[c0; 3], [(a[1] * c1) as f32; 3], [(a[2] * c1) as f32; 3], [(a[0] * c1) as f32; 3]]));
    renderer.set_scene(&scene).unwrap();
    for view in [Vec3::new(0.1, 0.0, 1.0), Vec3::new(-0.7, 0.4, 1.0), Vec3::new(1.0, 1.0, 0.6)] {
        let picture = renderer.render(&camera(view, 400.0), 9, 9).unwrap();
        let v = unit(wide(view));
        // Directions of light on a grid that is even in cosθ and in azimuth.
        let (rings, spokes) = (300, 600);
        let mut sum = 0.0;
        for i in 0..rings {
            let nl = (f64::from(i) + 0.5) / f64::from(rings);
            for k in 0..spokes {
                let phi = 2.0 * PI * (f64::from(k) + 0.5) / f64::from(spokes);
                let s = (1.0 - nl * nl).sqrt();
                let l = [s * phi.cos(), s * phi.sin(), nl];
                let h = unit([l[0] + v[0], l[1] + v[1], l[2] + v[2]]);
                let vh = dot(v, h);
                let (cos2, m2) = (h[2] * h[2], f64::from(m * m));
                let density = (-(1.0 / cos2 - 1.0) / m2).exp() / (PI * m2 * cos2 * cos2);
                let cavity = (2.0 * h[2] * v[2] / vh).min(2.0 * h[2] * nl / vh).min(1.0);
                let f = density * cavity / (4.0 * nl * v[2]);
                sum += f * nl * (1.0 + dot(a, l)) * 2.0 * PI / f64::from(rings * spokes);
            }
        }
        agree(&format!("{view}"), picture.hdr[4 * 9 + 4], [f64::from(rho_s) * sum; 3], 3e-3);
    }
}

/// The real harmonic Y_lm of a unit direction, from Rodrigues' formula: (1 − z²)^(m/2) times the (l+m)-th derivative of
/// (z² − 1)^l, term by term. It shares no recurrence with the renderer.
fn harmonic(l: usize, m: isize, d: [f64; 3]) -> f64 {
    let a = m.unsigned_abs();
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    let term = |k: usize| {
        // (−1)^k binomial(l, k) z^(2l − 2k), of which l + m derivatives are left where the power is high enough.
        let power = 2 * l - 2 * k;
        let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let choose = factorial(l) / (factorial(k) * factorial(l - k));
        if power < l + a {
            return 0.0;
        }
        sign * choose * factorial(power) / factorial(power - l - a) * d[2].powi((power - l - a) as i32)
    };
    let polynomial = (0..=l).map(term).sum::<f64>() / (2f64.powi(l as i32) * factorial(l));
    let two = if a == 0 { 1.0 } else { 2.0 };
    let norm = (two * (2 * l + 1) as f64 / (4.0 * PI) * factorial(l - a) / factorial(l + a)).sqrt();
    let azimuth = d[1].atan2(d[0]) * a as f64;
    let turn = if m < 0 { azimuth.sin() } else { azimuth.cos() };
    norm * polynomial * (1.0 - d[2] * d[2]).max(0.0).sqrt().powi(a as i32) * turn
}

/// Every band of a sky, from the first to the last, lights a leaf as an integral over the sky itself says. The
/// irradiance is integrated over both hemispheres. The gloss is seen along the normal, where its lobe is round, so
/// that the bands about its mean direction are exact: it is integrated over Beckmann's density (Wang et al. 2005, Eq.
/// 7) with the V-cavities of Cook and Torrance 1982.
#[test]
fn every_band_lights_a_leaf_as_its_integral_says() {
    let Some(mut renderer) = renderer() else { return };
    let (rho_s, m, tolerance) = (0.3f64, 0.15f64, 1e-4);
    let mut both = uniform_leaf();
    both.sides.front.gloss = Some(vec![[rho_s as f32, rho_s as f32, rho_s as f32, m as f32]; 64]);
    for band in 1..=6usize {
        // Coefficients of all orders, so that no order can stand for another one.
        let of = |k: usize| 0.5 * (1.7 * (k * k + 3 * k + 5 * band) as f64).sin();
        let harmonics: Vec<[f32; 3]> = (0..49)
            .map(|k| match k {
                0 => [(4.0 * PI).sqrt() as f32; 3],
                _ if (band * band..(band + 1) * (band + 1)).contains(&k) => [of(k) as f32; 3],
                _ => [0.0; 3],
            })
            .collect();
        let given = |k: usize| f64::from(harmonics[k][0]);
        let sky = |d: [f64; 3]| {
            let one = |k: usize| given(band * band + k) * harmonic(band, k as isize - band as isize, d);
            1.0 + (0..=2 * band).map(one).sum::<f64>()
        };
        let mut scene = scene_of(both.clone());
        scene.dome = Some(dome(harmonics.clone()));
        // The largest share of the band in the diffuse and in the glossy light.
        let mut most = [0.0f64; 2];
        for (tilt, turn) in [(0.0f32, 0.0f32), (0.6, 0.4), (1.3, -2.1)] {
            let q = glam::Quat::from_rotation_z(turn) * glam::Quat::from_rotation_x(tilt);
            scene.instances[0].transform = glam::Mat4::from_quat(q);
            let axes = [q * Vec3::X, q * Vec3::Y, q * Vec3::Z].map(wide);
            let (mut above, mut below, mut gloss, mut albedo) = (0.0, 0.0, 0.0, 0.0);
            // The sky has degree 6 in azimuth, for which 16 spokes are exact. Midpoints along the cosine have an error
            // below 1e-5.
            let (rings, spokes) = (1000, 16);
            for i in 0..rings {
                let z = (f64::from(i) + 0.5) / f64::from(rings);
                let s = (1.0 - z * z).sqrt();
                let h2 = 0.5 * (1.0 + z);
                let density = (-(1.0 / h2 - 1.0) / (m * m)).exp() / (PI * m * m * h2 * h2);
                // Along the normal, N·H = V·H, and the cavities are 2 (N·H)(N·L)/(V·H) or 1.
                let lobe = density * (2.0 * z).min(1.0) / (4.0 * z);
                for k in 0..spokes {
                    let phi = 2.0 * PI * (f64::from(k) + 0.5) / f64::from(spokes);
                    let [x, y] = [s * phi.cos(), s * phi.sin()];
                    let d = |z: f64| std::array::from_fn(|c| x * axes[0][c] + y * axes[1][c] + z * axes[2][c]);
                    let share = 2.0 * PI / f64::from(rings * spokes);
                    let light = sky(d(z));
                    above += light * z * share / PI;
                    below += sky(d(-z)) * z * share / PI;
                    gloss += light * z * lobe * share;
                    albedo += z * lobe * share;
                }
            }
            renderer.set_scene(&scene).unwrap();
            let picture = renderer.render(&camera(q * Vec3::Z, 400.0), 9, 9).unwrap();
            let want = [0, 1, 2].map(|c| f64::from(RHO_D[c]) * above + f64::from(BACK_T[c]) * below + rho_s * gloss);
            let what = format!("band {band}, tilt {tilt}: above {above:.4}, below {below:.4}, gloss {gloss:.4}");
            println!("{what}, drawn {:?}, expected {want:?}", picture.hdr[4 * 9 + 4]);
            agree(&what, picture.hdr[4 * 9 + 4], want, held(&renderer, tolerance));
            let diffuse = [0, 1, 2].map(|c| f64::from(RHO_D[c]) * (above - 1.0) + f64::from(BACK_T[c]) * (below - 1.0));
            most[0] = most[0].max(diffuse[1].abs() / want[1]);
            most[1] = most[1].max(rho_s * (gloss - albedo).abs() / want[1]);
        }
        // A band that was missing or wrong would be seen. A cosine has nothing of the odd bands above the first.
        assert!(most[1] > 20.0 * tolerance, "band {band}: {most:?}");
        assert!(band == 3 || band == 5 || most[0] > 10.0 * tolerance, "band {band}: {most:?}");
    }
}

/// Above the horizon the sky is seen, and below it the ground. The sun's disk is at the sun's place. None of this
/// counts as a leaf.
#[test]
fn the_sky_is_drawn_behind_the_leaves() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    let dome = dome(vec![[1.0; 3]]);
    scene.sun = Some(sun(dome.sun));
    scene.dome = Some(dome.clone());
    renderer.set_scene(&scene).unwrap();
    assert!(renderer.stats().pipelines.iter().any(|p| p == "sky") && renderer.stats().uploaded("sky harmonics"));
    let mut look = |ahead: Vec3| {
        let eye = Vec3::new(0.0, 0.0, 50.0);
        let camera = mesophyll_viewer::scene::Camera { eye, target: eye + ahead, up: Vec3::Y, fov_y_deg: 4.0 };
        renderer.render(&camera, 9, 9).unwrap().hdr[4 * 9 + 4]
    };
    let up = look(Vec3::new(-0.3, 0.2, 0.9));
    // Equal energy with a luminance of 1/4, in linear sRGB.
    let white =
        [3.2404542 - 1.5371385 - 0.4985314, -0.969266 + 1.8760108 + 0.041556, 0.0556434 - 0.2040259 + 1.0572252];
    agree("sky", up, white.map(|v: f64| 0.25 * v), 2e-3);
    assert_eq!(up[3], 0.0);
    agree("ground", look(Vec3::new(1.0, 0.3, -0.1)), [0.02, 0.03, 0.04], 2e-3);
    assert!(look(dome.sun)[0] > 1e4, "no sun");
    // Without a dome, neither the pass nor the coefficients exist.
    scene.dome = None;
    renderer.set_scene(&scene).unwrap();
    assert!(!renderer.stats().pipelines.iter().any(|p| p == "sky") && !renderer.stats().uploaded("sky"));
}

/// A dome that contradicts itself is refused by name.
#[test]
fn a_wrong_dome_is_refused() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    scene.dome = Some(dome(vec![[1.0; 3]; 5]));
    assert!(renderer.set_scene(&scene).unwrap_err().to_string().contains("5 coefficients"));
    scene.dome = Some(dome(vec![[1.0; 3]; 4]));
    scene.sky = Some([1.0; 3]);
    assert!(renderer.set_scene(&scene).unwrap_err().to_string().contains("one of the two"));
}
