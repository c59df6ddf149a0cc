//! The gloss as a measured material (`export --to bsdf`): read back by our own reader of such files, and shown by
//! Mitsuba where it is installed. Textures of σ (`export --to sigma`).

use crate::assembled::shown;
use crate::common::{run, succeeded};
use crate::programs::python;
use mesophyll::capture::goniometer::GoniometerReadings;
use mesophyll::export::foreign::nodes::DirectionPairs;
use mesophyll::export::{ExportFormat, assemble};
use mesophyll::files::image;
use mesophyll::optics::gloss::Lobe;
use mesophyll::optics::slab;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// The mean gloss of the two texels of the sample. Their ρs sum to .16 and .12, and their slopes are m and 1.3 m.
const SIDES: [(&str, [f64; 3], f64); 2] =
    [("front", [0.045, 0.05, 0.045], 0.25 * MEAN), ("back", [0.045, 0.05, 0.045], 0.4 * MEAN)];
/// Mean slope over the first texel's, weighted with ρs.
const MEAN: f64 = (0.16 + 1.3 * 0.12) / 0.28;

#[test]
fn a_measured_material_is_the_gloss() {
    let folder = tempfile::tempdir().unwrap();
    let (lobe, n) = (Lobe::Beckmann, [0.0, 0.0, 1.0]);
    let done = assemble(&shown(lobe), ExportFormat::Bsdf, &folder.path().join("b"), true, &[]).unwrap();
    assert_eq!(done.files.len(), 3, "{:?}", done.files);
    for (side, rho_s, m) in SIDES {
        // At the file's own nodes only D is interpolated.
        let found = GoniometerReadings::read(&folder.path().join(format!("b/a_leaf_{side}.bsdf"))).unwrap();
        assert!(found.rows.len() > 300, "{}", found.rows.len());
        for (light, view, values) in &found.rows {
            let f = lobe.bounded(n, *light, *view, m);
            for c in 0..3 {
                let ours = PI * rho_s[c] * f;
                assert!(
                    (values[c] - ours).abs() < 0.01 * ours + 2e-4,
                    "{side} {light:?} {view:?}: {} {ours}",
                    values[c]
                );
            }
        }
    }
    let lost: Value = serde_json::from_slice(&std::fs::read(folder.path().join("b/loss.json")).unwrap()).unwrap();
    let front = &lost["surfaces"][0]["front"];
    let number = |name: &str| front[name].as_f64().unwrap();
    // The texels' slopes differ by 30 %, which a mean cannot hold; the table itself loses less.
    assert!(number("gloss_rms") > number("table_rms") && number("gloss_rms") < 1.0, "{front}");
    assert!(front["albedo_error"]["gloss"][1].as_f64().unwrap().abs() < 0.001, "{front}");
    // Mitsuba between the nodes, against the lobe itself.
    let mut asked = Vec::new();
    for k in 0..40u32 {
        let at = |a: f64| (f64::from(k) * a).fract();
        let direction = |x: f64, y: f64| {
            let (sin, cos) = (TAU * y).sin_cos();
            [x.sin() * cos, x.sin() * sin, x.cos()]
        };
        let (v, l) = (direction(1.2 * at(0.618034), at(0.41421)), direction(1.2 * at(0.7320508), at(0.236068)));
        let (side, rho_s, m) = SIDES[(k % 2) as usize];
        asked.push(json!([side, v, l, rho_s.map(|rho| rho * lobe.bounded(n, l, v, m))]));
    }
    // What the front's table loses by itself is stated; Mitsuba finds the same over the same directions.
    let nodes: Vec<Value> = DirectionPairs::new(lobe, SIDES[0].2)
        .all
        .iter()
        .step_by(3)
        .map(|p| json!([p.view, p.light, p.weight, lobe.bounded(n, p.light, p.view, SIDES[0].2)]))
        .collect();
    std::fs::write(folder.path().join("asked.json"), json!([asked, nodes]).to_string()).unwrap();
    let script = "
import json, mitsuba as mi
mi.set_variant('scalar_rgb')
load = lambda side: mi.load_dict({'type': 'measured', 'filename': f'b/a_leaf_{side}.bsdf'})
sides = {'front': load('front'), 'back': load('back')}
si = mi.SurfaceInteraction3f()
si.t, si.n, si.sh_frame = 1, mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Vector3f(0, 0, 1))
def f(side, v, l):
    si.wi = mi.Vector3f(*v)
    return [x / l[2] for x in sides[side].eval(mi.BSDFContext(), si, mi.Vector3f(*l))]
asked, nodes = json.load(open('asked.json'))
worst = max(abs(x - y) for side, v, l, want in asked for x, y in zip(f(side, v, l), want))
lost = [(w * (f('front', v, l)[0] / .045 - want) ** 2, w * want ** 2) for v, l, w, want in nodes]
print(json.dumps([worst, (sum(a for a, _ in lost) / sum(b for _, b in lost)) ** .5]))";
    let Some(said) = python("mitsuba", script, folder.path()) else { return };
    let [worst, rms] = [0, 1].map(|k| said[k].as_f64().unwrap());
    // The front's lobe is as high as .06.
    assert!(worst < 0.002, "{worst}");
    // A third of the directions, in single precision.
    assert!((rms / number("table_rms") - 1.0).abs() < 0.2, "{rms} {front}");
}

/// Textures of σ are in 1/m and m, and the exact slab of them reflects and transmits what was fitted.
#[test]
fn sigma_textures_are_in_metres_and_make_the_fitted_leaf() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("sigma");
    succeeded(&run(["export", "fits/elm", "--to", "sigma", "-o", &out.display().to_string()]));
    let lost: Value = serde_json::from_slice(&std::fs::read(out.join("loss.json")).unwrap()).unwrap();
    let units: Value = serde_json::from_slice(&std::fs::read(out.join("sigma.json")).unwrap()).unwrap();
    for side in ["front", "back"] {
        assert_eq!(units["textures"][format!("{side}_sigma_a.exr")]["unit"], "1/m");
        let fit = image::read_exr(Path::new(&format!("fits/elm/{side}.exr"))).unwrap();
        let read = |what: &str| image::read_exr(&out.join(format!("{side}_{what}.exr"))).unwrap();
        let (absorbing, scattering, thickness) = (read("sigma_a"), read("sigma_s"), read("thickness"));
        let mask = fit.get("mask.Y").unwrap();
        for k in (0..mask.len()).filter(|k| mask[*k] == 1.0).step_by(101) {
            let h = f64::from(thickness.get("Y").unwrap()[k]);
            for letter in ["R", "G", "B"] {
                let [a, s] = [&absorbing, &scattering].map(|maps| f64::from(maps.get(letter).unwrap()[k]));
                let exact = slab::medium::response(a, s, h);
                let fitted = |name: &str| f64::from(fit.get(&format!("{name}.{letter}")).unwrap()[k]);
                assert!((exact.rho_d - fitted("rho_d")).abs() < 1e-5, "{side} {k}: {exact:?} {}", fitted("rho_d"));
                assert!((exact.rho_t - fitted("rho_t")).abs() < 1e-5, "{side} {k}: {exact:?} {}", fitted("rho_t"));
            }
        }
        let rms = |name: &str| lost["surfaces"][0][side][name].as_f64().unwrap();
        assert!(rms("reflectance_rms") < 1e-4 && rms("transmittance_rms") < 1e-4, "{lost}");
    }
}
