//! `mesophyll run`: the main job. Plan, scan and fit what is missing or stale, check, report.

use super::CommonArgs;
use crate::cli::Result;
use mesophyll_files::{atomic, claim, progress};
use mesophyll_report::{self as report, QualityLevel, ReportSource};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::{PlacedScene, leaf::LeafSearch};
use mesophyll_scene::placed::{fits::maker, ledger::Ledger};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll run data/scenes/demo.toml --out out/demo
  mesophyll run data/scenes/fits.toml --out out/fits --write-fits
  mesophyll run data/scenes/demo.toml --dry-run

Everything lands in the folder: captures/, fits/, plan.json, check.json, pictures and report.html. Run again it does \
only what is
missing or stale. The last line is the verdict of its report: exit code 0 for \"Good\" and \"Usable with care\", 1 \
for \"Not good\".")]
pub struct Args {
    /// Scene to run
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder for everything the run makes (default: out/SCENE)
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::destination::folder())]
    out: Option<PathBuf>,
    /// Scan and fit every leaf afresh into the folder that the scene names, instead of fitting only what is missing
    /// into DIR/fits
    #[arg(long)]
    write_fits: bool,
    /// Only say what would be needed and what is left out, as `mesophyll plan` does; nothing is written
    #[arg(long, conflicts_with = "write_fits")]
    dry_run: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.dry_run {
        return super::plan::say(&args.scene, args.out.as_deref(), common);
    }
    let clock = Instant::now();
    let manifest = SceneManifest::read(&args.scene)?;
    manifest.require_limits()?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out").join(&manifest.name));
    let _claim = claim::scene(&out, &args.scene)?;
    let mut stages = Stages::default();
    let ledger = Ledger::new();

    // The plan is made once, when every fit that it depends on exists.
    let search = LeafSearch { out: Some(&out), compared: true, free: false };
    let mut placed = stages.time("look for fits", || PlacedScene::new(&manifest, search, &ledger))?;
    let wanted: Vec<usize> = if args.write_fits {
        placed.leaves.iter().filter(|l| l.used).map(|l| l.index).collect()
    } else {
        placed.unfitted()
    };
    for index in wanted {
        let name = &manifest.leaves[index].name;
        let named = manifest.leaves[index].fit().and_then(|fit| fit.fit.as_ref());
        let folder = match (named, args.write_fits) {
            (Some(named), true) => manifest.resolve(named),
            _ => maker::fit_folder(&manifest, index, &out),
        };
        let what = if manifest.leaves[index].look().is_some() { "state" } else { "fit" };
        stages.time(&format!("{what} {name}"), || {
            maker::fit(&manifest, index, &out, &folder, args.write_fits, &ledger)?;
            placed.find_again(&manifest, index, search, &ledger)
        })?;
    }
    if !placed.untranslucent(&manifest).is_empty() {
        stages.time("translucency", || placed.make_translucency(&manifest, &out, search, &ledger))?;
    }
    let mut scene = stages.time("plan", || LoadedScene::new(manifest, placed, &ledger))?;
    if scene.manifest.transfer.is_some() {
        stages.time("light between leaves", || scene.find_transfer(&out, &ledger))?;
    }
    write_json(&out.join("plan.json"), &serde_json::to_value(&scene.plan).unwrap_or_default())?;

    // The report is written whatever the result of the check is, because it says why.
    let checked = stages.time("check", || check(&scene, &out, &ledger));
    let path = out.join("report.html");
    let sources = sources(&scene, &out);
    let written = stages.time("report", || report::write_html(&sources, &path));
    write_json(&out.join("ledger.json"), &json!({ "stages": stages.0, "entries": ledger.entries() }))?;
    let (passed, lines, checked) = checked?;
    let verdict = written?.verdict;

    let fits: Vec<String> =
        scene.placed.leaves.iter().filter_map(|l| l.fitted.as_ref()).map(|f| f.folder.display().to_string()).collect();
    if common.json {
        super::print_json(&json!({
            "scene": scene.plan.scene, "passed": passed, "verdict": verdict.sentence, "level": verdict.level,
                "fits": fits, "report": path, "check": checked,
            "stages": stages.0, "seconds": clock.elapsed().as_secs_f64(),
        }))?;
    } else {
        let left: Vec<&str> = scene.plan.left_out.iter().map(|l| l.name.as_str()).collect();
        let mut text = format!("{}\n{lines}", scene.plan.scene);
        text += &format!("left out: {}\n", left.join(", "));
        text += &format!("report: {}   {:.1} s in all\n", path.display(), clock.elapsed().as_secs_f64());
        for reason in verdict.reasons.iter().filter(|r| r.level != QualityLevel::Good) {
            text += &format!("{}\n", reason.text);
        }
        text += &format!("{}: {}\n", verdict.level.word(), verdict.sentence);
        super::print(&text)?;
    }
    // The report judges both fits and pictures; "usable with care" is only a warning.
    Ok(u8::from(!passed || verdict.level == QualityLevel::Bad))
}

/// The run's folder, and the folders of fits elsewhere.
fn sources(scene: &LoadedScene, out: &Path) -> Vec<ReportSource> {
    let fits = scene.placed.leaves.iter().filter_map(|l| l.fitted.as_ref());
    let elsewhere = fits.filter(|f| !f.folder.starts_with(out));
    std::iter::once(ReportSource::folder(out)).chain(elsewhere.map(|f| ReportSource::folder(&f.folder))).collect()
}

#[cfg(feature = "render")]
fn check(scene: &LoadedScene, out: &Path, ledger: &Ledger) -> Result<(bool, String, Value)> {
    use mesophyll_check::Options;
    use mesophyll_scene::manifest::InteriorSource;
    let options = Options { out: out.to_path_buf(), ..Options::default() };
    let compare = scene.manifest.leaves.iter().any(|l| l.interior == InteriorSource::Maps);
    let (passed, text, json) = super::check::judged(scene, &options, compare.then_some(Some(out)), ledger)?;
    if compare {
        write_json(&out.join("check.json"), &json)?;
    }
    Ok((passed, text, json))
}

#[cfg(not(feature = "render"))]
fn check(_: &LoadedScene, _: &Path, _: &Ledger) -> Result<(bool, String, Value)> {
    Ok((false, "nothing was checked: this build has no renderer (feature `render`)\n".into(), Value::Null))
}

fn write_json(path: &Path, value: &Value) -> Result<()> {
    atomic::write_bytes(path, serde_json::to_string_pretty(value).unwrap_or_default().as_bytes())
}

/// Stages with their wall times (s), said as they end.
#[derive(Default)]
struct Stages(Vec<(String, f64)>);

impl Stages {
    fn time<T>(&mut self, name: &str, body: impl FnOnce() -> Result<T>) -> Result<T> {
        progress::say(format!("{name} …"));
        let _bar = progress::TaskProgress::of(name);
        let start = Instant::now();
        let result = body();
        let seconds = start.elapsed().as_secs_f64();
        progress::say(format!("{name}: {} in {seconds:.1} s", if result.is_ok() { "done" } else { "failed" }));
        self.0.push((name.to_string(), seconds));
        result
    }
}
