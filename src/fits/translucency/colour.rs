//! From M, the light that the tissue lets through, to the function f that is stored. The measured colour is
//! substituted: f = π M / ∫ M dω.
//!
//! ρt was measured in front of a diffuse back light, whose radiance is 1/π per unit irradiance from every direction ω.
//! A texel that answers light from ω with ρt f(ω)/π then shows ρt/π · ∫ f dω/π. This is the measured ρt/π only if ∫ f
//! dω = π. The sources multiply ρt by M itself, but the level and the veins of M are already in ρt.

/// Scales images that are linear in M (coefficients, or M itself) so that ∫ f dω = π at every texel. `total` is ∫ M dω.
/// A texel that no light reaches gets the values `flat` of a flat uniform leaf. Returns how many texels that are.
pub fn substitute(images: &mut [Vec<f64>], total: &[f64], flat: &[f64], mask: &[bool]) -> usize {
    let mut dark = 0;
    for k in 0..mask.len() {
        let total = total[k];
        let lit = mask[k] && total > 0.0 && total.is_finite();
        dark += usize::from(mask[k] && !lit);
        for (image, flat) in images.iter_mut().zip(flat) {
            image[k] = if lit { std::f64::consts::PI * image[k] / total } else { *flat };
        }
    }
    dark
}

/// Scales images that are linear in M by one number, so that the leaf's mean of ∫ f dω is π: the sources' product at
/// the right level. Returns how many texels on the leaf no light reaches.
pub fn level(images: &mut [Vec<f64>], total: &[f64], mask: &[bool]) -> usize {
    let on = || total.iter().zip(mask).filter(|(_, m)| **m).map(|(t, _)| *t);
    let dark = on().filter(|t| !(*t > 0.0)).count();
    let total: f64 = on().sum();
    let count = mask.iter().filter(|m| **m).count() as f64;
    if total > 0.0 {
        let scale = std::f64::consts::PI * count / total;
        images.iter_mut().flatten().for_each(|v| *v *= scale);
    }
    dark
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn under_a_diffuse_light_every_texel_is_as_measured() {
        // Two functions with the integrals 1.5 and 0.7.
        let mut images = vec![vec![0.3, 0.1, -0.2, 0.5], vec![0.2, 0.4, 0.1, 0.5]];
        let total: Vec<f64> = (0..4).map(|k| 1.5 * images[0][k] + 0.7 * images[1][k]).collect();
        let dark = substitute(&mut images, &total, &[2.0, 0.1], &[true, true, true, false]);
        assert_eq!(dark, 1, "the third texel's total is negative");
        for k in 0..2 {
            assert!((images[0][k] * 1.5 + images[1][k] * 0.7 - PI).abs() < 1e-12);
        }
        assert_eq!((images[0][2], images[1][3]), (2.0, 0.1));
    }

    #[test]
    fn the_product_keeps_the_leafs_structure_and_gets_its_level() {
        let mut images = vec![vec![1.0, 3.0, 9.0]];
        let dark = level(&mut images, &[2.0, 6.0, 18.0], &[true, true, false]);
        assert!(dark == 0 && (images[0][1] / images[0][0] - 3.0).abs() < 1e-12);
        assert!(((images[0][0] + images[0][1]) * 2.0 / 2.0 - PI).abs() < 1e-12);
    }
}
