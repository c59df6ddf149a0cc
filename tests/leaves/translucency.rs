//! `mesophyll fit translucency` as a program, from a scan under a tube and from a capture under a dome.

use crate::common::{copy_tree, refused, run, scan, succeeded};
use mesophyll::files::image::read_exr;
use mesophyll::files::quantity::Quantity;
use mesophyll::optics::translucency::basis::HemisphereBasis;
use std::path::Path;

fn fit(input: &str, out: &Path, extra: &[&str]) -> std::process::Output {
    let mut args = vec!["fit", "translucency", input, "-o", out.to_str().unwrap()];
    args.extend(extra);
    run(args)
}

#[test]
fn a_leaf_fit_becomes_maps_and_one_light_is_what_the_basis_says_of_it() {
    let dir = tempfile::tempdir().unwrap();
    let (all, one) = (dir.path().join("all"), dir.path().join("one"));
    succeeded(&fit("fits/elm", &all, &[]));
    succeeded(&fit("fits/elm", &one, &["--sun-elevation-deg", "60", "--sun-azimuth-deg", "20"]));
    let (sin, cos) = 60f64.to_radians().sin_cos();
    let light = [cos * 20f64.to_radians().cos(), cos * 20f64.to_radians().sin(), sin];
    for side in ["front.exr", "back.exr"] {
        let (maps, direct) = (read_exr(&all.join(side)).unwrap(), read_exr(&one.join(side)).unwrap());
        let plane = |k: usize| maps.get(&format!("translucency.{}", k + 1)).unwrap();
        let (mask, full) = (maps.scalar(Quantity::Mask).unwrap(), direct.get("translucency.Y").unwrap());
        let leaf = read_exr(&Path::new("fits/elm").join(side)).unwrap();
        let (thickness, measured) =
            (maps.scalar(Quantity::Thickness).unwrap(), leaf.scalar(Quantity::Thickness).unwrap());
        let entering = maps.get("entering.Y").unwrap();
        for k in 0..mask.len() {
            if leaf.scalar(Quantity::Mask).unwrap()[k] == 1.0 {
                assert_eq!(thickness[k], measured[k]);
                // Light enters every texel, and no more than its largest facets can catch.
                assert!(entering[k] > 0.0 && entering[k] < 5.0, "{side} {k}: {}", entering[k]);
            }
        }
        let (mut off, mut size, mut mean, mut count) = (0.0, 0.0, 0.0, 0.0);
        for k in (0..mask.len()).filter(|&k| mask[k] == 1.0) {
            let found: f64 = (0..3).map(|i| f64::from(plane(i)[k]) * HemisphereBasis::HalfLife2.value(i, light)).sum();
            let full = f64::from(full[k]);
            (off, size) = (off + (found - full).powi(2), size + full * full);
            (mean, count) = (mean + full, count + 1.0);
        }
        // The three functions are compared with the whole convolution. The mean over the leaf follows n·ω.
        assert!((off / size).sqrt() < 0.05, "{side}: {}", (off / size).sqrt());
        assert!((mean / count / sin - 1.0).abs() < 0.03, "{side}: {}", mean / count);
    }
    // The same command again computes nothing.
    let written = std::fs::metadata(all.join("front.exr")).unwrap().modified().unwrap();
    succeeded(&fit("fits/elm", &all, &[]));
    assert_eq!(written, std::fs::metadata(all.join("front.exr")).unwrap().modified().unwrap());
    // The report recognises the kind of fit.
    let report = run(["report", all.to_str().unwrap(), "--json"]);
    succeeded(&report);
    let json: serde_json::Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!(json["fits"][0]["kind"], "translucency");
}

/// The page shows what a fit stores: every coefficient of a side, thickness, light that enters, and errors by the
/// light's angle.
#[test]
fn the_report_shows_the_maps() {
    let dir = tempfile::tempdir().unwrap();
    for (name, extra, pictures, said) in [
        // For each side: three lights, three coefficients, thickness, light that enters.
        (
            "one",
            vec![],
            8,
            vec!["Coefficients of f on half-life-2", "azimuth \u{2212}120°, 35° over the blade", "0.836 each"],
        ),
        // The coefficients as colours, and as three wavelengths.
        ("rgb", vec!["--colour", "three-wavelengths"], 17, vec!["Coefficients of M", "as colours", "8 blue"]),
        ("nine", vec!["--basis", "hemispherical"], 14, vec!["Coefficients of f on hemispherical-9", "function 9"]),
        (
            "sun",
            vec!["--sun-elevation-deg", "60", "--sun-azimuth-deg", "20"],
            3,
            vec!["under light 60° over the blade, azimuth 20°"],
        ),
    ] {
        let (out, page) = (dir.path().join(name), dir.path().join(format!("{name}.html")));
        succeeded(&fit("fits/elm", &out, &extra));
        succeeded(&run(["report", out.to_str().unwrap(), "-o", page.to_str().unwrap()]));
        let page = std::fs::read_to_string(page).unwrap();
        assert_eq!(page.matches("<img src=\"data:image/png;base64,").count(), 2 * pictures, "{name}");
        for part in said.into_iter().chain([
            "Light that enters the back",
            "<h4>Thickness",
            "even sky",
            "How it was made",
            "horizon map",
        ]) {
            assert!(page.contains(part), "{name}: {part}");
        }
        assert!(!page.contains("no name in this version"), "{name}: a figure without a name");
        let judged = page.contains("95 % of the texels within") || page.contains("95\u{a0}% of the texels within");
        assert_eq!(judged, name != "sun", "{name}");
        assert_eq!(page.contains("the stored directions keep the light that comes through to within"), name != "sun");
    }
}

/// In three wavelengths, a flat uniform leaf transmits what the slab says. The mean over the elm is near its ρt, in
/// each channel.
#[test]
fn three_wavelengths_let_through_what_the_light_box_measured() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("rgb");
    let steep = ["--colour", "three-wavelengths", "--sun-elevation-deg", "90", "--sun-azimuth-deg", "0"];
    succeeded(&fit("fits/elm", &out, &steep));
    let (maps, leaf) = (read_exr(&out.join("front.exr")).unwrap(), read_exr(Path::new("fits/elm/front.exr")).unwrap());
    let mask = maps.scalar(Quantity::Mask).unwrap();
    for c in ["R", "G", "B"] {
        let mean = |plane: &[f32]| {
            let on: Vec<f64> = plane.iter().zip(mask).filter(|(_, m)| **m == 1.0).map(|(v, _)| f64::from(*v)).collect();
            on.iter().sum::<f64>() / on.len() as f64
        };
        let through = mean(maps.get(&format!("translucency.{c}")).unwrap());
        let measured = mean(leaf.get(&format!("rho_t.{c}")).unwrap());
        // Tilted texels catch a few per cent less of a steep light than the flat texel of the slab.
        assert!((0.93..1.01).contains(&(through / measured)), "{c}: {through} {measured}");
    }
}

#[test]
fn a_capture_under_a_dome_goes_the_same_way() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, out) = (dir.path().join("dome"), dir.path().join("tr"));
    let synth = [
        "synth",
        "data/leaves/elm.toml",
        "--acquisition",
        "dome",
        "-o",
        capture.to_str().unwrap(),
        "--size",
        "96x72",
        "--patch-mm",
        "9",
    ];
    succeeded(&run(synth));
    succeeded(&fit(capture.to_str().unwrap(), &out, &[]));
    assert!(
        out.join("leaf/fit.toml").is_file() && out.join("leaf/blade.glb").is_file() && out.join("back.exr").is_file()
    );
    let record = std::fs::read_to_string(out.join("leaf/fit.toml")).unwrap();
    let record: toml::Table = record.parse().unwrap();
    let front = &record["front"];
    // The value is within three of its standard errors of the specification's σa (11.4 in green).
    let (value, err) =
        (front["sigma_a"]["value"][1].as_float().unwrap(), front["sigma_a"]["stderr"][1].as_float().unwrap());
    assert!((value - 11.4).abs() < 3.0 * err && err < 0.2 * value, "{value} {err}");
    assert!(front["truth"]["rho_t"]["coverage95"].as_float().unwrap() > 0.9);
    // A tube's options are refused here, and a dome's options there.
    let leaf = |extra: &[&str]| {
        let mut args = vec!["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap()];
        args.extend(extra);
        run(args)
    };
    refused(&leaf(&["--shard", "1/2"]), 2, &["--shard", "dome"]);
    refused(&leaf(&["--gloss", "9,0.3"]), 2, &["--gloss", "9"]);
}

#[test]
fn what_is_no_leaf_fit_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    refused(&fit(dir.path().to_str().unwrap(), &out, &[]), 2, &["no leaf fit", "fit leaf"]);
    refused(&fit("fits/elm-twig", &out, &[]), 2, &["kind", "expected \"leaf\""]);
    refused(&fit("fits/elm", &out, &["--a", "0.5"]), 2, &["--a", "0.5", "at least 1"]);
    refused(&fit("fits/elm", &out, &["--sigma-a", "0.4", "--sigma-s", "10", "--g", "1.5"]), 2, &["--g", "1.5"]);
    refused(
        &fit("fits/elm", &out, &["--form", "images", "--sigma-a", "0.1", "--sigma-s", "2"]),
        1,
        &["mean free path", "thin"],
    );
    let tube = scan(dir.path(), "elm", &["--size", "24x18", "--frames", "8"]);
    refused(&fit(tube.to_str().unwrap(), &out, &[]), 2, &["scan under a tube", "fit leaf"]);
    // One of the maps is truncated.
    let damaged = dir.path().join("damaged");
    copy_tree(Path::new("fits/elm"), &damaged);
    let bytes = std::fs::read(damaged.join("front.exr")).unwrap();
    std::fs::write(damaged.join("front.exr"), &bytes[..bytes.len() / 2]).unwrap();
    refused(&fit(damaged.to_str().unwrap(), &out, &[]), 2, &["front.exr"]);
    assert!(!out.join("fit.toml").exists());
}

/// A wrong -o destroys neither a fit nor a capture.
#[test]
fn nothing_fitted_or_measured_is_overwritten_by_another_kind_of_fit() {
    let dir = tempfile::tempdir().unwrap();
    let [leaf, maps, capture] = ["leaf", "maps", "capture"].map(|n| dir.path().join(n));
    copy_tree(Path::new("fits/elm"), &leaf);
    std::fs::create_dir(&capture).unwrap();
    std::fs::write(capture.join("capture.toml"), "schema = 1\n").unwrap();
    let before = std::fs::read(leaf.join("fit.toml")).unwrap();
    let from = leaf.to_str().unwrap();
    refused(&fit(from, &leaf, &[]), 2, &[from, "is what is to be read"]);
    refused(&fit("fits/elm", &leaf, &[]), 2, &[from, "holds the leaf fit \"elm\""]);
    refused(&fit(from, &capture, &[]), 2, &[capture.to_str().unwrap(), "holds a capture"]);
    assert_eq!(std::fs::read(leaf.join("fit.toml")).unwrap(), before);
    // A map that was changed after the fit is detected.
    std::fs::copy(leaf.join("back.exr"), leaf.join("front.exr")).unwrap();
    refused(&fit(from, &maps, &[]), 1, &["front.exr", "changed since it was fitted"]);
}
