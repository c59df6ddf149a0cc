//! Maps on disk: OpenEXR with named float channels (the truth) and 8-bit PNG (the preview).

use crate::atomic::{self, PendingFile};
use crate::quantity::RGB;
use crate::{Error, Result, guard, memory, whole_file};
use exr::block::reader::ChunksReader;
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder, SampleType, SmallVec,
    WritableImage,
};
use mesophyll_base::rgb::Rgb;
use std::fs::File;
use std::io::{BufReader, Write};
use std::ops::Range;
use std::path::Path;

/// Named single-precision channels of one size; row 0 is the top row, samples are row-major.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChannelMaps {
    /// Texels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Name and samples of each channel.
    pub channels: Vec<(String, Vec<f32>)>,
}

/// What an EXR file holds, without its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct ExrInfo {
    /// Texels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Whether any channel is stored as half (which keeps about 5e-4 relative).
    pub half: bool,
}

/// A part of an EXR file (other programs call it a layer or a view), without its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct ExrPart {
    /// The size of its data window, and what it holds.
    pub info: ExrInfo,
    /// Its name, where it has one.
    pub name: Option<String>,
    /// Column and row of the data window's first pixel in the display window; negative outside of it.
    pub offset: [i64; 2],
    /// Columns and rows of the display window, which is the whole picture.
    pub display: [usize; 2],
    /// CIE x and y of red, green, blue and white, where the file states them.
    pub chromaticities: Option<[[f64; 2]; 4]>,
}

/// How EXR samples are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// Raw scan lines: for noisy frames, where compression costs time and saves nothing.
    Raw,
    /// ZIP over 16 scan lines: for maps that are kept.
    Zip,
    /// The same with half floats, which keep about three digits; beyond ±65504 they are infinite.
    Half,
}

impl ChannelMaps {
    /// Maps of this size without a channel.
    pub fn new(width: usize, height: usize) -> Self {
        ChannelMaps { width, height, channels: Vec::new() }
    }

    /// Adds a channel; its length must be `width · height`.
    pub fn push(&mut self, name: impl Into<String>, samples: Vec<f32>) {
        debug_assert_eq!(samples.len(), self.width * self.height);
        self.channels.push((name.into(), samples));
    }

    /// Adds the channels `R`, `G` and `B` of an image.
    pub fn push_rgb(&mut self, pixels: &[Rgb<f32>]) {
        RGB.iter().enumerate().for_each(|(c, name)| self.push(*name, pixels.iter().map(|v| v[c]).collect()));
    }

    /// The first three channels, texel by texel.
    pub fn rgb(&self) -> Vec<Rgb<f32>> {
        (0..self.width * self.height).map(|k| Rgb::of(|c| self.channels[c].1[k])).collect()
    }

    /// The samples of a channel; `None` where there is none of that name.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|(n, _)| n == name).map(|(_, s)| s.as_slice())
    }

    /// The channel `name`, or a sentence that names the file and what it does hold.
    pub fn require(&self, path: &Path, name: &str) -> Result<&[f32]> {
        self.get(name)
            .ok_or_else(|| Error::field(path, name, format!("no such channel; the file holds {}", self.held())))
    }
}

/// Reads the header of an EXR file.
///
/// # Errors
/// [`Error::Input`] when the file is missing, is no EXR, or is broken.
pub fn exr_info(path: &Path) -> Result<ExrInfo> {
    let file = File::open(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
    let reader = guarded(path, || exr::block::read(BufReader::new(file), false).map_err(|e| broken(path, &e)))?;
    info_of(path, reader.headers().first())
}

/// Reads the headers of all parts of an EXR file.
///
/// # Errors
/// As [`exr_info`].
pub fn exr_parts(path: &Path) -> Result<Vec<ExrPart>> {
    let file = File::open(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
    let reader = guarded(path, || exr::block::read(BufReader::new(file), false).map_err(|e| broken(path, &e)))?;
    let part = |header: &Header| {
        let (own, shared) = (&header.own_attributes, &header.shared_attributes);
        let (window, point) = (shared.display_window, |v: exr::math::Vec2<f32>| [v.x(), v.y()].map(f64::from));
        let offset = [(own.layer_position.x(), window.position.x()), (own.layer_position.y(), window.position.y())];
        Ok(ExrPart {
            info: info_of(path, Some(header))?,
            name: own.layer_name.as_ref().map(ToString::to_string),
            offset: offset.map(|(data, display)| i64::from(data) - i64::from(display)),
            display: [window.size.width(), window.size.height()],
            chromaticities: shared.chromaticities.map(|c| [c.red, c.green, c.blue, c.white].map(point)),
        })
    };
    reader.headers().iter().map(part).collect()
}

fn info_of(path: &Path, header: Option<&Header>) -> Result<ExrInfo> {
    let header = header.ok_or_else(|| Error::input(path, "the file holds no image"))?;
    if header.deep {
        return Err(Error::input(path, "deep images are not supported; expected flat float channels"));
    }
    Ok(ExrInfo {
        width: header.layer_size.width(),
        height: header.layer_size.height(),
        channels: header.channels.list.iter().map(|c| c.name.to_string()).collect(),
        half: header.channels.list.iter().any(|c| c.sample_type == SampleType::F16),
    })
}

/// Above this many bytes of pixels, a reader checks whether there is enough memory, because a broken header may state
/// any size.
const ASK_FOR_MEMORY: u64 = 1 << 28;

/// No compression of OpenEXR that is read here makes pixels more than this many times as small. The limit is that of
/// deflate, 1032, with some room.
const MOST_COMPRESSED: u64 = 1100;

/// Pixels that are packed more than this many times as small are alike all over. A small file may ask for
/// [`ASK_FOR_MEMORY`] bytes of them, but for more only in proportion to its own size.
const MOST_ALIKE: u64 = 100;

/// Refuses a picture that would take far more memory than its file of `length` bytes; every sample is kept as a float.
///
/// # Errors
/// [`Error::Input`].
pub(crate) fn in_proportion(path: &Path, [w, h]: [usize; 2], channels: usize, length: u64) -> Result<()> {
    let whole = [w, h, 4 * channels].iter().fold(1u64, |product, n| product.saturating_mul(*n as u64));
    if whole <= ASK_FOR_MEMORY.max(length.saturating_mul(MOST_ALIKE)) {
        return Ok(());
    }
    let what = format!(
        "{w}x{h} pixels in a file of {length} bytes: nearly all of them are alike, and they would take {} MiB of \
         memory; expected at most {MOST_ALIKE} times the file, or a smaller picture",
        whole >> 20
    );
    Err(Error::input(path, what))
}

/// Reads every channel of an EXR file; half and integer samples become float.
pub fn read_exr(path: &Path) -> Result<ChannelMaps> {
    read_exr_rows(path, None, None)
}

/// Reads some channels (all when `None`, in the order asked) and some rows (all when `None`) of the first part,
/// decompressing only the blocks that hold them.
///
/// # Errors
/// [`Error::Input`] naming the file and, for a missing channel, the channel.
pub fn read_exr_rows(path: &Path, names: Option<&[&str]>, rows: Option<Range<usize>>) -> Result<ChannelMaps> {
    read_exr_part(path, 0, names, rows)
}

/// As [`read_exr_rows`], of the part with this place among [`exr_parts`]. Rows are those of its data window.
///
/// # Errors
/// As [`read_exr_rows`].
pub fn read_exr_part(
    path: &Path,
    part: usize,
    names: Option<&[&str]>,
    rows: Option<Range<usize>>,
) -> Result<ChannelMaps> {
    let file = File::open(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
    guarded(path, || {
        let reader = exr::block::read(BufReader::with_capacity(1 << 17, file), false).map_err(|e| broken(path, &e))?;
        let info = info_of(path, reader.headers().get(part))?;
        let stated = (info.width as u64).saturating_mul(info.height as u64);
        let samples = reader.headers()[part].channels.list.iter().map(|c| c.sample_type.bytes_per_sample() as u64);
        let length = std::fs::metadata(path).map_err(|e| Error::input(path, atomic::explain(&e)))?.len();
        if stated.saturating_mul(samples.sum()) > length.saturating_mul(MOST_COMPRESSED) {
            let [w, h] = [info.width, info.height];
            let what = format!("the header states {w}x{h} pixels; a file of {length} bytes cannot hold as many");
            return Err(Error::input(path, what));
        }
        in_proportion(path, [info.width, info.height], info.channels.len(), length)?;
        let rows = rows.unwrap_or(0..info.height);
        if rows.end > info.height {
            return Err(Error::input(path, format!("rows up to {} wanted, the image has {}", rows.end, info.height)));
        }
        let wanted: Vec<String> = match names {
            None => info.channels.clone(),
            Some(list) => list.iter().map(|n| n.to_string()).collect(),
        };
        // slot[k] is the place of the file's channel k in the output.
        let mut slots = vec![Vec::new(); info.channels.len()];
        for (at, name) in wanted.iter().enumerate() {
            match info.channels.iter().position(|c| c == name) {
                Some(k) => slots[k].push(at),
                None => {
                    return Err(Error::field(
                        path,
                        name,
                        format!("no such channel; the file holds {}", info.channels.join(", ")),
                    ));
                }
            }
        }
        let count = info.width * rows.len();
        let bytes = (count as u64).saturating_mul(4 * wanted.len() as u64);
        if bytes > ASK_FOR_MEMORY {
            let [w, h] = [info.width, rows.len()];
            memory::require(bytes, &format!("{}: an image of {w}x{h} pixels", path.display()))?;
        }
        let mut planes = vec![vec![0f32; count]; wanted.len()];
        let mut filled = 0usize;
        let chunks = reader
            .filter_chunks(false, |_, tile, block| {
                let (y0, y1) = (block.pixel_position.y(), block.pixel_position.y() + block.pixel_size.height());
                block.layer == part
                    && tile.level_index.0 == 0
                    && tile.level_index.1 == 0
                    && y0 < rows.end
                    && y1 > rows.start
            })
            .map_err(|e| broken(path, &e))?;
        let list = chunks.meta_data().headers[part].channels.clone();
        chunks
            .decompress_sequential(false, |_, block| {
                for line in block.lines(&list) {
                    let y = line.location.position.y();
                    if y < rows.start || y >= rows.end {
                        continue;
                    }
                    let (x, n) = (line.location.position.x(), line.location.sample_count);
                    let start = (y - rows.start) * info.width + x;
                    let kind = list.list[line.location.channel].sample_type;
                    for &slot in &slots[line.location.channel] {
                        decode(kind, line.value, &mut planes[slot][start..start + n]);
                        filled += n;
                    }
                }
                Ok(())
            })
            .map_err(|e| broken(path, &e))?;
        if filled < count * wanted.len() {
            return Err(Error::input(path, "some scan lines are missing (truncated?)"));
        }
        Ok(ChannelMaps { width: info.width, height: rows.len(), channels: wanted.into_iter().zip(planes).collect() })
    })
}

fn decode(kind: SampleType, bytes: &[u8], out: &mut [f32]) {
    match kind {
        SampleType::F32 => {
            for (o, b) in out.iter_mut().zip(bytes.chunks_exact(4)) {
                *o = f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
            }
        }
        SampleType::F16 => {
            for (o, b) in out.iter_mut().zip(bytes.chunks_exact(2)) {
                *o = exr::prelude::f16::from_ne_bytes([b[0], b[1]]).to_f32();
            }
        }
        SampleType::U32 => {
            for (o, b) in out.iter_mut().zip(bytes.chunks_exact(4)) {
                *o = u32::from_ne_bytes([b[0], b[1], b[2], b[3]]) as f32;
            }
        }
    }
}

/// Damaged files must end in a sentence: a panic inside a codec becomes an error here.
fn guarded<T>(path: &Path, body: impl FnOnce() -> Result<T>) -> Result<T> {
    guard::guarded(body).unwrap_or_else(|| Err(Error::input(path, "not a readable OpenEXR file (damaged)")))
}

fn broken(path: &Path, e: &exr::error::Error) -> Error {
    let what = match e {
        exr::error::Error::Io(io) => atomic::explain(io),
        exr::error::Error::NotSupported(what) => format!("an OpenEXR feature that is not supported: {what}"),
        exr::error::Error::Invalid(what) => format!("not a readable OpenEXR file ({what})"),
        exr::error::Error::Aborted => "reading was aborted".into(),
    };
    Error::input(path, what)
}

/// Writes float channels, whole or not at all.
pub fn write_exr(path: &Path, maps: &ChannelMaps, packing: Packing) -> Result<()> {
    let samples = |s: &[f32]| match packing {
        Packing::Half => FlatSamples::F16(s.iter().map(|v| exr::prelude::f16::from_f32(*v)).collect()),
        Packing::Raw | Packing::Zip => FlatSamples::F32(s.to_vec()),
    };
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> =
        maps.channels.iter().map(|(n, s)| AnyChannel::new(n.as_str(), samples(s))).collect();
    let encoding = Encoding {
        compression: match packing {
            Packing::Raw => exr::prelude::Compression::Uncompressed,
            Packing::Zip | Packing::Half => exr::prelude::Compression::ZIP16,
        },
        blocks: exr::prelude::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer =
        Layer::new((maps.width, maps.height), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    let image = Image::from_layer(layer);
    let mut pending = PendingFile::create(path)?;
    image.write().non_parallel().to_buffered(&mut pending).map_err(|e| match e {
        exr::error::Error::Io(io) => Error::write(path, atomic::explain(&io)),
        other => Error::write(path, other),
    })?;
    pending.finish()
}

/// Writes an 8-bit RGB or RGBA PNG (3 or 4 bytes a pixel), whole or not at all.
pub fn write_png(path: &Path, width: usize, height: usize, pixels: &[u8]) -> Result<()> {
    let kind = match pixels.len() / (width * height).max(1) {
        1 => image::ExtendedColorType::L8,
        3 => image::ExtendedColorType::Rgb8,
        _ => image::ExtendedColorType::Rgba8,
    };
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    image::ImageEncoder::write_image(encoder, pixels, width as u32, height as u32, kind)
        .map_err(|e| Error::write(path, e))?;
    atomic::write(path, |w: &mut dyn Write| w.write_all(&bytes))
}

/// Width, height and RGBA of a PNG, row 0 on top.
///
/// # Errors
/// [`Error::Input`] where it cannot be read.
pub fn read_png(path: &Path) -> Result<(usize, usize, Vec<[u8; 4]>)> {
    let bytes = whole_file::bytes(path, whole_file::MOST_DATA)?;
    let decoded = image::codecs::png::PngDecoder::new(std::io::Cursor::new(&bytes))
        .and_then(image::DynamicImage::from_decoder)
        .map_err(|e| Error::input(path, format!("not a readable PNG ({e})")))?
        .to_rgba8();
    let (w, h) = decoded.dimensions();
    Ok((w as usize, h as usize, decoded.pixels().map(|p| p.0).collect()))
}

/// Linear [0, 1] → 8-bit sRGB (IEC 61966-2-1); out-of-range values are clipped, NaN is black.
pub fn to_srgb8(linear: f32) -> u8 {
    let v = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0) };
    let s = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0 + 0.5) as u8
}

/// 8-bit sRGB → linear, 0 to 1 (IEC 61966-2-1).
pub fn from_srgb8(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests;
