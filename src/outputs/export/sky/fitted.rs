//! `sky_at`: all that depends on sun and turbidity, from the fitted polynomials. Sines and tangents of shaders may be
//! wrong in the fourth digit (their languages allow 2⁻¹¹), so tangent, sine and the logarithm close to 1 are spelled
//! out as short series there; `exp`, `log` of large numbers and `sqrt` are the only functions that are called.

use super::functions::series;
use super::language::{SourceText, ValueType};
use super::{Evaluator, Kind};
use mesophyll_sky::irradiance::below_horizon;
use mesophyll_sky::polynomials::PolynomialBasis;
use mesophyll_sky::polynomials::mix::{TURBIDITY_ZERO, rgb_from_separable};
use mesophyll_sky::{HORIZON_ROUNDING, colour, preetham, sun};
use std::f64::consts::{FRAC_PI_2, PI};

const PARTS: [&str; 3] = ["x", "y", "z"];

/// Writes the arrays, the helpers, and `sky_holds` and `sky_at`.
pub fn write(text: &mut SourceText, e: &Evaluator, ground: f64, closed: bool) {
    tables(text, e, ground);
    sine(text);
    tangent(text);
    if let Kind::Folded { .. } = e.kind {
        logarithm(text, e);
    }
    let [low, high] = e.turbidities.map(|t| text.number(t));
    let takes = [(ValueType::Wide, "sun_zenith"), (ValueType::Wide, "turbidity")];
    text.says("Whether the fit answers for this sun (angle from the zenith, rad) and turbidity.");
    text.function(ValueType::Truth, "sky_holds", &takes);
    let (zero, most) = (text.number(0.0), text.number(FRAC_PI_2 + HORIZON_ROUNDING));
    let sun = format!("sun_zenith >= {zero} && sun_zenith <= {most}");
    text.line(&format!("return {sun} && turbidity >= {low} && turbidity <= {high};"));
    text.end();
    text.says(
        "The sky of a sun at this zenith angle (rad) and of this turbidity; the last two are the cosine and the sine",
    );
    text.says("of the sun's azimuth, 1 and 0 for a sun above +x. Means nothing where sky_holds says no.");
    let azimuth = [(ValueType::Wide, "azimuth_cos"), (ValueType::Wide, "azimuth_sin")];
    text.function(ValueType::State, "sky_at", &[takes, azimuth].concat());
    text.room(ValueType::State, "sky", 0);
    let quarter = text.number(FRAC_PI_2);
    text.var(ValueType::Wide, "theta", "sun_zenith");
    text.when(&format!("theta > {quarter}"));
    text.line(&format!("theta = {quarter};"));
    text.close();
    text.line("sky.azimuth_cos = azimuth_cos;");
    text.line("sky.azimuth_sin = azimuth_sin;");
    let height = height(text);
    text.var(ValueType::Wide, "height", &height);
    text.when(&format!("height < {zero}"));
    text.line(&format!("height = {zero};"));
    text.close();
    text.keep(ValueType::Wide, "sun_cos", "sky_sine(height)");
    text.line("sky.sun_cos = sun_cos;");
    text.line("sky.sun_sin = sky_sine(theta);");
    sunlight(text);
    if closed || matches!(e.kind, Kind::Folded { .. }) {
        preetham(text, closed);
    }
    factors(text, e);
    sums(text, e);
    text.line("return sky;");
    text.end();
}

fn tables(text: &mut SourceText, e: &Evaluator, ground: f64) {
    let counts = [("SKY_BANDS", e.bands), ("SKY_TERMS", e.terms), ("SKY_FUNCTIONS", e.places().count())];
    counts.into_iter().for_each(|(name, n)| text.constant(ValueType::Whole, name, &n.to_string()));
    text.says("Functions of even order; the others are of odd order.");
    text.constant(ValueType::Whole, "SKY_EVEN", &e.first().to_string());
    text.says("Albedo of level ground that lights the lower hemisphere; 0 leaves it dark.");
    let albedo = text.number(ground);
    text.constant(ValueType::Wide, "SKY_GROUND", &albedo);
    text.says("l(l+1)+m of every function.");
    text.wholes("SKY_PLACE", &e.places().collect::<Vec<_>>());
    text.says("Share of the ground's radiance in the zonal coefficient of each band.");
    text.wides("SKY_BELOW", &(0..e.bands).map(below_horizon).collect::<Vec<_>>(), 8);
    if let Kind::Folded { rows, .. } = &e.kind {
        text.says("Terms in the turbidity for each power of the sun's angle.");
        text.wholes("SKY_ROWS", rows);
    }
    text.says(
        "Sunlight, wavelength by wavelength: linear sRGB above the air (klx), and the optical depths of one air mass:",
    );
    text.says("of molecules and ozone, and of haze.");
    let lines: Vec<f64> = sun::lines()
        .iter()
        .flat_map(|line| [&colour::rgb_from_xyz(line.above)[..], &line.depths[..]].concat())
        .collect();
    text.constant(ValueType::Whole, "SKY_WAVELENGTHS", &sun::lines().len().to_string());
    text.wides("SKY_SUN", &lines, 5);
    text.says(
        "Function by function, term by term, three values. Software adapters copy large constants at every access:",
    );
    text.says("for them put the numbers into a buffer of the same name.");
    text.singles("SKY_VALUES", &e.values().collect::<Vec<_>>());
    text.gap();
}

/// The sine of 0 to π/2, with all its digits close to 0.
fn sine(text: &mut SourceText) {
    text.function(ValueType::Wide, "sky_sine", &[(ValueType::Wide, "angle")]);
    if text.language.is_shader() {
        text.keep(ValueType::Wide, "a2", "angle * angle");
        let sign = |k: i32| if k % 2 == 0 { 1.0 } else { -1.0 };
        let terms = (0..8).map(|k: i32| sign(k) / (1..=2 * k + 1).map(f64::from).product::<f64>());
        text.line(&format!("return angle * {};", series(text, "a2", terms)));
    } else {
        text.line("return sin(angle);");
    }
    text.end();
}

/// π/2 less θ: a low sun's height has digits that π/2 in single precision has not.
fn height(text: &SourceText) -> String {
    let quarter = format!("({} - theta)", text.number(FRAC_PI_2));
    if text.language.is_shader() {
        format!("{quarter} + {}", text.number(FRAC_PI_2 - f64::from(FRAC_PI_2 as f32)))
    } else {
        quarter
    }
}

/// The tangent of 0 to 1.4.
fn tangent(text: &mut SourceText) {
    text.function(ValueType::Wide, "sky_tangent", &[(ValueType::Wide, "angle")]);
    if text.language.is_shader() {
        text.says("that of half the angle as a continued fraction");
        let number = |v: i32| text.number(f64::from(v));
        let (half, two, one, last) = (text.number(0.5), number(2), number(1), number(11));
        let fraction = [9, 7, 5, 3].into_iter().fold(last, |inner, k| format!("({} - h2 / {inner})", number(k)));
        text.keep(ValueType::Wide, "h", &format!("{half} * angle"));
        text.keep(ValueType::Wide, "h2", "h * h");
        text.keep(ValueType::Wide, "t", &format!("h / ({one} - h2 / {fraction})"));
        text.line(&format!("return {two} * t / ({one} - t * t);"));
    } else {
        text.line("return tan(angle);");
    }
    text.end();
}

/// The logarithm of what the turbidity is over the middle of the domain.
fn logarithm(text: &mut SourceText, e: &Evaluator) {
    text.function(ValueType::Wide, "sky_logarithm", &[(ValueType::Wide, "ratio")]);
    if text.language.is_shader() {
        // ln r = 2 (s + s³/3 + s⁵/5 + …), s = (r − 1)/(r + 1): as many terms as the ends of the domain need for 1e-9
        let most = e.logarithm().0.exp();
        let s = (most - 1.0) / (most + 1.0);
        let needed = (1..40).find(|k| s.powi(2 * k + 1) / f64::from(2 * k + 1) < 1e-9).unwrap_or(40);
        let one = text.number(1.0);
        text.keep(ValueType::Wide, "s", &format!("(ratio - {one}) / (ratio + {one})"));
        text.keep(ValueType::Wide, "s2", "s * s");
        let sum = series(text, "s2", (0..needed).map(|k| 1.0 / f64::from(2 * k + 1)));
        text.line(&format!("return {} * s * {sum};", text.number(2.0)));
    } else {
        text.line("return log(ratio);");
    }
    text.end();
}

/// Direct sunlight through the same air (Preetham et al. 1999, appendix A.1).
fn sunlight(text: &mut SourceText) {
    let n = |v: f64| text.language.number(v);
    let kasten = format!("{} * exp({} * log({} - theta * {}))", n(0.15), n(-1.253), n(93.885), n(180.0 / PI));
    let mass = format!("{} / (sun_cos + {kasten})", n(1.0));
    let haze = format!("{} * turbidity - {}", n(0.04608), n(0.04586));
    let zero = n(0.0);
    text.says("direct sunlight through the same air (Preetham et al. 1999, appendix A.1)");
    text.keep(ValueType::Wide, "air_mass", &mass);
    text.keep(ValueType::Wide, "haze", &haze);
    PARTS.iter().for_each(|c| text.var(ValueType::Wide, &format!("light_{c}"), &zero));
    text.each("w", "0", "SKY_WAVELENGTHS");
    let depth = "(SKY_SUN[5 * w + 3] + haze * SKY_SUN[5 * w + 4])";
    text.keep(ValueType::Wide, "through", &format!("exp(-air_mass * {depth})"));
    for (k, c) in PARTS.iter().enumerate() {
        text.line(&format!("light_{c} += through * SKY_SUN[5 * w + {k}];"));
    }
    text.close();
    for c in PARTS {
        text.when(&format!("light_{c} < {zero}"));
        text.line(&format!("light_{c} = {zero};"));
        text.close();
    }
    let value = text.language.triple(["light_x", "light_y", "light_z"]);
    text.line(&format!("sky.sun_light = {value};"));
}

/// Zenith luminance and chromaticities over the sky's shape towards the zenith: the factors of Y, Y/y and Y·x/y.
fn preetham(text: &mut SourceText, closed: bool) {
    let language = text.language;
    let n = |v: f64| language.number(v);
    text.says(
        "luminance and chromaticities at the zenith, over the sky's shape there (Preetham et al. 1999, appendix A.2)",
    );
    let half_turn = format!("({} - {} * theta)", n(PI), n(2.0));
    text.keep(ValueType::Wide, "chi", &format!("({} - turbidity * {}) * {half_turn}", n(4.0 / 9.0), n(1.0 / 120.0)));
    let slope = format!("({} * turbidity - {}) * sky_tangent(chi)", n(4.0453), n(4.9710));
    let luminance = format!("{slope} - {} * turbidity + {}", n(0.2155), n(2.4192));
    let chroma = |m: &[[f64; 4]; 3]| {
        let power = |k: usize| {
            let [a, b, c] = [m[0][k], m[1][k], m[2][k]].map(n);
            format!("(({a} * turbidity + {b}) * turbidity + {c})")
        };
        format!("(({} * theta + {}) * theta + {}) * theta + {}", power(0), power(1), power(2), power(3))
    };
    let zenith = [luminance, chroma(&preetham::ZENITH_X), chroma(&preetham::ZENITH_Y)];
    let one = n(1.0);
    for ((c, rows), zenith) in PARTS.iter().zip(preetham::PEREZ).zip(&zenith) {
        for (k, [slope, offset]) in rows.iter().enumerate() {
            let value = format!("{} * turbidity + {}", n(*slope), n(*offset));
            text.keep(ValueType::Wide, &format!("p{k}_{c}"), &value);
        }
        let overhead = format!("({one} + p0_{c} * exp(p1_{c}))");
        let glow = format!("({one} + p2_{c} * exp(p3_{c} * theta) + p4_{c} * sun_cos * sun_cos)");
        text.keep(ValueType::Wide, &format!("s_{c}"), &format!("({zenith}) / ({overhead} * {glow})"));
    }
    text.keep(ValueType::Wide, "q_x", "s_x");
    text.keep(ValueType::Wide, "q_y", "s_x / s_z");
    text.keep(ValueType::Wide, "q_z", "s_x * s_y / s_z");
    if closed {
        for k in 0..5 {
            let [x, y, z] = PARTS.map(|c| format!("p{k}_{c}"));
            text.line(&format!("sky.perez[{k}] = {};", language.triple([&x, &y, &z])));
        }
        text.line(&format!("sky.scale = {};", language.triple(["q_x", "q_y", "q_z"])));
    }
}

/// The factors of the terms, and the matrix that turns what is stored into linear sRGB: `m_RC`.
fn factors(text: &mut SourceText, e: &Evaluator) {
    let language = text.language;
    let n = |v: f64| language.number(v);
    text.room(ValueType::Wide, "even", e.terms);
    text.room(ValueType::Wide, "odd", e.terms);
    text.var(ValueType::Whole, "t", "0");
    match &e.kind {
        Kind::Folded { rows, back } => {
            let (half, mean) = e.logarithm();
            let width = rows.iter().copied().max().unwrap_or(1).max(2);
            text.says(
                "Chebyshev polynomials of the turbidity's logarithm, and of even and odd degree of the sun's angle",
            );
            let ratio = format!("(turbidity - {}) * {}", n(TURBIDITY_ZERO), n(1.0 / mean));
            text.keep(ValueType::Wide, "v", &format!("sky_logarithm({ratio}) * {}", n(1.0 / half)));
            chebyshev(text, "column", "v", width);
            text.keep(ValueType::Wide, "x", &format!("theta * {}", n(1.0 / FRAC_PI_2)));
            text.keep(ValueType::Wide, "twice", &format!("{} * x * x - {}", n(4.0), n(2.0)));
            for (name, value) in [
                ("even_now", n(1.0)),
                ("even_before", format!("{} * twice", n(0.5))),
                ("odd_now", "x".into()),
                ("odd_before", "x".into()),
                ("later", n(0.0)),
            ] {
                text.var(ValueType::Wide, name, &value);
            }
            text.each("i", "0", &rows.len().to_string());
            text.each("j", "0", "SKY_ROWS[i]");
            ["even", "odd"].iter().for_each(|p| text.line(&format!("{p}[t] = {p}_now * column[j];")));
            text.line("t++;");
            text.close();
            for p in ["even", "odd"] {
                text.line(&format!("later = twice * {p}_now - {p}_before;"));
                text.line(&format!("{p}_before = {p}_now;"));
                text.line(&format!("{p}_now = later;"));
            }
            text.close();
            let colours = rgb_from_separable();
            for (r, row) in colours.iter().enumerate() {
                for c in 0..3 {
                    let part = |q: usize| format!("{} * q_{}", n(row[q] * back[q][c]), PARTS[q]);
                    let sum = (0..3).map(part).collect::<Vec<_>>().join(" + ");
                    text.keep(ValueType::Wide, &format!("m_{r}{c}"), &sum);
                }
            }
        }
        Kind::Tensor { basis, powers: [a, b] } => {
            let [low, high] = e.turbidities;
            match basis {
                PolynomialBasis::Chebyshev => {
                    text.keep(ValueType::Wide, "x", &format!("theta * {} - {}", n(4.0 / PI), n(1.0)));
                    let over = format!("({} * turbidity - {}) * {}", n(2.0), n(low + high), n(1.0 / (high - low)));
                    text.keep(ValueType::Wide, "y", &over);
                    chebyshev(text, "p", "x", (*a).max(2));
                    chebyshev(text, "q", "y", (*b).max(2));
                }
                PolynomialBasis::Monomials => {
                    powers(text, "p", "theta", *a);
                    powers(text, "q", "turbidity", *b);
                }
            }
            text.each("i", "0", &a.to_string());
            text.each("j", "0", &b.to_string());
            ["even", "odd"].iter().for_each(|name| text.line(&format!("{name}[t] = p[i] * q[j];")));
            text.line("t++;");
            text.close();
            text.close();
            for k in 0..9 {
                let value = n(if k % 4 == 0 { 1.0 } else { 0.0 });
                text.keep(ValueType::Wide, &format!("m_{}{}", k / 3, k % 3), &value);
            }
        }
    }
}

fn chebyshev(text: &mut SourceText, name: &str, of: &str, count: usize) {
    let step = format!("{} * {of} * {name}[{name}_at - 1] - {name}[{name}_at - 2]", text.number(2.0));
    recurrence(text, name, of, count, &step);
}

fn powers(text: &mut SourceText, name: &str, of: &str, count: usize) {
    recurrence(text, name, of, count.max(2), &format!("{of} * {name}[{name}_at - 1]"));
}

/// A list that begins with 1 and `of`. Its index has a name of its own, because compilers of HLSL warn where two loops
/// of a function have the same one.
fn recurrence(text: &mut SourceText, name: &str, of: &str, count: usize, step: &str) {
    text.room(ValueType::Wide, name, count);
    text.line(&format!("{name}[0] = {};", text.number(1.0)));
    text.line(&format!("{name}[1] = {of};"));
    text.each(&format!("{name}_at"), "2", &count.to_string());
    text.line(&format!("{name}[{name}_at] = {step};"));
    text.close();
}

/// The coefficients, and the ground's light in them.
fn sums(text: &mut SourceText, e: &Evaluator) {
    let zero = text.number(0.0);
    let nothing = text.language.triple([&zero; 3]);
    text.each("k", "0", &(e.bands * e.bands).to_string());
    text.line(&format!("sky.harmonics[k] = {nothing};"));
    text.close();
    text.each("f", "0", "SKY_FUNCTIONS");
    text.var(ValueType::Triple, "u", &nothing);
    text.says("from the small terms of high degree to the large ones");
    text.each("i", "0", "SKY_TERMS");
    text.keep(ValueType::Whole, "k", "SKY_TERMS - 1 - i");
    text.keep(ValueType::Whole, "place", "3 * (f * SKY_TERMS + k)");
    text.var(ValueType::Real, "factor", "even[k]");
    text.when("f >= SKY_EVEN");
    text.line("factor = odd[k];");
    text.close();
    for (k, c) in PARTS.iter().enumerate() {
        text.line(&format!("u.{c} += factor * SKY_VALUES[place + {k}];"));
    }
    text.close();
    for (r, c) in PARTS.iter().enumerate() {
        text.line(&format!("sky.harmonics[SKY_PLACE[f]].{c} = m_{r}0 * u.x + m_{r}1 * u.y + m_{r}2 * u.z;"));
    }
    text.close();
    if e.bands < 2 {
        text.line(&format!("sky.ground_light = {nothing};"));
        return;
    }
    text.says("the ground's radiance: its albedo times its irradiance, which is harmonic 2 but for a factor, over pi");
    let share = text.number((4.0 * PI / 3.0).sqrt() / PI);
    let of = |c: &str| format!("SKY_GROUND * {share} * sky.harmonics[2].{c}");
    let value = text.language.triple([&of("x"), &of("y"), &of("z")]);
    text.line(&format!("sky.ground_light = {value};"));
    text.each("l", "0", "SKY_BANDS");
    for c in PARTS {
        text.line(&format!("sky.harmonics[l * (l + 1)].{c} += sky.ground_light.{c} * SKY_BELOW[l];"));
    }
    text.close();
}
