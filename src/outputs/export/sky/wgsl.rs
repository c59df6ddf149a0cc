//! The sky as WGSL, in f32 throughout. Sines and tangents of shaders may be wrong in the fourth digit (the language
//! allows 2⁻¹¹), so tangent, cosine and logarithm are spelled out as short series; `exp` is the only function called.

use super::{Constants, Evaluator, Kind, constants, listed};
use mesophyll_sky::HarmonicCoefficients;
use mesophyll_sky::polynomials::PolynomialBasis;
use mesophyll_sky::polynomials::mix::TURBIDITY_ZERO;

fn head(about: &[String]) -> String {
    about.iter().map(|l| format!("// {l}").trim_end().to_string() + "\n").collect::<String>() + "\n"
}

fn number(v: f64) -> String {
    format!("{:e}", v as f32)
}

fn vector(v: [f64; 3]) -> String {
    format!("vec3<f32>({})", v.map(number).join(", "))
}

/// Columns of a matrix given by rows.
fn matrix(m: &[[f64; 3]; 3]) -> String {
    let column = |c: usize| vector([m[0][c], m[1][c], m[2][c]]);
    format!("mat3x3<f32>({}, {}, {})", column(0), column(1), column(2))
}

pub fn fixed(c: &HarmonicCoefficients, about: &[String]) -> String {
    let n = c.values().len();
    let mut out = head(about);
    out.push_str(&format!("const SKY_BANDS: u32 = {}u;\n", c.bands()));
    out.push_str(&format!("const SKY_COEFFICIENTS: u32 = {n}u;\n\n// R, G, B at l(l+1)+m.\n"));
    out.push_str(&format!("const SKY: array<vec3<f32>, {n}> = array<vec3<f32>, {n}>(\n"));
    c.values().iter().for_each(|v| out.push_str(&format!("    {},\n", vector(*v))));
    out.push_str(");\n");
    out
}

pub fn polynomials(e: &Evaluator, about: &[String], ground: f64) -> String {
    let n = e.bands * e.bands;
    let mut out = head(about);
    out.push_str(
        "// var terms = sky_terms(sun_zenith, turbidity); then sky_coefficient(&terms, k) for k = 0 .. \
         SKY_COEFFICIENTS - 1, or all at\n",
    );
    out.push_str("// once by sky_coefficients(sun_zenith, turbidity).\n\n");
    out.push_str(&format!(
        "const SKY_BANDS: u32 = {}u;\nconst SKY_COEFFICIENTS: u32 = {n}u;\nconst SKY_TERMS: u32 = {}u;\n",
        e.bands, e.terms
    ));
    out.push_str(&format!(
        "// Functions of even order; the others are of odd order.\nconst SKY_EVEN: i32 = {};\n",
        e.first()
    ));
    out.push_str("// Albedo of level ground that lights the lower hemisphere; 0 leaves it dark.\n");
    out.push_str(&format!("const SKY_GROUND: f32 = {};\n", number(ground)));
    let functions: Vec<String> = e.functions().iter().map(|f| f.to_string()).collect();
    out.push_str("// The function at l(l+1)+m; none where m < 0.\n");
    out.push_str(&format!("const SKY_FUNCTION: array<i32, {n}> = array<i32, {n}>({});\n", functions.join(", ")));
    let shares: Vec<String> = e.ground_shares().iter().map(|s| number(*s)).collect();
    out.push_str("// Share of c[2] times the albedo that the ground gives to the zonal coefficient of each band.\n");
    out.push_str(&format!("const SKY_BELOW: array<f32, {0}> = array<f32, {0}>({1});\n", e.bands, shares.join(", ")));
    let size = e.values().count();
    out.push_str(
        "// Function by function, term by term, three values. Software adapters copy large constants at every access: \
         for them put the\n",
    );
    out.push_str(
        "// numbers into a storage buffer and declare that by this name: var<storage, read> SKY_VALUES: array<f32>;\n",
    );
    out.push_str(&format!(
        "const SKY_VALUES: array<f32, {size}> = array<f32, {size}>(\n{});\n\n",
        listed(e.values(), 8, "")
    ));
    out.push_str(&format!(
        "struct SkyTerms {{
    // of even and of odd orders
    factors: array<vec2<f32>, {}>,
    colours: mat3x3<f32>,
}}

// Everything that depends on the sky and on no coefficient: sun zenith angle in radians.
fn sky_terms(sun_zenith: f32, turbidity: f32) -> SkyTerms {{
    var terms: SkyTerms;
",
        e.terms
    ));
    match &e.kind {
        Kind::Folded { rows, back } => folded(&mut out, e, rows, back),
        Kind::Tensor { basis, powers } => tensor(&mut out, e, *basis, *powers),
    }
    out.push_str("    return terms;\n}\n\n");
    out.push_str(
        "fn sky_upper(terms: ptr<function, SkyTerms>, index: u32) -> vec3<f32> {
    let function_index = SKY_FUNCTION[index];
    if (function_index < 0) {
        return vec3<f32>(0.0);
    }
    let odd = function_index >= SKY_EVEN;
    let start = u32(function_index) * SKY_TERMS;
    var sum = vec3<f32>(0.0);
    // from the small terms of high degree to the large ones
    for (var k = 0u; k < SKY_TERMS; k++) {
        let t = SKY_TERMS - 1u - k;
        let pair = (*terms).factors[t];
        let at = 3u * (start + t);
        sum += select(pair.x, pair.y, odd) * vec3<f32>(SKY_VALUES[at], SKY_VALUES[at + 1u], SKY_VALUES[at + 2u]);
    }
    return (*terms).colours * sum;
}

// The coefficient at index l(l+1)+m.
fn sky_coefficient(terms: ptr<function, SkyTerms>, index: u32) -> vec3<f32> {
    var value = sky_upper(terms, index);
    if (SKY_GROUND > 0.0) {
        for (var l = 0u; l < SKY_BANDS; l++) {
            if (index == l * (l + 1u)) {
                value += SKY_GROUND * SKY_BELOW[l] * sky_upper(terms, 2u);
            }
        }
    }
    return value;
}

",
    );
    out.push_str(&format!(
        "fn sky_coefficients(sun_zenith: f32, turbidity: f32) -> array<vec3<f32>, {n}> {{
    var terms = sky_terms(sun_zenith, turbidity);
    var c: array<vec3<f32>, {n}>;
    for (var k = 0u; k < SKY_COEFFICIENTS; k++) {{
        c[k] = sky_coefficient(&terms, k);
    }}
    return c;
}}\n"
    ));
    out
}

fn folded(out: &mut String, e: &Evaluator, rows: &[usize], back: &[[f64; 3]; 3]) {
    let Constants { perez, zenith, colours } = constants();
    let (half, mean) = e.logarithm();
    let columns = rows.iter().copied().max().unwrap_or(1);
    let list: Vec<String> = rows.iter().map(|r| format!("{r}u")).collect();
    // ln r = 2 (s + s³/3 + s⁵/5 + …), s = (r − 1)/(r + 1): as many terms as the ends of the domain need for 1e-9
    let most = half.exp();
    let s = (most - 1.0) / (most + 1.0);
    let needed = (1..40).find(|k| s.powi(2 * k + 1) / f64::from(2 * k + 1) < 1e-9).unwrap_or(40);
    let series = (0..needed).rev().fold(String::new(), |inner, k| {
        let share = number(1.0 / f64::from(2 * k + 1));
        if inner.is_empty() { share } else { format!("({share} + s2 * {inner})") }
    });
    // cos θ by its series, to 1e-10 over 0 … π/2
    let cosine = (0..9).rev().fold(String::new(), |inner, k: i32| {
        let share =
            number((1..=2 * k).map(|n| -f64::from(n).recip()).product::<f64>() * if k % 2 == 0 { 1.0 } else { -1.0 });
        if inner.is_empty() { share } else { format!("({share} + z2 * {inner})") }
    });
    out.push_str(&format!(
        "    // Chebyshev polynomials of ln(turbidity - {TURBIDITY_ZERO}), scaled, and of even and odd degree of the \
         sun's angle
    let ratio = (turbidity - {zero}) * {mean};
    let s = (ratio - 1.0) / (ratio + 1.0);
    let s2 = s * s;
    let v = {double} * s * {series};
    var columns: array<f32, {width}>;
    columns[0] = 1.0;
    columns[1] = v;
    for (var j = 2u; j < {width}u; j++) {{
        columns[j] = 2.0 * v * columns[j - 1u] - columns[j - 2u];
    }}
    let x = sun_zenith * {over};
    let twice = 4.0 * x * x - 2.0;
    var angle = vec2<f32>(1.0, x);
    var before = vec2<f32>(0.5 * twice, x);
    var rows = array<u32, {count}>({list});
    var t = 0u;
    for (var i = 0u; i < {count}u; i++) {{
        for (var j = 0u; j < rows[i]; j++) {{
            terms.factors[t] = angle * columns[j];
            t++;
        }}
        let next = twice * angle - before;
        before = angle;
        angle = next;
    }}
",
        zero = number(TURBIDITY_ZERO),
        mean = number(1.0 / mean),
        double = number(2.0 / half),
        width = columns.max(2),
        over = number(1.0 / std::f64::consts::FRAC_PI_2),
        count = rows.len(),
        list = list.join(", "),
    ));
    let perez_of = |k: usize| {
        let column = |part: usize| vector(std::array::from_fn(|c| perez[c][k][part]));
        format!("{} * turbidity + {}", column(0), column(1))
    };
    let chroma = |m: &[[f64; 4]; 3]| {
        let power = |k: usize| {
            let [a, b, c] = [m[0][k], m[1][k], m[2][k]].map(number);
            format!("(({a} * turbidity + {b}) * turbidity + {c})")
        };
        format!("(({} * sun_zenith + {}) * sun_zenith + {}) * sun_zenith + {}", power(0), power(1), power(2), power(3))
    };
    out.push_str(&format!(
        "    // zenith luminance and chromaticity over the sky's shape towards the zenith (Preetham et al. 1999, \
         appendix A.2)
    let z2 = sun_zenith * sun_zenith;
    let c = {cosine};
    let half_chi = (0.22222222 - turbidity * 0.004166667) * (3.1415927 - 2.0 * sun_zenith);
    let h2 = half_chi * half_chi;
    // the tangent of half the angle as a continued fraction
    let h = half_chi / (1.0 - h2 / (3.0 - h2 / (5.0 - h2 / (7.0 - h2 / (9.0 - h2 / 11.0)))));
    let luminance = (4.0453 * turbidity - 4.9710) * 2.0 * h / (1.0 - h * h) - 0.2155 * turbidity + 2.4192;
    let zenith = vec3<f32>(luminance, {zx}, {zy});
    let overhead = vec3<f32>(1.0) + ({a}) * exp({b});
    let glow = vec3<f32>(1.0) + ({cc}) * exp(({d}) * sun_zenith) + ({ee}) * c * c;
    let scale = zenith / (overhead * glow);
    let p = vec3<f32>(scale.x, scale.x / scale.z, scale.x * scale.y / scale.z);
    let back = {back};
    let colours = {colours};
    terms.colours = colours * mat3x3<f32>(p * back[0], p * back[1], p * back[2]);
",
        zx = chroma(&zenith[0]),
        zy = chroma(&zenith[1]),
        a = perez_of(0),
        b = perez_of(1),
        cc = perez_of(2),
        d = perez_of(3),
        ee = perez_of(4),
        back = matrix(back),
        colours = matrix(&colours),
    ));
}

fn tensor(out: &mut String, e: &Evaluator, basis: PolynomialBasis, [a, b]: [usize; 2]) {
    let [low, high] = e.turbidities;
    let (x, y, twice) = match basis {
        PolynomialBasis::Chebyshev => (
            format!("sun_zenith * {} - 1.0", number(4.0 / std::f64::consts::PI)),
            format!("(2.0 * turbidity - {}) * {}", number(low + high), number(1.0 / (high - low))),
            true,
        ),
        PolynomialBasis::Monomials => ("sun_zenith".into(), "turbidity".into(), false),
    };
    let step = |v: &str, name: &str| {
        if twice { format!("2.0 * {v} * {name}[k - 1u] - {name}[k - 2u]") } else { format!("{v} * {name}[k - 1u]") }
    };
    out.push_str(&format!(
        "    let x = {x};
    let y = {y};
    var p: array<f32, {wa}>;
    var q: array<f32, {wb}>;
    p[0] = 1.0;
    p[1] = x;
    q[0] = 1.0;
    q[1] = y;
    for (var k = 2u; k < {a}u; k++) {{
        p[k] = {};
    }}
    for (var k = 2u; k < {b}u; k++) {{
        q[k] = {};
    }}
    for (var k = 0u; k < SKY_TERMS; k++) {{
        terms.factors[k] = vec2<f32>(p[k / {b}u] * q[k % {b}u]);
    }}
    terms.colours = mat3x3<f32>(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), vec3<f32>(0.0, 0.0, 1.0));
",
        step("x", "p"),
        step("y", "q"),
        wa = a.max(2),
        wb = b.max(2),
    ));
}
