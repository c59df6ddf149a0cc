//! A capture opened for fitting: before anything long starts, every file that it needs was found and has the right
//! size.

use crate::calibration::FrameGain;
use crate::folder::{self, check_image, content_hash, read_rgb};
use crate::manifest::{TubeManifest, frame_path, mirror_path, white_path};
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::median_of;
use mesophyll_files::image::{ChannelMaps, read_exr_rows};
use mesophyll_files::quantity::RGB;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

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
pub type FrameBand = Vec<Vec<Rgb<f32>>>;

/// The colours of a whole image, row by row.
pub type FramePixels = Vec<Rgb<f32>>;

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
        wanted.par_iter().try_for_each(|path| check_image(path, &RGB, manifest.size()))?;
        let dark_path = folder.join("dark.exr");
        let dark = if dark_path.exists() {
            check_image(&dark_path, &RGB, manifest.size())?;
            Some(read_rgb(&dark_path)?)
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

    /// Content hash of everything that a fit reads.
    pub fn hash(&self) -> Result<String> {
        content_hash(&self.folder, &self.files())
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
                let mut out: Vec<Rgb<f32>> =
                    at.iter().map(|&(local, _)| Rgb::of(|c| maps.channels[c].1[local])).collect();
                if let Some(dark) = &self.dark {
                    for (value, &(_, global)) in out.iter_mut().zip(&at) {
                        *value -= dark[global];
                    }
                }
                if let Some(gain) = gain {
                    gain.divide(k, texels, &mut out);
                }
                Ok(out)
            })
            .collect()
    }

    /// Light-box photographs of one side, dark-corrected: (leaf, empty box), as colours of the whole image.
    pub fn lightbox(&self, side: Side) -> Result<(FramePixels, FramePixels)> {
        Ok((self.dark_corrected(&self.folder.join(side.name()).join("lightbox.exr"))?, self.lightbox_empty()?))
    }

    /// The light box without a leaf, dark-corrected.
    pub fn lightbox_empty(&self) -> Result<FramePixels> {
        self.dark_corrected(&self.folder.join("lightbox_empty.exr"))
    }

    fn dark_corrected(&self, path: &Path) -> Result<FramePixels> {
        let mut image = read_rgb(path)?;
        if let Some(dark) = &self.dark {
            image.iter_mut().zip(dark).for_each(|(v, d)| *v -= *d);
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
    pub fn gain(&self, texels: &[[u32; 2]]) -> Vec<Rgb> {
        let passes: Vec<Vec<Rgb<f32>>> = self.gains.iter().map(|(_, g)| g.mean(texels)).collect();
        if passes.is_empty() {
            return vec![Rgb::splat(1.0); texels.len()];
        }
        let median = self.median_gain();
        let known = |gain: f64| if gain.is_finite() && gain > 0.0 { gain } else { median };
        let mean = |n: usize, c: usize| passes.iter().map(|p| f64::from(p[n][c])).sum::<f64>() / passes.len() as f64;
        (0..texels.len()).map(|n| Rgb::of(|c| known(mean(n, c)))).collect()
    }

    /// Camera value of the calibrated value 1 in frame `k` of a pass at each of `texels`; `None` where the pass has no
    /// white frames.
    pub fn gain_of_frame(&self, travel: Travel, k: usize, texels: &[[u32; 2]]) -> Option<Vec<Rgb<f32>>> {
        self.gains.iter().find(|(t, _)| *t == travel).map(|(_, gain)| gain.at(k, texels))
    }

    /// The dark level a texel, where `dark.exr` exists.
    pub fn dark(&self) -> Option<&[Rgb<f32>]> {
        self.dark.as_deref()
    }

    /// The dark level of a texel (column, row); 0 where it is not known.
    pub fn dark_at(&self, [column, row]: [u32; 2]) -> Rgb {
        let level = self.dark.as_ref().map(|dark| dark[row as usize * self.manifest.width + column as usize]);
        level.map_or(Rgb::default(), |v| v.map(|v| if v.is_finite() { f64::from(v) } else { 0.0 }))
    }

    /// `mask.exr` (channel Y), where there is one.
    pub fn mask(&self) -> Result<Option<Vec<bool>>> {
        folder::mask(&self.folder, self.manifest.size())
    }

    /// `truth/front.exr` of a synthetic scan.
    pub fn truth(&self, side: Side) -> Result<Option<ChannelMaps>> {
        folder::truth(&self.folder, side, self.manifest.size())
    }
}
