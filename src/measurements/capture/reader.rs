//! A capture opened for fitting: before anything long starts, every file that it needs was found and has the right
//! size.

use crate::calibration::FrameGain;
use crate::manifest::{TubeManifest, frame_path, mirror_path, white_path};
use crate::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, ExrInfo, exr_info, read_exr, read_exr_rows};
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The channels of every frame.
pub const RGB: [&str; 3] = ["R", "G", "B"];

/// A validated capture. It holds no frames: they are read in bands of rows.
#[derive(Debug)]
pub struct TubeCapture {
    /// The folder that was read.
    pub folder: PathBuf,
    /// The contents of its `capture.toml`.
    pub manifest: TubeManifest,
    /// Dark level a texel and channel (RGB planes), where `dark.exr` exists.
    dark: Option<FramePixels>,
    /// Gain of each pass's frames, where white frames exist.
    gains: Vec<(Travel, FrameGain)>,
    /// Median of all gains, computed when it is first asked for.
    median_gain: OnceLock<f64>,
}

/// Calibrated frames of one pass over a set of texels: `frames[k][n]` is the k-th frame asked for at the n-th texel
/// asked for.
pub type FrameBand = Vec<Vec<[f32; 3]>>;

/// One RGB triple a texel of the whole image, row-major.
pub type FramePixels = Vec<[f32; 3]>;

impl TubeCapture {
    /// Opens `folder`: reads the manifest, checks that every frame exists with the right size and channels, and loads
    /// the references.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first file that is missing, of another size, or unreadable.
    pub fn open(folder: &Path) -> Result<TubeCapture> {
        let manifest = TubeManifest::read(folder)?;
        let wanted: Vec<PathBuf> = manifest
            .sides
            .iter()
            .flat_map(|&side| {
                manifest.passes.iter().flat_map(move |p| (0..p.positions().len()).map(move |k| (side, p.name, k)))
            })
            .map(|(side, travel, k)| frame_path(folder, side, travel, k))
            .chain(manifest.sides.iter().map(|s| folder.join(s.name()).join("lightbox.exr")))
            .chain([folder.join("lightbox_empty.exr")])
            .collect();
        wanted.par_iter().try_for_each(|path| check_image(path, &manifest))?;
        let dark_path = folder.join("dark.exr");
        let dark = if dark_path.exists() {
            check_image(&dark_path, &manifest)?;
            Some(interleave(&read_exr_rows(&dark_path, Some(&RGB), None)?))
        } else {
            None
        };
        let mut gains = Vec::new();
        for pass in &manifest.passes {
            if folder.join("white").join(pass.name.name()).exists() {
                let gain = FrameGain::read(folder, &manifest, pass, dark.as_deref())?;
                gains.push((pass.name, gain));
            } else if folder.join("white").exists() {
                return Err(Error::input(
                    &white_path(folder, pass.name, 0),
                    "no such file; expected white frames for every pass, or no white folder where frames are \
                     normalised already",
                ));
            }
        }
        Ok(TubeCapture { folder: folder.to_path_buf(), manifest, dark, gains, median_gain: OnceLock::new() })
    }

    /// Content hash of everything that a fit reads. The whole content of the frames is hashed: names, sizes and a
    /// sample of the bytes would miss edits.
    pub fn hash(&self) -> Result<String> {
        let files = self.files();
        let hashes: Vec<String> = files.par_iter().map(|p| hash::file(p)).collect::<Result<_>>()?;
        let names: Vec<String> =
            files.iter().map(|p| p.strip_prefix(&self.folder).unwrap_or(p).to_string_lossy().into_owned()).collect();
        Ok(hash::combine(names.iter().map(String::as_str).zip(hashes.iter().map(String::as_str))))
    }

    /// Every file the fit reads, in a fixed order.
    pub fn files(&self) -> Vec<PathBuf> {
        let m = &self.manifest;
        let mut files = vec![self.folder.join("capture.toml"), self.folder.join("lightbox_empty.exr")];
        for &side in &m.sides {
            files.push(self.folder.join(side.name()).join("lightbox.exr"));
            for pass in &m.passes {
                files.extend((0..pass.positions().len()).map(|k| frame_path(&self.folder, side, pass.name, k)));
            }
        }
        for pass in &m.passes {
            files.extend((0..pass.positions().len()).map(|k| white_path(&self.folder, pass.name, k)));
            files.extend((0..pass.positions().len()).map(|k| mirror_path(&self.folder, pass.name, k)));
        }
        files.extend(["dark.exr", "mask.exr"].map(|n| self.folder.join(n)));
        files.retain(|p| p.exists());
        files
    }

    /// Reads and calibrates these `frames` of one pass in `rows`, at the texels `(column, row)` listed (all inside
    /// `rows`). Values are 1 for a white texel under an infinite tube straight above; NaN where there is no reading.
    pub fn band(
        &self,
        side: Side,
        travel: Travel,
        rows: Range<usize>,
        texels: &[[u32; 2]],
        frames: &[usize],
    ) -> Result<FrameBand> {
        if self.manifest.pass(travel).is_none() {
            return Ok(Vec::new());
        }
        let gain = self.gains.iter().find(|(t, _)| *t == travel).map(|(_, g)| g);
        let width = self.manifest.width;
        let at: Vec<(usize, usize)> = texels
            .iter()
            .map(|t| ((t[1] as usize - rows.start) * width + t[0] as usize, t[1] as usize * width + t[0] as usize))
            .collect();
        frames
            .par_iter()
            .map(|&k| {
                let path = frame_path(&self.folder, side, travel, k);
                let maps = read_exr_rows(&path, Some(&RGB), Some(rows.clone()))?;
                let mut out: Vec<[f32; 3]> =
                    at.iter().map(|&(local, _)| [0, 1, 2].map(|c: usize| maps.channels[c].1[local])).collect();
                if let Some(dark) = &self.dark {
                    for (value, &(_, global)) in out.iter_mut().zip(&at) {
                        for (v, d) in value.iter_mut().zip(dark[global]) {
                            *v -= d;
                        }
                    }
                }
                if let Some(gain) = gain {
                    gain.divide(k, texels, &mut out);
                }
                Ok(out)
            })
            .collect()
    }

    /// Light-box photographs of one side, dark-corrected: (leaf, empty box), interleaved RGB of the whole image.
    pub fn lightbox(&self, side: Side) -> Result<(FramePixels, FramePixels)> {
        Ok((self.dark_corrected(&self.folder.join(side.name()).join("lightbox.exr"))?, self.lightbox_empty()?))
    }

    /// The light box without a leaf, dark-corrected.
    pub fn lightbox_empty(&self) -> Result<FramePixels> {
        self.dark_corrected(&self.folder.join("lightbox_empty.exr"))
    }

    fn dark_corrected(&self, path: &Path) -> Result<FramePixels> {
        let mut image = interleave(&read_exr_rows(path, Some(&RGB), None)?);
        if let Some(dark) = &self.dark {
            for (v, d) in image.iter_mut().zip(dark) {
                for c in 0..3 {
                    v[c] -= d[c];
                }
            }
        }
        Ok(image)
    }

    /// Median camera value of a texel whose calibrated value is 1; it is 1 where frames are already normalised.
    pub fn median_gain(&self) -> f64 {
        *self.median_gain.get_or_init(|| {
            let all = self.gains.iter().flat_map(|(_, g)| g.values()).filter(|v| v.is_finite());
            median_of(all).map_or(1.0, f64::from)
        })
    }

    /// Camera value of the calibrated value 1 at each of `texels`, a channel each: the mean over the passes' white
    /// frames, or 1 where there are none.
    pub fn gain(&self, texels: &[[u32; 2]]) -> Vec<[f64; 3]> {
        let passes: Vec<Vec<[f32; 3]>> = self.gains.iter().map(|(_, g)| g.mean(texels)).collect();
        let mean = |n: usize, c: usize| passes.iter().map(|p| f64::from(p[n][c])).sum::<f64>() / passes.len() as f64;
        let median = self.median_gain();
        let known = |gain: f64| if gain.is_finite() && gain > 0.0 { gain } else { median };
        (0..texels.len()).map(|n| [0, 1, 2].map(|c| if passes.is_empty() { 1.0 } else { known(mean(n, c)) })).collect()
    }

    /// Camera value of the calibrated value 1 in frame `k` of a pass at each of `texels`; `None` where the pass has no
    /// white frames.
    pub fn gain_of_frame(&self, travel: Travel, k: usize, texels: &[[u32; 2]]) -> Option<Vec<[f32; 3]>> {
        self.gains.iter().find(|(t, _)| *t == travel).map(|(_, gain)| gain.at(k, texels))
    }

    /// The dark level a texel, where `dark.exr` exists.
    pub fn dark(&self) -> Option<&[[f32; 3]]> {
        self.dark.as_deref()
    }

    /// `mask.exr` (channel Y), where there is one.
    pub fn mask(&self) -> Result<Option<Vec<bool>>> {
        let path = self.folder.join("mask.exr");
        if !path.exists() {
            return Ok(None);
        }
        check_size(&path, &exr_info(&path)?, &self.manifest)?;
        let maps = read_exr_rows(&path, Some(&["Y"]), None)?;
        Ok(Some(maps.channels[0].1.iter().map(|&v| v > 0.5).collect()))
    }

    /// `truth/front.exr` of a synthetic scan.
    pub fn truth(&self, side: Side) -> Result<Option<ChannelMaps>> {
        let path = crate::truth_path(&self.folder, side);
        if !path.exists() {
            return Ok(None);
        }
        check_size(&path, &exr_info(&path)?, &self.manifest)?;
        read_exr(&path).map(Some)
    }
}

/// A frame must hold R, G and B at the size the manifest states.
fn check_image(path: &Path, manifest: &TubeManifest) -> Result<()> {
    let info = exr_info(path)?;
    check_size(path, &info, manifest)?;
    for name in RGB {
        if !info.channels.iter().any(|c| c == name) {
            return Err(Error::field(
                path,
                name,
                format!("no such channel; the file holds {}", info.channels.join(", ")),
            ));
        }
    }
    Ok(())
}

fn check_size(path: &Path, info: &ExrInfo, manifest: &TubeManifest) -> Result<()> {
    if (info.width, info.height) != (manifest.width, manifest.height) {
        return Err(Error::input(
            path,
            format!(
                "found {}x{} texels, capture.toml says {}x{}",
                info.width, info.height, manifest.width, manifest.height
            ),
        ));
    }
    Ok(())
}

/// RGB planes → one triple a texel.
pub fn interleave(maps: &ChannelMaps) -> FramePixels {
    let [r, g, b] = [0, 1, 2].map(|c: usize| &maps.channels[c].1);
    r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect()
}
