use super::*;
use crate::file;
use std::path::PathBuf;

fn presets() -> Vec<(PathBuf, MeadowSpec)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/grass");
    let files = std::fs::read_dir(folder).unwrap().flatten().map(|f| f.path());
    let described = files.filter(|f| f.extension().is_some_and(|e| e == "toml"));
    described.map(|f| (f.clone(), MeadowSpec::read(&f).unwrap())).collect()
}

fn area(mesh: &LeafMesh) -> f64 {
    let corners = |t| mesh.triangle(t).map(|k| mesh.positions[k]);
    (0..mesh.triangles()).map(corners).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
}

/// The area of all blades is the one that numbers, lengths and widths of the description give without a mesh.
#[test]
fn a_meadow_has_the_leaf_area_of_its_description() {
    let presets = presets();
    assert!(presets.len() >= 4);
    for (path, meadow) in presets {
        let plant = meadow.grow(None);
        assert_eq!(plant, meadow.grow(Some(meadow.seed)));
        assert_ne!(plant, meadow.grow(Some(meadow.seed + 1)));
        for sward in &meadow.swards {
            let square_m2 = meadow.size_mm[0] * meadow.size_mm[1] * 1e-6;
            let steps = 10_000;
            let mean_width: f64 = (0..steps)
                .map(|k| {
                    if sward.profile.is_empty() {
                        1.0
                    } else {
                        spec::at(&sward.profile, (f64::from(k) + 0.5) / f64::from(steps))
                    }
                })
                .sum::<f64>()
                / f64::from(steps);
            // The area of an inverted egg shape by the trapezoids of its outline.
            let leaflets = sward
                .leaflet_mm
                .map_or(0.0, |[l, w]| 3.0 * l * w * (0.3 * 0.31 + 0.35 * 0.8 + 0.25 * 0.9 + 0.1 * 0.55));
            let one = sward.length_mm * sward.width_mm * mean_width + leaflets;
            // ⟨(1 + s·u)²⟩ for u evenly from −1 to 1, where s is the spread of sizes.
            let expected = sward.per_m2 * square_m2 * one * (1.0 + sward.size_spread.powi(2) / 3.0);
            let found = area(&plant.blades_of(&sward.material));
            assert!((found / expected - 1.0).abs() < 0.04, "{}: {found} {expected}", path.display());
        }
        let sides = DVec2::from(meadow.size_mm) / 2.0;
        for leaf in &plant.leaves {
            // The midrib's first point is the foot, for trefoils and blades alike.
            let foot = leaf.transform.transform_point3(plant.blades[leaf.blade].mesh.positions[1]);
            assert!(foot.z.abs() < 1e-9 && foot.truncate().abs().cmple(sides + 1e-9).all(), "{foot}");
            let up = leaf.transform.transform_vector3(DVec3::Z);
            assert!(up.z >= -1e-12, "the upper side looks down");
        }
    }
}

#[test]
fn arcs_have_their_length_and_turn() {
    for bend in [0.0, 1e-9, 0.3, 1.5, PI] {
        let steps = 20_000;
        // The arc is followed in small steps along its direction.
        let mut place = DVec3::new(-25.0, 0.0, 0.0);
        for k in 0..steps {
            let a = bend * (f64::from(k) + 0.5) / f64::from(steps);
            place += DVec3::new(a.cos(), 0.0, -a.sin()) * (50.0 / f64::from(steps));
        }
        let (found, along, up) = arc(50.0, bend, 1.0);
        assert!(found.distance(place) < 1e-6, "{bend}: {found} {place}");
        assert!((along - DVec3::new(bend.cos(), 0.0, -bend.sin())).length() < 1e-12 && along.dot(up).abs() < 1e-12);
    }
}

/// A tuft whose feet are all at one place leans in all directions.
#[test]
fn blades_of_a_tuft_at_one_place_lean_all_ways() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.toml");
    let sward = "[[sward]]\nmaterial = \"grass\"\nper_m2 = 400\nlength_mm = 50\nwidth_mm = 2\nlean_deg = 30\n\
         blades_a_tuft = 8\n[[sward]]\nmaterial = \"moss\"\nper_m2 = 0\nlength_mm = 50\nwidth_mm = 2\n";
    std::fs::write(&path, format!("schema = 1\nname = \"m\"\nseed = 1\nsize_mm = [1000, 1000]\n{sward}")).unwrap();
    let plant = crate::growth::described(&path, None).unwrap();
    // A sward without blades has no shapes.
    assert!(plant.leaves.len() == 400 && plant.blades.iter().all(|b| b.material == "grass"));
    let mut octants = [0; 8];
    for leaf in &plant.leaves {
        let out = leaf.transform.x_axis.truncate().truncate();
        octants[((out.to_angle() + PI) / TAU * 8.0).min(7.0) as usize] += 1;
    }
    // 50 are expected in each octant; the limits are four standard deviations of a count.
    assert!(octants.iter().all(|n| (22..=78).contains(n)), "{octants:?}");
}

/// A meadow that is written and read back is the same plant.
#[test]
fn a_meadow_goes_through_a_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("clover.glb");
    let (_, meadow) = presets().into_iter().find(|(_, m)| m.swards.len() == 2).unwrap();
    let plant = meadow.grow(None);
    file::write(&plant, &path).unwrap();
    let back = file::read(&path).unwrap();
    assert_eq!(
        (back.branches.len(), back.leaves.len(), back.blades.len()),
        (1, plant.leaves.len(), plant.blades.len())
    );
    for material in ["grass", "clover"] {
        let [there, here] = [back.blades_of(material), plant.blades_of(material)];
        assert_eq!(there.indices.len(), here.indices.len());
        assert!((area(&there) / area(&here) - 1.0).abs() < 1e-5);
        let (a, b) = (there.bounds(), here.bounds());
        assert!(a.0.distance(b.0) < 1e-2 && (a.1 - b.1).abs() < 1e-2);
    }
}

#[test]
fn mistakes_are_told_by_field() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.toml");
    let head = "schema = 1\nname = \"m\"\nseed = 1\n";
    let blade = "[[sward]]\nmaterial = \"grass\"\nlength_mm = 50\nwidth_mm = 2\n";
    for (text, said) in [
        (format!("{head}size_mm = [400, 400]\nsward = []\n"), "expected at least one [[sward]]"),
        (format!("{head}size_mm = [400, 0]\n{blade}per_m2 = 10\n"), "size_mm"),
        (format!("{head}size_mm = [400, 400]\n{blade}per_m2 = 1\n"), "0 blades"),
        (format!("{head}size_mm = [4000, 4000]\n{blade}per_m2 = 1e6\n"), "16000000 blades"),
        (format!("{head}size_mm = [400, 400]\n{blade}per_m2 = nan\n"), "sward 1: per_m2"),
        (
            format!("{head}size_mm = [1000, 1000]\n{blade}per_m2 = 300000\nsegments = 64\n"),
            "triangles of all blades together",
        ),
        (format!("{head}size_mm = [400, 400]\n{blade}per_m2 = 100\nfold_deg = 120\n"), "sward 1: fold_deg"),
        (format!("{head}size_mm = [400, 400]\n{blade}per_m2 = 100\nprofile = [[0, 1]]\n"), "sward 1: profile"),
        (format!("{head}size_mm = [400, 400]\n{blade}per_m2 = 100\nblades = 3\n"), "unknown field `blades`"),
    ] {
        std::fs::write(&path, text).unwrap();
        let told = crate::growth::described(&path, None).unwrap_err().to_string();
        assert!(told.contains(said) && told.contains("m.toml") && told.lines().count() == 1, "{told}");
    }
}
