//! How much of a fitted leaf is on the triangles that it is put on, by the texture coordinates that they have.

use crate::dress::Coated;
use mesophyll_files::gltf_file::GltfPrimitive;
use mesophyll_plants::import::flat_pieces::FlatPieces;
use serde_json::Value;

/// The modes of glTF's samplers (`wrapS`, `wrapT`).
pub(super) const CLAMP: u64 = 33071;
pub(super) const MIRRORED: u64 = 33648;
pub(super) const REPEAT: u64 = 10497;

/// A piece that fills this share of the rectangle around it is a card.
const CARD: f64 = 0.98;

/// A triangle is looked at along each of its sides in this many steps.
const STEPS: usize = 16;

/// How the former texture of a material goes on beyond its edges, across and down. It repeats where the file says
/// nothing (glTF 2.0, §3.8.4.5).
pub(super) fn wrap(root: &Value, colour: &Value) -> [u64; 2] {
    let texture = &root["textures"][colour["index"].as_u64().map_or(usize::MAX, |k| k as usize)];
    let sampler = &root["samplers"][texture["sampler"].as_u64().map_or(usize::MAX, |k| k as usize)];
    ["wrapS", "wrapT"].map(|name| sampler[name].as_u64().unwrap_or(REPEAT))
}

/// Whether all coordinates lie on the picture, so that nothing shows how it goes on.
pub(super) fn inside(uvs: &[[f32; 2]]) -> bool {
    uvs.iter().flatten().all(|v| (-1e-3..=1.001).contains(v))
}

/// A coordinate on the picture.
pub(super) fn folded(v: f64, mode: u64) -> f64 {
    match mode {
        CLAMP => v.clamp(0.0, 1.0),
        MIRRORED => 1.0 - (v.rem_euclid(2.0) - 1.0).abs(),
        _ => v.rem_euclid(1.0),
    }
}

/// Whether the flat pieces are rectangles, whose shape says nothing of a leaf's.
pub(super) fn are_cards(surface: &GltfPrimitive, found: &FlatPieces) -> bool {
    let area: f64 = surface
        .indices
        .chunks_exact(3)
        .zip(&found.triangles)
        .filter(|(_, flat)| **flat)
        .map(|(t, _)| plane_area([0, 1, 2].map(|k| found.places[t[k] as usize])))
        .sum();
    !found.flat.is_empty() && area >= CARD * found.flat.len() as f64
}

/// The area of a triangle in a plane.
fn plane_area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs()
}

/// The area of the triangles for which `dressed` is true, and how much of it shows the fitted blade.
pub(super) fn kept(surface: &GltfPrimitive, dressed: &[bool], uvs: &[[f32; 2]], coated: &Coated) -> [f64; 2] {
    let (mut all, mut kept) = (0.0, 0.0);
    let [width, height] = coated.size;
    for (t, _) in surface.indices.chunks_exact(3).zip(dressed).filter(|(_, dressed)| **dressed) {
        let corners = [0, 1, 2].map(|k| surface.positions[t[k] as usize]);
        let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        let uv = [0, 1, 2].map(|k| uvs[t[k] as usize].map(f64::from));
        let (mut on, mut seen) = (0usize, 0usize);
        for i in 0..STEPS {
            for j in 0..STEPS - i {
                let [b, c] = [i, j].map(|k| (k as f64 + 1.0 / 3.0) / STEPS as f64);
                let at = [0, 1].map(|k| uv[0][k] + b * (uv[1][k] - uv[0][k]) + c * (uv[2][k] - uv[0][k]));
                let [x, y] = [0, 1].map(|k| {
                    let size = coated.size[k] as f64;
                    (folded(at[k], coated.wrap[k]) * size).clamp(0.0, size - 1.0) as usize
                });
                seen += 1;
                on += usize::from(coated.on.get(y * width + x).copied().unwrap_or(height == 0));
            }
        }
        all += area;
        kept += area * on as f64 / seen as f64;
    }
    [all, kept]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_go_on_as_the_sampler_says() {
        for (mode, want) in
            [(CLAMP, [0.0, 0.25, 1.0, 1.0]), (REPEAT, [0.75, 0.25, 0.25, 0.75]), (MIRRORED, [0.25, 0.25, 0.75, 0.25])]
        {
            let found = [-0.25, 0.25, 1.25, 1.75].map(|v| folded(v, mode));
            assert!(found.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12), "{mode}: {found:?}");
        }
        let root = serde_json::json!({"textures": [{"sampler": 0}, {}], "samplers": [{"wrapS": MIRRORED}]});
        for (texture, want) in [(0, [MIRRORED, REPEAT]), (1, [REPEAT; 2]), (2, [REPEAT; 2])] {
            assert_eq!(wrap(&root, &serde_json::json!({"index": texture})), want);
        }
        assert_eq!(wrap(&root, &Value::Null), [REPEAT; 2]);
    }
}
