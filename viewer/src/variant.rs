//! What a leaf's shader holds: the closure of what the scene's lights and the leaf's maps need. Equal variants share a
//! pipeline.

use crate::gpu::Gpu;
use crate::passes::bend;
use crate::scene::{Basis, Interior, Leaf, Lobe, Scene, Side};
use crate::shader::Defines;

/// Which parts of the main pass a leaf needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Variant {
    pub sun: bool,
    /// Shadow maps; 0 without a shadow.
    pub shadow: u32,
    pub sky: bool,
    /// The sky's light comes as harmonics.
    pub dome: bool,
    /// A tube lights it.
    pub scanner: bool,
    pub mask: bool,
    /// The mask is sampled where the pixel's samples are, instead of at its centre.
    pub sample_mask: bool,
    pub front: SideVariant,
    pub back: SideVariant,
    /// Translucency maps are looked up with the light bent towards the normal.
    pub bent: bool,
    pub lobe: LobeKind,
    pub msaa: u32,
    /// The mesh has levels of detail: what is drawn may be another surface than the one in the shadow maps.
    pub levels: bool,
    /// Branches of the scene, where an instance rides on one: its vertices are bent. 0: they are not.
    pub branches: u32,
    /// The branches sway by a motion texture.
    pub motion: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct SideVariant {
    /// ρd and ρt a texel instead of a slab curve.
    pub maps: bool,
    /// Neither: no light of this side's interior reaches a camera.
    pub black: bool,
    pub gloss: bool,
    pub normal: bool,
    /// Layers of the coefficient map for the sun's light that enters this side: 0 without one, 1, or 3 for a colour.
    pub translucency: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum LobeKind {
    None,
    Beckmann,
    Ggx,
    CookTorrance,
}

/// Shadow maps that a scene needs: none without a sun.
pub(crate) fn shadow_layers(scene: &Scene) -> u32 {
    let casts = scene.sun.is_some() && !scene.instances.is_empty();
    if casts { scene.shadow_samples } else { 0 }
}

impl Variant {
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, leaf: &Leaf) -> Variant {
        let (sun, dome) = (scene.sun.is_some(), scene.dome.is_some());
        let sky = scene.sky.is_some() || dome;
        let scanner = scene.scanner.is_some();
        let side = |side: &Side| {
            let gloss = (sun || sky || scanner)
                && side.gloss.as_ref().is_some_and(|g| g.iter().any(|t| t[0] > 0.0 || t[1] > 0.0 || t[2] > 0.0));
            // A constant sky sees the normal only through the gloss's directional albedo.
            let normal = side.normal.is_some() && (sun || dome || scanner || (sky && gloss));
            let translucency = side.translucency.as_ref().filter(|_| sun).map_or(0, |t| t.layers().len() as u32);
            SideVariant {
                maps: matches!(side.interior, Interior::Maps { .. }),
                black: side.is_black(),
                gloss,
                normal,
                translucency,
            }
        };
        let (front, back) = (side(&leaf.front), side(&leaf.back));
        let bent = sun
            && [&leaf.front, &leaf.back]
                .iter()
                .any(|s| s.translucency.as_ref().is_some_and(|t| t.basis == Basis::Bent));
        let lobe = match leaf.lobe {
            _ if !front.gloss && !back.gloss => LobeKind::None,
            Lobe::Beckmann => LobeKind::Beckmann,
            Lobe::Ggx => LobeKind::Ggx,
            Lobe::CookTorrance { .. } => LobeKind::CookTorrance,
        };
        let mask = leaf.mask.is_some();
        // Naga writes GLSL for a sample mask that GL drivers refuse: there the outline is cut at the pixels' centres.
        let sample_mask = mask && scene.msaa > 1 && !gpu.is_gl();
        Variant {
            sun,
            shadow: shadow_layers(scene),
            sky,
            dome,
            scanner,
            mask,
            sample_mask,
            front,
            back,
            bent,
            lobe,
            msaa: scene.msaa,
            levels: !leaf.mesh.details.is_empty(),
            branches: 0,
            motion: false,
        }
    }

    /// Whether any light reaches the leaf: without one no map is read.
    pub(crate) fn lit(&self) -> bool {
        self.sun || self.sky || self.scanner
    }

    pub(crate) fn tangent(&self) -> bool {
        [self.front, self.back].iter().any(|s| s.normal || s.translucency > 0)
    }

    /// The gloss's directional albedo, for the sky.
    pub(crate) fn albedo(&self) -> bool {
        self.sky && self.lobe != LobeKind::None
    }

    /// The gloss's mean direction and bands, for a dome.
    pub(crate) fn means(&self) -> bool {
        self.dome && self.albedo()
    }

    /// Highlights are averaged over the pixel where the normal turns quickly across it.
    pub(crate) fn supersample(&self) -> bool {
        self.sun && self.msaa > 1 && self.lobe != LobeKind::None && (self.front.normal || self.back.normal)
    }

    pub(crate) fn sampled(&self) -> bool {
        self.lit() || self.mask
    }

    pub(crate) fn defines(&self) -> Defines {
        let lit = self.lit();
        bend::defines(Defines::default(), self.branches, self.motion)
            .constant("SHADOW_LAYERS", self.shadow)
            .set("SUN", self.sun)
            .set("SHADOW", self.shadow > 0)
            .set("LEVELS", self.levels)
            .set("SKY", self.sky)
            .set("DOME", self.dome)
            .set("SCANNER", self.scanner)
            .set("LIT", lit)
            .set("MASK", self.mask)
            .set("SAMPLE_MASK", self.sample_mask)
            .set("SAMPLED", self.sampled())
            .set("TANGENT", self.tangent())
            .set("GLOSS", self.lobe != LobeKind::None)
            .set("GGX", self.lobe == LobeKind::Ggx)
            .set("FRESNEL", self.lobe == LobeKind::CookTorrance)
            .set("ALBEDO", self.albedo())
            .set("SUPERSAMPLE", self.supersample())
            .set("FRONT_CURVE", lit && !self.front.maps && !self.front.black)
            .set("BACK_CURVE", lit && !self.back.maps && !self.back.black)
            .set("FRONT_MAPS", lit && self.front.maps)
            .set("BACK_MAPS", lit && self.back.maps)
            .set("FRONT_GLOSS", self.front.gloss)
            .set("BACK_GLOSS", self.back.gloss)
            .set("FRONT_NORMAL", self.front.normal)
            .set("BACK_NORMAL", self.back.normal)
            .set("FRONT_TRANSLUCENCY", self.front.translucency > 0)
            .set("BACK_TRANSLUCENCY", self.back.translucency > 0)
            .set("FRONT_COLOUR", self.front.translucency == 3)
            .set("BACK_COLOUR", self.back.translucency == 3)
            .set("BENT", self.bent)
            .set("COLOUR", self.front.translucency == 3 || self.back.translucency == 3)
    }

    /// The pipeline's name in `Stats`, such as `main: sun, shadow 8, sky, front gloss normal, ggx`.
    pub(crate) fn name(&self) -> String {
        let mut words = Vec::new();
        let mut say = |on: bool, word: String| {
            if on {
                words.push(word);
            }
        };
        say(self.sun, "sun".into());
        say(self.shadow > 0, format!("shadow {}", self.shadow));
        say(self.sky, if self.dome { "dome" } else { "sky" }.into());
        say(self.scanner, "scanner".into());
        say(self.mask, "mask".into());
        for (name, side) in [("front", self.front), ("back", self.back)] {
            let parts = [
                (side.maps && self.lit(), " maps"),
                (side.black && self.lit(), " black"),
                (side.gloss, " gloss"),
                (side.normal, " normal"),
                (side.translucency > 0 && self.bent, " bent"),
                (side.translucency == 1, " translucency"),
                (side.translucency == 3, " translucency colour"),
            ];
            let parts: String = parts.iter().filter(|(on, _)| *on).map(|(_, word)| *word).collect();
            say(!parts.is_empty(), format!("{name}{parts}"));
        }
        say(self.lobe != LobeKind::None, format!("{:?}", self.lobe).to_lowercase());
        say(self.branches > 0, if self.motion { "sway".into() } else { "bend".into() });
        say(self.msaa > 1, format!("{} samples", self.msaa));
        if words.is_empty() { "main: unlit".into() } else { format!("main: {}", words.join(", ")) }
    }
}
