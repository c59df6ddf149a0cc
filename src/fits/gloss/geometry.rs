//! `GEOMETRY.toml` of `fit gloss` and `eval gloss`: the device over one texel in the middle of the blade.

use super::GlossFitDevice;
use crate::record::read_toml;
use crate::{Error, Result};
use mesophyll_base::error::TomlKind;
use mesophyll_files::table::InputTable;
use mesophyll_optics::gloss::Lobe;
use serde::Deserialize;
use std::path::Path;

/// The file's fields; unknown ones are errors. Lengths in mm; `u` = (x_light − x_texel)/height, a frame each.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlossGeometry {
    /// Height of the tube's axis over the blade.
    pub height_mm: f64,
    /// Lit length of the tube, centred on the blade.
    pub tube_length_mm: f64,
    /// 0 is a thin tube.
    pub tube_radius_mm: f64,
    /// View direction (sin, 0, cos).
    pub camera_deg: f64,
    /// Position u of the tube in the first frame. First and last frame are both included.
    #[serde(default)]
    pub u_start: Option<f64>,
    /// Position of the tube in the last frame.
    #[serde(default)]
    pub u_end: Option<f64>,
    /// How many frames there are, evenly from `u_start` to `u_end`.
    #[serde(default)]
    pub frames: Option<usize>,
    /// Instead of `u_start`, `u_end` and `frames`: the position u of every frame.
    #[serde(default)]
    pub u: Option<Vec<f64>>,
    /// The part of the noise that grows with the value: the standard deviation is √((noise_relative·value)² +
    /// noise_floor²).
    pub noise_relative: f64,
    /// The part of the noise that does not grow with the value.
    pub noise_floor: f64,
}

impl GlossGeometry {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<GlossGeometry> {
        let geometry: GlossGeometry = read_toml(path)?;
        geometry.check(path)?;
        Ok(geometry)
    }

    /// The same from the text of such a file; `name` stands for the file in messages.
    ///
    /// # Errors
    /// As [`GlossGeometry::read`].
    pub fn from_text(text: &str, name: &Path) -> Result<GlossGeometry> {
        let geometry: GlossGeometry =
            toml::from_str(text).map_err(|e| Error::toml_of(TomlKind::LightSource, name, text, &e))?;
        geometry.check(name)?;
        Ok(geometry)
    }

    fn check(&self, path: &Path) -> Result<()> {
        let bad = |field: &str, found: &dyn std::fmt::Display, expected: &str| {
            Err(Error::field(path, field, format!("found {found}, expected {expected}")))
        };
        for (field, value) in [("height_mm", self.height_mm), ("tube_length_mm", self.tube_length_mm)] {
            if !(value > 0.0 && value.is_finite()) {
                return bad(field, &value, "a positive length in mm");
            }
        }
        if !(self.tube_radius_mm >= 0.0 && self.tube_radius_mm < self.height_mm) {
            return bad("tube_radius_mm", &self.tube_radius_mm, "zero or more, and less than height_mm");
        }
        if !(-85.0..=85.0).contains(&self.camera_deg) {
            return bad("camera_deg", &self.camera_deg, "-85 to 85 degrees");
        }
        for (field, value) in [("noise_relative", self.noise_relative), ("noise_floor", self.noise_floor)] {
            if !(value >= 0.0 && value.is_finite()) {
                return bad(field, &value, "zero or a positive number");
            }
        }
        if self.noise_relative == 0.0 && self.noise_floor == 0.0 {
            return bad(
                "noise_floor",
                &0,
                "some noise: noise_relative and noise_floor are both zero, so no error could be told",
            );
        }
        match (&self.u, self.u_start, self.u_end, self.frames) {
            (Some(_), None, None, None) | (None, Some(_), Some(_), Some(_)) => {}
            _ => return Err(Error::field(path, "u", "expected either u = [...] or all of u_start, u_end and frames")),
        }
        // A number that is much too large would ask for all the memory there is.
        let count = self.u.as_ref().map_or(self.frames.unwrap_or(0), Vec::len);
        if !(1..=10_000).contains(&count) {
            return bad(if self.u.is_some() { "u" } else { "frames" }, &count, "1 to 10000 frames");
        }
        if let Some(wrong) = self.frames_u().iter().find(|u| !u.is_finite() || u.abs() > 1e4) {
            return bad(
                if self.u.is_some() { "u" } else { "u_start" },
                wrong,
                "finite positions within ±10000 heights",
            );
        }
        Ok(())
    }

    /// u of every frame.
    pub fn frames_u(&self) -> Vec<f64> {
        if let Some(list) = &self.u {
            return list.clone();
        }
        let (a, b, n) = (self.u_start.unwrap_or(0.0), self.u_end.unwrap_or(0.0), self.frames.unwrap_or(0));
        if n == 1 {
            return vec![a];
        }
        (0..n).map(|k| a + (b - a) * k as f64 / (n as f64 - 1.0)).collect()
    }

    /// Tube positions (mm) over a texel at the origin.
    pub fn positions_mm(&self) -> Vec<f64> {
        self.frames_u().into_iter().map(|u| u * self.height_mm).collect()
    }

    /// The device of this geometry, for texels with that lobe.
    pub fn device(&self, lobe: Lobe) -> GlossFitDevice {
        let camera = self.camera_deg.to_radians();
        GlossFitDevice {
            height_mm: self.height_mm,
            length_mm: self.tube_length_mm,
            radius_mm: self.tube_radius_mm,
            camera: [camera.sin(), 0.0, camera.cos()],
            lobe,
            noise_relative: self.noise_relative,
            noise_floor: self.noise_floor,
        }
    }
}

/// The columns of a trace: `r0 … r{n−1}`, or `r…, g…, b…`, in the order of channels; one list for each channel.
///
/// # Errors
/// [`Error::Input`] where a channel does not have exactly one column a frame.
pub fn trace_columns(table: &InputTable, frames: usize) -> Result<Vec<Vec<String>>> {
    let count = |channel: char| {
        let numbered = |h: &String| {
            h.strip_prefix(channel).is_some_and(|k| !k.is_empty() && k.bytes().all(|b| b.is_ascii_digit()))
        };
        table.header.iter().filter(|h| numbered(h)).count()
    };
    let channels: &[char] = if count('g') + count('b') > 0 { &['r', 'g', 'b'] } else { &['r'] };
    let mut lists = Vec::new();
    for &channel in channels {
        let found = count(channel);
        if found != frames {
            return Err(Error::field(
                table.name(),
                &format!("{channel}0 …"),
                format!("the header has {found} trace columns of this channel, the geometry has {frames} frames"),
            ));
        }
        let names: Vec<String> = (0..frames).map(|k| format!("{channel}{k}")).collect();
        for name in &names {
            table.require(name)?;
        }
        lists.push(names);
    }
    Ok(lists)
}
