//! Measurements of the scene that is set, besides its pictures: times, bent vertices, lengths of shaders.

use super::Renderer;
use crate::error::{Error, Result};
use crate::passes::bend;
use crate::readback;
use crate::scene::{Camera, Scene};
use crate::timing::{Clock, FrameTiming, PASSES};
use crate::variant::Variant;
use glam::{Vec3, Vec4};
use std::time::Instant;

/// An instance as a picture has drawn it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnInstance {
    /// Index of its mesh.
    pub mesh: usize,
    /// Index of its material.
    pub material: usize,
    /// Its level of detail.
    pub level: usize,
    /// The three rows of its transform, enlarged as it was drawn. Where the CPU chooses and a section carries the
    /// instance, they are those at rest, from the section's point.
    pub rows: [[f32; 4]; 3],
}

impl Renderer {
    /// Draws the picture `frames` times after one to warm up, without reading it back.
    pub fn time(&mut self, camera: &Camera, width: u32, height: u32, frames: usize) -> Result<FrameTiming> {
        let clock = Clock::new(&self.gpu);
        let mut timing = FrameTiming::default();
        if let Some(shadow) = self.loaded.as_mut().and_then(|l| l.shadow.as_mut()) {
            shadow.forget();
        }
        for i in 0..=frames {
            // Shadow maps are drawn in the first frame, which warms up, and are kept from then on.
            let first = u32::from(i > 0 || self.loaded.as_ref().is_none_or(|l| l.shadow.is_none()));
            let start = Instant::now();
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            self.record(&mut encoder, camera, width, height, clock.as_ref())?;
            if let Some(clock) = &clock {
                clock.resolve(&mut encoder, first);
            }
            self.gpu.queue.submit([encoder.finish()]);
            readback::wait(&self.gpu)?;
            if i > 0 {
                timing.frame_ms.push(start.elapsed().as_secs_f64() * 1e3);
            }
            if let Some(clock) = &clock {
                for (name, ms) in PASSES[first as usize..].iter().zip(clock.read(&self.gpu, first)?) {
                    if i > 0 || *name == "shadow" {
                        match timing.passes.iter_mut().find(|(n, _)| n == name) {
                            Some((_, all)) => all.push(ms),
                            None => timing.passes.push((name.to_string(), vec![ms])),
                        }
                    }
                }
            }
        }
        self.count()?;
        Ok(timing)
    }

    /// Draws a frame without waiting for its end, but for that of the frame before, as programs do that show frames:
    /// the processor prepares a frame while the adapter draws another.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw_ahead(&mut self, camera: &Camera, width: u32, height: u32) -> Result<()> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder, camera, width, height, None)?;
        let own = self.gpu.queue.submit([encoder.finish()]);
        match self.under_way.replace(own) {
            Some(before) => readback::wait_for(&self.gpu, Some(before)),
            None => Ok(()),
        }
    }

    /// The positions, normals and tangents of instance `index` after the vertex stage, in world space. `scene` must be
    /// the one that is set. The same shader function computes them as for pictures.
    ///
    /// # Errors
    /// `Scene` where nothing bends the instance or no scene is set, `Readback`.
    pub fn bent_vertices(&self, scene: &Scene, index: usize) -> Result<Vec<[Vec3; 3]>> {
        let bend = self.loaded.as_ref().and_then(|l| l.bend.as_ref());
        let (Some(bend), Some(instance)) = (bend, scene.instances.get(index).filter(|i| i.carried.is_some())) else {
            let place = format!("instance {index}");
            return Err(Error::Scene {
                place,
                found: "nothing that bends it".into(),
                expected: "an instance that a section of the set scene carries".into(),
            });
        };
        let (mesh, m) = (&scene.meshes[instance.mesh], instance.transform);
        let points = bend::points(scene);
        let rows = bend::rows(scene, instance, &points).map(Vec4::from_array);
        let own = bend::by_vertices(scene, instance, &points).map(|(own, _)| own);
        let of = |k: usize| match &own {
            Some(own) => (Vec3::new(own[k][0], own[k][1], own[k][2]), own[k][3] as i32),
            None => (Vec3::from(rows.map(|row| row.dot(mesh.positions[k].extend(1.0)))), bend::ride(instance)),
        };
        let vertices: Vec<[Vec3; 3]> = (0..mesh.positions.len())
            .map(|k| {
                let turned = |d: Vec3| m.transform_vector3(d);
                [of(k).0, turned(mesh.normals[k]), turned(mesh.tangents[k].truncate())]
            })
            .collect();
        let rides: Vec<i32> = (0..vertices.len()).map(|k| of(k).1).collect();
        bend.probe(&self.gpu, &rides, &vertices)
    }

    /// The box around everything that each branch of the scene's plants carries, as the adapter has posed it and fits
    /// shadow maps to it; `None` for a branch that carries nothing. There are none where the CPU poses the scene.
    ///
    /// # Errors
    /// `Readback`.
    pub fn moving_boxes(&self) -> Result<Vec<Option<[Vec3; 2]>>> {
        let pose = self.loaded.as_ref().and_then(|l| l.bend.as_ref()?.pose.as_ref());
        pose.map_or_else(|| Ok(Vec::new()), |pose| pose.boxes(&self.gpu))
    }

    /// Every instance of leaves and wood that the last picture has drawn, in the order of the draws.
    ///
    /// # Errors
    /// `Readback`.
    pub fn drawn_instances(&self) -> Result<Vec<DrawnInstance>> {
        let mut all = Vec::new();
        for batch in self.loaded.iter().flat_map(|l| &l.batches) {
            let own = match &batch.choice {
                Some(choice) => choice.drawn(&self.gpu)?,
                None => batch.levels.drawn(),
            };
            let (mesh, material) = (batch.mesh, batch.material);
            all.extend(own.into_iter().map(|(level, rows)| DrawnInstance { mesh, material, level, rows }));
        }
        Ok(all)
    }

    /// Number of operations in the fragment shader of material `index` of `scene` (see `operations`), a figure for
    /// comparing shaders. `None` for a material without an instance.
    pub fn operations(&self, scene: &Scene, index: usize) -> Option<usize> {
        let instance = *scene.instances.iter().find(|i| i.material == index)?;
        crate::operations::count(&crate::passes::main::source(&Variant::new(&self.gpu, scene, &[instance])?))
    }
}
