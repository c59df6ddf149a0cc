//! The radiance of a flat uniform leaf agrees with closed forms.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::scene::{Camera, Interior, Lobe, Scene};
use mesophyll_viewer::{Backend, Error, Options, Renderer};
use std::f64::consts::PI;

const FROM_FRONT: Vec3 = Vec3::new(0.3, -0.2, 1.0);
const FROM_BACK: Vec3 = Vec3::new(0.3, -0.2, -1.0);

fn middle(renderer: &mut Renderer, scene: &Scene, camera: &Camera) -> [f32; 4] {
    renderer.set_scene(scene).expect("scene");
    renderer.render(camera, 33, 33).expect("picture").radiance(16, 16)
}

fn wide3(c: [f32; 3]) -> [f64; 3] {
    c.map(f64::from)
}

#[test]
fn sun_alone_on_either_side() {
    let Some(mut renderer) = renderer() else { return };
    let direction = Vec3::new(0.4, 0.5, 0.8);
    for (view, light, rho, name) in [
        (FROM_FRONT, direction, RHO_D, "front lit, front seen"),
        (FROM_BACK, -direction, BACK_D, "back lit, back seen"),
        (FROM_BACK, direction, RHO_T, "front lit, back seen: the front's transmittance"),
        (FROM_FRONT, -direction, BACK_T, "back lit, front seen: the back's transmittance"),
    ] {
        let mut scene = scene_of(uniform_leaf());
        let sun = sun(light);
        scene.sun = Some(sun);
        let cosine = f64::from(sun.direction.z.abs());
        let want = std::array::from_fn(|c| f64::from(rho[c]) * f64::from(sun.irradiance[c]) * cosine / PI);
        let seen = middle(&mut renderer, &scene, &camera(view, 100.0));
        agree(name, seen, want, held(&renderer, 1e-5));
    }
}

#[test]
fn sky_alone_adds_what_both_sides_send() {
    let Some(mut renderer) = renderer() else { return };
    let sky = [0.7f32, 0.9, 1.3];
    for (view, d, t) in [(FROM_FRONT, RHO_D, BACK_T), (FROM_BACK, BACK_D, RHO_T)] {
        let mut scene = scene_of(uniform_leaf());
        scene.sky = Some(sky);
        let want = std::array::from_fn(|c| f64::from(sky[c]) * (f64::from(d[c]) + f64::from(t[c])));
        let seen = middle(&mut renderer, &scene, &camera(view, 100.0));
        agree("sky", seen, want, held(&renderer, 1e-5));
    }
}

#[test]
fn thickness_moves_along_the_slab_curve() {
    let Some(mut renderer) = renderer() else { return };
    let mut leaf = uniform_leaf();
    // h + δ lies halfway between the middle point and the thick end, and γ is applied: 1.1 of ρd, 0.75 of ρt.
    leaf.sides.front.gamma_delta.fill([1.5, 1.0, 0.5, 0.05]);
    let mut scene = scene_of(leaf);
    scene.sky = Some([1.0; 3]);
    let seen = middle(&mut renderer, &scene, &camera(FROM_FRONT, 100.0));
    let gamma = [1.5, 1.0, 0.5];
    let want = std::array::from_fn(|c| gamma[c] * 1.1 * f64::from(RHO_D[c]) + f64::from(BACK_T[c]));
    agree("front", seen, want, held(&renderer, 1e-5));
    let seen = middle(&mut renderer, &scene, &camera(FROM_BACK, 100.0));
    agree(
        "back",
        seen,
        std::array::from_fn(|c| f64::from(BACK_D[c]) + 0.75 * f64::from(RHO_T[c])),
        held(&renderer, 1e-5),
    );
}

#[test]
fn pigment_maps_replace_the_curve_and_gamma() {
    let Some(mut renderer) = renderer() else { return };
    let mut leaf = uniform_leaf();
    leaf.sides.front.gamma_delta.fill([9.0, 9.0, 9.0, 9.0]);
    leaf.sides.front.interior = Interior::Maps { rho_d: vec![RHO_D; 64], rho_t: vec![RHO_T; 64] };
    let mut scene = scene_of(leaf);
    scene.sky = Some([1.0; 3]);
    let seen = middle(&mut renderer, &scene, &camera(FROM_FRONT, 100.0));
    agree("maps", seen, std::array::from_fn(|c| f64::from(RHO_D[c]) + f64::from(BACK_T[c])), held(&renderer, 1e-5));
    assert!(!renderer.stats().uploaded("front gamma_delta"));
}

/// f_s for ρs = 1, written again in f64 from the formula of `scene.rs`, not from the shader's form of it.
fn lobe(kind: Lobe, n: [f64; 3], l: [f64; 3], v: [f64; 3], m: f64) -> f64 {
    let h = unit(std::array::from_fn(|i| l[i] + v[i]));
    let (nh, nl, nv, vh) = (dot(n, h), dot(n, l), dot(n, v).max(1e-3), dot(v, h));
    let alpha = nh.acos();
    let d = match kind {
        Lobe::Ggx => m * m / (PI * alpha.cos().powi(4) * (m * m + alpha.tan().powi(2)).powi(2)),
        _ => (-alpha.tan().powi(2) / (m * m)).exp() / (PI * m * m * alpha.cos().powi(4)),
    };
    let g = 1f64.min(2.0 * nh * nv / vh).min(2.0 * nh * nl / vh);
    let f = match kind {
        Lobe::CookTorrance { index } => {
            let n = index;
            let g = (n * n + vh * vh - 1.0).sqrt();
            0.5 * ((g - vh) / (g + vh)).powi(2) * (1.0 + ((vh * (g + vh) - 1.0) / (vh * (g - vh) + 1.0)).powi(2))
        }
        _ => 1.0,
    };
    d * g * f / (4.0 * nl * nv)
}

#[test]
fn gloss_of_every_lobe_at_several_geometries() {
    let Some(mut renderer) = renderer() else { return };
    let (width, height) = (40, 30);
    for kind in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        for (light, view, m) in [
            (Vec3::new(-0.5, 0.0, 1.0), Vec3::new(0.5, 0.05, 1.0), 0.1),
            (Vec3::new(-1.0, 0.4, 0.5), Vec3::new(1.0, -0.3, 0.4), 0.3),
            (Vec3::new(-1.0, 0.0, 0.2), Vec3::new(1.0, 0.0, 0.15), 0.5),
            (Vec3::new(0.2, 0.1, 1.0), Vec3::new(0.1, 0.1, -1.0), 0.2),
        ] {
            let mut leaf = uniform_leaf();
            leaf.lobe = kind;
            leaf.sides.front.gloss = Some(vec![[0.05, 0.04, 0.03, m]; 64]);
            let mut scene = scene_of(leaf);
            let sun = sun(light);
            scene.sun = Some(sun);
            let camera = camera(view, 40.0);
            renderer.set_scene(&scene).expect("scene");
            let picture = renderer.render(&camera, width, height).expect("picture");
            for (x, y) in [(20, 15), (15, 12), (25, 17)] {
                let point = seen_point(&camera, width, height, x, y);
                let (l, v) = (unit(wide(sun.direction)), unit(sub(wide(camera.eye), point)));
                let want = if view.z > 0.0 {
                    let f = lobe(kind, [0.0, 0.0, 1.0], l, v, f64::from(m));
                    let rho_s = [0.05, 0.04, 0.03];
                    std::array::from_fn(|c| {
                        f64::from(sun.irradiance[c]) * l[2] * (f64::from(RHO_D[c]) / PI + rho_s[c] * f)
                    })
                } else {
                    // Seen from the matte back there is no gloss, only the light that the front transmits.
                    std::array::from_fn(|c| f64::from(sun.irradiance[c]) * l[2] * f64::from(RHO_T[c]) / PI)
                };
                agree(&format!("{kind:?} m {m} pixel {x},{y}"), picture.radiance(x, y), want, held(&renderer, 2e-4));
            }
        }
    }
}

#[test]
fn gloss_under_the_sky_by_quadrature() {
    let Some(mut renderer) = renderer() else { return };
    for (kind, view, m) in [
        (Lobe::Beckmann, Vec3::new(1.0, 0.0, 0.5), 0.3f32),
        (Lobe::Ggx, Vec3::new(0.3, 0.0, 1.0), 0.2),
        (Lobe::CookTorrance { index: 1.4 }, Vec3::new(1.0, 0.0, 0.3), 0.4),
    ] {
        let mut leaf = uniform_leaf();
        leaf.lobe = kind;
        leaf.sides.front.gloss = Some(vec![[0.5, 0.25, 0.125, m]; 64]);
        let mut scene = scene_of(leaf);
        scene.sky = Some([1.0; 3]);
        let camera = camera(view, 100.0);
        let seen = middle(&mut renderer, &scene, &camera);
        let v = unit(sub(wide(camera.eye), seen_point(&camera, 33, 33, 16, 16)));
        let n = 600;
        let mut albedo = 0.0;
        for i in 0..n {
            for k in 0..n {
                let (sin2, phi) = ((i as f64 + 0.5) / n as f64, 2.0 * PI * (k as f64 + 0.5) / n as f64);
                let l = [sin2.sqrt() * phi.cos(), sin2.sqrt() * phi.sin(), (1.0 - sin2).sqrt()];
                albedo += lobe(kind, [0.0, 0.0, 1.0], l, v, f64::from(m)) * PI / (n * n) as f64;
            }
        }
        let rho_s = [0.5, 0.25, 0.125];
        let want = std::array::from_fn(|c| wide3(RHO_D)[c] + wide3(BACK_T)[c] + rho_s[c] * albedo);
        agree(&format!("{kind:?}"), seen, want, 3e-3);
    }
}

#[test]
fn tone_map_is_reinhard_and_srgb() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    scene.background = [0.0, 0.25, 4.0];
    scene.exposure = 2.0;
    renderer.set_scene(&scene).expect("scene");
    let picture = renderer.render(&camera(Vec3::Z, 1e4), 8, 8).expect("picture");
    let encode = |x: f64| if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    let want: Vec<u8> = [0.0, 0.5, 8.0f64].iter().map(|x| (255.0 * encode(x / (1.0 + x))).round() as u8).collect();
    assert_eq!(picture.ldr[0], [want[0], want[1], want[2], 255]);
    assert_eq!(picture.hdr[0], [0.0, 0.25, 4.0, 0.0]);
}

#[test]
fn sixteen_bits_and_four_samples_stay_close() {
    let Some(mut exact) = renderer() else { return };
    let Some(mut half) = renderer_with(&Options { half_only: true, ..Options::default() }) else { return };
    let mut leaf = uniform_leaf();
    leaf.sides.front.gloss = Some(vec![[0.04, 0.04, 0.04, 0.25]; 64]);
    let mut scene = scene_of(leaf);
    scene.sun = Some(sun(Vec3::new(-0.5, 0.2, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    let camera = camera(Vec3::new(0.6, 0.0, 1.0), 100.0);
    let want = middle(&mut exact, &scene, &camera);
    for msaa in [1, 4] {
        scene.msaa = msaa;
        for renderer in [&mut exact, &mut half] {
            agree("16 bits", middle(renderer, &scene, &camera), [want[0], want[1], want[2]].map(f64::from), 2e-3);
        }
    }
}

#[test]
fn the_same_picture_twice_is_the_same_bytes() {
    let draw = || {
        let mut renderer = renderer()?;
        let mut leaf = uniform_leaf();
        leaf.sides.front.gloss = Some((0..64).map(|i| [0.04, 0.04, 0.04, 0.1 + 0.005 * i as f32]).collect());
        let mut scene = scene_of(leaf);
        scene.sun = Some(sun(Vec3::new(-0.5, 0.2, 1.0)));
        scene.sky = Some([0.4, 0.5, 0.6]);
        (scene.shadow_samples, scene.msaa) = (4, 4);
        renderer.set_scene(&scene).expect("scene");
        Some(renderer.render(&camera(Vec3::new(0.6, 0.0, 1.0), 60.0), 64, 48).expect("picture"))
    };
    let Some(first) = draw() else { return };
    assert!(first.hdr.iter().filter(|p| p[3] == 1.0 && p[0] > 0.0).count() > 300, "the picture shows no leaf");
    assert_eq!(Some(first), draw());
}

#[test]
fn bad_scenes_and_sizes_are_refused_in_words() {
    let Some(mut renderer) = renderer() else { return };
    let camera = camera(Vec3::Z, 50.0);
    assert!(matches!(renderer.render(&camera, 8, 8), Err(Error::Scene { .. })), "a picture before a scene");
    let mut scene = scene_of(uniform_leaf());
    leaf(&mut scene, 0).sides.front.gamma_delta.pop();
    let error = renderer.set_scene(&scene).expect_err("short map").to_string();
    assert!(
        error.contains("leaf 0 (flat), front.gamma_delta") && error.contains("63 texels") && error.contains("64"),
        "{error}"
    );
    let mut scene = scene_of(uniform_leaf());
    scene.instances[0].material = 3;
    assert!(renderer.set_scene(&scene).expect_err("no such leaf").to_string().contains("instance 0, material"));
    let mut scene = scene_of(uniform_leaf());
    leaf(&mut scene, 0).sides.front.gamma_delta[5][1] = f32::NAN;
    assert!(renderer.set_scene(&scene).is_err(), "NaN in a map");
    renderer.set_scene(&scene_of(uniform_leaf())).expect("scene");
    assert!(matches!(renderer.render(&camera, 0, 0), Err(Error::Size { .. })));
    assert!(matches!(renderer.render(&camera, 1 << 20, 4), Err(Error::Size { .. })));
    let blind = Camera { target: camera.eye, ..camera };
    assert!(matches!(renderer.render(&blind, 8, 8), Err(Error::Scene { .. })));
}

#[test]
fn no_adapter_is_its_own_error() {
    // WGPU_BACKEND is read when an adapter is chosen. A process of its own keeps it from the other tests.
    let me = std::env::current_exe().expect("path");
    let child = std::process::Command::new(me)
        .args(["--exact", "radiance::child_without_adapter", "--ignored", "--nocapture"])
        .env("WGPU_BACKEND", "metal")
        .output()
        .expect("child");
    let out = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success() && out.contains("no graphics adapter was found"), "{out}");
}

#[test]
#[ignore = "run by no_adapter_is_its_own_error"]
fn child_without_adapter() {
    let error = Renderer::headless(&Options::default()).err().expect("metal does not exist here");
    assert!(matches!(error, Error::NoAdapter));
    println!("{error}");
}

#[test]
fn vulkan_and_gl_agree() {
    let draw = |backend| {
        let mut renderer = renderer_with(&Options { backend, ..Options::default() })?;
        let mut leaf = uniform_leaf();
        leaf.sides.front.gloss = Some(vec![[0.04, 0.04, 0.04, 0.25]; 64]);
        let mut scene = scene_of(leaf);
        scene.sun = Some(sun(Vec3::new(-0.5, 0.2, 1.0)));
        scene.sky = Some([0.4, 0.5, 0.6]);
        scene.shadow_samples = 4;
        renderer.set_scene(&scene).expect("scene");
        Some(renderer.render(&camera(Vec3::new(0.6, 0.0, 1.0), 80.0), 48, 48).expect("picture"))
    };
    let Some(a) = draw(Backend::Vulkan) else { return };
    // wgpu cannot open some GPUs by OpenGL that Vulkan opens (gfx-rs/wgpu issues 4751 and 7068).
    if let Err(error @ Error::Device { .. }) =
        Renderer::headless(&Options { backend: Backend::Gl, ..Options::default() })
    {
        skips::skip(skips::Need::Adapter, &format!("OpenGL: {error}"));
        return;
    }
    let Some(b) = draw(Backend::Gl) else { return };
    let differing = a.ldr.iter().zip(&b.ldr).filter(|(p, q)| p.iter().zip(*q).any(|(s, t)| s.abs_diff(*t) > 2)).count();
    // The silhouette may fall on either side of a pixel's centre.
    assert!(differing < 48, "{differing} pixels differ");
}
