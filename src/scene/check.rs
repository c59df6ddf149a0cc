//! The check: every view of a scene drawn by the GPU renderer, judged against the CPU reference (a card: against its closed form), against
//! golden pictures where the scene has them, and against the thresholds that the scene states.
//!
//! Errors are of displayed values, 0 to 1. The noise of the reference is measured against a second seed and printed beside each threshold.
//! Frame times are judged on real GPUs only.

use super::branch;
use super::card::{self, Card};
use super::day::{self, Hour};
use super::golden;
use super::handover;
use super::ledger::Ledger;
use super::manifest::{JudgedBy, Manifest, View, ViewKind};
use super::plan::{LeafPlan, Plan, sun_direction};
use super::reference;
use super::sound;
use super::sunlit;
use crate::files::{atomic, image, progress};
use crate::transport::{self, ReferencePicture, compare};
use crate::{Error, Result};
use mesophyll_viewer as gpu;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a check is told beside the scene.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Where pictures and `check.json` go.
    pub out: PathBuf,
    /// Write the reference's pictures as the scene's goldens instead of comparing with them.
    pub update_golden: bool,
}

/// The verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    pub passed: bool,
    pub adapter: String,
    /// Drawn by the CPU: frame times are printed, not judged.
    pub software: bool,
    pub views: Vec<ViewReport>,
    /// What else went wrong, a sentence each: files that are not what was fitted.
    pub failures: Vec<String>,
    /// What was uploaded (name, bytes) and compiled for the perspective views.
    pub uploads: Vec<(String, u64)>,
    pub pipelines: Vec<String>,
    /// What translucency maps cost a fragment, where there are any.
    pub translucency: Option<Term>,
    /// The hours of the scene's day, drawn into `day.png`.
    pub day: Vec<Hour>,
}

/// The translucency maps' term against the whole shader, in one run on one adapter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// Median time of the main pass (of a frame where the adapter has no clock) of the first perspective view, ms, with the term and with the
    /// cosine of the mesh's normal in its place; `None` where a frame takes seconds.
    pub ms: Option<[f64; 2]>,
    /// Operations of the dearest leaf's shader, both arms of every branch and loops once, with the term and without.
    pub operations: [usize; 2],
}

/// One view's figures; `None` where there was nothing to measure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ViewReport {
    pub name: String,
    pub card: bool,
    pub flip_mean: f64,
    pub flip_p99: f64,
    /// Largest error; for a card, relative, against the closed form.
    pub max_error: Option<f64>,
    pub max_at: Option<(usize, usize)>,
    /// Share of the leaf's pixels that the largest error looks at.
    pub interior_share: f64,
    /// The reference's own noise: the same two measures between two seeds; for a card, its error against the closed form.
    pub noise_flip_p99: Option<f64>,
    /// What the translucency maps' directional basis costs: the reference by the stored coefficients against the reference by the convolution.
    pub basis: Option<(f64, f64)>,
    /// Judged against the reference by the stored coefficients.
    pub by_maps: bool,
    pub noise_max_error: Option<f64>,
    pub threshold_flip_p99: Option<f64>,
    pub threshold_max_error: f64,
    /// FLIP and largest error against the scene's golden picture.
    pub golden: Option<(f64, f64)>,
    pub frame_ms_median: f64,
    pub frame_ms_p95: f64,
    pub threshold_frame_ms: Option<f64>,
    /// Median of each pass by the adapter's own clock.
    pub passes: Vec<(String, f64)>,
    pub reference_s: f64,
    pub pictures: Option<[String; 3]>,
    pub passed: bool,
    pub why: Vec<String>,
}

/// Opens the adapter.
///
/// # Errors
/// [`Error::Missed`] when there is none: a check never passes unlooked.
pub fn open() -> Result<gpu::Renderer> {
    gpu::Renderer::headless(&gpu::Options::default()).map_err(|e| Error::Missed(format!("nothing was checked: {e}")))
}

/// A renderer's complaint in our words.
pub fn told(e: gpu::Error) -> Error {
    Error::Missed(format!("the renderer failed: {e}"))
}

/// Checks every view.
///
/// # Errors
/// [`Error::Missed`] without an adapter; [`Error::Input`] for a leaf that is not fitted or a damaged file. A missed threshold is no error
/// here: see [`Report::passed`].
pub fn check(manifest: &Manifest, plan: &Plan, options: &Options, ledger: &Ledger) -> Result<Report> {
    if let Some(missing) = plan.unfitted().first() {
        let name = &manifest.leaves[*missing].name;
        return Err(Error::field(&manifest.path, &format!("leaf \"{name}\""), "not fitted yet; `mesophyll run` fits what a scene needs"));
    }
    atomic::probe_folder(&options.out)?;
    let mut renderer = open()?;
    let adapter = renderer.adapter().clone();
    let mut report = Report {
        passed: true,
        adapter: format!("{} ({}, {})", adapter.name, adapter.backend, adapter.driver),
        software: adapter.is_software,
        views: Vec::new(),
        failures: verify(plan, ledger)?,
        uploads: Vec::new(),
        pipelines: Vec::new(),
        translucency: None,
        day: Vec::new(),
    };
    progress::say(format!("drawn by {}", report.adapter));
    let perspective: Vec<&View> = manifest.views.iter().filter(|v| v.kind == ViewKind::Perspective).collect();
    if !perspective.is_empty() {
        let mut scene = handover::scene(manifest, plan, ledger)?;
        let mut world = reference::world(manifest, plan, ledger)?;
        renderer.set_scene(&scene).map_err(told)?;
        report.uploads = renderer.stats().uploads.iter().map(|u| (u.name.clone(), u.bytes)).collect();
        report.pipelines = renderer.stats().pipelines.clone();
        // Views of one time share the reference's trees.
        let mut times: Vec<f64> = perspective.iter().map(|v| branch::time(manifest, v)).collect();
        times.dedup();
        if plan.bends.is_none() {
            times.truncate(1);
        }
        let mut left = perspective.into_iter().peekable();
        for time in times {
            if let Some(wind) = &mut scene.wind {
                wind.time_s = time;
                renderer.set_time(wind);
            }
            reference::move_to(&mut world, plan, time)?;
            let mut by_maps = world.clone();
            let stored = sunlit::relight_as_stored(&mut by_maps, plan, &plan.eyes)?;
            let stage = transport::Renderer::new(&world)?;
            let by_maps = if stored { Some(transport::Renderer::new(&by_maps)?) } else { None };
            while let Some(view) = left.next_if(|v| plan.bends.is_none() || branch::time(manifest, v) == time) {
                let stages = Stages { truth: &stage, by_maps: by_maps.as_ref() };
                report.views.push(one_view(manifest, plan, view, &mut renderer, &stages, options)?);
            }
        }
        let slow = report.views.first().is_some_and(|v| v.frame_ms_median > 2000.0);
        report.translucency = term(manifest, &scene, &mut renderer, !slow)?;
        report.day = day::draw(manifest, plan, &scene, &mut renderer, &options.out, ledger)?;
    }
    for view in manifest.views.iter().filter(|v| v.kind == ViewKind::Card) {
        report.views.push(one_card(manifest, plan, view, &mut renderer, options, ledger)?);
    }
    report.passed = report.failures.is_empty() && report.views.iter().all(|v| v.passed);
    let path = options.out.join("check.json");
    atomic::write_bytes(&path, serde_json::to_string_pretty(&report.json(manifest)).unwrap_or_default().as_bytes())?;
    Ok(report)
}

/// Draws the first view with and without the translucency maps, by turns, and gives the maps back.
fn term(manifest: &Manifest, scene: &gpu::scene::Scene, renderer: &mut gpu::Renderer, timed: bool) -> Result<Option<Term>> {
    let has = |l: &gpu::scene::Leaf| l.front.translucency.is_some() || l.back.translucency.is_some();
    let own: Vec<usize> = (0..scene.leaves.len()).filter(|&k| has(&scene.leaves[k])).collect();
    let view = manifest.views.iter().find(|v| v.kind == ViewKind::Perspective);
    let (Some(view), false) = (view, own.is_empty()) else { return Ok(None) };
    let mut plain = scene.clone();
    for &k in &own {
        (plain.leaves[k].front.translucency, plain.leaves[k].back.translucency) = (None, None);
    }
    let longest = |scene: &gpu::scene::Scene, renderer: &gpu::Renderer| {
        own.iter().filter_map(|&k| renderer.operations(scene, k)).max().unwrap_or_default()
    };
    let operations = [longest(scene, renderer), longest(&plain, renderer)];
    if !timed {
        return Ok(Some(Term { ms: None, operations }));
    }
    let mut times = [Vec::new(), Vec::new()];
    for turn in 0..4 {
        let which = turn % 2;
        let drawn = if which == 0 { scene } else { &plain };
        for &k in &own {
            renderer.set_leaf(drawn, k).map_err(told)?;
        }
        let (w, h) = (manifest.check.width, manifest.check.height);
        let timing = renderer.time(&handover::camera(view), w, h, (manifest.check.frames as usize).min(10)).map_err(told)?;
        let main = timing.passes.iter().find(|(n, _)| n == "main").map_or(&timing.frame_ms, |(_, t)| t);
        times[which].extend(main);
    }
    for &k in &own {
        renderer.set_leaf(scene, k).map_err(told)?;
    }
    Ok(Some(Term { ms: Some(times.map(|t| median(&t))), operations }))
}

fn median(list: &[f64]) -> f64 {
    let mut sorted = list.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Hashes every file of a fit that the plan needs and asks whether they agree with each other; a sentence for each that does not.
fn verify(plan: &Plan, ledger: &Ledger) -> Result<Vec<String>> {
    let mut out = Vec::new();
    let translucent = |l: &LeafPlan| l.translucency.as_ref().and_then(|t| t.fitted.clone());
    for fitted in &plan.leaves.iter().flat_map(|l| [l.fitted.clone(), translucent(l)]).flatten().collect::<Vec<_>>() {
        let prefix = format!("{}/", fitted.name);
        for need in &plan.needed {
            if let Some(file) = need.name.strip_prefix(&prefix)
                && need.bytes.is_some()
                && fitted.folder.join(file).is_file()
                && let Err(e) = fitted.verify([file], ledger)
            {
                out.push(e.to_string());
            }
        }
    }
    for leaf in &plan.leaves {
        out.extend(sound::contradictions(leaf, ledger)?);
    }
    Ok(out)
}

/// The reference, and the same with translucency maps evaluated as they are stored.
struct Stages<'a> {
    truth: &'a transport::Renderer<'a>,
    by_maps: Option<&'a transport::Renderer<'a>>,
}

fn one_view(
    manifest: &Manifest,
    plan: &Plan,
    view: &View,
    renderer: &mut gpu::Renderer,
    stages: &Stages,
    options: &Options,
) -> Result<ViewReport> {
    let size = (manifest.check.width, manifest.check.height);
    let (w, h) = (size.0 as usize, size.1 as usize);
    let picture = renderer.render(&handover::camera(view), size.0, size.1).map_err(told)?;
    let mut out = timed(manifest, view, renderer)?;
    let start = Instant::now();
    let sampling = |seed: u64| transport::Options {
        samples_per_pixel: manifest.check.samples,
        sun_samples: if plan.shadow_samples > 0 { 4 } else { 1 },
        seed,
        sky_samples: 4,
        // A grazing leaf's sliver can slip through the rays of one pixel, not through those of all around it.
        margin: 2,
    };
    let camera = reference::camera(view);
    let mut truth = stages.truth.render(&camera, w, h, &sampling(manifest.check.seed))?;
    if let Some(by_maps) = stages.by_maps {
        // The same rays: what differs is the basis.
        let stored = by_maps.render(&camera, w, h, &sampling(manifest.check.seed))?;
        let basis = compare::compare(&truth, &stored.ldr)?;
        out.basis = Some((basis.flip_p99, basis.max_error.unwrap_or(0.0)));
        if view.judged_by == JudgedBy::Maps {
            (truth, out.by_maps) = (stored, true);
        }
    }
    let own = if out.by_maps { stages.by_maps.unwrap_or(stages.truth) } else { stages.truth };
    let other = own.render(&camera, w, h, &sampling(manifest.check.seed.wrapping_add(1)))?;
    out.reference_s = start.elapsed().as_secs_f64();
    let seen = compare::compare(&truth, &picture.ldr)?;
    let noise = compare::noise_floor(&truth, &other)?;
    out.flip_mean = seen.flip_mean;
    out.flip_p99 = seen.flip_p99;
    out.max_error = seen.max_error;
    out.max_at = seen.max_at;
    out.interior_share = seen.interior_share;
    (out.noise_flip_p99, out.noise_max_error) = (Some(noise.flip_p99), noise.max_error);
    out.judge_against_reference();
    let golden = golden::path(manifest, view);
    if options.update_golden {
        golden::write(&golden, &truth)?;
        progress::say(format!("wrote {}", golden.display()));
    } else if golden.is_file() && plan.all_named() {
        let seen = golden::compare(&golden, &truth, &picture.ldr)?;
        out.judge_against_golden(&golden, seen);
    }
    out.save(options, &truth, &picture, &seen)?;
    out.passed = out.why.is_empty();
    Ok(out)
}

fn one_card(
    manifest: &Manifest,
    plan: &Plan,
    view: &View,
    renderer: &mut gpu::Renderer,
    options: &Options,
    ledger: &Ledger,
) -> Result<ViewReport> {
    let size = (manifest.check.width, manifest.check.height);
    let (w, h) = (size.0 as usize, size.1 as usize);
    let card = Card::new(manifest, plan, view, ledger)?;
    renderer.set_scene(&handover::card(manifest, plan, &card, ledger)?).map_err(told)?;
    let picture = renderer.render(&handover::camera(view), size.0, size.1).map_err(told)?;
    let mut out = timed(manifest, view, renderer)?;
    out.card = true;
    let start = Instant::now();
    let world = card::world(manifest, &card)?;
    let sampling = transport::Options { samples_per_pixel: 16, sun_samples: 1, seed: manifest.check.seed, ..transport::Options::default() };
    let truth = transport::render(&world, &reference::camera(view), w, h, &sampling)?;
    out.reference_s = start.elapsed().as_secs_f64();
    // The lobe's albedo under a sky is integrated for every pixel that is asked for: a few hundred over the picture tell.
    let pixels: Vec<(usize, usize)> =
        (0..ROWS * COLUMNS).map(|k| ((2 * (k % COLUMNS) + 1) * w / (2 * COLUMNS), (2 * (k / COLUMNS) + 1) * h / (2 * ROWS))).collect();
    let exact = card.closed_form(manifest, view, (w, h), &pixels)?;
    let seen = compare::compare(&truth, &picture.ldr)?;
    (out.flip_mean, out.flip_p99, out.interior_share) = (seen.flip_mean, seen.flip_p99, seen.interior_share);
    let (worst, at) = relative(&picture.hdr, w, &pixels, &exact);
    // The reference scatters its rays over pixel and sun: few pixels, many rays, for its own distance from the formula.
    let fine = transport::Options { samples_per_pixel: 64, sun_samples: 16, ..sampling };
    let own = transport::render(&world, &reference::camera(view), 2 * COLUMNS, 2 * ROWS, &fine)?;
    let own_pixels: Vec<(usize, usize)> = (0..ROWS * COLUMNS).map(|k| (2 * (k % COLUMNS), 2 * (k / COLUMNS))).collect();
    let own_exact = card.closed_form(manifest, view, (2 * COLUMNS, 2 * ROWS), &own_pixels)?;
    let (reference_worst, _) = relative(&own.hdr, 2 * COLUMNS, &own_pixels, &own_exact);
    out.max_error = Some(worst);
    out.max_at = Some(at);
    out.noise_max_error = Some(reference_worst);
    let limit = out.threshold_max_error;
    for (who, error) in [("the renderer", worst), ("the reference", reference_worst)] {
        if exceeds(error, limit) {
            out.why.push(format!("{who} is {error:.2e} (relative) from the closed form, at most {limit:.2e} allowed"));
        }
    }
    if exact.iter().flatten().all(|v| *v <= 0.0) && sun_direction(manifest).is_some() {
        out.why.push("the card is black: nothing was compared".into());
    }
    out.save(options, &truth, &picture, &seen)?;
    out.passed = out.why.is_empty();
    Ok(out)
}

/// Above the limit; a NaN is too.
fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

/// Pixels of a card that are compared with the closed form.
const COLUMNS: usize = 24;
const ROWS: usize = 18;

/// Largest relative difference of the radiance from the closed form, and the pixel; a tenth of a thousandth of the brightest is the floor.
fn relative(found: &[[f32; 4]], width: usize, pixels: &[(usize, usize)], exact: &[[f64; 3]]) -> (f64, (usize, usize)) {
    let floor = 1e-4 * exact.iter().flatten().fold(0.0, |a: f64, b| a.max(*b));
    let mut worst = (0.0, (0, 0));
    for (&(x, y), b) in pixels.iter().zip(exact) {
        for c in 0..3 {
            let error = (f64::from(found[y * width + x][c]) - b[c]).abs() / b[c].max(floor).max(f64::MIN_POSITIVE);
            if exceeds(error, worst.0) {
                worst = (error, (x, y));
            }
        }
    }
    worst
}

fn timed(manifest: &Manifest, view: &View, renderer: &mut gpu::Renderer) -> Result<ViewReport> {
    let (w, h) = (manifest.check.width, manifest.check.height);
    let timing = renderer.time(&handover::camera(view), w, h, manifest.check.frames as usize).map_err(told)?;
    let mut out = ViewReport {
        name: view.name.clone(),
        frame_ms_median: timing.quantile(0.5).unwrap_or(0.0),
        frame_ms_p95: timing.quantile(0.95).unwrap_or(0.0),
        threshold_flip_p99: view.flip_p99,
        threshold_max_error: view.max_error.unwrap_or(0.0),
        threshold_frame_ms: view.frame_ms,
        passes: timing.passes.iter().map(|(n, t)| (n.clone(), median(t))).collect(),
        ..ViewReport::default()
    };
    if let Some(limit) = view.frame_ms
        && !renderer.adapter().is_software
        && out.frame_ms_median > limit
    {
        out.why.push(format!("a frame takes {:.2} ms (median), at most {limit:.2} ms allowed", out.frame_ms_median));
    }
    Ok(out)
}

impl ViewReport {
    fn judge_against_reference(&mut self) {
        if let Some(limit) = self.threshold_flip_p99
            && exceeds(self.flip_p99, limit)
        {
            self.why.push(format!("99 % FLIP is {:.4} from the reference, at most {limit:.4} allowed", self.flip_p99));
        }
        let limit = self.threshold_max_error;
        match self.max_error {
            None => self.why.push("no pixel of a leaf's interior to judge the largest error on".into()),
            Some(e) if exceeds(e, limit) => {
                let (x, y) = self.max_at.unwrap_or_default();
                self.why.push(format!("pixel ({x}, {y}) is {e:.4} from the reference, at most {limit:.4} allowed"));
            }
            Some(_) => {}
        }
    }

    fn judge_against_golden(&mut self, path: &Path, seen: compare::Comparison) {
        let error = seen.max_error.unwrap_or(1.0);
        self.golden = Some((seen.flip_p99, error));
        // The golden was rounded to 8 bits, and so was the picture.
        let limit = self.threshold_max_error + 1.0 / 255.0;
        if let Some(flip) = self.threshold_flip_p99
            && exceeds(seen.flip_p99, flip)
        {
            self.why.push(format!("99 % FLIP is {:.4} from the golden {}, at most {flip:.4} allowed", seen.flip_p99, path.display()));
        }
        if exceeds(error, limit) {
            self.why.push(format!("a pixel is {error:.4} from the golden {}, at most {limit:.4} allowed", path.display()));
        }
    }

    fn save(&mut self, options: &Options, truth: &ReferencePicture, picture: &gpu::Picture, seen: &compare::Comparison) -> Result<()> {
        let names = [format!("{}.png", self.name), format!("{}-reference.png", self.name), format!("{}-difference.png", self.name)];
        let (w, h) = (truth.width, truth.height);
        image::write_png(&options.out.join(&names[0]), w, h, picture.ldr.as_flattened())?;
        image::write_png(&options.out.join(&names[1]), w, h, truth.ldr.as_flattened())?;
        image::write_png(&options.out.join(&names[2]), w, h, &compare::difference_picture(&truth.ldr, &picture.ldr, 8.0))?;
        image::write_png(&options.out.join(format!("{}-flip.png", self.name)), w, h, &seen.flip_picture())?;
        self.pictures = Some(names);
        Ok(())
    }

    fn json(&self) -> Value {
        let pictures = self.pictures.clone().unwrap_or_default();
        json!({
            "name": self.name,
            "kind": if self.card { "card" } else { "perspective" },
            "flip_mean": self.flip_mean,
            "flip_p99": self.flip_p99,
            "max_error": self.max_error,
            "max_at": self.max_at.map(|(x, y)| [x, y]),
            "interior_share": self.interior_share,
            "noise_flip_p99": self.noise_flip_p99,
            "noise_max_error": self.noise_max_error,
            "basis_flip_p99": self.basis.map(|b| b.0),
            "basis_max_error": self.basis.map(|b| b.1),
            "judged_by": if self.by_maps { "maps" } else { "convolution" },
            "threshold_flip_p99": self.threshold_flip_p99,
            "threshold_max_error": self.threshold_max_error,
            "golden_flip_p99": self.golden.map(|g| g.0),
            "golden_max_error": self.golden.map(|g| g.1),
            "frame_ms_median": self.frame_ms_median,
            "frame_ms_p95": self.frame_ms_p95,
            "threshold_frame_ms": self.threshold_frame_ms,
            "pass_ms": self.passes.iter().map(|(n, t)| (n.clone(), json!(t))).collect::<serde_json::Map<_, _>>(),
            "reference_s": self.reference_s,
            "image": pictures[0],
            "reference": pictures[1],
            "difference": pictures[2],
            "passed": self.passed,
            "why": self.why,
        })
    }

    /// One line in words.
    pub fn line(&self) -> String {
        let verdict = if self.passed { "passed" } else { "MISSED" };
        let error = self.max_error.map_or("-".to_string(), |e| format!("{e:.4}"));
        let noise = |v: Option<f64>| v.map_or("-".to_string(), |e| format!("{e:.4}"));
        let times = format!("{:.1} ms a frame (95 %: {:.1})", self.frame_ms_median, self.frame_ms_p95);
        let mut line = if self.card {
            format!(
                "{verdict}  {}: {:.2e} from the closed form (allowed {:.1e}; the reference {:.1e}), {times}",
                self.name,
                self.max_error.unwrap_or(f64::NAN),
                self.threshold_max_error,
                self.noise_max_error.unwrap_or(f64::NAN)
            )
        } else {
            format!(
                "{verdict}  {}: FLIP 99 % {:.4} (allowed {:.4}, noise {}), largest error {error} (allowed {:.4}, noise {}), {times}",
                self.name,
                self.flip_p99,
                self.threshold_flip_p99.unwrap_or(f64::NAN),
                noise(self.noise_flip_p99),
                self.threshold_max_error,
                noise(self.noise_max_error)
            )
        };
        if let Some((flip, error)) = self.basis {
            let what = if self.by_maps {
                "judged by the stored maps; beside that, their basis costs"
            } else {
                "of which the basis of the translucency maps"
            };
            line += &format!("\n        {what}: FLIP 99 % {flip:.4}, largest error {error:.4}");
        }
        for why in &self.why {
            line += &format!("\n        {why}");
        }
        line
    }
}

impl Report {
    /// The contract's JSON and more.
    pub fn json(&self, manifest: &Manifest) -> Value {
        let mut out = json!({
            "scene": manifest.name,
            "passed": self.passed,
            "adapter": self.adapter,
            "software": self.software,
            "size": [manifest.check.width, manifest.check.height],
            "reference_samples": manifest.check.samples,
            "failures": self.failures,
            "views": self.views.iter().map(ViewReport::json).collect::<Vec<_>>(),
            "uploads": self.uploads.iter().map(|(n, b)| json!({"name": n, "bytes": b})).collect::<Vec<_>>(),
            "uploaded_bytes": self.uploads.iter().map(|(_, b)| b).sum::<u64>(),
            "pipelines": self.pipelines,
        });
        if let Some(term) = &self.translucency {
            out["translucency"] = json!({
                "main_ms": term.ms.map(|t| t[0]), "main_ms_without": term.ms.map(|t| t[1]),
                "operations": term.operations[0], "operations_without": term.operations[1],
            });
        }
        if !self.day.is_empty() {
            out["day"] = serde_json::to_value(&self.day).unwrap_or_default();
        }
        out
    }

    /// The report in words.
    pub fn text(&self) -> String {
        let mut out = format!("adapter: {}{}\n", self.adapter, if self.software { ", software: frame times are not judged" } else { "" });
        for failure in &self.failures {
            out += &format!("MISSED  {failure}\n");
        }
        for view in &self.views {
            out += &format!("{}\n", view.line());
        }
        if let Some(term) = &self.translucency {
            let [with, without] = term.operations;
            out += &format!("translucency maps: {with} operations a fragment, {without} without");
            if let Some([with, without]) = term.ms {
                out += &format!("; {:.2} times the main pass without ({with:.2} and {without:.2} ms)", with / without.max(1e-9));
            }
            out += "\n";
        }
        if !self.day.is_empty() {
            let worst = self.day.iter().map(|h| h.fit_error).fold(0.0, f64::max);
            out += &format!("day.png: {} hours; the fitted sky is within {worst:.1e} of an integrated one\n", self.day.len());
        }
        out
    }
}
