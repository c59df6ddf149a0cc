//! One of the scene's leaves in the world: its fit, its blade, and which of its sides are seen and lit.

use super::daylight;
use super::motion::SceneMotion;
use super::placement::{self, LeafPlacement};
use super::visible_sides::VisibleSides;
use crate::manifest::{InteriorSource, SceneManifest, StatedLeaf as Config, UpAxis};
use crate::placed::fits::source::{self, FitFreshness, LeafSource};
use crate::placed::fits::translucency::{self, PlacedTranslucency};
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use glam::{DMat4, DVec3};
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_files::progress::TaskProgress;
use mesophyll_files::unit::LengthUnit;
use mesophyll_fits::leaf_folder::other_side::OtherSide;
use mesophyll_fits::leaf_folder::{BLADE, LeafFit};
use mesophyll_optics::side::Sides;
use mesophyll_plants::import::{plant::part, soup};
use mesophyll_plants::{file, growth};
use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};

/// How a scene's leaves are searched for.
#[derive(Clone, Copy, Default)]
pub struct LeafSearch<'a> {
    /// A run's folder with its own fits.
    pub out: Option<&'a Path>,
    /// Whether captures are compared with what their fits were made from. Without it, every fit counts as up to date.
    pub compared: bool,
    /// Whether this is for a window, where camera, sun and sliders are free. Then every side counts as seen and lit.
    pub free: bool,
}

/// A leaf of the manifest, with its data.
#[derive(Debug, Default)]
pub struct PlacedLeaf {
    /// Index into the manifest's leaves.
    pub index: usize,
    /// Whether a perspective view, a card or a view of its scan shows it.
    pub used: bool,
    /// The source of its fit; `None` for a leaf that nothing shows.
    pub source: Option<LeafSource>,
    /// Whether its reflection is stated in the manifest, so that nothing must be fitted.
    pub uniform: bool,
    /// Its fit, which is open when the leaf is used and the fit is up to date.
    pub fitted: Option<LeafFit>,
    /// Path of its mesh.
    pub mesh_path: PathBuf,
    /// Its mesh, which is read where the leaf is placed and its fit exists.
    pub mesh: Option<LeafMesh>,
    /// The sides that perspective views see.
    pub facing: VisibleSides,
    /// The sides that card views see.
    pub on_cards: VisibleSides,
    /// Its translucency maps, where the scene requests them.
    pub translucent: Option<PlacedTranslucency>,
}

impl PlacedLeaf {
    /// Searches for leaf `index` of the manifest.
    ///
    /// # Errors
    /// [`crate::placed::Error::Input`] for a fit that does not exist and cannot be made, or a damaged mesh.
    pub fn find(
        manifest: &SceneManifest,
        (placements, moves): (&[LeafPlacement], SceneMotion),
        index: usize,
        search: LeafSearch,
        ledger: &Ledger,
    ) -> Result<PlacedLeaf> {
        let leaf = &manifest.leaves[index];
        let cards = || manifest.cards().filter(|card| card.leaf == leaf.name);
        let compared = cards().next().is_some() || manifest.captures().any(|view| view.leaf == leaf.name);
        let placed = manifest.perspectives().next().is_some() && placements.iter().any(|p| p.leaf == index);
        let used = placed || compared;
        let mut out = PlacedLeaf { index, used, ..PlacedLeaf::default() };
        if !used {
            return Ok(out);
        }
        out.uniform = leaf.uniform().is_some();
        let source = match out.uniform {
            true => None,
            false => Some(source::source(manifest, index, search.out, search.compared)?),
        };
        let sun = daylight::sun_direction(manifest)
            .zip(manifest.sun.as_ref())
            .map(|(direction, sun)| (direction, sun.radius_deg.to_radians()));
        let made = source.as_ref().filter(|s| s.status == FitFreshness::Reuse).and_then(|s| s.folder.as_ref());
        if let Some(folder) = made {
            out.fitted = Some(
                ledger.note("read", format!("{}/fit.toml", leaf.name), 0, || LeafFit::open(folder))?.called(&leaf.name),
            );
        }
        if let Some(other) = leaf.fit().and_then(|f| f.other_side.as_ref()) {
            out.fitted = out.fitted.map(|fitted| completed(manifest, leaf, fitted, other)).transpose()?;
        }
        if compared && out.fitted.as_ref().is_some_and(LeafFit::is_stated) {
            let what = "stated, not fitted; a card, and a view as its scan saw it, compare a leaf with its tissue, of \
                        which a picture says nothing: expected a fitted leaf";
            return Err(Error::field(&manifest.path, &format!("leaf \"{}\"", leaf.name), what));
        }
        if made.is_some() || out.uniform {
            let own = || made.map_or_else(PathBuf::new, |folder| folder.join(BLADE));
            let given = leaf.mesh.as_ref().or(leaf.discs.as_ref());
            out.mesh_path = given.map_or_else(own, |m| manifest.resolve(m));
            if placed {
                let mesh = out.blade(manifest, ledger)?;
                let mine: Vec<&LeafPlacement> = placements.iter().filter(|p| p.leaf == index).collect();
                let views: Vec<(DVec3, f64)> =
                    manifest.perspectives().map(|v| (v.camera.eye, manifest.time_of(v))).collect();
                out.facing = if search.free {
                    VisibleSides::ALL
                } else {
                    seen(manifest, &leaf.name, &mesh, &mine, moves, &views, sun)?
                };
                out.mesh = Some(mesh);
            }
        } else if placed {
            let sunny = Sides::of(|_| sun.is_some());
            out.facing = VisibleSides { lit: sunny, through: sunny, ..VisibleSides::ALL };
        }
        out.source = source;
        if placed {
            out.translucent = translucency::find(manifest, index, search.out, out.fitted.as_ref())?;
        }
        for card in cards() {
            let turn = placement::rotation(card.rotation_deg);
            let transform = DMat4::from_rotation_translation(turn, card.camera.target);
            let p = LeafPlacement { leaf: index, transform, section: None, frame: 0 };
            out.on_cards.add(&LeafMesh::rectangle(1.0, 1.0), &p, &[card.camera.eye], sun);
        }
        Ok(out)
    }

    fn blade(&self, manifest: &SceneManifest, ledger: &Ledger) -> Result<LeafMesh> {
        let leaf = &manifest.leaves[self.index];
        let bytes = std::fs::metadata(&self.mesh_path).map_or(0, |m| m.len());
        let name = format!("{}/{}", leaf.name, self.mesh_name());
        let mesh = ledger.note("read", name, bytes, || match leaf.discs {
            Some(_) => mesh::read_discs(&self.mesh_path, leaf.mesh_unit.unwrap_or(LengthUnit::Metre)),
            None if leaf.part.is_some() => blades_of(&self.mesh_path, leaf.part.as_deref().unwrap_or_default()),
            None if leaf.uniform().is_some() => mesh::read_plain(&self.mesh_path, leaf.mesh_unit),
            None => mesh::read(&self.mesh_path, leaf.mesh_unit),
        })?;
        if leaf.mesh.is_none() || leaf.part.is_some() || leaf.mesh_up.unwrap_or_else(|| up(&mesh)) == UpAxis::Z {
            return Ok(mesh);
        }
        let mut turned = LeafMesh::default();
        turned.append(&mesh, DMat4::from_rotation_x(FRAC_PI_2));
        Ok(turned)
    }

    /// The source of its ρd and ρt: what the scene asks of a fit, and maps of a stated look, which has nothing else.
    pub fn interior(&self, config: &Config) -> InteriorSource {
        if self.fitted.as_ref().is_some_and(LeafFit::is_stated) { InteriorSource::Maps } else { config.interior }
    }

    /// File name of its mesh.
    pub fn mesh_name(&self) -> String {
        self.mesh_path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    }
}

/// The fit with what the scene says of the side that was not measured.
fn completed(manifest: &SceneManifest, leaf: &Config, fitted: LeafFit, other: &OtherSide) -> Result<LeafFit> {
    if fitted.sides().count() != 1 {
        let what = format!("given, but {} has both sides; expected a fit with one side", fitted.folder.display());
        return Err(Error::field(&manifest.path, &format!("leaf \"{}\": other_side", leaf.name), what));
    }
    Ok(fitted.completed(other))
}

/// The axis of a mesh's file that points up in a scene which does not say so: glTF's y, but for a blade, which lies in
/// the plane of x and y with its front along z. A blade is what faces z by more than three fifths of its area.
fn up(mesh: &LeafMesh) -> UpAxis {
    let (mut along, mut whole) = (0.0, 0.0);
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
        let n = (b - a).cross(c - a);
        whole += n.length();
        along += n.z * n.normalize_or_zero().z;
    }
    if along > 0.6 * whole { UpAxis::Z } else { UpAxis::Y }
}

/// The blades of one material, from a plant's file or from a description that is grown. Of a file without branches they
/// are all triangles of the material.
fn blades_of(path: &Path, material: &str) -> Result<LeafMesh> {
    let described = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let plant = if described { Some(growth::described(path, None)?) } else { file::branched(path)? };
    let (mesh, known): (LeafMesh, BTreeSet<String>) = match plant {
        Some(plant) => {
            let triangles = plant.triangles_of(material);
            if triangles > file::MOST_TRIANGLES {
                let what = format!("found {triangles} triangles of the material \"{material}\"");
                return Err(Error::input(path, format!("{what}; expected at most {}", file::MOST_TRIANGLES)));
            }
            (plant.blades_of(material), plant.blades.into_iter().map(|b| b.material).collect())
        }
        None => {
            let soup = soup::read(path, None)?;
            (part(&soup, material), soup.materials.into_iter().collect())
        }
    };
    if mesh.indices.is_empty() {
        let known = known.into_iter().collect::<Vec<_>>().join(", ");
        return Err(Error::input(path, format!("no blades of the material \"{material}\"; expected one of {known}")));
    }
    Ok(mesh)
}

/// The sides of one leaf that the views (eye and time) see over all its placements.
fn seen(
    manifest: &SceneManifest,
    name: &str,
    mesh: &LeafMesh,
    placements: &[&LeafPlacement],
    moves: SceneMotion,
    views: &[(DVec3, f64)],
    sun: Option<(DVec3, f64)>,
) -> Result<VisibleSides> {
    let mut facing = VisibleSides::default();
    let bar = TaskProgress::new(format!("which sides of {name} are seen and lit"), placements.len() as u64);
    let bends = |p: &LeafPlacement| moves.any() && p.section.is_some();
    // Moving placements are tested time by time, because plants are posed once for each time.
    for (eye, time) in views {
        for p in placements.iter().filter(|p| bends(p)) {
            if mesophyll_files::progress::stop_requested() {
                break;
            }
            facing.add(mesh, &moves.placement(p, *time), &[*eye], sun);
        }
    }
    let eyes: Vec<DVec3> = views.iter().map(|v| v.0).collect();
    for p in placements {
        bar.step()?;
        if !bends(p) {
            facing.add(mesh, p, &eyes, sun);
        }
    }
    if manifest.sun_moves() {
        // The sun lights either side at some time.
        (facing.lit, facing.through) = (facing.seen, facing.seen);
    }
    Ok(facing)
}
