//! The functions of a sky in any of the languages: radiance and irradiance by the harmonics, the sky itself by its
//! closed form, the sun and its disk.

use super::language::{SourceText, ValueType};
use super::state::SkyAccess;
use mesophyll_sky::harmonics::HarmonicBasis;
use mesophyll_sky::irradiance::cosine_lobe;
use mesophyll_sky::polynomials::mix::rgb_from_separable;
use mesophyll_sky::sun::RADIUS_DEG;
use std::f64::consts::{FRAC_PI_2, PI};

/// Closer to the horizon than this, the horizon factor is its limit in double precision.
const HORIZON: f64 = 1e-4;

/// Writes all functions that are called with a direction.
pub fn write(text: &mut SourceText, access: SkyAccess, bands: usize) {
    harmonics(text, access, bands, "sky_radiance", |_| 1.0);
    harmonics(text, access, bands, "sky_irradiance", cosine_lobe);
    sun(text, access);
    if access.closed {
        arctangent(text);
        drawn(text, access);
    }
}

/// A polynomial of a square: Σ c_k s^k, written from the inside.
pub fn series(text: &SourceText, square: &str, terms: impl DoubleEndedIterator<Item = f64>) -> String {
    terms.rev().fold(String::new(), |inner, share| {
        let share = text.number(share);
        if inner.is_empty() { share } else { format!("({share} + {square} * {inner})") }
    })
}

/// x, y and z of the direction, turned about the z axis so that the sun is at azimuth 0.
fn turned(text: &mut SourceText, access: SkyAccess, name: &str) {
    let (cos, sin) = (access.at("azimuth_cos"), access.at("azimuth_sin"));
    text.keep(ValueType::Real, "x", &format!("{name}.x * {cos} + {name}.y * {sin}"));
    text.keep(ValueType::Real, "y", &format!("{name}.y * {cos} - {name}.x * {sin}"));
    text.keep(ValueType::Real, "z", &format!("{name}.z"));
}

/// Σ A_l c_lm Y_lm, with the basis spelled out by its recurrences. The sun is at azimuth 0, so that m < 0 are zero.
fn harmonics(text: &mut SourceText, access: SkyAccess, bands: usize, name: &str, weight: fn(usize) -> f64) {
    let argument = if name == "sky_radiance" {
        text.says(
            "Radiance (kcd/m2) from a unit direction, by the harmonics: smooth, for lighting and not for drawing.",
        );
        "direction"
    } else {
        text.says("Irradiance (klx) of sky and ground, without the sun, on a surface with this unit normal.");
        "normal"
    };
    let mut takes = access.takes();
    takes.push((ValueType::Triple, argument));
    text.function(ValueType::Triple, name, &takes);
    turned(text, access, argument);
    let zero = text.number(0.0);
    text.var(ValueType::Real, "order_cos", &text.number(1.0));
    text.var(ValueType::Real, "order_sin", &zero);
    text.var(ValueType::Real, "value", &zero);
    text.var(ValueType::Real, "before", &zero);
    text.var(ValueType::Real, "later", &zero);
    text.var(ValueType::Triple, "sum", &text.language.triple([&zero; 3]));
    let basis = HarmonicBasis::new(bands);
    for m in 0..bands {
        let (first, steps) = basis.recurrence(m);
        text.says(&format!("m = {m}"));
        if m > 0 {
            text.line("later = order_cos * x - order_sin * y;");
            text.line("order_sin = order_cos * y + order_sin * x;");
            text.line("order_cos = later;");
        }
        text.line(&format!("value = {} * order_cos;", text.number(first)));
        for l in m..bands {
            if l > m {
                let [alpha, beta] = steps[l - m - 1].map(|v| text.number(v));
                if l == m + 1 {
                    text.line("before = value;");
                    text.line(&format!("value = {alpha} * z * value;"));
                } else {
                    text.line(&format!("later = {alpha} * (z * value - {beta} * before);"));
                    text.line("before = value;");
                    text.line("value = later;");
                }
            }
            let by = match weight(l) {
                0.0 => continue,
                1.0 => "value".to_string(),
                w => format!("{} * value", text.number(w)),
            };
            text.add("sum", &by, &format!("{}[{}]", access.at("harmonics"), l * (l + 1) + m));
        }
    }
    text.line("return sum;");
    text.end();
}

fn sun(text: &mut SourceText, access: SkyAccess) {
    let (cos, sin) = (access.at("sun_cos"), access.at("sun_sin"));
    text.says("Unit vector to the sun.");
    text.function(ValueType::Triple, "sky_sun_direction", &access.takes());
    let part = |turn: &str| format!("{sin} * {}", access.at(turn));
    let value = text.language.triple([&part("azimuth_cos"), &part("azimuth_sin"), &cos]);
    text.line(&format!("return {value};"));
    text.end();
    text.says("The sun's colour: its light (klx) on a surface that faces it; times the cosine on any other.");
    text.function(ValueType::Triple, "sky_sun_light", &access.takes());
    text.line(&format!("return {};", access.at("sun_light")));
    text.end();
    let (edge, sine) = (RADIUS_DEG.to_radians(), RADIUS_DEG.to_radians().sin());
    text.says(&format!(
        "Radiance (kcd/m2) of the sun's disk from a unit direction: {RADIUS_DEG} degrees in radius, even"
    ));
    text.says("over the disk, zero beside it and below the horizon. Add it to the sky's own.");
    let mut takes = access.takes();
    takes.push((ValueType::Triple, "direction"));
    text.function(ValueType::Triple, "sky_sun_disk", &takes);
    turned(text, access, "direction");
    text.keep(ValueType::Real, "u", &format!("x - {sin}"));
    text.keep(ValueType::Real, "w", &format!("z - {cos}"));
    let zero = text.number(0.0);
    text.var(ValueType::Real, "share", &zero);
    // by the chord, because a cosine has no digits left at such a small angle
    let chord = text.number((2.0 * (0.5 * edge).sin()).powi(2));
    text.when(&format!("z >= {zero} && u * u + y * y + w * w <= {chord}"));
    text.line(&format!("share = {};", text.number(1.0 / (PI * sine * sine))));
    text.close();
    let part = |c: &str| format!("share * {}.{c}", access.at("sun_light"));
    let value = text.language.triple([&part("x"), &part("y"), &part("z")]);
    text.line(&format!("return {value};"));
    text.end();
}

/// The arc tangent of 0 to 1.
fn arctangent(text: &mut SourceText) {
    text.function(ValueType::Wide, "sky_arctangent", &[(ValueType::Wide, "tangent")]);
    if text.language.is_shader() {
        text.says("by half the angle; shaders' own arc tangents may be wrong in the fourth digit");
        let one = text.number(1.0);
        text.keep(ValueType::Wide, "h", &format!("tangent / ({one} + sqrt({one} + tangent * tangent))"));
        text.keep(ValueType::Wide, "h2", "h * h");
        let terms = (0..10).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 } / f64::from(2 * k + 1));
        text.line(&format!("return {} * h * {};", text.number(2.0), series(text, "h2", terms)));
    } else {
        text.line("return atan(tangent);");
    }
    text.end();
}

/// Preetham's sky in a direction.
fn drawn(text: &mut SourceText, access: SkyAccess) {
    text.says(
        "Radiance (kcd/m2) from a unit direction, for drawing: Preetham's formulas themselves, without harmonics",
    );
    text.says("and without the sun's disk. Below the horizon it is the ground. Blue may dip below zero.");
    let mut takes = access.takes();
    takes.push((ValueType::Triple, "direction"));
    text.function(ValueType::Triple, "sky_drawn", &takes);
    let (zero, one) = (text.number(0.0), text.number(1.0));
    text.when(&format!("direction.z < {zero}"));
    text.line(&format!("return {};", access.at("ground_light")));
    text.close();
    turned(text, access, "direction");
    let (cos, sin) = (access.at("sun_cos"), access.at("sun_sin"));
    text.says("the angle to the sun, by the chords to it and to the point opposite");
    text.keep(
        ValueType::Wide,
        "chord",
        &format!("sqrt((x - {sin}) * (x - {sin}) + y * y + (z - {cos}) * (z - {cos}))"),
    );
    text.keep(
        ValueType::Wide,
        "opposite",
        &format!("sqrt((x + {sin}) * (x + {sin}) + y * y + (z + {cos}) * (z + {cos}))"),
    );
    text.var(ValueType::Wide, "angle", &zero);
    text.when("chord <= opposite");
    let twice = text.number(2.0);
    text.line(&format!("angle = {twice} * sky_arctangent(chord / opposite);"));
    text.close();
    text.when("chord > opposite");
    text.line(&format!("angle = {} - {twice} * sky_arctangent(opposite / chord);", text.number(2.0 * FRAC_PI_2)));
    text.close();
    text.keep(ValueType::Wide, "toward", &format!("x * {sin} + z * {cos}"));
    text.var(ValueType::Wide, "inverse", &text.number(1.0 / HORIZON));
    text.when(&format!("z > {}", text.number(HORIZON)));
    text.line(&format!("inverse = {one} / z;"));
    text.close();
    for c in ["x", "y", "z"] {
        let perez = |k: usize| format!("{}[{k}].{c}", access.at("perez"));
        let horizon = format!("({one} + {} * exp({} * inverse))", perez(0), perez(1));
        let glow = format!("({one} + {} * exp({} * angle) + {} * toward * toward)", perez(2), perez(3), perez(4));
        text.keep(ValueType::Wide, &format!("f_{c}"), &format!("{horizon} * {glow}"));
    }
    let scale = |c: &str| format!("{}.{c}", access.at("scale"));
    text.says("Y, Y/y and Y x/y");
    text.keep(ValueType::Wide, "a", &format!("{} * f_x", scale("x")));
    text.keep(ValueType::Wide, "b", &format!("{} * f_x / f_z", scale("y")));
    text.keep(ValueType::Wide, "c", &format!("{} * f_x * f_y / f_z", scale("z")));
    let rows = rgb_from_separable().map(|row| {
        let [p, q, r] = row.map(|v| text.number(v));
        format!("{p} * a + {q} * b + {r} * c")
    });
    let value = text.language.triple([&rows[0], &rows[1], &rows[2]]);
    text.line(&format!("return {value};"));
    text.end();
}
