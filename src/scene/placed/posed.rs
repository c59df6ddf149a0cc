//! A scene's plants in its wind, as files for other programs: as they stand at a time, and as an animation.

use super::plant::{Planted, planted};
use super::winds::Winds;
use crate::ledger::Ledger;
use crate::{Error, Result};
use glam::DMat4;
use mesophyll_flora::file::{Carried, MOST_TRIANGLES, write_moving};
use mesophyll_flora::form::{Joint, Plant};
use mesophyll_flora::pose::{Pose, Rigid};
use mesophyll_manifest::Manifest;
use std::collections::BTreeSet;
use std::path::Path;

/// All plants of a scene and what moves them.
struct Standing {
    planted: Vec<Planted>,
    winds: Option<Winds>,
    /// Whether no two branches have the same name.
    unique: bool,
}

/// More places of nodes than this, over all times of an animation, are likelier a typing error than a wish: they take
/// half a gigabyte.
pub const MOST_PLACES: usize = 20_000_000;

impl Standing {
    fn new(manifest: &Manifest, ledger: &Ledger) -> Result<Standing> {
        let planted = planted(manifest, ledger)?;
        if planted.is_empty() {
            return Err(Error::field(&manifest.path, "plant", "missing; expected a scene with plants"));
        }
        let triangles = |p: &Planted| p.places.len().saturating_mul(p.plant.triangles());
        let triangles = planted.iter().map(triangles).fold(0, usize::saturating_add);
        if triangles > MOST_TRIANGLES {
            let found = format!("{triangles} triangles of all plants together");
            let expected = format!("at most {MOST_TRIANGLES}, which a plant's file may have");
            return Err(Error::unexpected(&manifest.path, "plant", found, expected));
        }
        let winds = Winds::new(manifest, &planted, ledger)?;
        let mut names = BTreeSet::new();
        let mut every = planted.iter().flat_map(|p| p.places.iter().flat_map(|_| &p.plant.branches));
        let unique = every.all(|b| names.insert(b.name.as_str()));
        Ok(Standing { planted, winds, unique })
    }

    /// Every plant at every place: its index, the place's, and the way to the scene's frame.
    fn each(&self) -> impl Iterator<Item = (usize, usize, DMat4)> {
        let places = |(index, one): (usize, &Planted)| {
            one.places.iter().enumerate().map(move |(place, to_scene)| (index, place, *to_scene)).collect::<Vec<_>>()
        };
        self.planted.iter().enumerate().flat_map(places)
    }

    fn pose(&self, index: usize, place: usize, time: f64) -> Option<Pose<'_>> {
        self.winds.as_ref().and_then(|w| w.pose(index, place, time))
    }

    /// All plants as one, in the scene's frame; at rest without a time.
    fn plant(&self, manifest: &Manifest, time: Option<f64>) -> Plant {
        let mut out = Plant { name: manifest.name.clone(), ..Plant::default() };
        for (index, place, to_scene) in self.each() {
            let one = &self.planted[index];
            let pose = time.and_then(|time| self.pose(index, place, time));
            let posed = pose.map_or_else(|| one.plant.clone(), |pose| pose.plant(&one.plant));
            let called = if self.unique { String::new() } else { format!("{}: ", one.name_at(place)) };
            out.join(posed.moved(to_scene), &called);
        }
        out
    }

    /// How the keyed sections of all plants at all places move at a time; in the scene's frame.
    fn motions(&self, carried: &Carried, time: f64) -> Vec<Rigid> {
        let (mut of_branches, mut of_leaves) = (Vec::new(), Vec::new());
        for (index, place, to_scene) in self.each() {
            let pose = self.pose(index, place, time).map(|pose| std::rc::Rc::new((pose, to_scene)));
            let plant = &self.planted[index].plant;
            of_branches.extend((0..plant.branches.len()).map(|own| (own, pose.clone())));
            of_leaves.extend(0..plant.leaves.len());
        }
        // Leaves stand after the roots of all branches.
        let leaf = |k: usize| k.checked_sub(of_branches.len()).and_then(|k| of_leaves.get(k));
        let one = |(k, (branch, at)): (usize, &(usize, f64))| match (&of_branches[*branch], leaf(k)) {
            ((own, Some(pose)), Some(leaf)) => pose.0.leaf(*leaf, Joint { branch: *own, at: *at }).moved(pose.1),
            ((own, Some(pose)), None) => pose.0.at(*own, *at).moved(pose.1),
            ((_, None), _) => Rigid::STILL,
        };
        carried.on.iter().enumerate().map(one).collect()
    }
}

/// All plants of a scene at a time (s), in the scene's frame. Branches keep their names where no two have the same;
/// otherwise the plant's name stands before each, as `eval sway` prints it ([`Planted::name_at`]).
///
/// # Errors
/// [`Error::Input`] for a scene without plants, more triangles than a plant's file may have, and as [`planted`] and [`Winds::new`].
pub fn plants(manifest: &Manifest, time: f64, ledger: &Ledger) -> Result<Plant> {
    Ok(Standing::new(manifest, ledger)?.plant(manifest, Some(time)))
}

/// All plants of a scene at rest, as [`plants`] has them.
///
/// # Errors
/// As [`plants`].
pub fn resting(manifest: &Manifest, ledger: &Ledger) -> Result<Plant> {
    Ok(Standing::new(manifest, ledger)?.plant(manifest, None))
}

/// Writes an animation of all plants of a scene from `from` (s) to `until`, a key every `step`; names and frame as
/// [`plants`] has them.
///
/// # Errors
/// [`Error::Input`] as [`plants`], and for a scene in which nothing moves; [`Error::Usage`] for times that are not in
/// order or too many; and as [`write_moving`].
pub fn animation(manifest: &Manifest, from: f64, until: f64, step: f64, ledger: &Ledger, path: &Path) -> Result<()> {
    if !(step > 0.0 && step.is_finite()) {
        return Err(Error::argument("--step", step, "a time above 0"));
    }
    if !(from.is_finite() && until.is_finite() && until > from) {
        return Err(Error::argument("--until", until, format!("a time after --from ({from})")));
    }
    let standing = Standing::new(manifest, ledger)?;
    if standing.winds.is_none() {
        return Err(Error::field(&manifest.path, "wind", "nothing moves; expected a [wind] that moves a plant"));
    }
    let rest = standing.plant(manifest, None);
    let carried = Carried::of(&rest);
    // The last time counts although the steps may fall short of it by rounding.
    let steps = ((until - from) / step + 1e-9).floor();
    let places = (steps + 1.0) * carried.on.len() as f64;
    if places > MOST_PLACES as f64 {
        let found = format!("{step}: {} times of {} nodes", steps + 1.0, carried.on.len());
        return Err(Error::argument("--step", found, format!("at most {MOST_PLACES} places of nodes in all")));
    }
    let times: Vec<f64> = (0..=steps as u64).map(|k| from + k as f64 * step).collect();
    write_moving(&rest, &carried, &times, |time| standing.motions(&carried, time), path)
}
