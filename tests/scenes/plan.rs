//! The plan: what a scene needs, what is left out, and that no other data are read.

use crate::blade::{Blade, scene};
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::plan::ScenePlan;
use std::path::Path;

fn opened(path: &Path) -> (LoadedScene, Ledger) {
    let ledger = Ledger::new();
    (LoadedScene::open(SceneManifest::read(path).unwrap(), LeafSearch::default(), &ledger).unwrap(), ledger)
}

fn planned(path: &Path) -> (ScenePlan, Ledger) {
    let (scene, ledger) = opened(path);
    (scene.plan, ledger)
}

fn names(plan: &ScenePlan) -> (Vec<&str>, Vec<&str>) {
    (plan.needed.iter().map(|n| n.name.as_str()).collect(), plan.left_out.iter().map(|n| n.name.as_str()).collect())
}

#[test]
fn a_front_lit_matte_leaf_needs_neither_back_nor_gloss_nor_sky() {
    let dir = tempfile::tempdir().unwrap();
    Blade { rho_s: [0.0, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let (plan, ledger) = planned(&scene(dir.path(), "front", "elm", Some(30.0), None, ""));
    let (needed, left) = names(&plan);
    for name in ["fit elm", "elm/blade.glb", "elm/front_gamma_delta", "elm/front_normal", "elm/front.exr", "sun"] {
        assert!(needed.contains(&name), "{name} of {needed:?}");
    }
    for name in [
        "elm/back_gamma_delta",
        "elm/back_normal",
        "elm/back_rho_s_m",
        "elm/front_rho_s_m",
        "elm/back.exr",
        "shadow maps",
        "sky",
        "beam fit",
        "motion texture",
        "sky polynomial (spherical harmonics)",
        "translucency maps",
        "elm: pigment maps, front",
    ] {
        assert!(left.contains(&name), "{name} of {left:?}");
        assert!(!needed.contains(&name));
    }
    assert!(plan.left_out.iter().all(|l| !l.reason.is_empty() && !l.saved.is_empty()));
    // No file of the back was opened.
    assert!(ledger.entries().iter().all(|e| !e.what.contains("back")), "{:?}", ledger.entries());
    assert_eq!(ledger.count("curve", "slab curve"), 1);
}

#[test]
fn light_through_the_leaf_asks_for_the_far_sides_transmittance() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let (plan, _) = planned(&scene(dir.path(), "back", "elm", Some(160.0), None, ""));
    let (needed, left) = names(&plan);
    for name in ["elm/back_gamma_delta", "elm/back_normal", "elm/back slab curve"] {
        assert!(needed.contains(&name), "{name} of {needed:?}");
    }
    for name in ["elm/front_gamma_delta", "elm/front_normal", "elm/front_rho_s_m"] {
        assert!(left.contains(&name), "{name} of {left:?}");
    }
}

#[test]
fn a_constant_sky_alone_asks_for_both_interiors_and_no_normals() {
    let dir = tempfile::tempdir().unwrap();
    Blade { rho_s: [0.0, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let (plan, _) = planned(&scene(dir.path(), "sky", "elm", None, Some(1.0), ""));
    let (needed, left) = names(&plan);
    for name in ["elm/front_gamma_delta", "elm/back_gamma_delta", "sky"] {
        assert!(needed.contains(&name), "{name} of {needed:?}");
    }
    for name in ["elm/front_normal", "elm/back_normal", "sun and shadow maps"] {
        assert!(left.contains(&name), "{name} of {left:?}");
    }
}

#[test]
fn gloss_is_kept_where_it_shows_and_left_out_where_it_does_not() {
    let dir = tempfile::tempdir().unwrap();
    for (rho_s, kept) in [(0.05, true), (1e-5, false)] {
        Blade { rho_s: [rho_s, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
        let (plan, _) = planned(&scene(dir.path(), "gloss", "elm", Some(30.0), None, ""));
        assert_eq!(names(&plan).0.contains(&"elm/front_rho_s_m"), kept, "rho_s {rho_s}");
    }
}

/// A flat, dark leaf with so little gloss that it is invisible from above, and a view in the sun's mirror direction at
/// this angle.
fn faint_gloss(dir: &Path, zenith_deg: f64) -> std::path::PathBuf {
    let dark = Blade {
        sigma_a: [[45.0, 20.0, 90.0]; 2],
        rho_s: [2e-4, 0.0],
        m: [0.4, 0.4],
        dome: 0.0,
        bump: 0.0,
        pattern: 0.0,
        ..Blade::default()
    };
    dark.write(&dir.join("fits/elm"), "elm");
    let path = scene(dir, "faint", "elm", Some(zenith_deg), None, "");
    let (sin, cos) = zenith_deg.to_radians().sin_cos();
    let eye = [-90.0 * sin * 30f64.to_radians().cos(), -90.0 * sin * 30f64.to_radians().sin(), 90.0 * cos];
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text
        .replace("[10, -25, 90]", &format!("{eye:?}"))
        .replace("tolerance = 0.004", "tolerance = 0.004\nexposure = 4");
    std::fs::write(&path, text).unwrap();
    path
}

/// The contribution of gloss in the middle of that leaf, from the formulas: W Eq. 7 in the mirror direction, where the
/// half vector is the normal.
fn added(zenith_deg: f64) -> f64 {
    use mesophyll::optics::slab;
    use mesophyll::transport::tone::display;
    let cos = zenith_deg.to_radians().cos();
    let under = [45.0, 20.0, 90.0].into_iter().zip([11.0, 12.0, 10.0]).zip([3.0, 3.0, 2.8]);
    let one = |((sigma_a, sigma_s), irradiance): ((f64, f64), f64)| {
        let below = slab::response(sigma_a, sigma_s, 0.2).rho_d * irradiance * cos / std::f64::consts::PI;
        let gloss = 2e-4 * irradiance / (std::f64::consts::PI * 0.16 * 4.0 * cos);
        display(below + gloss, 4.0) - display(below, 4.0)
    };
    under.map(one).fold(0.0, f64::max)
}

#[test]
fn gloss_that_only_a_grazing_view_shows_is_planned_for_one() {
    let dir = tempfile::tempdir().unwrap();
    for zenith in [10.0, 60.0, 75.0, 86.0] {
        let (plan, _) = planned(&faint_gloss(dir.path(), zenith));
        let shows = added(zenith) > 0.004;
        assert_eq!(shows, zenith > 50.0, "{zenith}: {}", added(zenith));
        assert_eq!(names(&plan).0.contains(&"elm/front_rho_s_m"), shows, "{zenith} degrees: adds {}", added(zenith));
        if !shows {
            // The bound is at least the contribution, and not many times larger.
            let left = plan.left_out.iter().find(|l| l.name == "elm/front_rho_s_m").unwrap();
            let bound: f64 =
                left.reason.split("adds at most ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            assert!((added(zenith)..2.0 * added(zenith)).contains(&bound), "{bound} for {}", added(zenith));
        }
    }
}

/// The reference draws also what the plan leaves out, so a plan that leaves out too much fails its check.
#[cfg(feature = "render")]
#[test]
fn the_check_sees_gloss_that_a_plan_left_out_by_mistake() {
    use mesophyll::check::{self, CheckVerdict};
    let dir = tempfile::tempdir().unwrap();
    let (mut scene, ledger) = opened(&faint_gloss(dir.path(), 75.0));
    let options = check::Options { out: dir.path().join("out"), ..Default::default() };
    let whole = match check::check(&scene, &options, &ledger) {
        Err(e) if e.to_string().contains("no graphics adapter") => return println!("skipped: no graphics adapter"),
        other => other.unwrap(),
    };
    assert_eq!(whole.passed, Some(true), "{}", whole.text());
    scene.plan.leaves[0].sides[0].gloss = false;
    let without = check::check(&scene, &options, &ledger).unwrap();
    let of = |verdict: &CheckVerdict| verdict.views[0].error.as_ref().unwrap().max_error.unwrap();
    let (error, before) = (of(&without), of(&whole));
    println!("with gloss {before:.4}, without {error:.4}; by the formulas {:.4}", added(75.0));
    assert!(without.passed == Some(false) && error > 0.7 * added(75.0), "{error} where {} is missing", added(75.0));
}

#[test]
fn a_glossy_side_under_a_constant_sky_needs_its_normals() {
    let dir = tempfile::tempdir().unwrap();
    Blade { rho_s: [0.05, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let (plan, _) = planned(&scene(dir.path(), "sky", "elm", None, Some(1.0), ""));
    let (needed, left) = names(&plan);
    // The share of the sky that a lobe mirrors depends on the angle between normal and view.
    assert!(needed.contains(&"elm/front_normal") && needed.contains(&"elm/front_rho_s_m"), "{needed:?}");
    assert!(left.contains(&"elm/back_normal"), "{left:?}");
}

/// The program's own export is drawn again: with metres, a node's scale and a back beside the front it is the blade
/// that was exported.
#[test]
fn an_exported_leaf_is_the_blade_again_and_one_in_another_unit_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("fits/elm");
    Blade::default().write(&fit, "elm");
    let leaf = dir.path().join("leaf.glb");
    let out = assert_cmd::Command::cargo_bin("mesophyll")
        .unwrap()
        .arg("export")
        .arg(&fit)
        .args(["--to", "gltf", "-o"])
        .arg(&leaf)
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let path = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    let text = std::fs::read_to_string(&path).unwrap();
    let (own, _) = opened(&path);
    let with = |mesh: &str| {
        std::fs::write(&path, text.replace("fit = \"fits/elm\"", &format!("fit = \"fits/elm\"\n{mesh}"))).unwrap();
        opened(&path).0
    };
    let again = with("mesh = \"leaf.glb\"");
    let (a, b) = (own.placed.leaves[0].mesh.as_ref().unwrap(), again.placed.leaves[0].mesh.as_ref().unwrap());
    assert_eq!(a.indices, b.indices);
    assert!(a.positions.iter().zip(&b.positions).all(|(p, q)| p.distance(*q) < 1e-4));
    assert!(own.plan.warnings.is_empty() && again.plan.warnings.is_empty(), "{:?}", again.plan.warnings);
    // Metres are read as millimetres, so the leaf has a thousandth of its size.
    let tiny = with("mesh = \"leaf.glb\"\nmesh_unit = \"mm\"");
    let said = tiny.plan.warnings.join("\n");
    assert!(said.contains("mm across") && said.contains("mesh_unit") && said.contains("no view shows it"), "{said}");
    let words = assert_cmd::Command::cargo_bin("mesophyll").unwrap().arg("plan").arg(&path).output().unwrap();
    assert!(String::from_utf8_lossy(&words.stdout).contains("warning: leaf \"elm\": mesh"));
    // A leaf that stands beside every view.
    std::fs::write(
        &path,
        text.replace("[[instance]]\nleaf = \"elm\"", "[[instance]]\nleaf = \"elm\"\nposition_mm = [5000, 0, 0]"),
    )
    .unwrap();
    let said = planned(&path).0.warnings.join("\n");
    assert!(said.contains("outside every view") && said.contains("[5000.0, "), "{said}");
}

#[test]
fn a_leaf_nobody_places_is_not_even_opened() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    Blade::default().write(&dir.path().join("fits/spare"), "spare");
    let path =
        scene(dir.path(), "spare", "elm", Some(30.0), None, "[[leaf]]\nname = \"spare\"\nfit = \"fits/spare\"\n");
    let (plan, ledger) = planned(&path);
    assert!(names(&plan).1.contains(&"fit spare"));
    assert!(plan.left_out.iter().any(|l| l.name == "fit spare" && l.saved_bytes > 1000));
    assert!(ledger.entries().iter().all(|e| !e.what.starts_with("spare")));
}

#[test]
fn two_leaves_one_above_the_other_need_shadow_maps() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let extra = "[[instance]]\nleaf = \"elm\"\nposition_mm = [5, 5, 30]\n";
    let (plan, _) = planned(&scene(dir.path(), "two", "elm", Some(30.0), None, extra));
    assert!(names(&plan).0.contains(&"shadow maps"));
    assert!(plan.light.shadow_samples >= 1 && plan.light.shadow_resolution > 0);
}

#[test]
fn a_tighter_tolerance_takes_a_finer_curve_and_a_distant_view_coarser_maps() {
    let dir = tempfile::tempdir().unwrap();
    Blade { width: 384, height: 288, texel_mm: 0.125, ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let path = scene(dir.path(), "much", "elm", Some(30.0), None, "");
    let text = std::fs::read_to_string(&path).unwrap();
    let with = |from: &str, to: &str| {
        std::fs::write(&path, text.replace(from, to)).unwrap();
        planned(&path).0
    };
    let points = |p: &ScenePlan| p.measured["elm/front slab curve"].last().unwrap().setting;
    let blocks = |p: &ScenePlan| p.leaves[0].block;
    let plain = with("x", "x");
    let tight = with("tolerance = 0.004", "tolerance = 0.00004");
    assert!(points(&tight) > points(&plain));
    let far = with("[10, -25, 90]", "[100, -250, 900]");
    assert!(blocks(&far) > blocks(&plain), "{} {}", blocks(&far), blocks(&plain));
    assert!(far.left_out.iter().any(|l| l.name.contains("map detail")));
}

/// A plan is plain data. Two plans of one scene make the same decisions and have the same hash, and JSON shows all of
/// it.
#[test]
fn plans_can_be_compared() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let path = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    let (one, other) = (planned(&path).0, planned(&path).0);
    assert!(one.leaves == other.leaves && one.light == other.light && one.hash == other.hash);
    assert_eq!(names(&one), names(&other));
    let json = serde_json::to_value(&one).unwrap();
    assert_eq!(json["leaves"][0]["sides"][0]["gloss"], one.leaves[0].sides[0].gloss);
    assert_eq!(json["light"]["msaa"], one.light.msaa);
    // A plan with another decision is another plan.
    let mut less = one.clone();
    less.leaves[0].sides[0].normal = false;
    assert_ne!(less, one);
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("zenith_deg = 30", "zenith_deg = 160")).unwrap();
    assert_ne!(planned(&path).0.hash, one.hash);
}

#[test]
fn the_verb_prints_the_contract() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let path = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    let run = |args: &[&str]| {
        assert_cmd::Command::cargo_bin("mesophyll").unwrap().arg("plan").arg(&path).args(args).output().unwrap()
    };
    let json: serde_json::Value = serde_json::from_slice(&run(&["--json"]).stdout).unwrap();
    assert!(!json["needed"].as_array().unwrap().is_empty());
    for left in json["left_out"].as_array().unwrap() {
        for key in ["name", "reason", "saved"] {
            assert!(left[key].is_string(), "{left}");
        }
    }
    assert!(String::from_utf8(run(&[]).stdout).unwrap().contains("left out"));
}

#[test]
fn a_fit_that_does_not_exist_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let path = scene(dir.path(), "none", "elm", Some(30.0), None, "");
    let out = assert_cmd::Command::cargo_bin("mesophyll").unwrap().arg("plan").arg(&path).output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(said.contains("leaf \"elm\": fit: there is no fit at") && said.lines().count() == 1, "{said}");
}
