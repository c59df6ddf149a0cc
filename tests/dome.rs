//! Captures under a dome: synthesised, read and reduced, against the truth they were made from.

use mesophyll::capture::dome::synth::{self, Blade, Options};
use mesophyll::capture::dome::{Capture, Reduced, reduce};
use mesophyll::capture::manifest::SideName;
use mesophyll::capture::synth::spec::{Model, Spec};
use mesophyll::files::image::Maps;
use std::path::{Path, PathBuf};

const SIDES: [SideName; 2] = [SideName::Front, SideName::Back];

fn spec(name: &str) -> Spec {
    Spec::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("data/leaves/{name}.toml"))).unwrap()
}

/// A patch of 12 mm of a leaf in texels of 0.1 mm.
fn options(noise: f64, seed: u64) -> Options {
    Options { width: 120, height: 120, patch: Some((12.0, [0.0, 0.0])), noise, height_noise_mm: 0.01, seed, model: Model::Exact }
}

fn captured(folder: &Path, name: &str, options: &Options) -> PathBuf {
    let (spec, out) = (spec(name), folder.join(name));
    let blade = Blade::grow(&spec, options).unwrap();
    synth::capture(&spec, &blade, options, &out).unwrap();
    out
}

fn reduced(folder: &Path) -> (Capture, Reduced) {
    let capture = Capture::open(folder).unwrap();
    let reduced = reduce(&capture, &Default::default()).unwrap();
    (capture, reduced)
}

fn truth<'a>(maps: &'a Maps, name: &str) -> &'a [f32] {
    maps.get(name).unwrap()
}

/// Mean and standard deviation of `found − true` over the leaf.
fn misses(mask: &[bool], pairs: impl Fn(usize) -> (f64, f64)) -> (f64, f64) {
    let list: Vec<f64> = (0..mask.len()).filter(|&k| mask[k]).map(&pairs).map(|(found, truth)| found - truth).collect();
    let n = list.len() as f64;
    let mean = list.iter().sum::<f64>() / n;
    (mean, (list.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

fn mask_of(r: &Reduced, side: SideName) -> Vec<bool> {
    r.side(side).status.iter().map(|s| *s != 0).collect()
}

/// Without noise transmittance and normals are exact (the scans' lean stays in the normals: 0.6° at most), thickness but for its zero
/// and its trend over the patch, albedo but for what the highlight varies.
#[test]
fn an_exact_capture_gives_back_its_truth() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, r) = reduced(&captured(dir.path(), "elm", &options(0.0, 1)));
    let front = capture.truth(SideName::Front).unwrap().unwrap();
    let d = truth(&front, "thickness.Y");
    let (_, sd) = misses(&r.mask, |k| (r.thickness[k], f64::from(d[k])));
    assert!(sd < 0.02 * 0.15, "{sd}");
    for s in SIDES {
        let (maps, mask, side) = (capture.truth(s).unwrap().unwrap(), mask_of(&r, s), r.side(s));
        assert!(r.defects(s).is_empty(), "{:?}", r.defects(s));
        for (c, end) in ["R", "G", "B"].iter().enumerate() {
            let t = truth(&maps, &format!("transmittance.{end}"));
            assert!((0..t.len()).all(|k| (side.transmittance[k][c] - f64::from(t[k])).abs() < 1e-6));
            let a = truth(&maps, &format!("rho_d.{end}"));
            let veil = truth(&maps, "highlight.Y");
            let (mean, sd) = misses(&mask, |k| (side.albedo[k][c], f64::from(a[k])));
            let (veil_mean, veil_sd) = misses(&mask, |k| (f64::from(veil[k]), side.highlight.share));
            assert!((mean - veil_mean).abs() < 1e-3 && (sd - veil_sd).abs() < 1e-3, "{mean} {sd}, veil {veil_mean} {veil_sd}");
            assert!(mean.abs() < side.highlight.stderr, "{mean} {}", side.highlight.stderr);
        }
        let n = ["X", "Y", "Z"].map(|c| truth(&maps, &format!("normal.{c}")).to_vec());
        for k in (0..mask.len()).filter(|&k| mask[k]) {
            let cos: f64 = (0..3).map(|c| f64::from(n[c][k]) * side.normal[k][c]).sum();
            assert!(cos.min(1.0).acos().to_degrees() < 0.7, "{k}");
        }
    }
}

/// With noise the photographs' maps scatter as their standard errors say.
#[test]
fn the_stated_errors_are_those_met() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, r) = reduced(&captured(dir.path(), "alpinia", &options(0.01, 1)));
    for s in SIDES {
        let (maps, mask, side) = (capture.truth(s).unwrap().unwrap(), mask_of(&r, s), r.side(s));
        for (c, end) in ["R", "G", "B"].iter().enumerate() {
            let t = truth(&maps, &format!("transmittance.{end}"));
            let pull = misses(&mask, |k| ((side.transmittance[k][c] - f64::from(t[k])) / side.transmittance_err[k][c], 0.0));
            // 14400 texels: the standard error of a deviation of 1 is .006; the references' own noise is common to few texels.
            assert!(pull.0.abs() < 0.05 && (pull.1 - 1.0).abs() < 0.03, "{} {end}: {pull:?}", s.name());
            let (a, seen) = (truth(&maps, &format!("albedo.{end}")), truth(&maps, "highlight.Y"));
            let pull = misses(&mask, |k| {
                let share = 0.5 * (1.0 + side.normal[k][2]);
                let shown = side.albedo[k][c] * share + side.highlight.share;
                ((shown - f64::from(a[k] + seen[k])) / (side.albedo_err[k][c] * share), 0.0)
            });
            assert!(pull.0.abs() < 0.05 && (pull.1 - 1.0).abs() < 0.03, "{} {end}: {pull:?}", s.name());
        }
    }
    // The zero of the thickness is within its standard error, taken three times.
    let front = capture.truth(SideName::Front).unwrap().unwrap();
    let d = truth(&front, "thickness.Y");
    let (mean, _) = misses(&r.mask, |k| (r.thickness[k], f64::from(d[k])));
    assert!(mean.abs() < 3.0 * r.alignment.offset_err_mm, "{mean} {}", r.alignment.offset_err_mm);
}
