use super::plane::{inner_reflectance, radius_of, spread};
use super::vein::{Ridge, Where, model, read};
use super::*;
use crate::optics::dipole::{Form, Tissue};

#[test]
fn rms_and_half_light_radius_are_those_of_the_kernel() {
    // by quadrature of `beyond`: <r²> = ∫ 2 r beyond(r) dr / total
    for (d, form) in [(0.2, Form::Thin), (0.5, Form::Images), (0.2, Form::Dipoles(3))] {
        let (t, n, end) = (Tissue::TABLE, 4000, 8.0);
        let sum: f64 = (0..n)
            .map(|k| {
                let r = (k as f64 + 0.5) / n as f64 * end;
                2.0 * r * t.beyond(r, d, form) * end / n as f64
            })
            .sum();
        let want = (sum / t.beyond(0.0, d, form)).sqrt();
        assert!((spread(&t, d, form) / want - 1.0).abs() < 2e-4, "{form:?}: {} {want}", spread(&t, d, form));
        let half = radius_of(&t, d, form, 0.5);
        assert!((t.beyond(half, d, form) / t.beyond(0.0, d, form) - 0.5).abs() < 1e-9);
    }
}

#[test]
fn inner_reflectance_follows_the_etendue() {
    // inside and outside of one face pass the same flux: 1 − ρ_out = n² (1 − ρ_in); ρ_out = 0.0918 at n = 1.5 (Walsh 1926)
    let inner = inner_reflectance(1.5);
    assert!((1.0 - 2.25 * (1.0 - inner) - 0.0918).abs() < 1e-4, "{inner}");
    assert!(inner_reflectance(1.0).abs() < 1e-9);
}

#[test]
fn a_vein_under_even_light_takes_the_totals_of_its_thickness_at_the_exit() {
    // even irradiance and the exit's thickness: no blur at all, so the crest is the ratio of two totals
    let t = Tissue::TABLE;
    let got = read(&model(&t, Form::Thin, Ridge::Unlit, 0.0, Where::Exit).unwrap());
    let want = t.total(0.2, Form::Thin);
    assert!((got.lamina / want - 1.0).abs() < 1e-3, "{} {want}", got.lamina);
    assert!(got.crest < 0.75 && got.crest > t.total(0.5, Form::Thin) / want);
    // the entry's thickness blurs: a lighter crest and a wider edge
    let entry = read(&model(&t, Form::Thin, Ridge::Unlit, 0.0, Where::Entry).unwrap());
    assert!(entry.crest > got.crest && entry.edge > got.edge, "{entry:?} {got:?}");
}

#[test]
fn the_rows_say_what_they_compare() {
    let rows = rows(Effort { plane: 300, vein: 4000 }).unwrap();
    assert!(rows.len() > 300);
    assert!(rows.iter().all(|r| r.model == "translucency" && r.knob.starts_with("oracle: ") && !r.setting.is_empty() && r.us >= 0.0));
    // the image sum below a mean free path (0.101 mm) is not there; the thin form is
    let at = |knob: &str, d: &str| rows.iter().find(|r| r.knob == knob && r.setting.ends_with(d)).unwrap().error;
    assert!(at("oracle: thickness, images", "d 0.05").is_nan());
    assert!(at("oracle: thickness, thin", "d 0.05").abs() < 0.2);
}
