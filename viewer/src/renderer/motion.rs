//! Motion vectors of the scene that is set.

use super::Renderer;
use crate::error::{Error, Result};
use crate::geometry::view_projection;
use crate::guard::Guard;
use crate::passes::main::DEPTH;
use crate::passes::motion::{Cameras, MotionPass};
use crate::readback::TextureCopy;
use crate::scene::{Camera, Scene, WindState};
use crate::thinning::Seen;
use crate::validation;

impl Renderer {
    /// The movement of every pixel's surface since it was seen by `earlier`, when the wind was `before`: pixels to the
    /// right and down, row by row, row 0 on top. `None` where nothing is drawn. A point that was hidden or outside the
    /// earlier picture has a vector too. `scene` must be the one that is set, at the time that was set last. The sky
    /// has no vectors. A pixel that a lawn covers has the vector of what stands behind the lawn. Vectors have the
    /// precision of radiance: single, or half where the adapter cannot draw better.
    ///
    /// # Errors
    /// `Size` for an empty or too large picture, `Scene` for a camera that looks nowhere, for a scanner, where no scene
    /// is set, or where a buffer cannot hold its sections at two times; `Device`, `Readback`.
    pub fn motion(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        earlier: &Camera,
        before: Option<&WindState>,
        width: u32,
        height: u32,
    ) -> Result<Vec<Option<[f32; 2]>>> {
        validation::camera(camera)?;
        validation::camera(earlier)?;
        validation::picture(&self.gpu, width, height)?;
        let Some(loaded) = self.loaded.as_mut().filter(|l| l.scanner.is_none()) else {
            return Err(Error::Scene {
                place: "motion vectors".into(),
                found: "no scene, or one with a scanner".into(),
                expected: "a scene that a camera looks at, set before".into(),
            });
        };
        if loaded.motion.is_none() {
            validation::sections(&self.gpu, scene, 2)?;
        }
        let guard = Guard::new(&self.gpu);
        let gpu = &self.gpu;
        // The same instances are drawn, at the same sizes, as in the picture, except that the CPU chooses. It does not
        // know where a wind has moved a leaf. So it chooses by where the leaf is at rest, and culls no leaf that
        // moves.
        let seen = Seen::new(camera, [width, height], true);
        for batch in &mut loaded.batches {
            batch.arrange(gpu, &seen, None);
        }
        let pass = match loaded.motion.take() {
            Some(pass) => pass,
            None => MotionPass::new(gpu, scene, loaded.bend.as_ref(), loaded.drawn(), &mut self.stats),
        };
        let (centre, radius) = loaded.ball;
        let of = |camera: &Camera| {
            let near = (0.5 * (camera.eye.distance(centre) - radius)).max(1e-4 * radius);
            view_projection(camera, width as f32 / height as f32, near).to_cols_array_2d()
        };
        let half_size = [0.5 * width as f32, -0.5 * height as f32, 0.0, 0.0];
        let cameras = Cameras { now: of(camera), before: of(earlier), half_size };
        let winds = [scene.wind.as_ref(), before.or(scene.wind.as_ref())];
        pass.aim(gpu, cameras, loaded.extents.sections(), winds);
        let texture = |format, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("motion"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            })
        };
        let target = texture(gpu.hdr_format(1), wgpu::TextureUsages::COPY_SRC);
        let depth = texture(DEPTH, wgpu::TextureUsages::empty());
        let views = [&target, &depth].map(|t| t.create_view(&Default::default()));
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        pass.draw(gpu, &mut encoder, loaded.drawn(), &self.samplers, [&views[0], &views[1]], &mut self.stats);
        let copy = TextureCopy::record(gpu, &mut encoder, &target);
        gpu.queue.submit([encoder.finish()]);
        loaded.batches.iter_mut().for_each(|batch| batch.put_back(gpu));
        loaded.motion = Some(pass);
        let texels = copy.floats(gpu)?;
        guard.finish(gpu)?;
        Ok(texels.iter().map(|t| (t[3] > 0.0).then_some([t[0], t[1]])).collect())
    }
}
