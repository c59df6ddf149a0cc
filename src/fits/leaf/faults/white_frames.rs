//! The white frames alone: a sheet whose fall-off is known tells whether the tube stands where capture.toml says,
//! whether dark light was taken off, and whether the frames are linear. The angle of the camera plays no part in it.

use super::causes::FrameCoding;
use crate::leaf::noise::CameraNoise;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::calibration::white_response;
use mesophyll_capture::manifest::TubePass;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_optics::tube::{Travel, Tube};

/// Places of the sheet in either direction.
const PLACES: usize = 7;
/// White frames that scatter by less than this share about one gain a place agree with the sheet.
const AGREES: f64 = 0.003;
/// A cause is named where it takes away this share of the scatter's square.
const EXPLAINS: f64 = 0.8;
/// Causes that leave almost as little are named beside the best one.
const TIE: f64 = 1.3;

/// What the white frames say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WhiteFrames {
    /// There are no white frames.
    pub absent: bool,
    /// Scatter of the gain over the frames (relative); it is 0 where the sheet is as it should be.
    pub scatter: f64,
    /// The causes that explain it, best first, each with the scatter that it leaves.
    pub causes: Vec<(WhiteFrameFault, f64)>,
}

/// What may be wrong with the white frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WhiteFrameFault {
    /// Nothing.
    None,
    /// `tube.height_mm` should be this.
    Height(f64),
    /// `tube.length_mm`.
    Length(f64),
    /// `texel_mm`.
    Texel(f64),
    /// A constant (camera's values) is in the frames.
    Dark(f64),
    /// The frames are coded.
    Coded(FrameCoding),
    /// These passes (x, y) run the other way.
    Reversed(bool, bool),
    /// The frames of each pass are those of the other.
    Exchanged,
}

struct Frames {
    travel: Travel,
    positions: Vec<f64>,
    /// Gain by frame, place and channel.
    gain: Vec<Vec<Rgb<f32>>>,
}

struct Sheet {
    tube: Tube,
    texel_mm: f64,
    at: Vec<[f64; 2]>,
    passes: Vec<Frames>,
    /// Dark level of each place.
    dark: Vec<Rgb>,
    floor: f64,
}

/// Looks at the white frames of a capture.
pub fn look(capture: &TubeCapture, level: &CameraNoise) -> WhiteFrames {
    let m = &capture.manifest;
    let spread = |count: usize| -> Vec<u32> {
        let n = PLACES.min(count);
        (0..n).map(|k| ((2 * k + 1) * count / (2 * n)) as u32).collect()
    };
    let texels: Vec<[u32; 2]> =
        spread(m.height).into_iter().flat_map(|j| spread(m.width).into_iter().map(move |i| [i, j])).collect();
    let frames = |pass: &TubePass| {
        let positions = pass.positions();
        let gain: Option<Vec<_>> = (0..positions.len()).map(|k| capture.gain_of_frame(pass.name, k, &texels)).collect();
        Some(Frames { travel: pass.name, positions, gain: gain? })
    };
    let passes: Vec<Frames> = m.passes.iter().filter_map(frames).collect();
    if passes.is_empty() {
        return WhiteFrames { absent: true, ..WhiteFrames::default() };
    }
    let sheet = Sheet {
        tube: m.tube,
        texel_mm: m.texel_mm,
        at: texels.iter().map(|t| m.texel_position(*t)).collect(),
        dark: texels.iter().map(|t| capture.dark_at(*t)).collect(),
        floor: level.camera_floor(),
        passes,
    };
    let scatter = sheet.scatter(WhiteFrameFault::None);
    let mut out = WhiteFrames { absent: false, scatter, causes: Vec::new() };
    if !(scatter > AGREES) {
        return out;
    }
    let brightest = sheet.brightest();
    let mut tried = vec![
        sheet.best(WhiteFrameFault::Height, &[0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0].map(|f| f * m.tube.height_mm)),
        sheet.best(WhiteFrameFault::Length, &[0.25, 0.5, 0.8, 1.0, 1.4, 2.5].map(|f| f * m.tube.length_mm)),
        sheet.best(WhiteFrameFault::Texel, &[0.3, 0.6, 0.8, 1.0, 1.3, 1.8, 3.0].map(|f| f * m.texel_mm)),
        sheet.best(WhiteFrameFault::Dark, &[-0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1, 0.3].map(|f| f * brightest)),
    ];
    let both = sheet.passes.len() == 2;
    let turned = [(true, false), (false, true), (true, true)].into_iter().take(if both { 3 } else { 1 });
    let others = [
        WhiteFrameFault::Coded(FrameCoding::Srgb),
        WhiteFrameFault::Coded(FrameCoding::Gamma),
        WhiteFrameFault::Exchanged,
    ];
    for cause in turned.map(|(x, y)| WhiteFrameFault::Reversed(x, y)).chain(others) {
        tried.push((sheet.scatter(cause), cause));
    }
    tried.retain(|t| t.0.is_finite());
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = tried.first().map_or(f64::INFINITY, |t| t.0);
    if least.powi(2) < (1.0 - EXPLAINS) * scatter.powi(2) {
        out.causes = tried.iter().filter(|t| t.0 < TIE * least).map(|t| (t.1, t.0)).take(3).collect();
    }
    out
}

impl Sheet {
    fn brightest(&self) -> f64 {
        let mut top = 0.0f64;
        for pass in &self.passes {
            for (frame, position) in pass.gain.iter().zip(&pass.positions) {
                for (gain, at) in frame.iter().zip(&self.at) {
                    let raw = f64::from(gain[1]) * white_response(&self.tube, pass.travel, *position, *at);
                    if raw.is_finite() {
                        top = top.max(raw);
                    }
                }
            }
        }
        top
    }

    /// Weighted scatter over the frames of ln gain about its mean at each place and channel.
    fn scatter(&self, amiss: WhiteFrameFault) -> f64 {
        let mut tube = self.tube;
        let mut scale = 1.0;
        match amiss {
            WhiteFrameFault::Height(mm) => tube.height_mm = mm,
            WhiteFrameFault::Length(mm) => tube.length_mm = mm,
            WhiteFrameFault::Texel(mm) => scale = mm / self.texel_mm,
            _ => {}
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for (p, pass) in self.passes.iter().enumerate() {
            // What the frames of this pass show by the cause: another pass, or the other end first.
            let (travel, mut positions) = match (amiss, self.passes.len()) {
                (WhiteFrameFault::Exchanged, 2) => (self.passes[1 - p].travel, self.passes[1 - p].positions.clone()),
                (WhiteFrameFault::Exchanged, _) => return f64::INFINITY,
                _ => (pass.travel, pass.positions.clone()),
            };
            if matches!(amiss, WhiteFrameFault::Reversed(x, y) if [x, y][pass.travel as usize]) {
                positions.reverse();
            }
            for (n, at) in self.at.iter().enumerate() {
                for c in 0..3 {
                    let (mut s, mut sx, mut sxx) = (0.0, 0.0, 0.0);
                    for (k, frame) in pass.gain.iter().enumerate().take(positions.len()) {
                        let was = white_response(&self.tube, pass.travel, pass.positions[k], *at);
                        let is = white_response(&tube, travel, positions[k], at.map(|x| x * scale));
                        let raw = f64::from(frame[n][c]) * was;
                        let dark = self.dark[n][c];
                        let light = match amiss {
                            WhiteFrameFault::Dark(b) => raw - b,
                            WhiteFrameFault::Coded(coding) => coding.linear(raw + dark) - coding.linear(dark),
                            _ => raw,
                        };
                        if !(light > 0.0 && raw > 0.0) {
                            continue;
                        }
                        // A frame as faint as its noise says little.
                        let weight = 1.0 / (4e-6 + (self.floor / raw).powi(2));
                        let x = (light / is).ln();
                        s += weight;
                        sx += weight * x;
                        sxx += weight * x * x;
                    }
                    if s > 0.0 {
                        sum += (sxx - sx * sx / s).max(0.0);
                        weights += s;
                    }
                }
            }
        }
        (sum / weights).sqrt()
    }

    fn best(&self, of: fn(f64) -> WhiteFrameFault, grid: &[f64]) -> (f64, WhiteFrameFault) {
        let costs: Vec<f64> = grid.iter().map(|x| self.scatter(of(*x))).collect();
        let top = (0..grid.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
        let (mut low, mut high) = (grid[top.saturating_sub(1)], grid[(top + 1).min(grid.len() - 1)]);
        let mut best = (costs[top], grid[top]);
        for _ in 0..12 {
            let (a, b) = (high - 0.618 * (high - low), low + 0.618 * (high - low));
            let (at_a, at_b) = (self.scatter(of(a)), self.scatter(of(b)));
            for (c, x) in [(at_a, a), (at_b, b)] {
                if c < best.0 {
                    best = (c, x);
                }
            }
            if at_a < at_b { high = b } else { low = a }
        }
        (best.0, of(best.1))
    }
}
