use super::*;
use crate::form::{Blade, Branch, BranchMotion, Joint, Leaf, Plant, tube};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_files::mesh::LeafMesh;
use serde_json::json;
use std::path::Path;

/// A plant of two branches, one of them bent, with leaves on both.
fn plant() -> Plant {
    let branch = |name: &str, parent, level, root: DVec3, turn: DQuat, axis: Vec<DVec3>| Branch {
        name: name.into(),
        parent,
        level,
        root,
        axes: [turn * DVec3::X, turn * DVec3::Y, turn * DVec3::Z],
        wood: tube(&axis, [4.0, 1.0], 5, 3),
        axis,
        root_radius: 4.0,
        tip_radius: 1.0,
        load: 0.25,
        bending_load: 0.125 * level as f64,
        stated: BranchMotion { lean_per_m_s: Some(0.02), resonance_hz: None, damping: Some(0.3) },
        material: "bark".into(),
    };
    let up = DQuat::from_rotation_y(-1.5);
    let trunk = branch("trunk", None, 0, DVec3::new(1.0, 2.0, 3.0), up, vec![DVec3::ZERO, DVec3::X * 900.0]);
    let on = Some(Joint { branch: 0, at: 0.75 });
    let bent = vec![DVec3::ZERO, DVec3::X * 100.0, DVec3::new(190.0, 20.0, -30.0)];
    let bough = branch("bough", on, 1, trunk.point(0.75).0, DQuat::from_rotation_z(0.7), bent);
    let leaf = |branch: usize, at: f64, turn: f64| Leaf {
        blade: 0,
        joint: Joint { branch, at },
        transform: DMat4::from_scale_rotation_translation(
            DVec3::splat(1.0 + 0.2 * turn),
            DQuat::from_rotation_x(turn),
            DVec3::new(300.0 * turn, 5.0, 700.0),
        ),
    };
    Plant {
        name: "twig".into(),
        branches: vec![trunk, bough],
        leaves: vec![leaf(0, 0.25, 0.1), leaf(1, 0.5, -0.4), leaf(1, 1.0, 0.9)],
        blades: vec![Blade { material: "elm".into(), mesh: LeafMesh::rectangle(60.0, 30.0) }],
        period: Some([400.0, 250.0]),
        ..Plant::default()
    }
}

fn near(a: DVec3, b: DVec3, limit: f64) -> bool {
    a.distance(b) <= limit
}

#[test]
fn what_is_written_is_read_back_to_single_precision() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twig.glb");
    let plant = plant();
    write(&plant, &path).unwrap();
    let back = read(&path).unwrap();
    assert_eq!((back.name.as_str(), back.branches.len(), back.leaves.len()), ("twig", 2, 3));
    let [x, y] = back.period.unwrap();
    assert!((x - 400.0).abs() < 1e-4 && (y - 250.0).abs() < 1e-4);
    // Places are within 1000 mm, where single precision has steps of 6e-5 mm.
    let limit = 2e-4;
    for (a, b) in plant.branches.iter().zip(&back.branches) {
        assert_eq!((&a.name, a.level, &a.material), (&b.name, b.level, &b.material));
        assert_eq!(a.parent, b.parent);
        assert!(a.stated == b.stated && (a.bending_load - b.bending_load).abs() <= 1e-6 * a.bending_load);
        // The node that turns mm to metres has a scale in single precision.
        let same = |p: f64, q: f64| (p / q - 1.0).abs() < 1e-6;
        assert!(same(a.root_radius, b.root_radius) && same(a.tip_radius, b.tip_radius) && same(a.load, b.load));
        assert!(near(a.root, b.root, limit), "{} {}", a.root, b.root);
        assert!((0..3).all(|k| near(a.axes[k], b.axes[k], 1e-6)));
        // Lengths come from the extras, in double precision.
        assert_eq!(a.axis.len(), b.axis.len());
        assert!(a.axis.iter().zip(&b.axis).all(|(p, q)| near(*p, *q, 1e-6 * a.length())));
        assert_eq!(a.wood.indices, b.wood.indices);
        for (p, q) in a.wood.positions.iter().zip(&b.wood.positions) {
            assert!(near(*p, *q, limit));
        }
    }
    // Leaves come back in the order of the file's nodes.
    let sorted = |plant: &Plant| {
        let mut leaves = plant.leaves.clone();
        leaves.sort_by(|a, b| a.joint.branch.cmp(&b.joint.branch).then(a.joint.at.total_cmp(&b.joint.at)));
        leaves
    };
    for (a, b) in sorted(&plant).iter().zip(&sorted(&back)) {
        assert_eq!(a.joint, b.joint);
        assert!(a.transform.abs_diff_eq(b.transform, limit), "{} {}", a.transform, b.transform);
    }
    assert_eq!(back.blades[0].material, "elm");
    assert_eq!(back.blades[0].mesh.uvs, plant.blades[0].mesh.uvs);
}

/// Readers that know nothing of the extras use the node transforms alone. They find the plant upright and in metres.
#[test]
fn the_file_stands_upright_in_metres() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twig.glb");
    let plant = plant();
    write(&plant, &path).unwrap();
    let mesh = mesophyll_files::mesh::read_plain(&path, None).unwrap();
    let top = mesh.positions.iter().map(|p| p.y).fold(0.0, f64::max);
    let tip = plant.branches[0].point(1.0).0;
    assert!((top - tip.z).abs() < 1.5, "{top} {tip}");
}

/// The JSON of a file after a change, written as .gltf with its buffer beside it.
fn changed(folder: &Path, change: impl Fn(&mut serde_json::Value)) -> std::path::PathBuf {
    let path = folder.join("twig.glb");
    write(&plant(), &path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let glb = gltf::binary::Glb::from_slice(&bytes).unwrap();
    let mut json: serde_json::Value = serde_json::from_slice(&glb.json).unwrap();
    json["buffers"][0]["uri"] = json!("twig.bin");
    std::fs::write(folder.join("twig.bin"), glb.bin.unwrap()).unwrap();
    change(&mut json);
    let out = folder.join("twig.gltf");
    std::fs::write(&out, serde_json::to_vec(&json).unwrap()).unwrap();
    out
}

#[test]
fn leaves_may_be_plain_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = changed(folder.path(), |json| {
        json["nodes"][3].as_object_mut().unwrap().remove("extensions");
        json["nodes"][3]["translation"] = json!([450.0, 0.0, 30.0]);
    });
    let back = read(&path).unwrap();
    assert_eq!(back.leaves.len(), 3);
    // The leaf is half way up the trunk, which is 900 mm long.
    assert!((back.leaves[0].joint.at - 0.5).abs() < 1e-6, "{:?}", back.leaves[0]);
}

#[test]
fn a_scaled_node_scales_what_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let plain = read(&changed(folder.path(), |_| ())).unwrap();
    let twice = read(&changed(folder.path(), |json| json["nodes"][0]["scale"] = json!([0.002, 0.002, 0.002]))).unwrap();
    for (a, b) in plain.branches.iter().zip(&twice.branches) {
        assert!((b.length() / a.length() - 2.0).abs() < 1e-6 && (b.root_radius / a.root_radius - 2.0).abs() < 1e-6);
        assert!(near(a.root * 2.0, b.root, 1e-3));
    }
}

/// A leaf's node may be mirrored and scaled unevenly: the blade gets that shape, and its place is a turn, a move and
/// one size. Lengths may be in metres.
#[test]
fn mirrored_and_uneven_leaves_keep_their_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let plain = read(&changed(folder.path(), |_| ())).unwrap();
    let triangles = |plant: &Plant| {
        let mesh = plant.blades_of("elm");
        (0..mesh.triangles()).map(|t| mesh.triangle(t).map(|k| mesh.positions[k])).collect::<Vec<_>>()
    };
    for scale in [[-1.0, -1.0, -1.0], [1.3, 1.0, 0.8], [1.0, -2.0, 1.0]] {
        // The instances of the first node become one plain leaf at the trunk's root.
        let alone = |scale: [f64; 3]| {
            move |json: &mut serde_json::Value| {
                json["nodes"][3].as_object_mut().unwrap().remove("extensions");
                json["nodes"][3]["scale"] = json!(scale);
            }
        };
        let even = read(&changed(folder.path(), alone([1.0; 3]))).unwrap();
        let own = read(&changed(folder.path(), alone(scale))).unwrap();
        // The bough's leaves come before it.
        let leaf = own.leaves.last().unwrap();
        let linear = glam::DMat3::from_mat4(leaf.transform);
        let square = linear.transpose() * linear * (1.0 / linear.determinant().cbrt().powi(2));
        assert!(linear.determinant() > 0.0 && square.abs_diff_eq(glam::DMat3::IDENTITY, 1e-4), "{scale:?}: {square}");
        let trunk = even.branches[0].frame();
        let place = trunk * DMat4::from_scale(DVec3::from(scale)) * trunk.inverse();
        for (found, [a, b, c]) in triangles(&own).iter().zip(triangles(&even)).skip(4) {
            // A mirror image has its corners in the other order.
            let wanted = if linear.determinant() * scale.iter().product::<f64>() < 0.0 { [a, c, b] } else { [a, b, c] };
            let wanted = wanted.map(|p| place.transform_point3(p));
            assert!((0..3).all(|k| near(found[k], wanted[k], 0.01)), "{scale:?}: {found:?} {wanted:?}");
        }
    }
    // The same plant in metres: what is drawn for a leaf is as large as before.
    let metres = read(&changed(folder.path(), |json| {
        json["nodes"][0]["scale"] = json!([1.0, 1.0, 1.0]);
        for k in 1..3 {
            json["nodes"][k]["extras"]["branch"]["axis_mm"] = json!([[0, 0, 0], [0.9, 0, 0]]);
        }
    }));
    let (leaf, same) = (metres.unwrap().leaves[0], plain.leaves[0]);
    assert!((leaf.transform.determinant() / same.transform.determinant() - 1.0).abs() < 1e-5);
}

#[test]
fn bad_files_end_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let said = |change: &dyn Fn(&mut serde_json::Value)| {
        read(&changed(folder.path(), change)).map(|_| ()).unwrap_err().to_string()
    };
    // What is changed in the file, and what is then said.
    type Case<'a> = (&'a dyn Fn(&mut serde_json::Value), &'a str);
    let cases: [Case; 14] = [
        (&|j| j["buffers"][0]["uri"] = json!("../twig.bin"), "leads outside the file's folder"),
        (&|j| j["buffers"][0]["uri"] = json!("gone.bin"), "no such file"),
        (&|j| j["nodes"][2]["name"] = json!("trunk"), "another branch has the same name"),
        (&|j| j["nodes"][1]["scale"] = json!([1.0, 2.0, 1.0]), "expected the same along all axes"),
        (&|j| j["nodes"][1]["rotation"] = json!([0.0, 0.0, 0.0, 0.0]), "not finite"),
        (&|j| j["nodes"][2]["extras"]["branch"]["at"] = json!(1.5), "found 1.5, expected 0"),
        (&|j| j["nodes"][2]["extras"]["branch"]["root_radius_mm"] = json!(-1.0), "found -1, expected a finite"),
        (&|j| j["nodes"][2]["extras"]["branch"]["damping"] = json!(0.0), "found 0, expected 0.01 to 10"),
        (&|j| j["nodes"][2]["extras"]["branch"]["resonance_hz"] = json!(-2.0), "found -2, expected 0.001 to 1000"),
        (&|j| j["nodes"][2]["extras"]["branch"] = json!({"level": 1}), "missing field"),
        (&|j| j["nodes"][3]["extensions"][INSTANCING]["attributes"]["SCALE"] = json!(999), "accessor 999"),
        (&|j| j["nodes"][3]["extensions"][INSTANCING]["attributes"]["SCALE"] = json!(3), "floats, 3 an instance"),
        (
            &|j| (1..3).for_each(|k| drop(j["nodes"][k].as_object_mut().unwrap().remove("extras"))),
            "`mesophyll import FILE -o PLANT.glb` finds branches",
        ),
        (
            &|j| {
                let a = j["meshes"][1]["primitives"][0]["indices"].as_u64().unwrap() as usize;
                j["accessors"][a]["count"] = json!(30_000_000);
            },
            "10000024 triangles, expected at most 5000000",
        ),
    ];
    for (change, expected) in cases {
        let error = said(change);
        assert!(error.contains(expected) && error.lines().count() == 1, "{expected}: {error}");
    }
    // A number that is too large to be one.
    let path = changed(folder.path(), |j| j["nodes"][2]["extras"]["branch"]["length_mm"] = json!(12345.5));
    let text = std::fs::read_to_string(&path).unwrap().replace("12345.5", "1e999");
    std::fs::write(&path, text).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("not a readable glTF file (number out of range"), "{error}");
    // What is missing once is named once, and not for each place that needs it.
    let error = said(&|j| drop(j.as_object_mut().unwrap().remove("buffers")));
    assert!(error.contains("bufferViews[0].buffer") && error.len() < 300, "{error}");
    // A place of a leaf beyond the tip, and a rotation by nothing.
    for (attribute, numbers, expected) in
        [("_AT", vec![7.0f32], "at: found 7, expected 0 (root) to 1"), ("ROTATION", vec![0.0; 4], "unit quaternion")]
    {
        let path = changed(folder.path(), |_| ());
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let of = &json["nodes"][3]["extensions"][INSTANCING]["attributes"][attribute];
        let view = json["accessors"][of.as_u64().unwrap() as usize]["bufferView"].as_u64().unwrap() as usize;
        let start = json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        let bin = folder.path().join("twig.bin");
        let mut bytes = std::fs::read(&bin).unwrap();
        let new: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes[start..start + new.len()].copy_from_slice(&new);
        std::fs::write(&bin, &bytes).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{attribute}: {error}");
    }
    // Faults in the buffer: triangles without an area, and an index out of range.
    let path = changed(folder.path(), |_| ());
    let bin = folder.path().join("twig.bin");
    let mut bytes = std::fs::read(&bin).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let accessor = json["meshes"][1]["primitives"][0]["indices"].as_u64().unwrap() as usize;
    let view = json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
    let start = json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
    let length = json["bufferViews"][view]["byteLength"].as_u64().unwrap() as usize;
    for (value, expected) in [(0u32, "degenerate"), (4000, "found 4000, expected less than the")] {
        bytes[start..start + length].chunks_exact_mut(4).for_each(|b| b.copy_from_slice(&value.to_le_bytes()));
        std::fs::write(&bin, &bytes).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
