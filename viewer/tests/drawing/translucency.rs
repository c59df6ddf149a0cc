//! Light that comes through by translucency maps agrees with the formula, which is written again here. A leaf without
//! such maps costs nothing more.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::scene::{
    Camera, CoefficientMaps, Interior, LeafMaterial, Scene, Side, Translucency, TranslucencyBasis,
};
use mesophyll_viewer::{Picture, Renderer};
use std::f64::consts::PI;

/// The coefficients h of a flat, uniform leaf.
fn flat() -> [f32; 3] {
    [((2.0 * PI).sqrt() / 3.0) as f32; 3]
}

fn of_factors(map: Vec<[f32; 3]>) -> Translucency {
    Translucency { basis: TranslucencyBasis::HalfLife2, coefficients: CoefficientMaps::Factor(map) }
}

fn of_colours(maps: [Vec<[f32; 3]>; 3]) -> Translucency {
    Translucency { basis: TranslucencyBasis::HalfLife2, coefficients: CoefficientMaps::Colour(maps) }
}

/// The direction at which a basis is evaluated. The bent one is computed from the elevation and the azimuth.
fn looked_up(basis: TranslucencyBasis, omega: [f64; 3]) -> [f64; 3] {
    let across = omega[0].hypot(omega[1]);
    let height = omega[2].atan2(across);
    let azimuth = omega[1].atan2(omega[0]);
    let share = match basis {
        TranslucencyBasis::HalfLife2 => 1.0,
        TranslucencyBasis::Bent => (2.0 * height.sin() / (1.0 + height.sin())).powf(0.25),
    };
    [share * height.cos() * azimuth.cos(), share * height.cos() * azimuth.sin(), height.sin()]
}

/// Σ h_i √(3/2π) H_i·ω, at least 0.
fn factor(h: [f32; 3], omega: [f64; 3]) -> f64 {
    let axes = [
        [-1.0 / 6f64.sqrt(), -1.0 / 2f64.sqrt(), 1.0 / 3f64.sqrt()],
        [-1.0 / 6f64.sqrt(), 1.0 / 2f64.sqrt(), 1.0 / 3f64.sqrt()],
        [(2.0f64 / 3.0).sqrt(), 0.0, 1.0 / 3f64.sqrt()],
    ];
    (0..3).map(|i| f64::from(h[i]) * (1.5 / PI).sqrt() * dot(axes[i], omega)).sum::<f64>().max(0.0)
}

/// A camera straight above one side. The picture is then the maps as that side's camera saw them.
fn straight(front: bool) -> Camera {
    let mut c = camera(if front { Vec3::Z } else { -Vec3::Z }, 100.0);
    c.fov_y_deg = 2.0 * (10.0f32 / 100.0).atan().to_degrees();
    c
}

fn draw(renderer: &mut Renderer, scene: &Scene, camera: &Camera) -> Picture {
    renderer.set_scene(scene).expect("scene");
    renderer.render(camera, 40, 40).expect("picture")
}

fn lit(leaf: LeafMaterial, light: Vec3) -> Scene {
    let mut scene = scene_of(leaf);
    scene.sun = Some(sun(light));
    scene
}

#[test]
fn a_flat_uniform_leafs_maps_change_nothing() {
    let Some(mut renderer) = renderer() else { return };
    let lights =
        [Vec3::new(0.3, 0.2, 1.0), Vec3::new(-0.9, 0.4, 0.2), Vec3::new(0.5, -0.6, -0.8), Vec3::new(0.1, 0.95, -0.08)];
    for (light, basis) in
        lights.into_iter().flat_map(|l| [(l, TranslucencyBasis::HalfLife2), (l, TranslucencyBasis::Bent)])
    {
        let plain = lit(uniform_leaf(), light);
        let mut factors = plain.clone();
        let mut colours = plain.clone();
        for (side, rho) in [(Side::Front, RHO_T), (Side::Back, BACK_T)] {
            let of = |coefficients: Translucency| Some(Translucency { basis, ..coefficients });
            leaf(&mut factors, 0).sides[side].translucency = of(of_factors(vec![flat(); 64]));
            let colour = of_colours(rho.map(|r| vec![flat().map(|h| r * h); 64]));
            leaf(&mut colours, 0).sides[side].translucency = of(colour);
        }
        for front in [true, false] {
            let want = draw(&mut renderer, &plain, &straight(front));
            let factor = draw(&mut renderer, &factors, &straight(front));
            let colour = draw(&mut renderer, &colours, &straight(front));
            for (x, y) in [(3, 4), (20, 20), (35, 11)] {
                let wanted: [f64; 3] = std::array::from_fn(|c| f64::from(want.radiance(x, y)[c]));
                agree("factor", factor.radiance(x, y), wanted, held(&renderer, 1e-4));
                // ρt itself is rounded to 16 bits in these maps.
                agree("colour", colour.radiance(x, y), wanted, held(&renderer, 1e-3));
            }
        }
    }
}

/// Coefficients that differ between texels and between functions.
fn made_up(k: usize) -> [f32; 3] {
    let (x, y) = ((k % 8) as f32, (k / 8) as f32);
    [0.8 + 0.05 * x, 0.7 + 0.06 * y, 0.9 - 0.04 * x - 0.02 * y]
}

#[test]
fn maps_are_looked_up_where_the_lit_sides_camera_saw_them_and_light_is_turned_into_its_frame() {
    let Some(mut renderer) = renderer() else { return };
    // Directions from steep down to half a degree and a twentieth of a degree above the blade.
    let towards = [
        (0.1, 0.1, 1.0),
        (0.8, 0.3, 0.7),
        (-0.5, 0.6, 0.3),
        (0.1, -0.9, 0.5),
        (0.8, 0.5, 0.1),
        (-0.9, 0.4, 9e-3),
        (0.3, 0.9, 9e-4),
    ];
    let cases = towards.into_iter().flat_map(|t| [(t, TranslucencyBasis::HalfLife2), (t, TranslucencyBasis::Bent)]);
    for front_lit in [true, false] {
        for (toward, basis) in cases.clone() {
            let toward = Vec3::from(toward);
            let out = if front_lit { 1.0 } else { -1.0 };
            let light = Vec3::new(toward.x, toward.y, out * toward.z);
            let direction = wide(sun(light).direction);
            // In the lit side's image x is to the right: world +x on the front, −x on the back.
            let omega = looked_up(basis, [out as f64 * direction[0], direction[1], out as f64 * direction[2]]);
            for colour in [false, true] {
                let mut leaf = uniform_leaf();
                let rho = if front_lit { RHO_T } else { BACK_T };
                let side = if front_lit { &mut leaf.sides.front } else { &mut leaf.sides.back };
                let tint = [1.0f32, 0.6, 0.3];
                let coefficients = if colour {
                    CoefficientMaps::Colour(tint.map(|t| (0..64).map(|k| made_up(k).map(|h| t * h)).collect()))
                } else {
                    CoefficientMaps::Factor((0..64).map(made_up).collect())
                };
                side.translucency = Some(Translucency { basis, coefficients });
                // The mapped normal must have no effect on this side.
                side.normal = Some(vec![Vec3::new(0.5, 0.5, 0.7).normalize().to_array(); 64]);
                let scene = lit(leaf, light);
                // The leaf is seen from the other side, whose picture mirrors the lit side's columns.
                let picture = draw(&mut renderer, &scene, &straight(!front_lit));
                for (column, row) in [(0usize, 0usize), (5, 2), (2, 6), (7, 7)] {
                    let f = factor(made_up(8 * row + column), omega);
                    let per = if colour { tint } else { rho };
                    // Half floats: each component of the texel's vector, whose length is √(3/2π)·|h|, is wrong by at
                    // most 2⁻¹¹ of itself.
                    let length = made_up(8 * row + column).iter().map(|h| f64::from(h * h)).sum::<f64>().sqrt()
                        * (1.5 / PI).sqrt();
                    let seen = picture.radiance(5 * (7 - column as u32) + 2, 5 * row as u32 + 2);
                    for c in 0..3 {
                        let level = f64::from(sun(light).irradiance[c] * per[c]) / PI;
                        let (want, got) = (level * f, f64::from(seen[c]));
                        let slack = level * length / 2048.0 + held(&renderer, 1e-5) * want;
                        assert!(
                            (got - want).abs() <= slack,
                            "front lit {front_lit}, {toward}, {basis:?}, {colour}, texel {column} {row}: {got} {want}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn light_below_the_function_is_dark_and_not_negative() {
    let Some(mut renderer) = renderer() else { return };
    let mut leaf = uniform_leaf();
    // The vector leans far towards −y, so light from +y at a low angle is below its horizon.
    leaf.sides.back.translucency = Some(of_factors(vec![[1.2, -0.4, 0.2]; 64]));
    let light = Vec3::new(0.0, 1.0, -0.1);
    let picture = draw(&mut renderer, &lit(leaf, light), &straight(true));
    assert_eq!(picture.radiance(20, 20)[..3], [0.0; 3]);
}

#[test]
fn a_leaf_without_maps_has_the_shader_it_had() {
    let Some(mut renderer) = renderer() else { return };
    let scene = lit(uniform_leaf(), Vec3::new(0.2, 0.1, -1.0));
    let plain = renderer.operations(&scene, 0).expect("a shader");
    let mut with = scene.clone();
    leaf(&mut with, 0).sides.back.translucency = Some(of_factors(vec![flat(); 64]));
    let one = renderer.operations(&with, 0).expect("a shader");
    leaf(&mut with, 0).sides.back.translucency = Some(of_colours([0, 1, 2].map(|_| vec![flat(); 64])));
    let three = renderer.operations(&with, 0).expect("a shader");
    assert!(plain < one && one < 2 * plain && plain < three, "{plain} {one} {three}");
    // Bending the light takes a dozen operations, once, for any kind of map.
    for (basis_free, coefficients) in [
        (one, CoefficientMaps::Factor(vec![flat(); 64])),
        (three, CoefficientMaps::Colour([0, 1, 2].map(|_| vec![flat(); 64]))),
    ] {
        leaf(&mut with, 0).sides.back.translucency =
            Some(Translucency { basis: TranslucencyBasis::Bent, coefficients });
        let bent = renderer.operations(&with, 0).expect("a shader");
        assert!(bent > basis_free && bent <= basis_free + 16, "{bent} {basis_free}");
    }
    // Without a sun, the maps cost nothing.
    (with.sun, with.sky) = (None, Some([1.0; 3]));
    let mut overcast = scene.clone();
    (overcast.sun, overcast.sky) = (None, Some([1.0; 3]));
    assert_eq!(renderer.operations(&with, 0), renderer.operations(&overcast, 0));
    renderer.set_scene(&scene).expect("scene");
}

fn names(renderer: &Renderer) -> Vec<String> {
    renderer.stats().uploads.iter().map(|u| u.name.clone()).collect()
}

#[test]
fn nothing_of_it_is_uploaded_or_compiled_without_maps_or_without_a_sun() {
    let Some(mut renderer) = renderer() else { return };
    let light = Vec3::new(0.2, 0.1, -1.0);
    draw(&mut renderer, &lit(uniform_leaf(), light), &straight(true));
    assert_eq!(renderer.stats().pipelines, ["main: sun", "tonemap"]);
    assert!(
        !renderer.stats().uploaded("translucency") && !renderer.stats().uploaded("tangents"),
        "{:?}",
        names(&renderer)
    );

    let mut lightened = uniform_leaf();
    lightened.sides.back.translucency = Some(of_factors(vec![flat(); 64]));
    let sunny = lit(lightened.clone(), light);
    draw(&mut renderer, &sunny, &straight(true));
    assert_eq!(renderer.stats().pipelines, ["main: sun, back translucency", "tonemap"]);
    let mut bent = sunny.clone();
    leaf(&mut bent, 0).sides.back.translucency =
        Some(Translucency { basis: TranslucencyBasis::Bent, ..of_factors(vec![flat(); 64]) });
    draw(&mut renderer, &bent, &straight(true));
    assert_eq!(renderer.stats().pipelines, ["main: sun, back bent translucency", "tonemap"]);
    draw(&mut renderer, &sunny, &straight(true));
    assert!(renderer.stats().uploaded("leaf 0 back translucency") && !renderer.stats().uploaded("front translucency"));
    // The maps are half floats with mips, whatever the format of the adapter's other maps: 64 + 16 + 4 + 1 texels of
    // eight bytes.
    let map = renderer.stats().uploads.iter().find(|u| u.name == "leaf 0 back translucency").expect("map");
    assert_eq!(map.bytes, 85 * 8);

    let mut overcast = sunny.clone();
    (overcast.sun, overcast.sky) = (None, Some([0.5; 3]));
    draw(&mut renderer, &overcast, &straight(true));
    assert_eq!(renderer.stats().pipelines, ["main: sky", "tonemap"]);
    assert!(
        !renderer.stats().uploaded("translucency") && !renderer.stats().uploaded("tangents"),
        "{:?}",
        names(&renderer)
    );

    lightened.sides.back.translucency = Some(of_colours([0, 1, 2].map(|_| vec![flat(); 64])));
    // A side that shows nothing itself still transmits light by such a map.
    lightened.sides.back.interior = Interior::Maps { rho_d: vec![BACK_D; 64], rho_t: vec![BACK_T; 64] };
    draw(&mut renderer, &lit(lightened, light), &straight(true));
    assert_eq!(renderer.stats().pipelines, ["main: sun, back maps translucency colour", "tonemap"]);
    let map = renderer.stats().uploads.iter().find(|u| u.name == "leaf 0 back translucency").expect("map");
    assert_eq!(map.bytes, 3 * 85 * 8);
}

#[test]
fn a_map_of_another_size_or_basis_is_refused() {
    let Some(mut renderer) = renderer() else { return };
    let mut leaf = uniform_leaf();
    leaf.sides.front.translucency = Some(of_factors(vec![flat(); 63]));
    let told = renderer.set_scene(&scene_of(leaf.clone())).expect_err("63 texels").to_string();
    assert!(told.contains("front.translucency") && told.contains("63"), "{told}");
    // The shader has one bent light for both sides, so their bases must agree.
    leaf.sides.front.translucency = Some(of_factors(vec![flat(); 64]));
    leaf.sides.back.translucency =
        Some(Translucency { basis: TranslucencyBasis::Bent, ..of_factors(vec![flat(); 64]) });
    let told = renderer.set_scene(&scene_of(leaf)).expect_err("two bases").to_string();
    assert!(
        told.contains("translucency.basis") && told.contains("HalfLife2 on the front and Bent on the back"),
        "{told}"
    );
}
