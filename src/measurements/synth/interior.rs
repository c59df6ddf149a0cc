//! The inside of the leaf, which both sides share, place by place in the front's columns, and what light that falls on
//! each side shows of it: by the slab ([`slab_truth`](super::slab_truth)) or by layers ([`layers`](super::layers)).

use super::layers::{FoliarSpec, Held};
use super::leaf::{Place, SyntheticTexel};
use super::slab_truth::SlabTruthTable;
use super::spec::{InteriorModel, LeafSpec};
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::side::Side;
use rayon::prelude::*;

/// What one side of a place shows of the interior.
#[derive(Debug, Clone, Copy, Default)]
pub struct InteriorLight {
    /// ρd without γ.
    pub reflected: Rgb,
    /// ρt of a beam along the normal.
    pub rho_t: Rgb<f32>,
    /// ρt as the light box's camera sees it.
    pub through: Rgb<f32>,
}

/// Interior maps.
pub struct InteriorMaps {
    /// Thickness, and what the inside consists of.
    pub texels: Vec<SyntheticTexel>,
    front: Vec<InteriorLight>,
    /// What the back shows, where it differs from the front.
    back: Option<Vec<InteriorLight>>,
}

impl InteriorMaps {
    /// `None` where the specification does not state what the model needs.
    pub fn of(spec: &LeafSpec, model: InteriorModel, places: &[Place]) -> Option<InteriorMaps> {
        let count = places.iter().filter(|p| p.inside).count() as f64;
        let mean = places.iter().filter(|p| p.inside).map(|p| p.thickness).sum::<f64>() / count;
        let scale = spec.thickness_mm / mean;
        let of = |p: &Place| SyntheticTexel {
            thickness: if p.inside { (scale * p.thickness) as f32 } else { 0.0 },
            ..SyntheticTexel::default()
        };
        let texels = places.iter().map(of).collect();
        match model {
            InteriorModel::Foliar => layers(spec, spec.foliar.as_ref()?, places, mean, texels),
            InteriorModel::Exact | InteriorModel::Pigment => Some(slab(spec, model, places, texels)),
        }
    }

    /// What a side shows.
    pub fn lit(&self, side: Side) -> &[InteriorLight] {
        self.back.as_ref().filter(|_| side == Side::Back).unwrap_or(&self.front)
    }
}

/// The cosine of the light box's camera.
fn oblique(spec: &LeafSpec) -> f64 {
    spec.device.lightbox_camera_deg.to_radians().cos()
}

/// Smallest and largest value over the places on the blade.
fn range(places: &[Place], value: impl Fn(usize) -> f64) -> [f64; 2] {
    let good = (0..places.len()).filter(|&k| places[k].inside).map(value);
    good.fold([f64::MAX, 0.0], |[a, b], v| [v.min(a), v.max(b)])
}

fn slab(spec: &LeafSpec, model: InteriorModel, places: &[Place], mut texels: Vec<SyntheticTexel>) -> InteriorMaps {
    // Maps are in single precision, so the slab is solved for the values that they hold.
    for (t, p) in texels.iter_mut().zip(places).filter(|(_, p)| p.inside) {
        let pigment = if model == InteriorModel::Exact { 1.0 } else { p.chlorophyll };
        t.sigma_a = Rgb(spec.interior.sigma_a).map(|s| (s * pigment) as f32);
        t.sigma_s = Rgb(spec.interior.sigma_s).map(|s| s as f32);
    }
    let thick = range(places, |k| f64::from(texels[k].thickness));
    let table = |c: usize, cosine: f64| {
        let absorption = range(places, |k| f64::from(texels[k].sigma_a[c]));
        SlabTruthTable::new(cosine, absorption, f64::from(spec.interior.sigma_s[c] as f32), thick)
    };
    let along = Rgb::of(|c| table(c, 1.0));
    let oblique = Some(oblique(spec)).filter(|cosine| *cosine < 1.0).map(|cosine| Rgb::of(|c| table(c, cosine)));
    let shown = |k: usize| {
        if !places[k].inside {
            return InteriorLight::default();
        }
        let t = &texels[k];
        let met =
            |tables: &Rgb<SlabTruthTable>| Rgb::of(|c| tables[c].at(f64::from(t.sigma_a[c]), f64::from(t.thickness)));
        let through = |tables| met(tables).map(|r| r.rho_t as f32);
        let (reflected, rho_t) = met(&along).map(|r| (r.rho_d, r.rho_t as f32)).unzip();
        InteriorLight { reflected, rho_t, through: oblique.as_ref().map_or(rho_t, through) }
    };
    let front = (0..places.len()).into_par_iter().map(shown).collect();
    InteriorMaps { texels, front, back: None }
}

/// `mean` is the mean of the places' thickness, in the unit of the places.
fn layers(
    spec: &LeafSpec,
    foliar: &FoliarSpec,
    places: &[Place],
    mean: f64,
    mut texels: Vec<SyntheticTexel>,
) -> Option<InteriorMaps> {
    let held: Vec<Held> = places
        .iter()
        .map(|p| match p.inside {
            true => foliar.held(p.chlorophyll, p.carotenoid, p.thickness / mean),
            false => Held::default(),
        })
        .collect();
    let tables = (0..3)
        .map(|c| foliar.table(c, oblique(spec), range(places, |k| held[k].depth[c])))
        .collect::<Option<Vec<_>>>()?;
    let side = |side: Side| {
        let shown = |k: usize| {
            if !places[k].inside {
                return InteriorLight::default();
            }
            let seen = Rgb::of(|c| tables[c].at(held[k].depth[c])[side]);
            InteriorLight {
                reflected: seen.map(|s| s.rho_d),
                rho_t: seen.map(|s| s.rho_t as f32),
                through: seen.map(|s| s.through as f32),
            }
        };
        (0..places.len()).into_par_iter().map(shown).collect()
    };
    let (front, back) = (side(Side::Front), Some(side(Side::Back)));
    for (t, h) in texels.iter_mut().zip(&held) {
        (t.chlorophyll, t.carotenoid) = (h.chlorophyll, h.carotenoid);
        if t.thickness > 0.0 {
            t.absorption = h.depth.map(|d| (d / f64::from(t.thickness)) as f32);
        }
    }
    Some(InteriorMaps { texels, front, back })
}
