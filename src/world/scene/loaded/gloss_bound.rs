//! An upper bound of what a side's gloss adds to any displayed value of a scene's views. The plan needs it before it
//! leaves gloss out.
//!
//! The bound is computed for the triangles of every placed leaf. Over one triangle, the interpolated normal, the
//! direction to the eye and the direction to the sun deviate from their means by known angles. Mapped normals deviate
//! from the interpolated one by their own tilt. Over such a cone the lobe has an upper bound in closed form
//! ([`largest`]), which grows towards grazing views like the lobe itself. Shadows are ignored, because a point in the
//! shade shows less gloss than the bound. Angles are in radians; radiance and irradiance are in the scene's unit.

use glam::{DMat3, DMat4, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::lobe::{COS_VIEW_FLOOR, Lobe, M_FLOOR, ReflectionLobe};
use mesophyll_transport::tone::display;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// A normal, a direction to the eye and a direction to the sun, with the largest angle by which each may deviate.
#[derive(Debug, Clone, Copy)]
pub struct GlossCone {
    /// Mean normal, a unit vector.
    pub normal: DVec3,
    /// Mean direction to the eye, a unit vector.
    pub view: DVec3,
    /// Mean direction to the sun, a unit vector.
    pub sun: DVec3,
    /// Largest deviation of the normal (rad).
    pub normal_by: f64,
    /// Largest deviation of the direction to the eye (rad).
    pub view_by: f64,
    /// Largest deviation of the direction to the sun (rad).
    pub sun_by: f64,
}

/// The largest value of f_s/ρs · N·l (1/sr) within a cone, for slopes between the two of `m`.
///
/// v·h is the cosine of half the angle between eye and sun for any normal. So f_s/ρs · N·l = D·F·G/(4 N·v) is at most
/// D·F times the smallest of 1/(4 N·v), N·h/(2 v·h) and (N·h)(N·l)/(2 (v·h)(N·v)), which are the three branches of the
/// V-cavity factor G.
pub fn largest(lobe: Lobe, cone: &GlossCone, m: [f64; 2]) -> f64 {
    let apart = cone.view.angle_between(cone.sun);
    let slack = cone.view_by + cone.sun_by;
    let (nearest, farthest) =
        ((0.5 * (apart - slack)).clamp(0.0, FRAC_PI_2), (0.5 * (apart + slack)).clamp(0.0, FRAC_PI_2));
    let v_h = farthest.cos().max(1e-9);
    // When one end of an arc moves, its middle moves by at most 1/(2 cos of half the arc) times as much.
    let half_by = slack / (2.0 * v_h);
    let half = (cone.view + cone.sun).normalize_or_zero();
    let alpha =
        if half == DVec3::ZERO { 0.0 } else { (cone.normal.angle_between(half) - cone.normal_by - half_by).max(0.0) };
    if alpha >= FRAC_PI_2 {
        return 0.0;
    }
    let most_turned = cone.normal.angle_between(cone.view) + cone.normal_by + cone.view_by;
    let cos_v = most_turned.min(FRAC_PI_2).cos().max(COS_VIEW_FLOOR);
    let cos_l = (cone.normal.angle_between(cone.sun) - cone.normal_by - cone.sun_by).max(0.0).cos().max(0.0);
    let cos_h = alpha.cos();
    // The unpolarised Fresnel factor may have a minimum between two angles, but no maximum.
    let fresnel = lobe.fresnel(v_h).max(lobe.fresnel(nearest.cos()));
    let cavity = (0.25 / cos_v).min(0.5 * cos_h / v_h).min(0.5 * cos_h * cos_l / (v_h * cos_v));
    largest_density(lobe, alpha.tan().powi(2), m) * fresnel * cavity
}

/// The largest D (1/sr) at tan²α of at least `tan2`, for slopes between the two of `m`.
fn largest_density(lobe: Lobe, tan2: f64, m: [f64; 2]) -> f64 {
    let [low, high] = m.map(|m| m.max(M_FLOOR).powi(2));
    // At a fixed angle, D is largest at m² = tan²α for both densities. Along that curve, and at either end of the range
    // of m, the largest value over the angle is at one of these candidates.
    let candidates = [tan2, low, high, 2.0 * low - 1.0, 2.0 * high - 1.0];
    let at = |t: f64| lobe.density((1.0 / (1.0 + t)).sqrt(), t.clamp(low, high).sqrt());
    let most = candidates.into_iter().filter(|t| *t >= tan2).map(at).fold(0.0, f64::max);
    // A long-tailed density with slopes above 1 increases towards facets that are edge-on.
    if lobe.is_long_tailed() { most.max(if high > 1.0 { high / PI } else { 0.0 }) } else { most }
}

/// The largest and the least light that falls on a scene.
#[derive(Debug, Clone, Default)]
pub struct LightBounds {
    /// Direction and irradiance of every sun of the scene: one, or one for each hour.
    pub suns: Vec<(DVec3, [f64; 3])>,
    /// Angular radius of the sun's disk.
    pub radius: f64,
    /// Radiance of the sky at its brightest place, without the sun.
    pub sky: [f64; 3],
    /// Radiance of a constant sky; 0 for other skies.
    pub even_sky: [f64; 3],
    /// The factor that radiance is multiplied by before it is displayed.
    pub exposure: f64,
}

/// The extremes of one side's maps over one triangle.
#[derive(Debug, Clone, Copy)]
pub struct GlossPatch {
    /// The largest ρs of each channel.
    pub rho_s: [f64; 3],
    /// The smallest and the largest m.
    pub m: [f64; 2],
    /// The largest angle between mapped and interpolated normal.
    pub tilt: f64,
    /// The smallest ρd of each channel.
    pub rho_d: [f64; 3],
}

/// One side's maps, with a value for each texel in that side's own columns.
pub struct GlossMaps<'a> {
    /// Columns and rows of texels.
    pub size: [usize; 2],
    /// Whether it is the back, whose columns run in the opposite direction.
    pub back: bool,
    /// ρs (RGB) and m.
    pub gloss: &'a [[f32; 4]],
    /// Normals in the tangent frame; `None` where the mesh's own normals are drawn.
    pub normals: Option<&'a [[f32; 3]]>,
    /// ρd; `None` where it is not known. Then 0 is assumed, which only increases the bound.
    pub rho_d: Option<&'a [[f32; 3]]>,
}

impl GlossMaps<'_> {
    /// One patch for each triangle of `mesh`, over every texel that a bilinear look-up within the triangle can reach.
    pub fn patches(&self, mesh: &LeafMesh) -> Vec<GlossPatch> {
        let [w, h] = self.size;
        (0..mesh.triangles())
            .into_par_iter()
            .map(|t| {
                let uv = mesh.triangle(t).map(|k| mesh.uvs[k]);
                let (low, high) = (uv[0].min(uv[1]).min(uv[2]), uv[0].max(uv[1]).max(uv[2]));
                let range = |low: f64, high: f64, n: usize| {
                    let texel = |x: f64| x.clamp(0.0, (n - 1) as f64) as usize;
                    texel((low * n as f64 - 0.5).floor())..texel((high * n as f64 - 0.5).floor() + 1.0) + 1
                };
                let mut out =
                    GlossPatch { rho_s: [0.0; 3], m: [f64::INFINITY, 0.0], tilt: 0.0, rho_d: [f64::INFINITY; 3] };
                for row in range(low.y, high.y, h) {
                    for column in range(low.x, high.x, w) {
                        self.add(row * w + if self.back { w - 1 - column } else { column }, &mut out);
                    }
                }
                out
            })
            .collect()
    }

    fn add(&self, k: usize, out: &mut GlossPatch) {
        let [r, g, b, m] = self.gloss[k].map(f64::from);
        for (c, v) in [r, g, b].into_iter().enumerate() {
            out.rho_s[c] = out.rho_s[c].max(v);
            out.rho_d[c] = out.rho_d[c].min(self.rho_d.map_or(0.0, |d| f64::from(d[k][c]).max(0.0)));
        }
        out.m = [out.m[0].min(m), out.m[1].max(m)];
        if let Some(normals) = self.normals {
            let [x, y, z] = normals[k].map(f64::from);
            out.tilt = out.tilt.max(x.hypot(y).atan2(z));
        }
    }
}

/// The largest difference that one side's gloss makes to a displayed value, over all placements and eyes. The search
/// ends as soon as it has found more than `enough`.
///
/// `places` are the leaf's transforms, each with the eyes that see it there.
pub fn most<Eyes: AsRef<[DVec3]> + Sync>(
    lobe: Lobe,
    mesh: &LeafMesh,
    back: bool,
    patches: &[GlossPatch],
    places: &[(DMat4, Eyes)],
    lights: &LightBounds,
    enough: f64,
) -> f64 {
    let one = |most: f64, (transform, eyes): &(DMat4, Eyes)| -> f64 {
        // Of a forest's leaves, nothing more is asked than what decides.
        if most > enough {
            return most;
        }
        let turn = DMat3::from_mat4(*transform).inverse().transpose();
        let out = if back { -1.0 } else { 1.0 };
        let positions: Vec<DVec3> = mesh.positions.iter().map(|p| transform.transform_point3(*p)).collect();
        let normals: Vec<DVec3> = mesh.normals.iter().map(|n| out * (turn * *n).normalize_or_zero()).collect();
        let mut most = most;
        for (t, patch) in patches.iter().enumerate().filter(|(_, p)| p.rho_s.iter().any(|v| *v > 0.0)) {
            let corner = mesh.triangle(t);
            let (normal, normal_by) = spread(corner.map(|k| normals[k]));
            for eye in eyes.as_ref() {
                if most > enough {
                    return most;
                }
                let (view, view_by) = spread(corner.map(|k| (*eye - positions[k]).normalize_or_zero()));
                // This side is seen where the interpolated normal faces the eye.
                if normal.angle_between(view) - normal_by - view_by >= FRAC_PI_2 {
                    continue;
                }
                most = lights.shown(patch, None, most);
                for (sun, irradiance) in &lights.suns {
                    if normal.angle_between(*sun) - normal_by - lights.radius >= FRAC_PI_2 {
                        continue;
                    }
                    let cone = GlossCone {
                        normal,
                        view,
                        sun: *sun,
                        normal_by: normal_by + patch.tilt,
                        view_by,
                        sun_by: lights.radius,
                    };
                    let lit = Lit {
                        irradiance: *irradiance,
                        // A point of the disk has a weight of one over its cosine to the centre.
                        shine: largest(lobe, &cone, patch.m) / lights.radius.cos(),
                        cosine: (normal.angle_between(*sun) + cone.normal_by + lights.radius)
                            .min(FRAC_PI_2)
                            .cos()
                            .max(0.0),
                    };
                    most = lights.shown(patch, Some(lit), most);
                }
            }
        }
        most
    };
    places.par_iter().fold(|| 0.0, one).reduce(|| 0.0, f64::max)
}

/// The mean of three directions, and the largest angle of one from it. The angle is π where they do not share a
/// hemisphere.
fn spread(directions: [DVec3; 3]) -> (DVec3, f64) {
    let Some(mean) = (directions[0] + directions[1] + directions[2]).try_normalize() else { return (DVec3::Z, PI) };
    let by = directions.map(|d| mean.angle_between(d)).into_iter().fold(0.0, f64::max);
    (mean, if by < FRAC_PI_2 { by } else { PI })
}

/// One sun on one triangle.
#[derive(Debug, Clone, Copy)]
struct Lit {
    irradiance: [f64; 3],
    /// The largest f_s/ρs · N·l.
    shine: f64,
    /// The smallest N·l.
    cosine: f64,
}

/// Number of parts of the sun's disk that are tested one by one, because a shadow's edge may hide the rest.
const PARTS: u32 = 8;
/// The largest slope of the sRGB curve.
const STEEPEST: f64 = 12.92;

impl LightBounds {
    /// The larger of `most` and the contribution of gloss to a displayed value here. The displayed value is a concave
    /// function of radiance, so the bound assumes the least light that the leaf surely scatters beneath the gloss.
    fn shown(&self, patch: &GlossPatch, lit: Option<Lit>, most: f64) -> f64 {
        let mut most = most;
        for c in 0..3 {
            // The directional albedo of a lobe is at most 1.
            let (sky, under_sky) = (patch.rho_s[c] * self.sky[c], patch.rho_d[c] * self.even_sky[c]);
            let (sun, under_sun) = lit.map_or((0.0, 0.0), |l| {
                (patch.rho_s[c] * l.irradiance[c] * l.shine, patch.rho_d[c] * l.irradiance[c] * l.cosine / PI)
            });
            if STEEPEST * self.exposure * (sky + sun) <= most {
                continue;
            }
            for part in 0..if sun > 0.0 { PARTS } else { 1 } {
                let share = |k: u32| f64::from(k) / f64::from(PARTS);
                let (under, gloss) = (under_sky + share(part) * under_sun, sky + share(part + 1) * sun);
                most = most.max(display(under + gloss, self.exposure) - display(under, self.exposure));
            }
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lobes() -> impl Strategy<Value = Lobe> {
        (any::<prop::sample::Index>(), 1.05f64..4.0).prop_map(|(which, index)| {
            let all: Vec<Lobe> = Lobe::all(index).collect();
            *which.get(&all)
        })
    }

    /// A direction `angle` away from the unit vector `d`.
    fn away(d: DVec3, angle: f64, turn: f64) -> DVec3 {
        let (a, b) = d.any_orthonormal_pair();
        d * angle.cos() + (a * turn.cos() + b * turn.sin()) * angle.sin()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 4000, ..ProptestConfig::default() })]

        /// The bound is compared with the reference renderer's own lobe, anywhere within the cone.
        #[test]
        fn no_direction_within_the_cone_is_brighter(
            lobe in lobes(),
            (zenith_v, zenith_l, turn) in (0.0f64..1.6, 0.0f64..1.6, 0.0f64..6.3),
            by in prop::array::uniform3(0.0f64..0.6),
            strays in prop::collection::vec((prop::array::uniform3(0.0f64..1.0), prop::array::uniform3(0.0f64..6.3),
                0.0f64..1.0), 40),
            (m_low, m_more) in (0.02f64..1.5, 0.0f64..1.0),
        ) {
            let view = away(DVec3::Z, zenith_v, 0.0);
            let sun = away(DVec3::Z, zenith_l, turn);
            let cone = GlossCone { normal: DVec3::Z, view, sun, normal_by: by[0], view_by: by[1], sun_by: by[2] };
            let m = [m_low, m_low + m_more];
            let bound = largest(lobe, &cone, m);
            for (share, turns, at) in strays {
                let [n, v, l] = [0, 1, 2].map(|k| away([DVec3::Z, view, sun][k], by[k] * share[k], turns[k]));
                let found = lobe.times_cosine(n, v, l, m[0] + at * m_more);
                prop_assert!(found <= bound * (1.0 + 1e-9), "{found} above the bound {bound}");
            }
        }

        /// For a cone of one direction and one slope, the bound is the lobe itself, except where G is between its
        /// branches.
        #[test]
        fn the_bound_of_a_single_direction_is_the_lobe(zenith_v in 0.0f64..1.5, zenith_l in 0.0f64..1.5,
            turn in 0.0f64..6.3, m in 0.05f64..0.7) {
            let (view, sun) = (away(DVec3::Z, zenith_v, 0.0), away(DVec3::Z, zenith_l, turn));
            let cone = GlossCone { normal: DVec3::Z, view, sun, normal_by: 0.0, view_by: 0.0, sun_by: 0.0 };
            let exact = Lobe::Beckmann.times_cosine(DVec3::Z, view, sun, m);
            prop_assert!((largest(Lobe::Beckmann, &cone, [m, m]) / exact - 1.0).abs() < 1e-6 || exact < 1e-12);
        }
    }

    /// A rectangle with bumps, seen and lit from many places, is compared with radiance that is evaluated directly at
    /// random points of it.
    #[test]
    fn no_point_of_a_leaf_shows_more_gloss_than_the_bound() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let mesh = LeafMesh::rectangle(40.0, 30.0);
        let size = [8, 6];
        let mut tightest = f64::INFINITY;
        for _ in 0..60 {
            let gloss: Vec<[f32; 4]> = (0..48)
                .map(|_| [0, 1, 2, 3].map(|c| rng.random::<f32>() * if c == 3 { 0.5 } else { 0.01 } + 0.05))
                .collect();
            let lean = 0.4 * rng.random::<f32>();
            let normals: Vec<[f32; 3]> = (0..48)
                .map(|_| [lean * (rng.random::<f32>() - 0.5), lean * (rng.random::<f32>() - 0.5), 1.0])
                .collect();
            let rho_d = vec![[0.05f32; 3]; 48];
            let maps = GlossMaps { size, back: false, gloss: &gloss, normals: Some(&normals), rho_d: Some(&rho_d) };
            let eye = away(DVec3::Z, 1.5 * rng.random::<f64>(), 6.0 * rng.random::<f64>()) * 120.0;
            let sun = away(DVec3::Z, 1.5 * rng.random::<f64>(), 6.0 * rng.random::<f64>());
            let lights = LightBounds { suns: vec![(sun, [3.0; 3])], exposure: 2.0, ..LightBounds::default() };
            let bound = most(
                Lobe::Beckmann,
                &mesh,
                false,
                &maps.patches(&mesh),
                &[(DMat4::IDENTITY, vec![eye])],
                &lights,
                f64::INFINITY,
            );
            let mut found = 0.0f64;
            for _ in 0..2000 {
                let k = rng.random_range(0..48);
                let (u, v) = ((k % 8) as f64 + 0.5, (k / 8) as f64 + 0.5);
                let p = DVec3::new((u / 8.0 - 0.5) * 40.0, (0.5 - v / 6.0) * 30.0, 0.0);
                let n = DVec3::from(normals[k].map(f64::from)).normalize();
                let shine = Lobe::Beckmann.times_cosine(n, (eye - p).normalize(), sun, f64::from(gloss[k][3]));
                let under = 0.05 * 3.0 * n.dot(sun).max(0.0) / PI;
                found = found.max(display(under + 3.0 * f64::from(gloss[k][0]) * shine, 2.0) - display(under, 2.0));
            }
            assert!(found <= bound, "{found} above the bound {bound}");
            tightest = tightest.min(bound / found);
        }
        // A bound that is many times too large would never leave anything out.
        assert!(tightest < 2.0, "{tightest}");
    }
}
