//! Cards of whole twigs: flat pieces that are many times as large as the fitted blade. They are found, and leaves are
//! scattered over them.

use super::Coated;
use super::coverage::folded;
use super::plan::Plan;
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use mesophyll_files::gltf_file::{AlphaMask, GltfPrimitive};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_plants::import::flat_pieces::FlatPieces;
use mesophyll_plants::import::soup::MeshPiece;
use std::path::Path;

/// A piece more than this many times as long as the fitted blade shows no single leaf.
pub(super) const TWIG: f64 = 3.0;

/// The share of a card's area that leaves get where no picture says it.
const FILLED: f64 = 0.5;

/// More leaves than this on one card are a mistake in the unit of its lengths.
const MOST: f64 = 20_000.0;

/// A leaf stands off the card's long axis by this angle, and by half of it more or less (degrees).
const SPREAD_DEG: f64 = 50.0;

/// What the former picture cut out, and how it goes on beyond its edges along u and v.
pub(super) type Cut = (AlphaMask, [u64; 2]);

/// A flat piece: the place of its base's corner, its edges along and across, and its triangles.
#[derive(Debug, Clone)]
pub(super) struct Card {
    pub corner: DVec3,
    pub edges: [DVec3; 2],
    pub triangles: Vec<usize>,
}

impl Card {
    /// Its length in the file's unit.
    pub fn length(&self) -> f64 {
        self.edges[0].length().max(self.edges[1].length())
    }
}

/// The flat pieces of a mesh with their axes.
pub(super) fn cards(surface: &GltfPrimitive, found: &FlatPieces) -> Vec<Card> {
    let triangles = |piece: &MeshPiece| piece.triangles.iter().map(|t| *t as usize).collect();
    found.flat.iter().filter_map(|piece| framed(surface, found, triangles(piece))).collect()
}

/// The axes of a piece, by its largest triangle.
fn framed(surface: &GltfPrimitive, found: &FlatPieces, triangles: Vec<usize>) -> Option<Card> {
    let corners = |t: usize| [0, 1, 2].map(|k| surface.indices[3 * t + k] as usize);
    let sides = |t: usize| {
        let place = corners(t).map(|k| DVec2::from(found.places[k]));
        (place[0], place[1] - place[0], place[2] - place[0])
    };
    let area = |t: usize| sides(t).1.perp_dot(sides(t).2).abs();
    let largest = *triangles.iter().max_by(|a, b| area(**a).total_cmp(&area(**b)))?;
    let (base, u, v) = sides(largest);
    let det = u.perp_dot(v);
    if det.abs() < 1e-9 {
        return None;
    }
    let [a, b, c] = corners(largest).map(|k| surface.positions[k]);
    let (along, across) = (((b - a) * v.y - (c - a) * u.y) / det, ((c - a) * u.x - (b - a) * v.x) / det);
    Some(Card { corner: a - along * base.x - across * base.y, edges: [along, across], triangles })
}

/// Leaves scattered over the cards of a primitive: a rectangle for each leaf, with texture coordinates over the fitted
/// blade.
///
/// The places are those of a low-discrepancy sequence (Roberts 2018), so that leaves lie evenly. A leaf points away
/// from the card's long axis, and is tilted out of the card.
///
/// # Errors
/// [`Error::Input`] for a card with too many leaves.
pub(super) fn scatter(path: &Path, plan: &Plan, cards: &[Card], coated: &Coated) -> Result<LeafMesh> {
    let Plan { surface, found, own, cut, unit_m, .. } = plan;
    let picture = cut.as_ref().zip(own.as_ref().map(|(_, uvs)| uvs));
    let [length, width] = coated.blade_m.map(|v| v / unit_m);
    let blade = length * width * coated.filled;
    let mut out = LeafMesh::default();
    for card in cards {
        let [along, across] = card.edges;
        let area: f64 = card.triangles.iter().map(|t| area(surface, *t)).sum();
        let normal = along.cross(across).normalize_or(DVec3::Z);
        // Where the card shows something, as far as its picture is known.
        let shows = |place: [f64; 2]| -> bool {
            let Some((t, weights)) = card.triangles.iter().find_map(|t| Some((*t, within(surface, found, *t, place)?)))
            else {
                return false;
            };
            picture.is_none_or(|((mask, wrap), uvs)| {
                let corner = |k: usize| uvs[surface.indices[3 * t + k] as usize].map(f64::from);
                let at = [0, 1].map(|c| folded((0..3).map(|k| weights[k] * corner(k)[c]).sum(), wrap[c]));
                mask.at(at) >= 0.0
            })
        };
        let places: Vec<[f64; 2]> = (1..=4096).map(place).collect();
        let share = places.iter().filter(|p| shows(**p)).count() as f64 / places.len() as f64;
        let rectangle = along.cross(across).length();
        let covered = if picture.is_some() { share * rectangle } else { FILLED * area };
        let count = (covered / blade).round().max(1.0);
        if count > MOST {
            let what = format!("{count:.0} leaves of {:.3} m would fit on one card", coated.blade_m[0]);
            return Err(Error::field(
                path,
                &plan.field(),
                format!("{what}; expected at most {MOST} (the unit of its lengths?)"),
            ));
        }
        let there = (1..).map(|k| (k, place(k))).take(400_000).filter(|(_, p)| shows(*p)).take(count as usize);
        for (k, [a, b]) in there {
            let chance = |step: f64| 2.0 * (k as f64 * step).rem_euclid(1.0) - 1.0;
            let side = if b < 0.5 { -1.0 } else { 1.0 };
            let turn = side * (SPREAD_DEG * (1.0 + 0.5 * chance(0.724_491_959))).to_radians();
            let to = (along.normalize_or(DVec3::X) * turn.cos()
                + normal.cross(along).normalize_or(DVec3::Y) * turn.sin())
            .normalize_or(DVec3::X);
            let tilt = (35.0 * chance(0.618_033_989)).to_radians();
            let across_leaf = (normal.cross(to) * tilt.cos() + normal * tilt.sin()).normalize_or(DVec3::Y);
            let facing = to.cross(across_leaf);
            let middle = card.corner + along * a + across * b;
            let first = out.positions.len() as u32;
            for [u, v] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                out.positions.push(middle + to * (length * (u - 0.5)) + across_leaf * (width * (v - 0.5)));
                out.normals.push(facing);
                out.uvs.push(DVec2::from(coated.coordinates([u, v]).map(f64::from)));
            }
            out.indices.extend([0, 1, 2, 0, 2, 3].map(|k| first + k));
        }
    }
    Ok(out)
}

fn area(surface: &GltfPrimitive, t: usize) -> f64 {
    let [a, b, c] = [0, 1, 2].map(|k| surface.positions[surface.indices[3 * t + k] as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// The place with this number in a sequence that fills the unit square evenly.
fn place(k: usize) -> [f64; 2] {
    [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step: f64| (0.5 + k as f64 * step).rem_euclid(1.0))
}

/// The weights of a triangle's corners at a place of its piece, where it lies within.
fn within(surface: &GltfPrimitive, found: &FlatPieces, t: usize, place: [f64; 2]) -> Option<[f64; 3]> {
    let [a, b, c] = [0, 1, 2].map(|k| DVec2::from(found.places[surface.indices[3 * t + k] as usize]));
    let det = (b - a).perp_dot(c - a);
    let p = DVec2::from(place) - a;
    let (v, w) = (p.perp_dot(c - a) / det, (b - a).perp_dot(p) / det);
    (v >= 0.0 && w >= 0.0 && v + w <= 1.0).then_some([1.0 - v - w, v, w])
}
