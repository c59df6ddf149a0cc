//! Fits in formats that other programs read. Values are written as fitted; what a format cannot express is written in a
//! file beside it.

#![warn(missing_docs)]

mod blade;
mod blender;
mod bsdf;
pub mod coat;
pub mod dress;
pub mod foreign;
mod gltf;
mod instanced;
mod materialx;
mod mitsuba;
mod obj;
mod packing;
mod pbrt;
mod ply;
pub mod scene;
mod side;
mod sigma;
pub mod sky;
mod table;
mod texture;
mod usd;

use coat::ExportLoss;
use mesophyll_files::atomic;
use mesophyll_files::claim::{self, OutputKind};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_fits::leaf_folder::LeafFitFile;
use mesophyll_fits::record::{FitKind, FitRecord, FitTimes};
use serde_json::json;
use side::ExportSideMaps;
use sky::SkyExportOptions;
use std::path::{Path, PathBuf};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// What a fit can be written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum ExportFormat {
    /// A folder of 8-bit maps: rho_d, rho_t and rho_s as sRGB, the rest linear; ranges.json says what a byte means
    Png,
    /// One float OpenEXR with every map of both sides and its standard error
    Exr,
    /// A row a texel: place, mask, every map and its standard error
    Csv,
    /// Parameters with errors, statistics and run times, not the maps; of a sky also the arrays and how to evaluate
    /// them
    Json,
    /// The blade as binary glTF (.glb) in metres, matte colour and gloss: opaque, no light comes through it
    #[strum(to_string = "gltf", serialize = "glb")]
    Gltf,
    /// As gltf, with light shining through (rho_t), for readers of KHR_materials_diffuse_transmission; a scene as a
    /// whole, with camera and sun
    GltfTranslucent,
    /// A folder with a scene for Mitsuba 3: scene.xml, meshes and textures, of a leaf or of a whole scene
    Mitsuba,
    /// A folder with a leaf or a whole scene for pbrt-v4: scene.pbrt, meshes and textures
    Pbrt,
    /// A folder with a leaf or a whole scene as OpenUSD text with UsdPreviewSurface: scene.usda and textures
    Usd,
    /// A folder with a leaf or a whole scene for Blender: scene.py, a script that builds the scene, and what it reads
    Blender,
    /// A folder with the materials alone, as MaterialX with OpenPBR: leaf.mtlx
    #[strum(to_string = "materialx", serialize = "mtlx")]
    Materialx,
    /// A folder with the gloss of each side as a measured material (.bsdf, RGL's tensors), the mean over the leaf
    Bsdf,
    /// A folder of float OpenEXR textures for renderers that follow light inside a leaf: sigma_a and sigma_s in 1/m and
    /// the thickness in m, a side
    Sigma,
    /// The blade as Wavefront OBJ in mm with normals, a material library and pictures beside it
    Obj,
    /// A folder of float OpenEXR textures for a renderer, a side: gamma and delta, rho_s and m, normals in the blade's
    /// tangent frame
    Packed,
    /// Of a scene: a folder with its plants at rest as meshes, and textures of the pivot, axis, length and parent of
    /// every branch and leaf, for the foliage materials of game engines
    Pivots,
    /// A leaf or a whole scene as one file for the viewer in a browser (docs/web.md): whatever the window shows, with
    /// the reference pictures of a check
    Web,
    /// A sky as functions for shaders of WebGPU: radiance, irradiance, the sky itself, the sun and its disk
    Wgsl,
    /// The same for shaders of OpenGL and Vulkan
    Glsl,
    /// The same for shaders of Direct3D
    Hlsl,
    /// The same as a C header, float or double
    C,
}

impl ExportFormat {
    /// The format's name on the command line.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether it writes a folder.
    pub fn is_folder(self) -> bool {
        matches!(self, ExportFormat::Png | ExportFormat::Packed | ExportFormat::Pivots | ExportFormat::Sigma)
            || self.is_assembly()
    }

    /// Whether it is a folder with a scene for another renderer.
    pub fn is_assembly(self) -> bool {
        matches!(
            self,
            ExportFormat::Mitsuba
                | ExportFormat::Pbrt
                | ExportFormat::Usd
                | ExportFormat::Blender
                | ExportFormat::Materialx
                | ExportFormat::Bsdf
        )
    }

    /// Whether it is the text of a sky's functions.
    pub fn is_source(self) -> bool {
        matches!(self, ExportFormat::Wgsl | ExportFormat::Glsl | ExportFormat::Hlsl | ExportFormat::C)
    }

    /// Whether a scene can be written so, with everything that stands in it.
    pub fn holds_scenes(self) -> bool {
        self.is_assembly() || self == ExportFormat::GltfTranslucent
    }

    /// Whether it shows a scene with everything that stands in it, to other programs or to our own viewer.
    pub fn is_whole_scene(self) -> bool {
        self.holds_scenes() || self == ExportFormat::Web
    }

    /// Whether anything of a scene can be written so.
    pub fn takes_scenes(self) -> bool {
        self.is_whole_scene() || matches!(self, ExportFormat::Gltf | ExportFormat::Pivots)
    }

    /// Endings of the files that this format writes.
    pub fn endings(self) -> &'static [&'static str] {
        match self {
            ExportFormat::Png => &["png", "json"],
            ExportFormat::Exr | ExportFormat::Packed => &["exr"],
            ExportFormat::Pivots => &["exr", "glb", "json"],
            ExportFormat::Csv => &["csv"],
            ExportFormat::Json => &["json"],
            ExportFormat::Gltf | ExportFormat::GltfTranslucent => &["glb", "gltf"],
            ExportFormat::Bsdf => &["bsdf", "json"],
            ExportFormat::Sigma => &["exr", "json"],
            ExportFormat::Obj => &["obj"],
            ExportFormat::Mitsuba => &["xml", "ply", "exr", "json"],
            ExportFormat::Pbrt => &["pbrt", "ply", "exr", "json"],
            ExportFormat::Usd => &["usda", "exr", "json"],
            ExportFormat::Blender => &["py", "glb", "exr", "json"],
            ExportFormat::Materialx => &["mtlx", "exr", "json"],
            ExportFormat::Web => &["mesophyll"],
            ExportFormat::Wgsl => &["wgsl"],
            ExportFormat::Glsl => &["glsl"],
            ExportFormat::Hlsl => &["hlsl"],
            ExportFormat::C => &["h"],
        }
    }
}

/// What was written.
#[derive(Debug, Default)]
pub struct ExportResult {
    /// Every file.
    pub files: Vec<PathBuf>,
    /// What the format cannot hold, where it is a material.
    pub lost: Option<ExportLoss>,
}

impl From<Vec<PathBuf>> for ExportResult {
    fn from(files: Vec<PathBuf>) -> Self {
        ExportResult { files, lost: None }
    }
}

/// The largest number of places that a format has where a plant is not held once.
const MOST_PLACES: usize = 8_000_000;

/// Writes what is shown as `format`, with its loss beside it: in a folder as `loss.json`, beside a file as
/// `FILE.loss.json`. `scene` says whether it is a whole scene.
///
/// # Errors
/// [`Error::Usage`] for a folder or file that holds something else; [`Error::Write`].
pub fn assemble(
    shown: &scene::ExportScene,
    format: ExportFormat,
    path: &Path,
    scene: bool,
    inputs: &[&Path],
) -> Result<ExportResult> {
    let most = match format {
        ExportFormat::Usd | ExportFormat::GltfTranslucent => usize::MAX,
        _ => MOST_PLACES,
    };
    if shown.place_count() > most {
        let found = format!("found {} leaves and pieces of wood at places of their own", shown.place_count());
        let expected = format!("expected at most {most}; --to usd and gltf-translucent hold a plant once");
        return Err(Error::Usage(format!("--to {}: {found}, {expected}", format.name())));
    }
    if !format.is_assembly() {
        let kind = match (format, scene) {
            (_, true) => gltf::GltfPurpose::Scene,
            (ExportFormat::Gltf, false) => gltf::GltfPurpose::Opaque,
            _ => gltf::GltfPurpose::Translucent,
        };
        let record = record_of_loss(path)?;
        let lost = gltf::write(shown, path, kind)?;
        return beside(record, vec![path.to_path_buf()], lost);
    }
    let _claim = claim::folder(path, OutputKind::Export, inputs)?;
    claim::begin(path, OutputKind::Export)?;
    let write = match format {
        ExportFormat::Pbrt => pbrt::write,
        ExportFormat::Usd => usd::write,
        ExportFormat::Blender => blender::write,
        ExportFormat::Materialx => materialx::write,
        ExportFormat::Bsdf => bsdf::write,
        _ => mitsuba::write,
    };
    let (mut files, lost) = write(shown, path)?;
    files.push(path.join("loss.json"));
    lost.write(&path.join("loss.json"))?;
    claim::finish(path)?;
    Ok(ExportResult { files, lost: Some(lost) })
}

/// The place of a file's loss, `FILE.loss.json`; refused where something else has that name.
fn record_of_loss(path: &Path) -> Result<PathBuf> {
    let mut name = path.as_os_str().to_owned();
    name.push(".loss.json");
    let record = PathBuf::from(name);
    claim::file(&record, &["json"], &[])?;
    let ours = |text: String| serde_json::from_str::<serde_json::Value>(&text).is_ok_and(|v| v["target"].is_string());
    if record.exists() && !std::fs::read_to_string(&record).is_ok_and(ours) {
        let what = "found something else, expected a free name or the loss of an earlier export";
        return Err(Error::Usage(format!("{}: {what}", record.display())));
    }
    Ok(record)
}

/// Writes a scene's plants with `write`, and beside them what they lack, each a sentence of `unsaid`. A folder's loss
/// lies in it.
///
/// # Errors
/// [`Error::Usage`] where something else has the name of the record; what `write` refuses; [`Error::Write`].
pub fn plants(
    format: ExportFormat,
    path: &Path,
    unsaid: &[String],
    write: impl FnOnce() -> Result<Vec<PathBuf>>,
) -> Result<ExportResult> {
    let record = if format.is_folder() { path.join("loss.json") } else { record_of_loss(path)? };
    let meaning = "left_out: what of the scene the file does not hold (docs/motion.md)";
    beside(record, write()?, ExportLoss::other(format.name(), meaning, Vec::new(), Vec::new(), unsaid))
}

/// Writes the loss of a file beside it.
fn beside(record: PathBuf, mut files: Vec<PathBuf>, lost: ExportLoss) -> Result<ExportResult> {
    lost.write(&record)?;
    files.push(record);
    Ok(ExportResult { files, lost: Some(lost) })
}

/// Writes the fit in `folder` as `format` to `path`; returns every file written.
///
/// # Errors
/// [`Error::Input`] when the fit or a map that it needs cannot be read, [`Error::Usage`] when this kind of fit cannot
/// be written in the format, [`Error::Missed`] for a fit that was changed since it was fitted, [`Error::Write`].
pub fn export(folder: &Path, format: ExportFormat, path: &Path, sky: &SkyExportOptions) -> Result<ExportResult> {
    let record = FitRecord::read(folder)?;
    if format == ExportFormat::Pivots {
        let what = format!("{} is a {}; --to pivots is for scenes with plants", folder.display(), record.kind.words());
        return Err(Error::Usage(what));
    }
    if format == ExportFormat::Web {
        return Err(Error::Usage("--to web: the file holds what the renderer draws, so it is made of a scene".into()));
    }
    if record.kind == FitKind::Sky {
        if !format.is_source() && format != ExportFormat::Json {
            let what = format!(
                "{} is a sky fit; it can be exported as wgsl, glsl, hlsl, c or json, not as {}",
                folder.display(),
                format.name()
            );
            return Err(Error::Usage(what));
        }
        atomic::write_bytes(path, sky::text(folder, format, sky)?.as_bytes())?;
        return Ok(vec![path.to_path_buf()].into());
    }
    if format.is_source() || !sky.is_plain() {
        let what = format!(
            "{} is a {}; --to wgsl, glsl, hlsl and c, --sun-zenith-deg, --sun-azimuth-deg, --turbidity and \
             --ground are for sky fits",
            folder.display(),
            record.kind.words()
        );
        return Err(Error::Usage(what));
    }
    if format == ExportFormat::Json {
        record.verify(folder)?;
        atomic::write_bytes(path, &as_json(&record, folder)?)?;
        return Ok(vec![path.to_path_buf()].into());
    }
    if record.kind == FitKind::Look && matches!(format, ExportFormat::Packed | ExportFormat::Sigma) {
        let what = "is stated, not fitted: a picture says nothing of γ, σa and σs, which this format holds";
        return Err(Error::Usage(format!("{}: {what}; expected another format", folder.display())));
    }
    let sides = ExportSideMaps::all(&record, folder)?;
    record.verify(folder)?;
    let alone = || vec![path.to_path_buf()];
    Ok(match format {
        ExportFormat::Json | ExportFormat::Pivots | ExportFormat::Web => Vec::new().into(),
        source if source.is_source() => Vec::new().into(),
        ExportFormat::Png => texture::folder(&sides, folder, path)?.into(),
        ExportFormat::Packed => packing::folder(&sides, folder, path)?.into(),
        ExportFormat::Sigma => sigma::folder(&sides, folder, path)?,
        ExportFormat::Exr => one_exr(&sides, folder, path).map(|()| alone())?.into(),
        ExportFormat::Csv => table::write(&sides, &record, path).map(|()| alone())?.into(),
        ExportFormat::Obj => {
            let loss = record_of_loss(path)?;
            let files = obj::write(&sides, &record, folder, path)?;
            let shown = scene::ExportScene::of_fit(folder, &sides)?;
            let mut unsaid = vec![
                "transmitted light".to_string(),
                "its gloss is Phong's, which readers scale differently: the errors are those of its matte colour alone"
                    .to_string(),
            ];
            unsaid.extend(shown.left_out.iter().cloned());
            let coats = coat::coats(&shown, crate::foreign::target::ExportTarget::Obj);
            beside(loss, files, ExportLoss::new("obj", &coats, &unsaid))?
        }
        _ => assemble(&scene::ExportScene::of_fit(folder, &sides)?, format, path, false, &[folder])?,
    })
}

/// The record as it is, and the times; numbers that are not finite become `null`.
fn as_json(record: &FitRecord, folder: &Path) -> Result<Vec<u8>> {
    let times = FitTimes::read(folder).ok();
    let mut text = serde_json::to_vec_pretty(&json!({"fit": record, "times": times}))
        .map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))?;
    text.push(b'\n');
    Ok(text)
}

/// `front.rho_d.R` and, for its standard error, `front.err.rho_d.R`.
fn one_exr(sides: &[ExportSideMaps], folder: &Path, path: &Path) -> Result<()> {
    let (width, height) = (sides[0].maps.width, sides[0].maps.height);
    let mut all = ChannelMaps::new(width, height);
    for side in sides {
        let own = side.side.name();
        side.maps.require_size(&LeafFitFile::Maps.path(folder, side.side), width, height)?;
        for (name, samples) in &side.maps.channels {
            all.push(format!("{own}.{name}"), samples.clone());
        }
        for (name, samples) in side.errors.iter().flat_map(|m| &m.channels) {
            all.push(format!("{own}.err.{name}"), samples.clone());
        }
    }
    write_exr(path, &all, Packing::Zip)
}

pub(crate) use mesophyll_base::error::{Error, Result};
