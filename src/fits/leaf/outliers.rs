//! Texels that differ from the rest of the leaf are named as defects; neighbours stand in for them in the leaf's means.
//!
//! One hot pixel among thousands of texels must not change σa. The gauges (mean thickness h, mean γ 1) are plain means,
//! so wild texels are taken out of them. All limits are set relative to the leaf's own scatter: median and median
//! absolute deviation, which stay valid until half of the texels are wild. The limits are wide enough that neither
//! noise nor a vein reaches them.

use super::curve::RANGE;
use super::defect::{OF_SCANS, failed_reading, of_light_box};
use super::leaf_wide::{GaugeSubstitutes, LeafWideFit, LeafWideTexel};
use super::texels;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::{median_of, spread};
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::defect::Defect;

/// A texel is unexplained where ln χ² is this many scatters above the leaf's median. Noise reaches that once in 10⁹
/// texels.
const CHI2_SCATTERS: f64 = 6.0;
/// Limit for ln γ and ln thickness, in scatters from the leaf's median.
const SCATTERS: f64 = 8.0;
/// A texel this many times brighter or darker than the leaf's median is foreign; veins reach five times.
const BRIGHTNESS: f64 = 8.0;
/// Limit for χ² of three transmittances about one thickness; noise exceeds it once in 10¹⁷ texels.
const TRANSMITTANCE_CHI2: f64 = 80.0;
/// In addition to that χ², the thickness must differ from the leaf's median by this factor.
const THICKNESS: f64 = 3.0;
/// Neighbours within this many texels may stand in for a missing one. They are taken from the smallest square that
/// holds [`CANDIDATES`] good texels, or from the largest square if none does.
const REACH: usize = 6;
const CANDIDATES: usize = 40;
/// This many of the candidates stand in: those whose transmittance is most like the missing texel's. A vein is replaced
/// by veins, lamina by lamina.
const NEIGHBOURS: usize = 8;

/// Texels of `mask` whose χ² no noise explains: it is far above 1, and far above that of this leaf's other texels.
/// Where the stated noise or the model is wrong, χ² is equally high in all texels, and none stands out.
pub fn unexplained(maps: &ChannelMaps, mask: &[bool]) -> Vec<bool> {
    let (chi2, freedom) = texels::chi2(maps);
    let code = maps.scalar(Quantity::Mask).unwrap_or(&[]);
    // Traces that are far off often make a texel ambiguous as well; being far off is the better name for the defect.
    let ambiguous = f32::from(Defect::Ambiguous.code());
    let reduced = |k: usize| match (chi2.get(k), freedom.get(k)) {
        (Some(c), Some(f)) if mask[k] && (code[k] == 1.0 || code[k] == ambiguous) && *f > 0.0 => {
            Some((f64::from(*c) / f64::from(*f), f64::from(*f)))
        }
        _ => None,
    };
    let all: Vec<f64> =
        (0..mask.len()).filter(|&k| code[k] == 1.0).filter_map(reduced).map(|(r, _)| r.max(1e-9).ln()).collect();
    let (centre, scatter) = spread(&all).unwrap_or((f64::NAN, f64::NAN));
    (0..mask.len())
        .map(|k| {
            let Some((r, freedom)) = reduced(k) else { return false };
            // Noise alone scatters ln χ² by √(2/freedom).
            let noise = (2.0 / freedom).sqrt();
            !r.is_finite() || r.max(1e-9).ln() > centre.max(0.0) + CHI2_SCATTERS * scatter.max(noise)
        })
        .collect()
}

/// Texels that stand out from the fitted leaf, by their place in `texels`.
pub fn of_leaf(texels: &[LeafWideTexel], wide: &LeafWideFit, h: f64) -> Vec<(usize, Defect)> {
    let gamma = Rgb::of(|c| {
        let list: Vec<f64> = wide.locals.iter().filter(|l| l.gamma[c] > 0.0).map(|l| l.gamma[c].ln()).collect();
        spread(&list).unwrap_or((f64::NAN, f64::NAN))
    });
    let thickness: Vec<f64> = wide.locals.iter().map(|l| l.thickness.ln()).collect();
    let thickness = spread(&thickness).unwrap_or((f64::NAN, f64::NAN));
    let chi2 = median_of(wide.locals.iter().map(|l| l.chi2)).unwrap_or(f64::NAN);
    // The median of χ² with two degrees of freedom is 2 ln 2.
    let chi2_limit = TRANSMITTANCE_CHI2 * (chi2 / (2.0 * std::f64::consts::LN_2)).max(1.0);
    let foreign = |k: usize| {
        (0..3).any(|c| {
            let (centre, scatter) = gamma[c];
            let far = (SCATTERS * scatter).max(BRIGHTNESS.ln());
            // A deviation of up to four standard errors of ρd is tolerated. A ρd that was cut at zero has γ = 0, which
            // says nothing about the slab's own reflectance, so the error of γ is taken there.
            let (l, x) = (&wide.locals[k], &texels[k]);
            let of_rho_d = x.rho_d_err[c] / x.rho_d[c].max(1e-9) * l.gamma[c];
            let error = 4.0 * if l.gamma[c] > 0.0 { of_rho_d } else { l.gamma_err[c] };
            l.gamma[c] - error > (centre + far).exp() || l.gamma[c] + error < (centre - far).exp()
        })
    };
    (0..texels.len())
        .filter_map(|k| {
            let l = &wide.locals[k];
            let away = (l.thickness.ln() - thickness.0).abs();
            if l.thickness < h / RANGE * 1.001 || l.thickness > h * RANGE * 0.999 {
                // A thickness at the end of the searched range is no measurement.
                Some((k, Defect::ThicknessRange))
            } else if l.chi2 > chi2_limit && away > (SCATTERS * thickness.1).max(THICKNESS.ln()) {
                Some((k, Defect::Transmission))
            } else {
                foreign(k).then_some((k, Defect::Foreign))
            }
        })
        .collect()
}

/// For every texel whose reading failed ([`failed_reading`]), the good texels around it with the most similar
/// transmittance, as places in `at`. `rho_t` is the measured transmittance of every texel. A failed texel without good
/// texels nearby gets no list.
pub fn stand_ins(mask: &[i16], at: &[u32], rho_t: &[Rgb<f32>], width: usize) -> Vec<GaugeSubstitutes> {
    let mut place = vec![u32::MAX; mask.len()];
    for (n, &k) in at.iter().enumerate() {
        place[k as usize] = n as u32;
    }
    let height = mask.len() / width.max(1);
    let near = |k: usize, r: usize| -> GaugeSubstitutes {
        let (i, j) = (k % width, k / width);
        let rows = j.saturating_sub(r)..(j + r + 1).min(height);
        let all =
            rows.flat_map(|row| (i.saturating_sub(r)..(i + r + 1).min(width)).map(move |column| row * width + column));
        all.map(|k| place[k]).filter(|n| *n != u32::MAX).collect()
    };
    let around = |k: usize| {
        let mut list =
            (1..=REACH).map(|r| near(k, r)).find(|list| list.len() >= CANDIDATES).unwrap_or_else(|| near(k, REACH));
        let away = |n: u32| -> f32 {
            let (a, b) = (&rho_t[k], &rho_t[at[n as usize] as usize]);
            a.iter().zip(b).map(|(a, b)| (a.max(1e-4) / b.max(1e-4)).ln().powi(2)).sum()
        };
        let seen =
            rho_t[k].iter().all(|t| *t > 0.0 && *t < 1.0) && !Defect::from_code(mask[k]).is_some_and(of_light_box);
        if seen {
            // The sort is stable: texels that are equally similar keep their order, so the list is the same on every
            // run.
            list.sort_by(|a, b| away(*a).total_cmp(&away(*b)));
            list.truncate(NEIGHBOURS);
        }
        (!list.is_empty()).then_some(list)
    };
    let failed = |code: i16| Defect::from_code(code).is_some_and(failed_reading);
    (0..mask.len()).filter(|&k| failed(mask[k])).filter_map(around).collect()
}

/// ` (most are …)`: the most common defect, for the message about a leaf that has no good texel left.
pub fn most_common(mask: &[i16]) -> String {
    let count = |d: &Defect| mask.iter().filter(|m| **m == d.code()).count();
    match OF_SCANS.into_iter().max_by_key(count) {
        Some(d) if count(&d) > 0 => {
            let on_leaf = mask.iter().filter(|m| **m != 0).count();
            format!(" ({} of {on_leaf} texels: {}); see `mesophyll inspect`", count(&d), d.name().replace('_', " "))
        }
        _ => "; see the counts of `mesophyll inspect`".into(),
    }
}
