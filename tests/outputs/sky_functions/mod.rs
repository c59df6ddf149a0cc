//! The functions that `mesophyll export` writes of a sky, in all four languages: compiled, run, and compared with the
//! library in many directions.

#[cfg(feature = "render")]
mod adapter;
mod cases;
mod programs;

use crate::common::skips::{self, Need};
use crate::sky_export::{export, fit};
use cases::{Case, DIRECTIONS, Differences, compare};
use mesophyll::fits::sky::{SkyFitForm, folder};
use mesophyll::sky::HarmonicCoefficients;
use programs::Form;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What docs/evidence/sky.md states, times one and a half, and twice for shaders, whose adapters choose the rounding.
const DOUBLE: Differences = Differences { harmonics: 3e-15, lighting: 4.5e-7, drawn: 1e-7, sun: 7.5e-8 };
const FLOAT: Differences = Differences { harmonics: 3e-7, lighting: 3e-6, drawn: 4.5e-7, sun: 1e-7 };
const SHADER: Differences = Differences { harmonics: 4e-6, lighting: 2e-5, drawn: 6e-6, sun: 6e-5 };

fn within(what: &str, found: Differences, most: Differences) {
    println!("{what}: {found}");
    let pairs = [
        (found.harmonics, most.harmonics),
        (found.lighting, most.lighting),
        (found.drawn, most.drawn),
        (found.sun, most.sun),
    ];
    assert!(pairs.iter().all(|(found, most)| found < most), "{what}: {found}; at most {most}");
}

/// The library's harmonics of the folder, in f64 from the stored arrays.
fn library(folder: &Path) -> impl Fn(&Case) -> HarmonicCoefficients {
    let (_, form) = folder::read(folder).unwrap();
    move |case| {
        let (s, t) = (case.zenith, case.turbidity);
        match &form {
            SkyFitForm::Folded(f) => f.to::<f64>().coefficients(s, t).unwrap(),
            SkyFitForm::Tensor(f) => f.to::<f64>().coefficients(s, t).unwrap(),
        }
    }
}

/// The sky of the fixed exports: three options, and the case that they are.
fn noon() -> ([&'static str; 8], Vec<Case>) {
    let options = ["--sun-zenith-deg", "40", "--sun-azimuth-deg", "-110", "--turbidity", "3", "--ground", "0.2"];
    (options, vec![Case::new(40f64.to_radians(), 3.0, (-110f64).to_radians())])
}

fn compiler() -> bool {
    let there = Command::new("cc").arg("--version").output().is_ok();
    if !there {
        skips::skip(Need::Compiler, "no C compiler (cc)");
    }
    there
}

fn exported(dir: &Path, method: &str, ending: &str, options: &[&str]) -> (PathBuf, String) {
    let folder = fit(dir, method);
    let text = export(&folder, &dir.join(format!("sky.{ending}")), options);
    (folder, text)
}

#[test]
fn c_equals_the_library() {
    if !compiler() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let cases = cases::all();
    for (method, ground) in [("fine", "0"), ("compact", "0.3"), ("chebyshev", "0")] {
        let (folder, _) = exported(dir.path(), method, "h", &["--ground", ground]);
        for (real, most) in [("float", FLOAT), ("double", DOUBLE)] {
            let got = programs::c(dir.path(), Form::Fitted, real, &cases);
            // In single precision, the plain Chebyshev polynomials have more cancellation.
            let plain = method == "chebyshev" && real == "float";
            let most = if plain { Differences { harmonics: 2e-6, lighting: 2e-5, ..most } } else { most };
            let found = compare(&got, &cases, ground.parse().unwrap(), library(&folder));
            within(&format!("C {method} {real}"), found, most);
        }
    }
    let (options, cases) = noon();
    let (folder, text) = exported(dir.path(), "fine", "h", &options);
    let got = programs::c(dir.path(), Form::Fixed, "double", &cases);
    // the sun's angle of the command is not rounded to single precision, that of the case is
    within("C fixed", compare(&got, &cases, 0.2, library(&folder)), FLOAT);
    assert!(text.contains("sky_radiance of this sky"), "{text}");
}

#[test]
fn hlsl_equals_the_library() {
    if Command::new("c++").arg("--version").output().is_err() {
        return skips::skip(Need::Compiler, "no C++ compiler (c++)");
    }
    let dir = tempfile::tempdir().unwrap();
    let cases = cases::all();
    let (folder, text) = exported(dir.path(), "fine", "hlsl", &["--ground", "0.3"]);
    let got = programs::hlsl(dir.path(), Form::Fitted, &text, &cases);
    within("HLSL", compare(&got, &cases, 0.3, library(&folder)), SHADER);
    let (options, cases) = noon();
    let (_, fixed) = exported(dir.path(), "fine", "hlsl", &options);
    let got = programs::hlsl(dir.path(), Form::Fixed, &fixed, &cases);
    within("HLSL fixed", compare(&got, &cases, 0.2, library(&folder)), SHADER);
    hlsl_is_hlsl(dir.path(), &text, "SkyState sky = sky_at(0.5, 3.0, 1.0, 0.0);", "sky, ");
    hlsl_is_hlsl(dir.path(), &fixed, "", "");
}

/// Khronos' compiler reads HLSL; it turns the text into SPIR-V.
fn hlsl_is_hlsl(folder: &Path, text: &str, make: &str, first: &str) {
    let Some(glslang) = ["glslang", "glslangValidator"].into_iter().find(|name| Command::new(name).output().is_ok())
    else {
        return skips::skip(Need::Peer, "no glslang (HLSL was run as C++ only)");
    };
    let main = format!(
        "{text}
RWStructuredBuffer<float3> found;
[numthreads(1, 1, 1)] void main(uint3 id : SV_DispatchThreadID) {{
    {make}
    float3 d = float3(0.6, 0.0, 0.8);
    found[0] = sky_radiance({first}d) + sky_irradiance({first}d) + sky_drawn({first}d) + sky_sun_disk({first}d);
}}
"
    );
    std::fs::write(folder.join("sky_main.hlsl"), main).unwrap();
    let arguments = ["-D", "-V", "-S", "comp", "-e", "main", "--auto-map-bindings", "-o", "sky.spv", "sky_main.hlsl"];
    let done = Command::new(glslang).args(arguments).current_dir(folder).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stdout));
}

#[test]
fn glsl_equals_the_library() {
    if !compiler() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let (options, fixed) = noon();
    for (form, options, cases) in
        [(Form::Fitted, &["--ground", "0.3"][..], cases::all()), (Form::Fixed, &options[..], fixed)]
    {
        let (folder, text) = exported(dir.path(), "fine", "glsl", options);
        let (shader, values) = programs::glsl_shader(form, &text);
        let Some(got) = programs::opengl(dir.path(), &shader, &values, &cases) else {
            return skips::skip(Need::Adapter, "no OpenGL 4.3 without a window (the GLSL was not compiled)");
        };
        let ground = options.last().unwrap().parse().unwrap();
        within("GLSL", compare(&got, &cases, ground, library(&folder)), SHADER);
    }
}

/// Every text is parsed and validated by naga. The functions are run where there is an adapter.
#[cfg(feature = "render")]
#[test]
fn wgsl_equals_the_library() {
    let dir = tempfile::tempdir().unwrap();
    for method in ["compact", "chebyshev"] {
        adapter::valid(&exported(dir.path(), method, "wgsl", &[]).1);
    }
    let device = adapter::open();
    let (options, fixed) = noon();
    for (form, options, cases) in
        [(Form::Fitted, &["--ground", "0.3"][..], cases::all()), (Form::Fixed, &options[..], fixed)]
    {
        let (folder, text) = exported(dir.path(), "fine", "wgsl", options);
        adapter::valid(&text);
        let Some((device, queue)) = &device else { continue };
        let got = adapter::run(device, queue, form, &text, &cases);
        let ground = options.last().unwrap().parse().unwrap();
        within("WGSL", compare(&got, &cases, ground, library(&folder)), SHADER);
    }
}

/// The irradiance that the text gives is the integral of the radiance that it gives, by a rule of the test's own.
#[test]
fn irradiance_is_the_integral_of_the_radiance() {
    if !compiler() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    exported(dir.path(), "fine", "h", &["--ground", "0.25"]);
    for normal in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.6, -0.8], [-1.0, 0.0, 0.0]] {
        let rule = cases::cosine_rule(normal);
        let mut cases: Vec<Case> = rule
            .chunks(DIRECTIONS)
            .map(|part| Case::with(0.9, 3.0, 0.7, |_, _| part.iter().map(|p| p.0).collect()))
            .collect();
        cases.push(Case::with(0.9, 3.0, 0.7, |_, _| vec![normal; DIRECTIONS]));
        let got = programs::c(dir.path(), Form::Fitted, "double", &cases);
        let answer = |k: usize, which: usize| {
            let at = 3 * ((k / DIRECTIONS + 1) * 51 + cases::ANSWERS * k + which);
            [got[at], got[at + 1], got[at + 2]]
        };
        let mut sum = [0.0; 3];
        for (k, (_, w)) in rule.iter().enumerate() {
            (0..3).for_each(|c| sum[c] += w * answer(k, 0)[c]);
        }
        let told = answer(rule.len(), 1);
        for c in 0..3 {
            // Directions are rounded to single precision.
            assert!((sum[c] / told[c] - 1.0).abs() < 1e-6, "{normal:?}: {sum:?} {told:?}");
        }
    }
}

/// Hosek and Wilkie's sky is no closed form of this program: it has everything but that, and says so.
#[test]
fn a_sky_without_a_closed_form_is_for_lighting_only() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("hosek");
    let arguments =
        ["fit", "sky", "--quiet", "--model", "hosek-wilkie", "--method", "chebyshev", "-o", folder.to_str().unwrap()];
    crate::common::was_fitted(&crate::common::run(arguments));
    let text = export(&folder, &dir.path().join("sky.wgsl"), &[]);
    #[cfg(feature = "render")]
    adapter::valid(&text);
    assert!(text.contains("fn sky_sun_disk(") && !text.contains("sky_drawn"), "{text}");
    assert!(text.contains("no closed form"), "{text}");
}
