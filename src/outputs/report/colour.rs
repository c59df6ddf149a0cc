//! False colour: a sequential and a diverging scale with evenly perceived steps, computed in OKLab (Ottosson 2020), and
//! pictures as indexed PNG inside data URIs.

use crate::model::{PictureTexels, ReportPicture, ScaleBar};
use crate::values::{self, MapValues};
use plotters::style::RGBColor;
use std::sync::OnceLock;

/// Colours that readers with any kind of colour vision can tell apart (Okabe and Ito, "Color universal design", 2008).
pub const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(60, 60, 60),
    RGBColor(150, 150, 150),
];

/// 255 colours of a scale.
pub type ColourScale = [[u8; 3]; 255];
/// Colours of the coarse picture that stands for a map until the page's script draws its values. Few colours keep it
/// small.
const COARSE: usize = 32;

/// Dark violet over teal to yellow. Lightness rises evenly, so the scale also works in grey and for colour-blind eyes.
pub(crate) fn sequential() -> &'static ColourScale {
    static SCALE: OnceLock<ColourScale> = OnceLock::new();
    SCALE.get_or_init(|| std::array::from_fn(|k| sequential_at(k as f64 / 254.0)))
}

/// Blue over light grey to red; the middle is zero.
pub(crate) fn diverging() -> &'static ColourScale {
    static SCALE: OnceLock<ColourScale> = OnceLock::new();
    SCALE.get_or_init(|| {
        std::array::from_fn(|k| {
            let t = k as f64 / 127.0 - 1.0;
            let hue: f64 = if t < 0.0 { 250.0 } else { 35.0 };
            in_gamut(0.95 - 0.5 * t.abs(), 0.19 * t.abs(), hue.to_radians())
        })
    })
}

/// Nine evenly spaced steps of the magma scale (Smith and van der Walt 2015), in which FLIP maps are drawn.
pub(crate) const MAGMA: [&str; 9] =
    ["#000004", "#1d1147", "#51127c", "#832681", "#b73779", "#e55064", "#fb8761", "#fec287", "#fcfdbf"];

/// Lightness .24 → .92; hue 300° → 108°; the chroma dips in the teal, where sRGB holds less.
fn sequential_at(t: f64) -> [u8; 3] {
    let hue = 300.0 - 192.0 * t;
    let chroma = 0.115 + 0.065 * (2.0 * t - 1.0).powi(2);
    in_gamut(0.24 + 0.68 * t, chroma, hue.to_radians())
}

/// OKLCH → 8-bit sRGB; chroma is reduced until sRGB has the colour.
fn in_gamut(lightness: f64, chroma: f64, hue: f64) -> [u8; 3] {
    let mut c = chroma;
    loop {
        let rgb = oklab_to_linear(lightness, c * hue.cos(), c * hue.sin());
        if c < 1e-4 || rgb.iter().all(|v| (-1e-4..=1.0001).contains(v)) {
            return rgb.map(|v| mesophyll_files::image::to_srgb8(v as f32));
        }
        c *= 0.98;
    }
}

/// Ottosson's OKLab → linear sRGB.
fn oklab_to_linear(l: f64, a: f64, b: f64) -> [f64; 3] {
    let (l_, m_, s_) = (
        (l + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3),
        (l - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3),
        (l - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3),
    );
    [
        4.076_741_662_1 * l_ - 3.307_711_591_3 * m_ + 0.230_969_929_2 * s_,
        -1.268_438_004_6 * l_ + 2.609_757_401_1 * m_ - 0.341_319_396_5 * s_,
        -0.004_196_086_3 * l_ - 0.703_418_614_7 * m_ + 1.707_614_701_0 * s_,
    ]
}

/// Which samples of a map to show, and how large.
#[derive(Debug, Clone, Copy)]
pub struct MapFrame {
    pub width: usize,
    pub height: usize,
    /// Largest width of the picture; larger maps are averaged over squares of texels.
    pub max_width: usize,
    /// Texels that are averaged along each direction even where the map is not too wide.
    pub least_step: usize,
    /// Edge of a texel in mm, where it is known: the picture then has a scale.
    pub texel_mm: Option<f64>,
    /// Which values are kept beside the picture: every so-manyth texel and row, and their significant digits.
    pub kept: (usize, u32),
}

impl MapFrame {
    /// Texels averaged into a pixel, along each direction.
    pub fn step(&self) -> usize {
        self.width.div_ceil(self.max_width.max(1)).max(self.least_step).max(1)
    }

    fn size(&self) -> (usize, usize) {
        (self.width.div_ceil(self.step()), self.height.div_ceil(self.step()))
    }

    fn texels(&self) -> PictureTexels {
        let scale = self.texel_mm.and_then(|mm| ScaleBar::of(self.width as f64 * mm));
        PictureTexels { columns: self.width, rows: self.height, step: self.step(), scale }
    }
}

/// A map in false colour over [min, max], with its values in `unit`; samples without a value are transparent. `signed`
/// takes the diverging scale.
pub(crate) fn false_colour(
    frame: MapFrame,
    signed: bool,
    (min, max): (f64, f64),
    unit: &str,
    value: impl Fn(usize) -> f32,
    alt: String,
) -> Option<ReportPicture> {
    let (w, h) = frame.size();
    let mut indices = vec![0; w * h];
    for (y, row) in indices.chunks_exact_mut(w.max(1)).enumerate() {
        for (x, out) in row.iter_mut().enumerate() {
            if let Some(v) = averaged(frame, x, y, &value) {
                let most = (COARSE - 1) as f64;
                *out = 1 + ((v - min) / (max - min) * most).round().clamp(0.0, most) as u8;
            }
        }
    }
    let scale = if signed { diverging() } else { sequential() };
    let values = values::pack((frame.width, frame.height), frame.kept, unit, value);
    let values = values.map(|v| MapValues { range: [min, max], signed, ..v });
    let palette: [[u8; 3]; COARSE] = std::array::from_fn(|k| scale[k * 254 / (COARSE - 1)]);
    Some(ReportPicture { values, ..indexed_png((w, h), frame.texels(), &indices, &palette, alt)? })
}

/// Categories: `code(i)` is an index into `colours`, `None` is transparent. Categories are never averaged: a pixel
/// shows the largest category of its texels, so that a single defect stays visible.
pub(crate) fn categories(
    frame: MapFrame,
    colours: &[[u8; 3]],
    code: impl Fn(usize) -> Option<usize>,
    alt: String,
) -> Option<ReportPicture> {
    let (w, h) = frame.size();
    let step = frame.step();
    let mut indices = vec![0; w * h];
    for y in 0..h {
        for x in 0..w {
            let mut found = None;
            for j in y * step..((y + 1) * step).min(frame.height) {
                for i in x * step..((x + 1) * step).min(frame.width) {
                    found = found.max(code(j * frame.width + i));
                }
            }
            if let Some(k) = found {
                indices[y * w + x] = 1 + k.min(254) as u8;
            }
        }
    }
    indexed_png((w, h), frame.texels(), &indices, colours, alt)
}

fn averaged(frame: MapFrame, x: usize, y: usize, value: &impl Fn(usize) -> f32) -> Option<f64> {
    let step = frame.step();
    let (mut sum, mut n) = (0.0, 0usize);
    for j in y * step..((y + 1) * step).min(frame.height) {
        for i in x * step..((x + 1) * step).min(frame.width) {
            let v = value(j * frame.width + i);
            if v.is_finite() {
                sum += f64::from(v);
                n += 1;
            }
        }
    }
    (n > 0).then(|| sum / n as f64)
}

/// Linear RGB as it would look (in sRGB), transparent where `shown` is false.
pub fn photograph(
    frame: MapFrame,
    rgb: [&[f32]; 3],
    gain: f32,
    shown: impl Fn(usize) -> bool,
    alt: String,
) -> Option<ReportPicture> {
    let (w, h) = frame.size();
    let mut pixels = Vec::with_capacity(w * h * 4);
    for y in 0..h {
        for x in 0..w {
            let mut pixel = [0u8; 4];
            for (c, plane) in rgb.iter().enumerate() {
                let value = |i: usize| if shown(i) { plane[i] } else { f32::NAN };
                if let Some(v) = averaged(frame, x, y, &value) {
                    pixel[c] = mesophyll_files::image::to_srgb8(v as f32 * gain);
                    pixel[3] = 255;
                }
            }
            pixels.extend_from_slice(&pixel);
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, w as u32, h as u32);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_compression(png::Compression::Balanced);
    encoder.write_header().ok()?.write_image_data(&pixels).ok()?;
    let uri = data_uri("image/png", &bytes);
    Some(ReportPicture { uri, width: w, height: h, alt, texels: frame.texels(), values: None })
}

/// Indexed PNG as a data URI. Index 0 is transparent, the palette holds the colours from 1 on. `None` when there is
/// nothing to show.
fn indexed_png(
    (width, height): (usize, usize),
    texels: PictureTexels,
    indices: &[u8],
    palette: &[[u8; 3]],
    alt: String,
) -> Option<ReportPicture> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette([&[[0; 3]], palette].concat().into_flattened());
    encoder.set_trns(vec![0]);
    encoder.set_compression(png::Compression::Balanced);
    encoder.set_filter(png::Filter::NoFilter);
    encoder.write_header().ok()?.write_image_data(indices).ok()?;
    Some(ReportPicture { uri: data_uri("image/png", &bytes), width, height, alt, texels, values: None })
}

/// `data:…;base64,…`.
pub(crate) fn data_uri(mime: &str, bytes: &[u8]) -> String {
    format!("data:{mime};base64,{}", base64(bytes))
}

/// Bytes as text (RFC 4648).
pub(crate) fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().enumerate().fold(0u32, |w, (k, b)| w | u32::from(*b) << (16 - 8 * k));
        for k in 0..4 {
            out.push(if k <= chunk.len() { char::from(ALPHABET[(word >> (18 - 6 * k) & 63) as usize]) } else { '=' });
        }
    }
    out
}

/// All colours of a scale, six hexadecimal digits each.
pub(crate) fn listed(scale: &ColourScale) -> String {
    scale.iter().map(|[r, g, b]| format!("{r:02x}{g:02x}{b:02x}")).collect()
}

/// `#rrggbb` of a scale at `t` ∈ [0, 1].
pub fn hex(scale: &ColourScale, t: f64) -> String {
    let [r, g, b] = scale[(t.clamp(0.0, 1.0) * 254.0).round() as usize];
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_of_flip_maps_have_the_colours_that_the_maps_are_drawn_with() {
        let drawn = nv_flip::magma_lut().to_vec();
        for (k, hex) in MAGMA.iter().enumerate() {
            let at = 3 * (255.0 * k as f64 / 8.0).round() as usize;
            for (c, value) in drawn[at..at + 3].iter().enumerate() {
                let stated = u8::from_str_radix(&hex[1 + 2 * c..3 + 2 * c], 16).unwrap();
                assert!(stated.abs_diff(*value) <= 2, "{hex} {:?}", &drawn[at..at + 3]);
            }
        }
    }

    /// CIE lightness of an 8-bit sRGB colour: an independent measure from the one the scale is built with.
    fn cie_lightness(c: [u8; 3]) -> f64 {
        let linear = c.map(|v| {
            let s = f64::from(v) / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        });
        let y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
        if y > 0.008856 { 116.0 * y.cbrt() - 16.0 } else { 903.3 * y }
    }

    #[test]
    fn the_sequential_scale_gets_lighter_evenly() {
        let light: Vec<f64> = sequential().iter().map(|c| cie_lightness(*c)).collect();
        assert!(light[0] < 20.0 && light[254] > 85.0, "{} {}", light[0], light[254]);
        let steps: Vec<f64> =
            light.chunks_exact(15).collect::<Vec<_>>().windows(2).map(|w| w[1][0] - w[0][0]).collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        assert!(steps.iter().all(|s| *s > 0.5 * mean && *s < 1.6 * mean), "{steps:?}");
    }

    #[test]
    fn the_diverging_scale_is_grey_in_the_middle_and_darker_outwards() {
        let scale = diverging();
        let [r, g, b] = scale[127];
        assert!(r.abs_diff(g) < 3 && g.abs_diff(b) < 3, "{:?}", scale[127]);
        assert!(cie_lightness(scale[0]) < 60.0 && cie_lightness(scale[127]) > 90.0 && cie_lightness(scale[254]) < 60.0);
        assert!(scale[0][2] > scale[0][0] && scale[254][0] > scale[254][2]);
    }

    #[test]
    fn base64_is_that_of_the_standard() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(data_uri("x/y", plain.as_bytes()), format!("data:x/y;base64,{coded}"));
        }
    }

    #[test]
    fn a_single_defect_survives_shrinking() {
        let frame = MapFrame { width: 100, height: 10, max_width: 10, least_step: 1, texel_mm: None, kept: (1, 3) };
        let with = categories(frame, &[[0; 3], [255, 0, 0]], |i| Some(usize::from(i == 555)), String::new()).unwrap();
        let without = categories(frame, &[[0; 3], [255, 0, 0]], |_| Some(0), String::new()).unwrap();
        assert_eq!((with.width, with.height), (10, 1));
        assert_ne!(with.uri, without.uri);
    }
}
