//! The window on screen: it gets events from winit and shows the stage's texture.

use crate::editor::Editor;
use crate::stage::WindowStage;
use crate::ui::{ViewerUi, WindowScene};
use mesophyll_viewer::gpu::{Gpu, Options, instance_descriptor};
use mesophyll_viewer::{Error, Result};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

/// How a window opens and, in scripts, when it closes.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// The adapter that draws.
    pub gpu: Options,
    /// Inner size of the window (pixels).
    pub size: [u32; 2],
    /// Closes the window after this many frames.
    pub frames: Option<u32>,
    /// Writes the window's contents as PNG to this path, before `frames` closes it.
    pub screenshot: Option<PathBuf>,
}

impl Default for WindowOptions {
    fn default() -> Self {
        WindowOptions { gpu: Options::default(), size: [1360, 800], frames: None, screenshot: None }
    }
}

/// Opens a window on a scene and returns when it is closed.
///
/// # Errors
/// `Window` where there is no display, `NoAdapter` where nothing can draw, `Scene` where the scene contradicts itself.
pub fn open_window(scene: WindowScene, editor: Box<dyn Editor>, options: &WindowOptions) -> Result<()> {
    let events = event_loop()?;
    let start = Start { scene, editor };
    let mut app = App { options: options.clone(), start: Some(start), running: None, failed: None, frames: 0 };
    events.run_app(&mut app).map_err(|e| Error::Window(reason(&e.to_string()).into()))?;
    app.failed.map_or(Ok(()), Err)
}

#[cfg(target_os = "linux")]
fn event_loop() -> Result<EventLoop<()>> {
    use winit::platform::{wayland::EventLoopBuilderExtWayland, x11::EventLoopBuilderExtX11};
    let mut builder = EventLoop::builder();
    // Off the main thread, winit would panic instead of returning an error. Both systems allow other threads.
    EventLoopBuilderExtX11::with_any_thread(&mut builder, true);
    EventLoopBuilderExtWayland::with_any_thread(&mut builder, true);
    builder.build().map_err(|e| Error::Window(no_display(&e.to_string())))
}

#[cfg(not(target_os = "linux"))]
fn event_loop() -> Result<EventLoop<()>> {
    EventLoop::new().map_err(|e| Error::Window(no_display(&e.to_string())))
}

/// The reason in an error of winit, without the place in winit's own source that precedes it (`os error at PATH:LINE:
/// REASON`).
fn reason(told: &str) -> &str {
    let reason =
        told.strip_prefix("os error at ").and_then(|rest| rest.split_once(": ")).map_or(told, |(_, reason)| reason);
    reason.trim_end_matches('.')
}

fn no_display(told: &str) -> String {
    format!("there is no display here ({})", reason(told))
}

struct Start {
    scene: WindowScene,
    editor: Box<dyn Editor>,
}

struct App {
    options: WindowOptions,
    start: Option<Start>,
    running: Option<Running>,
    failed: Option<Error>,
    frames: u32,
}

struct Running {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    blitter: wgpu::util::TextureBlitter,
    stage: WindowStage,
    input: egui_winit::State,
    state: ViewerUi,
}

impl Running {
    fn new(events: &ActiveEventLoop, start: Start, options: &WindowOptions) -> Result<Running> {
        let failed = |reason: String| Error::Window(reason);
        // The window is no larger than the screen. Without a window manager to make it fit, panels beyond its edge
        // could not be reached.
        let screen = events.primary_monitor().or_else(|| events.available_monitors().next()).map(|m| m.size());
        let within = |wanted: u32, most: Option<u32>| most.filter(|m| *m > 0).map_or(wanted, |m| wanted.min(m));
        let [width, height] =
            [within(options.size[0], screen.map(|s| s.width)), within(options.size[1], screen.map(|s| s.height))];
        let attributes = Window::default_attributes()
            .with_title(format!("Mesophyll: {}", start.scene.title))
            .with_inner_size(PhysicalSize::new(width, height));
        let window = Arc::new(events.create_window(attributes).map_err(|e| failed(reason(&e.to_string()).into()))?);
        let mut descriptor = instance_descriptor(&options.gpu);
        descriptor.display = Some(Box::new(events.owned_display_handle()));
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance.create_surface(window.clone()).map_err(|e| failed(e.to_string()))?;
        let gpu = Gpu::open(&instance, Some(&surface), &options.gpu)?;
        let capabilities = surface.get_capabilities(&gpu.adapter);
        // The canvas already contains encoded sRGB. A format that would encode it again is taken only if there is no
        // other.
        let plain = capabilities.formats.iter().copied().find(|f| !f.is_srgb());
        let format = plain
            .or_else(|| capabilities.formats.first().copied())
            .ok_or_else(|| failed(format!("adapter {} shows nothing on this display", gpu.info.name)))?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&gpu.adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| failed(format!("adapter {} does not fit this display", gpu.info.name)))?;
        config.format = format;
        surface.configure(&gpu.device, &config);
        let blitter = wgpu::util::TextureBlitter::new(&gpu.device, format);
        let state = ViewerUi::new(start.scene, start.editor, &gpu.info);
        let max_side = gpu.max_side() as usize;
        let stage = WindowStage::on(gpu);
        let id = egui::ViewportId::ROOT;
        let scale = Some(window.scale_factor() as f32);
        let input = egui_winit::State::new(stage.context().clone(), id, &window, scale, window.theme(), Some(max_side));
        Ok(Running { window, surface, config, blitter, stage, input, state })
    }

    /// Draws and shows one frame. Returns the time until the next one is due.
    fn frame(&mut self) -> Result<Duration> {
        let size = self.window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Ok(Duration::MAX);
        }
        let pixels = [size.width, size.height];
        if [self.config.width, self.config.height] != pixels {
            [self.config.width, self.config.height] = pixels;
            self.surface.configure(&self.stage.renderer.gpu().device, &self.config);
        }
        let input = self.input.take_egui_input(&self.window);
        let shown = self.stage.frame(&mut self.state, input, pixels)?;
        self.input.handle_platform_output(&self.window, shown.platform);
        use wgpu::CurrentSurfaceTexture as Current;
        let target = match self.surface.get_current_texture() {
            Current::Success(target) | Current::Suboptimal(target) => target,
            Current::Timeout | Current::Occluded => return Ok(Duration::from_millis(50)),
            Current::Outdated | Current::Lost => {
                self.surface.configure(&self.stage.renderer.gpu().device, &self.config);
                return Ok(Duration::ZERO);
            }
            Current::Validation => return Err(Error::Window("the display refused the next frame".into())),
        };
        let gpu = self.stage.renderer.gpu();
        if let Some(canvas) = self.stage.canvas_view() {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let view = target.texture.create_view(&Default::default());
            self.blitter.copy(&gpu.device, &mut encoder, canvas, &view);
            gpu.queue.submit([encoder.finish()]);
        }
        self.window.pre_present_notify();
        gpu.queue.present(target);
        Ok(shown.repaint_after)
    }
}

impl App {
    fn fail(&mut self, events: &ActiveEventLoop, error: Error) {
        self.failed = Some(error);
        events.exit();
    }

    fn redraw(&mut self, events: &ActiveEventLoop) {
        let Some(running) = &mut self.running else { return };
        let due = match running.frame() {
            Ok(due) => due,
            Err(error) => return self.fail(events, error),
        };
        self.frames += 1;
        if self.options.frames.is_some_and(|most| self.frames >= most) {
            let saved = self.options.screenshot.as_ref().map_or(Ok(()), |path| running.stage.save_png(path));
            match saved {
                Ok(()) => events.exit(),
                Err(error) => self.fail(events, error),
            }
            return;
        }
        // A script that counts frames must not wait until somebody moves the pointer.
        if due.is_zero() || self.options.frames.is_some() {
            running.window.request_redraw();
        } else if let Some(at) = Instant::now().checked_add(due) {
            events.set_control_flow(ControlFlow::WaitUntil(at));
        } else {
            events.set_control_flow(ControlFlow::Wait);
        }
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let Some(start) = self.start.take() else { return };
        match Running::new(events, start, &self.options) {
            Ok(running) => {
                running.window.request_redraw();
                self.running = Some(running);
            }
            Err(error) => self.fail(events, error),
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(running)) = (cause, &self.running) {
            running.window.request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(running) = &mut self.running else { return };
        let response = running.input.on_window_event(&running.window, &event);
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => self.redraw(events),
            _ if response.repaint => running.window.request_redraw(),
            _ => {}
        }
    }
}
