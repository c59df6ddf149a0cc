//! Errors of the adapter, such as lack of memory or a shader that the driver refuses, while a scene is uploaded.

use crate::error::Result;
use crate::gpu::Gpu;

/// Turns the adapter's errors into errors of the renderer.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) struct Guard {
    memory: wgpu::ErrorScopeGuard,
    validation: wgpu::ErrorScopeGuard,
}

#[cfg(not(target_arch = "wasm32"))]
impl Guard {
    /// Catches the adapter's errors from here on, until `finish`.
    pub(crate) fn new(gpu: &Gpu) -> Guard {
        Guard {
            memory: gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory),
            validation: gpu.device.push_error_scope(wgpu::ErrorFilter::Validation),
        }
    }

    pub(crate) fn finish(self, gpu: &Gpu) -> Result<()> {
        let validation = pollster::block_on(self.validation.pop());
        let memory = pollster::block_on(self.memory.pop());
        match memory.or(validation) {
            None => Ok(()),
            Some(error) => Err(crate::Error::Device { adapter: gpu.info.name.clone(), reason: error.to_string() }),
        }
    }
}

/// A page must not wait for the adapter, so a browser's errors arrive later, at the handler that the page gives to
/// [`wgpu::Device::on_uncaptured_error`].
#[cfg(target_arch = "wasm32")]
pub(crate) struct Guard;

#[cfg(target_arch = "wasm32")]
impl Guard {
    pub(crate) fn new(_: &Gpu) -> Guard {
        Guard
    }

    pub(crate) fn finish(self, _: &Gpu) -> Result<()> {
        Ok(())
    }
}
