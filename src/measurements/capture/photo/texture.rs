//! Which of two turns of a leaf is right, where its outline fits both: a leaf that is as wide at its tip as at its base
//! fits itself after half a turn. Then its texture decides: veins are brighter or darker than what is between them in
//! every picture, at the same places. Where the texture tells nothing, the outlines decide, however little they differ.

use super::grid::Grid;
use super::picture::LinearPhotograph;
use super::registration::{OutlineMatch, OutlineMatches, SimilarityTransform};
use mesophyll_base::rgb::Rgb;

/// Turns whose outlines overlap by no less than this from the best one are compared by texture.
const ALIKE: f64 = 0.03;
/// Texels on either side over which brightness is averaged; what differs from that is texture.
const REACH: usize = 3;
/// The texture of a wrong turn correlates by chance. The right one must do so by this many times as much, in the
/// square.
const CLEARER: f64 = 4.0;

/// The match to use, and whether nothing tells it from another turn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chosen {
    /// The match.
    pub found: OutlineMatch,
    /// The leaf may as well be turned by a large angle.
    pub doubtful: bool,
}

/// Chooses between the best match and one of another turn. `seen` is what the first picture shows on the grid where
/// `mask` is set.
pub(super) fn choose(
    grid: &Grid,
    mask: &[bool],
    seen: &[Rgb],
    picture: &LinearPhotograph,
    matches: OutlineMatches,
) -> Chosen {
    let OutlineMatches { best, rival } = matches;
    let Some(rival) = rival.filter(|r| r.overlap > best.overlap - ALIKE) else {
        return Chosen { found: best, doubtful: false };
    };
    let first: Vec<f64> = seen.iter().map(|v| v.iter().sum()).collect();
    let first = texture(grid, mask, &first);
    let like = |motion: SimilarityTransform| {
        // Whole texels, as in `seen`: single pixels of fine veins would be anything.
        let seen = grid.mean(mask, motion.scale(), |p| picture.at(motion.at(p)));
        let map: Vec<f64> = seen.iter().map(|v| v.iter().sum()).collect();
        let second = texture(grid, mask, &map);
        let both = || first.iter().zip(&second).filter(|(a, b)| a.is_finite() && b.is_finite());
        let sum = |f: &dyn Fn(f64, f64) -> f64| both().map(|(a, b)| f(*a, *b)).sum::<f64>();
        let own = sum(&|a, _| a * a) * sum(&|_, b| b * b);
        if own > 0.0 { sum(&|a, b| a * b).powi(2) / own } else { 0.0 }
    };
    let (a, b) = (like(best.motion), like(rival.motion));
    let doubtful = a.max(b) < CLEARER * a.min(b) + 1e-3;
    // Where texture does not tell, the outlines still do so, however little.
    let found = if b > a && !doubtful { rival } else { best };
    Chosen { found, doubtful }
}

/// What differs from the mean of the texels around, where all of them are on the leaf; NaN elsewhere.
fn texture(grid: &Grid, mask: &[bool], map: &[f64]) -> Vec<f64> {
    let (w, h) = (grid.width, grid.height);
    let n = ((2 * REACH + 1) * (2 * REACH + 1)) as f64;
    (0..w * h)
        .map(|k| {
            let [i, j] = grid.size().position(k);
            if i < REACH || j < REACH || i + REACH >= w || j + REACH >= h {
                return f64::NAN;
            }
            let mut sum = 0.0;
            for k in (j - REACH..=j + REACH).flat_map(|j| (i - REACH..=i + REACH).map(move |i| j * w + i)) {
                if !mask[k] {
                    return f64::NAN;
                }
                sum += map[k];
            }
            map[k] - sum / n
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::registration::{BinaryMask, register};
    use mesophyll_base::random::RandomStream;
    use mesophyll_base::rgb::Rgb;

    const W: usize = 200;
    const H: usize = 140;

    /// An ellipse with veins that are not symmetric, turned by `angle` about the middle, under noise. With `egg` it is
    /// wider at its right end, by this share of its width in the middle.
    fn drawn(angle: f64, veins: f64, egg: f64, seed: u64) -> (Vec<bool>, LinearPhotograph) {
        let (sin, cos) = angle.sin_cos();
        let mut stream = RandomStream::new(seed, &[1]);
        let (mut inside, mut pixels) = (Vec::new(), Vec::new());
        for k in 0..W * H {
            let [x, y] = [(k % W) as f64 + 0.5 - 100.0, (k / W) as f64 + 0.5 - 70.0];
            let [x, y] = [cos * x + sin * y, cos * y - sin * x];
            let on = (x / 80.0).hypot(y / (40.0 + 0.5 * egg * x)) < 1.0;
            let vein = veins * f64::from(u8::from((x - 0.6 * y.abs()).rem_euclid(17.0) < 4.0));
            let light = if on { 0.3 + vein + 0.0005 * x } else { 0.04 };
            inside.push(on);
            pixels.push(Rgb::splat((light + 0.01 * stream.normal_pair()[0]) as f32));
        }
        (
            inside,
            LinearPhotograph { path: "leaf.exr".into(), width: W, height: H, pixels, highest: (1.0, 1), steps: None },
        )
    }

    fn chosen(angle: f64, veins: f64, egg: f64) -> (f64, bool) {
        let ((a, first), (b, second)) = (drawn(0.0, 0.08, egg, 1), drawn(angle, -veins, egg, 2));
        let matches =
            register(BinaryMask { inside: &a, width: W }, BinaryMask { inside: &b, width: W }, false).unwrap();
        let grid = Grid { origin: [10, 20], step: 2, width: 90, height: 50 };
        let mask: Vec<bool> = (0..90 * 50).map(|k| BinaryMask { inside: &a, width: W }.holds(grid.middle(k))).collect();
        let seen = grid.mean(&mask, 1.0, |p| first.at(p));
        let found = choose(&grid, &mask, &seen, &second, matches);
        // A place right of the middle: where it comes to lie.
        let q = found.found.motion.at([150.0, 70.0]);
        let home = [100.0 + 50.0 * angle.cos(), 70.0 + 50.0 * angle.sin()];
        ((q[0] - home[0]).hypot(q[1] - home[1]), found.doubtful)
    }

    /// An ellipse fits itself after half a turn. Its veins, bright in one picture and dark in the other, tell which way
    /// it lies; without veins nobody can, and that is said.
    #[test]
    fn veins_tell_half_a_turn() {
        for angle in [0.1, std::f64::consts::PI - 0.2, std::f64::consts::PI + 0.1] {
            let (off, doubtful) = chosen(angle, 0.08, 0.0);
            assert!(off < 1.0 && !doubtful, "{angle}: off by {off}, {doubtful}");
        }
        assert!(chosen(0.1, 0.0, 0.0).1);
    }

    /// Where a picture shows no texture, an outline that is nearly symmetric still tells how the leaf lies.
    #[test]
    fn without_veins_the_outline_tells_half_a_turn() {
        for k in 0..6 {
            let angle = 0.1 + std::f64::consts::FRAC_PI_3 * f64::from(k);
            let (off, doubtful) = chosen(angle, 0.0, 0.05);
            assert!(off < 1.5 && doubtful, "{angle}: off by {off}, {doubtful}");
        }
    }
}
