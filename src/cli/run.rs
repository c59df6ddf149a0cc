//! `mesophyll run`: the main job. Plan, scan and fit what is missing or stale, check, report.

use super::Common;
use crate::Result;
use mesophyll_files::{atomic, claim, progress};
use mesophyll_report::{self as report, ReportSource, model::Level};
use mesophyll_scene::{fits::missing as missing_fits, ledger::Ledger, manifest::Manifest, plan};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll run data/scenes/demo.toml --out out/demo
  mesophyll run data/scenes/fits.toml --out out/fits --write-fits

Everything lands in the folder: captures/, fits/, plan.json, check.json, pictures and report.html. Run again it does \
only what is
missing or stale. The last line is the verdict of its report: exit code 0 for \"Good\" and \"Usable with care\", 1 \
for \"Not good\".")]
pub struct Args {
    /// Scene to run
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder for everything the run makes (default: out/SCENE)
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::place::folder())]
    out: Option<PathBuf>,
    /// Scan and fit every leaf afresh into the folder that the scene names, instead of fitting only what is missing
    /// into DIR/fits
    #[arg(long)]
    write_fits: bool,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let clock = Instant::now();
    let manifest = Manifest::read(&args.scene)?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out").join(&manifest.name));
    claim::scene(&out, &args.scene)?;
    let mut stages = Stages::default();
    let ledger = Ledger::new();

    let first = stages.time("plan", || plan::make(&manifest, Some(&out), Some(&missing_fits::input_hash), &ledger))?;
    let wanted: Vec<usize> = if args.write_fits {
        first.leaves.iter().filter(|l| l.used).map(|l| l.index).collect()
    } else {
        first.unfitted()
    };
    for index in wanted {
        let name = &manifest.leaves[index].name;
        let folder = match (&manifest.leaves[index].fit, args.write_fits) {
            (Some(named), true) => manifest.resolve(named),
            _ => missing_fits::fit_folder(&manifest, index, &out),
        };
        stages.time(&format!("fit {name}"), || {
            missing_fits::fit(&manifest, index, &out, &folder, args.write_fits, &ledger)
        })?;
    }
    let planned = || plan::make(&manifest, Some(&out), Some(&missing_fits::input_hash), &ledger);
    let mut plan = stages.time("plan with the fits", planned)?;
    if !plan.untranslucent().is_empty() {
        stages.time("translucency", || missing_fits::translucencies(&manifest, &plan, &out, &ledger))?;
        plan = stages.time("plan with the translucency maps", planned)?;
    }
    write_json(&out.join("plan.json"), &serde_json::to_value(&plan).unwrap_or_default())?;

    // The report is written whatever the check says: it is where one looks why.
    let checked = stages.time("check", || check(&manifest, &plan, &out, &ledger));
    let path = out.join("report.html");
    let sources = sources(&plan, &out);
    let written = stages.time("report", || report::write_html(&sources, &path));
    write_json(&out.join("ledger.json"), &json!({ "stages": stages.0, "entries": ledger.entries() }))?;
    let (passed, lines, checked) = checked?;
    let verdict = written?.verdict;

    let fits: Vec<String> =
        plan.leaves.iter().filter_map(|l| l.fitted.as_ref()).map(|f| f.folder.display().to_string()).collect();
    if common.json {
        super::print_json(&json!({
            "scene": manifest.name, "passed": passed, "verdict": verdict.sentence, "level": verdict.level, "fits": fits, "report": path, "check": checked,
            "stages": stages.0, "seconds": clock.elapsed().as_secs_f64(),
        }))?;
    } else {
        let left: Vec<&str> = plan.left_out.iter().map(|l| l.name.as_str()).collect();
        let mut text = format!("{}\n{lines}", manifest.name);
        text += &format!("left out: {}\n", left.join(", "));
        text += &format!("report: {}   {:.1} s in all\n", path.display(), clock.elapsed().as_secs_f64());
        for reason in verdict.reasons.iter().filter(|r| r.level != Level::Good) {
            text += &format!("{}\n", reason.text);
        }
        text += &format!("{}: {}\n", verdict.level.word(), verdict.sentence);
        super::print(&text)?;
    }
    // The report judges fits and pictures alike; "usable with care" is a warning.
    Ok(u8::from(!passed || verdict.level == Level::Bad))
}

/// The run's folder, and fits that lie elsewhere.
fn sources(plan: &plan::Plan, out: &Path) -> Vec<ReportSource> {
    let elsewhere = plan.leaves.iter().filter_map(|l| l.fitted.as_ref()).filter(|f| !f.folder.starts_with(out));
    std::iter::once(ReportSource::folder(out)).chain(elsewhere.map(|f| ReportSource::folder(&f.folder))).collect()
}

#[cfg(feature = "render")]
fn check(manifest: &Manifest, plan: &plan::Plan, out: &Path, ledger: &Ledger) -> Result<(bool, String, Value)> {
    use mesophyll_scene::{check::Options, manifest::Interior};
    let options = Options { out: out.to_path_buf(), ..Options::default() };
    let compare = manifest.leaves.iter().any(|l| l.interior == Interior::Maps);
    let (passed, text, json) = super::check::judged(manifest, plan, &options, compare.then_some(Some(out)), ledger)?;
    if compare {
        write_json(&out.join("check.json"), &json)?;
    }
    Ok((passed, text, json))
}

#[cfg(not(feature = "render"))]
fn check(_: &Manifest, _: &plan::Plan, _: &Path, _: &Ledger) -> Result<(bool, String, Value)> {
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
        let _bar = progress::Bar::of(name);
        let start = Instant::now();
        let result = body();
        let seconds = start.elapsed().as_secs_f64();
        progress::say(format!("{name}: {} in {seconds:.1} s", if result.is_ok() { "done" } else { "failed" }));
        self.0.push((name.to_string(), seconds));
        result
    }
}
