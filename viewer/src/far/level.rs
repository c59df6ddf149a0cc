//! What is drawn of a plant where pixels have one width: how much larger its leaves must be from each side, and the
//! light that they send.

use super::directions::OnDirections;
use super::sketch::{Crown, Sketch};
use glam::Vec3;

/// Patches along each side of a leaf. They are seen or not, and in the sun or not.
const PATCHES: u16 = 4;
/// The largest number of leaves whose light is followed. Others have that of these.
const FOLLOWED: usize = 4096;
/// Limits of the factor of area.
const AREA: [f32; 2] = [0.4, 2.5];

/// A width of pixels (mm, in the plant's frame), and the leaves that are drawn with the factors of their sizes.
pub(super) struct Level {
    pub width: f32,
    drawn: Vec<(u16, f32)>,
    views: OnDirections<View>,
    suns: OnDirections<Vec<u16>>,
}

/// How the leaves are seen from a direction: by how much their areas are multiplied, and which patches of each are
/// seen, a bit each.
struct View {
    larger: f32,
    seen: Vec<u16>,
}

/// Which patches of leaves show in a picture, a bit for each.
fn patches(crown: &Crown, drawn: &[(u16, f32)], larger: f32, sketch: &Sketch) -> Vec<u16> {
    let at = |k: u16| (2 * k + 1) as f32 / f32::from(PATCHES) - 1.0;
    let one = |(leaf, size): &(u16, f32)| {
        let seen = |k: u16| {
            let place = crown.place(*leaf, size * larger.sqrt(), at(k % PATCHES), at(k / PATCHES));
            u16::from(crown.shows(sketch, *leaf, place)) << k
        };
        (0..PATCHES * PATCHES).map(seen).sum()
    };
    drawn.iter().take(FOLLOWED).map(one).collect()
}

impl Level {
    /// The leaves stand in the order of their ranks.
    pub(super) fn new(width: f32, drawn: Vec<(u16, f32)>) -> Level {
        Level { width, drawn, views: OnDirections::new(), suns: OnDirections::new() }
    }

    /// By how much the areas of the leaves are multiplied, so that they cover as much as all do from there, which is
    /// `covered` cells.
    fn view(&self, crown: &Crown, towards: Vec3, covered: f32) -> View {
        let sketch = |larger: f32| crown.sketch(&self.drawn, larger, towards);
        // A step by the rule that half of any more area is hidden, and two through the last two.
        let mut before = (0.0, (sketch(1.0).covered() / covered).ln());
        let mut next = -2.0 * before.1;
        for _ in 0..2 {
            let found = (sketch(next.exp()).covered() / covered).ln();
            let slope = ((found - before.1) / (next - before.0)).clamp(0.2, 1.0);
            before = (next, found);
            next -= found / if slope.is_finite() { slope } else { 1.0 };
        }
        let larger = next.exp().clamp(AREA[0], AREA[1]);
        View { larger, seen: patches(crown, &self.drawn, larger, &sketch(larger)) }
    }

    /// By how much the areas of leaves are multiplied from this side, and the sunlight that they then send for the area
    /// that they cover. `whole` has what is asked of all leaves: the cells that they cover.
    pub(super) fn seen(
        &self,
        crown: &Crown,
        whole: &OnDirections<f32>,
        view: Vec3,
        sun: Option<Vec3>,
    ) -> (f32, Option<f32>) {
        let views = self.views.around(view, |d| self.view(crown, d, *whole.nearest(d, |d| crown.covered(d))));
        let larger = views.iter().map(|(own, share)| own.larger * share).sum();
        let of_sun = |sun: Vec3| {
            let lit = |d: Vec3| patches(crown, &self.drawn, 1.0, &crown.sketch(&crown.all(), 1.0, d));
            let suns = self.suns.around(sun, lit);
            let (mut sent, mut seen) = (0.0, 0.0);
            for (n, (leaf, size)) in self.drawn.iter().take(FOLLOWED).enumerate() {
                let card = &crown.cards[usize::from(*leaf)];
                let area = card.area() * size * size * card.normal.dot(view).abs();
                let (mut own, mut both) = (0.0, 0.0);
                for (at, share) in &views {
                    own += share * at.seen[n].count_ones() as f32;
                    let lit = suns.iter().map(|(lit, share)| share * (lit[n] & at.seen[n]).count_ones() as f32);
                    both += share * lit.sum::<f32>();
                }
                seen += area * own;
                sent += area * both * card.sent(view, sun);
            }
            sent / seen.max(1e-30)
        };
        (larger, sun.map(of_sun))
    }
}
