//! Leaves with maps, of a fit or of a look, some of whose numbers are unknown.
//!
//! Maps keep their pattern. σa and σs of a fitted leaf are numbers of the whole leaf: those of its leading side stand
//! for both sides and for all texels, which change by the same factor. Its thickness is the mean of that side, and
//! what is added to it is added everywhere. ρd, ρt, ρs and m change by factors on their maps; a fitted leaf of which
//! ρd or ρt is unknown becomes a stated look, because they would no longer be those of its slab.

use crate::Result;
use crate::quantity::{MappedNumber, SlabNumber, UnknownKind, UnknownQuantity};
use crate::tissue::mapped_name;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::edit::{self, LeafSideEdit};
use mesophyll_fits::leaf_folder::{LeafFit, reflecting};
use mesophyll_optics::side::{Side, Sides};
use mesophyll_optics::slab;
use mesophyll_optics::slab::chebyshev::SlabInterpolant;
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::LoadedLeaf;
use mesophyll_scene::manifest::InteriorSource;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::world::{ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferenceSide};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// The thinnest texel of a leaf whose thickness is changed, as a share of the mean, as [`LeafSideEdit::maps`] leaves
/// it.
const THINNEST: f64 = 1e-3;

/// A leaf with maps.
pub struct MappedLeaf {
    /// The fit, or the look as a fit.
    fit: LeafFit,
    /// Whether ρd and ρt of a fit are found without its slab.
    loose: bool,
    /// Whether ρd and ρt are both unknown.
    both: bool,
    /// Front and back, as the scene states them.
    sides: [ReferenceSide; 2],
    /// The tissue of each side; of a look there is none.
    tissue: [Option<SideTissue>; 2],
    texels: usize,
    /// σa, σs and thickness of the leading side.
    start: ([f64; 3], [f64; 3], f64),
}

/// The slab of one side.
struct SideTissue {
    /// σa and σs, where they are numbers of the side.
    sigma: [[f64; 3]; 2],
    /// Mean thickness (mm).
    thickness: f64,
    /// Maps of thickness, σa and σs, where these are maps.
    maps: Option<Vec<Vec<f32>>>,
}

impl MappedLeaf {
    /// The maps of a leaf of the world, of which `asked` is unknown; `None` where it has no fit.
    ///
    /// # Errors
    /// Those of reading the fit.
    pub fn of(
        leaf: LoadedLeaf,
        shown: &ReferenceLeaf,
        asked: &[String],
        ledger: &Ledger,
    ) -> Result<Option<MappedLeaf>> {
        let Some(fit) = leaf.placed.fitted.clone() else { return Ok(None) };
        let by_texel = leaf.placed.interior(leaf.config) == InteriorSource::Maps;
        let both = ["rho_d", "rho_t"].iter().all(|name| asked.iter().any(|n| n == name));
        let loose = !fit.is_stated() && asked.iter().any(|n| n == "rho_d" || n == "rho_t");
        let of = |side: Side| -> Result<Option<SideTissue>> {
            if fit.is_stated() || loose || !fit.has(side) {
                return Ok(None);
            }
            let (thickness, maps) = match by_texel {
                true => (fit.thickness(side)?, Some(reference::tissue(&fit, side, ledger)?)),
                false => (fit.thickness(side)?, None),
            };
            let mean = |plane: &Vec<f32>| plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len().max(1) as f64;
            let sigma = match &maps {
                Some(maps) => [0, 1].map(|q| [0, 1, 2].map(|c| mean(&maps[1 + 3 * q + c]))),
                None => [fit.rgb(side, Quantity::SigmaA)?, fit.rgb(side, Quantity::SigmaS)?],
            };
            Ok(Some(SideTissue { sigma, thickness, maps }))
        };
        let tissue = [of(Side::Front)?, of(Side::Back)?];
        let leading = tissue.iter().flatten().next();
        let start = leading.map_or(([0.0; 3], [0.0; 3], 0.0), |t| (t.sigma[0], t.sigma[1], t.thickness));
        let mut sides = [shown.front.clone(), shown.back.clone()];
        if loose {
            sides.iter_mut().for_each(|side| side.interior = solved(&side.interior));
        }
        Ok(Some(MappedLeaf { fit, loose, both, sides, tissue, texels: shown.width * shown.height, start }))
    }

    /// The unknowns that `what` asks for.
    pub fn unknown(&self, k: usize, name: &str, what: &str) -> std::result::Result<Vec<UnknownQuantity>, String> {
        let (sigma_a, sigma_s, thickness) = self.start;
        let endless = |at: Vec<f64>| {
            let high = vec![f64::INFINITY; at.len()];
            (at, high)
        };
        if self.fit.is_stated() && matches!(what, "sigma_a" | "sigma_s" | "thickness_mm") {
            let expected = "which says nothing of its tissue; expected rho_d, rho_t";
            return Err(format!("found \"{what}\" of a stated look, {expected}"));
        }
        let of_slab = |number, (at, high): (Vec<f64>, Vec<f64>), low: f64, scale: f64| {
            if at.iter().any(|v| !(*v > 0.0)) {
                return Err(format!(
                    "found \"{what}\" of a fit in which it is 0 in a channel, which no factor changes"
                ));
            }
            let name = format!("leaf.{name}.{what}");
            Ok(vec![UnknownQuantity { kind: UnknownKind::Slab(k, number), name, at, low, high, scale: Some(scale) }])
        };
        let factor = |number, high: Vec<f64>| {
            let (at, name) = (vec![1.0; high.len()], format!("leaf.{name}.{}", mapped_name(number)));
            let kind = UnknownKind::Factor(k, number);
            UnknownQuantity { kind, name, at, low: 0.0, high, scale: Some(1e-9) }
        };
        let glossy = self.sides.iter().any(|side| side.gloss.is_some());
        if matches!(what, "rho_s" | "m") && !glossy {
            return Err(format!("found \"{what}\" of a leaf whose maps have no gloss, expected a leaf with one"));
        }
        let largest = |of: fn(&ReferenceGloss) -> Box<dyn Iterator<Item = f32> + '_>| {
            let most = self.sides.iter().filter_map(|s| s.gloss.as_ref()).flat_map(of).fold(0f32, f32::max);
            vec![1.0 / f64::from(most).max(1e-9)]
        };
        Ok(match what {
            "sigma_a" => of_slab(SlabNumber::SigmaA, endless(sigma_a.to_vec()), 0.0, 0.1 / thickness.max(1e-9))?,
            "sigma_s" => of_slab(SlabNumber::SigmaS, endless(sigma_s.to_vec()), 0.0, 0.1 / thickness.max(1e-9))?,
            "thickness_mm" => of_slab(SlabNumber::Thickness, endless(vec![thickness]), 0.05 * thickness, 1e-9)?,
            "rho_d" => {
                let there = |back: &bool| self.shows(*back);
                let of = |back: bool| factor(MappedNumber::RhoD(back), self.most(back, true));
                [false, true].into_iter().filter(there).map(of).collect()
            }
            "rho_t" => {
                let [front, back] = [false, true].map(|back| self.most(back, false));
                vec![factor(MappedNumber::RhoT, front.iter().zip(back).map(|(a, b)| a.min(b)).collect())]
            }
            "rho_s" => vec![factor(MappedNumber::RhoS, largest(|g| Box::new(g.rho_s.iter().flatten().copied())))],
            _ => vec![factor(MappedNumber::M, largest(|g| Box::new(g.m.iter().copied())))],
        })
    }

    /// Whether a side has maps of its own.
    fn shows(&self, back: bool) -> bool {
        self.fit.has(if back { Side::Back } else { Side::Front })
    }

    /// ρd and ρt of a side's texels, a channel.
    fn reflectances(&self, back: bool, c: usize) -> Vec<[f64; 2]> {
        let interior = &self.sides[usize::from(back)].interior;
        let ReferenceInterior::Maps { rho_d, rho_t } = interior else { return Vec::new() };
        rho_d[c].iter().zip(&rho_t[c]).map(|(d, t)| [f64::from(*d), f64::from(*t)]).collect()
    }

    /// The largest factors on ρd (or on ρt) of a side, a channel each, with which no texel gives more than it gets.
    /// Where both are unknown, [`MappedLeaf::keep_energy`] holds their sum.
    fn most(&self, back: bool, of_rho_d: bool) -> Vec<f64> {
        let limit = |[d, t]: &[f64; 2]| {
            let (own, rest) = if of_rho_d { (*d, *t) } else { (*t, *d) };
            let rest = if self.both { 0.0 } else { rest };
            if own > 0.0 { (1.0 - rest) / own } else { f64::INFINITY }
        };
        (0..3).map(|c| self.reflectances(back, c).iter().map(limit).fold(1e6, f64::min).max(1.0)).collect()
    }

    /// What the present numbers of leaf `k` change of the fit.
    pub fn edits(&self, k: usize, numbers: &[UnknownQuantity]) -> Sides<LeafSideEdit> {
        let mut out = Sides::of(|_| LeafSideEdit::default());
        let (sigma_a, sigma_s, thickness) = self.start;
        for q in numbers {
            let three = |over: [f64; 3]| [0, 1, 2].map(|c| q.at[c.min(q.at.len() - 1)] / over[c]);
            for (side, edit) in out.iter_mut() {
                match q.kind {
                    UnknownKind::Slab(leaf, SlabNumber::SigmaA) if leaf == k => edit.sigma_a = three(sigma_a),
                    UnknownKind::Slab(leaf, SlabNumber::SigmaS) if leaf == k => edit.sigma_s = three(sigma_s),
                    UnknownKind::Slab(leaf, SlabNumber::Thickness) if leaf == k => {
                        edit.thickness_mm = q.at[0] - thickness;
                    }
                    UnknownKind::Factor(leaf, number) if leaf == k => match number {
                        MappedNumber::RhoD(back) if back == (side == Side::Back) => edit.rho_d = three([1.0; 3]),
                        MappedNumber::RhoD(_) => {}
                        MappedNumber::RhoT => edit.rho_t = three([1.0; 3]),
                        MappedNumber::RhoS => edit.rho_s = q.at[0],
                        MappedNumber::M => edit.m = q.at[0],
                    },
                    _ => {}
                }
            }
        }
        out
    }

    /// Writes the fit with the present numbers of leaf `k` into a folder.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn save(&self, k: usize, numbers: &[UnknownQuantity], folder: &Path) -> Result<()> {
        const HOW: &str = "found in pictures of a scene";
        let edits = self.edits(k, numbers);
        if self.loose {
            reflecting::save(&self.fit, &edits, folder, HOW)
        } else {
            edit::save_to(&self.fit.edited(edits), folder, HOW)
        }
    }

    /// Gives a leaf of the world the present numbers.
    pub fn set(&self, k: usize, numbers: &[UnknownQuantity], leaf: &mut ReferenceLeaf) {
        let edits = self.edits(k, numbers);
        for (s, side) in [&mut leaf.front, &mut leaf.back].into_iter().enumerate() {
            let edit = &edits[Side::ALL[s]];
            side.interior = self.interior(s, edit, None);
            side.gloss = self.sides[s].gloss.as_ref().map(|gloss| ReferenceGloss {
                rho_s: gloss.rho_s.each_ref().map(|map| scaled(map, edit.rho_s)),
                m: scaled(&gloss.m, edit.m),
            });
        }
    }

    /// The derivatives of both sides by an unknown of leaf `k` at the present numbers, as looks.
    pub fn by(&self, k: usize, kind: &UnknownKind, numbers: &[UnknownQuantity]) -> [ReferenceSide; 2] {
        let edits = self.edits(k, numbers);
        [0, 1].map(|s| {
            let mut out = ReferenceSide::black(self.texels);
            let none = || vec![0.0; self.texels];
            match kind {
                UnknownKind::Factor(_, MappedNumber::RhoS) => {
                    let gloss = self.sides[s].gloss.as_ref();
                    out.gloss = gloss.map(|g| ReferenceGloss { rho_s: g.rho_s.clone(), m: none() });
                }
                UnknownKind::Factor(_, MappedNumber::M) => {
                    let gloss = self.sides[s].gloss.as_ref();
                    out.gloss = gloss.map(|g| ReferenceGloss { rho_s: [none(), none(), none()], m: g.m.clone() });
                }
                UnknownKind::Factor(_, MappedNumber::RhoD(back)) if *back != (s == 1) => {}
                _ => out.interior = self.interior(s, &edits[Side::ALL[s]], Some(kind)),
            }
            out
        })
    }

    /// ρd and ρt of a side with the present numbers, or their derivatives by an unknown.
    fn interior(&self, s: usize, edit: &LeafSideEdit, by: Option<&UnknownKind>) -> ReferenceInterior {
        // What the maps of ρd and ρt are multiplied by.
        let on = match by {
            None => [edit.rho_d, edit.rho_t],
            Some(UnknownKind::Factor(_, MappedNumber::RhoD(_))) => [[1.0; 3], [0.0; 3]],
            Some(UnknownKind::Factor(..)) => [[0.0; 3], [1.0; 3]],
            Some(_) => [[1.0; 3]; 2],
        };
        let Some(tissue) = &self.tissue[s] else {
            let ReferenceInterior::Maps { rho_d, rho_t } = &self.sides[s].interior else {
                return self.sides[s].interior.clone();
            };
            let of = |maps: &[Vec<f32>; 3], by: [f64; 3]| [0, 1, 2].map(|c| scaled(&maps[c], by[c]));
            return ReferenceInterior::Maps { rho_d: of(rho_d, on[0]), rho_t: of(rho_t, on[1]) };
        };
        let start = [self.start.0, self.start.1];
        let factors = [edit.sigma_a, edit.sigma_s];
        let number = if let Some(UnknownKind::Slab(_, number)) = by { Some(*number) } else { None };
        // ρd and ρt of a channel by its own σa, σs and present thickness, or their derivatives. σ of a side and of a
        // texel change by the factor of the leading side's.
        let texel = move |c: usize, [sigma_a, sigma_s]: [f64; 2], h: f64| -> [f64; 2] {
            let (at, slope) = slab::response_with_partials(sigma_a * factors[0][c], sigma_s * factors[1][c], h);
            let (at, over) = match number {
                None => (at, 1.0),
                Some(SlabNumber::SigmaA) => (slope.sigma_a, sigma_a / start[0][c]),
                Some(SlabNumber::SigmaS) => (slope.sigma_s, sigma_s / start[1][c]),
                Some(SlabNumber::Thickness) => (slope.thickness, 1.0),
            };
            [at.rho_d * over, at.rho_t * over]
        };
        let thinnest = THINNEST * (tissue.thickness + edit.thickness_mm);
        let moved = |map: &[f32]| -> Vec<f32> {
            map.iter().map(|h| (f64::from(*h) + edit.thickness_mm).max(thinnest) as f32).collect()
        };
        if let Some(maps) = &tissue.maps {
            let thickness = moved(&maps[0]);
            let of = |c: usize| -> (Vec<f32>, Vec<f32>) {
                let one = |k: usize| {
                    let sigma = [f64::from(maps[1 + c][k]), f64::from(maps[4 + c][k])];
                    let [d, t] = texel(c, sigma, f64::from(thickness[k]));
                    (d as f32, t as f32)
                };
                (0..thickness.len()).into_par_iter().map(one).unzip()
            };
            let [(r, tr), (g, tg), (b, tb)] = [of(0), of(1), of(2)];
            return ReferenceInterior::Maps { rho_d: [r, g, b], rho_t: [tr, tg, tb] };
        }
        let ReferenceInterior::Scalars { gamma, thickness, .. } = &self.sides[s].interior else {
            return self.sides[s].interior.clone();
        };
        let (gamma, thickness, sigma) = (gamma.clone(), moved(thickness), tissue.sigma);
        if by.is_none() {
            let (low, high) =
                thickness.iter().fold((f64::INFINITY, 0f64), |(a, b), h| (a.min(f64::from(*h)), b.max(f64::from(*h))));
            let now = [0, 1].map(|q: usize| [0, 1, 2].map(|c: usize| sigma[q][c] * factors[q][c]));
            let curve = SlabInterpolant::new(now[0], now[1], low, high);
            return ReferenceInterior::Scalars { gamma, thickness, curve: Arc::new(move |h| curve.at(h)) };
        }
        let curve = move |h: f64| {
            let all = [0, 1, 2].map(|c| texel(c, [sigma[0][c], sigma[1][c]], h));
            (all.map(|v| v[0]), all.map(|v| v[1]))
        };
        ReferenceInterior::Scalars { gamma, thickness, curve: Arc::new(curve) }
    }

    /// Holds the factors on ρd and ρt where no texel gives more than it gets: what they are too large by is taken from
    /// both. `first` are the places of the unknowns' numbers in `values`.
    pub fn keep_energy(&self, k: usize, numbers: &[UnknownQuantity], first: &[usize], values: &mut [f64]) {
        let place = |number| {
            let own = numbers.iter().position(|q| q.kind == UnknownKind::Factor(k, number));
            own.map(|q| first[q])
        };
        let Some(through) = place(MappedNumber::RhoT) else { return };
        for back in [false, true] {
            let Some(own) = place(MappedNumber::RhoD(back)) else { continue };
            for c in 0..3 {
                let sum = |[d, t]: &[f64; 2]| d * values[own + c] + t * values[through + c];
                let most = self.reflectances(back, c).iter().map(sum).fold(0.0, f64::max);
                if most > 1.0 {
                    (values[own + c], values[through + c]) = (values[own + c] / most, values[through + c] / most);
                }
            }
        }
    }
}

/// ρd and ρt of every texel.
fn solved(interior: &ReferenceInterior) -> ReferenceInterior {
    let ReferenceInterior::Scalars { gamma, thickness, curve } = interior else { return interior.clone() };
    let texels: Vec<_> = thickness.par_iter().map(|h| curve(f64::from(*h))).collect();
    let rho_d = |c: usize| texels.iter().zip(&gamma[c]).map(|(of, g)| (f64::from(*g) * of.0[c]) as f32).collect();
    let rho_t = |c: usize| texels.iter().map(|of| of.1[c] as f32).collect();
    ReferenceInterior::Maps { rho_d: [rho_d(0), rho_d(1), rho_d(2)], rho_t: [rho_t(0), rho_t(1), rho_t(2)] }
}

/// A map times a factor.
fn scaled(map: &[f32], factor: f64) -> Vec<f32> {
    map.iter().map(|v| (f64::from(*v) * factor) as f32).collect()
}
