//! The reference that a picture is compared with: the direct-light reference, or the path tracer where the scene has
//! light between leaves.

use super::reference;
use crate::Result;
use crate::loaded::Scene;
use crate::manifest::View;
use mesophyll_files::progress;
use mesophyll_transport::path::{Paths, Picture, Request, Target, Tracer};
use mesophyll_transport::{self as transport, World};

/// A reference that is ready to draw.
pub struct Truth<'a> {
    direct: transport::Renderer<'a>,
    /// The path tracer, for light between leaves.
    paths: Option<Tracer<'a>>,
}

/// How a reference is sampled.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Number of pixels in a row, and number of rows.
    pub size: [usize; 2],
    /// Samples for each pixel.
    pub samples: u32,
    /// Samples over the sun's disk.
    pub sun_samples: u32,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// The largest number of direct-light samples, which decide where a pixel shows the interior of a surface.
const MOST_FOR_SHAPES: u32 = 16;

impl Sampling {
    /// The sampling of the scene's `[check]`, with another seed.
    pub fn of(scene: &Scene, seed: u64) -> Sampling {
        let check = &scene.manifest.check;
        Sampling {
            size: [check.width as usize, check.height as usize],
            samples: check.samples,
            sun_samples: if scene.plan.light.shadows_fall() { 4 } else { 1 },
            seed,
        }
    }
}

impl<'a> Truth<'a> {
    /// A reference with light `between` leaves, or with direct light alone.
    ///
    /// # Errors
    /// As [`transport::Renderer::new`].
    pub fn new(world: &'a World, between: bool) -> Result<Truth<'a>> {
        let paths = between.then(|| Tracer::new(world, Paths::default())).transpose()?;
        Ok(Truth { direct: transport::Renderer::new(world)?, paths })
    }

    /// The picture of a view of the scene, with the seed `seed`.
    ///
    /// # Errors
    /// As [`Truth::draw`].
    pub fn view(&self, scene: &Scene, view: &View, seed: u64) -> Result<transport::ReferencePicture> {
        self.draw(&reference::camera(view), &view.name, Sampling::of(scene, seed))
    }

    /// The picture of a camera. `what` names it in the progress bar.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for a camera that looks nowhere; [`crate::Error::Interrupted`] after a stop.
    pub fn draw(
        &self,
        camera: &transport::Camera,
        what: &str,
        Sampling { size, samples, sun_samples, seed }: Sampling,
    ) -> Result<transport::ReferencePicture> {
        let options = transport::Options {
            samples_per_pixel: if self.paths.is_some() { samples.min(MOST_FOR_SHAPES) } else { samples },
            sun_samples,
            seed,
            sky_samples: 4,
            // A narrow part of a grazing leaf may lie between the rays of one pixel, but not between those of all
            // neighbouring pixels.
            margin: 2,
        };
        let mut out = self.direct.render(camera, size[0], size[1], &options)?;
        if let Some(tracer) = &self.paths {
            let mut picture = Picture::new(size[0], size[1]);
            let target = Target { samples: Some(samples), error: None };
            picture.draw(tracer, &Request { camera: *camera, size, seed, target }, what, &mut |_| Ok(()))?;
            progress::go_on()?;
            out.relit(&picture.mean, tracer.world().exposure);
        }
        Ok(out)
    }
}
