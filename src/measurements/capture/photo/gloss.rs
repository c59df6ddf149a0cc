//! What a side's surface mirrors of light from all sides: towards a camera along the normal, which is part of what open
//! shade shows, and altogether, which is part of what the leaf's underside throws back onto a light table.
//!
//! It is computed from the stated index and slope. Without them only a range is known: effective indices of leaves are
//! between 1.2 and 1.7 (Bousquet et al. 2005, quoted by Habel 2009, §3.3.3), and no texel mirrors more than it shows in
//! its darkest channel. Then the middle of the range is taken, and its width is the error.

use super::diffuse::fresnel;
use super::manifest::PhotoManifest;
use crate::dome::highlight::{Highlight, fresnel_normal};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::quantile;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::Side;

/// Range of effective indices of leaves.
const INDICES: [f64; 2] = [1.2, 1.7];
/// Relative standard error of the share that a lobe of stated slope mirrors: models of the lobe differ by that much,
/// and so do places of a leaf.
pub(super) const LOBE: f64 = 0.1;
/// Slope of a surface of which nothing is stated: leaves have .078 to .5 (Bousquet et al. 2005).
const SLOPE: f64 = 0.3;
/// Cosines at which a rough surface is integrated, in equal steps.
const STEPS: usize = 16;
/// Share of the texels that may be darker than the bound for other reasons, such as dirt.
const DARKEST: f64 = 0.01;
/// Below this many standard deviations of noise lies the same share of the texels of an even leaf.
const DARKEST_NOISE: f64 = 2.326;

/// What a side mirrors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gloss {
    /// Of light from all sides towards a camera along the normal.
    pub normal: Highlight,
    /// Of light from all sides, in all directions. Most of that comes at grazing incidence, where the facets of a rough
    /// surface hide each other. What they then mirror twice is between all and nothing, so the middle is taken.
    pub all_round: f64,
    /// How much larger `all_round` is where `normal` is larger by one standard error.
    pub moves: f64,
    /// Standard error of `all_round` beside that: half of what facets hide.
    pub all_round_err: f64,
}

/// The gloss of `side`. `seen` holds the side's reflectance with gloss, without what the sheet adds, and `noise` its
/// noise, where `inner` is set: away from the outline, where pixels also show the dark sheet.
pub(super) fn gloss(m: &PhotoManifest, side: Side, seen: &[Rgb], noise: &[Rgb], inner: &[bool]) -> Gloss {
    // A texel's noise makes it look darker or brighter. As many texels of an even leaf as are left out here lie
    // `DARKEST_NOISE` below it, so that this is added again.
    let darkest = |k: usize| (0..3).map(|c| seen[k][c] + DARKEST_NOISE * noise[k][c]).fold(f64::INFINITY, f64::min);
    let mut list: Vec<f64> = (0..seen.len()).filter(|&k| inner[k]).map(darkest).filter(|v| v.is_finite()).collect();
    let at_most = quantile(&mut list, DARKEST).map_or(f64::INFINITY, |v| v.max(0.0));
    let s = usize::from(side == Side::Back);
    let (normal, all_round, moves) = match m.gloss {
        Some(g) => {
            let (n, lobe) = (g.index[s], Lobe::Beckmann.albedo(1.0, g.slope[s]));
            let share = fresnel_normal(n) * lobe;
            let by_index = lobe * g.index_err * 4.0 * (n - 1.0) / (n + 1.0).powi(3);
            let normal = Highlight { share, stderr: by_index.hypot(LOBE * share), at_most, stated: true };
            let [above, below] = [n + g.index_err, (n - g.index_err).max(1.0)].map(|n| all_round(n, g.slope[s])[0]);
            (normal, all_round(n, g.slope[s]), 0.5 * (above - below))
        }
        None => {
            let high = fresnel_normal(INDICES[1]).min(at_most);
            let low = fresnel_normal(INDICES[0]);
            // A leaf that is darker than the least gloss of leaves has less.
            let low = if low < high { low } else { 0.0 };
            // Mean and standard deviation of a value that may lie anywhere in the range.
            let (share, stderr) = (0.5 * (low + high), (high - low) / 12f64.sqrt());
            let [a, b] = [low, high].map(|share| all_round(index(share), SLOPE));
            let middle = [0, 1].map(|k: usize| 0.5 * (a[k] + b[k]));
            (Highlight { share, stderr, at_most, stated: false }, middle, (b[0] - a[0]) / 12f64.sqrt())
        }
    };
    Gloss { normal, all_round: all_round[0], moves, all_round_err: all_round[1] }
}

/// What a surface of index `n` and slope `m` mirrors of light from all sides: halfway between a smooth surface and one
/// whose facets hide each other and mirror once, and half the distance of both.
fn all_round(n: f64, m: f64) -> [f64; 2] {
    let lobe = Lobe::CookTorrance { index: n };
    let mu = (0..STEPS).map(|k| (k as f64 + 0.5) / STEPS as f64);
    let (smooth, once) = (fresnel(n), mu.map(|mu| 2.0 * mu * lobe.albedo(mu, m)).sum::<f64>() / STEPS as f64);
    [0.5 * (smooth + once), 0.5 * (smooth - once).abs()]
}

/// The index of a smooth surface that reflects this share along its normal.
fn index(share: f64) -> f64 {
    let r = share.min(0.9).sqrt();
    (1.0 + r) / (1.0 - r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::random::RandomStream;

    fn manifest(gloss: &str) -> PhotoManifest {
        let text = format!(
            r#"
            schema = 1
            kind = "photo"
            name = "x"
            thickness_mm = 0.2
            thickness_err_mm = 0.01
            card = {{ reflectance = 0.18, reflectance_err = 0.0 }}
            background = {{ reflectance = 0.04, reflectance_err = 0.0 }}
            ruler = {{ marks_px = [[0.0, 0.0], [90.0, 0.0]], length_mm = 50.0 }}
            front = {{ file = "a.exr", card = [0, 0, 9, 9] }}
            back = {{ file = "b.exr", card = [0, 0, 9, 9] }}
            light_table = {{ leaf = "c.exr", bare = "d.exr", reflectance = 0.3, reflectance_err = 0.1 }}
            {gloss}
            "#
        );
        toml::from_str(&text).unwrap()
    }

    /// A leaf whose blue is nothing but gloss of .028, under noise of .004. Texels at the outline show the sheet as
    /// well.
    #[test]
    fn neither_noise_nor_the_outline_makes_the_bound_too_low() {
        let n = 20_000;
        let mut stream = RandomStream::new(3, &[1]);
        let mut seen = Vec::new();
        for k in 0..n {
            let noise = Rgb::of(|_| 0.004 * stream.normal_pair()[0]);
            let outline = if k < n / 20 { 0.5 } else { 1.0 };
            seen.push(outline * Rgb([0.06, 0.09, 0.028]) + noise);
        }
        let noise = vec![Rgb::splat(0.004); n];
        let inner: Vec<bool> = (0..n).map(|k| k >= n / 20).collect();
        let found = gloss(&manifest(""), Side::Front, &seen, &noise, &inner).normal;
        assert!((found.at_most - 0.028).abs() < 1e-3, "{found:?}");
        let within = (found.share - 0.028).abs() / found.stderr;
        assert!(within < 1.8, "the ends of a range are √3 standard deviations from its middle: {found:?}");
        // With the outline and without regard to noise it was much too low.
        let all = crate::dome::highlight::estimate(&seen, &vec![true; n], None);
        assert!(all.at_most < 0.018, "{all:?}");
    }

    #[test]
    fn stated_gloss_is_fresnels_law() {
        let m = manifest("gloss = { index = [1.4, 1.5], index_err = 0.05, slope = [0.05, 0.05] }");
        let seen = vec![Rgb::splat(0.1); 9];
        let [front, back] = [Side::Front, Side::Back].map(|s| gloss(&m, s, &seen, &[Rgb::default(); 9], &[true; 9]));
        assert!((front.normal.share / 0.02778 - 1.0).abs() < 0.02 && (back.normal.share / 0.04 - 1.0).abs() < 0.02);
        // Light from all sides: .0768 and .0918 (Walsh's closed form, checked against Fresnel's law elsewhere).
        assert!((front.all_round - 0.0768).abs() < 1e-3 && (back.all_round - 0.0918).abs() < 1e-3);
        assert!(front.moves > 0.005 && front.moves < 0.012, "{front:?}");
    }
}
