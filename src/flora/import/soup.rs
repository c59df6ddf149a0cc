//! All triangles of a file in one list, cut into connected pieces. Vertices at the same place are merged.

use crate::file::{INSTANCING, MOST_TRIANGLES};
use crate::{Error, Result};
use glam::{DMat4, DVec3, I64Vec3};
use mesophyll_files::gltf_file::{self, DEEPEST, Opened};
use mesophyll_files::unit::Unit;
use std::collections::HashMap;
use std::path::Path;

/// Vertices are merged if their distance is less than this share of the plant's size.
const WELD: f64 = 1e-6;

/// Triangles, and the places of their corners.
#[derive(Debug, Clone, Default)]
pub struct Soup {
    /// Places of the vertices (mm).
    pub places: Vec<DVec3>,
    /// Indices of the three places of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles without an area, which were left out.
    pub degenerate: usize,
}

/// A set of connected triangles.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    /// Indices of triangles.
    pub triangles: Vec<u32>,
}

/// Reads every triangle of the file's scene at the place that its nodes give, including instances.
///
/// # Errors
/// [`Error::Input`] in one sentence, for what [`gltf_file::read`] and [`gltf_file::surface`] refuse, for more than
/// [`MOST_TRIANGLES`] triangles, for transforms that are not finite, and for a file without a triangle that has an
/// area.
pub fn read(path: &Path, unit: Option<Unit>) -> Result<Soup> {
    gltf_file::read(path, &[INSTANCING], |opened| {
        crate::file::count(path, &opened)?;
        let mut corners: Vec<[DVec3; 3]> = Vec::new();
        let world = DMat4::from_scale(DVec3::splat(unit.unwrap_or(opened.unit).mm()));
        match opened.document.default_scene().or_else(|| opened.document.scenes().next()) {
            Some(scene) => {
                for node in scene.nodes() {
                    add_node(path, &opened, &node, world, &mut corners, 0)?;
                }
            }
            None => {
                for mesh in opened.document.meshes() {
                    add_mesh(path, &opened, &mesh, &[world], &mut corners)?;
                }
            }
        }
        let soup = Soup::new(&corners);
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

fn add_node(
    path: &Path,
    opened: &Opened,
    node: &gltf::Node,
    above: DMat4,
    out: &mut Vec<[DVec3; 3]>,
    depth: usize,
) -> Result<()> {
    if depth > DEEPEST {
        return Err(Error::field(path, "nodes", format!("nested more than {DEEPEST} deep")));
    }
    let world = above * gltf_file::local(node);
    if !world.is_finite() {
        return Err(Error::field(path, &format!("nodes[{}]", node.index()), "its transform is not finite"));
    }
    if let Some(mesh) = node.mesh() {
        let places = crate::file::instances(path, opened, node)?;
        let worlds: Vec<DMat4> = places.iter().map(|(_, local)| world * *local).collect();
        add_mesh(path, opened, &mesh, &worlds, out)?;
    }
    for child in node.children() {
        add_node(path, opened, &child, world, out, depth + 1)?;
    }
    Ok(())
}

fn add_mesh(
    path: &Path,
    opened: &Opened,
    mesh: &gltf::Mesh,
    worlds: &[DMat4],
    out: &mut Vec<[DVec3; 3]>,
) -> Result<()> {
    for primitive in mesh.primitives() {
        let field = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
        let surface = gltf_file::surface(path, &field, &primitive, &opened.buffers)?;
        let total = out.len() + worlds.len() * surface.indices.len() / 3;
        if total > MOST_TRIANGLES {
            return Err(Error::unexpected(
                path,
                &field,
                format!("{total} triangles so far"),
                format!("at most {MOST_TRIANGLES}"),
            ));
        }
        for world in worlds {
            let placed: Vec<DVec3> = surface.positions.iter().map(|p| world.transform_point3(*p)).collect();
            out.extend(surface.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| placed[t[k] as usize])));
        }
    }
    Ok(())
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

impl Soup {
    /// Merges vertices at the same place, and leaves out triangles without an area.
    pub fn new(corners: &[[DVec3; 3]]) -> Soup {
        let (low, high) = corners
            .iter()
            .flatten()
            .fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(a, b), p| (a.min(*p), b.max(*p)));
        let cell = (WELD * (high - low).length()).max(f64::MIN_POSITIVE);
        let mut soup = Soup::default();
        let mut known: HashMap<I64Vec3, Vec<u32>> = HashMap::new();
        for triangle in corners {
            let indices = triangle.map(|p| soup.index(p - low, low, cell, &mut known));
            let [a, b, c] = indices.map(|k| soup.places[k as usize]);
            let (sides, area) = ([b - a, c - a, c - b], (b - a).cross(c - a).length());
            let longest = sides.iter().map(|s| s.length()).fold(0.0, f64::max);
            if indices[0] == indices[1]
                || indices[1] == indices[2]
                || indices[2] == indices[0]
                || !(area > 1e-9 * longest * longest)
            {
                soup.degenerate += 1;
            } else {
                soup.triangles.push(indices);
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

    /// Corners of a triangle.
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|k| self.places[k as usize])
    }

    /// Mean place of a piece, with each triangle weighted by its area.
    pub fn centre(&self, piece: &Piece) -> DVec3 {
        let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
        for t in &piece.triangles {
            let [a, b, c] = self.corners(*t);
            let area = (b - a).cross(c - a).length();
            sum += (a + b + c) / 3.0 * area;
            whole += area;
        }
        sum / whole
    }

    /// The pieces, in the order of their first triangles.
    pub fn pieces(&self) -> Vec<Piece> {
        let mut sets = Sets((0..self.places.len() as u32).collect());
        for [a, b, c] in &self.triangles {
            sets.join(*a, *b);
            sets.join(*a, *c);
        }
        let mut number: HashMap<u32, usize> = HashMap::new();
        let mut out: Vec<Piece> = Vec::new();
        for (t, [a, _, _]) in self.triangles.iter().enumerate() {
            let k = *number.entry(sets.top(*a)).or_insert_with(|| {
                out.push(Piece::default());
                out.len() - 1
            });
            out[k].triangles.push(t as u32);
        }
        out
    }
}
