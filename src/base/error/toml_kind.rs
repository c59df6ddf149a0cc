//! What a TOML file describes, told by its fields.

use std::fmt::{Display, Formatter};

/// What a TOML file of this program describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TomlKind {
    /// `fit.toml` of a fit's folder.
    FitRecord,
    /// A linear light source, for traces of gloss.
    LightSource,
    /// A plant or a meadow that can be grown.
    Growth,
    /// A leaf's look, stated by pictures.
    Look,
    /// A synthetic leaf that can be scanned.
    SyntheticLeaf,
    /// A scene.
    Scene,
    /// `capture.toml` of a capture's folder.
    Capture,
}

impl TomlKind {
    /// The kind whose fields a table has; `None` where it has those of none.
    pub fn of(table: &toml::Table) -> Option<TomlKind> {
        let has = |field: &str| table.contains_key(field);
        match () {
            () if has("record_hash") => Some(TomlKind::FitRecord),
            () if has("tube_length_mm") => Some(TomlKind::LightSource),
            () if has("sward") || has("wood") => Some(TomlKind::Growth),
            () if has("albedo") => Some(TomlKind::Look),
            () if has("field_mm") => Some(TomlKind::SyntheticLeaf),
            () if has("view") || has("periodic") || has("instance") || (has("leaf") && has("sun")) => {
                Some(TomlKind::Scene)
            }
            () if has("texel_mm") || has("tube") => Some(TomlKind::Capture),
            () => None,
        }
    }
}

impl Display for TomlKind {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            TomlKind::FitRecord => "the record of a fit",
            TomlKind::LightSource => "the description of a linear light source",
            TomlKind::Growth => "the description of a plant or a meadow",
            TomlKind::Look => "a leaf's look, stated by pictures",
            TomlKind::SyntheticLeaf => "the description of a synthetic leaf",
            TomlKind::Scene => "a scene",
            TomlKind::Capture => "the description of a capture",
        })
    }
}
