//! Materials on the adapter. A bind group holds a material's constants and the maps that its variant of the shader
//! reads. An edit uploads what it changed; all other textures stay.

use crate::dome::MeanTable;
use crate::gpu::Gpu;
use crate::lobe::{ShaderAlbedoTable, Tables};
use crate::maps::{self, Level, Uploaded};
use crate::samplers::Samplers;
use crate::scene::{AlbedoPattern, Interior, LeafMaterial, Material, Side, SideMaps, SlabCurve, Translucency};
use crate::stats::RenderStatistics;
use crate::variant::Variant;
use mesophyll_base::surface::side::mirror;
use std::hash::{DefaultHasher, Hash, Hasher};

/// A material ready to draw with.
pub(crate) struct MaterialOnGpu {
    pub group: wgpu::BindGroup,
    textures: Vec<Texture>,
}

/// A texture with a hash of its source data. An edit keeps the texture if the hash is the same.
struct Texture {
    slot: Slot,
    content: u64,
    view: wgpu::TextureView,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Constants {
    leaf: [f32; 4],
    front_curve: [f32; 4],
    back_curve: [f32; 4],
    albedo: [f32; 4],
}

/// The binding of a texture in group 1, as numbered in `leaf.wgsl`, `side.wgsl` and
/// `opaque.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Slot {
    Pattern,
    Leaf(LeafSlot),
}

/// A texture of a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LeafSlot {
    Mask,
    Albedo,
    Means,
    Of(Side, Map),
}

/// A side's textures, in the order of their bindings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Map {
    Curve,
    GammaDelta,
    RhoD,
    RhoT,
    Gloss,
    Normal,
    Translucency,
}

impl Slot {
    fn binding(self) -> u32 {
        match self {
            Slot::Leaf(LeafSlot::Mask) => 2,
            Slot::Leaf(LeafSlot::Albedo) => 3,
            Slot::Leaf(LeafSlot::Means) => 4,
            Slot::Pattern => 5,
            Slot::Leaf(LeafSlot::Of(side, map)) => 10 * (1 + side as u32) + map as u32,
        }
    }

    /// Whether the texture is read texel by texel instead of through the sampler.
    fn is_table(self) -> bool {
        matches!(self, Slot::Leaf(LeafSlot::Albedo | LeafSlot::Means | LeafSlot::Of(_, Map::Curve)))
    }
}

impl LeafSlot {
    /// The name of its uploads.
    fn name(self) -> String {
        let (side, map) = match self {
            LeafSlot::Mask => return "mask".into(),
            LeafSlot::Albedo => return "albedo table".into(),
            LeafSlot::Means => return "lobe means".into(),
            LeafSlot::Of(side, map) => (side, map),
        };
        let map = match map {
            Map::Curve => "slab curve",
            Map::GammaDelta => "gamma_delta",
            Map::RhoD => "rho_d",
            Map::RhoT => "rho_t",
            Map::Gloss => "gloss",
            Map::Normal => "normal",
            Map::Translucency => "translucency",
        };
        format!("{side} {map}")
    }
}

/// The textures that a variant reads.
fn slots(variant: &Variant) -> Vec<Slot> {
    let pattern = variant.patterned().then_some(Slot::Pattern);
    pattern.into_iter().chain(leaf_slots(variant).into_iter().map(Slot::Leaf)).collect()
}

/// Those of a leaf.
fn leaf_slots(variant: &Variant) -> Vec<LeafSlot> {
    let Some(leaf) = variant.leaf() else { return Vec::new() };
    let mut slots = Vec::new();
    for (side, needs) in leaf.sides.iter() {
        let lit = variant.lights.any() && !needs.black;
        let maps = [
            (lit && !needs.maps, Map::Curve),
            (lit && !needs.maps, Map::GammaDelta),
            (lit && needs.maps, Map::RhoD),
            (lit && needs.maps, Map::RhoT),
            (needs.gloss, Map::Gloss),
            (needs.normal, Map::Normal),
            (needs.translucency > 0, Map::Translucency),
        ];
        slots.extend(maps.into_iter().filter(|(on, _)| *on).map(|(_, map)| LeafSlot::Of(side, map)));
    }
    let shared =
        [(variant.albedo(), LeafSlot::Albedo), (variant.means(), LeafSlot::Means), (leaf.mask, LeafSlot::Mask)];
    slots.extend(shared.into_iter().filter(|(on, _)| *on).map(|(_, slot)| slot));
    slots
}

/// The bindings of group 1 for a variant. The layout and the bound resources come from one list.
pub(crate) fn layout(gpu: &Gpu, variant: &Variant) -> wgpu::BindGroupLayout {
    let visibility = wgpu::ShaderStages::FRAGMENT;
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let mut entries = vec![entry(0, uniform)];
    if variant.sampled() {
        entries.push(entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)));
    }
    for slot in slots(variant) {
        let layers = match (slot, variant.leaf()) {
            (Slot::Leaf(LeafSlot::Of(side, Map::Translucency)), Some(leaf)) => leaf.sides[side].translucency,
            _ => 1,
        };
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: !slot.is_table() },
            view_dimension: if layers > 1 {
                wgpu::TextureViewDimension::D2Array
            } else {
                wgpu::TextureViewDimension::D2
            },
            multisampled: false,
        };
        entries.push(entry(slot.binding(), texture));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("material"), entries: &entries })
}

fn curve_constants(side: &SideMaps) -> [f32; 4] {
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

/// Smallest and largest roughness of the sides that have gloss.
fn roughness_range(leaf: &LeafMaterial) -> (f64, f64) {
    let texels = leaf.sides.iter().filter_map(|(_, s)| s.gloss.as_ref()).flatten();
    let (low, high) = texels.fold((f64::MAX, 0.0f64), |(l, h), t| (l.min(f64::from(t[3])), h.max(f64::from(t[3]))));
    if high > 0.0 { (low.min(high), high) } else { (0.1, 0.1) }
}

fn rgb(texels: &[[f32; 3]]) -> Vec<[f32; 4]> {
    texels.iter().map(|t| [t[0], t[1], t[2], 0.0]).collect()
}

/// A leaf's own tables: the albedo of its lobe and, under a dome, the lobe's mean directions.
struct LobeTables {
    albedo: Option<ShaderAlbedoTable>,
    means: Option<MeanTable>,
}

/// A leaf that is being uploaded.
struct Upload<'a> {
    gpu: &'a Gpu,
    leaf: &'a LeafMaterial,
    tables: LobeTables,
}

impl Upload<'_> {
    /// A hash of the source data of the texture in a slot.
    fn content(&self, slot: LeafSlot) -> u64 {
        let leaf = self.leaf;
        let mut hash = DefaultHasher::new();
        (leaf.width, leaf.height).hash(&mut hash);
        let mut add = |bytes: &[u8]| hash.write(bytes);
        // The mask counts too, because maps are averaged over the texels on the leaf.
        if let (Some(mask), false) = (&leaf.mask, Slot::Leaf(slot).is_table()) {
            add(mask);
        }
        match slot {
            LeafSlot::Mask => {}
            LeafSlot::Albedo => self.tables.albedo.iter().for_each(|t| add(bytemuck::cast_slice(&t.values))),
            LeafSlot::Means => self.tables.means.iter().for_each(|t| add(bytemuck::cast_slice(&t.texels))),
            LeafSlot::Of(side, map) => {
                let side = &leaf.sides[side];
                match (map, &side.interior) {
                    (Map::Curve, Interior::Scalars(c)) => {
                        add(bytemuck::cast_slice(&c.rho_d));
                        add(bytemuck::cast_slice(&c.rho_t));
                    }
                    (Map::RhoD, Interior::Maps { rho_d, .. }) => add(bytemuck::cast_slice(rho_d)),
                    (Map::RhoT, Interior::Maps { rho_t, .. }) => add(bytemuck::cast_slice(rho_t)),
                    (Map::Curve | Map::RhoD | Map::RhoT, _) => {}
                    (Map::GammaDelta, _) => add(bytemuck::cast_slice(&side.gamma_delta)),
                    (Map::Gloss, _) => side.gloss.iter().for_each(|t| add(bytemuck::cast_slice(t))),
                    (Map::Normal, _) => side.normal.iter().for_each(|t| add(bytemuck::cast_slice(t))),
                    (Map::Translucency, _) => {
                        let layers = side.translucency.iter().flat_map(Translucency::layers);
                        layers.for_each(|t| add(bytemuck::cast_slice(t)));
                    }
                }
            }
        }
        hash.finish()
    }

    /// Makes the texture of a slot; `None` where the leaf has no data for it.
    fn texture(&self, slot: LeafSlot) -> Option<Uploaded> {
        let (gpu, leaf, name) = (self.gpu, self.leaf, slot.name());
        let table = |width: usize, height: usize, texels| {
            maps::upload_table(gpu, &name, Level { width: width as u32, height: height as u32, texels })
        };
        let (side, map) = match slot {
            LeafSlot::Mask => return Some(maps::upload_mask(gpu, &name, leaf.width, leaf.height, leaf.mask.as_ref()?)),
            LeafSlot::Albedo => {
                let texels = self.tables.albedo.as_ref()?.values.iter().map(|v| [*v, 0.0, 0.0, 0.0]).collect();
                return Some(table(ShaderAlbedoTable::COLUMNS, ShaderAlbedoTable::ROWS, texels));
            }
            LeafSlot::Means => {
                let texels = self.tables.means.as_ref()?.texels.clone();
                return Some(table(MeanTable::COLUMNS, 2 * MeanTable::ROWS, texels));
            }
            LeafSlot::Of(side, map) => (side, map),
        };
        let mask = leaf.mask.as_ref().map(|mask| match side {
            Side::Front => mask.clone(),
            Side::Back => mirror(mask, leaf.width as usize),
        });
        let mips = |texels| maps::mip_chain(leaf.width, leaf.height, texels, mask.as_deref());
        let side = &leaf.sides[side];
        let texels = match (map, &side.interior) {
            (Map::Curve, Interior::Scalars(curve)) => return Some(maps::upload_table(gpu, &name, curve_table(curve))),
            (Map::RhoD, Interior::Maps { rho_d, .. }) => rgb(rho_d),
            (Map::RhoT, Interior::Maps { rho_t, .. }) => rgb(rho_t),
            (Map::Curve | Map::RhoD | Map::RhoT, _) => return None,
            (Map::GammaDelta, _) => side.gamma_delta.clone(),
            (Map::Gloss, _) => side.gloss.clone()?,
            (Map::Normal, _) => rgb(side.normal.as_ref()?),
            (Map::Translucency, _) => {
                let vector = |h: &[f32; 3]| Translucency::vector(*h);
                let layers = side.translucency.as_ref()?.layers().iter();
                let layers: Vec<Vec<Level>> =
                    layers.map(|map| mips(rgb(&map.iter().map(vector).collect::<Vec<_>>()))).collect();
                return Some(maps::upload_half(gpu, &name, &layers));
            }
        };
        Some(maps::upload(gpu, &name, &mips(texels)))
    }
}

/// A hash of what a pattern's texture is made of.
fn pattern_content(pattern: &AlbedoPattern) -> u64 {
    let mut hash = DefaultHasher::new();
    (pattern.width, pattern.height).hash(&mut hash);
    hash.write(bytemuck::cast_slice(pattern.texels.as_slice()));
    hash.finish()
}

impl MaterialOnGpu {
    /// The texture with this content that is there already.
    fn kept(&self, slot: Slot, content: u64) -> Option<wgpu::TextureView> {
        self.textures.iter().find(|t| (t.slot, t.content) == (slot, content)).map(|t| t.view.clone())
    }

    /// Uploads those parts of material `index` that `variant` reads. Textures that `before`, the same material before
    /// an edit, already has are kept.
    #[expect(clippy::too_many_arguments, reason = "the material and the caches of its uploads have different owners")]
    pub(crate) fn new(
        gpu: &Gpu,
        index: usize,
        material: &Material,
        variant: &Variant,
        samplers: &Samplers,
        tables: &mut Tables,
        before: Option<&MaterialOnGpu>,
        stats: &mut RenderStatistics,
    ) -> MaterialOnGpu {
        let mut textures = Vec::new();
        let constants = match material {
            Material::Opaque(opaque) => {
                let ([r, g, b], mut tile) = (opaque.albedo, [0.0; 4]);
                if let Some(pattern) = opaque.pattern.as_ref().filter(|_| variant.patterned()) {
                    let (slot, content) = (Slot::Pattern, pattern_content(pattern));
                    let view = before.and_then(|b| b.kept(slot, content)).unwrap_or_else(|| {
                        let levels = maps::mip_chain(pattern.width, pattern.height, rgb(&pattern.texels), None);
                        let new = maps::upload(gpu, "pattern", &levels);
                        stats.upload(&format!("opaque {index} pattern"), new.bytes);
                        new.view
                    });
                    textures.push(Texture { slot, content, view });
                    let ([x, y], [wide, deep]) = (pattern.corner, pattern.size);
                    tile = [x, y, 1.0 / wide, 1.0 / deep];
                }
                gpu.uniform("opaque constants", &[[r, g, b, 0.0], tile])
            }
            Material::Leaf(leaf) => {
                let (low, high) = roughness_range(leaf);
                let albedo = variant.albedo().then(|| tables.albedo(leaf.lobe, low, high));
                let means = albedo.as_ref().filter(|_| variant.means()).map(|like| tables.means(leaf.lobe, like));
                let rows = albedo
                    .as_ref()
                    .map_or([0.0; 4], |t| [t.m_min.ln() as f32, (1.0 / (t.m_max / t.m_min).ln()) as f32, 0.0, 0.0]);
                let upload = Upload { gpu, leaf, tables: LobeTables { albedo, means } };
                for of in leaf_slots(variant) {
                    let (slot, content) = (Slot::Leaf(of), upload.content(of));
                    let view = match before.and_then(|b| b.kept(slot, content)) {
                        Some(kept) => kept,
                        None => {
                            let Some(new) = upload.texture(of) else { continue };
                            stats.upload(&format!("leaf {index} {}", of.name()), new.bytes);
                            new.view
                        }
                    };
                    textures.push(Texture { slot, content, view });
                }
                let constants = Constants {
                    leaf: [leaf.thickness_mm, leaf.lobe.index().unwrap_or(1.0) as f32, 0.0, 0.0],
                    front_curve: curve_constants(&leaf.sides.front),
                    back_curve: curve_constants(&leaf.sides.back),
                    albedo: rows,
                };
                gpu.uniform("leaf constants", &[constants])
            }
        };
        let mut entries = vec![wgpu::BindGroupEntry { binding: 0, resource: constants.as_entire_binding() }];
        if variant.sampled() {
            let sampler = if variant.patterned() { &samplers.tiles } else { &samplers.maps };
            entries.push(wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(sampler) });
        }
        for texture in &textures {
            let resource = wgpu::BindingResource::TextureView(&texture.view);
            entries.push(wgpu::BindGroupEntry { binding: texture.slot.binding(), resource });
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("material"),
            layout: &layout(gpu, variant),
            entries: &entries,
        });
        MaterialOnGpu { group, textures }
    }

    /// The leaf's mask, for the shadow pass.
    pub(crate) fn mask(&self) -> Option<&wgpu::TextureView> {
        self.textures.iter().find(|t| t.slot == Slot::Leaf(LeafSlot::Mask)).map(|t| &t.view)
    }
}
