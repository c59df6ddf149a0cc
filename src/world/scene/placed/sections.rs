//! The cross-sections of a plant's branches that carry something: one for each leaf, and those of the bark's vertices.
//! Both renderers move plants by these alone.

use super::plant::{PlacedPlant, PlacedWood};
use glam::DMat4;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_plants::form::Joint;
use mesophyll_plants::pose::bark::BarkCarriers;
use mesophyll_plants::pose::{Pose, RigidMotion};
use rayon::prelude::*;
use std::sync::Arc;

/// The number of sections that are worth a thread of their own.
const SHARE: usize = 256;

/// The sections of one plant, which are the same at each of its places.
#[derive(Debug)]
pub struct PlantSections {
    /// Branch and share of its axis: those of the leaves in their order, then those of the bark.
    on: Vec<(usize, f64)>,
    leaves: usize,
    /// For each wood of [`PlacedPlant::wood`], the section that carries each vertex.
    bark: Vec<Arc<Vec<u32>>>,
    /// Number of the plant's first section among those of the scene.
    first: usize,
    places: Vec<DMat4>,
    /// Whether its plants share poses.
    shared: bool,
}

/// How the bark of a plant that moves is carried.
#[derive(Debug, Clone, PartialEq)]
pub struct BarkMotion {
    /// Number of the plant's first section among those of the scene.
    pub first: usize,
    /// The section of each vertex, counted from there.
    pub of_vertices: Arc<Vec<u32>>,
}

impl PlantSections {
    /// The sections of a plant. They follow the `first` sections of the scene.
    pub fn new(planted: &PlacedPlant, first: usize) -> PlantSections {
        let mut on: Vec<(usize, f64)> = planted.plant.leaves.iter().map(|l| (l.joint.branch, l.joint.at)).collect();
        let bark = planted.barks().map(|branches| {
            let mut of_vertices = Vec::new();
            for (k, branch) in branches {
                let own = BarkCarriers::new(branch);
                let first = on.len() as u32;
                on.extend(own.at.iter().map(|at| (k, *at)));
                of_vertices.extend(own.of_vertices.iter().map(|section| first + section));
            }
            Arc::new(of_vertices)
        });
        let bark = bark.collect();
        // Plants that share poses move in their own frame.
        let places = match &planted.groups {
            Some(groups) => vec![DMat4::IDENTITY; groups.leaders.len()],
            None => planted.places.clone(),
        };
        PlantSections { on, leaves: planted.plant.leaves.len(), bark, first, places, shared: planted.groups.is_some() }
    }

    /// Branch and share of its axis of every section of a place. Those of the leaves come first, in the leaves' order.
    pub fn on(&self) -> &[(usize, f64)] {
        &self.on
    }

    /// Number of the plant's first section among those of the scene.
    pub fn first(&self) -> usize {
        self.first
    }

    /// The transforms from plant to world; from the plant's own frame to itself where plants share poses, once for each
    /// pose.
    pub fn places(&self) -> &[DMat4] {
        &self.places
    }

    /// Number of the first section after these.
    pub fn end(&self) -> usize {
        self.first + self.places.len() * self.on.len()
    }

    /// Number of the section of leaf `leaf` at a place.
    pub fn of_leaf(&self, place: usize, leaf: usize) -> usize {
        self.first + place * self.on.len() + leaf
    }

    /// The motions from rest of the sections of a place in a pose, in world space.
    pub fn at(&self, place: usize, pose: &Pose) -> Vec<RigidMotion> {
        let to_world = self.places[place];
        let own = |(k, (branch, at)): (usize, &(usize, f64))| match k < self.leaves {
            true => pose.leaf(k, Joint { branch: *branch, at: *at }),
            false => pose.at(*branch, *at),
        };
        let all = self.on.par_iter().enumerate().with_min_len(SHARE);
        all.map(|section| own(section).moved(to_world)).collect()
    }

    /// The plant's wood, separate for every place, because each bends differently. Plants that share poses have it
    /// once.
    pub fn wood(&self, rest: Vec<PlacedWood>) -> Vec<PlacedWood> {
        let at = |(k, place): (usize, &DMat4)| {
            let first = self.of_leaf(k, 0);
            let wood = rest.iter().zip(&self.bark).map(|(wood, of_vertices)| {
                let bark = Some(BarkMotion { first, of_vertices: of_vertices.clone() });
                PlacedWood { places: vec![*place], bark_moves: bark, ..wood.clone() }
            });
            wood.collect::<Vec<PlacedWood>>()
        };
        let apart = if self.shared { 1 } else { self.places.len() };
        self.places[..apart].iter().enumerate().flat_map(at).collect()
    }
}

impl PlacedWood {
    /// Its mesh in its own frame, moved by the scene's sections; `None` where none carries it.
    pub fn moved(&self, sections: &[RigidMotion]) -> Option<LeafMesh> {
        self.moved_by(&sections[self.bark_moves.as_ref()?.first..])
    }

    /// The same, moved by sections of which the first is the plant's first.
    pub fn moved_by(&self, sections: &[RigidMotion]) -> Option<LeafMesh> {
        let (bark, place) = (self.bark_moves.as_ref()?, self.places.first()?);
        let back = place.inverse();
        let mut mesh = self.mesh.clone();
        for (k, own) in bark.of_vertices.iter().enumerate() {
            let by = &sections[*own as usize];
            let turned = |v| back.transform_vector3(by.turn * place.transform_vector3(v));
            mesh.positions[k] = back.transform_point3(by.place(place.transform_point3(mesh.positions[k])));
            mesh.normals[k] = turned(mesh.normals[k]);
            mesh.tangents[k].0 = turned(mesh.tangents[k].0);
        }
        Some(mesh)
    }
}
