//! Maps as small pictures, which show the content of each side's textures (Wang et al. 2005, Fig. 6).

use egui::{Color32, ColorImage};
use glam::Vec2;
use mesophyll_viewer::scene::{Interior, LeafMaterial, Mesh, Side, SideMaps};

/// Longest side of a thumbnail (pixels).
const LONGEST: u32 = 96;

/// The maps that a side may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum MapKind {
    Gamma,
    Delta,
    RhoD,
    RhoT,
    RhoS,
    Roughness,
    Normal,
}

impl MapKind {
    pub(crate) const ALL: [MapKind; 7] = [
        MapKind::Gamma,
        MapKind::Delta,
        MapKind::RhoD,
        MapKind::RhoT,
        MapKind::RhoS,
        MapKind::Roughness,
        MapKind::Normal,
    ];

    pub(crate) fn label(self) -> &'static str {
        match self {
            MapKind::Gamma => "γ",
            MapKind::Delta => "δ",
            MapKind::RhoD => "ρd",
            MapKind::RhoT => "ρt",
            MapKind::RhoS => "ρs",
            MapKind::Roughness => "m",
            MapKind::Normal => "normal",
        }
    }

    /// Texel `i` of the map, or `None` where the side has no such map.
    fn value(self, side: &SideMaps, i: usize) -> Option<[f32; 3]> {
        let grey = |v: f32| [v, v, v];
        match (self, &side.interior) {
            (MapKind::Gamma, Interior::Scalars(_)) => side.gamma_delta.get(i).map(|t| [t[0], t[1], t[2]]),
            (MapKind::Delta, Interior::Scalars(_)) => side.gamma_delta.get(i).map(|t| grey(t[3])),
            (MapKind::RhoD, Interior::Maps { rho_d, .. }) => rho_d.get(i).copied(),
            (MapKind::RhoT, Interior::Maps { rho_t, .. }) => rho_t.get(i).copied(),
            (MapKind::RhoS, _) => side.gloss.as_ref()?.get(i).map(|t| [t[0], t[1], t[2]]),
            (MapKind::Roughness, _) => side.gloss.as_ref()?.get(i).map(|t| grey(t[3])),
            (MapKind::Normal, _) => side.normal.as_ref()?.get(i).map(|n| n.map(|c| 0.5 + 0.5 * c)),
            _ => None,
        }
    }
}

/// For each texel of the front's maps, whether its centre lies on the mesh. Beyond the outline, maps hold a fill for
/// the renderer's filters and no data.
fn covered(leaf: &LeafMaterial, mesh: Option<&Mesh>) -> Vec<bool> {
    let (width, height) = (leaf.width as usize, leaf.height as usize);
    let mut out = vec![false; width * height];
    let size = Vec2::new(width as f32, height as f32);
    let uvs = |mesh: &Mesh, triangle: [u32; 3]| triangle.map(|k| mesh.uvs[k as usize] * size - 0.5);
    let triangles = mesh.iter().flat_map(|m| m.indices.as_chunks::<3>().0.iter().map(|t| uvs(m, *t)));
    for [a, b, c] in triangles {
        let area = (b - a).perp_dot(c - a);
        let (low, high) = (a.min(b).min(c).ceil().max(Vec2::ZERO), a.max(b).max(c).floor().min(size - 1.0));
        for y in low.y as usize..(high.y + 1.0).max(0.0) as usize {
            for x in low.x as usize..(high.x + 1.0).max(0.0) as usize {
                let p = Vec2::new(x as f32, y as f32);
                let weights = [(b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)];
                out[y * width + x] |= area != 0.0 && weights.iter().all(|w| w / area >= -1e-5);
            }
        }
    }
    out
}

/// A thumbnail and the range of values from black to white over the blade; `None` where the side has no such map.
/// Texels beside the blade are transparent. `mesh` is one that the leaf is drawn with.
pub(crate) fn thumbnail(
    leaf: &LeafMaterial,
    mesh: Option<&Mesh>,
    side: Side,
    kind: MapKind,
) -> Option<(ColorImage, [f32; 2])> {
    let maps = &leaf.sides[side];
    kind.value(maps, 0)?;
    let step = leaf.width.max(leaf.height).div_ceil(LONGEST).max(1);
    let (w, h) = (leaf.width.div_ceil(step), leaf.height.div_ceil(step));
    let blade = covered(leaf, mesh);
    let mut values = Vec::with_capacity((w * h) as usize);
    for y in 0..h {
        for x in 0..w {
            let (column, row) = ((x * step + step / 2).min(leaf.width - 1), (y * step + step / 2).min(leaf.height - 1));
            let on_front = if side == Side::Front { column } else { leaf.width - 1 - column };
            let at = (row * leaf.width + on_front) as usize;
            let on_leaf = blade[at] && leaf.mask.as_ref().is_none_or(|m| m[at] > 0);
            values.push(kind.value(maps, (row * leaf.width + column) as usize).filter(|_| on_leaf));
        }
    }
    let range = match kind {
        MapKind::Normal => [0.0, 1.0],
        _ => {
            let all = values.iter().flatten().flatten();
            let (low, high) = all.fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
            let (low, high) = if low > high { (0.0, 0.0) } else { (low, high) };
            // Quantities that are at least 0 are shown from 0. δ varies about its mean.
            if kind == MapKind::Delta { [low, high.max(low + 1e-6)] } else { [0.0, high.max(1e-6)] }
        }
    };
    let shade = |v: f32| (255.0 * ((v - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0)).round() as u8;
    let pixels = values
        .iter()
        .map(|t| t.map_or(Color32::TRANSPARENT, |[r, g, b]| Color32::from_rgb(shade(r), shade(g), shade(b))));
    Some((ColorImage::new([w as usize, h as usize], pixels.collect()), range))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec3, Vec4};
    use mesophyll_viewer::scene::{Lobe, Sides};

    /// The blade covers the left half of its maps, and beyond it is a fill of 9. Neither the picture nor its range may
    /// show the fill.
    #[test]
    fn the_fill_beyond_the_outline_is_no_data() {
        let corners = [(0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.0, 1.0)];
        let gamma = |k: usize| if k % 8 < 4 { [0.5 + 0.05 * (k % 8) as f32, 0.6, 0.7, 0.0] } else { [9.0; 4] };
        // The back's columns run in the opposite direction.
        let turned = |k: usize| gamma(k / 8 * 8 + 7 - k % 8);
        let side =
            |of: &dyn Fn(usize) -> [f32; 4]| SideMaps { gamma_delta: (0..48).map(of).collect(), ..SideMaps::black() };
        let mesh = Mesh {
            positions: corners.iter().map(|&(u, v)| Vec3::new(u, -v, 0.0)).collect(),
            normals: vec![Vec3::Z; 4],
            tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
            uvs: corners.iter().map(|&(u, v)| Vec2::new(u, v)).collect(),
            indices: vec![0, 3, 2, 0, 2, 1],
            ..Mesh::default()
        };
        let leaf = LeafMaterial {
            name: "half".into(),
            width: 8,
            height: 6,
            thickness_mm: 0.2,
            lobe: Lobe::Beckmann,
            sides: Sides { front: side(&gamma), back: side(&turned) },
            mask: None,
        };
        for seen in Side::ALL {
            let (image, [low, high]) = thumbnail(&leaf, Some(&mesh), seen, MapKind::Gamma).unwrap();
            assert_eq!((low, high), (0.0, 0.7));
            for (k, pixel) in image.pixels.iter().enumerate() {
                let on_blade = (k % 8 < 4) == (seen == Side::Front);
                assert_eq!(*pixel != Color32::TRANSPARENT, on_blade, "{seen} pixel {k}: {pixel:?}");
            }
        }
    }
}
