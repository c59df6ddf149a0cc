//! A leaf as its own scan saw it: the flat, rectified blade under the tube, from the fit's folder, for both renderers.
//! Everything is drawn from the fit, and nothing of the scene's light takes part, so that the pictures can be set
//! against frames that were measured.
//!
//! The renderer takes W's packed textures and a slab curve, the reference takes the float maps and an interpolant of
//! its own, as in every other view.

use super::{handover, reference};
use crate::fits::fitted::{Fitted, fill};
use crate::ledger::Ledger;
use crate::loaded::curve::curve;
use crate::{Error, Result};
use glam::{DMat4, DVec3, Vec3};
use mesophyll_capture::manifest::Travel;
use mesophyll_files::image::Maps;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fit::leaf::held_out::KeptFrame;
use mesophyll_optics::side::Side;
use mesophyll_record::scan::Scan;
use mesophyll_transport as transport;
use mesophyll_viewer::scene as viewer;
use std::sync::Arc;

/// Linear interpolation of the slab's curve stays within this of the slab.
const CURVE: f64 = 1e-4;

/// One side of a fit and the device that scanned it.
pub struct Scanned<'a> {
    pub fitted: &'a Fitted,
    pub scan: &'a Scan,
    pub side: Side,
    pub width: usize,
    pub height: usize,
}

impl<'a> Scanned<'a> {
    /// # Errors
    /// [`Error::Input`] for a fit that does not say how its leaf was scanned, or whose maps cannot be read.
    pub fn new(fitted: &'a Fitted, side: Side) -> Result<Scanned<'a>> {
        let scan = fitted.record.scan.as_ref().ok_or_else(|| {
            Error::field(
                &fitted.folder.join("fit.toml"),
                "scan",
                "missing; only a fit of a scan under a tube can be drawn as it was scanned",
            )
        })?;
        let info = fitted.info(&format!("{}.exr", side.name()))?;
        Ok(Scanned { fitted, scan, side, width: info.width, height: info.height })
    }

    fn maps(&self, what: &str, channels: &[&str]) -> Result<Vec<Vec<f32>>> {
        let file = if what.is_empty() {
            format!("{}.exr", self.side.name())
        } else {
            format!("{}_{what}.exr", self.side.name())
        };
        let maps: Maps = self.fitted.maps(&file, channels, &Ledger::new())?;
        let path = self.fitted.folder.join(&file);
        if (maps.width, maps.height) != (self.width, self.height) {
            return Err(Error::input(
                &path,
                format!("found {}x{} texels, expected {}x{}", maps.width, maps.height, self.width, self.height),
            ));
        }
        let mut planes: Vec<Vec<f32>> = maps.channels.into_iter().map(|(_, p)| p).collect();
        let good: Vec<bool> = (0..self.width * self.height).map(|k| planes.iter().all(|p| p[k].is_finite())).collect();
        fill(&path, self.width, self.height, &mut planes, |k| good[k])?;
        Ok(planes)
    }

    fn mesh(&self) -> LeafMesh {
        LeafMesh::rectangle(self.width as f64 * self.scan.texel_mm, self.height as f64 * self.scan.texel_mm)
    }

    /// The scene for the renderer, the tube where it stood in `frame`; the gloss as it was fitted, or `bounded` by the
    /// V-cavity factor that scenes have. Cook–Torrance lobes always have it.
    ///
    /// # Errors
    /// A map that cannot be read.
    pub fn scene(&self, frame: &KeptFrame, bounded: bool) -> Result<viewer::Scene> {
        let (h, sigma_a, sigma_s) = self.slab()?;
        let first = self.maps("gamma_delta", &["R", "G", "B", "A"])?;
        let second = self.maps("rho_s_m", &["R", "G", "B", "A"])?;
        let normal = self.maps("", &["normal.X", "normal.Y", "normal.Z"])?;
        let texel = |planes: &[Vec<f32>], k: usize| [planes[0][k], planes[1][k], planes[2][k], planes[3][k]];
        let n = self.width * self.height;
        let (low, high) = first[3]
            .iter()
            .fold((f64::INFINITY, 0f64), |(a, b), d| (a.min(h + f64::from(*d)), b.max(h + f64::from(*d))));
        let curve = curve(sigma_a, sigma_s, low.max(1e-6), high.max(2e-6), CURVE, "scanned leaf", &Ledger::new());
        let front = viewer::SideMaps {
            gamma_delta: (0..n).map(|k| texel(&first, k)).collect(),
            gloss: Some((0..n).map(|k| texel(&second, k)).collect()),
            normal: Some((0..n).map(|k| [normal[0][k], normal[1][k], normal[2][k]]).collect()),
            translucency: None,
            interior: viewer::Interior::Scalars(handover::slab_curve(&curve)),
        };
        let leaf = viewer::Leaf {
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

    /// The same for the reference.
    ///
    /// # Errors
    /// A map that cannot be read.
    pub fn world(&self, frame: &KeptFrame) -> Result<transport::World> {
        let (_, sigma_a, sigma_s) = self.slab()?;
        const CHANNELS: [&str; 11] = [
            "gamma.R",
            "gamma.G",
            "gamma.B",
            "thickness.Y",
            "rho_s.R",
            "rho_s.G",
            "rho_s.B",
            "m.Y",
            "normal.X",
            "normal.Y",
            "normal.Z",
        ];
        let mut planes = self.maps("", &CHANNELS)?;
        let n = self.width * self.height;
        let values = (0..n).map(|k| [planes[8][k], planes[9][k], planes[10][k]]).collect();
        let mut take = |k: usize| std::mem::take(&mut planes[k]);
        let thickness = take(3);
        let (low, high) =
            thickness.iter().fold((f64::INFINITY, 0f64), |(a, b), h| (a.min(f64::from(*h)), b.max(f64::from(*h))));
        let curve = reference::Chebyshev::new(sigma_a, sigma_s, low, high);
        let front = transport::ReferenceSide {
            interior: transport::Interior::Scalars {
                gamma: [take(0), take(1), take(2)],
                thickness,
                curve: Arc::new(move |h| curve.at(h)),
            },
            gloss: Some(transport::Gloss { rho_s: [take(4), take(5), take(6)], m: take(7) }),
            normal: Some(transport::NormalMap { frame: transport::NormalFrame::Blade, values }),
        };
        let leaf = transport::ReferenceLeaf {
            mesh: reference::mesh(&self.mesh()),
            width: self.width,
            height: self.height,
            front,
            back: reference::black(n),
            mask: None,
            lobe: self.scan.lobe(),
        };
        let s = self.scan;
        Ok(transport::World {
            leaves: vec![leaf],
            instances: vec![transport::Placement { leaf: 0, transform: DMat4::IDENTITY }],
            scanner: Some(transport::Scanner {
                camera: DVec3::from(s.camera()),
                pixel_mm: s.texel_mm,
                height_mm: s.tube_height_mm,
                length_mm: s.tube_length_mm,
                radius_mm: s.tube_radius_mm,
                along_x: frame.travel == Travel::Y,
                at_mm: frame.position_mm,
                bounded: self.always_bounded(),
            }),
            ..transport::World::default()
        })
    }

    fn always_bounded(&self) -> bool {
        self.scan.lobe().index().is_some()
    }

    /// Mean thickness (mm), σa and σs (1/mm) of the side.
    fn slab(&self) -> Result<(f64, [f64; 3], [f64; 3])> {
        let f = self.fitted;
        Ok((f.thickness(self.side)?, f.rgb(self.side, "sigma_a")?, f.rgb(self.side, "sigma_s")?))
    }
}
