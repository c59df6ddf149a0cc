//! The renderer takes a scene and returns pictures and times. It creates and uploads only what the scene needs, and
//! counts it.

mod change;
// A page in a browser must not wait for the adapter, so pictures and figures are not read back there.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) mod measure;
#[cfg(not(target_arch = "wasm32"))]
mod motion;
#[cfg(not(target_arch = "wasm32"))]
mod read;
mod targets;

use crate::error::{Error, Result};
use crate::extents::Extents;
use crate::far::FarPlants;
use crate::geometry::{Batch, MeshOnGpu, parallel_projection, view_projection};
use crate::gpu::{AdapterInfo, Gpu};
use crate::guard::Guard;
use crate::lobe::Tables;
use crate::material::MaterialOnGpu;
use crate::passes::backdrop::{BackdropPass, Look};
use crate::passes::bend::{self, BendPass};
use crate::passes::bloom::BloomPass;
use crate::passes::choose::ChoosePass;
use crate::passes::grass::{Aim, GrassPass};
use crate::passes::main::{Drawn, Frame, MainPass, Pipelines, Targets};
use crate::passes::motion::MotionPass;
use crate::passes::place::PlacePass;
use crate::passes::pose;
use crate::passes::shadow::ShadowPass;
use crate::passes::sky::SkyPass;
use crate::passes::tonemap::TonemapPass;
use crate::passes::transfer::TransferPass;
use crate::readback;
use crate::samplers::Samplers;
use crate::scene::{Camera, Material, Mesh, Scanner, Scene, SectionAnimation, SkyDome, Sun};
use crate::stand::Falls;
use crate::stats::RenderStatistics;
use crate::thinning::Seen;
use crate::timing::Clock;
use crate::validation;
use crate::variant::shadow_layers;
use glam::Vec3;
use std::sync::Arc;
use targets::TargetSet;

/// Draws scenes, one at a time: first `set_scene`, then any number of pictures.
pub struct Renderer {
    gpu: Gpu,
    samplers: Samplers,
    pipelines: Pipelines,
    tables: Tables,
    far: FarPlants,
    tonemap: TonemapPass,
    loaded: Option<Loaded>,
    targets: Option<TargetSet>,
    /// Whether a scene's backdrop is seen.
    backdrop_shown: bool,
    /// The last frame of `draw_ahead`.
    #[cfg(not(target_arch = "wasm32"))]
    under_way: Option<wgpu::SubmissionIndex>,
    stats: RenderStatistics,
}

/// A scene on the adapter.
struct Loaded {
    /// By the scene's indices; `None` for meshes and materials without an instance.
    meshes: Vec<Option<MeshOnGpu>>,
    materials: Vec<Option<MaterialOnGpu>>,
    batches: Vec<Batch>,
    main: MainPass,
    shadow: Option<ShadowPass>,
    seen_sky: Option<SkyPass>,
    backdrop: Option<BackdropPass>,
    look: Option<BackdropPass>,
    bloom: Option<BloomPass>,
    grass: Option<GrassPass>,
    bend: Option<BendPass>,
    /// Moves what sections carry as wholes, where the adapter does not choose or shadow maps need it.
    place: Option<PlacePass>,
    /// Chooses what is drawn, where the adapter does.
    choose: Option<ChoosePass>,
    /// Made when motion vectors are requested for the first time.
    motion: Option<MotionPass>,
    transfer: Option<TransferPass>,
    sun_shares: Option<Arc<Vec<u8>>>,
    extents: Extents,
    casters: Vec<Vec3>,
    /// Boxes around everything at rest; none where shadow maps are always drawn with all of their texels.
    boxes: Vec<[Vec3; 2]>,
    ball: (Vec3, f32),
    sun: Option<Sun>,
    sky: Option<[f32; 3]>,
    dome: Option<SkyDome>,
    scanner: Option<Scanner>,
    background: [f32; 3],
    shadow_texel: f32,
    shadow_layers: u32,
    shadow_resolution: u32,
    msaa: u32,
}

impl Loaded {
    fn drawn(&self) -> Drawn<'_> {
        Drawn { meshes: &self.meshes, materials: &self.materials, batches: &self.batches }
    }
}

impl Renderer {
    /// Draws with a device that is already open, such as a window's.
    pub fn on(gpu: Gpu) -> Renderer {
        Renderer {
            samplers: Samplers::new(&gpu),
            pipelines: Pipelines::default(),
            tables: Tables::default(),
            far: FarPlants::default(),
            tonemap: TonemapPass::new(&gpu),
            loaded: None,
            targets: None,
            backdrop_shown: true,
            #[cfg(not(target_arch = "wasm32"))]
            under_way: None,
            stats: RenderStatistics::default(),
            gpu,
        }
    }

    /// The adapter that draws.
    pub fn adapter(&self) -> &AdapterInfo {
        &self.gpu.info
    }

    /// Shows or hides the scene's backdrop in the pictures that follow.
    pub fn show_backdrop(&mut self, shown: bool) {
        self.backdrop_shown = shown;
    }

    /// What was created, uploaded and drawn.
    pub fn stats(&self) -> &RenderStatistics {
        &self.stats
    }

    /// Uploads everything that `scene` needs, and makes the pipelines that it needs. It replaces the previous scene.
    ///
    /// # Errors
    /// `Scene` or `Size` where the data contradict themselves or exceed the adapter; the previous scene then stays.
    /// `Device` where the adapter runs out of memory or refuses a shader; then no scene is left.
    pub fn set_scene(&mut self, scene: &Scene) -> Result<()> {
        validation::scene(&self.gpu, scene)?;
        let mut without_poses = None;
        if let Some(SectionAnimation { poses: Some(poses), .. }) = &scene.sections
            && !pose::possible(&self.gpu, poses)
        {
            let mut scene = scene.clone();
            scene.sections.iter_mut().for_each(|s| s.poses = None);
            without_poses = Some(scene);
        }
        let scene = without_poses.as_ref().unwrap_or(scene);
        let guard = Guard::new(&self.gpu);
        let RenderStatistics { draws, shadow_renders, transfers, .. } = self.stats;
        let mut stats = RenderStatistics { draws, shadow_renders, transfers, ..RenderStatistics::default() };
        let points = bend::points(scene);
        let mut batches = Batch::all(&self.gpu, scene, &points, &mut self.far, &mut stats);
        let choose = ChoosePass::new(&self.gpu, &mut batches, &mut stats);
        for batch in &mut batches {
            batch.own = MeshOnGpu::carried(&self.gpu, scene, &points, batch, &mut stats);
        }
        let mesh = |(i, mesh): (usize, &Mesh)| MeshOnGpu::new(&self.gpu, i, mesh, &batches, &mut stats);
        let meshes: Vec<Option<MeshOnGpu>> = scene.meshes.iter().enumerate().map(mesh).collect();
        let material = |(i, material): (usize, &Material)| {
            let variant = &batches.iter().find(|b| b.material == i)?.variant;
            let (gpu, samplers) = (&self.gpu, &self.samplers);
            Some(MaterialOnGpu::new(gpu, i, material, variant, samplers, &mut self.tables, None, &mut stats))
        };
        let materials: Vec<Option<MaterialOnGpu>> = scene.materials.iter().enumerate().map(material).collect();
        let extents = Extents::new(scene);
        let now = extents.at(scene.wind.as_ref());
        let casters = now.casters;
        let bend = BendPass::posed(&self.gpu, scene, now.sections, &mut stats);
        let whole = bend.as_ref().filter(|_| batches.iter().any(|b| b.moving_whole().is_some()));
        let layers = shadow_layers(scene);
        let place = whole.map(|bend| PlacePass::new(&self.gpu, bend, &mut stats));
        if let (Some(place), Some(bend)) = (&place, &bend) {
            // Makes the buffers while a lack of memory is still noticed.
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            place.all(&self.gpu, &mut encoder, &mut batches, bend, layers > 0);
        }
        let drawn = Drawn { meshes: &meshes, materials: &materials, batches: &batches };
        let (mut shadow, mut shadow_texel) = (None, 0.0);
        if let Some(sun) = scene.sun.filter(|_| layers > 0) {
            let (mut pass, texel) =
                ShadowPass::new(&self.gpu, scene, &sun, &casters, drawn, &self.samplers, &mut stats);
            if let Some(pose) = bend.as_ref().and_then(|b| b.pose.as_ref()) {
                pass.follow(&self.gpu, &pose.parts, &sun, extents.still(), &mut stats);
            }
            (shadow, shadow_texel) = (Some(pass), texel);
        }
        for batch in &batches {
            self.pipelines.need(&self.gpu, &batch.variant, &mut stats);
        }
        stats.pipeline("tonemap");
        let transfer = TransferPass::new(&self.gpu, scene, &mut stats);
        let main = MainPass::new(&self.gpu, scene, shadow.as_ref(), transfer.as_ref(), &mut stats);
        let seen_sky = scene.dome.as_ref().filter(|d| d.picture.is_none());
        let seen_sky = seen_sky.map(|_| SkyPass::new(&self.gpu, scene.msaa, &mut stats));
        let [look, backdrop] = [scene.dome.as_ref().and_then(|d| d.picture.as_ref()), scene.backdrop.as_ref()]
            .map(|of| of.map(|b| BackdropPass::new(&self.gpu, b, scene.msaa, &mut stats)));
        let grass = GrassPass::new(&self.gpu, scene, &mut stats);
        let bloom = scene.bloom.map(|share| BloomPass::new(&self.gpu, scene.msaa, share, &mut stats));
        if let Err(error) = guard.finish(&self.gpu) {
            self.pipelines = Pipelines::default();
            self.loaded = None;
            return Err(error);
        }
        self.tonemap.set(&self.gpu, scene.exposure, scene.display);
        self.loaded = Some(Loaded {
            meshes,
            materials,
            batches,
            main,
            shadow,
            seen_sky,
            look,
            backdrop,
            bloom,
            grass,
            bend,
            place,
            choose,
            motion: None,
            transfer,
            sun_shares: scene.sun_shares.clone(),
            ball: now.ball,
            casters,
            boxes: if scene.in_full { Vec::new() } else { extents.boxes() },
            extents,
            sun: scene.sun,
            sky: scene.sky,
            dome: scene.dome.clone(),
            scanner: scene.scanner,
            background: scene.background,
            shadow_texel,
            shadow_layers: layers,
            shadow_resolution: scene.shadow_resolution,
            msaa: scene.msaa,
        });
        self.stats = stats;
        Ok(())
    }

    /// Records a whole frame into the targets of that size.
    fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        camera: &Camera,
        width: u32,
        height: u32,
        clock: Option<&Clock>,
    ) -> Result<()> {
        validation::camera(camera)?;
        validation::picture(&self.gpu, width, height)?;
        let Some(loaded) = &mut self.loaded else {
            return Err(Error::Scene {
                place: "renderer".into(),
                found: "no scene".into(),
                expected: "set_scene before a picture".into(),
            });
        };
        let bloom = loaded.bloom.as_ref();
        let fits = |t: &TargetSet| {
            let share = t.bloom.as_ref().map(|b| b.share);
            (t.width, t.height, t.msaa, share) == (width, height, loaded.msaa, bloom.map(|b| b.share))
        };
        if !self.targets.as_ref().is_some_and(fits) {
            self.targets = Some(TargetSet::new(&self.gpu, &self.tonemap, bloom, width, height, loaded.msaa));
        }
        let Some(targets) = &self.targets else { return Ok(()) };
        let (centre, radius) = loaded.ball;
        let near = (0.5 * (camera.eye.distance(centre) - radius)).max(1e-4 * radius);
        let four = |v: Vec3| [v.x, v.y, v.z, 0.0];
        let colour = |c: [f32; 3]| [c[0], c[1], c[2], 0.0];
        let seen = Seen::new(camera, [width, height], loaded.scanner.is_none());
        let pixel = if loaded.boxes.is_empty() { 0.0 } else { seen.narrowest(&loaded.boxes) };
        let texel = match &mut loaded.shadow {
            Some(shadow) => shadow.aim(&self.gpu, loaded.shadow_texel, pixel),
            None => loaded.shadow_texel,
        };
        let follows = loaded.shadow.as_ref().filter(|shadow| shadow.follows_motion());
        let falls = follows.and_then(|_| Falls::new(seen, &loaded.sun?, loaded.extents.low));
        let sun = loaded.sun.map(|sun| sun.direction.normalize());
        let mut apart = 0.0f32;
        for batch in &mut loaded.batches {
            if batch.choice.is_none() {
                batch.arrange(&self.gpu, &seen, sun.filter(|_| loaded.shadow.is_some()));
            }
            if loaded.shadow.as_ref().is_some_and(|shadow| !shadow.is_drawn()) {
                batch.cast(&self.gpu, texel, sun.unwrap_or(Vec3::Z), falls.as_ref());
            }
            apart = apart.max(batch.apart(texel));
        }
        if let Some(pose) = loaded.bend.as_ref().and_then(|b| b.pose.as_ref()) {
            pose.record(encoder);
        }
        if let (Some(place), Some(bend)) = (&loaded.place, &loaded.bend) {
            let maps = loaded.shadow.as_ref().is_some_and(|shadow| !shadow.is_drawn());
            place.all(&self.gpu, encoder, &mut loaded.batches, bend, maps);
        }
        if let Some(choose) = &loaded.choose {
            choose.record(&self.gpu, encoder, &mut loaded.batches, loaded.bend.as_ref(), &seen, texel, apart);
        }
        self.stats.triangles = loaded.batches.iter().map(Batch::triangles).sum();
        let drawn = Drawn { meshes: &loaded.meshes, materials: &loaded.materials, batches: &loaded.batches };
        let frame = Frame {
            view_projection: match &loaded.scanner {
                Some(scanner) => parallel_projection(scanner, width, height, radius),
                None => view_projection(camera, width as f32 / height as f32, near),
            }
            .to_cols_array_2d(),
            eye: loaded.scanner.map_or(camera.eye.extend(1.0), |s| s.camera.extend(0.0)).to_array(),
            sun_direction: four(loaded.sun.map_or(Vec3::Z, |s| s.direction.normalize())),
            sun_irradiance: colour(loaded.sun.map_or([0.0; 3], |s| s.irradiance)),
            sky: colour(loaded.sky.unwrap_or([0.0; 3])),
            shadow: [texel, apart, loaded.shadow.as_ref().map_or(1.0, ShadowPass::share), 0.0],
            tube: loaded.scanner.map_or([0.0; 4], |s| [s.at_mm, 0.5 * s.length_mm, s.radius_mm, s.height_mm]),
            travel: loaded
                .scanner
                .map_or([0.0; 4], |s| [f32::from(u8::from(s.along_x)), f32::from(u8::from(s.bounded)), 0.0, 0.0]),
        };
        self.gpu.queue.write_buffer(&loaded.main.frame, 0, bytemuck::bytes_of(&frame));
        if let Some(choose) = &loaded.choose {
            choose.apart(encoder, &loaded.main.frame);
        }
        if let (Some(sky), Some(dome)) = (&loaded.seen_sky, &loaded.dome) {
            sky.aim(&self.gpu, dome, loaded.sun.as_ref(), loaded.background, camera, [width, height]);
        }
        let (sun, background) = (loaded.sun.as_ref(), loaded.background);
        let look = loaded.dome.as_ref().map(|dome| Look { dome, sun, background });
        for (pass, look) in [(&loaded.look, look.as_ref()), (&loaded.backdrop, None)] {
            pass.iter().for_each(|pass| pass.aim(&self.gpu, camera, [width, height], look));
        }
        if let Some(grass) = &loaded.grass {
            let (sun, dome) = (loaded.sun.as_ref(), loaded.dome.as_ref());
            grass.aim(&self.gpu, Aim { camera, size: [width, height], sun, dome });
        }
        if let Some(shadow) = &mut loaded.shadow {
            shadow.draw(
                texel,
                encoder,
                drawn,
                loaded.bend.as_ref(),
                &loaded.main.frame,
                clock.map(|c| (&c.queries, 0)),
                &mut self.stats,
            );
        }
        loaded.main.draw(
            encoder,
            &self.pipelines,
            drawn,
            Targets {
                color: targets.samples.as_ref().unwrap_or(&targets.hdr_view),
                resolve: targets.samples.as_ref().map(|_| &targets.hdr_view),
                depth: &targets.depth,
                background: loaded.background,
                sky: loaded.seen_sky.as_ref(),
                backdrop: loaded.backdrop.as_ref().filter(|_| self.backdrop_shown).or(loaded.look.as_ref()),
                bend: loaded.bend.as_ref(),
                grass: loaded.grass.as_ref(),
            },
            clock.map(|c| c.writes(1)),
            &mut self.stats,
        );
        if let (Some(pass), Some(bloom)) = (&loaded.bloom, &targets.bloom) {
            pass.draw(encoder, bloom, &mut self.stats);
        }
        self.tonemap.draw(encoder, &targets.radiance, &targets.ldr_view, clock.map(|c| c.writes(2)), &mut self.stats);
        Ok(())
    }

    /// The device that draws.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Draws a frame and leaves the tone-mapped picture on the adapter, for a program that shows it.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw(&mut self, camera: &Camera, width: u32, height: u32) -> Result<&wgpu::TextureView> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder, camera, width, height, None)?;
        self.gpu.queue.submit([encoder.finish()]);
        readback::wait(&self.gpu)?;
        #[cfg(not(target_arch = "wasm32"))]
        self.count()?;
        let drawn = self.targets.as_ref().map(|t| &t.ldr_view);
        drawn.ok_or_else(|| Error::Readback("nothing has been drawn".into()))
    }
}
