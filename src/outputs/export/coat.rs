//! The material of a sheet in a target's numbers, what is lost with it, and its textures.

use crate::Result;
use crate::foreign::loss::{SideLoss, loss};
use crate::foreign::target::{ExportTarget, TargetCoder, TargetSide};
use crate::foreign::texel::ExportTexelSide;
use crate::scene::{ExportScene, ExportSheet};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_optics::side::{Side, Sides};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A sheet in a target's numbers.
#[derive(Debug, Clone)]
pub struct ExportCoat<'a> {
    /// The sheet.
    pub sheet: &'a ExportSheet,
    /// Who found the numbers.
    pub coder: TargetCoder,
    /// The numbers of each texel, in the front's columns.
    pub coded: Vec<Sides<TargetSide>>,
    /// What is lost.
    pub loss: Sides<SideLoss>,
    /// Whether it has two sides that scatter light; wood has one.
    pub leaf: bool,
}

impl<'a> ExportCoat<'a> {
    /// Finds the numbers.
    pub fn new(sheet: &'a ExportSheet, target: ExportTarget) -> ExportCoat<'a> {
        let (mut slopes, mut most) = ([f64::INFINITY, 0f64], 0f64);
        for part in sheet.texels.iter().flat_map(|t| Side::ALL.map(|s| &t.sides[s])) {
            let gloss = part.rho_s.iter().copied().fold(0.0, f64::max);
            if gloss > 0.0 {
                slopes = [slopes[0].min(part.m), slopes[1].max(part.m)];
                most = most.max(gloss);
            }
        }
        let coder = TargetCoder::new(target, sheet.lobe(), slopes, most);
        let coded = sheet.texels.iter().map(|t| coder.encode(t)).collect();
        let measured: Vec<_> = sheet.good.iter().map(|k| sheet.texels[*k]).collect();
        let lit = |p: &ExportTexelSide| [p.rho_d, p.rho_t, p.rho_s].iter().flatten().any(|v| *v > 0.0);
        let leaf = sheet.texels.iter().any(|t| lit(&t.sides.back));
        ExportCoat { sheet, loss: loss(&measured, &coder), coder, coded, leaf }
    }

    /// The largest value of a number over texels and sides.
    pub fn most(&self, of: impl Fn(&TargetSide) -> [f64; 3]) -> f64 {
        self.coded.iter().flat_map(|c| [of(&c.front), of(&c.back)]).flatten().fold(0.0, f64::max)
    }
}

/// The coats of everything that is shown.
pub fn coats(shown: &ExportScene, target: ExportTarget) -> Vec<ExportCoat<'_>> {
    shown.sheets.iter().map(|sheet| ExportCoat::new(sheet, target)).collect()
}

/// What an export loses, as it is recorded.
#[derive(Debug, Clone)]
pub struct ExportLoss {
    record: Value,
    lines: Vec<String>,
}

impl ExportLoss {
    /// Of these coats. `unsaid` are sentences about what the target cannot hold at all.
    pub fn new(format: &str, coats: &[ExportCoat], unsaid: &[String]) -> ExportLoss {
        let mut lines = Vec::new();
        let leaves = coats.iter().map(|coat| {
            let mut one = json!({"name": coat.sheet.name, "texels": coat.sheet.good.len()});
            for side in Side::ALL.into_iter().filter(|s| *s == Side::Front || coat.leaf) {
                one[side.name()] = record(&coat.loss[side]);
                lines.push(line(&coat.sheet.name, side, &coat.loss[side]));
            }
            one
        });
        let leaves: Vec<Value> = leaves.collect();
        if !coats.is_empty() {
            lines.push("docs/export.md says what these errors mean, and docs/evidence/export.md where they lie".into());
        }
        lines.extend(unsaid.iter().map(|what| format!("left out: {what}")));
        let record = json!({
            "target": format,
            "meaning": "rms: relative root mean square error of BRDF and BTDF over both hemispheres, weighted with \
                        both cosines; albedo_error: theirs less ours for red, green and blue (docs/export.md)",
            "surfaces": leaves,
            "left_out": unsaid,
        });
        ExportLoss { record, lines }
    }

    /// Of a target that holds something else than coats: `surfaces` are its records, whose keys `meaning` explains.
    pub fn other(
        format: &str,
        meaning: &str,
        surfaces: Vec<Value>,
        mut lines: Vec<String>,
        unsaid: &[String],
    ) -> ExportLoss {
        lines.extend(unsaid.iter().map(|what| format!("left out: {what}")));
        let record = json!({"target": format, "meaning": meaning, "surfaces": surfaces, "left_out": unsaid});
        ExportLoss { record, lines }
    }

    /// The record.
    pub fn json(&self) -> &Value {
        &self.record
    }

    /// A line for each side of a leaf, and for everything that is left out.
    pub fn lines(&self) -> &[String] {
        &self.lines
    }

    /// Writes the record.
    ///
    /// # Errors
    /// [`crate::Error::Write`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut text = serde_json::to_vec_pretty(&self.record).map_err(|e| crate::Error::write(path, e))?;
        text.push(b'\n');
        mesophyll_files::atomic::write_bytes(path, &text)
    }
}

fn record(s: &SideLoss) -> Value {
    json!({
        "brdf_rms": s.rms[0], "btdf_rms": s.rms[1],
        "albedo": {"reflected": s.ours[0], "transmitted": s.ours[1]},
        "albedo_error": {"reflected": s.albedo[0], "transmitted": s.albedo[1]},
    })
}

fn line(name: &str, side: Side, s: &SideLoss) -> String {
    let share = |rms: Option<f64>| rms.map_or("none".into(), |e| format!("{:.2} %", 100.0 * e));
    let three = |c: [f64; 3]| c.map(|v| format!("{v:+.4}")).join(" ");
    format!(
        "{name}, {}: BRDF error {}, BTDF error {} (relative RMS); albedo error, reflected {}, transmitted {}",
        side.name(),
        share(s.rms[0]),
        share(s.rms[1]),
        three(s.albedo[0]),
        three(s.albedo[1])
    )
}

/// The value of a texture: the same everywhere, or a picture.
#[derive(Debug, Clone, PartialEq)]
pub enum TexturePaint {
    /// The same everywhere.
    Flat([f64; 3]),
    /// A linear float OpenEXR, relative to the exported folder.
    File(String),
}

/// Writes the textures of an export.
#[derive(Debug)]
pub struct TextureWriter {
    folder: PathBuf,
    /// Every file that was written.
    pub written: Vec<PathBuf>,
}

impl TextureWriter {
    /// Into `FOLDER/textures`.
    pub fn new(folder: &Path) -> TextureWriter {
        TextureWriter { folder: folder.to_path_buf(), written: Vec::new() }
    }

    /// A colour for each texel of a sheet.
    ///
    /// # Errors
    /// [`crate::Error::Write`].
    pub fn colour(&mut self, sheet: &ExportSheet, what: &str, of: impl Fn(usize) -> [f64; 3]) -> Result<TexturePaint> {
        let count = sheet.texels.len();
        let first = of(0);
        if (1..count).all(|k| of(k) == first) {
            return Ok(TexturePaint::Flat(first));
        }
        self.picture(&format!("{}_{what}", sheet.name), sheet.size, |k| of(k).map(|v| v as f32))
    }

    /// A picture of three channels.
    ///
    /// # Errors
    /// [`crate::Error::Write`].
    pub fn picture(&mut self, name: &str, size: [usize; 2], of: impl Fn(usize) -> [f32; 3]) -> Result<TexturePaint> {
        let mut maps = ChannelMaps::new(size[0], size[1]);
        let texels: Vec<[f32; 3]> = (0..size[0] * size[1]).map(of).collect();
        for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
            maps.push(channel, texels.iter().map(|t| t[c]).collect());
        }
        let file = format!("textures/{name}.exr");
        let path = self.folder.join(&file);
        write_exr(&path, &maps, Packing::Zip)?;
        self.written.push(path);
        Ok(TexturePaint::File(file))
    }

    /// The mapped normals of a side, (n + 1)/2; `None` where it has none.
    ///
    /// # Errors
    /// [`crate::Error::Write`].
    pub fn normals(&mut self, sheet: &ExportSheet, side: Side) -> Result<Option<TexturePaint>> {
        let Some(normals) = &sheet.normals[side] else { return Ok(None) };
        let name = format!("{}_{}_normal", sheet.name, side.name());
        self.picture(&name, sheet.size, |k| normals[k].map(|v| 0.5 * (v + 1.0))).map(Some)
    }
}
