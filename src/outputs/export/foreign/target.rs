//! The materials of other programs: their parameters for a texel of ours, and what they show with them.
//!
//! | target | matte reflection | matte transmission | gloss |
//! |---|---|---|---|
//! | glTF 2.0 | a colour a side | a colour a side, in bytes | GGX, correlated by height |
//! | Mitsuba 3, composed of plugins | a colour a side | one colour | our slopes, Smith |
//! | pbrt-v4, a mix | one colour | one colour | GGX of a metal, the same on both sides |
//! | OpenPBR, thin wall | a colour and a ratio a side | the same colour | GGX of a dielectric |
//! | UsdPreviewSurface | one colour | none | GGX, Schlick |
//! | Blender | a colour a side | a colour a side | our slopes, Smith |
//! | Wavefront OBJ | a colour a side | none | not compared |

use crate::foreign::gloss::{LobeFamily, LobeTable, NearestLobe};
use crate::foreign::micro::{MaskingRule, MicrofacetLobe, SlopeDistribution};
use crate::foreign::texel::{DiffuseCoupling, ExportTexel, ExportTexelSide, MaterialTexel};
use mesophyll_base::surface::gloss::Lobe;
use mesophyll_base::surface::side::{Side, Sides};

/// A program's material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportTarget {
    /// glTF 2.0 with KHR_materials_specular, opaque.
    Gltf,
    /// The same with KHR_materials_diffuse_transmission.
    GltfTranslucent,
    /// A composition of Mitsuba 3's plugins.
    Mitsuba,
    /// pbrt-v4.
    Pbrt,
    /// OpenPBR with a thin wall.
    OpenPbr,
    /// UsdPreviewSurface.
    Usd,
    /// Blender's nodes.
    Blender,
    /// Wavefront OBJ.
    Obj,
}

/// One side of a point in a target's numbers. What they mean for a target is said at [`TargetCoder::encode`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TargetSide {
    /// Matte reflection.
    pub diffuse: [f64; 3],
    /// Matte transmission.
    pub through: [f64; 3],
    /// Gloss.
    pub gloss: [f64; 3],
    /// Slope of the gloss.
    pub alpha: f64,
    /// glTF: share of transmitted light. OpenPBR: anisotropy of the scattering.
    pub share: f64,
    /// glTF and pbrt: weight of the gloss.
    pub weight: f64,
}

/// Finds a target's parameters for the texels of one leaf.
#[derive(Debug, Clone)]
pub struct TargetCoder {
    target: ExportTarget,
    table: Option<LobeTable>,
    /// Whether the numbers are kept in bytes.
    bytes: bool,
}

/// The nearest byte of a value from 0 to 1, as a reader gets it back.
fn byte(v: f64) -> f64 {
    (v.clamp(0.0, 1.0) * 255.0).round() / 255.0
}

/// The same for a colour in sRGB.
fn srgb_byte(v: f64) -> f64 {
    let v = v.clamp(0.0, 1.0);
    let s = byte(if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 });
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

fn most(c: [f64; 3]) -> f64 {
    c.into_iter().fold(0.0, f64::max)
}

/// The largest reflectance of a metal that pbrt-v4 makes of a colour.
const METAL: f64 = 0.9999;

impl TargetCoder {
    /// For a leaf with this lobe, slopes in `slopes`, and a gloss of at most `rho_s`. A leaf without gloss has 0 there.
    pub fn new(target: ExportTarget, lobe: Lobe, slopes: [f64; 2], rho_s: f64) -> TargetCoder {
        let own = SlopeDistribution::of(lobe);
        let plain = |slopes, masking, under| LobeFamily {
            micro: MicrofacetLobe { slopes, masking },
            index: None,
            grazing: false,
            under,
        };
        let family = match target {
            ExportTarget::Gltf | ExportTarget::GltfTranslucent => {
                plain(SlopeDistribution::Ggx, MaskingRule::Correlated, DiffuseCoupling::Added)
            }
            ExportTarget::Mitsuba => {
                LobeFamily { index: lobe.index(), ..plain(own, MaskingRule::Separable, DiffuseCoupling::Added) }
            }
            ExportTarget::Pbrt => plain(SlopeDistribution::Ggx, MaskingRule::Correlated, DiffuseCoupling::Added),
            ExportTarget::OpenPbr => {
                // The dielectric that reflects as much as the largest gloss, so that no colour exceeds 1.
                let root = (1.2 * rho_s).clamp(0.02, 0.8).sqrt();
                let index = (1.0 + root) / (1.0 - root);
                LobeFamily {
                    index: Some(index),
                    ..plain(SlopeDistribution::Ggx, MaskingRule::Correlated, DiffuseCoupling::Albedo)
                }
            }
            ExportTarget::Usd => LobeFamily {
                grazing: true,
                ..plain(SlopeDistribution::Ggx, MaskingRule::Correlated, DiffuseCoupling::Added)
            },
            ExportTarget::Blender => plain(own, MaskingRule::Correlated, DiffuseCoupling::Added),
            ExportTarget::Obj => return TargetCoder { target, table: None, bytes: false },
        };
        let table = (rho_s > 0.0).then(|| LobeTable::new(family, lobe, slopes));
        TargetCoder { target, table, bytes: matches!(target, ExportTarget::Gltf | ExportTarget::GltfTranslucent) }
    }

    /// Index of refraction of the gloss, for a target that has one.
    pub fn index(&self) -> Option<f64> {
        self.table.as_ref().and_then(|t| t.family().index)
    }

    fn nearest(&self, part: &ExportTexelSide) -> NearestLobe {
        match &self.table {
            Some(table) => table.nearest(part.rho_d, part.rho_s, part.m, 1.0),
            None => NearestLobe { diffuse: part.rho_d, colour: [0.0; 3], alpha: 0.0, matte: 1.0 },
        }
    }

    /// The parameters for a texel.
    ///
    /// - Mitsuba, Blender, USD: reflectances as they stand, the slope α, the colour of the gloss.
    /// - glTF: `weight` w is the specular factor, `gloss` the reflectance at normal incidence over w, `share` t the
    ///   transmission factor; `diffuse` and `through` are the base colour and the transmission colour. f = (1 − w)
    ///   ((1 − t) base + t colour) + gloss, where w is also the reflectance at grazing incidence.
    /// - pbrt: `weight` is the amount of the metal, `gloss` its reflectance, the others are divided by 1 − amount.
    /// - OpenPBR: `diffuse` is the subsurface colour C, `share` its anisotropy g: R = C² (1 − g)/2, T = C² (1 + g)/2.
    ///   The colour enters twice in the reference graph (MaterialX 1.39, `open_pbr_surface`).
    pub fn encode(&self, texel: &ExportTexel) -> Sides<TargetSide> {
        let [front, back] = Side::ALL.map(|s| texel.sides[s]);
        let mean = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]));
        let both = mean(front.rho_t, back.rho_t);
        let plain = |part: &ExportTexelSide, through: [f64; 3]| {
            let n = self.nearest(part);
            TargetSide { diffuse: n.diffuse, through, gloss: n.colour, alpha: n.alpha, ..TargetSide::default() }
        };
        match self.target {
            ExportTarget::Mitsuba => Sides::of(|s| plain(&texel.sides[s], both)),
            ExportTarget::Blender => Sides::of(|s| plain(&texel.sides[s], texel.sides[s.other()].rho_t)),
            ExportTarget::Obj => Sides::of(|s| plain(&texel.sides[s], [0.0; 3])),
            ExportTarget::Usd => Sides::of(|_| plain(&front, [0.0; 3])),
            ExportTarget::Gltf | ExportTarget::GltfTranslucent => Sides::of(|s| {
                let through = if self.target == ExportTarget::Gltf { [0.0; 3] } else { texel.sides[s.other()].rho_t };
                self.in_bytes(plain(&texel.sides[s], through))
            }),
            ExportTarget::Pbrt => {
                // Wood and ground are black behind and have one side. A matte side has no slope.
                let one_sided = [back.rho_d, back.rho_t, back.rho_s].iter().flatten().all(|v| *v <= 0.0);
                let [a, b] = [front, back].map(|p| p.rho_s.iter().sum::<f64>());
                let m = if a + b > 0.0 { (a * front.m + b * back.m) / (a + b) } else { 0.5 * (front.m + back.m) };
                let middle = if one_sided {
                    front
                } else {
                    ExportTexelSide {
                        rho_d: mean(front.rho_d, back.rho_d),
                        rho_t: both,
                        rho_s: mean(front.rho_s, back.rho_s),
                        m,
                    }
                };
                let c = plain(&middle, both);
                let weight = most(c.gloss).min(0.99);
                let over = |v: f64, by: f64| if by > 0.0 { v / by } else { 0.0 };
                let coded = TargetSide {
                    weight,
                    gloss: c.gloss.map(|g| over(g, weight).min(METAL)),
                    diffuse: c.diffuse.map(|d| over(d, 1.0 - weight)),
                    through: c.through.map(|d| over(d, 1.0 - weight)),
                    ..c
                };
                Sides::of(|_| coded)
            }
            ExportTarget::OpenPbr => Sides::of(|s| self.one_colour(&texel.sides[s], texel.sides[s.other()].rho_t)),
        }
    }

    /// glTF's parameters, in bytes.
    fn in_bytes(&self, c: TargetSide) -> TargetSide {
        let weight = byte(most(c.gloss));
        let left = (1.0 - weight).max(1e-3);
        // The least share that the transmission colour can fill. So a reader without the extension, which takes the
        // base colour whole, shows the front too bright by as little as possible: 1/(1 − share).
        let least = (most(c.through) / left * 255.0).ceil() / 255.0;
        let share = if least > 0.0 { least.min(254.0 / 255.0) } else { 0.0 };
        TargetSide {
            weight,
            share,
            gloss: if weight > 0.0 { c.gloss.map(|g| srgb_byte(g / weight)) } else { [0.0; 3] },
            diffuse: c.diffuse.map(|d| srgb_byte(d / (left * (1.0 - share)))),
            through: if share > 0.0 { c.through.map(|t| srgb_byte(t / (left * share))) } else { [0.0; 3] },
            alpha: byte(c.alpha.sqrt()).powi(2).max(1e-3),
        }
    }

    /// One colour and one ratio nearest to R and T of three channels: the largest singular pair of their matrix.
    fn one_colour(&self, part: &ExportTexelSide, rho_t: [f64; 3]) -> TargetSide {
        let n = self.nearest(part);
        let (r, t) = (n.diffuse, rho_t.map(|t| t * n.matte));
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (rr, rt, tt) = (dot(r, r), dot(r, t), dot(t, t));
        // The eigenvector (cos φ, sin φ) of the larger eigenvalue of [[rr, rt], [rt, tt]].
        let phi = 0.5 * (2.0 * rt).atan2(rr - tt);
        let (cos, sin) = (phi.cos().max(0.0), phi.sin().max(0.0));
        let sum = (cos + sin).max(1e-12);
        let colour = [0, 1, 2].map(|c| ((cos * r[c] + sin * t[c]) * sum).clamp(0.0, 1.0));
        TargetSide {
            diffuse: colour,
            share: (sin - cos) / sum,
            gloss: n.colour,
            alpha: n.alpha,
            ..TargetSide::default()
        }
    }

    /// What the target shows of a side with its numbers.
    pub fn seen(&self, c: &TargetSide) -> MaterialTexel {
        let family = self.table.as_ref().map(LobeTable::family);
        // Schlick's rise and 1 − E stay where the colour is 0, so the lobe does, too.
        let shine = family.map(|f| f.shine(c.alpha, c.gloss));
        let plain = MaterialTexel { diffuse: c.diffuse, through: c.through, shine, under: DiffuseCoupling::Added };
        match self.target {
            ExportTarget::Mitsuba | ExportTarget::Blender | ExportTarget::Obj | ExportTarget::Usd => plain,
            ExportTarget::Gltf | ExportTarget::GltfTranslucent => MaterialTexel {
                diffuse: c.diffuse.map(|d| (1.0 - c.share) * d),
                through: c.through.map(|t| c.share * t),
                shine: family.filter(|_| c.weight > 0.0).map(|f| {
                    let normal = c.gloss.map(|g| g * c.weight);
                    crate::foreign::texel::MaterialGloss { colour: [normal, [c.weight; 3]], ..f.shine(c.alpha, normal) }
                }),
                under: DiffuseCoupling::Facet,
            },
            ExportTarget::Pbrt => MaterialTexel {
                diffuse: c.diffuse.map(|d| (1.0 - c.weight) * d),
                through: c.through.map(|t| (1.0 - c.weight) * t),
                shine: plain.shine.map(|s| crate::foreign::texel::MaterialGloss {
                    colour: [[c.weight; 3]; 2],
                    metal: Some(c.gloss.map(|r| 2.0 * r.sqrt() / (1.0 - r).sqrt())),
                    ..s
                }),
                under: DiffuseCoupling::Added,
            },
            ExportTarget::OpenPbr => MaterialTexel {
                diffuse: c.diffuse.map(|d| d * 0.5 * (1.0 - c.share)),
                through: c.diffuse.map(|d| d * 0.5 * (1.0 + c.share)),
                under: DiffuseCoupling::Albedo,
                ..plain
            },
        }
    }

    /// Whether numbers are rounded to bytes.
    pub fn bytes(&self) -> bool {
        self.bytes
    }
}
