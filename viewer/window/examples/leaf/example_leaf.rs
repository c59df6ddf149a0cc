//! A made-up leaf: an outline, a few veins, a folded and arched blade. It is not based on a measurement.

use glam::{Mat4, Quat, Vec2, Vec3};
use mesophyll_viewer::scene::{
    Camera, Instance, Interior, LeafMaterial, Lobe, Material, Mesh, Scene, Side, SideMaps, Sides, SlabCurve, Sun,
};

pub const WIDTH: u32 = 256;
const HEIGHT: u32 = 384;

/// Half the width of the blade, as a share of the largest half width, at `t` from base to tip.
fn outline(t: f32) -> f32 {
    (t * std::f32::consts::PI).sin().powf(0.8) * (1.0 - 0.35 * t) * 0.95
}

/// Distance to a pattern of veins, as a share of the blade's width, for x from −1 to 1 and t from 0 to 1.
fn vein(x: f32, t: f32) -> f32 {
    let side = ((t - 0.35 * x.abs()) * 9.0 + 0.5 * x.signum().max(0.0)).fract();
    (x.abs() * 1.2).min((side - 0.5).abs() * 0.35)
}

pub fn side(side: Side) -> SideMaps {
    let front = side == Side::Front;
    let mut gamma_delta = Vec::new();
    let mut normal = Vec::new();
    let mut gloss = Vec::new();
    let height = |i: i32, j: i32| {
        let x = 2.0 * (i as f32 + 0.5) / WIDTH as f32 - 1.0;
        let t = 1.0 - (j as f32 + 0.5) / HEIGHT as f32;
        (-(vein(if front { x } else { -x }, t) / 0.03).powi(2)).exp()
    };
    for j in 0..HEIGHT as i32 {
        for i in 0..WIDTH as i32 {
            let h = height(i, j);
            gamma_delta.push([1.0 + 0.9 * h, 1.0 + 0.5 * h, 1.0 + 0.7 * h, 0.12 * h - 0.02]);
            gloss.push([0.04, 0.04, 0.04, 0.22 + 0.2 * h]);
            let raised = if front { -1.2 } else { 1.2 };
            let (dx, dy) = (height(i + 1, j) - height(i - 1, j), height(i, j - 1) - height(i, j + 1));
            normal.push(Vec3::new(-raised * dx, -raised * dy, 1.0).normalize().to_array());
        }
    }
    let interior = Interior::Scalars(curve(start(side)));
    SideMaps { gamma_delta, gloss: front.then_some(gloss), normal: Some(normal), translucency: None, interior }
}

/// σa and σs with which editing starts (1/mm).
pub fn start(side: Side) -> [[f64; 3]; 2] {
    [if side == Side::Front { [16.0, 5.0, 24.0] } else { [9.0, 3.4, 11.0] }, [14.0, 15.0, 12.0]]
}

/// A simple replacement for the slab: two-stream (Kubelka & Munk) reflectance and transmittance over black, with K =
/// 2σa and S = ¾σs. It changes in the right direction with σa and σs. The real program solves the transport equation.
pub fn curve([sigma_a, sigma_s]: [[f64; 3]; 2]) -> SlabCurve {
    let n = 49;
    let (min_mm, max_mm) = (0.005, 1.2);
    let thickness = |k: usize| min_mm + (max_mm - min_mm) * k as f32 / (n - 1) as f32;
    let two_stream = |channel: usize, h: f32| {
        let (k, s) = (2.0 * sigma_a[channel] as f32, 0.75 * sigma_s[channel] as f32);
        let a = 1.0 + k / s;
        let b = (a * a - 1.0).sqrt();
        let (sinh, cosh) = ((b * s * h).min(40.0).sinh(), (b * s * h).min(40.0).cosh());
        let below = a * sinh + b * cosh;
        (sinh / below, b / below)
    };
    let all = |pick: fn((f32, f32)) -> f32| {
        (0..n).map(|k| std::array::from_fn(|c| pick(two_stream(c, thickness(k))))).collect()
    };
    SlabCurve { min_mm, max_mm, rho_d: all(|p| p.0), rho_t: all(|p| p.1) }
}

/// A blade 70 mm long, folded along its midrib and arched.
fn blade() -> Mesh {
    let (across, along) = (24u32, 60u32);
    let place = |u: f32, t: f32| {
        let x = (2.0 * u - 1.0) * 22.0;
        Vec3::new(x, (t - 0.5) * 70.0, 0.012 * x * x - 0.006 * ((t - 0.3) * 70.0).powi(2))
    };
    let mut mesh = Mesh::default();
    for j in 0..=along {
        for i in 0..=across {
            let t = 0.002 + 0.996 * j as f32 / along as f32;
            let u = 0.5 + (i as f32 / across as f32 - 0.5) * outline(t);
            let e = 1e-3;
            let (du, dt) = (place(u + e, t) - place(u - e, t), place(u, t + e) - place(u, t - e));
            mesh.positions.push(place(u, t));
            mesh.normals.push(du.cross(dt).normalize());
            mesh.tangents.push(du.normalize().extend(1.0));
            mesh.uvs.push(Vec2::new(u, 1.0 - t));
        }
    }
    for j in 0..along {
        for i in 0..across {
            let a = j * (across + 1) + i;
            let b = a + across + 1;
            mesh.indices.extend([a, a + 1, b, a + 1, b + 1, b]);
        }
    }
    mesh
}

/// The scene: a few leaves above each other, under sun and sky.
pub fn scene(cluster: bool) -> Scene {
    let leaf = LeafMaterial {
        name: "made up".into(),
        width: WIDTH,
        height: HEIGHT,
        thickness_mm: 0.2,
        lobe: Lobe::CookTorrance { index: 1.45 },
        sides: Sides::of(side),
        mask: None,
    };
    let mut instances = vec![Instance::default()];
    if cluster {
        instances = (0..7)
            .map(|k| {
                let turn = Quat::from_rotation_z(0.9 * k as f32) * Quat::from_rotation_x(-0.25 - 0.05 * k as f32);
                let place = turn * Vec3::new(0.0, 38.0, 0.0) + Vec3::Z * 7.0 * k as f32;
                Instance {
                    mesh: 0,
                    material: 0,
                    transform: Mat4::from_rotation_translation(turn, place),
                    ..Instance::default()
                }
            })
            .collect();
    }
    Scene {
        meshes: vec![blade()],
        materials: vec![Material::Leaf(leaf)],
        instances,
        sun: Some(Sun {
            direction: Vec3::new(-0.4, 0.5, 0.9).normalize(),
            irradiance: [3.0, 2.9, 2.6],
            radius: 0.00465,
        }),
        sky: Some([0.25, 0.32, 0.42]),
        dome: None,
        background: [0.35, 0.4, 0.45],
        exposure: 1.6,
        shadow_samples: 16,
        shadow_resolution: 2048,
        msaa: 4,
        ..Scene::default()
    }
}

pub fn camera() -> Camera {
    Camera { eye: Vec3::new(30.0, -110.0, 130.0), target: Vec3::new(0.0, 0.0, 10.0), up: Vec3::Z, fov_y_deg: 40.0 }
}
