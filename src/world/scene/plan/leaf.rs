//! The plan of one leaf: which files of its fit are read, which maps are uploaded at which resolution, and how fine the
//! slab curve is.
//!
//! What must be read of a leaf is decided before ([`super::needs`]).

use super::accuracy::AccuracyRow;
use super::findings::{GlossFinding, LeafFindings, MapDetail, MapLoss};
use super::{LeafPlan, PlanNeed, PlanOmission, ScenePlan};
use crate::manifest::{InteriorSource, SceneManifest};
use crate::placed::fits::reader::{self, GAMMA_DELTA, GLOSS, NORMAL, texture};
use crate::placed::leaf::PlacedLeaf;
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

impl ScenePlan {
    /// Decides about a leaf by what its maps told.
    pub(super) fn leaf(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, found: &LeafFindings) {
        let Some(fitted) = &leaf.fitted else { return };
        self.shape(manifest, leaf, fitted);
        for (side, told) in found.sides.iter() {
            self.leaves[leaf.index].size = told.size;
            if let Some(rows) = &told.curve {
                self.curve(curve_name(fitted, side), rows.clone());
            }
            match told.gloss {
                Some(found) => self.gloss(manifest, leaf, fitted, side, found),
                None => self.leave_out_gloss(leaf, fitted, side),
            }
            self.translucency(manifest, leaf, side, told.translucency.as_ref());
            self.files(manifest, leaf, side, told.translucency.is_some());
        }
        if let Some(footprint) = found.footprint {
            self.resolution(&manifest.leaves[leaf.index].name, leaf.index, footprint, found);
        }
        self.leave_out_errors(fitted);
    }

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
    fn shape(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, fitted: &LeafFit) {
        let config = &manifest.leaves[leaf.index];
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
    }

    /// Lists the parts of a fit that no picture needs.
    fn leave_out_errors(&mut self, fitted: &LeafFit) {
        let bytes: u64 = Side::ALL.iter().map(|s| reader::bytes(fitted, &LeafFitFile::Errors.name(*s))).sum();
        let name = format!("{}: error maps and previews", fitted.name);
        self.leave_out(PlanOmission::new(name, "a picture needs no standard errors", bytes, None));
    }

    /// Lists a slab curve, with the rows that were measured while it was refined.
    fn curve(&mut self, what: String, rows: Vec<AccuracyRow>) {
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
    fn leave_out_gloss(&mut self, leaf: &PlacedLeaf, fitted: &LeafFit, side: Side) {
        let size = self.leaves[leaf.index].size;
        if fitted.has(side) {
            let why = format!("no light falls on the {} where a camera sees it", side.name());
            let name = reader::entry(fitted, &texture(side, GLOSS));
            self.leave_out(PlanOmission::new(name, why, texture_bytes(size), None));
        }
    }

    /// Decides about the gloss of a side by what it adds to a displayed value.
    fn gloss(
        &mut self,
        manifest: &SceneManifest,
        leaf: &PlacedLeaf,
        fitted: &LeafFit,
        side: Side,
        found: GlossFinding,
    ) {
        if self.leaves[leaf.index].gloss_shows(manifest, side, found) {
            return;
        }
        let why = match found {
            GlossFinding::Matte => "matte: rho_s is zero everywhere".to_string(),
            GlossFinding::AtMost(most) => format!(
                "matte: at the angles of this scene's views and lights a highlight adds at most {most:.1e} to a \
                 displayed value, \
                 the scene tolerates {:.1e}",
                manifest.tolerated()
            ),
        };
        let name = reader::entry(fitted, &texture(side, GLOSS));
        let bytes = texture_bytes(self.leaves[leaf.index].size);
        self.leave_out(PlanOmission::new(name, why, bytes, None));
    }

    /// Decides about a side's translucency maps, by what a picture would lose without them where they were read.
    fn translucency(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, side: Side, loss: Option<&MapLoss>) {
        let (Some(translucent), Some(fitted)) = (&leaf.translucent, &leaf.fitted) else { return };
        if !fitted.has(side) {
            return;
        }
        let file = LeafFitFile::Maps.name(side);
        let plan = &mut self.leaves[leaf.index];
        let size = plan.size;
        let on_disk = translucent.fitted.as_ref().map_or(0, |f| reader::bytes(f, &file));
        let (Some(maps), Some(loss)) = (&translucent.fitted, loss) else {
            let what = format!("{}/translucency/{file}", fitted.name);
            if plan.needs(side).translucency {
                let mut need = PlanNeed::new(what, shows(side));
                need.status = Some(translucent.source.status);
                self.need(need);
            } else {
                let why = if manifest.sun.is_none() {
                    "there is no sun: a sky's light comes through by rho_t alone".to_string()
                } else {
                    format!("never back-lit: no camera sees sunlight that entered the {}", side.name())
                };
                self.leave_out(PlanOmission::new(what, why, with_mips(size, TRANSLUCENCY_TEXEL_BYTES) + on_disk, None));
            }
            return;
        };
        if !plan.maps_show(manifest, side, loss, self.free) {
            let why = format!(
                "by rho_t and the mapped normal a displayed value is off by {:.1e} at most (measured at every texel), \
                 the scene tolerates {:.1e}",
                loss.largest,
                manifest.tolerated()
            );
            let bytes = loss.layers as u64 * with_mips(size, TRANSLUCENCY_TEXEL_BYTES) + on_disk;
            self.leave_out(PlanOmission::new(reader::entry(maps, &file), why, bytes, None));
            return;
        }
        let mut need = PlanNeed::of_file(maps, &file, shows(side));
        need.amount = Some(format!(
            "{}, {}; without it a displayed value is off by {:.3} (99 % of the texels), {:.3} at most (measured)",
            if loss.layers == 1 { "three coefficients a texel" } else { "three coefficients a texel and channel" },
            loss.basis,
            loss.p99,
            loss.largest
        ));
        self.need(need);
    }

    /// Chooses the resolution at which the leaf's maps are uploaded, for the nearest pixel's footprint in texels.
    fn resolution(&mut self, name: &str, index: usize, footprint: f64, found: &LeafFindings) {
        let mut longest = |what: String, detail: &Option<MapDetail>| {
            let MapDetail { rows, allowed } = detail.as_ref()?;
            self.choose(&format!("{name}/{what} resolution"), rows.clone(), *allowed).map(|row| row.setting)
        };
        let own = found.sides.iter().filter_map(|(s, told)| longest(format!("{} map", s.name()), &told.detail)).min();
        let shown = found
            .sides
            .iter()
            .filter_map(|(s, t)| longest(format!("translucency {}", s.name()), &t.translucency_detail));
        self.leaves[index].block = shown.chain([own.unwrap_or(1)]).min().unwrap_or(1);
        let LeafPlan { sides, size, block } = self.leaves[index];
        let curves = found.sides.iter().filter(|(_, told)| told.curve.is_some()).count();
        let textures = curves as u64 + sides.iter().map(|s| u64::from(s.gloss)).sum::<u64>();
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
    fn files(&mut self, manifest: &SceneManifest, leaf: &PlacedLeaf, side: Side, maps_there: bool) {
        let Some(fitted) = leaf.fitted.as_ref().filter(|f| f.has(side)) else { return };
        let (needs, size) = (self.leaves[leaf.index].needs(side), self.leaves[leaf.index].size);
        let plan = self;
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
            } else if !leaf.facing.lit[side] && needs.gloss {
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

/// The name of a side's slab curve.
pub fn curve_name(fitted: &LeafFit, side: Side) -> String {
    format!("{}/{} slab curve", fitted.name, side.name())
}

fn shows(side: Side) -> String {
    format!("sunlight that enters the {} shows on the other side", side.name())
}
