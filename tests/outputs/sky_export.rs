//! `mesophyll export` of a sky fit. Its files are compiled and run, and compared with evaluation by the library.

use crate::common::skips::{self, Need};
use crate::common::{refused, run, succeeded};
use mesophyll::fits::sky::{SkyFitForm, folder};
use mesophyll::sky::irradiance::add_ground;
use serde_json::Value;
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Suns from the zenith to the horizon, and turbidities over the whole range.
fn skies() -> Vec<(f64, f64)> {
    let suns = [0.0, 0.2, 0.5, 0.785, 1.0, 1.2, 1.4, 1.5, 1.56, FRAC_PI_2];
    suns.iter().flat_map(|s| [2.5, 2.7, 3.3, 4.2, 5.1, 6.0].map(|t| (*s, t))).collect()
}

fn fit(dir: &Path, method: &str) -> PathBuf {
    let out = dir.join(method);
    succeeded(&run(["fit", "sky", "--quiet", "--method", method, "-o", out.to_str().unwrap()]));
    out
}

fn export(folder: &Path, to: &Path, extra: &[&str]) -> String {
    let format = to.extension().unwrap().to_str().unwrap();
    let format = if format == "h" { "c" } else { format };
    let mut args = vec!["export", folder.to_str().unwrap(), "--quiet", "--to", format, "-o", to.to_str().unwrap()];
    args.extend(extra);
    succeeded(&run(args));
    std::fs::read_to_string(to).unwrap()
}

/// The library's own evaluation of the folder, in f64 from the stored arrays, with ground of this albedo.
fn library(folder: &Path, ground: f64) -> Vec<Vec<[f64; 3]>> {
    let (_, form) = folder::read(folder).unwrap();
    skies()
        .iter()
        .map(|(s, t)| {
            let c = match &form {
                SkyFitForm::Folded(f) => f.to::<f64>().coefficients(*s, *t).unwrap(),
                SkyFitForm::Tensor(f) => f.to::<f64>().coefficients(*s, *t).unwrap(),
            };
            if ground > 0.0 { add_ground(&c, [ground; 3], [0.0; 3]) } else { c }.values().to_vec()
        })
        .collect()
}

/// Largest difference, relative to c00 of its sky.
fn worst(got: &[f64], want: &[Vec<[f64; 3]>]) -> f64 {
    assert_eq!(got.len(), want.iter().map(|w| 3 * w.len()).sum::<usize>());
    let mut at = got.iter();
    let mut out = 0.0f64;
    for sky in want {
        for v in sky {
            for (k, w) in v.iter().enumerate() {
                let off = (at.next().unwrap() - w).abs() / sky[0][k];
                assert!(off.is_finite());
                out = out.max(off);
            }
        }
    }
    out
}

/// The largest differences relative to c00 that docs/evidence/sky.md states, times one and a half: C in float 2e-7, in
/// double 2e-15, JSON 3e-15. WGSL uses single precision throughout, with recurrences of 30 steps, and its adapter
/// chooses the rounding: 2e-6, times two.
const SINGLE: f64 = 3e-7;
const DOUBLE: f64 = 3e-15;
const JSON: f64 = 4.5e-15;
const WGSL: f64 = 4e-6;

#[test]
fn the_c_header_compiles_and_equals_the_library() {
    if Command::new("cc").arg("--version").output().is_err() {
        return skips::skip(Need::Compiler, "no C compiler (cc)");
    }
    let dir = tempfile::tempdir().unwrap();
    for (method, ground) in [("fine", 0.0), ("compact", 0.3), ("chebyshev", 0.0)] {
        let folder = fit(dir.path(), method);
        export(&folder, &dir.path().join("sky.h"), &["--ground", &ground.to_string()]);
        let want = library(&folder, ground);
        let mut main = String::from(
            "#include <stdio.h>\n#include \"sky.h\"\nint main(void) {\n    static MESOPHYLL_SKY_REAL c[49][3];\n    \
             int k;\n",
        );
        for (s, t) in skies() {
            main.push_str(&format!(
                "    if (!mesophyll_sky({s:?}, {t:?}, c)) return 1;\n    for (k = 0; k < 49; k++) printf(\"%.17g %.17g \
                 %.17g\\n\", (double)c[k][0], (double)c[k][1], (double)c[k][2]);\n"
            ));
        }
        main.push_str(
            "    return mesophyll_sky(0.5, 6.1, c) || mesophyll_sky(1.6, 3.0, c) || mesophyll_sky(0.0 / 0.0, \
         3.0, c);\n}\n",
        );
        std::fs::write(dir.path().join("main.c"), main).unwrap();
        // In single precision, the plain Chebyshev polynomials have more cancellation.
        let single = if method == "chebyshev" { 2e-6 } else { SINGLE };
        for (real, tolerance) in [("float", single), ("double", DOUBLE)] {
            let program = dir.path().join(format!("{method}-{real}"));
            let built = Command::new("cc")
                .args([
                    "-std=c99",
                    "-Wall",
                    "-Wextra",
                    "-Werror",
                    &format!("-DMESOPHYLL_SKY_REAL={real}"),
                    "main.c",
                    "-lm",
                    "-o",
                ])
                .arg(&program)
                .current_dir(dir.path())
                .output()
                .unwrap();
            assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
            let ran = Command::new(&program).output().unwrap();
            assert!(ran.status.success());
            let text = String::from_utf8(ran.stdout).unwrap();
            let got: Vec<f64> = text.split_whitespace().map(|v| v.parse().unwrap()).collect();
            let off = worst(&got, &want);
            println!("C {method} {real}: {off:.1e} of c00");
            assert!(off < tolerance, "{method} {real}: {off:e}");
        }
    }
}

/// Evaluates the JSON by its own description, without the library.
fn by_hand(sky: &Value, s: f64, t: f64) -> Vec<[f64; 3]> {
    let n = |v: &Value| v.as_f64().unwrap();
    let list = |v: &Value| v.as_array().unwrap().iter().map(n).collect::<Vec<f64>>();
    let rows = list(&sky["rows"]);
    let zero = n(&sky["turbidity_zero"]);
    let [low, high] = [n(&sky["turbidity"][0]), n(&sky["turbidity"][1])].map(|x| (x - zero).ln());
    let v = (2.0 * (t - zero).ln() - low - high) / (high - low);
    let x = s / FRAC_PI_2;
    let cheb = |k: usize, x: f64| (k as f64 * x.clamp(-1.0, 1.0).acos()).cos();
    let mut factors = [Vec::new(), Vec::new()];
    for (i, row) in rows.iter().enumerate() {
        for j in 0..*row as usize {
            factors[0].push(cheb(2 * i, x) * cheb(j, v));
            factors[1].push(cheb(2 * i + 1, x) * cheb(j, v));
        }
    }
    let perez: Vec<Vec<f64>> =
        (0..3).map(|q| (0..5).map(|k| n(&sky["perez"][q][k][0]) * t + n(&sky["perez"][q][k][1])).collect()).collect();
    let chi = (4.0 / 9.0 - t / 120.0) * (std::f64::consts::PI - 2.0 * s);
    let chroma = |name: &str| {
        (0..3)
            .map(|r| t.powi(2 - r) * (0..4).map(|c| n(&sky[name][r as usize][c]) * s.powi(3 - c as i32)).sum::<f64>())
            .sum::<f64>()
    };
    let z = [(4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192, chroma("zenith_x"), chroma("zenith_y")];
    let q: Vec<f64> = (0..3)
        .map(|k| {
            z[k] / ((1.0 + perez[k][0] * perez[k][1].exp())
                * (1.0 + perez[k][2] * (perez[k][3] * s).exp() + perez[k][4] * s.cos().powi(2)))
        })
        .collect();
    let p = [q[0], q[0] / q[2], q[0] * q[1] / q[2]];
    let mut out = vec![[0.0; 3]; 49];
    for f in sky["functions"].as_array().unwrap() {
        let which = &factors[f["factors"].as_u64().unwrap() as usize];
        let mut u = [0.0; 3];
        for (term, factor) in f["values"].as_array().unwrap().iter().zip(which) {
            (0..3).for_each(|k| u[k] += factor * n(&term[k]));
        }
        let w: Vec<f64> = (0..3).map(|a| p[a] * (0..3).map(|b| n(&sky["back"][a][b]) * u[b]).sum::<f64>()).collect();
        out[f["index"].as_u64().unwrap() as usize] =
            std::array::from_fn(|c| (0..3).map(|a| n(&sky["colours"][c][a]) * w[a]).sum());
    }
    let (albedo, light) = (n(&sky["ground"]), out[2]);
    for (l, share) in list(&sky["ground_shares"]).iter().enumerate() {
        (0..3).for_each(|k| out[l * (l + 1)][k] += albedo * share * light[k]);
    }
    out
}

#[test]
fn the_json_says_how_it_is_evaluated() {
    let dir = tempfile::tempdir().unwrap();
    for (method, ground) in [("fine", 0.25), ("compact", 0.0)] {
        let folder = fit(dir.path(), method);
        let text = export(&folder, &dir.path().join("sky.json"), &["--ground", &ground.to_string()]);
        let json: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["fit"]["kind"], "sky");
        assert!(json["sky"]["conventions"]["harmonics"].as_str().unwrap().contains("Condon"));
        let got: Vec<f64> = skies().iter().flat_map(|(s, t)| by_hand(&json["sky"], *s, *t)).flatten().collect();
        let off = worst(&got, &library(&folder, ground));
        println!("JSON {method}: {off:.1e} of c00");
        assert!(off < JSON, "{method}: {off:e}");
    }
}

/// A fixed sky is 49×3 numbers without a polynomial. All three formats hold the same numbers.
#[test]
fn a_fixed_sky_is_forty_nine_triples() {
    let dir = tempfile::tempdir().unwrap();
    let folder = fit(dir.path(), "fine");
    let extra = ["--sun-zenith-deg", "40", "--turbidity", "3", "--ground", "0.2"];
    let json: Value = serde_json::from_str(&export(&folder, &dir.path().join("f.json"), &extra)).unwrap();
    let (c, wgsl) =
        (export(&folder, &dir.path().join("f.h"), &extra), export(&folder, &dir.path().join("f.wgsl"), &extra));
    let listed = json["coefficients"].as_array().unwrap();
    assert_eq!(listed.len(), 49);
    // The limit against direct integration is that of the fit's tier.
    let sky = mesophyll::sky::Preetham.at(40f64.to_radians(), 3.0).unwrap();
    let want = add_ground(&mesophyll::sky::projection::direct(&sky, 7), [0.2; 3], [0.0; 3]);
    for (k, w) in want.values().iter().enumerate() {
        for ch in 0..3 {
            assert!((listed[k][ch].as_f64().unwrap() - w[ch]).abs() < 2e-5 * want.get(0, 0)[ch], "{k}");
        }
    }
    let numbers = |text: &str, open: &str| -> Vec<f32> {
        let rows = text.lines().filter(|l| l.trim_start().starts_with(open));
        rows.flat_map(|l| {
            l.trim()
                .trim_start_matches(open)
                .split([',', '}', ')'])
                .map(|v| v.trim().trim_end_matches('f').to_string())
                .filter(|v| !v.is_empty())
                .collect::<Vec<_>>()
        })
        .map(|v| v.parse().unwrap_or_else(|_| panic!("{v:?}")))
        .collect()
    };
    let (from_c, from_wgsl) = (numbers(&c, "{"), numbers(&wgsl, "vec3<f32>("));
    assert_eq!((from_c.len(), &from_c), (147, &from_wgsl));
    let flat = listed.iter().flat_map(|v| v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32));
    assert!(flat.eq(from_c));
    assert!(c.len() < 8000 && !c.contains("exp("));
}

#[test]
fn what_cannot_be_exported_is_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let folder = fit(dir.path(), "compact");
    let (f, to) = (folder.to_str().unwrap(), dir.path().join("x"));
    let to = to.to_str().unwrap();
    refused(&run(["export", f, "--to", "gltf", "-o", to]), 2, &["sky fit", "wgsl"]);
    refused(
        &run(["export", f, "--to", "c", "--sun-zenith-deg", "95", "--turbidity", "3", "-o", to]),
        2,
        &["below the horizon"],
    );
    refused(
        &run(["export", f, "--to", "c", "--sun-zenith-deg", "30", "--turbidity", "8", "-o", to]),
        2,
        &["turbidity is 8"],
    );
    refused(&run(["export", f, "--to", "c", "--ground", "1.5", "-o", to]), 2, &["--ground"]);
    let beam = dir.path().join("beam");
    succeeded(&run(["fit", "beam", "--quiet", "--basis", "-o", beam.to_str().unwrap()]));
    refused(&run(["export", beam.to_str().unwrap(), "--to", "wgsl", "-o", to]), 2, &["beam fit"]);
    let text = export(&beam, &dir.path().join("beam.json"), &[]);
    let json: Value = serde_json::from_str(&text).unwrap();
    assert!(json["fit"]["all"]["a2"]["value"].as_array().unwrap().len() > 3);
}

#[cfg(feature = "render")]
mod shader {
    use super::*;
    use mesophyll_viewer::{pollster, wgpu};
    use wgpu::naga;

    /// Every text is parsed and validated by naga. The polynomials are run where there is an adapter.
    #[test]
    fn the_wgsl_is_valid_and_equals_the_library() {
        let dir = tempfile::tempdir().unwrap();
        let device = open();
        // Software adapters take ten seconds to compile one of them. So only the larger tier is run, and all are
        // validated.
        for (method, ground) in [("fine", 0.3), ("compact", 0.0), ("chebyshev", 0.0)] {
            let folder = fit(dir.path(), method);
            let text = export(&folder, &dir.path().join("sky.wgsl"), &["--ground", &ground.to_string()]);
            valid(&text);
            let Some((device, queue)) = device.as_ref().filter(|_| method == "fine") else { continue };
            let got = evaluate(device, queue, &text);
            let off = worst(&got, &library(&folder, ground));
            println!("WGSL {method}: {off:.1e} of c00");
            assert!(off < WGSL, "{method}: {off:e}");
        }
        let folder = dir.path().join("fine");
        valid(&export(&folder, &dir.path().join("f.wgsl"), &["--sun-zenith-deg", "40", "--turbidity", "3"]));
    }

    fn valid(text: &str) {
        let module = naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)));
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
            .validate(&module)
            .unwrap();
    }

    fn open() -> Option<(wgpu::Device, wgpu::Queue)> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle().with_env());
        let Ok(adapter) = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())) else {
            skips::skip(Need::Adapter, "no graphics adapter (the text was parsed and validated only)");
            return None;
        };
        println!("adapter {}", adapter.get_info().name);
        if !adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS) {
            skips::skip(Need::Elsewhere, "the adapter computes nothing (the text was parsed and validated only)");
            return None;
        }
        pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).ok()
    }

    /// Evaluates each sky in one invocation.
    fn evaluate(device: &wgpu::Device, queue: &wgpu::Queue, text: &str) -> Vec<f64> {
        use wgpu::util::DeviceExt;
        let all = skies();
        // The numbers are in a storage buffer, as the text itself advises, because software adapters copy large
        // constants at every access.
        let (head, rest) = text.split_once("const SKY_VALUES: ").unwrap();
        let (values, tail) = rest.split_once(");").unwrap();
        let list = values.rsplit_once('(').unwrap().1;
        let numbers: Vec<f32> =
            list.split(',').map(str::trim).filter(|v| !v.is_empty()).map(|v| v.parse().unwrap()).collect();
        let source = format!(
            "{head}@group(0) @binding(2) var<storage, read> SKY_VALUES: array<f32>;{tail}
@group(0) @binding(0) var<storage, read> suns: array<vec2<f32>>;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;
@compute @workgroup_size(1) fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    var terms = sky_terms(suns[id.x].x, suns[id.x].y);
    for (var k = 0u; k < SKY_COEFFICIENTS; k++) {{
        let c = sky_coefficient(&terms, k);
        let at = 3u * (SKY_COEFFICIENTS * id.x + k);
        results[at] = c.x;
        results[at + 1u] = c.y;
        results[at + 2u] = c.z;
    }}
}}"
        );
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let held: Vec<u8> = numbers.into_iter().flat_map(f32::to_le_bytes).collect();
        let held = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: &held,
            usage: wgpu::BufferUsages::STORAGE,
        });
        let input: Vec<u8> = all.iter().flat_map(|(s, t)| [*s as f32, *t as f32]).flat_map(f32::to_le_bytes).collect();
        let suns = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: &input,
            usage: wgpu::BufferUsages::STORAGE,
        });
        let size = (all.len() * 49 * 3 * 4) as u64;
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        };
        let results = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let back = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let bind = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: suns.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: results.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: held.as_entire_binding() },
            ],
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bind, &[]);
            pass.dispatch_workgroups(all.len() as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&results, 0, &back, 0, size);
        queue.submit([encoder.finish()]);
        back.map_async(wgpu::MapMode::Read, .., |r| r.unwrap());
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let view = back.get_mapped_range(..).unwrap();
        view.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect()
    }
}
