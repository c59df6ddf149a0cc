//! The transfer is compared with closed forms, and its two forms of a light with each other.

use super::*;
use crate::dome::ReferenceDome;
use crate::path::{PathSettings, PathTracer};
use crate::test_worlds::{leaf, plates, side, square};
use crate::world::{ReferencePlacement, ReferenceSun, ReferenceWorld};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_sky::harmonics::HarmonicBasis;
use std::f64::consts::PI;
use std::sync::Arc;

/// The light that arrives at every anchor of an instance, under a light with these coefficients for each channel.
fn under(found: &InstanceTransfer, rows: usize, light: &[[f64; 3]]) -> Vec<Vec<[f64; 3]>> {
    let row = |entries: &[[f32; 4]]| {
        [0, 1, 2].map(|c| entries.iter().zip(light).map(|(e, l)| f64::from(e[c] + e[3]) * l[c]).sum::<f64>())
    };
    let anchors: Vec<_> = found.entries.chunks(rows * light.len()).collect();
    anchors.into_iter().map(|a| a.chunks(light.len()).map(row).collect()).collect()
}

fn of(
    world: &ReferenceWorld,
    instance: usize,
    grid: [usize; 2],
    rows: TransferRows,
    request: TransferRequest,
) -> InstanceTransfer {
    let anchors = MeshAnchors::on_leaf(&world.leaves[world.instances[instance].leaf], grid);
    let tracer = PathTracer::new(world, PathSettings::default()).unwrap();
    measure(&tracer, &TransferReceiver { instance, anchors: &anchors.points, rows }, &request)
}

const HARMONICS: TransferRequest =
    TransferRequest { method: TransferMethod::Paths, columns: TransferColumns::Harmonics(5), paths: 2048, seed: 3 };

/// Light of radiance 1 all around.
fn even() -> Vec<[f64; 3]> {
    let mut light = vec![[0.0; 3]; 25];
    light[0] = [(4.0 * PI).sqrt(); 3];
    light
}

/// The irradiance vectors of front and back as lengths along the normal `n`, for green.
fn along(rows: &[[f64; 3]], n: DVec3) -> [f64; 2] {
    let vector = |first: usize| DVec3::new(rows[first][1], rows[first + 1][1], rows[first + 2][1]);
    [vector(0).dot(n), -vector(3).dot(n)]
}

/// A leaf alone gets π from a light of radiance 1, and the harmonics of an even light.
#[test]
fn a_leaf_alone_sees_all_of_the_light() {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 0.7);
    let mut world = plates(10.0, &[(0.0, [0.4, 0.3], 0.2)]);
    world.instances[0].transform = DMat4::from_rotation_translation(turn, DVec3::new(3.0, -2.0, 9.0));
    let found = of(&world, 0, [2, 2], TransferRows::Glossy(3), HARMONICS);
    for rows in under(&found, 15, &even()) {
        for e in along(&rows, turn * DVec3::Z) {
            assert!((e / PI - 1.0).abs() < 2e-3, "{e}");
        }
        assert!((rows[6][0] / (4.0 * PI).sqrt() - 1.0).abs() < 1e-5, "{}", rows[6][0]);
        assert!(rows[7..].iter().flatten().all(|v| v.abs() < 2e-2), "{:?}", &rows[7..]);
    }
}

/// Between two wide plates the light is reflected back and forth. With D the radiance downwards and U upwards, D = ρ₁ U
/// + τ₁ and U = ρ₂ D + τ₂.
#[test]
fn wide_plates_exchange_light_as_their_closed_form_says() {
    let (upper, lower) = (([0.3, 0.5], 0.35), ([0.45, 0.5], 0.4));
    let mut world = plates(1e6, &[(20.0, upper.0, upper.1), (0.0, lower.0, lower.1)]);
    // Only anchors in the middle count, because at the rim a plate is not wide.
    let down = (upper.1 + upper.0[1] * lower.1) / (1.0 - upper.0[1] * lower.0[0]);
    let up = lower.0[0] * down + lower.1;
    let check = |found: &InstanceTransfer, light: &[[f64; 3]], wanted: [f64; 2], what: &str| {
        let rows = &under(found, 6, light)[0];
        // The stated error is that of both sides together.
        let error = f64::from(found.errors[0]) * PI * (wanted[0] + wanted[1]);
        let seen = along(rows, DVec3::Z);
        for (e, want) in seen.into_iter().zip(wanted) {
            assert!((e - PI * want).abs() < 4.0 * error + 2e-3, "{what}: {e}, expected {}", PI * want);
        }
        assert!(error < 0.02, "{what}: too coarse, {error}");
    };
    let request = TransferRequest { paths: 8192, ..HARMONICS };
    check(&of(&world, 1, [1, 1], TransferRows::Both, request), &even(), [down, 1.0], "lower, harmonics");
    check(&of(&world, 0, [1, 1], TransferRows::Both, request), &even(), [1.0, up], "upper, harmonics");
    world.sky = Some([1.0; 3]);
    let request = TransferRequest { columns: TransferColumns::Light, ..request };
    check(&of(&world, 1, [1, 1], TransferRows::Both, request), &[[1.0; 3]], [down, 1.0], "lower, the light itself");
}

/// Leaves that absorb nothing do not change an even light, whatever is in its way.
#[test]
fn leaves_that_absorb_nothing_change_no_even_light() {
    let mut world = plates(10.0, &[]);
    world.leaves = vec![leaf(square(10.0), [0.6, 0.6], 0.4, None)];
    world.leaves[0].back = side(0.6, 0.4, None);
    for k in 0..30 {
        let f = f64::from(k);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, f, 2.0 * f, 0.3 * f);
        let at = DVec3::new((1.7 * f).sin() * 15.0, (2.9 * f).cos() * 15.0, 0.6 * f - 9.0);
        world.instances.push(ReferencePlacement { leaf: 0, transform: DMat4::from_rotation_translation(turn, at) });
    }
    let normal = crate::stage::rotation(&world.instances[7].transform) * DVec3::Z;
    for method in [TransferMethod::Paths, TransferMethod::AmbientOcclusion] {
        let found = of(&world, 7, [2, 2], TransferRows::Both, TransferRequest { method, ..HARMONICS });
        for (rows, error) in under(&found, 6, &even()).iter().zip(&found.errors) {
            let level = along(rows, normal).iter().sum::<f64>() / (2.0 * PI);
            assert!((level - 1.0).abs() < 4.0 * f64::from(*error) + 1e-3, "{method:?}: {level} ± {error}");
            assert!(*error < 0.02, "{method:?}: {error}");
        }
    }
}

/// Between two wide plates, ambient occlusion assumes that the other plate gets what this one gets, side by side: the
/// hidden side gets E = ρ π + τ E, where ρ and τ are the other plate's. The single number of wood and ground takes both
/// sides of what hides it to get what it gets itself.
#[test]
fn ambient_occlusion_between_plates_meets_its_closed_form() {
    let (upper, lower) = (([0.3, 0.5], 0.35), ([0.45, 0.5], 0.4));
    let world = plates(1e6, &[(20.0, upper.0, upper.1), (0.0, lower.0, lower.1)]);
    let request = TransferRequest { method: TransferMethod::AmbientOcclusion, paths: 8192, ..HARMONICS };
    let light = TransferRequest { columns: TransferColumns::Light, ..request };
    let mut lit = world.clone();
    lit.sky = Some([1.0; 3]);
    let expected = [[1.0, lower.0[0] / (1.0 - lower.1)], [upper.0[1] / (1.0 - upper.1), 1.0]];
    for (instance, wanted) in expected.into_iter().enumerate() {
        let by_bands = of(&world, instance, [1, 1], TransferRows::Both, request);
        let itself = of(&lit, instance, [1, 1], TransferRows::Both, light);
        for seen in
            [&under(&by_bands, 6, &even())[0], &under(&itself, 6, &[[1.0; 3]])[0]].map(|rows| along(rows, DVec3::Z))
        {
            for (e, want) in seen.into_iter().zip(wanted) {
                assert!((e / PI - want).abs() < 5e-3, "{instance}: {}, expected {want}", e / PI);
            }
        }
    }
    let open = of(&lit, 0, [1, 1], TransferRows::Front, light);
    assert!((f64::from(open.entries[0][1]) / PI - 1.0).abs() < 2e-3, "{}", open.entries[0][1]);
    let shut = of(&lit, 1, [1, 1], TransferRows::Front, light);
    assert!(
        shut.entries[0][1].abs() < 1e-6,
        "no light gets between the plates but by the back: {}",
        shut.entries[0][1]
    );
    // The sun above the upper plate comes in by its back as the sky does.
    lit.sky = None;
    lit.sun = Some(ReferenceSun { direction: DVec3::Z, irradiance: [2.0; 3], radius: 0.005 });
    let [front, back] = along(&under(&of(&lit, 0, [1, 1], TransferRows::Both, light), 6, &[[1.0; 3]])[0], DVec3::Z);
    let wanted = lower.0[0] * 2.0 / (1.0 - lower.1);
    assert!(front == 0.0 && (back / wanted - 1.0).abs() < 5e-3, "{front} {back}, expected {wanted}");
}

/// Black surfaces send no light on. Ambient occlusion is then the same as paths.
#[test]
fn among_black_leaves_ambient_occlusion_is_exact() {
    let mut world = plates(10.0, &[(4.0, [0.0; 2], 0.0), (0.0, [0.0; 2], 0.0)]);
    world.instances[0].transform = DMat4::from_translation(DVec3::new(7.0, 3.0, 4.0));
    for columns in [TransferColumns::Harmonics(5), TransferColumns::Light] {
        world.sky = Some([0.7; 3]);
        let [paths, occlusion] = [TransferMethod::Paths, TransferMethod::AmbientOcclusion].map(|method| {
            of(&world, 1, [2, 2], TransferRows::Glossy(3), TransferRequest { method, columns, ..HARMONICS })
        });
        assert!(paths.entries.iter().flatten().any(|v| *v != 0.0));
        assert_eq!(paths, occlusion);
    }
}

/// A light of five bands gives the same by its harmonics as by itself, although one way draws directions towards the
/// light and the other does not. The difference agrees with the stated errors.
#[test]
fn harmonics_and_the_light_itself_agree() {
    let mut world = plates(
        12.0,
        &[(14.0, [0.35, 0.25], 0.3), (0.0, [0.4, 0.2], 0.25), (-9.0, [0.5, 0.3], 0.2), (5.0, [0.6, 0.5], 0.1)],
    );
    world.instances[3].transform =
        DMat4::from_rotation_translation(DQuat::from_rotation_x(1.2), DVec3::new(4.0, 12.0, 5.0));
    let mut light = even();
    for (k, c) in [(2, 1.1), (1, -0.7), (6, 0.5), (8, 0.6), (12, -0.2), (20, 0.15)] {
        light[k] = [c, 0.7 * c, 0.4 * c];
    }
    let (basis, coefficients) = (HarmonicBasis::new(5), light.clone());
    let radiance = move |d: DVec3| {
        let mut y = [0.0; 25];
        basis.fill(d.to_array(), &mut y);
        let mut sum = [0.0; 3];
        y.iter().zip(&coefficients).for_each(|(y, l)| (0..3).for_each(|c| sum[c] += y * l[c]));
        sum
    };
    world.dome = Some(ReferenceDome { radiance: Arc::new(radiance), seen_below: Some([0.0; 3]), nodes: None });
    let (mut squares, mut count) = (0.0, 0.0);
    for instance in 0..3 {
        let by_bands = of(&world, instance, [3, 2], TransferRows::Glossy(3), HARMONICS);
        let request = TransferRequest { columns: TransferColumns::Light, ..HARMONICS };
        let itself = of(&world, instance, [3, 2], TransferRows::Glossy(3), TransferRequest { seed: 9, ..request });
        let other = of(&world, instance, [3, 2], TransferRows::Glossy(3), TransferRequest { seed: 10, ..request });
        let (a, b) = (under(&by_bands, 15, &light), under(&itself, 15, &[[1.0; 3]]));
        let c = under(&other, 15, &[[1.0; 3]]);
        for k in 0..a.len() {
            for row in 0..15 {
                let scale = if row < 6 { PI } else { (4.0 * PI).sqrt() };
                let apart = (a[k][row][1] - b[k][row][1]).abs() / scale;
                assert!(apart < 0.06, "instance {instance}, anchor {k}, row {row}: {:?} {:?}", a[k][row], b[k][row]);
            }
            // Two estimates of the same irradiance differ on average by √2 of their stated error.
            let level = |rows: &[[f64; 3]]| along(rows, DVec3::Z).iter().sum::<f64>();
            let error = f64::from(itself.errors[k]) * level(&b[k]);
            squares += (level(&b[k]) - level(&c[k])).powi(2) / (2.0 * error * error);
            count += 1.0;
        }
    }
    assert!((0.2..4.0).contains(&(squares / count)), "{}", squares / count);
}

/// Surfaces that the sun lights are part of the light for other leaves, but the sun's own disk is not.
#[test]
fn the_suns_disk_is_left_out() {
    let mut world = plates(1e6, &[(0.0, [0.4, 0.3], 0.2)]);
    world.sun = Some(ReferenceSun { direction: DVec3::Z, irradiance: [2.0; 3], radius: 0.005 });
    let request = TransferRequest { columns: TransferColumns::Light, paths: 512, seed: 1, ..HARMONICS };
    assert!(of(&world, 0, [1, 1], TransferRows::Both, request).entries.iter().flatten().all(|v| *v == 0.0));
    // A plate above it gets ρd E/π from below.
    world.instances.push(ReferencePlacement { leaf: 0, transform: DMat4::from_translation(-DVec3::Z) });
    world.leaves.push(leaf(square(1e-3), [0.4, 0.3], 0.2, None));
    world.instances[0].leaf = 1;
    let found = of(&world, 0, [1, 1], TransferRows::Both, request);
    let [front, back] = along(&under(&found, 6, &[[1.0; 3]])[0], DVec3::Z);
    assert!(front == 0.0 && (back / (0.4 * 2.0) - 1.0).abs() < 0.02, "{front} {back}");
}
