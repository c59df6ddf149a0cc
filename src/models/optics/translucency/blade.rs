//! A blade as maps: outline and thickness, and for each side heights, normals and the share of the light that enters.
//!
//! Maps are row-major with row 0 on top. What the sides share is stored in the front's columns. A side's own maps are
//! as its camera saw them: column i of the back is column W−1−i of the front, W being the number of columns. Lengths in
//! mm.

use crate::side::{Side, mirror};
use std::borrow::Cow;

/// One leaf as maps of `width · height` texels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BladeMaps {
    /// Texels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// Which texels lie on the leaf (front's columns).
    pub mask: Vec<bool>,
    /// Thickness (mm, front's columns), positive on the leaf, 0 off it.
    pub thickness: Vec<f64>,
    /// The front, in its own columns.
    pub front: SurfaceMaps,
    /// The back, in its own columns.
    pub back: SurfaceMaps,
}

/// One side's maps in its own columns. Values off the leaf are not read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SurfaceMaps {
    /// Height (mm) over the blade's mid plane, outward of this side.
    pub height: Vec<f64>,
    /// Unit normal in this side's image frame: x right, y up, z out of this side (positive).
    pub normal: Vec<[f64; 3]>,
    /// Share of the incident light that enters, 1 − ρ, in [0, 1].
    pub entry: Vec<f64>,
}

/// A blade as the lit side's camera sees it: every map in that side's columns.
#[derive(Debug, Clone)]
pub struct LitSide<'a> {
    /// Which side is lit.
    pub side: Side,
    /// Texels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// Which texels lie on the leaf.
    pub mask: Cow<'a, [bool]>,
    /// Thickness (mm), 0 off the leaf.
    pub thickness: Cow<'a, [f64]>,
    /// Heights, normals and share of light that enters.
    pub surface: &'a SurfaceMaps,
}

impl BladeMaps {
    /// A flat blade of one thickness that covers the whole map.
    pub fn flat(width: usize, height: usize, texel_mm: f64, thickness_mm: f64, entry: f64) -> BladeMaps {
        let n = width * height;
        let side = SurfaceMaps {
            height: vec![0.5 * thickness_mm; n],
            normal: vec![[0.0, 0.0, 1.0]; n],
            entry: vec![entry; n],
        };
        BladeMaps {
            width,
            height,
            texel_mm,
            mask: vec![true; n],
            thickness: vec![thickness_mm; n],
            front: side.clone(),
            back: side,
        }
    }

    /// A blade from the heights of its two sides, each measured outward from one mid plane and in its own columns. The
    /// thickness is the sum of the heights (the distance between the surfaces); normals are the slopes of the heights.
    /// `entry`: front, back.
    pub fn from_heights(
        width: usize,
        height: usize,
        texel_mm: f64,
        mask: Vec<bool>,
        heights: [Vec<f64>; 2],
        entry: [Vec<f64>; 2],
    ) -> BladeMaps {
        let [front, back] = heights;
        let thickness = thickness(&mask, &front, &back, width);
        let seen = mirror(&mask, width);
        let [enters_front, enters_back] = entry;
        let normals = |z: &[f64], mask: &[bool]| super::relief::normals(z, mask, width, height, texel_mm);
        let front = SurfaceMaps { normal: normals(&front, &mask), height: front, entry: enters_front };
        let back = SurfaceMaps { normal: normals(&back, &seen), height: back, entry: enters_back };
        BladeMaps { width, height, texel_mm, mask, thickness, front, back }
    }

    /// One side, in its own columns.
    pub fn surface(&self, side: Side) -> &SurfaceMaps {
        match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        }
    }

    /// The blade as the camera of `side` sees it when that side is lit.
    pub fn lit(&self, side: Side) -> LitSide<'_> {
        let (mask, thickness) = match side {
            Side::Front => (Cow::from(&self.mask), Cow::from(&self.thickness)),
            Side::Back => (Cow::from(mirror(&self.mask, self.width)), Cow::from(mirror(&self.thickness, self.width))),
        };
        LitSide {
            side,
            width: self.width,
            height: self.height,
            texel_mm: self.texel_mm,
            mask,
            thickness,
            surface: self.surface(side),
        }
    }

    /// Share of the inner light that leaves through the side opposite to the lit one (its 1 − ρ), in the lit side's
    /// columns.
    pub fn exit(&self, lit: Side) -> Vec<f64> {
        mirror(&self.surface(lit.other()).entry, self.width)
    }

    /// Thinnest and thickest texel (mm); `None` without a texel on the leaf.
    pub fn thickness_range(&self) -> Option<[f64; 2]> {
        let on = self.thickness.iter().zip(&self.mask).filter(|(_, m)| **m).map(|(d, _)| *d);
        on.fold(None, |range, d| Some(range.map_or([d, d], |[a, b]: [f64; 2]| [a.min(d), b.max(d)])))
    }

    /// Checks that the maps hold what their descriptions promise.
    ///
    /// # Errors
    /// A sentence that names the map, the texel, what was found and what was expected.
    pub fn validate(&self) -> Result<(), String> {
        let n = self.width * self.height;
        if n == 0 {
            return Err(format!("the maps have {}×{} texels; expected at least one", self.width, self.height));
        }
        if !(self.texel_mm > 0.0 && self.texel_mm.is_finite()) {
            return Err(format!("texel_mm: {} found, expected a positive length", self.texel_mm));
        }
        let sized = |name: &str, found: usize| {
            if found == n { Ok(()) } else { Err(format!("{name}: {found} values found, expected {n}")) }
        };
        sized("mask", self.mask.len())?;
        sized("thickness", self.thickness.len())?;
        if !self.mask.contains(&true) {
            return Err("mask: no texel lies on the leaf".into());
        }
        let place = |k: usize| format!("column {}, row {}", k % self.width, k / self.width);
        for (k, (&d, &on)) in self.thickness.iter().zip(&self.mask).enumerate() {
            if on && !(d > 0.0 && d.is_finite()) {
                return Err(format!("thickness at {}: {d} mm found, expected a positive length on the leaf", place(k)));
            }
            if !on && d != 0.0 {
                return Err(format!("thickness at {}: {d} mm found, expected 0 off the leaf", place(k)));
            }
        }
        for side in [Side::Front, Side::Back] {
            let (name, lit) = (side.name(), self.lit(side));
            let s = lit.surface;
            sized(&format!("{name} height"), s.height.len())?;
            sized(&format!("{name} normal"), s.normal.len())?;
            sized(&format!("{name} entry"), s.entry.len())?;
            for k in (0..n).filter(|&k| lit.mask[k]) {
                if !s.height[k].is_finite() {
                    return Err(format!(
                        "{name} height at {}: {} found, expected a finite height",
                        place(k),
                        s.height[k]
                    ));
                }
                let [x, y, z] = s.normal[k];
                if !((x * x + y * y + z * z - 1.0).abs() < 1e-3 && z > 0.0) {
                    return Err(format!(
                        "{name} normal at {}: ({x}, {y}, {z}) found, expected a unit vector with z > 0",
                        place(k)
                    ));
                }
                if !(0.0..=1.0).contains(&s.entry[k]) {
                    return Err(format!(
                        "{name} entry at {}: {} found, expected a share in [0, 1]",
                        place(k),
                        s.entry[k]
                    ));
                }
            }
        }
        Ok(())
    }
}

/// Thickness (mm, front's columns) from the heights of both sides, each measured outward from one mid plane and in its
/// own columns (H9 §3.3.2: the difference of the displacement maps); 0 off the leaf.
pub fn thickness(mask: &[bool], front: &[f64], back: &[f64], width: usize) -> Vec<f64> {
    let back = mirror(back, width);
    mask.iter().zip(front.iter().zip(&back)).map(|(&on, (f, b))| if on { f + b } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A blade whose sides differ and whose mask is not symmetric.
    fn lopsided() -> BladeMaps {
        let (w, h) = (7, 5);
        let mask: Vec<bool> = (0..w * h).map(|k| k % w > 1 && k / w > 0).collect();
        let front: Vec<f64> = (0..w * h).map(|k| 0.1 + 0.01 * (k % w) as f64).collect();
        // In the image of the back's camera it rises to the right, which is to the left in the front's image.
        let back: Vec<f64> = (0..w * h).map(|k| 0.2 + 0.03 * (k % w) as f64).collect();
        BladeMaps::from_heights(w, h, 0.5, mask, [front, back], [vec![0.9; w * h], vec![0.8; w * h]])
    }

    #[test]
    fn the_back_sees_the_leaf_mirrored() {
        let blade = lopsided();
        blade.validate().unwrap();
        let (front, back) = (blade.lit(Side::Front), blade.lit(Side::Back));
        for row in 0..5 {
            for i in 0..7 {
                let (f, b) = (row * 7 + i, row * 7 + 6 - i);
                assert_eq!(front.mask[f], back.mask[b]);
                assert_eq!(front.thickness[f], back.thickness[b]);
                let there = if front.mask[f] { 0.1 + 0.01 * i as f64 + 0.2 + 0.03 * (6 - i) as f64 } else { 0.0 };
                assert!((front.thickness[f] - there).abs() < 1e-15);
                if front.mask[f] {
                    // Both rise to the right in the images of their own cameras: slopes .02 and .06.
                    assert!((front.surface.normal[f][0] / front.surface.normal[f][2] + 0.02).abs() < 1e-12);
                    assert!((back.surface.normal[b][0] / back.surface.normal[b][2] + 0.06).abs() < 1e-12);
                }
            }
        }
        assert_eq!(blade.exit(Side::Front), vec![0.8; 35]);
        assert_eq!(blade.exit(Side::Back), vec![0.9; 35]);
    }

    #[test]
    fn bad_maps_are_named() {
        let check = |spoil: &dyn Fn(&mut BladeMaps), word: &str| {
            let mut blade = lopsided();
            spoil(&mut blade);
            let sentence = blade.validate().unwrap_err();
            assert!(sentence.contains(word), "{sentence}");
        };
        check(&|b| b.thickness[9] = f64::NAN, "thickness at column 2, row 1");
        check(&|b| b.thickness[0] = 0.1, "off the leaf");
        check(&|b| b.texel_mm = 0.0, "texel_mm");
        check(&|b| b.mask.fill(false), "mask");
        check(&|b| b.back.entry[7] = 1.5, "back entry at column 0, row 1");
        check(&|b| b.front.normal[9] = [0.0, 0.0, 2.0], "front normal");
        check(&|b| b.front.height.truncate(34), "front height: 34");
    }
}
