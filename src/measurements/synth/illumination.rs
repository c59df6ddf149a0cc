//! The value of a texel under the tube: the radiance that it sends to the camera, integrated finely over the tube's
//! visible surface.
//!
//! The tube is a cylinder of constant radiance (Lambertian), radius a, length L, axis at height H over the blade,
//! centred on it; the camera is orthographic. Lengths in mm, directions are unit vectors with z up. Values are
//! normalised so that a white Lambertian texel facing up shows 1 straight under an infinitely long tube (Gardner et al.
//! 2003 describe the device; `data/README.md` the units).
//!
//! Seen from the texel, a direction is (φ, ψ): φ turns in the plane across the tube and ψ along it, so dω = cosψ dψ dφ.
//! In the plane across, a tube at distance d fills φ₀ ± asin(a/d). The substitution sin(φ − φ₀) = (a/d) sinτ removes
//! the square root at the limb, so Gauss–Legendre in τ converges fast. Along ψ the diffuse part is integrated in closed
//! form. The lobe is integrated by Gauss–Legendre panels graded around its peak, or, where it lies well inside the
//! tube, by the trapezoidal rule (which converges exponentially for such bells). The relative accuracy is 1e-6 for m ≥
//! 0.03 (tested against area elements of the cylinder). This code shares only the name of a lobe with the fit.

use super::slab_truth::gauss_legendre;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::{Travel, Tube};
use std::f64::consts::PI;

/// Diffuse and glossy part of a texel's value, which is ρd · diffuse + ρs · gloss.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TexelShading {
    /// The factor of ρd.
    pub diffuse: f64,
    /// The factor of ρs.
    pub gloss: f64,
}

/// Roughness below which more nodes across the tube are taken.
const NARROW: f64 = 0.12;

/// The device for one direction of travel.
#[derive(Debug, Clone)]
pub struct TubeDevice {
    tube: Tube,
    travel: Travel,
    view: [f64; 3],
    /// Nodes across the tube, each (sinτ, cosτ, weight·cosτ): first for the diffuse part and broad lobes, then for
    /// lobes narrower than [`NARROW`].
    across: [Vec<[f64; 3]>; 2],
    /// Gauss–Legendre nodes of a panel.
    panel: Vec<(f64, f64)>,
}

/// A direction towards the tube in the plane across it: (sinφ, cosφ), the weight Le dφ, and the distance at which the
/// lit length ends. By the capture's convention that is the axis' distance. The surface itself would be nearer by most
/// of a radius, which is worth 0.15 % of D for the usual device.
#[derive(Debug, Clone, Copy)]
struct Ray {
    sin: f64,
    cos: f64,
    distance: f64,
    weight: f64,
}

/// The tube seen from one place along the direction of travel.
#[derive(Debug, Clone)]
pub struct TubeView {
    rays: [Vec<Ray>; 2],
    /// The direction to the axis: (sinφ₀, cosφ₀), with distance and half width in φ.
    axis: Ray,
    half_width: f64,
}

/// The lobe's exponent along the tube; components are along travel, tube and up.
struct Lobed<'a> {
    lobe: Lobe,
    m: f64,
    normal: [f64; 3],
    view: [f64; 3],
    /// n·v.
    facing: f64,
    panel: &'a [(f64, f64)],
}

impl TubeDevice {
    /// `camera_deg` is the angle of the view direction (sin, 0, cos) from z.
    pub fn new(tube: Tube, travel: Travel, camera_deg: f64) -> TubeDevice {
        let (s, c) = camera_deg.to_radians().sin_cos();
        let across = [7, 13].map(|n| {
            if tube.radius_mm == 0.0 {
                return vec![[0.0, 0.0, 2.0]];
            }
            gauss_legendre(n)
                .iter()
                .map(|&(x, w)| (0.5 * PI * x, 0.5 * PI * w))
                .map(|(t, w)| [t.sin(), t.cos(), w * t.cos()])
                .collect()
        });
        TubeDevice { tube, travel, view: [s, 0.0, c], across, panel: gauss_legendre(10) }
    }

    /// The tube at `position` (mm) seen from a texel at `at` (mm), both along the direction of travel.
    pub fn seen(&self, position: f64, at: f64) -> TubeView {
        let (height, radius) = (self.tube.height_mm, self.tube.radius_mm);
        let d = (position - at).hypot(height);
        let (sin0, cos0) = ((position - at) / d, height / d);
        let ray = |&[sin_tau, _, weight]: &[f64; 3]| {
            let sin = radius / d * sin_tau;
            let cos = (1.0 - sin * sin).sqrt();
            Ray {
                sin: sin0 * cos + cos0 * sin,
                cos: cos0 * cos - sin0 * sin,
                distance: d,
                weight: height / d * weight / cos,
            }
        };
        let rays = [0, 1].map(|set| self.across[set].iter().map(ray).collect());
        TubeView { rays, axis: Ray { sin: sin0, cos: cos0, distance: d, weight: 0.0 }, half_width: (radius / d).asin() }
    }

    /// The value of a texel. `along` is its position along the tube (mm), `normal` its unit normal (x, y, z), `m` its
    /// roughness. Without roughness only the diffuse part is computed.
    pub fn shown(&self, seen: &TubeView, along: f64, normal: [f64; 3], m: Option<f64>, lobe: Lobe) -> TexelShading {
        let (n, v) = (self.travel.local(normal), self.travel.local(self.view));
        let facing = n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
        if facing <= 0.0 {
            return TexelShading::default();
        }
        let ends = [-0.5 * self.tube.length_mm - along, 0.5 * self.tube.length_mm - along];
        let mut shown = TexelShading::default();
        for ray in &seen.rays[0] {
            if let Some([a, b]) = lit(ray, n, ends) {
                shown.diffuse += ray.weight * diffuse(ray, n, a, b);
            }
        }
        if let Some(m) = m {
            shown.gloss = Lobed { lobe, m, normal: n, view: v, facing, panel: &self.panel }.integral(seen, ends);
        }
        shown
    }
}

/// The lit part of the tube above the texel's horizon, as tanψ; `None` where there is none.
fn lit(ray: &Ray, n: [f64; 3], ends: [f64; 2]) -> Option<[f64; 2]> {
    let (mut a, mut b) = (ends[0] / ray.distance, ends[1] / ray.distance);
    let (p, q) = (n[0] * ray.sin + n[2] * ray.cos, n[1]);
    // n·ω = cosψ (p + q tanψ) > 0
    if q > 0.0 {
        a = a.max(-p / q);
    } else if q < 0.0 {
        b = b.min(-p / q);
    } else if p <= 0.0 {
        return None;
    }
    (a < b).then_some([a, b])
}

/// (1/π) ∫ (p cosψ + q sinψ) cosψ dψ between tanψ = a and b.
fn diffuse(ray: &Ray, n: [f64; 3], a: f64, b: f64) -> f64 {
    let p = n[0] * ray.sin + n[2] * ray.cos;
    let even = |t: f64| 0.5 * (t.atan() + t / (1.0 + t * t));
    let odd = |t: f64| 0.5 * t * t / (1.0 + t * t);
    (p * (even(b) - even(a)) + n[1] * (odd(b) - odd(a))) / PI
}

impl Lobed<'_> {
    /// ∫ f cosθi L dω per unit ρs.
    fn integral(&self, seen: &TubeView, ends: [f64; 2]) -> f64 {
        let (peak, low, width) = self.peak(&seen.axis);
        // The lobe is cut where it has fallen to e^−50. Turning the direction by the tube's half width turns α by at
        // most half of it.
        if !matches!(self.lobe, Lobe::Ggx | Lobe::GgxFresnel { .. }) {
            let nearest = (low.sqrt() - 2.0 * seen.half_width).max(0.0);
            if nearest * nearest > 50.0 * self.m * self.m {
                return 0.0;
            }
        }
        let rays = &seen.rays[usize::from(self.m < NARROW)];
        if matches!(self.lobe, Lobe::Beckmann)
            && width < 0.25
            && let Some(sum) = self.trapezoid(seen, rays, ends, peak, width)
        {
            return sum;
        }
        self.panels(rays, ends, peak, width)
    }

    /// tan²α of the half vector for the direction ψ.
    fn tan2(&self, ray: &Ray, psi: f64) -> f64 {
        let (s, c) = psi.sin_cos();
        let [p, q] = [self.normal[0] * ray.sin + self.normal[2] * ray.cos, self.normal[1]];
        let [cv, sv] = [self.view[0] * ray.sin + self.view[2] * ray.cos, self.view[1]];
        let h = c * p + s * q + self.facing;
        (2.0 * (1.0 + c * cv + s * sv) / (h * h) - 1.0).max(0.0)
    }

    /// Where along the tube the half vector is nearest to the normal: ψ, tan²α there, and the lobe's width in ψ.
    fn peak(&self, ray: &Ray) -> (f64, f64, f64) {
        let (n, v) = (self.normal, self.view);
        let mirror = [0, 1, 2].map(|k| 2.0 * self.facing * n[k] - v[k]);
        let mut psi = mirror[1].atan2((mirror[0] * ray.sin + mirror[2] * ray.cos).max(1e-3)).clamp(-1.4, 1.4);
        let e = 2e-3;
        let (mut low, mut bend) = (0.0, 0.0);
        for _ in 0..4 {
            let [l, c, r] = [self.tan2(ray, psi - e), self.tan2(ray, psi), self.tan2(ray, psi + e)];
            (low, bend) = (c, (l - 2.0 * c + r) / (e * e));
            let step = if bend > 0.0 { -0.5 * (r - l) / e / bend } else { 0.0 };
            psi = (psi + step.clamp(-0.3, 0.3)).clamp(-1.5, 1.5);
            if step.abs() < 1e-3 {
                break;
            }
        }
        (psi, low, self.m / (0.5 * bend).max(0.05).sqrt())
    }

    /// The parts of the normal and of the view direction in a ray's plane: p and cv of [`Lobed::value`].
    fn in_plane(&self, ray: &Ray) -> [f64; 2] {
        [self.normal[0] * ray.sin + self.normal[2] * ray.cos, self.view[0] * ray.sin + self.view[2] * ray.cos]
    }

    /// The integrand without the constants: D (and F, G) · cosψ for one direction, given by sinψ and cosψ.
    fn value(&self, [p, cv]: [f64; 2], s: f64, c: f64) -> f64 {
        let light = c * p + s * self.normal[1];
        let h = light + self.facing;
        let double = 2.0 * (1.0 + c * cv + s * self.view[1]); // |ω + v|²
        let inverse = double / (h * h); // 1/cos²α
        let m2 = self.m * self.m;
        let bell = |x: f64| (-(x - 1.0) / m2).exp() * x * x / m2;
        let tailed = |x: f64| m2 * x * x / (m2 + x - 1.0).powi(2);
        let masked = |index: f64| {
            let half = double.sqrt();
            let cosine = 0.5 * half; // v·h = |ω + v|/2
            let g = (2.0 * h / half / cosine * self.facing.min(light)).min(1.0);
            g * fresnel(cosine, index)
        };
        c * match self.lobe {
            Lobe::Beckmann => bell(inverse),
            Lobe::Ggx => tailed(inverse),
            Lobe::CookTorrance { index } => bell(inverse) * masked(index),
            Lobe::GgxFresnel { index } => tailed(inverse) * masked(index),
        }
    }

    /// Trapezoidal rule over the whole bell with the same ψ nodes for all rays; `None` where the tube's ends or the
    /// horizon cut the bell.
    fn trapezoid(&self, seen: &TubeView, rays: &[Ray], ends: [f64; 2], peak: f64, width: f64) -> Option<f64> {
        const STEP: f64 = 0.62;
        const REACH: i32 = 9;
        let reach = STEP * f64::from(REACH) * width;
        let inside = |psi: f64| {
            let (s, c) = psi.sin_cos();
            let t = s / c;
            let light = c * (self.normal[0] * seen.axis.sin + self.normal[2] * seen.axis.cos) + s * self.normal[1];
            psi.abs() < 1.5
                && t > ends[0] / seen.axis.distance
                && t < ends[1] / seen.axis.distance
                && light > 2.0 * seen.half_width
        };
        if !(inside(peak - reach) && inside(peak + reach)) {
            return None;
        }
        let planes: Vec<_> = rays.iter().map(|ray| (ray.weight, self.in_plane(ray))).collect();
        let mut sum = 0.0;
        for k in -REACH..=REACH {
            let (s, c) = (peak + STEP * f64::from(k) * width).sin_cos();
            sum += planes.iter().map(|&(weight, plane)| weight * self.value(plane, s, c)).sum::<f64>();
        }
        Some(sum * STEP * width * self.scale())
    }

    /// Panels from the peak outwards, each wider than the one before, clipped to each ray's lit length. Rays that clip
    /// a panel in the same way share its nodes, because sines and cosines are half of the work.
    fn panels(&self, rays: &[Ray], ends: [f64; 2], peak: f64, width: f64) -> f64 {
        const BELL: [f64; 4] = [0.0, 1.3, 3.0, 7.5];
        const TAILED: [f64; 8] = [0.0, 1.0, 2.5, 6.0, 15.0, 40.0, 100.0, 300.0];
        // V-cavity masking has kinks, so the panels are narrower.
        const KINKED: [f64; 11] = [0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.6, 3.2, 4.0, 5.5, 7.5];
        const BOTH: [f64; 16] = [0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.6, 3.2, 4.0, 5.5, 7.5, 10.0, 15.0, 40.0, 100.0, 300.0];
        let edges: &[f64] = match self.lobe {
            Lobe::Beckmann => &BELL,
            Lobe::Ggx => &TAILED,
            Lobe::CookTorrance { .. } => &KINKED,
            Lobe::GgxFresnel { .. } => &BOTH,
        };
        let mut lit_rays: Vec<_> = rays
            .iter()
            .filter_map(|ray| {
                let [a, b] = lit(ray, self.normal, ends)?;
                Some((ray.weight, self.in_plane(ray), [a.atan(), b.atan()], 0.0))
            })
            .collect();
        let mut nodes = Vec::new();
        for e in edges.windows(2) {
            for [lo, hi] in [[peak + e[0] * width, peak + e[1] * width], [peak - e[1] * width, peak - e[0] * width]] {
                let mut clipped = [f64::NAN; 2];
                for (_, plane, [a, b], sum) in &mut lit_rays {
                    let piece = [lo.max(*a), hi.min(*b)];
                    if piece[0] < piece[1] {
                        if piece != clipped {
                            self.nodes(piece, &mut nodes);
                            clipped = piece;
                        }
                        for &[s, c, weight] in &nodes {
                            *sum += weight * self.value(*plane, s, c);
                        }
                    }
                }
            }
        }
        lit_rays.iter().map(|(weight, .., sum)| weight * (sum * self.scale())).sum()
    }

    /// The nodes of a piece of the tube: sinψ, cosψ and weight.
    fn nodes(&self, [lo, hi]: [f64; 2], nodes: &mut Vec<[f64; 3]>) {
        nodes.clear();
        // Long pieces are split, so that the geometry itself is resolved as well.
        let parts = ((hi - lo) / 0.5).ceil().max(1.0);
        let step = (hi - lo) / parts;
        for k in 0..parts as usize {
            let mid = lo + (k as f64 + 0.5) * step;
            for &(x, w) in self.panel {
                let (s, c) = (mid + 0.5 * step * x).sin_cos();
                nodes.push([s, c, 0.5 * step * w]);
            }
        }
    }

    /// 1/(4π cosθr): the constants of the lobe; cosθi cancels.
    fn scale(&self) -> f64 {
        0.25 / (PI * self.facing)
    }
}

/// Reflectance of a dielectric for unpolarised light at cosine `c` of incidence (Fresnel's equations).
fn fresnel(c: f64, index: f64) -> f64 {
    let g = (index * index - 1.0 + c * c).sqrt();
    let (a, b) = ((g - c) / (g + c), (c * (g + c) - 1.0) / (c * (g - c) + 1.0));
    0.5 * a * a * (1.0 + b * b)
}
