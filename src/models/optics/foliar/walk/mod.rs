//! The random walk of rays through the six interfaces (the ABM of B1). It is analog: there is no roulette and no limit
//! of depth.
//!
//! What turns a ray inside the leaf depends only on where the ray goes. So rays wait in queues, one for each layer and
//! direction, for the lobe that brings them into it. A step takes the rays of the longest queue together through lobe,
//! absorption and Fresnel's formula. All rays of a step do the same, so vector instructions can be used. Every part of
//! [`PART`] rays has its own random streams, so the result depends on the seed and not on the number of threads.

mod pass;
mod random;

use super::goniometer::{self, Goniometer};
use super::{LayeredLeaf, MesophyllPath, Oblateness, Side, enter};
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::Lanes;
use mesophyll_base::processor::InstructionSet;
use pass::{RayBatch, WIDTH, WalkPlace, WalkStep};
use random::RandomLanes;
use rayon::prelude::*;

/// How many rays share one set of random streams.
pub const PART: u64 = 1 << 16;
/// How many rays are followed at the same time.
const UNDER_WAY: usize = 2 * WIDTH;
/// Rays that are left this many steps after the last ray was sent are given up. Rounding has caught their light in the
/// antidermal wall: about one ray in a million where this wall has the highest index.
const MOST_STEPS: u64 = 1 << 18;

/// Where rays went.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RayCounts {
    /// How many rays were sent.
    pub rays: u64,
    /// Rays that left on the lit side.
    pub reflected: u64,
    /// Rays that left on the other side.
    pub transmitted: u64,
    /// Rays that were given up.
    pub lost: u64,
}

impl RayCounts {
    /// A share of the rays and its standard error. Where the share is very near 0 or 1, the error is that of a single
    /// ray: that no ray was seen does not mean that none can come.
    pub fn share(&self, count: u64) -> (f64, f64) {
        let n = self.rays as f64;
        let p = (count as f64 + 1.0) / (n + 2.0);
        (count as f64 / n, (p * (1.0 - p) / n).sqrt() + self.lost as f64 / n)
    }

    fn add(&mut self, o: &RayCounts) {
        self.rays += o.rays;
        self.reflected += o.reflected;
        self.transmitted += o.transmitted;
        self.lost += o.lost;
    }
}

/// Sends `rays` rays at `incidence` (radians from the normal, 0 to π/2) onto one side. Between parts it asks `stop`
/// whether to end early; then its result must not be used.
pub fn count(
    leaf: &LayeredLeaf,
    side: Side,
    incidence: f64,
    rays: u64,
    seed: u64,
    stop: &(dyn Fn() -> bool + Sync),
) -> RayCounts {
    let walk = Walk::new(leaf, side, incidence);
    let parts = (0..rays.div_ceil(PART)).into_par_iter().map(|part| {
        let n = PART.min(rays - part * PART);
        if stop() { RayCounts::default() } else { walk.part::<false, _>(n, seed, part, &mut |_, _| ()) }
    });
    parts.reduce(RayCounts::default, |mut a, b| {
        a.add(&b);
        a
    })
}

/// The same, with the directions in which rays leave.
pub fn directions(
    leaf: &LayeredLeaf,
    side: Side,
    incidence: f64,
    rays: u64,
    seed: u64,
    stop: &(dyn Fn() -> bool + Sync),
) -> Goniometer {
    let walk = Walk::new(leaf, side, incidence);
    let parts = (0..rays.div_ceil(PART)).into_par_iter();
    let collect = |mut all: Goniometer, part: u64| {
        let n = PART.min(rays - part * PART);
        if !stop() {
            let found = walk.part::<true, _>(n, seed, part, &mut |lit, ray| all.collect(lit, ray));
            all.counts.add(&found);
        }
        all
    };
    parts.fold(goniometer::Goniometer::empty, collect).reduce(goniometer::Goniometer::empty, |mut a, b| {
        a.patches.iter_mut().zip(&b.patches).for_each(|(a, b)| *a += b);
        a.counts.add(&b.counts);
        a
    })
}

/// The places of a ray: a layer with the direction in which it goes, or outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    UpperDown,
    UpperUp,
    MesophyllDown,
    MesophyllUp,
    AirDown,
    AirUp,
    WallDown,
    WallUp,
    LowerDown,
    LowerUp,
    /// Outside of the upper face. `OutUp` rays are not turned; `MirroredUp` rays are still to be turned by the cuticle.
    OutUp,
    MirroredUp,
    OutDown,
    MirroredDown,
}

const INSIDE: usize = 10;
const PLACES: usize = 14;

/// Where the rays of each inside place go: first when reflected, then when refracted.
const NEXT: [(At, At); INSIDE] = [
    (At::UpperUp, At::MesophyllDown),
    (At::UpperDown, At::OutUp),
    (At::MesophyllUp, At::AirDown),
    (At::MesophyllDown, At::UpperUp),
    (At::AirUp, At::WallDown),
    (At::AirDown, At::MesophyllUp),
    (At::WallUp, At::LowerDown),
    (At::WallDown, At::AirUp),
    (At::LowerUp, At::OutDown),
    (At::LowerDown, At::WallUp),
];

struct Walk {
    places: [WalkPlace; INSIDE],
    /// 1/(ob + 1) of the cuticle.
    cuticle: Option<f32>,
    side: Side,
    surface: f64,
    incidence: f64,
    inside: f64,
}

impl Walk {
    fn new(leaf: &LayeredLeaf, side: Side, incidence: f64) -> Walk {
        let Oblateness { cuticle, epidermis, palisade, spongy } = leaf.oblateness;
        let lobe = |ob: f64| (ob.is_finite()).then_some((1.0 / (ob + 1.0)) as f32);
        let (nc, nm, na) = (leaf.n_cuticle, leaf.n_mesophyll, leaf.n_antidermal);
        let absorbs = (leaf.depth > 0.0).then_some((leaf.depth * std::f64::consts::LOG2_E) as f32);
        let place = |lobe: Option<f32>, absorbs: Option<f32>, here: f64, next: f64| WalkPlace {
            lobe,
            absorbs,
            sieve: leaf.path == MesophyllPath::Sieve,
            ratio: (here / next) as f32,
            excess: ((next - here) * (next + here) / (next * next)) as f32,
        };
        let [epidermis, palisade, spongy] = [epidermis, palisade, spongy].map(lobe);
        let places = [
            place(epidermis, None, nc, nm),
            place(epidermis, None, nc, 1.0),
            place(palisade, absorbs, nm, 1.0),
            place(palisade, absorbs, nm, nc),
            place(spongy, None, 1.0, na),
            place(None, None, 1.0, nm),
            place(None, None, na, nc),
            place(None, None, na, 1.0),
            place(epidermis, None, nc, 1.0),
            place(epidermis, None, nc, na),
        ];
        let (surface, _, inside) = enter(nc, incidence);
        Walk { places, cuticle: lobe(cuticle), side, surface, incidence, inside }
    }

    /// Sends `n` rays. If `DIRECTIONS` is set, the rays that leave are handed to `each`, with whether they left on the
    /// lit side and with their cosines.
    fn part<const DIRECTIONS: bool, E: FnMut(bool, [f32; 3])>(
        &self,
        n: u64,
        seed: u64,
        part: u64,
        each: &mut E,
    ) -> RayCounts {
        let walk = self;
        dispatch_lanes!(
            InstructionSet::detect(),
            F32[DIRECTIONS][E: FnMut(bool, [f32; 3])],
            follow(walk: &Walk, n: u64, seed: u64, part: u64, each: &mut E) -> RayCounts
        )
    }

    /// Sends `n` rays onto the lit face.
    #[inline(always)]
    fn send(&self, random: &mut RandomLanes, n: usize, queues: &mut [RayBatch; PLACES], inner: usize, mirrored: usize) {
        let mut chance = [0.0; WIDTH];
        random.fill(&mut chance[..n.next_multiple_of(random::LANES)]);
        let (surface, cos, inside) = (self.surface as f32, self.incidence.cos() as f32, self.inside as f32);
        for chance in &chance[..n] {
            let (to, mu) = if *chance <= surface { (mirrored, cos) } else { (inner, inside) };
            let rays = &mut queues[to];
            rays.mu[rays.len] = mu;
            // Azimuth 0 points to the source, so the light goes away from it.
            rays.azimuth[0][rays.len] = -1.0;
            rays.azimuth[1][rays.len] = 0.0;
            rays.len += 1;
        }
    }
}

/// [`Walk::part`], whose loops the compiler turns into vectors. All sets compute the same numbers.
#[inline(always)]
#[allow(clippy::extra_unused_type_parameters)] // The lanes say only for which set this is compiled.
fn follow<L: Lanes, const DIRECTIONS: bool, E: FnMut(bool, [f32; 3])>(
    walk: &Walk,
    n: u64,
    seed: u64,
    part: u64,
    each: &mut E,
) -> RayCounts {
    let mut random = RandomLanes::new(seed, part);
    let mut step = WalkStep::new();
    let mut queues: [RayBatch; PLACES] = std::array::from_fn(|_| RayBatch::new(UNDER_WAY));
    let (inner, mirrored) = match walk.side {
        Side::Front => (At::UpperDown as usize, At::MirroredUp as usize),
        Side::Back => (At::LowerUp as usize, At::MirroredDown as usize),
    };
    let (mut out, mut left, mut under_way) = ([0u64; 2], n, 0);
    let mut steps = 0;
    loop {
        if left > 0 && under_way <= UNDER_WAY - WIDTH {
            let sent = left.min(WIDTH as u64) as usize;
            left -= sent as u64;
            walk.send(&mut random, sent, &mut queues, inner, mirrored);
            under_way += sent;
        }
        if under_way == 0 {
            break;
        }
        let longest = (0..PLACES).max_by_key(|&k| queues[k].len).unwrap_or(0);
        if longest >= INSIDE {
            // outside: 0 up, 1 down
            let (down, turned) = ((longest - INSIDE) / 2, (longest - INSIDE) % 2 == 1);
            let rays = &mut queues[longest];
            let before = rays.len;
            if DIRECTIONS {
                let lit = (down == 0) == (walk.side == Side::Front);
                let lobe = if turned { walk.cuticle } else { None };
                step.leave(lobe, &mut random, rays, |ray| each(lit, ray));
            } else {
                rays.len = 0;
            }
            out[down] += (before - rays.len) as u64;
            under_way -= before - rays.len;
            continue;
        }
        let (to_mirrored, to_refracted) = (NEXT[longest].0 as usize, NEXT[longest].1 as usize);
        if let Ok([rays, a, b]) = queues.get_disjoint_mut([longest, to_mirrored, to_refracted]) {
            under_way -= step.run::<DIRECTIONS>(&walk.places[longest], &mut random, rays, a, b) as usize;
        }
        steps += u64::from(left == 0);
        if steps > MOST_STEPS {
            break;
        }
    }
    let [reflected, transmitted] = if walk.side == Side::Front { out } else { [out[1], out[0]] };
    RayCounts { rays: n, reflected, transmitted, lost: under_way as u64 }
}
