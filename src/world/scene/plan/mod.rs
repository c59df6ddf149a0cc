//! The plan: everything that a scene needs, and how much of it; what is left out, the reason, and the saving.
//!
//! A plan only decides. It is plain data, which can be printed, written and compared. It is made once, from the scene,
//! the heads of its fits and what their maps told when they were read ([`findings`]), and is not changed afterwards.
//! [`LeafPlan::new`] says which maps of a leaf must be read; [`crate::loaded`] reads them and hands over the findings.
//! Nothing is fitted, read, uploaded or compiled that the plan does not list. What is needed follows from the scene
//! alone (which sides the cameras see, which light falls on them) and from the fits' own figures. How much is needed
//! follows from the scene's tolerance and from rows of error and cost.

pub mod accuracy;
mod branches;
pub mod findings;
mod grass;
pub mod leaf;
pub mod levels;
pub(crate) mod light;
mod needs;
pub mod shared_light;
pub mod transfer;
mod unknowns;
mod warnings;

use crate::Result;
use crate::manifest::SceneManifest;
use crate::placed::PlacedScene;
use crate::placed::fits::{reader, source::FitFreshness};
use crate::placed::ledger::Ledger;
use accuracy::AccuracyRow;
use findings::LeafFindings;
use mesophyll_fits::leaf_folder::LeafFit;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

/// A thing that the scene needs.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PlanNeed {
    /// Its name: that of a file, a fit, a texture or a pass.
    pub name: String,
    /// The reason, in words.
    pub reason: String,
    /// The amount, where there was a choice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amount: Option<String>,
    /// Content hash of a fit's file, or input hash of a fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hash: Option<String>,
    /// Bytes, computed from sizes; `None` where it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Whether it exists; `None` where it is made in every run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<FitFreshness>,
    /// The path of the file, where it is one of a fit's folder.
    #[serde(skip)]
    pub file: Option<PathBuf>,
}

impl PlanNeed {
    /// A need with its name and its reason only.
    pub fn new(name: impl Into<String>, reason: impl Into<String>) -> PlanNeed {
        let (name, reason) = (name.into(), reason.into());
        PlanNeed { name, reason, amount: None, hash: None, bytes: None, status: None, file: None }
    }

    /// A file of a fit.
    pub fn of_file(fit: &LeafFit, file: &str, reason: impl Into<String>) -> PlanNeed {
        PlanNeed {
            hash: fit.record.files.get(file).cloned(),
            bytes: Some(reader::bytes(fit, file)),
            file: Some(fit.folder.join(file)),
            ..PlanNeed::new(reader::entry(fit, file), reason)
        }
    }
}

/// A thing that the scene could have and does not need.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PlanOmission {
    /// Its name: that of a file, a fit, a texture or a pass.
    pub name: String,
    /// The reason why the scene does not need it, in words.
    pub reason: String,
    /// The saving in words: bytes from sizes, and times where they were measured.
    pub saved: String,
    /// The saved bytes, from sizes.
    pub saved_bytes: u64,
    /// The saved time, where it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved_ms: Option<f64>,
}

impl PlanOmission {
    /// `bytes` come from sizes; `ms` is given only where it was measured.
    pub fn new(name: impl Into<String>, reason: impl Into<String>, bytes: u64, ms: Option<f64>) -> PlanOmission {
        let mut saved = format!("{bytes} bytes (from sizes)");
        if let Some(ms) = ms {
            saved += &format!(", {ms:.1} ms (measured)");
        }
        PlanOmission { name: name.into(), reason: reason.into(), saved, saved_bytes: bytes, saved_ms: ms }
    }
}

/// The needs of one side of a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct SideNeeds {
    /// Diffuse reflectance.
    pub rho_d: bool,
    /// Diffuse transmittance of light that enters here.
    pub rho_t: bool,
    /// The gloss map.
    pub gloss: bool,
    /// The map of normals.
    pub normal: bool,
    /// Maps for sunlight that enters this side.
    pub translucency: bool,
    /// Its mean parameters, for a card.
    pub mean: bool,
}

impl SideNeeds {
    /// Whether γ, δ and the slab are needed.
    pub fn interior(&self) -> bool {
        self.rho_d || self.rho_t
    }

    /// Whether any texture of it is needed.
    pub fn any(&self) -> bool {
        self.interior() || self.gloss || self.normal
    }
}

/// The decisions about one leaf.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LeafPlan {
    /// The needs of the front and of the back.
    pub sides: [SideNeeds; 2],
    /// Columns and rows of the maps on disk; zeros where no map was read.
    pub size: [usize; 2],
    /// Side of the blocks of texels over which maps are averaged.
    pub block: usize,
}

/// The decisions about the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct LightPlan {
    /// Number of shadow maps over the sun's disk; 0 where no shadow is possible.
    pub shadow_samples: u32,
    /// Texels along a side of a shadow map.
    pub shadow_resolution: u32,
    /// Samples for each pixel of the main pass.
    pub msaa: u32,
    /// Bands of a physical sky's harmonics.
    pub sky_bands: usize,
    /// Whether the sky's coefficients come from the polynomial fit.
    pub sun_moves: bool,
    /// The settings of light between leaves, if there is any.
    pub between: Option<TransferPlan>,
}

impl LightPlan {
    /// Whether anything can cast a shadow from the sun.
    pub fn shadows_fall(&self) -> bool {
        self.shadow_samples > 0 || self.between.is_some_and(|b| b.sun_visibility)
    }
}

/// The settings of the transfer of a scene with light between leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct TransferPlan {
    /// Number of bands of the light's harmonics; `None` where the light stands still and is one column.
    pub bands: Option<usize>,
    /// Whether the sun's shadows on leaves and wood are computed beforehand too.
    pub sun_visibility: bool,
}

/// The plan of a scene.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ScenePlan {
    /// The scene's name.
    pub scene: String,
    /// The things that it needs, fits first.
    pub needed: Vec<PlanNeed>,
    /// The things that it does not need.
    pub left_out: Vec<PlanOmission>,
    /// The rows of error and cost behind each choice of an amount.
    pub measured: BTreeMap<String, Vec<AccuracyRow>>,
    /// Unusual properties of the scene that may be intended, such as a leaf that no view shows, or a mesh in another
    /// unit.
    pub warnings: Vec<String>,
    /// Hash of the decisions and of every needed file.
    pub hash: String,
    /// Whether it is for a window, where camera, sun and sliders are free. Then nothing is left out for being small.
    pub free: bool,
    /// The decisions about each leaf, in the manifest's order.
    pub leaves: Vec<LeafPlan>,
    /// The decisions about lights and shadows.
    pub light: LightPlan,
}

impl ScenePlan {
    /// The plan of a scene. `found` has what the maps of each leaf told.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a side that is needed and that a fit does not have, for a physical sky that the
    /// model refuses, and for a fit's blade that cannot be read.
    pub fn new(
        manifest: &SceneManifest,
        placed: &PlacedScene,
        found: &[LeafFindings],
        ledger: &Ledger,
    ) -> Result<ScenePlan> {
        let mut plan = ScenePlan {
            scene: manifest.name.clone(),
            needed: Vec::new(),
            left_out: Vec::new(),
            measured: BTreeMap::new(),
            warnings: Vec::new(),
            hash: String::new(),
            free: placed.free,
            leaves: Vec::new(),
            light: LightPlan {
                shadow_samples: 0,
                shadow_resolution: 0,
                msaa: if manifest.tolerated() < 0.05 { 4 } else { 1 },
                sky_bands: 7,
                sun_moves: manifest.physical_sky().is_some() && (placed.free || manifest.sun_moves()),
                between: None,
            },
        };
        for leaf in &placed.leaves {
            plan.leaves.push(LeafPlan::new(manifest, leaf, placed.free)?);
            plan.list_fits(manifest, leaf);
        }
        for (leaf, found) in placed.leaves.iter().zip(found) {
            plan.leaf(manifest, leaf, found);
        }
        if placed.free {
            plan.leaves.iter_mut().for_each(|l| l.block = 1);
        }
        branches::branches(manifest, placed, &mut plan, ledger);
        grass::lawns(manifest, placed, &mut plan)?;
        light::lights(manifest, placed, &mut plan)?;
        transfer::between(manifest, placed, &mut plan)?;
        light::absent_models(manifest, placed, &mut plan);
        unknowns::unknowns(manifest, &mut plan);
        plan.warnings = warnings::warnings(manifest, placed)?;
        let files = plan.needed.iter().map(|n| (n.name.clone(), format!("{:?}", n.hash)));
        let decided = format!("{:?} {:?}", plan.leaves, plan.light);
        let parts: Vec<(String, String)> = files.chain([("decided".into(), decided)]).collect();
        plan.hash = mesophyll_files::hash::combine(parts.iter().map(|(a, b)| (a.as_str(), b.as_str())));
        Ok(plan)
    }

    /// Adds a need.
    fn need(&mut self, need: PlanNeed) {
        self.needed.push(need);
    }

    /// Adds a thing that is left out.
    fn leave_out(&mut self, left: PlanOmission) {
        self.left_out.push(left);
    }

    /// Notes the rows behind a choice, and returns the cheapest one within `allowed`.
    fn choose(&mut self, what: &str, rows: Vec<AccuracyRow>, allowed: f64) -> Option<AccuracyRow> {
        let row = accuracy::cheapest(&rows, allowed);
        self.measured.insert(what.into(), rows);
        row
    }

    /// The plan in words.
    pub fn text(&self) -> String {
        let mut out = format!("{} needs\n", self.scene);
        for need in &self.needed {
            let amount = need.amount.as_ref().map_or(String::new(), |a| format!(" [{a}]"));
            let _ = writeln!(out, "  {}{amount}: {}", need.name, need.reason);
        }
        let _ = writeln!(out, "left out");
        for left in &self.left_out {
            let _ = writeln!(out, "  {}: {}; saved {}", left.name, left.reason, left.saved);
        }
        for warning in &self.warnings {
            let _ = writeln!(out, "warning: {warning}");
        }
        out
    }
}
