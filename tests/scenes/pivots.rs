//! Pivot textures: the plant's hierarchy at rest is rebuilt from the exported files alone.

use super::plants::{BARK, run, scene};
use glam::{DVec3, Vec3};
use mesophyll::files::image::{ChannelMaps, read_exr};
use mesophyll::plants::form::nearest;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::placed::plant::planted;
use std::path::Path;

/// From glTF's metres with y up to the scene's mm with z up.
fn up(x: f32, y: f32, z: f32) -> DVec3 {
    1000.0 * Vec3::new(x, -z, y).as_dvec3()
}

/// The data of an element that a material can read: pivot and tip (mm, z up), and the parent.
fn element(textures: &[ChannelMaps; 2], k: usize) -> (DVec3, DVec3, usize) {
    let texel = |maps: &ChannelMaps| ["R", "G", "B", "A"].map(|c| maps.get(c).unwrap()[k]);
    let ([x, y, z, parent], [a, b, c, length]) = (texel(&textures[0]), texel(&textures[1]));
    assert!((Vec3::new(a, b, c).length() - 1.0).abs() < 1e-6 && length > 0.0);
    let pivot = up(x, y, z);
    (pivot, pivot + up(a * length, b * length, c * length), parent as usize)
}

#[test]
fn the_hierarchy_is_in_the_textures() {
    let folder = tempfile::tempdir().unwrap();
    let sapling = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/bird-cherry-sapling.toml");
    std::fs::copy(sapling, folder.path().join("sapling.toml")).unwrap();
    let path = scene(folder.path(), &format!("grow = \"sapling.toml\"\n{BARK}position_mm = [500, -200, 100]\n"));
    let words = ["export", "scene.toml", "--to", "pivots", "-o", "out"];
    assert_eq!(run(folder.path(), &words).0, Some(0));
    // What of the scene is lost lies beside them, and the folder is still one of pivots.
    assert_eq!(run(folder.path(), &words).0, Some(0));
    let out = folder.path().join("out");
    let lost = std::fs::read_to_string(out.join("loss.json")).unwrap();
    assert!(["\"pivots\"", "of sapling has", "own colour", "cameras"].iter().all(|w| lost.contains(w)), "{lost}");
    let textures = ["pivot_parent.exr", "axis_length.exr"].map(|name| read_exr(&out.join(name)).unwrap());
    let about: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("pivots.json")).unwrap()).unwrap();
    let (width, height) = (textures[0].width, textures[0].height);
    let count = about["elements"].as_u64().unwrap() as usize;
    assert_eq!([&about["width"], &about["height"]], [width, height]);
    assert!(count <= width * height && about["fused"] == 0);

    let plant = planted(&SceneManifest::read(&path).unwrap(), &Ledger::new()).unwrap()[0].clone();
    let plant = plant.plant.moved(plant.places[0]);
    assert_eq!(count, plant.branches.len() + plant.leaves.len());
    let all: Vec<_> = (0..count).map(|k| element(&textures, k)).collect();
    // The element with this pivot and this tip. No two elements have the same.
    let find = |pivot: DVec3, tip: DVec3| {
        let mut found = (0..count).filter(|k| all[*k].0.distance(pivot) < 1e-2 && all[*k].1.distance(tip) < 1e-2);
        let one = found.next().unwrap();
        assert!(found.next().is_none());
        one
    };
    let own: Vec<usize> = plant.branches.iter().map(|b| find(b.root, b.point(1.0).0)).collect();
    for (branch, k) in plant.branches.iter().zip(&own) {
        assert_eq!(all[*k].2, branch.parent.map_or(*k, |joint| own[joint.branch]), "{}", branch.name);
    }
    // Leaves hang on their branches' elements at their pivots. From every element, the trunk is reached within four
    // levels.
    for k in (0..count).filter(|k| !own.contains(k)) {
        let branch = &plant.branches[own.iter().position(|b| *b == all[k].2).unwrap()];
        let local = branch.frame().inverse().transform_point3(all[k].0);
        assert!(nearest(&branch.axis, local).1 < 1e-2);
        let trunk = (0..3).fold(k, |at, _| all[at].2);
        assert_eq!(all[trunk].2, trunk);
    }
    // Every vertex has the right element: bark lies around its branch, and leaves beside the line from pivot to tip.
    let (document, buffers, _) = gltf::import(out.join("plant.glb")).unwrap();
    let mut vertices = vec![0; count];
    for node in document.nodes() {
        let primitive = node.mesh().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|b| Some(&buffers[b.index()]));
        let texels = reader.read_tex_coords(1).unwrap().into_f32();
        for ([x, y, z], [u, v]) in reader.read_positions().unwrap().zip(texels) {
            let k = (v * height as f32) as usize * width + (u * width as f32) as usize;
            vertices[k] += 1;
            let (place, (pivot, tip, _)) = (up(x, y, z), all[k]);
            let off = match own.iter().position(|b| *b == k) {
                Some(branch) => {
                    let branch = &plant.branches[branch];
                    let local = branch.frame().inverse().transform_point3(place);
                    nearest(&branch.axis, local).1 / (1.01 * branch.root_radius)
                }
                None => place.distance(pivot).max(place.distance(tip)) / (1.3 * pivot.distance(tip)),
            };
            assert!(off < 1.0, "{place} {k} {off}");
        }
    }
    let blade = plant.blades[0].mesh.positions.len();
    for (k, have) in vertices.iter().enumerate() {
        let branch = own.iter().position(|b| *b == k);
        assert_eq!(*have, branch.map_or(blade, |b| plant.branches[b].wood.positions.len()));
    }
    // The export may overwrite itself, but not the files of others.
    assert_eq!(run(folder.path(), &words).0, Some(0));
    for (words, expected) in [
        ("scene.toml --to pivots --time 1 -o out", "expected no time"),
        ("scene.toml --to pivots -o -", "writes several files"),
        ("scene.toml --to csv -o a.csv", "exported as gltf or pivots"),
    ] {
        let words: Vec<&str> = ["export"].into_iter().chain(words.split(' ')).collect();
        let (code, said) = run(folder.path(), &words);
        assert!(code == Some(2) && said.contains(expected), "{words:?}: {said}");
    }
}
