//! Frames that no fit saw, in rows, pictures and reasons: those that the fit judged itself by, and those that its
//! folder keeps, which are predicted from the maps as they are now. A map that was changed after the fit no longer
//! predicts what was measured.

use crate::colour::{self, MapFrame};
use crate::maps::{WIDE, colour_bar_of};
use crate::model::{CaptionedPicture, QualityLevel};
use crate::number::{count, percent, significant};
use crate::size::ReportDetail;
use crate::stats::{quantile, sorted};
use mesophyll_fits::leaf::held_out::{self, BAD, GOOD, StoredFrame};
use mesophyll_fits::record::FitRecord;
use mesophyll_optics::side::Side;
use serde::Serialize;
use std::path::Path;

/// The scale of residual maps reaches this many standard deviations.
const SCALE: f64 = 4.0;

/// What held-out measurements say about a fit.
#[derive(Debug, Clone, Default, Serialize)]
pub struct HeldOutReport {
    /// Whether the fit belongs to a scan from which frames could be left out.
    pub applies: bool,
    pub rows: Vec<HeldOutRow>,
    /// Files that could not be read.
    pub problems: Vec<String>,
    #[serde(skip)]
    pub pictures: Vec<CaptionedPicture>,
}

/// One comparison; residuals are in standard deviations of the measurement's noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeldOutRow {
    pub section: String,
    pub kind: HeldOutKind,
    pub what: String,
    pub readings: usize,
    pub reduced_chi2: f64,
    pub expected: f64,
    /// How far predictions are off, beyond noise and chance, in units of the noise.
    pub off: f64,
    pub share_beyond_3: Option<f64>,
    pub bias: f64,
}

/// The kind of comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldOutKind {
    /// All held-out frames of a pass, as the fit judged itself.
    Pass,
    /// A stored frame, compared with the folder's maps.
    Stored,
    /// The stored light box, compared with the slab of the folder.
    LightBox,
}

/// Reads what a leaf fit's folder says; empty for other fits.
pub fn read(folder: &Path, record: &FitRecord, pictures: Option<ReportDetail>) -> HeldOutReport {
    let mut out = HeldOutReport { applies: record.scan.is_some(), ..HeldOutReport::default() };
    for side in [Side::Front, Side::Back] {
        let Some(section) = record.sections.get(side.name()) else { continue };
        for (pass, held) in &section.held_out {
            let frames = held.frames.len();
            out.rows.push(HeldOutRow {
                section: side.name().into(),
                kind: HeldOutKind::Pass,
                what: format!("{frames} frame{} of pass {pass}", if frames == 1 { "" } else { "s" }),
                readings: held.readings,
                reduced_chi2: held.reduced_chi2,
                expected: held.expected,
                off: held.off(),
                share_beyond_3: Some(held.share_beyond_3),
                bias: held.bias,
            });
        }
        let kept = match held_out::kept(folder, record, side) {
            Ok(Some(kept)) => kept,
            Ok(None) => continue,
            Err(e) => {
                out.problems.push(e.to_string());
                continue;
            }
        };
        for frame in &kept.frames {
            out.rows.push(HeldOutRow {
                section: side.name().into(),
                kind: HeldOutKind::Stored,
                what: format!("frame {} and the maps as they are", frame.name()),
                readings: frame.readings,
                reduced_chi2: frame.reduced_chi2,
                expected: frame.expected,
                off: frame.off(),
                share_beyond_3: Some(frame.share_beyond_3),
                bias: frame.bias,
            });
        }
        if let Some(light_box) = &kept.light_box {
            out.rows.push(HeldOutRow {
                section: side.name().into(),
                kind: HeldOutKind::LightBox,
                what: "light box and the slab of σa, σs and h + δ".into(),
                readings: light_box.readings,
                reduced_chi2: light_box.reduced_chi2,
                expected: light_box.expected,
                off: light_box.off(),
                share_beyond_3: None,
                bias: light_box.bias,
            });
        }
        // The frame that shows the most gloss is the most informative.
        let most =
            |f: &&StoredFrame| f.measured[1].iter().filter(|v| v.is_finite()).map(|v| f64::from(*v)).sum::<f64>();
        let best = kept.frames.iter().max_by(|a, b| most(a).total_cmp(&most(b)));
        if let (Some(frame), Some(detail)) = (best, pictures) {
            let (width, height, least_step) = (kept.width, kept.height, detail.aside);
            let kept = (detail.others, detail.digits);
            let size = MapFrame { width, height, max_width: WIDE, least_step, texel_mm: None, kept };
            let map = MapFrame { max_width: detail.thumb, least_step: 1, ..size };
            out.pictures.extend(drawn(side, frame, size, map));
        }
    }
    out
}

/// A frame as measured, as predicted, and the difference in units of the noise.
fn drawn(side: Side, frame: &StoredFrame, size: MapFrame, map: MapFrame) -> Vec<CaptionedPicture> {
    let place = format!("{}, frame {}, tube at {} mm", side.name(), frame.name(), significant(frame.position_mm, 4));
    let shown = |i: usize| frame.predicted[1][i].is_finite();
    let all = frame.measured.iter().flatten().copied();
    let gain = (0.8 / quantile(&sorted(all.filter(|v| v.is_finite())), 0.99).max(1e-6)) as f32;
    let photograph = |planes: &[Vec<f32>; 3], what: &str| {
        let caption = format!("{place}: {what}, × {}", significant(f64::from(gain), 2));
        let picture = colour::photograph(size, [&planes[0], &planes[1], &planes[2]], gain, shown, caption.clone())?;
        Some(CaptionedPicture { picture, caption, bar: String::new() })
    };
    let caption = format!("{place}: measured less predicted, green, in standard deviations of the noise");
    let range = (-SCALE, SCALE);
    let residual = colour::false_colour(map, true, range, "σ", |i| frame.residual[1][i], caption.clone());
    let residual = residual.map(|picture| CaptionedPicture { picture, caption, bar: colour_bar_of(true, range, "σ") });
    [
        photograph(&frame.measured, "measured, not seen by the fit"),
        photograph(&frame.predicted, "predicted from the fit"),
        residual,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The rule: a prediction that is off by less than a third of the noise is good, one that is off by more than the noise
/// is bad.
pub fn level(off: f64) -> QualityLevel {
    match off {
        o if o <= GOOD => QualityLevel::Good,
        o if o <= BAD => QualityLevel::Doubtful,
        _ => QualityLevel::Bad,
    }
}

/// The verdict's sentences: one for each side and kind, with the figures of the worst row.
pub fn reasons(report: &HeldOutReport, say: &mut impl FnMut(QualityLevel, String)) {
    for problem in &report.problems {
        say(QualityLevel::Bad, format!("the held-out frames cannot be compared: {problem}"));
    }
    if report.applies && report.rows.is_empty() {
        say(QualityLevel::Doubtful, "no frame was held out: nothing that was measured tests the fit".into());
    }
    let mut sides: Vec<&str> = report.rows.iter().map(|r| r.section.as_str()).collect();
    sides.dedup();
    for side in sides {
        for kind in [HeldOutKind::Pass, HeldOutKind::Stored, HeldOutKind::LightBox] {
            let rows = || report.rows.iter().filter(|r| r.section == side && r.kind == kind);
            let Some(worst) = rows().max_by(|a, b| a.off.total_cmp(&b.off)) else { continue };
            let level = level(worst.off);
            let figures = format!(
                "reduced χ² {}, {} expected{}",
                significant(worst.reduced_chi2, 3),
                significant(worst.expected, 3),
                worst.share_beyond_3.map_or(String::new(), |s| format!(
                    ", {} of {} readings beyond 3 σ",
                    percent(s),
                    count(worst.readings)
                ))
            );
            let off = significant(worst.off, 2);
            let text = match (kind, level) {
                (HeldOutKind::Pass, QualityLevel::Good) => {
                    let what: Vec<&str> = rows().map(|r| r.what.as_str()).collect();
                    format!(
                        "{side}: {} that the fit did not see are predicted within their noise ({figures})",
                        what.join(" and ")
                    )
                }
                (HeldOutKind::Pass, _) => {
                    format!(
                        "{side}: predictions of {} that the fit did not see are off by {off} of the noise ({figures})",
                        worst.what
                    )
                }
                // This was already said, unless the maps have changed.
                (HeldOutKind::Stored, QualityLevel::Good) => continue,
                (HeldOutKind::Stored, _) => {
                    format!(
                        "{side}: the maps do not give back the held-out measurement; {}: off by {off} of the noise \
                         ({figures})",
                        worst.what
                    )
                }
                (HeldOutKind::LightBox, QualityLevel::Good) => {
                    format!(
                        "{side}: σa, σs and h + δ give back what came through the light box within its noise \
                         ({figures})"
                    )
                }
                (HeldOutKind::LightBox, _) => {
                    format!(
                        "{side}: σa, σs and h + δ do not give back what came through the light box: off by {off} of \
                         its noise ({figures})"
                    )
                }
            };
            say(level, text);
        }
    }
}
