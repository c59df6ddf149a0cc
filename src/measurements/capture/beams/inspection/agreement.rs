//! Whether all photographs show the leaf the same way round. The outline and the veins of each, brought to the front's
//! columns, are compared with those of the first one. A photograph that was taken from the lit side, or whose `lit`
//! names the wrong side, agrees better when it is mirrored.

use crate::beams::manifest::BeamPhotograph;
use mesophyll_optics::side::Side;
use mesophyll_optics::side::mirror;

/// By how much (of a correlation) the mirror image must agree better, and how well it must agree at least.
const BETTER: f64 = 0.1;
const WELL: f64 = 0.3;

/// What the photographs so far have shown, in the front's columns.
pub struct BeamViews {
    width: usize,
    leaf: Vec<bool>,
    first: Option<(usize, Vec<f64>)>,
    mirrored: Vec<String>,
}

impl BeamViews {
    pub fn new(width: usize, height: usize) -> BeamViews {
        BeamViews { width, leaf: vec![false; width * height], first: None, mirrored: Vec::new() }
    }

    /// Takes the `k`-th photograph in its lit side's columns.
    pub fn add(&mut self, k: usize, beam: &BeamPhotograph, channels: &[Vec<f64>; 3], median: f64) {
        let texel = |at: usize| channels.iter().map(|c| c[at]).sum::<f64>() / 3.0;
        let mut seen: Vec<f64> = (0..self.leaf.len()).map(texel).collect();
        if beam.lit == Side::Back {
            seen = mirror(&seen, self.width);
        }
        self.leaf.iter_mut().zip(&seen).for_each(|(on, v)| *on |= v.is_finite());
        // A slope or stray light counts at most twice the median. A missing reading counts as dark.
        let level = |v: f64| if v.is_finite() { (v / median.max(1e-12)).clamp(0.0, 2.0) } else { 0.0 };
        let seen: Vec<f64> = seen.into_iter().map(level).collect();
        let Some((other, first)) = &self.first else {
            self.first = Some((k, seen));
            return;
        };
        let (straight, turned) = (correlation(first, &seen), correlation(first, &mirror(&seen, self.width)));
        if turned > straight + BETTER && turned > WELL {
            self.mirrored.push(format!(
                "{}: agrees with {} better when mirrored (correlation {turned:.2} against {straight:.2}): is it what \
                 the camera of the unlit side sees, and is \
                beam {}'s lit = \"{}\" right?",
                beam.file,
                if *other == 0 { "the first photograph".to_string() } else { format!("that of beam {}", other + 1) },
                k + 1,
                beam.lit.name()
            ));
        }
    }

    /// Texels with a reading in some photograph, in the front's columns.
    pub fn leaf(&self) -> Vec<bool> {
        self.leaf.clone()
    }

    /// One sentence for every photograph that is the wrong way round.
    pub fn mirrored(self) -> Vec<String> {
        self.mirrored
    }
}

/// Pearson's correlation of two maps; 0 where either is constant.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
    let (ma, mb) = (mean(a), mean(b));
    let [mut ab, mut aa, mut bb] = [0.0; 3];
    for (x, y) in a.iter().zip(b) {
        let (x, y) = (x - ma, y - mb);
        ab += x * y;
        aa += x * x;
        bb += y * y;
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}
