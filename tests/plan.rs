//! The plan: what a scene needs, what is left out, and that nothing else is touched.

mod blade;

use blade::{Blade, scene};
use mesophyll::scene::ledger::Ledger;
use mesophyll::scene::manifest::Manifest;
use mesophyll::scene::plan::{self, Plan};
use std::path::Path;

fn planned(path: &Path) -> (Plan, Ledger) {
    let ledger = Ledger::new();
    let plan = plan::make(&Manifest::read(path).unwrap(), None, None, &ledger).unwrap();
    (plan, ledger)
}

fn names(plan: &Plan) -> (Vec<&str>, Vec<&str>) {
    (plan.needed.iter().map(|n| n.name.as_str()).collect(), plan.left_out.iter().map(|n| n.name.as_str()).collect())
}

#[test]
fn a_front_lit_matte_leaf_needs_neither_back_nor_gloss_nor_sky() {
    let dir = tempfile::tempdir().unwrap();
    Blade { rho_s: [0.0, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let (plan, ledger) = planned(&scene(dir.path(), "front", "elm", Some(30.0), None, ""));
    let (needed, left) = names(&plan);
    for name in ["fit elm", "elm/blade.glb", "elm/front_gamma_delta.exr", "elm/front_normal.exr", "elm/front.exr", "sun"] {
        assert!(needed.contains(&name), "{name} of {needed:?}");
    }
    for name in [
        "elm/back_gamma_delta.exr",
        "elm/back_normal.exr",
        "elm/back_rho_s_m.exr",
        "elm/front_rho_s_m.exr",
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
    // Nothing of the back was opened.
    assert!(ledger.entries().iter().all(|e| !e.what.contains("back")), "{:?}", ledger.entries());
    assert_eq!(ledger.count("curve", "slab curve"), 1);
}

#[test]
fn light_through_the_leaf_asks_for_the_far_sides_transmittance() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let (plan, _) = planned(&scene(dir.path(), "back", "elm", Some(160.0), None, ""));
    let (needed, left) = names(&plan);
    for name in ["elm/back_gamma_delta.exr", "elm/back_normal.exr", "elm/back slab curve"] {
        assert!(needed.contains(&name), "{name} of {needed:?}");
    }
    for name in ["elm/front_gamma_delta.exr", "elm/front_normal.exr", "elm/front_rho_s_m.exr"] {
        assert!(left.contains(&name), "{name} of {left:?}");
    }
}

#[test]
fn a_constant_sky_alone_asks_for_both_interiors_and_no_normals() {
    let dir = tempfile::tempdir().unwrap();
    Blade { rho_s: [0.0, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let (plan, _) = planned(&scene(dir.path(), "sky", "elm", None, Some(1.0), ""));
    let (needed, left) = names(&plan);
    for name in ["elm/front_gamma_delta.exr", "elm/back_gamma_delta.exr", "sky"] {
        assert!(needed.contains(&name), "{name} of {needed:?}");
    }
    for name in ["elm/front_normal.exr", "elm/back_normal.exr", "sun and shadow maps"] {
        assert!(left.contains(&name), "{name} of {left:?}");
    }
}

#[test]
fn gloss_is_kept_where_it_shows_and_left_out_where_it_does_not() {
    let dir = tempfile::tempdir().unwrap();
    for (rho_s, kept) in [(0.05, true), (1e-5, false)] {
        Blade { rho_s: [rho_s, 0.0], ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
        let (plan, _) = planned(&scene(dir.path(), "gloss", "elm", Some(30.0), None, ""));
        assert_eq!(names(&plan).0.contains(&"elm/front_rho_s_m.exr"), kept, "rho_s {rho_s}");
    }
}

#[test]
fn a_leaf_nobody_places_is_not_even_opened() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    Blade::default().write(&dir.path().join("fits/spare"), "spare");
    let path = scene(dir.path(), "spare", "elm", Some(30.0), None, "[[leaf]]\nname = \"spare\"\nfit = \"fits/spare\"\n");
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
    assert!(plan.shadow_samples >= 1 && plan.shadow_resolution > 0);
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
    let points = |p: &Plan| p.measured["elm/front slab curve"].last().unwrap().setting;
    let blocks = |p: &Plan| p.leaves[0].block;
    let plain = with("x", "x");
    let tight = with("tolerance = 0.004", "tolerance = 0.00004");
    assert!(points(&tight) > points(&plain));
    let far = with("[10, -25, 90]", "[100, -250, 900]");
    assert!(blocks(&far) > blocks(&plain), "{} {}", blocks(&far), blocks(&plain));
    assert!(far.left_out.iter().any(|l| l.name.contains("map detail")));
}

#[test]
fn the_verb_prints_the_contract() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let path = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    let run = |args: &[&str]| assert_cmd::Command::cargo_bin("mesophyll").unwrap().arg("plan").arg(&path).args(args).output().unwrap();
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
