//! The 8-bit picture: a film's curve, bands as colours, and patterns on the ground.

use super::common::{agree, camera, renderer, scene_of, seen_point, square, sun, uniform_leaf};
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{
    AlbedoPattern, Instance, Material, OpaqueMaterial, PictureChannels, PictureDisplay, Scene, ToneCurve,
};
use std::sync::Arc;

/// A lit leaf in front of a bright background.
fn lit() -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.sun = Some(sun(Vec3::new(-0.5, 0.2, 1.0)));
    scene.background = [0.05, 0.3, 2.0];
    scene.exposure = 1.7;
    scene
}

/// What the shader shows is what the formulas in double precision make of its radiance, to one step; the radiance does
/// not depend on it. A picture that is shown plainly is the picture of a scene that says nothing.
#[test]
fn pictures_are_shown_as_the_scene_says() {
    let Some(mut renderer) = renderer() else { return };
    let eye = camera(Vec3::new(0.3, 0.0, 1.0), 80.0);
    let mut draw = |scene: &Scene, plain: bool| {
        renderer.set_scene(scene).expect("scene");
        renderer.show_plain(plain);
        renderer.render(&eye, 48, 32).expect("picture")
    };
    let own = draw(&lit(), false);
    assert!(own.hdr.iter().any(|p| p[3] == 0.0) && own.hdr.iter().any(|p| p[3] == 1.0));
    for curve in [ToneCurve::Reinhard, ToneCurve::Film] {
        for channels in [PictureChannels::Srgb, PictureChannels::Bands] {
            let display = PictureDisplay { curve, channels };
            let scene = Scene { display, ..lit() };
            let picture = draw(&scene, false);
            assert_eq!(picture.hdr, own.hdr);
            for (radiance, shown) in picture.hdr.iter().zip(&picture.ldr) {
                let [r, g, b, surface] = radiance.map(f64::from);
                let want = display.display([r, g, b], surface, f64::from(scene.exposure)).map(|v| 255.0 * v);
                for c in 0..3 {
                    assert!((f64::from(shown[c]) - want[c]).abs() < 0.51, "{display:?} {radiance:?} {shown:?}");
                }
            }
            assert_eq!(picture.ldr != own.ldr, display != PictureDisplay::default());
            assert_eq!(draw(&scene, true).ldr, own.ldr);
        }
    }
}

/// Texels of a pattern along a side.
const SIDE: u32 = 32;

/// Texels lie where the pattern says, row 0 at the largest y, and the pattern goes on beyond its first tile. Drivers
/// blur a pattern by a texel or two, so each quarter of it has one colour.
#[test]
fn a_pattern_lies_where_it_is_stated() {
    let Some(mut renderer) = renderer() else { return };
    let quarters = [[0.1, 0.2, 0.3], [0.9, 0.8, 0.7], [0.5, 0.1, 0.6], [0.25, 0.75, 0.4]];
    let texels = (0..SIDE * SIDE).map(|k| quarters[(k / SIDE * 2 / SIDE * 2 + k % SIDE * 2 / SIDE) as usize]);
    let (corner, size) = ([-10.0f32, -10.0], [8.0f32, 4.0]);
    let pattern = AlbedoPattern { width: SIDE, height: SIDE, texels: Arc::new(texels.collect()), corner, size };
    let mut scene = Scene { exposure: 1.0, msaa: 1, shadow_resolution: 64, ..Scene::default() };
    let soil = OpaqueMaterial { name: "soil".into(), albedo: [0.3; 3], pattern: Some(pattern) };
    let ground = scene.add(square(10.0), Material::Opaque(soil));
    // Seen on a turned square, too: the pattern belongs to the world.
    scene.instances.push(Instance { transform: Mat4::from_rotation_z(0.5), ..ground });
    scene.sky = Some([2.0; 3]);
    renderer.set_scene(&scene).expect("scene");
    let (eye, pixels) = (camera(Vec3::Z, 40.0), 200);
    let picture = renderer.render(&eye, pixels, pixels).expect("picture");
    let mut hit = [0; 4];
    for y in 0..pixels {
        for x in 0..pixels {
            let at = seen_point(&eye, pixels, pixels, x, y);
            let place = [0, 1].map(|k| (at[k] - f64::from(corner[k])) / f64::from(size[k]) * 2.0);
            // Near the middle of a quarter nothing of its neighbours is mixed in.
            if place.iter().any(|p| (p.fract() - 0.5).abs() > 0.25) {
                continue;
            }
            let [column, row] = place.map(|p| p.floor() as usize % 2);
            let k = (1 - row) * 2 + column;
            hit[k] += 1;
            agree("quarter", picture.radiance(x, y), quarters[k].map(|v: f32| 2.0 * f64::from(v)), 1e-3);
        }
    }
    assert!(hit.iter().all(|n| *n > 0), "{hit:?}");
    // An edit keeps the texture where its texels stay, and uploads it where one of them changes.
    let mut edited = |scene: &Scene| {
        let before = renderer.stats().uploads.len();
        renderer.set_material(scene, 0).expect("material");
        renderer.stats().uploads[before..].iter().map(|u| u.name.clone()).collect::<Vec<_>>()
    };
    for (texel, want) in [(quarters[0], None), ([0.2, 0.3, 0.4], Some("opaque 0 pattern"))] {
        let Material::Opaque(soil) = &mut scene.materials[0] else { panic!("no leaf") };
        let pattern = soil.pattern.as_mut().expect("pattern");
        pattern.size[0] *= 1.5;
        Arc::make_mut(&mut pattern.texels)[0] = texel;
        assert_eq!(edited(&scene), want.into_iter().collect::<Vec<&str>>());
    }
    // A pattern that cannot be is refused.
    for wrong in [[0.0, 4.0], [f32::NAN, 4.0]] {
        let Material::Opaque(soil) = &mut scene.materials[0] else { panic!("no leaf") };
        soil.pattern.as_mut().expect("pattern").size = wrong;
        assert!(renderer.set_scene(&scene).is_err());
    }
}
