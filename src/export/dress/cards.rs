//! Cards of whole twigs: flat pieces that are many times as large as the fitted blade. They are found, and leaves are
//! scattered over them.

use super::Coated;
use super::cover::folded;
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use mesophyll_files::gltf_file::Surface;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_flora::import::flat::Flat;
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;

/// A piece more than this many times as long as the fitted blade shows no single leaf.
pub(super) const TWIG: f64 = 3.0;

/// The share of a card's area that leaves get where no picture says it.
const FILLED: f64 = 0.5;

/// More leaves than this on one card are a mistake in the unit of its lengths.
const MOST: f64 = 20_000.0;

/// A leaf stands off the card's long axis by this angle, and by half of it more or less (degrees).
const SPREAD_DEG: f64 = 50.0;

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
pub(super) fn cards(surface: &Surface, found: &Flat) -> Vec<Card> {
    // Triangles that share a place belong to one piece.
    let mut owner: HashMap<[u64; 3], usize> = HashMap::new();
    let mut root: Vec<usize> = (0..surface.indices.len() / 3).collect();
    fn top(root: &mut [usize], mut k: usize) -> usize {
        while root[k] != k {
            root[k] = root[root[k]];
            k = root[k];
        }
        k
    }
    for (t, corners) in surface.indices.chunks_exact(3).enumerate() {
        for k in corners {
            let place = surface.positions[*k as usize].to_array().map(|v| (v + 0.0).to_bits());
            let other = *owner.entry(place).or_insert(t);
            let (a, b) = (top(&mut root, t), top(&mut root, other));
            root[a.max(b)] = a.min(b);
        }
    }
    let mut pieces: HashMap<usize, Vec<usize>> = HashMap::new();
    for t in (0..root.len()).filter(|t| found.triangles[*t]) {
        pieces.entry(top(&mut root, t)).or_default().push(t);
    }
    let mut pieces: Vec<Vec<usize>> = pieces.into_values().collect();
    // The order of a map changes from run to run.
    pieces.sort_unstable();
    pieces.into_iter().filter_map(|triangles| framed(surface, found, triangles)).collect()
}

/// The axes of a piece, by its largest triangle.
fn framed(surface: &Surface, found: &Flat, triangles: Vec<usize>) -> Option<Card> {
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

/// The opacity of a picture, by which a card is cut out.
#[derive(Debug, Clone)]
pub(super) struct Opacity {
    size: [usize; 2],
    on: Vec<bool>,
    wrap: [u64; 2],
}

impl Opacity {
    /// The opacity of the PNG that a material's colour is read from; `None` where it has none, or another kind of
    /// picture.
    pub fn of(root: &Value, bin: &[u8], colour: &Value, cutoff: f64) -> Option<Opacity> {
        let at = |list: &str, k: &Value| root[list].get(k.as_u64()? as usize).cloned();
        let image = at("images", &at("textures", &colour["index"])?["source"])?;
        let view = at("bufferViews", &image["bufferView"])?;
        let from = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let bytes = bin.get(from..from.checked_add(view["byteLength"].as_u64()? as usize)?)?;
        let picture = image::load_from_memory_with_format(bytes, image::ImageFormat::Png).ok()?;
        if !picture.color().has_alpha() {
            return None;
        }
        let picture = picture.into_rgba8();
        let on: Vec<bool> = picture.pixels().map(|p| f64::from(p.0[3]) / 255.0 >= cutoff).collect();
        let size = [picture.width() as usize, picture.height() as usize];
        Some(Opacity { size, on, wrap: super::cover::wrap(root, colour) })
    }

    fn is_on(&self, uv: [f64; 2]) -> bool {
        let [x, y] = [0, 1].map(|k| {
            let size = self.size[k] as f64;
            (folded(uv[k], self.wrap[k]) * size).clamp(0.0, size - 1.0) as usize
        });
        self.on[y * self.size[0] + x]
    }
}

/// Leaves scattered over the cards: a rectangle for each, with texture coordinates over the fitted blade. `uvs` are the
/// file's own coordinates, and `unit_m` is the length of the file's unit in the scene (m).
///
/// The places are those of a low-discrepancy sequence (Roberts 2018), so that leaves lie evenly. A leaf points away
/// from the card's long axis, and is tilted out of the card.
///
/// # Errors
/// [`Error::Input`] for a card with too many leaves.
pub(super) fn scatter(
    path: &Path,
    field: &str,
    surface: &Surface,
    found: &Flat,
    cards: &[Card],
    coated: &Coated,
    picture: Option<(&Opacity, &[[f32; 2]])>,
    unit_m: f64,
) -> Result<LeafMesh> {
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
            picture.is_none_or(|(opacity, uvs)| {
                let corner = |k: usize| uvs[surface.indices[3 * t + k] as usize].map(f64::from);
                opacity.is_on([0, 1].map(|c| (0..3).map(|k| weights[k] * corner(k)[c]).sum()))
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
                field,
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

fn area(surface: &Surface, t: usize) -> f64 {
    let [a, b, c] = [0, 1, 2].map(|k| surface.positions[surface.indices[3 * t + k] as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// The place with this number in a sequence that fills the unit square evenly.
fn place(k: usize) -> [f64; 2] {
    [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step: f64| (0.5 + k as f64 * step).rem_euclid(1.0))
}

/// The weights of a triangle's corners at a place of its piece, where it lies within.
fn within(surface: &Surface, found: &Flat, t: usize, place: [f64; 2]) -> Option<[f64; 3]> {
    let [a, b, c] = [0, 1, 2].map(|k| DVec2::from(found.places[surface.indices[3 * t + k] as usize]));
    let det = (b - a).perp_dot(c - a);
    let p = DVec2::from(place) - a;
    let (v, w) = (p.perp_dot(c - a) / det, (b - a).perp_dot(p) / det);
    (v >= 0.0 && w >= 0.0 && v + w <= 1.0).then_some([1.0 - v - w, v, w])
}
