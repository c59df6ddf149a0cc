//! The scan: frames of the moving tube for both sides and both passes, white sheet, dark frame, light box, mask and
//! truth. They are written frame by frame, so that a full-size capture is never held in memory. `capture.toml` comes
//! last: a folder without it is not yet a capture.

use super::illumination::TubeDevice;
use super::leaf::{SyntheticLeaf, SyntheticSide};
use super::preview;
use super::sensor::{EXPOSURES, Sensor};
use super::spec::{InteriorModel, LeafSpec};
use crate::{Error, Result};
use mesophyll_base::random::RandomStream;
use mesophyll_capture::manifest::{self, LightBox, TubeManifest, TubePass, texel_position};
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
    /// Relative noise; 0 writes exact values.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Whether σa varies over the leaf.
    pub model: InteriorModel,
    /// Keeps the three exposures of every frame in addition to the merged one.
    pub raw_exposures: bool,
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
    let white_size = white_size(leaf.width, leaf.height);
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
                write_frame(&path, image, (leaf.width, leaf.height), sensor, options.seed, place, raw)?;
                bar.advance(1);
            }
        }
    }
    references(&manifest, leaf, &camera, sensor.averaging(SHOTS), white_size, folder)?;
    let mut mask = ChannelMaps::new(leaf.width, leaf.height);
    mask.push("Y", leaf.mask.iter().map(|&m| f32::from(u8::from(m))).collect());
    write_exr(&folder.join("mask.exr"), &mask, Packing::Zip)?;
    for side in Side::ALL {
        write_exr(&mesophyll_capture::truth_path(folder, side), &leaf.truth(side), Packing::Zip)?;
        preview::write(folder, leaf, side)?;
    }
    let text = toml::to_string(&manifest).map_err(|e| Error::write(&folder.join("capture.toml"), e))?;
    atomic::write_bytes(&folder.join("capture.toml"), text.as_bytes())?;
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
        let [a, b] = if name == Travel::X { device.travel_x_mm } else { device.travel_y_mm };
        TubePass { name, start_mm: Some(a), end_mm: Some(b), frames: Some(options.frames), positions_mm: None }
    });
    TubeManifest {
        schema: 1,
        name: spec.name.clone(),
        width: leaf.width,
        height: leaf.height,
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
        passes: passes.collect(),
    }
}

/// A quarter of the leaf's frames in each direction, but not so small that interpolating the vignette between its
/// texels would show.
fn white_size(width: usize, height: usize) -> (usize, usize) {
    ((width / 4).max(width.min(180)), (height / 4).max(height.min(135)))
}

/// One side as the scan needs it.
struct View<'a> {
    leaf: &'a SyntheticLeaf,
    side: &'a SyntheticSide,
    mask: Vec<bool>,
}

impl<'a> View<'a> {
    fn new(leaf: &'a SyntheticLeaf, side: Side) -> Self {
        View { leaf, side: leaf.side(side), mask: leaf.mask_of(side) }
    }
}

/// Sensitivity at a place of the field (mm), a channel each. It falls off quadratically towards the corners.
pub fn gain(spec: &LeafSpec, p: [f64; 2]) -> [f64; 3] {
    let half = spec.field_mm.map(|f| 0.5 * f);
    let r2 = ((p[0] / half[0]).powi(2) + (p[1] / half[1]).powi(2)) * 0.5;
    spec.device.gain.map(|g| g * (1.0 - spec.device.vignette * r2))
}

struct Camera<'a> {
    spec: &'a LeafSpec,
    seed: u64,
}

impl Camera<'_> {
    fn gain(&self, p: [f64; 2]) -> [f64; 3] {
        gain(self.spec, p)
    }

    /// Noise-free values of a frame, dark level included: row-major, RGB.
    fn frame(&self, view: &View, tube: &TubeDevice, travel: Travel, position: f64) -> Vec<[f64; 3]> {
        let leaf = view.leaf;
        let (w, h, dark) = (leaf.width, leaf.height, self.spec.device.dark);
        let across = |i: usize, j: usize| texel_position(w, h, leaf.texel_mm, i, j);
        // What the tube looks like depends only on the place along its travel: a column (pass x) or a row (pass y).
        let columns: Vec<_> = match travel {
            Travel::X => (0..w).map(|i| tube.seen(position, across(i, 0)[0])).collect(),
            Travel::Y => (0..h).map(|j| tube.seen(position, across(0, j)[1])).collect(),
        };
        let mut image = vec![[dark; 3]; w * h];
        image.par_chunks_mut(w).enumerate().for_each(|(j, row)| {
            for (i, value) in row.iter_mut().enumerate() {
                let k = j * w + i;
                if !view.mask[k] {
                    continue;
                }
                let [x, y] = across(i, j);
                let (seen, along) = if travel == Travel::X { (&columns[i], y) } else { (&columns[j], x) };
                let m = view.side.rho_s[k].iter().any(|r| *r > 0.0).then(|| f64::from(view.side.m[k]));
                let shown = tube.shown(seen, along, view.side.normal[k].map(f64::from), m, leaf.lobe);
                let gain = self.gain([x, y]);
                for c in 0..3 {
                    let (d, s) = (f64::from(view.side.rho_d[k][c]), f64::from(view.side.rho_s[k][c]));
                    value[c] = dark + gain[c] * (d * shown.diffuse + s * shown.gloss);
                }
            }
        });
        image
    }

    /// Noise-free values of the white sheet, which covers the same field with fewer texels.
    fn white(
        &self,
        tube: &TubeDevice,
        travel: Travel,
        position: f64,
        (w, h): (usize, usize),
        texel: [f64; 2],
    ) -> Vec<[f64; 3]> {
        let mut image = vec![[0.0; 3]; w * h];
        image.par_chunks_mut(w).enumerate().for_each(|(j, row)| {
            for (i, value) in row.iter_mut().enumerate() {
                let p = [texel_position(w, h, texel[0], i, j)[0], texel_position(w, h, texel[1], i, j)[1]];
                let (at, along) = if travel == Travel::X { (p[0], p[1]) } else { (p[1], p[0]) };
                let shown = tube.shown(&tube.seen(position, at), along, [0.0, 0.0, 1.0], None, Lobe::Beckmann);
                *value = self.gain(p).map(|g| self.spec.device.dark + g * shown.diffuse);
            }
        });
        image
    }

    /// The light box, with a leaf on it or without (Wang et al. 2005 §3: reciprocity makes the ratio the ρt of a beam
    /// at the camera's angle).
    fn lightbox(&self, leaf: &SyntheticLeaf, on_it: Option<&View>) -> Vec<[f64; 3]> {
        let field = self.spec.field_mm;
        (0..leaf.width * leaf.height)
            .map(|k| {
                let [x, y] = texel_position(leaf.width, leaf.height, leaf.texel_mm, k % leaf.width, k / leaf.width);
                // No light box is even: this one is a little brighter to one side.
                let level = BOX_LEVEL * (1.0 + 0.04 * x / field[0] - 0.03 * (y / field[1]).powi(2));
                let through = match on_it {
                    Some(view) if view.mask[k] => view.side.through[k].map(f64::from),
                    _ => [1.0; 3],
                };
                let gain = self.gain([x, y]);
                [0, 1, 2].map(|c| self.spec.device.dark + gain[c] * level * through[c])
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
    white: (usize, usize),
    dark: f64,
) -> (Vec<[f64; 3]>, (usize, usize)) {
    let (sin, cos) = manifest.camera_deg.to_radians().sin_cos();
    let (tube, field) = (manifest.tube, [manifest.width, manifest.height].map(|n| n as f64 * manifest.texel_mm));
    // The camera's ray, reflected by the mirror to (−sin, 0, cos), meets the tube where it passes the axis at less than
    // the tube's radius: around position + H tan(camera) in pass x, and around the position itself in pass y.
    let (size, count, length, centre, half) = match travel {
        Travel::X => ((white.0, STRIP), white.0, field[0], position + tube.height_mm * sin / cos, tube.radius_mm / cos),
        Travel::Y => ((STRIP, white.1), white.1, field[1], position, tube.radius_mm),
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
    let along = |k: usize| if travel == Travel::X { k % size.0 } else { k / size.0 };
    ((0..size.0 * size.1).map(|k| [dark + covered[along(k)]; 3]).collect(), size)
}

fn references(
    manifest: &TubeManifest,
    leaf: &SyntheticLeaf,
    camera: &Camera,
    sensor: Sensor,
    white: (usize, usize),
    folder: &Path,
) -> Result<()> {
    let size = (leaf.width, leaf.height);
    let put = |name: PathBuf, image: Vec<[f64; 3]>, size: (usize, usize), place: [u64; 3]| {
        stop_if_asked(folder)?;
        write_frame(&name, image, size, sensor, camera.seed, place, None)
    };
    // The sheet covers exactly the leaf's field, so its texels are wider.
    let texel = [leaf.texel_mm * size.0 as f64 / white.0 as f64, leaf.texel_mm * size.1 as f64 / white.1 as f64];
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
    put(folder.join("dark.exr"), vec![[camera.spec.device.dark; 3]; size.0 * size.1], size, [11, 0, 0])?;
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
    mut image: Vec<[f64; 3]>,
    (width, height): (usize, usize),
    sensor: Sensor,
    seed: u64,
    place: [u64; 3],
    raw: Option<PathBuf>,
) -> Result<()> {
    image.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
        let stream = RandomStream::new(seed, &[place[0], place[1], place[2], j as u64]);
        sensor.disturb(row.as_flattened_mut(), stream);
    });
    let mut maps = ChannelMaps::new(width, height);
    for (c, name) in ["R", "G", "B"].iter().enumerate() {
        maps.push(*name, image.iter().map(|v| sensor.merged(v[c])).collect());
    }
    write_exr(path, &maps, Packing::Raw)?;
    let Some(stem) = raw else { return Ok(()) };
    for e in 0..EXPOSURES {
        let counts: Vec<u16> = image.as_flattened().iter().map(|&v| sensor.count(v, e)).collect();
        let path = PathBuf::from(format!("{}_e{e}.png", stem.display()));
        let bytes: Vec<u8> = counts.iter().flat_map(|c| c.to_ne_bytes()).collect();
        let mut out = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut out);
        image::ImageEncoder::write_image(encoder, &bytes, width as u32, height as u32, image::ExtendedColorType::Rgb16)
            .map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, &out)?;
    }
    Ok(())
}
