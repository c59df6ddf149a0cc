//! How many discs a canopy has, from its reflectance factors.

use super::photographs::{PixelUse, ReadingKind, ScenePhotograph};
use super::pictures::{LitScene, LitWorld, draw};
use super::synthetic::{START, TRUTH, opened, scene};
use super::*;
use mesophyll_base::random::RandomStream;
use std::f64::consts::PI;
use std::fmt::Write;

/// Reflectance and transmittance of the leaves in each channel.
const RHO: [[f64; 3]; 2] = [[0.05, 0.12, 0.45], [0.03, 0.1, 0.42]];
const SOIL: [f64; 3] = [0.12, 0.18, 0.25];
const OPTIONS: Options = Options { samples: 64, seed: 5, force: true };

/// A canopy of these discs over a soil, which repeats.
fn canopy(folder: &Path, discs: &[String], soil: [f64; 3], tables: &str) -> LoadedScene {
    std::fs::write(folder.join("discs.txt"), discs.join("\n")).unwrap();
    let [rho_d, rho_t] = RHO;
    let text = format!(
        "schema = 1\nname = \"area\"\n[periodic]\nsize_mm = [1000, 1000]\n[ground]\nalbedo = {soil:?}\n\
         [[leaf]]\nname = \"a\"\ndiscs = \"discs.txt\"\n\
         uniform = {{ rho_d = [{rho_d:?}, {rho_d:?}], rho_t = {rho_t:?} }}\n\
         [[instance]]\nleaf = \"a\"\n[sun]\nzenith_deg = 30\nirradiance = [1, 1, 1]\n\
         [[view]]\nname = \"v\"\nkind = \"perspective\"\neye_mm = [0, 0, 9000]\ntarget_mm = [0, 0, 0]\n\
         up = [0, 1, 0]\nfov_deg = 10\n{tables}"
    );
    opened(folder, &text).unwrap()
}

fn tables(noise: f64) -> String {
    format!("[[brf]]\nfile = \"brf.csv\"\nnoise = {noise}\n[unknown]\nleaves = {{ a = [\"area\"] }}\n")
}

/// A table of factors towards directions; `of` has those of a direction.
fn table(directions: &[[f64; 2]], of: impl Fn([f64; 2]) -> [f64; 3]) -> String {
    let mut text = String::from("view_zenith_deg,view_azimuth_deg,brf_r,brf_g,brf_b");
    for at in directions {
        let [r, g, b] = of(*at);
        let _ = write!(text, "\n{},{},{r},{g},{b}", at[0], at[1]);
    }
    text + "\n"
}

fn fitted(scene: &LoadedScene, out: &Path) -> FitRecord {
    match run(scene, out, &OPTIONS, &Ledger::new()).unwrap() {
        FitOutcome::Done(record) => *record,
        other => panic!("{other:?}"),
    }
}

fn unknowns(scene: &LoadedScene) -> SceneUnknowns {
    let world = reference::traced(scene, 0.0, &Ledger::new()).unwrap();
    SceneUnknowns::new(scene, world, &[], None, &Ledger::new()).unwrap()
}

/// Factors towards directions, of which none is measured yet.
fn towards(directions: &[[f64; 2]]) -> [ScenePhotograph; 1] {
    let places = directions.len();
    [ScenePhotograph {
        name: "brf".into(),
        by: ReadingKind::Directions(directions.iter().map(|at| at.map(f64::to_radians)).collect()),
        size: [places, 1],
        channels: 3,
        seen: vec![0.0; 3 * places],
        error: None,
        noise: 0.01,
        floor: 0.0,
        uses: vec![PixelUse::Fitted; places],
        exposure: None,
        sun_deg: None,
        saturated: 0,
    }]
}

/// The derivatives by the area towards directions, as a fit draws them: for each direction and channel.
fn derivatives(scene: &LoadedScene, directions: &[[f64; 2]], draw_of: u64, each: u32) -> Vec<f64> {
    let (numbers, shots) = (unknowns(scene), towards(directions));
    let worlds = LitWorld::all(&numbers, &shots, draw_of..draw_of + 1, true).unwrap();
    let lit = LitScene::all(&numbers, &worlds).unwrap();
    let halves = [0, 1].map(|half| draw(&lit, &shots, |_| true, Some(half), [16, each], draw_of).unwrap());
    let mean = |k: usize, c: usize| 0.5 * halves.iter().map(|half| half[0].slope(k, 0, c)).sum::<f64>();
    (0..3 * directions.len()).map(|i| mean(i / 3, i % 3)).collect()
}

/// A hundred level discs, whose heights differ by less than shows, as computed ones do.
fn layer() -> Vec<String> {
    let grid = (0..100).map(|k| [k % 10, k / 10].map(|i| 0.1 * f64::from(i) - 0.45));
    grid.map(|[x, y]| format!("0.01 {x} {y} {} 0 0 1", 0.2 + 1e-9 * x)).collect()
}

/// Level discs at one height over black soil neither shade nor light each other: the reflectance factor is ρd times the
/// share of the ground that they cover, towards every direction, and linear in their area.
#[test]
fn a_thin_layer_is_linear_in_its_area() {
    let folder = tempfile::tempdir().unwrap();
    let covered = 100.0 * PI * 0.01f64.powi(2);
    let directions = [[0.0, 0.0], [20.0, 50.0], [35.0, 110.0], [45.0, 180.0], [55.0, 250.0], [60.0, 310.0]];
    let level = |area: f64| RHO[0].map(|rho| rho * covered * area);
    std::fs::write(folder.path().join("brf.csv"), table(&directions, |_| level(1.3))).unwrap();
    let noise = 0.2;
    let scene = canopy(folder.path(), &layer(), [0.0; 3], &tables(noise));
    let found = derivatives(&scene, &directions, 0, 64);
    for c in 0..3 {
        // Channels share their paths and have the same error. Copies that cover each other take a share from it.
        let mean = (0..6).map(|k| found[3 * k + c]).sum::<f64>() / 6.0 / level(1.0)[c];
        assert!((mean - 1.0).abs() < 0.06, "{c}: {mean} times what it is");
    }
    let record = fitted(&scene, &folder.path().join("fit"));
    let area = &record.sections["all"].params["leaf.a.area"];
    // Eighteen factors of a known relative error, to each of which the area is proportional.
    let error = 1.3 * noise / f64::sqrt(18.0);
    assert!((area.value[0] - 1.3).abs() < 0.05, "{area:?}");
    assert!(area.stderr[0] > 0.97 * error && area.stderr[0] < 1.2 * error, "{area:?}, {error}");
}

/// Readings of three times the stated area, which is beyond the search's end.
#[test]
fn an_area_at_the_end_of_its_search_is_no_result() {
    let folder = tempfile::tempdir().unwrap();
    let directions = [[0.0, 0.0], [20.0, 50.0], [35.0, 110.0], [45.0, 180.0], [55.0, 250.0], [60.0, 310.0]];
    let covered = 100.0 * PI * 0.01f64.powi(2);
    std::fs::write(folder.path().join("brf.csv"), table(&directions, |_| RHO[0].map(|rho| 3.0 * rho * covered)))
        .unwrap();
    let scene = canopy(folder.path(), &layer(), [0.0; 3], &tables(0.5));
    let record = fitted(&scene, &folder.path().join("fit"));
    let area = &record.sections["all"].params["leaf.a.area"];
    let why = area.undetermined.join("");
    assert!(why.contains("found at 2, where the search ends") && why.contains("a list of more discs"), "{area:?}");
    assert!(record.faults.iter().any(|fault| fault.says.contains("leaf.a.area: found at 2")), "{:?}", record.faults);
}

/// Discs that stand anywhere in a box, with normals in all directions, one a line.
fn anywhere(seed: u64, count: usize) -> Vec<String> {
    let mut random = RandomStream::new(seed, &[]);
    let one = |_| {
        let place = [0.5 * random.signed(), 0.5 * random.signed(), 0.05 + 0.5 * random.uniform()];
        let up: Vec<f64> = (0..2).flat_map(|_| random.normal_pair()).take(3).collect();
        let of: Vec<String> = place.iter().chain(&up).map(f64::to_string).collect();
        format!("0.06 {}", of.join(" "))
    };
    (0..count).map(one).collect()
}

/// A canopy of which the scene states the first discs, and which has 1.3 times as many.
#[test]
fn the_number_of_discs_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (few, more) = (anywhere(1, 160), anywhere(2, 48));
    let directions: Vec<[f64; 2]> = (0..12).map(|k| [f64::from(7 * k % 61), f64::from(50 * k % 360)]).collect();
    let all: Vec<String> = few.iter().chain(&more).cloned().collect();
    let true_scene = canopy(folder.path(), &all, SOIL, "");
    let world = reference::traced(&true_scene, 0.0, &Ledger::new()).unwrap();
    let of = |at: [f64; 2]| {
        [0, 1, 2].map(|c| Canopy::new(&world, 30 + c as u64).unwrap().brf(at.map(f64::to_radians), c, 16_384).mean)
    };
    std::fs::write(folder.path().join("brf.csv"), table(&directions, of)).unwrap();
    let out = folder.path().join("fit");
    let record = fitted(&canopy(folder.path(), &few, SOIL, &tables(0.01)), &out);
    let area = &record.sections["all"].params["leaf.a.area"];
    let (value, error) = (area.value[0], area.stderr[0]);
    assert!((value - 1.3).abs() < 3.0 * error && error < 0.12, "{area:?}");
    assert!(record.faults.is_empty() && record.termination.is_some_and(|t| t.converged()), "{:?}", record.faults);
    let own = record.sections["all"].figures["leaf.a.area.monte_carlo_error"];
    assert!(own > 0.2 * error && own <= error, "{own} of {error}");
    // The scene that was written has the discs that were found, the last of them in part.
    let found = LoadedScene::open(SceneManifest::read(&out.join(SCENE)).unwrap(), Default::default(), &Ledger::new());
    let world = reference::traced(&found.unwrap(), 0.0, &Ledger::new()).unwrap();
    let mesh = &world.leaves[0].mesh;
    let side = |t: usize| mesh.positions[mesh.triangle(t)[0]].distance_squared(mesh.positions[mesh.triangle(t)[1]]);
    let counted = (0..mesh.triangles()).map(side).sum::<f64>() / (12.0 * 60.0 * 60.0);
    assert!((counted / 160.0 - value).abs() < 1e-4, "{counted} discs, {value} times 160 found");
}

/// The difference is that of canopies that are thinned and filled by another way: each disc is taken by chance, and
/// discs that are added stand anywhere.
#[test]
fn the_derivative_is_that_of_many_canopies() {
    let folder = tempfile::tempdir().unwrap();
    let few = anywhere(1, 160);
    let toward = [[0.0, 0.0]];
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for k in 0..12u64 {
        ours.push(derivatives(&canopy(folder.path(), &few, SOIL, &tables(0.01)), &toward, k, 2)[2]);
        let mut random = RandomStream::new(k, &[7]);
        let keep: Vec<String> = few.iter().filter(|_| random.uniform() < 0.9).cloned().collect();
        let more: Vec<String> = few.iter().cloned().chain(anywhere(1000 + k, 16)).collect();
        // What was taken away by chance is not exactly a tenth.
        let over = 160.0 / (more.len() - keep.len()) as f64;
        let [low, high] = [keep, more].map(|list| {
            let scene = canopy(folder.path(), &list, SOIL, "");
            let world = reference::traced(&scene, 0.0, &Ledger::new()).unwrap();
            Canopy::new(&world, k).unwrap().brf(toward[0], 2, 16_384).mean
        });
        theirs.push(over * (high - low));
    }
    let mean = |of: &[f64]| {
        let n = of.len() as f64;
        let mean = of.iter().sum::<f64>() / n;
        (mean, (of.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
    };
    let ((a, a_error), (b, b_error)) = (mean(&ours), mean(&theirs));
    assert!((a - b).abs() < 3.0 * a_error.hypot(b_error), "{a} ± {a_error}, {b} ± {b_error}");
    assert!(a > 5.0 * a_error.hypot(b_error), "{a} ± {a_error}, {b} ± {b_error}");
}

#[test]
fn an_area_that_cannot_be_found_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("brf.csv"), table(&[[0.0, 0.0]], |_| [0.2; 3])).unwrap();
    let out = folder.path().join("refused");
    let refused = |scene: Result<LoadedScene>, expected: &str| {
        let error = scene.and_then(|scene| run(&scene, &out, &OPTIONS, &Ledger::new())).unwrap_err();
        assert!(error.to_string().contains(expected) && !out.exists(), "{error}\nexpected {expected}");
    };
    let few = canopy(folder.path(), &anywhere(1, 9), SOIL, &tables(0.01));
    refused(Ok(few), "unknown.leaves.a: found \"area\" of a list of 9 discs, expected at least 10");
    let sure = canopy(folder.path(), &anywhere(1, 20), SOIL, &tables(0.01));
    let error = design::plan(&sure, &Default::default(), &Ledger::new()).err().unwrap().to_string();
    assert!(error.contains("unknown.leaves.a: found \"area\", whose error is mostly"), "{error}");
    let sure = canopy(folder.path(), &anywhere(1, 20), SOIL, &tables(0.01).replace("\"area\"", "\"areas\""));
    refused(Ok(sure), "unknown.leaves.a: found \"areas\", expected some of rho_d, rho_t, rho_s, m, area, the numbers");
    let picture = "[[picture]]\nview = \"across\"\nfile = \"across.exr\"\nnoise = 0.01\n";
    super::synthetic::photograph(folder.path(), &scene(TRUTH, ""), 1.0, |_, v| v).unwrap();
    let mesh = opened(folder.path(), &scene(START, &format!("{picture}[unknown]\nleaves = {{ a = [\"area\"] }}\n")));
    refused(mesh, "unknown.leaves.a: found \"area\" of a leaf with a mesh, expected one with `discs`");
}
