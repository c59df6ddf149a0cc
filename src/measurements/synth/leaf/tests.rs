use super::*;
use crate::slab_truth;
use mesophyll_optics::side::behind;

fn elm(model: InteriorModel) -> (LeafSpec, SyntheticLeaf) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/leaves/elm.toml");
    let spec = LeafSpec::read(&path).unwrap();
    let leaf = SyntheticLeaf::grow(&spec, model, 60, 45).unwrap();
    (spec, leaf)
}

#[test]
fn gauges_energy_and_the_slab_hold() {
    for model in [InteriorModel::Exact, InteriorModel::Pigment] {
        let (spec, leaf) = elm(model);
        for side in Side::ALL {
            let (side, mask) = (&leaf.sides[side], leaf.mask_of(side));
            let good: Vec<usize> = (0..mask.len()).filter(|&k| mask[k]).collect();
            let mean = |f: &dyn Fn(usize) -> f64| good.iter().map(|&k| f(k)).sum::<f64>() / good.len() as f64;
            assert!((mean(&|k| f64::from(side[k].thickness)) / spec.thickness_mm - 1.0).abs() < 1e-6);
            for c in 0..3 {
                assert!((mean(&|k| f64::from(side[k].gamma[c])) - 1.0).abs() < 1e-6);
                for &k in good.iter().step_by(211) {
                    let (a, s) = (f64::from(side[k].sigma_a[c]), f64::from(side[k].sigma_s[c]));
                    let r = slab_truth::response(a, s, f64::from(side[k].thickness));
                    assert!((f64::from(side[k].rho_d[c]) / (r.rho_d * f64::from(side[k].gamma[c])) - 1.0).abs() < 1e-6);
                    assert!((f64::from(side[k].rho_t[c]) / r.rho_t - 1.0).abs() < 1e-6);
                }
            }
            assert!(good.iter().all(|&k| (0..3).all(|c| side[k].rho_d[c] + side[k].rho_t[c] <= 1.0)));
            assert!(good.iter().all(|&k| (side[k].normal.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-6));
        }
        if model == InteriorModel::Exact {
            assert!(
                leaf.sides
                    .front
                    .iter()
                    .zip(&leaf.mask)
                    .all(|(t, m)| !m || t.sigma_a.0 == spec.interior.sigma_a.map(|v| v as f32))
            );
        }
    }
}

#[test]
fn the_back_is_the_front_mirrored() {
    let (_, leaf) = elm(InteriorModel::Pigment);
    let seen = leaf.mask_of(Side::Back);
    for f in 0..leaf.size.texels() {
        let b = behind(f, leaf.size.width);
        let (front, back) = (&leaf.sides.front[f], &leaf.sides.back[b]);
        assert_eq!(leaf.mask[f], seen[b]);
        assert_eq!(front.thickness, back.thickness);
        assert_eq!(front.sigma_a, back.sigma_a);
        assert_eq!(front.rho_t, back.rho_t);
    }
}

/// A plane that rises to the right in the front's image also rises to the right in the back's (turned about y and seen
/// from below).
#[test]
fn normals_turn_with_the_leaf() {
    let (mut spec, _) = elm(InteriorModel::Exact);
    spec.relief.sunk_mm = [0.0; 3];
    spec.relief.raised_mm = [0.0; 3];
    let leaf = SyntheticLeaf::grow(&spec, InteriorModel::Exact, 60, 45).unwrap();
    for j in 2..43 {
        for i in 2..58 {
            let (f, b) = (leaf.sides.front[j * 60 + i].normal, leaf.sides.back[j * 60 + 59 - i].normal);
            if leaf.mask[j * 60 + i] {
                // The same surface seen from below: n → −n, then turned about y: (x, y, z) → (−x, y, −z).
                let turned = [f[0], -f[1], f[2]];
                assert!((0..3).all(|c| (turned[c] - b[c]).abs() < 1e-5), "{f:?} {b:?}");
            }
        }
    }
}
