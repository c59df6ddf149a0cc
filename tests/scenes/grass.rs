//! Grass in scenes: all blades of one material as a leaf's mesh.

use crate::common;
use mesophyll::manifest::Manifest;
use mesophyll::scene::ledger::Ledger;
use mesophyll::scene::placed::{Placed, leaf::Search};
use std::path::Path;

const UNIFORM: &str = "uniform = { rho_d = [[0.1, 0.2, 0.1], [0.1, 0.2, 0.1]], rho_t = [0.05, 0.1, 0.05] }";

/// A scene of the clover's lawn, whose leaf is stated by `leaf`.
fn scene(folder: &Path, leaf: &str) -> std::path::PathBuf {
    let path = folder.join("lawn.toml");
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/grass/clover.toml");
    std::fs::copy(from, folder.join("clover.toml")).unwrap();
    let rest = "[[instance]]\nleaf = \"grass\"\n[sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"above\"\n\
         kind = \"perspective\"\neye_mm = [0, 0, 600]\ntarget_mm = [0, 0, 0]\nup = [0, 1, 0]\nfov_deg = 20\n\
         [check]\nwidth = 32\nheight = 32\nsamples = 4\n";
    std::fs::write(&path, format!("schema = 1\nname = \"lawn\"\n[[leaf]]\nname = \"grass\"\n{leaf}\n{rest}")).unwrap();
    path
}

/// A description and the file that is grown from it give the same mesh, to the file's f32.
#[test]
fn a_leaf_takes_the_blades_of_one_material() {
    let dir = tempfile::tempdir().unwrap();
    let mesh = |leaf: &str| {
        let manifest = Manifest::read(&scene(dir.path(), leaf)).unwrap();
        let placed = Placed::new(&manifest, Search::default(), &Ledger::new()).unwrap();
        placed.leaves[0].mesh.clone().unwrap()
    };
    let described = mesh(&format!("mesh = \"clover.toml\"\npart = \"clover\"\n{UNIFORM}"));
    mesophyll::flora::file::write(
        &mesophyll::flora::grow::described(&dir.path().join("clover.toml"), None).unwrap(),
        &dir.path().join("clover.glb"),
    )
    .unwrap();
    let written = mesh(&format!("mesh = \"clover.glb\"\npart = \"clover\"\n{UNIFORM}"));
    // 650 trefoils on a square metre; four pieces of four triangles and three leaflets of eight.
    assert_eq!((described.triangles(), written.triangles()), (104 * 40, 104 * 40));
    assert!(described.bounds().0.distance(written.bounds().0) < 0.01);
    let grass = mesh(&format!("mesh = \"clover.glb\"\npart = \"grass\"\n{UNIFORM}"));
    assert!(grass.triangles() > described.triangles());
}

/// A meadow that stands as a plant is grown from its description, and no wind moves it.
#[test]
fn a_meadow_is_a_plant_that_stands_still() {
    let dir = tempfile::tempdir().unwrap();
    let leaf = format!("mesh = \"clover.toml\"\npart = \"clover\"\n{UNIFORM}");
    let path = scene(dir.path(), &leaf);
    let text = std::fs::read_to_string(&path).unwrap();
    let plant = "[[plant]]\ngrow = \"clover.toml\"\nmaterials = { grass = \"grass\", clover = \"grass\" }\n\
         [wind]\nspeed_m_s = 6\nseed = 1\n";
    std::fs::write(&path, format!("{text}{plant}")).unwrap();
    let placed = Placed::new(&Manifest::read(&path).unwrap(), Search::default(), &Ledger::new()).unwrap();
    assert!(placed.winds.is_none() && placed.placements.len() == 1 + 3040 + 104);
}

#[test]
fn mistakes_about_a_part_are_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    for (leaf, said) in [
        (format!("mesh = \"clover.toml\"\npart = \"moss\"\n{UNIFORM}"), "no blades of the material \"moss\""),
        (format!("mesh = \"clover.toml\"\npart = \"grass\"\nmesh_unit = \"mm\"\n{UNIFORM}"), "part: given without"),
        (format!("mesh = \"nowhere.toml\"\npart = \"grass\"\n{UNIFORM}"), "nowhere.toml: no such file"),
    ] {
        let path = scene(dir.path(), &leaf);
        let out = dir.path().join("out");
        let output = common::run(["render", path.to_str().unwrap(), "-o", out.to_str().unwrap()]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(said) && told.lines().count() == 1, "{told}");
        assert_eq!(std::fs::read_dir(&out).map_or(0, Iterator::count), 0, "something was written");
    }
}
