//! Edits of a scene's branches in the window, and edited plants as new files.

use crate::manifest::SceneManifest;
use crate::placed::PlacedScene;
use crate::placed::ledger::Ledger;
use crate::placed::plant::{PlacedPlant, planted};
use crate::placed::winds::{SwayingPlants, WindResponse};
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_plants::form::{Branch, BranchMotion, DAMPINGS, LEANS, RESONANCES};
use mesophyll_plants::mechanics::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_window::edit::{EditQuantity, EditTarget, Edits};
use mesophyll_window::editor::{PlantInfo, PlantPart};
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A scene's plants as the window opened, and with the edits that were applied last.
pub struct WindowPlants {
    start: Vec<PlacedPlant>,
    /// How they moved as the window opened.
    winds: Option<Arc<SwayingPlants>>,
    edited: Vec<PlacedPlant>,
    applied: Edits,
}

impl WindowPlants {
    /// Reads or grows the plants of a scene once more.
    ///
    /// # Errors
    /// As [`planted`].
    pub fn new(manifest: &SceneManifest, placed: &PlacedScene, ledger: &Ledger) -> Result<WindowPlants> {
        let start = planted(manifest, ledger)?;
        Ok(WindowPlants { edited: start.clone(), start, winds: placed.winds.clone(), applied: Edits::default() })
    }

    /// What the window lists.
    pub fn listed(&self) -> Vec<PlantInfo> {
        let branches = |p: &PlacedPlant| p.plant.branches.iter().map(|b| (b.name.clone(), b.level)).collect();
        self.start.iter().map(|p| PlantInfo { name: p.name_at(0), branches: branches(p) }).collect()
    }

    /// The edits that were applied last.
    pub fn applied(&self) -> Edits {
        self.applied.clone()
    }

    /// Applies edits to the plants as the window opened, and places the result in the scene. After an error the scene
    /// is as before.
    ///
    /// # Errors
    /// As [`SwayingPlants::new`], where a load bends a branch too far, for example.
    pub fn apply(
        &mut self,
        edits: &Edits,
        manifest: &SceneManifest,
        placed: &mut PlacedScene,
        ledger: &Ledger,
    ) -> Result<()> {
        let mut edited = self.start.clone();
        let targets: BTreeSet<EditTarget> = edits.iter().map(|edit| edit.target).collect();
        for target in targets {
            let EditTarget::Plant(plant, part) = target else { continue };
            let Some(one) = edited.get_mut(plant) else { continue };
            let factors = EditQuantity::PLANT.map(|quantity| edits.factor(target, quantity));
            let answers = self.winds.as_ref().and_then(|w| w.plants[plant].as_ref()).map(|s| s.answers.as_slice());
            for (k, branch) in one.plant.branches.iter_mut().enumerate() {
                let mine = match part {
                    PlantPart::Level(level) => branch.level == level,
                    PlantPart::Branch(index) => k == index,
                };
                if mine {
                    edit_branch(branch, factors, answers.and_then(|a| a[k].as_ref()));
                }
            }
        }
        placed.replant(manifest, &edited, ledger)?;
        (self.edited, self.applied) = (edited, edits.clone());
        Ok(())
    }

    /// Writes a plant with the edits that were applied last as `NAME-edit-N.glb` under `folder`, and returns the path.
    ///
    /// # Errors
    /// [`Error::Usage`] for a plant that does not exist or a folder that cannot be written, and [`Error::Write`].
    pub fn save(&self, plant: usize, folder: &Path) -> Result<PathBuf> {
        let Some(one) = self.edited.get(plant) else {
            return Err(Error::argument("plant", plant, format!("less than {}", self.edited.len())));
        };
        let name: String = one.name.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        let free = (1..).map(|n| folder.join(format!("{name}-edit-{n}.glb"))).find(|p| !p.exists());
        let path = free.unwrap_or_else(|| folder.join(format!("{name}.glb")));
        atomic::probe_folder(folder)?;
        mesophyll_plants::file::write(&one.own(), &path)?;
        Ok(path)
    }
}

/// Changes a branch by factors, in the order of [`EditQuantity::PLANT`]. `answer` is how the wind moved it before.
fn edit_branch(branch: &mut Branch, factors: [f64; 5], answer: Option<&WindResponse>) {
    let [taper, load, leaning, resonating, damped] = factors;
    if taper != 1.0 {
        branch.set_taper((branch.taper() * taper).clamp(TAPER_MIN, TAPER_MAX));
    }
    let added = (load - 1.0) * branch.load;
    branch.load += added;
    branch.bending_load += added;
    let Some(WindResponse { sway, .. }) = answer.filter(|_| [leaning, resonating, damped] != [1.0; 3]) else {
        return;
    };
    // All three are stated then, so that each factor changes its own quantity only.
    let oscillator = sway.oscillator;
    let stated = branch.stated;
    let lean = stated.lean_per_m_s.unwrap_or(sway.lean / sway.wind.speed);
    let resonance = stated.resonance_hz.unwrap_or(oscillator.resonance);
    let damping = stated.damping.unwrap_or(oscillator.damping / (4.0 * PI * oscillator.resonance));
    branch.stated = BranchMotion {
        lean_per_m_s: Some((lean * leaning).clamp(LEANS[0], LEANS[1])),
        resonance_hz: Some((resonance * resonating).clamp(RESONANCES[0], RESONANCES[1])),
        damping: Some((damping * damped).clamp(DAMPINGS[0], DAMPINGS[1])),
    };
}
