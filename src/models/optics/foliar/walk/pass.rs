//! One step of many rays that are in the same place: the lobe that turns them, the mesophyll's absorption on the way,
//! and Fresnel's formula where they arrive.

use super::random::{LANES, RandomLanes, cos, cos_pi, exp2, falls_short, log2};

/// Largest number of rays in a step.
pub const WIDTH: usize = 256;

/// Where rays of one place go, and what happens on the way.
#[derive(Debug, Clone, Copy)]
pub struct WalkPlace {
    /// 1/(oblateness + 1) of the lobe that turns rays when they come here; `None` where they are not turned.
    pub lobe: Option<f32>,
    /// Absorption of one thickness, as a power of 2; `None` where nothing absorbs.
    pub absorbs: Option<f32>,
    /// Whether the crossing's length is that of [`super::super::MesophyllPath::Sieve`].
    pub sieve: bool,
    /// Index of this medium over that of the next.
    pub ratio: f32,
    /// 1 − ratio², rounded once: 0 between equal media, however grazing a ray is.
    pub excess: f32,
}

/// The rays of a place that wait for their lobe: cosines from the normal and, where directions are followed, cosine and
/// sine of the azimuth.
#[derive(Debug, Clone)]
pub struct RayBatch {
    /// How many rays there are.
    pub len: usize,
    /// Cosine from the normal, 0 to 1.
    pub mu: Box<[f32]>,
    /// Cosine and sine of the azimuth.
    pub azimuth: [Box<[f32]>; 2],
}

impl RayBatch {
    /// Room for `capacity` rays and one step more.
    pub fn new(capacity: usize) -> RayBatch {
        let room = || vec![1.0; capacity + WIDTH].into_boxed_slice();
        RayBatch { len: 0, mu: room(), azimuth: [room(), room()] }
    }

    /// Adds the rays of a step whose fate is `fate`, with the cosines `mu`.
    #[inline(always)]
    fn add<const DIRECTIONS: bool>(&mut self, from: &WalkStep, mu: &[f32; WIDTH], fate: u32) {
        let start = self.len;
        let mut added = keep(&mut self.mu[start..start + WIDTH], mu, from, fate);
        if DIRECTIONS {
            for (to, azimuth) in self.azimuth.iter_mut().zip(&from.azimuth) {
                added = keep(&mut to[start..start + WIDTH], azimuth, from, fate);
            }
        }
        self.len = start + added;
    }
}

/// Writes the values of the rays whose fate is `fate` one after the other and returns how many there are. It writes
/// every value but advances only after a ray with this fate, so it needs no branch.
#[inline(always)]
fn keep(to: &mut [f32], values: &[f32; WIDTH], step: &WalkStep, fate: u32) -> usize {
    let mut n = 0;
    if let Ok(to) = <&mut [f32; WIDTH]>::try_from(to) {
        for (&value, &f) in values.iter().zip(&step.fate).take(step.n) {
            to[n % WIDTH] = value;
            n += usize::from(f == fate);
        }
    }
    n
}

/// Room for the rays of one step.
#[derive(Debug)]
pub struct WalkStep {
    n: usize,
    random: [[f32; WIDTH]; 4],
    base: [f32; WIDTH],
    mu: [f32; WIDTH],
    inside: [f32; WIDTH],
    azimuth: [[f32; WIDTH]; 2],
    fate: [u32; WIDTH],
}

// Fates. The loops take the larger of two fates, so being turned again wins over the others.
const REFLECTED: u32 = 0;
const REFRACTED: u32 = 1;
const ABSORBED: u32 = 2;
const AGAIN: u32 = 3;

impl WalkStep {
    /// Empty room.
    pub fn new() -> WalkStep {
        let zero = [0.0; WIDTH];
        WalkStep { n: 0, random: [zero; 4], base: zero, mu: zero, inside: zero, azimuth: [zero; 2], fate: [0; WIDTH] }
    }

    /// Takes up to [`WIDTH`] rays off the end of `rays`. The unused places behind them are filled with harmless values.
    #[inline(always)]
    fn take<const DIRECTIONS: bool>(&mut self, rays: &mut RayBatch, random: &mut RandomLanes, numbers: usize) -> usize {
        self.n = rays.len.min(WIDTH);
        let from = rays.len - self.n;
        rays.len = from;
        let padded = self.n.next_multiple_of(LANES);
        self.base[..padded].copy_from_slice(&rays.mu[from..from + padded]);
        if DIRECTIONS {
            for k in 0..2 {
                self.azimuth[k][..padded].copy_from_slice(&rays.azimuth[k][from..from + padded]);
            }
        }
        for k in 0..numbers {
            random.fill(&mut self.random[k][..padded]);
        }
        padded
    }

    /// Turns each ray by the lobe of exponent `lobe` = 1/(ob + 1) (B1, Eq. 2): α = arccos ξ₁^lobe, β = 2π ξ₂. A ray
    /// that leaves its side of the leaf's plane is to be turned again.
    #[inline(always)]
    fn turn<const DIRECTIONS: bool>(&mut self, lobe: f32, padded: usize) {
        let [first, second, ..] = &self.random;
        let (first, second, base) = (&first[..padded], &second[..padded], &self.base[..padded]);
        let (to, fate) = (&mut self.mu[..padded], &mut self.fate[..padded]);
        let [x, y] = &mut self.azimuth;
        let (x, y) = (&mut x[..padded], &mut y[..padded]);
        for k in 0..padded {
            let mu = base[k];
            let power = log2(first[k]) * lobe;
            let (cos_a, sin_a2) = (exp2(power), falls_short(2.0 * power));
            let sin_a = sin_a2.max(0.0).sqrt();
            // β and −β give the same μ. So ξ₂ is spread over half a turn, and which half it lies in decides the sign.
            let (half, sign) = if DIRECTIONS {
                let low = second[k] <= 0.5;
                (if low { 2.0 * second[k] } else { 2.0 * second[k] - 1.0 }, if low { 1.0 } else { -1.0 })
            } else {
                (second[k], 1.0)
            };
            let cos_b = cos_pi(half);
            let s = (1.0 - mu * mu).max(0.0).sqrt();
            let turned = mu * cos_a - s * sin_a * cos_b;
            fate[k] = if turned > 0.0 { REFLECTED } else { AGAIN };
            to[k] = turned.min(1.0);
            if DIRECTIONS {
                // along the old azimuth, and across it
                let along = s * cos_a + mu * sin_a * cos_b;
                let across = sin_a * sign * (1.0 - cos_b * cos_b).max(0.0).sqrt();
                let length = (along * along + across * across).sqrt();
                let (c, d) = if length > 0.0 { (along / length, across / length) } else { (1.0, 0.0) };
                // A ray that is to be turned again keeps its azimuth.
                let (c, d) = if turned > 0.0 { (c, d) } else { (1.0, 0.0) };
                (x[k], y[k]) = (x[k] * c - y[k] * d, y[k] * c + x[k] * d);
            }
        }
    }

    /// Absorption on a crossing: a ray survives with exp(−a t / cos θ).
    #[inline(always)]
    fn absorb(&mut self, per_thickness: f32, sieve: bool, padded: usize) {
        let (chance, mu) = (&self.random[2][..padded], &self.mu[..padded]);
        let fate = &mut self.fate[..padded];
        for k in 0..padded {
            let length = 1.0 / if sieve { cos(mu[k]) } else { mu[k] };
            let gone = if chance[k] > exp2(-per_thickness * length) { ABSORBED } else { REFLECTED };
            fate[k] = fate[k].max(gone);
        }
    }

    /// Fresnel's formula without a division: ξ < ½ (a²/b² + c²/d²) is 2 ξ b² d² < a² d² + c² b².
    ///
    /// The square of the cosine beyond is (1 − ratio²) + ratio² μ². In the form 1 − ratio² (1 − μ²) a small μ loses its
    /// digits: between equal media below μ = 2e-4 all of them, and the ray would be mirrored.
    #[inline(always)]
    fn arrive(&mut self, ratio: f32, excess: f32, padded: usize) {
        let (chance, mu) = (&self.random[3][..padded], &self.mu[..padded]);
        let (fate, to) = (&mut self.fate[..padded], &mut self.inside[..padded]);
        for k in 0..padded {
            let mu = mu[k];
            let own = ratio * mu;
            let inside = (excess + own * own).max(0.0).sqrt();
            let (a, b) = (own - inside, own + inside);
            let (c, d) = (mu - ratio * inside, mu + ratio * inside);
            let (a, b, c, d) = (a * a, b * b, c * c, d * d);
            // Beyond total reflection a = b and c = d.
            let mirrored = if 2.0 * chance[k] * b * d <= a * d + c * b { REFLECTED } else { REFRACTED };
            to[k] = inside.min(1.0);
            fate[k] = fate[k].max(mirrored);
        }
    }

    /// Takes rays out of `rays` through one step. Reflected rays go to `mirrored`, refracted rays to `refracted`, and
    /// rays to be turned again go back. Returns how many were absorbed.
    #[inline(always)]
    pub fn run<const DIRECTIONS: bool>(
        &mut self,
        place: &WalkPlace,
        random: &mut RandomLanes,
        rays: &mut RayBatch,
        mirrored: &mut RayBatch,
        refracted: &mut RayBatch,
    ) -> u64 {
        let padded = self.take::<DIRECTIONS>(rays, random, 4);
        match place.lobe {
            Some(lobe) => self.turn::<DIRECTIONS>(lobe, padded),
            None => {
                self.mu[..padded].copy_from_slice(&self.base[..padded]);
                self.fate[..padded].fill(REFLECTED);
            }
        }
        if let Some(a) = place.absorbs {
            self.absorb(a, place.sieve, padded);
        }
        self.arrive(place.ratio, place.excess, padded);
        rays.add::<DIRECTIONS>(self, &self.base, AGAIN);
        mirrored.add::<DIRECTIONS>(self, &self.mu, REFLECTED);
        refracted.add::<DIRECTIONS>(self, &self.inside, REFRACTED);
        self.fate[..self.n].iter().filter(|f| **f == ABSORBED).count() as u64
    }

    /// Turns rays that have left the leaf and hands them to `each`, with the cosine of their angle and cosine and sine
    /// of their azimuth. Rays to be turned again go back.
    pub fn leave(
        &mut self,
        lobe: Option<f32>,
        random: &mut RandomLanes,
        rays: &mut RayBatch,
        mut each: impl FnMut([f32; 3]),
    ) {
        let padded = self.take::<true>(rays, random, 2);
        match lobe {
            Some(lobe) => self.turn::<true>(lobe, padded),
            None => {
                self.mu[..padded].copy_from_slice(&self.base[..padded]);
                self.fate[..padded].fill(REFLECTED);
            }
        }
        rays.add::<true>(self, &self.base, AGAIN);
        for k in (0..self.n).filter(|&k| self.fate[k] != AGAIN) {
            each([self.mu[k], self.azimuth[0][k], self.azimuth[1][k]]);
        }
    }
}
