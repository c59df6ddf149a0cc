//! A curved leaf with maps on both sides agrees pixel by pixel with the formulas of `scene.rs` in f64. Ray casting,
//! interpolation and optics are written again for this test.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::scene::{Camera, Interior, LeafMaterial, Lobe, Scene, SideMaps};
use std::f64::consts::PI;

type V = [f64; 3];

fn add(a: V, b: V, s: f64) -> V {
    std::array::from_fn(|i| a[i] + s * b[i])
}

/// Maps that are smooth, and different on both sides.
fn mapped_leaf(lobe: Lobe) -> LeafMaterial {
    let mut leaf = uniform_leaf();
    (leaf.width, leaf.height) = (24, 16);
    leaf.lobe = lobe;
    let wave = |k: usize, a: f32, b: f32| ((k % 24) as f32 * a).sin() * ((k / 24) as f32 * b).cos();
    for (side, s) in [(&mut leaf.sides.front, 1.0f32), (&mut leaf.sides.back, 1.7)] {
        side.gamma_delta = (0..384)
            .map(|k| {
                [
                    1.0 + 0.3 * wave(k, 0.4 * s, 0.3),
                    1.0,
                    1.0 - 0.2 * wave(k, 0.2, 0.5 * s),
                    0.04 * wave(k, 0.3, 0.6 * s),
                ]
            })
            .collect();
        let g = |k| 0.05 + 0.02 * wave(k, 0.5 * s, 0.2);
        side.gloss = Some((0..384).map(|k| [g(k), g(k), 0.04, 0.3 + 0.1 * wave(k, 0.1, 0.4 * s)]).collect());
        let normal = |k| Vec3::new(0.2 * wave(k, 0.35, 0.25 * s), 0.15 * wave(k, 0.3 * s, 0.45), 1.0).normalize();
        side.normal = Some((0..384).map(|k| normal(k).to_array()).collect());
    }
    leaf
}

fn bilinear<const N: usize>(leaf: &LeafMaterial, map: &[[f32; N]], u: f64, v: f64) -> [f64; N] {
    let (w, h) = (leaf.width as usize, leaf.height as usize);
    let place = |x: f64, n: usize| {
        let x = (x * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
        let i = (x as usize).min(n - 2);
        (i, x - i as f64)
    };
    let ((i, s), (j, t)) = (place(u, w), place(v, h));
    let at = |i: usize, j: usize, c: usize| f64::from(map[j * w + i][c]);
    std::array::from_fn(|c| {
        (at(i, j, c) * (1.0 - s) + at(i + 1, j, c) * s) * (1.0 - t)
            + (at(i, j + 1, c) * (1.0 - s) + at(i + 1, j + 1, c) * s) * t
    })
}

/// ρd with γ, and ρt, of a side at the front's (u, v).
fn interior(leaf: &LeafMaterial, side: &SideMaps, u: f64, v: f64) -> (V, V) {
    let gd = bilinear(leaf, &side.gamma_delta, u, v);
    let Interior::Scalars(c) = &side.interior else { panic!("curves here") };
    let n = c.rho_d.len() - 1;
    let h = f64::from(leaf.thickness_mm) + gd[3];
    let x = ((h - f64::from(c.min_mm)) / f64::from(c.max_mm - c.min_mm) * n as f64).clamp(0.0, n as f64);
    let i = (x as usize).min(n - 1);
    let on = |curve: &[[f32; 3]], k: usize| {
        f64::from(curve[i][k]) * (1.0 - (x - i as f64)) + f64::from(curve[i + 1][k]) * (x - i as f64)
    };
    (std::array::from_fn(|k| gd[k] * on(&c.rho_d, k)), std::array::from_fn(|k| on(&c.rho_t, k)))
}

fn lobe(kind: Lobe, n: V, l: V, v: V, m: f64) -> f64 {
    let h = unit(add(l, v, 1.0));
    let (nh, nl, nv, vh) = (dot(n, h), dot(n, l), dot(n, v).max(1e-3), dot(v, h));
    if nh <= 0.0 || nl <= 0.0 {
        return 0.0;
    }
    let tan2 = 1.0 / (nh * nh) - 1.0;
    let d = match kind {
        Lobe::Ggx => m * m / (PI * nh.powi(4) * (m * m + tan2).powi(2)),
        _ => (-tan2 / (m * m)).exp() / (PI * m * m * nh.powi(4)),
    };
    let f = if let Lobe::CookTorrance { index } = kind { fresnel(vh, index) } else { 1.0 };
    d * f * 1f64.min(2.0 * nh * nv / vh).min(2.0 * nh * nl / vh) / (4.0 * nl * nv)
}

fn fresnel(c: f64, n: f64) -> f64 {
    let g = (n * n + c * c - 1.0).sqrt();
    0.5 * ((g - c) / (g + c)).powi(2) * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)).powi(2))
}

/// Directional albedo by a product rule over light directions, with cosθ = s⁴ and φ = π(1 − t²). It is dense where
/// grazing views reflect.
fn albedo(kind: Lobe, nv: f64, m: f64) -> f64 {
    let nv = nv.max(1e-3);
    let v = [(1.0 - nv * nv).sqrt(), 0.0, nv];
    let n = 72;
    let mut sum = 0.0;
    for i in 0..n {
        for k in 0..n {
            let (s, t) = ((i as f64 + 0.5) / n as f64, (k as f64 + 0.5) / n as f64);
            let (nl, phi) = (s.powi(4), PI * (1.0 - t * t));
            let sin = (1.0 - nl * nl).sqrt();
            sum += lobe(kind, [0.0, 0.0, 1.0], [sin * phi.cos(), sin * phi.sin(), nl], v, m) * nl * s.powi(3) * t;
        }
    }
    16.0 * PI * sum / (n * n) as f64
}

/// Radiance at a pixel, or `None` off the leaf.
fn expected(scene: &Scene, camera: &Camera, size: (u32, u32), pixel: (u32, u32)) -> Option<V> {
    let (leaf, mesh) = (scene.leaf(0).expect("a leaf"), &scene.meshes[0]);
    let eye = wide(camera.eye);
    // `seen_point` lies on the pixel's ray, which is sufficient here.
    let ray = unit(sub(seen_point(camera, size.0, size.1, pixel.0, pixel.1), eye));
    let mut best: Option<(f64, [f64; 3], [usize; 3])> = None;
    for t in mesh.indices.chunks(3) {
        let k = [t[0] as usize, t[1] as usize, t[2] as usize];
        let [a, b, c] = k.map(|i| wide(mesh.positions[i]));
        let (e, f) = (sub(b, a), sub(c, a));
        let p = cross(ray, f);
        let det = dot(e, p);
        let s = sub(eye, a);
        let (u, q) = (dot(s, p) / det, cross(s, e));
        let (v, distance) = (dot(ray, q) / det, dot(f, q) / det);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0 && best.is_none_or(|(d, _, _)| distance < d) {
            best = Some((distance, [1.0 - u - v, u, v], k));
        }
    }
    let (distance, weights, k) = best?;
    let mix = |f: &dyn Fn(usize) -> V| (0..3).fold([0.0; 3], |sum, i| add(sum, f(k[i]), weights[i]));
    let n = unit(mix(&|i| wide(mesh.normals[i])));
    let t = mix(&|i| wide(mesh.tangents[i].truncate()));
    let t = unit(add(t, n, -dot(t, n)));
    let b = cross(n, t);
    let uv = mix(&|i| [f64::from(mesh.uvs[i].x), f64::from(mesh.uvs[i].y), 0.0]);
    let (fu, bu, v) = (uv[0], 1.0 - uv[0], uv[1]);
    let view = unit(sub(eye, add(eye, ray, distance)));
    let front = dot(n, view) > 0.0;
    let mapped = |side: &SideMaps, u: f64, sign: f64| {
        let m = side.normal.as_ref().map_or([0.0, 0.0, 1.0], |map| bilinear(leaf, map, u, v));
        unit(std::array::from_fn(|c| sign * m[0] * t[c] + m[1] * b[c] + sign * m[2] * n[c]))
    };
    let (near, near_u, far, far_u) = if front {
        (&leaf.sides.front, fu, &leaf.sides.back, bu)
    } else {
        (&leaf.sides.back, bu, &leaf.sides.front, fu)
    };
    let sign = if front { 1.0 } else { -1.0 };
    let (rho_d, _) = interior(leaf, near, near_u, v);
    let (_, rho_t) = interior(leaf, far, far_u, v);
    let normal = mapped(near, near_u, sign);
    let gloss = near.gloss.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |g| bilinear(leaf, g, near_u, v));
    let mut out = [0.0; 3];
    if let Some(sky) = scene.sky {
        let a = albedo(leaf.lobe, dot(normal, view), gloss[3]);
        out = std::array::from_fn(|c| f64::from(sky[c]) * (rho_d[c] + rho_t[c] + gloss[c] * a));
    }
    if let Some(sun) = scene.sun {
        let l = wide(sun.direction);
        let lit = sign * dot(n, l) > 0.0;
        for c in 0..3 {
            out[c] += f64::from(sun.irradiance[c])
                * if lit {
                    dot(normal, l).max(0.0) * (rho_d[c] / PI + gloss[c] * lobe(leaf.lobe, normal, l, view, gloss[3]))
                } else {
                    dot(mapped(far, far_u, -sign), l).max(0.0) * rho_t[c] / PI
                };
        }
    }
    Some(out)
}

fn tone(x: f64) -> f64 {
    let x = x / (1.0 + x);
    if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

#[test]
fn every_inner_pixel_meets_the_formulas() {
    let Some(mut renderer) = renderer() else { return };
    // The size avoids minified maps, which the renderer averages and a single ray does not.
    let size = (320, 240);
    for (kind, light, eye) in [
        (Lobe::Beckmann, Vec3::new(-0.6, 0.2, 1.0), Vec3::new(0.5, -0.4, 1.0)),
        (Lobe::Ggx, Vec3::new(-0.8, 0.3, -0.5), Vec3::new(0.9, 0.3, -0.7)),
        (Lobe::CookTorrance { index: 1.45 }, Vec3::new(0.3, 0.5, -1.0), Vec3::new(0.2, -0.6, 0.6)),
    ] {
        let mut scene = on_mesh(bent(10.0, 16, 0.03), mapped_leaf(kind));
        scene.sun = Some(sun(light));
        scene.sky = Some([0.5, 0.6, 0.8]);
        let camera = Camera { fov_y_deg: 24.0, ..camera(eye, 45.0) };
        renderer.set_scene(&scene).expect("scene");
        let picture = renderer.render(&camera, size.0, size.1).expect("picture");
        let (mut worst, mut compared) = (0.0f64, 0);
        for y in (1..size.1 - 1).step_by(6) {
            for x in (1..size.0 - 1).step_by(6) {
                let inner = (y - 1..=y + 1).all(|y| (x - 1..=x + 1).all(|x| picture.radiance(x, y)[3] == 1.0));
                if let (true, Some(want)) = (inner, expected(&scene, &camera, size, (x, y))) {
                    let got = picture.radiance(x, y);
                    worst = (0..3).map(|c| (tone(f64::from(got[c])) - tone(want[c])).abs()).fold(worst, f64::max);
                    compared += 1;
                }
            }
        }
        println!("{kind:?}: largest difference {worst:.5} over {compared} pixels");
        // Filters may store their weights in steps of 1/256, and 16-bit maps have three digits.
        assert!(compared > 500 && worst < 0.004, "{kind:?}: {worst} over {compared} pixels");
    }
}
