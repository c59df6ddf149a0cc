//! An edit: one value that a user has set, in the unit that its slider shows. It goes unchanged from the slider to the
//! program around the window.

use crate::editor::PlantPart;
use mesophyll_viewer::scene::{Side, Sides};
use std::collections::BTreeMap;

/// What an edit is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EditTarget {
    /// Both sides of a leaf, by the index of its material.
    Leaf(usize),
    /// One side of a leaf.
    LeafSide(usize, Side),
    /// The branches of a plant, by the plant's index (Habel 2009, Fig. 4.17).
    Plant(usize, PlantPart),
    /// Sun, sky and exposure.
    Light,
}

/// What takes over its edits in one go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EditGroup {
    /// A leaf with both sides.
    Leaf(usize),
    /// All plants.
    Plants,
    /// All lights.
    Light,
}

impl EditTarget {
    /// The group that it belongs to.
    pub fn group(self) -> EditGroup {
        match self {
            EditTarget::Leaf(leaf) | EditTarget::LeafSide(leaf, _) => EditGroup::Leaf(leaf),
            EditTarget::Plant(..) => EditGroup::Plants,
            EditTarget::Light => EditGroup::Light,
        }
    }
}

/// The values that can be edited (Wang et al. 2005, Fig. 6; Habel 2009, Table 4.2). σ has a channel: red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[expect(missing_docs, reason = "`scale` says what each of them is")]
pub enum EditQuantity {
    Thickness,
    SigmaA(usize),
    SigmaS(usize),
    RhoS,
    M,
    Taper,
    Load,
    Lean,
    Resonance,
    Damping,
    Azimuth,
    Elevation,
    Sun,
    Sky,
    Turbidity,
    Exposure,
}

/// How a value is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EditScale {
    /// Its name beside the slider.
    pub name: &'static str,
    /// Its unit, as it follows the number.
    pub unit: &'static str,
    /// The ends of its slider.
    pub range: [f64; 2],
    /// Most digits after the point; `None` where the slider's length decides.
    pub decimals: Option<usize>,
    /// What it is, for people who point at it.
    pub hint: &'static str,
}

impl EditQuantity {
    /// The factors on a plant's branches.
    pub const PLANT: [EditQuantity; 5] = [Self::Taper, Self::Load, Self::Lean, Self::Resonance, Self::Damping];

    /// Its name, unit and range.
    pub fn scale(self) -> EditScale {
        let absorbs = "absorption coefficient of this side, in 1/mm: the share of light that is absorbed on a mm";
        let scatters = "scattering coefficient of this side, in 1/mm: the share of light that is scattered on a mm";
        let (name, unit, range, decimals, hint) = match self {
            Self::Thickness => {
                ("h", " mm", [0.02, 1.0], None, "mean thickness of the leaf, in mm; click the number to type one")
            }
            Self::SigmaA(c) => (["σa R", "σa G", "σa B"][c.min(2)], "/mm", [1e-3, 100.0], None, absorbs),
            Self::SigmaS(c) => (["σs R", "σs G", "σs B"][c.min(2)], "/mm", [1e-2, 300.0], None, scatters),
            Self::RhoS => {
                ("ρs ×", "", [0.0, 3.0], None, "factor on the fitted strength of the gloss, ρs; it has no unit")
            }
            Self::M => {
                ("m ×", "", [0.2, 3.0], None, "factor on the fitted roughness m, an RMS slope; below 1 is sharper")
            }
            Self::Taper => ("taper ×", "", [0.1, 4.0], Some(2), "factor on tip radius over root radius; no unit"),
            Self::Load => {
                let hint = "factor on the weight that the branch carries; it bends by what is added";
                ("load ×", "", [0.0, 10.0], Some(2), hint)
            }
            Self::Lean => ("lean ×", "", [0.0, 5.0], Some(2), "factor on the way of the tip in a steady wind"),
            Self::Resonance => ("resonance ×", "", [0.2, 5.0], Some(2), "factor on the branch's own frequency"),
            Self::Damping => ("damping ×", "", [0.1, 10.0], Some(2), "factor on how fast it comes to rest"),
            Self::Azimuth => {
                ("azimuth", "°", [-180.0, 180.0], Some(1), "the sun's azimuth, in degrees from +x towards +y")
            }
            Self::Elevation => {
                ("elevation", "°", [-90.0, 90.0], Some(1), "the sun's height above the horizon, in degrees")
            }
            Self::Sun => ("sun ×", "", [0.0, 4.0], None, "factor on the sun's irradiance; 1 is the scene's"),
            Self::Sky => ("sky ×", "", [0.0, 4.0], None, "factor on the sky's radiance; 1 is the scene's"),
            Self::Turbidity => {
                let hint = "haze in the air, without a unit: 2 is very clear, 6 is hazy";
                ("turbidity", "", [1.7, 10.0], Some(2), hint)
            }
            Self::Exposure => ("exposure", "", [1e-3, 1e3], None, "factor on radiance before it is shown"),
        };
        EditScale { name, unit, range, decimals, hint }
    }

    /// What the symbol of its name stands for; empty where the name is a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Thickness => "thickness",
            Self::SigmaA(_) => "absorption",
            Self::SigmaS(_) => "scattering",
            Self::RhoS => "gloss",
            Self::M => "roughness",
            _ => "",
        }
    }

    /// Whether it is a factor on what the scene has, which starts with 1.
    pub fn is_factor(self) -> bool {
        use EditQuantity::{Azimuth, Elevation, Exposure, SigmaA, SigmaS, Thickness, Turbidity};
        !matches!(self, Thickness | SigmaA(_) | SigmaS(_) | Azimuth | Elevation | Turbidity | Exposure)
    }
}

impl EditScale {
    /// Whether the slider is logarithmic: where its ends are far apart, halves and doubles lie on both sides of the
    /// middle.
    pub fn is_logarithmic(&self) -> bool {
        let [low, high] = self.range;
        low > 0.0 && high / low > 10.0
    }
}

/// One value that a user has set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edit {
    /// What it is for.
    pub target: EditTarget,
    /// Which value.
    pub quantity: EditQuantity,
    /// The value in the unit that is shown.
    pub value: f64,
}

/// Values by what they are for. As the state of a window it holds those that differ from the start.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Edits(BTreeMap<(EditTarget, EditQuantity), f64>);

impl Edits {
    /// Thickness (mm), σa and σs (1/mm) of a leaf.
    pub fn tissue(leaf: usize, thickness_mm: f64, sigmas: Sides<[[f64; 3]; 2]>) -> Edits {
        let thickness = Edit { target: EditTarget::Leaf(leaf), quantity: EditQuantity::Thickness, value: thickness_mm };
        let of_side = |(side, [sigma_a, sigma_s]): (Side, &[[f64; 3]; 2])| {
            let target = EditTarget::LeafSide(leaf, side);
            let (a, s) = (*sigma_a, *sigma_s);
            (0..3).flat_map(move |c| {
                [(EditQuantity::SigmaA(c), a[c]), (EditQuantity::SigmaS(c), s[c])].map(|(quantity, value)| Edit {
                    target,
                    quantity,
                    value,
                })
            })
        };
        sigmas.iter().flat_map(of_side).chain([thickness]).collect()
    }

    /// A value, where it is in here.
    pub fn get(&self, target: EditTarget, quantity: EditQuantity) -> Option<f64> {
        self.0.get(&(target, quantity)).copied()
    }

    /// Factor on a value; 1 where it is not in here.
    pub fn factor(&self, target: EditTarget, quantity: EditQuantity) -> f64 {
        self.get(target, quantity).unwrap_or(1.0)
    }

    /// All values, in a fixed order.
    pub fn iter(&self) -> impl Iterator<Item = Edit> {
        self.0.iter().map(|(&(target, quantity), &value)| Edit { target, quantity, value })
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The values of a group.
    pub fn of(&self, group: EditGroup) -> Edits {
        self.iter().filter(|edit| edit.target.group() == group).collect()
    }

    /// These values with those of `other` in a group.
    pub fn replaced(&self, group: EditGroup, other: &Edits) -> Edits {
        let others = self.iter().filter(|edit| edit.target.group() != group);
        others.chain(other.iter().filter(|edit| edit.target.group() == group)).collect()
    }

    /// These values with `edits`; one that is the value of `start` is left out.
    pub fn with(&self, edits: impl IntoIterator<Item = Edit>, start: impl Fn(&Edit) -> Option<f64>) -> Edits {
        let mut out = self.clone();
        for edit in edits {
            match start(&edit) == Some(edit.value) {
                true => out.0.remove(&(edit.target, edit.quantity)),
                false => out.0.insert((edit.target, edit.quantity), edit.value),
            };
        }
        out
    }

    /// The values here that are not the same in `other`, and those of `start` that only `other` has.
    pub fn since(&self, other: &Edits, start: impl Fn(&Edit) -> Option<f64>) -> Vec<Edit> {
        let new = self.iter().filter(|edit| other.get(edit.target, edit.quantity) != Some(edit.value));
        let gone = other.iter().filter(|edit| self.get(edit.target, edit.quantity).is_none());
        new.chain(gone.filter_map(|edit| Some(Edit { value: start(&edit)?, ..edit }))).collect()
    }
}

impl FromIterator<Edit> for Edits {
    fn from_iter<T: IntoIterator<Item = Edit>>(edits: T) -> Edits {
        Edits(edits.into_iter().map(|e| ((e.target, e.quantity), e.value)).collect())
    }
}
