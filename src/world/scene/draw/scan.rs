//! A leaf as its own scan saw it, for both renderers: the flat, rectified blade under the tube, from the fit's folder.
//! Everything is drawn from the fit, without the scene's light, so that the pictures can be compared with measured
//! frames.
//!
//! The renderer uses W's packed textures and a slab curve. The reference uses the float maps and its own interpolation,
//! as in every other view.

use super::handover;
use crate::loaded::curve::curve;
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use glam::{DMat4, DVec3, Vec3};
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::{self, Quantity};
use mesophyll_fits::leaf::held_out::StoredFrame;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, filling, packing};
use mesophyll_fits::record::scan::ScanRecord;
use mesophyll_optics::side::Side;
use mesophyll_optics::slab::chebyshev::SlabInterpolant;
use mesophyll_optics::tube::Travel;
use mesophyll_transport as transport;
use mesophyll_viewer::scene as viewer;
use std::sync::Arc;

/// Largest error of the linear interpolation of the slab's curve.
const CURVE: f64 = 1e-4;

/// One side of a fit and the device that scanned it.
pub struct ScanSide<'a> {
    /// The fit whose maps are drawn.
    pub fitted: &'a LeafFit,
    /// The scan that it was made from.
    pub scan: &'a ScanRecord,
    /// The side that is drawn.
    pub side: Side,
    /// Texels across.
    pub width: usize,
    /// Texels down.
    pub height: usize,
}

impl<'a> ScanSide<'a> {
    /// # Errors
    /// [`Error::Input`] for a fit that does not state how its leaf was scanned, or whose maps cannot be read.
    pub fn new(fitted: &'a LeafFit, side: Side) -> Result<ScanSide<'a>> {
        let scan = fitted.record.scan.as_ref().ok_or_else(|| {
            Error::field(
                &fitted.record_path(),
                "scan",
                "missing; only a fit of a scan under a tube can be drawn as it was scanned",
            )
        })?;
        let info = fitted.info(side)?;
        Ok(ScanSide { fitted, scan, side, width: info.width, height: info.height })
    }

    /// Some quantities of the side's maps, with holes filled.
    fn maps(&self, quantities: &[Quantity]) -> Result<ChannelMaps> {
        let path = self.fitted.path(LeafFitFile::Maps, self.side);
        let maps = self.fitted.maps(self.side)?;
        let mut planes = maps.require_planes(&path, quantities)?;
        let good: Vec<bool> = (0..self.width * self.height).map(|k| planes.iter().all(|p| p[k].is_finite())).collect();
        filling::require(&path, &mut planes, &good, self.width, self.height)?;
        let channels = quantity::channels(quantities).into_iter().zip(planes).collect();
        Ok(ChannelMaps { width: self.width, height: self.height, channels })
    }

    fn mesh(&self) -> LeafMesh {
        LeafMesh::rectangle(self.width as f64 * self.scan.texel_mm, self.height as f64 * self.scan.texel_mm)
    }

    /// The scene for the renderer, with the tube at its place in `frame`. The gloss is as it was fitted or, with
    /// `bounded`, has the V-cavity factor as in scenes. Cook–Torrance lobes always have it.
    ///
    /// # Errors
    /// [`Error::Input`] for a map that cannot be read.
    pub fn scene(&self, frame: &StoredFrame, bounded: bool) -> Result<viewer::Scene> {
        let (h, sigma_a, sigma_s) = self.slab()?;
        let path = self.fitted.path(LeafFitFile::Maps, self.side);
        let gamma_delta = packing::gamma_delta(&path, &self.maps(&[Quantity::Gamma, Quantity::Thickness])?, h)?;
        let gloss = packing::gloss(&path, &self.maps(&[Quantity::RhoS, Quantity::M])?)?;
        let normal = packing::normals(&path, &self.maps(&[Quantity::Normal])?)?;
        let (low, high) = gamma_delta
            .iter()
            .fold((f64::INFINITY, 0f64), |(a, b), t| (a.min(h + f64::from(t[3])), b.max(h + f64::from(t[3]))));
        let range = [low.max(1e-6), high.max(2e-6)];
        let (curve, _) = curve(sigma_a, sigma_s, range, CURVE, "scanned leaf", &Ledger::new());
        let front = viewer::SideMaps {
            gamma_delta,
            gloss: Some(gloss),
            normal: Some(normal),
            translucency: None,
            interior: viewer::Interior::Scalars(mesophyll_web::bundle::slab_curve(&curve)),
        };
        let leaf = viewer::LeafMaterial {
            name: self.fitted.name.clone(),
            width: self.width as u32,
            height: self.height as u32,
            thickness_mm: h as f32,
            lobe: self.scan.lobe(),
            sides: viewer::Sides { front, back: viewer::SideMaps::black() },
            mask: None,
        };
        let s = self.scan;
        let mut scene = viewer::Scene {
            scanner: Some(viewer::Scanner {
                camera: Vec3::from(s.camera().map(|v| v as f32)),
                pixel_mm: s.texel_mm as f32,
                height_mm: s.tube_height_mm as f32,
                length_mm: s.tube_length_mm as f32,
                radius_mm: s.tube_radius_mm as f32,
                along_x: frame.travel == Travel::Y,
                at_mm: frame.position_mm as f32,
                bounded: bounded || self.always_bounded(),
            }),
            exposure: 1.0,
            shadow_resolution: 64,
            msaa: 1,
            ..viewer::Scene::default()
        };
        let one = scene.add(handover::viewer_mesh(&self.mesh()), viewer::Material::Leaf(leaf));
        scene.instances.push(one);
        Ok(scene)
    }

    /// The same for the reference renderer.
    ///
    /// # Errors
    /// [`Error::Input`] for a map that cannot be read.
    pub fn world(&self, frame: &StoredFrame) -> Result<transport::ReferenceWorld> {
        let (_, sigma_a, sigma_s) = self.slab()?;
        let quantities = [Quantity::Gamma, Quantity::Thickness, Quantity::RhoS, Quantity::M, Quantity::Normal];
        let maps = self.maps(&quantities)?;
        let values = packing::normals(&self.fitted.path(LeafFitFile::Maps, self.side), &maps)?;
        let n = self.width * self.height;
        let mut planes = maps.channels.into_iter().map(|(_, plane)| plane);
        let mut one = || planes.next().unwrap_or_default();
        let (gamma, thickness, rho_s, m) = ([one(), one(), one()], one(), [one(), one(), one()], one());
        let (low, high) =
            thickness.iter().fold((f64::INFINITY, 0f64), |(a, b), h| (a.min(f64::from(*h)), b.max(f64::from(*h))));
        let curve = SlabInterpolant::new(sigma_a, sigma_s, low, high);
        let front = transport::ReferenceSide {
            interior: transport::ReferenceInterior::Scalars { gamma, thickness, curve: Arc::new(move |h| curve.at(h)) },
            gloss: Some(transport::ReferenceGloss { rho_s, m }),
            normal: Some(transport::NormalMap { frame: transport::NormalFrame::Blade, values }),
        };
        let leaf = transport::ReferenceLeaf {
            mesh: self.mesh(),
            width: self.width,
            height: self.height,
            front,
            back: transport::ReferenceSide::black(n),
            mask: None,
            lobe: self.scan.lobe(),
        };
        let s = self.scan;
        Ok(transport::ReferenceWorld {
            leaves: vec![leaf],
            instances: vec![transport::ReferencePlacement { leaf: 0, transform: DMat4::IDENTITY }],
            scanner: Some(transport::ReferenceScanner {
                camera: DVec3::from(s.camera()),
                pixel_mm: s.texel_mm,
                height_mm: s.tube_height_mm,
                length_mm: s.tube_length_mm,
                radius_mm: s.tube_radius_mm,
                along_x: frame.travel == Travel::Y,
                at_mm: frame.position_mm,
                bounded: self.always_bounded(),
            }),
            ..transport::ReferenceWorld::default()
        })
    }

    fn always_bounded(&self) -> bool {
        self.scan.lobe().index().is_some()
    }

    /// Mean thickness (mm), σa and σs (1/mm) of the side.
    fn slab(&self) -> Result<(f64, [f64; 3], [f64; 3])> {
        let f = self.fitted;
        Ok((f.thickness(self.side)?, f.rgb(self.side, Quantity::SigmaA)?, f.rgb(self.side, Quantity::SigmaS)?))
    }
}
