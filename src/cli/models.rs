//! The models, one entry for each. `fit`, `eval`, `bench`, `bench --peers` and `stress`, their help texts and the
//! completions read only this list. `docs/adding.md` says which files a new model has besides its entry.

use crate::cli::peers::PeerScript;
use crate::cli::{CommonArgs, Error, Result, design, eval, fit, pictures};
use clap::{ArgMatches, Command, FromArgMatches};
use mesophyll_files::progress::TaskProgress;
use mesophyll_proof::bench::BenchRow;
use mesophyll_proof::stress::StressRow;
use mesophyll_proof::{
    beam, coverage, design as designs, foliar, forest, gloss, grass, leaf, motion, nist, peers, render, scene, sky,
    slab, solver, transfer, translucency, transport, visibility, wind,
};
use serde_json::json;
use std::path::{Path, PathBuf};

/// A model, or a table of cases that stands for itself: what the verbs can do with it.
#[derive(Debug, Clone, Copy)]
pub struct ModelEntry {
    /// Its name on the command line and in rows.
    pub name: &'static str,
    /// What `bench` or `stress` looks at, where no verb of `fit` or `eval` says what the model is.
    pub about: &'static str,
    /// `mesophyll fit NAME`.
    pub fit: Option<ModelVerb>,
    /// `mesophyll eval NAME`.
    pub eval: Option<ModelVerb>,
    /// `mesophyll design NAME`.
    pub design: Option<ModelVerb>,
    /// `mesophyll bench NAME`.
    pub bench: Option<ModelSweep>,
    /// `mesophyll stress NAME`.
    pub stress: Option<fn() -> Result<Vec<StressRow>>>,
}

/// A verb inside `fit`, `eval` or `design`.
#[derive(Debug, Clone, Copy)]
pub struct ModelVerb {
    /// What it does, in one sentence of the help.
    pub about: &'static str,
    pub arguments: fn(Command) -> Command,
    pub run: fn(&ArgMatches, &CommonArgs) -> Result<u8>,
}

/// Writes pictures into a folder, and names them.
type PictureWriter = fn(&Path) -> Result<Vec<PathBuf>>;

/// A sweep of a model's accuracy knobs.
#[derive(Debug, Clone, Copy)]
pub struct ModelSweep {
    /// Steps of the progress bar, which `rows` takes.
    pub steps: u64,
    pub rows: fn(&TaskProgress) -> Result<Vec<BenchRow>>,
    /// Pictures of the documentation that show the sweep, written into a folder.
    pub pictures: Option<PictureWriter>,
    /// Other programs that are measured beside it.
    pub peers: Option<PeerScript>,
}

/// The verb whose arguments and function `run` are in `fit::NAME`, `eval::NAME` or `design::NAME`.
macro_rules! verb {
    ($list:ident::$name:ident, $about:literal) => {
        Some(ModelVerb {
            about: $about,
            arguments: <$list::$name::Args as clap::Args>::augment_args,
            run: |matches, common| {
                let read = <$list::$name::Args as FromArgMatches>::from_arg_matches(matches);
                $list::$name::run(&read.map_err(|e| Error::Usage(e.to_string()))?, common)
            },
        })
    };
}

/// A sweep of one step.
macro_rules! sweep {
    ($rows:expr) => {
        ModelSweep {
            steps: 1,
            rows: |bar| {
                let rows = $rows()?;
                bar.step()?;
                Ok(rows)
            },
            pictures: None,
            peers: None,
        }
    };
}

const NONE: ModelEntry =
    ModelEntry { name: "", about: "", fit: None, eval: None, design: None, bench: None, stress: None };

/// All models, in the order in which verbs name and run them. A new model adds its entry here.
pub const MODELS: [ModelEntry; 30] = [
    ModelEntry {
        name: "solve",
        about: "The solver of least squares: stiff, singular and unbounded problems",
        bench: Some(ModelSweep {
            peers: Some(PeerScript { text: include_str!("../../tests/peers/nist_peers.py"), inputs: peers::nist }),
            ..sweep!(nist::bench_rows)
        }),
        stress: Some(|| Ok(solver::stress())),
        ..NONE
    },
    ModelEntry {
        name: "nist",
        about: "The certified problems of nonlinear regression",
        stress: Some(nist::stress),
        ..NONE
    },
    ModelEntry {
        name: "slab",
        fit: verb!(fit::slab, "σa and σs of a slab from its reflectance, transmittance and thickness, from CSV"),
        eval: verb!(eval::slab, "ρd and ρt of a slab from ω and Δ"),
        design: verb!(design::slab, "Which of reflectance, transmittance and thickness to measure better"),
        bench: Some(ModelSweep {
            peers: Some(PeerScript {
                text: include_str!("../../tests/peers/slab_peers.py"),
                inputs: || Ok(peers::slab()),
            }),
            ..sweep!(slab::bench::bench_rows)
        }),
        stress: Some(|| Ok(slab::stress::stress_cases())),
        ..NONE
    },
    ModelEntry {
        name: "bands",
        eval: verb!(eval::bands, "What bands see of spectra: sRGB, CIE 1931, or those of a sensor"),
        ..NONE
    },
    ModelEntry {
        name: "gloss",
        fit: verb!(fit::gloss, "Gloss traces of a linear light source, or goniometer samples, from CSV"),
        design: verb!(design::gloss, "Which directions a goniometer should read"),
        eval: verb!(eval::gloss, "Traces of a linear light source over a glossy texel"),
        bench: Some(ModelSweep {
            peers: Some(PeerScript { text: include_str!("../../tests/peers/gloss_peers.py"), inputs: peers::gloss }),
            ..sweep!(gloss::bench::bench_rows)
        }),
        stress: Some(|| Ok(gloss::stress::rows())),
        ..NONE
    },
    ModelEntry {
        name: "leaf",
        fit: verb!(fit::leaf, "A leaf scan: reflectance, gloss, normals, interior, thickness and blade"),
        design: verb!(design::leaf, "Where the tube of a leaf scan should stand"),
        stress: Some(leaf::stress::rows),
        ..NONE
    },
    ModelEntry {
        name: "coverage",
        about: "How often intervals hold the truth, over ten thousand made-up texels",
        stress: Some(coverage::rows),
        ..NONE
    },
    ModelEntry {
        name: "design",
        about: "Designs of measurements: errors against frames, and extreme cases",
        bench: Some(ModelSweep { pictures: Some(designs::bench::pictures), ..sweep!(designs::bench::rows) }),
        stress: Some(designs::stress::rows),
        ..NONE
    },
    ModelEntry {
        name: "beam",
        fit: verb!(
            fit::beam,
            "Coefficients of a tapered branch, or its taper and stiffness from measured deflections, from CSV"
        ),
        design: verb!(design::beam, "Where on a branch to measure"),
        eval: verb!(eval::beam, "Deflection and slope of a tapered branch"),
        bench: Some(sweep!(beam::bench::bench_rows)),
        stress: Some(|| Ok(beam::stress::rows())),
        ..NONE
    },
    ModelEntry {
        name: "motion",
        fit: verb!(
            fit::motion,
            "Resonance, damping and gain of a swaying branch from its deflections over time, from CSV"
        ),
        design: verb!(design::motion, "How long and how often to read a branch in gusts"),
        stress: Some(|| Ok(motion::rows())),
        ..NONE
    },
    ModelEntry {
        name: "wind",
        about: "How trees move in wind",
        bench: Some(ModelSweep { steps: pictures::TREES, rows: pictures::trees, pictures: None, peers: None }),
        stress: Some(wind::rows),
        ..NONE
    },
    ModelEntry { name: "sun", eval: verb!(eval::sun, "Where the sun stands, by hour, season and latitude"), ..NONE },
    ModelEntry { name: "sway", eval: verb!(eval::sway, "Where the tips of a scene's branches are, over time"), ..NONE },
    ModelEntry {
        name: "sky",
        fit: verb!(
            fit::sky,
            "Polynomials of a sky's spherical harmonics over sun and turbidity; or sun and turbidity from a picture of \
             the sky"
        ),
        eval: verb!(eval::sky, "Spherical harmonics of a sky from the sun's zenith angle and turbidity"),
        bench: Some(ModelSweep {
            pictures: Some(|folder| sky::charts::pictures(folder, &sky::figures::all(500)?)),
            ..sweep!(sky::bench::bench_rows)
        }),
        stress: Some(sky::stress::rows),
        ..NONE
    },
    ModelEntry {
        name: "panorama",
        eval: verb!(eval::panorama, "A picture of a sky whose sun and turbidity are known, as EXR"),
        ..NONE
    },
    ModelEntry {
        name: "translucency",
        fit: verb!(
            fit::translucency,
            "How the light that comes through a leaf depends on its direction: scattering inside the blade, its relief \
             and thickness"
        ),
        bench: Some(ModelSweep {
            steps: translucency::bench::PIECES,
            rows: translucency::bench::rows,
            pictures: Some(|folder| {
                Ok(vec![translucency::basis_charts::write(folder, &translucency::basis_study::histograms()?)?])
            }),
            peers: None,
        }),
        stress: Some(translucency::stress::rows),
        ..NONE
    },
    ModelEntry {
        name: "tissue",
        fit: verb!(fit::tissue, "What a leaf's inside is made of, from photographs of the light that comes through it"),
        ..NONE
    },
    ModelEntry {
        name: "render",
        about: "Ways to draw leaves, near and far",
        bench: Some(ModelSweep {
            steps: pictures::FOLIAGE,
            rows: pictures::foliage,
            pictures: None,
            peers: Some(PeerScript {
                text: include_str!("../../tests/peers/render_peers.py"),
                inputs: render::bench::peers,
            }),
        }),
        ..NONE
    },
    ModelEntry {
        name: "dipole",
        eval: verb!(eval::dipole, "Light diffusing through a leaf, by thickness and distance"),
        ..NONE
    },
    ModelEntry {
        name: "forest",
        about: "Plants that stand very often: a million of them, inside each other, tiny, huge, out of sight",
        stress: Some(forest::rows),
        ..NONE
    },
    ModelEntry {
        name: "scene",
        fit: verb!(fit::scene, "What leaves, ground and light of a scene are, from linear pictures of it"),
        design: verb!(design::scene, "Which cameras and suns further pictures of a scene should have"),
        bench: Some(ModelSweep {
            peers: Some(PeerScript {
                text: include_str!("../../tests/peers/scene_peers.py"),
                inputs: scene::bench::peers,
            }),
            ..sweep!(scene::bench::bench_rows)
        }),
        stress: Some(scene::stress),
        ..NONE
    },
    ModelEntry {
        name: "transfer",
        fit: verb!(
            fit::transfer,
            "How the light that reaches each leaf of a scene depends on the light around the scene"
        ),
        bench: Some(ModelSweep { steps: transfer::PIECES, rows: transfer::rows, pictures: None, peers: None }),
        ..NONE
    },
    ModelEntry {
        name: "grass",
        fit: verb!(fit::grass, "Slices of a meadow, drawn in real time, from its blades"),
        bench: Some(ModelSweep { steps: pictures::LAWNS, rows: pictures::lawns, pictures: None, peers: None }),
        stress: Some(|| Ok(grass::stress::rows())),
        ..NONE
    },
    ModelEntry {
        name: "transport",
        about: "Extreme scenes of the path tracer: furnaces, thin and white leaves",
        stress: Some(|| Ok(transport::stress())),
        ..NONE
    },
    ModelEntry {
        name: "visibility",
        about: "Maps of the sun's visibility on leaves",
        bench: Some(ModelSweep {
            steps: visibility::bench::PIECES,
            rows: visibility::bench::rows,
            pictures: None,
            peers: None,
        }),
        stress: Some(|| Ok(visibility::stress::rows())),
        ..NONE
    },
    ModelEntry {
        name: "canopy",
        eval: verb!(eval::canopy, "What a canopy reflects of the sun, towards directions or in all"),
        ..NONE
    },
    ModelEntry {
        name: "abm",
        eval: verb!(eval::abm, "Light reflected, absorbed and let through by the layers of a leaf, by rays or exactly"),
        bench: Some(ModelSweep {
            pictures: Some(foliar::charts::pictures),
            peers: Some(PeerScript {
                text: include_str!("../../tests/peers/foliar_peers.py"),
                inputs: foliar::peers::inputs,
            }),
            ..sweep!(foliar::bench::rows)
        }),
        ..NONE
    },
    ModelEntry {
        name: "fsm",
        eval: verb!(eval::fsm, "The foliar scattering model: its lobes, rules and errors"),
        bench: Some(sweep!(foliar::pictures::rows)),
        ..NONE
    },
    ModelEntry {
        name: "coefficients",
        fit: verb!(fit::coefficients, "Specific absorptions of leaves from spectra with measured contents, from CSV"),
        ..NONE
    },
    ModelEntry {
        name: "foliar",
        fit: verb!(fit::foliar, "Pigments of a leaf from the light that it reflects and lets through, from CSV"),
        design: verb!(design::foliar, "Which bands of a spectrometer to read"),
        bench: Some(ModelSweep {
            pictures: Some(foliar::leaves::pictures),
            peers: Some(PeerScript {
                text: include_str!("../../tests/peers/leaves_peers.py"),
                inputs: foliar::leaves::inputs,
            }),
            ..sweep!(foliar::leaves::rows)
        }),
        stress: Some(|| Ok(foliar::stress::rows())),
        ..NONE
    },
];

/// The models that have a certain part, each with that part.
pub fn with<T>(what: fn(&ModelEntry) -> Option<T>) -> impl Iterator<Item = (&'static str, T)> {
    MODELS.iter().filter_map(move |model| Some((model.name, what(model)?)))
}

/// The names that `bench` and `stress` take: those of the models that have a certain part, and `all`.
pub fn names<T>(what: fn(&ModelEntry) -> Option<T>) -> impl Iterator<Item = &'static str> {
    with(what).map(|(name, _)| name).chain([ALL])
}

const ALL: &str = "all";

/// Of the models that have a certain part, those that were asked for, each once and in the order asked; all of them
/// for `all`.
pub fn asked<T>(names: &[String], what: fn(&ModelEntry) -> Option<T>) -> Vec<(&'static str, T)> {
    if names.iter().any(|name| name == ALL) {
        return with(what).collect();
    }
    let first = |k: &usize| !names[..*k].contains(&names[*k]);
    (0..names.len()).filter(first).filter_map(|k| with(what).find(|(name, _)| *name == names[k])).collect()
}

/// Prints which models have a certain part, for a `verb` that was given no name.
///
/// # Errors
/// Those of standard output.
pub fn list<T>(verb: &str, what: fn(&ModelEntry) -> Option<T>, common: &CommonArgs) -> Result<u8> {
    let about =
        |m: &ModelEntry| [m.fit, m.eval, m.design].into_iter().flatten().next().map_or(m.about, |verb| verb.about);
    let models: Vec<_> = MODELS.iter().filter(|m| what(m).is_some()).map(|m| (m.name, about(m))).collect();
    if common.json {
        let models: Vec<_> = models.iter().map(|(name, about)| json!({ "name": name, "about": about })).collect();
        super::print_json(&json!({ "models": models }))?;
        return Ok(0);
    }
    let lines = models.iter().map(|(name, about)| format!("  {name:<13} {about}\n")).collect::<String>();
    super::print(&format!(
        "mesophyll {verb} NAME... runs one or several; `mesophyll {verb} all` runs every one.\n{lines}"
    ))?;
    Ok(0)
}

#[cfg(test)]
#[path = "models_tests.rs"]
mod tests;
