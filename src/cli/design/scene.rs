//! `mesophyll design scene`: which further pictures of a scene to take.

use super::{ChosenIo, DesignAnswer, ReadingSet};
use crate::cli::{CommonArgs, Error, Result, destination};
use mesophyll_base::selection::{DesignChoice, evenly};
use mesophyll_fit_scene::design::{SceneDesignOptions, plan};
use mesophyll_fits::design::search;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use std::path::PathBuf;

/// Chooses cameras and suns for further pictures of a scene: those that leave the smallest standard errors of what
/// `fit scene` would find, averaged over a range of values of its unknown numbers.
///
/// The scene states what is [unknown], and the pictures that there are, if any. Cameras to choose from are its own
/// perspective views, and some on a dome around what the first view looks at. Suns are its own, the hours of its [day],
/// and those of --suns. Each picture is drawn with its derivatives, as the fit does it.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll design scene data/pictures/plan.toml --more 2\n  \
    mesophyll design scene data/pictures/plan.toml --for leaf.leaf.rho_t --suns 60:200,70:120\n\n\
    A picture under another sun than the scene's is given to `fit scene` with picture.sun_deg.\n\n\
    Only pictures are planned. Reflectance factors that there are ([[brf]], in three channels) count. Which\n\
    directions to read further is not planned: compute some with `eval canopy`, and fit them with `fit scene`.")]
pub struct Args {
    /// Scene with [unknown], and with the [[picture]] tables that there are
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// How many pictures to take
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=200))]
    more: u16,
    /// What it is for, by comma: names of unknown numbers, or what they begin with [default: all]
    #[arg(long = "for", value_name = "NAME,…", value_delimiter = ',')]
    wanted: Vec<String>,
    /// Cameras on a dome, beside the scene's own views
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(0..=1000))]
    cameras: u16,
    /// Places of the sun beside the scene's own, by comma: zenith angle and azimuth in degrees
    #[arg(long, value_name = "ZENITH:AZIMUTH,…", value_delimiter = ',', allow_hyphen_values = true)]
    suns: Vec<String>,
    /// The unknown numbers are thought of as up to this many times smaller and larger than the scene states them
    #[arg(long, value_name = "TIMES", default_value_t = 1.5)]
    range: f64,
    /// How many sets of such values are drawn
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=100))]
    draws: u16,
    /// Relative noise of a pixel [default: that of the scene's pictures, or 0.01]
    #[arg(long, value_name = "S")]
    noise: Option<f64>,
    /// Paths a pixel
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(8..=65_536))]
    samples: u32,
    /// Most columns of a drawn picture; of a larger one, the details of a pixel are lost to the plan
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(4..=4096))]
    columns: u16,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 32))]
    seed: u64,
    /// Folder of an earlier run, whose fits of the scene's leaves are used
    #[arg(long, value_name = "DIR", value_parser = destination::folder())]
    run: Option<PathBuf>,
    #[command(flatten)]
    io: ChosenIo,
}

/// Columns of the chosen pictures.
const CHOSEN: [&str; 13] = [
    "camera",
    "eye_x_mm",
    "eye_y_mm",
    "eye_z_mm",
    "target_x_mm",
    "target_y_mm",
    "target_z_mm",
    "up_x",
    "up_y",
    "up_z",
    "fov_deg",
    "sun_zenith_deg",
    "sun_azimuth_deg",
];

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let options = args.options()?;
    let ledger = Ledger::new();
    let search_in = LeafSearch { out: args.run.as_deref(), compared: true, free: false };
    let scene = LoadedScene::open(SceneManifest::read(&args.scene)?, search_in, &ledger)?;
    scene.require_sound_fits(&ledger)?;
    let design = plan(&scene, &options, &ledger)?;
    let impossible = || {
        Error::Missed(
            "these pictures do not show what is asked for: their numbers are not finite, or too \
                                       unlike for double precision"
                .into(),
        )
    };
    let judged = |set: &[usize]| design.problem.judge(set).ok_or_else(impossible);
    let (there, new, more) = (design.there(), design.candidates.len(), usize::from(args.more));
    if new < more {
        return Err(Error::Usage(format!(
            "--more: found {more}, expected at most {new}, as many as there are cameras and suns to choose from \
             (--cameras and --suns give more)"
        )));
    }
    let mut answer = DesignAnswer {
        title: format!(
            "{}: {there} pictures that there are, {new} to choose from, noise {} a pixel",
            args.scene.display(),
            design.noise
        ),
        columns: design.names(),
        chosen: (CHOSEN.to_vec(), Vec::new()),
        ..DesignAnswer::default()
    };
    let set =
        |name: String, choice: &DesignChoice| ReadingSet { name, errors: design.errors(choice), ratio: choice.ratio };
    let all = judged(&evenly(there + new, there + new))?;
    let hidden = design.undetermined(&all);
    if hidden.len() == answer.columns.len() {
        return Err(Error::input(
            &args.scene,
            format!(
                "found no picture that shows {}; expected cameras that see what is unknown (more of them with \
                 --cameras), or a scene in which it matters",
                hidden.join(", ")
            ),
        ));
    }
    answer.sets.push(set(format!("all {}", there + new), &all));
    if there > 0 {
        answer.sets.push(set("the pictures that there are".into(), &judged(&design.problem.taken)?));
    }
    let even: Vec<usize> = evenly(new, more).into_iter().map(|k| there + k).collect();
    answer.sets.push(set(format!("and {more} even ones"), &judged(&[&design.problem.taken[..], &even].concat())?));
    let choice = search::choose(&design.problem, there + more)?.ok_or_else(impossible)?;
    answer.best_possible = search::best_possible(&design.problem, there + more)?;
    for (k, left) in design.one_by_one(&choice).ok_or_else(impossible)? {
        let one = &design.candidates[k - there];
        let sun = one.sun_deg.or_else(|| scene.manifest.sun.as_ref().map(|sun| [sun.zenith_deg, sun.azimuth_deg]));
        let under = sun.map_or_else(String::new, |[zenith, azimuth]| format!(", sun at {zenith:.0}:{azimuth:.0}"));
        answer.sets.push(set(format!("with {}{under}", one.camera_name), &left));
        let places = [one.camera.eye, one.camera.target, one.camera.up].map(|v| v.to_array()).concat();
        let numbers = places.into_iter().chain([one.camera.fov_y_deg]).chain(sun.unwrap_or([f64::NAN; 2]));
        let words = numbers.map(|v| if v.is_nan() { String::new() } else { format!("{:.3}", v + 0.0) });
        answer.chosen.1.push(std::iter::once(one.camera_name.clone()).chain(words).collect());
    }
    answer.undetermined = design.undetermined(&choice);
    answer.notes.extend(notes(&answer.undetermined, &hidden));
    if scene.manifest.taken.iter().any(|taken| taken.exposure.is_some()) {
        answer.notes.push(
            "Further pictures count as being in the scene's units. One whose exposure is unknown, too, tells less."
                .into(),
        );
    }
    answer.give(&args.io, &[&args.scene], common)?;
    Ok(0)
}

/// What has to be said of a choice.
fn notes(undetermined: &[String], hidden: &[String]) -> Vec<String> {
    let mut out = Vec::new();
    if !hidden.is_empty() {
        out.push(format!(
            "warning: no picture shows {}, whatever is chosen; its error is what was known before",
            hidden.join(", ")
        ));
    }
    let open: Vec<&str> = undetermined.iter().filter(|name| !hidden.contains(*name)).map(String::as_str).collect();
    if !open.is_empty() {
        out.push(format!("The chosen pictures leave {} undetermined; --more would help.", open.join(", ")));
    }
    out.push(
        "The errors are those of a scene that is as stated: where its leaves stand, its cameras and its light. A \
         picture that is held out tells whether it is."
            .into(),
    );
    out
}

impl Args {
    fn options(&self) -> Result<SceneDesignOptions> {
        let sun = |text: &String| {
            let both = text.split_once(':').and_then(|(z, a)| Some([z.trim().parse().ok()?, a.trim().parse().ok()?]));
            both.ok_or_else(|| {
                Error::Usage(format!("--suns: found {text:?}, expected a zenith angle and an azimuth, as 60:200"))
            })
        };
        if !(1.0..=10.0).contains(&self.range) {
            return Err(Error::argument("--range", self.range, "a factor from 1 to 10"));
        }
        if let Some(noise) = self.noise.filter(|noise| !(*noise > 0.0 && *noise < 1.0)) {
            return Err(Error::argument("--noise", noise, "a share above 0 and below 1"));
        }
        Ok(SceneDesignOptions {
            cameras: usize::from(self.cameras),
            suns: self.suns.iter().map(sun).collect::<Result<_>>()?,
            wanted: self.wanted.clone(),
            range: self.range,
            draws: usize::from(self.draws),
            noise: self.noise,
            samples: self.samples,
            columns: usize::from(self.columns),
            seed: self.seed,
        })
    }
}
