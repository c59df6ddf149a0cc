//! Compares methods for light between leaves. Every view of a scene is drawn with each of them, and each picture has
//! its error against the path tracer, its time and its bytes (Wang et al. 2005, Fig. 8 and 9).
//!
//! | name | what it is |
//! |---|---|
//! | `sun` | the sun alone, with its shadows: no light from the sky or from other leaves |
//! | `transfer` | the light between leaves alone, without the sun's own |
//! | `transfer, visibility` | both; what every vertex sees of the sun was worked out beforehand |
//! | `transfer, shadow maps` | both; shadows are drawn in the picture's own time |
//! | `occlusion` | as the one before, with light between leaves by multi-bounce ambient occlusion |
//! | `alone, shadow maps` | every leaf is lit as if it stood alone, except for the sun's shadows |
//! | `wavelets` | the light cut to 1,000 Haar wavelets of a 32² · 6 cube map (Ng et al. 2003), otherwise true |
//! | `path tracer` | the reference with another seed, whose error is that of its noise |
//!
//! Without a sun, only `transfer`, `occlusion` and `alone` of the first six are left. Wavelets are drawn by the path
//! tracer, because the method could draw at best a picture under the cut light. Their bytes are computed: one
//! coefficient in half precision for each pixel, wavelet and colour, without any compression.

use crate::sun_shares::{SunShareChange, kept};
use crate::{Options, open, told};
use mesophyll_base::error::{Error, Result};
use mesophyll_files::{atomic, image, progress};
use mesophyll_scene::draw::scene_reference::{ReferenceSampling, SceneReference};
use mesophyll_scene::draw::{handover, reference};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::PerspectiveView;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::comparison::compare;
use mesophyll_transport::cube::CubeLight;
use mesophyll_transport::{CameraRays, ReferencePicture, ReferenceWorld, tone};
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;
use std::fmt::Write;
use std::sync::Arc;
use std::time::Instant;

/// A way to draw a view, with its error, time and bytes.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MethodRow {
    /// The view's name.
    pub view: String,
    /// One of the names in the module's table.
    pub method: &'static str,
    /// 99th percentile of FLIP against the path tracer, over the whole picture.
    pub flip_p99: f64,
    /// Mean of FLIP.
    pub flip_mean: f64,
    /// Root of the mean square of the difference in radiance over pixels that show leaves, over their mean radiance.
    pub rms_over_mean: f64,
    /// Time of a frame (median), or of the whole picture of the path tracer.
    pub milliseconds: f64,
    /// Bytes that are stored for the light: operators, shares of the sun, shadow maps, wavelets.
    pub light_bytes: u64,
    /// File of the picture.
    pub picture: String,
}

/// Number of wavelets that are kept, side of the cube map, and rows of the environment map that it is drawn as (Wang et
/// al. 2005, Fig. 9).
const WAVELETS: usize = 1000;
const SIDE: usize = 32;
const ROWS: usize = 256;
/// Shadow maps of the sun's disk, where the scene itself needs none.
const SHADOWS: (u32, u32) = (8, 2048);

/// Draws all perspective views in all ways; writes the pictures, and the rows as `methods.csv`. Where plants move, it
/// also finds out how far what leaves see of the sun at rest holds at a view's time.
///
/// # Errors
/// [`Error::Usage`] for a scene without light between leaves; [`Error::Missed`] without an adapter; and those of
/// reading, drawing and writing.
pub fn weigh(
    scene: &mut LoadedScene,
    options: &Options,
    ledger: &Ledger,
) -> Result<(Vec<MethodRow>, Vec<SunShareChange>)> {
    if scene.transfer.is_none() {
        let why = "missing, or left out for a leaf that stands alone; methods are compared for light between leaves";
        return Err(Error::field(&scene.manifest.path, "transfer", why));
    }
    let own = handover::scene(scene, ledger)?;
    let exact = scene.transfer.clone();
    scene.occlude(&options.out, ledger)?;
    let occluded = handover::scene(scene, ledger)?;
    scene.transfer = exact;
    let scene = &*scene;
    let manifest = &scene.manifest;
    let mut renderer = open()?;
    let (mut rows, mut held) = (Vec::new(), Vec::new());
    for view in manifest.perspectives() {
        let _bar = progress::TaskProgress::of(format!("methods for view {}", view.name));
        let world = reference::traced(scene, manifest.time_of(view), ledger)?;
        if scene.placed.moves().plants() {
            let rest = reference::traced(scene, manifest.rest_time(), ledger)?;
            held.extend(kept(&view.name, &rest, &world, scene.drawn().count())?);
        }
        rows.extend(
            Weighing { scene, view, own: &own, occluded: &occluded, world: &world, options }.rows(&mut renderer)?,
        );
    }
    let mut csv = String::from("view,method,flip_p99,flip_mean,rms_over_mean,milliseconds,light_bytes,picture\n");
    for r in &rows {
        let _ = writeln!(
            csv,
            "{},\"{}\",{:.4},{:.4},{:.4},{:.2},{},{}",
            r.view, r.method, r.flip_p99, r.flip_mean, r.rms_over_mean, r.milliseconds, r.light_bytes, r.picture
        );
    }
    atomic::write_bytes(&options.out.join("methods.csv"), csv.as_bytes())?;
    Ok((rows, held))
}

/// The rows as text.
pub fn text(rows: &[MethodRow], held: &[SunShareChange]) -> String {
    let mut out = format!("{:<10} {:<22} FLIP 99 %  RMS/mean  ms          bytes\n", "view", "method");
    for r in rows {
        let _ = writeln!(
            out,
            "{:<10} {:<22} {:<10.3} {:<9.3} {:<11.1} {}",
            r.view, r.method, r.flip_p99, r.rms_over_mean, r.milliseconds, r.light_bytes
        );
    }
    held.iter().for_each(|kept| out += &kept.line());
    out
}

/// One view.
struct Weighing<'a> {
    scene: &'a LoadedScene,
    view: &'a PerspectiveView,
    own: &'a viewer::Scene,
    /// The scene with light between leaves by ambient occlusion.
    occluded: &'a viewer::Scene,
    world: &'a ReferenceWorld,
    options: &'a Options,
}

impl Weighing<'_> {
    fn rows(&self, renderer: &mut gpu::Renderer) -> Result<Vec<MethodRow>> {
        let check = &self.scene.manifest.check;
        let stage = SceneReference::new(self.world, true)?;
        let truth = stage.view(self.scene, self.view, check.seed)?;
        let start = Instant::now();
        let other = stage.view(self.scene, self.view, check.seed.wrapping_add(1))?;
        let seconds = start.elapsed().as_secs_f64();
        let mut rows = Vec::new();
        for (method, mut drawn) in ways(self.own, self.occluded) {
            if let Some(wind) = &mut drawn.wind {
                wind.time_s = self.scene.manifest.time_of(self.view);
            }
            renderer.set_scene(&drawn).map_err(told)?;
            let camera = handover::camera(&self.view.camera);
            let picture = renderer.render(&camera, check.width, check.height).map_err(told)?;
            let timing = renderer.time(&camera, check.width, check.height, check.frames as usize).map_err(told)?;
            let frame = timing.quantile(0.5).unwrap_or(0.0);
            rows.push(self.row(method, &truth, (&picture.hdr, &picture.ldr), frame, bytes(&drawn))?);
        }
        let start = Instant::now();
        let cut = self.cut_light(&truth)?;
        let pixels = u64::from(check.width) * u64::from(check.height);
        let size = pixels * WAVELETS as u64 * 3 * 2;
        let took = start.elapsed().as_secs_f64() * 1e3;
        rows.push(self.row("wavelets", &truth, (&cut.hdr, &cut.ldr), took, size)?);
        rows.push(self.row("path tracer", &truth, (&other.hdr, &other.ldr), seconds * 1e3, 0)?);
        image::write_png(
            &self.options.out.join(format!("{}-reference.png", self.view.name)),
            truth.width,
            truth.height,
            truth.ldr.as_flattened(),
        )?;
        Ok(rows)
    }

    fn row(
        &self,
        method: &'static str,
        truth: &ReferencePicture,
        (hdr, ldr): (&[[f32; 4]], &[[u8; 4]]),
        milliseconds: f64,
        light_bytes: u64,
    ) -> Result<MethodRow> {
        let seen = compare(truth, ldr)?;
        let picture = format!("{}-{}.png", self.view.name, method.replace(", ", "-").replace(' ', "-"));
        image::write_png(&self.options.out.join(&picture), truth.width, truth.height, ldr.as_flattened())?;
        let (mut square, mut sum, mut count) = (0.0, 0.0, 0);
        for (a, b) in hdr.iter().zip(&truth.hdr).filter(|(_, b)| b[3] >= 1.0) {
            for c in 0..3 {
                square += f64::from(a[c] - b[c]).powi(2);
                sum += f64::from(b[c]);
                count += 1;
            }
        }
        let mean = sum / f64::from(count.max(1));
        Ok(MethodRow {
            view: self.view.name.clone(),
            method,
            flip_p99: seen.flip_p99,
            flip_mean: seen.flip_mean,
            rms_over_mean: (square / f64::from(count.max(1))).sqrt() / mean.max(f64::MIN_POSITIVE),
            milliseconds,
            light_bytes,
            picture,
        })
    }

    /// The view under light that was cut to its largest wavelets. The background is the scene's own.
    fn cut_light(&self, truth: &ReferencePicture) -> Result<ReferencePicture> {
        let mut cube = CubeLight::new(self.world, SIDE)?;
        cube.keep(WAVELETS);
        let map = cube.environment(ROWS)?;
        let mut world = ReferenceWorld { sun: None, sky: None, dome: None, ..self.world.clone() };
        // Translucency maps belong to a sun in one direction, which this light does not have.
        world.through.clear();
        world.environment = Some(Arc::new(map.clone()));
        let sampling = ReferenceSampling::of(self.scene, self.scene.manifest.check.seed);
        let camera = self.view.camera;
        let mut out = SceneReference::new(&world, true)?.draw(&camera, "wavelets", sampling)?;
        let lens = CameraRays::new(&camera, out.width, out.height)?;
        let exposure = self.scene.manifest.exposure;
        for k in 0..out.hdr.len() {
            let beside = f64::from(1.0 - truth.hdr[k][3]);
            if beside <= 0.0 {
                continue;
            }
            let d = lens.ray((k % out.width) as f64 + 0.5, (k / out.width) as f64 + 0.5).direction;
            let (cut, own) = (map.at(d), self.background(d));
            for c in 0..3 {
                let value = f64::from(out.hdr[k][c]) + beside * (own[c] - cut[c]);
                out.hdr[k][c] = value.max(0.0) as f32;
                out.ldr[k][c] = (tone::display(value.max(0.0), exposure) * 255.0 + 0.5) as u8;
            }
        }
        Ok(out)
    }

    /// The background in a direction where nothing stands.
    fn background(&self, d: glam::DVec3) -> [f64; 3] {
        match &self.world.dome {
            Some(dome) => dome.behind(d),
            None => self.world.background,
        }
    }
}

/// The scene in all ways that the renderer draws it.
fn ways(own: &viewer::Scene, occluded: &viewer::Scene) -> Vec<(&'static str, viewer::Scene)> {
    let by_maps = |scene: &mut viewer::Scene| {
        scene.sun_shares = None;
        scene.instances.iter_mut().for_each(|i| i.first_share = None);
        if scene.shadow_samples == 0 {
            (scene.shadow_samples, scene.shadow_resolution) = SHADOWS;
        }
    };
    let mut sun = own.clone();
    if let Some(transfer) = &mut sun.transfer {
        transfer.entries.fill([0.0; 4]);
    }
    let mut transfer = own.clone();
    let most = own.meshes.iter().map(|m| m.positions.len()).max().unwrap_or(0);
    transfer.sun_shares = Some(Arc::new(vec![0; most]));
    transfer.instances.iter_mut().for_each(|i| i.first_share = Some(0));
    let mut maps = own.clone();
    by_maps(&mut maps);
    let mut occluded = occluded.clone();
    by_maps(&mut occluded);
    let mut alone = maps.clone();
    alone.transfer = None;
    if own.sun.is_none() {
        return vec![("transfer", own.clone()), ("occlusion", occluded), ("alone", alone)];
    }
    let mut out = vec![("sun", sun), ("transfer", transfer)];
    if own.sun_shares.is_some() {
        out.push(("transfer, visibility", own.clone()));
    }
    out.extend([("transfer, shadow maps", maps), ("occlusion", occluded), ("alone, shadow maps", alone)]);
    out
}

/// What the renderer keeps for the light of a scene.
fn bytes(scene: &viewer::Scene) -> u64 {
    // What was set to zero for a comparison would not be stored.
    let lit = |t: &&viewer::RadianceTransfer| t.entries.iter().any(|e| *e != [0.0; 4]);
    let operators = scene.transfer.as_ref().filter(lit).map_or(0, |t| 8 * t.entries.len() as u64);
    let seen = |s: &&Arc<Vec<u8>>| s.iter().any(|v| *v > 0);
    let shares = scene.sun_shares.as_ref().filter(seen).map_or(0, |s| s.len() as u64);
    let looked_up = scene.sun.is_some() && scene.instances.iter().any(|i| i.first_share.is_none());
    let side = u64::from(scene.shadow_resolution);
    operators + shares + if looked_up { u64::from(scene.shadow_samples) * side * side * 4 } else { 0 }
}
