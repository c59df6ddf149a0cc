//! The blade's contour with its teeth, in mm: base at the left, tip at the right, centred in the field.

use super::spec::{MarginSpec, OutlineSpec};
use mesophyll_base::random::{RandomStream, noise};

/// A closed contour and its coordinate frame.
#[derive(Debug, Clone)]
pub struct BladeContour {
    /// The contour, in either direction; the first point is not repeated at the end.
    contour: Vec<[f64; 2]>,
    /// Where the petiole meets the blade.
    pub base: [f64; 2],
    outline: OutlineSpec,
    /// Half widths left and right of the midrib over the angle θ with t = (1 − cosθ)/2, or radii over the angle in
    /// degrees. As a function of θ an elliptic end is smooth.
    curves: [Curve; 2],
    petiole: Option<[[f64; 2]; 2]>,
    bands: Bands,
}

/// The contour's edges by height, so that a point is tested only against the edges that pass its height.
#[derive(Debug, Clone, Default)]
struct Bands {
    low: f64,
    per_mm: f64,
    /// Edges (first point, second point) that touch each band, lowest first.
    edges: Vec<Vec<[[f64; 2]; 2]>>,
}

impl Bands {
    const COUNT: usize = 512;

    fn of(contour: &[[f64; 2]]) -> Bands {
        let [low, high] =
            contour.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], p| [l.min(p[1]), h.max(p[1])]);
        let mut bands =
            Bands { low, per_mm: Bands::COUNT as f64 / (high - low).max(1e-9), edges: vec![Vec::new(); Bands::COUNT] };
        for (k, &a) in contour.iter().enumerate() {
            let b = contour[(k + 1) % contour.len()];
            let (first, last) = (bands.index(a[1].min(b[1])), bands.index(a[1].max(b[1])));
            bands.edges[first..=last].iter_mut().for_each(|band| band.push([a, b]));
        }
        bands
    }

    /// The index grows with y: an edge that passes a height touches that height's band.
    fn index(&self, y: f64) -> usize {
        (((y - self.low) * self.per_mm).max(0.0) as usize).min(Bands::COUNT - 1)
    }

    fn at(&self, y: f64) -> &[[[f64; 2]; 2]] {
        self.edges.get(self.index(y)).map_or(&[], Vec::as_slice)
    }
}

/// A smooth curve through points: natural cubic spline.
#[derive(Debug, Clone, Default)]
struct Curve {
    x: Vec<f64>,
    y: Vec<f64>,
    /// Second derivatives at the points.
    bend: Vec<f64>,
}

impl Curve {
    /// A curve through at least three points with rising abscissae.
    fn through(points: impl IntoIterator<Item = (f64, f64)>) -> Curve {
        let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
        let n = x.len();
        // The tridiagonal system of continuity of slope, solved by elimination.
        let (mut upper, mut bend) = (vec![0.0; n], vec![0.0; n]);
        for k in 1..n.saturating_sub(1) {
            let (h0, h1) = (x[k] - x[k - 1], x[k + 1] - x[k]);
            let right = 6.0 * ((y[k + 1] - y[k]) / h1 - (y[k] - y[k - 1]) / h0);
            let pivot = 2.0 * (h0 + h1) - h0 * upper[k - 1];
            upper[k] = h1 / pivot;
            bend[k] = (right - h0 * bend[k - 1]) / pivot;
        }
        for k in (1..n.saturating_sub(1)).rev() {
            bend[k] -= upper[k] * bend[k + 1];
        }
        Curve { x, y, bend }
    }

    fn at(&self, x: f64) -> f64 {
        let k = self.x.partition_point(|&v| v <= x).clamp(1, self.x.len() - 1) - 1;
        let h = self.x[k + 1] - self.x[k];
        let (a, b) = ((self.x[k + 1] - x) / h, (x - self.x[k]) / h);
        a * self.y[k]
            + b * self.y[k + 1]
            + ((a * a * a - a) * self.bend[k] + (b * b * b - b) * self.bend[k + 1]) * h * h / 6.0
    }
}

/// Where the petiole must meet a round blade so that the blade is centred.
fn centring(radius: &Curve) -> [f64; 2] {
    let (mut lo, mut hi) = ([0.0f64; 2], [0.0f64; 2]);
    for k in -180..=180 {
        let (s, c) = f64::from(k).to_radians().sin_cos();
        let r = radius.at(f64::from(k));
        for (axis, v) in [r * c, r * s].into_iter().enumerate() {
            lo[axis] = lo[axis].min(v);
            hi[axis] = hi[axis].max(v);
        }
    }
    [-0.5 * (lo[0] + hi[0]), -0.5 * (lo[1] + hi[1])]
}

/// The angle whose (1 − cosθ)/2 is t.
fn theta(t: f64) -> f64 {
    (1.0 - 2.0 * t.clamp(0.0, 1.0)).acos()
}

impl BladeContour {
    pub fn new(outline: &OutlineSpec, margin: &MarginSpec, seed: u64) -> BladeContour {
        let curves = if outline.polar.is_empty() {
            [1, 2].map(|side| Curve::through(outline.profile.iter().map(|p| (theta(p[0]), p[side]))))
        } else {
            [Curve::through(outline.polar.iter().map(|p| (p[0], p[1]))), Curve::default()]
        };
        let mut blade = BladeContour {
            contour: Vec::new(),
            base: [0.0; 2],
            outline: outline.clone(),
            curves,
            petiole: None,
            bands: Bands::default(),
        };
        blade.base = if outline.polar.is_empty() {
            [-0.5 * outline.length_mm, blade.place(0.0, 0.0)[1]]
        } else {
            centring(&blade.curves[0])
        };
        blade.contour = toothed(&blade.smooth_contour(), margin, blade.base, seed);
        blade.bands = Bands::of(&blade.contour);
        if outline.petiole_mm > 0.0 {
            let [x, y] = blade.base;
            // The petiole enters the blade a little, so that no gap opens between them.
            blade.petiole =
                Some([[x + 0.5, y], [x - outline.petiole_mm - outline.polar.first().map_or(0.0, |p| p[1]), y]]);
        }
        blade
    }

    /// Densely sampled margin without teeth, from the base along the left half to the tip and back along the right
    /// half.
    fn smooth_contour(&self) -> Vec<[f64; 2]> {
        let steps = 1500;
        if !self.outline.polar.is_empty() {
            return (0..2 * steps)
                .map(|k| {
                    let angle = 180.0 - 360.0 * k as f64 / (2 * steps) as f64;
                    let r = self.curves[0].at(angle).max(0.0);
                    let (s, c) = angle.to_radians().sin_cos();
                    [self.base[0] + r * c, self.base[1] + r * s]
                })
                .collect();
        }
        // Close to the ends the margin turns fast, so the samples are even in an angle.
        let t = |k: usize| 0.5 - 0.5 * (std::f64::consts::PI * k as f64 / steps as f64).cos();
        let left = (0..=steps).map(|k| self.place(t(k), self.half_width(t(k), true)));
        let right = (1..steps).rev().map(|k| self.place(t(k), -self.half_width(t(k), false)));
        left.chain(right).collect()
    }

    /// Half width (mm) at a fraction of the length.
    pub fn half_width(&self, t: f64, left: bool) -> f64 {
        self.curves[usize::from(!left)].at(theta(t)).max(0.0)
    }

    /// The point at fraction t of the midrib, `side` mm to its left.
    pub fn place(&self, t: f64, side: f64) -> [f64; 2] {
        [(t - 0.5) * self.outline.length_mm, side + self.outline.bow_mm * ((std::f64::consts::PI * t).sin() - 0.5)]
    }

    /// Inverse of [`BladeContour::place`]: fraction along the midrib and distance to its left.
    pub fn along(&self, p: [f64; 2]) -> [f64; 2] {
        let t = p[0] / self.outline.length_mm + 0.5;
        [t, p[1] - self.place(t, 0.0)[1]]
    }

    /// The largest coordinate on blade and petiole (mm).
    pub fn reach(&self) -> f64 {
        let ends = self.petiole.into_iter().flatten();
        self.contour.iter().copied().chain(ends).map(|p| p[0].abs().max(p[1].abs())).fold(0.0, f64::max)
    }

    /// Whether a point lies on the blade (even–odd rule).
    pub fn holds(&self, p: [f64; 2]) -> bool {
        let mut inside = false;
        for [a, b] in self.bands.at(p[1]) {
            if (a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
                inside = !inside;
            }
        }
        inside
    }

    /// Which of the points at height `y` and abscissae `x` (rising) lie on the blade or its petiole. A row needs only
    /// one search for crossings.
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

    /// Whether the distance to the petiole's axis is within its half width, which widens towards both ends.
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
fn toothed(smooth: &[[f64; 2]], margin: &MarginSpec, base: [f64; 2], seed: u64) -> Vec<[f64; 2]> {
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
            // The left half runs towards the tip; on the right half the tip lies behind.
            let forward = if k < n / 2 { 1.0 } else { -1.0 };
            let t = [forward * tangent[0] / size, forward * tangent[1] / size];
            let outward = [-tangent[1] / size, tangent[0] / size];
            // The contour runs clockwise seen from +z with left = +y first: its outward side is to the left.
            let from_base = if k < n / 2 { lengths[k] } else { total - lengths[k] };
            let wander =
                0.35 * noise(seed ^ 0x7007, [from_base, if k < n / 2 { 0.0 } else { 500.0 }], 4.0 * margin.tooth_mm);
            let phase = from_base / margin.tooth_mm + 0.3 * wander;
            let far = (smooth[k][0] - base[0]).hypot(smooth[k][1] - base[1]) / reach;
            let fade = (far * 5.0).min(1.0) * (0.35 + 0.65 * ((1.0 - from_base / (0.5 * total)) * 4.0).clamp(0.0, 1.0));
            let uneven =
                1.0 + 0.25 * (RandomStream::new(seed, &[phase.floor() as i64 as u64, u64::from(k < n / 2)]).signed());
            let first = tooth(phase, margin.lean) * margin.depth_mm * uneven;
            let second = if margin.second > 0.0 {
                tooth(phase * margin.second, margin.lean) * margin.second_depth_mm
            } else {
                0.0
            };
            let out = fade * (first + second);
            let push = fade * margin.lean * 0.7 * (first + second);
            [0, 1].map(|c| smooth[k][c] + out * outward[c] + push * t[c])
        })
        .collect()
}

/// Height of a tooth, 0 to 1, over its phase: blunt and symmetric for lean 0, rising slowly and falling fast for lean
/// 1.
fn tooth(phase: f64, lean: f64) -> f64 {
    let u = phase.rem_euclid(1.0);
    let blunt = (std::f64::consts::PI * u).sin().sqrt();
    let crest = 0.5 + 0.35 * lean;
    let sharp = if u < crest { (u / crest).powf(1.3) } else { (1.0 - u) / (1.0 - crest) };
    blunt * (1.0 - lean) + sharp * lean
}
