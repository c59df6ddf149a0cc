//! Plants of other programs, from their file to a plant that a scene takes.

use super::plant::{ImportSummary, plant};
use super::*;
use crate::file;
use crate::form::{Plant, tube};
use glam::{DMat4, DQuat, DVec2};
use mesophyll_files::glb::{self, Glb};
use mesophyll_files::mesh::LeafMesh;
use serde_json::{Value, json};
use std::path::PathBuf;

/// From z up (mm) to the file's frame, in metres.
fn to_file(p: DVec3) -> [f32; 3] {
    DVec3::new(p.x, p.z, -p.y).as_vec3().to_array().map(|v| v / 1000.0)
}

/// Writes meshes (mm, z up), each with the name of its material, as one node each.
fn write(folder: &Path, parts: &[(&str, &LeafMesh)], change: impl Fn(&mut Value)) -> PathBuf {
    let mut file = Glb::default();
    let mut names: Vec<&str> = Vec::new();
    let mut meshes = Vec::new();
    for (name, mesh) in parts {
        let k = names.iter().position(|n| n == name).unwrap_or_else(|| {
            names.push(name);
            names.len() - 1
        });
        let places: Vec<[f32; 3]> = mesh.positions.iter().map(|p| to_file(*p)).collect();
        let mut attributes = json!({"POSITION": file.floats("VEC3", &places)});
        if !mesh.uvs.is_empty() {
            let uvs: Vec<[f32; 2]> = mesh.uvs.iter().map(|t| t.as_vec2().to_array()).collect();
            attributes["TEXCOORD_0"] = json!(file.floats("VEC2", &uvs));
        }
        let indices = file.indices(&mesh.indices);
        meshes.push(json!({"primitives": [{"attributes": attributes, "indices": indices, "material": k}]}));
    }
    let nodes: Vec<Value> = (0..meshes.len()).map(|k| json!({"mesh": k})).collect();
    let all: Vec<usize> = (0..nodes.len()).collect();
    let mut root = json!({"asset": glb::asset(), "scene": 0, "scenes": [{"nodes": all}], "nodes": nodes,
        "meshes": meshes, "materials": names.iter().map(|n| json!({"name": n})).collect::<Vec<_>>()});
    change(&mut root);
    let path = folder.join("elsewhere.glb");
    file.write(&path, root).unwrap();
    path
}

/// A blade in the plane of x and y whose two halves differ, its base at x = 0.
fn blade() -> LeafMesh {
    let outline = [(0.0, 0.0), (20.0, -9.0), (60.0, -4.0), (80.0, 0.0), (55.0, 11.0), (15.0, 7.0)];
    LeafMesh {
        positions: outline.iter().map(|(x, y)| DVec3::new(*x, *y, 0.0)).collect(),
        uvs: outline.iter().map(|(x, y)| DVec2::new(x / 80.0, 0.5 - y / 40.0)).collect(),
        indices: vec![0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5],
        ..LeafMesh::default()
    }
}

/// A trunk of 1.2 m with a bough, and sixty leaves along both: copies of one blade, turned and of different sizes.
fn tree() -> (LeafMesh, LeafMesh) {
    let trunk = tube(&[DVec3::ZERO, DVec3::Z * 1200.0], [20.0, 8.0], 8, 9);
    let bough = tube(&[DVec3::Z * 600.0, DVec3::new(500.0, 0.0, 900.0)], [7.0, 3.0], 8, 9);
    let mut wood = trunk;
    wood.append(&bough, DMat4::IDENTITY);
    let mut leaves = LeafMesh::default();
    for k in 0..60 {
        let at = f64::from(k) / 60.0;
        let (place, radius) = match k % 2 {
            0 => (DVec3::Z * (300.0 + 850.0 * at), 16.0),
            _ => (DVec3::new(100.0, 0.0, 660.0).lerp(DVec3::new(480.0, 0.0, 888.0), at), 5.0),
        };
        let turn = DQuat::from_rotation_z(2.4 * f64::from(k)) * DQuat::from_rotation_y(-0.4);
        let from = place + turn * DVec3::X * radius;
        let size = DVec3::splat(0.8 + 0.4 * at);
        leaves.append(&blade(), DMat4::from_scale_rotation_translation(size, turn, from));
    }
    (wood, leaves)
}

fn area(mesh: &LeafMesh) -> f64 {
    (0..mesh.triangles())
        .map(|t| {
            let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum()
}

fn made(path: &Path) -> (Plant, ImportSummary, PlantPieces) {
    let (soup, found) = import(path, None).unwrap();
    let (plant, made) = plant(&soup, &found, "tree");
    (plant, made, found)
}

/// The corners of the triangles, sorted, of all blades where they stand.
fn sorted(mesh: &LeafMesh) -> Vec<[i64; 3]> {
    let mut all: Vec<[i64; 3]> =
        mesh.indices.iter().map(|k| mesh.positions[*k as usize].to_array().map(|v| (v * 5.0).round() as i64)).collect();
    all.sort_unstable();
    all
}

#[test]
fn a_plant_is_written_with_branches_and_instances_and_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let (wood, leaves) = tree();
    let path = write(dir.path(), &[("Bark", &wood), ("Leaf", &leaves)], |_| ());
    let (plant, made, _) = made(&path);
    assert_eq!(made, ImportSummary::default());
    assert_eq!((plant.branches.len(), plant.leaves.len(), plant.blades.len()), (2, 60, 1));
    assert_eq!((plant.branches[0].material.as_str(), plant.blades[0].material.as_str()), ("Bark", "Leaf"));
    // The trunk stands upright at its place, and the bough grows where it was put.
    let bough = &plant.branches[1];
    assert!(plant.branches[0].chord().distance(DVec3::Z * 1200.0) < 1.0);
    assert!(bough.parent.is_some_and(|j| j.branch == 0 && (j.at - 0.5).abs() < 0.01), "{:?}", bough.parent);
    assert!(
        bough.root.distance(DVec3::Z * 600.0) < 1.0 && bough.point(1.0).0.distance(DVec3::new(500.0, 0.0, 900.0)) < 1.0
    );
    // Even leaves are on the trunk, odd ones on the bough, each hanging by its base.
    for (k, leaf) in plant.leaves.iter().enumerate() {
        assert_eq!(leaf.joint.branch, k % 2, "{k}");
        let (hang, to_tip) = plant.hang(leaf);
        let base = leaf.transform.transform_point3(DVec3::X * -40.0 * 0.8);
        assert!(base.distance(hang) < to_tip.length(), "{k}");
    }
    // Every blade and all wood is where it was, through the file too.
    let out = dir.path().join("tree.glb");
    file::write(&plant, &out).unwrap();
    let back = file::read(&out).unwrap();
    for plant in [&plant, &back] {
        let blades = plant.blades_of("Leaf");
        assert!((area(&blades) / area(&leaves) - 1.0).abs() < 1e-5);
        let off = sorted(&blades)
            .iter()
            .zip(sorted(&leaves))
            .filter(|(a, b)| (0..3).any(|c| (a[c] - b[c]).abs() > 1))
            .count();
        assert_eq!(off, 0);
        let bark: f64 = plant.branches.iter().map(|b| area(&b.wood)).sum();
        assert!((bark / area(&wood) - 1.0).abs() < 1e-5);
    }
    assert!(back.branches.iter().all(|b| b.length() > 100.0 && b.root_radius > b.tip_radius));
}

#[test]
fn without_branches_it_stands_still_and_upright() {
    let dir = tempfile::tempdir().unwrap();
    let (wood, leaves) = tree();
    let path = write(dir.path(), &[("Bark", &wood), ("Leaf", &leaves)], |_| ());
    let error = file::read(&path).unwrap_err().to_string();
    assert!(error.contains("`mesophyll import FILE -o PLANT.glb`"), "{error}");
    let known = |name: &str| Some(if name == "Leaf" { MaterialClass::Leaf } else { MaterialClass::Wood });
    let plant = file::read_any(&path, &known).unwrap();
    assert_eq!((plant.branches.len(), plant.leaves.len(), plant.blades.len()), (1, 60, 1));
    assert!(plant.branches[0].length() == 0.0 && (area(&plant.branches[0].wood) / area(&wood) - 1.0).abs() < 1e-5);
    let top = plant.branches[0].wood.positions.iter().map(|p| p.z).fold(0.0, f64::max);
    assert!((top - 1200.0).abs() < 1.0, "{top}");
    // Blades may be called wood, and the other way round: the scene decides. Bark is not flat.
    let turned = |name: &str| Some(if name == "Bark" { MaterialClass::Leaf } else { MaterialClass::Wood });
    let error = file::read_any(&path, &turned).unwrap_err().to_string();
    assert!(error.contains("no flat piece of the material \"Bark\"") && error.contains("[r, g, b]"), "{error}");
    let all = file::read_any(&path, &|_| Some(MaterialClass::Wood)).unwrap();
    assert_eq!((all.branches.len(), all.leaves.len()), (2, 0));
    // A part needs no branches either.
    let soup = soup::read(&path, None).unwrap();
    assert!((area(&super::plant::part(&soup, "Leaf")) / area(&leaves) - 1.0).abs() < 1e-5);
    assert!(super::plant::part(&soup, "Twig").indices.is_empty());
}

#[test]
fn doubled_backs_mirrors_and_sizes_are_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let (wood, leaves) = tree();
    let back: Vec<u32> = leaves.indices.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect();
    // The back as a mesh of its own, with vertices and a material of its own.
    let back = LeafMesh { indices: back, ..leaves.clone() };
    let path = write(dir.path(), &[("Bark", &wood), ("Leaf", &leaves), ("Back", &back)], |_| ());
    let (plant, _, found) = made(&path);
    assert_eq!((found.doubled, plant.leaves.len()), (leaves.triangles(), 60));
    assert!(strange(&soup::read(&path, None).unwrap(), &found).is_empty());
    // A mirrored and an uneven scale of the whole: everything is where the file says, its fronts are still fronts.
    let scale = [-1.0, 1.25, 1.0];
    let path = write(dir.path(), &[("Bark", &wood), ("Leaf", &leaves)], |root| {
        for node in root["nodes"].as_array_mut().unwrap() {
            node["scale"] = json!(scale);
        }
    });
    let (plant, ..) = made(&path);
    let blades = plant.blades_of("Leaf");
    let moved = |p: &DVec3| DVec3::new(-p.x, p.y, 1.25 * p.z);
    let want = LeafMesh { positions: leaves.positions.iter().map(moved).collect(), ..leaves.clone() };
    assert!((area(&blades) / area(&want) - 1.0).abs() < 1e-4);
    let facing = |mesh: &LeafMesh, t: usize| {
        let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
        (b - a).cross(c - a)
    };
    // All fronts look up in the tree, and so they do in its mirror image.
    assert!((0..blades.triangles()).all(|t| facing(&blades, t).z > 0.0));
    // Metres in place of centimetres and of millimetres.
    for (factor, expected) in [(300.0, "longer than"), (0.01, "across, which no plant")] {
        let path = write(dir.path(), &[("Bark", &wood), ("Leaf", &leaves)], |root| {
            for node in root["nodes"].as_array_mut().unwrap() {
                node["scale"] = json!([factor, factor, factor]);
            }
        });
        let (soup, found) = import(&path, None).unwrap();
        let said = strange(&soup, &found).join("; ");
        assert!(said.contains(expected) && said.contains("--unit"), "{said}");
    }
}

/// A ball of triangles, as crowns are drawn in simple models.
fn ball(centre: DVec3, radius: f64, rings: u32) -> LeafMesh {
    let mut mesh = LeafMesh::default();
    for j in 0..=rings {
        for i in 0..2 * rings {
            let (a, b) = (
                std::f64::consts::PI * f64::from(j) / f64::from(rings),
                std::f64::consts::PI * f64::from(i) / f64::from(rings),
            );
            let rough = 1.0 + 0.08 * (7.0 * a).sin() * (3.0 * b).cos();
            mesh.positions.push(centre + DVec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()) * (radius * rough));
        }
    }
    let n = 2 * rings;
    for (j, i) in (0..rings).flat_map(|j| (0..n).map(move |i| (j, i))) {
        let (a, b) = (j * n + i, j * n + (i + 1) % n);
        mesh.indices.extend([a, a + n, b, b, a + n, b + n]);
    }
    mesh
}

#[test]
fn crowns_that_are_balls_or_cones_are_no_branches() {
    let dir = tempfile::tempdir().unwrap();
    let trunk = tube(&[DVec3::ZERO, DVec3::Z * 2000.0], [90.0, 60.0], 8, 6);
    let cone = tube(&[DVec3::Z * 1200.0, DVec3::Z * 3400.0], [800.0, 1.0], 10, 2);
    let egg = |rings| {
        let mut egg = ball(DVec3::Z * 2600.0, 700.0, rings);
        egg.positions.iter_mut().for_each(|p| p.z = 2600.0 + 3.0 * (p.z - 2600.0));
        egg
    };
    for (what, crown) in [
        ("fine", ball(DVec3::Z * 2600.0, 900.0, 12)),
        ("coarse", ball(DVec3::Z * 2600.0, 900.0, 3)),
        ("egg", egg(9)),
        ("cone", cone),
    ] {
        let path = write(dir.path(), &[("Material", &trunk), ("Material", &crown)], |_| ());
        let (plant, made, found) = made(&path);
        assert_eq!((found.branches.len(), found.others.len()), (1, 1), "{what}");
        assert!((found.branches[0].tube.length() - 2000.0).abs() < 20.0, "{what}");
        assert!(found.others[0].why.contains("no branch"), "{what}: {}", found.others[0].why);
        // The crown is wood that the trunk carries, without length, so that it does not bend.
        assert_eq!((plant.branches.len(), made.still), (2, 1), "{what}");
        assert!(plant.branches[1].parent.is_some_and(|j| j.branch == 0) && plant.branches[1].length() == 0.0, "{what}");
    }
}

/// Square cards with a picture: the picture's top is the tip, wherever the nearest branch is.
#[test]
fn a_square_card_stands_as_its_picture_does() {
    let dir = tempfile::tempdir().unwrap();
    let trunk = tube(&[DVec3::ZERO, DVec3::Z * 1000.0], [20.0, 10.0], 8, 6);
    for turn in [0.0, 1.2, 3.0] {
        let mut card = LeafMesh::default();
        // The card's picture has its bottom at y = −25 before it is turned, and lies 40 mm beside the trunk.
        let frame = DMat4::from_translation(DVec3::new(60.0, 0.0, 500.0)) * DMat4::from_rotation_z(turn);
        card.append(&LeafMesh::rectangle(50.0, 50.0), frame);
        let path = write(dir.path(), &[("Bark", &trunk), ("Leaf", &card)], |_| ());
        let (plant, ..) = made(&path);
        let tip = plant.leaves[0].transform.x_axis.truncate().normalize();
        assert!(tip.distance(DQuat::from_rotation_z(turn) * DVec3::Y) < 1e-4, "{turn}: {tip}");
    }
}

/// Materials without names are told apart by their numbers, and the plant that is written has the file's colours: a
/// factor times the mean of the picture's opaque texels, in linear values.
#[test]
fn colours_are_kept_and_materials_without_names_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let (wood, leaves) = tree();
    // Two opaque texels of sRGB's 188 (.5029) and 255, and two that are cut out.
    let texels = [188, 255, 0, 255, 255, 255, 0, 255, 9, 9, 9, 0, 9, 9, 9, 0];
    mesophyll_files::image::write_png(&folder.path().join("leaf.png"), 2, 2, &texels).unwrap();
    let parts = [("wood", &wood), ("leaf", &leaves)];
    let path = write(folder.path(), &parts, |root| {
        root["materials"] = json!([{"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.1, 0.05, 1.0]}},
            {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1.0, 1.0, 1.0], "baseColorTexture": {"index": 0}}}]);
    });
    let bytes = std::fs::read(&path).unwrap();
    let mut glb = gltf::binary::Glb::from_slice(&bytes).unwrap();
    let mut root: Value = serde_json::from_slice(&glb.json).unwrap();
    (root["images"], root["textures"]) = (json!([{"uri": "leaf.png"}]), json!([{"source": 0}]));
    glb.json = serde_json::to_vec(&root).unwrap().into();
    std::fs::write(&path, glb.to_vec().unwrap()).unwrap();
    let (plant, _, _) = made(&path);
    assert!(plant.blades.iter().all(|blade| blade.material == "material 1"));
    assert!(plant.branches.iter().all(|branch| branch.material == "material 0"));
    let out = folder.path().join("out.glb");
    file::write(&plant, &out).unwrap();
    let (document, ..) = gltf::import(&out).unwrap();
    let colour = |name: &str| {
        let found = document.materials().find(|m| m.name() == Some(name)).unwrap();
        found.pbr_metallic_roughness().base_color_factor()
    };
    assert_eq!(colour("material 0"), [0.2, 0.1, 0.05, 1.0]);
    for (got, want) in colour("material 1").into_iter().zip([0.5 * (0.502_886 + 1.0) / 2.0, 1.0, 0.0, 1.0]) {
        assert!((f64::from(got) - want).abs() < 1e-4, "{got} {want}");
    }
}

/// A blade as a grid of nine by five vertices, of which `bend` makes a place of the share along and across (−½ to ½).
/// The diagonals of its cells run one way or the other.
fn grid(other: bool, bend: impl Fn(f64, f64) -> DVec3) -> LeafMesh {
    let mut out = LeafMesh::default();
    for k in 0..45 {
        out.positions.push(bend(f64::from(k / 5) / 8.0, f64::from(k % 5) / 4.0 - 0.5));
    }
    for cell in (0..40).filter(|k| k % 5 < 4) {
        let [a, b, c, d] = [cell, cell + 5, cell + 6, cell + 1];
        out.indices.extend(if other { [a, b, d, b, c, d] } else { [a, b, c, a, c, d] });
    }
    out
}

/// The trunk and the bough of [`tree`] with copies of a blade along the trunk.
fn with_blades(blade: &LeafMesh) -> (LeafMesh, LeafMesh) {
    let mut leaves = LeafMesh::default();
    for k in 0..40 {
        let turn = DQuat::from_rotation_z(2.4 * f64::from(k));
        let from = DVec3::Z * (300.0 + 20.0 * f64::from(k)) + turn * DVec3::X * 20.0;
        leaves.append(blade, DMat4::from_rotation_translation(turn, from));
    }
    (tree().0, leaves)
}

/// Blades that are rolled up by 290°, or that hang down in a half circle, are blades; a cone, which is a sheet too, is
/// none.
#[test]
fn rolled_and_hanging_leaves_are_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let rolled = grid(false, |along, across| {
        let (sin, cos) = (across * 290f64.to_radians()).sin_cos();
        DVec3::new(80.0 * along, 8.0 * sin, 8.0 * cos)
    });
    let hanging = grid(false, |along, across| {
        let (sin, cos) = (along * 180f64.to_radians()).sin_cos();
        DVec3::new(25.0 * sin, 20.0 * across, 25.0 * cos - 25.0)
    });
    for blade in [rolled, hanging] {
        let (wood, leaves) = with_blades(&blade);
        let (_, _, found) = made(&write(folder.path(), &[("wood", &wood), ("leaf", &leaves)], |_| ()));
        assert_eq!((found.branches.len(), found.leaves.len(), found.others.len()), (2, 40, 0));
        let whole: f64 = found.leaves.iter().map(|leaf| leaf.area).sum();
        assert!((whole / area(&leaves) - 1.0).abs() < 1e-5, "{whole}");
    }
    // A spike: a cone that is open where it grows out of the trunk.
    let (wood, leaves) = with_blades(&blade());
    let mut spike = LeafMesh { positions: vec![DVec3::new(120.0, 0.0, 500.0)], ..LeafMesh::default() };
    for k in 0..8 {
        let (sin, cos) = (f64::from(k) / 8.0 * std::f64::consts::TAU).sin_cos();
        spike.positions.push(DVec3::new(10.0, 6.0 * cos, 500.0 + 6.0 * sin));
        spike.indices.extend([0, k + 1, (k + 1) % 8 + 1]);
    }
    let parts = [("wood", &wood), ("leaf", &leaves), ("spike", &spike)];
    let (_, _, found) = made(&write(folder.path(), &parts, |_| ()));
    assert_eq!(found.leaves.len(), 40);
}

/// A back of another material that is cut into triangles the other way, a hair below its front, counts no area; which
/// of the two is the front follows from which faces upwards. Leaflets that touch in a point are two.
#[test]
fn backs_of_their_own_and_leaflets_that_touch() {
    let folder = tempfile::tempdir().unwrap();
    let flat = |shift: f64| {
        move |along: f64, across: f64| {
            DVec3::new(80.0 * along, 30.0 * across * (1.0 - along), 10.0 * along * along + shift)
        }
    };
    let (wood, upper) = with_blades(&grid(false, flat(0.0)));
    let (_, mut lower) = with_blades(&grid(true, flat(-0.2)));
    for t in lower.indices.chunks_exact_mut(3) {
        t.swap(0, 1);
    }
    for parts in [[("a", &upper), ("b", &lower)], [("a", &lower), ("b", &upper)]] {
        let parts = [("wood", &wood), parts[0], parts[1]];
        let (plant, _, found) = made(&write(folder.path(), &parts, |_| ()));
        assert_eq!((found.leaves.len(), found.others.len()), (40, 0));
        let front = if std::ptr::eq(parts[1].1, &upper) { "a" } else { "b" };
        assert!(plant.blades.iter().all(|blade| blade.material == front), "{front}");
    }
    // Two leaflets that stand on each other's edge, so that together they are not flat.
    let mut pair = blade();
    pair.append(&blade(), DMat4::from_quat(DQuat::from_rotation_x(1.5) * DQuat::from_rotation_z(0.7)));
    let (wood, leaves) = with_blades(&pair);
    let (_, _, found) = made(&write(folder.path(), &[("wood", &wood), ("leaf", &leaves)], |_| ()));
    assert_eq!((found.leaves.len(), found.others.len()), (80, 0));
}
