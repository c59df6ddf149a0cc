//! What the maps of a leaf tell when they are read: the figures on which some decisions of the plan depend.

use super::accuracy::AccuracyRow;
use mesophyll_optics::side::Sides;

/// What reading one leaf's maps told. It is empty for a leaf whose fit is not made yet.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeafFindings {
    /// What the maps of each side told.
    pub sides: Sides<SideFindings>,
    /// Texels that the nearest pixel covers along a side; `None` where no view shows the leaf.
    pub footprint: Option<f64>,
}

/// What reading one side's maps told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SideFindings {
    /// Columns and rows of the leaf's maps, as far as this side and the one before told; zeros where none was read.
    pub size: [usize; 2],
    /// Rows that were measured while the slab curve was refined, where there is one.
    pub curve: Option<Vec<AccuracyRow>>,
    /// What its gloss adds to a picture, where it was read.
    pub gloss: Option<GlossFinding>,
    /// What a picture would lose without its translucency maps, where they were read.
    pub translucency: Option<MapLoss>,
    /// How coarse its maps may be.
    pub detail: Option<MapDetail>,
    /// How coarse its translucency maps may be.
    pub translucency_detail: Option<MapDetail>,
}

/// What the gloss of a side adds to a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GlossFinding {
    /// Nothing: ρs is 0 everywhere.
    Matte,
    /// At most this much to a displayed value.
    AtMost(f64),
}

/// What a picture would lose without the translucency maps of one side, and the kind of these maps.
#[derive(Debug, Clone, PartialEq)]
pub struct MapLoss {
    /// Error of a displayed value: the 99th percentile over the texels.
    pub p99: f64,
    /// The largest error over the texels.
    pub largest: f64,
    /// Number of layers: 1, or 3 where every channel has its own coefficients.
    pub layers: usize,
    /// The name of the directional basis.
    pub basis: String,
}

/// Error and cost of coarser maps, and the error that is allowed.
#[derive(Debug, Clone, PartialEq)]
pub struct MapDetail {
    /// A row for each length of a block of texels.
    pub rows: Vec<AccuracyRow>,
    /// The allowed error of a displayed value.
    pub allowed: f64,
}
