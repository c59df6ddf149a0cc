//! The blade's contour with its teeth, in mm: base at the left, tip at the right, centred in the field.

use super::random::{Stream, noise};
use super::spec::{Margin, Outline};

/// A closed contour and the frame that belongs to it.
#[derive(Debug, Clone)]
pub struct Blade {
    /// Counter-clockwise or clockwise, not repeated at the end.
    contour: Vec<[f64; 2]>,
    /// Where the petiole meets the blade.
    pub base: [f64; 2],
    outline: Outline,
    petiole: Option<[[f64; 2]; 2]>,
}

/// Value at `x` of the curve through rows `(x, y)`, without overshoot (monotone cubic; Fritsch & Carlson 1980 with harmonic means).
pub fn monotone(rows: &[[f64; 2]], x: f64) -> f64 {
    let n = rows.len();
    let k = rows.partition_point(|r| r[0] <= x).clamp(1, n - 1) - 1;
    let secant = |i: usize| (rows[i + 1][1] - rows[i][1]) / (rows[i + 1][0] - rows[i][0]);
    let slope = |i: usize| {
        if i == 0 || i == n - 1 {
            return if i == 0 { secant(0) } else { secant(n - 2) };
        }
        let (a, b) = (secant(i - 1), secant(i));
        if a * b <= 0.0 { 0.0 } else { 2.0 * a * b / (a + b) }
    };
    let h = rows[k + 1][0] - rows[k][0];
    let t = ((x - rows[k][0]) / h).clamp(0.0, 1.0);
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * rows[k][1]
        + (t3 - 2.0 * t2 + t) * h * slope(k)
        + (3.0 * t2 - 2.0 * t3) * rows[k + 1][1]
        + (t3 - t2) * h * slope(k + 1)
}

impl Blade {
    pub fn new(outline: &Outline, margin: &Margin, seed: u64) -> Blade {
        let mut blade = Blade { contour: Vec::new(), base: [0.0; 2], outline: outline.clone(), petiole: None };
        let length = outline.length_mm;
        blade.base = if outline.polar.is_empty() { [-0.5 * length, 0.0] } else { [-0.5 * length + outline.polar[0][1], 0.0] };
        blade.contour = toothed(&blade.smooth_contour(), margin, blade.base, seed);
        if outline.petiole_mm > 0.0 {
            let [x, y] = blade.base;
            // It enters a little way, so that no gap opens between petiole and blade.
            blade.petiole = Some([[x + 0.5, y], [x - outline.petiole_mm - outline.polar.first().map_or(0.0, |p| p[1]), y]]);
        }
        blade
    }

    /// Densely sampled margin without teeth, from the base along the left half to the tip and back along the right half.
    fn smooth_contour(&self) -> Vec<[f64; 2]> {
        let steps = 1500;
        if !self.outline.polar.is_empty() {
            return (0..2 * steps)
                .map(|k| {
                    let angle = 180.0 - 360.0 * k as f64 / (2 * steps) as f64;
                    let r = monotone(&self.outline.polar, angle);
                    let (s, c) = angle.to_radians().sin_cos();
                    [self.base[0] + r * c, self.base[1] + r * s]
                })
                .collect();
        }
        // Close to the ends the margin turns fast: sample in an angle.
        let t = |k: usize| 0.5 - 0.5 * (std::f64::consts::PI * k as f64 / steps as f64).cos();
        let left = (0..=steps).map(|k| self.place(t(k), self.half_width(t(k), true)));
        let right = (1..steps).rev().map(|k| self.place(t(k), -self.half_width(t(k), false)));
        left.chain(right).collect()
    }

    /// Half width (mm) at a fraction of the length.
    pub fn half_width(&self, t: f64, left: bool) -> f64 {
        let rows: Vec<[f64; 2]> = self.outline.profile.iter().map(|p| [p[0], if left { p[1] } else { p[2] }]).collect();
        // Rounded at both ends: widths interpolate against √-like ends, so that base and tip close as an ellipse does.
        monotone(&rows, t.clamp(0.0, 1.0)).max(0.0)
    }

    /// The point at fraction t of the midrib, `side` mm to its left.
    pub fn place(&self, t: f64, side: f64) -> [f64; 2] {
        [(t - 0.5) * self.outline.length_mm, side + self.outline.bow_mm * ((std::f64::consts::PI * t).sin() - 0.5)]
    }

    /// Inverse of [`Blade::place`]: fraction along the midrib and distance to its left.
    pub fn along(&self, p: [f64; 2]) -> [f64; 2] {
        let t = p[0] / self.outline.length_mm + 0.5;
        [t, p[1] - self.place(t, 0.0)[1]]
    }

    pub fn round(&self) -> bool {
        !self.outline.polar.is_empty()
    }

    pub fn contour(&self) -> &[[f64; 2]] {
        &self.contour
    }

    /// Whether a point lies on the blade (even–odd rule).
    pub fn holds(&self, p: [f64; 2]) -> bool {
        let mut inside = false;
        let n = self.contour.len();
        for k in 0..n {
            let (a, b) = (self.contour[k], self.contour[(k + 1) % n]);
            if (a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
                inside = !inside;
            }
        }
        inside
    }

    /// Which of the points at heights `y`, abscissae `x` (rising) lie on the blade or its petiole: one crossing search a row.
    pub fn row(&self, y: f64, x: &[f64]) -> Vec<bool> {
        let n = self.contour.len();
        let mut crossings: Vec<f64> = (0..n)
            .filter_map(|k| {
                let (a, b) = (self.contour[k], self.contour[(k + 1) % n]);
                ((a[1] > y) != (b[1] > y)).then(|| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
            })
            .collect();
        crossings.sort_by(f64::total_cmp);
        x.iter().map(|&x| crossings.partition_point(|&c| c < x) % 2 == 1 || self.on_petiole([x, y])).collect()
    }

    /// Distance to the petiole's axis is within its half width, which widens towards both ends.
    fn on_petiole(&self, p: [f64; 2]) -> bool {
        let Some([a, b]) = self.petiole else { return false };
        let u = (p[0] - b[0]) / (a[0] - b[0]);
        let half = 0.5 * self.outline.petiole_width_mm * (1.0 + 0.5 * (2.0 * u - 1.0).powi(4));
        (0.0..=1.0).contains(&u) && (p[1] - a[1]).abs() < half
    }

    /// The petiole's axis from the blade outwards.
    pub fn petiole(&self) -> Option<[[f64; 2]; 2]> {
        self.petiole
    }
}

/// Moves the points of a smooth contour out and towards the tip, tooth by tooth.
fn toothed(smooth: &[[f64; 2]], margin: &Margin, base: [f64; 2], seed: u64) -> Vec<[f64; 2]> {
    if margin.tooth_mm <= 0.0 {
        return smooth.to_vec();
    }
    let n = smooth.len();
    let lengths: Vec<f64> = (0..n)
        .scan(0.0, |sum, k| {
            let (a, b) = (smooth[k], smooth[(k + 1) % n]);
            let here = *sum;
            *sum += (b[0] - a[0]).hypot(b[1] - a[1]);
            Some(here)
        })
        .collect();
    let total = lengths[n - 1];
    let reach = smooth.iter().map(|p| (p[0] - base[0]).hypot(p[1] - base[1])).fold(0.0, f64::max);
    (0..n)
        .map(|k| {
            let (before, after) = (smooth[(k + n - 1) % n], smooth[(k + 1) % n]);
            let tangent = [after[0] - before[0], after[1] - before[1]];
            let size = tangent[0].hypot(tangent[1]).max(1e-12);
            // Left half runs towards the tip; on the right half the tip lies behind.
            let forward = if k < n / 2 { 1.0 } else { -1.0 };
            let t = [forward * tangent[0] / size, forward * tangent[1] / size];
            let outward = [-tangent[1] / size, tangent[0] / size];
            // The contour runs clockwise seen from +z with left = +y first: its outward side is to the left.
            let from_base = if k < n / 2 { lengths[k] } else { total - lengths[k] };
            let wander = 0.35 * noise(seed ^ 0x7007, [from_base, if k < n / 2 { 0.0 } else { 500.0 }], 4.0 * margin.tooth_mm);
            let phase = from_base / margin.tooth_mm + 0.3 * wander;
            let far = (smooth[k][0] - base[0]).hypot(smooth[k][1] - base[1]) / reach;
            let fade = (far * 5.0).min(1.0) * (0.35 + 0.65 * ((1.0 - from_base / (0.5 * total)) * 4.0).clamp(0.0, 1.0));
            let uneven = 1.0 + 0.25 * (Stream::new(seed, &[phase.floor() as i64 as u64, u64::from(k < n / 2)]).signed());
            let first = tooth(phase, margin.lean) * margin.depth_mm * uneven;
            let second = if margin.second > 0.0 { tooth(phase * margin.second, margin.lean) * margin.second_depth_mm } else { 0.0 };
            let out = fade * (first + second);
            let push = fade * margin.lean * 0.7 * (first + second);
            [0, 1].map(|c| smooth[k][c] + out * outward[c] + push * t[c])
        })
        .collect()
}

/// Height of a tooth, 0 to 1, over its phase: blunt and symmetric for lean 0, rising slowly and falling fast for lean 1.
fn tooth(phase: f64, lean: f64) -> f64 {
    let u = phase.rem_euclid(1.0);
    let blunt = (std::f64::consts::PI * u).sin().sqrt();
    let crest = 0.5 + 0.35 * lean;
    let sharp = if u < crest { (u / crest).powf(1.3) } else { (1.0 - u) / (1.0 - crest) };
    blunt * (1.0 - lean) + sharp * lean
}
