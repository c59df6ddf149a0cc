//! Leaves by the models of B1 (Baranoski & Rokne 2001), as surfaces that paths meet.
//!
//! Both models follow a path against the light as if it went with the light: what comes from the viewer is scattered,
//! and lights are looked for where it goes. This is right for reciprocal surfaces. The layered leaf is not quite
//! reciprocal (`docs/evidence/foliar.md` gives the error), and FSM's rule for direct light makes the same assumption.
//!
//! - [`FoliarModel::Fsm`]: a table gives the shares of the light for each side and degree, and lobes give the
//!   directions. Light that is reflected at the face, and light that turned back before it reached the mesophyll, goes
//!   around the mirror direction. The rest is diffuse.
//! - [`FoliarModel::Abm`]: each scattering follows a ray through the layers. The density of its direction cannot be
//!   evaluated, so lights are found only by rays that hit them.

use crate::lobe::ReflectionLobe;
use glam::DVec3;
use mesophyll_optics::foliar::fsm::{self, FoliarRow, FoliarShares, ROWS, TiltedLobe};
use mesophyll_optics::foliar::goniometer::{self, RINGS, SECTORS};
use mesophyll_optics::foliar::{LayeredLeaf, lobe, ray};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::Side;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The choice between the two models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FoliarModel {
    /// A table and lobes.
    #[default]
    Fsm,
    /// Rays through the layers.
    Abm,
}

/// A leaf that is the same everywhere. Its front is the adaxial side.
#[derive(Debug, Clone, PartialEq)]
pub struct FoliarMaterial {
    model: FoliarModel,
    /// The leaf for each channel.
    leaves: [LayeredLeaf; 3],
    table: Vec<FoliarRow>,
    /// For each degree of incidence, the share of first draws around the mirror direction that stay on their side.
    acceptance: Vec<f64>,
    /// How `diffuse` and `through` of each row change with the absorption of one crossing of their channel; empty where
    /// nobody asked.
    by_depth: Vec<[[f64; 3]; 2]>,
}

/// The scattering at a point that a path meets, as shares for each channel.
#[derive(Debug, Clone, Copy)]
pub struct FoliarScattering {
    /// Diffuse share on the side that the path came from.
    pub diffuse: [f64; 3],
    /// Diffuse share on the other side.
    pub through: [f64; 3],
    /// Share around the mirror direction.
    pub surface: [f64; 3],
    /// Oblateness of the lobe around the mirror direction.
    pub oblateness: f64,
    /// Share of first draws around the mirror direction that stay on their side.
    acceptance: f64,
    /// Share that turned back before the mesophyll; the next field is its lobe.
    pub turned: f64,
    lobe: TiltedLobe,
}

/// The leaf for renderers that know only matte leaves with a gloss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatteLeaf {
    /// Diffuse reflectance of the front and of the back, without the light that is mirrored at the face.
    pub rho_d: [[f64; 3]; 2],
    /// Transmittance, the same in both directions.
    pub rho_t: [f64; 3],
    /// Scale of the Cook–Torrance gloss on both sides; it is about 1.
    pub rho_s: [f64; 3],
    /// Slope of the gloss.
    pub m: f64,
    /// Refractive index of the gloss: that of the cuticle for green light.
    pub index: f64,
}

impl FoliarScattering {
    /// Densities (1/sr) of the light that is reflected at the face, and of the light that turned back, in a unit
    /// direction on the lit side. `cos` is its cosine to the normal, `mirror` to the mirror direction, and `forward`
    /// its component along the mirror's side of the leaf.
    pub fn densities(&self, cos: f64, mirror: f64, forward: f64) -> [f64; 2] {
        let alpha = mirror.clamp(-1.0, 1.0).acos();
        let around = lobe::density(alpha, self.oblateness) / self.acceptance;
        [around, cos / PI * self.lobe.over_diffuse(cos, forward)]
    }

    /// A direction drawn by the second of these densities: its cosine, and its sines along and across the mirror's
    /// side.
    pub fn draw_turned(&self, random: &mut impl FnMut() -> f64) -> [f64; 3] {
        loop {
            let (square, phi, keep) = (random(), TAU * random(), random());
            let (cos, sin) = ((1.0 - square).sqrt(), square.sqrt());
            let forward = sin * phi.cos();
            if keep * self.lobe.most() < self.lobe.over_diffuse(cos, forward) {
                return [cos, forward, sin * phi.sin()];
            }
        }
    }
}

impl FoliarMaterial {
    /// A leaf, by its layers for red, green and blue. `None` where the exact method does not converge (see
    /// [`mesophyll_optics::foliar::exact`]), and for a lobe of infinite oblateness on the faces, which has no density.
    pub fn new(model: FoliarModel, leaves: [LayeredLeaf; 3]) -> Option<FoliarMaterial> {
        let oblateness = leaves[1].oblateness.cuticle;
        if oblateness.is_infinite() {
            return None;
        }
        let table = fsm::rows(&leaves)?;
        let acceptance = (0..=90).map(|k| lobe::acceptance(f64::from(k).to_radians(), oblateness)).collect();
        Some(FoliarMaterial { model, leaves, table, acceptance, by_depth: Vec::new() })
    }

    /// The same leaf with other absorptions of one crossing, with what [`FoliarMaterial::by_depth`] needs. Light that
    /// turns back before the mesophyll does not depend on these. `None` where the exact method does not converge.
    pub fn with_depths(&self, depths: [f64; 3]) -> Option<FoliarMaterial> {
        let mut out = self.clone();
        let mut slopes = Vec::with_capacity(3);
        for (c, depth) in depths.into_iter().enumerate() {
            out.leaves[c].depth = depth;
            let table = fsm::table(&out.leaves[c])?;
            for (row, share) in out.table.iter_mut().zip(table) {
                (row.diffuse[c], row.through[c]) = ((share.diffuse - row.turned).max(0.0), share.through);
            }
            slopes.push(fsm::by_depth(&out.leaves[c]));
        }
        out.by_depth = (0..ROWS).map(|k| [0, 1].map(|q| [0, 1, 2].map(|c: usize| slopes[c][k][q]))).collect();
        Some(out)
    }

    /// The absorptions of one crossing.
    pub fn depths(&self) -> [f64; 3] {
        self.leaves.each_ref().map(|leaf| leaf.depth)
    }

    /// The derivatives of `diffuse` and `through` of [`FoliarMaterial::meet`] by the absorption of one crossing, each
    /// of its channel; 0 where [`FoliarMaterial::with_depths`] did not make the leaf.
    pub fn by_depth(&self, view: DVec3, normal: DVec3, back: bool) -> [[f64; 3]; 2] {
        let (_, at) = incidence(view, normal, back);
        let (k, t) = place(at, ROWS);
        let (Some(a), Some(b)) = (self.by_depth.get(k), self.by_depth.get(k + 1)) else { return [[0.0; 3]; 2] };
        [0, 1].map(|q| [0, 1, 2].map(|c: usize| a[q][c] + t * (b[q][c] - a[q][c])))
    }

    /// FSM as in the paper, where light that turned back before the mesophyll is diffuse too.
    pub fn of_paper(&self) -> FoliarMaterial {
        let mut out = FoliarMaterial { model: FoliarModel::Fsm, ..self.clone() };
        for row in &mut out.table {
            row.diffuse.iter_mut().for_each(|d| *d += row.turned);
            row.turned = 0.0;
        }
        out
    }

    /// The same leaf by another model.
    pub fn by(&self, model: FoliarModel) -> FoliarMaterial {
        FoliarMaterial { model, ..self.clone() }
    }

    /// The model by which it is drawn.
    pub fn model(&self) -> FoliarModel {
        self.model
    }

    /// The leaf for a renderer that knows only matte leaves with a gloss. Its diffuse shares are means under light from
    /// everywhere. Its gloss is the nearest one to the reflection at the faces.
    pub fn stand_in(&self) -> MatteLeaf {
        // ∫ 2 sin θ cos θ of a quantity of the rows, in whole degrees.
        let mean = |back: bool, share: &dyn Fn(f64, &FoliarRow) -> f64| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for k in 0..=90 {
                let angle = (k as f64).to_radians();
                let w = (2.0 * angle).sin();
                sum += w * share(angle, &self.table[if back { ROWS - 1 - k } else { k }]);
                weight += w;
            }
            sum / weight
        };
        let side =
            |back: bool| -> [f64; 3] { [0, 1, 2].map(|c: usize| mean(back, &|_, row| row.turned + row.diffuse[c])) };
        let (front, back) = (side(false), side(true));
        // One transmittance for both directions. It is so small that neither side returns more light than it gets,
        // including the light that the faces mirror.
        let rho_t = [0, 1, 2].map(|c: usize| {
            let mirrored = mean(false, &|angle, _| self.leaves[c].surface_reflectance(angle));
            let both = 0.5 * (mean(false, &|_, row| row.through[c]) + mean(true, &|_, row| row.through[c]));
            both.min(1.0 - mirrored - front[c]).min(1.0 - mirrored - back[c])
        });
        let (rho_s, m) = self.nearest_gloss();
        MatteLeaf { rho_d: [front, back], rho_t, rho_s, m, index: self.leaves[1].n_cuticle }
    }

    /// ρs for each channel, and the slope m (to .01), of the Cook–Torrance lobe that is nearest to the face's
    /// reflection of green light. The fit is by least squares of f_s (N·l) over directions of view and of light.
    /// Residuals are relative to the total reflection for each view, so that bright grazing views do not dominate.
    fn nearest_gloss(&self) -> ([f64; 3], f64) {
        const VIEWS: usize = 8;
        const RINGS: usize = 12;
        const SECTORS: usize = 16;
        let green = &self.leaves[1];
        if green.surface_reflectance(0.0) <= 0.0 {
            return ([0.0; 3], 1.0);
        }
        let lobe = Lobe::CookTorrance { index: green.n_cuticle };
        let middle = |k: usize, of: usize| (k as f64 + 0.5) / of as f64;
        // Each sample is a view, a light and the density that the face sends there, over equal parts of sin²θ.
        let samples: Vec<(DVec3, DVec3, f64)> = (0..VIEWS * RINGS * SECTORS)
            .map(|k| {
                let (view, ring, sector) = (k / (RINGS * SECTORS), k / SECTORS % RINGS, k % SECTORS);
                let sin = middle(view, VIEWS).sqrt();
                let view = DVec3::new(sin, 0.0, (1.0 - sin * sin).sqrt());
                let cos = middle(ring, RINGS);
                let (y, x) = (TAU * middle(sector, SECTORS)).sin_cos();
                let light = DVec3::new(x * (1.0 - cos * cos).sqrt(), y * (1.0 - cos * cos).sqrt(), cos);
                let met = self.meet(view, DVec3::Z, false);
                let mirror = DVec3::new(-view.x, 0.0, view.z).dot(light);
                (view, light, met.densities(cos, mirror, 0.0)[0])
            })
            .collect();
        let fit = |m: f64| {
            let (mut both, mut own, mut rest) = (0.0, 0.0, 0.0);
            for (view, light, value) in &samples {
                let face = green.surface_reflectance(view.z.acos());
                let shown = lobe.times_cosine(DVec3::Z, *view, *light, m) / face;
                both += shown * value;
                own += shown * shown;
                rest += value * value;
            }
            (rest - both * both / own, both / own)
        };
        let (_, scale, m) = (5..=100)
            .map(|k| (f64::from(k) * 0.01, fit(f64::from(k) * 0.01)))
            .map(|(m, (misfit, scale))| (misfit, scale, m))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((0.0, 0.0, 1.0));
        let of_green = |leaf: &LayeredLeaf| scale * leaf.surface_reflectance(0.0) / green.surface_reflectance(0.0);
        (self.leaves.each_ref().map(of_green), m)
    }

    /// The scattering for a path that comes from the unit direction `view` onto the side with the normal `normal`.
    pub fn meet(&self, view: DVec3, normal: DVec3, back: bool) -> FoliarScattering {
        let (incidence, at) = incidence(view, normal, back);
        let (k, t) = place(at, ROWS);
        let [a, b] = [&self.table[k], &self.table[k + 1]];
        let mix = |x: f64, y: f64| x + t * (y - x);
        let (k, u) = place(incidence.to_degrees(), self.acceptance.len());
        FoliarScattering {
            diffuse: [0, 1, 2].map(|c: usize| mix(a.diffuse[c], b.diffuse[c])),
            through: [0, 1, 2].map(|c: usize| mix(a.through[c], b.through[c])),
            surface: self.leaves.each_ref().map(|leaf| leaf.surface_reflectance(incidence)),
            oblateness: self.leaves[1].oblateness.cuticle,
            acceptance: self.acceptance[k] + u * (self.acceptance[k + 1] - self.acceptance[k]),
            turned: mix(a.turned, b.turned),
            lobe: TiltedLobe { rise: mix(a.lobe.rise, b.lobe.rise), lean: mix(a.lobe.lean, b.lobe.lean) },
        }
    }

    /// Shares of one channel's light at `incidence` (radians from the normal of the lit side) that FSM sends into the
    /// patches of the goniometer, ring by ring ([`mesophyll_optics::foliar::goniometer`]).
    pub fn patches(&self, side: Side, incidence: f64, channel: usize) -> Vec<f64> {
        let back = side == Side::Back;
        let view = DVec3::new(incidence.sin(), 0.0, incidence.cos());
        let met = self.meet(view, DVec3::Z, back);
        let shares = FoliarShares {
            surface: met.surface[channel],
            diffuse: met.diffuse[channel],
            through: met.through[channel],
        };
        let patch = |k: usize| {
            let (ring, sector) = (k / SECTORS, k % SECTORS);
            let rest = fsm::patch(incidence, met.oblateness, shares, ring, sector);
            if ring >= RINGS / 2 {
                return rest;
            }
            let zenith = PI * (ring as f64 + 0.5) / RINGS as f64;
            let azimuth = TAU * (sector as f64 + 0.5) / SECTORS as f64;
            let over = met.lobe.over_diffuse(zenith.cos(), -zenith.sin() * azimuth.cos());
            rest + met.turned * over * goniometer::projected(ring) / PI
        };
        (0..RINGS * SECTORS).map(patch).collect()
    }

    /// Follows a ray from `view` through the layered leaf. Returns its direction, what each channel keeps of it, and
    /// how many crossings of the mesophyll it made. Refractive indices are those for green. `up` is the front's
    /// normal.
    pub fn follow(&self, view: DVec3, up: DVec3, random: &mut impl FnMut() -> f64) -> Option<(DVec3, [f64; 3], f64)> {
        let (x, y) = up.any_orthonormal_pair();
        let from = [-view.dot(x), -view.dot(y), -view.dot(up)];
        let exit = ray::follow(&self.leaves[1], from, random)?;
        let [a, b, c] = exit.direction;
        let kept = self.leaves.each_ref().map(|leaf| (-leaf.depth * exit.crossings).exp());
        Some(((x * a + y * b + up * c).normalize(), kept, exit.crossings))
    }
}

/// The angle of incidence (radians) of a path from `view`, and the place of its row (degrees).
fn incidence(view: DVec3, normal: DVec3, back: bool) -> (f64, f64) {
    let incidence = normal.cross(view).length().atan2(normal.dot(view)).clamp(0.0, FRAC_PI_2);
    (incidence, (if back { PI - incidence } else { incidence }).to_degrees())
}

/// The interval between two of `rows` whole degrees that contains `at`, and the share of it before `at`.
fn place(at: f64, rows: usize) -> (usize, f64) {
    let k = (at.max(0.0) as usize).min(rows - 2);
    (k, (at - k as f64).clamp(0.0, 1.0))
}

/// An unlimited stream of uniform numbers for one scattering, seeded by the numbers that a path has for it. Lobes with
/// rejected draws and rays through layers need any number of them.
pub fn stream(numbers: [f64; 4]) -> impl FnMut() -> f64 {
    use rand::{RngExt, SeedableRng};
    let seed = numbers.iter().fold(0x9e37_79b9_7f4a_7c15_u64, |hash, x| {
        (hash ^ x.to_bits()).wrapping_mul(0xbf58_476d_1ce4_e5b9).rotate_left(27)
    });
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    move || rng.random::<f64>()
}
