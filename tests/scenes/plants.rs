//! Whole plants in scenes: where they stand, what they are made of, what is refused.

use mesophyll::scene::ledger::Ledger;
use mesophyll::scene::manifest::Manifest;
use mesophyll::scene::placed::plant::{Planted, planted};
use std::path::{Path, PathBuf};

const HEAD: &str = "schema = 1\nname = \"s\"\n[[leaf]]\nname = \"elm\"\nuniform = { rho_d = [[0.1, 0.2, 0.1], [0.1, 0.2, 0.1]], \
 rho_t = [0.1, 0.2, 0.1] }\nmesh = \"leaf.glb\"\n[sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"v\"\nkind = \"perspective\"\n\
 eye_mm = [0, -900, 100]\ntarget_mm = [0, 0, 100]\nfov_deg = 30\n";
const BARK: &str = "materials = { leaf = \"elm\", bark = [0.1, 0.1, 0.1] }\n";

fn scene(folder: &Path, plant: &str) -> PathBuf {
    let twig = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/elm-twig.toml");
    std::fs::copy(twig, folder.join("twig.toml")).unwrap();
    let path = folder.join("scene.toml");
    std::fs::write(&path, format!("{HEAD}[[plant]]\n{plant}")).unwrap();
    path
}

fn plants(folder: &Path, plant: &str) -> Result<Vec<Planted>, String> {
    let manifest = Manifest::read(&scene(folder, plant)).map_err(|e| e.to_string())?;
    planted(&manifest, &Ledger::new()).map_err(|e| e.to_string())
}

#[test]
fn plants_stand_where_the_scene_says() {
    let folder = tempfile::tempdir().unwrap();
    let one =
        plants(folder.path(), &format!("grow = \"twig.toml\"\n{BARK}position_mm = [10, 20, 30]\nscale = 2\n")).unwrap();
    let wood = one[0].wood();
    assert_eq!((one[0].placements().count(), wood.len(), wood[0].places.len()), (8, 1, 1));
    assert_eq!(wood[0].places[0].w_axis.truncate().to_array(), [10.0, 20.0, 30.0]);
    let (leaf, rest) = (one[0].placements().next().unwrap(), one[0].plant.leaves[0]);
    let moved = leaf.transform.w_axis.truncate() - 2.0 * rest.transform.w_axis.truncate();
    assert!((moved - glam::DVec3::new(10.0, 20.0, 30.0)).length() < 1e-9);
    // The same wood as its branches': a tube of the trunk around the root.
    assert_eq!(wood[0].mesh.positions.len(), one[0].plant.branches[0].wood.positions.len());

    let many = format!("grow = \"twig.toml\"\n{BARK}count = 40\narea_mm = [4000, 2000]\nseed = 3\n");
    let (a, b) = (plants(folder.path(), &many).unwrap(), plants(folder.path(), &many).unwrap());
    assert_eq!(a, b);
    assert_eq!(a[0].placements().count(), 320);
    let places: Vec<glam::DVec3> = a[0].places.iter().map(|p| p.w_axis.truncate()).collect();
    assert!(places.iter().all(|p| p.x.abs() <= 2000.0 && p.y.abs() <= 1000.0 && p.z == 0.0));
    // They keep apart: chance alone would put two of forty within 50 mm.
    let nearest =
        |k: usize| (0..40).filter(|j| *j != k).map(|j| places[k].distance(places[j])).fold(f64::INFINITY, f64::min);
    assert!((0..40).map(nearest).fold(f64::INFINITY, f64::min) > 80.0);
}

/// A plant in a file stands as one that is grown on the spot, to single precision.
#[test]
fn a_file_is_the_plant_that_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let grown = plants(folder.path(), &format!("grow = \"twig.toml\"\ngrow_seed = 5\n{BARK}")).unwrap();
    mesophyll::flora::file::write(&grown[0].plant, &folder.path().join("twig.glb")).unwrap();
    let read = plants(folder.path(), &format!("file = \"twig.glb\"\n{BARK}")).unwrap();
    for (a, b) in grown[0].placements().zip(read[0].placements()) {
        assert!(a.leaf == b.leaf && a.transform.abs_diff_eq(b.transform, 1e-4));
    }
    assert_eq!(read[0].name, "twig");
}

#[test]
fn plants_that_cannot_stand_say_why() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("bad.glb"), b"glTF").unwrap();
    let grow = "grow = \"twig.toml\"\n";
    for (plant, expected) in [
        (BARK.to_string(), "plant.file: missing; expected a file, or grow"),
        (format!("{grow}file = \"a.glb\"\n{BARK}"), "given beside a file"),
        (format!("{grow}{BARK}count = 3\n"), "plant.area_mm: missing"),
        (format!("{grow}{BARK}scale = -1\n"), "plant.scale: found -1"),
        (format!("{grow}materials = {{ leaf = \"oak\", bark = [0, 0, 0] }}\n"), "oak"),
        (format!("{grow}materials = {{ leaf = \"elm\" }}\n"), "material \"bark\" maps to no bark"),
        (format!("{grow}materials = {{ bark = [0, 0, 0] }}\n"), "material \"leaf\" maps to no leaf"),
        (format!("{grow}materials = {{ leaf = \"elm\", bark = \"elm\" }}\n"), "\"bark\" is the bark's material"),
        (format!("{grow}materials = {{ leaf = \"elm\", bark = [0, 0, 0], moss = [0, 0, 0] }}\n"), "found \"moss\""),
        (format!("file = \"gone.glb\"\n{BARK}"), "no such file"),
        (format!("file = \"bad.glb\"\n{BARK}"), "not a readable glTF file"),
    ] {
        let error = plants(folder.path(), &plant).expect_err(expected);
        assert!(error.contains(expected) && error.lines().count() == 1, "{expected}: {error}");
    }
}
