//! The foliar scattering model (FSM) of B1, §3. A table says how much light a leaf reflects at its surface, reflects
//! from its inside, and lets through; three lobes say where this light goes.
//!
//! The model's rule for direct light exchanges source and viewer, which the paper justifies by reciprocity. But the
//! table is made with the paper's ABM, whose lobes around the ray are not reciprocal.

use super::exact;
use super::goniometer::{RINGS, SECTORS, projected};
use super::lobe;
use super::{LayeredLeaf, Oblateness, Side, walk};
use mesophyll_base::quadrature;
use std::f64::consts::{FRAC_PI_2, PI};

/// Wavelengths of the table's red, green and blue (nm): the dominant ones of a monitor's colours (Table 2).
pub const WAVELENGTHS: [f64; 3] = [608.0, 551.0, 465.0];
/// Rows of the table: every degree from light along the adaxial normal to light along the abaxial one.
pub const ROWS: usize = 181;
/// Attenuation below which a path ends (ς of Table 3).
pub const CUT: f64 = 0.01;

/// Shares of the incident light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoliarShares {
    /// Reflected by the surface.
    pub surface: f64,
    /// Reflected from the inside.
    pub diffuse: f64,
    /// Let through.
    pub through: f64,
}

/// The light of row `k` of the table: which side is lit, and the angle of incidence (radians). Rows beyond 90° light
/// the abaxial side.
pub fn light(row: usize) -> (Side, f64) {
    let degrees = row as f64;
    if row <= 90 { (Side::Front, degrees.to_radians()) } else { (Side::Back, (180.0 - degrees).to_radians()) }
}

/// The table of a leaf at one wavelength, by the exact method. `None` where that method does not converge.
pub fn table(leaf: &LayeredLeaf) -> Option<Vec<FoliarShares>> {
    let lights: Vec<(Side, f64)> = (0..ROWS).map(light).collect();
    let found = exact::responses(leaf, &lights)?;
    let share = |(&(_, angle), r): (&(Side, f64), &super::LeafResponse)| {
        let surface = leaf.surface_reflectance(angle);
        FoliarShares { surface, diffuse: (r.reflectance - surface).max(0.0), through: r.transmittance }
    };
    Some(lights.iter().zip(&found).map(share).collect())
}

/// The derivatives of the inside's reflectance and of the transmittance by the absorption of one crossing, for each row
/// of the [`table`].
pub fn by_depth(leaf: &LayeredLeaf) -> Vec<[f64; 2]> {
    let lights: Vec<(Side, f64)> = (0..ROWS).map(light).collect();
    let found = exact::by_depth(leaf, &lights);
    found.iter().map(|r| [r.reflectance.by[0], r.transmittance.by[0]]).collect()
}

/// A row of the table that pictures are made with. It has the paper's shares, but light that turns back before it came
/// through the mesophyll is a column of its own. With its angle it has ten numbers, as many as the paper's: what the
/// first interface reflects needs no column, because Fresnel's formula gives it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FoliarRow {
    /// Share that turns back before the mesophyll. Where the lower side is lit, that is light which turns back between
    /// wall and epidermis.
    pub turned: f64,
    /// The lobe of that share; see [`TiltedLobe`].
    pub lobe: TiltedLobe,
    /// Share that is reflected after it came through the mesophyll, at each wavelength.
    pub diffuse: [f64; 3],
    /// Share that is let through.
    pub through: [f64; 3],
}

/// A lobe cos θ/π · (1 + `rise` (sin²θ − ½) + `lean` sin θ cos φ), where θ is the angle from the normal of the lit side
/// and φ the angle from the plane of the mirror direction. It is the diffuse lobe, raised towards the plane of the leaf
/// and leaning forward.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TiltedLobe {
    /// How much more there is at flat angles, 0 to 2.
    pub rise: f64,
    /// How much more there is on the mirror's side.
    pub lean: f64,
}

impl TiltedLobe {
    /// The lobe whose light has these means of sin²θ and of sin θ cos φ, or the closest lobe that is nowhere negative.
    /// The integrals of cos θ/π sin⁴θ and of cos θ/π sin²θ cos²φ are 1/3 and 1/4.
    pub fn of(square: f64, forward: f64) -> TiltedLobe {
        let rise = (12.0 * (square - 0.5)).clamp(0.0, 2.0);
        let low = 1.0 - 0.5 * rise;
        // The smallest value of (low + rise s²)/s for s up to 1.
        let most = if low < rise { 2.0 * (low * rise).sqrt() } else { low + rise };
        TiltedLobe { rise, lean: (4.0 * forward).clamp(-most, most) }
    }

    /// The lobe divided by the diffuse one. `forward` is sin θ cos φ.
    pub fn over_diffuse(&self, cos: f64, forward: f64) -> f64 {
        (1.0 + self.rise * (0.5 - cos * cos) + self.lean * forward).max(0.0)
    }

    /// An upper bound of [`TiltedLobe::over_diffuse`].
    pub fn most(&self) -> f64 {
        1.0 + 0.5 * self.rise + self.lean.abs()
    }
}

/// How many rays are followed for the lobe of a row, and how many degrees lie between the rows that a lobe is computed
/// for.
const LOBE_RAYS: u64 = 1 << 17;
const LOBE_STEP: usize = 5;
/// An absorption of one crossing after which nothing is left.
const BLACK: f64 = 1e6;

/// The table of a leaf at three wavelengths. The leaf is also computed with a black mesophyll: all that such a leaf
/// reflects from inside has turned back before the mesophyll. The paper takes this light for diffuse, but it has met
/// few lobes, so more of it leaves forward. Its lobe is found from random rays in the black leaf, of which two means
/// are kept. `None` where the exact method does not converge.
pub fn rows(leaves: &[LayeredLeaf; 3]) -> Option<Vec<FoliarRow>> {
    let [r, g, b] = leaves;
    let tables = [table(r)?, table(g)?, table(b)?];
    let twin = LayeredLeaf { depth: BLACK, ..*g };
    let black = table(&twin)?;
    let anchors: Vec<TiltedLobe> = (0..=(ROWS - 1) / LOBE_STEP).map(|k| turned_lobe(&twin, k * LOBE_STEP)).collect();
    let row = |k: usize| {
        let (at, t) = (k / LOBE_STEP, (k % LOBE_STEP) as f64 / LOBE_STEP as f64);
        let next = anchors.get(at + 1).unwrap_or(&anchors[at]);
        let mix = |x: f64, y: f64| x + t * (y - x);
        let lobe = TiltedLobe { rise: mix(anchors[at].rise, next.rise), lean: mix(anchors[at].lean, next.lean) };
        let turned = tables.iter().map(|t| t[k].diffuse).fold(black[k].diffuse, f64::min);
        FoliarRow {
            turned,
            lobe,
            diffuse: [0, 1, 2].map(|c: usize| tables[c][k].diffuse - turned),
            through: [0, 1, 2].map(|c: usize| tables[c][k].through),
        }
    };
    Some((0..ROWS).map(row).collect())
}

/// The lobe of a leaf whose mesophyll is black, for the light of a row: means over the light that leaves, without the
/// light that the face mirrors.
fn turned_lobe(twin: &LayeredLeaf, row: usize) -> TiltedLobe {
    let (side, at) = light(row);
    // Light along the plane of the leaf is mirrored completely, so the row takes the lobe of slightly steeper light.
    let at = at.min(88f64.to_radians());
    // Without a lobe on the face, everything it mirrors falls into one known patch.
    let twin = LayeredLeaf { oblateness: Oblateness { cuticle: f64::INFINITY, ..twin.oblateness }, ..*twin };
    let seen = walk::directions(&twin, side, at, LOBE_RAYS, 1, &|| false);
    let mut shares: Vec<f64> =
        (0..RINGS / 2 * SECTORS).map(|k| seen.reading(k / SECTORS, k % SECTORS).fraction.0).collect();
    if let Some(mirror) = shares.iter_mut().max_by(|a, b| a.total_cmp(b)) {
        *mirror -= twin.surface_reflectance(at);
    }
    let (mut all, mut square, mut forward) = (0.0, 0.0, 0.0);
    for (k, share) in shares.iter().enumerate() {
        let zenith = PI * ((k / SECTORS) as f64 + 0.5) / RINGS as f64;
        let azimuth = 2.0 * PI * ((k % SECTORS) as f64 + 0.5) / SECTORS as f64;
        all += share;
        square += share * zenith.sin().powi(2);
        forward -= share * zenith.sin() * azimuth.cos();
    }
    // There is so little light that its means would be noise.
    if all < 2e-3 { TiltedLobe::default() } else { TiltedLobe::of(square / all, forward / all) }
}

/// The angle between the leaf's normal and the way back along a ray (Eq. 5, radians).
pub fn theta(normal: [f64; 3], ray: [f64; 3]) -> f64 {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = [
        normal[1] * ray[2] - normal[2] * ray[1],
        normal[2] * ray[0] - normal[0] * ray[2],
        normal[0] * ray[1] - normal[1] * ray[0],
    ];
    // arctan keeps the digits near 0 and 180° that arccos loses
    dot(cross, cross).sqrt().atan2(-dot(normal, ray))
}

/// What the rule for direct light selects (1/sr): ρd/π where source and viewer are on one side, otherwise τ/π. Angles
/// are from the adaxial normal, 0 to π.
pub fn direct(incidence: f64, source: f64, diffuse: f64, through: f64) -> f64 {
    let same = (incidence <= FRAC_PI_2) == (source <= FRAC_PI_2);
    (if same { diffuse } else { through }) / PI
}

/// Luminance of an attenuation (Eq. 4).
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2122 * r + 0.7013 * g + 0.0865 * b
}

/// Density (1/sr) of the directions of surface reflection around the mirror direction of light at `incidence`;
/// directions below the surface were drawn again. `zenith` is from the normal of the lit side, `azimuth` from the
/// source.
pub fn surface_density(incidence: f64, ob: f64, zenith: f64, azimuth: f64, acceptance: f64) -> f64 {
    if zenith > FRAC_PI_2 {
        return 0.0;
    }
    // The mirror direction has azimuth π. The half angles keep the digits where the two are close.
    let half = |x: f64| (0.5 * x).sin().powi(2);
    let square = half(zenith - incidence) + zenith.sin() * incidence.sin() * half(azimuth - PI);
    let alpha = 2.0 * square.sqrt().min(1.0).asin();
    lobe::density(alpha, ob) / acceptance
}

/// Share of the incident light that the model sends into a patch of the goniometer. `incidence` is from the normal of
/// the lit side, below π/2; `ob` is finite.
pub fn patch(incidence: f64, ob: f64, shares: FoliarShares, ring: usize, sector: usize) -> f64 {
    let lambert = projected(ring) / PI;
    if ring >= RINGS / 2 {
        return shares.through * lambert;
    }
    let (z0, z1) = (PI * ring as f64 / RINGS as f64, PI * (ring + 1) as f64 / RINGS as f64);
    let (a0, a1) = (2.0 * PI * sector as f64 / SECTORS as f64, 2.0 * PI * (sector + 1) as f64 / SECTORS as f64);
    let acceptance = lobe::acceptance(incidence, ob);
    let width = 1.0 / (ob + 1.0).sqrt();
    let around = |center: f64, by: f64| [-9.0, -4.0, -1.5, 0.0, 1.5, 4.0, 9.0].map(|k| center + k * by);
    let pieces = |mut ends: Vec<f64>, from: f64, to: f64| {
        ends.retain(|e| *e > from && *e < to);
        ends.extend([from, to]);
        ends.sort_by(f64::total_cmp);
        ends
    };
    let rule = quadrature::unit(16);
    let integrate = |ends: &[f64], f: &dyn Fn(f64) -> f64| -> f64 {
        let piece = |p: &[f64]| rule.iter().map(|(x, w)| w * (p[1] - p[0]) * f(p[0] + (p[1] - p[0]) * x)).sum::<f64>();
        ends.windows(2).map(piece).sum()
    };
    let ring_of = |zenith: f64| {
        let (a, b) = (zenith.cos() * incidence.cos(), zenith.sin() * incidence.sin());
        let mut ends = around(PI, width / b.sqrt().max(1e-3)).to_vec();
        if a < b {
            let edge = (-a / b).acos();
            ends.extend([PI - edge, PI + edge]);
        }
        let density = |azimuth: f64| surface_density(incidence, ob, zenith, azimuth, acceptance);
        zenith.sin() * integrate(&pieces(ends, a0, a1), &density)
    };
    let mut ends = around(incidence, width).to_vec();
    ends.extend((1..8).map(|k| z0 + (z1 - z0) * f64::from(k) / 8.0));
    ends.push(FRAC_PI_2 - incidence);
    shares.surface * integrate(&pieces(ends, z0, z1), &ring_of) + shares.diffuse * lambert
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_hold_all_light_of_the_three_lobes() {
        let shares = FoliarShares { surface: 0.5, diffuse: 0.2, through: 0.1 };
        for (incidence, ob) in [(0.0, 5.0), (0.6, 5.0), (1.4, 5.0), (0.9, 0.5), (0.7, 2000.0), (1.2, 1e6)] {
            let all = |rings: std::ops::Range<usize>| -> f64 {
                rings.flat_map(|r| (0..SECTORS).map(move |s| patch(incidence, ob, shares, r, s))).sum()
            };
            let (up, down) = (all(0..RINGS / 2), all(RINGS / 2..RINGS));
            assert!((up - 0.7).abs() < 2e-6 && (down - 0.1).abs() < 1e-12, "{incidence} {ob}: {up} {down}");
        }
    }

    #[test]
    fn the_lobe_of_light_that_turned_back_keeps_its_means() {
        let rule = quadrature::unit(40);
        for (square, forward) in [(0.545, 0.25), (0.5, 0.1), (0.53, 0.0)] {
            let lobe = TiltedLobe::of(square, forward);
            let (mut sums, mut least) = ([0.0; 3], f64::INFINITY);
            for &(x, w) in &rule {
                for k in 0..64 {
                    let (phi, cos) = (2.0 * PI * f64::from(k) / 64.0, x.sqrt());
                    let sin = (1.0 - x).sqrt();
                    let ratio = lobe.over_diffuse(cos, sin * phi.cos());
                    least = least.min(ratio);
                    assert!(ratio <= lobe.most() + 1e-12);
                    // cos θ/π over the hemisphere is even in cos²θ
                    let share = w / 64.0 * ratio;
                    [1.0, sin * sin, sin * phi.cos()].iter().zip(&mut sums).for_each(|(f, sum)| *sum += f * share);
                }
            }
            assert!((sums[0] - 1.0).abs() < 1e-9 && (sums[1] - square).abs() < 1e-9, "{sums:?}");
            assert!((sums[2] - forward).abs() < 1e-9 && least >= 0.0, "{sums:?}");
        }
        // Means that no such lobe can have are limited, and the lobe stays a density.
        assert!(TiltedLobe::of(0.6, 0.9).lean < 3.6 && TiltedLobe::of(0.2, 0.0).rise == 0.0);
    }

    #[test]
    fn the_rule_for_direct_light_goes_by_sides() {
        let degrees = |i: f64, s: f64| direct(i.to_radians(), s.to_radians(), 0.3, 0.2) * PI;
        assert!((degrees(20.0, 80.0) - 0.3).abs() < 1e-15 && (degrees(120.0, 100.0) - 0.3).abs() < 1e-15);
        assert!((degrees(20.0, 100.0) - 0.2).abs() < 1e-15 && (degrees(120.0, 10.0) - 0.2).abs() < 1e-15);
        assert!((luminance([1.0; 3]) - 1.0).abs() < 1e-12);
        assert!((theta([0.0, 0.0, 2.0], [0.0, 0.0, -1.0])).abs() < 1e-15);
        assert!((theta([0.0, 0.0, 1.0], [3.0, 0.0, -3.0]) - 0.25 * PI).abs() < 1e-15);
    }

    #[test]
    fn rows_run_from_one_normal_to_the_other() {
        assert_eq!(light(0), (Side::Front, 0.0));
        assert_eq!(light(90), (Side::Front, FRAC_PI_2));
        assert_eq!(light(180), (Side::Back, 0.0));
        assert!((light(91).1 - 89f64.to_radians()).abs() < 1e-15);
        let table = table(&LayeredLeaf::soybean(0.4)).unwrap();
        assert!(table.len() == ROWS && (table[90].surface - 1.0).abs() < 1e-12 && table[90].through < 1e-12);
        assert!(table.iter().all(|s| s.diffuse >= 0.0 && s.through >= 0.0));
    }
}
