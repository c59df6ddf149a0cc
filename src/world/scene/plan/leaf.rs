//! The plan of one leaf: which files of its fit are read, which maps are uploaded at which resolution, and how fine the
//! slab curve is.
//!
//! Some decisions depend on figures that are measured when the maps are read ([`crate::loaded`]).

use super::accuracy::AccuracyRow;
use super::{LeafPlan, PlanNeed, PlanOmission, ScenePlan, SideNeeds};
use crate::manifest::{InteriorSource, SceneManifest};
use crate::placed::fits::reader::{self, GAMMA_DELTA, GLOSS, NORMAL, texture};
use crate::placed::leaf::PlacedLeaf;
use crate::{Error, Result};
use mesophyll_fits::leaf_folder::{BLADE, LeafFit, LeafFitFile};
use mesophyll_fits::record::FitTimes;
use mesophyll_optics::side::Side;

/// Bytes of a texel on the adapter: four floats.
pub const TEXEL_BYTES: u64 = 16;
/// Bytes of a texel in one layer of translucency maps on the adapter: four half floats.
pub const TRANSLUCENCY_TEXEL_BYTES: u64 = 8;

/// Bytes of a texture with its mips, which add a third.
fn with_mips(size: [usize; 2], texel_bytes: u64) -> u64 {
    (size[0] * size[1]) as u64 * texel_bytes * 4 / 3
}

fn texture_bytes(size: [usize; 2]) -> u64 {
    with_mips(size, TEXEL_BYTES)
}

/// What a picture would lose without the translucency maps of one side, and the kind of these maps.
#[derive(Debug, Clone, PartialEq)]
pub struct MapLoss {
    /// Error of a displayed value: the 99th percentile over the texels.
    pub p99: f64,
    /// The largest error over the texels.
    pub largest: f64,
    /// Number of layers: 1, or 3 where every channel has its own coefficients.
    pub layers: usize,
    /// The name of the directional basis.
    pub basis: String,
}

/// The needs of each side, which follow from the leaf's placements.
pub fn sides(manifest: &SceneManifest, leaf: &PlacedLeaf, free: bool) -> [SideNeeds; 2] {
    // With light between leaves, every side is lit by light that depends on direction.
    let between = manifest.transfer.is_some();
    let (sun, sky) = (manifest.sun.is_some(), manifest.sky.is_some() || between);
    let asked = leaf.translucent.is_some() && sun;
    let (f, cards) = (leaf.facing, leaf.on_cards);
    [0, 1].map(|side| {
        if free && leaf.mesh.is_some() {
            let fitted = leaf.fitted.as_ref().is_some_and(|f| f.has(Side::ALL[side]));
            let has = leaf.uniform || fitted;
            return SideNeeds {
                rho_d: has,
                rho_t: has,
                gloss: has,
                normal: fitted,
                translucency: fitted && asked,
                mean: false,
            };
        }
        let rho_d = f.lit[side] || (sky && f.seen[side]);
        let translucency = asked && f.through[1 - side];
        SideNeeds {
            rho_d,
            rho_t: f.through[1 - side] || (sky && f.seen[1 - side]),
            gloss: rho_d,
            translucency,
            // Under a sky that varies, the light of both sides depends on their normals.
            normal: f.lit[side]
                || (f.through[1 - side] && !translucency)
                || ((manifest.varied_sky() || between) && (f.seen[side] || f.seen[1 - side])),
            mean: cards.seen[side] || cards.through[1 - side] || (sky && cards.seen[1 - side]),
        }
    })
}

impl ScenePlan {
    /// Lists the leaf's fit and its translucency maps as needed or left out.
    pub(super) fn list_fits(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf) {
        let name = &manifest.leaves[leaf.index].name;
        if !leaf.used {
            let folder = manifest.leaves[leaf.index].fit().and_then(|f| f.fit.as_ref()).map(|f| manifest.resolve(f));
            let bytes = folder.as_ref().and_then(|f| std::fs::read_dir(f).ok()).map_or(0, |entries| {
                entries.flatten().filter_map(|e| e.metadata().ok()).filter(|m| m.is_file()).map(|m| m.len()).sum()
            });
            let ms = folder.as_ref().and_then(|f| FitTimes::read(f).ok()).map(|t| t.total_s * 1e3);
            self.leave_out(PlanOmission::new(
                format!("fit {name}"),
                "no instance and no card shows this leaf",
                bytes,
                ms,
            ));
            return;
        }
        let stated =
            manifest.leaves[leaf.index].look().is_some() || leaf.fitted.as_ref().is_some_and(LeafFit::is_stated);
        let what = if stated { "stated look" } else { "fit" };
        let fits = [
            leaf.source.as_ref().map(|source| (format!("{what} {name}"), source, leaf.fitted.as_ref())),
            leaf.translucent
                .as_ref()
                .filter(|_| self.leaves[leaf.index].sides.iter().any(|s| s.translucency))
                .map(|t| (format!("fit {name} translucency"), &t.source, t.fitted.as_ref())),
        ];
        for (name, source, fitted) in fits.into_iter().flatten() {
            let mut need = PlanNeed::new(name, source.why.clone());
            need.status = Some(source.status);
            need.hash = fitted.map(|f| f.record.input_hash.clone());
            self.need(need);
        }
        if let Some((side, other)) = leaf.fitted.as_ref().and_then(LeafFit::unmeasured) {
            self.need(PlanNeed::new(format!("{name}: {} not measured", side.name()), other.said(side)));
        }
        for said in leaf.fitted.iter().flat_map(|f| f.record.stated()) {
            self.need(PlanNeed::new(format!("{name}: stated, not fitted"), said));
        }
    }

    /// Lists the leaf's shape, where its fit exists, and the parts of it that no picture needs.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a side that is needed and that the fit does not have.
    pub fn shape(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, fitted: &LeafFit) -> Result<()> {
        let config = &manifest.leaves[leaf.index];
        for (side, needs) in Side::ALL.into_iter().zip(self.leaves[leaf.index].sides) {
            if (needs.any() || needs.mean) && !fitted.has(side) {
                let what = format!(
                    "the scene shows the {}, which {} does not have; expected other_side = \"mirrored\" beside fit, \
                     other_side = {{ rho_d = [...] }} with a reflection of your own, or a fit of both sides",
                    side.name(),
                    fitted.folder.display()
                );
                return Err(Error::field(&manifest.path, &format!("leaf \"{}\"", config.name), what));
            }
        }
        if leaf.mesh.is_some() {
            let (file, why) = (leaf.mesh_name(), "the shape that is drawn");
            self.need(match config.mesh {
                None => PlanNeed::of_file(fitted, &file, why),
                Some(_) => PlanNeed::new(reader::entry(fitted, &file), why),
            });
        } else {
            let name = format!("{}/{BLADE}", config.name);
            self.leave_out(PlanOmission::new(name, "only a card shows this leaf", reader::bytes(fitted, BLADE), None));
        }
        Ok(())
    }

    /// Lists the parts of a fit that no picture needs.
    pub fn leave_out_errors(&mut self, fitted: &LeafFit) {
        let bytes: u64 = Side::ALL.iter().map(|s| reader::bytes(fitted, &LeafFitFile::Errors.name(*s))).sum();
        let name = format!("{}: error maps and previews", fitted.name);
        self.leave_out(PlanOmission::new(name, "a picture needs no standard errors", bytes, None));
    }

    /// Lists a slab curve, with the rows that were measured while it was refined.
    pub fn curve(&mut self, what: String, rows: Vec<AccuracyRow>) {
        let mut need = PlanNeed::new(what.clone(), "rho_d and rho_t follow the thickness h + delta of each texel");
        if let Some(r) = rows.last() {
            need.amount =
                Some(format!("{} points, interpolation error {:.1e} (measured), {:.2} ms", r.setting, r.error, r.ms));
            need.bytes = Some(r.bytes);
        }
        self.measured.insert(what, rows);
        self.need(need);
    }

    /// Leaves out the gloss of a side on which no light falls.
    pub fn leave_out_gloss(&mut self, leaf: &PlacedLeaf, fitted: &LeafFit, s: usize) {
        let (side, size) = (Side::ALL[s], self.leaves[leaf.index].size);
        if fitted.has(side) {
            let why = format!("no light falls on the {} where a camera sees it", side.name());
            let name = reader::entry(fitted, &texture(side, GLOSS));
            self.leave_out(PlanOmission::new(name, why, texture_bytes(size), None));
        }
    }

    /// Decides about the gloss of a side by its largest contribution to a displayed value; `None` where ρs is 0
    /// everywhere. Returns whether the gloss is kept.
    pub fn gloss(
        &mut self,
        manifest: &SceneManifest,
        leaf: &PlacedLeaf,
        fitted: &LeafFit,
        s: usize,
        most: Option<f64>,
    ) -> bool {
        let tolerated = manifest.tolerated();
        let why = match most {
            None => "matte: rho_s is zero everywhere".to_string(),
            Some(most) if most < tolerated => format!(
                "matte: at the angles of this scene's views and lights a highlight adds at most {most:.1e} to a \
                 displayed value, \
                 the scene tolerates {tolerated:.1e}"
            ),
            Some(_) => {
                // The share of a sky that a lobe reflects depends on the angle between normal and view, even for a
                // constant sky.
                self.leaves[leaf.index].sides[s].normal |= manifest.sky.is_some();
                return true;
            }
        };
        let LeafPlan { sides, size, .. } = &mut self.leaves[leaf.index];
        sides[s].gloss = false;
        let name = reader::entry(fitted, &texture(Side::ALL[s], GLOSS));
        let bytes = texture_bytes(*size);
        self.leave_out(PlanOmission::new(name, why, bytes, None));
        false
    }

    /// Whether a side's translucency maps must be read. If not, lists the reason.
    pub fn wants_translucency(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, s: usize) -> bool {
        let (Some(translucent), Some(fitted)) = (&leaf.translucent, &leaf.fitted) else { return false };
        let side = Side::ALL[s];
        if !fitted.has(side) {
            return false;
        }
        let file = LeafFitFile::Maps.name(side);
        let what = format!("{}/translucency/{file}", fitted.name);
        let LeafPlan { sides, size, .. } = self.leaves[leaf.index];
        if !sides[s].translucency {
            let why = if manifest.sun.is_none() {
                "there is no sun: a sky's light comes through by rho_t alone".to_string()
            } else {
                format!("never back-lit: no camera sees sunlight that entered the {}", side.name())
            };
            let on_disk = translucent.fitted.as_ref().map_or(0, |f| reader::bytes(f, &file));
            self.leave_out(PlanOmission::new(what, why, with_mips(size, TRANSLUCENCY_TEXEL_BYTES) + on_disk, None));
        } else if translucent.fitted.is_none() {
            let mut need = PlanNeed::new(what, shows(side));
            need.status = Some(translucent.source.status);
            self.need(need);
        }
        sides[s].translucency && translucent.fitted.is_some()
    }

    /// Decides about translucency maps that were read, by what a picture would lose without them.
    pub fn translucency(
        &mut self,
        manifest: &SceneManifest,
        leaf: &PlacedLeaf,
        maps: &LeafFit,
        s: usize,
        cost: &MapLoss,
    ) {
        let file = LeafFitFile::Maps.name(Side::ALL[s]);
        let what = reader::entry(maps, &file);
        let on_disk = reader::bytes(maps, &file);
        let LeafPlan { sides, size, .. } = &mut self.leaves[leaf.index];
        if cost.largest < manifest.tolerated() && !self.free {
            (sides[s].translucency, sides[s].normal) = (false, true);
            let why = format!(
                "by rho_t and the mapped normal a displayed value is off by {:.1e} at most (measured at every texel), \
                 the scene tolerates {:.1e}",
                cost.largest,
                manifest.tolerated()
            );
            let bytes = cost.layers as u64 * with_mips(*size, TRANSLUCENCY_TEXEL_BYTES) + on_disk;
            self.leave_out(PlanOmission::new(what, why, bytes, None));
            return;
        }
        let mut need = PlanNeed::of_file(maps, &file, shows(Side::ALL[s]));
        need.amount = Some(format!(
            "{}, {}; without it a displayed value is off by {:.3} (99 % of the texels), {:.3} at most (measured)",
            if cost.layers == 1 { "three coefficients a texel" } else { "three coefficients a texel and channel" },
            cost.basis,
            cost.p99,
            cost.largest
        ));
        self.need(need);
    }

    /// Notes the resolution at which the leaf's maps are uploaded, for the nearest pixel's footprint in texels.
    /// `textures` is the number of W's textures that were read.
    pub fn resolution(&mut self, name: &str, index: usize, footprint: f64, textures: u64) {
        let LeafPlan { sides, size, block } = self.leaves[index];
        let (w, h) = (size[0].div_ceil(block), size[1].div_ceil(block));
        let why = format!("the nearest pixel covers {footprint:.2} texels a side");
        let mut need = PlanNeed::new(format!("{name}: maps at {w}x{h}"), why);
        need.amount = Some(format!("blocks of {block}x{block} texels"));
        self.need(need);
        if block > 1 {
            let maps = textures + sides.iter().map(|s| u64::from(s.normal)).sum::<u64>();
            let saved = maps * (texture_bytes(size) - texture_bytes([w, h]));
            let name = format!("{name}: map detail finer than {block}x{block} texels");
            self.leave_out(PlanOmission::new(name, "no pixel is small enough to show it", saved, None));
        }
    }

    /// Lists the files of one side. `maps_there` tells whether its translucency maps were read.
    pub fn files(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, s: usize, maps_there: bool) {
        let side = Side::ALL[s];
        let Some(fitted) = leaf.fitted.as_ref().filter(|f| f.has(side)) else { return };
        let LeafPlan { sides, size, .. } = self.leaves[leaf.index];
        let plan = self;
        let needs = sides[s];
        let pigment = leaf.interior(&manifest.leaves[leaf.index]) == InteriorSource::Maps;
        let maps = LeafFitFile::Maps.name(side);
        let entry = |what: &str| reader::entry(fitted, &texture(side, what));
        let bytes = texture_bytes(size);
        let need = |plan: &mut ScenePlan, what: &str, why: &str| plan.need(PlanNeed::new(entry(what), why));
        let skip = |plan: &mut ScenePlan, what: &str, why: String| {
            plan.leave_out(PlanOmission::new(entry(what), why, bytes, None))
        };
        let unseen = format!("no camera sees the {} or light that came through it", side.name());
        match (needs.interior(), pigment) {
            (true, false) => {
                let why = match (needs.rho_d, needs.rho_t) {
                    (true, true) => "reflectance where light falls on it, transmittance where light comes through it",
                    (true, false) => "reflectance where light falls on it",
                    _ => "transmittance where light comes through it",
                };
                need(plan, GAMMA_DELTA, why);
                let name = format!("{}: pigment maps, {}", fitted.name, side.name());
                plan.leave_out(PlanOmission::new(name, "the scene asks for W's scalars", 2 * bytes, None));
            }
            (true, true) => skip(plan, GAMMA_DELTA, "the scene asks for pigment maps".into()),
            (false, _) => skip(plan, GAMMA_DELTA, unseen.clone()),
        }
        if needs.gloss {
            need(plan, GLOSS, "highlights of the sun or the sky show");
        }
        if needs.normal {
            let why = if manifest.varied_sky() {
                "the sky's light differs with where it turns"
            } else if !leaf.facing.lit[s] && needs.gloss {
                "how much a glossy side mirrors of the sky depends on where it turns"
            } else {
                "the sun falls on this side where it shows"
            };
            need(plan, NORMAL, why);
        } else if needs.translucency {
            // They are needed for the comparison, where there are maps to compare.
            if maps_there {
                need(plan, NORMAL, "what the translucency maps add is measured against it; it is not uploaded");
            }
        } else {
            let why = if needs.any() {
                "no sun falls on this side, and a constant sky asks a matte side for no direction".into()
            } else {
                unseen.clone()
            };
            skip(plan, NORMAL, why);
        }
        if needs.any() || needs.mean {
            let why = if pigment {
                "pigment maps, and the reference renderer's own path to the leaf"
            } else {
                "the reference renderer's own path to the leaf"
            };
            plan.need(PlanNeed::of_file(fitted, &maps, why));
        } else {
            let what = PlanOmission::new(reader::entry(fitted, &maps), unseen, reader::bytes(fitted, &maps), None);
            plan.leave_out(what);
        }
    }
}

fn shows(side: Side) -> String {
    format!("sunlight that enters the {} shows on the other side", side.name())
}
