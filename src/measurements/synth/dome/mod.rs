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

use crate::leaf::{FieldWindow, SyntheticLeaf, SyntheticSide, crop, texel_size};
use crate::preview;
use crate::scan::{SHOTS, gain, stop_if_asked, write_frame};
use crate::sensor::Sensor;
use crate::spec::{InteriorModel, LeafSpec};
use crate::{Error, Result};
use back_light::{REACH_MM, through};
use mesophyll_base::random::RandomStream;
use mesophyll_capture::dome::manifest::{DomeManifest, DomePicture, empty_path, white_path};
use mesophyll_capture::dome::smoothing::{SmoothingKernel, pass, smooth};
use mesophyll_capture::dome::visibility::visible;
use mesophyll_capture::kind::CaptureKind;
use mesophyll_capture::manifest::texel_position;
use mesophyll_files::atomic;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::progress::TaskProgress;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::side::{Side, mirror};
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
    pub height: [Vec<f64>; 2],
    /// What the photographs of front and back show.
    pub shown: [SideAppearance; 2],
    centre_mm: [f64; 2],
}

/// What the photographs of a side would show under even light: shares of the dome's light and of the back light.
#[derive(Debug, Clone)]
pub struct SideAppearance {
    /// ρd times the share of the dome that is seen.
    pub albedo: Vec<[f32; 3]>,
    /// What the surface mirrors.
    pub highlight: Vec<f32>,
    /// Share of the back light that comes through, a channel each.
    pub transmittance: Vec<[f32; 3]>,
}

impl DomeLeaf {
    /// Grows the leaf of a specification, gives it a back, and lights it; `None` when not one texel lies on it. The
    /// leaf continues around a patch, so that light may come in from the sides.
    ///
    /// # Errors
    /// The errors of the spreading of light ([`through`]).
    pub fn grow(spec: &LeafSpec, options: &Options) -> Result<Option<DomeLeaf>> {
        let (w, h) = (options.width, options.height);
        let (window, margin) = match options.patch {
            Some((size, centre_mm)) => {
                let texel_mm = size / w as f64;
                (FieldWindow { centre_mm, texel_mm }, ((REACH_MM / texel_mm).ceil() as usize).min(1024))
            }
            None => (FieldWindow { centre_mm: [0.0; 2], texel_mm: texel_size(spec, w, h) }, 0),
        };
        let wide = w + 2 * margin;
        let grown = SyntheticLeaf::grow_in(spec, options.model, (wide, h + 2 * margin), window);
        let Some(mut leaf) = grown.filter(|leaf| !leaf.front.sigma_a.is_empty()) else {
            return Ok(None);
        };
        let under: Vec<f64> = leaf.relief.iter().zip(&leaf.front.thickness).map(|(z, d)| f64::from(*d) - z).collect();
        let height = [leaf.relief.clone(), mirror(&under, wide)];
        let shape = optics::BladeMaps::from_heights(
            wide,
            leaf.height,
            leaf.texel_mm,
            leaf.mask.clone(),
            height.clone(),
            [Vec::new(), Vec::new()],
        );
        let back = shape.back.normal.iter().zip(leaf.mask_of(Side::Back));
        leaf.back.normal = back.map(|(n, m)| if m { n.map(|v| v as f32) } else { [0.0; 3] }).collect();
        let shown = shine(&leaf, &shape)?;
        let cut = |s: &SideAppearance| SideAppearance {
            albedo: crop(&s.albedo, wide, margin),
            highlight: crop(&s.highlight, wide, margin),
            transmittance: crop(&s.transmittance, wide, margin),
        };
        let leaf = leaf.cropped(margin);
        if !leaf.mask.contains(&true) {
            return Ok(None);
        }
        let height = [0, 1].map(|s: usize| crop(&height[s], wide, margin));
        Ok(Some(DomeLeaf { leaf, height, shown: [cut(&shown[0]), cut(&shown[1])], centre_mm: window.centre_mm }))
    }

    /// Place of a texel in the field (mm), for the front. Light and camera are equally uneven for the back.
    fn place(&self, k: usize) -> [f64; 2] {
        let (w, h) = (self.leaf.width, self.leaf.height);
        let p = texel_position(w, h, self.leaf.texel_mm, k % w, k / w);
        [p[0] + self.centre_mm[0], p[1] + self.centre_mm[1]]
    }
}

/// The light of both sides, front first.
fn shine(leaf: &SyntheticLeaf, shape: &optics::BladeMaps) -> Result<[SideAppearance; 2]> {
    let veil = Veil::new(leaf.lobe);
    let [front, back] = through(leaf, shape)?;
    let side = |side: &SyntheticSide, lit: Side, transmittance: Vec<[f32; 3]>| {
        let seen = visible(&shape.lit(lit));
        let mask = leaf.mask_of(lit);
        let mirrored =
            |k: usize| f64::from(side.rho_s[k][0]) * veil.at(f64::from(side.normal[k][2]), f64::from(side.m[k]));
        SideAppearance {
            albedo: side.rho_d.iter().zip(&seen).map(|(d, v)| d.map(|d| (f64::from(d) * v) as f32)).collect(),
            highlight: (0..mask.len()).map(|k| if mask[k] { mirrored(k) as f32 } else { 0.0 }).collect(),
            transmittance,
        }
    };
    Ok([side(&leaf.front, Side::Front, front), side(&leaf.back, Side::Back, back)])
}

/// Photographs and scans `spec` into `folder`; `capture.toml` comes last.
///
/// # Errors
/// [`Error::Write`] for what cannot be written, [`Error::Interrupted`] after Ctrl-C.
pub fn capture(spec: &LeafSpec, blade: &DomeLeaf, options: &Options, folder: &Path) -> Result<DomeManifest> {
    let leaf = &blade.leaf;
    let (device, size) = (&spec.device, (leaf.width, leaf.height));
    let sensor = Sensor { relative: options.noise, floor: device.noise_floor, full_scale: device.full_scale };
    let manifest = manifest_of(spec, blade, options);
    let sides = [Side::Front, Side::Back];
    let bar = TaskProgress::new("photographing sides", 2);
    let put = |path: PathBuf, light: &dyn Fn(usize) -> [f64; 3], sensor: Sensor, place: u64| {
        stop_if_asked(folder)?;
        let image = (0..manifest.texels()).map(|k| {
            let (gain, light) = (gain(spec, blade.place(k)), light(k));
            [0, 1, 2].map(|c| device.dark + gain[c] * light[c])
        });
        write_frame(&path, image.collect(), size, sensor, options.seed, [20, place, 0], None)
    };
    let dome = |k: usize| {
        let [x, y] = blade.place(k);
        1.0 - 0.03 * (x / spec.field_mm[0]).powi(2) + 0.02 * y / spec.field_mm[1]
    };
    let lamp = |k: usize| {
        let [x, y] = blade.place(k);
        BOX_LEVEL * (1.0 + 0.04 * x / spec.field_mm[0] - 0.03 * (y / spec.field_mm[1]).powi(2))
    };
    for (s, (name, shown)) in sides.into_iter().zip(&blade.shown).enumerate() {
        let mask = leaf.mask_of(name);
        // Beside the leaf the camera sees the back light, and under the dome it sees black cloth.
        let albedo = |k: usize| shown.albedo[k].map(|d| dome(k) * f64::from(d + shown.highlight[k]));
        let through = |k: usize| shown.transmittance[k].map(|t| lamp(k) * if mask[k] { f64::from(t) } else { 1.0 });
        put(DomePicture::Albedo.path(folder, name), &albedo, sensor, s as u64)?;
        put(DomePicture::Translucency.path(folder, name), &through, sensor, 2 + s as u64)?;
        let mut scan = ChannelMaps::new(size.0, size.1);
        scan.push("Y", scanned(&blade.height[s], &mask, leaf, options, s as u64));
        write_exr(&DomePicture::Height.path(folder, name), &scan, Packing::Raw)?;
        let truth = truth(blade, name, shown, s);
        write_exr(&mesophyll_capture::truth_path(folder, name), &truth, Packing::Zip)?;
        preview::write(folder, leaf, name)?;
        bar.advance(1);
    }
    let mean = sensor.averaging(SHOTS);
    put(white_path(folder), &|k| [dome(k); 3], mean, 4)?;
    put(empty_path(folder), &|k| [lamp(k); 3], mean, 5)?;
    put(folder.join("dark.exr"), &|_| [0.0; 3], mean, 6)?;
    let mut mask = ChannelMaps::new(size.0, size.1);
    mask.push("Y", leaf.mask.iter().map(|&m| f32::from(u8::from(m))).collect());
    write_exr(&folder.join("mask.exr"), &mask, Packing::Zip)?;
    let text = toml::to_string(&manifest).map_err(|e| Error::write(&folder.join("capture.toml"), e))?;
    atomic::write_bytes(&folder.join("capture.toml"), text.as_bytes())?;
    Ok(manifest)
}

/// The true maps of a side: those of the leaf, and what its photographs show of it.
pub fn truth(blade: &DomeLeaf, name: Side, shown: &SideAppearance, s: usize) -> ChannelMaps {
    let mask = blade.leaf.mask_of(name);
    let mut maps = blade.leaf.truth(name);
    for c in 0..3 {
        maps.push(format!("albedo.{}", RGB[c]), shown.albedo.iter().map(|v| v[c]).collect());
        maps.add(Quantity::Transmittance, c, shown.transmittance.iter().map(|v| v[c]).collect());
    }
    maps.add(Quantity::Highlight, 0, shown.highlight.clone());
    maps.add(
        Quantity::Height,
        0,
        blade.height[s].iter().zip(&mask).map(|(z, m)| if *m { *z as f32 } else { 0.0 }).collect(),
    );
    maps
}

/// A height scan: the surface and the scanner's noise, smoothed together, with the scan's own tilt and zero; NaN off
/// the leaf.
fn scanned(height: &[f64], mask: &[bool], leaf: &SyntheticLeaf, options: &Options, side: u64) -> Vec<f32> {
    let (w, h) = (leaf.width, leaf.height);
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
            let [x, y] = texel_position(w, h, leaf.texel_mm, k % w, k / w);
            if mask[k] { (surface[k] + zero + tilt[0] * x + tilt[1] * y) as f32 } else { f32::NAN }
        })
        .collect()
}

fn manifest_of(spec: &LeafSpec, blade: &DomeLeaf, options: &Options) -> DomeManifest {
    let leaf = &blade.leaf;
    let exact = options.noise == 0.0;
    let weight: Vec<f64> = leaf.mask.iter().map(|m| f64::from(u8::from(*m))).collect();
    let thickness: Vec<f64> = leaf.front.thickness.iter().map(|d| f64::from(*d)).collect();
    let met = smooth(&thickness, &weight, leaf.width, &SmoothingKernel::gaussian(0.25 * CONTACT_MM / leaf.texel_mm));
    let thickest = met.iter().zip(&leaf.mask).filter(|(_, m)| **m).fold(0.0, |a: f64, (d, _)| a.max(*d));
    let slip = if exact { 0.0 } else { CALIPER_MM * RandomStream::new(options.seed, &[23]).normal_pair()[0] };
    DomeManifest {
        schema: 1,
        kind: CaptureKind::Dome.field().unwrap_or_default().into(),
        name: spec.name.clone(),
        width: leaf.width,
        height: leaf.height,
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
