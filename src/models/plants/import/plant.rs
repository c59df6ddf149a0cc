//! What was found as a plant: branches in their frames with their own bark, and blades that are instances where they
//! repeat.
//!
//! The plant's frame has z up; that of the file has y up. All that no branch was found for is wood that stands still on
//! the nearest branch, so that nothing of the file is lost.

use super::soup::{MeshPiece, TriangleSoup};
use super::{LeafPiece as FoundLeaf, PlantPieces, outline};
use crate::form::{self, Blade, Branch, BranchMotion, Joint, Leaf, Plant, nearest};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_base::statistics::median_of;
use mesophyll_files::mesh::{LeafMesh, vertex_normals, vertex_tangents};
use std::collections::{BTreeMap, HashMap};

/// Two blades are the same shape if no vertex of theirs is farther apart than this share of their length.
const SAME: f64 = 5e-3;
/// The largest number of shapes to which a blade with as many triangles is compared.
const TRIED: usize = 24;

/// What is not a matter of course about a plant that was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ImportSummary {
    /// Branches whose parent is only the nearest one.
    pub near_branches: usize,
    /// Blades whose branch is only the nearest one.
    pub near_leaves: usize,
    /// Pieces that are neither, which became wood that does not bend.
    pub still: usize,
}

/// From the file's frame, with y up, to the plant's, with z up.
fn upright(p: DVec3) -> DVec3 {
    DVec3::new(p.x, -p.z, p.y)
}

/// The plant, called `name`. Branches are called `b0`, `b1`, … as in the table.
pub fn plant(soup: &TriangleSoup, found: &PlantPieces, name: &str) -> (Plant, ImportSummary) {
    let mut made = ImportSummary { still: found.others.len(), ..ImportSummary::default() };
    let mut out = Plant { name: name.into(), ..Plant::default() };
    let bark = barks(soup, found);
    for (k, one) in found.branches.iter().enumerate() {
        let mut joint = one.parent.map(|branch| Joint { branch, at: one.at });
        if one.unattached.is_some() {
            // Where the plant has a trunk, this hangs on what is nearest to its root.
            let root = one.tube.axis.first().copied().unwrap_or_default();
            let gap = |j: &usize| {
                let (at, distance) = nearest(&found.branches[*j].tube.axis, root);
                (*j, at, distance - found.branches[*j].tube.radius(at))
            };
            let before = (0..k).filter(|j| found.branches[*j].level.is_some()).map(|j| gap(&j));
            let best = before.min_by(|a, b| a.2.total_cmp(&b.2));
            joint = best.map(|(branch, at, _)| Joint { branch, at });
            made.near_branches += usize::from(joint.is_some());
        }
        let axis: Vec<DVec3> = one.tube.axis.iter().map(|p| upright(*p)).collect();
        let root = axis.first().copied().unwrap_or_default();
        let t = form::along(&axis, 0.0).1;
        let (r, s) = t.any_orthonormal_pair();
        let axes = [t, r, s];
        let local = |p: DVec3| DVec3::from(axes.map(|a| a.dot(p - root)));
        let piece = &found.pieces[one.piece];
        out.branches.push(Branch {
            name: format!("b{k}"),
            parent: joint,
            level: joint.map_or(0, |j| out.branches[j.branch].level + 1),
            root,
            axes,
            axis: axis.iter().map(|p| local(*p)).collect(),
            root_radius: one.tube.root_radius,
            tip_radius: one.tube.tip_radius,
            load: 0.0,
            bending_load: 0.0,
            stated: BranchMotion::default(),
            material: bark[soup.material(piece)].clone(),
            wood: mesh(soup, std::slice::from_ref(piece), local),
        });
    }
    let trunks = out.branches.len();
    for (k, one) in found.others.iter().enumerate() {
        let on = (0..trunks).map(|j| (j, nearest(&found.branches[j].tube.axis, one.centre)));
        let on = on.min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(branch, (at, _))| Joint { branch, at });
        let piece = &found.pieces[one.piece];
        let root = upright(one.centre);
        let wood = mesh(soup, std::slice::from_ref(piece), |p| p - root);
        out.branches.push(still(format!("piece {k}"), root, on, &bark[soup.material(piece)], wood, &out));
    }
    if out.branches.is_empty() {
        out.branches.push(still("plant".into(), DVec3::ZERO, None, "bark", LeafMesh::default(), &out));
    }
    made.near_leaves = found.leaves.iter().filter(|leaf| leaf.joint.is_none()).count();
    let joint = |leaf: &FoundLeaf| {
        let (branch, at) = leaf.joint.or(leaf.nearest).unwrap_or((0, 0.0));
        Joint { branch, at }
    };
    (out.blades, out.leaves) = blades(soup, found, joint);
    out.colours = colours(soup, &bark);
    (out, made)
}

/// The plant as one that stands still: its wood is one piece a material, whatever branches were found.
pub fn standing(soup: &TriangleSoup, found: &PlantPieces, name: &str) -> Plant {
    let mut out = Plant { name: name.into(), ..Plant::default() };
    let bark = barks(soup, found);
    let mut pieces: BTreeMap<&str, Vec<MeshPiece>> = BTreeMap::new();
    let wood = found.branches.iter().map(|b| b.piece).chain(found.others.iter().map(|o| o.piece));
    for k in wood {
        pieces.entry(soup.material(&found.pieces[k])).or_default().push(found.pieces[k].clone());
    }
    for (material, pieces) in pieces {
        let wood = mesh(soup, &pieces, |p| p);
        out.branches.push(still(bark[material].clone(), DVec3::ZERO, None, &bark[material], wood, &out));
    }
    if out.branches.is_empty() {
        out.branches.push(still("plant".into(), DVec3::ZERO, None, "bark", LeafMesh::default(), &out));
    }
    (out.blades, out.leaves) = blades(soup, found, |_| Joint { branch: 0, at: 0.0 });
    out.colours = colours(soup, &bark);
    out
}

/// All triangles of a material where they stand, with z up; none where the soup has no such material.
pub fn part(soup: &TriangleSoup, material: &str) -> LeafMesh {
    let of = |t: &u32| soup.said.get(*t as usize).is_some_and(|c| soup.materials[c.material as usize] == material);
    let triangles = (0..soup.triangles.len() as u32).filter(of).collect();
    mesh(soup, &[MeshPiece { triangles }], |p| p)
}

/// Wood without length, which does not bend.
fn still(name: String, root: DVec3, parent: Option<Joint>, material: &str, wood: LeafMesh, plant: &Plant) -> Branch {
    Branch {
        name,
        parent,
        level: parent.map_or(0, |j| plant.branches[j.branch].level + 1),
        root,
        axes: [DVec3::X, DVec3::Y, DVec3::Z],
        axis: vec![DVec3::ZERO; 2],
        root_radius: 0.0,
        tip_radius: 0.0,
        load: 0.0,
        bending_load: 0.0,
        stated: BranchMotion::default(),
        material: material.into(),
        wood,
    }
}

/// The name of a material as a blade's.
fn blade_name(name: &str) -> &str {
    if name.is_empty() { "leaf" } else { name }
}

/// The name of each material as a bark's. A scene maps a name either to a leaf or to a bark, so a material of both gets
/// two names.
fn barks<'a>(soup: &'a TriangleSoup, found: &PlantPieces) -> BTreeMap<&'a str, String> {
    let of_leaves: Vec<&str> = found.leaves.iter().map(|l| soup.material(&found.pieces[l.piece])).collect();
    let one = |name: &'a String| {
        let both = of_leaves.contains(&name.as_str());
        let bark = match name.as_str() {
            "" => "bark".into(),
            name if both => format!("{name} wood"),
            name => name.to_string(),
        };
        (name.as_str(), bark)
    };
    let mut out: BTreeMap<&str, String> = soup.materials.iter().map(one).collect();
    out.entry("").or_insert_with(|| "bark".into());
    out
}

/// The file's colour of each material, by its names as a blade's and as a bark's.
fn colours(soup: &TriangleSoup, bark: &BTreeMap<&str, String>) -> BTreeMap<String, [f64; 3]> {
    let named = |(name, colour): (&String, &[f64; 3])| {
        [blade_name(name).to_string(), bark[name.as_str()].clone()].map(|name| (name, *colour))
    };
    soup.materials.iter().zip(&soup.colours).flat_map(named).collect()
}

/// Some pieces as a mesh, each place moved by `local`, which turns and moves but does not scale. A vertex is one where
/// place, normal and texture coordinates are the same.
fn mesh(soup: &TriangleSoup, pieces: &[MeshPiece], local: impl Fn(DVec3) -> DVec3) -> LeafMesh {
    let mut out = LeafMesh::default();
    let zero = local(DVec3::ZERO);
    let mut normals = true;
    let mut known: HashMap<(u32, [u32; 3], [u32; 2]), u32> = HashMap::new();
    for t in pieces.iter().flat_map(|piece| &piece.triangles) {
        let said = soup.said.get(*t as usize).copied().unwrap_or_default();
        for (c, place) in soup.triangles[*t as usize].iter().enumerate() {
            let (normal, uv) = (said.normals[c], said.uvs[c]);
            let key = (*place, normal.map(f32::to_bits), uv.map(f32::to_bits));
            let vertex = *known.entry(key).or_insert_with(|| {
                let n = DVec3::from(normal.map(f64::from));
                normals &= n != DVec3::ZERO;
                out.positions.push(local(upright(soup.places[*place as usize])));
                out.normals.push((local(upright(n)) - zero).normalize_or(DVec3::Z));
                out.uvs.push(DVec2::from(uv.map(f64::from)));
                out.positions.len() as u32 - 1
            });
            out.indices.push(vertex);
        }
    }
    if !normals {
        out.normals = vertex_normals(&out);
    }
    out.tangents = vertex_tangents(&out);
    out
}

/// A shape that blades are instances of, while it is looked for.
struct Shape<'a> {
    blade: Blade,
    /// The material's name in the file.
    material: &'a str,
    /// Three vertices that are far from one line.
    corners: [usize; 3],
    /// The leaves that are this shape, by their numbers.
    leaves: Vec<usize>,
    /// How many of them hang by the end that is the base of the first, less the others.
    votes: i64,
}

/// The shapes of all blades, and the leaves that are instances of these. A shape has the median length of its
/// material's blades, and the outline that the material cuts out of its picture.
fn blades(soup: &TriangleSoup, found: &PlantPieces, joint: impl Fn(&FoundLeaf) -> Joint) -> (Vec<Blade>, Vec<Leaf>) {
    let mut lengths: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for leaf in &found.leaves {
        lengths.entry(soup.material(&found.pieces[leaf.piece])).or_default().push(leaf.size[0]);
    }
    let medians: BTreeMap<&str, f64> =
        lengths.into_iter().map(|(name, list)| (name, median_of(list).unwrap_or(1.0))).collect();
    let mut shapes: Vec<Shape> = Vec::new();
    let mut alike: HashMap<(&str, usize, usize), Vec<usize>> = HashMap::new();
    let mut leaves: Vec<Leaf> = Vec::with_capacity(found.leaves.len());
    for (k, leaf) in found.leaves.iter().enumerate() {
        let piece = &found.pieces[leaf.piece];
        let name = soup.material(piece);
        let own = mesh(soup, std::slice::from_ref(piece), |p| p);
        let tried = alike.entry((name, own.positions.len(), own.triangles())).or_default();
        let known = tried.iter().find_map(|s| Some((*s, same(&shapes[*s], &own, leaf.size[0])?)));
        let (shape, transform) = known.unwrap_or_else(|| {
            let frame = frame(&own, leaf) * DMat4::from_scale(DVec3::splat(leaf.size[0] / medians[name]));
            let inverse = frame.inverse();
            let mut blade = own.clone();
            blade.positions.iter_mut().for_each(|p| *p = inverse.transform_point3(*p));
            blade.normals.iter_mut().for_each(|n| *n = inverse.transform_vector3(*n).normalize_or(DVec3::Z));
            blade.tangents = vertex_tangents(&blade);
            let corners = far_apart(&blade.positions);
            let blade = Blade { material: blade_name(name).into(), mesh: blade };
            shapes.push(Shape { blade, material: name, corners, leaves: Vec::new(), votes: 0 });
            if tried.len() < TRIED {
                tried.push(shapes.len() - 1);
            }
            (shapes.len() - 1, frame)
        });
        let along = upright(leaf.ends[1]) - upright(leaf.ends[0]);
        shapes[shape].votes += if transform.x_axis.truncate().dot(along) < 0.0 { -1 } else { 1 };
        shapes[shape].leaves.push(k);
        leaves.push(Leaf { blade: shape, joint: joint(leaf), transform });
    }
    // Most leaves of a shape say which end its base is.
    let half = DMat4::from_rotation_z(std::f64::consts::PI);
    for shape in shapes.iter_mut().filter(|shape| shape.votes < 0) {
        let mesh = &mut shape.blade.mesh;
        let turn = |v: &mut DVec3| *v = DVec3::new(-v.x, -v.y, v.z);
        mesh.positions.iter_mut().chain(&mut mesh.normals).for_each(turn);
        mesh.tangents.iter_mut().for_each(|(t, _)| turn(t));
        shape.leaves.iter().for_each(|k| leaves[*k].transform *= half);
    }
    let fine = outline::fineness(shapes.iter().map(|shape| (shape.blade.mesh.triangles(), shape.leaves.len())));
    let blade = |shape: Shape| {
        let mask = soup.mask(shape.material).filter(|_| fine > 1);
        let cut = mask.and_then(|mask| outline::cut(&shape.blade.mesh, mask, fine));
        Blade { mesh: cut.unwrap_or(shape.blade.mesh), ..shape.blade }
    };
    (shapes.into_iter().map(blade).collect(), leaves)
}

/// The frame of a blade: x from its base to its tip, z out of its front, where triangles wind counterclockwise, and the
/// origin in its middle.
fn frame(own: &LeafMesh, leaf: &FoundLeaf) -> DMat4 {
    let facing: DVec3 = (0..own.triangles())
        .map(|t| {
            let [a, b, c] = own.triangle(t).map(|k| own.positions[k]);
            (b - a).cross(c - a)
        })
        .sum();
    let [base, tip] = leaf.ends.map(upright);
    let x = (tip - base).normalize_or(DVec3::X);
    let up = upright(leaf.normal);
    let up = if facing.dot(up) < 0.0 { -up } else { up };
    let z = (up - x * x.dot(up)).try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
    DMat4::from_cols(x.extend(0.0), z.cross(x).extend(0.0), z.extend(0.0), upright(leaf.centre).extend(1.0))
}

/// Three of some places, such that the triangle between them is large.
fn far_apart(places: &[DVec3]) -> [usize; 3] {
    let most = |value: &dyn Fn(DVec3) -> f64| {
        (0..places.len()).max_by(|a, b| value(places[*a]).total_cmp(&value(places[*b]))).unwrap_or(0)
    };
    let a = most(&|p| p.distance(places[0]));
    let b = most(&|p| p.distance(places[a]));
    let c = most(&|p| (p - places[a]).cross(places[b] - places[a]).length());
    [a, b, c]
}

/// The transform that makes a shape the mesh `own` of a blade `length` long, if one without mirror image does. Files
/// that repeat a blade repeat the order of its vertices.
fn same(shape: &Shape, own: &LeafMesh, length: f64) -> Option<DMat4> {
    let blade = &shape.blade.mesh;
    if blade.indices != own.indices || blade.uvs != own.uvs {
        return None;
    }
    let basis = |mesh: &LeafMesh| {
        let [a, b, c] = shape.corners.map(|k| mesh.positions[k]);
        let (x, size) = ((b - a).try_normalize()?, b.distance(a));
        let z = x.cross(c - a).try_normalize()?;
        let [x, y, z] = [x, z.cross(x), z].map(|v| (v * size).extend(0.0));
        Some(DMat4::from_cols(x, y, z, a.extend(1.0)))
    };
    let transform = basis(own)? * basis(blade)?.inverse();
    let off = blade.positions.iter().zip(&own.positions).map(|(a, b)| transform.transform_point3(*a).distance(*b));
    off.fold(0.0, f64::max).le(&(SAME * length)).then_some(transform)
}
