//! The renderer: a scene in, pictures and times out. It creates and uploads only what the scene needs, and counts it.

use crate::bend::Moved;
use crate::error::{Error, Result};
use crate::geometry::{Batch, Extents, MeshOnGpu, ball, parallel_projection, view_projection};
use crate::gpu::{AdapterInfo, Gpu, Options, instance_descriptor};
use crate::lobe::Tables;
use crate::material::{MaterialOnGpu, Samplers};
use crate::passes::bend::BendPass;
use crate::passes::grass::{Aim, GrassPass};
use crate::passes::main::{Drawn, Frame, MainPass, Pipelines, Targets};
use crate::passes::shadow::ShadowPass;
use crate::passes::sky::SkyPass;
use crate::passes::tonemap::{self, TonemapPass};
use crate::passes::transfer::{Lit, TransferPass};
use crate::picture::Picture;
use crate::readback::{self, Copy};
use crate::scene::{Camera, Dome, Instance, Material, Mesh, Scanner, Scene, Sun, Wind};
use crate::stats::Stats;
use crate::thin::Seen;
use crate::timing::{Clock, PASSES, Timing};
use crate::validate;
use crate::variant::{Variant, shadow_layers};
use glam::Vec3;
use std::sync::Arc;
use std::time::Instant;

/// Draws scenes. One at a time: `set_scene`, then any number of pictures.
pub struct Renderer {
    gpu: Gpu,
    samplers: Samplers,
    pipelines: Pipelines,
    tables: Tables,
    tonemap: TonemapPass,
    loaded: Option<Loaded>,
    targets: Option<TargetSet>,
    stats: Stats,
}

/// A scene on the adapter.
struct Loaded {
    /// By the scene's indices; `None` for what stands nowhere.
    meshes: Vec<Option<MeshOnGpu>>,
    materials: Vec<Option<MaterialOnGpu>>,
    batches: Vec<Batch>,
    main: MainPass,
    shadow: Option<ShadowPass>,
    seen_sky: Option<SkyPass>,
    grass: Option<GrassPass>,
    bend: Option<BendPass>,
    transfer: Option<TransferPass>,
    sun_shares: Option<Arc<Vec<u8>>>,
    extents: Extents,
    casters: Vec<Vec3>,
    ball: (Vec3, f32),
    sun: Option<Sun>,
    sky: Option<[f32; 3]>,
    dome: Option<Dome>,
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

/// Pictures of one size.
struct TargetSet {
    width: u32,
    height: u32,
    msaa: u32,
    hdr: wgpu::Texture,
    hdr_view: wgpu::TextureView,
    samples: Option<wgpu::TextureView>,
    depth: wgpu::TextureView,
    ldr: wgpu::Texture,
    ldr_view: wgpu::TextureView,
    radiance: wgpu::BindGroup,
}

impl Renderer {
    /// Opens an adapter without a window.
    ///
    /// # Errors
    /// `NoAdapter` where nothing can draw, `Device` where the adapter refuses.
    pub fn headless(options: &Options) -> Result<Renderer> {
        let instance = wgpu::Instance::new(instance_descriptor(options));
        Ok(Renderer::on(Gpu::open(&instance, None, options)?))
    }

    /// Draws with a device that is already open, such as a window's.
    pub fn on(gpu: Gpu) -> Renderer {
        Renderer {
            samplers: Samplers::new(&gpu),
            pipelines: Pipelines::default(),
            tables: Tables::default(),
            tonemap: TonemapPass::new(&gpu),
            loaded: None,
            targets: None,
            stats: Stats::default(),
            gpu,
        }
    }

    /// Who draws.
    pub fn adapter(&self) -> &AdapterInfo {
        &self.gpu.info
    }

    /// What was created, uploaded and drawn.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Uploads what `scene` needs and makes the pipelines it needs; replaces the scene before it.
    ///
    /// # Errors
    /// `Scene` or `Size` where the data contradict themselves or exceed the adapter: the scene before stays then.
    /// `Device` where the adapter runs out of memory or refuses a shader: no scene is left then.
    pub fn set_scene(&mut self, scene: &Scene) -> Result<()> {
        validate::scene(&self.gpu, scene)?;
        let guard = self.gpu.guard();
        let Stats { draws, shadow_renders, transfers, .. } = self.stats;
        let mut stats = Stats { draws, shadow_renders, transfers, ..Stats::default() };
        let batches = Batch::all(&self.gpu, scene, &mut stats);
        let mesh = |(i, mesh): (usize, &Mesh)| {
            let stands = batches.iter().any(|b| b.mesh == i);
            stands.then(|| MeshOnGpu::new(&self.gpu, i, mesh, &batches, &mut stats))
        };
        let meshes: Vec<Option<MeshOnGpu>> = scene.meshes.iter().enumerate().map(mesh).collect();
        let material = |(i, material): (usize, &Material)| {
            let variant = &batches.iter().find(|b| b.material == i)?.variant;
            let (gpu, samplers) = (&self.gpu, &self.samplers);
            Some(MaterialOnGpu::new(gpu, i, material, variant, samplers, &mut self.tables, None, &mut stats))
        };
        let materials: Vec<Option<MaterialOnGpu>> = scene.materials.iter().enumerate().map(material).collect();
        let drawn = Drawn { meshes: &meshes, materials: &materials, batches: &batches };
        let extents = Extents::new(scene);
        let casters = extents.casters(scene.wind.as_ref());
        let bend = BendPass::new(&self.gpu, scene, &mut stats);
        let layers = shadow_layers(scene);
        let (mut shadow, mut shadow_texel) = (None, 0.0);
        if let Some(sun) = scene.sun.filter(|_| layers > 0) {
            let (pass, texel) = ShadowPass::new(&self.gpu, scene, &sun, &casters, drawn, &self.samplers, &mut stats);
            (shadow, shadow_texel) = (Some(pass), texel);
        }
        for batch in &batches {
            self.pipelines.need(&self.gpu, &batch.variant, &mut stats);
        }
        stats.pipeline("tonemap");
        let transfer = TransferPass::new(&self.gpu, scene, &mut stats);
        let main = MainPass::new(&self.gpu, scene, shadow.as_ref(), transfer.as_ref(), &mut stats);
        let seen_sky = scene.dome.as_ref().map(|_| SkyPass::new(&self.gpu, scene.msaa, &mut stats));
        let grass = GrassPass::new(&self.gpu, scene, &mut stats);
        if let Err(error) = guard.finish(&self.gpu) {
            self.pipelines = Pipelines::default();
            self.loaded = None;
            return Err(error);
        }
        self.tonemap.set_exposure(&self.gpu, scene.exposure);
        self.loaded = Some(Loaded {
            meshes,
            materials,
            batches,
            main,
            shadow,
            seen_sky,
            grass,
            bend,
            transfer,
            sun_shares: scene.sun_shares.clone(),
            ball: ball(&extents.corners(scene.wind.as_ref())),
            casters,
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

    /// Takes over a change of lights, background or exposure, with meshes, materials and instances as they were; moving
    /// the sun redraws the shadow maps, all else is free. A light that appears or goes reloads the scene, since other
    /// maps are needed then.
    pub fn set_lights(&mut self, scene: &Scene) -> Result<()> {
        let same = self.loaded.as_ref().is_some_and(|l| {
            l.sun.is_some() == scene.sun.is_some()
                && l.sky.is_some() == scene.sky.is_some()
                && l.dome.is_some() == scene.dome.is_some()
                && l.scanner.is_some() == scene.scanner.is_some()
                && l.transfer.is_some() == scene.transfer.is_some()
                && l.sun_shares.as_ref().map(|s| s.len()) == scene.sun_shares.as_ref().map(|s| s.len())
                && l.shadow_layers == shadow_layers(scene)
                && l.shadow_resolution == scene.shadow_resolution
                && l.msaa == scene.msaa
        });
        if !same {
            return self.set_scene(scene);
        }
        validate::lights(&self.gpu, scene)?;
        let Some(loaded) = &mut self.loaded else { return Ok(()) };
        if let (Some(sun), Some(shadow)) = (scene.sun, &mut loaded.shadow)
            && loaded.sun.is_none_or(|old| old.direction != sun.direction || old.radius != sun.radius)
        {
            loaded.shadow_texel = shadow.set_sun(&self.gpu, &sun, &loaded.casters);
        }
        (loaded.sun, loaded.sky, loaded.background) = (scene.sun, scene.sky, scene.background);
        loaded.scanner = scene.scanner;
        if let Some(dome) = &scene.dome {
            loaded.main.set_dome(&self.gpu, dome);
        }
        if let Some(transfer) = &mut loaded.transfer {
            transfer.set_light(&self.gpu, &Lit::of(scene), &mut self.stats);
        }
        loaded.dome = scene.dome.clone();
        if let Some(shares) = scene.sun_shares.as_ref().filter(|_| loaded.sun_shares != scene.sun_shares) {
            loaded.main.set_shares(&self.gpu, shares);
            loaded.sun_shares = scene.sun_shares.clone();
        }
        self.tonemap.set_exposure(&self.gpu, scene.exposure);
        Ok(())
    }

    /// Takes over another time of `wind`, which is otherwise as it was: branches and what rides on them move, and
    /// shadows with them.
    pub fn set_time(&mut self, wind: &Wind) {
        let Some(loaded) = &mut self.loaded else { return };
        let Some(bend) = &loaded.bend else { return };
        bend.set_time(&self.gpu, loaded.extents.branches(), loaded.extents.sections(), wind);
        loaded.casters = loaded.extents.casters(Some(wind));
        loaded.ball = ball(&loaded.extents.corners(Some(wind)));
        if let (Some(sun), Some(shadow)) = (loaded.sun, &mut loaded.shadow) {
            loaded.shadow_texel = shadow.set_sun(&self.gpu, &sun, &loaded.casters);
        }
    }

    /// Where the vertex stage puts the vertices of instance `index` of `scene`, which must be the one that was set:
    /// position, normal and tangent each, in world space, computed by the same shader function that pictures are drawn
    /// with.
    ///
    /// # Errors
    /// `Scene` where nothing bends the instance or nothing was set, `Readback`.
    pub fn bent_vertices(&self, scene: &Scene, index: usize) -> Result<Vec<[Vec3; 3]>> {
        let bend = self.loaded.as_ref().and_then(|l| l.bend.as_ref());
        let (Some(bend), Some(instance)) = (bend, scene.instances.get(index).filter(|i| Moved::of(i).any())) else {
            let place = format!("instance {index}");
            return Err(Error::Scene {
                place,
                found: "nothing that bends it".into(),
                expected: "an instance on a branch or a section of the set scene".into(),
            });
        };
        let (mesh, m) = (&scene.meshes[instance.mesh], instance.transform);
        let vertices: Vec<[Vec3; 3]> = (0..mesh.positions.len())
            .map(|k| {
                let turned = |d: Vec3| m.transform_vector3(d);
                [m.transform_point3(mesh.positions[k]), turned(mesh.normals[k]), turned(mesh.tangents[k].truncate())]
            })
            .collect();
        bend.probe(&self.gpu, instance, &vertices)
    }

    /// Operations of the fragment shader that material `index` of `scene` is drawn with (see `operations`): a figure
    /// to compare shaders by. `None` for a material that stands nowhere.
    pub fn operations(&self, scene: &Scene, index: usize) -> Option<usize> {
        let instance = *scene.instances.iter().find(|i| i.material == index)?;
        crate::operations::count(&crate::passes::main::source(&Variant::new(&self.gpu, scene, &[instance])?))
    }

    /// Takes over a change of material `index`, with meshes, masks and instances as they were. Only what the change
    /// touched is uploaded: a curve where a slider moved a curve, and no map that is as it was.
    ///
    /// # Errors
    /// As [`Renderer::set_scene`].
    pub fn set_material(&mut self, scene: &Scene, index: usize) -> Result<()> {
        validate::material(&self.gpu, scene, index)?;
        let Some(loaded) = &mut self.loaded else { return self.set_scene(scene) };
        let Some(before) = loaded.materials.get(index).and_then(Option::as_ref) else { return Ok(()) };
        let guard = self.gpu.guard();
        let (gpu, stats) = (&self.gpu, &mut self.stats);
        let mut new = None;
        for batch in loaded.batches.iter_mut().filter(|b| b.material == index) {
            let own = |i: &&Instance| (i.mesh, i.material) == (batch.mesh, index);
            let instances: Vec<Instance> = scene.instances.iter().filter(own).copied().collect();
            let Some(variant) = Variant::new(gpu, scene, &instances) else { continue };
            batch.variant = variant;
            self.pipelines.need(gpu, &variant, stats);
            new.get_or_insert_with(|| {
                let (material, tables) = (&scene.materials[index], &mut self.tables);
                MaterialOnGpu::new(gpu, index, material, &variant, &self.samplers, tables, Some(before), stats)
            });
        }
        for (i, mesh) in loaded.meshes.iter_mut().enumerate() {
            if let Some(mesh) = mesh {
                mesh.complete(gpu, i, &scene.meshes[i], &loaded.batches, stats);
            }
        }
        if let Err(error) = guard.finish(&self.gpu) {
            self.pipelines = Pipelines::default();
            self.loaded = None;
            return Err(error);
        }
        if new.is_some() {
            loaded.materials[index] = new;
        }
        if let Some(mut shadow) = loaded.shadow.take() {
            shadow.bind_masks(&self.gpu, loaded.drawn(), &self.samplers);
            loaded.shadow = Some(shadow);
        }
        Ok(())
    }

    /// Draws a picture of `width` × `height` pixels.
    ///
    /// # Errors
    /// `Size` for an empty or too large picture, `Scene` for a camera that looks nowhere, `Readback`.
    pub fn render(&mut self, camera: &Camera, width: u32, height: u32) -> Result<Picture> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder, camera, width, height, None)?;
        let Some(targets) = &self.targets else { return Err(Error::Readback("no target".into())) };
        let hdr = Copy::record(&self.gpu, &mut encoder, &targets.hdr);
        let ldr = Copy::record(&self.gpu, &mut encoder, &targets.ldr);
        self.gpu.queue.submit([encoder.finish()]);
        Ok(Picture { width, height, hdr: hdr.floats(&self.gpu)?, ldr: ldr.bytes(&self.gpu)? })
    }

    /// Draws what the scene's scanner sees.
    ///
    /// # Errors
    /// As [`Renderer::render`], and `Scene` where there is no scanner.
    pub fn scan(&mut self, width: u32, height: u32) -> Result<Picture> {
        if self.loaded.as_ref().is_none_or(|l| l.scanner.is_none()) {
            return Err(Error::Scene {
                place: "scanner".into(),
                found: "none".into(),
                expected: "a scene with a scanner".into(),
            });
        }
        // The scanner's own camera is taken; this one only has to look somewhere.
        let camera = Camera { eye: 1e3 * Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_y_deg: 30.0 };
        self.render(&camera, width, height)
    }

    /// Draws the picture `frames` times after one to warm up, without reading it back.
    pub fn time(&mut self, camera: &Camera, width: u32, height: u32, frames: usize) -> Result<Timing> {
        let clock = Clock::new(&self.gpu);
        let mut timing = Timing::default();
        if let Some(shadow) = self.loaded.as_mut().and_then(|l| l.shadow.as_mut()) {
            shadow.forget();
        }
        for i in 0..=frames {
            // Shadow maps are drawn in the frame that warms up, and kept from then on.
            let first = u32::from(i > 0 || self.loaded.as_ref().is_none_or(|l| l.shadow.is_none()));
            let start = Instant::now();
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            self.record(&mut encoder, camera, width, height, clock.as_ref())?;
            if let Some(clock) = &clock {
                clock.resolve(&mut encoder, first);
            }
            self.gpu.queue.submit([encoder.finish()]);
            readback::wait(&self.gpu)?;
            if i > 0 {
                timing.frame_ms.push(start.elapsed().as_secs_f64() * 1e3);
            }
            if let Some(clock) = &clock {
                for (name, ms) in PASSES[first as usize..].iter().zip(clock.read(&self.gpu, first)?) {
                    if i > 0 || *name == "shadow" {
                        match timing.passes.iter_mut().find(|(n, _)| n == name) {
                            Some((_, all)) => all.push(ms),
                            None => timing.passes.push((name.to_string(), vec![ms])),
                        }
                    }
                }
            }
        }
        Ok(timing)
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
        validate::camera(camera)?;
        validate::picture(&self.gpu, width, height)?;
        let Some(loaded) = &mut self.loaded else {
            return Err(Error::Scene {
                place: "renderer".into(),
                found: "no scene".into(),
                expected: "set_scene before a picture".into(),
            });
        };
        if self.targets.as_ref().is_none_or(|t| (t.width, t.height, t.msaa) != (width, height, loaded.msaa)) {
            self.targets = Some(TargetSet::new(&self.gpu, &self.tonemap, width, height, loaded.msaa));
        }
        let Some(targets) = &self.targets else { return Ok(()) };
        let (centre, radius) = loaded.ball;
        let near = (0.5 * (camera.eye.distance(centre) - radius)).max(1e-4 * radius);
        let four = |v: Vec3| [v.x, v.y, v.z, 0.0];
        let colour = |c: [f32; 3]| [c[0], c[1], c[2], 0.0];
        let seen = Seen::new(camera, [width, height], loaded.scanner.is_none());
        let mut apart = 0.0f32;
        for batch in &mut loaded.batches {
            batch.levels.arrange(&self.gpu, &seen, &batch.instances, batch.rides.as_ref(), batch.begins.as_ref());
            apart = apart.max(batch.levels.apart(loaded.shadow_texel));
        }
        self.stats.triangles = loaded.batches.iter().map(|b| b.levels.triangles()).sum();
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
            shadow: [loaded.shadow_texel, apart, 0.0, 0.0],
            tube: loaded.scanner.map_or([0.0; 4], |s| [s.at_mm, 0.5 * s.length_mm, s.radius_mm, s.height_mm]),
            travel: loaded
                .scanner
                .map_or([0.0; 4], |s| [f32::from(u8::from(s.along_x)), f32::from(u8::from(s.bounded)), 0.0, 0.0]),
        };
        self.gpu.queue.write_buffer(&loaded.main.frame, 0, bytemuck::bytes_of(&frame));
        if let (Some(sky), Some(dome)) = (&loaded.seen_sky, &loaded.dome) {
            sky.aim(&self.gpu, dome, loaded.sun.as_ref(), loaded.background, camera, [width, height]);
        }
        if let Some(grass) = &loaded.grass {
            let (sun, dome) = (loaded.sun.as_ref(), loaded.dome.as_ref());
            grass.aim(&self.gpu, Aim { camera, size: [width, height], sun, dome });
        }
        if let Some(shadow) = &mut loaded.shadow {
            shadow.draw(
                loaded.shadow_texel,
                encoder,
                drawn,
                loaded.bend.as_ref(),
                clock.map(|c| (&c.queries, 0)),
                &mut self.stats,
            );
        }
        let (color, resolve) = match &targets.samples {
            Some(samples) => (samples, Some(&targets.hdr_view)),
            None => (&targets.hdr_view, None),
        };
        loaded.main.draw(
            encoder,
            &self.pipelines,
            drawn,
            Targets {
                color,
                resolve,
                depth: &targets.depth,
                background: loaded.background,
                sky: loaded.seen_sky.as_ref(),
                bend: loaded.bend.as_ref(),
                grass: loaded.grass.as_ref(),
            },
            clock.map(|c| c.writes(1)),
            &mut self.stats,
        );
        self.tonemap.draw(encoder, &targets.radiance, &targets.ldr_view, clock.map(|c| c.writes(2)), &mut self.stats);
        Ok(())
    }

    /// What draws.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Draws a frame and leaves it on the adapter, for a program that shows it: the tone-mapped picture.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw(&mut self, camera: &Camera, width: u32, height: u32) -> Result<&wgpu::TextureView> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder, camera, width, height, None)?;
        self.gpu.queue.submit([encoder.finish()]);
        readback::wait(&self.gpu)?;
        let drawn = self.targets.as_ref().map(|t| &t.ldr_view);
        drawn.ok_or_else(|| Error::Readback("nothing has been drawn".into()))
    }
}

impl TargetSet {
    fn new(gpu: &Gpu, tonemap: &TonemapPass, width: u32, height: u32, msaa: u32) -> TargetSet {
        use wgpu::TextureUsages as Use;
        let texture = |label, format, sample_count, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let view = |t: &wgpu::Texture| t.create_view(&Default::default());
        let format = gpu.hdr_format(msaa);
        let read = Use::RENDER_ATTACHMENT | Use::TEXTURE_BINDING | Use::COPY_SRC;
        let hdr = texture("radiance", format, 1, read);
        let ldr = texture("picture", tonemap::FORMAT, 1, read);
        let hdr_view = view(&hdr);
        TargetSet {
            width,
            height,
            msaa,
            samples: (msaa > 1).then(|| view(&texture("samples", format, msaa, Use::RENDER_ATTACHMENT))),
            depth: view(&texture("depth", crate::passes::main::DEPTH, msaa, Use::RENDER_ATTACHMENT)),
            ldr_view: view(&ldr),
            radiance: tonemap.bind(gpu, &hdr_view),
            hdr,
            hdr_view,
            ldr,
        }
    }
}
