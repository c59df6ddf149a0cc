//! Chooses which of many leaves and plants a picture needs. Nothing outside the view is drawn. Of leaves smaller than a
//! few pixels, fewer but larger ones are drawn, so that they cover the same area (Cook, Halstead, Planck & Ryu 2007,
//! "Stochastic simplification of aggregate detail"); so it is in shadow maps with leaves smaller than a few texels.
//! Where the adapter does not choose (`passes/choose.rs`), the CPU does, for each picture and each instance.

use crate::scene::Camera;
use glam::Vec3;

/// Leaves whose ball has at least this diameter in the picture (pixels) are all drawn. The ball's diameter is the
/// leaf's longest extent.
pub(crate) const WIDE: f32 = 1.5;
/// The least share of the leaves that is drawn, however far away they are: none is drawn more than 3.7 times as large.
/// Still larger leaves would reach out of the crown. It would then cover more than it does, and have more light. Plants
/// of stands have factors against that (`far`), and fewer leaves.
pub(crate) const FEWEST: f32 = 1.0 / 12.0;
/// If there are fewer leaves than this of one mesh and material, all are drawn.
pub(crate) const MANY: usize = 64;
/// The last of the drawn leaves shrink to nothing over this share of all drawn ones, so that none vanishes suddenly.
pub(crate) const FADE: f32 = 0.2;

/// A camera, and the part of the scene that its picture shows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub eye: Vec3,
    /// Angle of a pixel (rad).
    pub pixel: f32,
    /// Unit vectors ahead, to the right and up, and half the picture's sides at a distance of 1. `None` for a picture
    /// without perspective.
    frustum: Option<([Vec3; 3], [f32; 2])>,
}

impl Seen {
    pub(crate) fn new(camera: &Camera, [width, height]: [u32; 2], perspective: bool) -> Seen {
        let pixel = crate::detail::pixel(camera, height);
        let ahead = (camera.target - camera.eye).normalize_or_zero();
        let right = ahead.cross(camera.up).normalize_or_zero();
        let half = 0.5 * pixel * height as f32;
        let frustum = perspective
            .then(|| ([ahead, right, right.cross(ahead)], [half * width as f32 / height.max(1) as f32, half]));
        Seen { eye: camera.eye, pixel, frustum }
    }

    /// The least width of a pixel (mm) on anything in these boxes; 0 for a picture without perspective.
    pub(crate) fn narrowest(&self, boxes: &[[Vec3; 2]]) -> f32 {
        let near = boxes.iter().map(|[low, high]| self.eye.distance(self.eye.clamp(*low, *high)));
        self.frustum.map_or(0.0, |_| self.pixel * near.fold(f32::MAX, f32::min))
    }

    /// The eye with the angle of a pixel, the three directions with half sides of the picture (1 after the first with
    /// perspective, 0 without), and how far beyond these sides a ball of radius 1 is seen.
    pub(crate) fn in_numbers(&self) -> ([[f32; 4]; 4], [f32; 2]) {
        let eye = self.eye.extend(self.pixel).to_array();
        let Some(([ahead, right, up], half)) = self.frustum else {
            return ([eye, [0.0; 4], [0.0; 4], [0.0; 4]], [0.0; 2]);
        };
        let axes = [ahead.extend(1.0), right.extend(half[0]), up.extend(half[1])].map(|v| v.to_array());
        ([eye, axes[0], axes[1], axes[2]], half.map(|h| h.hypot(1.0)))
    }

    /// Whether things become smaller with their distance.
    pub(crate) fn has_perspective(&self) -> bool {
        self.frustum.is_some()
    }

    /// Whether any part of a ball may be in the picture.
    pub(crate) fn shows(&self, centre: Vec3, radius: f32) -> bool {
        let Some(([ahead, right, up], half)) = self.frustum else { return true };
        let to = centre - self.eye;
        let along = to.dot(ahead);
        let inside = |across: f32, half: f32| across.abs() <= along * half + radius * half.hypot(1.0);
        along >= -radius && inside(to.dot(right), half[0]) && inside(to.dot(up), half[1])
    }

    /// Whether any part of a ball that moves from one place to another may be in the picture on its way.
    pub(crate) fn shows_on_way(&self, [from, to]: [Vec3; 2], radius: f32) -> bool {
        let Some(([ahead, right, up], half)) = self.frustum else { return true };
        // How far a place is on the inner side of each of the picture's planes: on a straight way, most at an end.
        let inside = |place: Vec3| {
            let to = place - self.eye;
            let [along, x, y] = [ahead, right, up].map(|axis| to.dot(axis));
            let wide = half.map(|h| radius * h.hypot(1.0));
            let [w, h] = [along * half[0] + wide[0], along * half[1] + wide[1]];
            [along + radius, w - x, w + x, h - y, h + y]
        };
        inside(from).into_iter().zip(inside(to)).all(|(a, b)| a >= 0.0 || b >= 0.0)
    }

    /// The factor by which a leaf with this rank and ball is drawn larger; 0 where it is left out.
    pub(crate) fn enlarged(&self, rank: f32, centre: Vec3, radius: f32) -> f32 {
        if self.frustum.is_none() {
            return 1.0;
        }
        enlarged(2.0 * radius / (self.pixel * self.eye.distance(centre)).max(1e-30), rank)
    }
}

/// The factor by which a leaf with this rank is drawn larger if its ball is `wide` pixels or texels across; 0 where it
/// is left out.
pub(crate) fn enlarged(wide: f32, rank: f32) -> f32 {
    size((wide / WIDE).powi(2).max(FEWEST), rank)
}

/// The same where this share of the leaves is drawn.
pub(crate) fn size(kept: f32, rank: f32) -> f32 {
    if kept >= 1.0 {
        return 1.0;
    }
    let fade = (FADE * kept).min(1.0 - kept);
    let own = ((kept - rank) / fade.max(1e-6)).clamp(0.0, 1.0);
    // The leaves that fade have lost half of their area.
    (own / (kept - 0.5 * fade)).sqrt()
}

/// The rows of a transform that draws an instance `size` times as large about a point of its mesh. This is the middle
/// of the mesh: a leaf's origin is its stalk, and leaves that grew from there would all move out of the crown into the
/// sun.
pub(crate) fn larger(rows: &[[f32; 4]; 3], middle: Vec3, size: f32) -> [[f32; 4]; 3] {
    rows.map(|[x, y, z, w]| {
        let to_middle = x * middle.x + y * middle.y + z * middle.z;
        [size * x, size * y, size * z, w + (1.0 - size) * to_middle]
    })
}

/// The number of consecutive leaves among which ranks are spread evenly.
const BLOCK: usize = 64;

/// A rank from 0 to 1 for each of `count` leaves. Leaves with high ranks are left out first. Each block of leaves has
/// ranks at even steps, in an order that does not follow that of the leaves. Leaves stand on a twig in a regular order,
/// and a regular choice of them might choose one side of the twig.
pub(crate) fn ranks(count: usize) -> Vec<f32> {
    let mut out = vec![0.0; count];
    for (block, ranks) in out.chunks_mut(BLOCK).enumerate() {
        let mut order: Vec<usize> = (0..ranks.len()).collect();
        order.sort_by_key(|k| mixed(block * BLOCK + k));
        let (n, start) = (ranks.len() as f32, mixed(block ^ 0x5bd1_e995) as f32 / u32::MAX as f32);
        for (place, k) in order.into_iter().enumerate() {
            ranks[k] = (place as f32 + start) / n;
        }
    }
    out
}

/// A number that looks random (the mixing function of MurmurHash3).
fn mixed(number: usize) -> u32 {
    let mut x = (number as u32).wrapping_add(0x9e37_79b9);
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat4, Quat, Vec4};

    fn seen() -> Seen {
        let camera = Camera { eye: Vec3::ZERO, target: Vec3::X, up: Vec3::Z, fov_y_deg: 40.0 };
        Seen::new(&camera, [800, 600], true)
    }

    /// At any distance, the drawn leaves have the area of all leaves, and far away only a few are drawn.
    #[test]
    fn thinned_leaves_cover_as_much() {
        let seen = seen();
        for distance in [5e3f32, 2e4, 3e4, 6e4, 1.2e5] {
            let n = 20_000;
            let sizes: Vec<f32> = ranks(n).into_iter().map(|r| seen.enlarged(r, Vec3::X * distance, 30.0)).collect();
            let area = sizes.iter().map(|s| f64::from(*s).powi(2)).sum::<f64>() / n as f64;
            let drawn = sizes.iter().filter(|s| **s > 0.0).count() as f32 / n as f32;
            let wanted = (60.0 / (seen.pixel * distance) / WIDE).powi(2).clamp(FEWEST, 1.0);
            assert!((area - 1.0).abs() < 0.02, "{distance}: {area}");
            assert!((drawn / wanted - 1.0).abs() < 0.03, "{distance}: {drawn} {wanted}");
            // Leaves that are a golden angle apart stay evenly around their twig.
            let around = |k: usize| glam::Vec2::from_angle((2.399_963 * k as f64 % std::f64::consts::TAU) as f32);
            let pull = (0..n).map(|k| around(k) * sizes[k].powi(2)).sum::<glam::Vec2>().length() / n as f32;
            // The limit is four standard deviations of a random choice.
            let chance = 4.0 * ((1.0 - wanted) / (wanted * n as f32)).sqrt();
            assert!(pull < chance + 1e-3, "{distance}: {pull}");
        }
    }

    /// A leaf that is drawn larger keeps its middle in place, and distances from there grow.
    #[test]
    fn larger_leaves_stay_where_they_are() {
        let turned = Quat::from_rotation_x(0.7) * Quat::from_rotation_z(-1.1);
        let at_rest = Mat4::from_scale_rotation_translation(Vec3::splat(0.8), turned, Vec3::new(300.0, -20.0, 5e3));
        let middle = Vec3::new(31.0, 1.0, 0.5);
        let (x, y, z, w) = (at_rest.row(0), at_rest.row(1), at_rest.row(2), Vec4::W);
        let rows = larger(&[x, y, z].map(|row| row.to_array()), middle, 7.0);
        let [x, y, z] = rows.map(Vec4::from_array);
        let larger = Mat4::from_cols(x, y, z, w).transpose();
        let place = at_rest.transform_point3(middle);
        assert!(larger.transform_point3(middle).distance(place) < 2e-3);
        for tip in [Vec3::ZERO, Vec3::new(62.0, 0.0, 1.0), Vec3::new(30.0, 18.0, -2.0)] {
            let wanted = place + 7.0 * (at_rest.transform_point3(tip) - place);
            assert!(larger.transform_point3(tip).distance(wanted) < 5e-3, "{tip}");
        }
    }

    /// Random balls are compared with points in them: a ball that is left out has no point in the picture.
    #[test]
    fn only_what_is_outside_is_left_out() {
        let seen = seen();
        let half = (20f32.to_radians().tan() * 4.0 / 3.0, 20f32.to_radians().tan());
        let (mut out, mut wasted) = (0, 0);
        for k in 0..20_000 {
            let random = |j: u32| ((f64::from(k * 7 + j) * 0.754_877_666_246_692_7).fract() as f32 - 0.5) * 40.0;
            let (centre, radius) = (Vec3::new(random(0), random(3), random(5)), 1.5);
            let inside = |p: Vec3| p.x > 0.0 && p.y.abs() <= half.0 * p.x && p.z.abs() <= half.1 * p.x;
            let some = (0..60).any(|j| {
                let (z, a) = (1.0 - (2.0 * j as f32 + 1.0) / 60.0, 2.4 * j as f32);
                inside(centre + radius * Vec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z))
            });
            let shown = seen.shows(centre, radius);
            let way = [centre, centre + Vec3::new(0.0, 9.0, -4.0)];
            let along = (0..=20).any(|j| seen.shows(way[0].lerp(way[1], j as f32 / 20.0), radius));
            assert!(seen.shows_on_way(way, radius) || !along, "{centre}");
            assert_eq!(seen.shows_on_way([centre; 2], radius), shown);
            assert!(shown || !(some || inside(centre)), "{centre}");
            out += usize::from(!shown);
            wasted += usize::from(shown && !some && !inside(centre));
        }
        assert!(out > 15_000 && wasted < 600, "{out} {wasted}");
    }
}
