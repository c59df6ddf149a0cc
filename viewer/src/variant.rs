//! The variants of a material's shader. A variant follows from what the scene's lights and the material need. Equal
//! variants share a pipeline.

use crate::gpu::Gpu;
use crate::passes::bend::{self, Ride};
use crate::passes::place;
use crate::scene::{Instance, Interior, LeafMaterial, Material, Scene, SideMaps, Sides, TranslucencyBasis};
use crate::shader::Defines;
use crate::stand;
use mesophyll_base::surface::gloss::LobeKind;

/// The parts of the main pass that a mesh in a material needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Variant {
    pub lights: Lights,
    pub surface: Surface,
    pub msaa: u32,
    /// Whether the mesh has levels of detail. The drawn surface may then differ from the one in the shadow maps.
    pub levels: bool,
    /// How sections move the vertices of the mesh in the vertex stage, where they do.
    pub bend: Option<Ride>,
    /// Whether they turn the normals too.
    pub turn: bool,
    /// Whether its plants stand in many places and are stored once.
    pub stand: bool,
    /// How the mesh's anchors are read, where light arrives by a transfer.
    pub anchored: Option<Anchored>,
    /// Whether its vertices have shares of the sun, so that shadow maps are not needed.
    pub shares: bool,
}

/// How the anchors of a mesh are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Anchored {
    pub grid: [u32; 2],
    pub rows: u32,
    /// Number of bands of the harmonics among the rows.
    pub bands: u32,
    pub levels: u32,
    /// Number of pieces of the mesh, where there are levels.
    pub pieces: u32,
}

/// What the scene's lights need.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct Lights {
    pub sun: bool,
    /// Number of shadow maps; 0 without shadows.
    pub shadow: u32,
    /// Whether there is a sky, constant or not.
    pub sky: bool,
    /// Whether the sky's light depends on direction. It then comes as harmonics or by a transfer.
    pub dome: bool,
    /// Whether light arrives between and by way of other surfaces.
    pub transfer: bool,
    /// Whether vertices have shares of the sun, at least those of some instances.
    pub shares: bool,
    /// Whether a tube lights the scene.
    pub scanner: bool,
}

/// What the material needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Surface {
    Leaf(LeafSurface),
    Opaque {
        /// Whether a pattern takes the place of the albedo.
        pattern: bool,
    },
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct LeafSurface {
    pub mask: bool,
    /// Whether the mask is sampled at the pixel's samples instead of at its centre.
    pub sample_mask: bool,
    pub sides: Sides<SideVariant>,
    /// Whether translucency maps are evaluated for light that is bent towards the normal.
    pub bent: bool,
    /// The lobe; `None` where neither side has gloss.
    pub lobe: Option<LobeKind>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct SideVariant {
    /// Whether each texel has its own ρd and ρt, instead of a slab curve.
    pub maps: bool,
    /// Whether it has neither, because no light of this side's interior reaches a camera.
    pub black: bool,
    pub gloss: bool,
    pub normal: bool,
    /// Number of layers of the coefficient map for sunlight that enters this side: 0 without a map, 1, or 3 for colour.
    pub translucency: u32,
}

/// Number of shadow maps that a scene needs: 0 without a sun, or where all vertices have shares of it.
pub(crate) fn shadow_layers(scene: &Scene) -> u32 {
    let casts = scene.sun.is_some() && scene.instances.iter().any(|i| !knows_sun(scene, i));
    if casts { scene.shadow_samples } else { 0 }
}

/// Whether an instance's vertices have shares of the sun.
fn knows_sun(scene: &Scene, instance: &Instance) -> bool {
    scene.sun.is_some() && scene.sun_shares.is_some() && instance.first_share.is_some()
}

impl Lights {
    pub(crate) fn of(scene: &Scene) -> Lights {
        let transfer = scene.transfer.is_some();
        let dome = scene.dome.is_some() || transfer;
        Lights {
            sun: scene.sun.is_some(),
            shadow: shadow_layers(scene),
            sky: scene.sky.is_some() || dome,
            dome,
            transfer,
            shares: scene.sun.is_some() && scene.sun_shares.is_some(),
            scanner: scene.scanner.is_some(),
        }
    }

    /// Whether any light reaches a surface. Without light no map is read.
    pub(crate) fn any(&self) -> bool {
        self.sun || self.sky || self.scanner
    }
}

impl LeafSurface {
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, lights: &Lights, leaf: &LeafMaterial) -> LeafSurface {
        let side = |side: &SideMaps| {
            let shines = |g: &Vec<[f32; 4]>| g.iter().any(|t| t[0] > 0.0 || t[1] > 0.0 || t[2] > 0.0);
            let gloss = lights.any() && side.gloss.as_ref().is_some_and(shines);
            // Under a constant sky, only the gloss's directional albedo depends on the normal.
            let seen = lights.sun || lights.dome || lights.scanner || (lights.sky && gloss);
            SideVariant {
                maps: matches!(side.interior, Interior::Maps { .. }),
                black: side.is_black(),
                gloss,
                normal: side.normal.is_some() && seen,
                translucency: side.translucency.as_ref().filter(|_| lights.sun).map_or(0, |t| t.layers().len() as u32),
            }
        };
        let sides = Sides::of(|s| side(&leaf.sides[s]));
        let bends = |s: &SideMaps| s.translucency.as_ref().is_some_and(|t| t.basis == TranslucencyBasis::Bent);
        LeafSurface {
            mask: leaf.mask.is_some(),
            // For a sample mask, Naga writes GLSL that GL drivers refuse. With GL the outline is cut at the pixels'
            // centres.
            sample_mask: leaf.mask.is_some() && scene.msaa > 1 && !gpu.is_gl(),
            bent: lights.sun && leaf.sides.iter().any(|(_, s)| bends(s)),
            lobe: sides.iter().any(|(_, s)| s.gloss).then(|| leaf.lobe.into()),
            sides,
        }
    }

    fn any(&self, of: impl Fn(&SideVariant) -> bool) -> bool {
        self.sides.iter().any(|(_, s)| of(s))
    }
}

impl Variant {
    /// The variant for `instances` of the scene, which all have one mesh and one material.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, instances: &[Instance]) -> Option<Variant> {
        let first = instances.first()?;
        let lights = Lights::of(scene);
        let stand = first.stand.is_some();
        let bend = bend::kind(scene, instances).filter(|_| stand || !place::whole(gpu, scene, instances));
        Some(Variant {
            lights,
            surface: match &scene.materials[first.material] {
                Material::Leaf(leaf) => Surface::Leaf(LeafSurface::new(gpu, scene, &lights, leaf)),
                Material::Opaque(opaque) => Surface::Opaque { pattern: opaque.pattern.is_some() && lights.any() },
            },
            msaa: scene.msaa,
            levels: !scene.meshes[first.mesh].details.is_empty(),
            bend,
            stand,
            turn: bend.is_some() && scene.sections.as_ref().is_some_and(|s| s.turn_normals),
            anchored: scene.transfer.as_ref().zip(scene.meshes[first.mesh].anchors.as_ref()).map(
                |(transfer, anchors)| Anchored {
                    grid: anchors.grid,
                    rows: anchors.rows,
                    bands: transfer.gloss_bands as u32,
                    levels: anchors.levels,
                    pieces: if anchors.levels > 1 { anchors.pieces() } else { 1 },
                },
            ),
            shares: instances.iter().all(|i| knows_sun(scene, i)),
        })
    }

    pub(crate) fn leaf(&self) -> Option<&LeafSurface> {
        match &self.surface {
            Surface::Leaf(leaf) => Some(leaf),
            Surface::Opaque { .. } => None,
        }
    }

    /// Whether the vertex stage reads the first row of arriving light and the first share of the sun of an instance.
    pub(crate) fn begins(&self) -> bool {
        self.anchored.is_some() || self.shares
    }

    /// Whether it reads shadow maps.
    fn shadowed(&self) -> bool {
        self.lights.shadow > 0 && !self.shares
    }

    pub(crate) fn masked(&self) -> bool {
        self.leaf().is_some_and(|l| l.mask)
    }

    pub(crate) fn tangent(&self) -> bool {
        self.leaf().is_some_and(|l| l.any(|s| s.normal || s.translucency > 0))
    }

    /// Whether it needs the gloss's directional albedo, for the sky.
    pub(crate) fn albedo(&self) -> bool {
        self.lights.sky && self.leaf().is_some_and(|l| l.lobe.is_some())
    }

    /// Whether it needs the gloss's mean direction and bands, for a dome.
    pub(crate) fn means(&self) -> bool {
        self.lights.dome && self.albedo()
    }

    /// Whether highlights are averaged over the pixel where the normal turns quickly across it.
    pub(crate) fn supersample(&self) -> bool {
        self.lights.sun && self.msaa > 1 && self.leaf().is_some_and(|l| l.lobe.is_some() && l.any(|s| s.normal))
    }

    pub(crate) fn sampled(&self) -> bool {
        self.patterned() || self.leaf().is_some_and(|l| self.lights.any() || l.mask)
    }

    /// Whether a pattern takes the place of an opaque surface's albedo.
    pub(crate) fn patterned(&self) -> bool {
        self.surface == Surface::Opaque { pattern: true }
    }

    /// The names and constants with which all parts of the shader are assembled.
    pub(crate) fn defines(&self) -> Defines {
        let lights = &self.lights;
        let defines = stand::defines(bend::defines(Defines::default(), self.bend, 0), self.stand)
            .set("TURN", self.turn)
            .constant("SHADOW_LAYERS", lights.shadow)
            .set("SUN", lights.sun)
            .set("SHADOW", self.shadowed())
            .set("SHARES", self.shares)
            .set("LEVELS", self.levels)
            .set("SKY", lights.sky)
            .set("DOME", lights.dome)
            .set("TRANSFER", self.anchored.is_some())
            .set("SCANNER", lights.scanner)
            .set("LIT", lights.any());
        let none = Anchored { grid: [1; 2], rows: 0, bands: 7, levels: 1, pieces: 1 };
        let Anchored { grid, rows, bands, levels, pieces } = self.anchored.unwrap_or(none);
        let defines = defines
            .constant("GRID_X", grid[0])
            .constant("GRID_Y", grid[1])
            .constant("ROWS", rows)
            .constant("BANDS", bands)
            .constant("ANCHOR_LEVELS", levels)
            .constant("PIECES", pieces);
        let Some(leaf) = self.leaf() else { return defines.set("PATTERN", self.patterned()) };
        let curve = |s: &SideVariant| !s.maps && !s.black;
        defines
            .set("LEAF", true)
            .set("MASK", leaf.mask)
            .set("SAMPLE_MASK", leaf.sample_mask)
            .set("SAMPLED", self.sampled())
            .set("TANGENT", self.tangent())
            .set("GLOSS", leaf.lobe.is_some())
            .set(leaf.lobe.map_or("", Into::into), leaf.lobe.is_some())
            .set("ALBEDO", self.albedo())
            .set("SUPERSAMPLE", self.supersample())
            .set("CURVE", lights.any() && leaf.any(curve))
            .set("TRANSLUCENCY", leaf.any(|s| s.translucency > 0))
            .set("FRONT_TRANSLUCENCY", leaf.sides.front.translucency > 0)
            .set("BACK_TRANSLUCENCY", leaf.sides.back.translucency > 0)
            .set("COLOUR", leaf.any(|s| s.translucency == 3))
            .set("FRONT_COLOUR", leaf.sides.front.translucency == 3)
            .set("BACK_COLOUR", leaf.sides.back.translucency == 3)
            .set("BENT", leaf.bent)
    }

    /// The names and constants with which a side's part of a leaf's shader is assembled.
    pub(crate) fn side_defines(&self, leaf: &LeafSurface, side: &SideVariant) -> Defines {
        let lit = self.lights.any();
        Defines::default()
            .set("LIT", lit)
            .set("SUN", self.lights.sun)
            .set("TANGENT", self.tangent())
            .set("GLOSS", leaf.lobe.is_some())
            .set("CURVE", lit && !side.maps && !side.black)
            .set("MAPS", lit && side.maps)
            .set("GLOSS_MAP", side.gloss)
            .set("SUPERSAMPLE", self.supersample())
            .set("NORMAL", side.normal)
            .set("TRANSLUCENCY", side.translucency > 0)
            .set("COLOUR", side.translucency == 3)
    }

    /// The pipeline's name in `Stats`, such as `main: sun, shadow 8, sky, front gloss normal, ggx`.
    pub(crate) fn name(&self) -> String {
        let mut words = Vec::new();
        let mut say = |on: bool, word: String| {
            if on {
                words.push(word);
            }
        };
        let lights = &self.lights;
        say(self.leaf().is_none(), "opaque".into());
        say(self.patterned(), "pattern".into());
        say(lights.sun, "sun".into());
        say(self.shadowed(), format!("shadow {}", lights.shadow));
        say(self.shares, "shares".into());
        let sky = match (lights.transfer, lights.dome) {
            (true, _) => "transfer",
            (false, true) => "dome",
            (false, false) => "sky",
        };
        say(lights.sky, sky.into());
        say(lights.scanner, "scanner".into());
        if let Some(leaf) = self.leaf() {
            say(leaf.mask, "mask".into());
            for (name, side) in leaf.sides.iter() {
                let parts = [
                    (side.maps && lights.any(), " maps"),
                    (side.black && lights.any(), " black"),
                    (side.gloss, " gloss"),
                    (side.normal, " normal"),
                    (side.translucency > 0 && leaf.bent, " bent"),
                    (side.translucency == 1, " translucency"),
                    (side.translucency == 3, " translucency colour"),
                ];
                let parts: String = parts.iter().filter(|(on, _)| *on).map(|(_, word)| *word).collect();
                say(!parts.is_empty(), format!("{name}{parts}"));
            }
            if let Some(lobe) = leaf.lobe {
                say(true, format!("{lobe:?}").to_lowercase());
            }
        }
        say(self.bend.is_some(), if self.turn { "sections" } else { "sections without turns" }.into());
        say(self.stand, "stand".into());
        say(self.msaa > 1, format!("{} samples", self.msaa));
        if words.is_empty() { "main: unlit".into() } else { format!("main: {}", words.join(", ")) }
    }
}
