//! Light between leaves in a scene: which transfer it needs, where that is stored, and how it is made.
//!
//! A transfer belongs to the scene at rest. Leaves that sway in the wind keep the light that they get at rest.

use crate::draw::reference;
use crate::loaded::LoadedScene;
use crate::placed::daylight::sun_directions;
use crate::placed::ledger::Ledger;
pub use crate::plan::transfer::folder;
use crate::plan::transfer::{GLOSS_BANDS, ball, unseen, views_decide};
use crate::plan::{levels, shared_light};
use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_fits::record::maker::FitOutcome;
use mesophyll_fits::transfer::{self as fit, Options, TransferFit};
use mesophyll_transport::ReferenceWorld;
use mesophyll_transport::transfer::{TransferColumns, TransferMethod};
use std::path::Path;
use std::sync::Arc;

/// A leaf may count as hidden only if the ball around it covers at least so many pixels in every picture. If no ray
/// meets such a leaf, with one ray for each pixel, then only a small part of it can be visible.
const HIDEABLE: f64 = 16.0;

/// The options of the scene's transfer; `None` where its plan has none.
pub fn options(scene: &LoadedScene) -> Option<Options> {
    let (asked, between) = (scene.manifest.transfer.as_ref()?, scene.plan.light.between?);
    let columns = between.bands.map_or(TransferColumns::Light, TransferColumns::Harmonics);
    let gloss_bands = match columns {
        TransferColumns::Harmonics(bands) => bands,
        TransferColumns::Light => GLOSS_BANDS,
    };
    Some(Options {
        method: asked.method,
        anchors: asked.anchors,
        columns,
        gloss_bands,
        paths: asked.paths,
        seed: asked.seed,
        force: false,
    })
}

/// The scene in the form from which a transfer is made.
///
/// # Errors
/// As [`reference::world`]; [`Error::Input`] for a leaf that is not fitted yet.
pub fn of(scene: &LoadedScene, options: &Options, ledger: &Ledger) -> Result<fit::TransferScene> {
    let time = scene.manifest.rest_time();
    let world = match options.columns {
        TransferColumns::Light => reference::traced(scene, time, ledger)?,
        TransferColumns::Harmonics(_) => reference::unlit(scene, time, ledger)?,
    };
    let name = scene.manifest.name.clone();
    let leaves = scene.drawn().count();
    let mut seen = shown(scene, &world, ledger)?;
    let sources = shared_light::sources(&scene.manifest);
    if !sources.is_empty() {
        seen.resize(world.instances.len(), true);
        seen = shared_light::with_anchors(&seen, &sources);
    }
    let of = fit::TransferScene { name, leaves, world: Arc::new(world), seen, sources, sun: None };
    let wanted = scene.manifest.transfer.as_ref().zip(scene.manifest.sun.as_ref());
    match wanted.filter(|_| scene.plan.light.between.is_some_and(|b| b.sun_visibility)) {
        Some((asked, sun)) => {
            of.under_sun(sun.radius_deg.to_radians(), &sun_directions(&scene.manifest), asked.edge_mm)
        }
        None => Ok(of),
    }
}

/// For each instance, whether a view shows it. An instance is not shown if it lies outside of every picture, or if
/// other things hide it in all of them. Wood and ground, which come after the leaves, count as shown.
fn shown(scene: &LoadedScene, world: &ReferenceWorld, ledger: &Ledger) -> Result<Vec<bool>> {
    let LoadedScene { manifest, placed, .. } = scene;
    if !views_decide(manifest, placed) {
        return Ok(Vec::new());
    }
    let drawn = || placed.placements.iter().filter(|p| placed.leaves[p.leaf].mesh.is_some());
    let mut shown: Vec<bool> = drawn().map(|p| !unseen(manifest, placed, p)).collect();
    // One ray a pixel misses small leaves that can be seen, so these always count as shown.
    let eyes = levels::eyes(manifest, placed);
    let large = |p| ball(placed, p).is_some_and(|ball| eyes.iter().all(|eye| eye.pixels(ball) >= HIDEABLE));
    let may_hide: Vec<bool> = drawn().zip(&shown).map(|(p, shown)| *shown && large(p)).collect();
    if may_hide.iter().any(|may| *may) {
        let cameras: Vec<_> = manifest.perspectives().map(|v| v.camera).collect();
        let size = [manifest.check.width, manifest.check.height].map(|v| v as usize);
        let name = format!("{}: leaves that others hide", manifest.name);
        let seen = ledger.note("look", name, 0, || mesophyll_transport::shown(world, &cameras, size))?;
        shown.iter_mut().zip(may_hide).zip(seen).for_each(|((shown, may), seen)| *shown &= seen || !may);
    }
    shown.resize(world.instances.len(), true);
    // If all are shown, the list stays empty. Then the same transfer serves other views.
    Ok(if shown.iter().all(|s| *s) { Vec::new() } else { shown })
}

/// Makes the scene's transfer in the folder `out`.
///
/// # Errors
/// As [`of`] and [`fit::run`]; [`Error::Usage`] for a scene that requests none.
pub fn make(scene: &LoadedScene, out: &Path, force: bool, ledger: &Ledger) -> Result<FitOutcome> {
    let Some(options) = options(scene) else {
        let why = match scene.manifest.transfer {
            Some(_) => "there is none to make: one leaf stands alone",
            None => "missing; a scene with a [transfer] has light between leaves",
        };
        return Err(Error::field(&scene.manifest.path, "transfer", why));
    };
    if let Some(missing) = scene.placed.unfitted().first() {
        let leaf = format!("leaf \"{}\"", scene.manifest.leaves[*missing].name);
        let why = "its maps are not made yet; `mesophyll run` makes what a scene needs";
        return Err(Error::field(&scene.manifest.path, &leaf, why));
    }
    let of = of(scene, &options, ledger)?;
    fit::run(&of, &[&scene.manifest.path], out, &Options { force, ..options })
}

impl LoadedScene {
    /// Makes the scene's transfer by multi-bounce ambient occlusion in a folder below `out`, or reads the one that is
    /// there, and has it take the place of the scene's own.
    ///
    /// # Errors
    /// As [`make`].
    pub fn occlude(&mut self, out: &Path, ledger: &Ledger) -> Result<()> {
        let Some(options) = options(self).map(|o| Options { method: TransferMethod::AmbientOcclusion, ..o }) else {
            return Ok(());
        };
        let of = of(self, &options, ledger)?;
        let folder = out.join("fits").join(format!("{}-occlusion", self.manifest.name));
        fit::run(&of, &[&self.manifest.path], &folder, &options)?;
        self.transfer = Some(just_made(&folder, &of, &options)?);
        Ok(())
    }

    /// Reads the transfer of the scene: the one that the scene names, or the one below `out`. If neither belongs to
    /// this scene, it is made.
    ///
    /// # Errors
    /// As [`make`]; [`Error::Input`] for a damaged transfer.
    pub fn find_transfer(&mut self, out: &Path, ledger: &Ledger) -> Result<()> {
        let Some(options) = options(self) else { return Ok(()) };
        if !self.placed.unfitted().is_empty() {
            return Ok(());
        }
        let of = of(self, &options, ledger)?;
        let named = self.manifest.transfer.as_ref().and_then(|t| t.fit.as_ref()).map(|f| self.manifest.resolve(f));
        let own = folder(&self.manifest, self.plan.light.between.and_then(|b| b.bands), out);
        if let Some(place) = &named {
            self.transfer = TransferFit::open(place, &of, &options)?;
            if self.transfer.is_none() {
                progress::say(format!(
                    "{}: transfer.fit: {} is of another scene, light or setting; another one is made",
                    self.manifest.path.display(),
                    place.display()
                ));
            }
        }
        if self.transfer.is_none() && own.join("fit.toml").is_file() {
            // A damaged transfer is made again.
            self.transfer = TransferFit::open(&own, &of, &options).unwrap_or(None);
        }
        if let Some(found) = &self.transfer {
            let bytes = found.entries.len() as u64 * 8 + found.sun.as_ref().map_or(0, |s| s.maps.bytes() as u64);
            ledger.note("read", format!("{}/{}", self.manifest.name, fit::OPERATORS), bytes, || ());
            return Ok(());
        }
        let name = format!("{} transfer", self.manifest.name);
        ledger.note("fit", name, 0, || fit::run(&of, &[&self.manifest.path], &own, &options))?;
        self.transfer = Some(just_made(&own, &of, &options)?);
        Ok(())
    }
}

/// Opens a transfer that was made for this scene a moment ago. Without it every leaf would be drawn as if it stood
/// alone.
fn just_made(folder: &Path, of: &fit::TransferScene, options: &Options) -> Result<TransferFit> {
    let changed = || Error::Missed(format!("{}: is not of this scene, for which it was just made", folder.display()));
    TransferFit::open(folder, of, options)?.ok_or_else(changed)
}
