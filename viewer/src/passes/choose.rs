//! Chooses on the adapter which instances a picture shows, how much enlarged, and at which levels of detail, and draws
//! them indirectly: see `choose.wgsl`. `thin.rs` and `detail.rs` choose in the same way on the CPU, where the adapter
//! cannot, and where vertices move by themselves.

use crate::detail::PIXELS;
use crate::error::Result;
use crate::geometry::Batch;
use crate::gpu::Gpu;
use crate::passes::bend::{self, BendPass, RIGID, Ride};
use crate::passes::main::Frame;
use crate::passes::place::{self, WIDE};
use crate::shader::{Defines, assemble};
use crate::stats::RenderStatistics;
use crate::thinning::{FADE, FEWEST, MANY, Seen};
use std::collections::HashMap;
use wgpu::BufferUsages as Use;

/// Most levels of detail that may be lit.
const LEVELS: usize = 8;
/// Bytes of a draw, and distance of the draws of two batches, which suits every adapter.
const DRAW: u64 = 20;
const STRIDE: u64 = 256;

/// The constants of a batch for the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Plan {
    camera: [[f32; 4]; 4],
    ball: [f32; 4],
    reach: [f32; 4],
    numbers: [u32; 4],
    levels: [[u32; 4]; LEVELS],
}

/// Chooses for all batches of a scene for which the adapter can.
pub(crate) struct ChoosePass {
    /// The kernels `choose`, `sum_up` and `gather` of each kind of batch, by whether its instances have beginnings and
    /// whether sections carry them.
    pipelines: HashMap<(bool, bool), [wgpu::ComputePipeline; 3]>,
    /// The largest distance between the surface that is drawn and the surface in the shadow maps.
    apart: wgpu::Buffer,
    draws: wgpu::Buffer,
}

/// What is chosen of a batch.
pub(crate) struct Choice {
    /// The chosen instances, and their first rows of arriving light and first shares of the sun.
    pub rows: wgpu::Buffer,
    pub begins: Option<wgpu::Buffer>,
    plan: wgpu::Buffer,
    ranks: wgpu::Buffer,
    balls: wgpu::Buffer,
    choices: wgpu::Buffer,
    counts: wgpu::Buffer,
    /// The draws of all batches, the place of this batch's first one, and their number.
    draws: wgpu::Buffer,
    first: u64,
    levels: usize,
    /// The groups of the kernels, from the first picture on.
    groups: Option<[wgpu::BindGroup; 3]>,
}

/// Whether the adapter can choose from a batch, and whether that is worth while: it is where instances move, and where
/// they are many.
fn chooses(gpu: &Gpu, batch: &Batch) -> bool {
    gpu.chooses
        && batch.variant.bend.is_none()
        && batch.stand.is_none()
        && batch.levels.lit().len() <= LEVELS
        && (batch.moving_whole().is_some() || batch.count as usize >= MANY)
        && place::within(&gpu.device.limits(), batch.count as usize)
}

impl ChoosePass {
    /// Makes what the batches need for which the adapter chooses; `None` if there is none.
    pub(crate) fn new(gpu: &Gpu, batches: &mut [Batch], stats: &mut RenderStatistics) -> Option<ChoosePass> {
        let own: Vec<&mut Batch> = batches.iter_mut().filter(|b| chooses(gpu, b)).collect();
        if own.is_empty() {
            return None;
        }
        stats.pipeline("choose");
        let kernels = |begins: bool, moves: bool| {
            let defines = bend::defines(Defines::default(), moves.then_some(Ride::Instances), 0)
                .constant("LEVELS", LEVELS as u32)
                .set("BEGINS", begins);
            let numbers = format!(
                "const WIDE: f32 = {:?};\nconst FADE: f32 = {FADE:?};\nconst FEWEST: f32 = {FEWEST:?};\n",
                crate::thinning::WIDE
            );
            let source = assemble(&[RIGID, include_str!("choose.wgsl")].concat(), &defines);
            let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("choose"),
                source: wgpu::ShaderSource::Wgsl((numbers + &source).into()),
            });
            ["choose", "sum_up", "gather"].map(|entry| {
                gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry),
                    layout: None,
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    cache: None,
                })
            })
        };
        let mut pipelines = HashMap::new();
        for batch in &own {
            let (begins, moves) = kind(batch);
            pipelines.entry((begins, moves)).or_insert_with(|| kernels(begins, moves));
        }
        let draws = made(gpu, "draws", STRIDE * own.len() as u64, Use::INDIRECT | Use::COPY_SRC);
        for (k, batch) in own.into_iter().enumerate() {
            batch.choice = Some(Choice::new(gpu, batch, &draws, k as u64 * STRIDE, stats));
        }
        Some(ChoosePass {
            pipelines,
            apart: made(gpu, "largest distance between levels", 4, Use::COPY_SRC | Use::COPY_DST),
            draws,
        })
    }

    /// Chooses for a picture among instances as `bend` moves them. `apart` is the largest distance between levels that
    /// the CPU knows of; shadow maps have texels of this side.
    #[expect(clippy::too_many_arguments, reason = "a pass is recorded from what different owners hold")]
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        batches: &mut [Batch],
        bend: Option<&BendPass>,
        seen: &Seen,
        texel: f32,
        apart: f32,
    ) {
        gpu.queue.write_buffer(&self.apart, 0, bytemuck::bytes_of(&apart));
        let mut pass = encoder.begin_compute_pass(&Default::default());
        for batch in batches {
            let Some(mut choice) = batch.choice.take() else { continue };
            let plan = plan(batch, seen, texel);
            gpu.queue.write_buffer(&choice.plan, 0, bytemuck::bytes_of(&plan));
            if let Some(pipelines) = self.pipelines.get(&kind(batch)) {
                let bound =
                    choice.groups.take().unwrap_or_else(|| choice.bind(gpu, batch, bend, pipelines, &self.apart));
                let wide = plan.numbers[1];
                for ((pipeline, group), count) in pipelines.iter().zip(&bound).zip([wide, 1, wide]) {
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(0, group, &[]);
                    pass.dispatch_workgroups(count, 1, 1);
                }
                choice.groups = Some(bound);
            }
            batch.choice = Some(choice);
        }
    }

    /// Writes the largest distance between levels into a frame's constants.
    pub(crate) fn apart(&self, encoder: &mut wgpu::CommandEncoder, frame: &wgpu::Buffer) {
        let to = std::mem::offset_of!(Frame, shadow) as u64 + 4;
        encoder.copy_buffer_to_buffer(&self.apart, 0, frame, to, 4);
    }

    /// The draws of the last picture: number of indices, number of instances, first index, 0, first instance.
    pub(crate) fn draws(&self, gpu: &Gpu) -> Result<Vec<[u32; 5]>> {
        let bytes = read(gpu, &self.draws)?;
        let own = |k: usize| (0..LEVELS).map(move |level| (k * STRIDE as usize) + level * DRAW as usize);
        let places = (0..bytes.len() / STRIDE as usize).flat_map(own);
        Ok(places.map(|at| bytemuck::pod_read_unaligned(&bytes[at..at + DRAW as usize])).collect())
    }
}

/// Whether the instances of a batch have beginnings, and whether sections carry them.
fn kind(batch: &Batch) -> (bool, bool) {
    (batch.begins.is_some(), batch.moving_whole().is_some())
}

/// The constants of a batch for a picture.
fn plan(batch: &Batch, seen: &Seen, texel: f32) -> Plan {
    let (levels, (centre, radius)) = (&batch.levels, batch.levels.around());
    let (camera, [x, y]) = seen.in_numbers();
    let flags = u32::from(!levels.ranks().is_empty()) | u32::from(levels.several()) << 1;
    let lit = levels.lit().len() as u32;
    let mut all = [[0; 4]; LEVELS];
    for (to, (indices, error)) in all.iter_mut().zip(levels.lit()) {
        *to = [error.to_bits(), indices.start, indices.len() as u32, 0];
    }
    Plan {
        camera,
        ball: centre.extend(radius).to_array(),
        reach: [x, y, levels.apart_in_maps(texel), PIXELS],
        numbers: [batch.count, batch.count.div_ceil(WIDE as u32), lit, flags],
        levels: all,
    }
}

impl Choice {
    fn new(gpu: &Gpu, batch: &Batch, draws: &wgpu::Buffer, first: u64, stats: &mut RenderStatistics) -> Choice {
        let n = u64::from(batch.count);
        let ranks = batch.levels.ranks();
        stats.upload(&format!("ranks of mesh {}", batch.mesh), size_of_val(ranks) as u64);
        let balls = batch.levels.balls();
        stats.upload(&format!("balls of mesh {}", batch.mesh), size_of_val(&balls[..]) as u64);
        let ranks = if ranks.is_empty() { &[0.0; 4] } else { ranks };
        let begins = batch.begins.is_some();
        Choice {
            rows: made(gpu, "chosen instances", 48 * n, Use::VERTEX | Use::COPY_SRC),
            begins: begins.then(|| made(gpu, "chosen beginnings", 8 * n, Use::VERTEX)),
            plan: made(gpu, "plan of a choice", size_of::<Plan>() as u64, Use::UNIFORM | Use::COPY_DST),
            ranks: gpu.buffer("ranks", bytemuck::cast_slice(ranks), Use::STORAGE),
            balls: gpu.buffer("balls", bytemuck::cast_slice(&balls), Use::STORAGE),
            choices: made(gpu, "choices", 8 * n, Use::empty()),
            counts: made(gpu, "counts of groups", 4 * LEVELS as u64 * n.div_ceil(WIDE as u64), Use::empty()),
            draws: draws.clone(),
            first,
            levels: batch.levels.lit().len(),
            groups: None,
        }
    }

    /// Binds what each kernel reads and writes.
    fn bind(
        &self,
        gpu: &Gpu,
        batch: &Batch,
        bend: Option<&BendPass>,
        pipelines: &[wgpu::ComputePipeline; 3],
        apart: &wgpu::Buffer,
    ) -> [wgpu::BindGroup; 3] {
        let rides = batch.moving_whole();
        let own = wgpu::BufferBinding {
            buffer: &self.draws,
            offset: self.first,
            size: wgpu::BufferSize::new(DRAW * LEVELS as u64),
        };
        let whole = |buffer: Option<&'_ wgpu::Buffer>, binding: u32| buffer.map(|b| (binding, b.clone()));
        let all: Vec<(u32, wgpu::Buffer)> = [
            whole(Some(&self.plan), 0),
            whole(Some(&batch.instances), 1),
            whole(Some(&self.ranks), 2),
            whole(Some(&self.choices), 3),
            whole(Some(&self.counts), 4),
            whole(Some(apart), 6),
            whole(Some(&self.rows), 7),
            whole(batch.begins.as_ref(), 8),
            whole(self.begins.as_ref(), 9),
            whole(Some(&self.balls), 10),
            whole(rides, 11),
            whole(bend.filter(|_| rides.is_some()).map(|b| &b.sections), 12),
        ]
        .into_iter()
        .flatten()
        .collect();
        let reads: [&[u32]; 3] = [&[0, 2, 3, 4, 6, 10, 11, 12], &[0, 4, 5], &[0, 1, 3, 4, 7, 8, 9, 11, 12]];
        std::array::from_fn(|k| {
            let mut entries: Vec<wgpu::BindGroupEntry<'_>> = all
                .iter()
                .filter(|(binding, _)| reads[k].contains(binding))
                .map(|(binding, buffer)| wgpu::BindGroupEntry {
                    binding: *binding,
                    resource: buffer.as_entire_binding(),
                })
                .collect();
            if reads[k].contains(&5) {
                entries.push(wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::Buffer(own.clone()) });
            }
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("choice"),
                layout: &pipelines[k].get_bind_group_layout(0),
                entries: &entries,
            })
        })
    }

    /// Draws what was chosen. Returns the number of draws, one for each level.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        for level in 0..self.levels as u64 {
            pass.draw_indexed_indirect(&self.draws, self.first + DRAW * level);
        }
        self.levels as u64
    }

    /// The level and the rows of each instance that is drawn, in the order of the draws.
    pub(crate) fn drawn(&self, gpu: &Gpu) -> Result<Vec<(usize, [[f32; 4]; 3])>> {
        let rows: Vec<[[f32; 4]; 3]> = bytemuck::pod_collect_to_vec(&read(gpu, &self.rows)?);
        let draws = read(gpu, &self.draws)?;
        let mut all = Vec::new();
        for level in 0..self.levels {
            let at = self.first as usize + level * DRAW as usize;
            let [_, instances, _, _, first]: [u32; 5] = bytemuck::pod_read_unaligned(&draws[at..at + DRAW as usize]);
            all.extend(rows[first as usize..(first + instances) as usize].iter().map(|rows| (level, *rows)));
        }
        Ok(all)
    }
}

fn made(gpu: &Gpu, label: &str, size: u64, usage: Use) -> wgpu::Buffer {
    let usage = if usage.contains(Use::UNIFORM) { usage } else { Use::STORAGE | usage };
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

/// All bytes of a buffer on the adapter.
fn read(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>> {
    let back = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("back"),
        size: buffer.size(),
        usage: Use::MAP_READ | Use::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &back, 0, back.size());
    gpu.queue.submit([encoder.finish()]);
    crate::readback::buffer(gpu, &back)
}
