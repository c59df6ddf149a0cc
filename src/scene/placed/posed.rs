//! A scene's plants as they stand at a time, as one plant that can be written to a file.

use super::plant::{Planted, planted};
use super::winds::Winds;
use crate::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_flora::file::MOST_TRIANGLES;
use mesophyll_flora::form::Plant;
use mesophyll_manifest::Manifest;
use std::collections::BTreeSet;

/// All plants of a scene at a time (s), in the scene's frame. Branches keep their names where no two have the same;
/// otherwise the plant's name stands before each, as `eval sway` prints it ([`Planted::name_at`]).
///
/// # Errors
/// [`Error::Input`] for a scene without plants, more triangles than a plant's file may have, and as [`planted`] and [`Winds::new`].
pub fn plants(manifest: &Manifest, time: f64, ledger: &Ledger) -> Result<Plant> {
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
    let mut out = Plant { name: manifest.name.clone(), ..Plant::default() };
    for (index, one) in planted.iter().enumerate() {
        for (place, to_scene) in one.places.iter().enumerate() {
            let pose = winds.as_ref().and_then(|w| w.pose(index, place, time));
            let posed = pose.map_or_else(|| one.plant.clone(), |pose| pose.plant(&one.plant));
            let called = if unique { String::new() } else { format!("{}: ", one.name_at(place)) };
            out.join(posed.moved(*to_scene), &called);
        }
    }
    Ok(out)
}
