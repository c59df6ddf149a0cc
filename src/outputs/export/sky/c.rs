//! The sky as a C header (C99, one file, no state): arrays in float, the few factors of a sky in double, sums in
//! `MESOPHYLL_SKY_REAL`.

use super::{Constants, Evaluator, Kind, constants, listed};
use mesophyll_sky::HarmonicCoefficients;
use mesophyll_sky::polynomials::PolynomialBasis;
use mesophyll_sky::polynomials::mix::TURBIDITY_ZERO;

fn head(about: &[String]) -> String {
    let lines: String = about.iter().map(|l| format!(" * {l}").trim_end().to_string() + "\n").collect();
    format!("/*\n{lines} */\n#ifndef MESOPHYLL_SKY_H\n#define MESOPHYLL_SKY_H\n\n")
}

pub fn fixed(c: &HarmonicCoefficients, about: &[String]) -> String {
    let mut out = head(about);
    let n = c.values().len();
    out.push_str(&format!("#define MESOPHYLL_SKY_BANDS {}\n\n", c.bands()));
    out.push_str("/* R, G, B at l(l+1)+m. */\n");
    out.push_str(&format!("static const float mesophyll_sky[{n}][3] = {{\n"));
    for v in c.values() {
        let [r, g, b] = v.map(|x| x as f32);
        out.push_str(&format!("    {{{r:e}f, {g:e}f, {b:e}f}},\n"));
    }
    out.push_str("};\n\n#endif\n");
    out
}

pub fn polynomials(e: &Evaluator, about: &[String], ground: f64) -> String {
    let mut out = head(about);
    let (n, functions) = (e.bands * e.bands, e.groups.iter().map(|g| g.places.len()).sum::<usize>());
    out.push_str("#include <math.h>\n\n/* float or double: what the sums are formed and handed back in. */\n");
    out.push_str("#ifndef MESOPHYLL_SKY_REAL\n#define MESOPHYLL_SKY_REAL float\n#endif\n");
    out.push_str("/* Albedo of level ground that lights the lower hemisphere; 0 leaves it dark. */\n");
    out.push_str(&format!("#ifndef MESOPHYLL_SKY_GROUND\n#define MESOPHYLL_SKY_GROUND {ground:?}\n#endif\n\n"));
    out.push_str(&format!("#define MESOPHYLL_SKY_BANDS {}\n#define MESOPHYLL_SKY_TERMS {}\n\n", e.bands, e.terms));
    let places: Vec<String> = e.groups.iter().flat_map(|g| &g.places).map(|p| p.to_string()).collect();
    out.push_str(&format!(
        "/* l(l+1)+m of every function; the first {} take the first factors, the others the second. */\n",
        e.first()
    ));
    out.push_str(&format!(
        "static const unsigned char mesophyll_sky_place[{functions}] = {{{}}};\n",
        places.join(", ")
    ));
    out.push_str("/* Function by function, term by term, three values. */\n");
    out.push_str(&format!(
        "static const float mesophyll_sky_values[{}] = {{\n{}}};\n\n",
        functions * e.terms * 3,
        listed(e.values(), 8, "f")
    ));
    out.push_str(
        "/* The coefficients for a sun zenith angle (rad) and turbidity; 0 where these are outside the domain \
     (out is left as it is), else 1. */\n",
    );
    out.push_str(&format!(
        "static int mesophyll_sky(double sun_zenith, double turbidity, MESOPHYLL_SKY_REAL out[{n}][3])\n{{\n"
    ));
    let [low, high] = e.turbidities;
    out.push_str(&format!("    double first[{0}], second[{0}], m[3][3];\n    int i, j, k, t = 0, f;\n", e.terms));
    out.push_str(&format!(
        "    if (!(sun_zenith >= 0.0 && sun_zenith <= 1.5708 && turbidity >= {low:?} && turbidity <= {high:?})) return \
         0;\n"
    ));
    out.push_str("    if (sun_zenith > 1.5707963267948966) sun_zenith = 1.5707963267948966;\n");
    match &e.kind {
        Kind::Folded { rows, back } => folded(&mut out, e, rows, back),
        Kind::Tensor { basis, powers } => tensor(&mut out, e, *basis, *powers),
    }
    out.push_str(&format!(
        "    for (i = 0; i < {n}; i++) out[i][0] = out[i][1] = out[i][2] = 0;
    for (f = 0; f < {functions}; f++) {{
        const float *a = mesophyll_sky_values + f * MESOPHYLL_SKY_TERMS * 3;
        const double *factor = f < {first} ? first : second;
        MESOPHYLL_SKY_REAL u[3] = {{0, 0, 0}};
        for (t = MESOPHYLL_SKY_TERMS - 1; t >= 0; t--)
            for (k = 0; k < 3; k++) u[k] += (MESOPHYLL_SKY_REAL)factor[t] * a[3 * t + k];
        for (k = 0; k < 3; k++)
            out[mesophyll_sky_place[f]][k] =
                (MESOPHYLL_SKY_REAL)m[k][0] * u[0] + (MESOPHYLL_SKY_REAL)m[k][1] * u[1] + (MESOPHYLL_SKY_REAL)m[k][2] \
                * u[2];
    }}\n",
        first = e.first()
    ));
    if e.bands > 1 {
        let shares: Vec<String> = e.ground_shares().iter().map(|s| format!("{s:?}")).collect();
        out.push_str(&format!(
            "    {{
        /* the ground's radiance is the albedo times its irradiance, which is c[2] but for a factor, over pi */
        static const double below[{}] = {{{}}};
        for (k = 0; k < 3; k++) {{
            const double light = (MESOPHYLL_SKY_GROUND) * out[2][k];
            for (i = 0; i < {}; i++) out[i * (i + 1)][k] += (MESOPHYLL_SKY_REAL)(light * below[i]);
        }}
    }}\n",
            e.bands,
            shares.join(", "),
            e.bands
        ));
    }
    out.push_str("    return 1;\n}\n\n#endif\n");
    out
}

fn matrix<const R: usize, const C: usize>(m: &[[f64; C]; R]) -> String {
    let rows: Vec<String> = m
        .iter()
        .map(|r| format!("{{{}}}", r.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ")))
        .collect();
    format!("{{{}}}", rows.join(", "))
}

fn folded(out: &mut String, e: &Evaluator, rows: &[usize], back: &[[f64; 3]; 3]) {
    let Constants { perez, zenith, colours } = constants();
    let (half, mean) = e.logarithm();
    let columns = rows.iter().copied().max().unwrap_or(1);
    let list: Vec<String> = rows.iter().map(|r| r.to_string()).collect();
    // Perez rows as slopes and offsets apart
    let slopes: [[f64; 5]; 3] = perez.map(|r| r.map(|p| p[0]));
    let offsets: [[f64; 5]; 3] = perez.map(|r| r.map(|p| p[1]));
    out.push_str(&format!(
        "    {{
        /* Chebyshev polynomials of ln(turbidity - {TURBIDITY_ZERO}), and those of even and odd degree of the sun's \
        angle */
        static const int rows[{count}] = {{{list}}};
        const double v = log((turbidity - {TURBIDITY_ZERO}) / {mean:?}) / {half:?};
        const double x = sun_zenith / 1.5707963267948966, twice = 4.0 * x * x - 2.0;
        double column[{width}], even = 1.0, odd = x, even_before = 0.5 * twice, odd_before = x, next;
        column[0] = 1.0;
        for (j = 1; j < {columns}; j++) column[j] = j == 1 ? v : 2.0 * v * column[j - 1] - column[j - 2];
        for (i = 0; i < {count}; i++) {{
            for (j = 0; j < rows[i]; j++, t++) {{
                first[t] = even * column[j];
                second[t] = odd * column[j];
            }}
            next = twice * even - even_before; even_before = even; even = next;
            next = twice * odd - odd_before; odd_before = odd; odd = next;
        }}
    }}
    {{
        /* zenith luminance and chromaticity over the sky's shape towards the zenith (Preetham et al. 1999, appendix \
        A.2) */
        static const double slope[3][5] = {slopes};
        static const double offset[3][5] = {offsets};
        static const double zenith_x[3][4] = {zx};
        static const double zenith_y[3][4] = {zy};
        static const double colours[3][3] = {colours};
        static const double back[3][3] = {back};
        const double c = cos(sun_zenith), chi = (4.0 / 9.0 - turbidity / 120.0) * (3.141592653589793 - 2.0 * \
        sun_zenith);
        double s[3] = {{(4.0453 * turbidity - 4.9710) * tan(chi) - 0.2155 * turbidity + 2.4192, 0.0, 0.0}}, p[3];
        for (j = 0; j < 4; j++) {{
            s[1] = s[1] * sun_zenith + (zenith_x[0][j] * turbidity + zenith_x[1][j]) * turbidity + zenith_x[2][j];
            s[2] = s[2] * sun_zenith + (zenith_y[0][j] * turbidity + zenith_y[1][j]) * turbidity + zenith_y[2][j];
        }}
        for (k = 0; k < 3; k++) {{
            double q[5];
            for (j = 0; j < 5; j++) q[j] = slope[k][j] * turbidity + offset[k][j];
            s[k] /= (1.0 + q[0] * exp(q[1])) * (1.0 + q[2] * exp(q[3] * sun_zenith) + q[4] * c * c);
        }}
        p[0] = s[0]; p[1] = s[0] / s[2]; p[2] = s[0] * s[1] / s[2];
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++)
                m[i][j] = colours[i][0] * p[0] * back[0][j] + colours[i][1] * p[1] * back[1][j] + colours[i][2] * p[2] \
                * back[2][j];
    }}\n",
        count = rows.len(),
        list = list.join(", "),
        width = columns.max(1),
        slopes = matrix(&slopes),
        offsets = matrix(&offsets),
        zx = matrix(&zenith[0]),
        zy = matrix(&zenith[1]),
        colours = matrix(&colours),
        back = matrix(back),
    ));
}

fn tensor(out: &mut String, e: &Evaluator, basis: PolynomialBasis, [a, b]: [usize; 2]) {
    let [low, high] = e.turbidities;
    let body = match basis {
        PolynomialBasis::Chebyshev => format!(
            "        const double x = sun_zenith * 1.2732395447351628 - 1.0, y = (2.0 * turbidity - {:?}) / {:?};
        for (i = 0; i < {a}; i++) p[i] = i == 0 ? 1.0 : i == 1 ? x : 2.0 * x * p[i - 1] - p[i - 2];
        for (j = 0; j < {b}; j++) q[j] = j == 0 ? 1.0 : j == 1 ? y : 2.0 * y * q[j - 1] - q[j - 2];\n",
            low + high,
            high - low
        ),
        PolynomialBasis::Monomials => format!(
            "        for (i = 0; i < {a}; i++) p[i] = i == 0 ? 1.0 : sun_zenith * p[i - 1];
        for (j = 0; j < {b}; j++) q[j] = j == 0 ? 1.0 : turbidity * q[j - 1];\n"
        ),
    };
    out.push_str(&format!(
        "    {{
        double p[{a}], q[{b}];
{body}        for (i = 0; i < {a}; i++)
            for (j = 0; j < {b}; j++, t++) first[t] = second[t] = p[i] * q[j];
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) m[i][j] = i == j ? 1.0 : 0.0;
    }}\n"
    ));
}
