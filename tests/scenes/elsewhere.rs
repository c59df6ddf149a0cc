//! Plants of other programs in scenes: as they are, standing still, and with the branches that `import` finds.

use crate::plants::{run, scene};
use glam::DVec3;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::placed::plant::{PlacedPlant, planted};
use serde_json::Value;
use std::path::Path;

const MATTER: &str = "materials = { leaf = \"elm\", bark = [0.1, 0.1, 0.1] }\n";

/// A sapling as another program would write it: no node says what it is.
fn stripped(folder: &Path) {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/bird-cherry-sapling.toml");
    assert_eq!(run(folder, &["grow", spec.to_str().unwrap(), "-o", "own.glb"]).0, Some(0));
    let bytes = std::fs::read(folder.join("own.glb")).unwrap();
    let mut glb = gltf::binary::Glb::from_slice(&bytes).unwrap();
    let mut root: Value = serde_json::from_slice(&glb.json).unwrap();
    for node in root["nodes"].as_array_mut().unwrap() {
        node.as_object_mut().unwrap().retain(|key, _| key != "extras" && key != "name");
    }
    glb.json = serde_json::to_vec(&root).unwrap().into();
    std::fs::write(folder.join("elsewhere.glb"), glb.to_vec().unwrap()).unwrap();
}

fn plants(folder: &Path, file: &str) -> PlacedPlant {
    let path = scene(folder, &format!("file = \"{file}\"\n{MATTER}"));
    planted(&SceneManifest::read(&path).unwrap(), &Ledger::new()).unwrap().remove(0)
}

/// The size of all wood along the three axes (mm).
fn size(plant: &PlacedPlant) -> DVec3 {
    let places = plant.wood().into_iter().flat_map(|wood| wood.mesh.positions);
    let (low, high) = places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
    high - low
}

#[test]
fn a_plant_of_another_program_stands_as_it_is_and_sways_once_it_is_imported() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    stripped(folder);
    let (code, said) = run(folder, &["import", "elsewhere.glb", "-o", "tree.glb"]);
    assert!(code == Some(0) && said.contains("tree.glb: 41 branches (0 not attached)"), "{said}");
    let own = plants(folder, "own.glb");
    for file in ["elsewhere.glb", "tree.glb"] {
        let other = plants(folder, file);
        assert!(size(&own).distance(size(&other)) < 0.1, "{file}: {} {}", size(&own), size(&other));
        let near = |p: DVec3| {
            let all = own.placements();
            all.min_by(|a, b| {
                let far = |x: &glam::DMat4| x.w_axis.truncate().distance(p);
                far(&a.transform).total_cmp(&far(&b.transform))
            })
        };
        assert_eq!(own.placements().count(), other.placements().count(), "{file}");
        for leaf in other.placements() {
            let place = leaf.transform.w_axis.truncate();
            let twin = near(place).unwrap().transform;
            // The middle of the area is not the middle of the length; tip and front point the same way.
            assert!(twin.w_axis.truncate().distance(place) < 12.0, "{file}");
            let along = twin.x_axis.truncate().normalize().dot(leaf.transform.x_axis.truncate().normalize());
            let front = twin.z_axis.truncate().normalize().dot(leaf.transform.z_axis.truncate().normalize());
            assert!(along > 0.95 && front > 0.95, "{file}: {along} {front}");
        }
    }
    // In a wind: how far the leaves are from each other at two times.
    let moved = |file: &str| {
        let wind = "[wind]\nspeed_m_s = 6\nseed = 2\n";
        scene(folder, &format!("file = \"{file}\"\n{MATTER}{wind}"));
        let at = |time: &str| {
            let (code, said) =
                run(folder, &["export", "scene.toml", "--time", time, "--to", "gltf", "-o", "posed.glb"]);
            assert_eq!(code, Some(0), "{file}: {said}");
            let posed = mesophyll::plants::file::read(&folder.join("posed.glb")).unwrap();
            posed.leaves.iter().map(|l| l.transform.w_axis.truncate()).collect::<Vec<_>>()
        };
        at("0").iter().zip(at("1.5")).map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
    };
    assert_eq!(moved("elsewhere.glb"), 0.0);
    assert!(moved("tree.glb") > 1.0);
}

#[test]
fn a_part_needs_no_branches_and_a_mesh_is_y_up() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    stripped(folder);
    let own = plants(folder, "own.glb");
    let path = folder.join("scene.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let (head, _) = text.split_once("[[plant]]").unwrap();
    let height = |mesh: &str| {
        let text = head.replace("mesh = \"leaf.glb\"\n", mesh);
        std::fs::write(&path, format!("{text}[[instance]]\nleaf = \"elm\"\n")).unwrap();
        let manifest = SceneManifest::read(&path).map_err(|e| e.to_string())?;
        let placed = mesophyll::scene::placed::PlacedScene::new(&manifest, Default::default(), &Ledger::new());
        let placed = placed.map_err(|e| e.to_string())?;
        let mesh = placed.leaves[0].mesh.clone().unwrap();
        let (low, high) =
            mesh.positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        Ok::<DVec3, String>(high - low)
    };
    let whole = height("mesh = \"elsewhere.glb\"\n").unwrap();
    assert!(whole.z > size(&own).z - 0.1 && whole.z > whole.y, "{whole}");
    let lying = height("mesh = \"elsewhere.glb\"\nmesh_up = \"z\"\n").unwrap();
    assert!((lying.y - whole.z).abs() < 1e-6 && (lying.z - whole.y).abs() < 1e-6, "{lying}");
    let wood = height("mesh = \"elsewhere.glb\"\npart = \"bark\"\n").unwrap();
    assert!(wood.distance(size(&own)) < 0.1, "{wood}");
    for (mesh, expected) in [
        ("mesh = \"elsewhere.glb\"\npart = \"moss\"\n", "expected one of bark, leaf"),
        (
            "mesh = \"elsewhere.glb\"\npart = \"bark\"\nmesh_up = \"y\"\n",
            "mesh_up: given without a mesh, or with a part",
        ),
        ("mesh = \"elsewhere.glb\"\nmesh_up = \"x\"\n", "expected `y` or `z`"),
    ] {
        let error = height(mesh).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    // A blade keeps lying with its front up.
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("fits/elm/blade.glb"), folder.join("leaf.glb")).unwrap();
    let blade = height("mesh = \"leaf.glb\"\n").unwrap();
    assert!(blade.z < 0.5 * blade.y.min(blade.x), "{blade}");
}
