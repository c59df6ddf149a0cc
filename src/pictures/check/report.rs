//! The verdict of a check: a view's figures, what the translucency maps cost, and all of it as JSON and in words.

use crate::CaptureFigures;
use crate::FilmSmoothness;
use crate::day::CheckHour;
use crate::golden;
use mesophyll_scene::manifest::SceneManifest;
use serde_json::{Value, json};

/// The verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckVerdict {
    /// Whether every view, capture and file is as the scene asks.
    pub passed: bool,
    /// What drew: name, interface and driver.
    pub adapter: String,
    /// Whether the CPU drew: then frame times are printed, not judged.
    pub software: bool,
    /// The views, in the order of the scene.
    pub views: Vec<ViewFigures>,
    /// Leaves as their scans saw them, compared with held-out frames.
    pub captures: Vec<CaptureFigures>,
    /// Capture views that could not be drawn, in one sentence each; they are not judged.
    pub skipped: Vec<String>,
    /// What else went wrong, one sentence each: files that are not as they were fitted.
    pub failures: Vec<String>,
    /// Warnings about the scene that do not fail the check: see [`mesophyll_scene::plan::ScenePlan::warnings`].
    pub warnings: Vec<String>,
    /// What was uploaded for the perspective views (name, bytes).
    pub uploads: Vec<(String, u64)>,
    /// Names of the pipelines that were made.
    pub pipelines: Vec<String>,
    /// What translucency maps cost a fragment, where there are any.
    pub translucency: Option<TranslucencyCost>,
    /// Whether a film is smooth, where the scene asks for one.
    pub film: Option<FilmSmoothness>,
    /// The hours of the scene's day, drawn into `day.png`.
    pub day: Vec<CheckHour>,
    /// Time from the start of the program to the end of the first frame (s), where only frames are timed.
    pub first_frame_s: Option<f64>,
}

/// The cost of the translucency maps' term compared with the whole shader, in one run on one adapter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TranslucencyCost {
    /// Median time (ms) of the main pass of the first perspective view (of a frame where the adapter has no clock),
    /// with the term, and with the cosine of the mesh's normal instead of it. `None` where a frame takes seconds.
    pub ms: Option<[f64; 2]>,
    /// Operations of the most expensive leaf's shader, with the term and without. Both arms of every branch count, and
    /// loops count once.
    pub operations: [usize; 2],
}

/// What is looked at in a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ViewScope {
    /// The picture against the reference, the golden, and the time of a frame.
    #[default]
    Whole,
    /// Only the small picture against its golden.
    Golden,
    /// Only the time of a frame.
    Time,
}

/// One view's figures; `None` where there was nothing to measure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ViewFigures {
    /// The name of the view in the scene.
    pub name: String,
    /// Whether it is a card, which is judged by its closed form.
    pub card: bool,
    /// Mean of FLIP (Andersson et al. 2020) over the picture, 0 to 1.
    pub flip_mean: f64,
    /// 99th percentile of FLIP.
    pub flip_p99: f64,
    /// Largest error; for a card, the largest relative error compared with the closed form.
    pub max_error: Option<f64>,
    /// Column and row of the largest error.
    pub max_at: Option<(usize, usize)>,
    /// Share of the leaf's pixels that the largest error looks at.
    pub interior_share: f64,
    /// The reference's own noise, the 99th percentile of FLIP between two seeds; for a card, its error compared with
    /// the closed form.
    pub noise_flip_p99: Option<f64>,
    /// The error of the translucency maps' directional basis: the reference with the stored coefficients compared with
    /// the reference with the convolution.
    pub basis: Option<(f64, f64)>,
    /// The view is judged by the means of blocks with this many pixels a side.
    pub blocks: Option<u32>,
    /// Whether the view is judged by the reference with the stored coefficients.
    pub by_maps: bool,
    /// The reference's noise in the largest error.
    pub noise_max_error: Option<f64>,
    /// The largest 99th percentile of FLIP that the scene allows.
    pub threshold_flip_p99: Option<f64>,
    /// The largest error that the scene allows.
    pub threshold_max_error: f64,
    /// How far the small picture is from the scene's golden picture, where there is one.
    pub golden: Option<golden::GoldenFigures>,
    /// What was looked at.
    pub scope: ViewScope,
    /// The renderer's picture compared with the reference's picture of the true leaves.
    pub true_leaf: Option<TrueLeafError>,
    /// Median time of a frame, ms.
    pub frame_ms_median: f64,
    /// 95th percentile of the time of a frame, ms.
    pub frame_ms_p95: f64,
    /// Triangles drawn in a frame; every instance counts.
    pub triangles: u64,
    /// The largest median time of a frame that the scene allows, ms; judged on real GPUs only.
    pub threshold_frame_ms: Option<f64>,
    /// Median of each pass by the adapter's own clock.
    pub passes: Vec<(String, f64)>,
    /// Time of the reference, s.
    pub reference_s: f64,
    /// Files of the picture, the reference, the difference and the FLIP map.
    pub pictures: Option<[String; 4]>,
    /// The error that the lightest colour of the FLIP map stands for.
    pub flip_top: Option<f64>,
    /// The difference that white (and, negated, black) stands for in the picture of the difference; displayed values
    /// are 0 to 1.
    pub difference_top: Option<f64>,
    /// Whether there is no reason in `why` against it.
    pub passed: bool,
    /// The limits that were missed, in one sentence each.
    pub why: Vec<String>,
}

/// The error that the fit causes, where the true leaves are known: the picture from the fit compared with the
/// reference's picture of the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueLeafError {
    pub flip_mean: f64,
    pub flip_p99: f64,
    pub max_error: Option<f64>,
    pub picture: String,
}

/// Whether the value is above the limit, or NaN.
pub fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

impl ViewFigures {
    fn json(&self) -> Value {
        let pictures = self.pictures.clone().unwrap_or_default();
        json!({
            "name": self.name,
            "kind": if self.card { "card" } else { "perspective" },
            "flip_mean": self.flip_mean,
            "flip_p99": self.flip_p99,
            "max_error": self.max_error,
            "max_at": self.max_at.map(|(x, y)| [x, y]),
            "blocks": self.blocks,
            "interior_share": self.interior_share,
            "noise_flip_p99": self.noise_flip_p99,
            "noise_max_error": self.noise_max_error,
            "basis_flip_p99": self.basis.map(|b| b.0),
            "basis_max_error": self.basis.map(|b| b.1),
            "judged_by": if self.by_maps { "maps" } else { "convolution" },
            "threshold_flip_p99": self.threshold_flip_p99,
            "threshold_max_error": self.threshold_max_error,
            "golden_flip_mean": self.golden.map(|g| g.flip_mean),
            "golden_changed": self.golden.map(|g| g.changed),
            "true_leaf_flip_mean": self.true_leaf.as_ref().map(|t| t.flip_mean),
            "true_leaf_flip_p99": self.true_leaf.as_ref().map(|t| t.flip_p99),
            "true_leaf_max_error": self.true_leaf.as_ref().and_then(|t| t.max_error),
            "true_leaf": self.true_leaf.as_ref().map(|t| &t.picture),
            "frame_ms_median": self.frame_ms_median,
            "frame_ms_p95": self.frame_ms_p95,
            "triangles": self.triangles,
            "threshold_frame_ms": self.threshold_frame_ms,
            "pass_ms": self.passes.iter().map(|(n, t)| (n.clone(), json!(t))).collect::<serde_json::Map<_, _>>(),
            "reference_s": self.reference_s,
            "image": pictures[0],
            "reference": pictures[1],
            "difference": pictures[2],
            "flip": pictures[3],
            "flip_top": self.flip_top,
            "difference_top": self.difference_top,
            "passed": self.passed,
            "why": self.why,
        })
    }

    /// One line in words.
    pub fn line(&self) -> String {
        let verdict = if self.passed { "passed" } else { "MISSED" };
        let error = self.max_error.map_or("-".to_string(), |e| format!("{e:.4}"));
        let noise = |v: Option<f64>| v.map_or("-".to_string(), |e| format!("{e:.4}"));
        let times = format!(
            "{:.1} ms a frame (95 %: {:.1}), {} triangles",
            self.frame_ms_median, self.frame_ms_p95, self.triangles
        );
        let golden = self.golden.map(|g| {
            let allowed = format!("allowed {:.0e} and {:.1} %", golden::FLIP_MEAN, 100.0 * golden::CHANGED);
            format!(
                "mean FLIP {:.1e} and {:.2} % of the pixels from the golden ({allowed})",
                g.flip_mean,
                100.0 * g.changed
            )
        });
        let mut line = if self.scope == ViewScope::Time {
            format!("{verdict}  {}: {times}", self.name)
        } else if self.scope == ViewScope::Golden {
            format!("{verdict}  {}: {}", self.name, golden.clone().unwrap_or_else(|| "drawn small".into()))
        } else if self.card {
            format!(
                "{verdict}  {}: {:.2e} from the closed form (allowed {:.1e}; the reference {:.1e}), {times}",
                self.name,
                self.max_error.unwrap_or(f64::NAN),
                self.threshold_max_error,
                self.noise_max_error.unwrap_or(f64::NAN)
            )
        } else {
            format!(
                "{verdict}  {}: FLIP 99 % {:.4} (allowed {:.4}, noise {}), largest error {error} (allowed {:.4}, noise \
                 {}), {times}",
                self.name,
                self.flip_p99,
                self.threshold_flip_p99.unwrap_or(f64::NAN),
                noise(self.noise_flip_p99),
                self.threshold_max_error,
                noise(self.noise_max_error)
            )
        };
        if let Some((flip, error)) = self.basis {
            let what = if self.by_maps {
                "judged by the stored maps; beside that, their basis costs"
            } else {
                "of which the basis of the translucency maps"
            };
            line += &format!("\n        {what}: FLIP 99 % {flip:.4}, largest error {error:.4}");
        }
        if let Some(t) = &self.true_leaf {
            let error = t.max_error.map_or("-".to_string(), |e| format!("{e:.4}"));
            line += &format!(
                "\n        from the true leaf: FLIP mean {:.4}, 99 % {:.4}, largest error {error}",
                t.flip_mean, t.flip_p99
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

impl CheckVerdict {
    /// The JSON of the contract, with further fields.
    pub fn json(&self, manifest: &SceneManifest) -> Value {
        let mut out = json!({
            "scene": manifest.name,
            "passed": self.passed,
            "adapter": self.adapter,
            "software": self.software,
            "size": [manifest.check.width, manifest.check.height],
            "reference_samples": manifest.check.samples,
            "failures": self.failures,
            "warnings": self.warnings,
            "views": self.views.iter().map(ViewFigures::json).collect::<Vec<_>>(),
            "captures": self.captures,
            "skipped": self.skipped,
            "uploads": self.uploads.iter().map(|(n, b)| json!({"name": n, "bytes": b})).collect::<Vec<_>>(),
            "uploaded_bytes": self.uploads.iter().map(|(_, b)| b).sum::<u64>(),
            "pipelines": self.pipelines,
        });
        if let Some(seconds) = self.first_frame_s {
            out["first_frame_s"] = json!(seconds);
        }
        if let Some(term) = &self.translucency {
            out["translucency"] = json!({
                "main_ms": term.ms.map(|t| t[0]), "main_ms_without": term.ms.map(|t| t[1]),
                "operations": term.operations[0], "operations_without": term.operations[1],
            });
        }
        if let Some(film) = &self.film {
            out["film"] = serde_json::to_value(film).unwrap_or_default();
        }
        if !self.day.is_empty() {
            out["day"] = serde_json::to_value(&self.day).unwrap_or_default();
        }
        out
    }

    /// The report in words.
    pub fn text(&self) -> String {
        let mut out = format!(
            "adapter: {}{}\n",
            self.adapter,
            if self.software { ", software: frame times are not judged" } else { "" }
        );
        for warning in &self.warnings {
            out += &format!("warning: {warning}\n");
        }
        for failure in &self.failures {
            out += &format!("MISSED  {failure}\n");
        }
        for view in &self.views {
            out += &format!("{}\n", view.line());
        }
        for line in self.captures.iter().map(CaptureFigures::line).chain(self.skipped.iter().cloned()) {
            out += &format!("{line}\n");
        }
        if let Some(term) = &self.translucency {
            let [with, without] = term.operations;
            out += &format!("translucency maps: {with} operations a fragment, {without} without");
            if let Some([with, without]) = term.ms {
                out += &format!(
                    "; {:.2} times the main pass without ({with:.2} and {without:.2} ms)",
                    with / without.max(1e-9)
                );
            }
            out += "\n";
        }
        if let Some(film) = &self.film {
            out += &format!("{}\n", film.line());
        }
        if let Some(seconds) = self.first_frame_s {
            let bytes: u64 = self.uploads.iter().map(|(_, b)| b).sum();
            out += &format!("the first frame after {seconds:.2} s; {:.1} MB on the adapter\n", bytes as f64 / 1e6);
        }
        if !self.day.is_empty() {
            let worst = self.day.iter().map(|h| h.fit_error).fold(0.0, f64::max);
            let sky = match worst {
                0.0 => "the sky was integrated at each".to_string(),
                worst => format!("the fitted sky is within {worst:.1e} of an integrated one"),
            };
            out += &format!("day.png: {} hours; {sky}\n", self.day.len());
        }
        out
    }
}
