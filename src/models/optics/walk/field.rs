//! A leaf between two height fields, and rays that march through it cell by cell.
//!
//! Heights are given at the texels' centres and are bilinear between them. So the height over a ray is quadratic along
//! the ray, and every crossing is a root in closed form: there is no step length and no bias. Where the front is at or
//! below the back there is no tissue (a hole). Grid frame: x to the right, y down the rows, z towards the light.

use super::phase::Direction;
use mesophyll_base::error::{Error, Result};

/// What lies beyond the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldRim {
    /// The map repeats.
    Periodic,
    /// The heights of the rim continue outwards without end. Light starts over the map and a margin (mm) around it, and
    /// upstream of both.
    Clamped {
        /// Width of the margin (mm), at least 0.
        margin_mm: f64,
    },
}

/// Both faces of a leaf as the lit side's camera sees it: row-major, row 0 on top, `width · height` values each;
/// heights in mm towards the light.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafHeightField {
    width: usize,
    height: usize,
    texel_mm: f64,
    front: Vec<f64>,
    back: Vec<f64>,
    rim: FieldRim,
    top: f64,
    bottom: f64,
}

/// Faces crossed within this distance (mm) leave no tissue between them.
const SHEET: f64 = 1e-12;
/// Steps from cell to cell before a flight is given up.
const CELLS: u32 = 10_000_000;

/// A ray: the cell between the centres of texels (i, j) and (i+1, j+1), the place in it, and on which side of each face
/// the ray is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub i: i64,
    pub j: i64,
    pub u: f64,
    pub v: f64,
    pub z: f64,
    pub d: Direction,
    pub below_front: bool,
    pub above_back: bool,
}

impl Ray {
    pub fn inside(&self) -> bool {
        self.below_front && self.above_back
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Event {
    /// The budget is spent.
    Collision,
    Front,
    Back,
    /// The ray leaves for good, towards the light.
    Up,
    Down,
    Lost,
}

/// A bilinear patch: height, slopes along u and v at a point, and the twist (mm per cell).
struct Patch {
    h: f64,
    hu: f64,
    hv: f64,
    twist: f64,
}

impl LeafHeightField {
    /// A leaf of `width` × `height` texels of `texel_mm` between two maps of heights (mm), row by row.
    ///
    /// # Errors
    /// Maps of another size, a height that is not a number, or a texel that is not positive.
    pub fn new(
        width: usize,
        height: usize,
        texel_mm: f64,
        front: Vec<f64>,
        back: Vec<f64>,
        rim: FieldRim,
    ) -> Result<LeafHeightField> {
        let cells = width * height;
        if cells == 0 || front.len() != cells || back.len() != cells {
            let found = (front.len(), back.len());
            return Err(Error::Usage(format!(
                "random walk: height maps of {} and {} values, expected {width} × {height}",
                found.0, found.1
            )));
        }
        if !(texel_mm > 0.0 && texel_mm.is_finite()) {
            return Err(Error::Usage(format!("random walk: a texel of {texel_mm} mm, expected a number above 0")));
        }
        if front.iter().chain(&back).any(|h| !h.is_finite()) {
            return Err(Error::Usage("random walk: a height is not a number".into()));
        }
        if let FieldRim::Clamped { margin_mm } = rim
            && !(margin_mm >= 0.0 && margin_mm.is_finite())
        {
            return Err(Error::Usage(format!("random walk: a margin of {margin_mm} mm, expected a number ≥ 0")));
        }
        let all = || front.iter().chain(&back);
        let (top, bottom) =
            (all().copied().fold(f64::NEG_INFINITY, f64::max), all().copied().fold(f64::INFINITY, f64::min));
        Ok(LeafHeightField { width, height, texel_mm, front, back, rim, top, bottom })
    }

    /// Texels a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Size of a texel (mm).
    pub fn texel_mm(&self) -> f64 {
        self.texel_mm
    }

    /// Where light along `d` (z < 0) starts: corner and size of a rectangle at the leaf's highest level, in mm from the
    /// map's upper left corner. Diffuse light (`None`) has the upstream part of light 80° from the vertical.
    pub(super) fn start(&self, d: Option<Direction>) -> ([f64; 2], [f64; 2]) {
        let size = [self.width as f64 * self.texel_mm, self.height as f64 * self.texel_mm];
        let FieldRim::Clamped { margin_mm } = self.rim else { return ([0.0; 2], size) };
        let drop = self.top - self.bottom;
        let mut low = [-margin_mm; 2];
        let mut high = [size[0] + margin_mm, size[1] + margin_mm];
        for k in 0..2 {
            match d {
                Some(d) => {
                    let drift = drop * d[k] / -d[2];
                    low[k] -= drift.max(0.0);
                    high[k] += (-drift).max(0.0);
                }
                None => {
                    low[k] -= 5.67 * drop;
                    high[k] += 5.67 * drop;
                }
            }
        }
        (low, [high[0] - low[0], high[1] - low[1]])
    }

    /// A ray over the leaf at (x, y) mm from the upper left corner.
    pub(super) fn above(&self, x: f64, y: f64, d: Direction) -> Ray {
        let (gx, gy) = (x / self.texel_mm - 0.5, y / self.texel_mm - 0.5);
        let (i, j) = (gx.floor(), gy.floor());
        Ray { i: i as i64, j: j as i64, u: gx - i, v: gy - j, z: self.top, d, below_front: false, above_back: true }
    }

    /// Index of the texel under a ray, None beyond a clamped rim.
    pub(super) fn texel(&self, ray: &Ray) -> Option<usize> {
        let (i, j) = (ray.i + i64::from(ray.u >= 0.5), ray.j + i64::from(ray.v >= 0.5));
        let (w, h) = (self.width as i64, self.height as i64);
        match self.rim {
            FieldRim::Periodic => Some((j.rem_euclid(h) * w + i.rem_euclid(w)) as usize),
            FieldRim::Clamped { .. } => ((0..w).contains(&i) && (0..h).contains(&j)).then(|| (j * w + i) as usize),
        }
    }

    /// Unit normal, out of the tissue, of a face under the ray.
    pub(super) fn normal(&self, ray: &Ray, front: bool) -> Direction {
        let p = self.patch(if front { &self.front } else { &self.back }, ray, self.corners(ray));
        let (x, y) = (p.hu / self.texel_mm, p.hv / self.texel_mm);
        let side = if front { 1.0 } else { -1.0 };
        let scale = side / (1.0 + x * x + y * y).sqrt();
        [-x * scale, -y * scale, scale]
    }

    fn corners(&self, ray: &Ray) -> [usize; 4] {
        let along = |k: i64, n: usize| -> usize {
            match self.rim {
                FieldRim::Periodic => k.rem_euclid(n as i64) as usize,
                FieldRim::Clamped { .. } => k.clamp(0, n as i64 - 1) as usize,
            }
        };
        let (i0, i1) = (along(ray.i, self.width), along(ray.i + 1, self.width));
        let (j0, j1) = (along(ray.j, self.height) * self.width, along(ray.j + 1, self.height) * self.width);
        [j0 + i0, j0 + i1, j1 + i0, j1 + i1]
    }

    fn patch(&self, map: &[f64], ray: &Ray, at: [usize; 4]) -> Patch {
        let [a, b, c, d] = at.map(|k| map[k]);
        let twist = a - b - c + d;
        let (hu, hv) = (b - a + twist * ray.v, c - a + twist * ray.u);
        Patch { h: a + ray.u * (b - a) + ray.v * hv, hu, hv, twist }
    }

    /// Moves the ray to its next event, at most `budget` mm along (infinite outside the tissue).
    pub(super) fn advance(&self, ray: &mut Ray, mut budget: f64) -> Event {
        let (du, dv) = (ray.d[0] / self.texel_mm, ray.d[1] / self.texel_mm);
        for _ in 0..CELLS {
            if ray.d[2] >= 0.0 && ray.z > self.top && !ray.below_front {
                return Event::Up;
            }
            if ray.d[2] <= 0.0 && ray.z < self.bottom && !ray.above_back {
                return Event::Down;
            }
            let to = |p: f64, d: f64| {
                if d > 0.0 {
                    (1.0 - p) / d
                } else if d < 0.0 {
                    -p / d
                } else {
                    f64::INFINITY
                }
            };
            let (tu, tv) = (to(ray.u, du).max(0.0), to(ray.v, dv).max(0.0));
            let edge = tu.min(tv);
            let corners = self.corners(ray);
            let reach = edge.min(budget);
            let front = crossing(ray, &self.patch(&self.front, ray, corners), du, dv, ray.below_front, reach);
            let back = crossing(ray, &self.patch(&self.back, ray, corners), du, dv, !ray.above_back, reach);
            let hit = front.unwrap_or(f64::INFINITY).min(back.unwrap_or(f64::INFINITY));
            let t = hit.min(reach);
            if !t.is_finite() {
                return self.away(ray);
            }
            ray.z += t * ray.d[2];
            ray.u = (ray.u + t * du).clamp(0.0, 1.0);
            ray.v = (ray.v + t * dv).clamp(0.0, 1.0);
            if hit <= reach {
                if let (Some(f), Some(k), false) = (front, back, ray.inside())
                    && (f - k).abs() <= SHEET
                {
                    // A sheet without thickness is a hole: both faces are passed at once.
                    (ray.below_front, ray.above_back) = (!ray.below_front, !ray.above_back);
                    budget -= t;
                    continue;
                }
                return if front == Some(hit) { Event::Front } else { Event::Back };
            }
            if budget <= edge {
                return Event::Collision;
            }
            budget -= t;
            if tu <= edge {
                let forward = du > 0.0;
                ray.i += if forward { 1 } else { -1 };
                ray.u = if forward { 0.0 } else { 1.0 };
            }
            if tv <= edge {
                let forward = dv > 0.0;
                ray.j += if forward { 1 } else { -1 };
                ray.v = if forward { 0.0 } else { 1.0 };
            }
        }
        Event::Lost
    }

    /// A ray that runs straight up or down and meets nothing else.
    fn away(&self, ray: &Ray) -> Event {
        match (ray.inside(), ray.d[2]) {
            (false, z) if z > 0.0 => Event::Up,
            (false, z) if z < 0.0 => Event::Down,
            _ => Event::Lost,
        }
    }
}

/// First distance within `reach` at which the ray changes sides of the patch: from below to above (`rising`), or the
/// other way.
///
/// f(t) = z(t) − h(t) = a t² + b t + c has one root where it rises (and one where it falls). If rounding has left a ray
/// beyond the face and it moves further away, it has already crossed.
fn crossing(ray: &Ray, p: &Patch, du: f64, dv: f64, rising: bool, reach: f64) -> Option<f64> {
    let sign = if rising { 1.0 } else { -1.0 };
    let c = sign * (ray.z - p.h);
    let b = sign * (ray.d[2] - p.hu * du - p.hv * dv);
    let a = -sign * p.twist * du * dv;
    if c >= 0.0 && b >= 0.0 {
        // The ray is on the face, or beyond it by rounding. A face that was left at this place moves the other way.
        return (c > 0.0 || b > 0.0).then_some(0.0);
    }
    let discriminant = b * b - 4.0 * a * c;
    if !(discriminant >= 0.0) {
        return None;
    }
    let root = discriminant.sqrt();
    let t = if b >= 0.0 { -2.0 * c / (b + root) } else { (root - b) / (2.0 * a) };
    (t >= 0.0 && t <= reach).then_some(t)
}
