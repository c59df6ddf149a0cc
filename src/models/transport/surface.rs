//! A point of a leaf that a ray hit, and what the leaf is like there.

use super::lookup::TexelTaps;
use super::world::{NormalFrame, ReferenceInterior, ReferenceLeaf, ReferenceSide, SunlitMaps};
use glam::{DMat3, DVec2, DVec3, DVec4};

/// A point where a ray hit a leaf. The "viewed" side is the one that the ray came from, and the "far" side is the other
/// one.
pub(super) struct Surface<'a> {
    pub(super) leaf: &'a ReferenceLeaf,
    /// The instance that was hit.
    pub instance: usize,
    /// The place at which its group was hit; `None` for an instance that stands by itself.
    pub place: Option<u32>,
    pub point: DVec3,
    /// Towards the origin of the ray.
    pub view: DVec3,
    /// The triangle's normal, on its front.
    pub flat: DVec3,
    /// Whether the back is the viewed side.
    pub back: bool,
    pub(super) smooth: DVec3,
    pub(super) front_normal: DVec3,
    pub(super) turn: DMat3,
    pub(super) corner: [usize; 3],
    pub(super) weight: [f64; 3],
    pub(super) uv: DVec2,
}

impl<'a> Surface<'a> {
    /// The mesh's interpolated normal, on the viewed side.
    pub fn toward_viewer(&self) -> DVec3 {
        if self.back { -self.front_normal } else { self.front_normal }
    }

    /// Optical properties of the viewed side.
    pub fn viewed(&self) -> &'a ReferenceSide {
        if self.back { &self.leaf.back } else { &self.leaf.front }
    }

    /// Optical properties of the far side.
    pub fn far(&self) -> &'a ReferenceSide {
        if self.back { &self.leaf.front } else { &self.leaf.back }
    }

    /// The model of the gloss.
    pub fn lobe(&self) -> super::lobe::Lobe {
        self.leaf.lobe
    }

    /// Where the maps of the viewed side are read, or of the far side.
    pub fn taps(&self, far: bool) -> TexelTaps {
        TexelTaps::new(self.uv.x, self.uv.y, self.leaf.width, self.leaf.height, self.back != far)
    }

    /// The mapped normal of the viewed side.
    pub fn normal(&self) -> DVec3 {
        self.mapped(self.viewed(), self.back)
    }

    /// The mapped normal of the far side.
    pub fn far_normal(&self) -> DVec3 {
        self.mapped(self.far(), !self.back)
    }

    fn mapped(&self, side: &ReferenceSide, back: bool) -> DVec3 {
        let plain = if back { -self.front_normal } else { self.front_normal };
        let Some(map) = &side.normal else { return plain };
        let taps = TexelTaps::new(self.uv.x, self.uv.y, self.leaf.width, self.leaf.height, back);
        let [x, y, z] = taps.vector(&map.values);
        let (x, z) = if back { (-x, -z) } else { (x, z) };
        let local = match map.frame {
            NormalFrame::Blade => DVec3::new(x, y, z),
            NormalFrame::Tangent => {
                let tangents = &self.leaf.mesh.tangents;
                let t = self.corner.iter().zip(self.weight).map(|(&c, w)| DVec4::from(tangents[c]) * w).sum::<DVec4>();
                let smooth = self.smooth;
                let along = (t.truncate() - smooth * smooth.dot(t.truncate())).normalize_or_zero();
                along * x + smooth.cross(along) * (t.w.signum() * y) + smooth * z
            }
        };
        (self.turn * local).normalize_or(plain)
    }

    /// ρd of the viewed side, with γ.
    pub fn rho_d(&self) -> [f64; 3] {
        reflectance(self.viewed(), &self.taps(false))
    }

    /// ρt of a beam that enters at the far side.
    pub fn rho_t(&self) -> [f64; 3] {
        transmittance(self.far(), &self.taps(true))
    }

    /// ρt of a beam that enters at the viewed side.
    pub fn rho_t_inward(&self) -> [f64; 3] {
        transmittance(self.viewed(), &self.taps(false))
    }

    /// Derivatives of ρd, ρt and ρs, and of m, where front and back of the leaf have these derivatives, which are looks
    /// themselves.
    pub fn by_look(&self, sides: &[ReferenceSide; 2]) -> ([[f64; 3]; 3], f64) {
        let (viewed, far) = (&sides[usize::from(self.back)], &sides[usize::from(!self.back)]);
        let taps = self.taps(false);
        let gloss = viewed.gloss.as_ref().map(|gloss| (taps.colour(&gloss.rho_s), taps.scalar(&gloss.m)));
        let (rho_s, m) = gloss.unwrap_or_default();
        ([reflectance(viewed, &taps), transmittance(far, &self.taps(true)), rho_s], m)
    }

    /// ρs and m of the viewed side; `None` if it is not glossy.
    pub fn gloss(&self) -> Option<([f64; 3], f64)> {
        let gloss = self.viewed().gloss.as_ref()?;
        let taps = self.taps(false);
        Some((taps.colour(&gloss.rho_s), taps.scalar(&gloss.m)))
    }

    /// The factor that replaces ρt times a cosine, where maps describe how the sun's light passes; `rho_t` is
    /// [`Surface::rho_t`].
    pub fn through(&self, sunlit: &SunlitMaps, rho_t: impl FnOnce() -> [f64; 3]) -> [f64; 3] {
        match sunlit {
            SunlitMaps::Factor(map) => {
                let f = self.taps(true).scalar(map).max(0.0);
                rho_t().map(|r| r * f)
            }
            SunlitMaps::Colour(maps) => self.taps(true).colour(maps).map(|m| m.max(0.0)),
        }
    }
}

/// The numbers of the vertices of a triangle.
pub(super) fn corners(leaf: &ReferenceLeaf, triangle: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| leaf.mesh.indices[3 * triangle + k] as usize)
}

/// The texture point of a point of a triangle.
pub(super) fn texture_point(leaf: &ReferenceLeaf, triangle: usize, barycentric: [f64; 2]) -> DVec2 {
    if leaf.width * leaf.height == 1 {
        // A single texel is the same everywhere.
        return DVec2::ZERO;
    }
    let [a, b, c] = corners(leaf, triangle).map(|k| leaf.mesh.uvs[k]);
    a + (b - a) * barycentric[0] + (c - a) * barycentric[1]
}

fn reflectance(side: &ReferenceSide, taps: &TexelTaps) -> [f64; 3] {
    match &side.interior {
        ReferenceInterior::Maps { rho_d, .. } => taps.colour(rho_d),
        ReferenceInterior::Scalars { gamma, thickness, curve } => {
            let (rho_d, gamma) = (curve(taps.scalar(thickness)).0, taps.colour(gamma));
            [0, 1, 2].map(|c| gamma[c] * rho_d[c])
        }
    }
}

fn transmittance(side: &ReferenceSide, taps: &TexelTaps) -> [f64; 3] {
    match &side.interior {
        ReferenceInterior::Maps { rho_t, .. } => taps.colour(rho_t),
        ReferenceInterior::Scalars { thickness, curve, .. } => curve(taps.scalar(thickness)).1,
    }
}
