//! The sky as JSON: the arrays, every constant that the evaluation needs, and the evaluation in words.

use super::{Evaluator, Kind, SkyExportOptions, constants};
use crate::{Error, Result};
use mesophyll_fits::record::{FitRecord, FitTimes};
use mesophyll_sky::HarmonicCoefficients;
use mesophyll_sky::polynomials::PolynomialBasis;
use mesophyll_sky::polynomials::mix::TURBIDITY_ZERO;
use serde_json::{Value, json};
use std::path::Path;

fn conventions(sun: &str) -> Value {
    json!({
        "harmonics": "real, orthonormal, no Condon-Shortley phase, index l(l+1)+m; cos(m phi) for m > 0, sin(|m| phi) \
         for m < 0",
        "axes": format!("z up, {sun}, azimuth from +x to +y"),
        "hemisphere": "upper; zero below the horizon, but for ground light",
        "unit": "kcd/m2",
        "colour": "linear sRGB, not clamped",
        "sun": "zenith angle in radians, its disk is not part of the sky",
    })
}

fn finished(value: &Value) -> Result<String> {
    serde_json::to_string(value).map(|t| t + "\n").map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))
}

fn error(record: &FitRecord) -> Value {
    let figure = |name: &str| record.sections.get("all").and_then(|s| s.figures.get(name)).copied();
    json!({
        "worst": figure("error_worst"),
        "median": figure("error_median"),
        "smallest_c00": figure("smallest_c00"),
        "measure": "root of the sum of squared coefficient errors over the smallest c00 of the domain, worst channel",
    })
}

pub fn fixed(
    c: &HarmonicCoefficients,
    record: &FitRecord,
    options: &SkyExportOptions,
    sun: f64,
    turbidity: f64,
) -> Result<String> {
    finished(&json!({
        "name": record.name,
        "program": record.program,
        "conventions": conventions("the sun at sun_azimuth"),
        "sun_zenith": sun,
        "sun_azimuth": options.azimuth,
        "turbidity": turbidity,
        "ground": options.ground,
        "error": error(record),
        "bands": c.bands(),
        "coefficients": c.values(),
    }))
}

pub fn polynomials(e: &Evaluator, record: &FitRecord, folder: &Path, ground: f64) -> Result<String> {
    let functions: Vec<Value> = e
        .groups
        .iter()
        .enumerate()
        .flat_map(|(k, g)| {
            g.places
                .iter()
                .zip(g.values.chunks_exact(e.terms))
                .map(move |(place, values)| json!({"index": place, "factors": k, "values": values}))
        })
        .collect();
    let mut sky = json!({
        "conventions": conventions("the sun at azimuth 0 = +x"),
        "error": error(record),
        "bands": e.bands,
        "sun_zenith": [0.0, std::f64::consts::FRAC_PI_2],
        "turbidity": e.turbidities,
        "ground": ground,
        "ground_shares": e.ground_shares(),
        "ground_light": "with albedo a > 0 add a ground_shares[l] c[2] to c[l(l+1)]; c[2] before the addition",
        "terms": e.terms,
        "functions": functions,
    });
    let more = match &e.kind {
        Kind::Folded { rows, back } => {
            let constants = constants();
            json!({
                "form": "folded",
                "rows": rows,
                "turbidity_zero": TURBIDITY_ZERO,
                "colours": constants.colours,
                "back": back,
                "perez": constants.perez,
                "zenith_x": constants.zenith[0],
                "zenith_y": constants.zenith[1],
                "evaluation": [
                    "v = ln(turbidity - turbidity_zero) scaled linearly to -1 at the lower and 1 at the upper \
                     turbidity; x = sun_zenith/(pi/2)",
                    "term (i, j), j < rows[i], i rising, j fastest: factors 0: T_2i(x) T_j(v), factors 1: T_2i+1(x) \
                     T_j(v), T Chebyshev",
                    "u = sum over terms of factor times values (three a term)",
                    "A..E = slope turbidity + offset of perez[Y, x, y]; chi = (4/9 - turbidity/120)(pi - 2 sun_zenith)",
                    "Y = (4.0453 turbidity - 4.9710) tan chi - .2155 turbidity + 2.4192; x, y = [t^2 t 1] zenith [s^3 \
                     s^2 s 1], t turbidity, s sun_zenith",
                    "Y, x, y each over (1 + A e^B)(1 + C e^(D s) + E cos^2 s); p = (Y, Y/y, Y x/y)",
                    "rgb = colours diag(p) back u",
                ],
            })
        }
        Kind::Tensor { basis, powers } => json!({
            "form": "tensor",
            "basis": if *basis == PolynomialBasis::Chebyshev { "chebyshev" } else { "monomials" },
            "powers": powers,
            "evaluation": [
                "chebyshev: sun_zenith and turbidity scaled to -1 .. 1 over their domains; monomials: as they are",
                "term (i, j), j fastest: P_i(sun) P_j(turbidity); rgb = sum over terms of factor times values",
            ],
        }),
    };
    if let (Some(sky), Value::Object(more)) = (sky.as_object_mut(), more) {
        sky.extend(more);
    }
    finished(&json!({"fit": record, "times": FitTimes::read(folder).ok(), "sky": sky}))
}
