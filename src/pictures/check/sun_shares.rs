//! Whether what a vertex sees of the sun at rest still holds while branches and leaves move.
//!
//! Maps of the sun's shares belong to plants at rest, so scenes that move draw shadow maps instead. Here the shares at
//! the time of a view are worked out as well, and held against those at rest, and against knowing the mean share alone.

use mesophyll_base::error::Result;
use mesophyll_transport::ReferenceWorld;
use mesophyll_transport::visibility::{AreaLight, ShadowReceivers, ShadowScene};
use serde::Serialize;

/// Number of points that stand for the sun's disk, as in `fit transfer`.
const POINTS: usize = 64;

/// The sun's shares at the vertices of leaves, at rest and at another time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SunShareChange {
    /// The view's name.
    pub view: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Root mean square of the difference between both times, of a share from 0 to 1.
    pub rms: f64,
    /// Root mean square of the shares at that time around their mean: the error of who knows no more than the mean.
    pub spread: f64,
    /// Mean share at rest.
    pub mean_at_rest: f64,
    /// Mean share at that time.
    pub mean: f64,
}

impl SunShareChange {
    /// The figures in one line.
    pub fn line(&self) -> String {
        format!(
            "{}: what {} vertices of leaves see of the sun at rest is off by {:.3} (RMS) at this time; their mean \
             alone would be off by {:.3} (means {:.3} at rest, {:.3} now)\n",
            self.view, self.vertices, self.rms, self.spread, self.mean_at_rest, self.mean
        )
    }
}

/// Compares the shares in two worlds that differ in nothing but the places of their instances. The first `leaves` of
/// their leaves are leaves; the others are wood and ground, which only hide. `None` without a sun or without leaves.
///
/// # Errors
/// As [`ShadowReceivers::new`], and [`mesophyll_base::error::Error::Interrupted`] after Ctrl-C.
pub fn kept(view: &str, rest: &ReferenceWorld, now: &ReferenceWorld, leaves: usize) -> Result<Option<SunShareChange>> {
    let (a, b) = (shares(rest, leaves)?, shares(now, leaves)?);
    if a.is_empty() || a.len() != b.len() {
        return Ok(None);
    }
    let count = a.len() as f64;
    let mean = |of: &[f64]| of.iter().sum::<f64>() / count;
    let off = |pairs: &mut dyn Iterator<Item = f64>| (pairs.map(|d| d * d).sum::<f64>() / count).sqrt();
    let (mean_at_rest, mean_now) = (mean(&a), mean(&b));
    Ok(Some(SunShareChange {
        view: view.into(),
        vertices: a.len(),
        rms: off(&mut a.iter().zip(&b).map(|(a, b)| a - b)),
        spread: off(&mut b.iter().map(|b| b - mean_now)),
        mean_at_rest,
        mean: mean_now,
    }))
}

/// The share of the sun, 0 to 1, that each vertex of each leaf sees.
fn shares(world: &ReferenceWorld, leaves: usize) -> Result<Vec<f64>> {
    let Some(sun) = &world.sun else { return Ok(Vec::new()) };
    let receivers = ShadowReceivers::new(world, &[])?;
    let light = AreaLight::disk(sun.radius.max(1e-6), POINTS)?;
    let mut out = Vec::new();
    ShadowScene::new(world, &receivers, &light)?.maps(&[sun.direction], |_, map| {
        let own = (0..world.instances.len()).filter(|k| world.instances[*k].leaf < leaves);
        out = own.flat_map(|k| &map[receivers.of(k)]).map(|share| f64::from(*share) / 255.0).collect();
        Ok(())
    })?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DVec2, DVec3};
    use mesophyll_files::mesh::LeafMesh;
    use mesophyll_transport::lobe::Lobe;
    use mesophyll_transport::{ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceSun, ReferenceWorld};

    /// A small triangle below a large one that moves aside: the lower one's three vertices are dark at rest and lit
    /// afterwards, those of the upper one are always lit, and a trunk hides and is not counted.
    #[test]
    fn a_shadow_that_moves_away_is_counted() {
        let side = || ReferenceSide::even([0.1; 3], [0.1; 3], None);
        let leaf = |reach: f64| {
            let at = |x: f64, y: f64| DVec3::new(x * reach, y * reach, 0.0);
            let mesh = LeafMesh {
                positions: vec![at(-1.0, -1.0), at(1.0, -1.0), at(0.0, 1.0)],
                normals: vec![DVec3::Z; 3],
                uvs: vec![DVec2::ZERO; 3],
                indices: vec![0, 1, 2],
                ..LeafMesh::default()
            };
            ReferenceLeaf::even(mesh, [side(), side()], Lobe::Beckmann)
        };
        let world = |aside: f64| ReferenceWorld {
            leaves: vec![leaf(1.0), leaf(20.0), leaf(3.0)],
            instances: [(0, DVec3::ZERO), (1, DVec3::new(aside, 0.0, 5.0)), (2, DVec3::new(-500.0, 0.0, 0.0))]
                .map(|(leaf, at)| ReferencePlacement { leaf, transform: DMat4::from_translation(at) })
                .to_vec(),
            sun: Some(ReferenceSun { direction: DVec3::Z, irradiance: [1.0; 3], radius: 0.00465 }),
            ..ReferenceWorld::default()
        };
        let found = kept("side", &world(0.0), &world(100.0), 2).unwrap().unwrap();
        assert_eq!((found.vertices, found.mean_at_rest, found.mean), (6, 0.5, 1.0));
        assert!((found.rms - 0.5f64.sqrt()).abs() < 1e-12 && found.spread == 0.0, "{found:?}");
        let same = kept("side", &world(0.0), &world(0.0), 2).unwrap().unwrap();
        assert!(same.rms == 0.0 && (same.spread - 0.5).abs() < 1e-12, "{same:?}");
        assert_eq!(kept("side", &ReferenceWorld { sun: None, ..world(0.0) }, &world(0.0), 2).unwrap(), None);
    }
}
