//! A scene's plants in its wind as files for other programs: at a single time, and as an animation.

use super::plant::{PlacedPlant, planted};
use super::winds::SwayingPlants;
use crate::manifest::SceneManifest;
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use glam::DMat4;
use mesophyll_plants::file::{MOST_TRIANGLES, MovingParts, write_moving};
use mesophyll_plants::form::{Joint, Plant};
use mesophyll_plants::pose::{Pose, RigidMotion};
use std::collections::BTreeSet;
use std::path::Path;

/// All plants of a scene, and their motion.
struct Standing {
    planted: Vec<PlacedPlant>,
    winds: Option<SwayingPlants>,
    /// Whether the names of all branches differ.
    unique: bool,
}

/// The largest number of nodes' places over all times of an animation. A larger number is more likely a typing error
/// than meant; this one takes half a gigabyte.
pub const MOST_PLACES: usize = 20_000_000;

impl Standing {
    fn new(manifest: &SceneManifest, ledger: &Ledger) -> Result<Standing> {
        let planted = planted(manifest, ledger)?;
        if planted.is_empty() {
            return Err(Error::field(&manifest.path, "plant", "missing; expected a scene with plants"));
        }
        let triangles = |p: &PlacedPlant| p.places.len().saturating_mul(p.plant.triangles());
        let triangles = planted.iter().map(triangles).fold(0, usize::saturating_add);
        if triangles > MOST_TRIANGLES {
            let found = format!("{triangles} triangles of all plants together");
            let expected = format!("at most {MOST_TRIANGLES}, which a plant's file may have");
            return Err(Error::unexpected(&manifest.path, "plant", found, expected));
        }
        let winds = SwayingPlants::new(manifest, &planted, ledger)?;
        let mut names = BTreeSet::new();
        let mut every = planted.iter().flat_map(|p| p.places.iter().flat_map(|_| &p.plant.branches));
        let unique = every.all(|b| names.insert(b.name.as_str()));
        Ok(Standing { planted, winds, unique })
    }

    /// Every plant at every place: its index, the index of the place, and the transform to the scene's frame.
    fn each(&self) -> impl Iterator<Item = (usize, usize, DMat4)> {
        let places = |(index, one): (usize, &PlacedPlant)| {
            one.places.iter().enumerate().map(move |(place, to_scene)| (index, place, *to_scene)).collect::<Vec<_>>()
        };
        self.planted.iter().enumerate().flat_map(places)
    }

    fn pose(&self, index: usize, place: usize, time: f64) -> Option<Pose<'_>> {
        self.winds.as_ref().and_then(|w| w.pose(index, place, time))
    }

    /// All plants as one, in the scene's frame, each in the pose that `pose` gives for its index and its place.
    fn plant<'a>(&self, manifest: &SceneManifest, pose: impl Fn(usize, usize) -> Option<Pose<'a>>) -> Plant {
        let mut out = Plant { name: manifest.name.clone(), ..Plant::default() };
        for (index, place, to_scene) in self.each() {
            let one = &self.planted[index];
            let posed = pose(index, place).map_or_else(|| one.plant.clone(), |pose| pose.plant(&one.plant));
            let called = if self.unique { String::new() } else { format!("{}: ", one.name_at(place)) };
            out.join(posed.moved(to_scene), &called);
        }
        out
    }

    /// The motions of the keyed sections of all plants at all places at a time, in the scene's frame.
    fn motions(&self, carried: &MovingParts, time: f64) -> Vec<RigidMotion> {
        let (mut of_branches, mut of_leaves) = (Vec::new(), Vec::new());
        for (index, place, to_scene) in self.each() {
            let pose = self.pose(index, place, time).map(|pose| std::rc::Rc::new((pose, to_scene)));
            let plant = &self.planted[index].plant;
            of_branches.extend((0..plant.branches.len()).map(|own| (own, pose.clone())));
            of_leaves.extend(0..plant.leaves.len());
        }
        // Leaves come after the roots of all branches.
        let leaf = |k: usize| k.checked_sub(of_branches.len()).and_then(|k| of_leaves.get(k));
        let one = |(k, (branch, at)): (usize, &(usize, f64))| match (&of_branches[*branch], leaf(k)) {
            ((own, Some(pose)), Some(leaf)) => pose.0.leaf(*leaf, Joint { branch: *own, at: *at }).moved(pose.1),
            ((own, Some(pose)), None) => pose.0.at(*own, *at).moved(pose.1),
            ((_, None), _) => RigidMotion::STILL,
        };
        carried.on.iter().enumerate().map(one).collect()
    }
}

/// All plants of a scene at a time (s), in the scene's frame. Branches keep their names if no two are equal. Otherwise
/// each gets the plant's name as a prefix, as `eval sway` prints it ([`PlacedPlant::name_at`]).
///
/// # Errors
/// [`Error::Input`] for a scene without plants, and for more triangles than a plant's file may have; and those of
/// [`planted`] and [`SwayingPlants::new`].
pub fn plants(manifest: &SceneManifest, time: f64, ledger: &Ledger) -> Result<Plant> {
    let standing = Standing::new(manifest, ledger)?;
    Ok(standing.plant(manifest, |index, place| standing.pose(index, place, time)))
}

/// All plants of a scene without a wind, with names and frame as in [`plants`]. Loads bend their branches.
///
/// # Errors
/// As [`plants`].
pub fn resting(manifest: &SceneManifest, ledger: &Ledger) -> Result<Plant> {
    let standing = Standing::new(manifest, ledger)?;
    let bent = |index, place| standing.winds.as_ref().and_then(|w| w.loaded(index, place));
    Ok(standing.plant(manifest, bent))
}

/// Writes an animation of all plants of a scene, from `from` (s) with a key every `step` (s), to the last step at or
/// before `until` (s). Names and frame are as in [`plants`].
///
/// # Errors
/// [`Error::Input`] as in [`plants`], and for a scene in which nothing moves; [`Error::Argument`] for times that are
/// out of order, too many, fewer than two, or equal in the file; and those of [`write_moving`].
pub fn animation(
    manifest: &SceneManifest,
    from: f64,
    until: f64,
    step: f64,
    ledger: &Ledger,
    path: &Path,
) -> Result<()> {
    let keys = Keys::new(from, until, step)?;
    let standing = Standing::new(manifest, ledger)?;
    if !standing.winds.as_ref().is_some_and(SwayingPlants::sways) {
        return Err(Error::field(&manifest.path, "wind", "nothing moves; expected a [wind] that moves a plant"));
    }
    let rest = standing.plant(manifest, |_, _| None);
    let carried = MovingParts::of(&rest);
    let after = keys.after(carried.on.len())?;
    write_moving(&rest, &carried, from, &after, |time| standing.motions(&carried, time), path)
}

/// The keys of an animation.
struct Keys {
    from: f64,
    step: f64,
    /// Number of steps after the first key, a whole number.
    steps: f64,
}

impl Keys {
    /// The keys from `from` (s) to the last step at or before `until`, at least two.
    fn new(from: f64, until: f64, step: f64) -> Result<Keys> {
        if !from.is_finite() {
            return Err(Error::argument("--from", from, "a finite time"));
        }
        if !(step > 0.0 && step.is_finite()) {
            return Err(Error::argument("--step", short(step), "a finite time above 0"));
        }
        if !(until.is_finite() && until > from) {
            let expected = format!("a finite time after --from ({})", short(from));
            return Err(Error::argument("--until", short(until), expected));
        }
        // The last time counts even if rounding makes the steps end slightly before it.
        let steps = ((until - from) / step + 1e-9).floor();
        if steps < 1.0 {
            let expected = format!("at most {}, from --from to --until: two keys or more", short(until - from));
            return Err(Error::argument("--step", short(step), expected));
        }
        Ok(Keys { from, step, steps })
    }

    /// The time of each key after the first one (s). A glTF file stores them in single precision, in which they must
    /// rise.
    fn after(&self, nodes: usize) -> Result<Vec<f64>> {
        let count = self.steps + 1.0;
        if count * nodes as f64 > MOST_PLACES as f64 {
            let times = if count < 1e12 { count.to_string() } else { format!("{count:.1e}") };
            let found = format!("{}: {times} times of {nodes} nodes", short(self.step));
            return Err(Error::argument("--step", found, format!("at most {MOST_PLACES} places of nodes in all")));
        }
        let after: Vec<f64> = (0..=self.steps as u64).map(|k| k as f64 * self.step).collect();
        let rise =
            |w: &[f64]| (w[1] as f32).is_finite() && w[1] as f32 > w[0] as f32 && self.from + w[1] > self.from + w[0];
        if !after.windows(2).all(rise) {
            let expected = format!(
                "a step that tells keys from {} s on apart, which the file has in single precision",
                short(self.from)
            );
            return Err(Error::argument("--step", short(self.step), expected));
        }
        Ok(after)
    }
}

/// A number as text, with a power of ten where it is very large or small.
fn short(number: f64) -> String {
    let plain = number == 0.0 || (1e-5..1e12).contains(&number.abs()) || !number.is_finite();
    if plain { number.to_string() } else { format!("{number:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_rise_and_end_at_the_last_step_before_the_end() {
        let after =
            |from, until, step| Keys::new(from, until, step).and_then(|k| k.after(7)).map_err(|e| e.to_string());
        assert_eq!(after(0.0, 0.1, 0.04), Ok(vec![0.0, 0.04, 0.08]));
        assert_eq!(after(-3.0, -2.7, 0.1).map(|a| a.len()), Ok(4));
        for (from, until, step, expected) in [
            (f64::NAN, 1.0, 0.1, "--from: found NaN, expected a finite time"),
            (0.0, f64::INFINITY, 0.1, "--until: found inf"),
            (0.0, 0.01, 0.04, "--step: found 0.04, expected at most 0.01, from --from to --until"),
            (0.0, 1.0, -1.0, "--step: found -1, expected a finite time above 0"),
            (0.0, 1.0, 1e-300, "--step: found 1e-300: 1.0e300 times of 7 nodes"),
            (-1e308, 1e308, 1.0, "--step: found 1: inf times of 7 nodes"),
            (0.0, 1e300, 5e299, "--step: found 5e299, expected a step that tells keys from 0 s on apart"),
            (0.0, 3e-50, 1e-50, "--step: found 1e-50, expected a step that tells keys"),
            (1e9, 1_000_000_000.000_01, 1e-7, "--step: found 1e-7, expected a step that tells keys from 1000000000 s"),
        ] {
            let error = after(from, until, step).expect_err(expected);
            assert!(error.starts_with(expected) && error.lines().count() == 1, "{expected}: {error}");
        }
    }
}
