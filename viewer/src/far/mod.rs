//! What a plant of a stand lacks where fewer and larger leaves are drawn of it: from each side, how much larger they
//! must be to cover as much as all leaves do, and how much more or less sunlight they must send. Both are found from
//! the plant itself: its leaves are drawn on the CPU as rectangles, all of them and as many as are kept (`sketch`).
//!
//! What all leaves send is a smooth function of the directions of eye and sun, of which few coefficients are kept. What
//! few leaves send is none, because they hide and shade each other in a pattern. So the pattern itself is kept: which
//! patches of the drawn leaves are seen from a direction, and which are in the sun (`level`). Both are found where they
//! are first asked for.
//!
//! Leaves that stay are those whose normals and places have the moments of all leaves (herding: Chen, Welling & Smola
//! 2010, "Super-samples from kernel herding").

mod cards;
mod directions;
mod level;
mod sketch;
#[cfg(test)]
mod tests;

use crate::extents::{StandBounds, scale_of};
use crate::geometry::{BatchKey, ball};
use crate::least_squares::solved;
use crate::scene::{Instance, LeafMaterial, Mesh, Scene, Side};
use crate::thinning::{FEWEST, MANY, WIDE, size};
use cards::{Card, means, order, rectangle};
use directions::{OnDirections, TERMS, spread, terms};
use glam::{Mat3, Quat, Vec3};
use level::Level;
use sketch::{Crown, MOST, Sketch};
use std::collections::{BTreeMap, HashMap};
use std::hash::{Hash, Hasher};
use std::sync::{Arc, OnceLock};

/// A plant that is narrower than this in the picture (pixels) has still fewer leaves than [`FEWEST`] allows, in
/// proportion to the pixels that it covers, but never fewer than [`LAST`].
const NARROW: f32 = 24.0;
const LAST: f32 = 16.0;
/// Levels between a width of pixels and twice as much.
const STEPS: f32 = 3.0;
/// The lowest direction from which a plant is looked at, and numbers of directions, of which few coefficients are kept.
const LOWEST: f32 = -0.6;
const VIEWS: usize = 64;
const SUNS: usize = 32;
/// Limits of the factor of the sun's light.
const LIGHT: [f32; 2] = [0.4, 2.5];
/// Below the directions that coefficients were found for, the factor of light becomes 1 within this height.
const FADES: f32 = 0.2;

/// All leaves of one mesh and material of a plant. They have no ranks before they belong to a plant.
pub(crate) struct FarLeaves {
    /// Leaves with high ranks are left out first.
    pub ranks: Vec<f32>,
    cards: Vec<Card>,
    /// Radius of the ball around a leaf, the mean over the leaves.
    radius: f32,
}

/// A plant of a stand whose leaves may be thinned.
pub(crate) struct FarPlant {
    pub leaves: Vec<FarLeaves>,
    /// A ball around it.
    around: (Vec3, f32),
    /// The direction that is upright where it stands.
    up: Vec3,
    patterns: OnceLock<Option<Patterns>>,
}

/// What is known of a plant's leaves, all of them and at each level.
struct Patterns {
    crown: Crown,
    /// The cells that all leaves cover.
    covered: OnDirections<f32>,
    /// The sunlight that all leaves send, in that of cells.
    sent: [f32; TERMS],
    levels: Vec<Level>,
}

/// A plant whose leaves may be thinned, and the number of the kind of leaves in it.
pub(crate) type FarKind = (Arc<FarPlant>, usize);

/// Plants that are known, kept from scene to scene.
#[derive(Default)]
pub(crate) struct FarPlants(HashMap<u64, Arc<FarPlant>>);

/// The largest number of plants that are kept from scene to scene.
const KNOWN: usize = 64;

impl FarPlants {
    /// The plant with these leaves in this ball, which is made where it is not known. `up` is upright in its frame.
    pub(crate) fn plant(&mut self, leaves: Vec<FarLeaves>, around: (Vec3, f32), up: Vec3) -> Arc<FarPlant> {
        let mut hash = std::hash::DefaultHasher::new();
        let bits = |card: &Card| {
            let places = [card.middle, card.sides[0], card.sides[1]].map(|v| v.to_array().map(f32::to_bits));
            (places, card.sends.map(f32::to_bits))
        };
        for own in &leaves {
            own.radius.to_bits().hash(&mut hash);
            own.cards.iter().for_each(|card| bits(card).hash(&mut hash));
        }
        let ball = [around.0.to_array(), [around.1, 0.0, 0.0], up.to_array()];
        ball.map(|v| v.map(f32::to_bits)).hash(&mut hash);
        let key = hash.finish();
        if self.0.len() >= KNOWN && !self.0.contains_key(&key) {
            self.0.retain(|_, plant| Arc::strong_count(plant) > 1);
        }
        self.0.entry(key).or_insert_with(|| Arc::new(FarPlant::new(leaves, around, up))).clone()
    }
}

/// The plants of stands whose leaves may be thinned with the kinds of their leaves, by the numbers of stand, material
/// and mesh.
pub(crate) fn thinned(
    scene: &Scene,
    together: &BTreeMap<BatchKey, Vec<Instance>>,
    stands: &[Arc<StandBounds>],
    known: &mut FarPlants,
) -> BTreeMap<(u32, usize, usize), FarKind> {
    let mut out = BTreeMap::new();
    for (k, bounds) in (0u32..).zip(stands).filter(|_| !scene.in_full) {
        let own = together.iter().filter(|((material, _, stand, _), instances)| {
            *stand == Some(k) && instances.len() >= MANY && scene.leaf(*material).is_some()
        });
        let kinds: Vec<_> = own.map(|((material, mesh, ..), instances)| (*material, *mesh, instances)).collect();
        let leaves = |(material, mesh, instances): &(usize, usize, &Vec<Instance>)| {
            FarLeaves::new(&scene.meshes[*mesh], scene.leaf(*material), instances)
        };
        let (false, Some(place)) = (kinds.is_empty(), scene.stands[k as usize].places.first()) else { continue };
        // All places of a plant have the same tilt.
        let up = (Mat3::from_mat4(place.transform).transpose() * Vec3::Z).normalize_or(Vec3::Z);
        let plant = known.plant(kinds.iter().map(leaves).collect(), bounds.rest, up);
        for (kind, (material, mesh, _)) in kinds.iter().enumerate() {
            out.insert((k, *material, *mesh), (plant.clone(), kind));
        }
    }
    out
}

/// The share of its leaves that is drawn of a plant, where pixels or texels have this width in its own frame.
fn kept(count: usize, radius: f32, reach: f32, pixel: f32) -> f32 {
    let across = |radius: f32| 2.0 * radius / pixel.max(1e-30);
    let narrow = (across(reach) / NARROW).min(1.0).powi(2);
    let least = (FEWEST * narrow).max(LAST / count as f32);
    (across(radius) / WIDE).powi(2).max(least).min(1.0)
}

impl FarLeaves {
    pub(crate) fn new(mesh: &Mesh, leaf: Option<&LeafMaterial>, instances: &[Instance]) -> FarLeaves {
        let squares: f32 = instances.iter().map(|i| scale_of(&i.transform).powi(2)).sum();
        let radius = ball(&mesh.positions).1 * (squares / instances.len().max(1) as f32).sqrt();
        let sends = leaf.map_or([1.0, 1.0, 0.0], |leaf| {
            let [front, back] = [Side::Front, Side::Back].map(|side| means(leaf, side));
            [front[0], back[0], 0.5 * (front[1] + back[1])]
        });
        let own = rectangle(mesh, sends);
        let cards = instances.iter().map(|instance| own.placed(instance)).collect();
        FarLeaves { ranks: Vec::new(), cards, radius }
    }
}

impl FarPlant {
    fn new(mut leaves: Vec<FarLeaves>, around: (Vec3, f32), up: Vec3) -> FarPlant {
        leaves.iter_mut().for_each(|own| own.ranks = order(&own.cards));
        FarPlant { leaves, around, up, patterns: OnceLock::new() }
    }

    /// The share of the leaves of a kind that is drawn where pixels have this width in the plant's frame.
    pub(crate) fn kept(&self, kind: usize, pixel: f32) -> f32 {
        let leaves = &self.leaves[kind];
        kept(leaves.cards.len(), leaves.radius, self.around.1, pixel)
    }

    /// By how much the area of leaves and the sun's light are multiplied where pixels have this width in the plant's
    /// frame.
    pub(crate) fn factors(&self, pixel: f32, view: Vec3, sun: Option<Vec3>) -> [f32; 2] {
        if (0..self.leaves.len()).all(|kind| self.kept(kind, pixel) >= 1.0) {
            return [1.0; 2];
        }
        let Some(known) = self.patterns.get_or_init(|| self.patterns()) else { return [1.0; 2] };
        let all = sun.map(|sun| known.sent(view, sun));
        let trust = sun.map_or(0.0, |sun| self.trust(view, sun));
        let at = |level: &Level| {
            let (larger, sent) = level.seen(&known.crown, &known.covered, view, sun);
            let lit = all.zip(sent).map_or(1.0, |(all, own)| all / own.max(1e-30));
            [larger, 1.0 + trust * (lit.clamp(LIGHT[0], LIGHT[1]) - 1.0)]
        };
        let next = known.levels.partition_point(|level| level.width < pixel);
        let after = known.levels.get(next);
        let Some(before) = next.checked_sub(1).and_then(|k| known.levels.get(k)) else { return [1.0; 2] };
        let Some(after) = after else { return at(before) };
        let t = (pixel / before.width).ln() / (after.width / before.width).ln();
        let (a, b) = (if next == 1 { [1.0; 2] } else { at(before) }, at(after));
        [0, 1].map(|k| a[k] + t * (b[k] - a[k]))
    }

    /// From 1, where coefficients were found for these directions, to 0 far below them. Both may be exchanged.
    fn trust(&self, view: Vec3, sun: Vec3) -> f32 {
        let [view, sun] = [view, sun].map(|d| d.dot(self.up));
        let within = view.min(sun - LOWEST).max(sun.min(view - LOWEST));
        (1.0 + within.min(0.0) / FADES).max(0.0)
    }

    /// The leaves that are drawn with pixels of this width, with the factor of their size, in the order of their ranks.
    fn drawn(&self, pixel: f32) -> Vec<(u16, f32)> {
        let mut out = Vec::new();
        let mut first = 0;
        for (kind, own) in self.leaves.iter().enumerate() {
            let kept = self.kept(kind, pixel);
            let one = |(k, rank): (usize, &f32)| ((first + k) as u16, size(kept, *rank), *rank);
            out.extend(own.ranks.iter().enumerate().map(one).filter(|(_, size, _)| *size > 0.0));
            first += own.ranks.len();
        }
        out.sort_by(|a, b| a.2.total_cmp(&b.2));
        out.into_iter().map(|(k, size, _)| (k, size)).collect()
    }

    /// What is known of this plant, if its leaves are not too many.
    fn patterns(&self) -> Option<Patterns> {
        let cards: Vec<Card> = self.leaves.iter().flat_map(|own| own.cards.iter().copied()).collect();
        if cards.len() > MOST {
            return None;
        }
        let crown = Crown::new(cards, self.around);
        let all = crown.all();
        let turn = Quat::from_rotation_arc(Vec3::Z, self.up);
        let around = |count: usize, low: f32| spread(count, low).into_iter().map(move |d| turn * d);
        let suns: Vec<Vec3> = around(SUNS, 0.0).collect();
        let casting: Vec<Sketch> = suns.iter().map(|sun| crown.sketch(&all, 1.0, *sun)).collect();
        let sample = |view: Vec3| {
            let sketch = crown.sketch(&all, 1.0, view);
            let one = |(sun, sent): (&Vec3, f32)| (terms(view, *sun), sent * sketch.covered());
            suns.iter().zip(crown.light(&sketch, &casting)).map(one).collect::<Vec<_>>()
        };
        let sent = solved(around(VIEWS, LOWEST).flat_map(sample));
        // Leaves without a vector area, such as needles, and black ones have no card that tells anything.
        if sent.iter().all(|c| *c == 0.0) {
            return None;
        }
        // Widths at which something changes: until the kinds keep the fewest of their leaves.
        let widths = || self.leaves.iter().map(|own| 2.0 * own.radius / WIDE);
        let (first, widest) = (widths().fold(f32::INFINITY, f32::min), widths().fold(0.0, f32::max));
        let least = |kind: usize| (LAST / self.leaves[kind].cards.len() as f32).min(1.0);
        let mut levels = Vec::new();
        for k in 0..(24.0 * STEPS) as u32 {
            let width = first * (k as f32 / STEPS).exp2();
            levels.push(Level::new(width, self.drawn(width)));
            if width > widest && (0..self.leaves.len()).all(|kind| self.kept(kind, width) <= least(kind)) {
                break;
            }
        }
        Some(Patterns { crown, covered: OnDirections::new(), sent, levels })
    }
}

impl Patterns {
    /// The sunlight that all leaves send for the area that they cover.
    fn sent(&self, view: Vec3, sun: Vec3) -> f32 {
        let sent: f32 = terms(view, sun).iter().zip(&self.sent).map(|(t, c)| t * c).sum();
        let around = self.covered.around(view, |d| self.crown.covered(d));
        sent.max(0.0) / around.iter().map(|(covered, share)| **covered * share).sum::<f32>()
    }
}
