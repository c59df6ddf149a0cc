//! All triangles of a file in one list, cut into connected pieces. Vertices at the same place are merged.

use crate::file::{INSTANCING, MOST_TRIANGLES};
use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec3, I64Vec3};
use mesophyll_files::gltf_file::{self, AlphaMask, DEEPEST, GltfDocument, wide};
use mesophyll_files::unit::LengthUnit;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

/// Vertices are merged if their distance is less than this share of the plant's size.
const WELD: f64 = 1e-6;

/// Triangles, and the places of their corners.
#[derive(Debug, Clone, Default)]
pub struct TriangleSoup {
    /// Places of the vertices (mm).
    pub places: Vec<DVec3>,
    /// Indices of the three places of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// What the file says of the corners of each triangle, in the same order.
    pub said: Vec<TriangleCorners>,
    /// Names of materials, each once; "" for triangles without one. Of several materials without a name, each has its
    /// number.
    pub materials: Vec<String>,
    /// What each material cuts out of a picture; `None` where it cuts nothing out.
    pub masks: Vec<Option<AlphaMask>>,
    /// The colour of each material: linear reflectances of red, green and blue.
    pub colours: Vec<[f64; 3]>,
    /// Triangles without an area, which were left out.
    pub degenerate: usize,
    /// Triangles that repeat another one, as the back of a leaf does, which were left out.
    pub doubled: usize,
}

/// What a file says of the corners of a triangle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TriangleCorners {
    /// Unit normals; 0 where the file has none.
    pub normals: [[f32; 3]; 3],
    /// Texture coordinates; 0 where the file has none.
    pub uvs: [[f32; 2]; 3],
    /// Index of the material.
    pub material: u32,
}

/// A set of connected triangles of one material.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshPiece {
    /// Indices of triangles.
    pub triangles: Vec<u32>,
}

type Given = ([DVec3; 3], TriangleCorners);

struct Reader<'a> {
    path: &'a Path,
    opened: &'a GltfDocument,
    materials: Vec<String>,
    masks: Vec<Option<AlphaMask>>,
    colours: Vec<[f64; 3]>,
    out: Vec<Given>,
}

/// Reads every triangle of the file's scene at the place that its nodes give, including instances.
///
/// # Errors
/// [`Error::Input`] in one sentence, for what [`gltf_file::read`] and [`gltf_file::surface`] refuse, for more than
/// [`MOST_TRIANGLES`] triangles, for transforms that are not finite, and for a file without a triangle that has an
/// area.
pub fn read(path: &Path, unit: Option<LengthUnit>) -> Result<TriangleSoup> {
    gltf_file::read(path, &[INSTANCING], |opened| {
        crate::file::count(path, &opened)?;
        let mut reader = Reader {
            path,
            opened: &opened,
            materials: Vec::new(),
            masks: Vec::new(),
            colours: Vec::new(),
            out: Vec::new(),
        };
        let world = DMat4::from_scale(DVec3::splat(unit.unwrap_or(opened.unit).mm()));
        match opened.document.default_scene().or_else(|| opened.document.scenes().next()) {
            Some(scene) => {
                for node in scene.nodes() {
                    reader.node(&node, world, 0)?;
                }
            }
            None => {
                for mesh in opened.document.meshes() {
                    reader.mesh(&mesh, &[world])?;
                }
            }
        }
        let soup = TriangleSoup {
            masks: reader.masks,
            colours: reader.colours,
            ..TriangleSoup::with(&reader.out, reader.materials)
        };
        if soup.triangles.is_empty() {
            let what = if soup.degenerate > 0 {
                format!("all {} triangles are degenerate: none has an area", soup.degenerate)
            } else {
                "found no triangles, expected a plant".into()
            };
            return Err(Error::input(path, what));
        }
        Ok(soup)
    })
}

impl Reader<'_> {
    fn node(&mut self, node: &gltf::Node, above: DMat4, depth: usize) -> Result<()> {
        if depth > DEEPEST {
            return Err(Error::field(self.path, "nodes", format!("nested more than {DEEPEST} deep")));
        }
        let world = above * gltf_file::local(node);
        if !world.is_finite() {
            return Err(Error::field(self.path, &format!("nodes[{}]", node.index()), "its transform is not finite"));
        }
        if let Some(mesh) = node.mesh() {
            let places = gltf_file::places(self.path, self.opened, node)?;
            let worlds: Vec<DMat4> = places.iter().map(|(_, local)| world * *local).collect();
            self.mesh(&mesh, &worlds)?;
        }
        for child in node.children() {
            self.node(&child, world, depth + 1)?;
        }
        Ok(())
    }

    fn mesh(&mut self, mesh: &gltf::Mesh, worlds: &[DMat4]) -> Result<()> {
        for primitive in mesh.primitives() {
            let field = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
            let surface = gltf_file::surface(self.path, &field, &primitive, &self.opened.buffers)?;
            let total = self.out.len() + worlds.len() * surface.indices.len() / 3;
            if total > MOST_TRIANGLES {
                let found = format!("{total} triangles so far");
                return Err(Error::unexpected(self.path, &field, found, format!("at most {MOST_TRIANGLES}")));
            }
            let reader = primitive.reader(|b| self.opened.buffers.get(b.index()).map(|d| d.0.as_slice()));
            let normals: Vec<DVec3> = reader.read_normals().map(|l| l.map(wide).collect()).unwrap_or_default();
            let uvs: Vec<[f32; 2]> = reader.read_tex_coords(0).map(|l| l.into_f32().collect()).unwrap_or_default();
            let name = self.name(&primitive.material());
            let known = self.materials.iter().position(|own| *own == name);
            let material = known.unwrap_or_else(|| {
                self.materials.push(name);
                let index = primitive.material().index();
                self.masks.push(index.and_then(|k| AlphaMask::of(self.path, self.opened, k)));
                self.colours.push(index.map_or([1.0; 3], |k| gltf_file::colour(self.path, self.opened, k)));
                self.materials.len() - 1
            }) as u32;
            for world in worlds {
                let placed: Vec<DVec3> = surface.positions.iter().map(|p| world.transform_point3(*p)).collect();
                let linear = DMat3::from_mat4(*world);
                let across = linear.inverse().transpose();
                let normal = |k: usize| {
                    let turned = normals.get(k).map(|n| (across * *n).normalize_or_zero());
                    turned.filter(|n| n.is_finite()).unwrap_or_default().as_vec3().to_array()
                };
                // A mirrored node also reverses the order of the corners.
                let order = if linear.determinant() < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
                self.out.extend(surface.indices.chunks_exact(3).map(|t| {
                    let own = order.map(|k| t[k] as usize);
                    let uv = |k: usize| uvs.get(k).copied().filter(|uv| uv.iter().all(|v| v.is_finite()));
                    let uvs = own.map(|k| uv(k).unwrap_or_default());
                    (own.map(|k| placed[k]), TriangleCorners { normals: own.map(normal), uvs, material })
                }));
            }
        }
        Ok(())
    }
}

impl Reader<'_> {
    /// The name of a material. One without a name has "", and its number where the file has several of these.
    fn name(&self, material: &gltf::Material) -> String {
        let unnamed = || self.opened.document.materials().filter(|m| m.name().is_none_or(str::is_empty)).nth(1);
        match (material.name().unwrap_or_default(), material.index()) {
            ("", Some(k)) if unnamed().is_some() => format!("material {k}"),
            (name, _) => name.into(),
        }
    }
}

/// Sets of connected numbers. Each number points to a lower one of its set, or to itself.
#[derive(Debug, Default)]
pub(super) struct Sets(Vec<u32>);

impl Sets {
    /// Adds a number, in a set of its own.
    pub(super) fn add(&mut self) -> u32 {
        let new = self.0.len() as u32;
        self.0.push(new);
        new
    }

    /// The lowest number of the set that holds `k`.
    pub(super) fn top(&mut self, mut k: u32) -> u32 {
        while self.0[k as usize] != k {
            self.0[k as usize] = self.0[self.0[k as usize] as usize];
            k = self.0[k as usize];
        }
        k
    }

    /// Joins two sets.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (p, q) = (self.top(a), self.top(b));
        self.0[p.max(q) as usize] = p.min(q);
    }

    /// Number of sets.
    pub(super) fn count(&self) -> usize {
        self.0.iter().enumerate().filter(|(k, up)| *k as u32 == **up).count()
    }
}

impl TriangleSoup {
    /// Merges vertices at the same place, and leaves out triangles without an area and those that repeat another.
    pub fn new(corners: &[[DVec3; 3]]) -> TriangleSoup {
        let given: Vec<Given> = corners.iter().map(|c| (*c, TriangleCorners::default())).collect();
        TriangleSoup::with(&given, vec![String::new()])
    }

    fn with(given: &[Given], materials: Vec<String>) -> TriangleSoup {
        let (low, high) = given
            .iter()
            .flat_map(|(corners, _)| corners)
            .fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(a, b), p| (a.min(*p), b.max(*p)));
        let cell = (WELD * (high - low).length()).max(f64::MIN_POSITIVE);
        let mut soup = TriangleSoup { materials, ..TriangleSoup::default() };
        let mut known: HashMap<I64Vec3, Vec<u32>> = HashMap::new();
        let mut seen: HashSet<[u32; 3]> = HashSet::with_capacity(given.len());
        for (triangle, said) in given {
            let indices = triangle.map(|p| soup.index(p - low, low, cell, &mut known));
            let [a, b, c] = indices.map(|k| soup.places[k as usize]);
            let (sides, area) = ([b - a, c - a, c - b], (b - a).cross(c - a).length());
            let longest = sides.iter().map(|s| s.length()).fold(0.0, f64::max);
            let mut sorted = indices;
            sorted.sort_unstable();
            if indices[0] == indices[1]
                || indices[1] == indices[2]
                || indices[2] == indices[0]
                || !(area > 1e-9 * longest * longest)
            {
                soup.degenerate += 1;
            } else if !seen.insert(sorted) {
                soup.doubled += 1;
            } else {
                soup.triangles.push(indices);
                soup.said.push(*said);
            }
        }
        soup
    }

    /// The vertex within a cell's width of a place. Where there is none, a new one is made.
    fn index(&mut self, place: DVec3, low: DVec3, cell: f64, known: &mut HashMap<I64Vec3, Vec<u32>>) -> u32 {
        let at = (place / cell).floor().as_i64vec3();
        // The neighbouring cells are searched too, because the place may be near their border.
        let near = |c: f64| if c.fract() < 0.5 { -1 } else { 1 };
        let scaled = place / cell;
        let steps = [near(scaled.x), near(scaled.y), near(scaled.z)];
        for corner in 0..8 {
            let step = I64Vec3::new(
                if corner & 1 > 0 { steps[0] } else { 0 },
                if corner & 2 > 0 { steps[1] } else { 0 },
                if corner & 4 > 0 { steps[2] } else { 0 },
            );
            for k in known.get(&(at + step)).into_iter().flatten() {
                if self.places[*k as usize].distance(place + low) <= 0.5 * cell {
                    return *k;
                }
            }
        }
        let new = self.places.len() as u32;
        self.places.push(place + low);
        known.entry(at).or_default().push(new);
        new
    }

    /// The name of a piece's material.
    pub fn material(&self, piece: &MeshPiece) -> &str {
        let first = piece.triangles.first().and_then(|t| self.said.get(*t as usize));
        first.and_then(|c| self.materials.get(c.material as usize)).map_or("", String::as_str)
    }

    /// What a material, by its name, cuts out of a picture.
    pub fn mask(&self, material: &str) -> Option<&AlphaMask> {
        let k = self.materials.iter().position(|own| own == material)?;
        self.masks.get(k)?.as_ref()
    }

    /// Places of a triangle's corners.
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|k| self.places[k as usize])
    }

    /// Mean place of a piece, with each triangle weighted by its area.
    pub fn centre(&self, piece: &MeshPiece) -> DVec3 {
        let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
        for t in &piece.triangles {
            let [a, b, c] = self.corners(*t);
            let area = (b - a).cross(c - a).length();
            sum += (a + b + c) / 3.0 * area;
            whole += area;
        }
        sum / whole
    }

    /// The parts of a piece that have no edge in common, in the order of their first triangles.
    pub fn apart(&self, piece: &MeshPiece) -> Vec<MeshPiece> {
        let mut sets = Sets((0..piece.triangles.len() as u32).collect());
        let mut first: HashMap<[u32; 2], u32> = HashMap::new();
        for (k, t) in piece.triangles.iter().enumerate() {
            let [a, b, c] = self.triangles[*t as usize];
            for (from, to) in [(a, b), (b, c), (c, a)] {
                sets.join(*first.entry([from.min(to), from.max(to)]).or_insert(k as u32), k as u32);
            }
        }
        let mut out: BTreeMap<u32, MeshPiece> = BTreeMap::new();
        for (k, t) in piece.triangles.iter().enumerate() {
            out.entry(sets.top(k as u32)).or_default().triangles.push(*t);
        }
        out.into_values().collect()
    }

    /// The pieces, in the order of their first triangles. Triangles of different materials are never in one piece.
    pub fn pieces(&self) -> Vec<MeshPiece> {
        // The same place is another vertex for each further material.
        let mut sets = Sets((0..self.places.len() as u32).collect());
        let mut more: HashMap<(u32, u32), u32> = HashMap::new();
        let mut vertices = Vec::with_capacity(self.triangles.len());
        for (t, places) in self.triangles.iter().enumerate() {
            let material = self.said.get(t).map_or(0, |c| c.material);
            let [a, b, c] = match material {
                0 => *places,
                _ => places.map(|p| *more.entry((p, material)).or_insert_with(|| sets.add())),
            };
            sets.join(a, b);
            sets.join(a, c);
            vertices.push(a);
        }
        let mut number: HashMap<u32, usize> = HashMap::new();
        let mut out: Vec<MeshPiece> = Vec::new();
        for (t, a) in vertices.into_iter().enumerate() {
            let k = *number.entry(sets.top(a)).or_insert_with(|| {
                out.push(MeshPiece::default());
                out.len() - 1
            });
            out[k].triangles.push(t as u32);
        }
        out
    }
}
