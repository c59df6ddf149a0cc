//! The viewer in a browser: the same renderer and the same shaders as in the window, on a canvas by WebGPU. The page
//! (`page/`) has the controls, and calls this.

use crate::bundle::{Bundle, BundleView, LeafSlabs};
use mesophyll_viewer::gpu::{Gpu, Options, instance_descriptor};
use mesophyll_viewer::scene::{Camera, Instance};
use mesophyll_viewer::{Error, OrbitCamera, Renderer, ball_around, wgpu};
use serde_json::json;
use std::sync::{Arc, Mutex, PoisonError};
use wasm_bindgen::prelude::*;
use web_sys::HtmlCanvasElement;

/// A canvas, and the scene that is drawn on it.
#[wasm_bindgen]
pub struct Viewer {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    blitter: wgpu::util::TextureBlitter,
    renderer: Renderer,
    shown: Option<Shown>,
    /// What the adapter refused last. It says so some time after the call that it refuses.
    refused: Arc<Mutex<Option<String>>>,
}

struct Shown {
    bundle: Bundle,
    orbit: OrbitCamera,
    /// Pixels of the picture.
    size: [u32; 2],
}

fn told(error: impl ToString) -> JsError {
    JsError::new(&error.to_string())
}

#[wasm_bindgen]
impl Viewer {
    /// Opens the browser's adapter for a canvas.
    pub async fn start(canvas: HtmlCanvasElement) -> Result<Viewer, JsError> {
        // A defect of this program reaches the page as an error with a sentence.
        std::panic::set_hook(Box::new(|defect| wasm_bindgen::throw_str(&defect.to_string())));
        let options = Options::default();
        let instance = wgpu::Instance::new(instance_descriptor(&options));
        let surface = instance.create_surface(wgpu::SurfaceTarget::Canvas(canvas)).map_err(told)?;
        let gpu = Gpu::open_later(&instance, Some(&surface), &options).await.map_err(|error| match error {
            Error::NoAdapter => {
                told("this browser gives WebGPU no graphics adapter; its page chrome://gpu may say why")
            }
            other => told(other),
        })?;
        let refused = Arc::new(Mutex::new(None));
        let note = |refused: &Mutex<Option<String>>, what: String| {
            *refused.lock().unwrap_or_else(PoisonError::into_inner) = Some(what);
        };
        let (of_error, of_loss) = (refused.clone(), refused.clone());
        gpu.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            note(&of_error, format!("the browser's graphics adapter refused: {error}"));
        }));
        gpu.device.set_device_lost_callback(move |_, why| {
            note(&of_loss, format!("the browser has taken the graphics adapter away ({why}); reload the page"));
        });
        let mut config =
            surface.get_default_config(&gpu.adapter, 1, 1).ok_or_else(|| told("this canvas shows nothing"))?;
        // The picture is already encoded as sRGB.
        config.format = config.format.remove_srgb_suffix();
        let blitter = wgpu::util::TextureBlitter::new(&gpu.device, config.format);
        Ok(Viewer { surface, config, blitter, renderer: Renderer::on(gpu), shown: None, refused })
    }

    /// What the adapter has refused, or why it was lost, since this was asked last.
    pub fn refused(&self) -> Option<String> {
        self.refused.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Opens the bytes of a file. It then describes it as JSON: `title`, `program`, `triangles`, `views` (each with
    /// `name`, `size` and `reference`, whether there is a picture), and `leaves` (each with `name` and `slabs`, which
    /// `edit` takes back).
    pub fn load(&mut self, bytes: &[u8]) -> Result<String, JsError> {
        let bundle = Bundle::read(bytes).map_err(told)?;
        self.renderer.set_scene(&bundle.scene).map_err(told)?;
        let view = |v: &BundleView| json!({"name": v.name, "size": v.size, "reference": v.reference.is_some()});
        let leaf = |l: &LeafSlabs| json!({"name": bundle.scene.materials[l.material].name(), "slabs": l});
        let triangles = |i: &Instance| bundle.scene.meshes[i.mesh].indices.len() / 3;
        let about = json!({
            "title": bundle.title,
            "program": bundle.program,
            "triangles": bundle.scene.instances.iter().map(triangles).sum::<usize>(),
            "views": bundle.views.iter().map(view).collect::<Vec<_>>(),
            "leaves": bundle.leaves.iter().map(leaf).collect::<Vec<_>>(),
        });
        let radius = ball_around(&bundle.scene).1;
        let first = &bundle.views[0];
        let (camera, size) = (first.camera, first.size);
        self.shown = Some(Shown { orbit: OrbitCamera::new(camera, radius), size, bundle });
        Ok(about.to_string())
    }

    /// Goes to the camera of a view.
    pub fn look(&mut self, view: usize) -> Result<(), JsError> {
        let shown = self.shown.as_mut().ok_or_else(|| told("no scene"))?;
        let view = shown.bundle.views.get(view).ok_or_else(|| told("no such view"))?;
        let radius = ball_around(&shown.bundle.scene).1;
        (shown.orbit, shown.size) = (OrbitCamera::new(view.camera, radius), view.size);
        Ok(())
    }

    /// The reference picture of a view, a PNG file.
    pub fn reference(&self, view: usize) -> Option<Vec<u8>> {
        self.shown.as_ref()?.bundle.views.get(view)?.reference.clone()
    }

    /// Turns the camera by angles (rad).
    pub fn turn(&mut self, right: f32, down: f32) {
        self.moved(|orbit| orbit.turn(right, down));
    }

    /// Moves the camera by shares of the picture's height.
    pub fn pan(&mut self, right: f32, down: f32) {
        self.moved(|orbit| orbit.pan(right, down));
    }

    /// Moves the camera closer by a factor.
    pub fn zoom(&mut self, factor: f32) {
        self.moved(|orbit| orbit.zoom(factor));
    }

    fn moved(&mut self, by: impl FnOnce(&mut OrbitCamera)) {
        if let Some(shown) = &mut self.shown {
            by(&mut shown.orbit);
        }
    }

    /// Computes a leaf's slabs again. `slabs` is JSON as `load` gives it, with other numbers.
    pub fn edit(&mut self, slabs: &str) -> Result<(), JsError> {
        let slabs: LeafSlabs = serde_json::from_str(slabs).map_err(told)?;
        let shown = self.shown.as_mut().ok_or_else(|| told("no scene"))?;
        let leaf = shown.bundle.scene.leaf_mut(slabs.material).ok_or_else(|| told("no such leaf"))?;
        slabs.apply(leaf).map_err(told)?;
        self.renderer.set_material(&shown.bundle.scene, slabs.material).map_err(told)
    }

    /// Draws the scene on the canvas.
    pub fn draw(&mut self) -> Result<(), JsError> {
        use wgpu::CurrentSurfaceTexture as Current;
        let Some(shown) = &self.shown else { return Ok(()) };
        let (camera, [width, height]): (Camera, _) = (shown.orbit.camera, shown.size);
        if [self.config.width, self.config.height] != shown.size {
            [self.config.width, self.config.height] = shown.size;
            self.surface.configure(&self.renderer.gpu().device, &self.config);
        }
        let picture = self.renderer.draw(&camera, width, height).map_err(told)?.clone();
        let target = match self.surface.get_current_texture() {
            Current::Success(target) | Current::Suboptimal(target) => target,
            Current::Timeout | Current::Occluded => return Ok(()),
            Current::Outdated | Current::Lost | Current::Validation => {
                return Err(told("the canvas takes no pictures; reload the page"));
            }
        };
        let gpu = self.renderer.gpu();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.blitter.copy(&gpu.device, &mut encoder, &picture, &target.texture.create_view(&Default::default()));
        gpu.queue.submit([encoder.finish()]);
        gpu.queue.present(target);
        Ok(())
    }
}
