//! The exported texts as programs: C by the C compiler; HLSL by the C++ compiler, with the few types of HLSL that it
//! needs; GLSL by the OpenGL of the machine (Mesa's, without a window).

use super::cases::{ANSWERS, Case, DIRECTIONS, GIVEN};
use std::path::Path;
use std::process::Command;

/// HLSL's triples, for a C++ compiler. Nothing else of the language is in the texts.
const HLSL_TYPES: &str = "#include <cmath>
#include <cstdio>
using std::exp;
using std::log;
using std::sqrt;
struct float3 {
    float x, y, z;
    float3() {}
    float3(float a, float b, float c) : x(a), y(b), z(c) {}
};
static float3 operator*(float s, float3 v) { return float3(s * v.x, s * v.y, s * v.z); }
static float3 &operator+=(float3 &a, float3 b) { return a = float3(a.x + b.x, a.y + b.y, a.z + b.z); }
";

/// How a text is called: with a state, or with none where the sky is fixed.
#[derive(Clone, Copy, PartialEq)]
pub enum Form {
    Fitted,
    Fixed,
}

/// Everything that is asked of a sky, in the syntax that C, C++ and GLSL share; `put` takes a triple.
fn asked(form: Form, prefix: &str, triple: &str, by_pointer: bool) -> String {
    let (first, only, list) = match (form, by_pointer) {
        (Form::Fixed, _) => (String::new(), "", format!("{}SKY_HARMONICS", prefix.to_uppercase())),
        (Form::Fitted, true) => ("&sky, ".into(), "&sky", "sky.harmonics".into()),
        (Form::Fitted, false) => ("sky, ".into(), "sky", "sky.harmonics".into()),
    };
    let directions: String = ["radiance", "irradiance", "drawn", "sun_disk"]
        .iter()
        .map(|name| format!("            put({prefix}sky_{name}({first}d));\n"))
        .collect();
    assert_eq!(directions.lines().count(), ANSWERS);
    format!(
        "        for (int k = 0; k < 49; k++) put({list}[k]);
        put({prefix}sky_sun_direction({only}));
        put({prefix}sky_sun_light({only}));
        for (int k = 0; k < {DIRECTIONS}; k++) {{
            int at = start + 4 + 3 * k;
            {triple} d = {triple}(given[at], given[at + 1], given[at + 2]);
{directions}        }}
"
    )
}

fn numbers(cases: &[Case]) -> String {
    let all: Vec<String> = cases.iter().flat_map(|c| &c.given).map(|v| format!("{v:e}f")).collect();
    all.join(", ")
}

fn built(folder: &Path, compiler: &str, arguments: &[&str], program: &str) {
    let done = Command::new(compiler).args(arguments).args(["-o", program]).current_dir(folder).output().unwrap();
    assert!(done.status.success(), "{program}: {}", String::from_utf8_lossy(&done.stderr));
}

fn answers(command: &mut Command) -> Vec<f64> {
    let ran = command.output().unwrap();
    assert!(ran.status.success(), "{:?} {}", ran.status, String::from_utf8_lossy(&ran.stderr));
    let text = String::from_utf8(ran.stdout).unwrap();
    text.split_whitespace().map(|v| v.parse().unwrap()).collect()
}

/// Runs the header `sky.h` of `folder` with this type of numbers.
pub fn c(folder: &Path, form: Form, real: &str, cases: &[Case]) -> Vec<f64> {
    let make = match form {
        Form::Fixed => "",
        Form::Fitted => {
            "        if (!mesophyll_sky_holds(g[0], g[1])) return 1;
        const mesophyll_sky_state sky = mesophyll_sky_at(g[0], g[1], g[2], g[3]);
"
        }
    };
    let main = format!(
        "#include \"sky.h\"
#include <stdio.h>
static const float given[] = {{{}}};
static void put(mesophyll_sky_triple v) {{
    printf(\"%.17g %.17g %.17g\\n\", (double)v.x, (double)v.y, (double)v.z);
}}
static mesophyll_sky_triple triple(float x, float y, float z) {{
    const mesophyll_sky_triple v = {{x, y, z}};
    return v;
}}
typedef mesophyll_sky_triple direction;
#define direction(x, y, z) triple(x, y, z)
int main(void) {{
    for (int s = 0; s < {}; s++) {{
        const int start = {GIVEN} * s;
        const float *g = given + start;
        (void)g;
{make}{}    }}
    return 0;
}}
",
        numbers(cases),
        cases.len(),
        asked(form, "mesophyll_", "direction", true)
    );
    std::fs::write(folder.join("main.c"), main).unwrap();
    let real = format!("-DMESOPHYLL_SKY_REAL={real}");
    let arguments = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", &real, "main.c", "-lm"];
    built(folder, "cc", &arguments, "from_c");
    answers(&mut Command::new(folder.join("from_c")))
}

/// Runs the text of HLSL as C++ in single precision.
pub fn hlsl(folder: &Path, form: Form, text: &str, cases: &[Case]) -> Vec<f64> {
    let make = match form {
        Form::Fixed => "",
        Form::Fitted => {
            "        if (!sky_holds(g[0], g[1])) return 1;\n        SkyState sky = sky_at(g[0], g[1], g[2], g[3]);\n"
        }
    };
    let main = format!(
        "{HLSL_TYPES}{text}
static const float given[] = {{{}}};
static void put(float3 v) {{ printf(\"%.9g %.9g %.9g\\n\", v.x, v.y, v.z); }}
int main() {{
    for (int s = 0; s < {}; s++) {{
        int start = {GIVEN} * s;
        const float *g = given + start;
        (void)g;
{make}{}    }}
    return 0;
}}
",
        numbers(cases),
        cases.len(),
        asked(form, "", "float3", false)
    );
    std::fs::write(folder.join("main.cpp"), main).unwrap();
    // A number without a suffix is of single precision in HLSL.
    let arguments = ["-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsingle-precision-constant", "main.cpp"];
    built(folder, "c++", &arguments, "from_hlsl");
    answers(&mut Command::new(folder.join("from_hlsl")))
}

/// A compute shader around the text of GLSL: one invocation a sky. The polynomials' numbers come from a buffer, as the
/// text itself advises.
pub fn glsl_shader(form: Form, text: &str) -> (String, Vec<f32>) {
    let (text, values) = if form == Form::Fitted { without_values(text) } else { (text.to_string(), vec![0.0]) };
    let (buffer, make) = match form {
        Form::Fixed => ("", ""),
        Form::Fitted => (
            "layout(std430, binding = 2) readonly buffer Values { float SKY_VALUES[]; };\n",
            "        SkyState sky = sky_at(given[start], given[start + 1], given[start + 2], given[start + 3]);\n",
        ),
    };
    let each = 3 * (49 + 2 + ANSWERS * DIRECTIONS);
    let shader = format!(
        "#version 430
layout(local_size_x = 1) in;
layout(std430, binding = 0) readonly buffer Given {{ float given[]; }};
layout(std430, binding = 1) writeonly buffer Found {{ float found[]; }};
{buffer}{text}
int place;
void put(vec3 v) {{
    found[place] = v.x;
    found[place + 1] = v.y;
    found[place + 2] = v.z;
    place += 3;
}}
void main() {{
        int start = {GIVEN} * int(gl_GlobalInvocationID.x);
        place = {each} * int(gl_GlobalInvocationID.x);
{make}{}}}
",
        asked(form, "", "vec3", false)
    );
    (shader, values)
}

/// The text without its large table, and the table's numbers.
pub fn without_values(text: &str) -> (String, Vec<f32>) {
    let at = text.lines().position(|l| l.contains("const") && l.contains(" SKY_VALUES")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let end = at + lines[at..].iter().position(|l| l.trim() == ");").unwrap();
    let list = lines[at + 1..end].iter().flat_map(|l| l.split(',')).map(str::trim).filter(|v| !v.is_empty());
    let rest = [&lines[..at], &lines[end + 1..]].concat().join("\n");
    (rest, list.map(|v| v.parse().unwrap()).collect())
}

/// Runs a compute shader by OpenGL; nothing where the machine has none that computes.
pub fn opengl(folder: &Path, shader: &str, values: &[f32], cases: &[Case]) -> Option<Vec<f64>> {
    let host = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/outputs/sky_functions/opengl.c");
    built(folder, "cc", &["-std=c99", "-Wall", "-Wextra", "-Werror", host.to_str().unwrap(), "-ldl"], "opengl");
    let bytes = |all: &mut dyn Iterator<Item = f32>| all.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    std::fs::write(folder.join("shader.glsl"), shader).unwrap();
    std::fs::write(folder.join("given"), bytes(&mut cases.iter().flat_map(|c| c.given.iter().copied()))).unwrap();
    std::fs::write(folder.join("values"), bytes(&mut values.iter().copied())).unwrap();
    let count = cases.len() * 3 * (49 + 2 + ANSWERS * DIRECTIONS);
    let mut command = Command::new(folder.join("opengl"));
    command.current_dir(folder).env("EGL_PLATFORM", "surfaceless").env("LIBGL_ALWAYS_SOFTWARE", "1");
    command.args([&cases.len().to_string(), &count.to_string()]);
    let ran = command.output().unwrap();
    if ran.status.code() == Some(77) {
        println!("{}", String::from_utf8_lossy(&ran.stderr));
        return None;
    }
    assert!(ran.status.success(), "{:?} {}", ran.status, String::from_utf8_lossy(&ran.stderr));
    Some(ran.stdout.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect())
}
