//! Draws the user interface, with the picture inside it, into a texture. This needs no display. Tests use it directly,
//! and the window copies the texture to the screen.

use crate::ui::{Job, ViewerUi};
use egui::TextureId;
use mesophyll_viewer::Renderer;
use mesophyll_viewer::gpu::{Gpu, Options, instance_descriptor};
use mesophyll_viewer::readback::TextureCopy;
use mesophyll_viewer::save_png;
use mesophyll_viewer::{Error, Result};
use std::path::Path;
use std::time::{Duration, Instant};

const CANVAS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// The renderer, the user interface, and the texture that both are drawn into.
pub struct WindowStage {
    pub(crate) renderer: Renderer,
    context: egui::Context,
    painter: egui_wgpu::Renderer,
    picture: TextureId,
    canvas: Option<(wgpu::Texture, wgpu::TextureView)>,
}

/// The tasks that a frame leaves to its caller.
pub struct FrameTasks {
    /// Requests of the user interface to the desktop: the pointer's shape, the clipboard.
    pub platform: egui::PlatformOutput,
    /// The time until the next frame is due; `Duration::MAX` when nothing moves.
    pub repaint_after: Duration,
}

impl WindowStage {
    /// A stage without a window.
    ///
    /// # Errors
    /// As `Renderer::headless`.
    pub fn headless(options: &Options) -> Result<WindowStage> {
        let instance = wgpu::Instance::new(instance_descriptor(options));
        Ok(WindowStage::on(Gpu::open(&instance, None, options)?))
    }

    pub(crate) fn on(gpu: Gpu) -> WindowStage {
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        let mut painter = egui_wgpu::Renderer::new(&gpu.device, CANVAS, options);
        let blank = texture(&gpu, [1, 1]);
        let view = blank.create_view(&Default::default());
        let picture = painter.register_native_texture(&gpu.device, &view, wgpu::FilterMode::Linear);
        let context = egui::Context::default();
        context.set_theme(egui::Theme::Dark);
        context.all_styles_mut(|style| {
            style.text_styles.insert(egui::TextStyle::Small, egui::FontId::proportional(11.0));
            style.visuals.weak_text_color = Some(egui::Color32::from_gray(150));
            style.visuals.widgets.noninteractive.fg_stroke.color = egui::Color32::from_gray(200);
        });
        WindowStage { renderer: Renderer::on(gpu), context, painter, picture, canvas: None }
    }

    /// The user interface's memory.
    pub fn context(&self) -> &egui::Context {
        &self.context
    }

    /// The renderer of the live picture.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// Does the work that the previous frame announced, and then draws one frame of `pixels` into the canvas.
    pub fn frame(&mut self, state: &mut ViewerUi, input: egui::RawInput, pixels: [u32; 2]) -> Result<FrameTasks> {
        let limit = self.renderer.gpu().max_side();
        if pixels.iter().any(|side| *side == 0 || *side > limit) {
            return Err(Error::Size { what: "window".into(), width: pixels[0], height: pixels[1], limit });
        }
        self.work(state)?;
        let picture = self.picture;
        let output = self.context.clone().run_ui(input, |ui| state.show(ui, picture));
        let mut textures = output.textures_delta;
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                self.painter.update_texture(&self.renderer.gpu().device, &self.renderer.gpu().queue, id, delta);
            }
        }
        let unused: Vec<TextureId> = textures.free.drain().collect();
        let following = state.follow_sun();
        self.draw_picture(state)?;

        let gpu = self.renderer.gpu();
        if self.canvas.as_ref().is_none_or(|(t, _)| [t.width(), t.height()] != pixels) {
            let canvas = texture(gpu, pixels);
            let view = canvas.create_view(&Default::default());
            self.canvas = Some((canvas, view));
        }
        let Some((_, view)) = &self.canvas else { return Err(Error::Window("no canvas".into())) };
        let jobs = self.context.tessellate(output.shapes, output.pixels_per_point);
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: pixels, pixels_per_point: output.pixels_per_point };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut commands = self.painter.update_buffers(&gpu.device, &gpu.queue, &mut encoder, &jobs, &screen);
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("user interface"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        self.painter.render(&mut pass.forget_lifetime(), &jobs, &screen);
        commands.push(encoder.finish());
        gpu.queue.submit(commands);
        for id in &unused {
            self.painter.free_texture(id);
        }
        let asked = output.viewport_output.values().map(|v| v.repaint_delay).min().unwrap_or(Duration::MAX);
        let more = state.job.is_some() || !state.is_drawn() || following || state.continuous();
        Ok(FrameTasks { platform: output.platform_output, repaint_after: if more { Duration::ZERO } else { asked } })
    }

    /// Does the work that the previous frame announced.
    fn work(&mut self, state: &mut ViewerUi) -> Result<()> {
        let Some(job) = state.job.take() else { return Ok(()) };
        self.take_over(state)?;
        match job {
            Job::Check => {
                let [width, height] = state.check_size();
                // The reference knows no backdrop, because it lights nothing.
                self.renderer.show_backdrop(false);
                self.renderer.show_plain(true);
                let picture = self.renderer.render(&state.camera(), width, height);
                self.renderer.show_plain(false);
                self.renderer.show_backdrop(state.view.backdrop_shown);
                let picture = picture?;
                state.finish_check(&self.context, &picture);
            }
            Job::Screenshot => {
                let [width, height] = state.view.picture_size;
                let picture = self.renderer.render(&state.live_camera(), width, height)?;
                state.finish_screenshot(&picture);
            }
            Job::Kept => {
                let Some(kept) = state.kept_edits() else { return Ok(()) };
                let [width, height] = state.view.picture_size;
                let now = state.edits().clone();
                state.restore(&kept);
                self.take_over(state)?;
                let picture = self.renderer.render(&state.live_camera(), width, height)?;
                state.restore(&now);
                state.finish_kept(&self.context, &picture);
            }
            Job::Analyse => {
                // This is the live picture once more, in its own size, so it needs not be drawn again.
                let [width, height] = state.view.picture_size;
                let picture = self.renderer.render(&state.live_camera(), width, height)?;
                state.finish_analysis(&self.context, picture);
                return Ok(());
            }
        }
        // That picture had another size or another state, so the live one must be drawn again.
        state.made.drawn = None;
        Ok(())
    }

    /// Uploads what the user has changed. A scene that cannot be drawn is an error only at the start.
    fn take_over(&mut self, state: &mut ViewerUi) -> Result<()> {
        let versions = &state.made.versions;
        let before = state.made.uploaded.replace(versions.now).filter(|before| versions.scene <= *before);
        let Some(before) = before else { return self.renderer.set_scene(&state.made.scene) };
        let (timed, lit) = (versions.time > before, versions.lights > before);
        for leaf in versions.leaves_since(before) {
            if let Err(error) = self.renderer.set_material(&state.made.scene, leaf) {
                state.say(error.to_string());
            }
        }
        if let (true, Some(wind)) = (timed, &state.made.scene.wind) {
            self.renderer.set_time(wind);
        }
        if lit {
            self.renderer.set_lights(&state.made.scene)?;
        }
        Ok(())
    }

    /// Draws the picture if something has changed, and measures the time.
    fn draw_picture(&mut self, state: &mut ViewerUi) -> Result<()> {
        self.take_over(state)?;
        if state.is_drawn() && !state.continuous() {
            return Ok(());
        }
        self.renderer.show_backdrop(state.view.backdrop_shown);
        let start = Instant::now();
        let [width, height] = state.live_size();
        let device = self.renderer.gpu().device.clone();
        let view = self.renderer.draw(&state.live_camera(), width, height)?;
        self.painter.update_egui_texture_from_wgpu_texture(&device, view, wgpu::FilterMode::Linear, self.picture);
        state.drawn(start.elapsed().as_secs_f64() * 1e3);
        Ok(())
    }

    pub(crate) fn canvas_view(&self) -> Option<&wgpu::TextureView> {
        self.canvas.as_ref().map(|(_, view)| view)
    }

    /// The canvas's pixels: width, height and RGBA, row 0 on top.
    pub fn pixels(&self) -> Result<(u32, u32, Vec<[u8; 4]>)> {
        let Some((canvas, _)) = &self.canvas else { return Err(Error::Readback("nothing has been drawn yet".into())) };
        let gpu = self.renderer.gpu();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let copy = TextureCopy::record(gpu, &mut encoder, canvas);
        gpu.queue.submit([encoder.finish()]);
        Ok((canvas.width(), canvas.height(), copy.bytes(gpu)?))
    }

    /// Writes the canvas as PNG.
    pub fn save_png(&self, path: &Path) -> Result<()> {
        let (width, height, mut pixels) = self.pixels()?;
        pixels.iter_mut().for_each(|p| p[3] = 255);
        save_png(path, width, height, pixels.as_flattened())
    }
}

fn texture(gpu: &Gpu, [width, height]: [u32; 2]) -> wgpu::Texture {
    use wgpu::TextureUsages as Use;
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("canvas"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: CANVAS,
        usage: Use::RENDER_ATTACHMENT | Use::TEXTURE_BINDING | Use::COPY_SRC,
        view_formats: &[],
    })
}
