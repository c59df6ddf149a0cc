//! Copies textures back to memory. Rows are padded on the adapter and packed here.

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use half::f16;

/// A copy from a texture into a buffer that is under way.
pub struct TextureCopy {
    buffer: wgpu::Buffer,
    row: usize,
    padded: usize,
    format: wgpu::TextureFormat,
}

fn failed(error: impl ToString) -> Error {
    Error::Readback(error.to_string())
}

/// Waits until the adapter has done everything submitted so far.
///
/// # Errors
/// `Readback` where the adapter was lost.
pub fn wait(gpu: &Gpu) -> Result<()> {
    wait_for(gpu, None)
}

/// Waits until the adapter has done a submission; without one, the last one.
pub(crate) fn wait_for(gpu: &Gpu, submission_index: Option<wgpu::SubmissionIndex>) -> Result<()> {
    gpu.device.poll(wgpu::PollType::Wait { submission_index, timeout: None }).map(|_| ()).map_err(failed)
}

/// All bytes of a buffer that can be mapped.
pub(crate) fn buffer(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>> {
    let (sender, receiver) = std::sync::mpsc::channel();
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver exists until the result has arrived. If it were gone, there would be nobody to tell.
        let _ = sender.send(result);
    });
    wait(gpu)?;
    receiver.recv().map_err(failed)?.map_err(failed)?;
    let bytes = buffer.get_mapped_range(..).map_err(failed)?.to_vec();
    buffer.unmap();
    Ok(bytes)
}

impl TextureCopy {
    /// Records the copy of a whole texture.
    pub fn record(gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) -> TextureCopy {
        let texel = texture.format().block_copy_size(None).unwrap_or(4) as usize;
        let row = texture.width() as usize * texel;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: (padded * texture.height() as usize) as u64,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded as u32),
                    rows_per_image: Some(texture.height()),
                },
            },
            texture.size(),
        );
        TextureCopy { buffer, row, padded, format: texture.format() }
    }

    fn packed(&self, gpu: &Gpu) -> Result<Vec<u8>> {
        let bytes = buffer(gpu, &self.buffer)?;
        Ok(bytes.chunks(self.padded).flat_map(|r| r[..self.row].iter().copied()).collect())
    }

    /// Texels of an 8-bit texture, row-major.
    ///
    /// # Errors
    /// `Readback` where the adapter was lost.
    pub fn bytes(&self, gpu: &Gpu) -> Result<Vec<[u8; 4]>> {
        Ok(self.packed(gpu)?.as_chunks::<4>().0.to_vec())
    }

    /// Texels of a 16- or 32-bit float texture.
    pub(crate) fn floats(&self, gpu: &Gpu) -> Result<Vec<[f32; 4]>> {
        let bytes = self.packed(gpu)?;
        if self.format == wgpu::TextureFormat::Rgba32Float {
            let value = |b: &[u8; 4]| f32::from_le_bytes(*b);
            let texels = bytes.as_chunks::<16>().0.iter();
            return Ok(texels.map(|t| std::array::from_fn(|c| value(&t.as_chunks::<4>().0[c]))).collect());
        }
        let value = |b: &[u8; 2]| f16::from_le_bytes(*b).to_f32();
        let texels = bytes.as_chunks::<8>().0.iter();
        Ok(texels.map(|t| std::array::from_fn(|c| value(&t.as_chunks::<2>().0[c]))).collect())
    }
}
