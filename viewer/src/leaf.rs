//! One leaf on the adapter: its constants and the maps its variant of the shader reads, in one bind group.

use crate::dome::MeanTable;
use crate::geometry::{Geometry, VertexNeeds};
use crate::gpu::Gpu;
use crate::lobe::AlbedoTable;
use crate::maps::{self, Level, Uploaded};
use crate::passes::bend;
use crate::scene::{Interior, Leaf, Lobe, Scene, Side, SlabCurve, Translucency};
use crate::stats::Stats;
use crate::variant::Variant;

/// A leaf ready to draw.
pub(crate) struct LeafOnGpu {
    /// Which of the scene's leaves this is.
    pub index: usize,
    pub variant: Variant,
    pub geometry: Geometry,
    pub group: wgpu::BindGroup,
    /// Mask and sampler for the shadow pass.
    pub mask: Option<wgpu::TextureView>,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Constants {
    leaf: [f32; 4],
    front_curve: [f32; 4],
    back_curve: [f32; 4],
    albedo: [f32; 4],
}

/// Directional-albedo tables already integrated, kept from scene to scene.
#[derive(Default)]
pub(crate) struct AlbedoCache(Vec<(Lobe, AlbedoTable)>, Vec<(Lobe, MeanTable)>);

impl AlbedoCache {
    /// A table that covers roughness `m_min` to `m_max`.
    fn table(&mut self, lobe: Lobe, m_min: f64, m_max: f64) -> AlbedoTable {
        // Rounded outwards to powers of two, so that an edit in the window rarely integrates anew.
        let (low, high) =
            (m_min.max(crate::lobe::FLOOR).log2().floor().exp2(), m_max.max(crate::lobe::FLOOR).log2().ceil().exp2());
        if let Some((_, table)) =
            self.0.iter().find(|(l, t)| *l == lobe && t.m_min <= low && t.m_max >= high && t.m_max <= 4.0 * high)
        {
            return table.clone();
        }
        let table = AlbedoTable::new(lobe, low, high);
        self.0.push((lobe, table.clone()));
        table
    }

    /// The lobe's mean directions over an albedo table's grid.
    fn means(&mut self, lobe: Lobe, like: &AlbedoTable) -> MeanTable {
        if let Some((_, table)) =
            self.1.iter().find(|(l, t)| *l == lobe && (t.m_min, t.m_max) == (like.m_min, like.m_max))
        {
            return table.clone();
        }
        let table = MeanTable::new(lobe, like.m_min, like.m_max);
        self.1.push((lobe, table.clone()));
        table
    }
}

/// The bindings of group 1 for a variant: the layout and what is bound come from one list.
pub(crate) fn layout(gpu: &Gpu, variant: &Variant) -> wgpu::BindGroupLayout {
    let entry = |binding, ty, visibility| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let texture = |filterable, layers| wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable },
        view_dimension: if layers > 1 { wgpu::TextureViewDimension::D2Array } else { wgpu::TextureViewDimension::D2 },
        multisampled: false,
    };
    let mut entries = vec![entry(
        0,
        wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        fragment,
    )];
    if variant.sampled() {
        entries.push(entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering), fragment));
    }
    for binding in texture_bindings(variant) {
        let filterable = !matches!(binding, 2 | 3 | 15 | 16);
        let layers = match binding {
            17 => variant.front.translucency,
            18 => variant.back.translucency,
            _ => 1,
        };
        entries.push(entry(binding, texture(filterable, layers), fragment));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("leaf"), entries: &entries })
}

/// Textures that a variant binds, as numbered in `main.wgsl`.
fn texture_bindings(variant: &Variant) -> Vec<u32> {
    let mut bindings = Vec::new();
    for (k, side) in [(0, variant.front), (1, variant.back)] {
        if variant.lit() && side.maps {
            bindings.extend([10 + 2 * k, 11 + 2 * k]);
        } else if variant.lit() && !side.black {
            bindings.extend([2 + k, 4 + k]);
        }
        if side.gloss {
            bindings.push(6 + k);
        }
        if side.normal {
            bindings.push(8 + k);
        }
        if side.translucency > 0 {
            bindings.push(17 + k);
        }
    }
    if variant.mask {
        bindings.push(14);
    }
    if variant.albedo() {
        bindings.push(15);
    }
    if variant.means() {
        bindings.push(16);
    }
    bindings
}

fn curve_constants(side: &Side) -> [f32; 4] {
    match &side.interior {
        Interior::Scalars(c) if !side.is_black() => {
            let last = (c.rho_d.len() - 1) as f32;
            [c.min_mm, last / (c.max_mm - c.min_mm), last, 0.0]
        }
        _ => [0.0; 4],
    }
}

fn curve_table(curve: &SlabCurve) -> Level {
    let texels = curve.rho_d.iter().chain(&curve.rho_t).map(|c| [c[0], c[1], c[2], 0.0]).collect();
    Level { width: curve.rho_d.len() as u32, height: 2, texels }
}

/// Smallest and largest roughness of the sides that shine.
fn roughness_range(leaf: &Leaf) -> (f64, f64) {
    let texels = [&leaf.front, &leaf.back].into_iter().filter_map(|s| s.gloss.as_ref()).flatten();
    let (low, high) = texels.fold((f64::MAX, 0.0f64), |(l, h), t| (l.min(f64::from(t[3])), h.max(f64::from(t[3]))));
    if high > 0.0 { (low.min(high), high) } else { (0.1, 0.1) }
}

impl LeafOnGpu {
    /// Uploads leaf `index` as far as `variant` reads it; `None` where it stands nowhere.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        index: usize,
        samplers: &Samplers,
        tables: &mut AlbedoCache,
        stats: &mut Stats,
    ) -> Option<LeafOnGpu> {
        let leaf = &scene.leaves[index];
        let (branches, motion) = bend::needs(scene, index);
        let variant = Variant { branches, motion, ..Variant::new(gpu, scene, leaf) };
        let needs = VertexNeeds { normals: true, tangents: variant.tangent(), rides: branches > 0 };
        let geometry = Geometry::new(gpu, scene, index, needs, stats)?;

        let mut bound: Vec<(u32, wgpu::TextureView)> = Vec::new();
        let mirrored: Option<Vec<u8>> = leaf
            .mask
            .as_ref()
            .map(|mask| mask.chunks(leaf.width as usize).flat_map(|row| row.iter().rev().copied()).collect());
        let mut keep = |binding: u32, name: String, up: Uploaded| {
            stats.upload(&format!("leaf {index} {name}"), up.bytes);
            bound.push((binding, up.view));
        };
        for (k, name, side, sv, mask) in [
            (0, "front", &leaf.front, variant.front, leaf.mask.as_deref()),
            (1, "back", &leaf.back, variant.back, mirrored.as_deref()),
        ] {
            let map = |what: &str, texels: Vec<[f32; 4]>| {
                maps::upload(gpu, &format!("{name} {what}"), &maps::mip_chain(leaf.width, leaf.height, texels, mask))
            };
            let rgb =
                |texels: &[[f32; 3]]| -> Vec<[f32; 4]> { texels.iter().map(|t| [t[0], t[1], t[2], 0.0]).collect() };
            if variant.lit() && !sv.black {
                match &side.interior {
                    Interior::Maps { rho_d, rho_t } => {
                        keep(10 + 2 * k, format!("{name} rho_d"), map("rho_d", rgb(rho_d)));
                        keep(11 + 2 * k, format!("{name} rho_t"), map("rho_t", rgb(rho_t)));
                    }
                    Interior::Scalars(curve) => {
                        keep(
                            2 + k,
                            format!("{name} slab curve"),
                            maps::upload_table(gpu, "slab curve", curve_table(curve)),
                        );
                        keep(4 + k, format!("{name} gamma_delta"), map("gamma_delta", side.gamma_delta.clone()));
                    }
                }
            }
            if let (true, Some(gloss)) = (sv.gloss, &side.gloss) {
                keep(6 + k, format!("{name} gloss"), map("gloss", gloss.clone()));
            }
            if let (true, Some(normal)) = (sv.normal, &side.normal) {
                keep(8 + k, format!("{name} normal"), map("normal", rgb(normal)));
            }
            if let (true, Some(translucency)) = (sv.translucency > 0, &side.translucency) {
                let layers: Vec<Vec<Level>> = translucency
                    .layers()
                    .iter()
                    .map(|map| map.iter().map(|h| Translucency::vector(*h)).map(|[x, y, z]| [x, y, z, 0.0]).collect())
                    .map(|texels| maps::mip_chain(leaf.width, leaf.height, texels, mask))
                    .collect();
                keep(
                    17 + k,
                    format!("{name} translucency"),
                    maps::upload_half(gpu, &format!("{name} translucency"), &layers),
                );
            }
        }
        let mut albedo = [0.0; 4];
        if variant.albedo() {
            let (low, high) = roughness_range(leaf);
            let table = tables.table(leaf.lobe, low, high);
            albedo = [table.m_min.ln() as f32, (1.0 / (table.m_max / table.m_min).ln()) as f32, 0.0, 0.0];
            let texels = table.values.iter().map(|v| [*v, 0.0, 0.0, 0.0]).collect();
            let level = Level { width: AlbedoTable::COLUMNS as u32, height: AlbedoTable::ROWS as u32, texels };
            keep(15, "albedo table".into(), maps::upload_table(gpu, "albedo table", level));
            if variant.means() {
                let means = tables.means(leaf.lobe, &table);
                let level = Level {
                    width: MeanTable::COLUMNS as u32,
                    height: 2 * MeanTable::ROWS as u32,
                    texels: means.texels,
                };
                keep(16, "lobe means".into(), maps::upload_table(gpu, "lobe means", level));
            }
        }
        let mut mask_view = None;
        if let Some(mask) = &leaf.mask {
            let up = maps::upload_mask(gpu, "mask", leaf.width, leaf.height, mask);
            mask_view = Some(up.view.clone());
            keep(14, "mask".into(), up);
        }
        let index_of_refraction = if let Lobe::CookTorrance { index } = leaf.lobe { index } else { 1.0 };
        let constants = Constants {
            leaf: [leaf.thickness_mm, index_of_refraction, 0.0, 0.0],
            front_curve: curve_constants(&leaf.front),
            back_curve: curve_constants(&leaf.back),
            albedo,
        };
        let buffer = gpu.uniform("leaf constants", &[constants]);
        let mut entries = vec![wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }];
        if variant.sampled() {
            entries.push(wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&samplers.maps) });
        }
        for (binding, view) in &bound {
            entries
                .push(wgpu::BindGroupEntry { binding: *binding, resource: wgpu::BindingResource::TextureView(view) });
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("leaf"),
            layout: &layout(gpu, &variant),
            entries: &entries,
        });
        Some(LeafOnGpu { index, variant, geometry, group, mask: mask_view })
    }
}

/// Samplers shared by every leaf.
pub(crate) struct Samplers {
    /// Trilinear when a map is minified, plain bilinear when it is magnified, clamped at its rim.
    pub maps: wgpu::Sampler,
}

impl Samplers {
    pub(crate) fn new(gpu: &Gpu) -> Samplers {
        Samplers {
            maps: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("maps"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            }),
        }
    }
}
