//! The inside of the leaf, which both sides share, place by place in the front's columns, and what light that falls on
//! each side shows of it: by the slab ([`slab_truth`](super::slab_truth)) or by layers ([`layers`](super::layers)).

use super::layers::{FoliarSpec, Held};
use super::leaf::Place;
use super::slab_truth::SlabTruthTable;
use super::spec::{InteriorModel, LeafSpec};
use rayon::prelude::*;

/// What one side shows of the interior.
pub struct InteriorSide {
    /// ρd without γ.
    pub reflected: Vec<[f64; 3]>,
    /// ρt of a beam along the normal.
    pub rho_t: Vec<[f32; 3]>,
    /// ρt as the light box's camera sees it.
    pub through: Vec<[f32; 3]>,
}

/// What the interior is made of.
pub enum InteriorTissue {
    /// Absorption and scattering (1/mm).
    Slab { sigma_a: Vec<[f32; 3]>, sigma_s: Vec<[f32; 3]> },
    /// Pigments (µg/cm²), and the mesophyll's absorption (1/mm).
    Layers { chlorophyll: Vec<f32>, carotenoid: Vec<f32>, absorption: Vec<[f32; 3]> },
}

/// Interior maps.
pub struct InteriorMaps {
    /// Thickness (mm).
    pub thickness: Vec<f32>,
    pub tissue: InteriorTissue,
    front: InteriorSide,
    /// What the back shows, where it differs from the front.
    back: Option<InteriorSide>,
}

impl InteriorMaps {
    /// `None` where the specification does not state what the model needs.
    pub fn of(spec: &LeafSpec, model: InteriorModel, places: &[Place]) -> Option<InteriorMaps> {
        let count = places.iter().filter(|p| p.inside).count() as f64;
        let mean = places.iter().filter(|p| p.inside).map(|p| p.thickness).sum::<f64>() / count;
        let scale = spec.thickness_mm / mean;
        let thickness: Vec<f32> =
            places.iter().map(|p| if p.inside { (scale * p.thickness) as f32 } else { 0.0 }).collect();
        match model {
            InteriorModel::Foliar => layers(spec, spec.foliar.as_ref()?, places, mean, thickness),
            InteriorModel::Exact | InteriorModel::Pigment => Some(slab(spec, model, places, thickness)),
        }
    }

    /// What a side shows.
    pub fn lit(&self, back: bool) -> &InteriorSide {
        self.back.as_ref().filter(|_| back).unwrap_or(&self.front)
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

fn slab(spec: &LeafSpec, model: InteriorModel, places: &[Place], thickness: Vec<f32>) -> InteriorMaps {
    let on_blade = |f: &dyn Fn(&Place) -> [f64; 3]| -> Vec<[f32; 3]> {
        places.iter().map(|p| if p.inside { f(p).map(|v| v as f32) } else { [0.0; 3] }).collect()
    };
    let pigment = |p: &Place| if model == InteriorModel::Exact { 1.0 } else { p.chlorophyll };
    let sigma_a = on_blade(&|p| spec.interior.sigma_a.map(|s| s * pigment(p)));
    let sigma_s = on_blade(&|_| spec.interior.sigma_s);
    let (mut reflected, mut rho_t) = (vec![[0.0; 3]; places.len()], vec![[0f32; 3]; places.len()]);
    let oblique = oblique(spec);
    let mut through = if oblique < 1.0 { vec![[0f32; 3]; places.len()] } else { Vec::new() };
    for c in 0..3 {
        // Maps are in single precision, so the slab is solved for the values that they hold.
        let absorption = range(places, |k| f64::from(sigma_a[k][c]));
        let scattering = f64::from(spec.interior.sigma_s[c] as f32);
        let thick = range(places, |k| f64::from(thickness[k]));
        let table = SlabTruthTable::new(1.0, absorption, scattering, thick);
        reflected.par_iter_mut().zip(&mut rho_t).enumerate().filter(|(k, _)| places[*k].inside).for_each(
            |(k, (d, t))| {
                let r = table.at(f64::from(sigma_a[k][c]), f64::from(thickness[k]));
                (d[c], t[c]) = (r.rho_d, r.rho_t as f32);
            },
        );
        if !through.is_empty() {
            let table = SlabTruthTable::new(oblique, absorption, scattering, thick);
            through.par_iter_mut().enumerate().filter(|(k, _)| places[*k].inside).for_each(|(k, t)| {
                t[c] = table.at(f64::from(sigma_a[k][c]), f64::from(thickness[k])).rho_t as f32;
            });
        }
    }
    if through.is_empty() {
        through.clone_from(&rho_t);
    }
    let front = InteriorSide { reflected, rho_t, through };
    InteriorMaps { thickness, tissue: InteriorTissue::Slab { sigma_a, sigma_s }, front, back: None }
}

/// `mean` is the mean of the places' thickness, in the unit of the places.
fn layers(
    spec: &LeafSpec,
    foliar: &FoliarSpec,
    places: &[Place],
    mean: f64,
    thickness: Vec<f32>,
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
    let side = |back: bool| {
        let seen = |k: usize| {
            let on = |c: usize| tables[c].at(held[k].depth[c])[usize::from(back)];
            if places[k].inside { [0, 1, 2].map(|c| Some(on(c))) } else { [None; 3] }
        };
        let all: Vec<_> = (0..places.len()).into_par_iter().map(seen).collect();
        let of = |pick: fn(&super::layers::Seen) -> f64| -> Vec<[f64; 3]> {
            all.iter().map(|s| s.map(|s| s.as_ref().map_or(0.0, pick))).collect()
        };
        let single = |map: Vec<[f64; 3]>| map.into_iter().map(|v| v.map(|v| v as f32)).collect();
        InteriorSide { reflected: of(|s| s.rho_d), rho_t: single(of(|s| s.rho_t)), through: single(of(|s| s.through)) }
    };
    let (front, back) = (side(false), Some(side(true)));
    let absorption = held.iter().zip(&thickness).map(|(h, t)| match *t > 0.0 {
        true => h.depth.map(|d| (d / f64::from(*t)) as f32),
        false => [0.0; 3],
    });
    let tissue = InteriorTissue::Layers {
        chlorophyll: held.iter().map(|h| h.chlorophyll).collect(),
        carotenoid: held.iter().map(|h| h.carotenoid).collect(),
        absorption: absorption.collect(),
    };
    Some(InteriorMaps { thickness, tissue, front, back })
}
