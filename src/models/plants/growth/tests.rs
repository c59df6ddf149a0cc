use super::*;
use std::path::{Path, PathBuf};

fn preset(name: &str) -> PlantSpec {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/plants").join(format!("{name}.toml"));
    PlantSpec::read(&path).unwrap()
}

/// Number of vertices that are drawn; those of a blade count for every leaf.
fn vertices(plant: &Plant) -> usize {
    let wood: usize = plant.branches.iter().map(|b| b.wood.positions.len()).sum();
    wood + plant.leaves.iter().map(|l| plant.blades[l.blade].mesh.positions.len()).sum::<usize>()
}

fn within(value: usize, wanted: usize, share: f64) -> bool {
    (value as f64 / wanted as f64 - 1.0).abs() <= share
}

/// The presets have the sizes that their sources name, and those of a large tree for games.
#[test]
fn presets_have_the_sizes_that_are_asked_for() {
    let wych = grow(&preset("wych-elm"), None);
    assert_eq!((wych.branches.len(), wych.leaves.len()), (1500, 10_000));
    assert_eq!(wych.branches.iter().map(|b| b.level).max(), Some(3));
    assert!(within(vertices(&wych), 75_000, 0.02), "{}", vertices(&wych));
    let habel = grow(&preset("habel-tree"), None);
    assert_eq!(habel.leaves.len(), 6392);
    let wang = grow(&preset("wang-tree"), None);
    assert!(within(vertices(&wang), 500_000, 0.02), "{}", vertices(&wang));
}

#[test]
fn every_preset_grows_and_a_seed_is_a_plant() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/plants");
    let files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().flatten().map(|f| f.path()).collect();
    let specs = files.iter().filter(|f| f.extension().is_some_and(|e| e == "toml"));
    assert!(specs.clone().count() >= 6);
    for file in specs {
        let spec = PlantSpec::read(file).unwrap();
        let plant = grow(&spec, None);
        assert_eq!(plant.leaves.len(), spec.leaves.as_ref().map_or(0, |l| l.count), "{}", file.display());
        assert_eq!(plant.branches.len(), spec.levels.iter().map(|l| l.count).sum::<usize>());
        assert!(!spec.sources.is_empty() || spec.species.is_empty(), "{}: no sources", file.display());
        let top = plant.branches.iter().map(|b| b.point(1.0).0.z).fold(0.0, f64::max);
        assert!(top > 0.8 * spec.height_mm && top < 1.15 * spec.height_mm, "{}: {top}", file.display());
    }
    let spec = preset("elm-twig");
    assert_eq!(grow(&spec, None), grow(&spec, Some(spec.seed)));
    assert_ne!(grow(&spec, None), grow(&spec, Some(spec.seed + 1)));
}

/// Branches stand on their parents and are thinner than these. No branch is thicker than the pipes of its tips require.
#[test]
fn branches_stand_on_their_parents_and_follow_the_pipe_model() {
    let spec = preset("bird-cherry");
    let plant = grow(&spec, None);
    let mut tips = vec![1.0; plant.branches.len()];
    for (k, b) in plant.branches.iter().enumerate().rev() {
        let Some(joint) = b.parent else { continue };
        tips[joint.branch] += tips[k];
        let parent = &plant.branches[joint.branch];
        assert!(joint.branch < k && b.level == parent.level + 1);
        assert!(b.root.distance(parent.point(joint.at).0) < 1e-6);
        assert!(b.root_radius <= parent.radius(joint.at) && b.tip_radius <= b.root_radius);
    }
    let pipes = spec.wood.twig_radius_mm * f64::powf(tips[0], 1.0 / spec.wood.pipe_exponent);
    assert!((plant.branches[0].root_radius / pipes - 1.0).abs() < 1e-12);
}

/// Mean angle (degrees) at the joint between branches of an order and the branches that they grow on.
fn angle(plant: &Plant, order: usize) -> f64 {
    let all: Vec<f64> = plant
        .branches
        .iter()
        .filter(|b| b.level == order)
        .filter_map(|b| b.parent.map(|j| plant.branches[j.branch].point(j.at).1.angle_between(b.axes[0]).to_degrees()))
        .collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// Figures of the crown agree with the botanical descriptions that the presets name: width over height, height of the
/// widest place, angle of the main branches, leaves on a shoot.
#[test]
fn trees_have_the_figures_of_their_species() {
    for (name, width, widest, fork, a_shoot) in [
        // Width of the crown over the height of the tree, height of the widest place as a share, angle, leaves on a
        // shoot.
        ("wych-elm", [0.7, 1.1], [0.35, 0.75], [35.0, 60.0], [4.0, 9.0]),
        ("balata", [0.45, 0.85], [0.5, 0.9], [40.0, 75.0], [4.0, 10.0]),
        ("bird-cherry", [0.4, 0.75], [0.25, 0.65], [30.0, 65.0], [4.0, 10.0]),
    ] {
        let plant = grow(&preset(name), None);
        let height = plant.branches.iter().map(|b| b.point(1.0).0.z).fold(0.0, f64::max);
        // For each of ten slices of the height, the reach that one leaf in a hundred exceeds.
        let mut slices = vec![Vec::new(); 10];
        for leaf in &plant.leaves {
            let at = leaf.transform.w_axis.truncate();
            slices[((at.z / height * 10.0) as usize).min(9)].push(at.truncate().length());
        }
        let reach: Vec<f64> = slices
            .iter_mut()
            .map(|s| {
                s.sort_by(f64::total_cmp);
                s.get(s.len() * 97 / 100).copied().unwrap_or(0.0)
            })
            .collect();
        let most = reach.iter().copied().fold(0.0, f64::max);
        let at = (reach.iter().position(|r| *r == most).unwrap() as f64 + 0.5) / 10.0;
        let shoots = plant.branches.iter().filter(|b| b.level == 3).count();
        let leaves = plant.leaves.len() as f64 / shoots as f64;
        let found = [2.0 * most / height, at, angle(&plant, 1), leaves];
        println!(
            "{name}: width {:.2} of the height, widest at {:.2}, main branches {:.0}°, {:.1} leaves a shoot",
            found[0], found[1], found[2], found[3]
        );
        for (value, [low, high]) in found.into_iter().zip([width, widest, fork, a_shoot]) {
            assert!((low..=high).contains(&value), "{name}: {value} is not within {low} and {high}");
        }
    }
}

#[test]
fn bad_descriptions_name_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.toml");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/plants/elm-twig.toml");
    let text = std::fs::read_to_string(source).unwrap();
    for (from, to, expected) in [
        ("schema = 1", "schema = 2", "schema: found 2, expected 1"),
        ("height_mm = ", "height_mm = -", "height_mm: found -"),
        ("pipe_exponent = ", "pipe_exponent = 1", "wood.pipe_exponent: found 1"),
        ("rings = ", "ring = ", "unknown field `ring`"),
        ("count = ", "count = 0 #", "count: found 0, expected 1"),
        ("profile = [[0", "profile = [[2", "crown.profile: expected ascending"),
    ] {
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let error = PlantSpec::read(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}
