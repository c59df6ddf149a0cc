//! What a view is held against: the direct-light reference, or the path tracer where the scene has light between leaves.

use crate::Result;
use crate::loaded::Scene;
use crate::manifest::View;
use mesophyll_transport::path::{Paths, Picture, Request, Target, Tracer};
use mesophyll_transport::{self as transport, World};

/// A reference that is ready to draw.
pub struct Truth<'a> {
    direct: transport::Renderer<'a>,
    /// Light between leaves.
    paths: Option<Tracer<'a>>,
}

/// Most samples that tell where a pixel shows the inside of a surface, without the light between leaves.
const MOST_FOR_SHAPES: u32 = 16;

impl<'a> Truth<'a> {
    /// Direct light alone.
    ///
    /// # Errors
    /// As [`transport::Renderer::new`].
    pub fn direct(world: &'a World) -> Result<Truth<'a>> {
        Ok(Truth { direct: transport::Renderer::new(world)?, paths: None })
    }

    /// What the scene asks for.
    ///
    /// # Errors
    /// As [`Truth::direct`].
    pub fn of(scene: &Scene, world: &'a World) -> Result<Truth<'a>> {
        let paths = scene.manifest.transfer.is_some().then(|| Tracer::new(world, Paths::default())).transpose()?;
        Ok(Truth { paths, ..Truth::direct(world)? })
    }

    /// The view from `seed`, with the scene's own number of samples a pixel.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for a camera that looks nowhere; [`crate::Error::Interrupted`] after a stop.
    pub fn draw(&self, scene: &Scene, view: &View, seed: u64) -> Result<transport::ReferencePicture> {
        let check = &scene.manifest.check;
        let size = [check.width as usize, check.height as usize];
        let camera = crate::draw::reference::camera(view);
        let samples = if self.paths.is_some() { check.samples.min(MOST_FOR_SHAPES) } else { check.samples };
        let options = transport::Options {
            samples_per_pixel: samples,
            sun_samples: if scene.plan.light.shadow_samples > 0 { 4 } else { 1 },
            seed,
            sky_samples: 4,
            // A grazing leaf's sliver can slip through the rays of one pixel, not through those of all around it.
            margin: 2,
        };
        let mut out = self.direct.render(&camera, size[0], size[1], &options)?;
        if let Some(tracer) = &self.paths {
            let mut picture = Picture::new(size[0], size[1]);
            let target = Target { samples: Some(check.samples), error: None };
            picture.draw(tracer, &Request { camera, size, seed, target }, &view.name, &mut |_| Ok(()))?;
            mesophyll_files::progress::go_on()?;
            out.relit(&picture.mean, scene.manifest.exposure);
        }
        Ok(out)
    }
}
