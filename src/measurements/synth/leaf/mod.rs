//! The truth about a leaf, texel by texel: outline, veins, relief and normals, thickness, pigment, γ, gloss, and the
//! light of the interior. Both sides share interior and shape. The back's maps are stored as its camera saw them:
//! column i of the back is column W−1−i of the front (W columns in all), and x and z change sign. Lengths in mm,
//! coefficients in 1/mm, albedos in [0, 1].

use super::interior::InteriorMaps;
use super::spec::{InteriorModel, LeafSpec};
use super::{outline::BladeContour, veins::VeinNetwork};
use mesophyll_base::image::ImageSize;
use mesophyll_base::random::{mesh, noise};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::{Side, Sides, mirror};
use rayon::prelude::*;

/// One texel of a side as its camera saw it; all zero off the blade. A slab has σ and γ, a leaf of layers has pigments
/// and their absorption.
#[derive(Debug, Clone, Copy, Default)]
pub struct SyntheticTexel {
    /// Diffuse reflectance.
    pub rho_d: Rgb<f32>,
    /// Transmittance.
    pub rho_t: Rgb<f32>,
    /// Transmittance for a beam at the light box's camera angle; ρt where the camera looks along the normal.
    pub through: Rgb<f32>,
    /// Gloss reflectance.
    pub rho_s: f32,
    /// Slope of the gloss.
    pub m: f32,
    /// Unit normal in this side's image: x right, y up, z out of the side.
    pub normal: [f32; 3],
    /// Absorption coefficient of the slab (1/mm).
    pub sigma_a: Rgb<f32>,
    /// Scattering coefficient of the slab (1/mm).
    pub sigma_s: Rgb<f32>,
    /// Thickness (mm).
    pub thickness: f32,
    /// γ: the texel's reflectance relative to that of a slab.
    pub gamma: Rgb<f32>,
    /// Chlorophyll of a leaf of layers (µg/cm²).
    pub chlorophyll: f32,
    /// Carotenoids of a leaf of layers (µg/cm²).
    pub carotenoid: f32,
    /// Absorption of the mesophyll of a leaf of layers over the leaf's thickness (1/mm).
    pub absorption: Rgb<f32>,
}

/// A grown leaf: its outline, its relief and both sides' maps.
#[derive(Debug, Clone)]
pub struct SyntheticLeaf {
    /// Columns and rows of every map.
    pub size: ImageSize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// The gloss lobe of both sides.
    pub lobe: Lobe,
    /// What its inside is.
    pub model: InteriorModel,
    /// Texels on the leaf, as the front's camera saw it.
    pub mask: Vec<bool>,
    /// Height of the front over the plane z = 0 (mm), in the front's columns; set on the blade and one texel around it.
    pub relief: Vec<f64>,
    /// The maps of each side, in its own camera's columns.
    pub sides: Sides<Vec<SyntheticTexel>>,
}

/// Which part of the field is evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldWindow {
    /// Centre of the part, from the centre of the field (mm), x right and y up.
    pub centre_mm: [f64; 2],
    /// Size of a texel (mm).
    pub texel_mm: f64,
}

/// What a place on the blade is made of, before it is split into maps (front's columns).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Place {
    pub inside: bool,
    /// How much of a vein of each order the place is, 0 to 1.
    vein: [f64; 3],
    /// Height of the front and of the back over the plane (mm), z towards the front's camera.
    front_mm: f64,
    back_mm: f64,
    /// Thickness in units of h, before its mean is set.
    pub thickness: f64,
    /// Chlorophyll relative to the leaf's.
    pub chlorophyll: f64,
    /// Carotenoids relative to the leaf's.
    pub carotenoid: f64,
    /// Slow and fine noise for γ and gloss of each side, standard deviation ~1.
    mottle: [f64; 4],
}

/// Size of a texel so that the specified field fits into the image (mm).
pub(crate) fn texel_size(spec: &LeafSpec, size: ImageSize) -> f64 {
    (spec.field_mm[0] / size.width as f64).max(spec.field_mm[1] / size.height as f64)
}

impl SyntheticLeaf {
    /// Grows the leaf and evaluates its maps at one resolution; `None` when not one texel lies on the blade, or the
    /// specification does not state what the model asks for ([`LeafSpec::truth`]).
    pub fn grow(spec: &LeafSpec, model: InteriorModel, width: usize, height: usize) -> Option<SyntheticLeaf> {
        let size = ImageSize::new(width, height);
        let window = FieldWindow { centre_mm: [0.0; 2], texel_mm: texel_size(spec, size) };
        SyntheticLeaf::grow_in(spec, model, size, window)
    }

    /// The same for a part of the field. The leaf is the same whichever part is seen, except that the means of
    /// thickness and γ are those of the part.
    pub(crate) fn grow_in(
        spec: &LeafSpec,
        model: InteriorModel,
        size: ImageSize,
        window: FieldWindow,
    ) -> Option<SyntheticLeaf> {
        let ImageSize { width, height } = size;
        let FieldWindow { centre_mm, texel_mm } = window;
        let blade = BladeContour::new(&spec.outline, &spec.margin, spec.seed);
        let network = VeinNetwork::grow(&blade, &spec.veins, spec.seed);
        let x: Vec<f64> = (0..width).map(|i| centre_mm[0] + size.place_mm(texel_mm, i)[0]).collect();
        let y = |j: usize| centre_mm[1] + size.place_mm(texel_mm, j * width)[1];
        let rows: Vec<Vec<bool>> = (0..height).into_par_iter().map(|j| blade.row(y(j), &x)).collect();
        let places: Vec<Place> = (0..height)
            .into_par_iter()
            .flat_map_iter(|j| {
                // Slopes also need the neighbours, on the blade or not.
                let wanted = |i: usize| {
                    (j.saturating_sub(1)..(j + 2).min(height))
                        .any(|b| (i.saturating_sub(1)..(i + 2).min(width)).any(|a| rows[b][a]))
                };
                let (rows, x, network) = (&rows, &x, &network);
                (0..width)
                    .map(|i| {
                        if wanted(i) {
                            place(spec, network, [x[i], y(j)], texel_mm, rows[j][i])
                        } else {
                            Place::default()
                        }
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        if !places.iter().any(|p| p.inside) {
            return None;
        }
        let interior = InteriorMaps::of(spec, model, &places)?;
        let sides = Sides::of(|lit| side(spec, model, &places, &interior, (size, texel_mm), lit));
        let (mask, relief) = places.iter().map(|p| (p.inside, p.front_mm)).unzip();
        Some(SyntheticLeaf { size, texel_mm, lobe: spec.lobe, model, mask, relief, sides })
    }

    /// The leaf without `margin` texels along each edge of its maps; `margin` is less than half of width and height.
    pub fn cropped(&self, margin: usize) -> SyntheticLeaf {
        let width = self.size.width;
        SyntheticLeaf {
            size: ImageSize::new(width - 2 * margin, self.size.height - 2 * margin),
            mask: crop(&self.mask, width, margin),
            relief: crop(&self.relief, width, margin),
            sides: Sides::of(|side| crop(&self.sides[side], width, margin)),
            ..*self
        }
    }

    /// The mask as that side's camera saw it.
    pub fn mask_of(&self, side: Side) -> Vec<bool> {
        match side {
            Side::Front => self.mask.clone(),
            Side::Back => mirror(&self.mask, self.size.width),
        }
    }

    /// The truth in the channels of `data/README.md`: those that the leaf's model has.
    pub fn truth(&self, side: Side) -> ChannelMaps {
        let texels = &self.sides[side];
        let mut maps = ChannelMaps::new(self.size.width, self.size.height);
        let mut three = |quantity, of: fn(&SyntheticTexel) -> [f32; 3]| {
            (0..3).for_each(|c| maps.add(quantity, c, texels.iter().map(|t| of(t)[c]).collect()));
        };
        three(Quantity::RhoD, |t| t.rho_d.0);
        three(Quantity::RhoS, |t| [t.rho_s; 3]);
        three(Quantity::RhoT, |t| t.rho_t.0);
        three(Quantity::Normal, |t| t.normal);
        let layered = self.model == InteriorModel::Foliar;
        if layered {
            three(Quantity::Absorption, |t| t.absorption.0);
        } else {
            three(Quantity::SigmaA, |t| t.sigma_a.0);
            three(Quantity::SigmaS, |t| t.sigma_s.0);
            three(Quantity::Gamma, |t| t.gamma.0);
        }
        let mut one = |quantity, of: fn(&SyntheticTexel) -> f32| {
            maps.add(quantity, 0, texels.iter().map(of).collect());
        };
        if layered {
            one(Quantity::Chlorophyll, |t| t.chlorophyll);
            one(Quantity::Carotenoid, |t| t.carotenoid);
        }
        one(Quantity::M, |t| t.m);
        one(Quantity::Thickness, |t| t.thickness);
        maps.add(Quantity::Mask, 0, self.mask_of(side).into_iter().map(|m| f32::from(u8::from(m))).collect());
        maps
    }
}

/// A row-major map without `margin` texels along each edge; an empty one stays empty.
pub fn crop<T: Copy>(map: &[T], width: usize, margin: usize) -> Vec<T> {
    let height = map.len() / width;
    if height == 0 {
        return Vec::new();
    }
    (margin..height - margin).flat_map(|j| map[j * width + margin..(j + 1) * width - margin].iter().copied()).collect()
}

/// How strongly a vein of radius r shows at distance d on texels of size p. A vein narrower than a texel is drawn wider
/// and fainter.
fn bell(found: Option<(f64, f64)>, texel: f64) -> f64 {
    let Some((d, r)) = found else { return 0.0 };
    let wide = r.hypot(0.45 * texel);
    r / wide * (-(d / wide) * (d / wide)).exp()
}

fn place(spec: &LeafSpec, network: &VeinNetwork, p: [f64; 2], texel: f64, inside: bool) -> Place {
    let (v, relief) = (&spec.veins, &spec.relief);
    let reach = [0, 1, 2].map(|k| 2.5 * v.width_mm[k].hypot(2.0 * texel));
    let near =
        [0, 1, 2].map(|k| network.orders[k].nearest(p, reach[k].max(3.4 * relief.bulge_width_mm[usize::from(k == 2)])));
    let vein = [0, 1, 2].map(|k| bell(near[k], texel));
    let far = |k: usize| near[k].map_or(f64::MAX, |(d, _)| d);
    // The lamina rises away from veins and levels off. Small meshes are added to the large ones.
    let dome = |d: f64, width: f64| 1.0 - (-(d / width) * (d / width)).exp();
    let between = dome(far(0), relief.bulge_width_mm[0]) * dome(far(1), relief.bulge_width_mm[0]);
    let fine_width = relief.bulge_width_mm[1].max(texel);
    let mut bulge = relief.bulge_mm[0] * between;
    if v.tertiary_mm > 0.0 {
        bulge += relief.bulge_mm[1] * (relief.bulge_width_mm[1] / fine_width) * between * dome(far(2), fine_width);
    }
    let areole =
        if v.areole_mm > 2.0 * texel { (-(mesh(spec.seed ^ 0xa5, p, v.areole_mm) / 0.09).powi(2)).exp() } else { 0.0 };
    bulge -= 0.12 * relief.bulge_mm[1] * areole;
    // The shape of the whole blade: halves that rise from the midrib, ends that hang, and slow waves that grow towards
    // the margin.
    let half = 0.5 * spec.outline.length_mm;
    let off = p[1] - spec.outline.bow_mm * ((std::f64::consts::PI * (p[0] / half * 0.5 + 0.5)).sin() - 0.5);
    let fold = relief.fold_deg.to_radians().tan() * (off.hypot(2.0) - 2.0);
    let wave =
        relief.wave_mm * noise(spec.seed ^ 0x3a, p, relief.wave_length_mm) * (off.abs() / (0.35 * half)).min(1.5);
    let sheet = fold - relief.droop_mm * (p[0] / half).powi(2) + wave + bulge;
    let dents = |depths: [f64; 3]| (0..3).map(|k| depths[k] * vein[k]).sum::<f64>();
    let lamina = 1.0
        + spec.variation.lamina[0] * noise(spec.seed ^ 0x11, p, 14.0)
        + spec.variation.lamina[1] * noise(spec.seed ^ 0x12, p, 1.2) * damped(1.2, texel);
    let thickness = lamina
        + (0..3).map(|k| spec.variation.veins[k] * vein[k]).sum::<f64>()
        + 0.2 * spec.variation.veins[2] * areole;
    let any = vein[0].max(vein[1]).max(0.75 * vein[2]).max(0.2 * areole);
    let lively = 1.0 + spec.pigment.lamina * noise(spec.seed ^ 0x21, p, 9.0) - spec.pigment.between * between;
    Place {
        inside,
        vein: [vein[0], vein[1], vein[2].max(0.25 * areole)],
        front_mm: sheet - dents(relief.sunk_mm),
        back_mm: sheet - dents(relief.raised_mm),
        thickness: thickness.max(0.3),
        chlorophyll: lively.max(0.2) * (1.0 - (1.0 - spec.pigment.veins) * any),
        // Veins and fading halves lack chlorophyll but keep the other pigments.
        carotenoid: (1.0 + spec.pigment.lamina * noise(spec.seed ^ 0x22, p, 9.0)).max(0.2),
        mottle: [(0x31, 7.0), (0x32, 0.8), (0x33, 6.0), (0x34, 0.9)]
            .map(|(s, length): (u64, f64)| noise(spec.seed ^ s, p, length) * damped(length, texel)),
    }
}

/// Noise finer than a few texels is faded out, because it would alias.
fn damped(length: f64, texel: f64) -> f64 {
    1.0 / (1.0 + (1.5 * texel / length).powi(2))
}

fn side(
    spec: &LeafSpec,
    model: InteriorModel,
    places: &[Place],
    interior: &InteriorMaps,
    (size, texel_mm): (ImageSize, f64),
    lit: Side,
) -> Vec<SyntheticTexel> {
    let back = lit == Side::Back;
    let surface = if back { &spec.back } else { &spec.front };
    let vein = |p: &Place| p.vein[0].max(p.vein[1]).max(0.75 * p.vein[2]);
    let gamma_raw = |p: &Place| {
        // In pigment leaves the veins are pale because they lack chlorophyll, not through γ.
        let veins = if model == InteriorModel::Exact { vein(p) } else { 0.0 };
        let mottle = if back { 0.6 * p.mottle[1] - 0.8 * p.mottle[0] } else { 0.8 * p.mottle[0] + 0.6 * p.mottle[1] };
        Rgb(surface.gamma_veins).map(|g| ((1.0 + g * veins) * (1.0 + surface.gamma_lamina * mottle)).max(0.2))
    };
    let (mut sum, mut count) = (Rgb::splat(0.0), 0.0);
    for p in places.iter().filter(|p| p.inside) {
        sum += gamma_raw(p);
        count += 1.0;
    }
    let gloss = |p: &Place| {
        let [slow, fine] = [p.mottle[2], p.mottle[3]];
        let vary = |mean: f64, which: usize, n: f64| {
            (mean * (1.0 + surface.gloss_veins[which] * vein(p)) * (1.0 + surface.gloss_lamina[which] * n))
                .max(0.1 * mean)
        };
        [vary(surface.rho_s, 0, 0.8 * slow + 0.6 * fine), vary(surface.m, 1, 0.8 * fine - 0.6 * slow).clamp(0.03, 0.8)]
    };
    // What this side's camera sees at a texel of its own.
    let seen = |k: usize| lit.in_front(k, size.width);
    // Heights as this side's camera sees them: towards it is positive.
    let height_of = |i: usize, j: usize| {
        let p = &places[seen(j * size.width + i)];
        if back { -p.back_mm } else { p.front_mm }
    };
    let normal = |k: usize| {
        let [i, j] = size.position(k);
        let (l, r) = (i.saturating_sub(1), (i + 1).min(size.width - 1));
        let (u, d) = (j.saturating_sub(1), (j + 1).min(size.height - 1));
        let slope = |a: f64, b: f64, n: usize| if n == 0 { 0.0 } else { (b - a) / (n as f64 * texel_mm) };
        let (dx, dy) = (slope(height_of(l, j), height_of(r, j), r - l), slope(height_of(i, d), height_of(i, u), d - u));
        let s = (1.0 + dx * dx + dy * dy).sqrt();
        [-dx / s, -dy / s, 1.0 / s]
    };
    let shown = interior.lit(lit);
    let texel = |k: usize| {
        let p = &places[seen(k)];
        if !p.inside {
            return SyntheticTexel::default();
        }
        let (light, own) = (&shown[seen(k)], interior.texels[seen(k)]);
        // γ is the slab's; a leaf of layers has none.
        let gamma = match model {
            InteriorModel::Foliar => Rgb::splat(1.0),
            InteriorModel::Exact | InteriorModel::Pigment => (gamma_raw(p) * count / sum).map(|g| g as f32),
        };
        let [rho_s, m] = gloss(p).map(|v| v as f32);
        SyntheticTexel {
            rho_d: (gamma.map(f64::from) * light.reflected).map(|v| v as f32),
            rho_t: light.rho_t,
            through: light.through,
            rho_s,
            m,
            normal: normal(k).map(|v| v as f32),
            gamma,
            ..own
        }
    };
    (0..size.texels()).map(texel).collect()
}

#[cfg(test)]
mod tests;
