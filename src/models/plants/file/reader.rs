//! Reads a plant from glTF.

use super::{Extras, INSTANCING, MOST_TRIANGLES, NodeExtras, PERIOD};
use crate::form::{Blade, Branch, BranchMotion, DAMPINGS, Joint, LEANS, Leaf, Plant, RESONANCES};
use crate::import::axis::principal;
use crate::import::plant::standing;
use crate::import::{self, MaterialClass, soup};
use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec2, DVec3};
use mesophyll_files::gltf_file::{self, DEEPEST, GltfDocument, GltfPrimitive, wide};
use mesophyll_files::mesh::{DuplicateTriangles, LeafMesh, vertex_normals, vertex_tangents};
use mesophyll_files::progress;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The transform from glTF's frame (y up, z towards the viewer) to the plant's (z up).
fn upright() -> DMat4 {
    DMat4::from_mat3(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y))
}

/// Reads the plant in `path`.
///
/// # Errors
/// [`Error::Input`] in one sentence for what [`gltf_file::read`] refuses, and for a file without branches, names that
/// occur twice, numbers that are not finite or out of range, branches that are scaled unevenly or mirrored, or more
/// than [`MOST_TRIANGLES`] triangles.
pub fn read(path: &Path) -> Result<Plant> {
    branched(path)?.ok_or_else(|| {
        let what = "no node says in its extras that it is a branch; `mesophyll import FILE -o PLANT.glb` finds \
                    branches in triangles and writes a plant";
        Error::input(path, what)
    })
}

/// As [`read`]; a file without branches is a plant that stands still, whose blades are its flat pieces. `known` says
/// what a material of such a file is, by its name, where that is known.
///
/// # Errors
/// As [`read`]; for a file without branches those of [`soup::read`], and a material of leaves without a flat piece.
pub fn read_any(path: &Path, known: &(impl Fn(&str) -> Option<MaterialClass> + Sync)) -> Result<Plant> {
    if let Some(plant) = branched(path)? {
        return Ok(plant);
    }
    let soup = soup::read(path, None)?;
    let mut found = import::find(&soup, known);
    let of_leaves = |piece: usize| known(soup.material(&found.pieces[piece])) == Some(MaterialClass::Leaf);
    let (left_out, others): (Vec<_>, Vec<_>) = found.others.clone().into_iter().partition(|o| of_leaves(o.piece));
    if let Some(first) = left_out.first() {
        let name = soup.material(&found.pieces[first.piece]);
        if !found.leaves.iter().any(|leaf| soup.material(&found.pieces[leaf.piece]) == name) {
            let what = format!(
                "found no flat piece of the material \"{name}\", in whose place a leaf could be drawn; a reflectance \
                 [r, g, b] in place of the leaf's name draws it as it is"
            );
            return Err(Error::input(path, what));
        }
        let what = "of a leaf's material are not flat, and are left out";
        progress::say(format!("{}: {} of {} pieces {what}", path.display(), left_out.len(), found.pieces.len()));
    }
    found.others = others;
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(standing(&soup, &found, &name))
}

/// The plant in `path`, or `None` where no node says that it is a branch.
///
/// # Errors
/// As [`read`].
pub fn branched(path: &Path) -> Result<Option<Plant>> {
    gltf_file::read(path, &[INSTANCING], |opened| {
        count(path, &opened)?;
        let mut reader =
            Reader { path, opened: &opened, plant: Plant::default(), blades: BTreeMap::new(), names: BTreeSet::new() };
        let document = &opened.document;
        let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) else { return Ok(None) };
        let world = upright() * DMat4::from_scale(DVec3::splat(opened.unit.mm()));
        for node in scene.nodes() {
            if reader.plant.name.is_empty() {
                reader.plant.name = node.name().unwrap_or_default().to_string();
            }
            reader.node(&node, world, None, 0)?;
        }
        Ok(Some(reader.plant).filter(|plant| !plant.branches.is_empty()))
    })
}

/// A leaf that its nodes enlarge by more than this is in metres, not in mm.
const IN_METRES: f64 = 100.0;

/// Refuses files with too many triangles before these are read.
pub(crate) fn count(path: &Path, opened: &GltfDocument) -> Result<()> {
    let of_mesh: Vec<usize> =
        opened.document.meshes().map(|m| m.primitives().map(|p| gltf_file::at_most(&p)).sum::<usize>()).collect();
    let total: usize = opened.document.nodes().filter_map(|n| n.mesh()).map(|m| of_mesh[m.index()]).sum();
    if total > MOST_TRIANGLES {
        return Err(Error::unexpected(
            path,
            "meshes",
            format!("{total} triangles"),
            format!("at most {MOST_TRIANGLES}"),
        ));
    }
    Ok(())
}

fn wrong(path: &Path, node: &gltf::Node, field: &str, what: impl std::fmt::Display) -> Error {
    let name = node.name().map_or_else(|| format!("nodes[{}]", node.index()), |n| format!("node \"{n}\""));
    Error::field(path, &format!("{name}: {field}"), what)
}

struct Reader<'a> {
    path: &'a Path,
    opened: &'a GltfDocument,
    plant: Plant,
    /// Index of the blade for each mesh that is one, and for what its node does to its shape.
    blades: BTreeMap<(usize, [i64; 9]), usize>,
    names: BTreeSet<String>,
}

impl Reader<'_> {
    fn wrong(&self, node: &gltf::Node, field: &str, what: impl std::fmt::Display) -> Error {
        wrong(self.path, node, field, what)
    }

    fn node(&mut self, node: &gltf::Node, above: DMat4, branch: Option<usize>, depth: usize) -> Result<()> {
        if depth > DEEPEST {
            return Err(Error::field(self.path, "nodes", format!("nested more than {DEEPEST} deep")));
        }
        let world = above * gltf_file::local(node);
        if !world.is_finite() {
            return Err(self.wrong(node, "transform", "found numbers that are not finite"));
        }
        let parsed = node.extras().as_ref().map(|raw| serde_json::from_str::<Value>(raw.get()));
        let extras = parsed.transpose().map_err(|e| self.wrong(node, "extras", e))?;
        if let Some(period) = extras.as_ref().and_then(|e| e.get(PERIOD)) {
            self.plant.period = Some(self.period(node, world, period)?);
        }
        let mut on = branch;
        if extras.as_ref().is_some_and(|e| e.get("branch").is_some()) {
            let Extras { branch: said } = serde_json::from_value(extras.clone().unwrap_or_default())
                .map_err(|e| self.wrong(node, "extras.branch", e))?;
            on = Some(self.branch(node, world, branch, &said)?);
        } else if let (Some(branch), Some(mesh)) = (branch, node.mesh()) {
            let at = extras.as_ref().and_then(|e| e.get("at")).and_then(Value::as_f64);
            self.leaves(node, &mesh, world, branch, at)?;
        }
        for child in node.children() {
            self.node(&child, world, on, depth + 1)?;
        }
        Ok(())
    }

    fn branch(&mut self, node: &gltf::Node, world: DMat4, parent: Option<usize>, said: &NodeExtras) -> Result<usize> {
        let name = node.name().map_or_else(|| format!("branch {}", node.index()), String::from);
        if !self.names.insert(name.clone()) {
            return Err(self.wrong(node, "name", "another branch has the same name, expected a name of its own"));
        }
        let scale = self.scale(node, world)?;
        let numbers = [
            ("length_mm", said.length_mm, 0.0),
            ("root_radius_mm", said.root_radius_mm, 0.0),
            ("tip_radius_mm", said.tip_radius_mm, 0.0),
            ("load_over_stiffness_mm", said.load_over_stiffness_mm, f64::NEG_INFINITY),
            ("bending_load_mm", said.bending_load_mm, f64::NEG_INFINITY),
        ];
        for (field, value, least) in numbers {
            if !(value.is_finite() && value >= least) {
                let what = format!("found {value}, expected a finite number of 0 or more");
                return Err(self.wrong(node, &format!("extras.branch.{field}"), what));
            }
        }
        let stated = [
            ("lean_per_m_s", said.lean_per_m_s, LEANS),
            ("resonance_hz", said.resonance_hz, RESONANCES),
            ("damping", said.damping, DAMPINGS),
        ];
        for (field, value, [least, most]) in stated {
            if let Some(value) = value.filter(|v| !(least..=most).contains(v)) {
                let what = format!("found {value}, expected {least} to {most}");
                return Err(self.wrong(node, &format!("extras.branch.{field}"), what));
            }
        }
        let axis: Vec<DVec3> = match said.axis_mm.as_slice() {
            [] => vec![DVec3::ZERO, DVec3::X * said.length_mm * scale],
            [_] => return Err(self.wrong(node, "extras.branch.axis_mm", "found one point, expected two or more")),
            points => points.iter().map(|p| DVec3::from(*p) * scale).collect(),
        };
        if axis.iter().any(|p| !p.is_finite()) {
            return Err(self.wrong(node, "extras.branch.axis_mm", "found a point that is not finite"));
        }
        let parent = match (parent, said.at) {
            (None, _) => None,
            (Some(branch), Some(at)) if (0.0..=1.0).contains(&at) => Some(Joint { branch, at }),
            (Some(_), Some(at)) => {
                let what = format!("found {at}, expected 0 (root of the parent) to 1 (its tip)");
                return Err(self.wrong(node, "extras.branch.at", what));
            }
            (Some(branch), None) => {
                Some(Joint { branch, at: nearest(&self.plant.branches[branch], world.w_axis.truncate()) })
            }
        };
        let rigid = DMat3::from_mat4(world) * (1.0 / scale);
        let mut wood = LeafMesh::default();
        let mut material = "bark".to_string();
        if let Some(mesh) = node.mesh() {
            (wood, material) = self.mesh(&mesh, scale, &material)?;
        }
        self.plant.branches.push(Branch {
            name,
            parent,
            level: parent.map_or(0, |joint| self.plant.branches[joint.branch].level + 1),
            root: world.w_axis.truncate(),
            axes: [rigid.x_axis, rigid.y_axis, rigid.z_axis],
            axis,
            root_radius: said.root_radius_mm * scale,
            tip_radius: said.tip_radius_mm * scale,
            load: said.load_over_stiffness_mm * scale,
            bending_load: said.bending_load_mm * scale,
            stated: BranchMotion {
                lean_per_m_s: said.lean_per_m_s,
                resonance_hz: said.resonance_hz,
                damping: said.damping,
            },
            material,
            wood,
        });
        Ok(self.plant.branches.len() - 1)
    }

    /// The rectangle that repeats (mm).
    fn period(&self, node: &gltf::Node, world: DMat4, said: &Value) -> Result<[f64; 2]> {
        match serde_json::from_value::<[f64; 2]>(said.clone()) {
            Ok(period) if period.iter().all(|side| *side > 0.0 && side.is_finite()) => {
                let scale = self.scale(node, world)?;
                Ok(period.map(|side| side * scale))
            }
            _ => Err(self.wrong(node, &format!("extras.{PERIOD}"), format!("found {said}, expected two lengths"))),
        }
    }

    /// The factor by which a node enlarges its content.
    fn scale(&self, node: &gltf::Node, world: DMat4) -> Result<f64> {
        let sizes = [world.x_axis, world.y_axis, world.z_axis].map(|c| c.truncate().length());
        let mean = (sizes[0] + sizes[1] + sizes[2]) / 3.0;
        if world.determinant() < 0.0 {
            let what = "the node is mirrored, which a branch cannot be; expected a scale above 0 along all axes";
            return Err(self.wrong(node, "scale", what));
        }
        if !(mean > 0.0) || sizes.iter().any(|s| (s / mean - 1.0).abs() > 1e-4) {
            let [x, y, z] = sizes.map(|s| s / sizes[0].max(f64::MIN_POSITIVE));
            let what = format!("found {x:.4} x {y:.4} x {z:.4} relative to x, expected the same along all axes");
            return Err(self.wrong(node, "scale", what));
        }
        Ok(mean)
    }

    fn leaves(
        &mut self,
        node: &gltf::Node,
        mesh: &gltf::Mesh,
        world: DMat4,
        branch: usize,
        said: Option<f64>,
    ) -> Result<()> {
        for (at, local) in gltf_file::places(self.path, self.opened, node)? {
            let Some((transform, shape)) = apart(world * local) else {
                let what = "found a size of 0 along an axis, or a number that is not finite; expected a size";
                return Err(self.wrong(node, "scale", what));
            };
            // A branch may be in metres. Its blades then are too, and what is drawn for them is not enlarged by that.
            let unit = if transform.determinant().cbrt() > IN_METRES { 1000.0 } else { 1.0 };
            let (transform, shape) = (transform * DMat4::from_scale(DVec3::splat(1.0 / unit)), shape * unit);
            let key = (mesh.index(), shape.to_cols_array().map(|v| (v * 1e4).round() as i64));
            let blade = match self.blades.get(&key) {
                Some(known) => *known,
                None => {
                    let (own, material) = self.mesh(mesh, 1.0, "leaf")?;
                    self.plant.blades.push(Blade { material, mesh: shaped(own, shape) });
                    self.blades.insert(key, self.plant.blades.len() - 1);
                    self.plant.blades.len() - 1
                }
            };
            let at = match at.or(said) {
                Some(at) if (0.0..=1.0).contains(&at) => at,
                Some(at) => {
                    return Err(self.wrong(node, "at", format!("found {at}, expected 0 (root) to 1 (tip)")));
                }
                None => nearest(&self.plant.branches[branch], transform.w_axis.truncate()),
            };
            self.plant.leaves.push(Leaf { blade, joint: Joint { branch, at }, transform });
        }
        Ok(())
    }

    /// All primitives of a mesh as one mesh, `scale` times as large, and the name of the first primitive's material.
    fn mesh(&self, mesh: &gltf::Mesh, scale: f64, unnamed: &str) -> Result<(LeafMesh, String)> {
        let mut out = LeafMesh::default();
        let mut material = None;
        let (mut normals, mut maps) = (true, true);
        let mut doubled = DuplicateTriangles::default();
        for primitive in mesh.primitives() {
            let field = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
            let GltfPrimitive { positions, indices } =
                gltf_file::surface(self.path, &field, &primitive, &self.opened.buffers)?;
            material.get_or_insert_with(|| primitive.material().name().unwrap_or(unnamed).to_string());
            let n = positions.len();
            let flat = |t: &[u32]| {
                let [a, b, c] = [0, 1, 2].map(|k| positions[t[k] as usize]);
                !((b - a).cross(c - a).length_squared() > 0.0)
            };
            if !indices.is_empty() && indices.chunks_exact(3).all(flat) {
                return Err(Error::field(self.path, &field, "all its triangles are degenerate: none has an area"));
            }
            let reader = primitive.reader(|b| self.opened.buffers.get(b.index()).map(|d| d.0.as_slice()));
            let given: Vec<DVec3> = reader.read_normals().map(|l| l.map(wide).collect()).unwrap_or_default();
            let uvs: Vec<DVec2> = reader
                .read_tex_coords(0)
                .map(|l| l.into_f32().map(|[u, v]| DVec2::new(f64::from(u), f64::from(v))).collect())
                .unwrap_or_default();
            let single = |t: &&[u32]| !doubled.again([0, 1, 2].map(|k| positions[t[k] as usize]));
            let indices: Vec<u32> = indices.chunks_exact(3).filter(single).flatten().copied().collect();
            if indices.is_empty() {
                continue;
            }
            let first = out.positions.len() as u32;
            normals &= given.len() == n;
            maps &= uvs.len() == n;
            out.positions.extend(positions.iter().map(|p| *p * scale));
            out.normals.extend(if given.len() == n { given } else { vec![DVec3::Z; n] });
            out.uvs.extend(if uvs.len() == n { uvs } else { vec![DVec2::ZERO; n] });
            out.indices.extend(indices.iter().map(|i| i + first));
        }
        if out.normals.iter().any(|v| !v.is_finite()) || out.uvs.iter().any(|v| !v.is_finite()) {
            return Err(Error::field(
                self.path,
                &format!("meshes[{}]", mesh.index()),
                "found a vertex that is not finite",
            ));
        }
        if !normals {
            out.normals = vertex_normals(&out);
        }
        out.tangents = if maps {
            vertex_tangents(&out)
        } else {
            out.normals.iter().map(|n| (n.any_orthonormal_vector(), 1.0)).collect()
        };
        Ok((out, material.unwrap_or_else(|| unnamed.to_string())))
    }
}

/// A transform as one of which the turn, the place and an even size are left, and what it does to a shape before that:
/// a different size along different axes, or a mirror image. `None` where nothing of the shape would be left.
pub(crate) fn apart(transform: DMat4) -> Option<(DMat4, DMat3)> {
    let linear = DMat3::from_mat4(transform);
    let mirror = if linear.determinant() < 0.0 { DVec3::new(1.0, -1.0, 1.0) } else { DVec3::ONE };
    let linear = linear * DMat3::from_diagonal(mirror);
    let size = linear.determinant().cbrt();
    if !(size > 0.0 && transform.is_finite()) {
        return None;
    }
    let square = linear.transpose() * linear * (1.0 / (size * size));
    let even = (square - DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 2e-4);
    let stretch = if even {
        DMat3::IDENTITY
    } else {
        // The symmetric root of the square.
        principal(square).iter().fold(DMat3::ZERO, |sum, (value, axis)| {
            let root = value.max(0.0).sqrt();
            sum + DMat3::from_cols(*axis * (root * axis.x), *axis * (root * axis.y), *axis * (root * axis.z))
        })
    };
    let turn = linear * stretch.inverse();
    turn.is_finite().then(|| {
        let [x, y, z] = [turn.x_axis, turn.y_axis, turn.z_axis].map(|c| c.extend(0.0));
        (DMat4::from_cols(x, y, z, transform.w_axis), stretch * DMat3::from_diagonal(mirror))
    })
}

/// A mesh whose shape is changed as [`apart`] says.
fn shaped(mut mesh: LeafMesh, shape: DMat3) -> LeafMesh {
    if shape == DMat3::IDENTITY {
        return mesh;
    }
    let across = shape.inverse().transpose();
    mesh.positions.iter_mut().for_each(|p| *p = shape * *p);
    mesh.normals.iter_mut().for_each(|n| *n = (across * *n).normalize_or(DVec3::Z));
    if shape.determinant() < 0.0 {
        mesh.indices.chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
    }
    mesh.tangents = vertex_tangents(&mesh);
    mesh
}

/// The share of a branch's axis that is nearest to a place in the plant's frame.
fn nearest(branch: &Branch, place: DVec3) -> f64 {
    let local = branch.frame().inverse().transform_point3(place);
    crate::form::nearest(&branch.axis, local).0
}
