//! WGSL that sums harmonics of light in a direction. It is written without loops, because loops with computed indices
//! took more time than all maps of a leaf together (on a software adapter).

/// Weights of the bands of a cosine over π (Ramamoorthi and Hanrahan 2001).
const COSINE: [f64; 7] = [1.0, 2.0 / 3.0, 0.25, 0.0, -1.0 / 24.0, 0.0, 1.0 / 64.0];

/// The function `gathered(d, w)`, which is Σ w_l c_lm Y_lm(d) and at least 0, for this number of bands. It calls
/// `coefficient(k)` for c_lm, where k = l(l+1) + m. With `even`, it is followed by `even_light(d)`, the irradiance over
/// π on a surface with the normal `d`.
pub(crate) fn source(bands: usize, even: bool) -> String {
    let all: Vec<(usize, String)> = (0..bands).map(|l| (l, format!("w[{l}]"))).collect();
    let mut out = function("gathered(d: vec3f, w: array<f32, 7>)", &all);
    if even {
        let cosine = (0..bands.min(7)).filter(|l| COSINE[*l] != 0.0).map(|l| (l, float(COSINE[l])));
        out += &function("even_light(d: vec3f)", &cosine.collect::<Vec<_>>());
    }
    out
}

/// A function with a sum over bands, each with its weight. By recurrence, p_mm = 1 and
/// (l−m) p_l = (2l−1) z p_{l−1} − (l+m−1) p_{l−2}. These are multiplied by the real and imaginary parts of (x + iy)^m.
fn function(head: &str, bands: &[(usize, String)]) -> String {
    let last = bands.iter().map(|b| b.0).max().unwrap_or(0);
    let mut lines = vec![format!("fn {head} -> vec3f {{")];
    for m in 0..=last {
        match m {
            0 => {}
            1 => lines.push("let c1 = d.x;\nlet s1 = d.y;".into()),
            _ => lines
                .push(format!("let c{m} = c{b} * d.x - s{b} * d.y;\nlet s{m} = c{b} * d.y + s{b} * d.x;", b = m - 1)),
        }
        for l in m + 1..=last {
            let over = (l - m) as f64;
            let first = format!("{} * d.z * p{}_{m}", float((2 * l - 1) as f64 / over), l - 1);
            lines.push(match l - m {
                1 => format!("let p{l}_{m} = {} * d.z;", float((2 * l - 1) as f64)),
                2 => format!("let p{l}_{m} = {first} - {};", float((l + m - 1) as f64 / over)),
                _ => format!("let p{l}_{m} = {first} - {} * p{}_{m};", float((l + m - 1) as f64 / over), l - 2),
            });
        }
    }
    lines.push("var sum = vec3f(0.0);".into());
    for (l, weight) in bands {
        let middle = l * (l + 1);
        let term = |m: usize| {
            let round = match m {
                0 => format!("coefficient({middle})"),
                _ => format!("(c{m} * coefficient({}) + s{m} * coefficient({}))", middle + m, middle - m),
            };
            if *l == m { round } else { format!("p{l}_{m} * {round}") }
        };
        let terms: Vec<String> = (0..=*l).map(term).collect();
        lines.push(format!("sum += {weight} * ({});", terms.join(" + ")));
    }
    lines.push("return max(sum, vec3f(0.0));\n}\n".into());
    lines.join("\n")
}

/// A number as WGSL writes it.
fn float(x: f64) -> String {
    format!("{:?}", x as f32)
}
