//! Poses plants on the adapter, once for each time: see `pose.wgsl`, and `pose_alone.wgsl` and `pose_groups.wgsl` for
//! the passes. The CPU gives an amplitude for each branch, and everything else stays on the adapter: the sections for
//! the vertex stage, boxes around what moves, and the matrices of shadow maps that are fitted to these boxes.

use crate::error::Result;
use crate::gpu::Gpu;
use crate::passes::bend::{self, RIGID, Ride};
use crate::passes::bounds::{Oriented, boxes};
use crate::scene::{PoseHierarchy, Scene, SectionSeat};
use crate::shader::{Defines, assemble};
use crate::stats::RenderStatistics;
use glam::Vec3;
use std::cell::Cell;
use std::sync::Arc;
use wgpu::BufferUsages as Use;

/// Bytes of a branch, of a mark, and of the box around what a section carries: the largest of what there is of each.
const LIMB: usize = 128;
const MARK: usize = 32;
const BOX_AT_REST: usize = 64;
/// The largest number of sections that one invocation of `pose_alone.wgsl` seats beside those on marks, of which it
/// seats a branch's own.
const LONGEST: usize = 8;
/// Invocations in a group that poses one branch.
const LANES: usize = 32;
/// Number of Newton steps for a place on a bent branch; few branches need more than two.
const STEPS: u32 = 4;

/// A compute shader with what it reads and writes.
pub(crate) struct Kernel {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    /// Number of work groups.
    count: u32,
}

impl Kernel {
    /// Makes one of the entry points of a module, for so many work groups. It must use all of the `resources`.
    pub(crate) fn new(
        gpu: &Gpu,
        module: &wgpu::ShaderModule,
        entry: &str,
        resources: &[(u32, wgpu::BindingResource<'_>)],
        count: usize,
    ) -> Kernel {
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: None,
            module,
            entry_point: Some(entry),
            // Groups use nothing of what they share before it is written.
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        let entries: Vec<wgpu::BindGroupEntry<'_>> = resources
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(entry),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Kernel { pipeline, group, count: count as u32 }
    }

    pub(crate) fn record(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(self.count, 1, 1);
    }
}

/// The pose of all plants on the adapter.
pub(crate) struct PosePass {
    poses: Arc<PoseHierarchy>,
    amplitudes: wgpu::Buffer,
    turns: Option<wgpu::Buffer>,
    /// The box around everything that each branch carries: two corners of four numbers each.
    pub parts: wgpu::Buffer,
    kernels: Vec<Kernel>,
    /// Makes the boxes of parts. It is only needed where something reads them.
    enclose: Kernel,
    /// Whether a new pose may wait for the next frame's commands, and whether one does. On a GPU a submission of its
    /// own costs time. On a software adapter it begins while the frame's commands are recorded.
    waits: bool,
    due: Cell<bool>,
}

/// Whether an adapter can pose what a scene has. If not, the CPU does.
pub(crate) fn possible(gpu: &Gpu, poses: &PoseHierarchy) -> bool {
    within(&gpu.device.limits(), poses.limbs.len(), poses.pieces.len(), poses.seats.len())
}

/// Whether buffers and numbers of work groups stay within an adapter's limits.
fn within(limits: &wgpu::Limits, limbs: usize, pieces: usize, seats: usize) -> bool {
    let bytes = (LIMB * limbs).max(MARK * (pieces + limbs)).max(BOX_AT_REST * seats) as u64;
    let groups = limbs.max(seats).div_ceil(64);
    limits.max_storage_buffers_per_shader_stage >= 8
        && bytes <= limits.max_storage_buffer_binding_size
        && groups <= limits.max_compute_workgroups_per_dimension as usize
}

impl PosePass {
    /// Uploads the branches of a scene, whose sections are written into `sections`.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        poses: &Arc<PoseHierarchy>,
        sections: &wgpu::Buffer,
        stats: &mut RenderStatistics,
    ) -> PosePass {
        let groups = in_groups(gpu, poses);
        let order = order(poses);
        let mut put = |label: &str, bytes: &[u8]| {
            stats.upload(label, bytes.len() as u64);
            gpu.buffer(label, if bytes.is_empty() { &[0; 16] } else { bytes }, Use::STORAGE)
        };
        let limbs = put("branches", bytemuck::cast_slice(&limbs(poses, &order)));
        let pieces = put("pieces of branches", bytemuck::cast_slice(&pieces(poses)));
        let hangs = poses.turns.is_some() || poses.seats.iter().any(|s| s.offset != Vec3::ZERO);
        let seats = put("seats of sections", bytemuck::cast_slice(&seats(poses, &order, hangs)));
        let at_rest =
            put("boxes of sections", bytemuck::cast_slice(&oriented(poses, &order, &boxes(scene, poses, false))));
        let runs = if groups { Vec::new() } else { runs(poses, &order) };
        let of_runs = (!groups).then(|| put("runs of seats", bytemuck::cast_slice(&runs)));
        let made = |label: &str, bytes: usize, usage: Use| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes.max(16) as u64,
                usage: Use::STORAGE | usage,
                mapped_at_creation: false,
            })
        };
        let (n, m) = (poses.limbs.len(), poses.seats.len());
        let amplitudes = made("amplitudes", 8 * n, Use::COPY_DST);
        let turns = hangs.then(|| made("turns of leaves", 4 * m, Use::COPY_DST));
        let marks = made("marks", MARK * (poses.pieces.len() + n), Use::empty());
        let states = made("states", 80 * n, Use::empty());
        let parts = made("parts", 32 * n, Use::COPY_SRC);
        let by = if groups { include_str!("pose_groups.wgsl") } else { include_str!("pose_alone.wgsl") };
        let defines = bend::defines(Defines::default(), Some(Ride::Instances), 0)
            .constant("STEPS", if poses.closed_form { 0 } else { STEPS })
            .constant("LANES", LANES as u32)
            .set("CLOSED_FORM", poses.closed_form)
            .set("HANGS", hangs);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("pose"),
            source: wgpu::ShaderSource::Wgsl(
                assemble(&[RIGID, include_str!("beam.wgsl"), include_str!("pose.wgsl"), by].concat(), &defines).into(),
            ),
        });
        let mut of = |entry: &str, buffers: &[(u32, &wgpu::Buffer)], count: usize| {
            let all: Vec<(u32, wgpu::BindingResource<'_>)> =
                buffers.iter().map(|(binding, buffer)| (*binding, buffer.as_entire_binding())).collect();
            stats.pipeline(&format!("pose: {entry}"));
            Kernel::new(gpu, &module, entry, &all, count)
        };
        let bent = [(0, &limbs), (1, &pieces), (3, &amplitudes), (7, &marks), (8, &states)];
        let joined = [(0, &limbs), (1, &pieces), (7, &marks), (8, &states)];
        let mut carried = vec![(0, &limbs), (2, &seats), (7, &marks), (8, &states), (10, sections)];
        carried.extend(turns.as_ref().map(|turns| (4, turns)));
        let seated = [carried.as_slice(), &[(1, &pieces)]].concat();
        let in_runs: Vec<_> = seated.iter().copied().chain(of_runs.as_ref().map(|runs| (6, runs))).collect();
        let enclosed = [(0, &limbs), (2, &seats), (5, &at_rest), (9, &parts), (10, sections)];
        let kernels = if groups {
            vec![of("bend_limbs", &bent, n), of("seat_sections", &seated, n)]
        } else {
            vec![
                of("bend_limbs", &bent, n.div_ceil(64)),
                of("join_limbs", &joined, n.div_ceil(64)),
                of("carry_limbs", &carried, n.div_ceil(64)),
                of("seat_sections", &in_runs, runs.len().div_ceil(64)),
            ]
        };
        let enclose = of("enclose_parts", &enclosed, if groups { n } else { n.div_ceil(64) });
        let (waits, due) = (groups, Cell::new(false));
        PosePass { poses: poses.clone(), amplitudes, turns, parts, kernels, enclose, waits, due }
    }

    /// Poses everything at a time (s).
    pub(crate) fn set_time(&self, gpu: &Gpu, time: f64) {
        gpu.queue.write_buffer(&self.amplitudes, 0, bytemuck::cast_slice(&(self.poses.amplitudes)(time)));
        if let (Some(buffer), Some(turns)) = (&self.turns, &self.poses.turns) {
            gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&turns(time)));
        }
        self.due.set(true);
        if !self.waits {
            self.now(gpu);
        }
    }

    /// Records the passes of the last time that was set, unless they have been.
    pub(crate) fn record(&self, encoder: &mut wgpu::CommandEncoder) {
        if self.due.replace(false) {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            self.kernels.iter().for_each(|kernel| kernel.record(&mut pass));
        }
    }

    /// Poses at once.
    pub(crate) fn now(&self, gpu: &Gpu) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Makes the boxes of [`PosePass::parts`] for the present pose.
    pub(crate) fn enclose(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.enclose.record(pass);
    }

    /// The boxes around what each branch carries; `None` for a branch that carries nothing.
    pub(crate) fn boxes(&self, gpu: &Gpu) -> Result<Vec<Option<[Vec3; 2]>>> {
        self.now(gpu);
        let back = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("parts back"),
            size: self.parts.size(),
            usage: Use::MAP_READ | Use::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.enclose(&mut encoder.begin_compute_pass(&Default::default()));
        encoder.copy_buffer_to_buffer(&self.parts, 0, &back, 0, back.size());
        gpu.queue.submit([encoder.finish()]);
        let found: Vec<[[f32; 4]; 2]> = bytemuck::pod_collect_to_vec(&crate::readback::buffer(gpu, &back)?);
        let corner = |c: &[f32; 4]| Vec3::new(c[0], c[1], c[2]);
        let part = |[low, high]: &[[f32; 4]; 2]| (low[0] <= high[0]).then(|| [corner(low), corner(high)]);
        Ok(found.iter().take(self.poses.limbs.len()).map(part).collect())
    }
}

/// Whether a group of invocations shares the work on each branch. That is what a GPU is quick at, which has thousands
/// of invocations waiting side by side. A software adapter has few, and is quicker where each has a branch of its own.
fn in_groups(gpu: &Gpu, poses: &PoseHierarchy) -> bool {
    let most = gpu.device.limits().max_compute_workgroups_per_dimension as usize;
    if !gpu.groups || poses.limbs.len() > most {
        return false;
    }
    let mut depths: Vec<usize> = Vec::with_capacity(poses.limbs.len());
    for limb in &poses.limbs {
        depths.push(limb.parent.map_or(1, |parent| depths[parent as usize] + 1));
    }
    depths.iter().all(|depth| *depth <= LANES)
}

/// A number whose bits a shader reads as an integer.
fn bits(number: u32) -> f32 {
    f32::from_bits(number)
}

fn four(v: Vec3, w: f32) -> [f32; 4] {
    v.extend(w).to_array()
}

/// The mark of its branch on which a section sits: the beginning of a piece, or the tip, which comes last.
fn mark(poses: &PoseHierarchy, seat: &SectionSeat) -> Option<u32> {
    let [first, count] = poses.limbs[seat.limb as usize].pieces;
    if seat.share == 1.0 {
        return Some(count);
    }
    (seat.share == poses.pieces[(first + seat.piece) as usize].begin).then_some(seat.piece)
}

/// The sections in the order of their branches: first those on marks, and then those on the branch's pieces in order.
fn order(poses: &PoseHierarchy) -> Vec<u32> {
    let mut all: Vec<u32> = (0..poses.seats.len() as u32).collect();
    let key = |seat: &SectionSeat| (seat.limb, mark(poses, seat).is_none(), seat.piece);
    all.sort_by_key(|k| key(&poses.seats[*k as usize]));
    all
}

/// Sections on a branch, and on no mark, that follow each other in this order, each on the same piece as the one before
/// or on the next: the branch, the piece of the first one among all pieces, its place in the order, and their number.
/// The longest come first, so that invocations beside each other have as much to do.
fn runs(poses: &PoseHierarchy, order: &[u32]) -> Vec<[u32; 4]> {
    let seat = |k: &u32| &poses.seats[*k as usize];
    let marked = |k: &u32| mark(poses, seat(k)).is_some();
    let near = |a: &u32, b: &u32| seat(a).limb == seat(b).limb && seat(b).piece.wrapping_sub(seat(a).piece) <= 1;
    let mut all = Vec::new();
    let mut first = 0;
    for some in order.chunk_by(|a, b| marked(a) == marked(b) && near(a, b)) {
        for run in some.chunks(LONGEST) {
            let SectionSeat { limb, piece, .. } = *seat(&run[0]);
            if !marked(&run[0]) {
                all.push([limb, poses.limbs[limb as usize].pieces[0] + piece, first, run.len() as u32]);
            }
            first += run.len() as u32;
        }
    }
    all.sort_by_key(|run| std::cmp::Reverse(run[3]));
    all
}

fn limbs(poses: &PoseHierarchy, order: &[u32]) -> Vec<[[f32; 4]; 8]> {
    let seat = |k: &u32| &poses.seats[*k as usize];
    let begin = |limb: usize| order.partition_point(|k| (seat(k).limb as usize) < limb);
    let one = |(k, limb): (usize, &crate::scene::PoseLimb)| {
        let [alpha, ln_alpha, ell] = limb.taper;
        let parent = limb.parent.map_or(-1, |p| p as i32) as u32;
        let [piece, pieces] = limb.pieces;
        let below = limb.parent.map_or(0, |p| poses.limbs[p as usize].pieces[0]) + limb.at.1;
        let own = &order[begin(k)..begin(k + 1)];
        let on_marks = own.partition_point(|k| mark(poses, seat(k)).is_some());
        [
            four(limb.axes[0], alpha),
            four(limb.axes[1], 0.0),
            limb.coefficients,
            [limb.length, ell, limb.at.0, ln_alpha],
            four(limb.root, 0.0),
            four(limb.offset, 0.0),
            [parent, below, piece, pieces].map(bits),
            [begin(k), own.len(), on_marks, 0].map(|n| bits(n as u32)),
        ]
    };
    poses.limbs.iter().enumerate().map(one).collect()
}

fn pieces(poses: &PoseHierarchy) -> Vec<[[f32; 4]; 2]> {
    poses.pieces.iter().map(|p| [four(p.place, p.begin), four(p.way, 0.0)]).collect()
}

/// Where sections sit. Without anything that hangs beside an axis or turns, there is no more to read of a section than
/// its share, or its mark, and its number.
fn seats(poses: &PoseHierarchy, order: &[u32], hangs: bool) -> Vec<f32> {
    let one = |section: &u32| {
        let seat = &poses.seats[*section as usize];
        let place = mark(poses, seat).map_or(seat.share, bits);
        let beside = [four(seat.offset, place), four(seat.axis, bits(*section))];
        if hangs { beside.as_flattened().to_vec() } else { vec![place, bits(*section)] }
    };
    order.iter().flat_map(one).collect()
}

fn oriented(poses: &PoseHierarchy, order: &[u32], around: &[Option<Oriented>]) -> Vec<[[f32; 4]; 4]> {
    let one = |section: &u32| match around[*section as usize] {
        Some((centre, [x, y, z])) => {
            [four(centre - poses.seats[*section as usize].from, 1.0), four(x, 0.0), four(y, 0.0), four(z, 0.0)]
        }
        None => [[0.0; 4]; 4],
    };
    order.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With WebGPU's smallest limits, the boxes of two million sections fill a buffer, and a storage buffer too few is
    /// too few.
    #[test]
    fn what_is_too_large_is_left_to_the_cpu() {
        let limits = wgpu::Limits::default();
        let most = (limits.max_storage_buffer_binding_size / 64) as usize;
        assert!(within(&limits, 1500, 4000, 14_000) && within(&limits, 1, 1, most));
        assert!(!within(&limits, 1, 1, most + 1) && !within(&limits, most, 1, 1));
        let marks = (limits.max_storage_buffer_binding_size / 32) as usize;
        assert!(within(&limits, 1, marks - 1, 1) && !within(&limits, 1, marks, 1));
        let large = wgpu::Limits { max_storage_buffer_binding_size: u64::MAX, ..limits.clone() };
        assert!(within(&large, 1, 1, 64 * 65_535) && !within(&large, 1, 1, 64 * 65_535 + 1));
        let few = wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..limits };
        assert!(!within(&few, 1, 1, 1));
    }
}
