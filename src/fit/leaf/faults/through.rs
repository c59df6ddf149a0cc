//! What comes through a leaf, from either side. It is nearly the same both ways, so the leaf's picture from behind is the
//! mirror image of that from the front. Scans, domes and photographs are judged alike.

use crate::leaf::interior::Fitted;
use crate::leaf::outliers::median;
use mesophyll_files::quantity::RGB;
use mesophyll_optics::defect::Defect;
use mesophyll_record::Section;
use mesophyll_record::fault::{Fault, Grade};

/// A picture fits in another place where its correlation is better by this much, and is at least [`ALIKE`].
const BETTER: f64 = 0.15;
const ALIKE: f64 = 0.6;
/// Steps (texels) that a picture may be shifted by.
const SHIFTS: i32 = 4;
/// Front and back transmit alike up to this share.
const SIDES: f64 = 0.2;
/// Texels with more light than arrives: this share of a side's texels is no accident.
const ENERGY: f64 = 0.2;

/// What is spoilt where the transmittance is.
pub const THROUGH: [&str; 5] = ["rho_t", "sigma_a", "sigma_s", "thickness", "gamma"];

/// One side's transmittance in its own image.
pub struct View<'a> {
    /// Texels on the leaf.
    pub mask: &'a [bool],
    /// Transmittance, a channel.
    pub through: &'a [[f32; 3]],
}

impl View<'_> {
    /// That of a scan.
    pub fn of(fitted: &Fitted) -> View<'_> {
        View { mask: &fitted.measured.mask, through: &fitted.measured.rho_t }
    }
}

impl<'a> From<&'a (Vec<bool>, Vec<[f32; 3]>)> for View<'a> {
    fn from((mask, through): &'a (Vec<bool>, Vec<[f32; 3]>)) -> View<'a> {
        View { mask, through }
    }
}

/// Names the channels of a section's σ that a fault spoils as undetermined.
pub fn apply(faults: &[Fault], side: &str, section: &mut Section) {
    for (name, param) in &mut section.params {
        let Some(fault) = faults.iter().find(|f| f.grade == Grade::Wrong && f.spoils(side, name)) else { continue };
        if param.value.len() == 3 {
            param.undetermined = RGB.iter().map(|letter| format!("{name}.{letter}: {}", fault.says)).collect();
        }
    }
}

/// A fault from borrowed words.
pub fn fault(name: &str, grade: Grade, sides: &[&str], spoils: &[&str], says: String) -> Fault {
    let owned = |list: &[&str]| list.iter().map(|s| s.to_string()).collect();
    Fault { name: name.into(), grade, sides: owned(sides), spoils: owned(spoils), says }
}

/// Many texels of a side that send back and let through more light than arrives; `mask` holds their fates.
pub fn energy(side: &str, mask: &[i16]) -> Option<Fault> {
    let good = mask.iter().filter(|k| **k == 1).count();
    let energy = mask.iter().filter(|k| **k == Defect::Energy.code()).count();
    let share = energy as f64 / (good + energy).max(1) as f64;
    (share > ENERGY).then(|| {
        fault(
            "energy",
            Grade::Wrong,
            &[side],
            &["rho_d", "rho_s", "rho_t", "sigma_a", "sigma_s", "gamma"],
            format!(
                "{side}: {:.0} % of the texels send back and let through more light than arrives (ρd + ρt > 1): the white \
                 reference is missing or too dark, white_reflectance is wrong, or an exposure changed",
                100.0 * share
            ),
        )
    })
}

/// Front and back compared by what comes through them. `file`: the back's photograph.
pub fn turned(front: &View, back: &View, width: usize, file: &str) -> Option<Fault> {
    let n = front.mask.len();
    let height = n / width;
    let log = |view: &View| -> Vec<f64> {
        (0..n)
            .map(|k| {
                let t = view.through[k];
                let mean = (t[0] + t[1] + t[2]) / 3.0;
                if view.mask[k] && mean > 0.0 && mean < 1.0 { f64::from(mean).ln() } else { f64::NAN }
            })
            .collect()
    };
    let (a, b) = (log(front), log(back));
    // Where the back's texel lies that shows the front's texel (i, j), for each way that the leaf may have been turned.
    let of = |turn: usize, i: usize, j: usize| match turn {
        0 => [width - 1 - i, j],
        1 => [i, j],
        2 => [i, height - 1 - j],
        _ => [width - 1 - i, height - 1 - j],
    };
    let correlation = |turn: usize, shift: [i32; 2]| {
        let mut s = [0.0; 6];
        let step = (n / 40_000).max(1);
        for k in (0..n).step_by(step) {
            let [x, y] = of(turn, k % width, k / width);
            let (x, y) = (x as i32 + shift[0], y as i32 + shift[1]);
            if x < 0 || y < 0 || x >= width as i32 || y >= height as i32 {
                continue;
            }
            let (u, v) = (a[k], b[y as usize * width + x as usize]);
            if u.is_finite() && v.is_finite() {
                let terms = [1.0, u, v, u * u, v * v, u * v];
                s.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
            }
        }
        let [n, u, v, uu, vv, uv] = s;
        let spread = ((uu - u * u / n) * (vv - v * v / n)).sqrt();
        let share = n * step as f64 / a.iter().filter(|v| v.is_finite()).count().max(1) as f64;
        if n < 60.0 || share < 0.5 || !(spread > 0.0) { f64::NAN } else { (uv - u * v / n) / spread }
    };
    let right = correlation(0, [0, 0]);
    let both = ["front", "back"];
    let wrong =
        (1..4).map(|t| (correlation(t, [0, 0]), t)).filter(|c| c.0.is_finite()).max_by(|x, y| x.0.total_cmp(&y.0));
    let known = if right.is_finite() { right } else { -1.0 };
    if let Some((r, turn)) = wrong.filter(|w| w.0 > known + BETTER && w.0 > ALIKE) {
        let what = match turn {
            1 => {
                "it shows the front's image and not its mirror image (the leaf was not turned, \
                 the photograph is that of the front, or the back was mirrored once too often)"
            }
            2 => "the back is turned about the x axis and not about the y axis (its rows run the other way)",
            _ => "the back is upside down",
        };
        return Some(fault(
            "back-not-turned",
            Grade::Wrong,
            &both,
            &THROUGH,
            format!("{file}: {what}; correlation of what comes through {r:.2} instead of {known:.2}"),
        ));
    }
    let best = (-SHIFTS..=SHIFTS)
        .flat_map(|y| (-SHIFTS..=SHIFTS).map(move |x| [x, y]))
        .map(|shift| (correlation(0, shift), shift))
        .filter(|c| c.0.is_finite())
        .max_by(|x, y| x.0.total_cmp(&y.0));
    let texels = front.mask.iter().filter(|m| **m).count().max(1) as f64;
    // Correlations by Fisher's transformation, whose standard error is 1/√n.
    let better = |r: f64| r.clamp(-0.999_99, 0.999_99).atanh() - known.clamp(-0.999_99, 0.999_99).atanh();
    if let Some((r, shift)) =
        best.filter(|b| b.1 != [0, 0] && b.0 > ALIKE && better(b.0) > (6.0 / texels.sqrt()).max(0.1))
    {
        return Some(fault(
            "back-shifted",
            Grade::Wrong,
            &both,
            &["thickness", "sigma_a", "sigma_s"],
            format!(
                "{file}: what comes through the back fits the front's when shifted by {} columns and {} rows \
                 (correlation {r:.2} instead of {known:.2}): the leaf moved between the sides",
                shift[0], shift[1]
            ),
        ));
    }
    // The level.
    let ratios: Vec<f64> =
        (0..n).map(|k| a[k] - b[k / width * width + width - 1 - k % width]).filter(|v| v.is_finite()).collect();
    let apart = median(ratios);
    (apart.abs() > SIDES).then(|| {
        fault(
            "sides-transmit",
            Grade::Doubtful,
            &both,
            &[],
            format!(
                "front and back: {:.2} times as much light comes through from the front as from the back; a leaf lets through \
                 nearly the same either way, so one of the photographs has another exposure, or shows another leaf",
                apart.exp()
            ),
        )
    })
}
