//! Pictures of a plant's leaves as rectangles, drawn on the CPU along one direction.

use super::cards::Card;
use glam::Vec3;

/// Cells along a picture's side.
const CELLS: usize = 128;
/// The side of a picture over the diameter of the ball around the plant: enlarged leaves reach out of it.
const WIDER: f32 = 1.3;
/// A depth (in cells) by which a leaf may be behind another and still be seen.
const SAME: f32 = 0.02;
/// The cosine of a leaf that is seen edge-on and hides nothing.
const EDGE_ON: f32 = 0.02;
/// A cell in which nothing is seen.
const NONE: u16 = u16::MAX;
/// A plant of more leaves has no pictures.
pub(super) const MOST: usize = NONE as usize;

/// All leaves of a plant, in a ball.
pub(super) struct Crown {
    pub cards: Vec<Card>,
    middle: Vec3,
    cell: f32,
}

/// Which leaf is seen in each cell of a picture, and the picture's axes: to the right, up, and to whom looks.
pub(super) struct Sketch {
    seen: Vec<u16>,
    axes: [Vec3; 3],
}

impl Sketch {
    /// The number of cells in which a leaf is seen.
    pub(super) fn covered(&self) -> f32 {
        self.seen.iter().filter(|k| **k != NONE).count().max(1) as f32
    }
}

impl Crown {
    pub(super) fn new(cards: Vec<Card>, (middle, reach): (Vec3, f32)) -> Crown {
        Crown { cards, middle, cell: 2.0 * WIDER * reach / CELLS as f32 }
    }

    /// All leaves, as large as they are.
    pub(super) fn all(&self) -> Vec<(u16, f32)> {
        (0..self.cards.len() as u16).map(|k| (k, 1.0)).collect()
    }

    /// The cells that all leaves cover.
    pub(super) fn covered(&self, towards: Vec3) -> f32 {
        self.sketch(&self.all(), 1.0, towards).covered()
    }

    /// A picture of leaves, each with the factor of its size, whose areas are multiplied by `larger`.
    pub(super) fn sketch(&self, drawn: &[(u16, f32)], larger: f32, towards: Vec3) -> Sketch {
        let (x, y) = towards.any_orthonormal_pair();
        let mut seen = vec![NONE; CELLS * CELLS];
        let mut depths = vec![f32::NEG_INFINITY; CELLS * CELLS];
        let larger = larger.sqrt();
        for (k, size) in drawn {
            let card = &self.cards[usize::from(*k)];
            let from = card.middle - self.middle;
            let flat = |p: Vec3| [p.dot(x) / self.cell, p.dot(y) / self.cell];
            let [u, v] = card.sides.map(|side| side * (*size * larger));
            let ([cx, cy], [ux, uy], [vx, vy]) = (flat(from), flat(u), flat(v));
            let [cx, cy] = [cx, cy].map(|c| c + 0.5 * CELLS as f32);
            let det = ux * vy - uy * vx;
            if det.abs() < 1e-6 {
                continue;
            }
            let (depth, along, across) = (from.dot(towards), u.dot(towards) / det, v.dot(towards) / det);
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
                        let cell = j * CELLS + i;
                        if depths[cell] < at {
                            (depths[cell], seen[cell]) = (at, *k);
                        }
                    }
                }
            }
        }
        Sketch { seen, axes: [x, y, towards] }
    }

    /// Whether a place of a leaf, from the plant's middle, is seen in a picture.
    pub(super) fn shows(&self, sketch: &Sketch, leaf: u16, place: Vec3) -> bool {
        let [x, y, z] = sketch.axes;
        let to = |axis: Vec3| place.dot(axis) / self.cell + 0.5 * CELLS as f32;
        let (i, j) = (to(x), to(y));
        if !(i >= 0.0 && j >= 0.0 && i < CELLS as f32 && j < CELLS as f32) {
            return true;
        }
        let first = sketch.seen[j as usize * CELLS + i as usize];
        if first == NONE || first == leaf {
            return true;
        }
        // The height of the other leaf's plane over the place.
        let card = &self.cards[usize::from(first)];
        let steep = card.normal.dot(z);
        let above = (card.middle - self.middle - place).dot(card.normal) / steep;
        above <= SAME * self.cell || steep.abs() < EDGE_ON
    }

    /// The light of a picture for each cell in which a leaf is seen, under each of the suns from which pictures of what
    /// casts shadows were made.
    pub(super) fn light(&self, sketch: &Sketch, suns: &[Sketch]) -> Vec<f32> {
        let [x, y, z] = sketch.axes;
        let mut out = vec![0.0; suns.len()];
        for (number, leaf) in sketch.seen.iter().enumerate().filter(|(_, leaf)| **leaf != NONE) {
            let card = &self.cards[usize::from(*leaf)];
            let at = |n: usize| (n as f32 + 0.5 - 0.5 * CELLS as f32) * self.cell;
            let flat = at(number % CELLS) * x + at(number / CELLS) * y;
            let depth = (card.middle - self.middle - flat).dot(card.normal) / card.normal.dot(z);
            let place = flat + depth * z;
            for (sun, out) in suns.iter().zip(&mut out) {
                if self.shows(sun, *leaf, place) {
                    *out += card.sent(z, sun.axes[2]);
                }
            }
        }
        let covered = sketch.covered();
        out.iter_mut().for_each(|sum| *sum /= covered);
        out
    }

    /// A place of a leaf from the plant's middle, where the leaf has this factor of its size and reaches from −1 to 1.
    pub(super) fn place(&self, leaf: u16, size: f32, s: f32, t: f32) -> Vec3 {
        let card = &self.cards[usize::from(leaf)];
        card.middle - self.middle + size * (s * card.sides[0] + t * card.sides[1])
    }
}
