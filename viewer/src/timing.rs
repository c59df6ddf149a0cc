//! Times of the passes by timestamp queries, where the adapter has them.

use crate::error::Result;
use crate::gpu::Gpu;
use crate::readback;
use mesophyll_base::statistics::percentile;

/// The passes, in the order of their pairs of timestamps.
pub(crate) const PASSES: [&str; 3] = ["shadow", "main", "tonemap"];

/// Times of repeated frames (ms).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameTiming {
    /// Time from submitting a frame to its end, with shadow maps that are kept, so as under a still sun.
    pub frame_ms: Vec<f64>,
    /// Times of each pass by the adapter's own clock; empty without timestamps. `shadow` has one entry, because the
    /// maps are drawn once.
    pub passes: Vec<(String, Vec<f64>)>,
}

impl FrameTiming {
    /// The value below which a share `q` of the frames lies (nearest rank); `None` without frames.
    pub fn quantile(&self, q: f64) -> Option<f64> {
        let mut sorted = self.frame_ms.clone();
        sorted.sort_by(f64::total_cmp);
        percentile(&sorted, q)
    }
}

pub(crate) struct Clock {
    pub queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
    period_ns: f64,
}

impl Clock {
    pub(crate) fn new(gpu: &Gpu) -> Option<Clock> {
        if !gpu.timestamps {
            return None;
        }
        let count = 2 * PASSES.len() as u32;
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: 8 * u64::from(count),
                usage,
                mapped_at_creation: false,
            })
        };
        Some(Clock {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
            period_ns: f64::from(gpu.queue.get_timestamp_period()),
        })
    }

    pub(crate) fn writes(&self, pass: u32) -> wgpu::RenderPassTimestampWrites<'_> {
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        }
    }

    /// Records the copy of the times of the passes `first..` to memory.
    pub(crate) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, first: u32) {
        encoder.resolve_query_set(&self.queries, 2 * first..2 * PASSES.len() as u32, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, self.readable.size());
    }

    /// Durations (ms) of the passes `first..` after the frame has ended.
    pub(crate) fn read(&self, gpu: &Gpu, first: u32) -> Result<Vec<f64>> {
        let bytes = readback::buffer(gpu, &self.readable)?;
        let ticks: Vec<u64> = bytes.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
        let pairs = ticks.as_chunks::<2>().0.iter().take(PASSES.len() - first as usize);
        Ok(pairs.map(|[start, end]| end.saturating_sub(*start) as f64 * self.period_ns * 1e-6).collect())
    }
}
