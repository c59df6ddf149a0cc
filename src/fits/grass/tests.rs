use super::*;
use crate::grass::march::SliceAxis;
use crate::record::maker::FitOutcome;
use glam::{DVec2, DVec3};
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};

const SMALL: &str = "schema = 1\nname = \"tuft\"\nseed = 3\nsize_mm = [60, 50]\n[[sward]]\nmaterial = \"grass\"\n\
    per_m2 = 30000\nlength_mm = 40\nsize_spread = 0.3\nwidth_mm = 3\nlean_deg = 20\nlean_spread_deg = 15\n\
    bend_deg = 50\nbend_spread_deg = 30\ntuft_mm = 4\nblades_a_tuft = 3\n";

fn described(folder: &Path) -> PathBuf {
    let path = folder.join("tuft.toml");
    std::fs::write(&path, SMALL).unwrap();
    path
}

pub(crate) fn small() -> (Plant, LawnMeadow) {
    small_with(SMALL)
}

/// The same from another description.
fn small_with(description: &str) -> (Plant, LawnMeadow) {
    let folder = tempfile::tempdir().unwrap();
    let path = described(folder.path());
    std::fs::write(&path, description).unwrap();
    let plant = plant(&path).unwrap();
    let meadow = LawnMeadow::new(&path, &plant, &optics::read(None).unwrap()).unwrap();
    (plant, meadow)
}

/// The same with half as many blades, so that much light reaches the ground.
pub(crate) fn thin() -> (Plant, LawnMeadow) {
    small_with(&SMALL.replace("30000", "15000"))
}

pub(crate) fn options() -> Options {
    Options { slices: 8, texels: [64, 32], rays: 2, entries: 16, view: false, ..Options::default() }
}

/// Points and directions that follow no pattern.
fn ray(k: usize, height: f64) -> (DVec3, DVec3) {
    let f = |a: f64| (k as f64 * a + 0.13).fract();
    let origin = DVec3::new(300.0 * f(0.7549) - 150.0, 300.0 * f(0.5698) - 150.0, height);
    (origin, -judge::towards(8.0 + 80.0 * f(0.3247), 360.0 * f(0.8192)))
}

/// The repeating rectangle gives the same hits as explicit copies of its blades side by side.
#[test]
fn rays_meet_the_blades_of_all_rectangles() {
    let (plant, meadow) = small();
    let mut all = mesophyll_files::mesh::LeafMesh::default();
    for i in -8..=8 {
        for j in -8..=8 {
            let place = glam::DMat4::from_translation(DVec3::new(60.0 * f64::from(i), 50.0 * f64::from(j), 0.0));
            plant.leaves.iter().for_each(|l| all.append(&plant.blades[l.blade].mesh, place * l.transform));
        }
    }
    let forest =
        InstanceForest::new(vec![TriangleTree::new(&all.positions, &all.indices)], &[(0, glam::DMat4::IDENTITY)]);
    let mut met = 0;
    for k in 0..400 {
        let (origin, d) = ray(k, meadow.height);
        let (ray, ground) = (Ray::new(origin, d), -origin.z / d.z);
        let want = forest.nearest_within(&ray, ground, |_, _, _| true).map(|hit| hit.t);
        let got = meadow.nearest(&ray, ground);
        assert_eq!(want.is_some(), got.is_some(), "ray {k}");
        assert_eq!(got.is_some(), meadow.blocked(&ray, ground), "ray {k}");
        if let (Some(want), Some(got)) = (want, got) {
            assert!((want - got.t).abs() < 1e-7 * (1.0 + want), "ray {k}: {want} {}", got.t);
            assert!(got.normal.dot(d) < 0.5 && (got.normal.length() - 1.0).abs() < 1e-9);
            met += 1;
        }
    }
    assert!((100..400).contains(&met), "{met}");
}

/// The closed form gives the same crossings as all planes sorted by distance.
#[test]
fn slices_are_crossed_closest_first_and_none_is_forgotten() {
    let (_, meadow) = small();
    let slices = baked(&meadow, &Options { texels: [8, 8], rays: 1, ..options() });
    for k in 0..200 {
        let (origin, d) = ray(k, slices.height);
        let ground = -origin.z / d.z;
        let mut want = vec![(0.5 * ground, SliceAxis::Z)];
        for j in -400..400 {
            for (axis, across) in [SliceAxis::X, SliceAxis::Y].into_iter().enumerate() {
                let step = slices.period[axis] / 8.0;
                let plane = (f64::from(j) + 0.5) * step - 0.5 * slices.period[axis];
                let t = (plane - origin[axis]) / d[axis];
                if t > 0.0 && t < ground {
                    want.push((t, across));
                }
            }
        }
        want.sort_by(|a, b| a.0.total_cmp(&b.0));
        let got: Vec<(f64, SliceAxis)> = slices.crossings(origin, d, None).map(|c| (c.t, c.across)).collect();
        assert_eq!(got.len(), want.len(), "ray {k}");
        for (a, b) in got.iter().zip(&want) {
            assert!(a.1 == b.1 && (a.0 - b.0).abs() < 1e-9 * ground, "ray {k}: {a:?} {b:?}");
        }
        // From the other end, the same slices are crossed in the opposite order.
        let back = slices.crossings(origin + d * ground, -d, None);
        let back: Vec<(SliceAxis, i64)> = back.map(|c| (c.across, c.index)).collect();
        let mut forth: Vec<(SliceAxis, i64)> = slices.crossings(origin, d, None).map(|c| (c.across, c.index)).collect();
        forth.reverse();
        assert_eq!(back, forth, "ray {k}");
    }
}

/// The mean opacity of cells is that of the blades' silhouettes at every level of the sheet, and borders repeat the
/// cell.
#[test]
fn every_level_keeps_the_coverage() {
    let (_, meadow) = small();
    let slices = baked(&meadow, &options());
    let sheet = &slices.upright;
    assert_eq!(sheet.levels.len(), 4);
    let mean = |level: f64| {
        let n = 1 << level as usize;
        let [w, h] = [sheet.cell[0] / n, sheet.cell[1] / n];
        let at = |k: usize, x: usize, y: usize| {
            sheet.at(k, [(x as f64 + 0.5) / w as f64, (y as f64 + 0.5) / h as f64], level)[0]
        };
        let all = (0..16).flat_map(|k| (0..w * h).map(move |i| (k, i % w, i / w)));
        all.map(|(k, x, y)| at(k, x, y)).sum::<f64>() / (16 * w * h) as f64
    };
    let fine = mean(0.0);
    assert!((0.05..0.9).contains(&fine), "{fine}");
    for level in 1..4 {
        assert!((mean(f64::from(level)) - fine).abs() < 1e-6, "level {level}");
    }
    for level in [0.0, 1.0, 2.5, 3.0] {
        let [left, right] = [-1e-9, 1.0 - 1e-9].map(|u| sheet.at(3, [u, 0.3], level));
        assert!((left[0] - right[0]).abs() < 1e-5);
        // Below the ground, the border repeats the row at the ground and not the neighbouring cell.
        assert_eq!(sheet.at(3, [0.2, -0.5], level), sheet.at(3, [0.2, 0.0], level));
    }
    // One texel is compared with rays of its own.
    let [along, high] = [37, 5];
    let got = sheet.at(2, [(f64::from(along) + 0.5) / 64.0, (f64::from(high) + 0.5) / 32.0], 0.0)[0];
    let hits = (0..4).filter(|i| {
        let at = |k: i32, i: i32, n: f64| (f64::from(k) + 0.25 + 0.5 * f64::from(i)) / n;
        let y = (at(along, i % 2, 64.0) - 0.5) * 50.0;
        let from = DVec3::new(3.0 * 7.5 - 30.0, y, at(high, i / 2, 32.0) * meadow.height);
        meadow.blocked(&Ray::new(from, DVec3::NEG_X), 7.5)
    });
    assert_eq!(got, hits.count() as f64 / 4.0);
}

/// The file that `grow` writes states the rectangle over which the meadow repeats.
#[test]
fn a_file_gives_the_meadow_of_its_description() {
    let folder = tempfile::tempdir().unwrap();
    let (grown, described) = small();
    let path = folder.path().join("tuft.glb");
    file::write(&grown, &path).unwrap();
    let read = LawnMeadow::new(&path, &plant(&path).unwrap(), &optics::read(None).unwrap()).unwrap();
    assert_eq!(read.blades, described.blades);
    let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-5;
    assert!(near(read.period[0], 60.0) && near(read.period[1], 50.0) && near(read.height, described.height));
    assert!(read.projection.iter().zip(&described.projection).all(|(a, b)| near(*a, *b)));
}

#[test]
fn weights_give_the_blades_optical_depth() {
    let (_, meadow) = small();
    let slices = baked(&meadow, &Options { texels: [8, 8], rays: 1, ..options() });
    let p = |s: f64| crate::grass::blades::shown(&meadow.projection, s);
    for [elevation, azimuth] in [[3.0, 0.0], [20.0, 45.0], [50.0, 10.0], [70.0, 200.0], [90.0, 0.0]] {
        let d = -judge::towards(elevation, azimuth);
        let [upright, level] = slices.weights(d);
        let across = DVec2::new(d.x, d.y).abs().element_sum();
        let depth = upright * p(0.0) * across + level * p(1.0) * d.z.abs();
        assert!((depth - p(d.z)).abs() < 1e-9, "{elevation} {azimuth}: {depth} {}", p(d.z));
        assert!((0.0..=1.0).contains(&upright) && (0.0..=1.0).contains(&level));
    }
}

/// Slices with fitted weights cover as much as the blades do, also in azimuths that the fit did not use. Without
/// weights they cover too much along diagonals and too little from above. The folder stores the slices, and the fit is
/// recognised when it is run again.
#[test]
fn a_fit_covers_what_the_blades_cover() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (described(folder.path()), folder.path().join("fit"));
    let FitOutcome::Done(record) = run(&path, &out, &options()).unwrap() else { panic!("not done") };
    record.verify(&out).unwrap();
    let known = &record.sections["all"].params["projection"];
    assert!(known.stderr[0] == f64::INFINITY && known.stderr[12] < 0.1 * known.value[12], "{known:?}");
    let slices = open(&out).unwrap();
    let (_, meadow) = small();
    let whole = baked(&meadow, &options());
    let off = slices.upright.levels[0].texels.iter().zip(&whole.upright.levels[0].texels);
    assert!(off.flat_map(|(a, b)| a.iter().zip(b)).all(|(a, b)| (a - b).abs() < 6e-4), "halves keep three digits");
    assert!(slices.level.is_some() && slices.count == 8);
    let rays = LawnRays { side: 16, level: 0.0, sunlit: false };
    let truth = judge::blades(&meadow, rays);
    let error = |slices: &LawnSlices| folder::LawnErrors::of(&judge::judged(slices, &truth, rays)).coverage;
    let (plain, fitted) = (error(&LawnSlices { weighted: false, ..slices.clone() }), error(&slices));
    assert!(fitted < 0.03 && plain > 2.0 * fitted, "weighted {fitted}, plain {plain}");
    assert!((record.sections["all"].figures["coverage_rms_error"] - fitted).abs() < 1e-9);
    assert!(matches!(run(&path, &out, &options()).unwrap(), FitOutcome::UpToDate(_)));
}

/// Blades that stand exactly upright show nothing from straight above. So that step is undetermined, and no other step
/// takes its value from it. The folder that was written can be opened.
#[test]
fn upright_blades_leave_the_step_from_above_undetermined() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("up.toml"), folder.path().join("fit"));
    let upright = "schema = 1\nname = \"up\"\nseed = 3\nsize_mm = [60, 50]\n[[sward]]\nmaterial = \"grass\"\n\
        per_m2 = 30000\nlength_mm = 40\nwidth_mm = 3\nlean_deg = 0\nbend_deg = 0\n";
    std::fs::write(&path, upright).unwrap();
    let options = Options { slices: 4, texels: [16, 16], rays: 2, entries: 8, view: false, ..Options::default() };
    let FitOutcome::Done(record) = run(&path, &out, &options).unwrap() else { panic!("not done") };
    let all = &record.sections["all"].params;
    let (own, known) = (&all["projection_of_blades"].value, &all["projection"]);
    assert!(own[STEPS].abs() < 1e-9 && known.value[STEPS] == own[STEPS] && known.stderr[STEPS] == f64::INFINITY);
    assert!(known.undetermined.iter().any(|u| u == "16: no ray ends on a blade"), "{:?}", known.undetermined);
    for k in 1..STEPS {
        let determined = !known.undetermined.iter().any(|u| u.starts_with(&format!("{k}: ")));
        assert!(known.value[k].is_finite() && (!determined || known.stderr[k] < known.value[k]), "step {k}: {known:?}");
    }
    // At the steps between, blades at random have the optical depth of the slices in every direction.
    assert!((known.value[12] / own[12] - 1.0).abs() < 0.3, "{known:?}");
    let slices = open(&out).unwrap();
    assert_eq!(slices.weights(DVec3::NEG_Z)[1], 0.0);
}

/// A run that continues keeps finished parts. A damaged part is made again, and the others stay.
#[test]
fn a_damaged_part_is_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (described(folder.path()), folder.path().join("fit"));
    let small = Options { slices: 4, texels: [16, 16], rays: 1, entries: 4, ..Options::default() };
    let pictures = || {
        let (from, options) = (path.clone(), small.clone());
        // This fit ends after its pictures, like one that is stopped there, and says where they are.
        let stopped: Result<()> = maker::make(FitKind::Grass, &out, &[&path], move |maker| {
            maker.made_from("of a test".into())?;
            let meadow = LawnMeadow::new(&from, &plant(&from)?, &optics::read(None)?)?;
            slices(&meadow, &options, maker)?;
            Err(Error::Usage(maker.parts(PART).display().to_string()))
        });
        PathBuf::from(stopped.unwrap_err().to_string())
    };
    let parts = pictures();
    std::fs::write(parts.join("part-0.exr"), "no picture").unwrap();
    let kept = std::fs::metadata(parts.join("part-1.exr")).unwrap().modified().unwrap();
    assert_eq!(pictures(), parts);
    sheet::texels(&parts.join("part-0.exr"), 16, 16 * 8).unwrap();
    assert_eq!(std::fs::metadata(parts.join("part-1.exr")).unwrap().modified().unwrap(), kept);
}

#[test]
fn mistakes_are_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = described(folder.path());
    let out = folder.path().join("fit");
    let said = |options: &Options, path: &Path| run(path, &out, options).unwrap_err().to_string();
    std::fs::write(&path, SMALL.replace("\"grass\"", "\"moss\"")).unwrap();
    let told = said(&options(), &path);
    assert!(told.contains("moss") && told.contains("clover, grass"), "{told}");
    let leaves = folder.path().join("leaves.toml");
    std::fs::write(&leaves, "[moss]\nrho_d = [[0.9, 0.1, 0.1], [0.1, 0.1, 0.1]]\nrho_t = [0.2, 0.1, 0.1]\n").unwrap();
    let told = said(&Options { leaves: Some(leaves), ..options() }, &path);
    assert!(told.contains("leaves.toml") && told.contains("0.9 reflected and 0.2 let through"), "{told}");
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/plants/bird-cherry-sapling.toml");
    let told = said(&options(), &tree);
    assert!(told.contains("no meadow"), "{told}");
    let large = Options { slices: 128, texels: [1024, 1024], ..options() };
    let told = said(&large, &described(folder.path()));
    assert!(told.contains("million texels; expected at most 33.6 million"), "{told}");
    assert!(!out.exists());
}
