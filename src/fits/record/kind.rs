//! The kinds of fit folder.

use mesophyll_files::claim;
use serde::{Deserialize, Serialize};
use strum::{Display, IntoStaticStr};

/// What a fit folder is a fit of; its name is what `kind` in `fit.toml` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Display, IntoStaticStr)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum FitKind {
    /// A leaf's maps and leaf-wide figures, from a scan, a dome or light boxes.
    #[default]
    Leaf,
    /// A leaf whose look is stated by pictures: the maps of a leaf, of which nothing was fitted.
    Look,
    /// How light spreads inside a leaf, from narrow beams.
    Tissue,
    /// How the light that comes through a leaf depends on its direction.
    Translucency,
    /// Polynomials of a sky's spherical harmonics.
    Sky,
    /// Sun and turbidity of one picture of the sky.
    Panorama,
    /// The shapes of bending branches.
    Beam,
    /// Slices that stand for the blades of a meadow.
    Grass,
    /// What leaves, ground and light of a scene are, from its pictures.
    Scene,
    /// How light reaches the leaves of a scene past and by way of other leaves.
    Transfer,
}

impl FitKind {
    /// Its name in `fit.toml`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What a folder of it is called.
    pub fn words(self) -> String {
        claim::fit_words(self.name())
    }
}
