//! The contents of a report as plain rows. The JSON *is* these rows; Markdown and HTML print the same.

use crate::captures::CaptureRow;
use crate::held_out::HeldOutReport;
use crate::stats::MapSummary;
use crate::values::MapValues;
use mesophyll_base::solvers::TraceRow;
use mesophyll_fits::record::next::NextMeasurement;
use mesophyll_fits::record::{FitKind, FitPhase, ResidualStatistics, TruthError};
use mesophyll_scene::manifest::ViewKind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A level of quality. The levels are ordered, so that the worst reason decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum QualityLevel {
    /// Nothing speaks against it.
    Good,
    /// Usable, but something should be checked.
    Doubtful,
    /// It must not be used as it is.
    Bad,
}

impl QualityLevel {
    /// Its word in the report.
    pub fn word(self) -> &'static str {
        match self {
            QualityLevel::Good => "Good",
            QualityLevel::Doubtful => "Usable with care",
            QualityLevel::Bad => "Not good",
        }
    }
}

/// One reason behind a verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VerdictReason {
    /// What it says of the fit.
    pub level: QualityLevel,
    /// The reason as a sentence.
    pub text: String,
}

/// "Is this good?"
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReportVerdict {
    /// The level of the worst reason.
    pub level: QualityLevel,
    /// The verdict as a sentence, with the reasons that decide it.
    pub sentence: String,
    /// Whether the fit missed its mark by what was measured. A truth that a synthetic capture holds is left out: it
    /// says how good the method is, which no measured capture can.
    pub missed: bool,
    /// Every reason, the worst first.
    pub reasons: Vec<VerdictReason>,
}

/// A whole report.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Version of this layout.
    pub schema: u32,
    /// Name and version of the program that wrote the report.
    pub program: String,
    /// Heading.
    pub title: String,
    /// The overall verdict: the worst of what the report contains.
    pub verdict: ReportVerdict,
    /// The fits, in the order in which they were named.
    pub fits: Vec<FitReport>,
    /// Every further fit compared with the first, where fits are compared.
    pub comparisons: Vec<FitComparison>,
    /// What scenes need, and what they leave out.
    pub plans: Vec<PlanReport>,
    /// The results of checks of scenes.
    pub checks: Vec<CheckReport>,
}

/// One fit folder.
#[derive(Debug, Clone, Serialize)]
pub struct FitReport {
    pub name: String,
    pub kind: FitKind,
    pub folder: String,
    pub program: String,
    pub input_hash: String,
    pub termination: Option<String>,
    pub verdict: ReportVerdict,
    /// The measurement that would help most, where a number is not determined.
    pub next_measurement: Option<NextMeasurement>,
    pub options: BTreeMap<String, String>,
    pub parameters: Vec<ParameterRow>,
    pub sections: Vec<SectionReport>,
    pub maps: Vec<MapRow>,
    /// Measurements that the fit did not see.
    pub held_out: HeldOutReport,
    pub times: Option<TimesReport>,
    /// Of a scene that was found in pictures, its steps: processor time (s), and the root mean square of all numbers'
    /// distance from the result and of their standard errors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<[f64; 3]>,
    /// What the folder lacks, in words.
    pub missing: Vec<String>,
    #[serde(skip)]
    pub pictures: Vec<SidePictures>,
}

/// A parameter; each channel has its own row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterRow {
    pub section: String,
    pub name: String,
    /// `R`, `G`, `B`, or empty.
    pub channel: String,
    pub value: Option<f64>,
    /// The whole standard error; absent where it is infinite or not stated.
    pub stderr: Option<f64>,
    /// The part of the standard error that comes from the caliper, which is the same share for all of the leaf; absent
    /// where there is none.
    pub stderr_caliper: Option<f64>,
    pub unit: String,
    /// Why the data do not determine the parameter.
    pub undetermined: Option<String>,
}

/// The statistics of `front`, `back` or `all`.
#[derive(Debug, Clone, Serialize)]
pub struct SectionReport {
    pub name: String,
    pub counts: BTreeMap<String, usize>,
    pub terminations: BTreeMap<String, usize>,
    pub residuals: BTreeMap<String, ResidualStatistics>,
    pub truth: BTreeMap<String, TruthError>,
    pub figures: BTreeMap<String, f64>,
    pub correlation_names: Vec<String>,
    pub correlation: Vec<Vec<f64>>,
    pub condition: Option<f64>,
    pub rank: Option<usize>,
}

/// A map's channel in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapRow {
    pub section: String,
    pub quantity: String,
    pub channel: String,
    pub unit: String,
    /// Statistics over the good texels.
    pub summary: MapSummary,
    /// Good texels without a value, or with one whose standard error is infinite.
    pub undetermined: usize,
    pub stderr_median: Option<f64>,
    pub truth: Option<MapTruth>,
}

/// A map compared with the truth, over the good texels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MapTruth {
    pub median_absolute: f64,
    pub p99_absolute: f64,
    /// Absent where a ratio means nothing (normals).
    pub median_relative: Option<f64>,
    pub bias: f64,
    /// Share of truths within 1.96 standard errors.
    pub coverage95: Option<f64>,
}

/// `times.toml`.
#[derive(Debug, Clone, Serialize)]
pub struct TimesReport {
    pub phases: Vec<FitPhase>,
    pub total_s: f64,
    pub threads: usize,
    pub peak_memory_mib: Option<f64>,
    pub traces: BTreeMap<String, Vec<TraceRow>>,
}

/// Two fits side by side: the second against the first.
#[derive(Debug, Clone, Serialize)]
pub struct FitComparison {
    pub first: String,
    pub second: String,
    pub sentence: String,
    pub parameters: Vec<ParameterDifference>,
    pub maps: Vec<MapDifference>,
    /// What only one of the fits has, and what cannot be compared.
    pub notes: Vec<String>,
    #[serde(skip)]
    pub pictures: Vec<MapPictures>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterDifference {
    pub section: String,
    pub name: String,
    pub channel: String,
    pub unit: String,
    /// Absent where undetermined.
    pub first: Option<f64>,
    pub first_stderr: Option<f64>,
    pub second: Option<f64>,
    pub second_stderr: Option<f64>,
    /// For undetermined values, the best estimates and their bounds in words; empty where determined.
    pub estimates: [String; 2],
    pub difference: Option<f64>,
    /// Difference divided by the combined standard error.
    pub sigmas: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapDifference {
    pub section: String,
    pub quantity: String,
    pub channel: String,
    pub unit: String,
    pub texels: usize,
    pub median_difference: f64,
    pub median_absolute: f64,
    pub p99_absolute: f64,
    /// Share of texels that differ by more than 1.96 combined standard errors.
    pub beyond95: Option<f64>,
}

/// `plan.json`, as far as the report shows it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlanReport {
    pub folder: String,
    pub needed: Vec<PlanRow>,
    pub left_out: Vec<PlanRow>,
}

/// What a scene needs or can do without.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlanRow {
    pub name: String,
    pub reason: String,
    pub saved: String,
}

/// `check.json`.
#[derive(Debug, Clone, Serialize)]
pub struct CheckReport {
    pub folder: String,
    pub passed: Option<bool>,
    pub adapter: String,
    pub views: Vec<ViewReport>,
    /// Leaves compared with their scans, and what was skipped.
    pub captures: Vec<CaptureRow>,
    pub skipped: Vec<String>,
    pub missing: Vec<String>,
}

#[derive(Debug, Clone, Serialize)]
pub struct ViewReport {
    pub name: String,
    /// What it shows; a card is compared with a closed form.
    pub kind: ViewKind,
    pub passed: Option<bool>,
    /// What missed its threshold, one sentence each.
    pub why: Vec<String>,
    /// Every number of the view, by the name `check.json` gives it.
    pub figures: BTreeMap<String, f64>,
    #[serde(skip)]
    pub image: Option<ReportPicture>,
    #[serde(skip)]
    pub reference: Option<ReportPicture>,
    #[serde(skip)]
    pub difference: Option<ReportPicture>,
    #[serde(skip)]
    pub flip: Option<ReportPicture>,
    /// The reference's picture of the true leaf, where the scan is synthetic.
    #[serde(skip)]
    pub true_leaf: Option<ReportPicture>,
}

/// A picture inside the page.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReportPicture {
    pub uri: String,
    pub width: usize,
    pub height: usize,
    pub alt: String,
    /// The map or the larger picture that it shows.
    pub texels: PictureTexels,
    /// The map's values, where it is one in false colour.
    pub values: Option<MapValues>,
}

/// Columns and rows of a map, and how many of them are one pixel of its picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PictureTexels {
    pub columns: usize,
    pub rows: usize,
    pub step: usize,
    pub scale: Option<ScaleBar>,
}

/// A bar of a round length that is drawn over a picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScaleBar {
    pub mm: f64,
    /// Its share of the picture's width.
    pub share: f64,
}

impl ScaleBar {
    /// The longest bar of 1, 2 or 5 times a power of ten (mm) that takes at most two fifths of a picture `wide` mm
    /// wide.
    pub fn of(wide: f64) -> Option<ScaleBar> {
        let most = Some(0.4 * wide).filter(|m| *m > 0.0 && m.is_finite())?;
        let ten = 10_f64.powf(most.log10().floor());
        let mm = [5.0, 2.0, 1.0].map(|m| m * ten).into_iter().find(|mm| *mm <= most)?;
        Some(ScaleBar { mm, share: mm / wide })
    }
}

/// The pictures of a side.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SidePictures {
    pub section: String,
    /// ρd and ρt as they would look.
    pub looks: Vec<CaptionedPicture>,
    pub fate: Option<CaptionedPicture>,
    pub legend: Vec<LegendItem>,
    pub residual: Option<CaptionedPicture>,
    pub residual_histogram: Option<String>,
    pub maps: Vec<MapPictures>,
}

/// A picture (or chart) and its caption; `bar` is SVG.
#[derive(Debug, Clone, Serialize)]
pub struct CaptionedPicture {
    pub picture: ReportPicture,
    pub caption: String,
    pub bar: String,
}

#[derive(Debug, Clone, Serialize)]
pub struct LegendItem {
    pub colour: String,
    pub name: String,
    pub texels: usize,
}

/// One quantity: its channels in order, the most informative one first.
#[derive(Debug, Clone, Serialize)]
pub struct MapPictures {
    pub quantity: String,
    pub title: String,
    /// Remarks on the maps; may be empty.
    pub note: String,
    pub section: String,
    pub channels: Vec<ChannelPictures>,
}

#[derive(Debug, Clone, Serialize)]
pub struct ChannelPictures {
    pub channel: String,
    pub pictures: Vec<CaptionedPicture>,
    /// SVG, with captions.
    pub charts: Vec<ChartTile>,
}

#[derive(Debug, Clone, Serialize)]
pub struct ChartTile {
    pub svg: String,
    pub caption: String,
}

#[cfg(test)]
mod tests {
    use super::ScaleBar;

    #[test]
    fn a_scale_is_a_round_length_within_the_picture() {
        for (wide, mm) in [(60.0, 20.0), (12.6, 5.0), (100.0, 20.0), (0.3, 0.1), (2500.0, 1000.0)] {
            let scale = ScaleBar::of(wide).unwrap();
            assert!(
                (scale.mm / mm - 1.0).abs() < 1e-12 && (scale.share * wide / mm - 1.0).abs() < 1e-12,
                "{wide}: {scale:?}"
            );
        }
        assert_eq!(ScaleBar::of(0.0), None);
        assert_eq!(ScaleBar::of(f64::NAN), None);
    }
}
