//! What comes through a leaf, from either side. It is nearly the same both ways, so the leaf's picture from behind is
//! the mirror image of that from the front. Scans, domes and photographs are judged alike.

use crate::leaf::interior::LeafSideFit;
use crate::record::RecordSection;
use crate::record::fault::{FaultGrade, MeasurementFault};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::median_of;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::defect::Defect;
use mesophyll_optics::side::behind;

/// A picture fits in another place where its correlation is better by this much, and is at least [`ALIKE`].
const BETTER: f64 = 0.15;
const ALIKE: f64 = 0.6;
/// A photograph lies otherwise than its frames where, shifted as the other side's lies to it, their details are more
/// alike by this many standard errors. If it lay as they do, they would be less alike by many.
const LIES: f64 = 2.0;
/// Texels on every side whose mean is taken from a picture, so that its details stay.
const AROUND: usize = 3;
/// Steps (texels) that a picture may be shifted by.
const SHIFTS: i32 = 4;
/// Front and back transmit alike up to this share.
const SIDES: f64 = 0.2;
/// Texels with more light than arrives: this share of a side's texels is no accident.
const ENERGY: f64 = 0.2;

/// What is spoilt where the transmittance is.
pub const THROUGH: [&str; 5] = ["rho_t", "sigma_a", "sigma_s", "thickness", "gamma"];

/// One side's transmittance in its own image.
pub struct TransmittanceView<'a> {
    /// Texels on the leaf.
    pub mask: &'a [bool],
    /// Transmittance, a channel.
    pub through: &'a [Rgb<f32>],
}

impl TransmittanceView<'_> {
    /// That of a scan.
    pub fn of(fitted: &LeafSideFit) -> TransmittanceView<'_> {
        TransmittanceView { mask: &fitted.measured.mask, through: &fitted.measured.rho_t }
    }
}

impl<'a> From<&'a (Vec<bool>, Vec<Rgb<f32>>)> for TransmittanceView<'a> {
    fn from((mask, through): &'a (Vec<bool>, Vec<Rgb<f32>>)) -> TransmittanceView<'a> {
        TransmittanceView { mask, through }
    }
}

/// Names the channels of a section's σ that a fault spoils as undetermined.
pub fn apply(faults: &[MeasurementFault], side: &str, section: &mut RecordSection) {
    for (name, param) in &mut section.params {
        let Some(fault) = faults.iter().find(|f| f.grade == FaultGrade::Wrong && f.spoils(side, name)) else {
            continue;
        };
        if param.value.len() == 3 {
            param.undetermined = RGB.iter().map(|letter| format!("{name}.{letter}: {}", fault.says)).collect();
        }
    }
}

/// A fault from borrowed words.
pub fn fault(name: &str, grade: FaultGrade, sides: &[&str], spoils: &[&str], says: String) -> MeasurementFault {
    let owned = |list: &[&str]| list.iter().map(|s| s.to_string()).collect();
    MeasurementFault { name: name.into(), grade, sides: owned(sides), spoils: owned(spoils), says }
}

/// Many texels of a side that send back and let through more light than arrives; `mask` holds their fates.
pub fn energy(side: &str, mask: &[i16]) -> Option<MeasurementFault> {
    let good = mask.iter().filter(|k| **k == 1).count();
    let energy = mask.iter().filter(|k| **k == Defect::Energy.code()).count();
    let share = energy as f64 / (good + energy).max(1) as f64;
    (share > ENERGY).then(|| {
        fault(
            "energy",
            FaultGrade::Wrong,
            &[side],
            &["rho_d", "rho_s", "rho_t", "sigma_a", "sigma_s", "gamma"],
            format!(
                "{side}: {:.0} % of the texels send back and let through more light than arrives (ρd + ρt > 1): the \
                 white reference is missing or too dark, white_reflectance is wrong, or an exposure changed",
                100.0 * share
            ),
        )
    })
}

/// Two pictures of a leaf: logarithms of a channel, NaN where there is none.
struct Pair {
    a: Vec<f64>,
    b: Vec<f64>,
    size: ImageSize,
}

impl Pair {
    /// Correlation of the first with the second as it is (0), with its columns (1), its rows (2) or both (3) reversed,
    /// and shifted by columns and rows; NaN where they have less than half of the leaf in common.
    fn correlation(&self, turn: usize, shift: [i32; 2]) -> f64 {
        let (ImageSize { width, height }, n) = (self.size, self.a.len());
        let mut s = [0.0; 6];
        let step = (n / 40_000).max(1);
        for k in (0..n).step_by(step) {
            let [i, j] = self.size.position(k);
            let x = (if turn & 1 == 1 { width - 1 - i } else { i }) as i32 + shift[0];
            let y = (if turn & 2 == 2 { height - 1 - j } else { j }) as i32 + shift[1];
            let Some(to) = self.size.texel([x, y]) else { continue };
            let (u, v) = (self.a[k], self.b[to]);
            if u.is_finite() && v.is_finite() {
                let terms = [1.0, u, v, u * u, v * v, u * v];
                s.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
            }
        }
        let [n, u, v, uu, vv, uv] = s;
        let spread = ((uu - u * u / n) * (vv - v * v / n)).sqrt();
        let share = n * step as f64 / self.a.iter().filter(|v| v.is_finite()).count().max(1) as f64;
        if n < 60.0 || share < 0.5 || !(spread > 0.0) { f64::NAN } else { (uv - u * v / n) / spread }
    }

    /// The shift at which `score` of the correlation is best, and that correlation, where it is not at rest and better
    /// by more than chance.
    fn shift(&self, score: impl Fn(f64) -> f64) -> Option<(f64, [i32; 2])> {
        let at_rest = score(self.correlation(0, [0, 0]));
        let best = (-SHIFTS..=SHIFTS)
            .flat_map(|y| (-SHIFTS..=SHIFTS).map(move |x| [x, y]))
            .map(|shift| (score(self.correlation(0, shift)), shift))
            .filter(|c| c.0.is_finite())
            .max_by(|x, y| x.0.total_cmp(&y.0))?;
        // Correlations by Fisher's transformation, whose standard error is 1/√n.
        let fisher = |r: f64| r.clamp(-0.999_99, 0.999_99).atanh();
        let texels = self.a.iter().filter(|v| v.is_finite()).count().max(1) as f64;
        let known = if at_rest.is_finite() { at_rest } else { -1.0 };
        let sure = fisher(best.0) - fisher(known) > (6.0 / texels.sqrt()).max(0.1);
        (best.1 != [0, 0] && best.0 > ALIKE && sure).then_some(best)
    }
}

impl Pair {
    /// A side's frames under the tube, and its photograph on the light box.
    fn with_frames(fitted: &LeafSideFit, width: usize) -> Pair {
        let mask = &fitted.measured.mask;
        let rho_d = fitted.maps.three(Quantity::RhoD);
        let log = |k: usize| match rho_d {
            Some(rho_d) if mask[k] => mean_log(Rgb(rho_d.map(|plane| plane[k])), 2.0),
            _ => f64::NAN,
        };
        let a: Vec<f64> = (0..mask.len()).map(log).collect();
        let b: Vec<f64> = fitted.measured.rho_t.iter().map(|t| mean_log(*t, 0.9)).collect();
        Pair { a, b, size: ImageSize::new(width, mask.len() / width) }
    }

    /// The details of both.
    fn details(&self) -> Pair {
        Pair { a: details(&self.a, self.size), b: details(&self.b, self.size), size: self.size }
    }

    /// What comes through the front, and the mirror image of what comes through the back.
    fn of_sides(front: &TransmittanceView, back: &TransmittanceView, width: usize) -> Pair {
        let log =
            |view: &TransmittanceView, k: usize| if view.mask[k] { mean_log(view.through[k], 1.0) } else { f64::NAN };
        let places = 0..front.mask.len();
        Pair {
            a: places.clone().map(|k| log(front, k)).collect(),
            b: places.map(|k| log(back, behind(k, width))).collect(),
            size: ImageSize::new(width, front.mask.len() / width),
        }
    }

    /// By how many standard errors the two are more alike (veins may be dark in one and bright in the other) when the
    /// second is shifted than at rest.
    fn gain(&self, shift: [i32; 2]) -> f64 {
        let fisher = |shift: [i32; 2]| self.correlation(0, shift).abs().min(0.999_99).atanh();
        let texels = self.a.iter().filter(|v| v.is_finite()).count().max(1) as f64;
        (fisher(shift) - fisher([0, 0])) * texels.sqrt()
    }
}

/// A picture less the mean of the places around each: veins stay, and what changes slowly over the leaf goes.
fn details(picture: &[f64], size: ImageSize) -> Vec<f64> {
    let ImageSize { width, height } = size;
    let around = |k: usize| {
        let [i, j] = size.position(k);
        let rows = j.saturating_sub(AROUND)..(j + AROUND + 1).min(height);
        let columns = i.saturating_sub(AROUND)..(i + AROUND + 1).min(width);
        let all = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
        let (sum, count) = all
            .map(|at| picture[at])
            .filter(|v| v.is_finite())
            .fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        sum / count
    };
    (0..picture.len()).map(|k| picture[k] - around(k)).collect()
}

fn mean_log(value: Rgb<f32>, most: f32) -> f64 {
    let mean = (value[0] + value[1] + value[2]) / 3.0;
    if mean > 0.0 && mean < most { f64::from(mean).ln() } else { f64::NAN }
}

/// The light box compared with the frames under the tube: veins show in both.
pub fn against_frames(fitted: &LeafSideFit, width: usize) -> Option<MeasurementFault> {
    let pair = Pair::with_frames(fitted, width);
    let side = fitted.side.name();
    // A vein may be darker than the lamina in one picture and brighter in the other.
    let (right, wrong) = (pair.correlation(0, [0, 0]).abs(), pair.correlation(1, [0, 0]).abs());
    let known = if right.is_finite() { right } else { 0.0 };
    if wrong > known + BETTER && wrong > ALIKE {
        return Some(fault(
            "box-mirrored",
            FaultGrade::Wrong,
            &[side],
            &THROUGH,
            format!(
                "{side}/lightbox.exr: its veins lie where the mirror image of the frames has them (correlation \
                 {wrong:.2} instead of {known:.2}): it is the photograph of the other side, or was mirrored"
            ),
        ));
    }
    let (_, shift) = pair.shift(f64::abs)?;
    Some(box_shifted(side, shift))
}

/// Which of two photographs on the light box lies otherwise than the frames of its side, where front and back do not
/// fit by a shift: none where the frames do not tell it, or tell that both lie as their frames do.
pub fn moved_box(sides: [&LeafSideFit; 2], width: usize) -> Option<MeasurementFault> {
    let pair = Pair::of_sides(&TransmittanceView::of(sides[0]), &TransmittanceView::of(sides[1]), width);
    let [right, up] = pair.shift(|r| r)?.1;
    // The front's photograph was shifted the other way, or that of the back by as much in its own image.
    let shifts = [[-right, -up], [-right, up]];
    let gain = |k: usize| Pair::with_frames(sides[k], width).details().gain(shifts[k]);
    let k = usize::from(gain(1) > gain(0));
    (gain(k) > LIES).then(|| box_shifted(sides[k].side.name(), shifts[k]))
}

fn box_shifted(side: &str, [right, up]: [i32; 2]) -> MeasurementFault {
    fault(
        "box-shifted",
        FaultGrade::Wrong,
        &[side],
        &THROUGH,
        format!(
            "{side}/lightbox.exr: its veins lie {right} columns and {up} rows from where the frames have them: the \
             leaf lay otherwise on the light box"
        ),
    )
}

/// Front and back compared by what comes through them. `file`: the back's photograph.
pub fn turned(
    front: &TransmittanceView,
    back: &TransmittanceView,
    width: usize,
    file: &str,
) -> Option<MeasurementFault> {
    let pair = Pair::of_sides(front, back, width);
    let right = pair.correlation(0, [0, 0]);
    let both = ["front", "back"];
    let known = if right.is_finite() { right } else { -1.0 };
    let wrong = (1..4).map(|t| (pair.correlation(t, [0, 0]), t)).filter(|c| c.0.is_finite());
    let wrong = wrong.max_by(|x, y| x.0.total_cmp(&y.0));
    if let Some((r, turn)) = wrong.filter(|w| w.0 > known + BETTER && w.0 > ALIKE) {
        let what = match turn {
            1 => {
                "it shows the front's image and not its mirror image (the leaf was not turned, the photograph is that \
                 of the front, or the back was mirrored once too often)"
            }
            2 => "the back is upside down",
            _ => "the back is turned about the x axis and not about the y axis (its rows run the other way)",
        };
        return Some(fault(
            "back-not-turned",
            FaultGrade::Wrong,
            &both,
            &THROUGH,
            format!("{file}: {what}; correlation of what comes through {r:.2} instead of {known:.2}"),
        ));
    }
    if let Some((r, shift)) = pair.shift(|r| r) {
        return Some(fault(
            "back-shifted",
            FaultGrade::Wrong,
            &both,
            &["thickness", "sigma_a", "sigma_s"],
            format!(
                "{file}: what comes through the back fits the front's when shifted by {} columns and {} rows \
                 (correlation {r:.2} instead of {known:.2}): the leaf moved between the sides",
                -shift[0], shift[1]
            ),
        ));
    }
    let apart = median_of(pair.a.iter().zip(&pair.b).map(|(a, b)| a - b).filter(|v| v.is_finite())).unwrap_or(f64::NAN);
    (apart.abs() > SIDES).then(|| {
        fault(
            "sides-transmit",
            FaultGrade::Doubtful,
            &both,
            &[],
            format!(
                "front and back: {:.2} times as much light comes through from the front as from the back; a leaf lets \
                 through nearly the same either way, so one of the photographs has another exposure, or shows another \
                 leaf",
                apart.exp()
            ),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_optics::side::mirror;

    /// A lopsided leaf with veins, seen from the front, and from the back as it is after a turn.
    fn leaf(width: usize, height: usize, moved: [i32; 2]) -> (Vec<bool>, Vec<Rgb<f32>>) {
        let at = |k: usize| {
            let [i, j] = ImageSize::new(width, height).position(k).map(|v| v as i32);
            let (i, j) = (i - moved[0], j - moved[1]);
            let (x, y) = (f64::from(i) / width as f64 - 0.45, f64::from(j) / height as f64 - 0.52);
            let through = 0.2 + 0.06 * (17.0 * x + 9.0 * y * y).sin() + 0.05 * (23.0 * y - 8.0 * x).cos();
            (x * x / 0.16 + y * y / 0.12 < 1.0, Rgb::splat(through as f32))
        };
        (0..width * height).map(at).unzip()
    }

    fn mirrored((mask, through): &(Vec<bool>, Vec<Rgb<f32>>), width: usize) -> (Vec<bool>, Vec<Rgb<f32>>) {
        (mirror(mask, width), mirror(through, width))
    }

    #[test]
    fn a_back_that_was_not_turned_or_that_moved_is_named() {
        let (width, height) = (60, 45);
        let front = leaf(width, height, [0, 0]);
        let right = mirrored(&front, width);
        let name = |back: &(Vec<bool>, Vec<Rgb<f32>>)| {
            turned(&TransmittanceView::from(&front), &TransmittanceView::from(back), width, "back.exr")
                .map(|f| (f.name, f.says))
        };
        assert_eq!(name(&right), None);
        assert_eq!(name(&front).unwrap().0, "back-not-turned");
        // The back's image two columns to the right of where it should be: the front's two to the left.
        let (kind, says) = name(&mirrored(&leaf(width, height, [-2, 1]), width)).unwrap();
        assert!(kind == "back-shifted" && says.contains("2 columns and 1 rows"), "{says}");
        let brighter = (right.0.clone(), right.1.iter().map(|t| t.map(|v| 1.4 * v)).collect());
        assert_eq!(name(&brighter).unwrap().0, "sides-transmit");
    }

    #[test]
    fn more_light_than_arrives_is_named() {
        let mask: Vec<i16> = (0..100).map(|k| if k % 3 == 0 { Defect::Energy.code() } else { 1 }).collect();
        assert_eq!(energy("front", &mask).unwrap().sides, ["front"]);
        assert_eq!(energy("front", &[1; 100]), None);
    }
}
