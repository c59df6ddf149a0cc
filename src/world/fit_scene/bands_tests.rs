//! Spectra of leaves and soil from reflectance factors of bands.

use super::*;
use mesophyll_scene::draw::bands::surfaces;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_transport::path::SurfaceBands;
use std::fmt::Write;

/// Wavelengths (nm) of ten bands of a satellite, with the leaf's R and T and the soil's albedo.
const TRUTH: [[f64; 4]; 10] = [
    [443.0, 0.04, 0.01, 0.07],
    [490.0, 0.05, 0.02, 0.09],
    [560.0, 0.11, 0.09, 0.12],
    [665.0, 0.05, 0.03, 0.16],
    [705.0, 0.15, 0.14, 0.18],
    [740.0, 0.38, 0.36, 0.2],
    [783.0, 0.46, 0.44, 0.22],
    [865.0, 0.47, 0.45, 0.24],
    [1610.0, 0.33, 0.3, 0.32],
    [2190.0, 0.14, 0.11, 0.28],
];

/// A canopy of level and leaning discs over soil. Spectra are `by` times the true ones.
fn canopy(folder: &Path, by: f64, tables: &str) -> String {
    let (mut leaf, mut soil) = (String::from("wavelength_nm,R,T\n"), String::from("wavelength_nm,albedo\n"));
    for [nm, r, t, a] in TRUTH {
        let _ = writeln!(leaf, "{nm},{},{}", by * r, by * t);
        let _ = writeln!(soil, "{nm},{}", by * a);
    }
    let mut discs = String::new();
    for k in 0..40 {
        let f = f64::from(k);
        let at = [0.45 * (2.1 * f).sin(), 0.45 * (1.3 * f).cos(), 0.2 + 0.02 * f];
        let up = [0.7 * (0.7 * f).sin(), 0.7 * (1.9 * f).cos(), 1.0];
        let _ = writeln!(discs, "0.1 {} {} {} {} {} {}", at[0], at[1], at[2], up[0], up[1], up[2]);
    }
    for (name, text) in [("leaf.csv", leaf), ("soil.csv", soil), ("discs.txt", discs)] {
        std::fs::write(folder.join(name), text).unwrap();
    }
    format!(
        "schema = 1\nname = \"bands\"\n[periodic]\nsize_mm = [1000, 1000]\n[ground]\nspectrum = \"soil.csv\"\n\
         [[leaf]]\nname = \"a\"\ndiscs = \"discs.txt\"\nuniform = {{ spectrum = \"leaf.csv\" }}\n\
         [[instance]]\nleaf = \"a\"\n[sun]\nzenith_deg = 30\nirradiance = [1, 1, 1]\n\
         [[view]]\nname = \"v\"\nkind = \"perspective\"\neye_mm = [0, 0, 9000]\ntarget_mm = [0, 0, 0]\n\
         up = [0, 1, 0]\nfov_deg = 10\n{tables}"
    )
}

/// Opens the scene of this text, as the command does: bands need no colours.
fn opened(folder: &Path, text: &str) -> Result<LoadedScene> {
    std::fs::write(folder.join("scene.toml"), text).unwrap();
    with_bands(SceneManifest::read(&folder.join("scene.toml"))?)
}

fn with_bands(mut manifest: SceneManifest) -> Result<LoadedScene> {
    manifest.forget_colours();
    LoadedScene::open(manifest, LeafSearch::default(), &Ledger::new())
}

/// A table of a canopy's factors at all of its bands but those in `without`, with errors of 0.3 %.
fn measured(folder: &Path, directions: u32, seed: u64, without: &[f64]) -> String {
    let scene = opened(folder, &canopy(folder, 1.0, "")).unwrap();
    let nm: Vec<f64> = TRUTH.iter().map(|band| band[0]).filter(|nm| !without.contains(nm)).collect();
    let (of, world) = (surfaces(&scene, &nm).unwrap(), reference::traced(&scene, 0.0, &Ledger::new()).unwrap());
    // Each band has paths of its own, so that noise is independent.
    let one = |list: &[f64], b: usize| vec![list[b]];
    let alone = |b: usize| -> Vec<SurfaceBands> {
        let of = of.iter();
        of.map(|s| SurfaceBands { rho_d: [one(&s.rho_d[0], b), one(&s.rho_d[1], b)], rho_t: one(&s.rho_t, b) })
            .collect()
    };
    let traced: Vec<_> =
        (0..nm.len()).map(|b| (Canopy::new(&world, 100 * seed + b as u64).unwrap(), alone(b))).collect();
    let mut text = String::from("view_zenith_deg,view_azimuth_deg");
    nm.iter().for_each(|nm| text += &format!(",brf_{nm},brf_{nm}_err"));
    for k in 0..directions {
        let [zenith, azimuth] = [f64::from(7 * k % 71), f64::from(50 * k % 360)];
        let at = [zenith.to_radians(), azimuth.to_radians()];
        let _ = write!(text, "\n{zenith},{azimuth}");
        for (canopy, of) in &traced {
            let found = canopy.brf_of_bands(at, of, 1, 8192).unwrap()[0];
            let _ = write!(text, ",{},{}", found.mean, found.error.hypot(0.003 * found.mean));
        }
    }
    text + "\n"
}

const UNKNOWN: &str = "[unknown]\nleaves = { a = [\"rho_d\", \"rho_t\"] }\nground = [\"albedo\"]\n";
const OPTIONS: Options = Options { samples: 64, seed: 5, force: true };

/// Ten bands of two tables, one of which lacks a band, from spectra that are wrong by a factor of 1.6.
#[test]
fn reflectance_factors_of_ten_bands_give_spectra() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (measured(folder.path(), 14, 3, &[]), measured(folder.path(), 10, 4, &[865.0]));
    let tables = format!("[[brf]]\nfile = \"one.csv\"\n[[brf]]\nfile = \"two.csv\"\n{UNKNOWN}");
    let text = canopy(folder.path(), 0.625, &tables);
    std::fs::write(folder.path().join("one.csv"), one).unwrap();
    std::fs::write(folder.path().join("two.csv"), two).unwrap();
    let scene = opened(folder.path(), &text).unwrap();
    let out = folder.path().join("fit");
    let FitOutcome::Done(record) = run(&scene, &out, &OPTIONS, &Ledger::new()).unwrap() else { panic!("not fitted") };
    assert!(record.termination.is_some_and(|t| t.converged()) && record.faults.is_empty(), "{:?}", record.faults);
    let params = &record.sections["all"].params;
    assert_eq!(params.len(), 30);
    let (mut inside, mut known) = (0, 0);
    for [nm, r, t, a] in TRUTH {
        for (name, truth) in [("leaf.a.rho_d", r), ("leaf.a.rho_t", t), ("ground.albedo", a)] {
            let param = &params[&format!("{name}.{nm}nm")];
            let z = (param.value[0] - truth) / param.stderr[0];
            assert!(z.abs() < 4.5 && param.undetermined.is_empty(), "{name}.{nm}nm: {param:?}, {truth} is true");
            known += usize::from(param.stderr[0] < 0.03);
            inside += usize::from(z.abs() < 1.96);
        }
    }
    assert!(inside >= 24 && known >= 25, "{inside} of 30 intervals hold, {known} are narrow");
    // What was found is spectra that other verbs read.
    let found = SceneManifest::read(&out.join(SCENE)).unwrap();
    let read = found.wavelengths().unwrap();
    assert_eq!(read, TRUTH.map(|band| band[0]));
    let found = with_bands(found).unwrap();
    let again = surfaces(&found, &[865.0]).unwrap();
    assert!((again[0].rho_t[0] - params["leaf.a.rho_t.865nm"].value[0]).abs() < 1e-6);
    assert!((again[1].rho_d[0][0] - params["ground.albedo.865nm"].value[0]).abs() < 1e-6);
    let residuals = std::fs::read_to_string(out.join("residual-brf-2.csv")).unwrap();
    assert!(residuals.starts_with("view_zenith_deg,view_azimuth_deg,brf_443,") && residuals.contains(",residual_865,"));
    assert_eq!(residuals.lines().count(), 11);
}

#[test]
fn tables_of_bands_that_cannot_be_used_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("good.csv", "view_zenith_deg,brf_560,brf_560_err\n0,0.2,0.01\n20,0.2,0.01\n");
    write("mixed.csv", "view_zenith_deg,brf_560,brf_r\n0,0.2,0.2\n");
    write("far.csv", "view_zenith_deg,brf_560,brf_2300\n0,0.2,0.2\n");
    write("micro.csv", "view_zenith_deg,brf_0.56\n0,0.2\n");
    write("negative.csv", "view_zenith_deg,brf_560,brf_560_err\n0,-0.2,0.01\n");
    write("bare.csv", "view_zenith_deg,brf_560\n0,0.2\n");
    write("channels.csv", "view_zenith_deg,brf_r,brf_g,brf_b\n0,0.2,0.2,0.2\n");
    let tables = |name: &str| format!("[[brf]]\nfile = \"{name}\"\n{UNKNOWN}");
    let many: String = (0..65).map(|k| format!(",brf_{}", 500 + k)).collect();
    write("many.csv", &format!("view_zenith_deg{many}\n0{}\n", ",0.2".repeat(65)));
    for (text, expected) in [
        (tables("mixed.csv"), "brf_r: found beside brf_560; expected factors of channels or of wavelengths"),
        (tables("far.csv"), "2300 nm is asked for; expected a spectrum that covers it"),
        (tables("micro.csv"), "brf_0.56: no wavelength; expected a number of nm"),
        (tables("negative.csv"), "line 2: found 0° and -0.2, expected a zenith below 89.9° and factors of at least 0"),
        (tables("bare.csv"), "brf[0].noise: missing; "),
        (tables("many.csv"), "its tables have 65 wavelengths, expected at most 64"),
        (
            format!("[[brf]]\nfile = \"channels.csv\"\n{}", tables("good.csv")),
            "channels.csv has channels; expected one",
        ),
        (
            tables("good.csv").replace("\"rho_t\"", "\"rho_s\""),
            "found \"rho_s\", expected some of rho_d, rho_t, the num",
        ),
    ] {
        let noisy = text.replace("far.csv\"\n", "far.csv\"\nnoise = 0.01\n");
        let out = folder.path().join("refused");
        let error = opened(folder.path(), &canopy(folder.path(), 0.6, &noisy))
            .and_then(|scene| run(&scene, &out, &OPTIONS, &Ledger::new()))
            .unwrap_err();
        assert!(error.to_string().contains(expected), "{error}\nexpected {expected}");
        assert!(!out.exists());
    }
}
