//! Cards: a flat patch with one leaf's mean parameters, under the scene's light. Its radiance is known in closed form,
//! so that both renderers can be compared with a result that neither of them computed.

use super::reference;
use crate::loaded::LoadedScene;
use crate::manifest::{CardView, SceneManifest};
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::placed::placement;
use crate::{Error, Result};
use glam::{DMat4, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile};
use mesophyll_optics::side::{Side, Sides};
use mesophyll_optics::slab;
use mesophyll_optics::slab::chebyshev::SlabInterpolant;
use mesophyll_transport::{self as transport, closed_form};
use rayon::prelude::*;
use std::sync::Arc;

/// One side's mean parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct CardSide {
    /// γ, the factor on the slab's reflectance (Wang et al. 2005), for each channel.
    pub gamma: [f64; 3],
    /// Mean thickness (mm).
    pub thickness: f64,
    /// Absorption coefficient of the slab (1/mm).
    pub sigma_a: [f64; 3],
    /// Scattering coefficient of the slab (1/mm).
    pub sigma_s: [f64; 3],
    /// Specular reflectance of each channel.
    pub rho_s: [f64; 3],
    /// Roughness m: root mean square slope.
    pub m: f64,
    /// Diffuse reflectance: γ times that of the slab.
    pub rho_d: [f64; 3],
    /// Diffuse transmittance of each channel.
    pub rho_t: [f64; 3],
}

/// A flat patch with one leaf's mean parameters, whose radiance is known in closed form.
#[derive(Debug, Clone)]
pub struct LeafCard {
    /// Index into the manifest's leaves.
    pub leaf: usize,
    /// The patch.
    pub mesh: LeafMesh,
    /// The transform from the patch to the world.
    pub transform: DMat4,
    /// Parameters of the front and of the back, where the fit has them.
    pub sides: Sides<Option<CardSide>>,
    /// Whether the plan gives each side to the renderer. The closed form and the reference use both sides.
    pub planned: Sides<bool>,
}

impl LeafCard {
    /// The card of a view, from the maps of the plan's fit.
    ///
    /// # Errors
    /// [`Error::Input`] when the leaf is not fitted or a map cannot be read.
    pub fn new(scene: &LoadedScene, view: &CardView, ledger: &Ledger) -> Result<LeafCard> {
        let name = &view.leaf;
        let leaf = scene.leaves().find(|l| l.config.name == *name);
        let Some((leaf, fitted)) = leaf.and_then(|l| l.placed.fitted.as_ref().map(|f| (l, f))) else {
            return Err(Error::field(
                &scene.manifest.path,
                &format!("leaf \"{name}\""),
                "not fitted yet; `mesophyll run` fits it",
            ));
        };
        let has = |side| fitted.has(side).then(|| patch(fitted, side, ledger)).transpose();
        let sides = Sides::try_of(has)?;
        let (eye, target) = (view.camera.eye, view.camera.target);
        let turn = placement::rotation(view.rotation_deg);
        // The patch fills the picture at the angle at which it is seen.
        let slant = (turn * DVec3::Z).dot((eye - target).normalize()).abs().max(0.05);
        let side = 4.0 * eye.distance(target) * view.camera.half_height() / slant;
        Ok(LeafCard {
            leaf: leaf.placed.index,
            mesh: LeafMesh::rectangle(side, side),
            transform: DMat4::from_rotation_translation(turn, target),
            sides,
            planned: Sides::of(|side| leaf.plan.needs(side).mean),
        })
    }

    /// Radiance at the centres of these pixels, in closed form.
    ///
    /// # Errors
    /// [`Error::Input`] when the card is seen from a side that the fit does not have.
    pub fn closed_form(
        &self,
        manifest: &SceneManifest,
        view: &CardView,
        size: (usize, usize),
        pixels: &[(usize, usize)],
    ) -> Result<Vec<[f64; 3]>> {
        let config = &manifest.leaves[self.leaf];
        let normal = self.transform.transform_vector3(DVec3::Z).normalize();
        let towards = view.camera.eye - self.transform.transform_point3(DVec3::ZERO);
        let front = normal.dot(towards) >= 0.0;
        let seen = if front { Side::Front } else { Side::Back };
        let side = self.sides[seen].as_ref().ok_or_else(|| {
            Error::field(
                &manifest.path,
                &format!("view \"{}\"", view.name),
                "it shows a side of the leaf that the fit does not have",
            )
        })?;
        let card = closed_form::FlatLeaf {
            rho_d: side.rho_d,
            rho_s: side.rho_s,
            m: side.m,
            lobe: config.lobe(),
            rho_t_far: self.sides[seen.other()].as_ref().map_or([0.0; 3], |p| p.rho_t),
            normal: if front { normal } else { -normal },
        };
        let lights = reference::lights(manifest)?;
        let (sun, sky) = (lights.sun.as_ref(), lights.sky);
        let Some(dome) = &lights.dome else {
            return pixels.iter().map(|&pixel| card.pixel(&view.camera, size, pixel, sun, sky)).collect();
        };
        let radiance = |d: DVec3| (dome.radiance)(d);
        let (near, beyond) =
            (closed_form::irradiance(&radiance, card.normal), closed_form::irradiance(&radiance, -card.normal));
        let lens = transport::CameraRays::new(&view.camera, size.0, size.1)?;
        Ok(pixels
            .par_iter()
            .map(|&(x, y)| {
                let view = -lens.ray(x as f64 + 0.5, y as f64 + 0.5).direction;
                let (direct, around) = (card.radiance(view, sun, None), card.under_dome(view, near, beyond, &radiance));
                [0, 1, 2].map(|c| direct[c] + around[c])
            })
            .collect())
    }
}

/// Means over the good texels of `{side}.exr`.
fn patch(fitted: &LeafFit, side: Side, ledger: &Ledger) -> Result<CardSide> {
    let path = fitted.path(LeafFitFile::Maps, side);
    let maps = reader::maps(fitted, side, ledger)?;
    let quantities = [Quantity::Mask, Quantity::Gamma, Quantity::Thickness, Quantity::RhoS, Quantity::M];
    let planes = maps.require_planes(&path, &quantities)?;
    let good: Vec<usize> = (0..maps.width * maps.height)
        .filter(|&k| planes[0][k] > 0.0 && planes.iter().all(|p| p[k].is_finite()))
        .collect();
    if good.is_empty() {
        return Err(Error::field(&path, &Quantity::Mask.channel(0), "found no good texel, expected some on the leaf"));
    }
    let mean = |c: usize| good.iter().map(|&k| f64::from(planes[c][k])).sum::<f64>() / good.len() as f64;
    let (sigma_a, sigma_s) = (fitted.rgb(side, Quantity::SigmaA)?, fitted.rgb(side, Quantity::SigmaS)?);
    let (gamma, thickness) = ([mean(1), mean(2), mean(3)], mean(4));
    let at = [0, 1, 2].map(|c| slab::medium::response(sigma_a[c], sigma_s[c], thickness));
    Ok(CardSide {
        gamma,
        thickness,
        sigma_a,
        sigma_s,
        rho_s: [mean(5), mean(6), mean(7)],
        m: mean(8),
        rho_d: [0, 1, 2].map(|c| gamma[c] * at[c].rho_d),
        rho_t: at.map(|r| r.rho_t),
    })
}

/// The world of a card for the reference renderer.
///
/// # Errors
/// [`Error::Input`] for a physical sky that the model refuses.
pub fn world(manifest: &SceneManifest, card: &LeafCard) -> Result<transport::ReferenceWorld> {
    let texel = |v: f64| vec![v as f32];
    let side = |p: &Option<CardSide>| {
        let Some(p) = p else { return transport::ReferenceSide::black(1) };
        let curve = SlabInterpolant::new(p.sigma_a, p.sigma_s, 0.95 * p.thickness, 1.05 * p.thickness);
        transport::ReferenceSide {
            interior: transport::ReferenceInterior::Scalars {
                gamma: p.gamma.map(texel),
                thickness: texel(p.thickness),
                curve: Arc::new(move |h| curve.at(h)),
            },
            gloss: p.rho_s.iter().any(|v| *v > 0.0).then(|| transport::ReferenceGloss::even(p.rho_s, p.m)),
            normal: None,
        }
    };
    let (sides, lobe) = (Side::ALL.map(|s| side(&card.sides[s])), manifest.leaves[card.leaf].lobe());
    let leaf = transport::ReferenceLeaf::even(card.mesh.clone(), sides, lobe);
    let mut world = reference::lights(manifest)?;
    world.leaves = vec![leaf];
    world.instances = vec![transport::ReferencePlacement { leaf: 0, transform: card.transform }];
    Ok(world)
}
