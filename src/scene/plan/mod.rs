//! The plan: the closure of what a scene needs, how much of it, and what is left out, why, and what that saved.
//!
//! Nothing is fitted, read, uploaded or compiled that the plan does not list. What is needed follows from the scene
//! alone (which sides the cameras see, what light falls on them) and from the fits' own figures; how much follows from
//! the scene's tolerance and from rows of error against cost that are measured while planning.

pub mod accuracy;
mod branches;
pub mod display;
mod gloss;
pub mod leaf;
pub mod light;
mod warnings;

use crate::Result;
use crate::fits::fitted::Fitted;
use crate::fits::source::{self, InputHash, Source, Status};
use crate::ledger::Ledger;
use crate::loaded::translucency::{self, Translucent};
use crate::manifest::{Manifest, ViewKind};
use crate::placed::branch::{self, Bends, Twig};
use crate::placed::facing::{self, Facing};
use crate::placed::placement::{self, Placement};
use crate::placed::tree;
use accuracy::{Curve, Row};
use glam::DVec3;
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_files::progress::Bar;
use mesophyll_optics::side::Side;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Something the scene needs.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Need {
    pub name: String,
    pub reason: String,
    /// How much of it, where that was a choice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amount: Option<String>,
    /// Content hash, where it is a file of a fit; of the input, where it is a fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hash: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
}

impl Need {
    pub fn new(name: impl Into<String>, reason: impl Into<String>) -> Need {
        Need { name: name.into(), reason: reason.into(), amount: None, hash: None, bytes: None, status: None }
    }
}

/// Something the scene could have had.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LeftOut {
    pub name: String,
    pub reason: String,
    /// In words: bytes from sizes, times where they were measured.
    pub saved: String,
    pub saved_bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved_ms: Option<f64>,
}

impl LeftOut {
    /// `bytes` from sizes; `ms` only where it was measured.
    pub fn new(name: impl Into<String>, reason: impl Into<String>, bytes: u64, ms: Option<f64>) -> LeftOut {
        let mut saved = format!("{bytes} bytes (from sizes)");
        if let Some(ms) = ms {
            saved += &format!(", {ms:.1} ms (measured)");
        }
        LeftOut { name: name.into(), reason: reason.into(), saved, saved_bytes: bytes, saved_ms: ms }
    }
}

/// What is needed of one side of a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SideNeeds {
    pub rho_d: bool,
    pub rho_t: bool,
    pub gloss: bool,
    pub normal: bool,
    /// Maps of how the sun comes through that enters this side.
    pub translucency: bool,
    /// Its mean parameters, for a card.
    pub mean: bool,
}

impl SideNeeds {
    /// γ, δ and the slab.
    pub fn interior(&self) -> bool {
        self.rho_d || self.rho_t
    }

    pub fn any(&self) -> bool {
        self.interior() || self.gloss || self.normal
    }
}

/// W's textures of one side, filled beyond the outline; only what the plan needs is read.
#[derive(Debug, Clone, Default)]
pub struct Textures {
    /// γ (RGB) and δ (mm).
    pub gamma_delta: Option<Vec<[f32; 4]>>,
    /// ρs (RGB) and m.
    pub gloss: Option<Vec<[f32; 4]>>,
    /// Where the fit knew γ.
    pub good: Vec<bool>,
}

/// The plan for one leaf.
#[derive(Debug)]
pub struct LeafPlan {
    /// Index into the manifest's leaves.
    pub index: usize,
    /// Drawn by a perspective view, a card or as its scan saw it.
    pub used: bool,
    pub source: Option<Source>,
    /// Open when used and up to date.
    pub fitted: Option<Fitted>,
    pub mesh_path: PathBuf,
    pub mesh: Option<LeafMesh>,
    pub facing: Facing,
    /// Front, back.
    pub sides: [SideNeeds; 2],
    pub textures: [Textures; 2],
    pub curves: [Option<Curve>; 2],
    /// Where the scene asks for it.
    pub translucency: Option<Translucent>,
    /// Size of the maps on disk.
    pub size: [usize; 2],
    /// Maps are averaged over blocks of this many texels a side.
    pub block: usize,
}

/// What a scene needs.
#[derive(Debug, serde::Serialize)]
pub struct Plan {
    pub scene: String,
    pub needed: Vec<Need>,
    pub left_out: Vec<LeftOut>,
    /// Rows of error against cost behind each choice of an amount.
    pub measured: BTreeMap<String, Vec<Row>>,
    /// What is strange about it, and may be meant: a leaf that no view shows, a mesh in another unit.
    pub warnings: Vec<String>,
    /// Hash of the manifest and of every needed file.
    pub hash: String,
    #[serde(skip)]
    pub leaves: Vec<LeafPlan>,
    /// For a window: camera, sun and sliders may take everything anywhere, so that nothing is left out for being small.
    #[serde(skip)]
    pub free: bool,
    /// Where leaves stand at rest.
    #[serde(skip)]
    pub placements: Vec<Placement>,
    /// Where perspective views look from.
    #[serde(skip)]
    pub eyes: Vec<DVec3>,
    /// Branches at rest, with their meshes.
    #[serde(skip)]
    pub twigs: Vec<(Twig, LeafMesh)>,
    /// A tree's wood, and its bark.
    #[serde(skip)]
    pub wood: Option<(LeafMesh, [f64; 3])>,
    /// `None`: nothing bends.
    #[serde(skip)]
    pub bends: Option<Bends>,
    /// 0: none can fall.
    #[serde(skip)]
    pub shadow_samples: u32,
    #[serde(skip)]
    pub shadow_resolution: u32,
    #[serde(skip)]
    pub msaa: u32,
    /// Bands of a physical sky's harmonics.
    #[serde(skip)]
    pub sky_bands: usize,
    /// The sky's coefficients come from the polynomial fit.
    #[serde(skip)]
    pub sun_moves: bool,
    /// Set once that fit was asked for.
    #[serde(skip)]
    pub sky_fitted: OnceLock<()>,
}

/// Towards the sun.
pub fn sun_direction(manifest: &Manifest) -> Option<DVec3> {
    manifest.sun.as_ref().map(|s| {
        let ((sz, cz), (sa, ca)) = (s.zenith_deg.to_radians().sin_cos(), s.azimuth_deg.to_radians().sin_cos());
        DVec3::new(sz * ca, sz * sa, cz)
    })
}

/// Makes the plan. `out` is a run's folder with fits of its own.
///
/// # Errors
/// [`crate::Error::Input`] for a fit that does not exist and cannot be made, a damaged mesh or map, a side the fit does
/// not have.
pub fn make(manifest: &Manifest, out: Option<&Path>, input_hash: Option<InputHash>, ledger: &Ledger) -> Result<Plan> {
    make_for(manifest, out, input_hash, ledger, false)
}

/// The plan for a window, where the camera and the sun move: both sides of every leaf in the scene, at full resolution.
///
/// # Errors
/// As [`make`].
pub fn make_free(
    manifest: &Manifest,
    out: Option<&Path>,
    input_hash: Option<InputHash>,
    ledger: &Ledger,
) -> Result<Plan> {
    make_for(manifest, out, input_hash, ledger, true)
}

fn make_for(
    manifest: &Manifest,
    out: Option<&Path>,
    input_hash: Option<InputHash>,
    ledger: &Ledger,
    free: bool,
) -> Result<Plan> {
    let placements = placement::placements(manifest);
    let twigs = branch::twigs(manifest, ledger)?;
    let bends = if branch::moves(manifest, &twigs) { Some(Bends::new(manifest, &twigs, ledger)?) } else { None };
    let mut plan = Plan {
        scene: manifest.name.clone(),
        needed: Vec::new(),
        left_out: Vec::new(),
        measured: BTreeMap::new(),
        warnings: Vec::new(),
        hash: String::new(),
        leaves: Vec::new(),
        free,
        placements,
        eyes: manifest
            .views
            .iter()
            .filter(|v| v.kind == ViewKind::Perspective)
            .filter_map(|v| v.eye_mm.map(DVec3::from))
            .collect(),
        wood: manifest.tree.as_ref().map(|t| (tree::wood(&tree::grow(t).wood), t.bark)),
        twigs: twigs.into_iter().map(|t| (t.clone(), branch::tube(&t))).collect(),
        bends,
        shadow_samples: 0,
        shadow_resolution: 0,
        msaa: if manifest.tolerance < 0.05 { 4 } else { 1 },
        sky_bands: 7,
        sun_moves: manifest.physical_sky() && (free || manifest.sun_moves()),
        sky_fitted: OnceLock::new(),
    };
    for index in 0..manifest.leaves.len() {
        let mut leaf = leaf_plan(manifest, &plan, index, out, input_hash, ledger)?;
        if free && leaf.mesh.is_some() {
            let sides = leaf.fitted.as_ref().map_or([false; 2], |f| Side::ALL.map(|s| f.has(s)));
            leaf.facing = Facing::ALL;
            let shines = |has: bool| has && leaf.translucency.is_some() && manifest.sun.is_some();
            leaf.sides = sides.map(|has| SideNeeds {
                rho_d: has,
                rho_t: has,
                gloss: has,
                normal: has,
                translucency: shines(has),
                mean: false,
            });
        }
        leaf::list(manifest, &leaf, &mut plan);
        translucency::list(manifest, &leaf, &mut plan);
        plan.leaves.push(leaf);
    }
    for k in 0..plan.leaves.len() {
        let mut leaf = plan.leaves.remove(k);
        if leaf.fitted.is_some() {
            leaf::detail(manifest, &mut leaf, &mut plan, ledger)?;
        }
        plan.leaves.insert(k, leaf);
    }
    if free {
        plan.leaves.iter_mut().for_each(|l| l.block = 1);
    }
    branches::branches(manifest, &mut plan, ledger);
    light::lights(manifest, &mut plan, free)?;
    light::absent_models(manifest, &mut plan);
    plan.warnings = warnings::warnings(manifest, &plan)?;
    let parts: Vec<(String, String)> =
        plan.needed.iter().map(|n| (n.name.clone(), format!("{:?} {:?}", n.hash, n.amount))).collect();
    plan.hash = mesophyll_files::hash::combine(parts.iter().map(|(a, b)| (a.as_str(), b.as_str())));
    Ok(plan)
}

fn leaf_plan(
    manifest: &Manifest,
    whole: &Plan,
    index: usize,
    out: Option<&Path>,
    input_hash: Option<InputHash>,
    ledger: &Ledger,
) -> Result<LeafPlan> {
    let leaf = &manifest.leaves[index];
    let placements = &whole.placements;
    let cards: Vec<_> = manifest
        .views
        .iter()
        .filter(|v| v.kind == ViewKind::Card && v.leaf.as_deref() == Some(leaf.name.as_str()))
        .collect();
    let scanned =
        manifest.views.iter().any(|v| v.kind == ViewKind::Capture && v.leaf.as_deref() == Some(leaf.name.as_str()));
    let perspective = manifest.views.iter().any(|v| v.kind == ViewKind::Perspective);
    let placed = perspective && placements.iter().any(|p| p.leaf == index);
    let mut plan = LeafPlan {
        index,
        used: placed || scanned || !cards.is_empty(),
        source: None,
        fitted: None,
        mesh_path: PathBuf::new(),
        mesh: None,
        facing: Facing::default(),
        sides: Default::default(),
        textures: Default::default(),
        curves: Default::default(),
        translucency: None,
        size: [0; 2],
        block: 1,
    };
    if !plan.used {
        return Ok(plan);
    }
    let source = source::source(manifest, index, out, input_hash)?;
    let sun = sun_direction(manifest)
        .zip(manifest.sun.as_ref())
        .map(|(direction, sun)| (direction, sun.radius_deg.to_radians()));
    if let (Status::Reuse, Some(folder)) = (source.status, &source.folder) {
        plan.fitted =
            Some(ledger.note("read", format!("{}/fit.toml", leaf.name), 0, || Fitted::open(&leaf.name, folder))?);
        plan.mesh_path = leaf.mesh.as_ref().map_or_else(|| folder.join("blade.glb"), |m| manifest.resolve(m));
        if placed {
            let bytes = std::fs::metadata(&plan.mesh_path).map_or(0, |m| m.len());
            let name = format!(
                "{}/{}",
                leaf.name,
                plan.mesh_path.file_name().map(|n| n.to_string_lossy()).unwrap_or_default()
            );
            let read = ledger.note("read", name, bytes, || mesh::read(&plan.mesh_path, leaf.mesh_unit))?;
            let views: Vec<(DVec3, f64)> = manifest
                .views
                .iter()
                .filter(|v| v.kind == ViewKind::Perspective)
                .filter_map(|v| Some((v.eye_mm?.into(), branch::time(manifest, v))))
                .collect();
            let mine: Vec<&Placement> = placements.iter().filter(|p| p.leaf == index).collect();
            let bar = Bar::new(format!("which sides of {} are seen and lit", leaf.name), mine.len() as u64);
            for p in mine {
                bar.step()?;
                if p.ride.is_none() || whole.bends.is_none() {
                    let eyes: Vec<DVec3> = views.iter().map(|v| v.0).collect();
                    plan.facing.add(&read, p, &eyes, sun);
                } else {
                    views.iter().for_each(|(eye, time)| plan.facing.add(&read, &whole.at_time(p, *time), &[*eye], sun));
                }
            }
            if manifest.sun_moves() {
                // It lights either side at some time.
                (plan.facing.lit, plan.facing.through) = (plan.facing.seen, plan.facing.seen);
            }
            plan.mesh = Some(read);
        }
    } else if placed {
        plan.facing = Facing { seen: [true; 2], lit: [sun.is_some(); 2], through: [sun.is_some(); 2] };
    }
    plan.source = Some(source);
    if placed {
        plan.translucency = translucency::find(manifest, index, out, plan.fitted.as_ref())?;
    }
    let sky = manifest.sky.is_some();
    let mut card_facing = Facing::default();
    for card in cards {
        let (turn, at) =
            (placement::rotation(card.rotation_deg.unwrap_or_default()), card.target_mm.unwrap_or_default());
        let p =
            Placement { leaf: index, transform: glam::DMat4::from_rotation_translation(turn, at.into()), ride: None };
        card_facing.add(&LeafMesh::rectangle(1.0, 1.0), &p, &[DVec3::from(card.eye_mm.unwrap_or_default())], sun);
    }
    for side in [0, 1] {
        let f = plan.facing;
        let needs = &mut plan.sides[side];
        needs.rho_d = f.lit[side] || (sky && f.seen[side]);
        needs.rho_t = f.through[1 - side] || (sky && f.seen[1 - side]);
        needs.gloss = needs.rho_d;
        needs.translucency = plan.translucency.is_some() && sun.is_some() && f.through[1 - side];
        // Under a physical sky every side's light depends on where it turns, the far one's too.
        needs.normal = f.lit[side]
            || (f.through[1 - side] && !needs.translucency)
            || (manifest.physical_sky() && (f.seen[side] || f.seen[1 - side]));
        needs.mean = card_facing.seen[side] || card_facing.through[1 - side] || (sky && card_facing.seen[1 - side]);
    }
    Ok(plan)
}

impl Plan {
    pub fn need(&mut self, need: Need) {
        self.needed.push(need);
    }

    pub fn leave_out(&mut self, left: LeftOut) {
        self.left_out.push(left);
    }

    /// A placement as the branches have it at a time (s).
    pub fn at_time(&self, placement: &Placement, time: f64) -> Placement {
        match (&self.bends, placement.ride) {
            (Some(bends), Some(ride)) => {
                Placement { transform: bends.transform(ride, time, placement.transform), ..*placement }
            }
            _ => *placement,
        }
    }

    /// Leaves that must be fitted before anything can be drawn.
    pub fn unfitted(&self) -> Vec<usize> {
        self.leaves.iter().filter(|l| l.used && l.fitted.is_none()).map(|l| l.index).collect()
    }

    /// Leaves whose translucency maps must be made before anything can be drawn; their own fits are there.
    pub fn untranslucent(&self) -> Vec<usize> {
        let lacks = |l: &&LeafPlan| {
            l.fitted.is_some()
                && l.sides.iter().any(|s| s.translucency)
                && l.translucency.as_ref().is_some_and(|t| t.source.status != Status::Reuse)
        };
        self.leaves.iter().filter(lacks).map(|l| l.index).collect()
    }

    /// Decides the shadow maps from the placements and meshes.
    pub fn shadows(&self, sun: DVec3, radius: f64) -> std::result::Result<(), &'static str> {
        let meshes: Vec<Option<&LeafMesh>> = self.leaves.iter().map(|l| l.mesh.as_ref()).collect();
        facing::shadows(&meshes, &self.placements, sun, radius)
    }

    /// Notes the rows behind a choice and returns the cheapest one within `allowed`.
    pub fn choose(&mut self, what: &str, rows: Vec<Row>, allowed: f64) -> Option<Row> {
        let row = accuracy::cheapest(&rows, allowed);
        self.measured.insert(what.into(), rows);
        row
    }
}
