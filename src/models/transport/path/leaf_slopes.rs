//! How what a point of a leaf scatters depends on the leaf's numbers.

use super::scattering::ScatterPoint;
use super::slopes::RadianceParameter;
use crate::foliar::FoliarMaterial;
use crate::surface::Surface;
use glam::DVec3;

/// The derivatives by one parameter of what a point scatters.
#[derive(Default)]
pub(super) struct PointSlope {
    /// Index of the parameter.
    of: usize,
    /// Derivatives of ρd of the viewed side, of ρt, and of ρs.
    rho_d: [f64; 3],
    rho_t: [f64; 3],
    rho_s: [f64; 3],
    /// The derivative of m.
    m: f64,
    /// The derivative of the absorption of one crossing, where rays are followed through layers.
    depth: [f64; 3],
}

/// A derivative of what is scattered in one direction: the parameter, and a number for each channel.
pub(super) type Term = (usize, [f64; 3]);

/// The parameters of each leaf, with their places in the list of all.
pub(super) struct LeafSlopes<'a>(Vec<Vec<(usize, &'a RadianceParameter)>>);

impl<'a> LeafSlopes<'a> {
    /// For a world of so many leaves.
    pub fn new(leaves: usize, of: &'a [RadianceParameter]) -> LeafSlopes<'a> {
        let mut out = vec![Vec::new(); leaves];
        for (k, parameter) in of.iter().enumerate() {
            let leaf = match parameter {
                RadianceParameter::RhoD { leaf, .. }
                | RadianceParameter::Look { leaf, .. }
                | RadianceParameter::Depth { leaf, .. } => *leaf,
                RadianceParameter::RhoT(leaf) | RadianceParameter::RhoS(leaf) | RadianceParameter::Slope(leaf) => *leaf,
                RadianceParameter::Light { .. } => continue,
            };
            out[leaf].push((k, parameter));
        }
        LeafSlopes(out)
    }

    /// The derivatives at a point of a leaf, in place of those that `out` had. `foliar` is the leaf's model by B1, if
    /// it has one, and `layered` whether rays are followed through it.
    pub fn at(
        &self,
        leaf: usize,
        surface: &Surface,
        foliar: Option<&FoliarMaterial>,
        layered: bool,
        out: &mut Vec<PointSlope>,
    ) {
        out.clear();
        for (of, parameter) in &self.0[leaf] {
            let mut slope = PointSlope { of: *of, ..PointSlope::default() };
            match parameter {
                RadianceParameter::RhoD { back, .. } if *back != surface.back => continue,
                RadianceParameter::RhoD { .. } => slope.rho_d = [1.0; 3],
                RadianceParameter::RhoT(_) => slope.rho_t = [1.0; 3],
                RadianceParameter::RhoS(_) => slope.rho_s = [1.0; 3],
                RadianceParameter::Slope(_) => slope.m = 1.0,
                RadianceParameter::Look { sides, .. } => {
                    ([slope.rho_d, slope.rho_t, slope.rho_s], slope.m) = surface.by_look(sides);
                }
                RadianceParameter::Depth { by, .. } if layered => slope.depth = *by,
                RadianceParameter::Depth { by, .. } => {
                    let Some(foliar) = foliar else { continue };
                    let [d, t] = foliar.by_depth(surface.view, surface.normal(), surface.back);
                    (slope.rho_d, slope.rho_t) = ([0, 1, 2].map(|c| d[c] * by[c]), [0, 1, 2].map(|c| t[c] * by[c]));
                }
                RadianceParameter::Light { .. } => continue,
            }
            out.push(slope);
        }
    }
}

/// Whether ρd, ρt and gloss have derivatives at a point.
pub(super) fn asked(slopes: &[PointSlope]) -> [bool; 3] {
    let some = |of: &dyn Fn(&PointSlope) -> bool| slopes.iter().any(of);
    let any = |v: &[f64; 3]| v.iter().any(|v| *v != 0.0);
    [some(&|s| any(&s.rho_d)), some(&|s| any(&s.rho_t)), some(&|s| any(&s.rho_s) || s.m != 0.0)]
}

/// The derivatives of what is scattered towards `l` (1/sr), in place of those that `out` had.
pub(super) fn terms(slopes: &[PointSlope], scatter: &ScatterPoint, l: DVec3, out: &mut Vec<Term>) {
    out.clear();
    if slopes.is_empty() {
        return;
    }
    let ([diffuse, through, gloss, by_m], rho_s) = (scatter.lobes(l), scatter.rho_s());
    for s in slopes {
        let by = |c: usize| diffuse * s.rho_d[c] + through * s.rho_t[c] + gloss * s.rho_s[c] + by_m * rho_s[c] * s.m;
        let value = [0, 1, 2].map(by);
        if value.iter().any(|v| *v != 0.0) {
            out.push((s.of, value));
        }
    }
}

/// The derivatives of the `weight` of a ray that crossed the mesophyll of a leaf `crossings` times.
pub(super) fn crossed(slopes: &[PointSlope], weight: [f64; 3], crossings: f64, out: &mut Vec<Term>) {
    out.clear();
    out.extend(slopes.iter().map(|s| (s.of, [0, 1, 2].map(|c| -crossings * weight[c] * s.depth[c]))));
}
