//! Synthesis of photographs of a leaf from a specification: both sides on a black sheet in open shade, with a grey card
//! and a ruler, and the leaf on a light table. The leaf is the blade that a dome would photograph
//! ([`crate::dome`]), with light that travels sideways through it and slopes that see less of the
//! sky.
//!
//! The plane of the sheet is measured in pixels of the front's picture, so that the truth has its texels. The camera is
//! moved for every other picture: turned, shifted and raised. What a capture states (card, sheet, table, thickness,
//! marks) differs from the truth by errors of the stated size.

mod leaf_light;

use crate::Result;
use crate::dome::{DomeLeaf, index_of, truth};
use crate::preview;
use crate::scan::{finish, stop_if_asked};
use crate::spec::{InteriorModel, LeafSpec};
use leaf_light::{both_round, on_table, shaded};
use mesophyll_base::image::{Image, ImageSize};
use mesophyll_base::random::RandomStream;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::kind::CaptureKind;
use mesophyll_capture::photo::manifest::{
    GlossStatement, LightTable, PhotoManifest, ReflectanceStatement, Ruler, ShadePhotograph, TransferCurve,
};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_optics::side::{Side, Sides};
use rayon::prelude::*;
use std::path::Path;

/// How a specification is photographed.
#[derive(Debug, Clone)]
pub struct Options {
    /// Columns of every picture.
    pub width: usize,
    /// Rows of every picture.
    pub height: usize,
    /// Noise of a reading at full scale, relative to it; 0 writes exact values, and states exact ones.
    pub noise: f64,
    /// Seed of noise and of errors.
    pub seed: u64,
    /// Whether σa varies over the leaf.
    pub model: InteriorModel,
}

/// Share of the picture's height that is the leaf's.
const FIELD: f64 = 0.76;
/// Card and ruler, as shares of width and height: left, top, right, bottom.
const CARD: [f64; 4] = [0.06, 0.81, 0.22, 0.95];
const RULER: [f64; 4] = [0.3, 0.84, 0.94, 0.93];
/// Place of the ruler's zero.
const ZERO: f64 = 0.33;
/// Distance and width of the ruler's ticks (mm).
const TICK_MM: [f64; 2] = [1.0, 0.25];
/// Reflectances of the ruler and of its ticks.
const PAPER: [f64; 2] = [0.75, 0.08];
/// What is stated, and its standard error.
const CARD_REFLECTANCE: [f64; 2] = [0.18, 0.002];
const SHEET: [f64; 2] = [0.04, 0.006];
const TABLE: [f64; 2] = [0.35, 0.05];
const CALIPER_MM: f64 = 0.003;
/// Width of the smoothing of the light that a leaf throws back onto the table (mm, standard deviation).
const SPREAD_MM: f64 = 1.5;
/// The table's brightness in the pictures with the leaf, over that in the bare picture.
const DRIFT: [f64; 2] = [0.97, 1.02];
/// Levels of the camera's converter.
const LEVELS: f64 = 16_383.0;

/// Grows the leaf in the upper part of the pictures; `None` when not one pixel lies on it.
///
/// # Errors
/// Those of the spreading of light in the leaf.
pub fn grow(spec: &LeafSpec, options: &Options) -> Result<Option<DomeLeaf>> {
    let (w, h) = (options.width as f64, options.height as f64);
    let pixel_mm = (spec.field_mm[0] / w).max(spec.field_mm[1] / (FIELD * h));
    let down = 0.5 * (1.0 - FIELD) * h * pixel_mm;
    let options = crate::dome::Options {
        width: options.width,
        height: options.height,
        patch: Some((w * pixel_mm, [0.0, -down])),
        noise: options.noise,
        height_noise_mm: 0.0,
        seed: options.seed,
        model: options.model,
    };
    DomeLeaf::grow(spec, &options)
}

/// Where the camera of a picture sees a place of the sheet: turned and scaled about the middle, then shifted (pixels).
#[derive(Debug, Clone, Copy)]
struct Pose {
    middle: [f64; 2],
    turn: [f64; 2],
    shift: [f64; 2],
}

impl Pose {
    fn moved(options: &Options, place: u64) -> Pose {
        let middle = [0.5 * options.width as f64, 0.5 * options.height as f64];
        if place == 0 {
            return Pose { middle, turn: [1.0, 0.0], shift: [0.0; 2] };
        }
        let mut stream = RandomStream::new(options.seed, &[31, place]);
        let (sin, cos) = (4.0 * stream.signed()).to_radians().sin_cos();
        let size = 0.955 + 0.025 * stream.signed();
        let shift = [0.012 * middle[0] * stream.signed(), 0.012 * middle[1] * stream.signed()];
        Pose { middle, turn: [size * cos, size * sin], shift }
    }

    /// The picture's place of a place of the sheet.
    fn seen(&self, p: [f64; 2]) -> [f64; 2] {
        let ([x, y], [a, b]) = ([p[0] - self.middle[0], p[1] - self.middle[1]], self.turn);
        [a * x - b * y + self.middle[0] + self.shift[0], b * x + a * y + self.middle[1] + self.shift[1]]
    }

    /// The sheet's place of a place of the picture.
    fn sheet(&self, p: [f64; 2]) -> [f64; 2] {
        let ([a, b], d) = (self.turn, self.turn[0].powi(2) + self.turn[1].powi(2));
        let [x, y] = [0, 1].map(|k| p[k] - self.middle[k] - self.shift[k]);
        [(a * x + b * y) / d + self.middle[0], (a * y - b * x) / d + self.middle[1]]
    }
}

/// What a picture shows of the leaf, pixel by pixel of the sheet: its light, 0 off the leaf, and whether it is there.
struct Plate {
    pixels: Image<(Rgb, f64)>,
}

impl Plate {
    /// Light and cover at a place of the sheet, weighted linearly between pixels.
    fn at(&self, [x, y]: [f64; 2]) -> (Rgb, f64) {
        let (x, y) = (x - 0.5, y - 0.5);
        let ImageSize { width, height } = self.pixels.size;
        let (mut light, mut cover) = (Rgb::splat(0.0), 0.0);
        if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
            return (light, cover);
        }
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f64, y - j as f64);
        for (k, w) in [(0, (1.0 - u) * (1.0 - v)), (1, u * (1.0 - v)), (width, (1.0 - u) * v), (width + 1, u * v)] {
            let (lit, on) = self.pixels[j * width + i + k];
            light += w * lit;
            cover += w * on;
        }
        (light, cover)
    }
}

/// Photographs `blade` into `folder`; `capture.toml` comes last.
///
/// # Errors
/// [`Error::Write`] for what cannot be written, [`Error::Interrupted`] after Ctrl-C.
pub fn capture(spec: &LeafSpec, blade: &DomeLeaf, options: &Options, folder: &Path) -> Result<PhotoManifest> {
    let leaf = &blade.leaf;
    let ImageSize { width: w, height: h } = leaf.size;
    let mut stream = RandomStream::new(options.seed, &[30]);
    // A true value that differs from the stated one by its standard error times a normal deviate.
    let mut true_value = |[stated, err]: [f64; 2]| {
        let deviate = stream.normal_pair()[0];
        if options.noise == 0.0 { stated } else { stated + err * deviate }
    };
    let (card, sheet, table) = (true_value(CARD_REFLECTANCE), true_value(SHEET), true_value(TABLE));
    let caliper = true_value([spec.thickness_mm, CALIPER_MM]);
    let slips = [0, 1, 2, 3].map(|_| true_value([0.0, 1.0]));
    let plates = |light: Sides<Vec<Rgb>>| {
        Sides::of(|side| {
            let cover = leaf.mask_of(side).into_iter().map(|on| f64::from(u8::from(on)));
            let pixels = light[side].iter().zip(cover).map(|(v, on)| (*v * on, on)).collect();
            Plate { pixels: Image { size: leaf.size, pixels } }
        })
    };
    let round = both_round(leaf);
    let (shade, through) = (plates(shaded(blade, &round, sheet)), plates(on_table(blade, &round, table, SPREAD_MM)));

    let poses = [0, 1, 2, 4].map(|place| Pose::moved(options, place));
    let pixel_mm = leaf.texel_mm;
    let length_mm = (0.55 * w as f64 * pixel_mm / 10.0).floor().max(1.0) * 10.0;
    let still = |p: [f64; 2]| sheet_with_things(p, [w, h], pixel_mm, card, sheet);
    let put = |name: &str, place: u64, value: &(dyn Fn([f64; 2]) -> Rgb + Sync)| {
        stop_if_asked(folder)?;
        photograph(&folder.join(name), spec, options, [w, h], place, value)
    };
    for ((side, shade), pose) in shade.iter().zip(&poses) {
        put(&format!("{side}.exr"), side as u64, &|p| {
            let q = pose.sheet(p);
            let ((leaf, on), light) = (shade.at(q), sky(q, [w, h]));
            light * (leaf + (1.0 - on) * still(q))
        })?;
    }
    for ((side, through), (name, place)) in through.iter().zip([("table_leaf.exr", 2), ("table_turned.exr", 4)]) {
        let s = side as usize;
        put(name, place, &|p| {
            let (leaf, on) = through.at(poses[2 + s].sheet(p));
            leaf.map(|l| DRIFT[s] * lamp(p, [w, h]) * (l + 1.0 - on))
        })?;
    }
    put("table_bare.exr", 3, &|p| Rgb::splat(lamp(p, [w, h])))?;
    for side in Side::ALL {
        write_exr(&mesophyll_capture::truth_path(folder, side), &truth(blade, side), Packing::Zip)?;
        preview::write(folder, leaf, side)?;
    }
    let card_of = |pose: &Pose| {
        let [left, top, right, bottom] = CARD;
        let middle = pose.seen([0.5 * (left + right) * w as f64, 0.5 * (top + bottom) * h as f64]);
        let half = [0.3 * (right - left) * w as f64, 0.3 * (bottom - top) * h as f64];
        let [x, y] = [0, 1].map(|k| (middle[k] - half[k]).round().max(0.0) as usize);
        [x, y, (2.0 * half[0]) as usize, (2.0 * half[1]) as usize]
    };
    let row = 0.5 * (RULER[1] + RULER[3]) * h as f64;
    let marks = [0.0, length_mm].map(|mm| [ZERO * w as f64 + mm / pixel_mm, row]);
    let exact = options.noise == 0.0;
    let err = |err: f64| if exact { 0.0 } else { err };
    let manifest = PhotoManifest {
        schema: 1,
        kind: CaptureKind::Photo.field().unwrap_or_default().into(),
        name: spec.name.clone(),
        thickness_mm: Some((1e6 * caliper).round() / 1e6),
        thickness_err_mm: Some(err(CALIPER_MM)),
        thickness_range_mm: None,
        transfer: TransferCurve::Linear,
        full_scale: Some(1.0),
        noise_photon: Some(options.noise * options.noise),
        noise_read: Some(err(spec.device.noise_floor)),
        texel_mm: None,
        card: ReflectanceStatement { reflectance: CARD_REFLECTANCE[0], reflectance_err: err(CARD_REFLECTANCE[1]) },
        background: ReflectanceStatement { reflectance: SHEET[0], reflectance_err: err(SHEET[1]) },
        ruler: Ruler {
            marks_px: [
                [marks[0][0] + slips[0], marks[0][1] + slips[1]],
                [marks[1][0] + slips[2], marks[1][1] + slips[3]],
            ],
            length_mm,
            tick_mm: Some(TICK_MM[0]),
            err_px: 1.0,
        },
        front: ShadePhotograph { file: "front.exr".into(), card: card_of(&poses[0]) },
        back: ShadePhotograph { file: "back.exr".into(), card: card_of(&poses[1]) },
        light_table: LightTable {
            leaf: "table_leaf.exr".into(),
            turned: Some("table_turned.exr".into()),
            bare: "table_bare.exr".into(),
            up: Side::Front,
            reflectance: TABLE[0],
            reflectance_err: err(TABLE[1]),
        },
        gloss: Some(GlossStatement { index: index_of(spec), index_err: 0.05, slope: [spec.front.m, spec.back.m] }),
    };
    finish(folder, manifest)
}

/// Reflectance of the sheet, and of the card and the ruler on it, at a place of the sheet.
fn sheet_with_things(p: [f64; 2], size: [usize; 2], pixel_mm: f64, card: f64, sheet: f64) -> f64 {
    let [x, y] = [p[0] / size[0] as f64, p[1] / size[1] as f64];
    let within = |[left, top, right, bottom]: [f64; 4]| x >= left && x < right && y >= top && y < bottom;
    if within(CARD) {
        return card;
    }
    if !within(RULER) {
        return sheet;
    }
    // The share of a pixel's width that is tick.
    let [distance, width] = TICK_MM;
    let inked = |mm: f64| {
        let ticks = (mm / distance + 0.5).floor();
        let over = (mm - ticks * distance + 0.5 * width).clamp(0.0, width);
        ticks * width + over
    };
    let mm = (p[0] - ZERO * size[0] as f64) * pixel_mm;
    let ink = (inked(mm + 0.5 * pixel_mm) - inked(mm - 0.5 * pixel_mm)) / pixel_mm;
    PAPER[0] + ink * (PAPER[1] - PAPER[0])
}

/// The light of open shade over the sheet: brighter on the side of the open sky.
fn sky([x, y]: [f64; 2], size: [usize; 2]) -> f64 {
    let [x, y] = [2.0 * x / size[0] as f64 - 1.0, 2.0 * y / size[1] as f64 - 1.0];
    0.9 * (1.0 + 0.10 * x - 0.06 * y - 0.04 * x * x - 0.03 * y * y)
}

/// The light of the table over its picture.
fn lamp([x, y]: [f64; 2], size: [usize; 2]) -> f64 {
    let [x, y] = [2.0 * x / size[0] as f64 - 1.0, 2.0 * y / size[1] as f64 - 1.0];
    0.85 * (1.0 + 0.03 * x - 0.08 * (x * x + y * y))
}

/// One exposure: sensitivities, vignetting, photon and read noise, clipping at 1, and the converter's levels.
fn photograph(
    path: &Path,
    spec: &LeafSpec,
    options: &Options,
    [w, h]: [usize; 2],
    place: u64,
    value: &(dyn Fn([f64; 2]) -> Rgb + Sync),
) -> Result<()> {
    let (gain, read) = (spec.device.gain, spec.device.noise_floor);
    let rows: Vec<Vec<Rgb<f32>>> = (0..h)
        .into_par_iter()
        .map(|j| {
            let mut stream = RandomStream::new(options.seed, &[32, place, j as u64]);
            (0..w)
                .map(|i| {
                    let p = [i as f64 + 0.5, j as f64 + 0.5];
                    let [x, y] = [p[0] / w as f64 - 0.5, p[1] / h as f64 - 0.5];
                    let vignette = 1.0 - 2.0 * spec.device.vignette * (x * x + y * y);
                    let light = value(p);
                    Rgb::of(|c| {
                        let v = gain[c] * vignette * light[c];
                        if options.noise == 0.0 {
                            return v.min(1.0) as f32;
                        }
                        let sd = (options.noise.powi(2) * v.max(0.0) + read * read).sqrt();
                        let v = v + sd * stream.normal_pair()[0];
                        ((v.min(1.0) * LEVELS).round() / LEVELS) as f32
                    })
                })
                .collect()
        })
        .collect();
    let mut maps = ChannelMaps::new(w, h);
    maps.push_rgb(&rows.concat());
    write_exr(path, &maps, Packing::Zip)
}
