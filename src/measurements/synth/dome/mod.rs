//! Synthesis of a capture under a dome from a leaf specification. The leaf's maps (shared with the synthesis for the
//! linear light source) become a blade with two surfaces, which is photographed and scanned. Lengths in mm.
//!
//! The blade: the front's relief is that of the specification, and the back lies the thickness d under it. So the
//! scanner measures the same thickness that light crosses. (The specification's `raised_mm` is therefore not used: a
//! vein stands out by its extra thickness.)
//!
//! Light: under the dome a texel shows ρd · V + ρs · (what its lobe mirrors of the dome), where V is the share of the
//! dome that it sees past the relief, weighted by the cosine. Light between neighbouring slopes is left out. In front
//! of the back light it shows what comes through, spread sideways by the tissue ([`through`]).
//!
//! Scans: heights towards each camera with white noise, both smoothed by the scanner's filter. Each scan has its own
//! zero and tilt.

mod back_light;
mod veil;

use crate::Result;
use crate::leaf::{FieldWindow, SyntheticLeaf, crop, texel_size};
use crate::preview;
use crate::scan::{SHOTS, finish, gain, stop_if_asked, write_frame, write_mask};
use crate::sensor::Sensor;
use crate::spec::{InteriorModel, LeafSpec};
use back_light::{REACH_MM, through};
use mesophyll_base::image::ImageSize;
use mesophyll_base::random::RandomStream;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::dome::manifest::{DomeManifest, DomePicture, empty_path, white_path};
use mesophyll_capture::dome::smoothing::{SmoothingKernel, pass, smooth};
use mesophyll_capture::dome::visibility::visible;
use mesophyll_capture::kind::CaptureKind;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::progress::TaskProgress;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::side::{Side, Sides, mirror};
use mesophyll_optics::translucency::blade as optics;
use std::path::{Path, PathBuf};
use veil::Veil;

/// How a specification is photographed and scanned.
#[derive(Debug, Clone)]
pub struct Options {
    /// Columns of every picture.
    pub width: usize,
    /// Rows of every picture.
    pub height: usize,
    /// Width (mm) and centre (mm from the field's centre) of the part that is captured; the whole field when absent.
    pub patch: Option<(f64, [f64; 2])>,
    /// Relative noise of the photographs; 0 writes exact values, heights included.
    pub noise: f64,
    /// Standard deviation of a height as delivered (mm).
    pub height_noise_mm: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Whether σa varies over the leaf.
    pub model: InteriorModel,
}

/// Standard deviation of the Gaussian of the scanner's smoothing (mm).
const FILTER_MM: f64 = 0.05;
/// Width of the caliper's contact, and its standard error (mm).
const CONTACT_MM: f64 = 1.0;
const CALIPER_MM: f64 = 0.002;
/// Radiance of the back light at its middle.
const BOX_LEVEL: f64 = 0.9;
/// Largest tilt of a scan (mm per mm), and largest error of its zero (mm).
const TILT: f64 = 0.008;
const OFFSET_MM: f64 = 2.0;

/// A leaf with the geometry of its blade and what its photographs show.
#[derive(Debug, Clone)]
pub struct DomeLeaf {
    /// The leaf with all its maps.
    pub leaf: SyntheticLeaf,
    /// Heights of front and back over one plane, each as its own camera saw it (mm).
    pub height: Sides<Vec<f64>>,
    /// What the photographs of front and back show.
    pub shown: Sides<Vec<TexelAppearance>>,
    centre_mm: [f64; 2],
}

/// What the photographs of a texel would show under even light: shares of the dome's light and of the back light.
#[derive(Debug, Clone, Copy)]
pub struct TexelAppearance {
    /// ρd times the share of the dome that is seen.
    pub albedo: Rgb<f32>,
    /// What the surface mirrors.
    pub highlight: f32,
    /// Share of the back light that comes through.
    pub transmittance: Rgb<f32>,
}

impl DomeLeaf {
    /// Grows the leaf of a specification, gives it a back, and lights it; `None` when not one texel lies on it. The
    /// leaf continues around a patch, so that light may come in from the sides.
    ///
    /// # Errors
    /// The errors of the spreading of light ([`through`]).
    pub fn grow(spec: &LeafSpec, options: &Options) -> Result<Option<DomeLeaf>> {
        let size = ImageSize::new(options.width, options.height);
        let (window, margin) = match options.patch {
            Some((wide_mm, centre_mm)) => {
                let texel_mm = wide_mm / size.width as f64;
                (FieldWindow { centre_mm, texel_mm }, ((REACH_MM / texel_mm).ceil() as usize).min(1024))
            }
            None => (FieldWindow { centre_mm: [0.0; 2], texel_mm: texel_size(spec, size) }, 0),
        };
        let grown = ImageSize::new(size.width + 2 * margin, size.height + 2 * margin);
        let wide = grown.width;
        let grown = SyntheticLeaf::grow_in(spec, options.model, grown, window);
        let Some(mut leaf) = grown.filter(|leaf| leaf.model != InteriorModel::Foliar) else {
            return Ok(None);
        };
        let under: Vec<f64> =
            leaf.relief.iter().zip(&leaf.sides.front).map(|(z, t)| f64::from(t.thickness) - z).collect();
        let height = Sides { front: leaf.relief.clone(), back: mirror(&under, wide) };
        let shape = optics::BladeMaps::from_heights(
            wide,
            leaf.size.height,
            leaf.texel_mm,
            leaf.mask.clone(),
            [height.front.clone(), height.back.clone()],
            [Vec::new(), Vec::new()],
        );
        let mask = leaf.mask_of(Side::Back);
        for ((t, n), on) in leaf.sides.back.iter_mut().zip(&shape.back.normal).zip(mask) {
            t.normal = if on { n.map(|v| v as f32) } else { [0.0; 3] };
        }
        let shown = shine(&leaf, &shape)?;
        let leaf = leaf.cropped(margin);
        if !leaf.mask.contains(&true) {
            return Ok(None);
        }
        let height = Sides::of(|side| crop(&height[side], wide, margin));
        let shown = Sides::of(|side| crop(&shown[side], wide, margin));
        Ok(Some(DomeLeaf { leaf, height, shown, centre_mm: window.centre_mm }))
    }

    /// Place of a texel in the field (mm), for the front. Light and camera are equally uneven for the back.
    fn place(&self, k: usize) -> [f64; 2] {
        let p = self.leaf.size.place_mm(self.leaf.texel_mm, k);
        [p[0] + self.centre_mm[0], p[1] + self.centre_mm[1]]
    }
}

/// The light of both sides.
fn shine(leaf: &SyntheticLeaf, shape: &optics::BladeMaps) -> Result<Sides<Vec<TexelAppearance>>> {
    let veil = Veil::new(leaf.lobe);
    let through = through(leaf, shape)?;
    Ok(Sides::of(|side| {
        let (seen, mask) = (visible(&shape.lit(side)), leaf.mask_of(side));
        let shown = |k: usize| {
            let (t, transmittance) = (&leaf.sides[side][k], through[side][k]);
            let mirrored = f64::from(t.rho_s) * veil.at(f64::from(t.normal[2]), f64::from(t.m));
            TexelAppearance {
                albedo: t.rho_d.map(|d| (f64::from(d) * seen[k]) as f32),
                highlight: if mask[k] { mirrored as f32 } else { 0.0 },
                transmittance,
            }
        };
        (0..mask.len()).map(shown).collect()
    }))
}

/// Photographs and scans `spec` into `folder`; `capture.toml` comes last.
///
/// # Errors
/// [`Error::Write`] for what cannot be written, [`Error::Interrupted`] after Ctrl-C.
pub fn capture(spec: &LeafSpec, blade: &DomeLeaf, options: &Options, folder: &Path) -> Result<DomeManifest> {
    let leaf = &blade.leaf;
    let device = &spec.device;
    let sensor = Sensor { relative: options.noise, floor: device.noise_floor, full_scale: device.full_scale };
    let manifest = manifest_of(spec, blade, options);
    let bar = TaskProgress::new("photographing sides", 2);
    let put = |path: PathBuf, light: &dyn Fn(usize) -> Rgb, sensor: Sensor, place: u64| {
        stop_if_asked(folder)?;
        let image = (0..manifest.texels()).map(|k| gain(spec, blade.place(k)) * light(k) + device.dark);
        write_frame(&path, image.collect(), leaf.size, sensor, options.seed, [20, place, 0], None)
    };
    let dome = |k: usize| {
        let [x, y] = blade.place(k);
        1.0 - 0.03 * (x / spec.field_mm[0]).powi(2) + 0.02 * y / spec.field_mm[1]
    };
    let lamp = |k: usize| {
        let [x, y] = blade.place(k);
        BOX_LEVEL * (1.0 + 0.04 * x / spec.field_mm[0] - 0.03 * (y / spec.field_mm[1]).powi(2))
    };
    for (side, shown) in blade.shown.iter() {
        let (mask, place) = (leaf.mask_of(side), side as u64);
        // Beside the leaf the camera sees the back light, and under the dome it sees black cloth.
        let albedo = |k: usize| shown[k].albedo.map(|d| dome(k) * f64::from(d + shown[k].highlight));
        let through = |k: usize| shown[k].transmittance.map(|t| lamp(k) * if mask[k] { f64::from(t) } else { 1.0 });
        put(DomePicture::Albedo.path(folder, side), &albedo, sensor, place)?;
        put(DomePicture::Translucency.path(folder, side), &through, sensor, 2 + place)?;
        let mut scan = ChannelMaps::new(leaf.size.width, leaf.size.height);
        scan.push("Y", scanned(&blade.height[side], &mask, leaf, options, place));
        write_exr(&DomePicture::Height.path(folder, side), &scan, Packing::Raw)?;
        write_exr(&mesophyll_capture::truth_path(folder, side), &truth(blade, side), Packing::Zip)?;
        preview::write(folder, leaf, side)?;
        bar.advance(1);
    }
    let mean = sensor.averaging(SHOTS);
    put(white_path(folder), &|k| Rgb::splat(dome(k)), mean, 4)?;
    put(empty_path(folder), &|k| Rgb::splat(lamp(k)), mean, 5)?;
    put(folder.join("dark.exr"), &|_| Rgb::splat(0.0), mean, 6)?;
    write_mask(folder, leaf)?;
    finish(folder, manifest)
}

/// The true maps of a side: those of the leaf, and what its photographs show of it.
pub fn truth(blade: &DomeLeaf, side: Side) -> ChannelMaps {
    let (shown, mask) = (&blade.shown[side], blade.leaf.mask_of(side));
    let mut maps = blade.leaf.truth(side);
    for c in 0..3 {
        maps.push(format!("albedo.{}", RGB[c]), shown.iter().map(|v| v.albedo[c]).collect());
        maps.add(Quantity::Transmittance, c, shown.iter().map(|v| v.transmittance[c]).collect());
    }
    maps.add(Quantity::Highlight, 0, shown.iter().map(|v| v.highlight).collect());
    let height = blade.height[side].iter().zip(&mask).map(|(z, m)| if *m { *z as f32 } else { 0.0 });
    maps.add(Quantity::Height, 0, height.collect());
    maps
}

/// A height scan: the surface and the scanner's noise, smoothed together, with the scan's own tilt and zero; NaN off
/// the leaf.
fn scanned(height: &[f64], mask: &[bool], leaf: &SyntheticLeaf, options: &Options, side: u64) -> Vec<f32> {
    let ImageSize { width: w, height: h } = leaf.size;
    let exact = options.noise == 0.0;
    let kernel = SmoothingKernel::gaussian(if exact { 0.0 } else { FILTER_MM / leaf.texel_mm });
    let weight: Vec<f64> = mask.iter().map(|m| f64::from(u8::from(*m))).collect();
    let mut surface = smooth(height, &weight, w, &kernel);
    if !exact {
        let mut white = Vec::with_capacity(w * h + 1);
        for j in 0..h {
            let mut stream = RandomStream::new(options.seed, &[21, side, j as u64]);
            let mut row: Vec<f64> = (0..w.div_ceil(2)).flat_map(|_| stream.normal_pair()).collect();
            row.truncate(w);
            white.append(&mut row);
        }
        let scale = options.height_noise_mm / kernel.noise();
        surface.iter_mut().zip(pass(&white, w, &kernel)).for_each(|(z, n)| *z += scale * n);
    }
    let mut stream = RandomStream::new(options.seed, &[22, side]);
    let (tilt, zero) = ([TILT * stream.signed(), TILT * stream.signed()], OFFSET_MM * stream.signed());
    (0..w * h)
        .map(|k| {
            let [x, y] = leaf.size.place_mm(leaf.texel_mm, k);
            if mask[k] { (surface[k] + zero + tilt[0] * x + tilt[1] * y) as f32 } else { f32::NAN }
        })
        .collect()
}

fn manifest_of(spec: &LeafSpec, blade: &DomeLeaf, options: &Options) -> DomeManifest {
    let leaf = &blade.leaf;
    let exact = options.noise == 0.0;
    let weight: Vec<f64> = leaf.mask.iter().map(|m| f64::from(u8::from(*m))).collect();
    let thickness: Vec<f64> = leaf.sides.front.iter().map(|t| f64::from(t.thickness)).collect();
    let met =
        smooth(&thickness, &weight, leaf.size.width, &SmoothingKernel::gaussian(0.25 * CONTACT_MM / leaf.texel_mm));
    let thickest = met.iter().zip(&leaf.mask).filter(|(_, m)| **m).fold(0.0, |a: f64, (d, _)| a.max(*d));
    let slip = if exact { 0.0 } else { CALIPER_MM * RandomStream::new(options.seed, &[23]).normal_pair()[0] };
    DomeManifest {
        schema: 1,
        kind: CaptureKind::Dome.field().unwrap_or_default().into(),
        name: spec.name.clone(),
        width: leaf.size.width,
        height: leaf.size.height,
        texel_mm: leaf.texel_mm,
        thickness_max_mm: (1e6 * (thickest + slip)).round() / 1e6,
        thickness_max_err_mm: (!exact).then_some(CALIPER_MM),
        contact_mm: CONTACT_MM,
        noise_relative: Some(options.noise),
        noise_floor: Some(if exact { 0.0 } else { spec.device.noise_floor }),
        reference_shots: SHOTS as u32,
        height_noise_mm: Some(if exact { 0.0 } else { options.height_noise_mm }),
        height_filter_mm: if exact { 0.0 } else { FILTER_MM },
        full_scale: None,
        white_reflectance: 1.0,
        highlight_index: Some(index_of(spec)),
        sides: vec![Side::Front, Side::Back],
    }
}

/// The refractive index of a smooth surface that mirrors as much along its normal as each side does, to two digits.
pub fn index_of(spec: &LeafSpec) -> [f64; 2] {
    let fresnel = spec.lobe.index().map_or(1.0, |index| ((index - 1.0) / (index + 1.0)).powi(2));
    [&spec.front, &spec.back].map(|s| {
        let r = (s.rho_s * fresnel).min(0.15).sqrt();
        (100.0 * (1.0 + r) / (1.0 - r)).round() / 100.0
    })
}
