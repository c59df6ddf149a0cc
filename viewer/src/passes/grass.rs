//! The grass pass: lawns as slices. For each lawn the back faces of its box are drawn, in the main pass after all
//! meshes. Only scenes with grass have its pipelines and textures.

use crate::gpu::Gpu;
use crate::maps::{Level, upload_half};
use crate::passes::bend;
use crate::passes::main::{Drawing, drawing, frame_layout, light, vertex_state};
use crate::passes::sky::pixel_rays;
use crate::scene::{Camera, GRASS_STEPS, Grass, GrassSheet, GrassTable, Scene, SkyDome, Sun};
use crate::shader::assemble;
use crate::stats::RenderStatistics;
use crate::variant::{Lights, Surface, Variant};
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// The shader: the lawn's data, the walk through its slices, their light, and the two ways to draw them.
const SOURCE: [&str; 6] = [
    include_str!("grass/lawn.wgsl"),
    include_str!("grass/walk.wgsl"),
    include_str!("grass/shade.wgsl"),
    include_str!("grass/boards.wgsl"),
    include_str!("grass/draw.wgsl"),
    include_str!("grass/hill.wgsl"),
];

/// The constants of a lawn for the shader; see `grass/lawn.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    base: [f32; 4],
    corners: [f32; 4],
    period: [f32; 4],
    upright: [f32; 4],
    level: [f32; 4],
    shown: [f32; 4],
    soil: [f32; 4],
    scatter: [f32; 4],
    below: [f32; 4],
    rays: [[f32; 4]; 3],
    lean: [f32; 4],
    turn: [f32; 4],
    tables: [[[f32; 4]; 5]; 4],
}

pub(crate) struct GrassPass {
    lawns: Vec<Lawn>,
    /// Time of the wind (s).
    pub time: f64,
}

struct Lawn {
    grass: Arc<Grass>,
    pipeline: wgpu::RenderPipeline,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
    /// The boards, where the lawn is drawn as polygons.
    boards: Option<wgpu::Buffer>,
}

/// A board: a piece of a slice as a polygon. The numbers are the axis that the slice stands across (0 to 2, or 3 for
/// the ground), the number of its plane, the number of the interval between planes of the other axis, and whether it is
/// the upper half.
type Board = [i32; 4];

/// The camera and the lights of a frame.
#[derive(Clone, Copy)]
pub(crate) struct Aim<'a> {
    pub camera: &'a Camera,
    /// Size of the picture in pixels.
    pub size: [u32; 2],
    pub sun: Option<&'a Sun>,
    pub dome: Option<&'a SkyDome>,
}

impl GrassPass {
    /// Makes the pass; `None` for a scene without grass.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, stats: &mut RenderStatistics) -> Option<GrassPass> {
        let lawns: Vec<Lawn> = scene.grass.iter().map(|grass| Lawn::new(gpu, scene, grass, stats)).collect();
        let time = scene.wind.as_ref().map_or(0.0, |w| w.time_s);
        (!lawns.is_empty()).then_some(GrassPass { lawns, time })
    }

    /// Takes over the camera and the lights of this frame.
    pub(crate) fn aim(&self, gpu: &Gpu, aim: Aim<'_>) {
        for lawn in &self.lawns {
            let uniform = uniform(&lawn.grass, aim, self.time);
            gpu.queue.write_buffer(&lawn.uniform, 0, bytemuck::bytes_of(&uniform));
            if let Some(buffer) = &lawn.boards {
                let eye = aim.camera.eye - Vec3::from_slice(&uniform.base[..3]);
                gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&boards(&lawn.grass, uniform.corners, eye)));
            }
        }
    }

    /// Draws all lawns. The main pass must have bound its own group.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, stats: &mut RenderStatistics) {
        for lawn in &self.lawns {
            pass.set_pipeline(&lawn.pipeline);
            pass.set_bind_group(1, &lawn.group, &[]);
            match &lawn.boards {
                None => pass.draw(0..36, 0..1),
                Some(boards) => {
                    pass.set_vertex_buffer(0, boards.slice(..));
                    pass.draw(0..4, 0..(boards.size() / size_of::<Board>() as u64) as u32);
                }
            }
            stats.draws += 1;
        }
    }
}

impl Lawn {
    fn new(gpu: &Gpu, scene: &Scene, grass: &Arc<Grass>, stats: &mut RenderStatistics) -> Lawn {
        let device = &gpu.device;
        let level = grass.level.is_some();
        let layout = layout(gpu, level, grass.gusts.is_some());
        let windy = if grass.gusts.is_some() { " in the wind" } else { "" };
        stats.pipeline(&format!("grass{}{windy}", if level { "" } else { " without a level slice" }));
        let pipeline = pipeline(gpu, scene, grass, &layout);
        let uniform = gpu.uniform("grass", &[Uniform::default()]);
        stats.upload("grass", size_of::<Uniform>() as u64);
        let mut put = |what: &str, sheet: &GrassSheet| {
            let name = format!("{} {what}", grass.name);
            let planes: Vec<Vec<Level>> = (0..4)
                .map(|k| {
                    let one = |l: &crate::scene::GrassLevel| Level {
                        width: l.width,
                        height: l.height,
                        texels: l.planes[k].clone(),
                    };
                    sheet.levels.iter().map(one).collect()
                })
                .collect();
            let uploaded = upload_half(gpu, &name, &planes);
            stats.upload(&name, uploaded.bytes);
            uploaded.view
        };
        let upright = put("upright slices", &grass.upright);
        let level = grass.level.as_ref().map(|sheet| put("level slice", sheet));
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("slices"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let gusts = grass.gusts.as_ref().map(|gusts| {
            let texels = gusts.added.iter().map(|v| [v[0], v[1], 0.0, 0.0]).collect();
            let name = format!("{} gusts", grass.name);
            let map = upload_half(gpu, &name, &[vec![Level { width: gusts.size, height: gusts.size, texels }]]);
            stats.upload(&name, map.bytes);
            let repeated = device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("gusts"),
                address_mode_u: wgpu::AddressMode::Repeat,
                address_mode_v: wgpu::AddressMode::Repeat,
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            });
            (map.view, repeated)
        });
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&upright) },
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&sampler) },
        ];
        if let Some(level) = &level {
            entries.push(wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::TextureView(level) });
        }
        if let Some((map, repeated)) = &gusts {
            let (map, repeated) = (wgpu::BindingResource::TextureView(map), wgpu::BindingResource::Sampler(repeated));
            entries.push(wgpu::BindGroupEntry { binding: 4, resource: map });
            entries.push(wgpu::BindGroupEntry { binding: 5, resource: repeated });
        }
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("grass"),
            layout: &layout,
            entries: &entries,
        });
        let boards = grass.billboards.then(|| {
            let (low, high) = (grass.low, grass.high);
            let all = boards(grass, [low.x, low.y, high.x, high.y], Vec3::ZERO);
            stats.upload("billboards", size_of_val(all.as_slice()) as u64);
            let usage = wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST;
            gpu.buffer("billboards", bytemuck::cast_slice(&all), usage)
        });
        Lawn { grass: Arc::clone(grass), pipeline, uniform, group, boards }
    }
}

fn layout(gpu: &Gpu, level: bool, wind: bool) -> wgpu::BindGroupLayout {
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let slices = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let mut entries = vec![
        entry(0, fragment | wgpu::ShaderStages::VERTEX, uniform),
        entry(1, fragment, slices),
        entry(2, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
    ];
    if level {
        entries.push(entry(3, fragment, slices));
    }
    if wind {
        let map = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        entries.push(entry(4, fragment, map));
        entries.push(entry(5, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("grass"), entries: &entries })
}

/// The shader of a lawn under a scene's lights.
fn source(gpu: &Gpu, scene: &Scene, grass: &Grass) -> (String, Lights) {
    let lights = Lights::of(scene);
    let variant = Variant {
        lights,
        surface: Surface::Opaque { pattern: false },
        msaa: scene.msaa,
        levels: false,
        bend: None,
        turn: false,
        stand: false,
        anchored: None,
        shares: false,
    };
    let defines = variant
        .defines()
        .set("LEVEL_SLICE", grass.level.is_some())
        .set("WIND", grass.gusts.is_some())
        .set("BILLBOARDS", grass.billboards)
        .set("IRREGULAR", grass.irregular.is_some())
        .set("HILL", grass.hill.is_some())
        // Blades over a ridge cover samples. OpenGL has no masks of samples.
        .set("SAMPLE_MASK", grass.hill.is_some() && scene.msaa > 1 && !gpu.is_gl())
        .constant("STEPS", grass.steps);
    let defines = grass.irregular.iter().fold(defines, |all, seed| all.constant("IRREGULAR_SEED", *seed));
    let shared = [bend::SOURCE, include_str!("main.wgsl"), &light(&variant)];
    (assemble(&(shared.concat() + &SOURCE.concat()), &defines), lights)
}

fn pipeline(gpu: &Gpu, scene: &Scene, grass: &Grass, own: &wgpu::BindGroupLayout) -> wgpu::RenderPipeline {
    let (source, lights) = source(gpu, scene, grass);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("grass"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("grass"),
        bind_group_layouts: &[Some(&frame_layout(gpu, &lights)), Some(own)],
        immediate_size: 0,
    });
    if grass.billboards {
        let attributes = wgpu::vertex_attr_array![0 => Sint32x4];
        let boards = wgpu::VertexBufferLayout {
            array_stride: size_of::<Board>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &attributes,
        };
        let buffers = [Some(boards)];
        let vertex = vertex_state(&module, "board_vertex", &buffers);
        let primitive = wgpu::PrimitiveState { topology: wgpu::PrimitiveTopology::TriangleStrip, ..Default::default() };
        let (label, fragment, msaa) = ("billboards", (&module, "board_fragment"), scene.msaa);
        return drawing(gpu, Drawing { label, layout: &layout, vertex, fragment, primitive, msaa, solid: false });
    }
    // Back faces are drawn because an eye inside the grass sees them too.
    let primitive = wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Front), ..Default::default() };
    let vertex = vertex_state(&module, "grass_vertex", &[]);
    let (label, fragment, msaa) = ("grass", (&module, "grass_fragment"), scene.msaa);
    drawing(gpu, Drawing { label, layout: &layout, vertex, fragment, primitive, msaa, solid: true })
}

/// All boards of a lawn in the order in which an eye needs them. `corners` are those of the shader. The ground comes
/// first, then the half of the height that is farther from the eye, the level slice, and the nearer half. Within each,
/// boards are sorted from the farthest to the nearest middle.
fn boards(grass: &Grass, corners: [f32; 4], eye: Vec3) -> Vec<Board> {
    let apart = [0, 1].map(|k: usize| grass.period[k] / grass.count as f32);
    let place = |k: usize, plane: f32| (plane + 0.5) * apart[k] - 0.5 * grass.period[k];
    // Boards that reach over the edge are cut there. Boards beyond the edge are left out.
    let planes = |k: usize| {
        let at = |edge: f32| ((edge + 0.5 * grass.period[k]) / apart[k] - 0.5).round() as i32;
        at(corners[k])..at(corners[2 + k])
    };
    let half = 0.5 * grass.height;
    let mut layers: [Vec<(f32, Board)>; 3] = Default::default();
    let mut put = |layer: usize, middle: Vec3, board: Board| layers[layer].push((middle.distance_squared(eye), board));
    for i in planes(0) {
        for j in planes(1) {
            let [x, y] = [place(0, i as f32), place(1, j as f32)];
            let [beside_x, beside_y] = [x + 0.5 * apart[0], y + 0.5 * apart[1]];
            for upper in 0..2 {
                let (z, layer) = ((upper as f32 + 0.5) * half, 2 * upper as usize);
                put(layer, Vec3::new(x, beside_y, z), [0, i, j, upper]);
                put(layer, Vec3::new(beside_x, y, z), [1, j, i, upper]);
            }
            if grass.level.is_some() {
                put(1, Vec3::new(beside_x, beside_y, half), [2, i, j, 0]);
            }
        }
    }
    if eye.z < half {
        layers.reverse();
    }
    layers.iter_mut().for_each(|layer| layer.sort_by(|a, b| b.0.total_cmp(&a.0)));
    std::iter::once([3, 0, 0, 0]).chain(layers.into_iter().flatten().map(|(_, board)| board)).collect()
}

fn uniform(grass: &Grass, Aim { camera, size, sun, dome }: Aim<'_>, time: f64) -> Uniform {
    let sheet = |s: &GrassSheet| [s.cell[0] as f32, s.cell[1] as f32, s.border as f32, s.columns as f32];
    let (pixel, rays) = pixel_rays(camera, size);
    // The direction towards the sun, transformed to the lawn without wind.
    let mean = grass.gusts.as_ref().map_or([0.0; 2], |g| g.mean);
    let leant = |to: Vec3| (to - to.z * Vec3::new(mean[0], mean[1], 0.0)).normalize();
    let upwards = sun.map_or(0.0, |s| leant(s.direction.normalize()).z).clamp(0.0, 1.0);
    let x = upwards * GRASS_STEPS as f32;
    let k = (x as usize).min(GRASS_STEPS - 1);
    let sunlit = grass.through.map(|row| row[k] + (x - k as f32) * (row[k + 1] - row[k]));
    let packed = |table: &GrassTable| {
        let mut out = [[0.0; 4]; 5];
        table.iter().enumerate().for_each(|(i, v)| out[i / 4][i % 4] = *v);
        out
    };
    // Places are relative to the rectangle below the eye, because single precision is most accurate there.
    let period = Vec2::from(grass.period);
    let number = ((camera.eye - grass.origin).truncate() / period).round();
    let shift = number * period;
    let (low, high) = (grass.low - shift, grass.high - shift);
    let base = grass.origin + shift.extend(0.0);
    let (lean, turn) = grass.gusts.as_ref().map_or_else(Default::default, |g| {
        let at = g.place(base.truncate().as_dvec2(), time).as_vec2();
        let turn = g.turn.map(|v| v.as_vec2());
        ([mean[0], mean[1], at.x, at.y], [turn[0].x, turn[0].y, turn[1].x, turn[1].y])
    });
    // The middle relative to the base, the height, and 1/(2 radius²).
    let (hill, narrow) = grass.hill.map_or_else(Default::default, |h| {
        let middle = h.middle - base.truncate();
        ([middle.x, middle.y, h.height], 0.5 / (h.radius * h.radius))
    });
    let below = dome.and_then(|d| Some(d.ground?.map(|v| v * d.strength))).unwrap_or_default();
    Uniform {
        lean,
        turn,
        base: base.extend(grass.height).to_array(),
        corners: [low.x, low.y, high.x, high.y],
        period: [grass.period[0], grass.period[1], grass.count as f32, grass.level_cover],
        upright: sheet(&grass.upright),
        level: grass.level.as_ref().map_or([0.0; 4], sheet),
        shown: [grass.shown[0], grass.shown[1], grass.soil_open, pixel],
        soil: Vec3::from(grass.soil).extend(number.x).to_array(),
        scatter: Vec3::from(grass.scatter).extend(number.y).to_array(),
        below: Vec3::from(below).extend(narrow).to_array(),
        rays: std::array::from_fn(|k| rays[k].extend(hill[k]).to_array()),
        tables: [&grass.projection, &grass.cover, &grass.open, &sunlit].map(packed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lawn that no wind leans, and whose rectangles are all alike, is compiled without any code for either.
    #[test]
    fn no_code_for_what_a_lawn_does_not_have() {
        let lines = |name: &'static str, on: bool| {
            let defines = crate::shader::Defines::default().set(name, on).constant("STEPS", 64);
            let source = assemble(&SOURCE.concat(), &defines);
            let own = source.lines().filter(|l| !l.trim().is_empty() && !l.trim().starts_with("//"));
            own.map(str::to_string).collect::<Vec<_>>()
        };
        for (name, words, least) in [
            ("WIND", &["leaning", "unleant", "gusts", "leans"][..], [10, 20]),
            ("IRREGULAR", &["shifted", "IRREGULAR_SEED", "SHIFTS"], [5, 15]),
            ("HILL", &["hill_", "sheared("], [10, 60]),
        ] {
            let (without, with) = (lines(name, false), lines(name, true));
            let count = |lines: &[String]| lines.iter().filter(|l| words.iter().any(|w| l.contains(w))).count();
            assert_eq!(count(&without), 0, "{name}");
            let found = [count(&with), with.len() - without.len()];
            assert!(found[0] >= least[0] && found[1] >= least[1], "{name}: {found:?}");
        }
    }
}
