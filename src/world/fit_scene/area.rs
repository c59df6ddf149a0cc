//! How many discs there are: a canopy with some of its discs taken away, or with copies of some added.
//!
//! No path can be differentiated by the number of leaves that it might meet. So the derivative is a difference of two
//! canopies, with a few discs less and with a few more, by paths with the same random numbers; every disc of the one
//! stands in the other too. The difference is central; at the limits of the area it is one-sided. For a reflectance
//! that nears its limit as exp(−k · area), its bias is (STEP · k)² / 6 of the derivative, or STEP · k / 2 at the
//! limits. That changes a standard error by as much, and not where the search ends.
//!
//! Which discs these are is drawn by the fit's seed, and is the same for all steps. With one draw, what is shown would
//! change with the area disc by disc, now by a high one and now by one in the dark; so it is the mean over several
//! draws. Which discs really are gone, and where others stand, nobody knows; [`crate::scatter`] finds what that
//! changes.

use crate::quantity::{UnknownKind, UnknownQuantity};
use crate::unknowns::SceneUnknowns;
use glam::DVec3;
use mesophyll_base::random::RandomStream;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::unit::LengthUnit;
use mesophyll_scene::manifest::AREA;
use mesophyll_transport::path::slopes::DerivativePicture;
use mesophyll_transport::world::ReferenceWorld;
use std::collections::HashSet;

/// Least and largest area, as a factor on what the scene states.
pub const LIMITS: [f64; 2] = [0.2, 2.0];
/// Half of the difference of areas from which the derivative follows.
const STEP: f64 = 0.1;
/// The fewest discs of which a part can be taken away.
const FEWEST: usize = 10;
/// Most draws whose mean is shown. There are more than two only while they have at most so many discs together.
const DRAWS: usize = 8;
const TOGETHER: usize = 20_000;
/// Bytes of a disc in a world, and in the tree that finds it.
const BYTES: u64 = 1000;
/// A copy is moved by at most so many times the distance to the next disc. It then has about 64 discs around it, of
/// which the one that it was made of is but one: copies hide behind their own discs no more than behind others.
const REACH: f64 = 2.0;
/// Places that are tried for a copy until one is near a disc, so that gaps between crowns stay empty.
const TRIES: usize = 32;
/// A disc of which less is left counts as gone.
const LEAST: f64 = 1e-3;

/// The discs of one leaf, of which there can be fewer or more.
pub struct DiscPopulation {
    /// Index of the leaf in the world.
    leaf: usize,
    /// Middles of the discs, in the coordinates of their list.
    centres: Vec<DVec3>,
    /// The box around them.
    bounds: [DVec3; 2],
    /// How far the next disc is, about.
    apart: f64,
    /// Cells of this size that have a disc in them, or in one beside them.
    near: HashSet<[i64; 3]>,
    /// A height (mm) above which no disc stands, whatever the area.
    top: f64,
}

/// A disc that stands: which of the list, its size over that of the list, and how far from there.
type StandingDisc = (usize, f64, DVec3);

impl DiscPopulation {
    /// The discs of leaf `leaf` of a world.
    ///
    /// # Errors
    /// What was found and what is expected, for too few discs.
    pub fn new(world: &ReferenceWorld, leaf: usize) -> std::result::Result<Self, String> {
        let mesh = &world.leaves[leaf].mesh;
        let centres: Vec<DVec3> = (0..mesh.triangles()).map(|disc| centre(mesh, disc)).collect();
        if centres.len() < FEWEST {
            let found = format!("found \"{AREA}\" of a list of {} discs", centres.len());
            return Err(format!("{found}, expected at least {FEWEST}, so that some of them can be taken away"));
        }
        let far = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let around = |all: &[DVec3]| all.iter().fold(far, |[low, high], at| [low.min(*at), high.max(*at)]);
        let bounds = around(&centres);
        let size = bounds[1] - bounds[0];
        let apart = apart(size, centres.len());
        // Corners are two radii from a middle.
        let radii = (0..centres.len()).map(|disc| radius(mesh, disc));
        let margin = DVec3::splat(2.0 * radii.fold(0.0, f64::max));
        let [low, high] = [bounds[0] - margin, bounds[1] + margin];
        let corner = |k: usize| DVec3::select(glam::BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low);
        let placed = world.instances.iter().filter(|placed| placed.leaf == leaf);
        let top = placed.flat_map(|p| (0..8).map(|k| p.transform.transform_point3(corner(k)).z)).fold(0.0, f64::max);
        let beside = |at: &DVec3| {
            let [x, y, z] = cell(*at, apart);
            [[x, y, z], [x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]]
        };
        let near = centres.iter().flat_map(beside).collect();
        Ok(DiscPopulation { leaf, bounds, apart, near, top, centres })
    }

    /// The discs with this area, by draw `draw` of a seed. The last of them has the size that is left for it, so that
    /// what is shown changes with the area without a jump.
    fn standing(&self, area: f64, [seed, draw]: [u64; 2]) -> Vec<StandingDisc> {
        let n = self.centres.len();
        let stream = |what: u64, disc: usize| RandomStream::new(seed, &[draw, self.leaf as u64, what, disc as u64]);
        let shuffled = |what: u64| {
            let mut keyed: Vec<(u64, usize)> = (0..n).map(|disc| (stream(what, disc).bits(), disc)).collect();
            keyed.sort_unstable();
            keyed.into_iter().map(|(_, disc)| disc)
        };
        let reach = (self.bounds[1] - self.bounds[0]).min(DVec3::splat(REACH * self.apart));
        let copy = |disc: usize| {
            let mut random = stream(2, disc);
            let places = (0..TRIES).map(|_| {
                let aside = reach * DVec3::new(random.signed(), random.signed(), random.signed());
                self.inside(self.centres[disc] + aside)
            });
            let place = places.into_iter().find(|at| self.near.contains(&cell(*at, self.apart)));
            place.map_or(DVec3::ZERO, |at| at - self.centres[disc])
        };
        let all = shuffled(0).map(|disc| (disc, DVec3::ZERO)).chain(shuffled(1).map(|disc| (disc, copy(disc))));
        let part = |rank: usize| (area * n as f64 - rank as f64).min(1.0);
        let of = |(rank, (disc, aside)): (usize, (usize, DVec3))| (disc, part(rank).max(0.0).sqrt(), aside);
        all.enumerate().take_while(|(rank, _)| part(*rank) > LEAST).map(of).collect()
    }

    /// A place within the box, from whose sides it is turned back.
    fn inside(&self, at: DVec3) -> DVec3 {
        let [low, high] = self.bounds;
        let turned = DVec3::select(at.cmplt(low), 2.0 * low - at, at);
        DVec3::select(turned.cmpgt(high), 2.0 * high - turned, turned).clamp(low, high)
    }
}

/// How far the next of so many discs is, about, in a box of this size.
fn apart(size: DVec3, discs: usize) -> f64 {
    let mut wide: Vec<f64> = size.to_array().into_iter().filter(|s| *s > 0.0).collect();
    wide.sort_by(f64::total_cmp);
    let mean = |wide: &[f64]| (wide.iter().product::<f64>() / discs as f64).powf(1.0 / wide.len().max(1) as f64);
    // Along a side that is thinner than that, discs stand in one layer.
    while wide.len() > 1 && wide[0] < mean(&wide) {
        wide.remove(0);
    }
    mean(&wide)
}

/// The cell of a place.
fn cell(at: DVec3, size: f64) -> [i64; 3] {
    (at / size).to_array().map(|v| v.floor() as i64)
}

/// The middle of a disc.
fn centre(mesh: &LeafMesh, disc: usize) -> DVec3 {
    mesh.triangle(disc).iter().map(|k| mesh.positions[*k]).sum::<DVec3>() / 3.0
}

/// The radius of a disc, whose corners are two radii from its middle.
fn radius(mesh: &LeafMesh, disc: usize) -> f64 {
    0.5 * centre(mesh, disc).distance(mesh.positions[mesh.triangle(disc)[0]])
}

/// The discs that stand.
fn discs(from: &LeafMesh, standing: &[StandingDisc]) -> LeafMesh {
    let mut out = LeafMesh { discs: true, ..LeafMesh::default() };
    for (disc, size, aside) in standing {
        let middle = centre(from, *disc);
        for k in from.triangle(*disc) {
            out.indices.push(out.positions.len() as u32);
            out.positions.push(middle + *aside + (from.positions[k] - middle) * *size);
            out.normals.push(from.normals[k]);
            out.tangents.push(from.tangents[k]);
            out.uvs.push(from.uvs[k]);
        }
    }
    out
}

/// The unknown area of the discs of a leaf.
pub fn unknown(leaf: usize, name: &str) -> UnknownQuantity {
    UnknownQuantity {
        kind: UnknownKind::Area(leaf),
        name: format!("leaf.{name}.{AREA}"),
        at: vec![1.0],
        low: LIMITS[0],
        high: vec![LIMITS[1]],
        scale: Some(1e-9),
    }
}

impl SceneUnknowns {
    /// Indices of the unknowns that are areas, each with its discs.
    pub fn areas(&self) -> impl Iterator<Item = (usize, &DiscPopulation)> {
        self.list.iter().enumerate().filter_map(|(k, q)| match q.kind {
            UnknownKind::Area(leaf) => Some((k, self.populations.get(&leaf)?)),
            _ => None,
        })
    }

    /// How many draws of the discs there are: one where no area is unknown.
    pub fn draws(&self) -> u64 {
        let all: usize = self.areas().map(|(_, population)| population.centres.len()).sum();
        TOGETHER.checked_div(all).map_or(1, |draws| draws.clamp(2, DRAWS) as u64)
    }

    /// Bytes of all worlds with other discs.
    pub fn disc_bytes(&self) -> u64 {
        let all: usize = self.areas().map(|(_, population)| population.centres.len()).sum();
        self.draws() * all as u64 * BYTES * (1 + 4 * self.areas().count() as u64)
    }

    /// The areas on both sides of that of unknown `k` from which its derivative follows.
    pub fn beside(&self, k: usize) -> [f64; 2] {
        let q = &self.list[k];
        [-STEP, STEP].map(|step| (q.at[0] + step).clamp(q.low, q.high[0]))
    }

    /// A world in which as many discs stand as the present numbers say, or with another area of one unknown.
    pub fn counted(&self, world: &ReferenceWorld, draw: u64, other: Option<(usize, f64)>) -> ReferenceWorld {
        let mut out = world.clone();
        for (k, population) in self.areas() {
            let area = other.filter(|(own, _)| *own == k).map_or(self.list[k].at[0], |(_, area)| area);
            let mesh = &mut out.leaves[population.leaf].mesh;
            *mesh = discs(mesh, &population.standing(area, [self.seed, draw]));
        }
        out
    }

    /// A height (mm) from which rays reach every disc that could be added; below everything where no area is unknown.
    /// Rays of the same random numbers begin at the same points then.
    pub fn top(&self) -> f64 {
        self.areas().map(|(_, population)| population.top).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The discs that stand in the end of each leaf whose area is unknown: its name, and the list's lines.
    pub fn found_discs(&self) -> Vec<(String, String)> {
        let of = |(k, population): (usize, &DiscPopulation)| {
            let name = self.leaf_name(population.leaf);
            let stated = self.manifest.leaves.iter().find(|leaf| leaf.name == name);
            let unit = stated.and_then(|leaf| leaf.mesh_unit).unwrap_or(LengthUnit::Metre).mm();
            let mesh = &self.world.leaves[population.leaf].mesh;
            let mut text = String::from("# radius, centre x y z, normal x y z\n");
            for (disc, size, aside) in population.standing(self.list[k].at[0], [self.seed, 0]) {
                let radius = size * radius(mesh, disc) / unit;
                let ([x, y, z], n) =
                    (((centre(mesh, disc) + aside) / unit).to_array(), mesh.normals[mesh.triangle(disc)[0]]);
                text += &format!("{radius} {x} {y} {z} {} {} {}\n", n.x, n.y, n.z);
            }
            (name, text)
        };
        self.areas().map(of).collect()
    }
}

/// The mean of pictures by paths of their own.
pub fn averaged(pictures: Vec<DerivativePicture>) -> DerivativePicture {
    let share = 1.0 / pictures.len().max(1) as f64;
    let add = |to: &mut Vec<f64>, of: &[f64]| to.iter_mut().zip(of).for_each(|(to, v)| *to += v);
    let mut all = pictures.into_iter();
    let mut out = all.next().unwrap_or_default();
    for picture in all {
        add(&mut out.mean, &picture.mean);
        add(&mut out.variance, &picture.variance);
        add(&mut out.slopes, &picture.slopes);
    }
    out.mean.iter_mut().chain(&mut out.slopes).for_each(|v| *v *= share);
    out.variance.iter_mut().for_each(|v| *v *= share * share);
    out
}

/// Adds a derivative as the last parameter of a picture: the difference of two pictures times `over`.
pub fn differ(to: &mut DerivativePicture, [low, high]: [&DerivativePicture; 2], over: f64) {
    let (n, had) = (to.channels, to.channels * to.parameters);
    let old = std::mem::take(&mut to.slopes);
    for (place, (low, high)) in low.mean.chunks_exact(n).zip(high.mean.chunks_exact(n)).enumerate() {
        to.slopes.extend_from_slice(&old[place * had..][..had]);
        to.slopes.extend(low.iter().zip(high).map(|(a, b)| over * (b - a)));
    }
    to.parameters += 1;
}
