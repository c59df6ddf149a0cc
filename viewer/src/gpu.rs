//! The adapter and device that draw. They are chosen once, and the headless renderer and the window share them. The
//! passes ask here what the adapter can do, so that they use 32-bit maps and targets only where these work.

use crate::error::{Error, Result};
use wgpu::{Backends, Features, Limits};

/// How to choose the adapter. The environment variable `WGPU_BACKEND` narrows the choice further.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// The graphics interface to use.
    pub backend: Backend,
    /// Keeps every map and target at 16 bits, as adapters without 32-bit filtering do.
    pub half_only: bool,
    /// Moves each vertex where it is drawn, even of what moves as a whole, and chooses on the CPU what a picture shows,
    /// as adapters without indirect draws do.
    pub plain: bool,
    /// Whether a group of invocations shares the work on each branch of a plant. Else GPUs do so, and software adapters
    /// do not.
    pub groups: Option<bool>,
}

/// A graphics interface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Backend {
    /// The first one that works.
    #[default]
    Any,
    /// Vulkan only.
    Vulkan,
    /// OpenGL only.
    Gl,
}

/// The adapter that draws.
#[derive(Debug, Clone, PartialEq)]
pub struct AdapterInfo {
    /// Name of the adapter, as the driver gives it.
    pub name: String,
    /// `vulkan`, `gl`, …
    pub backend: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Whether the CPU draws. Then frame times say nothing about a GPU.
    pub is_software: bool,
    /// Whether maps or radiance have 16 bits a channel, with a relative precision of about 5e-4.
    pub half_precision: bool,
}

/// An opened device and what it can do.
pub struct Gpu {
    /// The adapter that draws.
    pub adapter: wgpu::Adapter,
    /// Makes buffers, textures and pipelines.
    pub device: wgpu::Device,
    /// The queue that takes commands.
    pub queue: wgpu::Queue,
    /// The adapter in words.
    pub info: AdapterInfo,
    /// Format of the appearance maps, which has 32 bits where such maps can be filtered.
    pub(crate) map_format: wgpu::TextureFormat,
    /// Format of the radiance target without multisampling.
    pub(crate) hdr_format: wgpu::TextureFormat,
    pub(crate) timestamps: bool,
    /// Whether instances that move as wholes are moved by compute passes.
    pub(crate) places: bool,
    /// Whether the adapter chooses what a picture shows.
    pub(crate) chooses: bool,
    /// Whether groups of invocations share what there is to do for a branch.
    pub(crate) groups: bool,
}

/// Format of the radiance target with multisampling: the widest that every adapter resolves.
pub(crate) const MSAA_HDR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// What a program that draws requests of the system: the graphics interfaces that `options` and the environment allow.
pub fn instance_descriptor(options: &Options) -> wgpu::InstanceDescriptor {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = match options.backend {
        // A build for browsers has WebGPU alone, and any other build has not.
        Backend::Any => Backends::VULKAN | Backends::GL | Backends::BROWSER_WEBGPU,
        Backend::Vulkan => Backends::VULKAN,
        Backend::Gl => Backends::GL,
    };
    descriptor.with_env()
}

/// An instance without a window, from which [`Gpu::open`] opens what `options` and the environment allow. OpenGL is
/// only touched where Vulkan has no GPU: a driver needs time to open it, and one hung where several threads did so at
/// once.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn headless(options: &Options) -> wgpu::Instance {
    let by = |backend| wgpu::Instance::new(instance_descriptor(&Options { backend, ..*options }));
    if options.backend != Backend::Any || std::env::var_os("WGPU_BACKEND").is_some() {
        return by(options.backend);
    }
    // Whether an instance has a GPU; `None` where it has nothing.
    let gpu =
        |instance: &wgpu::Instance| Some(!is_software(&pollster::block_on(best(instance, None)).ok()?.get_info()));
    let vulkan = by(Backend::Vulkan);
    match gpu(&vulkan) {
        Some(true) => vulkan,
        None => by(Backend::Gl),
        Some(false) => Some(by(Backend::Gl)).filter(|gl| gpu(gl) == Some(true)).unwrap_or(vulkan),
    }
}

/// The best adapter of an instance; with a `surface`, one that can show pictures on it.
async fn best(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<wgpu::Adapter> {
    let request = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        force_fallback_adapter: false,
        compatible_surface: surface,
        apply_limit_buckets: false,
    };
    instance.request_adapter(&request).await.map_err(|_| Error::NoAdapter)
}

fn is_software(info: &wgpu::AdapterInfo) -> bool {
    info.device_type == wgpu::DeviceType::Cpu || info.name.to_lowercase().contains("llvmpipe")
}

impl Gpu {
    /// Opens the best adapter; with a `surface`, one that can show pictures on it.
    ///
    /// # Errors
    /// `NoAdapter` where nothing can draw, `Device` where the adapter refuses.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>, options: &Options) -> Result<Gpu> {
        pollster::block_on(Gpu::open_later(instance, surface, options))
    }

    /// As `open`, for programs that must not wait, such as a page in a browser.
    ///
    /// # Errors
    /// As `open`.
    pub async fn open_later(
        instance: &wgpu::Instance,
        surface: Option<&wgpu::Surface<'_>>,
        options: &Options,
    ) -> Result<Gpu> {
        let adapter = best(instance, surface).await?;
        let raw = adapter.get_info();
        let mut info = AdapterInfo {
            half_precision: false,
            is_software: is_software(&raw),
            backend: raw.backend.to_string(),
            driver: format!("{} {}", raw.driver, raw.driver_info).trim().to_string(),
            name: raw.name,
        };
        let wanted = Features::FLOAT32_FILTERABLE | Features::TIMESTAMP_QUERY | Features::INDIRECT_FIRST_INSTANCE;
        let features = adapter.features() & wanted;
        let offered = adapter.limits();
        let mut limits = Limits::default().using_resolution(offered.clone());
        limits.max_buffer_size = offered.max_buffer_size;
        limits.max_storage_buffer_binding_size = offered.max_storage_buffer_binding_size;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("mesophyll"),
            required_features: features,
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = adapter
            .request_device(&descriptor)
            .await
            .map_err(|error| Error::Device { adapter: info.name.clone(), reason: error.to_string() })?;
        let filterable = features.contains(Features::FLOAT32_FILTERABLE) && !options.half_only;
        let renderable = !options.half_only
            && adapter
                .get_texture_format_features(wgpu::TextureFormat::Rgba32Float)
                .allowed_usages
                .contains(wgpu::TextureUsages::RENDER_ATTACHMENT);
        info.half_precision = !(filterable && renderable);
        let pick = |wide| if wide { wgpu::TextureFormat::Rgba32Float } else { wgpu::TextureFormat::Rgba16Float };
        Ok(Gpu {
            map_format: pick(filterable),
            hdr_format: pick(renderable),
            timestamps: features.contains(Features::TIMESTAMP_QUERY),
            places: !options.plain,
            groups: options.groups.unwrap_or(!info.is_software),
            chooses: !options.plain
                && features.contains(Features::INDIRECT_FIRST_INSTANCE)
                && raw.backend != wgpu::Backend::Gl,
            adapter,
            device,
            queue,
            info,
        })
    }

    pub(crate) fn is_gl(&self) -> bool {
        self.adapter.get_info().backend == wgpu::Backend::Gl
    }

    /// Largest side of a texture or picture.
    pub fn max_side(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }

    pub(crate) fn max_layers(&self) -> u32 {
        self.device.limits().max_texture_array_layers
    }

    pub(crate) fn hdr_format(&self, msaa: u32) -> wgpu::TextureFormat {
        if msaa > 1 { MSAA_HDR_FORMAT } else { self.hdr_format }
    }

    pub(crate) fn uniform<T: bytemuck::Pod>(&self, label: &str, value: &[T]) -> wgpu::Buffer {
        self.buffer(label, bytemuck::cast_slice(value), wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)
    }

    pub(crate) fn buffer(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        use wgpu::util::DeviceExt;
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents: bytes, usage })
    }
}
