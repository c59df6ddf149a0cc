//! Comparisons of pictures: equal pictures must be called equal, and errors of a renderer must be visible in the
//! figures.

use super::*;
use mesophyll::transport::comparison::{compare, difference_picture, noise_floor};

const SIZE: (usize, usize) = (96, 72);

fn both(leaf: &mut ReferenceLeaf) -> [&mut ReferenceSide; 2] {
    [&mut leaf.front, &mut leaf.back]
}

fn shot(world: &ReferenceWorld, view: &ReferenceCamera, seed: u64) -> ReferencePicture {
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
    assert_eq!(same.flip_picture(1.0).len(), 3 * SIZE.0 * SIZE.1);

    let at = 36 * SIZE.0 + 48;
    assert!(picture.interior[at] && !picture.penumbra[at]);
    let mut spoilt = picture.ldr.clone();
    spoilt[at][1] = spoilt[at][1].wrapping_add(51);
    let found = compare(&picture, &spoilt).unwrap();
    assert_eq!((found.max_error, found.max_at), (Some(51.0 / 255.0), Some((48, 36))));
    assert!(found.flip_mean > 0.0 && found.error_p99 == Some(0.0));
    // The scale of the FLIP map ends at the stated value. There the worst pixel has the lightest colour, and with twice
    // this value a darker one.
    let worst = (0..found.flip.len()).max_by(|&a, &b| found.flip[a].total_cmp(&found.flip[b])).unwrap();
    let shade = |top: f64| found.flip_picture(top)[3 * worst];
    assert!(shade(f64::from(found.flip[worst])) == 0xfc && shade(2.0 * f64::from(found.flip[worst])) < 0xf0);

    // The largest error leaves out edge pixels, but FLIP includes them.
    let edge = picture.interior.iter().position(|i| !i).unwrap();
    let mut spoilt = picture.ldr.clone();
    spoilt[edge][0] ^= 0xff;
    let found = compare(&picture, &spoilt).unwrap();
    assert_eq!(found.max_error, Some(0.0));
    assert!(found.flip_mean > 0.0);
    assert!(compare(&picture, &spoilt[1..]).is_err());
}

/// Typical errors of a renderer must stand far above the reference's own noise, from both sides and with light from
/// both.
#[test]
fn wrong_pictures_stand_out_of_the_noise() {
    let (world, view) = portrait();
    let encode = |x: f32| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    // Name, whether it is a gross error, and how it is made.
    type Mistake = (&'static str, bool, Box<dyn Fn(&mut ReferenceWorld)>);
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
                    let ReferenceInterior::Maps { rho_d, rho_t } = &mut side.interior else {
                        panic!("the portrait has maps")
                    };
                    rho_d.iter_mut().chain(rho_t).flatten().for_each(|x| *x = encode(*x));
                }
            })
        }),
        ("a blade 1.3 times too thick", false, {
            Box::new(|w| {
                for side in both(&mut w.leaves[0]) {
                    let ReferenceInterior::Maps { rho_t, .. } = &mut side.interior else {
                        panic!("the portrait has maps")
                    };
                    rho_t.iter_mut().flatten().for_each(|t| *t = t.powf(1.3));
                }
            })
        }),
        ("maps shifted by a texel", false, {
            Box::new(|w| {
                for side in both(&mut w.leaves[0]) {
                    let ReferenceInterior::Maps { rho_d, rho_t } = &mut side.interior else {
                        panic!("the portrait has maps")
                    };
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
        // The camera is so close that a pixel is smaller than a texel.
        let view = ReferenceCamera { eye, fov_y_deg: 14.0, ..view };
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
            // Any noise floor includes one 8-bit step of rounding.
            let (found_max, floor_max) = (found.max_error.unwrap(), floor.max_error.unwrap().max(1.0 / 255.0));
            // Small errors must at least be detected.
            if !gross {
                assert!(
                    found_max > floor_max,
                    "{place}, {name}: largest error {found_max} against a floor of {floor_max}"
                );
                continue;
            }
            assert!(
                found_max > 3.0 * floor_max,
                "{place}, {name}: largest error {found_max} against a floor of {floor_max}"
            );
            let least = 2.0 * floor.flip_p99;
            assert!(
                found.flip_p99 > least,
                "{place}, {name}: FLIP {} against a floor of {}",
                found.flip_p99,
                floor.flip_p99
            );
        }
    }
}
