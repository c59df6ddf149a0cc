//! Visibility maps: the share of a light that every receiver sees, for one direction of its centre.

use super::casters::Casters;
use super::light::{AreaLight, frame};
use super::receivers::ShadowReceivers;
use crate::Result;
use crate::stage::Stage;
use crate::world::ReferenceWorld;
use glam::{DMat3, DVec3};
use mesophyll_files::progress::{TaskProgress, go_on};
use rayon::prelude::*;

/// A scene that casts shadows on its receivers.
pub struct ShadowScene<'a> {
    stage: Stage<'a>,
    receivers: &'a ShadowReceivers,
    light: &'a AreaLight,
}

/// Number of receivers in a thread's unit of work.
const PIECE: usize = 1024;

impl<'a> ShadowScene<'a> {
    /// Prepares a scene. `receivers` must have been made for this world.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a world that contradicts itself.
    pub fn new(
        world: &'a ReferenceWorld,
        receivers: &'a ShadowReceivers,
        light: &'a AreaLight,
    ) -> Result<ShadowScene<'a>> {
        world.validate()?;
        Ok(ShadowScene { stage: Stage::new(world), receivers, light })
    }

    /// Computes the map of each direction (towards the light's centre; of any length above 0) in order: a byte for each
    /// receiver, 255 times the visible share, rounded. `take` gets its number and the map. Ctrl-C stops it between two
    /// maps.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] after Ctrl-C; those of `take`.
    pub fn maps(&self, directions: &[DVec3], mut take: impl FnMut(usize, &[u8]) -> Result<()>) -> Result<()> {
        let bar = TaskProgress::new("visibility", directions.len() as u64);
        let mut done = 0;
        self.follow(directions.iter().copied(), |_, map| {
            go_on()?;
            take(done, map)?;
            done += 1;
            bar.advance(1);
            Ok(())
        })
    }

    /// Computes the map of each direction that the iterator returns, until it ends, for a light that moves freely.
    /// There is no progress bar. `take` gets the direction and its map.
    ///
    /// # Errors
    /// Those of `take`.
    pub fn follow(
        &self,
        directions: impl Iterator<Item = DVec3>,
        mut take: impl FnMut(DVec3, &[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut casters = Casters::new(&self.stage, self.light);
        let mut map = vec![0; self.receivers.len()];
        for direction in directions {
            if self.stage.world.periodic.is_some() {
                // In a scene that repeats, rays follow the light from cell to cell.
                map = self.by_rays(direction);
            } else {
                casters.look_from(direction);
                self.by_casting(direction, &casters, &mut map);
            }
            take(direction, &map)?;
        }
        Ok(())
    }

    fn by_casting(&self, direction: DVec3, casters: &Casters, map: &mut [u8]) {
        let (from, words) = (frame(direction), casters.words());
        let points: Vec<DVec3> = (0..self.light.len()).map(|k| from * self.light.direction(k)).collect();
        self.each(map, words, |point, normal, hidden| {
            let centre = normal.dot(from.z_axis);
            casters.hide(self.stage.leave(point, normal, from.z_axis).origin, hidden);
            if centre.abs() > self.light.reach() || normal == DVec3::ZERO {
                return;
            }
            // The blade's own plane divides the light. The points behind it are seen from the other side of the blade.
            let mut beyond = vec![0; words];
            casters.hide(self.stage.leave(point, normal, -from.z_axis).origin, &mut beyond);
            for (k, l) in points.iter().enumerate() {
                if (normal.dot(*l) < 0.0) != (centre < 0.0) {
                    hidden[k / 64] = hidden[k / 64] & !(1 << (k % 64)) | beyond[k / 64] & 1 << (k % 64);
                }
            }
        });
    }

    /// The map of a direction by a ray to every point of the light. It is slow, and serves as the reference for the
    /// fast method.
    pub fn by_rays(&self, direction: DVec3) -> Vec<u8> {
        let (from, words) = (frame(direction), self.light.len().div_ceil(64));
        let mut map = vec![0; self.receivers.len()];
        self.each(&mut map, words, |point, normal, hidden| self.hide_by_rays(point, normal, &from, hidden));
        map
    }

    fn hide_by_rays(&self, point: DVec3, normal: DVec3, from: &DMat3, hidden: &mut [u64]) {
        for k in 0..self.light.len() {
            let ray = self.stage.leave(point, normal, *from * self.light.direction(k));
            hidden[k / 64] |= u64::from(self.stage.blocked(&ray)) << (k % 64);
        }
    }

    /// Fills a map. `hide` sets the bits of the light's points that are hidden from a point with a normal.
    fn each(&self, map: &mut [u8], words: usize, hide: impl Fn(DVec3, DVec3, &mut [u64]) + Sync) {
        let points = self.receivers.positions().par_chunks(PIECE).zip(self.receivers.normals().par_chunks(PIECE));
        map.par_chunks_mut(PIECE).zip(points).for_each(|(map, (points, normals))| {
            let mut hidden = vec![0; words];
            for ((value, point), normal) in map.iter_mut().zip(points).zip(normals) {
                hidden.fill(0);
                hide(*point, *normal, &mut hidden);
                *value = self.light.left(&hidden);
            }
        });
    }
}
