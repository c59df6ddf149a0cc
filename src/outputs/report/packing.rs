//! Pictures that a check wrote, packed as small as PNG allows, and averaged where the page would be too large.

use image::RgbImage;
use std::collections::BTreeMap;

/// A PNG with the same pixels in fewer bytes, or with squares of `step` × `step` pixels averaged to one. `None` for
/// what is not a PNG.
pub fn repacked(png: &[u8], step: usize) -> Option<Vec<u8>> {
    let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(png)).ok()?;
    let whole = image::DynamicImage::from_decoder(decoder).ok()?.to_rgb8();
    let shown = if step > 1 { averaged(&whole, step as u32) } else { whole };
    let packed = match palette(&shown) {
        // Maps in false colour have few colours: a byte a pixel.
        Some(colours) => {
            let indices: Vec<u8> = shown.pixels().map(|p| colours[&p.0]).collect();
            let mut listed = vec![[0; 3]; colours.len()];
            colours.iter().for_each(|(colour, k)| listed[usize::from(*k)] = *colour);
            encoded(&shown, &indices, Some(listed.as_flattened()))?
        }
        None => encoded(&shown, shown.as_raw(), None)?,
    };
    Some(if step == 1 && png.len() < packed.len() { png.to_vec() } else { packed })
}

/// The colours and their indices, where there are at most 256.
fn palette(picture: &RgbImage) -> Option<BTreeMap<[u8; 3], u8>> {
    let mut colours = BTreeMap::new();
    for p in picture.pixels() {
        let next = colours.len();
        if let std::collections::btree_map::Entry::Vacant(e) = colours.entry(p.0) {
            e.insert(u8::try_from(next).ok()?);
        }
    }
    Some(colours)
}

/// Squares of `step` × `step` pixels, averaged as displayed; those at the right and lower edge may be smaller.
fn averaged(whole: &RgbImage, step: u32) -> RgbImage {
    RgbImage::from_fn(whole.width().div_ceil(step), whole.height().div_ceil(step), |x, y| {
        let (mut sum, mut count) = ([0u32; 3], 0);
        for j in y * step..((y + 1) * step).min(whole.height()) {
            for i in x * step..((x + 1) * step).min(whole.width()) {
                whole.get_pixel(i, j).0.iter().zip(&mut sum).for_each(|(v, s)| *s += u32::from(*v));
                count += 1;
            }
        }
        image::Rgb(sum.map(|s| ((s + count / 2) / count) as u8))
    })
}

fn encoded(picture: &RgbImage, data: &[u8], palette: Option<&[u8]>) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, picture.width(), picture.height());
    encoder.set_depth(png::BitDepth::Eight);
    match palette {
        Some(palette) => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(palette.to_vec());
            encoder.set_compression(png::Compression::High);
            encoder.set_filter(png::Filter::NoFilter);
        }
        None => {
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_compression(png::Compression::High);
        }
    }
    encoder.write_header().ok()?.write_image_data(data).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_stay_and_bytes_become_fewer() {
        for colours in [7u32, 4096] {
            let picture = RgbImage::from_fn(61, 40, |x, y| {
                let k = (x * 37 + y * y * 11) % colours;
                image::Rgb([(k % 256) as u8, (k / 16) as u8, 9])
            });
            let mut png = std::io::Cursor::new(Vec::new());
            picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
            let packed = repacked(png.get_ref(), 1).unwrap();
            assert!(packed.len() <= png.get_ref().len());
            assert_eq!(image::load_from_memory(&packed).unwrap().to_rgb8(), picture);
            let half = image::load_from_memory(&repacked(png.get_ref(), 2).unwrap()).unwrap().to_rgb8();
            assert_eq!(half.dimensions(), (31, 20));
            let four = [(2, 4), (3, 4), (2, 5), (3, 5)].map(|(x, y)| u32::from(picture.get_pixel(x, y).0[0]));
            assert_eq!(u32::from(half.get_pixel(1, 2).0[0]), (four.iter().sum::<u32>() + 2) / 4);
        }
        assert_eq!(repacked(b"no picture", 1), None);
    }
}
