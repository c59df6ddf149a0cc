//! Whole plants of a scene at rest. They are read or grown once, and stand where the manifest says ([`super::winds`]
//! moves them).
//!
//! A plant's materials have names. The manifest says which leaf of the scene is drawn for the blades of a material, and
//! gives the reflectance of the bark. A leaf is drawn in its own size times the plant's scale and the size that the
//! plant gives the blade.

use super::groups::PlantGroups;
use super::overrides;
use super::placement::LeafPlacement;
use super::sections::BarkMotion;
use super::spots::spots;
use crate::manifest::{SceneManifest, SceneMaterial};
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use glam::{DMat4, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_plants::form::{Branch, Plant};
use mesophyll_plants::growth::described;
use mesophyll_plants::import;
use std::collections::BTreeSet;

/// The largest number of leaves of all plants together that share no poses. The real-time renderer takes about a
/// kilobyte for each. It is also the largest number of leaves that the path tracer stores.
pub const MOST_LEAVES: usize = 8_000_000;

/// Wood in the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedWood {
    /// Name of the wood in printed text.
    pub name: String,
    /// Its triangles.
    pub mesh: LeafMesh,
    /// Diffuse reflectance.
    pub bark: [f64; 3],
    /// The transform from mesh to world, for every place where it stands.
    pub places: Vec<DMat4>,
    /// How its vertices are carried, where something moves it. It then stands at one place only.
    pub bark_moves: Option<BarkMotion>,
}

/// A shape of a plant's blades, and the leaf that is drawn for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedShape {
    /// The scene's leaf.
    pub leaf: usize,
    /// How large the shape is (mm).
    pub across_mm: f64,
    /// The factor by which the plant enlarges the leaf.
    pub scale: f64,
    /// The part of `leaf_scale` in this.
    pub leaf_scale: f64,
}

/// A `[[plant]]` of the manifest.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedPlant {
    /// Name of the plant in printed text.
    pub name: String,
    /// Number of plants of the same name before it, and whether there are other plants of this name at all.
    same: (usize, bool),
    /// The plant from its file, with what the scene states about its branches.
    pub plant: Plant,
    /// The transform from plant to world, for every place where it stands.
    pub places: Vec<DMat4>,
    /// How its plants share poses; `None` where each has a pose of its own.
    pub groups: Option<PlantGroups>,
    /// The scene's leaf for every blade of the plant.
    leaves: Vec<usize>,
    barks: Vec<(String, [f64; 3])>,
    /// The factor on the size of what is drawn in place of its blades.
    leaf_scale: f64,
}

/// Reads or grows every plant.
///
/// # Errors
/// [`Error::Input`] for a file, a description or a fit of a branch that cannot be read, a material that the scene does
/// not map, a mapped material that the plant lacks, or too many leaves.
pub fn planted(manifest: &SceneManifest, ledger: &Ledger) -> Result<Vec<PlacedPlant>> {
    let mut out: Vec<PlacedPlant> = Vec::new();
    let mut total = 0;
    for (index, said) in manifest.plants.iter().enumerate() {
        let (source, mut plant) = match (&said.file, &said.grow) {
            (Some(file), _) => {
                let path = manifest.resolve(file);
                let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
                let known = |material: &str| match said.materials.get(material)? {
                    SceneMaterial::Leaf(_) => Some(import::MaterialClass::Leaf),
                    SceneMaterial::Bark(_) => Some(import::MaterialClass::Wood),
                };
                let plant = ledger.note("read", file.display().to_string(), bytes, || {
                    mesophyll_plants::file::read_any(&path, &known)
                })?;
                (file, plant)
            }
            (None, Some(file)) => {
                let path = manifest.resolve(file);
                (file, ledger.note("grow", file.display().to_string(), 0, || described(&path, said.grow_seed))?)
            }
            (None, None) => continue,
        };
        let stem = source.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        overrides::apply(manifest, index, &mut plant, ledger)?;
        let one = one(manifest, index, said, said.name.clone().unwrap_or(stem), plant)?;
        total += if one.groups.is_some() { 0 } else { one.plant.leaves.len() * one.places.len() };
        if total > MOST_LEAVES {
            let what = format!("{total} leaves up to here");
            return Err(Error::unexpected(
                &manifest.path,
                &field(index, "count"),
                what,
                format!("at most {MOST_LEAVES}"),
            ));
        }
        out.push(one);
    }
    for k in 0..out.len() {
        let same = |p: &&PlacedPlant| p.name == out[k].name;
        let before = out[..k].iter().filter(same).map(|p| p.places.len()).sum();
        out[k].same = (before, out.iter().filter(same).count() > 1);
    }
    let mut names = BTreeSet::new();
    for (k, one) in out.iter().enumerate() {
        if let Some(name) = (0..one.places.len()).map(|p| one.name_at(p)).find(|name| !names.insert(name.clone())) {
            let found = format!("\"{}\", so that two plants are called \"{name}\"", one.name);
            return Err(Error::unexpected(&manifest.path, &field(k, "name"), found, "another name"));
        }
    }
    Ok(out)
}

fn field(index: usize, key: &str) -> String {
    format!("plant {}: {key}", index + 1)
}

fn one(
    manifest: &SceneManifest,
    index: usize,
    said: &crate::manifest::StatedPlant,
    name: String,
    mut plant: Plant,
) -> Result<PlacedPlant> {
    let wrong = |what: String| Error::field(&manifest.path, &field(index, "materials"), what);
    let mut used = BTreeSet::new();
    let mut leaves = Vec::new();
    for blade in &plant.blades {
        used.insert(blade.material.clone());
        match said.materials.get(&blade.material) {
            Some(SceneMaterial::Leaf(leaf)) => leaves.extend(manifest.leaf_index(leaf)),
            Some(SceneMaterial::Bark(_)) => {
                return Err(wrong(format!("\"{}\" is a blade's material, expected a leaf's name", blade.material)));
            }
            None => return Err(wrong(format!("the plant's material \"{}\" maps to no leaf", blade.material))),
        }
    }
    let mut barks: Vec<(String, [f64; 3])> = Vec::new();
    for branch in plant.branches.iter().filter(|b| b.wood.triangles() > 0) {
        if barks.iter().any(|(known, _)| *known == branch.material) {
            continue;
        }
        used.insert(branch.material.clone());
        match said.materials.get(&branch.material) {
            Some(SceneMaterial::Bark(bark)) => barks.push((branch.material.clone(), *bark)),
            Some(SceneMaterial::Leaf(_)) => {
                return Err(wrong(format!("\"{}\" is the bark's material, expected [r, g, b]", branch.material)));
            }
            None => return Err(wrong(format!("the plant's material \"{}\" maps to no bark", branch.material))),
        }
    }
    if let Some(unused) = said.materials.keys().find(|name| !used.contains(*name)) {
        let known: Vec<&str> = used.iter().map(String::as_str).collect();
        return Err(wrong(format!("found \"{unused}\", expected a material of the plant ({})", known.join(", "))));
    }
    sized(&mut plant, said.leaf_scale);
    let mut spots = spots(manifest, said)?;
    let share = PlantGroups::form(manifest, spots.len(), plant.leaves.len());
    let groups = share.then(|| PlantGroups::new(manifest, said, &mut spots));
    let places = spots.iter().map(|spot| spot.transform(said)).collect();
    Ok(PlacedPlant { name, same: (0, false), plant, places, groups, leaves, barks, leaf_scale: said.leaf_scale })
}

/// Draws leaves `factor` times as large in place of blades, which themselves stay as they are.
fn sized(plant: &mut Plant, factor: f64) {
    if factor != 1.0 {
        plant.leaves.iter_mut().for_each(|leaf| leaf.transform *= DMat4::from_scale(DVec3::splat(factor)));
        plant.blades.iter_mut().flat_map(|blade| &mut blade.mesh.positions).for_each(|p| *p /= factor);
    }
}

impl PlacedPlant {
    /// The name of the plant at a place. It has a number, counted from 1, where several plants in the scene have this
    /// name.
    pub fn name_at(&self, place: usize) -> String {
        let (before, others) = self.same;
        match others || self.places.len() > 1 {
            true => format!("{} {}", self.name, before + place + 1),
            false => self.name.clone(),
        }
    }

    /// Its leaves at all its places.
    pub fn placements(&self) -> impl Iterator<Item = LeafPlacement> {
        self.places.iter().flat_map(|place| self.leaves_at(*place))
    }

    /// Its leaves where the plant stands at a place.
    pub fn leaves_at(&self, place: DMat4) -> impl Iterator<Item = LeafPlacement> {
        self.plant.leaves.iter().map(move |leaf| LeafPlacement {
            leaf: self.leaves[leaf.blade],
            transform: place * leaf.transform,
            section: None,
            frame: 0,
        })
    }

    /// The plant as its file has it: without the scene's `leaf_scale`.
    pub fn own(&self) -> Plant {
        let mut plant = self.plant.clone();
        sized(&mut plant, 1.0 / self.leaf_scale);
        plant
    }

    /// The shapes of its blades.
    pub fn shapes(&self) -> impl Iterator<Item = PlacedShape> {
        let leaf_scale = self.leaf_scale;
        let scale = self.places.first().map_or(1.0, |place| place.x_axis.truncate().length()) * leaf_scale;
        let across = self.plant.blades.iter().map(move |blade| 2.0 * blade.mesh.bounds().1 * scale);
        let shape = move |(leaf, across_mm)| PlacedShape { leaf, across_mm, scale, leaf_scale };
        self.leaves.iter().copied().zip(across).map(shape)
    }

    fn made_of(&self, material: &str) -> impl Iterator<Item = (usize, &Branch)> {
        self.plant.branches.iter().enumerate().filter(move |(_, b)| b.material == material)
    }

    /// The branches of each wood of [`PlacedPlant::wood`], with their numbers, in the order in which their bark follows
    /// there.
    pub fn barks(&self) -> impl Iterator<Item = impl Iterator<Item = (usize, &Branch)>> {
        self.barks.iter().map(|(material, _)| self.made_of(material))
    }

    /// Its wood, with one mesh for each material.
    pub fn wood(&self) -> Vec<PlacedWood> {
        self.barks
            .iter()
            .map(|(material, bark)| {
                let mut mesh = LeafMesh::default();
                for (_, branch) in self.made_of(material) {
                    mesh.append(&branch.wood, branch.frame());
                }
                PlacedWood {
                    name: format!("{} {material}", self.name),
                    mesh,
                    bark: *bark,
                    places: self.places.clone(),
                    bark_moves: None,
                }
            })
            .collect()
    }
}
