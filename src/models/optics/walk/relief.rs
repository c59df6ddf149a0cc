//! A leaf of varying thickness: light from one direction or from everywhere walks between two height fields.
//!
//! The lit face shadows itself, and light that leaves travels on and may enter again elsewhere. Exitance is counted
//! where light left the unlit face for the last time. It is per area of a texel in the leaf's plane, not per area of
//! its facet.

use super::field::{Event, LeafHeightField, Ray};
use super::phase::{self, Direction};
use super::tally::{self, FluxFates, Histories, HistoryEstimate, ScoreSums, Tally, uniform};
use super::{Boundary, EVENTS, Medium, survives};
use mesophyll_base::error::{Error, Result};
use rand_pcg::Pcg64;

/// Where the light comes from, in the lit side's frame (x right, y up in its image, z out of the leaf).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum IncidentLight {
    /// Direction towards the light, z > 0; it is made a unit vector. Results are per irradiance of a plane that faces
    /// the light.
    Direction(Direction),
    /// Lambertian. Results are per irradiance of the leaf's plane.
    Diffuse,
}

/// The tissue and its faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReliefLeaf {
    /// What light travels in.
    pub medium: Medium,
    /// What the faces do to light.
    pub boundary: Boundary,
    /// Whether light that crosses a matched or diffuse face continues Lambertian about the face's normal (a rough face)
    /// instead of straight.
    pub spread: bool,
}

/// Totals are shares of the flux that starts; the maps are per unit irradiance (see [`IncidentLight`]).
#[derive(Debug, Clone, PartialEq)]
pub struct ReliefWalk {
    /// How many histories were run.
    pub histories: u64,
    /// Share that was inside and leaves for good on the lit side.
    pub reflected: HistoryEstimate,
    /// Share that leaves on the lit side without having entered (rough faces).
    pub glossy: HistoryEstimate,
    /// Share that was inside and leaves for good on the unlit side.
    pub transmitted: HistoryEstimate,
    /// Share that reaches the unlit side without having entered: through holes.
    pub passed: HistoryEstimate,
    /// Share that the tissue absorbs.
    pub absorbed: HistoryEstimate,
    /// Share that was given up after [`EVENTS`] events.
    pub lost: HistoryEstimate,
    /// Sum of all the above; 1 except for the roulette.
    pub balance: HistoryEstimate,
    /// Flux that entered a second time or more often, summed over entries.
    pub entered_again: HistoryEstimate,
    /// Light that leaves the unlit face, for each texel.
    pub exitance: Vec<HistoryEstimate>,
    /// π times the mean radiance of each texel seen from straight in front of the unlit face, within 37° (cosine
    /// [`SEEN`]). It is the exitance where the light is Lambertian about the leaf's normal, and less where the face is
    /// tilted.
    pub seen: Vec<HistoryEstimate>,
    /// Light that enters through the lit face for the first time, for each texel.
    pub entering: Vec<HistoryEstimate>,
}

/// Cosine of the half angle of the cone over which [`ReliefWalk::seen`] is averaged.
pub(crate) const SEEN: f64 = 0.8;

struct Sums {
    fates: FluxFates,
    passed: ScoreSums,
    entered_again: ScoreSums,
    exitance: Vec<ScoreSums>,
    seen: Vec<ScoreSums>,
    entering: Vec<ScoreSums>,
}

impl Tally for Sums {
    fn merge(&mut self, o: &Self) {
        self.fates.merge(&o.fates);
        tally::merge([&mut self.passed, &mut self.entered_again], [&o.passed, &o.entered_again]);
        tally::merge(&mut self.exitance, &o.exitance);
        tally::merge(&mut self.seen, &o.seen);
        tally::merge(&mut self.entering, &o.entering);
    }
}

/// One history under way.
struct Particle {
    ray: Ray,
    weight: f64,
    absorbed: f64,
    entries: u32,
    again: f64,
    /// The texel where the particle left last, if that was through the unlit face.
    left: Option<usize>,
}

impl ReliefLeaf {
    /// Walks `histories` through the leaf of this shape.
    pub fn walk(&self, field: &LeafHeightField, light: IncidentLight, histories: Histories) -> Result<ReliefWalk> {
        self.medium.check()?;
        self.boundary.check()?;
        // travel in the grid's frame: y runs down the rows
        let beam = match light {
            IncidentLight::Diffuse => None,
            IncidentLight::Direction(w) => {
                let length = phase::dot(w, w).sqrt();
                if !(w[2] > 0.0 && length.is_finite()) {
                    return Err(Error::Usage(format!(
                        "random walk: the light's direction is {w:?}, expected its third part above 0"
                    )));
                }
                Some([-w[0] / length, w[1] / length, -w[2] / length])
            }
        };
        let (corner, size) = field.start(beam);
        let texels = field.width() * field.height();
        let empty = || Sums {
            fates: FluxFates::default(),
            passed: ScoreSums::default(),
            entered_again: ScoreSums::default(),
            exitance: vec![ScoreSums::default(); texels],
            seen: vec![ScoreSums::default(); texels],
            entering: vec![ScoreSums::default(); texels],
        };
        let sums = tally::run(histories, empty, |rng, sums| {
            let d = beam.unwrap_or_else(|| {
                let o = phase::lambert(rng);
                [o[0], o[1], -o[2]]
            });
            let ray = field.above(corner[0] + uniform(rng) * size[0], corner[1] + uniform(rng) * size[1], d);
            self.history(field, ray, rng, sums);
        })?;
        let n = histories.count;
        // One history carries the flux through the area of the start, divided by the number of histories.
        let per_texel = beam.map_or(1.0, |d| -d[2]) * size[0] * size[1] / (field.texel_mm() * field.texel_mm());
        let map = |sums: &[ScoreSums]| sums.iter().map(|s| s.mean(n).scaled(per_texel)).collect();
        Ok(ReliefWalk {
            histories: n,
            reflected: sums.fates.reflected.mean(n),
            glossy: sums.fates.glossy.mean(n),
            transmitted: sums.fates.transmitted.mean(n),
            passed: sums.passed.mean(n),
            absorbed: sums.fates.absorbed.mean(n),
            lost: sums.fates.lost.mean(n),
            balance: sums.fates.balance.mean(n),
            entered_again: sums.entered_again.mean(n),
            exitance: map(&sums.exitance),
            seen: map(&sums.seen),
            entering: map(&sums.entering),
        })
    }

    fn history(&self, field: &LeafHeightField, ray: Ray, rng: &mut Pcg64, sums: &mut Sums) {
        let mut p = Particle { ray, weight: 1.0, absorbed: 0.0, entries: 0, again: 0.0, left: None };
        let end = self.follow(field, &mut p, rng, sums);
        let w = p.weight;
        let inside = p.entries > 0;
        let leaves = match end {
            Some(Event::Up) => Some(if inside { &mut sums.fates.reflected } else { &mut sums.fates.glossy }),
            Some(Event::Down) => Some(if inside { &mut sums.fates.transmitted } else { &mut sums.passed }),
            Some(_) => Some(&mut sums.fates.lost),
            None => None,
        };
        let mut balance = p.absorbed;
        if let Some(sum) = leaves {
            sum.add(w);
            balance += w;
        }
        if let (Some(Event::Down), Some(texel)) = (end, p.left) {
            sums.exitance[texel].add(w);
            if -p.ray.d[2] > SEEN {
                // the cone holds 1 − c² of a Lambertian's flux
                sums.seen[texel].add(w / (1.0 - SEEN * SEEN));
            }
        }
        sums.fates.absorbed.add(p.absorbed);
        sums.entered_again.add(p.again);
        sums.fates.balance.add(balance);
    }

    /// Follows the particle; `None` where it ends in the tissue.
    fn follow(&self, field: &LeafHeightField, p: &mut Particle, rng: &mut Pcg64, sums: &mut Sums) -> Option<Event> {
        let extinction = self.medium.extinction();
        for _ in 0..EVENTS {
            let inside = p.ray.inside();
            if inside && !survives(&mut p.weight, 1.0, rng) {
                return None;
            }
            let budget = if inside && extinction > 0.0 { -uniform(rng).ln() / extinction } else { f64::INFINITY };
            match field.advance(&mut p.ray, budget) {
                Event::Collision => {
                    p.absorbed += p.weight * (self.medium.sigma_a / extinction);
                    p.weight *= self.medium.albedo();
                    p.ray.d = phase::scattered(p.ray.d, phase::henyey_greenstein(self.medium.g, rng), rng);
                }
                face @ (Event::Front | Event::Back) => {
                    let front = face == Event::Front;
                    toggle(&mut p.ray, front);
                    let enters = p.ray.inside();
                    if enters == inside {
                        continue; // of two faces that leave no tissue between them
                    }
                    let normal = field.normal(&p.ray, front);
                    match self.cross(p.ray.d, normal, enters, rng) {
                        None => return Some(Event::Lost),
                        Some((d, through)) => {
                            p.ray.d = d;
                            if !through {
                                toggle(&mut p.ray, front);
                                continue;
                            }
                        }
                    }
                    if enters {
                        if p.entries > 0 {
                            p.again += p.weight;
                        } else if front && let Some(texel) = field.texel(&p.ray) {
                            sums.entering[texel].add(p.weight);
                        }
                        p.entries = p.entries.saturating_add(1);
                    } else {
                        p.left = if front { None } else { field.texel(&p.ray) };
                    }
                }
                gone => return Some(gone),
            }
        }
        Some(Event::Lost)
    }

    /// Direction after a face of outward normal `n`, and whether the light goes through. `None` where it is given up.
    fn cross(&self, d: Direction, n: Direction, enters: bool, rng: &mut Pcg64) -> Option<(Direction, bool)> {
        let inward = [-n[0], -n[1], -n[2]];
        match self.boundary {
            Boundary::Rough(rough) => {
                let mut local = phase::within(n, d);
                // A ray that grazes the face: the side it comes from is known, but its cosine only to rounding.
                local[2] = if enters { local[2].min(-1e-12) } else { local[2].max(1e-12) };
                let o = rough.scatter(local, rng)?;
                Some((phase::about(n, o), (o[2] < 0.0) == enters))
            }
            Boundary::Diffuse { reflectance } if !enters && uniform(rng) <= reflectance => {
                Some((phase::about(inward, phase::lambert(rng)), false))
            }
            _ if self.spread => Some((phase::about(if enters { inward } else { n }, phase::lambert(rng)), true)),
            _ => Some((d, true)),
        }
    }
}

fn toggle(ray: &mut Ray, front: bool) {
    if front { ray.below_front = !ray.below_front } else { ray.above_back = !ray.above_back }
}
