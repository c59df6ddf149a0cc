//! Maps as small pictures: what each side's textures hold (Wang et al. 2005, Fig. 6).

use crate::scene::{Interior, Leaf, Side};
use egui::{Color32, ColorImage};

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
    pub(crate) const ALL: [MapKind; 7] =
        [MapKind::Gamma, MapKind::Delta, MapKind::RhoD, MapKind::RhoT, MapKind::RhoS, MapKind::Roughness, MapKind::Normal];

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
    fn value(self, side: &Side, i: usize) -> Option<[f32; 3]> {
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

/// A thumbnail with the range it spreads from black to white, or `None` where the side has no such map.
pub(crate) fn thumbnail(leaf: &Leaf, front: bool, kind: MapKind) -> Option<(ColorImage, [f32; 2])> {
    let side = if front { &leaf.front } else { &leaf.back };
    kind.value(side, 0)?;
    let step = leaf.width.max(leaf.height).div_ceil(LONGEST).max(1);
    let (w, h) = (leaf.width.div_ceil(step), leaf.height.div_ceil(step));
    let mut values = Vec::with_capacity((w * h) as usize);
    for y in 0..h {
        for x in 0..w {
            let (column, row) = ((x * step + step / 2).min(leaf.width - 1), (y * step + step / 2).min(leaf.height - 1));
            let on_front = if front { column } else { leaf.width - 1 - column };
            let on_leaf = leaf.mask.as_ref().is_none_or(|m| m[(row * leaf.width + on_front) as usize] > 0);
            values.push(kind.value(side, (row * leaf.width + column) as usize).filter(|_| on_leaf));
        }
    }
    let range = match kind {
        MapKind::Normal => [0.0, 1.0],
        _ => {
            let all = values.iter().flatten().flatten();
            let (low, high) = all.fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
            // Quantities that start at nothing are shown from there; δ swings about its mean.
            if kind == MapKind::Delta { [low, high.max(low + 1e-6)] } else { [0.0, high.max(1e-6)] }
        }
    };
    let shade = |v: f32| (255.0 * ((v - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0)).round() as u8;
    let pixels = values.iter().map(|t| t.map_or(Color32::TRANSPARENT, |[r, g, b]| Color32::from_rgb(shade(r), shade(g), shade(b))));
    Some((ColorImage::new([w as usize, h as usize], pixels.collect()), range))
}
