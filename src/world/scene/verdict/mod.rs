//! The verdict of a check, as `check.json` holds it: the check writes it, and the report reads it. What was not
//! measured is absent.

mod capture;
mod view;

pub use capture::{CaptureComparison, CaptureFigures};
pub use view::{
    BasisError, FrameCost, GoldenFigures, ReferenceError, TrueLeafError, ViewFigures, ViewPictures, ViewScope,
};

use crate::manifest::sun_words;
use serde::{Deserialize, Serialize};

/// Whether the value is above the limit, or NaN.
pub fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

/// The verdict.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CheckVerdict {
    /// Name of the scene.
    pub scene: String,
    /// Whether every view, capture and file is as the scene asks; `None` where nothing was judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passed: Option<bool>,
    /// What drew: name, interface and driver.
    pub adapter: String,
    /// Whether the CPU drew: then frame times are printed, not judged.
    pub software: bool,
    /// Pixels of a picture: width and height; `None` where only goldens are drawn, which have sizes of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Samples a pixel of the reference, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_samples: Option<u32>,
    /// What else went wrong, one sentence each: files that are not as they were fitted.
    pub failures: Vec<String>,
    /// Warnings about the scene that do not fail the check: see [`crate::plan::ScenePlan::warnings`].
    pub warnings: Vec<String>,
    /// The views, in the order of the scene.
    pub views: Vec<ViewFigures>,
    /// Leaves as their scans saw them, compared with held-out frames.
    pub captures: Vec<CaptureFigures>,
    /// Capture views that could not be drawn, in one sentence each; they are not judged.
    pub skipped: Vec<String>,
    /// What was uploaded for the perspective views.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub uploads: Vec<AdapterUpload>,
    /// Their sum.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uploaded_bytes: Option<u64>,
    /// Names of the pipelines that were made.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pipelines: Vec<String>,
    /// Time from the start of the program to the end of the first frame (s), where only frames are timed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_frame_s: Option<f64>,
    /// What translucency maps cost a fragment, where there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translucency: Option<TranslucencyCost>,
    /// Whether a film is smooth, where the scene asks for one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film: Option<FilmSmoothness>,
    /// The hours of the scene's day, drawn into `day.png`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub day: Vec<CheckHour>,
}

/// A buffer or a texture on the adapter.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct AdapterUpload {
    /// What it holds.
    pub name: String,
    /// Its size.
    pub bytes: u64,
}

/// The cost of the translucency maps' term compared with the whole shader, in one run on one adapter.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TranslucencyCost {
    /// Median time (ms) of the main pass of the first perspective view (of a frame where the adapter has no clock) with
    /// the term. `None` where a frame takes seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub main_ms: Option<f64>,
    /// The same with the cosine of the mesh's normal instead of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub main_ms_without: Option<f64>,
    /// Operations of the most expensive leaf's shader with the term. Both arms of every branch count, and loops count
    /// once.
    pub operations: usize,
    /// The same without.
    pub operations_without: usize,
}

/// The second differences in time of displayed means of blocks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FilmSmoothness {
    /// Number of frames.
    pub frames: u32,
    /// Frames a second.
    pub fps: f64,
    /// The largest second difference of the film as it is drawn.
    pub drawn: f64,
    /// The largest one of the film that is drawn in full.
    pub in_full: f64,
    /// The largest one of the difference of both films.
    pub apart: f64,
    /// What is allowed for the difference: four times the scene's tolerance.
    pub allowed: f64,
    /// Frame, and column and row of the block, in which the difference of both films has its largest one.
    pub at: [usize; 3],
}

impl FilmSmoothness {
    /// What is wrong, in one sentence; `None` where nothing pops.
    pub fn why(&self) -> Option<String> {
        let [frame, column, row] = self.at;
        exceeds(self.apart, self.allowed).then(|| {
            format!(
                "frame {frame}: something pops in the block at column {column} and row {row}: shortcuts change its \
                 second difference by {:.4}, at most {:.4} allowed",
                self.apart, self.allowed
            )
        })
    }

    /// The figures in one line.
    pub fn line(&self) -> String {
        format!(
            "film: {} frames, {} a second: second differences of blocks are {:.4} at most, {:.4} in full detail, {:.4} \
             between both (allowed {:.4})",
            self.frames, self.fps, self.drawn, self.in_full, self.apart, self.allowed
        )
    }
}

/// One hour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckHour {
    /// Solar time; 12 is noon.
    pub hour: f64,
    /// Angle of the sun from straight up.
    pub zenith_deg: f64,
    /// Azimuth of the sun, from +x towards +y.
    pub azimuth_deg: f64,
    /// Irradiance of the sun on a surface that faces it.
    pub sun: [f64; 3],
    /// Root of the sum of squared differences from integrated coefficients over c00, worst channel; 0 where they were
    /// integrated and not fitted.
    pub fit_error: f64,
}

impl CheckVerdict {
    /// Judges the whole by its parts.
    pub fn judge(&mut self) {
        let views = self.views.iter().map(|v| v.passed);
        let all: Vec<bool> = views.flatten().chain(self.captures.iter().map(|c| c.passed)).collect();
        let judged = !(all.is_empty() && self.failures.is_empty());
        self.passed = judged.then(|| self.failures.is_empty() && all.iter().all(|passed| *passed));
    }

    /// The verdict in words.
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
            out += &format!(
                "translucency maps: {} operations a fragment, {} without",
                term.operations, term.operations_without
            );
            if let (Some(with), Some(without)) = (term.main_ms, term.main_ms_without) {
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
            let megabytes = self.uploaded_bytes.unwrap_or_default() as f64 / 1e6;
            out += &format!("the first frame after {seconds:.2} s; {megabytes:.1} MB on the adapter\n");
        }
        if !self.day.is_empty() {
            let worst = self.day.iter().map(|h| h.fit_error).fold(0.0, f64::max);
            let sky = match worst {
                0.0 => "the sky was integrated at each".to_string(),
                worst => format!("the fitted sky is within {worst:.1e} of an integrated one"),
            };
            out += &format!("day.png: {} hours; {sky}\n", self.day.len());
            for h in &self.day {
                out += &format!("  {}\n", sun_words(h.hour, h.zenith_deg, h.azimuth_deg));
            }
        }
        out
    }
}
