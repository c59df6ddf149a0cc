//! Compares the photographs' answer with the slab fit's, and says in words why they differ where they do.
//!
//! The slab fit knows each texel's reflectance and transmittance and the caliper's mean thickness. The photographs also
//! know transmittance, and how far light spreads in texels of known size. Where the assumptions of both hold, they
//! agree. Each kind of disagreement has one assumption behind it.

use super::TissueCoefficients;
use mesophyll_optics::slab;

/// The leaf fit's coefficients (1/mm), a channel each. Errors are NaN or infinite where they are not known.
#[derive(Debug, Clone, PartialEq)]
pub struct SlabReference {
    pub sigma_a: Vec<f64>,
    pub sigma_s: Vec<f64>,
    pub sigma_a_err: Vec<f64>,
    pub sigma_s_err: Vec<f64>,
}

/// One channel compared with the slab.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabDifference {
    /// ln of the ratio fit/slab of σa and σs′, and its standard error.
    pub sigma_a: [f64; 2],
    pub sigma_s: [f64; 2],
    /// ρt at the mean thickness: the slab's, and the photographs'.
    pub rho_t: [f64; 2],
    /// The same for ρd.
    pub rho_d: [f64; 2],
}

/// With a standard error of ln σ above this, three standard errors are a factor of 20 in either direction: the fit says
/// nothing.
const TELLS: f64 = 1.0;

/// Differences count only if they are more than three standard errors and more than this.
const MATTERS: f64 = 0.03;

/// `stderr`: standard errors of ln σa and ln σs′ of each channel, then of ln scale (0 where it is fixed).
pub fn differences(
    found: &TissueCoefficients,
    stderr: &[f64],
    slab: &SlabReference,
    thickness_mm: f64,
) -> Vec<SlabDifference> {
    let error = |own: f64, other: f64, value: f64| own.hypot(if other.is_finite() { other / value } else { 0.0 });
    (0..found.sigma_a.len())
        .map(|c| {
            let (a, s) = (slab.sigma_a[c], slab.sigma_s[c]);
            let theirs = slab::response(a, s, thickness_mm);
            let ours = slab::response(found.sigma_a[c], found.reduced[c], found.scale * thickness_mm);
            SlabDifference {
                sigma_a: [(found.sigma_a[c] / a).ln(), error(stderr[2 * c], slab.sigma_a_err[c], a)],
                sigma_s: [(found.reduced[c] / s).ln(), error(stderr[2 * c + 1], slab.sigma_s_err[c], s)],
                rho_t: [theirs.rho_t, ours.rho_t],
                rho_d: [theirs.rho_d, ours.rho_d],
            }
        })
        .collect()
}

fn matters([difference, error]: [f64; 2]) -> bool {
    difference.abs() > 3.0 * error && difference.abs() > MATTERS
}

fn percent(x: f64) -> String {
    format!("{:+.1} %", 100.0 * x)
}

/// One sentence: that they agree, or which assumption fails.
pub fn explain(names: &[&str], d: &[SlabDifference], found: &TissueCoefficients, scale_err: f64) -> String {
    let differ: Vec<usize> = (0..d.len()).filter(|&c| matters(d[c].sigma_a) || matters(d[c].sigma_s)).collect();
    let scale = found.scale.ln();
    let scaled = matters([scale, scale_err]);
    // A value whose error is so large that nothing is known agrees with everything and says nothing.
    let loose: Vec<&str> = (0..d.len())
        .filter(|&c| [d[c].sigma_a, d[c].sigma_s].iter().any(|v| !(v[1] <= TELLS)))
        .map(|c| names[c])
        .collect();
    if differ.is_empty() && !scaled && !loose.is_empty() {
        return format!(
            "cannot be compared with the slab fit in {}: the photographs leave sigma there too uncertain",
            loose.join(", ")
        );
    }
    if differ.is_empty() && !scaled {
        return "agrees with the slab fit within three standard errors or 3 % in every channel".into();
    }
    let each: Vec<String> = differ
        .iter()
        .map(|&c| {
            format!(
                "{}: sigma_a {}, sigma_s {}",
                names[c],
                percent(d[c].sigma_a[0].exp_m1()),
                percent(d[c].sigma_s[0].exp_m1())
            )
        })
        .collect();
    // Once the thickness is taken out, is the remaining difference small?
    let products = (0..d.len())
        .all(|c| [d[c].sigma_a, d[c].sigma_s].iter().all(|[v, e]| !matters([v + scale, e.hypot(scale_err)])));
    let light =
        d.iter().map(|d| d.rho_t[1] / d.rho_t[0] - 1.0).fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m });
    let why = if scaled && products {
        format!(
            "sigma times thickness agrees; the photographs ask for a thickness {} off the map's: they measure lengths \
             by how far light spreads, the slab fit takes the caliper's mean thickness as right",
            percent(scale.exp_m1())
        )
    } else if light.abs() > MATTERS {
        format!(
            "up to {} of the light at the mean thickness is not the slab's: the slab fit uses a diffuse light box from \
             behind, the photographs narrow beams whose shadows, slant (the kernel is that of a beam along the normal) \
             and exposure enter",
            percent(light)
        )
    } else {
        "both let the same light through; they part it differently: the slab fit tells absorption from scattering by \
         the reflectance (its gauge of gamma, the surface's own share), the photographs by how far light spreads \
         (diffusion, the texel's size)"
            .into()
    };
    let list =
        if each.is_empty() { String::new() } else { format!("differs from the slab fit in {}; ", each.join("; ")) };
    let undetermined = if scale_err > super::certainty::DETERMINED {
        "; the thickness scale is not determined here, --fix-scale takes the map's"
    } else {
        ""
    };
    format!("{list}{why}{undetermined}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn says(found: &TissueCoefficients, stderr: [f64; 3]) -> String {
        let slab =
            SlabReference { sigma_a: vec![0.5], sigma_s: vec![9.0], sigma_a_err: vec![0.005], sigma_s_err: vec![0.05] };
        let d = differences(found, &stderr, &slab, 0.2);
        explain(&["R"], &d, found, stderr[2])
    }

    #[test]
    fn each_disagreement_gets_its_reason() {
        let one = |a: f64, s: f64, scale: f64| TissueCoefficients { sigma_a: vec![a], reduced: vec![s], scale };
        let sure = [0.01, 0.005, 0.01];
        assert!(says(&one(0.503, 9.02, 1.0), sure).starts_with("agrees"));
        assert!(says(&one(0.5 / 1.2, 9.0 / 1.2, 1.2), sure).contains("sigma times thickness agrees"));
        assert!(says(&one(1.2, 9.0, 1.0), sure).contains("of the light at the mean thickness is not the slab's"));
        // The same transmitted light, divided differently: σs is such that ρt stays.
        let want = slab::response(0.5, 9.0, 0.2).rho_t;
        let (mut low, mut high) = (3.0, 9.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if slab::response(0.8, middle, 0.2).rho_t > want { low = middle } else { high = middle }
        }
        assert!(says(&one(0.8, low, 1.0), sure).contains("they part it differently"));
        // Wide errors agree with anything, and unbounded errors must not be called agreement.
        assert!(says(&one(5.0, 8.0, 1.0), [f64::INFINITY, 0.3, 0.4]).starts_with("cannot be compared"));
        assert!(says(&one(0.6, 8.0, 1.1), [0.5, 0.3, 0.4]).starts_with("agrees"));
    }
}
