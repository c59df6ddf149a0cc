//! A fit with one side in a scene: refused, unless the scene says what stands for the other one.

use crate::common::{copy_tree, refused, run, succeeded};
use mesophyll::fits::leaf_folder::LeafFit;
use mesophyll::fits::record::FitRecord;
use mesophyll::scene::draw::reference;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::transport::{ReferenceInterior, ReferenceLeaf, ReferenceSide};
use std::path::{Path, PathBuf};

/// The committed elm as if only this side had been scanned.
fn one_sided(folder: &Path, kept: &str, lost: &str) -> PathBuf {
    let fit = folder.join(format!("only-{kept}"));
    copy_tree(Path::new("fits/elm"), &fit);
    let mut record = FitRecord::read(&fit).unwrap();
    record.sections.remove(lost).unwrap();
    record.sections.remove("sides");
    let gone: Vec<String> = record.files.keys().filter(|name| name.starts_with(lost)).cloned().collect();
    for name in gone {
        record.files.remove(&name);
        std::fs::remove_file(fit.join(name)).unwrap();
    }
    record.write(&fit).unwrap();
    assert_eq!(LeafFit::open(&fit).unwrap().sides().count(), 1);
    fit
}

/// A scene that shows both sides, lit from above and from the sky.
fn scene(folder: &Path, fit: &Path, more: &str) -> PathBuf {
    let path = folder.join("scene.toml");
    let fit = fit.display();
    let views = [("above", 130), ("below", -130)].map(|(name, height)| {
        format!(
            "[[view]]\nname = \"{name}\"\nkind = \"perspective\"\neye_mm = [0, -35, {height}]\ntarget_mm = [0, 0, \
             0]\nfov_deg = 26\nflip_p99 = 0.2\nmax_error = 0.15\n"
        )
    });
    let text = format!(
        "schema = 1\nname = \"one-sided\"\ntolerance = 0.05\n[[leaf]]\nname = \"elm\"\nfit = \"{fit}\"\n{more}\n\
         [[instance]]\nleaf = \"elm\"\n[sun]\nzenith_deg = 30\nazimuth_deg = 60\nirradiance = [3, 3, 3]\n\
         [sky]\nradiance = [0.3, 0.3, 0.3]\n{}[check]\nwidth = 96\nheight = 72\nsamples = 32\n",
        views.concat()
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn leaf(scene: &Path) -> ReferenceLeaf {
    let ledger = Ledger::new();
    let loaded = LoadedScene::open(SceneManifest::read(scene).unwrap(), LeafSearch::default(), &ledger).unwrap();
    reference::world(&loaded, &ledger).unwrap().leaves.remove(0)
}

/// ρd and ρt of every texel of a side.
fn inside(side: &ReferenceSide) -> Vec<[f64; 6]> {
    let ReferenceInterior::Scalars { gamma, thickness, curve } = &side.interior else { panic!("scalars") };
    let one = |k: usize| {
        let (rho_d, rho_t) = curve(f64::from(thickness[k]));
        let d = [0, 1, 2].map(|c| f64::from(gamma[c][k]) * rho_d[c]);
        [d[0], d[1], d[2], rho_t[0], rho_t[1], rho_t[2]]
    };
    (0..thickness.len()).map(one).collect()
}

/// The texel that lies behind another, counted by row and column.
fn behind(k: usize, width: usize) -> usize {
    let (row, column) = (k / width, k % width);
    row * width + (width - 1 - column)
}

fn refused_with(scene: &Path, words: &[&str]) {
    refused(&run(["plan", scene.to_str().unwrap()]), 2, words);
}

#[test]
fn a_side_that_is_shown_and_not_there_is_refused_with_both_ways_out() {
    let dir = tempfile::tempdir().unwrap();
    let fit = one_sided(dir.path(), "front", "back");
    let words = ["shows the back", "only-front", "other_side = \"mirrored\"", "other_side = { rho_d = [...] }"];
    refused_with(&scene(dir.path(), &fit, ""), &words);
}

/// Every texel of the back is what lies before it on the front; its relief points outwards there as it does here.
#[test]
fn a_mirrored_side_is_the_other_one_seen_from_behind() {
    let dir = tempfile::tempdir().unwrap();
    for (kept, lost) in [("front", "back"), ("back", "front")] {
        let fit = one_sided(dir.path(), kept, lost);
        let ReferenceLeaf { width, front, back, .. } = leaf(&scene(dir.path(), &fit, "other_side = \"mirrored\""));
        let (a, b) = (inside(&front), inside(&back));
        let gloss = [&front, &back].map(|s| s.gloss.clone().unwrap());
        let normals = [&front, &back].map(|s| s.normal.clone().unwrap().values);
        let mut bumps = 0;
        for k in 0..a.len() {
            let j = behind(k, width);
            (0..6).for_each(|q| assert!((a[j][q] - b[k][q]).abs() < 1e-12, "{kept} {k} {q}"));
            assert_eq!(gloss[0].m[j], gloss[1].m[k]);
            (0..3).for_each(|c| assert_eq!(gloss[0].rho_s[c][j], gloss[1].rho_s[c][k]));
            let (n, m) = (normals[0][j], normals[1][k]);
            let off = [n[0] + m[0], n[1] - m[1], n[2] - m[2]].map(f32::abs).into_iter().fold(0.0, f32::max);
            assert!(off < 2e-5, "{kept} {k}: {n:?} {m:?}");
            bumps += usize::from(n[0].abs() > 0.02);
        }
        assert!(bumps > 100, "the relief is not flat: {bumps}");
    }
}

/// A stated side reflects what is stated, lets through what was measured, and is smooth.
#[test]
fn a_stated_side_reflects_what_is_stated() {
    let dir = tempfile::tempdir().unwrap();
    let fit = one_sided(dir.path(), "front", "back");
    let more = "other_side = { rho_d = [0.11, 0.15, 0.06], rho_s = [0.01, 0.01, 0.01], m = 0.3 }";
    let ReferenceLeaf { width, front, back, .. } = leaf(&scene(dir.path(), &fit, more));
    let (a, b) = (inside(&front), inside(&back));
    for k in 0..a.len() {
        for (c, stated) in [0.11, 0.15, 0.06].into_iter().enumerate() {
            assert!((b[k][c] - stated).abs() < 1e-6, "{k}: {:?}", b[k]);
            assert!((b[k][3 + c] - a[behind(k, width)][3 + c]).abs() < 1e-12);
        }
    }
    let gloss = back.gloss.unwrap();
    assert!(gloss.m.iter().all(|m| *m == 0.3) && gloss.rho_s.iter().flatten().all(|v| *v == 0.01));
    let straight = |n: &[f32; 3]| n[0].abs() < 1e-5 && n[1].abs() < 1e-5 && (n[2] - 1.0).abs() < 1e-5;
    assert!(back.normal.unwrap().values.iter().all(straight));
}

/// The plan says that the side was not measured, and so do the check and its JSON; both renderers draw the same leaf.
#[test]
fn it_is_said_that_the_side_was_not_measured() {
    let dir = tempfile::tempdir().unwrap();
    let fit = one_sided(dir.path(), "front", "back");
    let scene = scene(dir.path(), &fit, "other_side = \"mirrored\"");
    let said = "the back was not measured: it mirrors the front";
    let planned = run(["plan", scene.to_str().unwrap()]);
    succeeded(&planned);
    assert!(String::from_utf8_lossy(&planned.stdout).contains(said), "{planned:?}");
    #[cfg(feature = "render")]
    {
        let out = dir.path().join("out");
        let checked = run(["check", scene.to_str().unwrap(), "-o", out.to_str().unwrap(), "--json"]);
        if crate::skips::no_adapter(&checked) {
            return;
        }
        let found = crate::json(&checked);
        assert_eq!(found["stated"][0], format!("elm: {said}"), "{found}");
        assert_eq!(found["passed"], true, "{found}");
    }
}

#[test]
fn words_that_say_nothing_of_the_other_side_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let fit = one_sided(dir.path(), "front", "back");
    for (more, words) in [
        ("other_side = \"mirored\"", &["other_side", "mirored", "\"mirrored\""][..]),
        ("other_side = { rho_t = [0, 0, 0] }", &["other_side", "rho_t", "rho_d"]),
        ("other_side = { rho_d = [0.1, 0.1, 1.5] }", &["other_side", "1.5", "rho_d"]),
        ("other_side = { rho_d = [0.99, 0.1, 0.1] }", &["other_side", "0.99", "through", "at most 1"]),
        ("interior = \"maps\"\nother_side = { rho_d = [0.1, 0.1, 0.1] }", &["other_side", "scalars"]),
        ("translucency = {}\nother_side = \"mirrored\"", &["other_side", "translucency"]),
    ] {
        refused_with(&scene(dir.path(), &fit, more), words);
    }
    let both = Path::new("fits/elm").canonicalize().unwrap();
    refused_with(&scene(dir.path(), &both, "other_side = \"mirrored\""), &["other_side", "has both sides"]);
}
