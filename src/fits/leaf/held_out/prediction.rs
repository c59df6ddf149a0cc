//! What frames show of a fitted texel, according to the tube model.

use super::ScanRecord;
use mesophyll_base::processor::InstructionSet;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::tube::evaluator::{COLUMNS, PassEvaluator, TubeGeometry};
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};

/// A texel as it was fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexelParameters {
    /// Diffuse reflectance ρd, a channel each.
    pub rho_d: Rgb,
    /// Gloss reflectance ρs, a channel each.
    pub rho_s: Rgb,
    /// Slope of the gloss.
    pub m: f64,
    /// Unit normal in the frame of the scan.
    pub normal: [f64; 3],
}

/// Reads one texel of maps with the channels `rho_d.R` … `normal.Z`; `None` where a channel is missing or a reflectance
/// is no number.
pub fn texel_of(maps: &ChannelMaps) -> Option<impl Fn(usize) -> Option<TexelParameters> + Sync + '_> {
    let rho_d = maps.three(Quantity::RhoD)?;
    let rho_s = maps.three(Quantity::RhoS)?;
    let normal = maps.three(Quantity::Normal)?;
    let m = maps.scalar(Quantity::M)?;
    Some(move |k: usize| {
        let three = |p: &[&[f32]; 3]| p.map(|c| f64::from(c[k]));
        let (rho_d, rho_s, n) = (Rgb(three(&rho_d)), Rgb(three(&rho_s)), three(&normal));
        let length = n.iter().map(|v| v * v).sum::<f64>().sqrt();
        let whole = rho_d.iter().chain(&rho_s).all(|v| v.is_finite()) && length > 0.5 && length.is_finite();
        // A matte texel has no slope and no gloss lobe, so any slope will do.
        let slope = f64::from(m[k]);
        let m = if slope > 0.0 && slope.is_finite() { slope } else { 0.5 };
        whole.then(|| TexelParameters { rho_d, rho_s, m, normal: n.map(|v| v / length) })
    })
}

/// One pass of a device at some positions of its tube.
pub struct FramePredictor {
    pass: PassEvaluator,
}

/// Scratch for one texel's frames. Each thread needs its own.
#[derive(Debug, Default)]
pub struct PredictionScratch {
    lit: TubeGeometry,
    columns: [Vec<f64>; COLUMNS],
}

impl FramePredictor {
    /// The device of `scan` in pass `travel`, with its tube at these positions along the travel (mm).
    pub fn new(scan: &ScanRecord, travel: Travel, positions_mm: &[f64]) -> FramePredictor {
        let precision = TubePrecision::default();
        let model = TubeModel::new(scan.tube(), scan.camera(), scan.lobe(), &precision);
        FramePredictor {
            pass: PassEvaluator::new(&model, travel, positions_mm, precision.along, InstructionSet::detect()),
        }
    }

    /// How many positions there are.
    pub fn frames(&self) -> usize {
        self.pass.frames()
    }

    /// The columns D (diffuse light), S (gloss), ∂S/∂m, and ∂D and ∂S along the given changes of the normal. Each has
    /// one value a frame, for a texel at `at` (mm).
    pub fn columns<'a>(
        &self,
        scratch: &'a mut PredictionScratch,
        texel: &TexelParameters,
        at: [f64; 2],
        changes: &[[f64; 3]],
    ) -> &'a [Vec<f64>; COLUMNS] {
        self.pass.light(at, &mut scratch.lit);
        for column in &mut scratch.columns {
            column.resize(self.pass.padded(), 0.0);
        }
        let mut columns = scratch.columns.each_mut().map(Vec::as_mut_slice);
        self.pass.respond(&mut scratch.lit, texel.normal, changes, texel.m, &mut columns);
        &scratch.columns
    }

    /// Predicted value a frame and channel.
    pub fn values(&self, scratch: &mut PredictionScratch, texel: &TexelParameters, at: [f64; 2]) -> Vec<Rgb> {
        let columns = self.columns(scratch, texel, at, &[]);
        (0..self.frames()).map(|k| texel.rho_d * columns[0][k] + texel.rho_s * columns[1][k]).collect()
    }
}
