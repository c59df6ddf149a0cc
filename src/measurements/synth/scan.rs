//! The scan: frames of the moving tube for both sides and both passes, white sheet, dark frame, light box, mask and
//! truth. They are written frame by frame, so that a full-size capture is never held in memory. `capture.toml` comes
//! last: a folder without it is not yet a capture.

use super::illumination::TubeDevice;
use super::leaf::{SyntheticLeaf, SyntheticTexel};
use super::preview;
use super::sensor::{EXPOSURES, Sensor};
use super::spec::{InteriorModel, LeafSpec};
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::random::RandomStream;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::manifest::{self, LightBox, TubeManifest, TubePass};
use mesophyll_files::atomic;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::progress::{TaskProgress, stop_requested};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// How a specification is scanned.
#[derive(Debug, Clone)]
pub struct Options {
    /// Columns of every frame.
    pub width: usize,
    /// Rows of every frame.
    pub height: usize,
    /// Frames a pass.
    pub frames: usize,
    /// The passes that are scanned.
    pub passes: Vec<Travel>,
    /// Where the frames of a pass stand (mm), in place of even ones.
    pub positions: Vec<(Travel, Vec<f64>)>,
    /// Relative noise; 0 writes exact values.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Whether σa varies over the leaf.
    pub model: InteriorModel,
    /// Keeps the three exposures of every frame in addition to the merged one.
    pub raw_exposures: bool,
}

impl Default for Options {
    /// A scan of full size with 1 % of noise, of a leaf whose σa is the same everywhere.
    fn default() -> Options {
        Options {
            width: 720,
            height: 540,
            frames: 100,
            passes: vec![Travel::X, Travel::Y],
            positions: Vec::new(),
            noise: 0.01,
            seed: 1,
            model: InteriorModel::Exact,
            raw_exposures: false,
        }
    }
}

/// White, dark and light-box references are averaged over this many shots.
pub(crate) const SHOTS: f64 = 64.0;
/// Radiance of the light box at its middle.
const BOX_LEVEL: f64 = 0.9;

/// Scans `leaf` into `folder`.
///
/// # Errors
/// [`Error::Write`] for what cannot be written, [`Error::Interrupted`] after Ctrl-C; without `capture.toml` the folder
/// is no capture.
pub fn scan(spec: &LeafSpec, leaf: &SyntheticLeaf, options: &Options, folder: &Path) -> Result<TubeManifest> {
    let manifest = manifest_of(spec, leaf, options);
    let device = &spec.device;
    let sensor = Sensor { relative: options.noise, floor: device.noise_floor, full_scale: device.full_scale };
    let camera = Camera { spec, seed: options.seed };
    let white_size = white_size(leaf.size);
    let frames: usize = manifest.passes.iter().map(|p| p.positions().len()).sum();
    let bar = TaskProgress::new("scanning", (2 * frames) as u64);

    for side in Side::ALL {
        let view = View::new(leaf, side);
        for (p, pass) in manifest.passes.iter().enumerate() {
            let tube = TubeDevice::new(device.tube, pass.name, device.camera_deg);
            for (k, &position) in pass.positions().iter().enumerate() {
                stop_if_asked(folder)?;
                let image = camera.frame(&view, &tube, pass.name, position);
                let path = manifest::frame_path(folder, side, pass.name, k);
                let place = [1 + side as u64, p as u64, k as u64];
                let raw = options.raw_exposures.then(|| path.with_extension(""));
                write_frame(&path, image, leaf.size, sensor, options.seed, place, raw)?;
                bar.advance(1);
            }
        }
    }
    references(&manifest, leaf, &camera, sensor.averaging(SHOTS), white_size, folder)?;
    write_mask(folder, leaf)?;
    for side in Side::ALL {
        write_exr(&mesophyll_capture::truth_path(folder, side), &leaf.truth(side), Packing::Zip)?;
        preview::write(folder, leaf, side)?;
    }
    finish(folder, manifest)
}

/// Writes the leaf's mask.
pub(crate) fn write_mask(folder: &Path, leaf: &SyntheticLeaf) -> Result<()> {
    let mut mask = ChannelMaps::new(leaf.size.width, leaf.size.height);
    mask.push("Y", leaf.mask.iter().map(|&m| f32::from(u8::from(m))).collect());
    write_exr(&folder.join("mask.exr"), &mask, Packing::Zip)
}

/// Writes `capture.toml`, by which a folder becomes a capture.
pub(crate) fn finish<M: serde::Serialize>(folder: &Path, manifest: M) -> Result<M> {
    let path = folder.join("capture.toml");
    let text = toml::to_string(&manifest).map_err(|e| Error::write(&path, e))?;
    atomic::write_bytes(&path, text.as_bytes())?;
    Ok(manifest)
}

/// Ends a synthesis after Ctrl-C.
pub fn stop_if_asked(folder: &Path) -> Result<()> {
    if stop_requested() {
        return Err(Error::Interrupted(format!(
            "stopped before the capture {} was complete; nothing of it was kept",
            folder.display()
        )));
    }
    Ok(())
}

fn manifest_of(spec: &LeafSpec, leaf: &SyntheticLeaf, options: &Options) -> TubeManifest {
    let device = &spec.device;
    let passes = options.passes.iter().map(|&name| {
        if let Some((_, list)) = options.positions.iter().find(|(travel, _)| *travel == name) {
            return TubePass { name, start_mm: None, end_mm: None, frames: None, positions_mm: Some(list.clone()) };
        }
        let [a, b] = if name == Travel::X { device.travel_x_mm } else { device.travel_y_mm };
        TubePass { name, start_mm: Some(a), end_mm: Some(b), frames: Some(options.frames), positions_mm: None }
    });
    TubeManifest {
        schema: 1,
        name: spec.name.clone(),
        width: leaf.size.width,
        height: leaf.size.height,
        texel_mm: leaf.texel_mm,
        thickness_mm: spec.thickness_mm,
        thickness_err_mm: None,
        camera_deg: device.camera_deg,
        noise_relative: Some(options.noise),
        noise_floor: Some(if options.noise > 0.0 { device.noise_floor } else { 0.0 }),
        white_reflectance: None,
        sides: vec![Side::Front, Side::Back],
        tube: device.tube,
        lightbox: LightBox { camera_deg: device.lightbox_camera_deg },
        limits: None,
        passes: passes.collect(),
    }
}

/// A quarter of the leaf's frames in each direction, but not so small that interpolating the vignette between its
/// texels would show.
fn white_size(of: ImageSize) -> ImageSize {
    ImageSize::new((of.width / 4).max(of.width.min(180)), (of.height / 4).max(of.height.min(135)))
}

/// One side as the scan needs it.
struct View<'a> {
    leaf: &'a SyntheticLeaf,
    side: &'a [SyntheticTexel],
    mask: Vec<bool>,
}

impl<'a> View<'a> {
    fn new(leaf: &'a SyntheticLeaf, side: Side) -> Self {
        View { leaf, side: &leaf.sides[side], mask: leaf.mask_of(side) }
    }
}

/// Sensitivity at a place of the field (mm), a channel each. It falls off quadratically towards the corners.
pub fn gain(spec: &LeafSpec, p: [f64; 2]) -> Rgb {
    let half = spec.field_mm.map(|f| 0.5 * f);
    let r2 = ((p[0] / half[0]).powi(2) + (p[1] / half[1]).powi(2)) * 0.5;
    Rgb(spec.device.gain) * (1.0 - spec.device.vignette * r2)
}

struct Camera<'a> {
    spec: &'a LeafSpec,
    seed: u64,
}

impl Camera<'_> {
    fn gain(&self, p: [f64; 2]) -> Rgb {
        gain(self.spec, p)
    }

    /// Noise-free values of a frame, dark level included: row-major, RGB.
    fn frame(&self, view: &View, tube: &TubeDevice, travel: Travel, position: f64) -> Vec<Rgb> {
        let leaf = view.leaf;
        let (ImageSize { width: w, height: h }, dark) = (leaf.size, self.spec.device.dark);
        let across = |k: usize| leaf.size.place_mm(leaf.texel_mm, k);
        // What the tube looks like depends only on the place along its travel: a column (pass x) or a row (pass y).
        let columns: Vec<_> = match travel {
            Travel::X => (0..w).map(|i| tube.seen(position, across(i)[0])).collect(),
            Travel::Y => (0..h).map(|j| tube.seen(position, across(j * w)[1])).collect(),
        };
        let mut image = vec![Rgb::splat(dark); w * h];
        image.par_chunks_mut(w).enumerate().for_each(|(j, row)| {
            for (i, value) in row.iter_mut().enumerate() {
                let k = j * w + i;
                if !view.mask[k] {
                    continue;
                }
                let [x, y] = across(k);
                let (seen, along) = if travel == Travel::X { (&columns[i], y) } else { (&columns[j], x) };
                let t = &view.side[k];
                let m = (t.rho_s > 0.0).then(|| f64::from(t.m));
                let shown = tube.shown(seen, along, t.normal.map(f64::from), m, leaf.lobe);
                let light = t.rho_d.map(|d| f64::from(d) * shown.diffuse + f64::from(t.rho_s) * shown.gloss);
                *value = self.gain([x, y]) * light + dark;
            }
        });
        image
    }

    /// Noise-free values of the white sheet, which covers the same field with fewer texels.
    fn white(&self, tube: &TubeDevice, travel: Travel, position: f64, size: ImageSize, texel: [f64; 2]) -> Vec<Rgb> {
        let mut image = vec![Rgb::splat(0.0); size.texels()];
        image.par_chunks_mut(size.width).enumerate().for_each(|(j, row)| {
            for (i, value) in row.iter_mut().enumerate() {
                let k = j * size.width + i;
                let p = [size.place_mm(texel[0], k)[0], size.place_mm(texel[1], k)[1]];
                let (at, along) = if travel == Travel::X { (p[0], p[1]) } else { (p[1], p[0]) };
                let shown = tube.shown(&tube.seen(position, at), along, [0.0, 0.0, 1.0], None, Lobe::Beckmann);
                *value = self.gain(p) * shown.diffuse + self.spec.device.dark;
            }
        });
        image
    }

    /// The light box, with a leaf on it or without (Wang et al. 2005 §3: reciprocity makes the ratio the ρt of a beam
    /// at the camera's angle).
    fn lightbox(&self, leaf: &SyntheticLeaf, on_it: Option<&View>) -> Vec<Rgb> {
        let field = self.spec.field_mm;
        (0..leaf.size.texels())
            .map(|k| {
                let [x, y] = leaf.size.place_mm(leaf.texel_mm, k);
                // No light box is even: this one is a little brighter to one side.
                let level = BOX_LEVEL * (1.0 + 0.04 * x / field[0] - 0.03 * (y / field[1]).powi(2));
                let through = match on_it {
                    Some(view) if view.mask[k] => view.side[k].through.map(f64::from),
                    _ => Rgb::splat(1.0),
                };
                self.gain([x, y]) * level * through + self.spec.device.dark
            })
            .collect()
    }
}

/// Number of texels of a mirror frame across the strip, along which nothing changes.
const STRIP: usize = 4;

/// A level mirror in the blade's plane, a strip along the travel. It shows only where the tube's reflection is. It is
/// seen through a filter, because a mirror shows the tube itself, H/a times as bright as white paper; here the tube has
/// the value 1.
fn mirror(
    manifest: &TubeManifest,
    travel: Travel,
    position: f64,
    white: ImageSize,
    dark: f64,
) -> (Vec<Rgb>, ImageSize) {
    let (sin, cos) = manifest.camera_deg.to_radians().sin_cos();
    let (tube, field) = (manifest.tube, [manifest.width, manifest.height].map(|n| n as f64 * manifest.texel_mm));
    // The camera's ray, reflected by the mirror to (−sin, 0, cos), meets the tube where it passes the axis at less than
    // the tube's radius: around position + H tan(camera) in pass x, and around the position itself in pass y.
    let (size, count, length, centre, half) = match travel {
        Travel::X => {
            let centre = position + tube.height_mm * sin / cos;
            (ImageSize::new(white.width, STRIP), white.width, field[0], centre, tube.radius_mm / cos)
        }
        Travel::Y => (ImageSize::new(STRIP, white.height), white.height, field[1], position, tube.radius_mm),
    };
    // Share of each texel along the travel that shows the tube.
    let wide = length / count as f64;
    let covered: Vec<f64> = (0..count)
        .map(|k| {
            let at = match travel {
                Travel::X => (k as f64 + 0.5 - count as f64 / 2.0) * wide,
                Travel::Y => (count as f64 / 2.0 - k as f64 - 0.5) * wide,
            };
            ((at + 0.5 * wide).min(centre + half) - (at - 0.5 * wide).max(centre - half)).max(0.0) / wide
        })
        .collect();
    let along = |k: usize| size.position(k)[usize::from(travel == Travel::Y)];
    ((0..size.texels()).map(|k| Rgb::splat(dark + covered[along(k)])).collect(), size)
}

fn references(
    manifest: &TubeManifest,
    leaf: &SyntheticLeaf,
    camera: &Camera,
    sensor: Sensor,
    white: ImageSize,
    folder: &Path,
) -> Result<()> {
    let size = leaf.size;
    let put = |name: PathBuf, image: Vec<Rgb>, size: ImageSize, place: [u64; 3]| {
        stop_if_asked(folder)?;
        write_frame(&name, image, size, sensor, camera.seed, place, None)
    };
    // The sheet covers exactly the leaf's field, so its texels are wider.
    let texel =
        [(size.width, white.width), (size.height, white.height)].map(|(n, of)| leaf.texel_mm * n as f64 / of as f64);
    for (p, pass) in manifest.passes.iter().enumerate() {
        let tube = TubeDevice::new(manifest.tube, pass.name, manifest.camera_deg);
        for (k, &position) in pass.positions().iter().enumerate() {
            let image = camera.white(&tube, pass.name, position, white, texel);
            put(manifest::white_path(folder, pass.name, k), image, white, [10, p as u64, k as u64])?;
            if manifest.tube.radius_mm > 0.0 {
                let (image, size) = mirror(manifest, pass.name, position, white, camera.spec.device.dark);
                put(manifest::mirror_path(folder, pass.name, k), image, size, [13, p as u64, k as u64])?;
            }
        }
    }
    put(folder.join("dark.exr"), vec![Rgb::splat(camera.spec.device.dark); size.texels()], size, [11, 0, 0])?;
    put(folder.join("lightbox_empty.exr"), camera.lightbox(leaf, None), size, [12, 0, 0])?;
    for side in Side::ALL {
        let image = camera.lightbox(leaf, Some(&View::new(leaf, side)));
        put(folder.join(side.name()).join("lightbox.exr"), image, size, [13, side as u64, 0])?;
    }
    Ok(())
}

/// Adds noise, merges the exposures and writes a frame; with `raw` also `<raw>_e0.png` … (16-bit linear counts).
pub(crate) fn write_frame(
    path: &Path,
    mut image: Vec<Rgb>,
    size: ImageSize,
    sensor: Sensor,
    seed: u64,
    place: [u64; 3],
    raw: Option<PathBuf>,
) -> Result<()> {
    image.par_chunks_mut(size.width).enumerate().for_each(|(j, row)| {
        let stream = RandomStream::new(seed, &[place[0], place[1], place[2], j as u64]);
        sensor.disturb(row.iter_mut().flatten(), stream);
    });
    let mut maps = ChannelMaps::new(size.width, size.height);
    maps.push_rgb(&image.iter().map(|v| v.map(|v| sensor.merged(v))).collect::<Vec<_>>());
    write_exr(path, &maps, Packing::Raw)?;
    let Some(stem) = raw else { return Ok(()) };
    for e in 0..EXPOSURES {
        let counts: Vec<u16> = image.iter().flatten().map(|&v| sensor.count(v, e)).collect();
        let path = PathBuf::from(format!("{}_e{e}.png", stem.display()));
        let bytes: Vec<u8> = counts.iter().flat_map(|c| c.to_ne_bytes()).collect();
        let mut out = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut out);
        let [width, height] = [size.width, size.height].map(|n| n as u32);
        image::ImageEncoder::write_image(encoder, &bytes, width, height, image::ExtendedColorType::Rgb16)
            .map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, &out)?;
    }
    Ok(())
}
