//! What the renderers get of translucency maps, and what they draw.

use super::*;
use mesophyll::scene::draw::{handover, reference};
use mesophyll::scene::manifest::TranslucencyBasis;
use mesophyll::transport::SunlitMaps;
use mesophyll_viewer::scene::{CoefficientMaps, Sides, Translucency};

#[test]
fn the_renderer_gets_the_lit_sides_coefficients_and_the_reference_the_suns_own_map() {
    let flat = Blade { dome: 0.0, ..Blade::default() };
    let dir = folder(&flat);
    let path = scene(dir.path(), "back", Some(140.0), None, "");
    let (whole, ledger) = planned(&path);
    let plan = &whole.plan;
    let drawn = handover::scene(&whole, &ledger).unwrap();
    let leaf = drawn.leaf(0).unwrap();
    assert!(leaf.sides.front.translucency.is_none() && leaf.sides.back.normal.is_none());
    let Some(Translucency { coefficients: CoefficientMaps::Factor(map), .. }) = &leaf.sides.back.translucency else {
        panic!("no factor")
    };
    assert_eq!(plan.leaves[0].block, 1);
    let k = 36 * flat.width + 40;
    let want = leaning(1, 40, 36);
    assert!((0..3).all(|i| (f64::from(map[k][i]) - want[i]).abs() < 1e-6), "{:?} {want:?}", map[k]);

    // On a flat blade, the sun has the same direction in every texel: (−sx, sy, −sz) in the back's frame.
    let world = reference::world(&whole, &ledger).unwrap();
    let (zenith, azimuth) = (140f64.to_radians(), 30f64.to_radians());
    let omega = [-zenith.sin() * azimuth.cos(), zenith.sin() * azimuth.sin(), -zenith.cos()];
    let (a, b, c) = ((1.0f64 / 6.0).sqrt(), 0.5f64.sqrt(), (1.0f64 / 3.0).sqrt());
    let axes = [[-a, -b, c], [-a, b, c], [2.0 * a, 0.0, c]];
    let f: f64 = (0..3)
        .map(|i| want[i] * (1.5 / PI).sqrt() * (axes[i][0] * omega[0] + axes[i][1] * omega[1] + axes[i][2] * omega[2]))
        .sum();
    let Some(SunlitMaps::Factor(map)) = &world.through[0].entering[1] else { panic!("no map") };
    assert!((f64::from(map[k]) - f).abs() < 1e-5, "{} {f}", map[k]);
    assert!(world.through[0].entering[0].is_none());
}

/// Σ h_i √(3/2π) H_i·ω on the back, computed from angles. The sun is `zenith` and `azimuth` degrees from the
/// front's normal and from its x. With `bent`, the bent basis is used.
fn by_angles(h: [f64; 3], zenith: f64, azimuth: f64, bent: bool) -> f64 {
    let (height, azimuth) = ((zenith - 90.0).to_radians(), PI - azimuth.to_radians());
    let share = if bent { (2.0 * height.sin() / (1.0 + height.sin())).powf(0.25) } else { 1.0 };
    // The three axes have azimuths of −120, 120 and 0 degrees, and all have the z of a cube's diagonal.
    let along = [-2.0 * PI / 3.0, 2.0 * PI / 3.0, 0.0].map(|a: f64| (azimuth - a).cos());
    (0..3).map(|i| h[i] * (share * height.cos() * along[i] * 2f64.sqrt() + height.sin()) / (2.0 * PI).sqrt()).sum()
}

#[test]
fn the_bent_basis_is_evaluated_as_it_is_stored() {
    let flat = Blade { dome: 0.0, ..Blade::default() };
    let dir = folder(&flat);
    let maps = dir.path().join("fits/elm-translucency");
    let k = 36 * flat.width + 40;
    for (basis, name) in [(TranslucencyBasis::HalfLife2, "half-life-2"), (TranslucencyBasis::Bent, "bent-3")] {
        with_basis(&maps, name);
        for zenith in [150.0, 120.0, 100.0, 91.0] {
            let path = scene(dir.path(), "back", Some(zenith), None, "");
            let (whole, ledger) = planned(&path);
            let plan = &whole.plan;
            let amount =
                plan.needed.iter().find(|n| n.name == "elm/translucency/back.exr").and_then(|n| n.amount.clone());
            assert!(amount.is_some_and(|a| a.starts_with(&format!("three coefficients a texel, {name};"))));
            let drawn = handover::scene(&whole, &ledger).unwrap();
            let stored = drawn.leaf(0).unwrap().sides.back.translucency.as_ref().expect("maps");
            assert_eq!(format!("{:?}", stored.basis), format!("{basis:?}"));
            let world = reference::world(&whole, &ledger).unwrap();
            let Some(SunlitMaps::Factor(map)) = &world.through[0].entering[1] else { panic!("no map") };
            let want = by_angles(leaning(1, 40, 36), zenith, 30.0, basis == TranslucencyBasis::Bent);
            assert!((f64::from(map[k]) - want).abs() < 1e-5, "{zenith}: {} {want}", map[k]);
        }
    }
}

/// The effect of the window's check box on the reference: without its maps, a leaf is the same as one that never
/// had maps.
#[test]
fn the_windows_reference_follows_the_maps_that_are_taken_off() {
    use mesophyll::scene::window::edit::SceneEditor;
    use mesophyll_window::editor::Editor;

    let dir = folder(&Blade::default());
    let with = scene(dir.path(), "back", Some(125.0), None, "");
    let plain = blade::scene(dir.path(), "plain", "elm", Some(125.0), None, "");
    let open = |path: &Path| {
        let manifest = SceneManifest::read(path).unwrap();
        let camera = handover::camera(&manifest.perspectives().next().unwrap().camera);
        let free =
            LoadedScene::open(manifest, LeafSearch { free: true, ..LeafSearch::default() }, &Ledger::new()).unwrap();
        let drawn = handover::scene(&free, &Ledger::new()).unwrap();
        (SceneEditor::new(free, dir.path().join("out")).unwrap(), drawn, camera)
    };
    let (mut editor, mut drawn, camera) = open(&with);
    let (mut never, bare, _) = open(&plain);
    let by_maps = editor.reference(&drawn, &camera, 40, 30).unwrap();
    let sides = &mut drawn.leaf_mut(0).unwrap().sides;
    let maps = Sides::of(|side| sides[side].translucency.take());
    assert!(maps.front.is_some() && maps.back.is_some());
    let without = editor.reference(&drawn, &camera, 40, 30).unwrap();
    assert!(without.ldr != by_maps.ldr);
    assert!(without.ldr == never.reference(&bare, &camera, 40, 30).unwrap().ldr);
    let sides = &mut drawn.leaf_mut(0).unwrap().sides;
    (sides.front.translucency, sides.back.translucency) = (maps.front, maps.back);
    assert!(editor.reference(&drawn, &camera, 40, 30).unwrap().ldr == by_maps.ldr);
}

#[test]
fn both_renderers_draw_the_same_light() {
    let dir = folder(&Blade { rho_s: [0.0, 0.0], ..Blade::default() });
    // A domed blade whose light leans. In the bent basis, the light also comes from low above its far side.
    for (basis, zenith) in [("half-life-2", 125.0), ("bent-3", 104.0)] {
        with_basis(&dir.path().join("fits/elm-translucency"), basis);
        let path = scene(dir.path(), "back", Some(zenith), None, "");
        let out = dir.path().join("out");
        let mut command = assert_cmd::Command::cargo_bin("mesophyll").unwrap();
        let output = command.arg("check").arg(&path).arg("--json").arg("--out").arg(&out).output().unwrap();
        if crate::skips::no_adapter(&output) {
            return;
        }
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(0), "{report:#}");
        let uploads = report["uploads"].as_array().unwrap();
        assert!(uploads.iter().any(|u| u["name"] == "leaf 0 back translucency"), "{report:#}");
        assert!(uploads.iter().all(|u| u["name"] != "leaf 0 back normal" && u["name"] != "leaf 0 front translucency"));
        let word = if basis.starts_with("bent") { "back bent translucency" } else { "back translucency" };
        assert!(
            report["pipelines"].as_array().unwrap().iter().any(|p| p.as_str().unwrap().contains(word)),
            "{report:#}"
        );
    }
}
