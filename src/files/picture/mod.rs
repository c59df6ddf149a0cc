//! Linear pictures of other programs: panoramas of skies and developed photographs, as OpenEXR or Radiance. What they
//! hold is brought to one form: the whole picture, in linear sRGB.
//!
//! - Of an OpenEXR file of several parts or layers, the one with the colours is found.
//! - A picture that is stored in part (its data window lies inside its display window) is padded.
//! - Colours whose chromaticities the file states are changed to linear sRGB.
//! - Readings that are no radiance are clamped where they are few, and counted.

mod primaries;
mod radiance;
#[cfg(test)]
mod tests;

pub use crate::quantity::RGB;

use crate::image::{ChannelMaps, ExrPart, exr_parts, read_exr_part};
use crate::{Error, Result, memory, progress};
use glam::DVec3;
use primaries::Primaries;
use std::path::Path;

/// A picture, and what was done to it.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearPicture {
    /// The channels that were asked for first, under the names that they were asked for by.
    pub maps: ChannelMaps,
    /// What was found and changed, a sentence each.
    pub said: Vec<String>,
}

/// What is read of a picture.
#[derive(Debug, Clone, Copy)]
pub struct PictureRequest<'a> {
    /// Channels that must be there. If these are [`RGB`], colours are changed to linear sRGB.
    pub names: &'a [&'a str],
    /// Whether the other channels beside them are read too.
    pub all: bool,
    /// The value of pixels that the file leaves out because they lie outside of its data window.
    pub outside: f32,
}

/// Reads an OpenEXR or a Radiance file. `fits` judges columns and rows before anything large is read.
///
/// # Errors
/// [`Error::Input`] that names the file, and the channel that is missing, or why it cannot be told which of several
/// parts or layers is meant; the error of `fits`; [`Error::Usage`] where memory is short.
pub fn read(
    path: &Path,
    request: &PictureRequest,
    fits: impl FnOnce(usize, usize) -> Result<()>,
) -> Result<LinearPicture> {
    if radiance::is(path)? {
        if let Some(name) = request.names.iter().find(|n| !RGB.contains(n)) {
            return Err(Error::field(path, name, "no such channel; a Radiance picture holds R, G, B"));
        }
        return radiance::read(path, fits);
    }
    let parts = exr_parts(path)?;
    let found = find(path, &parts, request.names)?;
    let part = &parts[found.part];
    let [width, height] = part.display;
    fits(width, height)?;
    let mut said: Vec<String> = found.told(&parts).into_iter().collect();
    let (read, names) = found.channels(&part.info.channels, request);
    let read: Vec<&str> = read.iter().map(String::as_str).collect();
    let inner = read_exr_part(path, found.part, Some(&read), None)?;
    let mut maps = whole(path, part, inner, request.outside, &mut said)?;
    maps.channels.iter_mut().zip(names).for_each(|(channel, name)| channel.0 = name);
    if request.names == RGB {
        recolour(path, &mut maps, part.chromaticities.as_ref(), &mut said)?;
    }
    Ok(LinearPicture { maps, said })
}

/// Says what was done to a picture.
pub fn tell(path: &Path, said: &[String]) {
    said.iter().for_each(|what| progress::say(format_args!("{}: {what}", path.display())));
}

/// The part and the layer that hold the channels.
struct Found {
    part: usize,
    /// What the names of its channels begin with: empty, or the layer and a full stop.
    layer: String,
    /// The file's names of the channels that were asked for.
    names: Vec<String>,
}

impl Found {
    /// Which part and layer it is; `None` for plain channels of the first part.
    fn told(&self, parts: &[ExrPart]) -> Option<String> {
        let part = (self.part > 0).then(|| match &parts[self.part].name {
            Some(name) => format!("part {} ({name:?})", self.part + 1),
            None => format!("part {}", self.part + 1),
        });
        let layer = (!self.layer.is_empty()).then(|| format!("layer {:?}", self.layer.trim_end_matches('.')));
        let place: Vec<String> = layer.into_iter().chain(part).collect();
        (!place.is_empty()).then(|| format!("{} are those of {}", self.names.join(", "), place.join(" of ")))
    }

    /// The file's names of all channels that are read, and the names they get.
    fn channels(&self, there: &[String], request: &PictureRequest) -> (Vec<String>, Vec<String>) {
        let asked = self.names.iter().cloned().zip(request.names.iter().map(ToString::to_string));
        let beside = there.iter().filter(|name| request.all && !self.names.contains(name));
        let beside = beside.map(|n| (n.clone(), n.strip_prefix(&self.layer).unwrap_or(n).to_string()));
        asked.chain(beside).unzip()
    }
}

/// Finds the channels: plain ones of the first part that has them all, or those of the only layer that has them.
fn find(path: &Path, parts: &[ExrPart], names: &[&str]) -> Result<Found> {
    let mut all = Vec::new();
    for (part, of) in parts.iter().enumerate() {
        let there = &of.info.channels;
        let mut layers: Vec<&str> = there.iter().filter_map(|c| Some(&c[..=c.rfind('.')?])).collect();
        layers.dedup();
        for layer in std::iter::once("").chain(layers) {
            let own = |name: &&str| {
                let wanted = format!("{layer}{name}");
                there.iter().find(|c| **c == wanted).or_else(|| there.iter().find(|c| c.eq_ignore_ascii_case(&wanted)))
            };
            if let Some(names) = names.iter().map(own).map(|n| n.cloned()).collect::<Option<Vec<_>>>() {
                all.push(Found { part, layer: layer.to_string(), names });
            }
        }
    }
    let plain = all.iter().position(|f| f.layer.is_empty());
    if let Some(k) = plain.or((all.len() == 1).then_some(0)) {
        return Ok(all.swap_remove(k));
    }
    if !all.is_empty() {
        let layers: Vec<String> = all.iter().filter_map(|f| f.told(parts)).collect();
        let what = format!("several layers hold them: {}; expected one (save it alone)", layers.join("; "));
        return Err(Error::field(path, names[0], what));
    }
    let held = |p: &ExrPart| p.info.channels.join(", ");
    let missing = names.iter().find(|n| !parts[0].info.channels.iter().any(|c| c == **n)).unwrap_or(&names[0]);
    let parts: Vec<String> = parts.iter().map(held).collect();
    Err(Error::field(path, missing, format!("no such channel; the file holds {}", parts.join("; in the next part "))))
}

/// The display window of a picture whose data window was read.
fn whole(path: &Path, part: &ExrPart, inner: ChannelMaps, outside: f32, said: &mut Vec<String>) -> Result<ChannelMaps> {
    let [width, height] = part.display;
    if part.offset == [0, 0] && part.display == [inner.width, inner.height] {
        return Ok(inner);
    }
    // The columns or rows of both windows, counted in the display window.
    let shared = |axis: usize, data: usize| {
        let end = (part.offset[axis] + data as i64).min(part.display[axis] as i64);
        (part.offset[axis].max(0), end)
    };
    let [columns, rows] = [shared(0, inner.width), shared(1, inner.height)];
    let [left, top] = part.offset;
    let place = format!("its {} x {} pixels lie at {left}, {top} of {width} x {height}", inner.width, inner.height);
    if columns.0 >= columns.1 || rows.0 >= rows.1 {
        return Err(Error::input(path, format!("{place}, so the picture (display window) is empty")));
    }
    let bytes = (4 * inner.channels.len() as u64).saturating_mul(width as u64).saturating_mul(height as u64);
    memory::require(bytes, &format!("{}: a picture of {width}x{height} pixels", path.display()))?;
    let cut = ((columns.1 - columns.0) as usize, (rows.1 - rows.0) as usize) != (inner.width, inner.height);
    said.push(format!(
        "{place}; what it leaves out is empty{}",
        if cut { ", what lies outside is cut off" } else { "" }
    ));
    let mut maps = ChannelMaps::new(width, height);
    for (name, samples) in inner.channels {
        let mut all = vec![outside; width * height];
        for y in rows.0..rows.1 {
            let from = ((y - top) as usize * inner.width) + (columns.0 - left) as usize;
            let to = y as usize * width + columns.0 as usize;
            let n = (columns.1 - columns.0) as usize;
            all[to..to + n].copy_from_slice(&samples[from..from + n]);
        }
        maps.push(name, all);
    }
    Ok(maps)
}

/// Changes the first three channels to linear sRGB, where the file states other primaries.
fn recolour(path: &Path, maps: &mut ChannelMaps, stated: Option<&Primaries>, said: &mut Vec<String>) -> Result<()> {
    let change = stated.map(primaries::to_srgb).transpose().map_err(|why| Error::input(path, why))?;
    let Some(change) = change.flatten() else { return Ok(()) };
    let [r, g, b, ..] = &mut maps.channels[..] else { return Ok(()) };
    for ((r, g), b) in r.1.iter_mut().zip(&mut g.1).zip(&mut b.1) {
        let colour = change.matrix * DVec3::new(f64::from(*r), f64::from(*g), f64::from(*b));
        [*r, *g, *b] = colour.to_array().map(|v| v as f32);
    }
    said.push(format!("its colours are {} and were changed to linear sRGB", change.from));
    Ok(())
}

/// Of the light in a picture, negative readings may be this share. Compression and other primaries make them.
const NEGATIVE: f64 = 0.01;
/// Of the readings, this share may be no numbers, or infinite: single pixels that a program spoiled. One pixel may
/// always be.
const SPOILT: f64 = 0.01;

/// Makes readings of radiance of all numbers: negative ones become 0, infinite ones the largest finite reading of their
/// channel, and those that are no numbers 0. Returns what was done, if anything was.
///
/// # Errors
/// A sentence where that is no small change: negative readings are more than 1 % of the light, or more than 1 % of the
/// readings are not finite.
pub fn clamp(texels: &mut [[f32; 3]], columns: usize) -> std::result::Result<Option<String>, String> {
    let bad = |v: &f32| !(v.is_finite() && *v >= 0.0);
    let Some(first) = texels.as_flattened().iter().position(bad) else { return Ok(None) };
    let (mut light, mut dark, mut negative, mut spoilt, mut most) = (0.0, 0.0, 0, 0, [0f32; 3]);
    for texel in &*texels {
        for (value, most) in texel.iter().zip(&mut most) {
            match f64::from(*value) {
                v if !v.is_finite() => spoilt += 1,
                v if v < 0.0 => (negative, dark) = (negative + 1, dark - v),
                v => (light, *most) = (light + v, most.max(*value)),
            }
        }
    }
    let (at, count) = (first / 3, 3 * texels.len());
    let place = format!("channel {}, column {}, row {}", RGB[first % 3], at % columns, at / columns);
    let found = format!("{place}: found {}", texels.as_flattened()[first]);
    if dark > NEGATIVE * light {
        return Err(format!(
            "{found}; {negative} of {count} readings are negative, {:.3} % of the light; expected radiance (few and \
             small negative values are clamped)",
            100.0 * dark / light
        ));
    }
    if spoilt as f64 > (SPOILT * count as f64).max(3.0) {
        return Err(format!("{found}; {spoilt} of {count} readings are not finite; expected radiance"));
    }
    for texel in texels.iter_mut() {
        for (value, most) in texel.iter_mut().zip(most) {
            *value = if *value == f32::INFINITY { most } else { value.max(0.0) };
        }
    }
    Ok(Some(format!(
        "of {count} readings {negative} are negative and {spoilt} not finite, the first at {place}; they were clamped"
    )))
}
