//! A picture as a texture: its colours as light and its opacity, or numbers that are no light, such as a map of
//! normals.

use super::encoding::{self, Decoded};
use super::manifest::TransferCurve;
use super::picture::too_large;
use crate::photo::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_files::image::{ChannelMaps, exr_info, read_exr};
use mesophyll_files::picture::{self, PictureRequest, RGB};
use std::path::Path;

/// What the numbers of a picture stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureEncoding {
    /// Light, by the stated curve, or by the file's own where none is stated.
    Light(Option<TransferCurve>),
    /// Themselves, whatever a colour profile says.
    Numbers,
}

/// A picture, row-major, row 0 on top.
#[derive(Debug, Clone)]
pub struct ColourPicture {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue and opacity of each pixel. Colours are not multiplied by the opacity. A picture of one channel
    /// has it three times.
    pub pixels: Vec<[f32; 4]>,
    /// Whether the picture has one channel in place of three colours.
    pub grey: bool,
    /// Whether it holds opacity; it is 1 everywhere otherwise.
    pub has_opacity: bool,
    /// The curve by which its colours became light; linear for numbers.
    pub transfer: TransferCurve,
}

/// Reads an OpenEXR, Radiance, PNG, TIFF or JPEG file.
///
/// # Errors
/// [`Error::Input`] for a file that is broken, of another kind or too large; for light whose curve is unknown, is not
/// the file's own, or is linear with 8 bits a channel.
pub fn read(path: &Path, meaning: PictureEncoding) -> Result<ColourPicture> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match extension.as_str() {
        "exr" | "hdr" => floats(path, meaning),
        "png" | "tif" | "tiff" | "jpg" | "jpeg" => whole(path, meaning),
        _ => Err(Error::input(path, "found a file of another kind, expected a .png, .tif, .jpg, .exr or .hdr file")),
    }
}

fn whole(path: &Path, meaning: PictureEncoding) -> Result<ColourPicture> {
    let stated = match meaning {
        PictureEncoding::Light(stated) => stated,
        PictureEncoding::Numbers => None,
    };
    let Decoded { image, transfer, .. } = encoding::decoded(path, stated)?;
    let color = image.color();
    let transfer = match (meaning, transfer) {
        (PictureEncoding::Numbers, _) => TransferCurve::Linear,
        (PictureEncoding::Light(_), Some(transfer)) => {
            if color.bytes_per_pixel() == color.channel_count() {
                encoding::not_too_coarse(path, transfer)?;
            }
            transfer
        }
        (PictureEncoding::Light(_), None) => {
            let what = "the file has no colour profile, and no transfer is stated; expected the curve's name, such as \
                        transfer = \"srgb\", which most programs write";
            return Err(Error::input(path, what));
        }
    };
    let share = |v: u16| f32::from(v) / f32::from(u16::MAX);
    let light: Vec<f32> = (0..=u16::MAX).map(|v| transfer.light(f64::from(share(v))) as f32).collect();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixel = |p: &image::Rgba<u16>| {
        let [r, g, b, a] = p.0;
        let [r, g, b] = [r, g, b].map(|v| light[usize::from(v)]);
        [r, g, b, share(a)]
    };
    let pixels = image.into_rgba16().pixels().map(pixel).collect();
    let (grey, has_opacity) = (color.channel_count() < 3, color.has_alpha());
    Ok(ColourPicture { width, height, pixels, grey, has_opacity, transfer })
}

fn floats(path: &Path, meaning: PictureEncoding) -> Result<ColourPicture> {
    if let PictureEncoding::Light(Some(stated)) = meaning
        && stated != TransferCurve::Linear
    {
        let what = "the file holds light in proportion, and another transfer is stated; expected none, or \"linear\"";
        return Err(Error::input(path, what));
    }
    let radiance = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hdr"));
    let one = if radiance { None } else { Some(exr_info(path)?).filter(|info| info.channels.len() == 1) };
    let maps = match (&one, meaning) {
        (None, PictureEncoding::Light(_)) => {
            let picture::LinearPicture { maps, said } =
                picture::read(path, &PictureRequest { names: &RGB, all: true, outside: 0.0 }, |w, h| {
                    too_large(path, w, h)
                })?;
            picture::tell(path, &said);
            maps
        }
        // Stated chromaticities are those of colours, and numbers are none.
        _ if radiance => {
            return Err(Error::input(path, "found radiance, expected numbers in a .png, .tif or .exr file"));
        }
        _ => read_exr(path)?,
    };
    too_large(path, maps.width, maps.height)?;
    let ChannelMaps { width, height, .. } = maps;
    let names = one.as_ref().map_or(RGB, |info| [info.channels[0].as_str(); 3]);
    let [r, g, b] = [maps.require(path, names[0])?, maps.require(path, names[1])?, maps.require(path, names[2])?];
    let opacity = maps.get("A").filter(|_| one.is_none());
    // Colours of an OpenEXR file are multiplied by its opacity.
    let over = |k: usize| opacity.map_or(1.0, |a| if a[k] > 0.0 { a[k] } else { 1.0 });
    let pixel = |k: usize| {
        let [r, g, b] = [r[k], g[k], b[k]].map(|v| v / over(k));
        [r, g, b, opacity.map_or(1.0, |a| a[k])]
    };
    let pixels: Vec<[f32; 4]> = (0..width * height).map(pixel).collect();
    if let Some(k) = pixels.iter().position(|p| p[3] > 0.0 && p.iter().any(|v| !v.is_finite())) {
        let [column, row] = ImageSize::new(width, height).position(k);
        let what = format!("column {column}, row {row}: found {:?}, expected finite numbers", pixels[k]);
        return Err(Error::input(path, what));
    }
    let (grey, has_opacity, transfer) = (one.is_some(), opacity.is_some(), TransferCurve::Linear);
    Ok(ColourPicture { width, height, pixels, grey, has_opacity, transfer })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_files::image::{Packing, write_exr};

    /// The same half-covered orange in three files, and what each says when its curve is not clear.
    #[test]
    fn the_same_colour_comes_from_every_kind_of_file() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        // 188, 118 and 0 of 255 in sRGB are a linear 0.5029, 0.1812 and 0.
        let pixel = image::Rgba([188, 118, 0, 128]);
        image::RgbaImage::from_pixel(16, 16, pixel).save(at("a.png")).unwrap();
        let opacity = 128.0 / 255.0;
        let mut maps = ChannelMaps::new(16, 16);
        for (name, v) in [("R", 0.5029), ("G", 0.1812), ("B", 0.0), ("A", 1.0)] {
            maps.push(name, vec![v * opacity; 256]);
        }
        write_exr(&at("a.exr"), &maps, Packing::Zip).unwrap();
        for (name, stated) in [("a.png", Some(TransferCurve::Srgb)), ("a.exr", None)] {
            let found = read(&at(name), PictureEncoding::Light(stated)).unwrap();
            assert!(found.has_opacity && !found.grey && found.pixels.len() == 256, "{name}");
            for (v, want) in found.pixels[17].iter().zip([0.5029, 0.1812, 0.0, opacity]) {
                assert!((v - want).abs() < 2e-4, "{name}: {:?}", found.pixels[17]);
            }
        }
        let said = |name: &str, stated| read(&at(name), PictureEncoding::Light(stated)).unwrap_err().to_string();
        assert!(said("a.png", None).contains("no colour profile"), "{}", said("a.png", None));
        assert!(said("a.png", Some(TransferCurve::Linear)).contains("8 bits"));
        assert!(said("a.exr", Some(TransferCurve::Srgb)).contains("in proportion"));
        assert!(read(&at("a.tga"), PictureEncoding::Numbers).unwrap_err().to_string().contains("another kind"));
        // The file's own chunk says the curve where none is stated, and contradicts another one.
        let mut bytes = std::fs::read(at("a.png")).unwrap();
        bytes.splice(33..33, [&[0, 0, 0, 1][..], b"sRGB", &[0], &[0xae, 0xce, 0x1c, 0xe9]].concat());
        std::fs::write(at("own.png"), bytes).unwrap();
        let own = read(&at("own.png"), PictureEncoding::Light(None)).unwrap();
        assert!(own.transfer == TransferCurve::Srgb && (own.pixels[0][0] - 0.5029).abs() < 2e-4);
        assert!(said("own.png", Some(TransferCurve::Linear)).contains("own colour profile"));
        // Numbers are what the file holds.
        let numbers = read(&at("a.png"), PictureEncoding::Numbers).unwrap().pixels[0];
        assert!((numbers[0] - 188.0 / 255.0).abs() < 1e-6);
        image::GrayImage::from_pixel(16, 16, image::Luma([51])).save(at("g.png")).unwrap();
        let grey = read(&at("g.png"), PictureEncoding::Numbers).unwrap();
        assert!(grey.grey && !grey.has_opacity && (grey.pixels[5][2] - 0.2).abs() < 1e-6);
    }
}
