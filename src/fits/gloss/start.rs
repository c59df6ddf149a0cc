//! Starting points: a bank of templates (columns D and S) over (m, tilt). Each template is fitted to the sum of the
//! channels by two-column least squares.
//!
//! Templates depend on where the texel lies along the travel. So there is a bank for every few millimetres, built when
//! it is first used.

use crate::gloss::{GlossFitDevice, normal_of};
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::{DoubleLanes, padded};
use mesophyll_base::processor::InstructionSet;
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};
use std::sync::OnceLock;

/// m of the templates, finest first.
const SLOPES: [f64; 9] = [0.03, 0.06, 0.12, 0.22, 0.35, 0.5, 0.65, 0.8, 1.0];
/// Neighbouring frames are summed into about this many groups.
const GROUPS: usize = 33;
/// Banks on either side of the blade's middle.
const SIDE: usize = 40;

/// A point to start from and how well it fits (Σ w r² of the channel sum).
#[derive(Debug, Clone, Copy)]
pub struct TemplateMatch {
    pub m: f64,
    pub tilt: f64,
    pub cost: f64,
}

/// Condensed samples, their weights and each template's gain.
#[derive(Debug, Default)]
pub struct TemplateScratch {
    samples: Vec<f64>,
    weights: Vec<f64>,
    gains: Vec<f64>,
}

struct Template {
    m: f64,
    tilt: f64,
    d: Vec<f64>,
    s: Vec<f64>,
}

/// Templates of one pass.
pub struct TemplateBank {
    model: TubeModel,
    travel: Travel,
    positions: Vec<f64>,
    range: [f64; 2],
    pitch_mm: f64,
    level: InstructionSet,
    group: usize,
    fineness: f64,
    bins: Vec<OnceLock<Vec<Template>>>,
}

impl TemplateBank {
    /// `range`: tilts in the plane of travel that the templates cover (rad). `fineness`: how many times the usual
    /// number of templates there are along either parameter.
    pub fn new(
        device: &GlossFitDevice,
        travel: Travel,
        positions: &[f64],
        range: [f64; 2],
        fineness: f64,
    ) -> TemplateBank {
        // A thin tube is accurate enough for starting points.
        let tube = mesophyll_optics::tube::Tube { radius_mm: 0.0, ..device.tube() };
        TemplateBank {
            model: TubeModel::new(tube, device.camera, device.lobe, &TubePrecision { along: 6, across: 1 }),
            travel,
            positions: positions.to_vec(),
            range,
            pitch_mm: device.height_mm / 16.0,
            level: InstructionSet::detect(),
            group: (positions.len() / GROUPS).max(1),
            fineness,
            bins: std::iter::repeat_with(OnceLock::new).take(2 * SIDE + 1).collect(),
        }
    }

    /// Number of templates.
    pub fn size(&self) -> usize {
        self.templates([0.0; 2]).len()
    }

    fn templates(&self, texel: [f64; 2]) -> &[Template] {
        let along = self.travel.local([texel[0], texel[1], 0.0])[0] / self.pitch_mm;
        let bin = (along.round() + SIDE as f64).clamp(0.0, 2.0 * SIDE as f64) as usize;
        self.bins[bin].get_or_init(|| self.build((bin as f64 - SIDE as f64) * self.pitch_mm))
    }

    fn build(&self, along: f64) -> Vec<Template> {
        let at = self.travel.local([along, 0.0, 0.0]);
        let mut out = Vec::new();
        for m in slopes(self.fineness) {
            let count =
                ((self.range[1] - self.range[0]) / (0.9 * m).min(0.08) * self.fineness).ceil().max(1.0) as usize;
            for k in 0..=count {
                let tilt = self.range[0] + (self.range[1] - self.range[0]) * k as f64 / count as f64;
                let n = normal_of(if self.travel == Travel::X { [tilt, 0.0] } else { [0.0, tilt] });
                let (mut d, mut s): (Vec<f64>, Vec<f64>) = self
                    .positions
                    .iter()
                    .map(|&light| {
                        let r = self.model.response(self.travel, light, [at[0], at[1]], n, m);
                        (r.d, r.s)
                    })
                    .unzip();
                (d, s) = (self.condense(&d), self.condense(&s));
                out.push(Template { m, tilt, d, s });
            }
        }
        out
    }

    /// Sums of neighbouring frames, padded to whole vectors: about `GROUPS` are enough to find a start.
    fn condense(&self, frames: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = frames.chunks(self.group).map(|g| g.iter().sum()).collect();
        out.resize(padded(out.len()), 0.0);
        out
    }

    /// The best templates, best first, at most `most`; no two of them are neighbours. `variances` are those of the
    /// samples; an infinite one leaves out the sample and all others of its group.
    pub fn best(
        &self,
        texel: [f64; 2],
        samples: &[f64],
        variances: &[f64],
        most: usize,
        scratch: &mut TemplateScratch,
        found: &mut Vec<TemplateMatch>,
    ) {
        found.clear();
        let TemplateScratch { samples: y, weights: w, gains } = scratch;
        for list in [&mut *y, &mut *w] {
            list.clear();
        }
        for (values, variance) in samples.chunks(self.group).zip(variances.chunks(self.group)) {
            y.push(values.iter().sum::<f64>());
            w.push(1.0 / variance.iter().sum::<f64>());
        }
        for list in [&mut *y, &mut *w] {
            list.resize(padded(list.len()), 0.0);
        }
        let (samples, weights) = (&y[..], &w[..]);
        let yy: f64 = samples.iter().zip(weights).map(|(y, w)| y * y * w).sum();
        let (templates, level) = (self.templates(texel), self.level);
        gains.clear();
        gains.resize(templates.len(), 0.0);
        let gains = &mut gains[..];
        dispatch_lanes!(level, F64, match_all(templates: &[Template], samples: &[f64], weights: &[f64],
            gains: &mut [f64]));
        for (t, gain) in templates.iter().zip(gains.iter()) {
            let start = TemplateMatch { m: t.m, tilt: t.tilt, cost: yy - gain };
            if found.len() < most || start.cost < found[found.len() - 1].cost {
                insert(found, start, most);
            }
        }
    }
}

/// `SLOPES`, or `fineness` times as many values with the same spread.
fn slopes(fineness: f64) -> Vec<f64> {
    if fineness == 1.0 {
        return SLOPES.to_vec();
    }
    let count = ((SLOPES.len() as f64 * fineness).round() as usize).max(2);
    let at = |k: usize| {
        let x = k as f64 * (SLOPES.len() - 1) as f64 / (count - 1) as f64;
        let (i, f) = ((x as usize).min(SLOPES.len() - 2), x - (x as usize).min(SLOPES.len() - 2) as f64);
        SLOPES[i] * (SLOPES[i + 1] / SLOPES[i]).powf(f)
    };
    (0..count).map(at).collect()
}

/// How much of Σ w y² each template explains with ρd ≥ 0 and ρs ≥ 0.
#[inline(always)]
fn match_all<L: DoubleLanes>(templates: &[Template], samples: &[f64], weights: &[f64], gains: &mut [f64]) {
    for (t, gain) in templates.iter().zip(gains) {
        let mut g = [L::splat(0.0); 5];
        for k in (0..samples.len()).step_by(L::N) {
            let (d, s) = (L::load(&t.d[k..]), L::load(&t.s[k..]));
            let (y, w) = (L::load(&samples[k..]), L::load(&weights[k..]));
            let (wd, ws) = (w.mul(d), w.mul(s));
            g[0] = wd.fma(d, g[0]);
            g[1] = wd.fma(s, g[1]);
            g[2] = ws.fma(s, g[2]);
            g[3] = wd.fma(y, g[3]);
            g[4] = ws.fma(y, g[4]);
        }
        let [dd, ds, ss, dy, sy] = [g[0].sum(), g[1].sum(), g[2].sum(), g[3].sum(), g[4].sum()];
        let det = dd * ss - ds * ds;
        let (rd, rs) = (ss * dy - ds * sy, dd * sy - ds * dy);
        *gain = if det > 1e-12 * dd * ss && rd >= 0.0 && rs >= 0.0 {
            (rd * dy + rs * sy) / det
        } else {
            let only = |g: f64, y: f64| if g > 0.0 { y.max(0.0).powi(2) / g } else { 0.0 };
            only(dd, dy).max(only(ss, sy))
        };
    }
}

/// Inserts a start into the list, which stays sorted by cost. Neighbours of a better start are left out.
fn insert(found: &mut Vec<TemplateMatch>, new: TemplateMatch, most: usize) {
    let near = |a: &TemplateMatch, b: &TemplateMatch| (a.tilt - b.tilt).abs() < 0.15 && (a.m / b.m).ln().abs() < 0.6;
    if found.iter().any(|f| near(f, &new) && f.cost <= new.cost) {
        return;
    }
    found.retain(|f| !near(f, &new));
    let place = found.iter().position(|f| new.cost < f.cost).unwrap_or(found.len());
    if place < most {
        found.insert(place, new);
        found.truncate(most);
    }
}
