//! The reference renderer against closed forms, analytic geometry and itself; leaves are built by hand.

use glam::{DMat4, DQuat, DVec2, DVec3, DVec4};
use mesophyll::transport::closed_form::Card;
use mesophyll::transport::lobe::Lobe;
use mesophyll::transport::render::Lens;
use mesophyll::transport::{
    Camera, Gloss, Interior, NormalFrame, NormalMap, Options, Placement, ReferenceLeaf, ReferenceMesh, ReferencePicture, ReferenceSide,
    ReferenceSun, Renderer, World, render,
};
use std::f64::consts::PI;
use std::sync::Arc;

const SUN: f64 = 0.004_65;

/// A blade of `w`×`h` mm about the origin in `n`×`n` cells, bent upwards by `bend` mm at its sides.
fn blade(w: f64, h: f64, n: usize, bend: f64) -> ReferenceMesh {
    let mut mesh = ReferenceMesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
            let x = w * (u - 0.5);
            let slope = 8.0 * bend * x / (w * w);
            mesh.positions.push(DVec3::new(x, h * (0.5 - v), 4.0 * bend * x * x / (w * w)));
            mesh.normals.push(DVec3::new(-slope, 0.0, 1.0).normalize());
            mesh.tangents.push(DVec3::new(1.0, 0.0, slope).normalize().extend(1.0));
            mesh.uvs.push(DVec2::new(u, v));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let a = (j * (n + 1) + i) as u32;
            let below = a + n as u32 + 1;
            mesh.indices.extend([a, below, a + 1, a + 1, below, below + 1]);
        }
    }
    mesh
}

/// One colour over a 1×1 map.
fn uniform(rho_d: [f64; 3], rho_t: [f64; 3], gloss: Option<([f64; 3], f64)>) -> ReferenceSide {
    let one = |c: [f64; 3]| c.map(|x| vec![x as f32]);
    ReferenceSide {
        interior: Interior::Maps { rho_d: one(rho_d), rho_t: one(rho_t) },
        gloss: gloss.map(|(rho_s, m)| Gloss { rho_s: one(rho_s), m: vec![m as f32] }),
        normal: None,
    }
}

fn leaf(mesh: ReferenceMesh, front: ReferenceSide, back: ReferenceSide, lobe: Lobe) -> ReferenceLeaf {
    ReferenceLeaf { mesh, width: 1, height: 1, front, back, mask: None, lobe }
}

fn alone(leaf: ReferenceLeaf, sun: Option<ReferenceSun>, sky: Option<[f64; 3]>) -> World {
    World { leaves: vec![leaf], instances: vec![Placement { leaf: 0, transform: DMat4::IDENTITY }], sun, sky, ..World::default() }
}

fn sun(direction: DVec3, radius: f64) -> Option<ReferenceSun> {
    Some(ReferenceSun { direction, irradiance: [3.0, 2.5, 2.0], radius })
}

fn camera(eye: DVec3, fov_y_deg: f64) -> Camera {
    Camera { eye, target: DVec3::ZERO, up: DVec3::Y, fov_y_deg }
}

/// A leaf with veins, two unlike sides, gloss and relief, `n` texels wide.
fn veined(n: usize) -> ReferenceLeaf {
    let texel = |k: usize| ((k % n) as f64 / n as f64, (k / n) as f64 / n as f64);
    let vein = |u: f64, v: f64| {
        let midrib = (-((u - 0.45) / 0.012).powi(2)).exp();
        let side = (0.5 + 0.5 * ((v - 0.7 * (u - 0.45).abs()) * 2.0 * PI * 7.0).cos()).powi(20);
        (midrib + 0.7 * side).min(1.0)
    };
    let map = |of: &dyn Fn(f64, f64) -> f64| (0..n * n).map(|k| of(texel(k).0, texel(k).1) as f32).collect::<Vec<f32>>();
    let side = |mirror: bool, tint: [f64; 3], shine: f64, m: f64, relief: f64| {
        let at = move |u: f64, v: f64| vein(if mirror { 1.0 - u } else { u }, v);
        let colour = |c: usize, vein_gain: f64| map(&|u, v| tint[c] * (1.0 + vein_gain * at(u, v)));
        let h = 0.5 / n as f64;
        let normals = (0..n * n)
            .map(|k| {
                let (u, v) = texel(k);
                let (dx, dy) = (at(u + h, v) - at(u - h, v), at(u, v - h) - at(u, v + h));
                let normal = DVec3::new(-relief * dx / h * 0.01, -relief * dy / h * 0.01, 1.0).normalize();
                [normal.x as f32, normal.y as f32, normal.z as f32]
            })
            .collect();
        ReferenceSide {
            interior: Interior::Maps {
                rho_d: [colour(0, 1.5), colour(1, 0.8), colour(2, 1.8)],
                rho_t: [0, 1, 2].map(|c| map(&|u, v| 0.8 * tint[c] * (1.0 - 0.6 * at(u, v)))),
            },
            gloss: Some(Gloss {
                rho_s: [0, 1, 2].map(|_| map(&|u, v| shine * (1.0 - 0.5 * at(u, v)))),
                m: map(&|u, v| m + 0.1 * at(u, v)),
            }),
            normal: Some(NormalMap { frame: NormalFrame::Blade, values: normals }),
        }
    };
    let outline = |u: f64, v: f64| {
        let y = 2.0 * v - 1.0;
        (u - 0.48).abs() < 0.42 * (1.0 - y * y).max(0.0).powf(0.8)
    };
    ReferenceLeaf {
        mesh: blade(60.0, 60.0, 24, 4.0),
        width: n,
        height: n,
        front: side(false, [0.05, 0.13, 0.03], 0.05, 0.25, 1.0),
        back: side(true, [0.12, 0.21, 0.09], 0.02, 0.45, -1.0),
        mask: Some((0..n * n).map(|k| u8::from(outline(texel(k).0, texel(k).1))).collect()),
        lobe: Lobe::Beckmann,
    }
}

fn portrait() -> (World, Camera) {
    let mut world = alone(veined(64), sun(DVec3::new(0.5, 0.4, 1.0), SUN), Some([0.25, 0.3, 0.4]));
    world.exposure = 1.2;
    world.background = [0.02, 0.02, 0.025];
    (world, camera(DVec3::new(-20.0, -35.0, 110.0), 32.0))
}

/// Mean of the closed form over a pixel's square, by a 3×3 midpoint rule.
fn over_pixel(card: &Card, lens: &Lens, x: usize, y: usize, sun: Option<&ReferenceSun>, sky: Option<[f64; 3]>) -> [f64; 3] {
    let mut mean = [0.0; 3];
    for k in 0..9 {
        let ray = lens.ray(x as f64 + ((k % 3) as f64 + 0.5) / 3.0, y as f64 + ((k / 3) as f64 + 0.5) / 3.0);
        let radiance = card.radiance(-ray.direction, sun, sky);
        (0..3).for_each(|c| mean[c] += radiance[c] / 9.0);
    }
    mean
}

#[test]
fn flat_cards_meet_the_closed_form() {
    let (front_d, front_t, front_s) = ([0.1, 0.3, 0.05], [0.2, 0.35, 0.12], [0.06, 0.05, 0.04]);
    let (back_d, back_t, back_s) = ([0.2, 0.4, 0.15], [0.22, 0.3, 0.1], [0.02, 0.03, 0.01]);
    let mut seen = 0;
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        let front = uniform(front_d, front_t, Some((front_s, 0.25)));
        let back = uniform(back_d, back_t, Some((back_s, 0.5)));
        for (eye, lamp, sky) in [
            (DVec3::new(60.0, 10.0, 80.0), sun(DVec3::new(-0.8, 0.0, 1.0), 0.0), None),
            (DVec3::new(60.0, 10.0, 80.0), sun(DVec3::new(-0.3, 0.2, -1.0), 0.0), None),
            (DVec3::new(10.0, 80.0, 25.0), None, Some([0.5, 0.7, 1.0])),
            (DVec3::new(-30.0, -20.0, -70.0), sun(DVec3::new(0.3, 0.2, -1.0), SUN), Some([0.5, 0.7, 1.0])),
            (DVec3::new(-30.0, -20.0, -70.0), sun(DVec3::new(0.3, 0.2, 1.0), SUN), None),
        ] {
            let world = alone(leaf(blade(400.0, 400.0, 2, 0.0), front.clone(), back.clone(), lobe), lamp, sky);
            let view = camera(eye, 4.0);
            let options = Options { samples_per_pixel: 64, ..Options::default() };
            let picture = render(&world, &view, 12, 9, &options).unwrap();
            let card = if eye.z > 0.0 {
                Card { rho_d: front_d, rho_s: front_s, m: 0.25, lobe, rho_t_far: back_t, normal: DVec3::Z }
            } else {
                Card { rho_d: back_d, rho_s: back_s, m: 0.5, lobe, rho_t_far: front_t, normal: -DVec3::Z }
            };
            let lens = Lens::new(&view, 12, 9).unwrap();
            for (k, found) in picture.hdr.iter().enumerate() {
                let expected = over_pixel(&card, &lens, k % 12, k / 12, world.sun.as_ref(), sky);
                assert_eq!(found[3], 1.0);
                for c in 0..3 {
                    let error = f64::from(found[c]) / expected[c] - 1.0;
                    assert!(error.abs() < 5e-4, "{lobe:?} {eye} pixel {k}: {} against {}", found[c], expected[c]);
                    seen += 1;
                }
            }
        }
    }
    assert_eq!(seen, 3 * 5 * 108 * 3);
}

#[test]
fn a_white_furnace_gives_the_sky_back() {
    let side = |d: f64| uniform([d; 3], [0.3; 3], None);
    for (eye, rho_d) in [(DVec3::Z * 90.0, 0.7), (DVec3::new(20.0, 5.0, -90.0), 0.7)] {
        let world = alone(leaf(blade(30.0, 30.0, 6, 5.0), side(rho_d), side(rho_d), Lobe::Ggx), None, Some([0.4, 0.8, 1.2]));
        let picture = render(&world, &camera(eye, 30.0), 40, 30, &Options::default()).unwrap();
        let inside: Vec<_> = picture.hdr.iter().filter(|p| p[3] == 1.0).collect();
        assert!(inside.len() > 100);
        for p in inside {
            assert!((p[0] - 0.4).abs() < 1e-6 && (p[1] - 0.8).abs() < 1e-6 && (p[2] - 1.2).abs() < 1e-6, "{p:?}");
        }
    }
}

/// Share of a unit disk on the side x > d.
fn segment(d: f64) -> f64 {
    let d = d.clamp(-1.0, 1.0);
    (d.acos() - d * (1.0 - d * d).sqrt()) / PI
}

/// A card lit from straight above, and a wide blade at `height` that hides the half-space x < 0.
fn half_hidden(height: f64, radius: f64) -> World {
    let side = || uniform([0.5; 3], [0.0; 3], None);
    let mut world = alone(leaf(blade(1.0, 1.0, 1, 0.0), side(), side(), Lobe::Beckmann), sun(DVec3::Z, radius), None);
    let place =
        |at: DVec3| Placement { leaf: 0, transform: DMat4::from_scale_rotation_translation(DVec3::splat(2000.0), DQuat::IDENTITY, at) };
    world.instances = vec![place(DVec3::ZERO), place(DVec3::new(-1000.0, 0.0, height))];
    world
}

#[test]
fn a_half_hidden_sun_shows_a_circular_segment() {
    for radius in [SUN, 0.1] {
        let world = half_hidden(100.0, radius);
        let renderer = Renderer::new(&world).unwrap();
        let reach = 100.0 * f64::tan(radius);
        for d in [-1.2, -0.9, -0.5, -0.1, 0.0, 0.3, 0.8, 1.1] {
            // from a point at x = d·reach the edge cuts the disk at −d
            let found = renderer.sun_visibility(DVec3::new(d * reach, 3.0, 0.0), 4096, 5).unwrap();
            assert!((found - segment(-d)).abs() < 2e-3, "{radius} {d}: {found} against {}", segment(-d));
        }
    }
}

#[test]
fn a_penumbra_has_the_right_profile_and_is_marked() {
    let (height, radius) = (100.0, 0.05);
    let world = half_hidden(height, radius);
    let (width, rows) = (80, 8);
    // from below the occluder, straight down
    let view = camera(DVec3::new(0.0, 0.0, 50.0), 2.0);
    let options = Options { samples_per_pixel: 64, sun_samples: 16, ..Options::default() };
    let picture = render(&world, &view, width, rows, &options).unwrap();
    let lens = Lens::new(&view, width, rows).unwrap();
    let full = [3.0, 2.5, 2.0].map(|e| e * 0.5 / PI);
    let (mut marked, mut squares) = (0, 0.0f64);
    for k in 0..width * rows {
        let ray = lens.ray((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
        let x = ray.direction.x / -ray.direction.z * 50.0;
        let d = x / (height * radius.tan());
        for (found, full) in picture.hdr[k].iter().zip(full) {
            let share = f64::from(*found) / full;
            let error = share - segment(-d);
            assert!(error.abs() < 0.02, "x = {x}: {share} against {}", segment(-d));
            squares += error * error / (3 * width * rows) as f64;
        }
        let pixel = 50.0 * (2.0 / rows as f64).to_radians() / (height * radius.tan());
        if d.abs() < 1.0 - pixel {
            assert!(picture.penumbra[k], "unmarked at d = {d}");
            marked += 1;
        } else if d.abs() > 1.0 + 3.0 * pixel {
            assert!(!picture.penumbra[k], "marked at d = {d}");
        }
        assert!(picture.interior[k]);
    }
    assert!(marked > 100);
    // 1024 unstratified samples would scatter by √(¼/1024) = .016 at V = ½
    assert!(squares.sqrt() < 0.008, "{}", squares.sqrt());
}

/// The blade turned over, with its sides exchanged, must look the same: maps mirrored, normals turned, far side's too.
#[test]
fn the_back_is_the_front_turned_over() {
    for frame in [NormalFrame::Blade, NormalFrame::Tangent] {
        let mut front_up = veined(48);
        for side in [&mut front_up.front, &mut front_up.back] {
            side.normal.as_mut().unwrap().frame = frame;
        }
        front_up.mesh = blade(60.0, 60.0, 6, 0.0);
        let mut back_up = front_up.clone();
        std::mem::swap(&mut back_up.front, &mut back_up.back);
        let mask = back_up.mask.as_mut().unwrap();
        mask.chunks_mut(48).for_each(|row| row.reverse());
        for lamp in [DVec3::new(0.7, 0.4, 1.0), DVec3::new(0.3, 0.6, -1.0)] {
            let up = alone(front_up.clone(), sun(lamp, SUN), Some([0.1, 0.2, 0.3]));
            let mut down = alone(back_up.clone(), sun(lamp, SUN), Some([0.1, 0.2, 0.3]));
            down.instances[0].transform = DMat4::from_rotation_y(PI);
            let view = camera(DVec3::new(15.0, -25.0, 100.0), 36.0);
            let [a, b] = [&up, &down].map(|w| render(w, &view, 60, 45, &Options::default()).unwrap());
            let mut brightest = 0f32;
            for (k, (p, q)) in a.hdr.iter().zip(&b.hdr).enumerate() {
                for c in 0..4 {
                    // a ray in thousands falls on the other side of the outline by rounding
                    assert!((p[c] - q[c]).abs() < 1e-5 || !a.interior[k], "{frame:?} pixel {k}: {p:?} {q:?}");
                }
                brightest = brightest.max(p[1]);
            }
            assert!(brightest > 0.1);
        }
    }
}

#[test]
fn columns_of_the_back_run_the_other_way() {
    let side = |left: f32, right: f32| ReferenceSide {
        interior: Interior::Maps { rho_d: [vec![left, right], vec![0.1; 2], vec![0.1; 2]], rho_t: [(); 3].map(|_| vec![0.0; 2]) },
        gloss: None,
        normal: None,
    };
    let leaf = ReferenceLeaf {
        mesh: blade(20.0, 20.0, 1, 0.0),
        width: 2,
        height: 1,
        front: side(0.1, 0.6),
        back: side(0.9, 0.2),
        mask: None,
        lobe: Lobe::Beckmann,
    };
    let world = alone(leaf, None, Some([1.0; 3]));
    for (z, left, right) in [(60.0, 0.1, 0.6), (-60.0, 0.9, 0.2)] {
        let picture = render(&world, &camera(DVec3::Z * z, 18.0), 40, 40, &Options::default()).unwrap();
        assert!((picture.hdr[20 * 40 + 3][0] - left).abs() < 1e-6, "left half from z = {z}");
        assert!((picture.hdr[20 * 40 + 36][0] - right).abs() < 1e-6, "right half from z = {z}");
    }
}

/// A constant mapped normal on a turned, scaled flat blade is Lambert's law about the turned normal.
#[test]
fn mapped_normals_turn_with_the_instance() {
    let n = DVec3::new(0.3, -0.2, 0.9).normalize();
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.3, 0.8);
    let l = DVec3::new(0.3, 0.2, 1.0).normalize();
    for (frame, from_back) in
        [(NormalFrame::Blade, false), (NormalFrame::Tangent, false), (NormalFrame::Blade, true), (NormalFrame::Tangent, true)]
    {
        let mut side = uniform([0.4; 3], [0.2; 3], None);
        side.normal = Some(NormalMap { frame, values: vec![[n.x as f32, n.y as f32, n.z as f32]] });
        let mut world = alone(leaf(blade(300.0, 300.0, 3, 0.0), side.clone(), side, Lobe::Beckmann), sun(l, 0.0), None);
        let flip = if from_back { DQuat::from_rotation_y(PI) } else { DQuat::IDENTITY };
        world.instances[0].transform = DMat4::from_scale_rotation_translation(DVec3::splat(1.7), turn * flip, DVec3::ZERO);
        let picture = render(&world, &camera(DVec3::new(5.0, 8.0, 90.0), 3.0), 4, 3, &Options::default()).unwrap();
        // from behind, the image's own frame (x right, y up, z out) is the flipped leaf's, so the expectation is the same
        let expected = 3.0 * 0.4 / PI * (turn * n).dot(l);
        for p in &picture.hdr {
            assert!((f64::from(p[0]) / expected - 1.0).abs() < 1e-6, "{frame:?} back {from_back}: {} against {expected}", p[0]);
        }
        // and lit from behind, the far side's normal counts
        world.sun = sun(-l, 0.0);
        let lit = render(&world, &camera(DVec3::new(5.0, 8.0, 90.0), 3.0), 4, 3, &Options::default()).unwrap();
        let far = turn * DVec3::new(-n.x, n.y, -n.z);
        let expected = 3.0 * 0.2 / PI * far.dot(-l);
        assert!((f64::from(lit.hdr[0][0]) / expected - 1.0).abs() < 1e-6, "{frame:?} far side");
    }
}

/// On a bent blade the tangent frame follows the mesh and the blade's frame does not.
#[test]
fn tangent_normals_follow_a_bent_mesh() {
    let n = DVec3::new(0.25, 0.1, 0.95).normalize();
    let l = DVec3::new(0.2, 0.1, 1.0).normalize();
    let (w, bend) = (100.0, 12.0);
    let mesh = blade(w, 100.0, 256, bend);
    for frame in [NormalFrame::Blade, NormalFrame::Tangent] {
        let mut side = uniform([0.5; 3], [0.0; 3], None);
        side.normal = Some(NormalMap { frame, values: vec![[n.x as f32, n.y as f32, n.z as f32]] });
        let world = alone(leaf(mesh.clone(), side.clone(), side, Lobe::Beckmann), sun(l, 0.0), None);
        // a camera far away sees x nearly in proportion
        let view = camera(DVec3::Z * 1e5, 0.05);
        let picture = render(&world, &view, 31, 21, &Options::default()).unwrap();
        let pixel = 2.0 * 0.025f64.to_radians().tan() / 21.0 * 1e5;
        for i in 8..23 {
            let x = (i as f64 - 15.0) * pixel;
            let slope = 8.0 * bend * x / (w * w);
            let (t, up) = (DVec3::new(1.0, 0.0, slope).normalize(), DVec3::new(-slope, 0.0, 1.0).normalize());
            let normal = if frame == NormalFrame::Blade { n } else { t * n.x + DVec3::Y * n.y + up * n.z };
            let expected = 3.0 * 0.5 / PI * normal.dot(l);
            let found = f64::from(picture.hdr[10 * 31 + i][0]);
            assert!((found / expected - 1.0).abs() < 2e-3, "{frame:?} at {x}: {found} against {expected}");
        }
    }
}

/// γ and thickness are interpolated first and the slab solved then; maps interpolate what was solved.
#[test]
fn scalars_solve_between_texels() {
    let slab = |h: f64| ([(-3.0 * h).exp(), 0.2, 0.1], [(-9.0 * h).exp(), 0.3, h]);
    let side = ReferenceSide {
        interior: Interior::Scalars {
            gamma: [vec![1.0, 0.5], vec![1.0; 2], vec![1.0; 2]],
            thickness: vec![0.1, 0.4],
            curve: Arc::new(slab),
        },
        gloss: None,
        normal: None,
    };
    let card = ReferenceLeaf {
        mesh: blade(20.0, 20.0, 1, 0.0),
        width: 2,
        height: 1,
        front: side.clone(),
        back: side,
        mask: None,
        lobe: Lobe::Ggx,
    };
    let world = alone(card, None, Some([1.0; 3]));
    let (width, height) = (41, 9);
    let view = camera(DVec3::Z * 2000.0, 0.12);
    let picture = render(&world, &view, width, height, &Options { samples_per_pixel: 256, ..Options::default() }).unwrap();
    let lens = Lens::new(&view, width, height).unwrap();
    for i in 0..width {
        let mean = (0..40).map(|s| {
            let ray = lens.ray(i as f64 + (s as f64 + 0.5) / 40.0, 4.5);
            let u = ray.direction.x / -ray.direction.z * 2000.0 / 20.0 + 0.5;
            let at = |u: f64| (2.0 * u - 0.5).clamp(0.0, 1.0);
            // the far side's map runs the other way
            let (near, far) = (at(u), at(1.0 - u));
            (1.0 - 0.5 * near) * slab(0.1 + 0.3 * near).0[0] + slab(0.1 + 0.3 * far).1[0]
        });
        let expected = mean.sum::<f64>() / 40.0;
        let found = f64::from(picture.hdr[4 * width + i][0]);
        assert!((found - expected).abs() < 1e-4, "column {i}: {found} against {expected}");
    }
}

#[test]
fn masks_cut_at_one_half_and_let_the_sun_through() {
    // a 4×1 mask whose edge lies halfway across: everything left of it is there
    let side = || ReferenceSide {
        interior: Interior::Maps { rho_d: [(); 3].map(|_| vec![0.5; 4]), rho_t: [(); 3].map(|_| vec![0.0; 4]) },
        gloss: None,
        normal: None,
    };
    let card = ReferenceLeaf {
        mesh: blade(40.0, 40.0, 1, 0.0),
        width: 4,
        height: 1,
        front: side(),
        back: side(),
        mask: Some(vec![1, 1, 0, 0]),
        lobe: Lobe::Beckmann,
    };
    let mut world = alone(card, sun(DVec3::Z, 0.0), None);
    let view = camera(DVec3::Z * 100.0, 20.0);
    let picture = render(&world, &view, 60, 60, &Options::default()).unwrap();
    for (x, covered) in [(2, 1.0), (28, 1.0), (31, 0.0), (57, 0.0)] {
        assert_eq!(picture.hdr[30 * 60 + x][3], covered, "column {x}");
    }
    // a second one right above: its missing half casts no shadow
    world.instances.push(Placement { leaf: 0, transform: DMat4::from_translation(DVec3::Z * 200.0) });
    world.instances[0].transform = DMat4::from_scale(DVec3::splat(4.0));
    let renderer = Renderer::new(&world).unwrap();
    assert_eq!(renderer.sun_visibility(DVec3::new(-10.0, 0.0, 50.0), 16, 1), Some(0.0));
    assert_eq!(renderer.sun_visibility(DVec3::new(10.0, 0.0, 50.0), 16, 1), Some(1.0));
}

#[test]
fn pictures_depend_on_the_seed_and_not_on_the_threads() {
    let (world, view) = portrait();
    let shot = |threads: usize, seed: u64| -> ReferencePicture {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = Options { samples_per_pixel: 4, sun_samples: 2, seed, ..Options::default() };
        pool.install(|| render(&world, &view, 80, 60, &options).unwrap())
    };
    let one = shot(1, 1);
    assert_eq!(one, shot(2, 1));
    assert_ne!(one.hdr, shot(2, 2).hdr);
}

/// The printed noise is the spread that other seeds show.
#[test]
fn the_printed_noise_is_honest() {
    let (world, view) = portrait();
    let renderer = Renderer::new(&world).unwrap();
    let shots: Vec<_> =
        (0..6).map(|seed| renderer.render(&view, 80, 60, &Options { seed, sun_samples: 1, ..Options::default() }).unwrap()).collect();
    // root mean square over the picture, in display units of the green channel, against the printed worst channel
    let value = |p: &ReferencePicture, k: usize| f64::from(p.ldr[k][1]) / 255.0;
    let (mut spread, mut printed, mut count) = (0.0, 0.0, 0);
    for k in 0..80 * 60 {
        let mean = shots.iter().map(|p| value(p, k)).sum::<f64>() / 6.0;
        let variance = shots.iter().map(|p| (value(p, k) - mean).powi(2)).sum::<f64>() / 5.0;
        if shots[0].hdr[k][3] > 0.0 {
            spread += variance;
            printed += shots.iter().map(|p| f64::from(p.noise[k]).powi(2)).sum::<f64>() / 6.0;
            count += 1;
        }
    }
    let ratio = (printed / spread).sqrt();
    assert!(
        count > 1000 && (0.8..1.6).contains(&ratio),
        "printed {:.5}, seen {:.5}",
        (printed / count as f64).sqrt(),
        (spread / count as f64).sqrt()
    );
}

#[test]
fn worlds_that_do_not_fit_together_are_refused() {
    let (world, view) = portrait();
    let refused = |edit: &dyn Fn(&mut World), expected: &str| {
        let mut broken = world.clone();
        edit(&mut broken);
        let said = render(&broken, &view, 4, 3, &Options::default()).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(said.contains(expected), "{said:?} does not say {expected:?}");
    };
    refused(&|w| w.leaves[0].width = 7, "expected 7×64 = 448");
    refused(&|w| w.instances[0].leaf = 3, "leaf 3 wanted");
    refused(&|w| w.instances[0].transform = DMat4::ZERO, "cannot be inverted");
    refused(&|w| w.leaves[0].mesh.indices[0] = 1 << 20, "indices");
    refused(&|w| w.leaves[0].front.gloss.as_mut().unwrap().m.truncate(3), "front m: 3 texels");
    refused(&|w| w.sun.as_mut().unwrap().direction = DVec3::ZERO, "sun direction");
    refused(&|w| w.leaves[0].mesh.positions[0].x = f64::NAN, "finite");
    refused(
        &|w| {
            w.leaves[0].mesh.tangents = vec![DVec4::X; 2];
            w.leaves[0].back.normal.as_mut().unwrap().frame = NormalFrame::Tangent;
        },
        "back normals need tangents",
    );
    assert!(render(&world, &view, 0, 3, &Options::default()).is_err());
    assert!(render(&world, &view, 4, 3, &Options { samples_per_pixel: 0, ..Options::default() }).is_err());
    assert!(render(&world, &Camera { target: view.eye, ..view }, 4, 3, &Options::default()).is_err());
    // an empty world is its background
    let nothing = render(&World { background: [0.5, 0.25, 0.125], ..World::default() }, &view, 2, 2, &Options::default()).unwrap();
    assert_eq!(nothing.hdr[3], [0.5, 0.25, 0.125, 0.0]);
}

#[cfg(feature = "render")]
mod judging {
    use super::*;
    use mesophyll::transport::compare::{compare, difference_picture, noise_floor};

    const SIZE: (usize, usize) = (96, 72);

    fn both(leaf: &mut ReferenceLeaf) -> [&mut ReferenceSide; 2] {
        [&mut leaf.front, &mut leaf.back]
    }

    fn shot(world: &World, view: &Camera, seed: u64) -> ReferencePicture {
        render(world, view, SIZE.0, SIZE.1, &Options { seed, ..Options::default() }).unwrap()
    }

    #[test]
    fn a_picture_equals_itself_and_one_pixel_is_found() {
        let (world, view) = portrait();
        let picture = shot(&world, &view, 1);
        let same = compare(&picture, &picture.ldr).unwrap();
        assert_eq!((same.flip_mean, same.flip_p99, same.max_error, same.error_p99), (0.0, 0.0, Some(0.0), Some(0.0)));
        assert!(same.interior_share > 0.8, "{}", same.interior_share);
        assert!(difference_picture(&picture.ldr, &picture.ldr, 8.0).iter().all(|&x| x == 128));
        assert_eq!(same.flip_picture().len(), 3 * SIZE.0 * SIZE.1);

        let at = 36 * SIZE.0 + 48;
        assert!(picture.interior[at] && !picture.penumbra[at]);
        let mut spoilt = picture.ldr.clone();
        spoilt[at][1] = spoilt[at][1].wrapping_add(51);
        let found = compare(&picture, &spoilt).unwrap();
        assert_eq!((found.max_error, found.max_at), (Some(51.0 / 255.0), Some((48, 36))));
        assert!(found.flip_mean > 0.0 && found.error_p99 == Some(0.0));

        // an edge pixel is not judged by the largest error, but FLIP sees it
        let edge = picture.interior.iter().position(|i| !i).unwrap();
        let mut spoilt = picture.ldr.clone();
        spoilt[edge][0] ^= 0xff;
        let found = compare(&picture, &spoilt).unwrap();
        assert_eq!(found.max_error, Some(0.0));
        assert!(found.flip_mean > 0.0);
        assert!(compare(&picture, &spoilt[1..]).is_err());
    }

    /// Mistakes that a renderer makes must stand far above the reference's own noise, from both sides and with light from both.
    #[test]
    fn wrong_pictures_stand_out_of_the_noise() {
        let (world, view) = portrait();
        let encode = |x: f32| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        // name, whether it is a gross one, how it is made
        type Mistake = (&'static str, bool, Box<dyn Fn(&mut World)>);
        let mistakes: [Mistake; 5] = [
            ("mirrored normal", true, {
                Box::new(|w| {
                    for side in both(&mut w.leaves[0]) {
                        side.normal.as_mut().unwrap().values.iter_mut().for_each(|n| n[0] = -n[0]);
                    }
                })
            }),
            ("swapped sides", true, {
                Box::new(|w| {
                    let leaf = &mut w.leaves[0];
                    std::mem::swap(&mut leaf.front, &mut leaf.back);
                })
            }),
            ("sRGB read as linear", true, {
                Box::new(move |w| {
                    for side in both(&mut w.leaves[0]) {
                        let Interior::Maps { rho_d, rho_t } = &mut side.interior else { panic!("the portrait has maps") };
                        rho_d.iter_mut().chain(rho_t).flatten().for_each(|x| *x = encode(*x));
                    }
                })
            }),
            ("a blade 1.3 times too thick", false, {
                Box::new(|w| {
                    for side in both(&mut w.leaves[0]) {
                        let Interior::Maps { rho_t, .. } = &mut side.interior else { panic!("the portrait has maps") };
                        rho_t.iter_mut().flatten().for_each(|t| *t = t.powf(1.3));
                    }
                })
            }),
            ("maps shifted by a texel", false, {
                Box::new(|w| {
                    for side in both(&mut w.leaves[0]) {
                        let Interior::Maps { rho_d, rho_t } = &mut side.interior else { panic!("the portrait has maps") };
                        rho_d.iter_mut().chain(rho_t).for_each(|m| m.rotate_right(1));
                    }
                })
            }),
        ];
        for (place, eye, lamp) in [
            ("front lit", view.eye, DVec3::new(0.5, 0.4, 1.0)),
            ("back lit", view.eye, DVec3::new(0.5, 0.4, -1.0)),
            ("from behind", view.eye * DVec3::new(1.0, 1.0, -1.0), DVec3::new(0.5, 0.4, -1.0)),
        ] {
            let mut world = world.clone();
            world.sun = sun(lamp, SUN);
            // close up, so that a pixel is smaller than a texel
            let view = Camera { eye, fov_y_deg: 14.0, ..view };
            let reference = shot(&world, &view, 1);
            let floor = noise_floor(&reference, &shot(&world, &view, 2)).unwrap();
            for (name, gross, spoil) in &mistakes {
                let mut wrong = world.clone();
                spoil(&mut wrong);
                let found = compare(&reference, &shot(&wrong, &view, 3).ldr).unwrap();
                println!(
                    "{place}, {name}: flip p99 {:.4} (floor {:.4}), largest {:.4} (floor {:.4})",
                    found.flip_p99,
                    floor.flip_p99,
                    found.max_error.unwrap(),
                    floor.max_error.unwrap()
                );
                // one 8-bit step of rounding is part of any floor
                let (found_max, floor_max) = (found.max_error.unwrap(), floor.max_error.unwrap().max(1.0 / 255.0));
                // small mistakes: seen at all
                if !gross {
                    assert!(found_max > floor_max, "{place}, {name}: largest error {found_max} against a floor of {floor_max}");
                    continue;
                }
                assert!(found_max > 3.0 * floor_max, "{place}, {name}: largest error {found_max} against a floor of {floor_max}");
                let least = 2.0 * floor.flip_p99;
                assert!(found.flip_p99 > least, "{place}, {name}: FLIP {} against a floor of {}", found.flip_p99, floor.flip_p99);
            }
        }
    }
}
