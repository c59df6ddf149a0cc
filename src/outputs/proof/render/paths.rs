//! Camera paths a second on one thread: the crown with matte leaves under an even sky, with at most eight scatterings.

use super::ProofFoliage;
use super::foliage::{EYE, TANGENT};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::ReferenceCamera;
use mesophyll_transport::lobe::Lobe;
use mesophyll_transport::path::{PathPicture, PathRequest, PathSettings, PathTracer, SamplingStrategy, SamplingTarget};
use mesophyll_transport::world::{ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceWorld};
use serde_json::{Value, json};

/// Pixels along a side of the picture, and paths for each pixel.
const PIXELS: usize = 200;
const SAMPLES: u32 = 8;
/// Reflectance of both sides. Nothing is transmitted, because the peer's matte surface transmits nothing.
const RHO: f64 = 0.5;
/// The most scatterings of a path.
const BOUNCES: u32 = 8;

/// The picture that both programs draw.
pub struct ProofScene {
    world: ReferenceWorld,
    pool: rayon::ThreadPool,
}

impl ProofScene {
    /// The crown with flat triangles, because the peer has no normals for its corners.
    ///
    /// # Errors
    /// [`crate::Error::Missed`] where no thread can be started.
    pub fn new(foliage: &ProofFoliage) -> crate::Result<ProofScene> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|e| crate::Error::Missed(format!("no thread could be started: {e}")))?;
        let mut mesh = LeafMesh::default();
        for t in foliage.indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|k| foliage.positions[t[k] as usize]);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(DVec3::Z);
            mesh.indices.extend([0, 1, 2].map(|k| mesh.positions.len() as u32 + k));
            mesh.positions.extend(corners);
            mesh.normals.extend([normal; 3]);
            mesh.uvs.extend([DVec2::ZERO; 3]);
        }
        let sides = [(); 2].map(|()| ReferenceSide::even([RHO; 3], [0.0; 3], None));
        let leaf = ReferenceLeaf::even(mesh, sides, Lobe::Beckmann);
        let instances = vec![ReferencePlacement { leaf: 0, transform: DMat4::IDENTITY }];
        Ok(ProofScene {
            world: ReferenceWorld { leaves: vec![leaf], instances, sky: Some([1.0; 3]), ..ReferenceWorld::default() },
            pool,
        })
    }

    /// Draws the picture once: the mean radiance of all pixels, its standard error, and the time (s) without that of
    /// the box tree, which the peer builds beforehand.
    fn draw(&self) -> crate::Result<(f64, f64, f64)> {
        let paths = PathSettings { bounces: Some(BOUNCES), strategy: SamplingStrategy::default() };
        let tracer = PathTracer::new(&self.world, paths)?;
        let camera = ReferenceCamera { eye: EYE, target: DVec3::ZERO, up: DVec3::Z, fov_y_deg: fov_deg() };
        let target = SamplingTarget { samples: Some(SAMPLES), error: None };
        let request = PathRequest { camera, size: [PIXELS; 2], seed: 1, target };
        let mut picture = PathPicture::new(PIXELS, PIXELS);
        let clock = std::time::Instant::now();
        self.pool.install(|| picture.draw(&tracer, &request, "paths", &mut |_| Ok(())))?;
        let seconds = clock.elapsed().as_secs_f64();
        let pixels = (PIXELS * PIXELS) as f64;
        let mean = picture.mean.iter().map(|p| f64::from(p[1])).sum::<f64>() / pixels;
        let variance: f64 = (0..PIXELS * PIXELS).map(|k| f64::from(picture.error(k)[1]).powi(2)).sum();
        Ok((mean, variance.sqrt() / pixels, seconds))
    }

    /// Time of a camera path (µs), measured over one picture; NaN where it cannot be drawn.
    pub fn time(&self) -> f64 {
        self.draw().map_or(f64::NAN, |(_, _, seconds)| seconds * 1e6 / ProofScene::paths() as f64)
    }

    /// Number of camera paths of the picture.
    fn paths() -> usize {
        PIXELS * PIXELS * SAMPLES as usize
    }

    /// The input that the peer needs, and our result.
    ///
    /// # Errors
    /// Those of the path tracer.
    pub fn told(&self) -> crate::Result<Value> {
        let (mean, error, _) = self.draw()?;
        Ok(json!({
            "eye": EYE.to_array(), "fov_deg": fov_deg(), "pixels": PIXELS, "samples": SAMPLES, "rho": RHO,
            "bounces": BOUNCES, "mean": mean, "error": error,
        }))
    }
}

fn fov_deg() -> f64 {
    2.0 * (0.5 * TANGENT).atan().to_degrees()
}
