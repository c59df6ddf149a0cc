//! Properties that hold for all numbers: energy and scaling of the slab, reciprocity of the lobes, and tables and
//! images that are read back as they were written.

use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll::files::table::{self, BatchSpec, InputRow, InputTable, OutputRow, TableOutput};
use mesophyll::optics::gloss::Lobe;
use mesophyll::optics::slab::{self, inverse, medium};
use proptest::prelude::*;

/// Coefficients (1/mm) over six decades, and thicknesses (mm) over three.
fn coefficient() -> impl Strategy<Value = f64> {
    (-3.0..3.0f64).prop_map(|e| 10f64.powf(e))
}

fn thickness() -> impl Strategy<Value = f64> {
    (-2.3..0.7f64).prop_map(|e| 10f64.powf(e))
}

/// A unit vector at least 1° above the horizon.
fn upward() -> impl Strategy<Value = [f64; 3]> {
    (0.02..1.0f64, 0.0..std::f64::consts::TAU).prop_map(|(z, phi)| {
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    })
}

/// A case that random cases found: at 157 mean free paths the table has no digits left.
#[test]
fn a_black_slab_still_passes_what_meets_nothing() {
    let (a, s, h) = (401.6250393021319, 0.0012436094687627896, 0.3904314124690348);
    let (fast, exact) = (slab::response(a, s, h).rho_t, medium::response(a, s, h).rho_t);
    assert!(fast >= (-(a + s) * h).exp() && (fast / exact - 1.0).abs() < 1e-5, "{fast} {exact}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    /// ρd + ρt + absorbed = 1, and no share is negative. Nothing is absorbed without an absorber. Unscattered light
    /// always passes.
    #[test]
    fn a_slab_keeps_its_energy(a in coefficient(), s in coefficient(), h in thickness()) {
        for r in [slab::response(a, s, h), medium::response(a, s, h)] {
            prop_assert!(r.rho_d >= 0.0 && r.rho_t >= 0.0 && r.rho_d + r.rho_t < 1.0 + 1e-12, "{r:?}");
            prop_assert!(r.rho_t >= (-(a + s) * h).exp() * (1.0 - 1e-9), "{r:?}");
        }
        let white = medium::response(0.0, s, h);
        prop_assert!((white.rho_d + white.rho_t - 1.0).abs() < 1e-9, "{white:?}");
    }

    /// Only σ·h counts. More absorption darkens both sides. A thicker slab transmits less and reflects more.
    #[test]
    fn a_slab_scales_and_is_monotone(a in coefficient(), s in coefficient(), h in thickness(), k in 1.01..3.0f64) {
        let r = medium::response(a, s, h);
        let same = medium::response(a * k, s * k, h / k);
        let alike = (same.rho_d - r.rho_d).abs() <= 1e-9 * r.rho_d + 1e-14;
        prop_assert!(alike && (same.rho_t - r.rho_t).abs() <= 1e-9 * r.rho_t, "{r:?} {same:?}");
        let darker = medium::response(a * k, s, h);
        prop_assert!(darker.rho_d <= r.rho_d * (1.0 + 1e-9) && darker.rho_t <= r.rho_t * (1.0 + 1e-9), "{r:?} \
         {darker:?}");
        let thicker = medium::response(a, s, h * k);
        prop_assert!(thicker.rho_d >= r.rho_d * (1.0 - 1e-9) && thicker.rho_t <= r.rho_t * (1.0 + 1e-9), "{r:?} \
         {thicker:?}");
    }

    /// The slab's coefficients are recovered from its reflectance and transmittance, and `ok` can be trusted.
    #[test]
    fn an_inverted_slab_is_the_slab(omega in 0.1..0.995f64, delta in 0.1..8.0f64, h in thickness()) {
        let (a, s) = ((1.0 - omega) * delta / h, omega * delta / h);
        let r = medium::response(a, s, h);
        let found = inverse::invert(r.rho_d, r.rho_t, h, 1e-9, 1e-9);
        prop_assert!(found.status.is_ok(), "{found:?}");
        let off = [(found.sigma_a - a, found.sigma_a_err, a), (found.sigma_s - s, found.sigma_s_err, s)];
        prop_assert!(off.iter().all(|(d, e, v)| d.abs() <= 4.0 * e + 1e-6 * v), "{a} {s}: {found:?}");
    }

    /// Light and camera can be exchanged (in the bounded form, which the renderers draw), and no value is negative.
    #[test]
    fn lobes_are_reciprocal(l in upward(), v in upward(), m in 0.03..0.8f64, index in 1.1..2.0f64) {
        let n = [0.0, 0.0, 1.0];
        for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index }] {
            let (there, back) = (lobe.bounded(n, l, v, m), lobe.bounded(n, v, l, m));
            prop_assert!(there >= 0.0 && there.is_finite() && (there - back).abs() <= 1e-9 * there.max(1e-300),
                "{lobe:?} {there} {back}");
        }
    }

    /// Any number and any text of a table passes through a batch unchanged, but for what a spreadsheet would run: that
    /// gets an apostrophe, once.
    #[test]
    fn tables_read_back_exactly(rows in prop::collection::vec((any::<f64>(), "[ -~äσ\"]{0,12}"), 1..20)) {
        let rows: Vec<(f64, String)> = rows.into_iter().filter(|(x, _)| !x.is_nan()).map(|(x, note)| (x,
            note.trim().to_string())).collect();
        let mut bytes = b"note,x\n".to_vec();
        for (x, note) in &rows {
            table::push_text(&mut bytes, note);
            bytes.push(b',');
            table::push_number(&mut bytes, *x);
            bytes.push(b'\n');
        }
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let spec = BatchSpec { required: vec!["x".into()], outputs: vec!["same".into()], ..BatchSpec::default() };
        let input = InputTable::from_reader(Box::new(std::io::Cursor::new(bytes)), "in.csv".into()).unwrap();
        let copied = |row: &InputRow, out: &mut Vec<OutputRow>| out.push(OutputRow::ok(vec![row.get(0)]));
        table::run(input, &TableOutput::csv(&out), &spec, copied).unwrap();
        let mut again = csv::Reader::from_path(&out).unwrap();
        let found: Vec<(f64, String)> = again.records().map(|r| r.unwrap()).map(|r| (r[2].parse().unwrap(),
            r[0].to_string())).collect();
        prop_assert_eq!(found.len(), rows.len());
        for (a, b) in found.iter().zip(&rows) {
            let marked = a.1 == format!("'{}", b.1) && b.1.starts_with(['=', '+', '-', '@']);
            let same = a.1 == b.1 && !b.1.starts_with(['=', '@']);
            prop_assert!(a.0.to_bits() == b.0.to_bits() && (marked || same), "{a:?} {b:?}");
        }
    }

    /// Every bit of every sample survives, packed or not.
    #[test]
    fn images_read_back_exactly(width in 1usize..9, height in 1usize..20, seed in any::<u32>(),
        packed in any::<bool>()) {
        let mut state = seed | 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            f32::from_bits(state)
        };
        let mut maps = ChannelMaps::new(width, height);
        for name in ["R", "mask.Y", "sigma_a.B"] {
            maps.push(name, (0..width * height).map(|_| next()).collect());
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        write_exr(&path, &maps, if packed { Packing::Zip } else { Packing::Raw }).unwrap();
        let again = read_exr(&path).unwrap();
        prop_assert_eq!((again.width, again.height), (width, height));
        for (name, samples) in &maps.channels {
            let found = again.get(name).unwrap();
            prop_assert!(samples.iter().zip(found).all(|(a, b)| a.to_bits() == b.to_bits()), "{name}");
        }
    }
}
