//! The reference renderer is compared with closed forms, analytic geometry and itself. The leaves are built by hand.

use glam::{DMat4, DVec3};
use mesophyll::transport::CameraRays;
use mesophyll::transport::closed_form::FlatLeaf;
use mesophyll::transport::lobe::Lobe;
use mesophyll::transport::{
    NormalFrame, Options, ReferenceCamera, ReferenceInterior, ReferenceLeaf, ReferencePicture, ReferencePlacement,
    ReferenceRenderer, ReferenceSide, ReferenceSun, ReferenceWorld, render,
};
use std::f64::consts::PI;
use std::sync::Arc;

#[cfg(feature = "render")]
mod judging;
mod normals;
mod shadow;
mod stage;

use stage::{SUN, alone, blade, camera, leaf, portrait, sun, uniform, veined};

/// Mean of the closed form over a pixel's square, by a 3×3 midpoint rule.
fn over_pixel(
    card: &FlatLeaf,
    lens: &CameraRays,
    x: usize,
    y: usize,
    sun: Option<&ReferenceSun>,
    sky: Option<[f64; 3]>,
) -> [f64; 3] {
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
            // A low sun behind the card, where the cavities hide the light, and a low view.
            (DVec3::new(60.0, 10.0, 60.0), sun(DVec3::new(-1.0, 0.0, 0.25), 0.0), None),
            (DVec3::new(80.0, 0.0, 20.0), sun(DVec3::new(-0.4, 0.0, 0.5), 0.0), None),
            (DVec3::new(10.0, 80.0, 25.0), None, Some([0.5, 0.7, 1.0])),
            (DVec3::new(-30.0, -20.0, -70.0), sun(DVec3::new(0.3, 0.2, -1.0), SUN), Some([0.5, 0.7, 1.0])),
            (DVec3::new(-30.0, -20.0, -70.0), sun(DVec3::new(0.3, 0.2, 1.0), SUN), None),
        ] {
            let world = alone(leaf(blade(400.0, 400.0, 2, 0.0), front.clone(), back.clone(), lobe), lamp, sky);
            let view = camera(eye, 4.0);
            let options = Options { samples_per_pixel: 64, ..Options::default() };
            let picture = render(&world, &view, 12, 9, &options).unwrap();
            let card = if eye.z > 0.0 {
                FlatLeaf { rho_d: front_d, rho_s: front_s, m: 0.25, lobe, rho_t_far: back_t, normal: DVec3::Z }
            } else {
                FlatLeaf { rho_d: back_d, rho_s: back_s, m: 0.5, lobe, rho_t_far: front_t, normal: -DVec3::Z }
            };
            let lens = CameraRays::new(&view, 12, 9).unwrap();
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
    assert_eq!(seen, 3 * 7 * 108 * 3);
}

#[test]
fn a_white_furnace_gives_the_sky_back() {
    let side = |d: f64| uniform([d; 3], [0.3; 3], None);
    for (eye, rho_d) in [(DVec3::Z * 90.0, 0.7), (DVec3::new(20.0, 5.0, -90.0), 0.7)] {
        let world =
            alone(leaf(blade(30.0, 30.0, 6, 5.0), side(rho_d), side(rho_d), Lobe::Ggx), None, Some([0.4, 0.8, 1.2]));
        let picture = render(&world, &camera(eye, 30.0), 40, 30, &Options::default()).unwrap();
        let inside: Vec<_> = picture.hdr.iter().filter(|p| p[3] == 1.0).collect();
        assert!(inside.len() > 100);
        for p in inside {
            assert!((p[0] - 0.4).abs() < 1e-6 && (p[1] - 0.8).abs() < 1e-6 && (p[2] - 1.2).abs() < 1e-6, "{p:?}");
        }
    }
}

/// The blade is turned over, and its sides are exchanged. The picture must stay the same, with mirrored maps and turned
/// normals, those of the far side too.
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
                    // By rounding, one ray in thousands falls on the other side of the outline.
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
        interior: ReferenceInterior::Maps {
            rho_d: [vec![left, right], vec![0.1; 2], vec![0.1; 2]],
            rho_t: [(); 3].map(|_| vec![0.0; 2]),
        },
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

/// With scalars, γ and thickness are interpolated first and then the slab is solved. Maps interpolate the solutions.
#[test]
fn scalars_solve_between_texels() {
    let slab = |h: f64| ([(-3.0 * h).exp(), 0.2, 0.1], [(-9.0 * h).exp(), 0.3, h]);
    let side = ReferenceSide {
        interior: ReferenceInterior::Scalars {
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
    let picture =
        render(&world, &view, width, height, &Options { samples_per_pixel: 256, ..Options::default() }).unwrap();
    let lens = CameraRays::new(&view, width, height).unwrap();
    for i in 0..width {
        let mean = (0..40).map(|s| {
            let ray = lens.ray(i as f64 + (s as f64 + 0.5) / 40.0, 4.5);
            let u = ray.direction.x / -ray.direction.z * 2000.0 / 20.0 + 0.5;
            let at = |u: f64| (2.0 * u - 0.5).clamp(0.0, 1.0);
            // The far side's map runs in the opposite direction.
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
    // A mask of 4×1 texels whose edge is halfway across. Everything left of it belongs to the leaf.
    let side = || ReferenceSide {
        interior: ReferenceInterior::Maps {
            rho_d: [(); 3].map(|_| vec![0.5; 4]),
            rho_t: [(); 3].map(|_| vec![0.0; 4]),
        },
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
    // A second leaf right above: its missing half casts no shadow.
    world.instances.push(ReferencePlacement { leaf: 0, transform: DMat4::from_translation(DVec3::Z * 200.0) });
    world.instances[0].transform = DMat4::from_scale(DVec3::splat(4.0));
    let renderer = ReferenceRenderer::new(&world).unwrap();
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

/// The printed noise is the spread over other seeds.
#[test]
fn the_printed_noise_is_honest() {
    let (world, view) = portrait();
    let renderer = ReferenceRenderer::new(&world).unwrap();
    let shots: Vec<_> = (0..6)
        .map(|seed| renderer.render(&view, 80, 60, &Options { seed, sun_samples: 1, ..Options::default() }).unwrap())
        .collect();
    // The root mean square over the picture, in display units of the green channel, is compared with the printed worst
    // channel.
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
    let refused = |edit: &dyn Fn(&mut ReferenceWorld), expected: &str| {
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
            w.leaves[0].mesh.tangents = vec![(DVec3::X, 0.0); 2];
            w.leaves[0].back.normal.as_mut().unwrap().frame = NormalFrame::Tangent;
        },
        "back normals need tangents",
    );
    assert!(render(&world, &view, 0, 3, &Options::default()).is_err());
    assert!(render(&world, &view, 4, 3, &Options { samples_per_pixel: 0, ..Options::default() }).is_err());
    assert!(render(&world, &ReferenceCamera { target: view.eye, ..view }, 4, 3, &Options::default()).is_err());
    // An empty world shows its background.
    let nothing = render(
        &ReferenceWorld { background: [0.5, 0.25, 0.125], ..ReferenceWorld::default() },
        &view,
        2,
        2,
        &Options::default(),
    )
    .unwrap();
    assert_eq!(nothing.hdr[3], [0.5, 0.25, 0.125, 0.0]);
}
