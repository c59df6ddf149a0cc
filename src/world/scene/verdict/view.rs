//! The figures of one view.

use super::exceeds;
use crate::manifest::{CardView, PerspectiveView, TranslucencyReference, ViewKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What is looked at in a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewScope {
    /// The picture against the reference, the golden, and the time of a frame.
    #[default]
    Whole,
    /// Only the small picture against its golden.
    Golden,
    /// Only the time of a frame.
    Time,
}

/// One view's figures; what was not measured is absent.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewFigures {
    /// The name of the view in the scene.
    pub name: String,
    /// What it shows; a card is judged by its closed form.
    pub kind: ViewKind,
    /// What was looked at.
    pub scope: ViewScope,
    /// The picture compared with the reference.
    #[serde(flatten)]
    pub error: Option<ReferenceError>,
    /// The error of the translucency maps' directional basis.
    #[serde(flatten)]
    pub basis: Option<BasisError>,
    /// The small picture compared with the scene's golden picture, where there is one.
    #[serde(flatten)]
    pub golden: Option<GoldenFigures>,
    /// The renderer's picture compared with the reference's picture of the true leaves.
    #[serde(flatten)]
    pub true_leaf: Option<TrueLeafError>,
    /// The time of a frame.
    #[serde(flatten)]
    pub cost: Option<FrameCost>,
    /// The view is judged by the means of blocks with this many pixels a side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blocks: Option<u32>,
    /// The largest 99th percentile of FLIP that the scene allows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold_flip_p99: Option<f64>,
    /// The largest error that the scene allows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold_max_error: Option<f64>,
    /// The largest median time of a frame that the scene allows, ms; judged on real GPUs only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold_frame_ms: Option<f64>,
    /// The files beside `check.json`.
    #[serde(flatten)]
    pub pictures: Option<ViewPictures>,
    /// The error that the lightest colour of the FLIP map stands for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip_top: Option<f64>,
    /// The difference that white (and, negated, black) stands for in the picture of the difference; displayed values
    /// are 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub difference_top: Option<f64>,
    /// Whether there is no reason in `why` against it; `None` where nothing was judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passed: Option<bool>,
    /// The limits that were missed, in one sentence each.
    pub why: Vec<String>,
}

impl From<&PerspectiveView> for ViewFigures {
    fn from(view: &PerspectiveView) -> ViewFigures {
        ViewFigures {
            name: view.name.clone(),
            threshold_flip_p99: view.flip_p99,
            threshold_max_error: view.max_error,
            threshold_frame_ms: view.frame_ms,
            ..ViewFigures::default()
        }
    }
}

impl From<&CardView> for ViewFigures {
    fn from(view: &CardView) -> ViewFigures {
        ViewFigures {
            name: view.name.clone(),
            kind: ViewKind::Card,
            threshold_max_error: view.max_error,
            threshold_frame_ms: view.frame_ms,
            ..ViewFigures::default()
        }
    }
}

/// A picture compared with the reference; errors are those of displayed values, 0 to 1.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ReferenceError {
    /// Mean of FLIP (Andersson et al. 2020) over the picture, 0 to 1.
    pub flip_mean: f64,
    /// 99th percentile of FLIP.
    pub flip_p99: f64,
    /// Largest error; for a card, the largest relative error compared with the closed form. `None` where the picture
    /// has no pixel inside a leaf.
    pub max_error: Option<f64>,
    /// Column and row of the largest error.
    pub max_at: Option<(usize, usize)>,
    /// Share of the leaf's pixels that the largest error looks at.
    #[serde(default)]
    pub interior_share: f64,
    /// The reference's own noise, the 99th percentile of FLIP between two seeds.
    #[serde(default)]
    pub noise_flip_p99: Option<f64>,
    /// The reference's noise in the largest error; for a card, its own error compared with the closed form.
    #[serde(default)]
    pub noise_max_error: Option<f64>,
    /// Whether the reference's translucency is convolved, or as the maps store it.
    #[serde(default)]
    pub judged_by: TranslucencyReference,
    /// Time of the reference, s.
    #[serde(default)]
    pub reference_s: f64,
}

/// The error of the translucency maps' directional basis: the reference with the stored coefficients compared with the
/// reference with the convolution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BasisError {
    /// 99th percentile of FLIP.
    #[serde(rename = "basis_flip_p99")]
    pub flip_p99: f64,
    /// Largest error.
    #[serde(rename = "basis_max_error")]
    pub max_error: f64,
}

/// How far a picture is from its golden.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GoldenFigures {
    /// Mean FLIP error over all pixels, 0 to 1.
    #[serde(rename = "golden_flip_mean")]
    pub flip_mean: f64,
    /// Share of changed pixels.
    #[serde(rename = "golden_changed")]
    pub changed: f64,
}

impl GoldenFigures {
    /// Largest mean FLIP error of two adapters' pictures of one scene.
    pub const FLIP_MEAN: f64 = 1e-3;
    /// Largest share of changed pixels: the edge of a leaf may fall on either side of a pixel's centre. At 800 × 600
    /// pixels that happened to 2.4e-4 of them; in a golden, edges take a four times larger share of the pixels.
    pub const CHANGED: f64 = 2e-3;

    /// What is too large, in words; `None` where both figures are within their limits. A NaN is too large.
    pub fn missed(&self) -> Option<String> {
        let mut out = Vec::new();
        if exceeds(self.flip_mean, Self::FLIP_MEAN) {
            out.push(format!("mean FLIP is {:.1e}, at most {:.0e} allowed", self.flip_mean, Self::FLIP_MEAN));
        }
        if exceeds(self.changed, Self::CHANGED) {
            out.push(format!(
                "{:.2} % of the pixels changed, at most {:.2} % allowed,",
                100.0 * self.changed,
                100.0 * Self::CHANGED
            ));
        }
        (!out.is_empty()).then(|| out.join("; "))
    }
}

/// The error that the fit causes, where the true leaves are known: the picture from the fit compared with the
/// reference's picture of the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrueLeafError {
    /// Mean of FLIP.
    #[serde(rename = "true_leaf_flip_mean")]
    pub flip_mean: f64,
    /// 99th percentile of FLIP.
    #[serde(rename = "true_leaf_flip_p99")]
    pub flip_p99: f64,
    /// Largest error; `None` where no pixel lies inside a leaf.
    #[serde(rename = "true_leaf_max_error")]
    pub max_error: Option<f64>,
    /// File of the reference's picture.
    #[serde(rename = "true_leaf")]
    pub picture: String,
}

/// What a frame costs.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FrameCost {
    /// Median time of a frame, ms.
    pub frame_ms_median: f64,
    /// 95th percentile of the time of a frame, ms.
    pub frame_ms_p95: f64,
    /// Triangles drawn in a frame; every instance counts.
    #[serde(default)]
    pub triangles: u64,
    /// Median of each pass by the adapter's own clock, ms.
    #[serde(default)]
    pub pass_ms: BTreeMap<String, f64>,
    /// Those of the passes that were drawn once and kept in these frames, so that no frame holds their time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub kept_passes: Vec<String>,
}

impl FrameCost {
    /// The passes in words, those of every frame first and the largest of them first; none without the adapter's clock.
    fn passes(&self) -> Option<String> {
        let words = |kept: bool| {
            let of = self.pass_ms.iter().filter(|(name, _)| self.kept_passes.contains(name) == kept);
            let mut list: Vec<(&String, &f64)> = of.collect();
            list.sort_by(|a, b| b.1.total_cmp(a.1));
            let each = list.iter().take(3).map(|(name, ms)| format!("{name} {ms:.2} ms"));
            each.collect::<Vec<String>>().join(", ")
        };
        let (drawn, kept) = (words(false), words(true));
        match (drawn.is_empty(), kept.is_empty()) {
            (true, true) => None,
            (_, true) => Some(format!("of each frame: {drawn}")),
            (true, _) => Some(format!("drawn once before the frames: {kept}")),
            _ => Some(format!("of each frame: {drawn}; drawn once before the frames: {kept}")),
        }
    }
}

/// The pictures of a view: files beside `check.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ViewPictures {
    /// The renderer's picture.
    pub image: String,
    /// The reference's.
    pub reference: String,
    /// The enlarged difference of both.
    pub difference: String,
    /// The FLIP map.
    pub flip: String,
}

impl ViewFigures {
    /// Whether it is a card, which is judged by its closed form.
    pub fn is_card(&self) -> bool {
        self.kind == ViewKind::Card
    }

    /// One line in words.
    pub fn line(&self) -> String {
        let verdict = match self.passed {
            Some(true) => "passed",
            Some(false) => "MISSED",
            None => "measured",
        };
        let or_dash = |v: Option<f64>| v.map_or("-".to_string(), |e| format!("{e:.4}"));
        let mut said = Vec::new();
        if let Some(e) = self.error.as_ref().filter(|_| self.is_card()) {
            said.push(format!(
                "{:.2e} from the closed form (allowed {:.1e}; the reference {:.1e})",
                e.max_error.unwrap_or(f64::NAN),
                self.threshold_max_error.unwrap_or(f64::NAN),
                e.noise_max_error.unwrap_or(f64::NAN)
            ));
        } else if let Some(e) = &self.error {
            said.push(format!(
                "FLIP 99 % {:.4} (allowed {:.4}, noise {})",
                e.flip_p99,
                self.threshold_flip_p99.unwrap_or(f64::NAN),
                or_dash(e.noise_flip_p99)
            ));
            said.push(match e.max_error {
                Some(error) => format!(
                    "largest error {error:.4} (allowed {:.4}, noise {})",
                    self.threshold_max_error.unwrap_or(0.0),
                    or_dash(e.noise_max_error)
                ),
                None => "largest error not judged (no pixel lies within a surface)".into(),
            });
        }
        if let Some(cost) = &self.cost {
            said.push(format!(
                "{:.1} ms a frame (95 %: {:.1}), {} triangles",
                cost.frame_ms_median, cost.frame_ms_p95, cost.triangles
            ));
            said.extend(cost.passes());
        }
        let golden = self.golden.map(|g| {
            format!(
                "mean FLIP {:.1e} and {:.2} % of the pixels from the golden (allowed {:.0e} and {:.1} %)",
                g.flip_mean,
                100.0 * g.changed,
                GoldenFigures::FLIP_MEAN,
                100.0 * GoldenFigures::CHANGED
            )
        });
        if self.scope == ViewScope::Golden {
            said.push(golden.clone().unwrap_or_else(|| "drawn small".into()));
        }
        let mut line = format!("{verdict}  {}: {}", self.name, said.join(", "));
        if let Some(basis) = &self.basis {
            let by_maps = self.error.as_ref().is_some_and(|e| e.judged_by == TranslucencyReference::Maps);
            let what = if by_maps {
                "judged by the stored maps; beside that, their basis costs"
            } else {
                "of which the basis of the translucency maps"
            };
            line += &format!("\n        {what}: FLIP 99 % {:.4}, largest error {:.4}", basis.flip_p99, basis.max_error);
        }
        if let Some(t) = &self.true_leaf {
            line += &format!(
                "\n        from the true leaf: FLIP mean {:.4}, 99 % {:.4}, largest error {}",
                t.flip_mean,
                t.flip_p99,
                or_dash(t.max_error)
            );
        }
        if let Some(golden) = golden.filter(|_| self.scope == ViewScope::Whole) {
            line += &format!("\n        {golden}");
        }
        for why in &self.why {
            line += &format!("\n        {why}");
        }
        line
    }
}
