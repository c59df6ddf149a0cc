//! The plan: the closure of what a scene needs, how much of it, and what is left out, why, and what that saved.
//!
//! A plan only decides. It is plain data, which can be printed, written and compared; the maps and curves that it asks
//! for are read by [`crate::loaded`], which also measures the figures that some of its decisions rest on. Nothing is
//! fitted, read, uploaded or compiled that the plan does not list. What is needed follows from the scene alone (which
//! sides the cameras see, what light falls on them) and from the fits' own figures; how much follows from the scene's
//! tolerance and from rows of error against cost.

pub mod accuracy;
pub mod between;
mod branches;
mod grass;
pub mod leaf;
mod light;
mod warnings;

use crate::Result;
use accuracy::Row;
use mesophyll_manifest::Manifest;
use mesophyll_placed::Placed;
use mesophyll_placed::fits::source::Status;
use mesophyll_placed::ledger::Ledger;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Something the scene needs.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Need {
    /// A file, a fit, a texture or a pass.
    pub name: String,
    /// Why, in words.
    pub reason: String,
    /// How much of it, where that was a choice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amount: Option<String>,
    /// Content hash, where it is a file of a fit; of the input, where it is a fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hash: Option<String>,
    /// From sizes; `None` where it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Whether it is there; `None` where it is made in every run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
}

impl Need {
    /// A need of which no more is known than its name and reason.
    pub fn new(name: impl Into<String>, reason: impl Into<String>) -> Need {
        Need { name: name.into(), reason: reason.into(), amount: None, hash: None, bytes: None, status: None }
    }
}

/// Something the scene could have had.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LeftOut {
    /// A file, a fit, a texture or a pass.
    pub name: String,
    /// Why the scene does without, in words.
    pub reason: String,
    /// In words: bytes from sizes, times where they were measured.
    pub saved: String,
    /// Bytes from sizes.
    pub saved_bytes: u64,
    /// Time, where it was measured.
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

    /// Whether a texture of it is needed at all.
    pub fn any(&self) -> bool {
        self.interior() || self.gloss || self.normal
    }
}

/// What is decided about one leaf.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LeafPlan {
    /// Front, back.
    pub sides: [SideNeeds; 2],
    /// Columns and rows of the maps on disk; zeros where none was looked at.
    pub size: [usize; 2],
    /// Maps are averaged over blocks of this many texels a side.
    pub block: usize,
}

/// What is decided about the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct LightPlan {
    /// Shadow maps over the sun's disk; 0 where no shadow can fall.
    pub shadow_samples: u32,
    /// Texels a side of a shadow map.
    pub shadow_resolution: u32,
    /// Samples a pixel of the main pass.
    pub msaa: u32,
    /// Bands of a physical sky's harmonics.
    pub sky_bands: usize,
    /// The sky's coefficients come from the polynomial fit.
    pub sun_moves: bool,
    /// Light between leaves.
    pub between: Option<Between>,
}

impl LightPlan {
    /// Whether anything can stand in the sun's light.
    pub fn shadows_fall(&self) -> bool {
        self.shadow_samples > 0 || self.between.is_some_and(|b| b.sun_visibility)
    }
}

/// What the transfer of a scene with light between leaves is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Between {
    /// Bands of the light's harmonics; `None` where the light stands still and is one column.
    pub bands: Option<usize>,
    /// The sun's shadows on leaves and wood are worked out beforehand too.
    pub sun_visibility: bool,
}

/// What a scene needs.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Plan {
    /// The scene's name.
    pub scene: String,
    /// What it needs, fits first.
    pub needed: Vec<Need>,
    /// What it does without.
    pub left_out: Vec<LeftOut>,
    /// Rows of error against cost behind each choice of an amount.
    pub measured: BTreeMap<String, Vec<Row>>,
    /// What is strange about the scene, and may be meant: a leaf that no view shows, a mesh in another unit.
    pub warnings: Vec<String>,
    /// Hash of the decisions and of every needed file.
    pub hash: String,
    /// For a window: camera, sun and sliders may take everything anywhere, so that nothing is left out for being small.
    pub free: bool,
    /// In the manifest's order.
    pub leaves: Vec<LeafPlan>,
    /// Which lights and shadows are computed.
    pub light: LightPlan,
}

impl Plan {
    /// What follows from where everything stands: which fits, and what of each side. Leaves are then gone through one
    /// by one ([`leaf`]), and [`Plan::finish`] ends it.
    pub fn new(manifest: &Manifest, placed: &Placed) -> Plan {
        let mut plan = Plan {
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
                sun_moves: manifest.physical_sky() && (placed.free || manifest.sun_moves()),
                between: None,
            },
        };
        for leaf in &placed.leaves {
            plan.leaves.push(LeafPlan { sides: leaf::sides(manifest, leaf, placed.free), size: [0; 2], block: 1 });
            plan.list_fits(manifest, leaf);
        }
        plan
    }

    /// Decides about branches and light, after all leaves.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a physical sky that the model refuses, and for a fit's blade that cannot be read.
    pub fn finish(&mut self, manifest: &Manifest, placed: &Placed, ledger: &Ledger) -> Result<()> {
        branches::branches(manifest, placed, self, ledger);
        grass::lawns(manifest, placed, self)?;
        light::lights(manifest, placed, self)?;
        between::between(manifest, placed, self)?;
        light::absent_models(manifest, placed, self);
        self.warnings = warnings::warnings(manifest, placed)?;
        let files = self.needed.iter().map(|n| (n.name.clone(), format!("{:?}", n.hash)));
        let decided = format!("{:?} {:?}", self.leaves, self.light);
        let parts: Vec<(String, String)> = files.chain([("decided".into(), decided)]).collect();
        self.hash = mesophyll_files::hash::combine(parts.iter().map(|(a, b)| (a.as_str(), b.as_str())));
        Ok(())
    }

    /// Notes a need.
    pub fn need(&mut self, need: Need) {
        self.needed.push(need);
    }

    /// Notes something that is left out.
    pub fn leave_out(&mut self, left: LeftOut) {
        self.left_out.push(left);
    }

    /// Notes the rows behind a choice and returns the cheapest one within `allowed`.
    pub fn choose(&mut self, what: &str, rows: Vec<Row>, allowed: f64) -> Option<Row> {
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
