//! Captures under a dome: synthesised, read and reduced, against the truth they were made from.

use mesophyll::capture::dome::synth::{self, Blade, Options};
use mesophyll::capture::dome::{Capture, Reduced, reduce};
use mesophyll::capture::manifest::SideName;
use mesophyll::capture::synth::spec::{Model, Spec};
use mesophyll::files::image::Maps;
use std::path::{Path, PathBuf};

const SIDES: [SideName; 2] = [SideName::Front, SideName::Back];

fn spec(name: &str) -> Spec {
    let root = option_env!("DOME_ROOT").unwrap_or(env!("CARGO_MANIFEST_DIR"));
    Spec::read(&Path::new(root).join(format!("data/leaves/{name}.toml"))).unwrap()
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

#[test]
fn probe() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["elm", "balata", "alpinia", "prunus"] {
        for noise in [0.0, 0.01] {
            let out = captured(dir.path(), name, &options(noise, 1));
            let (c, r) = reduced(&out);
            let f = c.truth(SideName::Front).unwrap().unwrap();
            let d = truth(&f, "thickness.Y");
            let ks: Vec<usize> = (0..d.len()).filter(|&k| r.mask[k]).collect();
            let n = ks.len() as f64;
            let bias = ks.iter().map(|&k| r.thickness[k] - f64::from(d[k])).sum::<f64>() / n;
            let sd = (ks.iter().map(|&k| (r.thickness[k] - f64::from(d[k]) - bias).powi(2)).sum::<f64>() / n).sqrt();
            println!("{name} noise {noise}: thickness bias {bias:.5} sd {sd:.5} max {} {:?}", c.manifest.thickness_max_mm, r.alignment);
            for s in SIDES {
                let t = c.truth(s).unwrap().unwrap();
                let side = r.side(s);
                for (what, map, err) in
                    [("rho_d", &side.albedo, &side.albedo_err), ("transmittance", &side.transmittance, &side.transmittance_err)]
                {
                    let mut line = format!("  {} {what}:", s.name());
                    for (c, e) in ["R", "G", "B"].iter().enumerate() {
                        let t = truth(&t, &format!("{what}.{e}"));
                        let b = ks.iter().map(|&k| map[k][c] - f64::from(t[k])).sum::<f64>() / n;
                        let sd = (ks.iter().map(|&k| (map[k][c] - f64::from(t[k]) - b).powi(2)).sum::<f64>() / n).sqrt();
                        let se = ks.iter().map(|&k| err[k][c]).sum::<f64>() / n;
                        line += &format!(" {b:.5}/{sd:.5}/{se:.5}");
                    }
                    println!("{line} hl {:?} {:?}", side.highlight, r.defects(s));
                }
                let nt = ["X", "Y", "Z"].map(|c| truth(&t, &format!("normal.{c}")).to_vec());
                let mut ang: Vec<f64> = ks
                    .iter()
                    .map(|&k| (0..3).map(|c| f64::from(nt[c][k]) * side.normal[k][c]).sum::<f64>().min(1.0).acos().to_degrees())
                    .collect();
                ang.sort_by(f64::total_cmp);
                println!(
                    "  normals {}: median {:.3} 95% {:.3} max {:.3}",
                    s.name(),
                    ang[ang.len() / 2],
                    ang[ang.len() * 95 / 100],
                    ang[ang.len() - 1]
                );
            }
        }
    }
}
