//! A leaf as its scan saw it, drawn from the fit and compared with a frame that the fit did not use.

use serde::{Deserialize, Serialize};

/// One frame, drawn twice and compared.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CaptureFigures {
    /// Name of the view.
    pub name: String,
    /// Name of the leaf in the scene.
    pub leaf: String,
    /// `front` or `back`.
    pub side: String,
    /// Along which axis the tube travelled: `x` or `y`.
    pub pass: String,
    /// Number of the frame in its pass.
    pub frame: usize,
    /// Readings compared: texels times channels.
    pub readings: usize,
    /// Mean square that a right fit leaves, in the units of the rule.
    pub expected: f64,
    /// The error of pictures that is allowed.
    pub allowed: f64,
    /// The real-time renderer's picture.
    pub renderer: CaptureComparison,
    /// The reference renderer's picture.
    pub reference: CaptureComparison,
    /// The renderer's picture with the V-cavity factor that bounds gloss in scenes, and that the fit's lobe does not
    /// have. It is printed, not judged.
    pub bounded: CaptureComparison,
    /// Errors of the tube model's prediction and of the light box, each in units of its own noise.
    pub model_off: f64,
    /// Error of the light box; `None` where the scan has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_box_off: Option<f64>,
    /// File of the measured frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_image: Option<String>,
    /// File of the real-time renderer's picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// File of the reference's picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_image: Option<String>,
    /// Residuals of the renderer's picture: blue −4, white 0, red +4 units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_image: Option<String>,
    /// Whether both pictures are as close to the measurement as the view asks.
    pub passed: bool,
    /// The limits that were missed, in one sentence each.
    pub why: Vec<String>,
}

/// A picture compared with the measurement, in the units of the rule.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CaptureComparison {
    /// Mean square of the residuals.
    pub reduced_chi2: f64,
    /// Error beyond noise and chance.
    pub off: f64,
    /// Share of the residuals beyond three units.
    pub share_beyond_3: f64,
    /// Mean of the residuals.
    pub bias: f64,
    /// Distance from the exact tube integral, root mean square and largest. It does not depend on the measurement's
    /// noise.
    pub from_model: f64,
    /// The largest of these distances.
    pub from_model_most: f64,
}

impl Default for CaptureComparison {
    /// Nothing is known.
    fn default() -> Self {
        let [reduced_chi2, off, share_beyond_3, bias, from_model, from_model_most] = [f64::NAN; 6];
        CaptureComparison { reduced_chi2, off, share_beyond_3, bias, from_model, from_model_most }
    }
}

impl CaptureFigures {
    /// One line in words.
    pub fn line(&self) -> String {
        let mut line = format!(
            "{}  {}: {} {}, held-out frame {} {}: the picture is off by {:.2} of the measurement's noise, the \
             reference by {:.2} (allowed {:.2}); \
             reduced χ² {:.3} and {:.3}, {:.3} expected, {} readings; with the V-cavity factor of scenes it is off by \
             {:.2}",
            if self.passed { "passed" } else { "MISSED" },
            self.name,
            self.leaf,
            self.side,
            self.pass,
            self.frame,
            self.renderer.off,
            self.reference.off,
            self.allowed,
            self.renderer.reduced_chi2,
            self.reference.reduced_chi2,
            self.expected,
            self.readings,
            self.bounded.off
        );
        for why in &self.why {
            line += &format!("\n        {why}");
        }
        line
    }
}
