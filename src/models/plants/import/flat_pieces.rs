//! Flat pieces of a mesh, and texture coordinates along their own axes, for leaves that came without any.

use super::leaf;
use super::soup::{MeshPiece, TriangleSoup};
use glam::DVec3;
use mesophyll_files::gltf_file::GltfPrimitive;
use std::collections::HashMap;

/// What [`flat`] found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FlatPieces {
    /// For each triangle: whether it belongs to a flat piece.
    pub triangles: Vec<bool>,
    /// For each vertex of a flat piece: its place along the piece, 0 at the base and 1 at the tip, and across it, from
    /// 0 on the right to 1 on the left of who looks at the front with the tip up. 0 for other vertices.
    pub places: Vec<[f64; 2]>,
    /// The flat pieces.
    pub flat: Vec<MeshPiece>,
    /// Number of pieces that are not flat.
    pub others: usize,
}

/// Finds the flat pieces of a mesh, as [`leaf::of`] does, and lays axes through each.
///
/// The front is where the triangles wind counterclockwise. The base is the end that is nearer to the mesh's own origin:
/// there a leaf hangs that is a mesh of its own, and there stands a plant that is one mesh. The long axis is the
/// piece's principal axis, or its longest edge where it is about as wide as long.
pub fn flat(surface: &GltfPrimitive) -> FlatPieces {
    // Vertices at the same place belong together: files double them where normals or coordinates differ.
    let mut known: HashMap<[u64; 3], u32> = HashMap::new();
    let mut soup = TriangleSoup::default();
    let index: Vec<u32> = surface
        .positions
        .iter()
        .map(|p| {
            // + 0.0 makes one zero of both.
            *known.entry(p.to_array().map(|v| (v + 0.0).to_bits())).or_insert_with(|| {
                soup.places.push(*p);
                soup.places.len() as u32 - 1
            })
        })
        .collect();
    soup.triangles = surface.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| index[t[k] as usize])).collect();
    let mut out = FlatPieces {
        triangles: vec![false; soup.triangles.len()],
        places: vec![[0.0; 2]; surface.positions.len()],
        ..FlatPieces::default()
    };
    let mut placed = vec![[0.0; 2]; soup.places.len()];
    for piece in soup.pieces() {
        let Some(axes) = Axes::of(&soup, &piece) else {
            out.others += 1;
            continue;
        };
        for t in &piece.triangles {
            out.triangles[*t as usize] = true;
            for k in soup.triangles[*t as usize] {
                placed[k as usize] = axes.place(soup.places[k as usize]);
            }
        }
        out.flat.push(piece);
    }
    for (place, k) in out.places.iter_mut().zip(&index) {
        *place = placed[*k as usize];
    }
    out
}

/// Axes of a flat piece: directions along and across, and where the piece begins and how long it is in each.
struct Axes([(DVec3, f64, f64); 2]);

impl Axes {
    fn of(soup: &TriangleSoup, piece: &MeshPiece) -> Option<Axes> {
        let found = leaf::of(soup, piece)?;
        let facing: DVec3 = piece
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = soup.corners(*t);
                (b - a).cross(c - a)
            })
            .sum();
        let normal = if facing.dot(found.normal) < 0.0 { -found.normal } else { found.normal };
        let long = (found.ends[1] - found.ends[0]).normalize_or_zero();
        if long == DVec3::ZERO {
            return None;
        }
        let extent = |axis: DVec3| {
            let along = piece.triangles.iter().flat_map(|t| soup.corners(*t)).map(|p| p.dot(axis));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), d| (low.min(d), high.max(d)))
        };
        let (low, high) = extent(long);
        let middle = found.centre - long * found.centre.dot(long);
        let long = if (middle + long * high).length() < (middle + long * low).length() { -long } else { long };
        let axes = [long, normal.cross(long)].map(|axis| {
            let (low, high) = extent(axis);
            (axis, low, high - low)
        });
        axes.iter().all(|(_, _, length)| *length > 0.0).then_some(Axes(axes))
    }

    fn place(&self, p: DVec3) -> [f64; 2] {
        self.0.map(|(axis, low, length)| ((p.dot(axis) - low) / length).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// A kite of 4 × 2 in the plane xy, its tip along +x, turned and moved; and a box beside it.
    #[test]
    fn a_kite_gets_coordinates_along_its_own_axes_and_a_box_none() {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
        let kite = [(0.0, 0.0), (3.0, -1.0), (4.0, 0.0), (3.0, 1.0)];
        let far = turn * DVec3::new(7.0, 0.0, 0.0);
        let mut positions: Vec<DVec3> = kite.iter().map(|(x, y)| turn * DVec3::new(*x, *y, 0.0) + far).collect();
        // The second triangle has vertices of its own at the same places.
        positions.extend([positions[0], positions[2]]);
        let mut indices = vec![0, 1, 2, 4, 5, 3];
        let first = positions.len() as u32;
        positions.extend((0..8).map(|k| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2))));
        let box_of: [u32; 36] = [
            0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 3, 7, 1, 7, 5,
        ];
        indices.extend(box_of.map(|k| first + k));
        let found = flat(&GltfPrimitive { positions, indices });
        assert_eq!((found.flat.len(), found.others), (1, 1));
        assert_eq!(found.triangles, [vec![true; 2], vec![false; 12]].concat());
        let want = [[0.0, 0.5], [0.75, 0.0], [1.0, 0.5], [0.75, 1.0], [0.0, 0.5], [1.0, 0.5]];
        for (got, want) in found.places.iter().zip(want) {
            assert!((got[0] - want[0]).abs() < 1e-9 && (got[1] - want[1]).abs() < 1e-9, "{got:?} {want:?}");
        }
    }

    /// A square card has no principal axis: its edges are its axes, never its diagonal.
    #[test]
    fn a_card_is_laid_along_its_edges() {
        let corner = |x: f64, y: f64| DVec3::new(x + 5.0, y - 0.5, 0.0);
        let positions = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        let found = flat(&GltfPrimitive { positions, indices: vec![0, 1, 2, 0, 2, 3] });
        for place in &found.places {
            assert!(place.iter().all(|v| v.min(1.0 - v).abs() < 1e-12), "{place:?}");
        }
    }
}
