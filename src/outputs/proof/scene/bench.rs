//! Error against processor time of `fit scene`, and the scene on which its peers are measured. The time that processors
//! spend on a program depends little on what others do meanwhile.

use crate::bench::BenchRow;
use crate::peers::PeerInputs;
use crate::{Error, Result};
use mesophyll_fit_scene::synthetic::{BOTH, START, SyntheticExposure, TRUTH, crowd, opened, photograph, scene};
use mesophyll_fit_scene::{Options, processor, run};
use mesophyll_fits::record::maker::FitOutcome;
use mesophyll_scene::draw::reference;
use mesophyll_scene::placed::ledger::Ledger;
use std::time::Instant;
use tempfile::TempDir;

/// What the numbers of [`TRUTH`] are called in a fit, and in the files of peers.
const NAMES: [(&str, &str); 4] = [
    ("leaf.a.front.rho_d", "front"),
    ("leaf.a.back.rho_d", "back"),
    ("leaf.a.rho_t", "through"),
    ("ground.albedo", "ground"),
];
/// Most paths a pixel of the sweep.
const PATHS: [u32; 3] = [64, 256, 1024];
/// Where a peer may stop.
const TARGET: f64 = 0.01;

/// A scene with pictures in a folder, whose numbers start wrong by a factor of two.
struct Problem {
    folder: TempDir,
    text: String,
}

impl Problem {
    /// `of` makes the scene's text from its numbers and further tables; `pictures` are those that are fitted.
    fn new(of: fn([[f64; 3]; 5], &str) -> String, pictures: &str) -> Result<Problem> {
        let folder = tempfile::tempdir().map_err(|e| Error::Missed(format!("no folder for pictures: {e}")))?;
        photograph(folder.path(), &of(TRUTH, ""), 1.0, |_, v| v)?;
        let unknown = "[unknown]\nleaves = { a = [\"rho_d\", \"rho_t\"] }\nground = [\"albedo\"]\n";
        Ok(Problem { folder, text: of(START, &format!("{pictures}{unknown}")) })
    }

    /// Fits it. The error is the root mean square of what the twelve numbers are off by, over their true values; the
    /// time is that of all processors, where the system says it.
    fn row(&self, knob: &str, setting: String, paths: u32, note: &str) -> Result<BenchRow> {
        let scene = opened(self.folder.path(), &self.text)?;
        let options = Options { samples: paths, seed: 5, force: true };
        let (clock, before) = (Instant::now(), processor::seconds());
        let ended = run(&scene, &self.folder.path().join("fit"), &options, &Ledger::new())?;
        let spent = processor::seconds().zip(before).map(|(now, then)| now - then);
        let us = 1e6 * spent.unwrap_or_else(|| clock.elapsed().as_secs_f64());
        let FitOutcome::Done(record) = ended else { return Err(Error::Missed("no fit was made".into())) };
        let params = &record.sections["all"].params;
        let (mut square, mut within) = (0.0, 0);
        for ((name, _), truth) in NAMES.iter().zip(TRUTH) {
            for (channel, truth) in ["R", "G", "B"].iter().zip(truth) {
                let param = &params[&format!("{name}.{channel}")];
                square += ((param.value[0] - truth) / truth).powi(2) / 12.0;
                within += usize::from((param.value[0] - truth).abs() <= 2.0 * param.stderr[0]);
            }
        }
        let note = format!("processor time; {note}; {within} of 12 numbers within twice their stated errors");
        Ok(BenchRow { model: "scene".into(), knob: knob.into(), setting, error: f64::sqrt(square), us, note })
    }
}

/// Most paths a pixel against the error of what is found in two small pictures.
///
/// # Errors
/// Those of fits, and a stop.
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let problem = Problem::new(scene, BOTH)?;
    let note = "24 leaves, two pictures of 32 x 24 pixels with noise of 1 %";
    PATHS.iter().map(|paths| problem.row("most paths a pixel", paths.to_string(), *paths, note)).collect()
}

/// One picture of 200 leaves, as numbers for other programs, and our fit of it.
///
/// # Errors
/// As [`bench_rows`].
pub fn peers() -> Result<PeerInputs> {
    let one = BOTH.split_inclusive("across.exr\"\n").next().unwrap_or(BOTH);
    let problem = Problem::new(crowd, one)?;
    let opened = opened(problem.folder.path(), &crowd(TRUTH, ""))?;
    let world = reference::traced(&opened, 0.0, &Ledger::new())?;
    let (mut positions, mut indices): (Vec<u8>, Vec<u8>) = (Vec::new(), Vec::new());
    let mut first = 0u32;
    for placed in world.instances.iter().filter(|placed| placed.leaf == 0) {
        let mesh = &world.leaves[placed.leaf].mesh;
        let corners = mesh.positions.iter().map(|p| placed.transform.transform_point3(*p).as_vec3());
        positions.extend(corners.flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes));
        indices.extend(mesh.indices.iter().flat_map(|k| (first + k).to_le_bytes()));
        first += mesh.positions.len() as u32;
    }
    let numbers = |of: [[f64; 3]; 5]| -> serde_json::Value {
        NAMES.iter().zip(of).map(|((_, name), v)| (name.to_string(), serde_json::json!(v))).collect()
    };
    let views = opened.manifest.perspectives().next();
    let camera = views.map(|view| view.camera).ok_or_else(|| Error::Missed("the scene has no camera".into()))?;
    let sun = world.sun.as_ref().ok_or_else(|| Error::Missed("the scene has no sun".into()))?;
    // By which `photograph` took our picture.
    let exposure = SyntheticExposure::default();
    let said = serde_json::json!({
        "truth": numbers(TRUTH),
        "start": numbers(START),
        "sky": world.sky,
        "sun": { "toward": sun.direction.normalize().to_array(), "irradiance": sun.irradiance },
        "reach": opened.manifest.ground.as_ref().and_then(|ground| ground.reach_mm),
        "eye": camera.eye.to_array(),
        "look_at": camera.target.to_array(),
        "fov_deg": camera.fov_y_deg,
        "size": [opened.manifest.check.width, opened.manifest.check.height],
        "noise": exposure.noise,
        "seed": exposure.seed,
        "target": TARGET,
    });
    let row =
        problem.row("peer", "mesophyll".into(), 1024, "200 leaves, one picture of 96 x 72 pixels, noise of 1 %")?;
    // The peer starts right after this fit, whose time is our turn: another fit would only take as long again.
    let us = row.us;
    Ok(PeerInputs {
        files: vec![
            ("positions.f32".into(), positions),
            ("indices.u32".into(), indices),
            ("scene.json".into(), said.to_string().into_bytes()),
        ],
        ours: vec![row],
        turn: Some(Box::new(move |_| us)),
    })
}
