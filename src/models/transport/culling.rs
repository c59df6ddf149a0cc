//! Which things of a world a picture shows. What none of a scene's pictures shows needs no light of its own.

use crate::Result;
use crate::camera::{CameraRays, ReferenceCamera};
use crate::stage::Stage;
use crate::world::ReferenceWorld;
use rayon::prelude::*;

/// For each of the world's instances, with those of groups, whether any of these cameras sees it in a picture of
/// `width` × `height` pixels. One ray is sent through the middle of every pixel. It may therefore miss a thing of which
/// less than a pixel shows, also one that is so small that nothing hides it.
///
/// # Errors
/// [`crate::Error::Input`] for a world that contradicts itself, [`crate::Error::Usage`] for a camera that looks
/// nowhere, [`crate::Error::Interrupted`] after Ctrl-C.
pub fn shown(world: &ReferenceWorld, cameras: &[ReferenceCamera], [width, height]: [usize; 2]) -> Result<Vec<bool>> {
    world.validate()?;
    let stage = Stage::new(world);
    let mut shown = vec![false; stage.instances()];
    for camera in cameras {
        let lens = CameraRays::new(camera, width, height)?;
        let rows: Vec<Vec<bool>> = (0..height)
            .into_par_iter()
            .fold(
                || vec![false; stage.instances()],
                |mut shown, y| {
                    if !mesophyll_files::progress::stop_requested() {
                        for x in 0..width {
                            if let Some(met) = stage.nearest(&lens.ray(x as f64 + 0.5, y as f64 + 0.5)) {
                                shown[met.hit.instance] = true;
                            }
                        }
                    }
                    shown
                },
            )
            .collect();
        mesophyll_files::progress::go_on()?;
        for row in rows {
            shown.iter_mut().zip(row).for_each(|(s, r)| *s |= r);
        }
    }
    Ok(shown)
}

/// Places of the samples within a pixel, those of multisampled pictures.
const SAMPLES: [[f64; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];

/// For each pixel of a picture, row by row, the share that surfaces cover.
///
/// # Errors
/// As [`shown`].
pub fn covered(world: &ReferenceWorld, camera: &ReferenceCamera, [width, height]: [usize; 2]) -> Result<Vec<f32>> {
    world.validate()?;
    let stage = Stage::new(world);
    let lens = CameraRays::new(camera, width, height)?;
    let meets = |x: usize, y: usize, [dx, dy]: [f64; 2]| {
        f32::from(u8::from(stage.nearest(&lens.ray(x as f64 + dx, y as f64 + dy)).is_some()))
    };
    let pixel = |k: usize| {
        if mesophyll_files::progress::stop_requested() {
            return 0.0;
        }
        SAMPLES.iter().map(|at| meets(k % width, k / width, *at)).sum::<f32>() / SAMPLES.len() as f32
    };
    let shares = (0..width * height).into_par_iter().map(pixel).collect();
    mesophyll_files::progress::go_on()?;
    Ok(shares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_worlds::plates;
    use glam::DVec3;

    fn camera(eye: DVec3, target: DVec3) -> ReferenceCamera {
        ReferenceCamera { eye, target, up: DVec3::Y, fov_y_deg: 60.0 }
    }

    /// Three level squares stand over each other. A camera above sees only the highest, one below only the lowest, one
    /// beside all three; several cameras see what any of them does. A hole in the highest shows the next.
    #[test]
    fn what_others_hide_is_not_shown() {
        let mut world = plates(5.0, &[0.0, 2.0, 4.0].map(|z| (z, [0.3; 2], 0.2)));
        let (above, below) = (DVec3::Z * 20.0, DVec3::Z * -20.0);
        let down = camera(above, DVec3::ZERO);
        let of = |world: &ReferenceWorld, cameras: &[ReferenceCamera]| shown(world, cameras, [40, 30]).unwrap();
        assert_eq!(of(&world, &[down]), [false, false, true]);
        assert_eq!(of(&world, &[camera(below, DVec3::ZERO)]), [true, false, false]);
        assert_eq!(of(&world, &[down, camera(below, DVec3::ZERO)]), [true, false, true]);
        assert_eq!(of(&world, &[camera(DVec3::new(15.0, 0.0, 3.0), DVec3::Z * 2.0)]), [true; 3]);
        assert_eq!(of(&world, &[camera(above, DVec3::Z * 40.0)]), [false; 3]);
        // The middle texel of nine is cut out.
        (world.leaves[2].width, world.leaves[2].height) = (3, 3);
        let mut mask = vec![255; 9];
        mask[4] = 0;
        world.leaves[2].mask = Some(mask);
        let leaf = &mut world.leaves[2];
        for side in [&mut leaf.front, &mut leaf.back] {
            *side = crate::test_worlds::side(0.3, 0.2, None);
            if let crate::world::ReferenceInterior::Maps { rho_d, rho_t } = &mut side.interior {
                rho_d.iter_mut().chain(rho_t).for_each(|map| map.resize(9, map[0]));
            }
        }
        assert_eq!(of(&world, &[down]), [false, true, true]);
        assert!(shown(&world, &[camera(above, above)], [40, 30]).is_err());
        assert!(covered(&world, &camera(above, above), [40, 30]).is_err());
    }

    /// A square of 10 mm fills its share of the picture, in quarters of a pixel.
    #[test]
    fn surfaces_cover_their_share_of_the_picture() {
        let world = plates(5.0, &[(0.0, [0.3; 2], 0.2)]);
        let shares = |target| covered(&world, &camera(DVec3::Z * 20.0, target), [160, 120]).unwrap();
        let sum: f32 = shares(DVec3::ZERO).iter().sum();
        let across = 10.0 / (2.0 * 20.0 * 30f32.to_radians().tan()) * 120.0;
        assert!((sum / (across * across) - 1.0).abs() < 0.02, "{sum} {}", across * across);
        assert!(shares(DVec3::ZERO).iter().all(|s| (4.0 * s).fract() == 0.0));
        assert!(shares(DVec3::Z * 40.0).iter().all(|s| *s == 0.0));
    }
}
