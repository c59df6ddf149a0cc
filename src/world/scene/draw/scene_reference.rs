//! The reference that a picture is compared with: the direct-light reference, or the path tracer where the scene has
//! light between leaves.

use crate::Result;
use crate::loaded::LoadedScene;
use crate::manifest::PerspectiveView;
use mesophyll_files::progress;
use mesophyll_transport::path::{PathPicture, PathRequest, PathSettings, PathTracer, SamplingTarget};
use mesophyll_transport::{self as transport, ReferenceWorld};

/// A reference that is ready to draw.
pub struct SceneReference<'a> {
    direct: transport::ReferenceRenderer<'a>,
    /// The path tracer, for light between leaves.
    paths: Option<PathTracer<'a>>,
}

/// How a reference is sampled.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceSampling {
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

impl ReferenceSampling {
    /// The sampling of the scene's `[check]`, with another seed.
    pub fn of(scene: &LoadedScene, seed: u64) -> ReferenceSampling {
        let check = &scene.manifest.check;
        ReferenceSampling {
            size: [check.width as usize, check.height as usize],
            samples: check.samples,
            sun_samples: if scene.plan.light.shadows_fall() { 4 } else { 1 },
            seed,
        }
    }
}

impl<'a> SceneReference<'a> {
    /// A reference with light `between` leaves, or with direct light alone.
    ///
    /// # Errors
    /// As [`transport::ReferenceRenderer::new`].
    pub fn new(world: &'a ReferenceWorld, between: bool) -> Result<SceneReference<'a>> {
        let paths = between.then(|| PathTracer::new(world, PathSettings::default())).transpose()?;
        Ok(SceneReference { direct: transport::ReferenceRenderer::new(world)?, paths })
    }

    /// The picture of a view of the scene, with the seed `seed`.
    ///
    /// # Errors
    /// As [`SceneReference::draw`].
    pub fn view(&self, scene: &LoadedScene, view: &PerspectiveView, seed: u64) -> Result<transport::ReferencePicture> {
        self.draw(&view.camera, &view.name, ReferenceSampling::of(scene, seed))
    }

    /// The picture of a camera. `what` names it in the progress bar.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for a camera that looks nowhere; [`crate::Error::Interrupted`] after a stop.
    pub fn draw(
        &self,
        camera: &transport::ReferenceCamera,
        what: &str,
        ReferenceSampling { size, samples, sun_samples, seed }: ReferenceSampling,
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
            let mut picture = PathPicture::new(size[0], size[1]);
            let target = SamplingTarget { samples: Some(samples), error: None };
            picture.draw(tracer, &PathRequest { camera: *camera, size, seed, target }, what, &mut |_| Ok(()))?;
            progress::go_on()?;
            out.relit(&picture.mean, tracer.world().exposure);
        }
        Ok(out)
    }
}
