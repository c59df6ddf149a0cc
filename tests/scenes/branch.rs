//! Loads of branches, and wind, in a scene: what the plan requests, and where the GPU's vertex stage puts things,
//! compared with the library in f64.
#![cfg(feature = "render")]

use crate::blade;
use crate::blade::Blade;
use crate::skips;
use glam::{DVec3, Vec3};
use mesophyll::scene::draw::{handover, reference};
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::plan::ScenePlan;
use mesophyll_viewer::{Error, Options, Renderer};
use std::path::Path;

/// A straight twig with one leaf, which stands out level along x, and what the scene states about it.
const SPEC: &str = r#"
schema = 1
name = "twig"
seed = 3
height_mm = 90
[crown]
base = 0.0
radius_mm = 200
profile = [[0, 1.0], [1.0, 1.0]]
[wood]
twig_radius_mm = 0.45
pipe_exponent = 2.0
[[level]]
count = 1
sides = 12
rings = 30
[leaves]
count = 1
bare = 0.7
angle_deg = 50
length_mm = 40
width_mm = 20
"#;

const SAGGING: &str = r#"
[[plant]]
grow = "twig-spec.toml"
materials = { leaf = "elm", bark = [0.1, 0.08, 0.06] }
position_mm = [-40, 5, 8]
rotation_deg = [0, 78, -6]
drag_n_s_m3 = 0
[[plant.branch]]
name = "trunk"
taper = 0.3
load_over_stiffness_mm = 40
lean_per_m_s = 0.03
"#;

const WIND: &str = "[wind]\nspeed_m_s = 3\nazimuth_deg = 50\nseed = 4\ntime_s = 1.5\n";

/// A scene with one leaf, which hangs on a plant if there is one.
fn scene(dir: &Path, extra: &str) -> SceneManifest {
    let fit = dir.join("fits/elm");
    if !fit.exists() {
        Blade { rho_s: [0.0, 0.0], width: 48, height: 36, texel_mm: 1.0, ..Blade::default() }.write(&fit, "elm");
    }
    std::fs::write(dir.join("twig-spec.toml"), SPEC).unwrap();
    let path = blade::scene(dir, "twig", "elm", Some(30.0), Some(0.3), extra);
    if extra.contains("[[plant]]") {
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace("[[instance]]\nleaf = \"elm\"\n", "")).unwrap();
    }
    SceneManifest::read(&path).unwrap()
}

fn planned(manifest: &SceneManifest) -> (LoadedScene, Ledger) {
    let ledger = Ledger::new();
    (LoadedScene::open(manifest.clone(), LeafSearch::default(), &ledger).unwrap(), ledger)
}

fn needs(plan: &ScenePlan, name: &str) -> bool {
    let (needed, left) = (plan.needed.iter().any(|n| n.name == name), plan.left_out.iter().any(|l| l.name == name));
    assert!(needed != left, "{name}: needed {needed}, left out {left}");
    needed
}

/// The numbers of beam fits and of motion textures that were made.
fn done(ledger: &Ledger) -> (usize, usize) {
    (ledger.count("fit", "beam"), ledger.count("make", "motion texture"))
}

#[test]
fn only_what_moves_is_fitted_and_made_and_then_once() {
    let dir = tempfile::tempdir().unwrap();
    let still = SAGGING.replace("load_over_stiffness_mm = 40", "load_over_stiffness_mm = 0");
    let breeze = format!("{still}{WIND}");
    let both = format!("{SAGGING}{WIND}{}", SAGGING.replace("[-40, 5, 8]", "[-40, 9, 14]"));
    for (extra, beam, motion) in [
        ("", false, false),
        (WIND, false, false),
        (&still, false, false),
        (SAGGING, true, false),
        (&breeze, true, true),
        (&both, true, true),
    ] {
        let (whole, ledger) = planned(&scene(dir.path(), extra));
        assert_eq!((needs(&whole.plan, "beam fit"), needs(&whole.plan, "motion texture")), (beam, motion), "{extra}");
        assert_eq!(done(&ledger), (usize::from(beam), usize::from(motion)), "{extra}");
        assert_eq!(whole.placed.winds.is_some(), beam);
    }
}

/// A renderer, or a skip.
fn renderer() -> Option<Renderer> {
    match Renderer::headless(&Options::default()) {
        Ok(renderer) => Some(renderer),
        Err(Error::NoAdapter) => {
            skips::skip(skips::Need::Adapter, "no graphics adapter");
            None
        }
        Err(other) => panic!("{other}"),
    }
}

fn drawn(manifest: &SceneManifest, renderer: &mut Renderer) -> (Vec<[f32; 4]>, Vec<String>) {
    let (whole, ledger) = planned(manifest);
    let view = manifest.perspectives().next().unwrap();
    renderer.set_scene(&handover::scene(&whole, &ledger).unwrap()).unwrap();
    let picture = renderer.render(&handover::camera(&view.camera), 96, 72).unwrap();
    (picture.hdr, renderer.stats().pipelines.clone())
}

#[test]
fn a_wind_without_branches_changes_no_byte_and_one_with_branches_does() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let storm = WIND.replace("speed_m_s = 3", "speed_m_s = 6");
    let mut draw = |extra: &str| drawn(&scene(dir.path(), extra), &mut renderer);
    let (plain, pipelines) = draw("");
    assert_eq!(plain, draw(WIND).0);
    assert_eq!(plain, draw(&storm).0);
    assert!(pipelines.iter().all(|p| !p.contains("bend") && !p.contains("sections")), "{pipelines:?}");
    // A branch that nothing bends is drawn as it is. Without wind, its lean has no effect.
    let still = SAGGING.replace("load_over_stiffness_mm = 40", "load_over_stiffness_mm = 0");
    let (straight, pipelines) = draw(&still);
    assert!(pipelines.iter().all(|p| !p.contains("bend") && !p.contains("sections")), "{pipelines:?}");
    assert_eq!(straight, draw(&still.replace("lean_per_m_s = 0.03", "lean_per_m_s = 0.06")).0);
    let (sagging, pipelines) = draw(SAGGING);
    assert!(pipelines.iter().any(|p| p.contains("sections")), "{pipelines:?}");
    let (swaying, _) = draw(&format!("{SAGGING}{WIND}"));
    assert!(straight != plain && straight != sagging && sagging != swaying);
    assert_ne!(swaying, draw(&format!("{SAGGING}{storm}")).0);
    assert_ne!(swaying, draw(&format!("{SAGGING}{}", WIND.replace("time_s = 1.5", "time_s = 1.7"))).0);
}

fn angle(a: DVec3, b: Vec3) -> f64 {
    let b = b.as_dvec3();
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Where the shader puts the vertices of a branch and of a leaf on it, compared with the library in f64. The cases have
/// tapers from a thin tip to none, loads up to a tip at 0.6 L, and several times.
#[test]
fn the_vertex_stage_puts_vertices_where_the_library_does() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    // Largest distance (relative to the branch's length), and largest angles (°) of normals and tangents, for leaf and
    // branch.
    let mut worst = [[0.0f64; 3]; 2];
    let mut swing = 0.0f64;
    for (taper, load) in [(0.05, 1.5), (0.3, 40.0), (0.51, 90.0), (1.0, 200.0), (1.2, 260.0)] {
        let branch =
            SAGGING.replace("taper = 0.3", &format!("taper = {taper}")).replace("_mm = 40", &format!("_mm = {load}"));
        let manifest = scene(dir.path(), &format!("{branch}{WIND}"));
        let (whole, ledger) = planned(&manifest);
        let mut scene = handover::scene(&whole, &ledger).unwrap();
        renderer.set_scene(&scene).unwrap();
        let winds = whole.placed.winds.as_ref().unwrap();
        let wood = &whole.placed.wood[0];
        let tip_at_rest = glam::DVec3::Z * 90.0;
        for time in [0.0, 0.37, 12.9, 1234.5] {
            let wind = scene.wind.as_mut().unwrap();
            wind.time_s = time;
            renderer.set_time(wind);
            swing = swing.max(winds.pose(0, 0, time).unwrap().tip(0).distance(tip_at_rest) / 90.0);
            let bent = wood.moved(&winds.sections(time)).unwrap();
            let leaf = whole.placed.leaves[0].mesh.as_ref().unwrap();
            let at = [whole.placed.at_time(&whole.placed.placements[0], time).transform, wood.places[0]];
            for (instance, (mesh, m)) in [leaf, &bent].into_iter().zip(at).enumerate() {
                let turn = |v: DVec3| m.transform_vector3(v).normalize();
                let found = renderer.bent_vertices(&scene, instance).unwrap();
                assert_eq!(found.len(), mesh.positions.len());
                let of = &mut worst[instance];
                for (k, f) in found.iter().enumerate() {
                    let place = m.transform_point3(mesh.positions[k]);
                    of[0] = of[0].max(f[0].as_dvec3().distance(place) / 90.0);
                    of[1] = of[1].max(angle(turn(mesh.normals[k]), f[1]));
                    of[2] = of[2].max(angle(turn(mesh.tangents[k].0), f[2]));
                }
            }
        }
    }
    println!("GPU f32 against f64, tip up to {swing:.2} L; leaf, then branch: {worst:?}");
    assert!(swing > 0.3, "the branches hardly move: {swing}");
    // Single precision: a thousandth of a millimetre on this branch, and angles far below those of mapped normals.
    for of in worst {
        assert!(of[0] < 1e-5 && of[1] < 0.01 && of[2] < 0.01, "{worst:?}");
    }
}

/// The pointer finds a leaf where the library says it is, which is not its place at rest.
#[test]
fn the_pointer_meets_what_is_bent() {
    let dir = tempfile::tempdir().unwrap();
    let manifest = scene(dir.path(), SAGGING);
    let (whole, ledger) = planned(&manifest);
    let scene = handover::scene(&whole, &ledger).unwrap();
    let p = &whole.placed.placements[0];
    let centre = whole.placed.leaves[0].mesh.as_ref().unwrap().positions[0];
    let (rest, bent) =
        (p.transform.transform_point3(centre), whole.placed.at_time(p, 0.0).transform.transform_point3(centre));
    assert!(rest.distance(bent) > 2.0, "{rest} {bent}");
    let up = whole.placed.at_time(p, 0.0).transform.z_axis.truncate();
    let camera = mesophyll_viewer::scene::Camera {
        eye: (bent + 50.0 * up).as_vec3(),
        target: bent.as_vec3(),
        up: Vec3::Y,
        fov_y_deg: 10.0,
    };
    // The vertex lies inside the blade's outline or on it, so places slightly towards the middle are tried too.
    let hits: Vec<_> = [(0.5, 0.5), (0.45, 0.5), (0.55, 0.5), (0.5, 0.45), (0.5, 0.55)]
        .into_iter()
        .filter_map(|(x, y)| mesophyll_viewer::picking::pick(&scene, &camera, 1.0, x, y))
        .filter(|h| h.material == 0)
        .collect();
    assert!(!hits.is_empty() && hits.iter().all(|h| h.position.as_dvec3().distance(bent) < 3.0), "{hits:?} {bent}");
}

/// The reference also moves with time, and returns to the same place.
#[test]
fn the_reference_moves_with_the_time() {
    let dir = tempfile::tempdir().unwrap();
    let manifest = scene(dir.path(), &format!("{SAGGING}{WIND}"));
    let (whole, ledger) = planned(&manifest);
    let mut world = reference::world(&whole, &ledger).unwrap();
    let look =
        |w: &mesophyll::transport::ReferenceWorld| (w.instances[0].transform, w.leaves[1].mesh.positions.clone());
    let first = look(&world);
    reference::move_to(&mut world, &whole, 2.0).unwrap();
    let second = look(&world);
    assert!(first.0 != second.0 && first.1 != second.1);
    reference::move_to(&mut world, &whole, 1.5).unwrap();
    assert_eq!(first, look(&world));
}

#[test]
fn a_branch_takes_its_taper_and_load_from_a_measured_one() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("fits/bent");
    let run = |data: &Path| {
        let out = assert_cmd::Command::cargo_bin("mesophyll")
            .unwrap()
            .args(["fit", "beam", "--positions", "axis", "--load", "even", "--deflections"])
            .arg(data)
            .arg("-o")
            .arg(&fit)
            .output()
            .unwrap();
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    };
    run(&root.join("data/branches/elm-twig.csv"));
    // The committed fit is the one that the program makes of the data.
    let read =
        |folder: &Path| mesophyll::fits::record::FitRecord::read(folder).unwrap().sections["branch elm-twig"].clone();
    let (fresh, committed) = (read(&fit), read(&root.join("fits/elm-twig")));
    let fitted =
        SAGGING.replace("taper = 0.3\nload_over_stiffness_mm = 40\n", "fit = \"fits/bent\"\nmeasured = \"elm-twig\"\n");
    let planted = mesophyll::scene::placed::plant::planted(&scene(dir.path(), &fitted), &Ledger::new()).unwrap();
    let (taper, load) = (planted[0].plant.branches[0].taper(), planted[0].plant.branches[0].bending_load);
    for (name, found) in [("alpha", taper), ("load_over_stiffness", load)] {
        let (a, b) = (&fresh.params[name], &committed.params[name]);
        assert!((a.value[0] - b.value[0]).abs() < 0.02 * b.stderr[0], "{name}: {a:?}, committed {b:?}");
        assert!((found / a.value[0] - 1.0).abs() < 1e-12);
    }
    // The data were made with a taper of 0.25 and 60 mm.
    assert!((taper - 0.25).abs() < 0.02 && (load - 60.0).abs() < 2.0);
    // Unknown names, and branches that could not be determined, are named in the error.
    let fails = |text: &str| {
        LoadedScene::open(scene(dir.path(), text), LeafSearch::default(), &Ledger::new()).unwrap_err().to_string()
    };
    assert!(
        fails(&fitted.replace("measured = \"elm-twig\"", "measured = \"oak\"")).contains("expected one of elm-twig")
    );
    let thin = dir.path().join("two.csv");
    std::fs::write(
        &thin,
        "branch,length_mm,position_mm,deflection_mm,deflection_err_mm\nelm-twig,230,115,5,3\nelm-twig,230,230,26,20\n",
    )
    .unwrap();
    run(&thin);
    let said = fails(&fitted);
    assert!(said.contains("alpha") || said.contains("load_over_stiffness"), "{said}");
    // This tip would move further than the branch is long.
    let said = fails(&SAGGING.replace("load_over_stiffness_mm = 40", "load_over_stiffness_mm = 900"));
    assert!(said.contains("branch \"trunk\"") && said.contains("of its length, expected at most 0.75"), "{said}");
}

/// Branches that are edited in the window move, and the plant that is saved moves in a scene as the edited one does.
#[test]
fn an_edited_plant_is_saved_and_moves_as_it_was_edited() {
    use mesophyll::scene::window::edit::SceneEditor;
    use mesophyll_window::edit::{Edit, EditQuantity, EditTarget, Edits};
    use mesophyll_window::editor::{Editor, PlantPart};
    let dir = tempfile::tempdir().unwrap();
    let text = format!("{SAGGING}{WIND}");
    let open = |extra: &str| {
        let search = LeafSearch { free: true, ..LeafSearch::default() };
        LoadedScene::open(scene(dir.path(), extra), search, &Ledger::new()).unwrap()
    };
    let mut editor = SceneEditor::new(open(&text), dir.path().join("out")).unwrap();
    let listed = editor.plants();
    assert_eq!((listed.len(), listed[0].branches.clone()), (1, vec![("trunk".to_string(), 0)]));
    let target = EditTarget::Plant(0, PlantPart::Level(0));
    let edit = |(quantity, value)| Edit { target, quantity, value };
    // Taper, load, lean, resonance, damping.
    let factors: Edits = EditQuantity::PLANT.into_iter().zip([1.5, 1.4, 2.0, 0.5, 2.0]).map(edit).collect();
    let before = editor.bend(&Edits::default()).unwrap();
    let after = editor.bend(&factors).unwrap();
    // The tip goes further, and the wood is thicker there.
    let tip = |s: &mesophyll_viewer::scene::Scene, time: f64| {
        let sections = s.sections.as_ref().unwrap();
        (sections.at)(time).last().unwrap().to
    };
    assert!(tip(&before, 3.0).distance(tip(&after, 3.0)) > 2.0);
    assert_eq!(before.instances.len(), after.instances.len());
    // A load that no beam carries is refused, and the plant stays as it was.
    let said = editor.bend(&[edit((EditQuantity::Load, 10.0))].into_iter().collect()).unwrap_err();
    assert!(said.contains("at most 0.75"), "{said}");
    let saved = editor.save_plant(0).unwrap();
    assert!(saved.ends_with("out/plants/twig-spec-edit-1.glb"), "{saved}");
    assert!(editor.save_plant(0).unwrap().ends_with("edit-2.glb"));
    assert!(editor.save_plant(1).is_err());
    std::fs::write(dir.path().join("file"), "").unwrap();
    let mut nowhere = SceneEditor::new(open(&text), dir.path().join("file")).unwrap();
    assert!(nowhere.save_plant(0).is_err());
    // The saved plant needs nothing that the scene stated. Its file has single precision.
    let head = SAGGING.split("[[plant.branch]]").next().unwrap();
    let again = head.replace("grow = \"twig-spec.toml\"", "file = \"out/plants/twig-spec-edit-1.glb\"");
    let whole = open(&format!("{again}{WIND}"));
    let read = handover::scene(&whole, &Ledger::new()).unwrap();
    for time in [0.0, 1.7, 40.0] {
        let (a, b) = (tip(&after, time), tip(&read, time));
        assert!(a.distance(b) < 0.02, "{time}: {a}, read back {b}");
    }
    let branch =
        &mesophyll::scene::placed::plant::planted(&whole.manifest, &Ledger::new()).unwrap()[0].plant.branches[0];
    assert!((branch.taper() - 0.45).abs() < 1e-6 && (branch.bending_load - 56.0).abs() < 1e-3);
    let stated = branch.stated;
    assert!((stated.lean_per_m_s.unwrap() - 0.06).abs() < 1e-6 && (stated.damping.unwrap() - 0.3).abs() < 1e-6);
    let resonance = 2.55 * 0.09f64.powf(-0.59);
    assert!((stated.resonance_hz.unwrap() / resonance - 0.5).abs() < 1e-6, "{stated:?}");
}

/// A load bends plants and moves nothing with time: no film, no animation, and no clock in the window.
#[test]
fn a_load_alone_is_no_motion() {
    use crate::plants::run;
    let dir = tempfile::tempdir().unwrap();
    let whole = planned(&scene(dir.path(), SAGGING)).0;
    assert!(whole.placed.moves().any() && !whole.placed.moves().with_time());
    assert!(handover::scene(&whole, &Ledger::new()).unwrap().wind.is_none());
    let words =
        ["export", "twig.toml", "--from", "0", "--until", "2", "--step", "1", "--to", "gltf", "-o", "moving.glb"];
    let (code, said) = run(dir.path(), &words);
    assert!(code == Some(2) && said.contains("nothing moves") && !dir.path().join("moving.glb").exists(), "{said}");
    // Without a time, the export is bent by the load, as `eval sway` says.
    let (code, said) = run(dir.path(), &["export", "twig.toml", "--to", "pivots", "-o", "pivots"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = run(dir.path(), &["eval", "sway", "twig.toml", "--to", "0", "-o", "sway.csv"]);
    assert_eq!(code, Some(0), "{said}");
    let row = std::fs::read_to_string(dir.path().join("sway.csv")).unwrap();
    let tip: Vec<f64> = row.lines().nth(1).unwrap().split(',').skip(3).map(|v| v.parse().unwrap()).collect();
    let bent = mesophyll::scene::placed::poses::resting(&whole.manifest, &Ledger::new()).unwrap();
    assert!(bent.branches[0].point(1.0).0.distance(DVec3::new(tip[0], tip[1], tip[2])) < 1e-3);
}
