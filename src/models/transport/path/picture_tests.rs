//! Pictures as a whole: their stated errors, what is stored and taken up again, and paths that are followed together.

use super::picture::{DrawingOutcome, PathPicture};
use super::tests::BOTH;
use super::*;
use crate::camera::ReferenceCamera;
use crate::test_worlds::{leaf, plates, square};
use crate::world::{ReferencePlacement, ReferenceSun};
use glam::DMat4;

fn picture_of(world: &ReferenceWorld, samples: u32, seed: u64) -> PathPicture {
    let tracer = PathTracer::new(world, BOTH).unwrap();
    let mut picture = PathPicture::new(24, 24);
    let request = PathRequest {
        camera: ReferenceCamera { eye: DVec3::new(3.0, 5.0, 60.0), target: DVec3::ZERO, up: DVec3::Y, fov_y_deg: 40.0 },
        size: [24, 24],
        seed,
        target: SamplingTarget { samples: Some(samples), error: None },
    };
    assert_eq!(picture.draw(&tracer, &request, "test", &mut |_| Ok(())).unwrap(), DrawingOutcome::Done);
    picture
}

fn lit_plates() -> ReferenceWorld {
    let mut world = plates(15.0, &[(0.0, [0.5, 0.5], 0.3), (9.0, [0.3, 0.2], 0.4)]);
    world.instances[1].transform =
        DMat4::from_rotation_translation(glam::DQuat::from_rotation_x(0.7), DVec3::new(4.0, 2.0, 12.0));
    world.sky = Some([0.5; 3]);
    world.sun =
        Some(ReferenceSun { direction: DVec3::new(0.3, 0.1, 0.9).normalize(), irradiance: [2.0; 3], radius: 0.1 });
    world
}

/// The stated errors are right, tested over blocks of pixels with a picture of many more paths. Blocks that a corner of
/// a leaf just touches do not count for the intervals, but they do for the variance. Few paths meet the leaf there, and
/// their mean is far from normally distributed.
#[test]
fn stated_errors_are_true() {
    const BLOCK: usize = 4;
    let world = lit_plates();
    // The errors of this picture are added to the stated ones, so it need not be much more accurate than the pictures.
    let truth = picture_of(&world, 1024, 5);
    let blocks = 24 / BLOCK;
    for (samples, seeds) in [(16, 40), (50, 40)] {
        let (mut count, mut inside, mut off, mut stated) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..seeds {
            let picture = picture_of(&world, samples, 100 + seed);
            for block in 0..blocks * blocks {
                let (x, y) = (block % blocks * BLOCK, block / blocks * BLOCK);
                let (mut difference, mut variance, mut covered) = (0.0, 0.0, true);
                for k in (0..BLOCK * BLOCK).map(|q| (y + q / BLOCK) * 24 + x + q % BLOCK) {
                    difference += f64::from(picture.mean[k][1] - truth.mean[k][1]);
                    variance += f64::from(picture.error(k)[1]).powi(2) + f64::from(truth.error(k)[1]).powi(2);
                    covered &= truth.mean[k][1] > 0.02;
                }
                // A block that shows only background has no error, and none is stated.
                assert!(variance > 0.0 || difference == 0.0);
                (off, stated) = (off + difference * difference, stated + variance);
                if covered {
                    count += 1.0;
                    inside += f64::from(u8::from(difference.abs() <= 1.96 * variance.sqrt()));
                }
            }
        }
        assert!(count > 500.0, "{count}");
        assert!((0.93..=0.97).contains(&(inside / count)), "{samples}: {} of {count}", inside / count);
        assert!((off / stated - 1.0).abs() < 0.1, "{samples}: {}", off / stated);
    }
}

#[test]
fn a_stored_picture_goes_on_to_the_same_bits() {
    let world = lit_plates();
    let tracer = PathTracer::new(&world, BOTH).unwrap();
    let whole = picture_of(&world, 40, 3);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("part.exr");
    let mut picture = PathPicture::new(24, 24);
    let request = |samples| PathRequest {
        camera: ReferenceCamera { eye: DVec3::new(3.0, 5.0, 60.0), target: DVec3::ZERO, up: DVec3::Y, fov_y_deg: 40.0 },
        size: [24, 24],
        seed: 3,
        target: SamplingTarget { samples: Some(samples), error: None },
    };
    // The picture is stored after every round. The first store that is not the last is continued.
    let mut rounds = 0;
    loop {
        let lens = crate::camera::CameraRays::new(&request(40).camera, 24, 24).unwrap();
        // One row at a time, as in an interrupted picture.
        let j = rounds % 24;
        let (row, _) = tracer.row(&lens, j, 24, 5, |i| picture::pixel_seed(3, j * 24 + i, 0)).unwrap();
        picture.take(j, 5, &row);
        rounds += 1;
        if rounds == 7 {
            break;
        }
    }
    picture.store(&path).unwrap();
    let mut again = PathPicture::restore(&path, [24, 24]).unwrap();
    assert_eq!(again, picture);
    again.draw(&tracer, &request(40), "test", &mut |_| Ok(())).unwrap();
    assert_eq!(again, whole);
    assert_eq!(again.paths(), [40, 40]);
    // More paths than the first time.
    again.draw(&tracer, &request(72), "test", &mut |_| Ok(())).unwrap();
    assert_eq!(again.paths(), [72, 72]);
    assert!(again.median_error().unwrap() < whole.median_error().unwrap());
    assert!(PathPicture::restore(&path, [24, 25]).is_err());
}

/// A path brings the same, to the last bit, alone and beside others, whose rays take turns. Some leaves have holes.
#[test]
fn paths_side_by_side_bring_what_they_bring_alone() {
    let mut world = lit_plates();
    world.leaves.push(leaf(square(3.0), [0.8, 0.3], 0.15, Some((0.2, 0.3))));
    for k in 0..30 {
        let f = f64::from(k);
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, f, 2.0 * f, 0.3 * f);
        let at = DVec3::new((1.7 * f).sin() * 9.0, (2.9 * f).cos() * 9.0, 0.3 * f);
        let leaf = world.leaves.len() - 1;
        world.instances.push(ReferencePlacement { leaf, transform: DMat4::from_rotation_translation(turn, at) });
    }
    let last = world.leaves.last_mut().unwrap();
    (last.width, last.height, last.mask) = (3, 3, Some(vec![255, 255, 0, 255, 0, 255, 255, 255, 255]));
    for side in [&mut last.front, &mut last.back] {
        let crate::ReferenceInterior::Maps { rho_d, rho_t } = &mut side.interior else { panic!("other maps") };
        let gloss = side.gloss.iter_mut().flat_map(|g| g.rho_s.iter_mut().chain([&mut g.m]));
        rho_d.iter_mut().chain(rho_t).chain(gloss).for_each(|map| map.resize(9, map[0]));
    }
    for bounces in [None, Some(3)] {
        let tracer = PathTracer::new(&world, PathSettings { bounces, strategy: SamplingStrategy::Both }).unwrap();
        let begin = |k: u32| {
            let f = f64::from(k);
            let from = DVec3::new(f.sin() * 20.0, f.cos() * 20.0, 30.0);
            let to = DVec3::new((3.0 * f).sin(), (5.0 * f).cos(), 0.1) * 8.0;
            (Ray::new(from, (to - from).normalize()), PathSampler::new(5, k))
        };
        let (rays, mut samples): (Vec<Ray>, Vec<PathSampler>) = (0..400).map(begin).unzip();
        let together = tracer.follow_each(rays.into_iter().zip(&mut samples));
        let mut met = 0;
        for (k, brought) in (0..).zip(together) {
            let (ray, mut samples) = begin(k);
            let alone = tracer.follow(ray, &mut samples);
            assert_eq!(brought.radiance.map(f64::to_bits), alone.radiance.map(f64::to_bits), "path {k}");
            assert_eq!((brought.met, brought.cut), (alone.met, alone.cut), "path {k}");
            met += usize::from(alone.met);
        }
        assert!(met > 200, "{met}");
    }
}
