//! A world that is built by hand: what both renderers are given, against places, normals, rays and lights that are
//! computed here on their own.

use super::{handover, reference};
use crate::loaded::LoadedScene;
use crate::manifest::{LeafOrigin, SceneManifest};
use crate::placed::leaf::LeafSearch;
use crate::placed::ledger::Ledger;
use crate::world::{SceneWorld, WorldMaterial, WorldSky};
use mesophyll_fits::leaf::blade::{BladeMesh, glb};
use mesophyll_transport::{CameraRays, ReferenceInterior};
use mesophyll_viewer::picking;
use mesophyll_viewer::scene as viewer;

type Vector = [f64; 3];

/// Two triangles that share an edge and are not in one plane.
const CORNERS: [[f32; 3]; 4] = [[-20.0, -10.0, 0.0], [25.0, -10.0, 3.0], [25.0, 10.0, 3.0], [-20.0, 10.0, -6.0]];
const NORMALS: [[f32; 3]; 4] = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.6, 0.8], [-0.6, 0.0, 0.8]];
/// Where the two instances of the leaf stand: position (mm), angles about x, y and z (degrees), scale.
const PLACES: [(Vector, Vector, f64); 2] =
    [([10.0, -30.0, 55.0], [25.0, -40.0, 110.0], 1.5), ([-70.0, 5.0, 20.0], [0.0, 90.0, -15.0], 0.5)];
const GROUND: [f64; 3] = [0.3, 0.2, 0.1];
const RHO: [[f64; 3]; 3] = [[0.05, 0.11, 0.03], [0.09, 0.16, 0.07], [0.06, 0.14, 0.02]];

const SCENE: &str = r#"
schema = 1
name = "by-hand"
exposure = 0.5
background = [0.1, 0.2, 0.3]
instance = [
    { leaf = "sheet", position_mm = [10, -30, 55], rotation_deg = [25, -40, 110], scale = 1.5 },
    { leaf = "sheet", position_mm = [-70, 5, 20], rotation_deg = [0, 90, -15], scale = 0.5 },
]
[[leaf]]
name = "unused"
mesh = "blade.glb"
mesh_up = "z"
uniform = { rho_d = [[0, 0, 0], [0, 0, 0]], rho_t = [0, 0, 0] }
[[leaf]]
name = "sheet"
mesh = "blade.glb"
mesh_up = "z"
[leaf.uniform]
rho_d = [[0.05, 0.11, 0.03], [0.09, 0.16, 0.07]]
rho_t = [0.06, 0.14, 0.02]
rho_s = [0.04, 0.05, 0.06]
m = 0.3
[ground]
albedo = [0.3, 0.2, 0.1]
reach_mm = 300
height_mm = -7
[sun]
zenith_deg = 35
azimuth_deg = 130
irradiance = [3.0, 2.8, 2.5]
radius_deg = 0.5
[sky]
radiance = [0.4, 0.5, 0.6]
[[view]]
name = "a"
kind = "perspective"
eye_mm = [30, -200, 160]
target_mm = [-10, 15, 20]
up = [0.2, 0, 1]
fov_deg = 40
[check]
width = 32
height = 24
"#;

fn opened() -> (tempfile::TempDir, LoadedScene) {
    let folder = tempfile::tempdir().unwrap();
    let blade = BladeMesh {
        positions: CORNERS.to_vec(),
        normals: NORMALS.to_vec(),
        tangents: vec![[1.0, 0.0, 0.0, 1.0]; 4],
        uvs: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..BladeMesh::default()
    };
    glb::write(&folder.path().join("blade.glb"), "sheet", &blade).unwrap();
    let path = folder.path().join("scene.toml");
    let manifest = SceneManifest::parse(SCENE, &path).unwrap();
    let scene = LoadedScene::open(manifest, LeafSearch::default(), &Ledger::new()).unwrap();
    (folder, scene)
}

/// The vector after turns about x, then y, then z, each by its own formula.
fn turned([x, y, z]: Vector, deg: Vector) -> Vector {
    let [a, b, c] = deg.map(|d| d * std::f64::consts::PI / 180.0);
    let (y, z) = (y * a.cos() - z * a.sin(), y * a.sin() + z * a.cos());
    let (x, z) = (x * b.cos() + z * b.sin(), -x * b.sin() + z * b.cos());
    [x * c.cos() - y * c.sin(), x * c.sin() + y * c.cos(), z]
}

fn apart(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Vector) -> Vector {
    a.map(|v| v / dot(a, a).sqrt())
}

/// Every vertex of both instances, and its normal, in the world.
fn expected() -> Vec<(Vector, Vector)> {
    let at = |(position, deg, scale): &(Vector, Vector, f64), k: usize| {
        let (p, n) = (CORNERS[k].map(f64::from), NORMALS[k].map(f64::from));
        let p = turned(p, *deg);
        ([0, 1, 2].map(|c| position[c] + scale * p[c]), turned(n, *deg))
    };
    PLACES.iter().flat_map(|place| (0..4).map(move |k| at(place, k))).collect()
}

#[test]
fn both_renderers_are_given_the_same_leaves_at_the_same_places() {
    let (_folder, scene) = opened();
    let world = SceneWorld::new(&scene).unwrap();
    assert_eq!((world.surfaces.len(), world.leaves, world.ground()), (2, 1, Some(1)));
    assert!(matches!(world.surfaces[0].material, WorldMaterial::Stated(leaf, _) if leaf.config.name == "sheet"));
    let mut exact = Vec::new();
    for i in world.standing_leaves() {
        let mesh = world.surfaces[i.surface].mesh;
        exact.extend(mesh.positions.iter().zip(&mesh.normals).map(|(p, n)| {
            let turned = i.transform.transform_vector3(*n).normalize();
            (i.transform.transform_point3(*p).to_array(), turned.to_array())
        }));
    }
    let traced = reference::unlit(&scene, 0.0, &Ledger::new()).unwrap();
    let mut path = Vec::new();
    for i in &traced.instances[..2] {
        let mesh = &traced.leaves[i.leaf].mesh;
        path.extend(mesh.positions.iter().zip(&mesh.normals).map(|(p, n)| {
            let turned = i.transform.transform_vector3(*n).normalize();
            (i.transform.transform_point3(*p).to_array(), turned.to_array())
        }));
    }
    let drawn = handover::scene(&scene, &Ledger::new()).unwrap();
    let mut real_time = Vec::new();
    for i in &drawn.instances[..2] {
        let mesh = &drawn.meshes[i.mesh];
        real_time.extend(mesh.positions.iter().zip(&mesh.normals).map(|(p, n)| {
            let turned = i.transform.transform_vector3(*n).normalize();
            (i.transform.transform_point3(*p).to_array().map(f64::from), turned.to_array().map(f64::from))
        }));
    }
    // The mesh's file has single precision, and so has the real-time renderer's scene.
    for (what, found, within) in [("world", exact, 1e-5), ("path tracer", path, 1e-5), ("renderer", real_time, 5e-5)] {
        assert_eq!(found.len(), expected().len(), "{what}");
        for (found, wanted) in found.iter().zip(expected()) {
            let off = (apart(found.0, wanted.0), apart(found.1, wanted.1));
            assert!(off.0 < within && off.1 < 1e-6, "{what}: {found:?} {wanted:?}");
        }
    }
    // The ground is the last of either: level, 600 mm wide, below all leaves.
    let corner = |p: Vector| p[0].abs() == 300.0 && p[1].abs() == 300.0 && p[2] == -7.0;
    assert_eq!(traced.ground, Some(2));
    assert!(traced.leaves[1].mesh.positions.iter().all(|p| corner(p.to_array())));
    assert!(drawn.meshes[1].positions.iter().all(|p| corner(p.to_array().map(f64::from))));
    assert!(drawn.instances[2].floor && drawn.instances.len() == 3 && traced.instances.len() == 3);
}

#[test]
fn both_renderers_are_given_what_the_scene_states_of_material_and_light() {
    let (_folder, scene) = opened();
    let traced = reference::world(&scene, &Ledger::new()).unwrap();
    let drawn = handover::scene(&scene, &Ledger::new()).unwrap();
    let near = |a: f32, b: f64| (f64::from(a) - b).abs() < 1e-7;
    let leaf = drawn.leaf(0).unwrap();
    for (k, side) in [&traced.leaves[0].front, &traced.leaves[0].back].into_iter().enumerate() {
        let ReferenceInterior::Maps { rho_d, rho_t } = &side.interior else { panic!("{side:?}") };
        let seen = &leaf.sides[mesophyll_optics::side::Side::ALL[k]];
        let gloss = side.gloss.as_ref().unwrap();
        assert!(near(gloss.m[0], 0.3) && (0..3).all(|c| near(gloss.rho_s[c][0], 0.04 + 0.01 * c as f64)));
        assert!((0..3).all(|c| near(rho_d[c][0], RHO[k][c]) && near(rho_t[c][0], RHO[2][c])), "{k}");
        // The plan leaves out a side that no view shows; what it keeps is what is stated.
        if let viewer::Interior::Maps { rho_d, rho_t } = &seen.interior {
            assert!((0..3).all(|c| near(rho_d[0][c], RHO[k][c]) && near(rho_t[0][c], RHO[2][c])), "{k}");
        }
    }
    let viewer::Material::Opaque(soil) = &drawn.materials[1] else { panic!("the ground is no leaf") };
    let ReferenceInterior::Maps { rho_d, rho_t } = &traced.leaves[1].front.interior else { panic!("a curve") };
    assert!((0..3).all(|c| near(soil.albedo[c], GROUND[c]) && near(rho_d[c][0], GROUND[c]) && rho_t[c][0] == 0.0));
    // The sun at 35° from straight up, and 130° from +x towards +y.
    let (zenith, azimuth) = (35.0 * std::f64::consts::PI / 180.0, 130.0 * std::f64::consts::PI / 180.0);
    let towards = [zenith.sin() * azimuth.cos(), zenith.sin() * azimuth.sin(), zenith.cos()];
    let (a, b) = (traced.sun.unwrap(), drawn.sun.unwrap());
    assert!(apart(a.direction.to_array(), towards) < 1e-12);
    assert!(apart(b.direction.to_array().map(f64::from), towards) < 1e-6);
    let radius = 0.5 * std::f64::consts::PI / 180.0;
    assert!((a.radius - radius).abs() < 1e-12 && near(b.radius, radius));
    assert_eq!((a.irradiance, b.irradiance), ([3.0, 2.8, 2.5], [3.0, 2.8, 2.5]));
    assert_eq!((traced.sky, drawn.sky), (Some([0.4, 0.5, 0.6]), Some([0.4, 0.5, 0.6])));
    assert_eq!((traced.background, drawn.background), ([0.1, 0.2, 0.3], [0.1, 0.2, 0.3]));
    assert_eq!((traced.exposure, drawn.exposure), (0.5, 0.5));
    assert!(traced.dome.is_none() && drawn.dome.is_none());
    assert!(matches!(SceneWorld::new(&scene).unwrap().lights.sky, WorldSky::Even(_)));
}

/// A ray of the camera by similar triangles: the plane through the target, across the line of sight, is 2·d·tan 20°
/// high in the picture, where d is the distance.
#[test]
fn both_renderers_send_the_same_rays_from_a_view() {
    let (_folder, scene) = opened();
    let view = scene.manifest.perspectives().next().unwrap();
    let (eye, target, up): (Vector, Vector, Vector) = ([30.0, -200.0, 160.0], [-10.0, 15.0, 20.0], [0.2, 0.0, 1.0]);
    let ahead = [0, 1, 2].map(|k| target[k] - eye[k]);
    let right = unit(cross(ahead, up));
    let above = unit(cross(right, ahead));
    let high = 2.0 * dot(ahead, ahead).sqrt() * 0.363_970_234_266_202_4;
    let lens = CameraRays::new(&view.camera, 32, 24).unwrap();
    let drawn = handover::camera(&view.camera);
    for (x, y) in [(0.0, 0.0), (16.0, 12.0), (31.5, 2.25), (7.0, 23.5)] {
        let (across, along) = (high * (x - 16.0) / 24.0, high * (12.0 - y) / 24.0);
        let wanted = unit([0, 1, 2].map(|k| ahead[k] + across * right[k] + along * above[k]));
        let exact = lens.ray(x, y);
        assert!(apart(exact.origin.to_array(), eye) < 1e-12 && apart(exact.direction.to_array(), wanted) < 1e-12);
        let (origin, direction) = picking::ray(&drawn, 32.0 / 24.0, x as f32 / 32.0, y as f32 / 24.0);
        assert!(apart(origin.to_array().map(f64::from), eye) < 1e-4, "{origin}");
        assert!(apart(direction.to_array().map(f64::from), wanted) < 1e-6, "{x} {y}: {direction} {wanted:?}");
    }
}

/// A leaf whose maps nobody has made yet is refused with the same words by both.
#[test]
fn a_leaf_without_data_is_refused_by_the_world() {
    let (_folder, mut scene) = opened();
    let refused = |scene: &LoadedScene| {
        let ledger = Ledger::new();
        let both = [reference::unlit(scene, 0.0, &ledger).err(), handover::scene(scene, &ledger).err()];
        both.map(|e| e.map(|e| e.to_string()))
    };
    assert_eq!(refused(&scene), [None, None]);
    scene.manifest.leaves[1].origin = LeafOrigin::Other;
    let [a, b] = refused(&scene);
    assert_eq!(a, b);
    assert!(a.unwrap().contains("leaf \"sheet\": its maps are not made yet; `mesophyll run` makes them"));
}
