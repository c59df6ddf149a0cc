//! A ground with a grain, for pictures that are made to be looked at: soil, clods and old leaves of many sizes, made
//! from noise.
//!
//! The pattern is a square tile that repeats without a seam. Its logarithm is the sum of value noise in octaves (Perlin
//! 1985, "An image synthesizer") and of flat ellipses that represent old leaves and stones. The mean of each channel is
//! the ground's albedo, so that on average the ground returns the same light as an even one.

use crate::manifest::{GRAINS_A_TILE, SceneGround};
use glam::{DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::{self as transport, lobe};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Texels along a side of the tile.
const TEXELS: usize = 1024;
/// Number of cells of the coarsest noise along a side of the tile. Each octave has twice as many cells, and a weight of
/// this share.
const COARSEST: usize = 16;
const OCTAVES: usize = 6;
const SHARE: f64 = 0.9;
/// Number of old leaves and stones in a square of one grain.
const LITTER: f64 = 0.5;
/// Colour of light places relative to the mean, with more red and less blue, because wet soil is darker and bluer.
const TINT: [f64; 3] = [1.15, 1.0, 0.8];

/// The ground as a leaf of the world, `size` mm wide and deep; `None` where it has no grain. A ground that is
/// `repeated` in a periodic scene has whole tiles, which are stretched slightly to fit.
pub fn leaf(ground: &SceneGround, size: [f64; 2], repeated: bool) -> Option<transport::ReferenceLeaf> {
    let grain = ground.grain_mm?;
    let mut front = transport::ReferenceSide::black(TEXELS * TEXELS);
    if let transport::ReferenceInterior::Maps { rho_d, .. } = &mut front.interior {
        *rho_d = albedo(ground.albedo, ground.contrast(), TEXELS);
    }
    Some(transport::ReferenceLeaf {
        mesh: tiles(size, grain * GRAINS_A_TILE, ground.height_mm, repeated),
        width: TEXELS,
        height: TEXELS,
        front,
        back: transport::ReferenceSide::black(TEXELS * TEXELS),
        mask: None,
        lobe: lobe::Lobe::Beckmann,
    })
}

/// The same pattern for the real-time renderer, at the same places; `None` where the ground has no grain.
#[cfg(feature = "render")]
pub fn pattern(ground: &SceneGround) -> Option<mesophyll_viewer::scene::AlbedoPattern> {
    let (width, reach) = (ground.grain_mm? * GRAINS_A_TILE, ground.reach_mm?);
    let [r, g, b] = albedo(ground.albedo, ground.contrast(), TEXELS);
    let texels = (0..TEXELS * TEXELS).map(|k| [r[k], g[k], b[k]]).collect();
    Some(mesophyll_viewer::scene::AlbedoPattern {
        width: TEXELS as u32,
        height: TEXELS as u32,
        texels: std::sync::Arc::new(texels),
        corner: [-reach as f32; 2],
        size: [width as f32; 2],
    })
}

/// Squares of this width side by side, each with the whole tile. The last ones of a row and of a column are cut off.
/// With `whole`, all tiles are whole and about this wide.
fn tiles(size: [f64; 2], width: f64, height: f64, whole: bool) -> LeafMesh {
    // The number of tiles along x and y, which need not be whole.
    let along = DVec2::from(size) / width;
    let along = if whole { along.round().max(DVec2::ONE) } else { along };
    let step = DVec2::from(size) / along;
    let count = along.ceil();
    let mut out = LeafMesh::default();
    for j in 0..count.y as usize {
        for i in 0..count.x as usize {
            let first = out.positions.len() as u32;
            for corner in [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y] {
                let tile = DVec2::new(i as f64, j as f64);
                let at = (tile + corner).min(along);
                out.positions.push((step * at - 0.5 * DVec2::from(size)).extend(height));
                let place = at - tile;
                out.uvs.push(DVec2::new(place.x, 1.0 - place.y));
            }
            out.indices.extend([0, 1, 2, 0, 2, 3].map(|k| first + k));
        }
    }
    out.normals = vec![DVec3::Z; out.positions.len()];
    out.tangents = vec![(DVec3::X, 1.0); out.positions.len()];
    out
}

/// The tile's reflectance, with a map of `side` × `side` texels for each channel. The standard deviation of its
/// logarithm is about `contrast`, as long as few values are cut at 1.
fn albedo(mean: [f64; 3], contrast: f64, side: usize) -> [Vec<f32>; 3] {
    let mut pattern = vec![0.0; side * side];
    let mut rng = Pcg64::seed_from_u64(11);
    noise(&mut pattern, side, &mut rng);
    litter(&mut pattern, side, &mut rng);
    let count = pattern.len() as f64;
    let middle = pattern.iter().sum::<f64>() / count;
    let spread = (pattern.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / count).sqrt();
    pattern.iter_mut().for_each(|v| *v = contrast * (*v - middle) / spread);
    [0, 1, 2].map(|c| {
        let map: Vec<f64> = pattern.iter().map(|v| (TINT[c] * v).exp()).collect();
        let scale = scale_to(mean[c] * count, &map);
        map.into_iter().map(|v| (v * scale).min(1.0) as f32).collect()
    })
}

/// The scale at which the values, cut at 1, have this sum, which is at most their number. The sum is a concave,
/// piecewise linear function of the scale. So Newton's steps from below reach the solution from below.
fn scale_to(sum: f64, values: &[f64]) -> f64 {
    let mut scale = 0.0;
    loop {
        let (mut cut, mut rest) = (0.0, 0.0);
        for v in values {
            if v * scale >= 1.0 { cut += 1.0 } else { rest += v }
        }
        let next = (sum - cut) / rest;
        if !(next > scale * (1.0 + 1e-12)) {
            return scale;
        }
        scale = next;
    }
}

/// Adds value noise in octaves, which repeats with the tile.
fn noise(pattern: &mut [f64], side: usize, rng: &mut Pcg64) {
    let mut weight = 1.0;
    for octave in 0..OCTAVES {
        let cells = COARSEST << octave;
        let values: Vec<f64> = (0..cells * cells).map(|_| rng.random::<f64>() - 0.5).collect();
        let at = |k: usize| {
            let x = (k as f64 + 0.5) * cells as f64 / side as f64;
            let t = x.fract();
            (x as usize % cells, (x as usize + 1) % cells, t * t * (3.0 - 2.0 * t))
        };
        for (j, row) in pattern.chunks_mut(side).enumerate() {
            let (a, b, v) = at(j);
            for (i, value) in row.iter_mut().enumerate() {
                let (c, d, u) = at(i);
                let along = |row: usize| values[row * cells + c] * (1.0 - u) + values[row * cells + d] * u;
                *value += weight * (along(a) * (1.0 - v) + along(b) * v);
            }
        }
        weight *= SHARE;
    }
}

/// Adds flat ellipses about one grain long, each with one brightness and a shadow along one side.
fn litter(pattern: &mut [f64], side: usize, rng: &mut Pcg64) {
    let grain = side as f64 / GRAINS_A_TILE;
    for _ in 0..(LITTER * GRAINS_A_TILE * GRAINS_A_TILE) as usize {
        let centre = DVec2::new(rng.random::<f64>(), rng.random::<f64>()) * side as f64;
        let size = grain * (0.25 + 0.5 * rng.random::<f64>());
        let (along, slim) =
            (DVec2::from_angle(std::f64::consts::TAU * rng.random::<f64>()), 0.3 + 0.4 * rng.random::<f64>());
        let level = 1.6 * rng.random::<f64>() - 0.5;
        let reach = (1.3 * size).ceil() as i64;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let texel = [centre.x as i64 + dx, centre.y as i64 + dy];
                let off = DVec2::new(texel[0] as f64 + 0.5, texel[1] as f64 + 0.5) - centre;
                let inside = |p: DVec2| DVec2::new(p.dot(along), p.perp_dot(along) / slim).length() < 0.5 * size;
                let [i, j] = texel.map(|k| k.rem_euclid(side as i64) as usize);
                let value = &mut pattern[j * side + i];
                if inside(off) {
                    *value = 0.5 * *value + level;
                } else if inside(off - DVec2::splat(0.12 * size)) {
                    *value -= 0.8;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of each channel is the albedo, and nothing reflects more light than it gets. Neighbours across the
    /// tile's edge are as similar as neighbours within it.
    #[test]
    fn a_tile_has_its_mean_and_no_seam() {
        let side = 256;
        let mean_of = |map: &Vec<f32>| map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len() as f64;
        // Many values of a bright ground are cut at 1.
        for (mean, contrast) in [([0.9, 0.5, 1.0], 1.0), ([0.0, 0.7, 0.99], 0.4)] {
            for (map, mean) in albedo(mean, contrast, side).iter().zip(mean) {
                assert!((mean_of(map) - mean).abs() <= 1e-6 * mean, "{} {mean}", mean_of(map));
                assert!(map.iter().all(|v| (0.0..=1.0).contains(v)));
            }
        }
        let mean = [0.3, 0.2, 0.1];
        let maps = albedo(mean, 0.4, side);
        for (map, mean) in maps.iter().zip(mean) {
            let found = mean_of(map);
            assert!((found - mean).abs() < 1e-6 * mean, "{found} {mean}");
            assert!(map.iter().all(|v| (0.0..=1.0).contains(v)));
            let spread = (map.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / map.len() as f64).sqrt();
            assert!(spread > 0.2 * mean, "{spread}");
            let apart = |a: usize, b: usize| {
                (0..side).map(|j| f64::from(map[j * side + a] - map[j * side + b]).abs()).sum::<f64>()
            };
            assert!(apart(0, side - 1) < 1.5 * apart(100, 101), "{} {}", apart(0, side - 1), apart(100, 101));
        }
    }

    /// The squares cover exactly the ground, with their fronts up.
    #[test]
    fn tiles_cover_the_ground() {
        for (whole, one) in [(false, 64.0), (true, 1000.0 / 16.0), (false, 3000.0)] {
            let mesh = tiles([1000.0, 700.0], if one > 1000.0 { one } else { 64.0 }, -3.0, whole);
            let [mut area, mut texture] = [0.0; 2];
            for t in 0..mesh.triangles() {
                let [a, b, c] = mesh.triangle(t);
                let p = [a, b, c].map(|k| mesh.positions[k]);
                area += 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).z;
                let q = [a, b, c].map(|k| mesh.uvs[k]);
                texture += 0.5 * (q[1] - q[0]).perp_dot(q[2] - q[0]).abs();
                // Along x every tile has the right width, whether it is cut off or not.
                let wide = (p[1].x - p[0].x) / (q[1].x - q[0].x);
                assert!(q[1].x == q[0].x || (wide / one - 1.0).abs() < 1e-9, "{wide}");
            }
            assert!((area - 7e5).abs() < 1e-6);
            let tiles = if whole { 16.0 * 11.0 } else { 7e5 / (one * one) };
            assert!((texture - tiles).abs() < 1e-6 * tiles, "{texture} {tiles}");
            let within = |p: &DVec3| p.x.abs() < 500.0 + 1e-9 && p.y.abs() < 350.0 + 1e-9 && p.z == -3.0;
            assert!(mesh.positions.iter().all(within));
        }
    }
}
