//! The side of a leaf that was not measured, where only one was: a scene says what stands for it.

use crate::leaf_folder::{LeafFit, LeafFitFile, Result, frames, packing};
use glam::DVec3;
use mesophyll_base::surface::side::mirror;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use rayon::prelude::*;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error as _, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// What stands for a side that was not measured.
#[derive(Debug, Clone, PartialEq)]
pub enum OtherSide {
    /// The measured side, with its relief outwards.
    Mirrored,
    /// The same reflection everywhere.
    Stated(StatedSide),
}

/// The reflection of a side that is the same everywhere. What comes through the leaf is what the measured side says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedSide {
    /// Diffuse reflectance, linear sRGB.
    pub rho_d: [f64; 3],
    /// Reflectance ρs of the gloss; without it the side is matte.
    #[serde(default)]
    pub rho_s: [f64; 3],
    /// Root mean square slope m of the gloss.
    #[serde(default = "slope")]
    pub m: f64,
}

fn slope() -> f64 {
    0.2
}

/// The one word for a side that is not stated.
const MIRRORED: &str = "mirrored";

impl<'de> Deserialize<'de> for OtherSide {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<OtherSide, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = OtherSide;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                write!(f, "\"{MIRRORED}\", or a table with rho_d, and rho_s and m where the side is glossy")
            }

            fn visit_str<E: serde::de::Error>(self, word: &str) -> std::result::Result<OtherSide, E> {
                if word == MIRRORED {
                    return Ok(OtherSide::Mirrored);
                }
                Err(E::invalid_value(serde::de::Unexpected::Str(word), &self))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> std::result::Result<OtherSide, A::Error> {
                let side = StatedSide::deserialize(MapAccessDeserializer::new(map));
                side.map(OtherSide::Stated).map_err(A::Error::custom)
            }
        }
        from.deserialize_any(Either)
    }
}

impl OtherSide {
    /// What is said of the side, in a sentence without its end.
    pub fn said(&self, side: Side) -> String {
        let what = match self {
            OtherSide::Mirrored => format!("it mirrors the {}", side.other().name()),
            OtherSide::Stated(stated) => format!(
                "its reflection is stated, rho_d {:?}, rho_s {:?} and m {}, and the {} says what comes through",
                stated.rho_d,
                stated.rho_s,
                stated.m,
                side.other().name()
            ),
        };
        format!("the {} was not measured: {what}", side.name())
    }

    /// The maps of `side`, from those of the side that was measured.
    ///
    /// # Errors
    /// A blade, a parameter or a channel of the fit that cannot be read; a stated reflectance that leaves no room for
    /// the light that comes through.
    pub(super) fn maps(&self, leaf: &LeafFit, side: Side) -> Result<ChannelMaps> {
        let measured = side.other();
        let from = leaf.maps(measured)?;
        let mut out = ChannelMaps::new(from.width, from.height);
        for (name, plane) in &from.channels {
            out.push(name.clone(), mirror(plane, from.width));
        }
        let outwards = match self {
            OtherSide::Mirrored => Some(packing::normals(&leaf.path(LeafFitFile::Maps, measured), from)?),
            OtherSide::Stated(stated) => {
                stated.paint(leaf, side, &mut out)?;
                None
            }
        };
        let normals = self::normals(leaf, side, outwards.as_deref(), from)?;
        for c in 0..3 {
            out.replace(Quantity::Normal, c, normals.iter().map(|n| n[c]).collect());
        }
        Ok(out)
    }
}

/// Normals of `side` as its camera would see them: those of the other side mirrored in the blade, or straight out.
fn normals(leaf: &LeafFit, side: Side, mirrored: Option<&[[f32; 3]]>, of: &ChannelMaps) -> Result<Vec<[f32; 3]>> {
    let (path, width) = (leaf.path(LeafFitFile::Maps, side.other()), of.width);
    let blade = leaf.blade()?.map(|mesh| frames::frames(&path, &mesh, width, of.height)).transpose()?;
    // A camera behind the blade was turned about y.
    let turned = |v: DVec3, side: Side| if side == Side::Back { DVec3::new(-v.x, v.y, -v.z) } else { v };
    let one = |k: usize| {
        let at = side.in_front(k, width);
        let out = blade.as_ref().map_or(DVec3::Z, |frames| frames[at][2]);
        let normal = match mirrored {
            None => {
                if side == Side::Back {
                    -out
                } else {
                    out
                }
            }
            Some(seen) => {
                let of = side.other();
                let n = turned(DVec3::from(seen[of.in_front(at, width)].map(f64::from)), of);
                n - 2.0 * n.dot(out) * out
            }
        };
        turned(normal, side).to_array().map(|v| v as f32)
    };
    Ok((0..width * of.height).map(one).collect())
}

/// The rounding that ρd + ρt = 1 may have.
const ROUNDING: f64 = 1e-6;

impl StatedSide {
    /// Writes what is stated into mirrored maps. γ becomes what makes the slab reflect ρd, so that ρt, which the slab
    /// alone decides, stays as it was measured.
    fn paint(&self, leaf: &LeafFit, side: Side, maps: &mut ChannelMaps) -> Result<()> {
        let measured = side.other();
        let path = leaf.path(LeafFitFile::Maps, measured);
        let (sigma_a, sigma_s) = (leaf.rgb(measured, Quantity::SigmaA)?, leaf.rgb(measured, Quantity::SigmaS)?);
        let thickness = maps.require_scalar(&path, Quantity::Thickness)?.to_vec();
        for c in 0..3 {
            let slabs: Vec<(f64, f64)> = thickness
                .par_iter()
                .map(|h| {
                    if !(*h > 0.0) {
                        return (f64::NAN, f64::NAN);
                    }
                    let slab = slab::response(sigma_a[c], sigma_s[c], f64::from(*h));
                    (slab.rho_d, slab.rho_t)
                })
                .collect();
            let through = slabs.iter().map(|s| s.1).filter(|v| v.is_finite()).fold(0.0, f64::max);
            if self.rho_d[c] + through > 1.0 + ROUNDING {
                let what = format!(
                    "a scene states rho_d {} of {} for the {}, where the fit lets {through:.3} through; expected at \
                     most 1 together",
                    self.rho_d[c],
                    ["R", "G", "B"][c],
                    side.name()
                );
                return Err(crate::leaf_folder::Error::field(&leaf.record_path(), "other_side", what));
            }
            maps.replace(Quantity::Gamma, c, slabs.iter().map(|s| (self.rho_d[c] / s.0) as f32).collect());
            maps.replace(Quantity::RhoD, c, vec![self.rho_d[c] as f32; thickness.len()]);
            maps.replace(Quantity::RhoS, c, vec![self.rho_s[c] as f32; thickness.len()]);
        }
        maps.replace(Quantity::M, 0, vec![self.m as f32; thickness.len()]);
        Ok(())
    }
}
