//! The truth about a leaf, texel by texel: outline, veins, relief and normals, thickness, pigment, γ, gloss, and the
//! light of the interior. Both sides share interior and shape. The back's maps are stored as its camera saw them:
//! column i of the back is column W−1−i of the front (W columns in all), and x and z change sign. Lengths in mm,
//! coefficients in 1/mm, albedos in [0, 1].

use super::interior::{InteriorMaps, InteriorTissue};
use super::spec::{InteriorModel, LeafSpec};
use super::{outline::BladeContour, veins::VeinNetwork};
use mesophyll_base::random::{mesh, noise};
use mesophyll_capture::manifest::texel_position;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::{Side, mirror};
use rayon::prelude::*;

/// One side, row-major as its camera saw it; every map has `width · height` entries, zero off the blade. Maps that the
/// leaf's model does not have are empty.
#[derive(Debug, Clone, Default)]
pub struct SyntheticSide {
    /// Diffuse reflectance, a channel each.
    pub rho_d: Vec<[f32; 3]>,
    /// Transmittance, a channel each.
    pub rho_t: Vec<[f32; 3]>,
    /// Transmittance for a beam at the light box's camera angle; ρt where the camera looks along the normal.
    pub through: Vec<[f32; 3]>,
    /// Gloss reflectance, a channel each.
    pub rho_s: Vec<[f32; 3]>,
    /// Slope of the gloss.
    pub m: Vec<f32>,
    /// Unit normal in this side's image: x right, y up, z out of the side.
    pub normal: Vec<[f32; 3]>,
    /// Absorption coefficient of the slab (1/mm), a channel each.
    pub sigma_a: Vec<[f32; 3]>,
    /// Scattering coefficient of the slab (1/mm), a channel each.
    pub sigma_s: Vec<[f32; 3]>,
    /// Thickness (mm).
    pub thickness: Vec<f32>,
    /// γ: the texel's reflectance relative to that of a slab, a channel each.
    pub gamma: Vec<[f32; 3]>,
    /// Chlorophyll of a leaf of layers (µg/cm²).
    pub chlorophyll: Vec<f32>,
    /// Carotenoids of a leaf of layers (µg/cm²).
    pub carotenoid: Vec<f32>,
    /// Absorption of the mesophyll of a leaf of layers over the leaf's thickness (1/mm), a channel each.
    pub absorption: Vec<[f32; 3]>,
}

/// A grown leaf: its outline, its relief and both sides' maps.
#[derive(Debug, Clone)]
pub struct SyntheticLeaf {
    /// Columns of every map.
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// The gloss lobe of both sides.
    pub lobe: Lobe,
    /// Texels on the leaf, as the front's camera saw it.
    pub mask: Vec<bool>,
    /// Height of the front over the plane z = 0 (mm), in the front's columns; set on the blade and one texel around it.
    pub relief: Vec<f64>,
    /// The front's maps.
    pub front: SyntheticSide,
    /// The back's maps, in its own camera's columns.
    pub back: SyntheticSide,
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
pub(crate) fn texel_size(spec: &LeafSpec, width: usize, height: usize) -> f64 {
    (spec.field_mm[0] / width as f64).max(spec.field_mm[1] / height as f64)
}

impl SyntheticLeaf {
    /// Grows the leaf and evaluates its maps at one resolution; `None` when not one texel lies on the blade, or the
    /// specification does not state what the model asks for ([`LeafSpec::truth`]).
    pub fn grow(spec: &LeafSpec, model: InteriorModel, width: usize, height: usize) -> Option<SyntheticLeaf> {
        SyntheticLeaf::grow_in(
            spec,
            model,
            (width, height),
            FieldWindow { centre_mm: [0.0; 2], texel_mm: texel_size(spec, width, height) },
        )
    }

    /// The same for a part of the field. The leaf is the same whichever part is seen, except that the means of
    /// thickness and γ are those of the part.
    pub(crate) fn grow_in(
        spec: &LeafSpec,
        model: InteriorModel,
        (width, height): (usize, usize),
        window: FieldWindow,
    ) -> Option<SyntheticLeaf> {
        let FieldWindow { centre_mm, texel_mm } = window;
        let blade = BladeContour::new(&spec.outline, &spec.margin, spec.seed);
        let network = VeinNetwork::grow(&blade, &spec.veins, spec.seed);
        let x: Vec<f64> = (0..width).map(|i| centre_mm[0] + texel_position(width, height, texel_mm, i, 0)[0]).collect();
        let y = |j: usize| centre_mm[1] + texel_position(width, height, texel_mm, 0, j)[1];
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
        let shape = (width, height, texel_mm);
        let interior = InteriorMaps::of(spec, model, &places)?;
        let front = side(spec, model, &places, &interior, shape, false);
        let back = side(spec, model, &places, &interior, shape, true);
        let (mask, relief) = places.iter().map(|p| (p.inside, p.front_mm)).unzip();
        Some(SyntheticLeaf { width, height, texel_mm, lobe: spec.lobe, mask, relief, front, back })
    }

    /// The leaf without `margin` texels along each edge of its maps; `margin` is less than half of width and height.
    pub fn cropped(&self, margin: usize) -> SyntheticLeaf {
        let side = |s: &SyntheticSide| SyntheticSide {
            rho_d: crop(&s.rho_d, self.width, margin),
            rho_t: crop(&s.rho_t, self.width, margin),
            through: crop(&s.through, self.width, margin),
            rho_s: crop(&s.rho_s, self.width, margin),
            m: crop(&s.m, self.width, margin),
            normal: crop(&s.normal, self.width, margin),
            sigma_a: crop(&s.sigma_a, self.width, margin),
            sigma_s: crop(&s.sigma_s, self.width, margin),
            thickness: crop(&s.thickness, self.width, margin),
            gamma: crop(&s.gamma, self.width, margin),
            chlorophyll: crop(&s.chlorophyll, self.width, margin),
            carotenoid: crop(&s.carotenoid, self.width, margin),
            absorption: crop(&s.absorption, self.width, margin),
        };
        SyntheticLeaf {
            width: self.width - 2 * margin,
            height: self.height - 2 * margin,
            texel_mm: self.texel_mm,
            lobe: self.lobe,
            mask: crop(&self.mask, self.width, margin),
            relief: crop(&self.relief, self.width, margin),
            front: side(&self.front),
            back: side(&self.back),
        }
    }

    /// One side's maps.
    pub fn side(&self, side: Side) -> &SyntheticSide {
        match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        }
    }

    /// The mask as that side's camera saw it.
    pub fn mask_of(&self, side: Side) -> Vec<bool> {
        match side {
            Side::Front => self.mask.clone(),
            Side::Back => mirror(&self.mask, self.width),
        }
    }

    /// The truth in the channels of `data/README.md`: those that the leaf's model has.
    pub fn truth(&self, side: Side) -> ChannelMaps {
        let grown = self.side(side);
        let mut maps = ChannelMaps::new(self.width, self.height);
        let mut three = |quantity, map: &[[f32; 3]]| {
            for c in (0..3).filter(|_| !map.is_empty()) {
                maps.add(quantity, c, map.iter().map(|v| v[c]).collect());
            }
        };
        three(Quantity::RhoD, &grown.rho_d);
        three(Quantity::RhoS, &grown.rho_s);
        three(Quantity::RhoT, &grown.rho_t);
        three(Quantity::SigmaA, &grown.sigma_a);
        three(Quantity::SigmaS, &grown.sigma_s);
        three(Quantity::Gamma, &grown.gamma);
        three(Quantity::Absorption, &grown.absorption);
        three(Quantity::Normal, &grown.normal);
        for (quantity, map) in [(Quantity::Chlorophyll, &grown.chlorophyll), (Quantity::Carotenoid, &grown.carotenoid)]
        {
            if !map.is_empty() {
                maps.add(quantity, 0, map.clone());
            }
        }
        maps.add(Quantity::M, 0, grown.m.clone());
        maps.add(Quantity::Thickness, 0, grown.thickness.clone());
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
    (width, height, texel): (usize, usize, f64),
    back: bool,
) -> SyntheticSide {
    let surface = if back { &spec.back } else { &spec.front };
    // Index into the front's maps of what this side's camera sees at (i, j).
    let place_of = |i: usize, j: usize| j * width + if back { width - 1 - i } else { i };
    let seen: Vec<usize> = (0..width * height).map(|k| place_of(k % width, k / width)).collect();
    let on_blade = |f: &dyn Fn(usize) -> [f64; 3]| -> Vec<[f32; 3]> {
        seen.iter()
            .enumerate()
            .map(|(k, &p)| if places[p].inside { f(k).map(|v| v as f32) } else { [0.0; 3] })
            .collect()
    };
    let vein = |p: &Place| p.vein[0].max(p.vein[1]).max(0.75 * p.vein[2]);
    let gamma_raw = |p: &Place| {
        // In pigment leaves the veins are pale because they lack chlorophyll, not through γ.
        let veins = if model == InteriorModel::Exact { vein(p) } else { 0.0 };
        let mottle = if back { 0.6 * p.mottle[1] - 0.8 * p.mottle[0] } else { 0.8 * p.mottle[0] + 0.6 * p.mottle[1] };
        surface.gamma_veins.map(|g| ((1.0 + g * veins) * (1.0 + surface.gamma_lamina * mottle)).max(0.2))
    };
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for p in places.iter().filter(|p| p.inside) {
        let g = gamma_raw(p);
        (0..3).for_each(|c| sum[c] += g[c]);
        count += 1.0;
    }
    // γ is the slab's; a leaf of layers has none.
    let gamma = match interior.tissue {
        InteriorTissue::Slab { .. } => on_blade(&|k| {
            let g = gamma_raw(&places[seen[k]]);
            [0, 1, 2].map(|c| g[c] * count / sum[c])
        }),
        InteriorTissue::Layers { .. } => Vec::new(),
    };

    let gloss = |k: usize| {
        let p = &places[seen[k]];
        let [slow, fine] = [p.mottle[2], p.mottle[3]];
        let vary = |mean: f64, which: usize, n: f64| {
            (mean * (1.0 + surface.gloss_veins[which] * vein(p)) * (1.0 + surface.gloss_lamina[which] * n))
                .max(0.1 * mean)
        };
        [vary(surface.rho_s, 0, 0.8 * slow + 0.6 * fine), vary(surface.m, 1, 0.8 * fine - 0.6 * slow).clamp(0.03, 0.8)]
    };
    // Heights as this side's camera sees them: towards it is positive.
    let height_of =
        |i: usize, j: usize| if back { -places[place_of(i, j)].back_mm } else { places[place_of(i, j)].front_mm };
    let normal = |k: usize| {
        let (i, j) = (k % width, k / width);
        let (l, r) = (i.saturating_sub(1), (i + 1).min(width - 1));
        let (u, d) = (j.saturating_sub(1), (j + 1).min(height - 1));
        let slope = |a: f64, b: f64, n: usize| if n == 0 { 0.0 } else { (b - a) / (n as f64 * texel) };
        let (dx, dy) = (slope(height_of(l, j), height_of(r, j), r - l), slope(height_of(i, d), height_of(i, u), d - u));
        let s = (1.0 + dx * dx + dy * dy).sqrt();
        [-dx / s, -dy / s, 1.0 / s]
    };
    let lit = interior.lit(back);
    let mut grown = SyntheticSide {
        rho_d: on_blade(&|k| {
            let own = gamma.get(k).map_or([1.0; 3], |g| g.map(f64::from));
            [0, 1, 2].map(|c| own[c] * lit.reflected[seen[k]][c])
        }),
        rho_t: picked(&lit.rho_t, &seen),
        through: picked(&lit.through, &seen),
        rho_s: on_blade(&|k| [gloss(k)[0]; 3]),
        m: seen.iter().enumerate().map(|(k, &p)| if places[p].inside { gloss(k)[1] as f32 } else { 0.0 }).collect(),
        normal: on_blade(&normal),
        thickness: picked(&interior.thickness, &seen),
        gamma,
        ..SyntheticSide::default()
    };
    match &interior.tissue {
        InteriorTissue::Slab { sigma_a, sigma_s } => {
            (grown.sigma_a, grown.sigma_s) = (picked(sigma_a, &seen), picked(sigma_s, &seen));
        }
        InteriorTissue::Layers { chlorophyll, carotenoid, absorption } => {
            (grown.chlorophyll, grown.carotenoid) = (picked(chlorophyll, &seen), picked(carotenoid, &seen));
            grown.absorption = picked(absorption, &seen);
        }
    }
    grown
}

/// What a side's camera sees of a map.
fn picked<T: Copy>(map: &[T], seen: &[usize]) -> Vec<T> {
    seen.iter().map(|&p| map[p]).collect()
}

#[cfg(test)]
mod tests;
