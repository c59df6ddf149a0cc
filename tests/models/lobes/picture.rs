//! `docs/lobes.svg`: a leaf's reflectance in the plane of incidence with the fits of the three lobes, and the gain by
//! the long tail for each scan.

use super::Leaf;
use mesophyll::optics::gloss::Lobe;
use std::fmt::Write;

/// The scan that is drawn. It has the median RMS over all three lobes.
const SHOWN: &str = "qlo-40-26";
/// Value column that is drawn (550 nm).
const BAND: usize = 1;
const KINDS: [(Lobe, &str, &str); 3] = [
    (Lobe::Beckmann, "beckmann", "#0072b2"),
    (Lobe::Ggx, "ggx", "#d55e00"),
    (Lobe::CookTorrance { index: 1.45 }, "cook-torrance, n = 1.45", "#009e73"),
];

/// A linear map of values to places.
fn scale(from: [f64; 2], to: [f64; 2]) -> impl Fn(f64) -> f64 {
    move |v| to[0] + (v - from[0]) / (from[1] - from[0]) * (to[1] - to[0])
}

pub fn draw(leaves: &[Leaf]) -> String {
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 980 440\" font-family=\"sans-serif\" \
         font-size=\"13\">\n\
         <title>Which lobe real leaves want</title>\n<rect width=\"980\" height=\"440\" fill=\"white\"/>\n",
    );
    curves(&mut svg, leaves.iter().find(|l| l.name == SHOWN).expect("the scan that is drawn"));
    gains(&mut svg, leaves);
    svg.push_str("</svg>\n");
    svg
}

fn text(svg: &mut String, x: f64, y: f64, anchor: &str, words: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>");
}

fn line(svg: &mut String, a: [f64; 2], b: [f64; 2], colour: &str) {
    let _ = writeln!(
        svg,
        "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{colour}\" fill=\"none\"/>",
        a[0], a[1], b[0], b[1]
    );
}

/// Measured points in the plane of incidence, and the fitted curves. The view's zenith angle is positive on the mirror
/// side.
fn curves(svg: &mut String, leaf: &Leaf) {
    let (x, y) = (scale([-65.0, 65.0], [60.0, 520.0]), scale([0.0, 0.34], [380.0, 50.0]));
    let place = format!(
        "{}, <tspan font-style=\"italic\">{}</tspan>, 550 nm, source at {:.0}°",
        leaf.name, leaf.species, leaf.samples[0].source
    );
    text(svg, 60.0, 28.0, "start", &place);
    for zenith in [-60, -30, 0, 30, 60] {
        line(svg, [x(zenith.into()), 380.0], [x(zenith.into()), 50.0], "#eee");
        text(svg, x(zenith.into()), 398.0, "middle", &format!("{zenith}°"));
    }
    for k in 0..=3 {
        let v = 0.1 * f64::from(k);
        line(svg, [60.0, y(v)], [520.0, y(v)], "#eee");
        text(svg, 54.0, y(v) + 4.0, "end", &format!("{v:.1}"));
    }
    text(svg, 290.0, 422.0, "middle", "view zenith in the plane of incidence (mirror side positive)");
    let _ = writeln!(
        svg,
        "<text transform=\"translate(18 215) rotate(-90)\" text-anchor=\"middle\">reflectance factor</text>"
    );
    let source = leaf.samples[0].source.to_radians();
    let light = [source.sin(), 0.0, source.cos()];
    for (k, (lobe, name, colour)) in KINDS.into_iter().enumerate() {
        let f = &leaf.fits[k];
        let (t, ty) = (f["tilt"], f["tilt_y"]);
        let normal = [t.sin() * ty.cos(), ty.sin(), t.cos() * ty.cos()];
        let brf = |zenith: f64| {
            let z = zenith.to_radians();
            f["rho_d_brf_550"]
                + std::f64::consts::PI * f["rho_s"] * lobe.value(normal, light, [-z.sin(), 0.0, z.cos()], f["m"])
        };
        let points: Vec<String> =
            (-130..=130).map(|k| 0.5 * f64::from(k)).map(|z| format!("{:.1} {:.1}", x(z), y(brf(z)))).collect();
        // Beckmann and Cook-Torrance almost coincide, so dashes show both.
        let dash = if k == 2 { " stroke-dasharray=\"7 7\"" } else { "" };
        let _ = writeln!(
            svg,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"{dash}/>",
            points.join("L")
        );
        let row = 66.0 + 20.0 * k as f64;
        let _ = writeln!(svg, "<path d=\"M80 {row}H108\" stroke=\"{colour}\" stroke-width=\"3\"/>");
        text(svg, 116.0, row + 4.0, "start", &format!("{name}: m {:.2}, RMS {:.4}", f["m"], leaf.rms(k)));
    }
    let _ = writeln!(svg, "<circle cx=\"94\" cy=\"126\" r=\"4\"/>");
    text(svg, 116.0, 130.0, "start", "measured");
    for s in &leaf.samples {
        let side = if s.azimuth == 180.0 { 1.0 } else { -1.0 };
        if s.azimuth == 0.0 || s.azimuth == 180.0 {
            let _ = writeln!(svg, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\"/>", x(side * s.zenith), y(s.brf[BAND]));
        }
    }
}

/// ΔAIC of every scan, largest first.
fn gains(svg: &mut String, leaves: &[Leaf]) {
    let mut order: Vec<&Leaf> = leaves.iter().collect();
    order.sort_by(|a, b| b.delta_aic().total_cmp(&a.delta_aic()));
    let x = scale([-20.0, 60.0], [650.0, 950.0]);
    text(svg, 800.0, 28.0, "middle", "what the long tail gains: AIC(beckmann) − AIC(ggx)");
    for v in [-20, 0, 20, 40, 60] {
        line(svg, [x(v.into()), 40.0], [x(v.into()), 380.0], if v == 0 { "#888" } else { "#eee" });
        text(svg, x(v.into()), 398.0, "middle", &v.to_string());
    }
    for (k, leaf) in order.iter().enumerate() {
        let (y, d) = (54.0 + 22.0 * k as f64, leaf.delta_aic());
        let colour = if d > 0.0 { KINDS[1].2 } else { KINDS[0].2 };
        text(svg, 642.0, y + 4.0, "end", &leaf.name);
        let _ = writeln!(svg, "<path d=\"M{:.1} {y:.1}H{:.1}\" stroke=\"{colour}\" stroke-width=\"3\"/>", x(0.0), x(d));
        let _ = writeln!(svg, "<circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"{colour}\"/>", x(d));
    }
    text(svg, 800.0, 422.0, "middle", "orange: the long-tailed lobe fits better; blue: Beckmann's");
}
