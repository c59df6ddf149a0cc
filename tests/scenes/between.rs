//! Light between leaves: it is planned, computed, drawn in real time, and compared with the path tracer.

use crate::blade::Blade;
use crate::{json, skips};
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::plan::ScenePlan;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A scene of domed blades that are the same everywhere, with these ρd and ρt, in front of a background.
fn crowd(dir: &Path, [rho_d, rho_t]: [f64; 2], count: usize, rest: &str) -> PathBuf {
    Blade::default().write(&dir.join("fits/elm"), "elm");
    let mut text = format!(
        "schema = 1\nname = \"crowd\"\ntolerance = 0.004\nbackground = [0.5, 0.5, 0.5]\n[[leaf]]\nname = \"elm\"\nmesh \
         = \
         \"fits/elm/blade.glb\"\nuniform = {{ rho_d = [[{rho_d}, {rho_d}, {rho_d}], [{rho_d}, {rho_d}, {rho_d}]], \
         rho_t = [{rho_t}, {rho_t}, {rho_t}] }}\n"
    );
    for k in 0..count {
        let f = k as f64;
        let at = [12.0 * (1.7 * f).sin(), 12.0 * (2.9 * f).cos(), 5.0 * f - 12.0];
        let turn = [40.0 * (f + 0.5).sin(), 30.0 * (2.0 * f).cos(), 70.0 * f];
        text += &format!("[[instance]]\nleaf = \"elm\"\nposition_mm = {at:?}\nrotation_deg = {turn:?}\n");
    }
    text += rest;
    text += "[[view]]\nname = \"side\"\nkind = \"perspective\"\neye_mm = [20, -120, 40]\ntarget_mm = [0, 0, \
             0]\nfov_deg = \
             35\nflip_p99 = 0.05\nmax_error = 0.012\n[check]\nwidth = 96\nheight = 72\nsamples = 16\nframes = 1\n";
    let path = dir.join("crowd.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn mesophyll(args: &[&str]) -> Output {
    assert_cmd::Command::cargo_bin("mesophyll").unwrap().args(args).output().unwrap()
}

fn planned(path: &Path) -> ScenePlan {
    LoadedScene::open(SceneManifest::read(path).unwrap(), LeafSearch::default(), &Ledger::new()).unwrap().plan
}

/// Leaves that absorb nothing cannot be distinguished from an even sky around them. This holds where they hide the sky
/// from each other and where they light each other. The picture is the sky.
#[test]
fn leaves_that_absorb_nothing_vanish_in_the_real_time_picture() {
    let dir = tempfile::tempdir().unwrap();
    for bands in ["", "bands = 3\n"] {
        let rest = format!("[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\npaths = 4096\n{bands}");
        let scene = crowd(dir.path(), [0.6, 0.4], 8, &rest);
        let out = dir.path().join(format!("out{}", bands.len()));
        let output = mesophyll(&["check", "--json", scene.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        if skips::no_adapter(&output) {
            return;
        }
        let report = json(&output);
        assert!(report["passed"].as_bool().unwrap(), "{report:#}");
        let picture = image::open(out.join("side.png")).unwrap().to_rgb8();
        let sky = picture.get_pixel(0, 0).0;
        // .5/(1 + .5), encoded in sRGB.
        assert_eq!(sky, [156; 3]);
        let far = picture.pixels().map(|p| p.0.iter().map(|v| v.abs_diff(sky[0])).max().unwrap()).max().unwrap();
        assert!(far <= 3, "{bands}: a pixel is off by {far} of 255");
    }
}

/// The decisions of the plan, and the savings that it states for each omission.
#[test]
fn a_light_that_stands_still_needs_no_operators() {
    let dir = tempfile::tempdir().unwrap();
    let plan_of = |count: usize, rest: &str| planned(&crowd(dir.path(), [0.3, 0.3], count, rest));
    let has = |plan: &ScenePlan, name: &str| plan.needed.iter().any(|n| n.name == name);
    let left = |plan: &ScenePlan, name: &str| plan.left_out.iter().find(|l| l.name == name).map(|l| l.saved_bytes);
    const LIGHT: &str = "light between leaves";
    const OPERATORS: &str = "operators of the light";
    let still = plan_of(4, "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\n");
    assert!(has(&still, LIGHT) && !has(&still, OPERATORS));
    // Four leaves with 15 anchors of 6 rows each, and 24 columns fewer of 8 bytes.
    assert_eq!(left(&still, OPERATORS), Some(4 * 15 * 6 * 24 * 8));
    assert_eq!(still.light.between.unwrap().bands, None);
    let asked = plan_of(4, "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\nbands = 4\n");
    assert!(has(&asked, OPERATORS) && asked.light.between.unwrap().bands == Some(4));
    let moving =
        plan_of(4, "[sun]\nzenith_deg = 40\nmoves = true\n[sky]\nmodel = \"preetham\"\nturbidity = 3\n[transfer]\n");
    assert_eq!(moving.light.between.unwrap().bands, Some(5));
    let none = plan_of(4, "[sky]\nradiance = [0.5, 0.5, 0.5]\n");
    assert!(none.light.between.is_none() && left(&none, LIGHT) == Some(0));
}

#[test]
fn a_transfer_is_made_once_and_made_again_for_another_scene() {
    let dir = tempfile::tempdir().unwrap();
    let light = "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\npaths = 32\n";
    let scene = crowd(dir.path(), [0.3, 0.3], 3, light);
    let out = dir.path().join("transfer");
    let fit = |scene: &Path| mesophyll(&["fit", "transfer", scene.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    let told = |output: &Output| String::from_utf8_lossy(&output.stderr).into_owned();
    let first = fit(&scene);
    assert!(first.status.success(), "{}", told(&first));
    assert!(String::from_utf8_lossy(&first.stdout).contains("45 anchors, 270 rows of 1 columns"));
    assert!(told(&fit(&scene)).contains("already holds this fit"));
    let scene = crowd(dir.path(), [0.3, 0.2], 3, light);
    let again = fit(&scene);
    assert!(again.status.success() && !told(&again).contains("already holds"), "{}", told(&again));
    let report = mesophyll(&["report", "--json", out.to_str().unwrap()]);
    assert_eq!(json(&report)["fits"][0]["sections"][0]["counts"]["anchors"], 45);
}

#[test]
fn what_cannot_be_asked_for_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let sky = "[sky]\nradiance = [0.5, 0.5, 0.5]\n";
    for (rest, expected) in [
        (sky.to_string(), "transfer: missing; a scene with a [transfer] has light between leaves"),
        (format!("{sky}[transfer]\nanchors = [0, 3]\n"), "transfer.anchors: found 0, expected 1 to 64"),
        (format!("{sky}[transfer]\npaths = 3\n"), "transfer.paths: found 3, expected 16 to 524288"),
        (format!("{sky}[transfer]\nbands = 9\n"), "transfer.bands: found 9, expected 1 to 7"),
        (format!("{sky}[transfer]\nrays = 9\n"), "unknown field `rays`"),
    ] {
        let scene = crowd(dir.path(), [0.3, 0.3], 2, &rest);
        let output =
            mesophyll(&["fit", "transfer", scene.to_str().unwrap(), "-o", dir.path().join("t").to_str().unwrap()]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(expected) && told.contains("crowd.toml"), "{told}\nexpected {expected}");
    }
}

/// Sharp shadows that were computed beforehand. No shadow map is drawn, and the picture agrees with the path tracer's,
/// as it does with shadow maps.
#[test]
fn shadows_that_are_known_beforehand_are_those_of_the_path_tracer() {
    let dir = tempfile::tempdir().unwrap();
    let light = "[sun]\nzenith_deg = 35\nazimuth_deg = -70\nirradiance = [2.0, 2.0, 2.0]\nradius_deg = 2\n\
                 [sky]\nradiance = [0.1, 0.1, 0.1]\n[transfer]\npaths = 256\n";
    let draw = |more: &str| {
        let scene = crowd(dir.path(), [0.3, 0.3], 6, &format!("{light}{more}"));
        let out = dir.path().join(format!("out{}", more.len()));
        let output = mesophyll(&["check", "--json", scene.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        (!skips::no_adapter(&output)).then(|| (json(&output), image::open(out.join("side.png")).unwrap().to_rgb8()))
    };
    let Some((known, by_shares)) = draw("shadows = \"visibility\"\nedge_mm = 1.5\n") else { return };
    let Some((drawn, by_maps)) = draw("") else { return };
    let has = |report: &serde_json::Value, list: &str, word: &str| report[list].to_string().contains(word);
    assert!(has(&known, "uploads", "shares of the sun") && has(&known, "pipelines", "shares"), "{known:#}");
    assert!(!has(&known, "pipelines", "shadow") && has(&drawn, "pipelines", "shadow"));
    let p99 = |report: &serde_json::Value| report["views"][0]["flip_p99"].as_f64().unwrap();
    let noise = known["views"][0]["noise_flip_p99"].as_f64().unwrap();
    // The picture is as near to the path tracer's as with shadow maps, and within three times the path tracer's own
    // noise.
    assert!(p99(&known) < p99(&drawn) + noise && p99(&known) < 3.0 * noise, "{known:#} {drawn:#}");
    let apart = by_shares.as_raw().iter().zip(by_maps.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b)));
    let (sum, count) = apart.fold((0.0, 0.0), |(sum, count), d| (sum + d, count + 1.0));
    assert!(sum / count < 1.0, "mean difference of {} of 255", sum / count);
    // Without them the plan says why.
    let path = |more: &str| crowd(dir.path(), [0.3, 0.3], 6, &format!("{light}{more}"));
    assert!(planned(&path("shadows = \"visibility\"\n")).light.between.unwrap().sun_visibility);
    let plan = planned(&path(""));
    assert!(plan.left_out.iter().any(|l| l.name == "sun visibility" && l.reason.contains("asks for shadow maps")));
}

/// A leaf that no view shows gets no anchors. The plan states the saving, and the transfer has no further anchors.
#[test]
fn leaves_beside_the_picture_get_no_anchors() {
    let dir = tempfile::tempdir().unwrap();
    let light = "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\npaths = 32\n";
    let beside = "[[instance]]\nleaf = \"elm\"\nposition_mm = [5000, 0, 0]\n";
    let scene = crowd(dir.path(), [0.3, 0.3], 3, &format!("{beside}{light}"));
    let plan = planned(&scene);
    let left = plan.left_out.iter().find(|l| l.name == "light at leaves beside the pictures").unwrap();
    // 15 anchors of 6 rows, with 8 bytes each.
    assert_eq!(left.saved_bytes, 15 * 6 * 8);
    assert!(left.reason.contains("no view shows 1 of 4 leaves"), "{}", left.reason);
    let out = dir.path().join("transfer");
    let output = mesophyll(&["fit", "transfer", scene.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(told.contains("45 anchors, 270 rows of 1 columns"), "{told}");
    let all = planned(&crowd(dir.path(), [0.3, 0.3], 3, light));
    assert!(!all.left_out.iter().any(|l| l.name == "light at leaves beside the pictures"));
}

/// A leaf that others hide from every view gets no anchors either. The others keep the light that they have where it
/// gets some.
#[test]
fn leaves_that_others_hide_get_no_anchors() {
    let dir = tempfile::tempdir().unwrap();
    // The eye stands at (20, −120, 40). The second blade hides behind the first, which faces the eye and is larger.
    let blade = |at: [f64; 3], scale: f64| {
        format!("[[instance]]\nleaf = \"elm\"\nposition_mm = {at:?}\nrotation_deg = [72, 0, 10]\nscale = {scale}\n")
    };
    let light = "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\npaths = 64\n";
    let of = |views: &str| {
        let rest = format!("{}{}{light}{views}", blade([0.0; 3], 1.0), blade([-2.5, 15.0, -5.0], 0.2));
        let scene = crowd(dir.path(), [0.3, 0.3], 0, &rest);
        let out = dir.path().join(format!("out{}", views.len()));
        let output = mesophyll(&["fit", "transfer", scene.to_str().unwrap(), "-o", out.to_str().unwrap()]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let maps = mesophyll::files::image::read_exr(&out.join("operators.exr")).unwrap();
        let planes = ["between.R", "between.G", "between.B", "straight.Y"].map(|n| maps.get(n).unwrap()[..90].to_vec());
        (String::from_utf8_lossy(&output.stdout).into_owned(), planes)
    };
    let (told, hidden) = of("");
    assert!(told.contains("15 anchors, 90 rows of 1 columns"), "{told}");
    let behind = "[[view]]\nname = \"behind\"\nkind = \"perspective\"\neye_mm = [-20, 120, -40]\n\
                  target_mm = [0, 0, 0]\nfov_deg = 35\nflip_p99 = 0.05\nmax_error = 0.012\n";
    let (told, seen) = of(behind);
    assert!(told.contains("30 anchors, 180 rows of 1 columns"), "{told}");
    assert_eq!(hidden, seen);
}

/// Where all views are far away the plan keeps the coarse levels of anchors alone, and says what that saves.
#[test]
fn the_plan_counts_the_levels_that_no_view_comes_near() {
    let dir = tempfile::tempdir().unwrap();
    let name = "the finest light at leaves far away";
    let light = "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\n";
    let near = crowd(dir.path(), [0.3, 0.3], 3, light);
    assert!(!planned(&near).left_out.iter().any(|l| l.name == name));
    let text = std::fs::read_to_string(&near).unwrap().replace("[20, -120, 40]", "[0, -90000, 0]");
    std::fs::write(&near, text.replace("fov_deg = 35", "fov_deg = 2")).unwrap();
    let plan = planned(&near);
    let left = plan.left_out.iter().find(|l| l.name == name).unwrap();
    // A pixel is 44 mm wide at 90 m; five anchors lie closer than that. One anchor stays of 15, 2 and 1.
    assert_eq!(left.saved_bytes, 3 * (15 + 2) * 6 * 8);
    assert!(left.reason.contains("3 leaves"), "{}", left.reason);
}

/// Five pairs of leaves, far apart from each other, are lit alike. One pair has anchors, and its light is right for the
/// others too: the picture is that in which each has anchors, and not that in which each is lit as if it stood alone.
#[test]
fn copies_of_a_list_show_the_light_of_the_one_in_their_middle() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("places.txt"), "-36 0 0\n-18 0 0\n0 0 0\n18 0 0\n36 0 0\n").unwrap();
    let list = |z: f64| {
        format!(
            "[[instance]]\nleaf = \"elm\"\npositions = \"places.txt\"\nunit = \"mm\"\nposition_mm = [0, 0, {z}]\n\
             rotation_deg = [20, 0, 30]\nscale = 0.3\n"
        )
    };
    let draw = |name: &str, light: &str| {
        let rest = format!("{}{}[sky]\nradiance = [0.5, 0.5, 0.5]\n{light}", list(0.0), list(3.0));
        let scene = crowd(dir.path(), [0.3, 0.3], 0, &rest);
        let out = dir.path().join(name);
        let output = mesophyll(&["check", "--json", scene.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        if skips::no_adapter(&output) {
            return None;
        }
        assert_eq!(json(&output)["passed"], true, "{:#}", json(&output));
        Some(image::open(out.join("side.png")).unwrap().to_rgb8().into_raw())
    };
    let Some(shared) = draw("shared", "[transfer]\npaths = 4096\nshared = true\n") else { return };
    let fit = std::fs::read_to_string(dir.path().join("shared/fits/crowd-transfer/fit.toml")).unwrap();
    assert!(fit.contains("anchors = 30\n"), "{fit}");
    let [own, alone] = [("own", "[transfer]\npaths = 4096\n"), ("alone", "")].map(|(n, l)| draw(n, l).unwrap());
    let off = |picture: &[u8]| picture.iter().zip(&own).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>();
    assert!(off(&shared) < 0.1 * off(&alone), "off by {} and {}", off(&shared), off(&alone));
    // No list, nothing to share.
    let rest = "[sky]\nradiance = [0.5, 0.5, 0.5]\n[transfer]\nshared = true\n";
    let scene = crowd(dir.path(), [0.3, 0.3], 2, rest);
    let output = mesophyll(&["check", scene.to_str().unwrap(), "--out", dir.path().join("no").to_str().unwrap()]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2));
    assert!(told.contains("transfer.shared: true, but no [[instance]] has"), "{told}");
}

/// The text of an instance that stands at `count` places of a list, which lie within 20 mm of each other.
fn many(folder: &Path, count: u64) -> String {
    let places: String = (0..count).map(|k| format!("{} 0 {}\n", k % 7, k % 20)).collect();
    std::fs::write(folder.join("places.txt"), places).unwrap();
    "[[instance]]\nleaf = \"elm\"\npositions = \"places.txt\"\nunit = \"mm\"\n".into()
}

/// A transfer for which this machine lacks the memory is refused by the plan, with the numbers, before any leaf is
/// fitted.
#[test]
fn a_transfer_that_is_too_large_is_refused_at_once() {
    let Some(there) = mesophyll::files::memory::available() else {
        return skips::skip(skips::Need::System, "no /proc/meminfo");
    };
    let dir = tempfile::tempdir().unwrap();
    // 64·64 anchors for each leaf, 6 rows of 49 columns, 64 bytes each. The scene needs one and a half times the memory
    // that there is.
    let leaf = 64 * 64 * 6 * 49 * 64;
    let count = 3 * there / leaf / 2 + 1;
    let rest =
        format!("{}[transfer]\nanchors = [64, 64]\nbands = 7\n[sky]\nradiance = [1, 1, 1]\n", many(dir.path(), count));
    let scene = crowd(dir.path(), [0.2, 0.2], 0, &rest);
    let output = mesophyll(&["--quiet", "plan", scene.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains(&format!("64 by 64 anchors on each of {count} leaves, 7 bands")), "{said}");
    let needed = format!("needs about {:.1} GiB of memory", (count * leaf) as f64 / f64::from(1 << 30));
    assert!(said.contains(&needed), "{said} {needed}");
    assert_eq!(said.trim().lines().count(), 1, "{said}");
}

/// A transfer that exists is only read. Then the plan needs no memory for computing it.
#[test]
fn a_transfer_that_is_there_is_not_refused() {
    let Some(there) = mesophyll::files::memory::available() else {
        return skips::skip(skips::Need::System, "no /proc/meminfo");
    };
    let dir = tempfile::tempdir().unwrap();
    let count = there / (64 * 64 * 6 * 49 * 64) + 8;
    // One leaf stands far beside the picture and is not counted.
    let rest = format!(
        "{}[[instance]]\nleaf = \"elm\"\nposition_mm = [50000, 0, 0]\n[transfer]\nanchors = [64, 64]\nbands = \
         7\n[sky]\n\
         radiance = [1, 1, 1]\n",
        many(dir.path(), count)
    );
    let manifest = SceneManifest::read(&crowd(dir.path(), [0.2, 0.2], 0, &rest)).unwrap();
    let out = dir.path().join("out");
    let search = LeafSearch { out: Some(&out), ..LeafSearch::default() };
    let told = LoadedScene::open(manifest.clone(), search, &Ledger::new()).unwrap_err().to_string();
    assert!(told.contains(&format!("anchors on each of {count} leaves")), "{told}");
    let folder = mesophyll::scene::transfer::folder(&manifest, Some(7), &out);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("fit.toml"), "").unwrap();
    assert!(LoadedScene::open(manifest, search, &Ledger::new()).is_ok());
}

/// A transfer that leaves out a leaf is taken over, at once and from its folder, where the scene has a ground too.
#[test]
fn a_transfer_without_leaves_that_no_view_shows_is_taken_over() {
    let dir = tempfile::tempdir().unwrap();
    let rest = "[[instance]]\nleaf = \"elm\"\nposition_mm = [50000, 0, 0]\n[ground]\nalbedo = [0.2, 0.2, 0.2]\n\
                reach_mm = 300\nheight_mm = -60\n[transfer]\npaths = 16\n[sky]\nradiance = [1, 1, 1]\n";
    let manifest = SceneManifest::read(&crowd(dir.path(), [0.2, 0.2], 3, rest)).unwrap();
    for _ in 0..2 {
        let mut scene = LoadedScene::open(manifest.clone(), LeafSearch::default(), &Ledger::new()).unwrap();
        assert!(scene.plan.left_out.iter().any(|l| l.reason.contains("no view shows 1 of 4 leaves")));
        scene.find_transfer(&dir.path().join("out"), &Ledger::new()).unwrap();
        assert!(scene.transfer.is_some());
    }
}

/// The six clusters are read and planned as docs/evidence/light.md describes them: 14 leaves with 270 anchors,
/// operators, and a map of the sun.
#[test]
fn the_clusters_of_six_species_are_planned() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/canopies/species");
    let mut found = 0;
    let scene = |entry: std::io::Result<std::fs::DirEntry>| entry.map(|e| e.path()).ok();
    for path in
        std::fs::read_dir(folder).unwrap().filter_map(scene).filter(|p| p.extension().is_some_and(|x| x == "toml"))
    {
        let manifest = SceneManifest::read(&path).unwrap();
        manifest.require_limits().unwrap();
        let scene = LoadedScene::open(manifest, LeafSearch::default(), &Ledger::new()).unwrap();
        let between = scene.plan.light.between.unwrap();
        assert_eq!((between.bands, between.sun_visibility), (Some(5), true));
        assert_eq!(
            scene.placed.placements.len() * scene.manifest.transfer.unwrap().anchors.iter().product::<usize>(),
            3780
        );
        found += 1;
    }
    assert_eq!(found, 6);
}

/// The window asks for the sun's map with the renderer's direction, which is in single precision. A sun that was not
/// moved needs no other map, and a sun that was moved gets one.
#[cfg(feature = "render")]
#[test]
fn the_window_asks_for_no_map_before_its_sun_moves() {
    use mesophyll::scene::draw::handover;
    use mesophyll::scene::window::edit::SceneEditor;
    use mesophyll_window::editor::Editor;
    let dir = tempfile::tempdir().unwrap();
    let light = "[sun]\nzenith_deg = 35\nazimuth_deg = -70\nirradiance = [2.0, 2.0, 2.0]\nradius_deg = 2\n[sky]\n\
                 radiance = [0.1, 0.1, 0.1]\n[transfer]\npaths = 16\nbands = 1\nshadows = \"visibility\"\n\
                      edge_mm = 8\n";
    let manifest = SceneManifest::read(&crowd(dir.path(), [0.3, 0.3], 3, light)).unwrap();
    let ledger = Ledger::new();
    let mut free = LoadedScene::open(manifest, LeafSearch { free: true, ..LeafSearch::default() }, &ledger).unwrap();
    free.find_transfer(&dir.path().join("out"), &ledger).unwrap();
    let drawn = handover::scene(&free, &ledger).unwrap();
    let mut editor = SceneEditor::new(free, dir.path().join("out")).unwrap();
    let sun = drawn.sun.unwrap().direction;
    assert_eq!(editor.shares(sun), Ok((None, false)));
    let (mut map, mut more) = editor.shares(-sun).unwrap();
    assert!(map.is_some() || more);
    let begun = std::time::Instant::now();
    while more && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(1));
        let (new, still) = editor.shares(-sun).unwrap();
        (map, more) = (new.or(map), still);
    }
    assert_eq!(map.map(|m| m.len()), drawn.sun_shares.map(|m| m.len()));
}
