//! Light between leaves in stiff and extreme scenes, each with the verdict that it must get. The answers are known in
//! closed form, so digits are those of the radiance. Four standard errors are allowed for chance.

use crate::stress::StressRow;
use glam::{DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::environment::Environment;
use mesophyll_transport::path::{PathSettings, PathTracer};
use mesophyll_transport::{ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceSun, ReferenceWorld, lobe::Lobe};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
use std::time::Instant;

/// The table.
pub fn stress() -> Vec<StressRow> {
    let mut rows = vec![
        sky_alone("white leaves face to face, .01 mm apart", stack(&[(0.01, 1.0, 0.0), (0.0, 1.0, 0.0)]), 1.0),
        sky_alone("clear leaves face to face, .01 mm apart", stack(&[(0.01, 0.3, 0.7), (0.0, 0.3, 0.7)]), 1.0),
        sky_alone("leaves 1 µm apart", stack(&[(1e-3, 0.3, 0.4), (0.0, 0.3, 0.4)]), two_sheets(0.3, 0.4)),
        sky_alone("leaves that cross", crossing(), 1.0),
        sky_alone("zero-area triangles among others", with_slivers(), 0.7),
        sky_alone("normals against the winding", against_the_winding(), 0.7),
        sky_alone("black leaves", stack(&[(0.0, 0.0, 0.0)]), 0.0),
        sky_alone("a million triangles", million(), 0.7),
        sun("a sun on the horizon", FRAC_PI_2, 0.0),
        sun("a sun from below", 2.0, 0.4 * 3.0 * -(2f64.cos()) / PI),
        sun("a sun without extent overhead", 0.0, 0.3 * 3.0 / PI),
    ];
    rows.push(gap());
    rows.extend([pixel_sun(), not_a_number()]);
    rows
}

/// A level square, front up, 2 m wide, of `n` by `n` pieces.
pub(crate) fn square(n: u32) -> LeafMesh {
    let mut mesh = LeafMesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let uv = DVec2::new(f64::from(i), f64::from(j)) / f64::from(n);
            mesh.positions.push(DVec3::new(uv.x - 0.5, 0.5 - uv.y, 0.0) * 2000.0);
            mesh.normals.push(DVec3::Z);
            mesh.uvs.push(uv);
        }
    }
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            let below = a + n + 1;
            mesh.indices.extend([a, below, a + 1, a + 1, below, below + 1]);
        }
    }
    mesh
}

pub(crate) fn leaf(mesh: LeafMesh, rho_d: f64, rho_t: f64) -> ReferenceLeaf {
    let sides = [(); 2].map(|()| ReferenceSide::even([rho_d; 3], [rho_t; 3], None));
    ReferenceLeaf::even(mesh, sides, Lobe::Beckmann)
}

/// Level squares: height (mm), ρd and ρt of each.
pub(crate) fn stack(of: &[(f64, f64, f64)]) -> ReferenceWorld {
    ReferenceWorld {
        leaves: of.iter().map(|(_, rho_d, rho_t)| leaf(square(1), *rho_d, *rho_t)).collect(),
        instances: (0..of.len())
            .map(|k| ReferencePlacement { leaf: k, transform: DMat4::from_translation(DVec3::Z * of[k].0) })
            .collect(),
        ..ReferenceWorld::default()
    }
}

/// The radiance that two equal wide sheets reflect of a sky that is 1 all around.
fn two_sheets(rho: f64, tau: f64) -> f64 {
    // Between the sheets the light is the same upward and downward: L = τ + ρ L.
    rho + tau * tau / (1.0 - rho)
}

fn crossing() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.4, 0.6)]);
    let turn = DMat4::from_rotation_translation(DQuat::from_rotation_y(1.1), DVec3::new(0.0, 1.0, 0.0));
    world.instances.push(ReferencePlacement { leaf: 0, transform: turn });
    world
}

fn with_slivers() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4)]);
    world.leaves[0].mesh.indices.extend([0, 0, 1, 2, 2, 2, 0, 3, 0]);
    world
}

fn against_the_winding() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4)]);
    world.leaves[0].mesh.normals.iter_mut().for_each(|n| *n = -*n);
    world
}

fn million() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4)]);
    world.leaves[0].mesh = square(708);
    world
}

/// Looks at the middle obliquely from above.
fn look(world: &ReferenceWorld, case: &str, want: f64, at_most: f64) -> StressRow {
    from(world, case, want, at_most, DVec3::new(200.0, 100.0, 400.0), DVec3::new(0.3, 0.2, 0.0))
}

/// Compares the radiance along one line of sight with its known value. The standard error must be at most `at_most` of
/// it.
fn from(world: &ReferenceWorld, case: &str, want: f64, at_most: f64, eye: DVec3, target: DVec3) -> StressRow {
    let clock = Instant::now();
    let (verdict, digits) = match PathTracer::new(world, PathSettings::default()) {
        Err(why) => (format!("refused: {why}"), None),
        Ok(tracer) => {
            let seen = tracer.look(eye, target - eye, 4096, 7);
            let green = seen.radiance[1];
            let (off, error) = ((green.mean - want).abs(), green.error);
            let digits = (-(off / want.abs().max(1e-12)).max(1e-16).log10()).clamp(0.0, 16.0);
            let verdict = if seen.cut {
                "wrong: paths were cut off".into()
            } else if !(error <= at_most * want.max(1.0)) {
                format!("wrong: no nearer than ± {error:.1e}")
            } else if off <= 4.0 * error + 1e-5 {
                "ok".into()
            } else {
                format!("wrong: {} ± {error:.1e}, expected {want}", green.mean)
            };
            (verdict, Some(digits))
        }
    };
    row(case, "ok", verdict, digits, clock)
}

fn row(case: &str, expected: &str, verdict: String, digits: Option<f64>, since: Instant) -> StressRow {
    StressRow {
        model: "transport".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits,
        condition: None,
        ms: since.elapsed().as_secs_f64() * 1e3,
    }
}

/// The case under a sky that is 1 all around.
fn sky_alone(case: &str, world: ReferenceWorld, want: f64) -> StressRow {
    look(&ReferenceWorld { sky: Some([1.0; 3]), ..world }, case, want, 0.02)
}

fn sun(case: &str, zenith: f64, want: f64) -> StressRow {
    let direction = DVec3::new(zenith.sin(), 0.0, zenith.cos());
    let sun = Some(ReferenceSun { direction, irradiance: [3.0; 3], radius: 0.0 });
    look(&ReferenceWorld { sun, ..stack(&[(0.0, 0.3, 0.4)]) }, case, want, 1e-6)
}

/// Ground of 40 m under an opaque, black roof 10 mm above it: it is dark in the middle.
fn gap() -> StressRow {
    let mut world = stack(&[(10.0, 0.0, 0.0), (0.0, 0.9, 0.0)]);
    for instance in &mut world.instances {
        instance.transform *= DMat4::from_scale(DVec3::splat(20.0));
    }
    world.sky = Some([1.0; 3]);
    from(&world, "40 m under a roof 10 mm above", 0.0, 1e-4, DVec3::new(50.0, 20.0, 9.0), DVec3::new(3.0, 2.0, 0.0))
}

/// A map that is black except for one texel, which is as bright as the sun. Its light follows from its radiance and
/// place.
fn pixel_sun() -> StressRow {
    let (columns, rows) = (512usize, 256usize);
    let (i, j) = (100usize, 60usize);
    let mut texels = vec![[0f32; 3]; columns * rows];
    texels[j * columns + i] = [1e5; 3];
    let mut world = stack(&[(0.0, 0.3, 0.4)]);
    // The bilinear hat of the texel over its neighbours, integrated on a separate grid.
    let n = 400;
    let mut irradiance = 0.0;
    for a in 0..n {
        for b in 0..n {
            let at = |k: i32| (2.0 * f64::from(k) + 1.0) / f64::from(n) - 1.0;
            let (x, y) = (at(a), at(b));
            let theta = PI * (j as f64 + 0.5 + y) / rows as f64;
            let hat = (1.0 - x.abs()) * (1.0 - y.abs());
            irradiance += 1e5 * hat * theta.cos() * theta.sin();
        }
    }
    irradiance *= 2.0 * PI / columns as f64 * PI / rows as f64 * (2.0 / f64::from(n)).powi(2);
    world.environment = Environment::new(columns, rows, texels).ok().map(Arc::new);
    look(&world, "a sun of one texel in an environment map", 0.3 * irradiance / PI, 0.01)
}

fn not_a_number() -> StressRow {
    let clock = Instant::now();
    let mut texels = vec![[1f32; 3]; 32];
    texels[5][2] = f32::NAN;
    let verdict = match Environment::new(8, 4, texels) {
        Ok(_) => "ok".into(),
        Err(why) => format!("refused: {why}"),
    };
    row("NaN in an environment map", "refused: channel B, column 5, row 0: found NaN", verdict, None, clock)
}
