//! A plane slab lit at one point: totals, the transmitted spot T(r), its width and the angles it leaves at.
//!
//! The lit face is at depth 0; z and directions count downwards. With matched or diffuse faces, one unit of flux starts
//! just inside the lit face along the given direction. The part that crosses without scattering is added as its
//! expectation (a spot without width, separate from everything else), and the history follows the rest. So a slab far
//! thinner than a mean free path takes no longer than a thick one. With rough dielectric faces the flux arrives from
//! outside, and nothing is forced.

use super::phase::{self, Direction};
use super::tally::{self, FluxFates, Histories, HistoryEstimate, RatioSums, ScoreSums, Tally, uniform};
use super::{Boundary, EVENTS, Medium, survives};
use mesophyll_base::error::{Error, Result};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Number of parts of equal Lambertian flux in which the exit angles are counted.
pub const ANGLES: usize = 10;

/// A plane homogeneous slab.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab {
    /// What light travels in.
    pub medium: Medium,
    /// mm, ≥ 0
    pub thickness_mm: f64,
    /// What the faces do to light.
    pub boundary: Boundary,
}

/// Direction of the light at the lit face: inside it for matched and diffuse faces, outside it for rough ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EntryDirection {
    /// A beam along this direction, z > 0; it is made a unit vector.
    Beam(Direction),
    /// Lambertian.
    Diffuse,
}

impl EntryDirection {
    /// A beam along the normal.
    pub const NORMAL: EntryDirection = EntryDirection::Beam([0.0, 0.0, 1.0]);
}

/// All fluxes are relative to the flux that starts. `balance` = reflected + glossy + transmitted + absorbed + lost is 1
/// except for the roulette.
#[derive(Debug, Clone, PartialEq)]
pub struct SlabWalk {
    /// How many histories were run.
    pub histories: u64,
    /// Share that was inside and leaves through the lit face.
    pub reflected: HistoryEstimate,
    /// Reflected by a rough face's outside without entering.
    pub glossy: HistoryEstimate,
    /// Share that leaves through the other face.
    pub transmitted: HistoryEstimate,
    /// The part of `transmitted` that met neither tissue nor a reflecting face.
    pub unscattered: HistoryEstimate,
    /// Absorbed by the tissue.
    pub absorbed: HistoryEstimate,
    /// Share that was given up after [`EVENTS`] events.
    pub lost: HistoryEstimate,
    /// Sum of all the shares; 1 except for the roulette.
    pub balance: HistoryEstimate,
    /// T(r) of the scattered light, averaged over each ring (1/mm²).
    pub radial: Vec<HistoryEstimate>,
    /// Radii of the rings (mm), one more than there are rings.
    pub edges: Vec<f64>,
    /// Mean square distance of the scattered transmitted light from where it entered, mm² (NaN where none came).
    pub mean_square_radius: HistoryEstimate,
    /// Share of the scattered transmitted flux between cos²θ = k/10 and (k+1)/10; all 0.1 for a Lambertian.
    pub angles: [HistoryEstimate; ANGLES],
    /// Mean cosine of that flux; 2/3 for a Lambertian.
    pub mean_cosine: HistoryEstimate,
}

#[derive(Clone)]
struct Sums {
    fates: FluxFates,
    unscattered: ScoreSums,
    scattered: ScoreSums,
    radial: Vec<ScoreSums>,
    radius: RatioSums,
    angles: [ScoreSums; ANGLES],
    cosine: RatioSums,
}

impl Tally for Sums {
    fn merge(&mut self, o: &Self) {
        self.fates.merge(&o.fates);
        tally::merge([&mut self.unscattered, &mut self.scattered], [&o.unscattered, &o.scattered]);
        tally::merge(&mut self.radial, &o.radial);
        tally::merge(&mut self.angles, &o.angles);
        self.radius.merge(&o.radius);
        self.cosine.merge(&o.cosine);
    }
}

/// How one history ended.
enum End {
    Lit,
    Unlit,
    Inside,
    Lost,
}

struct Particle {
    p: [f64; 3],
    d: Direction,
    weight: f64,
    absorbed: f64,
    /// Whether it met tissue or a reflecting face.
    touched: bool,
}

impl Slab {
    /// Walks `histories` through the slab. `edges` are the radii of the rings in mm, ascending from ≥ 0 (may be empty).
    pub fn walk(&self, entry: EntryDirection, histories: Histories, edges: &[f64]) -> Result<SlabWalk> {
        self.medium.check()?;
        self.boundary.check()?;
        if !(self.thickness_mm >= 0.0 && self.thickness_mm.is_finite()) {
            return Err(Error::Usage(format!(
                "random walk: the thickness is {} mm, expected a number ≥ 0",
                self.thickness_mm
            )));
        }
        if edges.first().is_some_and(|r| !(*r >= 0.0)) || edges.windows(2).any(|w| !(w[1] > w[0])) {
            return Err(Error::Usage("random walk: the rings' radii do not ascend from 0 or more".into()));
        }
        let entry = match entry {
            EntryDirection::Beam(d) => {
                let length = phase::dot(d, d).sqrt();
                if !(d[2] > 0.0 && length.is_finite()) {
                    return Err(Error::Usage(format!(
                        "random walk: the beam's direction is {d:?}, expected its third part above 0"
                    )));
                }
                EntryDirection::Beam(d.map(|x| x / length))
            }
            EntryDirection::Diffuse => EntryDirection::Diffuse,
        };
        let rings = edges.len().saturating_sub(1);
        let empty = || Sums {
            fates: FluxFates::default(),
            unscattered: ScoreSums::default(),
            scattered: ScoreSums::default(),
            radial: vec![ScoreSums::default(); rings],
            radius: RatioSums::default(),
            angles: [ScoreSums::default(); ANGLES],
            cosine: RatioSums::default(),
        };
        let sums = tally::run(histories, empty, |rng, sums| self.history(entry, edges, rng, sums))?;
        let n = histories.count;
        Ok(SlabWalk {
            histories: n,
            reflected: sums.fates.reflected.mean(n),
            glossy: sums.fates.glossy.mean(n),
            transmitted: sums.fates.transmitted.mean(n),
            unscattered: sums.unscattered.mean(n),
            absorbed: sums.fates.absorbed.mean(n),
            lost: sums.fates.lost.mean(n),
            balance: sums.fates.balance.mean(n),
            radial: sums
                .radial
                .iter()
                .zip(edges.windows(2))
                .map(|(s, e)| s.mean(n).scaled(1.0 / (PI * (e[1] * e[1] - e[0] * e[0]))))
                .collect(),
            edges: edges.to_vec(),
            mean_square_radius: sums.radius.mean(),
            angles: sums.angles.map(|s| s.share(&sums.scattered)),
            mean_cosine: sums.cosine.mean(),
        })
    }

    fn history(&self, entry: EntryDirection, edges: &[f64], rng: &mut Pcg64, sums: &mut Sums) {
        let d = match entry {
            EntryDirection::Beam(d) => d,
            EntryDirection::Diffuse => phase::lambert(rng),
        };
        let mut particle = Particle { p: [0.0; 3], d, weight: 1.0, absorbed: 0.0, touched: false };
        let mut straight = 0.0;
        match self.boundary {
            Boundary::Rough(rough) => match rough.scatter([d[0], d[1], -d[2]], rng) {
                Some(o) if o[2] > 0.0 => {
                    sums.fates.glossy.add(1.0);
                    sums.fates.balance.add(1.0);
                    return;
                }
                Some(o) => particle.d = [o[0], o[1], -o[2]],
                None => particle.weight = 0.0,
            },
            Boundary::Matched => straight = self.force(&mut particle, 0.0, rng),
            Boundary::Diffuse { reflectance } => straight = self.force(&mut particle, reflectance, rng),
        }
        let start = particle.weight;
        let end = if start > 0.0 { self.follow(&mut particle, rng) } else { End::Inside };
        let w = particle.weight;
        let (mut transmitted, mut balance) = (straight, straight + particle.absorbed);
        if straight > 0.0 {
            sums.unscattered.add(straight);
        }
        match end {
            End::Lit => {
                sums.fates.reflected.add(w);
                balance += w;
            }
            End::Unlit => {
                transmitted += w;
                balance += w;
                if particle.touched { sums.spread(&particle, edges) } else { sums.unscattered.add(w) }
            }
            End::Inside => {}
            End::Lost => {
                sums.fates.lost.add(w);
                balance += w;
            }
        }
        if matches!(self.boundary, Boundary::Rough(_)) && start == 0.0 {
            sums.fates.lost.add(1.0);
            balance += 1.0;
        }
        sums.fates.transmitted.add(transmitted);
        sums.fates.absorbed.add(particle.absorbed);
        sums.fates.balance.add(balance);
    }

    /// Splits off and returns what crosses without scattering and leaves. The particle carries the rest, at its first
    /// collision or reflection.
    fn force(&self, particle: &mut Particle, reflectance: f64, rng: &mut Pcg64) -> f64 {
        let depth = self.medium.extinction() * self.thickness_mm / particle.d[2];
        // A slab without thickness is crossed whatever it contains.
        let stopped = if depth.is_nan() { 0.0 } else { -(-depth).exp_m1() };
        let returned = reflectance * (1.0 - stopped);
        particle.weight = stopped + returned;
        particle.touched = true;
        if particle.weight > 0.0 {
            if uniform(rng) * particle.weight <= stopped {
                let s = -(-stopped * uniform(rng)).ln_1p() / self.medium.extinction();
                particle.p = std::array::from_fn(|k| s * particle.d[k]);
                particle.p[2] = particle.p[2].min(self.thickness_mm);
                self.collide(particle, rng);
            } else {
                let s = self.thickness_mm / particle.d[2];
                particle.p = [s * particle.d[0], s * particle.d[1], self.thickness_mm];
                let o = phase::lambert(rng);
                particle.d = [o[0], o[1], -o[2]];
            }
        }
        (1.0 - reflectance) * (1.0 - stopped)
    }

    fn collide(&self, particle: &mut Particle, rng: &mut Pcg64) {
        let albedo = self.medium.albedo();
        particle.absorbed += particle.weight * (self.medium.sigma_a / self.medium.extinction());
        particle.weight *= albedo;
        particle.touched = true;
        let cos = phase::henyey_greenstein(self.medium.g, rng);
        particle.d = phase::scattered(particle.d, cos, rng);
    }

    /// Follows the particle until it leaves or ends.
    fn follow(&self, particle: &mut Particle, rng: &mut Pcg64) -> End {
        let (extinction, thickness, start) =
            (self.medium.extinction(), self.thickness_mm, particle.weight + particle.absorbed);
        for _ in 0..EVENTS {
            if !survives(&mut particle.weight, start, rng) {
                return End::Inside;
            }
            let z = particle.d[2];
            let down = z > 0.0;
            let to_face = if down { (thickness - particle.p[2]) / z } else { -particle.p[2] / z };
            let flight = -uniform(rng).ln() / extinction;
            if flight < to_face {
                for k in 0..3 {
                    particle.p[k] += flight * particle.d[k];
                }
                self.collide(particle, rng);
                continue;
            }
            if !to_face.is_finite() {
                return End::Lost; // along the faces in a clear medium
            }
            particle.p[0] += to_face * particle.d[0];
            particle.p[1] += to_face * particle.d[1];
            particle.p[2] = if down { thickness } else { 0.0 };
            let end = if down { End::Unlit } else { End::Lit };
            match self.boundary {
                Boundary::Matched => return end,
                Boundary::Diffuse { reflectance } => {
                    if uniform(rng) > reflectance {
                        return end;
                    }
                    let o = phase::lambert(rng);
                    particle.d = [o[0], o[1], if down { -o[2] } else { o[2] }];
                }
                Boundary::Rough(rough) => {
                    // For the face, +z is out of the medium.
                    let flip = if down { 1.0 } else { -1.0 };
                    let Some(o) = rough.scatter([particle.d[0], particle.d[1], flip * z], rng) else {
                        return End::Lost;
                    };
                    particle.d = [o[0], o[1], flip * o[2]];
                    if o[2] > 0.0 {
                        return end;
                    }
                }
            }
            particle.touched = true;
        }
        End::Lost
    }
}

impl Sums {
    /// Records where and how scattered light leaves the unlit face.
    fn spread(&mut self, particle: &Particle, edges: &[f64]) {
        let (w, cos) = (particle.weight, particle.d[2]);
        let square = particle.p[0] * particle.p[0] + particle.p[1] * particle.p[1];
        self.scattered.add(w);
        self.radius.add(w, square);
        self.cosine.add(w, cos);
        self.angles[((cos * cos * ANGLES as f64) as usize).min(ANGLES - 1)].add(w);
        let r = square.sqrt();
        let ring = edges.partition_point(|e| *e <= r);
        if ring > 0 && ring < edges.len() {
            self.radial[ring - 1].add(w);
        }
    }
}
