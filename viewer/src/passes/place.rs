//! Moves whole instances once for each picture, instead of each of their vertices in each pass: see `place.wgsl`. The
//! passes that draw then need not know the sections. What the adapter chooses for a picture, `choose.wgsl` moves as it
//! chooses.

use crate::geometry::Batch;
use crate::gpu::Gpu;
use crate::passes::bend::{self, BendPass, Carrier, Ride};
use crate::scene::{Instance, Scene};
use crate::shader::{Defines, assemble};
use crate::stats::RenderStatistics;
use wgpu::BufferUsages as Use;

/// Bytes of an instance's rows, and number of instances in a work group.
const ROWS: u64 = 48;
pub(crate) const WIDE: usize = 256;

/// The instances of a batch as their sections have moved them: all of them, those that are drawn enlarged, and those
/// that are drawn into shadow maps.
#[derive(Default)]
pub(crate) struct Placed {
    pub all: Option<wgpu::Buffer>,
    pub enlarged: Option<wgpu::Buffer>,
    pub thinned: Option<wgpu::Buffer>,
}

/// Moves instances.
pub(crate) struct PlacePass {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

/// Whether sections carry these instances as wholes, and the adapter can move them so. Where normals do not turn, each
/// vertex has to be moved.
pub(crate) fn whole(gpu: &Gpu, scene: &Scene, instances: &[Instance]) -> bool {
    gpu.places
        && scene.sections.as_ref().is_some_and(|s| s.turn_normals)
        && instances.iter().all(|i| i.carried.is_none_or(|c| c.vertices.is_none()))
        && within(&gpu.device.limits(), instances.len())
}

/// Whether so many instances stay within an adapter's limits.
pub(crate) fn within(limits: &wgpu::Limits, instances: usize) -> bool {
    ROWS * instances as u64 <= limits.max_storage_buffer_binding_size
        && instances.div_ceil(WIDE) <= limits.max_compute_workgroups_per_dimension as usize
}

impl PlacePass {
    pub(crate) fn new(gpu: &Gpu, bend: &BendPass, stats: &mut RenderStatistics) -> PlacePass {
        stats.pipeline("place");
        let defines = bend::defines(Defines::default(), Some(Ride::Instances), 0);
        let source = assemble(&[bend::SOURCE, include_str!("place.wgsl")].concat(), &defines);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("place"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let entry = |binding: u32| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: binding < 2 },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("place"),
            entries: &[entry(0), entry(1), entry(2)],
        });
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("place"),
            bind_group_layouts: &[Some(&layout), None, Some(bend.layout())],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("place"),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("place"),
            compilation_options: Default::default(),
            cache: None,
        });
        PlacePass { pipeline, layout }
    }

    /// Moves the instances of all batches that move as wholes, as far as a picture needs them, and shadow maps if these
    /// are drawn with it.
    pub(crate) fn all(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        batches: &mut [Batch],
        bend: &BendPass,
        maps: bool,
    ) {
        // A GPU needs time for a pass in which nothing is done, too.
        if !batches.iter().any(|batch| batch.places(maps)) {
            return;
        }
        let mut pass = encoder.begin_compute_pass(&Default::default());
        batches.iter_mut().for_each(|batch| batch.place(gpu, &mut pass, self, bend, maps));
    }

    /// Moves `count` instances, which have these rows and these rides.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        bend: &BendPass,
        (rows, rides, count): (&wgpu::Buffer, &wgpu::Buffer, u32),
        to: &mut Option<wgpu::Buffer>,
    ) {
        if count == 0 {
            return;
        }
        let size = ROWS * u64::from(count);
        if to.as_ref().is_none_or(|buffer| buffer.size() != size) {
            *to = None;
        }
        let to = to.get_or_insert_with(|| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("moved instances"),
                size,
                usage: Use::VERTEX | Use::STORAGE,
                mapped_at_creation: false,
            })
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("place"),
            layout: &self.layout,
            entries: &[
                begin_of(0, rows, size),
                begin_of(1, rides, (size_of::<Carrier>() * count as usize) as u64),
                begin_of(2, to, size),
            ],
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_bind_group(2, &bend.group, &[]);
        pass.dispatch_workgroups(count.div_ceil(WIDE as u32), 1, 1);
    }
}

/// Binds the first bytes of a buffer.
fn begin_of(binding: u32, buffer: &wgpu::Buffer, bytes: u64) -> wgpu::BindGroupEntry<'_> {
    let size = wgpu::BufferSize::new(bytes);
    wgpu::BindGroupEntry {
        binding,
        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With WebGPU's smallest limits, 128 MiB of rows are the most; with larger buffers, the number of work groups.
    #[test]
    fn too_many_instances_are_left_to_the_cpu() {
        let limits = wgpu::Limits::default();
        let most = (limits.max_storage_buffer_binding_size / 48) as usize;
        assert!(most > 2_700_000 && within(&limits, most) && !within(&limits, most + 1));
        let large = wgpu::Limits { max_storage_buffer_binding_size: u64::MAX, ..limits };
        assert!(within(&large, 256 * 65_535) && !within(&large, 256 * 65_535 + 1));
    }
}
