//! Synthesis of photographs under beams from a leaf specification. Lengths in mm.
//!
//! The leaf's maps are those of the other captures (normals, thickness, σ). The irradiance of a beam with
//! self-shadowing enters, spreads in the thin form with the transport equation's totals for a beam of that incidence,
//! and leaves. There are 20 thickness levels and kernels to 1e-9, more than a fit uses. Where σa varies over the leaf
//! (pigment leaves), there are levels in ln σa as well as in thickness. The leaf is index-matched: all light enters,
//! and all light that reaches the far side leaves. For a patch the leaf is grown wider than the picture, so that light
//! comes in over its border.

use crate::Result;
use crate::leaf::{FieldWindow, SyntheticLeaf, crop, texel_size};
use crate::preview;
use crate::scan::{finish, stop_if_asked};
use crate::sensor::Sensor;
use crate::spec::{InteriorModel, LeafSpec};
use mesophyll_base::image::ImageSize;
use mesophyll_base::random::RandomStream;
use mesophyll_capture::beams::manifest::{BeamPhotograph, BeamsManifest};
use mesophyll_capture::kind::CaptureKind;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::progress::TaskProgress;
use mesophyll_optics::dipole::Tissue;
use mesophyll_optics::side::{Side, mirror};
use mesophyll_optics::slab::medium::SlabMedium;
use mesophyll_optics::translucency::blade::{LitSide, SurfaceMaps};
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver, TotalsSource};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance};
use mesophyll_optics::translucency::levels::{LevelKind, ThicknessLevels};
use mesophyll_optics::translucency::relief;
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::Path;

/// How a specification is photographed.
#[derive(Debug, Clone)]
pub struct Options {
    /// Columns of every photograph.
    pub width: usize,
    /// Rows of every photograph.
    pub height: usize,
    /// Width (mm) and centre (mm from the field's centre) of the part that is captured; the whole field when absent.
    pub patch: Option<(f64, [f64; 2])>,
    /// The lights, and the file of each photograph.
    pub beams: Vec<BeamPhotograph>,
    /// Relative noise; 0 writes exact values.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Whether σa varies over the leaf.
    pub model: InteriorModel,
}

/// Number of thickness levels, and of levels of ln σa where it varies.
const LEVELS: usize = 20;
const PIGMENTS: usize = 6;
/// Light from more than this many mean thicknesses outside of a patch is left out.
const AROUND: f64 = 8.0;
/// A facet counts for at most the area of this many texels.
const STEEPEST: f64 = 5.0;

/// One beam along each side's normal, and three slanting ones on the front.
pub fn usual_beams() -> Vec<BeamPhotograph> {
    let beams = [
        (Side::Front, 90.0, 0.0),
        (Side::Front, 50.0, 20.0),
        (Side::Front, 50.0, 140.0),
        (Side::Front, 50.0, 260.0),
        (Side::Back, 90.0, 0.0),
    ];
    named(
        beams
            .map(|(lit, elevation_deg, azimuth_deg)| BeamPhotograph {
                file: String::new(),
                lit,
                elevation_deg,
                azimuth_deg,
            })
            .to_vec(),
    )
}

/// Gives the beams their file names, such as `photographs/01_front_90_0.exr`.
pub fn named(mut beams: Vec<BeamPhotograph>) -> Vec<BeamPhotograph> {
    for (k, b) in beams.iter_mut().enumerate() {
        b.file = format!("photographs/{:02}_{}_{}_{}.exr", k + 1, b.lit.name(), b.elevation_deg, b.azimuth_deg);
    }
    beams
}

/// A leaf that is wider than the picture by `around` texels on every side.
#[derive(Debug, Clone)]
pub struct WideLeaf {
    /// The leaf with all its maps.
    pub leaf: SyntheticLeaf,
    /// Texels beyond the picture's border, on every side.
    pub around: usize,
}

/// Grows the leaf; `None` where not one texel of the picture lies on it, or where the leaf is not a slab.
pub fn grow(spec: &LeafSpec, options: &Options) -> Option<WideLeaf> {
    let size = ImageSize::new(options.width, options.height);
    let (window, around) = match options.patch {
        Some((wide_mm, centre_mm)) => {
            let texel_mm = wide_mm / size.width as f64;
            (FieldWindow { centre_mm, texel_mm }, (AROUND * spec.thickness_mm / texel_mm).ceil() as usize)
        }
        None => (FieldWindow { centre_mm: [0.0; 2], texel_mm: texel_size(spec, size) }, 0),
    };
    let grown = ImageSize::new(size.width + 2 * around, size.height + 2 * around);
    let leaf = SyntheticLeaf::grow_in(spec, options.model, grown, window)?;
    let grown = WideLeaf { leaf, around };
    if grown.leaf.model == InteriorModel::Foliar {
        return None;
    }
    grown.crop(&grown.leaf.mask).contains(&true).then_some(grown)
}

impl WideLeaf {
    /// The picture's part of a map.
    pub fn crop<T: Copy>(&self, map: &[T]) -> Vec<T> {
        crop(map, self.leaf.size.width, self.around)
    }

    /// Exact values of a photograph, in the lit side's columns, a channel each.
    ///
    /// # Errors
    /// A tissue that no kernel can be made of.
    pub fn shown(&self, beam: &BeamPhotograph) -> Result<[Vec<f64>; 3]> {
        let leaf = &self.leaf;
        let (side, mask) = (&leaf.sides[beam.lit], leaf.mask_of(beam.lit));
        let ImageSize { width: w, height: h } = leaf.size;
        let on = || side.iter().zip(&mask);
        let normal: Vec<[f64; 3]> =
            on().map(|(t, m)| if *m { t.normal.map(f64::from) } else { [0.0, 0.0, 1.0] }).collect();
        let height = relief::integrate(&normal, &mask, w, h, leaf.texel_mm).height;
        let thickness: Vec<f64> = on().map(|(t, m)| if *m { f64::from(t.thickness) } else { 0.0 }).collect();
        // A slope has more area than its texel, so it receives n·ω/n_z.
        let entry = normal.iter().map(|n| (1.0 / n[2]).min(STEEPEST)).collect();
        let surface = SurfaceMaps { height, normal, entry };
        let lit = LitSide {
            side: beam.lit,
            width: w,
            height: h,
            texel_mm: leaf.texel_mm,
            mask: Cow::from(&mask),
            thickness: Cow::from(&thickness),
            surface: &surface,
        };
        let light = irradiance(&lit, &Horizon::new(&lit), beam.direction(), Visibility::Hard);
        let mut out: [Vec<f64>; 3] = Default::default();
        for (c, out) in out.iter_mut().enumerate() {
            let sigma_a: Vec<f64> = side.iter().map(|t| f64::from(t.sigma_a[c])).collect();
            let reduced = on().find(|(_, m)| **m).map_or(0.0, |(t, _)| f64::from(t.sigma_s[c]));
            *out = self.crop(&through(
                &light,
                &thickness,
                &sigma_a,
                reduced,
                beam.direction()[2].min(1.0),
                w,
                leaf.texel_mm,
            )?);
        }
        Ok(out)
    }
}

/// The share of a beam at cosine `mu` to the normal that comes through a slab of `d` mm, divided by that of a beam
/// along the normal.
pub fn slanting(tissue: &Tissue, d: f64, mu: f64) -> f64 {
    slanting_in(&medium(tissue), tissue, d, mu)
}

fn medium(tissue: &Tissue) -> SlabMedium {
    let (a, s) = (tissue.sigma_a, tissue.reduced_scattering());
    SlabMedium::new(s / (a + s), a / (a + s))
}

fn slanting_in(medium: &SlabMedium, tissue: &Tissue, d: f64, mu: f64) -> f64 {
    if !(d > 0.0 && mu < 1.0) {
        return 1.0;
    }
    let ln = |mu: f64| medium.solve_log(mu, (tissue.sigma_a + tissue.reduced_scattering()) * d).1;
    (ln(mu) - ln(1.0)).exp()
}

/// [`slanting`] for many thicknesses: a table over ln d, cubic between its points.
fn slants(tissue: &Tissue, range: [f64; 2], mu: f64) -> impl Fn(f64) -> f64 + use<> {
    const POINTS: usize = 64;
    let (low, step) = (range[0].ln() - 1e-9, ((range[1] / range[0]).ln() + 2e-9) / (POINTS - 1) as f64);
    let medium = medium(tissue);
    let at = |k: usize| slanting_in(&medium, tissue, (low + step * k as f64).exp(), mu);
    let values: Vec<f64> = (0..POINTS).into_par_iter().map(at).collect();
    move |d: f64| {
        let at = ((d.ln() - low) / step).clamp(0.0, (POINTS - 1) as f64);
        let first = (at as usize).saturating_sub(1).min(POINTS - 4);
        let u = at - first as f64;
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| values[first + k]);
        -a * (u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0 + b * u * (u - 2.0) * (u - 3.0) / 2.0
            - c * u * (u - 1.0) * (u - 3.0) / 2.0
            + d * u * (u - 1.0) * (u - 2.0) / 6.0
    }
}

/// The light that comes through where σa varies; the sources are split by levels of ln σa.
fn through(
    light: &[f64],
    thickness: &[f64],
    sigma_a: &[f64],
    reduced: f64,
    mu: f64,
    width: usize,
    texel_mm: f64,
) -> Result<Vec<f64>> {
    let on = || sigma_a.iter().zip(thickness).filter(|(_, d)| **d > 0.0).map(|(s, _)| *s);
    let [low, high] = on().fold([f64::INFINITY, 0.0], |[a, b]: [f64; 2], s| [a.min(s), b.max(s)]);
    let varies = low > 0.0 && high > low * (1.0 + 1e-9);
    let (middle, half) = (0.5 * (low.ln() + high.ln()), 0.5 * (high.ln() - low.ln()));
    let nodes: Vec<f64> = if varies {
        (0..PIGMENTS).map(|k| (middle + half * mesophyll_base::chebyshev::node(k, PIGMENTS)).exp()).collect()
    } else {
        vec![high]
    };
    let thick =
        thickness.iter().filter(|d| **d > 0.0).fold([f64::INFINITY, 0.0], |[a, b]: [f64; 2], d| [a.min(*d), b.max(*d)]);
    let mut sum = vec![0.0; light.len()];
    if !(reduced > 0.0 || high > 0.0) || thick[1] == 0.0 {
        return Ok(sum);
    }
    for (k, &node) in nodes.iter().enumerate() {
        // Lagrange's weight of this node for the σa of each texel.
        let weight = |s: f64| match varies {
            true => (0..PIGMENTS).filter(|j| *j != k).map(|j| (s / nodes[j]).ln() / (node / nodes[j]).ln()).product(),
            false => 1.0,
        };
        let tissue = Tissue { sigma_a: node, sigma_s: reduced, g: 0.0, a: 1.0 };
        let slant = slants(&tissue, thick, mu);
        let lit = |k: usize| {
            if light[k] > 0.0 && thickness[k] > 0.0 { light[k] * weight(sigma_a[k]) * slant(thickness[k]) } else { 0.0 }
        };
        let part: Vec<f64> = (0..light.len()).map(lit).collect();
        let levels = ThicknessLevels { count: LEVELS, kind: LevelKind::Chebyshev };
        let settings = ConvolutionSettings {
            levels,
            totals: TotalsSource::Transport,
            tail: 1e-9,
            ..ConvolutionSettings::new(tissue, texel_mm)
        };
        let Some(convolver) = Convolver::for_map(&settings, width, thickness)? else { continue };
        sum.iter_mut().zip(&convolver.run(thickness, &[part])[0]).for_each(|(s, v)| *s += v);
    }
    Ok(sum)
}

/// Writes photographs of `grown` into `folder`; `capture.toml` is written last.
///
/// # Errors
/// [`Error::Write`] for what cannot be written, [`Error::Interrupted`] after Ctrl-C.
pub fn capture(spec: &LeafSpec, grown: &WideLeaf, options: &Options, folder: &Path) -> Result<BeamsManifest> {
    let (w, h) = (options.width, options.height);
    let floor = if options.noise > 0.0 { spec.device.noise_floor } else { 0.0 };
    let sensor = Sensor { relative: options.noise, floor, full_scale: spec.device.full_scale };
    let bar = TaskProgress::new("photographing", options.beams.len() as u64);
    for (k, beam) in options.beams.iter().enumerate() {
        stop_if_asked(folder)?;
        let mut shown = grown.shown(beam)?;
        for (c, channel) in shown.iter_mut().enumerate() {
            sensor.disturb(channel, RandomStream::new(options.seed, &[31, k as u64, c as u64]));
        }
        // As the unlit side's camera sees it; off the leaf there are no readings.
        let mask = grown.crop(&grown.leaf.mask_of(beam.lit));
        let mut maps = ChannelMaps::new(w, h);
        for (channel, name) in shown.iter().zip(mesophyll_files::quantity::RGB) {
            let seen: Vec<f32> =
                channel.iter().zip(&mask).map(|(v, m)| if *m { *v as f32 } else { f32::NAN }).collect();
            maps.push(name, mirror(&seen, w));
        }
        write_exr(&folder.join(&beam.file), &maps, Packing::Raw)?;
        bar.advance(1);
    }
    for side in Side::ALL {
        let all = grown.leaf.truth(side);
        let mut truth = ChannelMaps::new(w, h);
        for (channel, values) in &all.channels {
            truth.push(channel, grown.crop(values));
        }
        write_exr(&mesophyll_capture::truth_path(folder, side), &truth, Packing::Zip)?;
        preview::write(folder, &grown.leaf, side)?;
    }
    let manifest = BeamsManifest {
        schema: 1,
        kind: CaptureKind::Beams.field().unwrap_or_default().into(),
        name: spec.name.clone(),
        width: w,
        height: h,
        texel_mm: grown.leaf.texel_mm,
        noise_relative: Some(options.noise),
        noise_floor: Some(floor),
        beams: options.beams.clone(),
    };
    finish(folder, manifest)
}
