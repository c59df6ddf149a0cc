//! Pictures of whole numbers (PNG, TIFF, JPEG): how their numbers stand for light.

use super::manifest::TransferCurve;
use super::picture::too_large;
use crate::photo::{Error, Result};
use image::ImageDecoder;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::{atomic, whole_file};
use std::path::Path;

/// Share of the largest number of an integer file from which a reading counts as clipped.
const CLIPPED: f32 = 0.998;

/// Standard error of a number of a JPEG file, in steps of 8 bits: its blocks are rounded too, and colours are shared by
/// neighbours.
const JPEG_STEPS: f64 = 1.0;

/// A number that is rounded to a whole one is off by this many steps (root mean square).
const ROUNDED_STEPS: f64 = 0.288_675;

/// Columns, rows and linear readings of a picture, and the errors of its 8 bits, where it has no more.
pub(super) type Read = (usize, usize, Vec<Rgb<f32>>, Option<TonalSteps>);

/// The numbers of a picture with 8 bits a channel: the light that each stands for, ascending, and how many steps a
/// number is off by.
#[derive(Debug, Clone, PartialEq)]
pub struct TonalSteps {
    levels: Vec<f64>,
    off: f64,
}

impl TonalSteps {
    /// Steps of 8 bits.
    pub(super) fn new(transfer: TransferCurve, jpeg: bool) -> TonalSteps {
        let levels = (0..=255u8).map(|k| transfer.light(f64::from(k) / 255.0)).collect();
        TonalSteps { levels, off: if jpeg { JPEG_STEPS } else { ROUNDED_STEPS } }
    }

    /// The standard error of a linear reading `v`. Neighbours with the same light have the same error, so that a mean
    /// over them has it too.
    pub fn error(&self, v: f64) -> f64 {
        let last = self.levels.len() - 1;
        let at = self.levels.partition_point(|level| *level < v).clamp(1, last);
        self.off * (self.levels[at] - self.levels[at - 1])
    }
}

impl TransferCurve {
    /// The light, in any unit, that the number `v` (0 … 1) stands for.
    pub fn light(self, v: f64) -> f64 {
        match self {
            TransferCurve::Linear => v,
            TransferCurve::Srgb if v <= 0.040_45 => v / 12.92,
            TransferCurve::Srgb => ((v + 0.055) / 1.055).powf(2.4),
            TransferCurve::Rec709 if v < 0.081 => v / 4.5,
            TransferCurve::Rec709 => ((v + 0.099) / 1.099).powf(1.0 / 0.45),
            TransferCurve::AdobeRgb => v.powf(563.0 / 256.0),
            TransferCurve::ProphotoRgb if v < 1.0 / 32.0 => v / 16.0,
            TransferCurve::ProphotoRgb => v.powf(1.8),
            TransferCurve::Gamma22 => v.powf(2.2),
            TransferCurve::SLog3 if v >= 171.210_294_692_9 / 1023.0 => {
                10f64.powf((v * 1023.0 - 420.0) / 261.5) * 0.19 - 0.01
            }
            TransferCurve::SLog3 => (v * 1023.0 - 95.0) * 0.011_25 / (171.210_294_692_9 - 95.0),
            TransferCurve::LogC3 if v > 0.149_658 => (10f64.powf((v - 0.385_537) / 0.247_190) - 0.052_272) / 5.555_556,
            TransferCurve::LogC3 => (v - 0.092_809) / 5.367_655,
            TransferCurve::VLog if v < 0.181 => (v - 0.125) / 5.6,
            TransferCurve::VLog => 10f64.powf((v - 0.598_206) / 0.241_514) - 0.008_73,
        }
    }
}

/// A picture of whole numbers as its file holds it.
pub(super) struct Decoded {
    pub(super) image: image::DynamicImage,
    /// The stated curve, or the file's own where none is stated.
    pub(super) transfer: Option<TransferCurve>,
    pub(super) jpeg: bool,
}

/// Decodes a PNG, a TIFF or a JPEG file. `transfer` is the stated curve.
///
/// # Errors
/// [`Error::Input`] for a file that is broken or too large, or whose own profile says another curve than `transfer`.
pub(super) fn decoded(path: &Path, transfer: Option<TransferCurve>) -> Result<Decoded> {
    let broken = |e: &dyn std::fmt::Display| Error::input(path, format!("not a readable picture: {e}"));
    let open = || -> Result<image::ImageReader<_>> {
        image::ImageReader::open(path)
            .and_then(image::ImageReader::with_guessed_format)
            .map_err(|e| Error::input(path, atomic::explain(&e)))
    };
    let mut reader = open()?;
    let jpeg = reader.format() == Some(image::ImageFormat::Jpeg);
    let png = reader.format() == Some(image::ImageFormat::Png);
    let (width, height) = open()?.into_dimensions().map_err(|e| broken(&e))?;
    too_large(path, width as usize, height as usize)?;
    // The size is allowed and the memory was asked for, so that the decoder's own limit of 512 MiB does not count.
    reader.no_limits();
    let mut decoder = reader.into_decoder().map_err(|e| broken(&e))?;
    let profile = decoder.icc_profile().ok().flatten();
    let own = profile.and_then(|p| curve_of_profile(&p)).or(if png { curve_of_png(path)? } else { None });
    if let Some(transfer) = transfer {
        agrees(path, transfer, own)?;
    }
    let image = image::DynamicImage::from_decoder(decoder).map_err(|e| broken(&e))?;
    Ok(Decoded { image, transfer: transfer.or_else(|| own.and_then(named)), jpeg })
}

/// The curve of a file that states only an exponent; `None` where no published curve is near it.
fn named(gamma: Stated) -> Option<TransferCurve> {
    match gamma {
        g if (g - 1.0).abs() < 0.02 => Some(TransferCurve::Linear),
        g if (2.1..=2.45).contains(&g) => Some(TransferCurve::Srgb),
        _ => None,
    }
}

/// Reads a PNG, a TIFF or a JPEG file.
///
/// # Errors
/// As [`decoded`]; [`Error::Input`] for a file without colours, and for 8 bits a channel without a curve.
pub(super) fn read(path: &Path, transfer: TransferCurve) -> Result<Read> {
    let Decoded { image, jpeg, .. } = decoded(path, Some(transfer))?;
    use image::ColorType::{Rgb8, Rgb16, Rgba8, Rgba16};
    let found = image.color();
    if !matches!(found, Rgb8 | Rgba8 | Rgb16 | Rgba16) {
        let expected = "three colours with 16 bits a channel, or with 8 bits and a known curve";
        return Err(Error::input(path, format!("found {found:?}, expected {expected}")));
    }
    let coarse = matches!(found, Rgb8 | Rgba8);
    if coarse {
        not_too_coarse(path, transfer)?;
    }
    // Numbers of 8 bits become k · 257 of 16, the same shares.
    let decode = |v: u16| {
        let v = f32::from(v) / f32::from(u16::MAX);
        if v >= CLIPPED { f32::INFINITY } else { transfer.light(f64::from(v)) as f32 }
    };
    let table: Vec<f32> = (0..=u16::MAX).map(decode).collect();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.into_rgb16().pixels().map(|p| Rgb(p.0).map(|v| table[usize::from(v)])).collect();
    Ok((width, height, pixels, coarse.then(|| TonalSteps::new(transfer, jpeg))))
}

/// Refuses 8 bits a channel in proportion to light.
pub(super) fn not_too_coarse(path: &Path, transfer: TransferCurve) -> Result<()> {
    if transfer != TransferCurve::Linear {
        return Ok(());
    }
    let what = "found 8 bits a channel and transfer = \"linear\"; 8 bits hold light in proportion too coarsely, and \
                cameras write them with a curve: expected the curve's name, such as transfer = \"srgb\", or 16 bits";
    Err(Error::input(path, what))
}

/// The curve that a file states: 1 is linear, and that of sRGB counts as about 2.2.
type Stated = f64;

/// Refuses a stated curve that is not the file's own.
fn agrees(path: &Path, transfer: TransferCurve, stated: Option<Stated>) -> Result<()> {
    let Some(gamma) = stated else { return Ok(()) };
    let linear = (gamma - 1.0).abs() < 0.02;
    let named = if linear { "light in proportion (a linear profile)" } else { "a curve, as that of sRGB is" };
    let what = match transfer {
        TransferCurve::Linear if !linear => "transfer = \"linear\"; name the curve, or develop the picture without one",
        TransferCurve::Linear => return Ok(()),
        _ if linear => "another transfer; expected transfer = \"linear\"",
        _ => return Ok(()),
    };
    Err(Error::input(path, format!("the file's own colour profile says {named}, and what is stated is {what}")))
}

/// The exponent of the red curve of an ICC profile; `None` where it has none.
fn curve_of_profile(profile: &[u8]) -> Option<Stated> {
    let word = |at: usize| Some(u32::from_be_bytes(profile.get(at..at + 4)?.try_into().ok()?));
    let count = word(128)?.min(200) as usize;
    let tag = |name: &[u8]| (0..count).map(|k| 132 + 12 * k).find(|at| profile.get(*at..*at + 4) == Some(name));
    let at = word(tag(b"rTRC").or_else(|| tag(b"gTRC"))? + 4)? as usize;
    let fixed = |at: usize| Some(f64::from(word(at)? as i32) / 65536.0);
    match profile.get(at..at + 4)? {
        b"para" => fixed(at + 12),
        b"curv" => match word(at + 8)? {
            // Two numbers are the ends of a line.
            0 | 2 => Some(1.0),
            1 => Some(f64::from(u16::from_be_bytes(profile.get(at + 12..at + 14)?.try_into().ok()?)) / 256.0),
            // The number in the middle: a half to the power of the exponent.
            many => {
                let middle = at + 12 + 2 * (many as usize / 2);
                let v = f64::from(u16::from_be_bytes(profile.get(middle..middle + 2)?.try_into().ok()?)) / 65535.0;
                let x = (many / 2) as f64 / (many - 1) as f64;
                Some(v.max(1e-6).ln() / x.ln())
            }
        },
        _ => None,
    }
}

/// The curve that a PNG states by its chunks `sRGB` or `gAMA`.
fn curve_of_png(path: &Path) -> Result<Option<Stated>> {
    let bytes = whole_file::bytes(path, whole_file::MOST_DATA)?;
    let mut at = 8;
    while let (Some(length), Some(name)) = (bytes.get(at..at + 4), bytes.get(at + 4..at + 8)) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        match (name, bytes.get(at + 8..at + 12)) {
            (b"IDAT", _) => break,
            (b"sRGB", _) => return Ok(Some(2.2)),
            (b"gAMA", Some(g)) => {
                let gamma = f64::from(u32::from_be_bytes([g[0], g[1], g[2], g[3]])) / 1e5;
                return Ok((gamma > 0.0).then(|| 1.0 / gamma));
            }
            _ => at = at.saturating_add(length).saturating_add(12),
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use strum::IntoEnumIterator;

    /// Every curve rises, and a grey of 18 % is where its source puts it.
    #[test]
    fn curves_are_those_of_their_sources() {
        for (transfer, code) in [
            (TransferCurve::Srgb, 0.4613),
            (TransferCurve::Rec709, 0.4090),
            (TransferCurve::AdobeRgb, 0.4585),
            (TransferCurve::ProphotoRgb, 0.3857),
            (TransferCurve::SLog3, 420.0 / 1023.0),
            (TransferCurve::LogC3, 0.3910),
            (TransferCurve::VLog, 0.4233),
        ] {
            let light = transfer.light(code);
            assert!((light / 0.18 - 1.0).abs() < 4e-3, "{transfer:?}: {light}");
        }
        for transfer in TransferCurve::iter() {
            let lights: Vec<f64> = (0..=1000).map(|k| transfer.light(f64::from(k) / 1000.0)).collect();
            assert!(lights.windows(2).all(|w| w[1] > w[0]), "{transfer:?}");
            // No jump where two parts of a curve meet.
            assert!(lights.windows(3).all(|w| w[2] - w[1] < 3.0 * (w[1] - w[0]) + 1e-4), "{transfer:?}");
        }
    }

    /// The error of a rounded number, against many numbers that were rounded.
    #[test]
    fn eight_bits_have_the_error_of_their_steps() {
        let transfer = TransferCurve::Srgb;
        let steps = TonalSteps::new(transfer, false);
        for middle in [0.02, 0.18, 0.6] {
            // Light around the middle, so that all places between two steps count.
            let (mut sum, n) = (0.0, 4000);
            for k in 0..n {
                let light = middle * (0.85 + 0.3 * f64::from(k) / f64::from(n));
                let code = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
                sum += (transfer.light((code * 255.0).round() / 255.0) - light).powi(2);
            }
            let rms = (sum / f64::from(n)).sqrt();
            assert!((steps.error(middle) / rms - 1.0).abs() < 0.1, "{middle}: {} {rms}", steps.error(middle));
        }
        assert!(TonalSteps::new(transfer, true).error(0.18) > 3.0 * steps.error(0.18));
    }

    /// A PNG and a JPEG of 8 bits, and a PNG whose header says that it is coded as sRGB.
    #[test]
    fn eight_bits_need_a_curve_and_not_another_one_than_the_files() {
        let dir = tempfile::tempdir().unwrap();
        let pixels = image::RgbImage::from_fn(32, 24, |x, _| image::Rgb([8 * x as u8, 118, 40]));
        for name in ["a.png", "a.jpg"] {
            let path = dir.path().join(name);
            pixels.save(&path).unwrap();
            let refused = read(&path, TransferCurve::Linear).unwrap_err().to_string();
            assert!(refused.contains(name) && refused.contains("8 bits"), "{refused}");
            let (width, height, read, steps) = read(&path, TransferCurve::Srgb).unwrap();
            assert!((width, height, read.len()) == (32, 24, 768) && steps.is_some());
            // 118 of 255 in sRGB is a linear 18 %.
            assert!(read.iter().all(|v| (v[1] - 0.1812).abs() < 0.02), "{name}");
        }
        // The chunk sRGB stands behind the header: length, name, one byte, and a sum that is not looked at here.
        let path = dir.path().join("a.png");
        let mut bytes = std::fs::read(&path).unwrap();
        let chunk = [&[0, 0, 0, 1][..], b"sRGB", &[0], &[0xae, 0xce, 0x1c, 0xe9]].concat();
        bytes.splice(33..33, chunk);
        std::fs::write(&path, bytes).unwrap();
        let refused = read(&path, TransferCurve::Linear).unwrap_err().to_string();
        assert!(refused.contains("own colour profile") && refused.contains("sRGB"), "{refused}");
        assert!(read(&path, TransferCurve::Srgb).is_ok());
    }

    #[test]
    fn a_profile_says_its_curve() {
        let profile = |curve: &[u8]| {
            let mut bytes = vec![0u8; 128];
            bytes.extend(1u32.to_be_bytes());
            bytes.extend(b"rTRC");
            bytes.extend(144u32.to_be_bytes());
            bytes.extend((curve.len() as u32).to_be_bytes());
            bytes.extend(curve);
            bytes
        };
        let curv = |numbers: &[u16]| {
            let mut bytes = b"curv\0\0\0\0".to_vec();
            bytes.extend((numbers.len() as u32).to_be_bytes());
            bytes.extend(numbers.iter().flat_map(|v| v.to_be_bytes()));
            bytes
        };
        let table: Vec<u16> =
            (0..1024).map(|k| (65535.0 * TransferCurve::Srgb.light(f64::from(k) / 1023.0)).round() as u16).collect();
        for (curve, want) in [(curv(&[]), 1.0), (curv(&[0, 65535]), 1.0), (curv(&[563]), 2.2), (curv(&table), 2.22)] {
            let found = curve_of_profile(&profile(&curve)).unwrap();
            assert!((found - want).abs() < 0.1, "{found} {want}");
        }
        assert_eq!(curve_of_profile(b"short"), None);
        let path = Path::new("a.tif");
        let refused = agrees(path, TransferCurve::Linear, Some(2.2)).unwrap_err().to_string();
        assert!(refused.contains("a.tif") && refused.contains("sRGB") && refused.contains("linear"), "{refused}");
        assert!(
            agrees(path, TransferCurve::Srgb, Some(1.0)).is_err()
                && agrees(path, TransferCurve::Srgb, Some(2.2)).is_ok()
        );
        assert!(
            agrees(path, TransferCurve::Linear, Some(1.0)).is_ok() && agrees(path, TransferCurve::Linear, None).is_ok()
        );
    }
}
