//! Whole plants in scenes: their places, their materials, and what is refused.

use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::placed::plant::{PlacedPlant, planted};
use std::path::{Path, PathBuf};

const HEAD: &str = "schema = 1\nname = \"s\"\n[[leaf]]\nname = \"elm\"\nuniform = { rho_d = [[0.1, 0.2, 0.1], [0.1, \
 0.2, 0.1]], \
 rho_t = [0.1, 0.2, 0.1] }\nmesh = \"leaf.glb\"\n[sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"v\"\nkind = \
 \"perspective\"\n\
 eye_mm = [0, -900, 100]\ntarget_mm = [0, 0, 100]\nfov_deg = 30\n";
pub const BARK: &str = "materials = { leaf = \"elm\", bark = [0.1, 0.1, 0.1] }\n";

pub fn scene(folder: &Path, plant: &str) -> PathBuf {
    let twig = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/elm-twig.toml");
    std::fs::copy(twig, folder.join("twig.toml")).unwrap();
    let path = folder.join("scene.toml");
    std::fs::write(&path, format!("{HEAD}[[plant]]\n{plant}")).unwrap();
    path
}

/// Runs the program in a folder. Returns the exit code and the messages.
pub fn run(folder: &Path, words: &[&str]) -> (Option<i32>, String) {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_mesophyll"));
    let output = command.args(words).current_dir(folder).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn plants(folder: &Path, plant: &str) -> Result<Vec<PlacedPlant>, String> {
    let manifest = SceneManifest::read(&scene(folder, plant)).map_err(|e| e.to_string())?;
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
    // The wood is that of its branches: a tube for the trunk around the root.
    assert_eq!(wood[0].mesh.positions.len(), one[0].plant.branches[0].wood.positions.len());

    let many = format!("grow = \"twig.toml\"\n{BARK}count = 40\narea_mm = [4000, 2000]\nseed = 3\n");
    let (a, b) = (plants(folder.path(), &many).unwrap(), plants(folder.path(), &many).unwrap());
    assert_eq!(a, b);
    assert_eq!(a[0].placements().count(), 320);
    let places: Vec<glam::DVec3> = a[0].places.iter().map(|p| p.w_axis.truncate()).collect();
    assert!(places.iter().all(|p| p.x.abs() <= 2000.0 && p.y.abs() <= 1000.0 && p.z == 0.0));
    // The plants keep a distance. By chance alone, two of forty would be within 50 mm.
    let nearest =
        |k: usize| (0..40).filter(|j| *j != k).map(|j| places[k].distance(places[j])).fold(f64::INFINITY, f64::min);
    assert!((0..40).map(nearest).fold(f64::INFINITY, f64::min) > 80.0);
}

/// A plant from a file is the same as one that is grown on the spot, to single precision.
#[test]
fn a_file_is_the_plant_that_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let grown = plants(folder.path(), &format!("grow = \"twig.toml\"\ngrow_seed = 5\n{BARK}")).unwrap();
    mesophyll::plants::file::write(&grown[0].plant, &folder.path().join("twig.glb")).unwrap();
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
        (format!("{grow}{BARK}flutter = {{ deg_per_m_s = 4, damping = 0.1 }}\n"), "flutter.damping: found 0.1"),
        (
            format!("{grow}{BARK}flutter = {{ deg_per_m_s = 4, resonance_hz = 7 }}\n"),
            "found 7, expected 0.05 to 6.4 Hz",
        ),
        (format!("{grow}{BARK}flutter = {{ resonance_hz = 4 }}\n"), "missing field `deg_per_m_s`"),
        (
            format!("{grow}{BARK}[ground]\nalbedo = [0.1, 0.1, 0.1]\nreach_mm = 500\ncontrast = 0.3\n"),
            "contrast: given without grain_mm",
        ),
        // The first two would be called "a 1" and "a 2".
        (
            ["a", "a", "a 1"].map(|name| format!("name = \"{name}\"\n{grow}{BARK}")).join("[[plant]]\n"),
            "plant 3: name: found \"a 1\", so that two plants are called \"a 1\"",
        ),
        (format!("file = \"gone.glb\"\n{BARK}"), "no such file"),
        (format!("file = \"bad.glb\"\n{BARK}"), "not a readable glTF file"),
    ] {
        let error = plants(folder.path(), &plant).expect_err(expected);
        assert!(error.contains(expected) && error.lines().count() == 1, "{expected}: {error}");
    }
}

/// A plant in the wind is written and read back. Names, figures, lengths and places of growth are the same, and tips
/// are where `eval sway` says.
#[test]
fn a_posed_plant_is_written_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let sapling = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/bird-cherry-sapling.toml");
    std::fs::copy(sapling, folder.path().join("sapling.toml")).unwrap();
    let path =
        scene(folder.path(), &format!("grow = \"sapling.toml\"\n{BARK}position_mm = [50, 20, 0]\nscale = 1.5\n"));
    let still = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{still}[wind]\nspeed_m_s = 9\nazimuth_deg = 30\nseed = 7\n")).unwrap();
    let run = |words: &[&str]| run(folder.path(), words);
    assert_eq!(run(&["export", "scene.toml", "--time", "2.5", "--to", "gltf", "-o", "posed.glb"]).0, Some(0));
    assert_eq!(run(&["eval", "sway", "scene.toml", "--from", "2.5", "--to", "2.5", "-o", "sway.csv"]).0, Some(0));
    let manifest = SceneManifest::read(&path).unwrap();
    let rest =
        planted(&manifest, &Ledger::new()).unwrap()[0].plant.moved(glam::DMat4::from_scale_rotation_translation(
            glam::DVec3::splat(1.5),
            glam::DQuat::IDENTITY,
            glam::DVec3::new(50.0, 20.0, 0.0),
        ));
    let posed = mesophyll::plants::file::read(&folder.path().join("posed.glb")).unwrap();
    assert_eq!((posed.branches.len(), posed.leaves.len()), (rest.branches.len(), rest.leaves.len()));
    let mut moved = 0.0f64;
    let find = |name: &str| posed.branches.iter().find(|b| b.name == name).unwrap();
    for a in &rest.branches {
        let b = find(&a.name);
        assert!((b.length() / a.length() - 1.0).abs() < 1e-5 && (b.root_radius / a.root_radius - 1.0).abs() < 1e-5);
        assert!((b.load / a.load - 1.0).abs() < 1e-5 && a.level == b.level && a.material == b.material);
        assert_eq!(
            a.parent.map(|j| (&rest.branches[j.branch].name, j.at)),
            b.parent.map(|j| (&posed.branches[j.branch].name, j.at))
        );
        if let (Some(on), Some(now)) = (a.parent, b.parent) {
            let gap = |plant: &mesophyll::plants::form::Plant, j: mesophyll::plants::form::Joint, root: glam::DVec3| {
                plant.branches[j.branch].point(j.at).0.distance(root)
            };
            let apart = (gap(&rest, on, a.root) - gap(&posed, now, b.root)).abs();
            // Places have single precision, at about a metre and a half here.
            assert!(apart < 1e-3 * rest.branches[on.branch].radius(on.at) + 2e-3, "{}: {apart} mm", a.name);
        }
        moved = moved.max(a.point(1.0).0.distance(b.point(1.0).0));
    }
    assert!(moved > 20.0, "{moved}");
    let table = std::fs::read_to_string(folder.path().join("sway.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + rest.branches.len());
    for line in table.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells[0], cells[1]), ("2.5", "sapling"));
        let tip = glam::DVec3::from_array([3, 4, 5].map(|k| cells[k].parse().unwrap()));
        let there = find(cells[2]).point(1.0).0;
        assert!(tip.distance(there) < 0.01, "{line} {there}");
    }
    // Without a wind, the file is that of the plant at rest, byte by byte. Impossible requests are refused.
    std::fs::write(folder.path().join("still.toml"), &still).unwrap();
    assert_eq!(run(&["export", "still.toml", "--to", "gltf", "-o", "still.glb"]).0, Some(0));
    let mut out = mesophyll::plants::form::Plant { name: "s".into(), ..Default::default() };
    out.join(rest, "");
    mesophyll::plants::file::write(&out, &folder.path().join("rest.glb")).unwrap();
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("still.glb") == bytes("rest.glb") && bytes("still.glb") != bytes("posed.glb"));
    for (words, expected) in [
        (
            ["export", "scene.toml", "--to", "csv", "-o", "a.csv"].as_slice(),
            "whose plants can be exported as gltf or pivots",
        ),
        (&["export", ".", "--time", "1", "--to", "gltf", "-o", "a.glb"], "expected a finite time, with a scene"),
        (&["export", "scene.toml", "--time", "nan", "--to", "gltf", "-o", "a.glb"], "expected a finite time"),
    ] {
        let (code, said) = run(words);
        assert!(code == Some(2) && said.contains(expected), "{words:?}: {said}");
    }
}

/// A sapling in a wind that bends its branches strongly, placed and drawn.
#[cfg(feature = "render")]
mod moving {
    use super::{BARK, scene};
    use crate::parts::{gap, looseness};
    use crate::skips;
    use glam::{DMat4, DVec3, Vec3};
    use mesophyll::plants::form::Plant;
    use mesophyll::scene::draw::{handover, reference};
    use mesophyll::scene::loaded::LoadedScene;
    use mesophyll::scene::manifest::SceneManifest;
    use mesophyll::scene::placed::leaf::LeafSearch;
    use mesophyll::scene::placed::ledger::Ledger;
    use mesophyll_viewer::{Error, Options, Renderer};
    use std::path::Path;

    const WIND: &str = "[wind]\nspeed_m_s = 12\nazimuth_deg = 30\nseed = 7\ntime_s = 2.5\n";

    fn open(folder: &Path, plant: &str, wind: &str) -> LoadedScene {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        std::fs::copy(root.join("data/plants/bird-cherry-sapling.toml"), folder.join("sapling.toml")).unwrap();
        std::fs::copy(root.join("fits/elm/blade.glb"), folder.join("leaf.glb")).unwrap();
        let path = scene(folder, &format!("grow = \"sapling.toml\"\n{BARK}{plant}{wind}"));
        LoadedScene::open(SceneManifest::read(&path).unwrap(), LeafSearch::default(), &Ledger::new()).unwrap()
    }

    /// The plant of one place by the f64 pose, in world space.
    fn posed(scene: &LoadedScene, rest: &Plant, place: usize, time: f64) -> Plant {
        let winds = scene.placed.winds.as_ref().unwrap();
        winds.pose(0, place, time).unwrap().plant(rest).moved(scene.placed.wood[place].places[0])
    }

    /// The vertices of the bark in world space, in the order of the wood's mesh.
    fn bark(plant: &Plant) -> Vec<(DVec3, DVec3, f64)> {
        let own = |b: &mesophyll::plants::form::Branch| {
            let (frame, length) = (b.frame(), b.length());
            let pairs = b.wood.positions.iter().zip(&b.wood.normals);
            pairs.map(|(p, n)| (frame.transform_point3(*p), frame.transform_vector3(*n), length)).collect::<Vec<_>>()
        };
        plant.branches.iter().flat_map(own).collect()
    }

    /// The vertex stage and the reference renderer's meshes are compared with the pose in double precision: within 1e-4
    /// of each branch's length.
    #[test]
    fn both_renderers_draw_the_pose() {
        let folder = tempfile::tempdir().unwrap();
        let two = "count = 2\narea_mm = [3000, 3000]\nseed = 3\nflutter = { deg_per_m_s = 4 }\n";
        let whole = open(folder.path(), two, WIND);
        let rest = super::planted(&whole.manifest, &Ledger::new()).unwrap()[0].plant.clone();
        let drawn = handover::scene(&whole, &Ledger::new()).unwrap();
        // Branches are posed by one invocation each, and by groups.
        let mut renderers = Vec::new();
        for groups in [false, true] {
            match Renderer::headless(&Options { groups: Some(groups), ..Options::default() }) {
                Ok(mut renderer) => {
                    renderer.set_scene(&drawn).unwrap();
                    renderers.push(renderer);
                }
                Err(Error::NoAdapter) => skips::skip(skips::Need::Adapter, "no graphics adapter"),
                Err(e) => panic!("{e}"),
            }
        }
        let leaves = rest.leaves.len();
        // Leaves turn on their branches, each by its own angle.
        let angles: Vec<f64> = {
            let pose = whole.placed.winds.as_ref().unwrap().pose(0, 1, 2.5).unwrap();
            let turn = |(k, leaf): (usize, &mesophyll::plants::form::Leaf)| {
                let own = pose.at(leaf.joint.branch, leaf.joint.at).turn.transpose() * pose.leaf(k, leaf.joint).turn;
                glam::DQuat::from_mat3(&own).to_axis_angle().1
            };
            rest.leaves.iter().enumerate().map(turn).collect()
        };
        let mean = angles.iter().sum::<f64>() / angles.len() as f64;
        assert!(mean > 0.05 && angles.iter().any(|a| *a < 0.2 * mean) && angles.iter().any(|a| *a > 2.0 * mean));
        let mut world = reference::unlit(&whole, 0.0, &Ledger::new()).unwrap();
        let (mut joints, mut loose) = (0.0f64, [0.0f64; 2]);
        for time in [2.5, 3.1, 1e6] {
            reference::move_to(&mut world, &whole, time).unwrap();
            let mut now = drawn.clone();
            let wind = now.wind.as_mut().unwrap();
            wind.time_s = time;
            renderers.iter_mut().for_each(|renderer| renderer.set_time(wind));
            let mut worst = [0.0f64; 3];
            let mut moved = 0.0f64;
            for place in 0..2 {
                let plant = posed(&whole, &rest, place, time);
                let (want, still) = (bark(&plant), bark(&rest.moved(whole.placed.wood[place].places[0])));
                moved = want.iter().zip(&still).map(|(a, b)| a.0.distance(b.0)).fold(moved, f64::max);
                let wood = 2 * leaves + place;
                let mesh = &world.leaves[1 + place].mesh;
                let to_world = whole.placed.wood[place].places[0];
                for ((p, n, length), have) in want.iter().zip(&mesh.positions) {
                    let have = to_world.transform_point3(*have);
                    worst[0] = worst[0].max(have.distance(*p) / length);
                    assert!((n.length() - 1.0).abs() < 1e-5);
                }
                for renderer in &renderers {
                    let found = renderer.bent_vertices(&now, wood).unwrap();
                    // The vertices of the wood's levels follow its own.
                    assert!(found.len() > want.len());
                    rigid(&now.meshes[now.instances[wood].mesh].positions, &found, want.len(), to_world);
                    for ((p, n, length), [q, m, _]) in want.iter().zip(&found) {
                        worst[1] = worst[1].max(q.as_dvec3().distance(*p) / length);
                        assert!(m.as_dvec3().distance(*n) < 2e-3, "{m} {n}");
                    }
                    for k in (0..leaves).step_by(41) {
                        let index = place * leaves + k;
                        let found = renderer.bent_vertices(&now, index).unwrap();
                        let length = plant.branches[plant.leaves[k].joint.branch].length();
                        let mesh = &now.meshes[now.instances[index].mesh];
                        for (rest, have) in mesh.positions.iter().zip(&found).step_by(13) {
                            let to = plant.leaves[k].transform.transform_point3(rest.as_dvec3());
                            worst[2] = worst[2].max(have[0].as_dvec3().distance(to) / length);
                        }
                    }
                    joints = joints.max(gap(&rest, &plant, &found));
                    let boxes = renderer.moving_boxes().unwrap();
                    let n = plant.branches.len();
                    assert_eq!(boxes.len(), 2 * n);
                    let blade = &now.meshes[now.instances[place * leaves].mesh].positions;
                    let ratios = looseness(&plant, blade, &boxes[place * n..][..n]);
                    loose = [0, 1].map(|k| loose[k].max(ratios[k]));
                }
            }
            println!(
                "{time} s: reference {:.1e}, bark {:.1e}, leaves {:.1e} of a branch's length",
                worst[0], worst[1], worst[2]
            );
            assert!(moved > 50.0 && worst.iter().all(|w| *w < 1e-4), "{time} s: {worst:?}, moved by {moved} mm");
        }
        println!(
            "gaps {joints:.1e} of the parent's radius; boxes {:.3} times as long, {:.2} as large",
            loose[0], loose[1]
        );
        assert!(joints > 0.0 && joints < 1e-3, "{joints}");
        // A box around a blade that is turned by 45° is √2 times as long as the blade, and a part is a union of these.
        assert!(loose[0] < std::f64::consts::SQRT_2, "{loose:?}");
    }

    /// Corners of the wood's levels keep their distance from the wood's own vertex next to them, which stands on the
    /// same ring; a few of them are next to another branch.
    fn rigid(rest: &[Vec3], moved: &[[Vec3; 3]], own: usize, to_world: DMat4) {
        let scale = to_world.determinant().cbrt() as f32;
        let kept = (own..rest.len()).filter(|k| {
            let off = |n: &usize| rest[*n].distance(rest[*k]);
            let next = (0..own).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            (moved[next][0].distance(moved[*k][0]) - scale * off(&next)).abs() < 0.02
        });
        let share = kept.count() as f64 / (rest.len() - own) as f64;
        assert!(share > 0.95, "{share}");
    }

    /// Without a wind the scene is the same as before: no sections, no textures, and no code for them in a shader. The
    /// plan says so.
    #[test]
    fn without_a_wind_nothing_of_it_is_made() {
        let folder = tempfile::tempdir().unwrap();
        let still = open(folder.path(), "", "");
        let left: Vec<&str> = still.plan.left_out.iter().map(|l| l.name.as_str()).collect();
        assert!(left.contains(&"plants in the wind") && left.contains(&"beam fit"), "{left:?}");
        let drawn = handover::scene(&still, &Ledger::new()).unwrap();
        assert!(
            drawn.sections.is_none() && drawn.wind.is_none() && drawn.instances.iter().all(|i| i.carried.is_none())
        );
        let windy = open(folder.path(), "", WIND);
        assert!(windy.plan.needed.iter().any(|n| n.name == "plants in the wind"));
        let calm = open(folder.path(), "drag_n_s_m3 = 0\n", WIND);
        assert!(calm.placed.winds.is_none() && calm.plan.left_out.iter().any(|l| l.name == "plants in the wind"));
        let Ok(mut renderer) = Renderer::headless(&Options::default()) else { return };
        renderer.set_scene(&drawn).unwrap();
        assert!(renderer.stats().uploads.iter().all(|u| !u.name.contains("section")));
        assert!(renderer.stats().pipelines.iter().all(|p| !p.contains("sections") && !p.contains("bend")));
        let moving = handover::scene(&windy, &Ledger::new()).unwrap();
        renderer.set_scene(&moving).unwrap();
        assert!(renderer.stats().uploads.iter().any(|u| u.name.contains("section")));
        let camera = mesophyll_viewer::scene::Camera {
            eye: Vec3::new(0.0, -2500.0, 700.0),
            target: Vec3::new(0.0, 0.0, 600.0),
            up: Vec3::Z,
            fov_y_deg: 35.0,
        };
        let first = renderer.render(&camera, 96, 96).unwrap();
        let mut later = moving.wind.unwrap();
        later.time_s += 0.4;
        renderer.set_time(&later);
        assert_ne!(first.ldr, renderer.render(&camera, 96, 96).unwrap().ldr);
    }
}
