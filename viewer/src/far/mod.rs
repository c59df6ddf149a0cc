//! What a plant of a stand lacks where fewer and larger leaves are drawn of it: from each side, how much larger they
//! must be to cover as much as all leaves do, and how much more or less sunlight they must send. Both are found from
//! the plant itself, once: its leaves are drawn on the CPU as rectangles, all of them and as many as a level keeps,
//! from many directions and under many suns. Few coefficients for each level say the rest.
//!
//! Leaves that stay are those whose normals and places have the moments of all leaves (herding: Chen, Welling & Smola
//! 2010, "Super-samples from kernel herding").

mod cards;

use crate::extents::{StandBounds, scale_of};
use crate::geometry::{BatchKey, ball};
use crate::least_squares::solved;
use crate::scene::{Instance, LeafMaterial, Mesh, Scene, Side};
use crate::thinning::{FEWEST, MANY, WIDE, size};
use cards::{Card, card, means, order};
use glam::Vec3;
use std::collections::{BTreeMap, HashMap};
use std::hash::{Hash, Hasher};
use std::sync::{Arc, OnceLock};

/// A plant that is narrower than this in the picture (pixels) has still fewer leaves than [`FEWEST`] allows, in
/// proportion to the pixels that it covers, but never fewer than [`LAST`].
const NARROW: f32 = 24.0;
const LAST: f32 = 16.0;
/// A plant of more leaves has no factors, because they would take long to find.
const MOST: usize = 1 << 16;
/// Directions of views and of suns, cells along a picture's side, and levels for a width of pixels and twice as much.
const VIEWS: usize = 40;
const SUNS: usize = 16;
const CELLS: usize = 128;
const STEPS: f32 = 1.0;
/// Numbers of coefficients.
const COVER: usize = 15;
const SUN: usize = 81;
/// The side of a picture over the diameter of the ball around the plant: enlarged leaves reach out of it.
const WIDER: f32 = 1.3;
/// A depth (in cells) by which a leaf may be behind another and still see the sun.
const SAME: f32 = 0.02;

/// All leaves of one mesh and material of a plant. They have no ranks before they belong to a plant.
pub(crate) struct FarLeaves {
    cards: Vec<Card>,
    /// Leaves with high ranks are left out first.
    pub ranks: Vec<f32>,
    /// Radius of the ball around a leaf, the mean over the leaves.
    radius: f32,
    /// Light that a leaf sends back from its front and from its back, and what it lets through.
    sends: [f32; 3],
}

/// A plant of a stand whose leaves may be thinned.
pub(crate) struct FarPlant {
    pub leaves: Vec<FarLeaves>,
    middle: Vec3,
    reach: f32,
    fit: OnceLock<Vec<FarLevel>>,
}

/// A width of pixels (mm, in the plant's frame), and how plants are corrected there.
struct FarLevel {
    width: f32,
    cover: [f32; COVER],
    sun: [f32; SUN],
}

/// A plant whose leaves may be thinned, and the number of the kind of leaves in it.
pub(crate) type FarKind = (Arc<FarPlant>, usize);

/// Plants that are known, kept from scene to scene.
#[derive(Default)]
pub(crate) struct FarPlants(HashMap<u64, Arc<FarPlant>>);

/// The largest number of plants that are kept from scene to scene.
const KNOWN: usize = 64;

impl FarPlants {
    /// The plant with these leaves in this ball, which is made where it is not known.
    pub(crate) fn plant(&mut self, leaves: Vec<FarLeaves>, around: (Vec3, f32)) -> Arc<FarPlant> {
        let mut hash = std::hash::DefaultHasher::new();
        let numbers = |own: &FarLeaves| [own.sends[0], own.sends[1], own.sends[2], own.radius].map(f32::to_bits);
        let bits = |card: &Card| [card.middle, card.sides[0], card.sides[1]].map(|v| v.to_array().map(f32::to_bits));
        for own in &leaves {
            numbers(own).hash(&mut hash);
            own.cards.iter().for_each(|card| bits(card).hash(&mut hash));
        }
        if self.0.len() >= KNOWN {
            self.0.clear();
        }
        self.0.entry(hash.finish()).or_insert_with(|| Arc::new(FarPlant::new(leaves, around))).clone()
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
        let plant = known.plant(kinds.iter().map(leaves).collect(), bounds.rest);
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
        let cards: Vec<Card> = instances.iter().map(|instance| card(mesh, instance)).collect();
        let sends = leaf.map_or([1.0, 1.0, 0.0], |leaf| {
            let [front, back] = [Side::Front, Side::Back].map(|side| means(leaf, side));
            [front[0], back[0], 0.5 * (front[1] + back[1])]
        });
        FarLeaves { ranks: Vec::new(), cards, radius, sends }
    }
}

/// Directions that are spread evenly over the ball down to this height.
fn directions(count: usize, low: f32) -> Vec<Vec3> {
    let one = |k: usize| {
        let z = low + (1.0 - low) * (k as f32 + 0.5) / count as f32;
        let (sin, cos) = (2.399_963_2 * k as f32).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        Vec3::new(flat * cos, flat * sin, z)
    };
    (0..count).map(one).collect()
}

/// The axes of a picture: to the right, up, and to whom looks.
fn axes(towards: Vec3) -> [Vec3; 3] {
    let (x, y) = towards.any_orthonormal_pair();
    [x, y, towards]
}

/// Polynomials of a direction, the even ones up to the fourth order.
fn cover_terms(d: Vec3) -> [f32; COVER] {
    let mut out = [0.0; COVER];
    let mut n = 0;
    for i in 0..=4 {
        for j in 0..=4 - i {
            out[n] = d.x.powi(i) * d.y.powi(j) * d.z.powi(4 - i - j);
            n += 1;
        }
    }
    out
}

/// Products of the polynomials up to the second order of both directions.
fn sun_terms(view: Vec3, sun: Vec3) -> [f32; SUN] {
    let of = |d: Vec3| {
        let Vec3 { x, y, z } = d;
        [1.0, x, y, z, x * y, y * z, z * x, x * x - y * y, 3.0 * z * z - 1.0]
    };
    let (view, sun) = (of(view), of(sun));
    std::array::from_fn(|k| view[k / 9] * sun[k % 9])
}

/// What is seen in each cell of a picture: the kind and number of a leaf, and its depth.
type Seen = Vec<Option<(u16, u32, f32)>>;

impl FarPlant {
    fn new(mut leaves: Vec<FarLeaves>, (middle, reach): (Vec3, f32)) -> FarPlant {
        leaves.iter_mut().for_each(|own| own.ranks = order(&own.cards));
        FarPlant { leaves, middle, reach, fit: OnceLock::new() }
    }

    /// The share of the leaves of a kind that is drawn where pixels have this width in the plant's frame.
    pub(crate) fn kept(&self, kind: usize, pixel: f32) -> f32 {
        let leaves = &self.leaves[kind];
        kept(leaves.cards.len(), leaves.radius, self.reach, pixel)
    }

    /// By how much the area of leaves and the sun's light are multiplied where pixels have this width in the plant's
    /// frame.
    pub(crate) fn factors(&self, pixel: f32, view: Vec3, sun: Option<Vec3>) -> [f32; 2] {
        let count: usize = self.leaves.iter().map(|own| own.cards.len()).sum();
        if count > MOST || (0..self.leaves.len()).all(|kind| self.kept(kind, pixel) >= 1.0) {
            return [1.0; 2];
        }
        let levels = self.fit.get_or_init(|| self.fitted());
        let next = levels.partition_point(|level| level.width < pixel);
        let at = |level: Option<&FarLevel>| {
            level.map_or([1.0; 2], |level| {
                let cover: f32 = cover_terms(view).iter().zip(&level.cover).map(|(t, c)| t * c).sum();
                let lit = |sun| sun_terms(view, sun).iter().zip(&level.sun).map(|(t, c)| t * c).sum::<f32>();
                [cover, sun.map_or(0.0, lit)].map(|off| (1.0 + off).clamp(0.4, 2.5))
            })
        };
        let (Some(before), Some(after)) = (next.checked_sub(1).and_then(|k| levels.get(k)), levels.get(next)) else {
            return at(levels.last().filter(|_| next > 0));
        };
        let t = (pixel / before.width).ln() / (after.width / before.width).ln();
        let (a, b) = (at(Some(before)), at(Some(after)));
        [0, 1].map(|k| a[k] + t * (b[k] - a[k]))
    }

    /// The leaves that are drawn with pixels of this width, with the factor of their size.
    fn drawn(&self, pixel: f32) -> Vec<Vec<(u32, f32)>> {
        let of = |kind: usize| {
            let kept = self.kept(kind, pixel);
            let one = |(k, rank): (usize, &f32)| (k as u32, size(kept, *rank));
            self.leaves[kind].ranks.iter().enumerate().map(one).filter(|(_, size)| *size > 0.0).collect()
        };
        (0..self.leaves.len()).map(of).collect()
    }

    /// A picture of these leaves, whose areas are multiplied by `larger`.
    fn picture(&self, drawn: &[Vec<(u32, f32)>], larger: f32, [x, y, z]: [Vec3; 3]) -> Seen {
        let mut out: Seen = vec![None; CELLS * CELLS];
        let per_cell = CELLS as f32 / (2.0 * WIDER * self.reach);
        for (kind, own) in drawn.iter().enumerate() {
            for (k, size) in own {
                let card = &self.leaves[kind].cards[*k as usize];
                let from = card.middle - self.middle;
                let flat = |p: Vec3| [p.dot(x) * per_cell, p.dot(y) * per_cell];
                let [u, v] = card.sides.map(|side| side * (*size * larger.sqrt()));
                let ([cx, cy], [ux, uy], [vx, vy]) = (flat(from), flat(u), flat(v));
                let [cx, cy] = [cx, cy].map(|c| c + 0.5 * CELLS as f32);
                let det = ux * vy - uy * vx;
                if det.abs() < 1e-6 {
                    continue;
                }
                let (depth, along, across) = (from.dot(z), u.dot(z) / det, v.dot(z) / det);
                let range = |c: f32, r: f32| {
                    let low = (c - r - 0.5).ceil().clamp(0.0, CELLS as f32) as usize;
                    low..((c + r - 0.5).floor() + 1.0).clamp(0.0, CELLS as f32) as usize
                };
                for j in range(cy, uy.abs() + vy.abs()) {
                    for i in range(cx, ux.abs() + vx.abs()) {
                        let (dx, dy) = (i as f32 + 0.5 - cx, j as f32 + 0.5 - cy);
                        let (s, t) = (dx * vy - dy * vx, ux * dy - uy * dx);
                        if s.abs() <= det.abs() && t.abs() <= det.abs() {
                            let at = depth + s * along + t * across;
                            let cell = &mut out[j * CELLS + i];
                            if cell.is_none_or(|(.., before)| before < at) {
                                *cell = Some((kind as u16, *k, at));
                            }
                        }
                    }
                }
            }
        }
        out
    }

    /// The light that a picture shows under each of the suns, in which `casting` are all leaves as the suns see them.
    fn light(&self, seen: &Seen, [x, y, z]: [Vec3; 3], casting: &[(Vec3, Seen)]) -> [f32; SUNS] {
        let cell = 2.0 * WIDER * self.reach / CELLS as f32;
        let mut out = [0.0; SUNS];
        for (number, found) in seen.iter().enumerate() {
            let Some((kind, k, depth)) = found else { continue };
            let at = |n: usize| (n as f32 + 0.5 - 0.5 * CELLS as f32) * cell;
            let place = at(number % CELLS) * x + at(number / CELLS) * y + *depth * z;
            let leaves = &self.leaves[*kind as usize];
            let normal = leaves.cards[*k as usize].normal;
            let front = normal.dot(z) > 0.0;
            for ((sun, shade), out) in casting.iter().zip(&mut out) {
                let [sx, sy, sz] = axes(*sun);
                let to = |axis: Vec3| place.dot(axis) / cell + 0.5 * CELLS as f32;
                let [i, j] = [to(sx), to(sy)];
                let inside = i >= 0.0 && j >= 0.0 && i < CELLS as f32 && j < CELLS as f32;
                let first = inside.then(|| shade[j as usize * CELLS + i as usize]).flatten();
                let lit = first.is_none_or(|(kind, caster, _)| {
                    let card = &self.leaves[kind as usize].cards[caster as usize];
                    // The depth of the caster's plane at the place.
                    let steep = card.normal.dot(sz);
                    let above = (card.middle - self.middle - place).dot(card.normal) / steep;
                    above <= SAME * cell || steep.abs() < 0.02
                });
                if lit {
                    let cosine = normal.dot(*sun);
                    let sends =
                        if (cosine > 0.0) != front { leaves.sends[2] } else { leaves.sends[usize::from(!front)] };
                    *out += cosine.abs() * sends;
                }
            }
        }
        out
    }

    /// The levels, from the first at which leaves are left out to the last that differs.
    fn fitted(&self) -> Vec<FarLevel> {
        let views = directions(VIEWS, -0.6);
        let all: Vec<Vec<(u32, f32)>> =
            self.leaves.iter().map(|own| (0..own.cards.len() as u32).map(|k| (k, 1.0)).collect()).collect();
        let casting: Vec<(Vec3, Seen)> =
            directions(SUNS, 0.0).into_iter().map(|sun| (sun, self.picture(&all, 1.0, axes(sun)))).collect();
        let covered = |seen: &Seen| seen.iter().flatten().count().max(1) as f32;
        let full: Vec<(f32, [f32; SUNS])> = views
            .iter()
            .map(|view| {
                let seen = self.picture(&all, 1.0, axes(*view));
                (covered(&seen), self.light(&seen, axes(*view), &casting))
            })
            .collect();
        let level = |width: f32| {
            let drawn = self.drawn(width);
            let larger: Vec<f32> = views
                .iter()
                .zip(&full)
                .map(|(view, (wanted, _))| {
                    let found = |larger: f32| covered(&self.picture(&drawn, larger, axes(*view)));
                    // A step by the rule that half of any more area is hidden, and one through both.
                    let first = found(1.0);
                    let off = (wanted / first).ln();
                    if off.abs() < 2e-3 {
                        return (2.0 * off).exp();
                    }
                    let slope = (found((2.0 * off).exp()) / first).ln() / (2.0 * off);
                    (off / slope.clamp(0.2, 1.0)).exp()
                })
                .collect();
            let cover = solved(views.iter().zip(&larger).map(|(view, a)| (cover_terms(*view), a - 1.0, 1.0)));
            let mut samples = Vec::new();
            for (view, (_, wanted)) in views.iter().zip(&full) {
                let larger = 1.0 + cover_terms(*view).iter().zip(&cover).map(|(t, c)| t * c).sum::<f32>();
                let seen = self.picture(&drawn, larger.clamp(0.4, 2.5), axes(*view));
                let found = self.light(&seen, axes(*view), &casting);
                for (((sun, _), wanted), found) in casting.iter().zip(wanted).zip(found) {
                    if *wanted > 0.0 && found > 0.0 {
                        samples.push((sun_terms(*view, *sun), wanted / found - 1.0, found / wanted));
                    }
                }
            }
            FarLevel { width, cover, sun: solved(samples.into_iter()) }
        };
        // Widths at which something changes: until the kinds keep the fewest of their leaves.
        let widest = self.leaves.iter().map(|own| 2.0 * own.radius / WIDE).fold(0.0, f32::max);
        let first = self.leaves.iter().map(|own| 2.0 * own.radius / WIDE).fold(widest, f32::min);
        let mut out = vec![FarLevel { width: first, cover: [0.0; COVER], sun: [0.0; SUN] }];
        for k in 1..64 {
            let width = first * (k as f32 / STEPS).exp2();
            let least = |own: &FarLeaves| (LAST / own.cards.len() as f32).min(1.0);
            let fewest = |kind: usize| self.kept(kind, 0.5 * width) <= least(&self.leaves[kind]);
            if width > 2.0 * widest && (0..self.leaves.len()).all(fewest) {
                break;
            }
            out.push(level(width));
        }
        out
    }
}
