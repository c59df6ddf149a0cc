//! Prepares appearance maps for the adapter: mip chains by averages that are weighted by the area on the leaf, so that
//! texels off the leaf hardly count, with 32 or 16 bits a channel. Texel centres lie at (i + ½)/W. Sampling is bilinear
//! and clamped.

use crate::gpu::Gpu;
use half::f16;

/// Weight of a texel off the leaf. It is small enough not to change colours on the leaf, and large enough to keep a
/// level defined where no texel is on the leaf.
const OFF_LEAF: f32 = 1e-5;

/// One level of a map, row-major, row 0 on top.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Level {
    pub width: u32,
    pub height: u32,
    pub texels: Vec<[f32; 4]>,
}

/// All levels of a map down to 1×1. `on_leaf` has the same columns as the map.
pub(crate) fn mip_chain(width: u32, height: u32, texels: Vec<[f32; 4]>, on_leaf: Option<&[u8]>) -> Vec<Level> {
    let mut weights: Vec<f32> = match on_leaf {
        Some(mask) => mask.iter().map(|m| if *m > 0 { 1.0 } else { OFF_LEAF }).collect(),
        None => vec![1.0; texels.len()],
    };
    let mut levels = vec![Level { width, height, texels }];
    while let Some(last) = levels.last()
        && (last.width > 1 || last.height > 1)
    {
        let (w, h) = ((last.width / 2).max(1), (last.height / 2).max(1));
        let mut texels = Vec::with_capacity((w * h) as usize);
        let mut next_weights = Vec::with_capacity((w * h) as usize);
        for y in 0..h {
            for x in 0..w {
                let (mut sum, mut weight, mut area) = ([0.0f32; 4], 0.0f32, 0.0f32);
                for (sy, wy) in footprint(y, h, last.height) {
                    for (sx, wx) in footprint(x, w, last.width) {
                        let i = (sy * last.width + sx) as usize;
                        let share = wx * wy * weights[i];
                        weight += share;
                        area += wx * wy;
                        for (s, t) in sum.iter_mut().zip(last.texels[i]) {
                            *s += share * t;
                        }
                    }
                }
                texels.push(sum.map(|s| s / weight));
                next_weights.push(weight / area);
            }
        }
        levels.push(Level { width: w, height: h, texels });
        weights = next_weights;
    }
    levels
}

/// The source texels under texel `i` of `n`, at most four, with the share that it covers of each.
fn footprint(i: u32, n: u32, source: u32) -> impl Iterator<Item = (u32, f32)> {
    let scale = source as f32 / n as f32;
    let (start, end) = (i as f32 * scale, (i + 1) as f32 * scale);
    let last = ((end - 1e-4).ceil() as u32).min(source);
    (start as u32..last)
        .map(move |s| (s, end.min((s + 1) as f32) - start.max(s as f32)))
        .filter(|(_, share)| *share > 1e-6)
}

/// A texture, and the number of bytes that were uploaded for it.
pub(crate) struct Uploaded {
    pub view: wgpu::TextureView,
    pub bytes: u64,
}

/// Uploads a map with its mips in the adapter's map format.
pub(crate) fn upload(gpu: &Gpu, label: &str, levels: &[Level]) -> Uploaded {
    write(gpu, label, &[levels], gpu.map_format)
}

/// Uploads maps of one size as the layers of one texture, with 16 bits a channel on every adapter. Rounding changes a
/// component by at most 2⁻¹¹ of itself. So a product with a unit vector has an error below 5e-4 of the texel's length.
pub(crate) fn upload_half(gpu: &Gpu, label: &str, layers: &[Vec<Level>]) -> Uploaded {
    let layers: Vec<&[Level]> = layers.iter().map(Vec::as_slice).collect();
    write(gpu, label, &layers, wgpu::TextureFormat::Rgba16Float)
}

/// Uploads a table that is read texel by texel, always with 32 bits.
pub(crate) fn upload_table(gpu: &Gpu, label: &str, table: Level) -> Uploaded {
    write(gpu, label, &[&[table]], wgpu::TextureFormat::Rgba32Float)
}

fn write(gpu: &Gpu, label: &str, layers: &[&[Level]], format: wgpu::TextureFormat) -> Uploaded {
    let base = &layers[0][0];
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: base.width, height: base.height, depth_or_array_layers: layers.len() as u32 },
        mip_level_count: layers[0].len() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut bytes = 0;
    for (layer, i, level) in
        layers.iter().enumerate().flat_map(|(k, levels)| levels.iter().enumerate().map(move |(i, l)| (k, i, l)))
    {
        let halves: Vec<[u16; 4]>;
        let data: &[u8] = if format == wgpu::TextureFormat::Rgba32Float {
            bytemuck::cast_slice(&level.texels)
        } else {
            let largest = f16::MAX.to_f32();
            halves =
                level.texels.iter().map(|t| t.map(|c| f16::from_f32(c.clamp(-largest, largest)).to_bits())).collect();
            bytemuck::cast_slice(&halves)
        };
        put(gpu, &texture, [layer as u32, i as u32], level.width, level.height, data);
        bytes += data.len() as u64;
    }
    Uploaded { view: texture.create_view(&Default::default()), bytes }
}

/// Uploads a mask (255 on the leaf) without mips, because coverage is sampled and must not be averaged.
pub(crate) fn upload_mask(gpu: &Gpu, label: &str, width: u32, height: u32, mask: &[u8]) -> Uploaded {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R8Unorm,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let data: Vec<u8> = mask.iter().map(|m| if *m > 0 { 255 } else { 0 }).collect();
    put(gpu, &texture, [0, 0], width, height, &data);
    Uploaded { view: texture.create_view(&Default::default()), bytes: data.len() as u64 }
}

fn put(gpu: &Gpu, texture: &wgpu::Texture, [layer, level]: [u32; 2], width: u32, height: u32, data: &[u8]) {
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: level,
            origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
            aspect: wgpu::TextureAspect::All,
        },
        data,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(data.len() as u32 / height),
            rows_per_image: Some(height),
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_keep_the_mean_at_odd_sizes() {
        let (w, h) = (7, 5);
        let texels: Vec<[f32; 4]> = (0..w * h).map(|i| [i as f32, 1.0, (i % 3) as f32, -2.0]).collect();
        let mean = |t: &[[f32; 4]], c: usize| t.iter().map(|x| x[c] as f64).sum::<f64>() / t.len() as f64;
        let chain = mip_chain(w, h, texels.clone(), None);
        let last = chain.last().expect("levels");
        assert_eq!((last.width, last.height), (1, 1));
        for c in 0..4 {
            assert!((mean(&texels, c) - mean(&last.texels, c)).abs() < 1e-4, "channel {c}");
        }
    }

    #[test]
    fn texels_off_the_leaf_do_not_bleed() {
        let mask = [1, 1, 0, 0];
        let texels = vec![[1.0; 4], [1.0; 4], [100.0; 4], [100.0; 4]];
        let chain = mip_chain(4, 1, texels, Some(&mask));
        assert!((chain[1].texels[0][0] - 1.0).abs() < 1e-6);
        assert!((chain[2].texels[0][0] - 1.0).abs() < 2e-3, "{}", chain[2].texels[0][0]);
    }
}
