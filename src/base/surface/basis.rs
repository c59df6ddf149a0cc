//! The functions of direction for which a leaf's translucency maps hold coefficients, as scenes name them and the
//! renderer evaluates them: three coefficients for each texel, one dot product. The fits know more functions than
//! these.

use serde::{Deserialize, Serialize};

/// Functions of the direction ω towards the light in the lit side's frame (x right, y up, z out of the side).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum TranslucencyBasis {
    /// As published: the three √(3/2π) H_i·ω with the axes H_i of the Half-Life 2 basis (McTaggart 2004).
    #[default]
    #[serde(rename = "half-life-2", alias = "half-life 2")]
    HalfLife2,
    /// The same three of a light that is bent towards the normal: x and y are first multiplied by (2z/(1+z))^¼, so that
    /// shadows of relief end at the horizon.
    #[serde(rename = "bent-3", alias = "bent")]
    Bent,
}

impl TranslucencyBasis {
    /// All of them, the default first.
    pub const ALL: [TranslucencyBasis; 2] = [TranslucencyBasis::HalfLife2, TranslucencyBasis::Bent];
}
