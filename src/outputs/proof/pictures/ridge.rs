//! How high a lawn stands out over the ridge of a hill: drawn as slices, by rays that meet blades, and what the hill
//! without grass would show. It is the view `ridge` of data/grass/scenes/hill.toml.

use super::BenchRow;
use glam::{DMat4, DVec3};
use mesophyll_base::error::{Error, Result};
use mesophyll_check::told;
use mesophyll_files::atomic;
use mesophyll_fits::grass::hill::Hill;
use mesophyll_scene::draw::{handover, reference};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::CameraRays;
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};
use mesophyll_viewer as gpu;
use rayon::prelude::*;

const SCENE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/scenes/hill.toml"));
const LAWN: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/lawn.toml"));
/// Rays along each side of a pixel.
const RAYS: usize = 4;

/// Heights over the edge of the level ground, in pixels: means over the columns of the picture in which the hill
/// without grass stands over that edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawnSilhouettes {
    /// The hill without grass, by its formula.
    pub bare: f64,
    /// Blades and ground, as the path tracer has them.
    pub blades: f64,
    /// Slices.
    pub slices: f64,
}

/// Measures the silhouettes in a picture that is `width` pixels wide.
///
/// # Errors
/// Those of reading and drawing, and [`Error::Interrupted`] after a stop.
pub fn silhouettes(renderer: &mut gpu::Renderer, width: u32) -> Result<LawnSilhouettes> {
    let folder = tempfile::tempdir().map_err(|e| Error::Missed(format!("no folder for a hill: {e}")))?;
    let scenes = folder.path().join("scenes");
    std::fs::create_dir_all(&scenes).map_err(|e| Error::write(&scenes, atomic::explain(&e)))?;
    atomic::write_bytes(&folder.path().join("lawn.toml"), LAWN.as_bytes())?;
    atomic::write_bytes(&scenes.join("hill.toml"), SCENE.as_bytes())?;
    let manifest = SceneManifest::read(&scenes.join("hill.toml"))?;
    let height = width * manifest.check.height / manifest.check.width;
    let ledger = Ledger::new();
    let scene = LoadedScene::open(manifest, LeafSearch::default(), &ledger)?;
    let missing = |what: &str| Error::field(&scene.manifest.path, what, "missing");
    let view = scene.manifest.perspectives().find(|v| v.name == "ridge").ok_or_else(|| missing("view \"ridge\""))?;
    let hill = mesophyll_scene::placed::grass::hill(&scene.manifest).ok_or_else(|| missing("ground.hill"))?;
    let reach = scene.manifest.ground.as_ref().and_then(|g| g.reach_mm).ok_or_else(|| missing("ground.reach_mm"))?;
    let camera = view.camera;
    let (w, h) = (width as usize, height as usize);
    let lens = CameraRays::new(&camera, w, h)?;
    // The share of every pixel whose rays meet something.
    let shown = |meets: &(dyn Fn(&Ray) -> bool + Sync)| -> Vec<f64> {
        let one = |k: usize| {
            let inside = |n: usize| (n as f64 + 0.5) / RAYS as f64;
            let ray = |n: usize| lens.ray((k % w) as f64 + inside(n % RAYS), (k / w) as f64 + inside(n / RAYS));
            (0..RAYS * RAYS).filter(|n| meets(&ray(*n))).count() as f64 / (RAYS * RAYS) as f64
        };
        (0..w * h).into_par_iter().map(one).collect()
    };
    let ground = |hill: Hill| shown(&move |ray: &Ray| meets(&hill, ray, reach));
    // Rows of each column that show something.
    let columns = |seen: &[f64]| (0..w).map(|x| (0..h).map(|y| seen[y * w + x]).sum::<f64>()).collect::<Vec<f64>>();
    let level = columns(&ground(Hill { height: 0.0, ..hill }));
    let bare = columns(&ground(hill));
    let wide: Vec<usize> = (0..w).filter(|x| bare[*x] > level[*x] + 1.0).collect();
    let over = |seen: &[f64]| wide.iter().map(|x| seen[*x] - level[*x]).sum::<f64>() / wide.len() as f64;
    let world = reference::traced(&scene, 0.0, &ledger)?;
    let shapes = world.leaves.iter().map(|l| TriangleTree::new(&l.mesh.positions, &l.mesh.indices)).collect();
    let placed: Vec<(usize, DMat4)> = world.instances.iter().map(|i| (i.leaf, i.transform)).collect();
    let forest = InstanceForest::new(shapes, &placed);
    let far = 4.0 * (camera.eye.length() + reach);
    let blades = over(&columns(&shown(&|ray: &Ray| forest.blocked_within(ray, far, |_, _, _| true))));
    renderer.set_scene(&handover::scene(&scene, &ledger)?).map_err(told)?;
    let picture = renderer.render(&handover::camera(&view.camera), width, height).map_err(told)?;
    let drawn: Vec<f64> = picture.hdr.iter().map(|p| f64::from(p[3])).collect();
    Ok(LawnSilhouettes { bare: over(&bare), blades, slices: over(&columns(&drawn)) })
}

/// Whether a ray from above meets the ground with this hill within the square that reaches `reach` mm from the
/// origin. It is tried at steps of 1 mm, from the height of the hill down to that of the level ground.
fn meets(hill: &Hill, ray: &Ray, reach: f64) -> bool {
    let falls = -ray.direction.z;
    if falls <= 0.0 {
        return false;
    }
    let at = |over: f64| ((ray.origin.z - over) / falls).max(0.0);
    let (first, last) = (at(hill.height.max(0.0)), at(hill.height.min(0.0)));
    let place = |t: f64| ray.origin + ray.direction * t;
    let met = |p: DVec3| p.truncate().abs().max_element() <= reach && p.z <= hill.rise(p.truncate()) + 1e-9;
    met(place(last)) || (0..(last - first) as usize).any(|k| met(place(first + k as f64)))
}

/// The row of `mesophyll bench grass`. The error is that of the height over the hill without grass.
///
/// # Errors
/// Those of [`silhouettes`].
pub fn row(renderer: &mut gpu::Renderer) -> Result<BenchRow> {
    let found = silhouettes(renderer, 360)?;
    Ok(BenchRow {
        model: "grass".into(),
        knob: "silhouette".into(),
        setting: "the ridge of hill.toml".into(),
        error: f64::NAN,
        us: f64::NAN,
        note: format!(
            "pixels over the edge of the level ground, in the mean over the hill's width: without grass {:.1} (by \
             its formula), blades {:.1}, slices {:.1}; 360x240 on {}",
            found.bare,
            found.blades,
            found.slices,
            renderer.adapter().name
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    /// A hill of no height is met where the level ground is, up to its edge.
    #[test]
    fn rays_meet_level_ground_up_to_its_edge() {
        let flat = Hill { middle: DVec2::ZERO, height: 0.0, radius: 100.0 };
        let eye = DVec3::new(0.0, -1900.0, 260.0);
        for (to, met) in [(1990.0, true), (2010.0, false)] {
            let ray = Ray::new(eye, (DVec3::new(0.0, to, 0.0) - eye).normalize());
            assert_eq!(meets(&flat, &ray, 2000.0), met, "{to}");
        }
        let straight = |d: DVec3| meets(&flat, &Ray::new(eye, d), 2000.0);
        assert!(!straight(DVec3::Z) && straight(DVec3::NEG_Z));
    }
}
