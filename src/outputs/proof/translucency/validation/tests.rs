use super::plane::{inner_reflectance, radius_of, spread};
use super::vein::{ConvolutionVariant, OracleFaces, RidgeFace, VEINS, VeinProofModel, oracle, read};
use super::*;
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::walk::slab::EntryDirection;
use mesophyll_optics::walk::{Boundary, Medium, Slab};

#[test]
fn rms_and_half_light_radius_are_those_of_the_kernel() {
    // By quadrature of `beyond`: <r²> = ∫ 2 r beyond(r) dr / total.
    for (d, form) in [(0.2, DipoleForm::Thin), (0.5, DipoleForm::Images), (0.2, DipoleForm::Dipoles(3))] {
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
    // The inside and the outside of one face pass the same flux: 1 − ρ_out = n² (1 − ρ_in), with ρ_out = 0.0918 at n =
    // 1.5 (Walsh 1926).
    let inner = inner_reflectance(1.5);
    assert!((1.0 - 2.25 * (1.0 - inner) - 0.0918).abs() < 1e-4, "{inner}");
    assert!(inner_reflectance(1.0).abs() < 1e-9);
}

#[test]
fn a_vein_under_even_light_is_blurred_by_the_entry_and_not_by_the_exit() {
    let t = Tissue::TABLE;
    let model = VeinProofModel::new(&VEINS[0], RidgeFace::Unlit);
    let kernels = model.kernels(&t, DipoleForm::Images).unwrap();
    // With even irradiance and the thickness at the exit there is no blur: each texel has the total of its own
    // thickness.
    let exit = read(&model.profile(&kernels, 0.0, ConvolutionVariant::Exit));
    let lamina = t.total(0.2, DipoleForm::Images);
    // The crest is read over four texels, at 0.02 and 0.06 mm.
    let at = |x: f64| t.total(0.2 + 0.3 * (std::f64::consts::PI * x / 0.8).cos().powi(2), DipoleForm::Images);
    let crest = 0.5 * (at(0.02) + at(0.06));
    assert!((exit.lamina / lamina - 1.0).abs() < 2e-3, "{} {lamina}", exit.lamina);
    assert!((exit.crest * exit.lamina / crest - 1.0).abs() < 5e-3, "{} {crest}", exit.crest * exit.lamina);
    // The thickness at the entry blurs: the crest is lighter. Facets make no difference where the lit face is flat.
    let entry = read(&model.profile(&kernels, 0.0, ConvolutionVariant::Printed));
    let facets = read(&model.profile(&kernels, 0.0, ConvolutionVariant::Facets));
    assert!(entry.crest > exit.crest + 0.01, "{entry:?} {exit:?}");
    assert!((entry.crest - facets.crest).abs() < 1e-12);
}

#[test]
fn the_oracle_in_a_vein_has_the_lamina_of_the_plane_slab() {
    let runs = oracle(&VEINS[1], RidgeFace::Lit, OracleFaces::Clear, 0.0, OracleEffort { plane: 2, vein: 80_000 })
        .unwrap()
        .exitance;
    let lamina = runs.iter().map(|r| read(r).lamina).sum::<f64>() / runs.len() as f64;
    let t = Tissue::TABLE;
    let slab = Slab {
        medium: Medium { sigma_a: t.sigma_a, sigma_s: t.sigma_s, g: t.g },
        thickness_mm: 0.2,
        boundary: Boundary::Matched,
    };
    let flat = slab.walk(EntryDirection::NORMAL, Histories { count: 80_000, seed: 1 }, &[]).unwrap().transmitted;
    // Ten texels of a hundred get a tenth of the histories.
    assert!((lamina - flat.value).abs() < 4.0 * 4.0 * flat.error, "{lamina} {flat:?}");
}

#[test]
fn the_rows_say_what_they_compare() {
    let effort = OracleEffort { plane: 300, vein: 0 };
    let mut rows = plane::total_rows(effort).unwrap();
    rows.extend(plane::angle_rows(effort).unwrap());
    assert!(rows.iter().all(|r| r.model == "translucency"
        && r.knob.starts_with("oracle: ")
        && !r.setting.is_empty()
        && (r.us >= 0.0 || r.error.is_nan())));
    // Below a mean free path (0.101 mm) the image sum is not defined; the thin form is.
    let at = |knob: &str, d: &str| rows.iter().find(|r| r.knob == knob && r.setting.ends_with(d)).unwrap().error;
    assert!(at("oracle: thickness, images", "d 0.05").is_nan());
    assert!(at("oracle: thickness, thin", "d 0.05").abs() < 0.2);
}

#[test]
fn a_slanting_beam_is_the_exact_slabs() {
    let effort = OracleEffort { plane: 40_000, vein: 0 };
    let t = Tissue::TABLE;
    let slab = Slab { medium: plane::medium(&t), thickness_mm: 0.2, boundary: Boundary::Matched };
    for degrees in [0.0f64, 60.0] {
        let walk = plane::beam_over_even(&slab, degrees, effort).unwrap();
        let exact = plane::slant(&t, 0.2, degrees.to_radians().cos());
        // Taking σs(1−g) instead of σs and g = 0.07 changes a few thousandths.
        assert!((walk.value - exact).abs() < 4.0 * walk.error + 0.01 * exact, "{degrees}: {walk:?} {exact}");
        // Neither is 1, which is what the maps say.
        assert!((exact - 1.0).abs() > 0.1, "{exact}");
    }
}
