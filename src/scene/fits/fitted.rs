//! A fit folder as the scene reads it: shared parameters from `fit.toml`, maps on demand, content hashes.
//!
//! σa and σs in 1/mm, thickness in mm. Every read goes through the ledger. Texels the fit could not determine (and
//! those beside the blade) take the mean of their neighbours, ring by ring, so that filtering at the outline never
//! mixes in what is not leaf.

use crate::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_files::hash;
use mesophyll_files::image::{self, ExrInfo, Maps};
use mesophyll_optics::side::Side;
use mesophyll_record::{FitRecord, Section};
use std::path::{Path, PathBuf};

/// An opened fit folder; maps are read only when asked for.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The leaf's name in the scene.
    pub name: String,
    pub folder: PathBuf,
    pub record: FitRecord,
}

impl Fitted {
    /// Opens `folder` and reads its `fit.toml`.
    ///
    /// # Errors
    /// [`Error::Input`] when there is no fit, or it is not a leaf's.
    pub fn open(name: &str, folder: &Path) -> Result<Fitted> {
        Fitted::open_as(name, folder, "leaf")
    }

    /// Opens a folder of another kind of fit.
    pub fn open_as(name: &str, folder: &Path, kind: &str) -> Result<Fitted> {
        let file = folder.join("fit.toml");
        if !file.is_file() {
            return Err(Error::input(
                folder,
                format!("no fit of {kind} \"{name}\" here (no fit.toml); `mesophyll fit {kind}` writes one"),
            ));
        }
        let record = FitRecord::read(folder)?;
        if record.kind != kind {
            return Err(Error::field(&file, "kind", format!("found \"{}\", expected \"{kind}\"", record.kind)));
        }
        Ok(Fitted { name: name.into(), folder: folder.into(), record })
    }

    pub fn has(&self, side: Side) -> bool {
        self.record.sections.contains_key(side.name())
    }

    pub fn section(&self, side: Side) -> Result<&Section> {
        self.record.sections.get(side.name()).ok_or_else(|| {
            Error::field(&self.folder.join("fit.toml"), side.name(), "missing; the scene needs this side of the leaf")
        })
    }

    /// A shared parameter, one number a channel.
    pub fn rgb(&self, side: Side, name: &str) -> Result<[f64; 3]> {
        let values = self.param(side, name)?;
        match values {
            [r, g, b] if values.iter().all(|v| v.is_finite() && *v >= 0.0) => Ok([*r, *g, *b]),
            _ => Err(self.bad(side, name, &format!("found {values:?}, expected three finite numbers of at least 0"))),
        }
    }

    /// Mean thickness h (mm).
    pub fn thickness(&self, side: Side) -> Result<f64> {
        match self.param(side, "thickness")? {
            [h] if *h > 0.0 && h.is_finite() => Ok(*h),
            other => Err(self.bad(side, "thickness", &format!("found {other:?}, expected one positive length in mm"))),
        }
    }

    fn param(&self, side: Side, name: &str) -> Result<&[f64]> {
        self.section(side)?.params.get(name).map(|p| p.value.as_slice()).ok_or_else(|| self.bad(side, name, "missing"))
    }

    fn bad(&self, side: Side, name: &str, what: &str) -> Error {
        Error::field(&self.folder.join("fit.toml"), &format!("{}.{name}", side.name()), what)
    }

    /// Reads some channels of one of the folder's maps.
    pub fn maps(&self, file: &str, channels: &[&str], ledger: &Ledger) -> Result<Maps> {
        let path = self.folder.join(file);
        ledger
            .note("read", self.entry(file), self.file_bytes(file), || image::read_exr_rows(&path, Some(channels), None))
    }

    /// Size and channels of one of the folder's maps.
    pub fn info(&self, file: &str) -> Result<ExrInfo> {
        image::exr_info(&self.folder.join(file))
    }

    pub fn file_bytes(&self, file: &str) -> u64 {
        std::fs::metadata(self.folder.join(file)).map_or(0, |m| m.len())
    }

    /// The size of a leaf's maps, where `size` is that of one of them and `leaf` is what is known so far (zeros where
    /// nothing is).
    ///
    /// # Errors
    /// [`Error::Input`] naming the file where they differ.
    pub fn same_size(&self, leaf: [usize; 2], size: [usize; 2], file: &str) -> Result<[usize; 2]> {
        if leaf != [0, 0] && leaf != size {
            let what = format!(
                "found {}x{} texels, expected {}x{} as of the leaf's other maps",
                size[0], size[1], leaf[0], leaf[1]
            );
            return Err(Error::input(&self.folder.join(file), what));
        }
        Ok(size)
    }

    pub fn entry(&self, file: &str) -> String {
        format!("{}/{file}", self.name)
    }

    /// Hashes these files afresh and compares them with what the fit wrote down.
    ///
    /// # Errors
    /// [`Error::Missed`] for a file that changed since, or that `fit.toml` does not list.
    pub fn verify<'a>(&self, files: impl IntoIterator<Item = &'a str>, ledger: &Ledger) -> Result<()> {
        for file in files {
            let path = self.folder.join(file);
            let Some(expected) = self.record.files.get(file) else {
                return Err(Error::Missed(format!("{}: fit.toml lists no content hash for it", path.display())));
            };
            let found = ledger.note("hash", self.entry(file), self.file_bytes(file), || hash::file(&path))?;
            if &found != expected {
                return Err(Error::Missed(format!(
                    "{}: changed since it was fitted (its content hash is not the one in fit.toml)",
                    path.display()
                )));
            }
        }
        Ok(())
    }
}

/// Gives every texel where `good` does not hold the mean of its good neighbours, ring by ring outward, in every plane
/// alike.
///
/// # Errors
/// [`Error::Input`] when no texel at all is good.
pub fn fill(
    path: &Path,
    width: usize,
    height: usize,
    planes: &mut [Vec<f32>],
    good: impl Fn(usize) -> bool,
) -> Result<()> {
    let n = width * height;
    let mut ring = vec![u32::MAX; n];
    let mut frontier: Vec<usize> = (0..n).filter(|&k| good(k)).collect();
    if frontier.is_empty() {
        return Err(Error::input(path, "no good texel at all"));
    }
    for &k in &frontier {
        ring[k] = 0;
    }
    let neighbours = |k: usize| {
        let (i, j) = ((k % width) as isize, (k / width) as isize);
        (-1..=1isize).flat_map(move |dj| (-1..=1isize).map(move |di| (i + di, j + dj))).filter_map(move |(i, j)| {
            let inside = i >= 0 && j >= 0 && i < width as isize && j < height as isize;
            inside.then(|| j as usize * width + i as usize)
        })
    };
    let mut level = 0;
    while !frontier.is_empty() {
        level += 1;
        let mut next = Vec::new();
        for &k in &frontier {
            for near in neighbours(k) {
                if ring[near] == u32::MAX {
                    ring[near] = level;
                    next.push(near);
                }
            }
        }
        for &k in &next {
            let sources: Vec<usize> = neighbours(k).filter(|&s| ring[s] < level).collect();
            for plane in planes.iter_mut() {
                plane[k] = sources.iter().map(|&s| plane[s]).sum::<f32>() / sources.len() as f32;
            }
        }
        frontier = next;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filling_keeps_good_texels_and_leaves_no_hole() {
        let (w, h) = (7, 5);
        let mut plane: Vec<f32> = (0..w * h).map(|k| k as f32).collect();
        let good = |k: usize| k == 8 || k == 9;
        for k in (0..w * h).filter(|k| !good(*k)) {
            plane[k] = f32::NAN;
        }
        let mut planes = [plane];
        fill(Path::new("a.exr"), w, h, &mut planes, good).unwrap();
        assert_eq!((planes[0][8], planes[0][9]), (8.0, 9.0));
        assert_eq!((planes[0][7], planes[0][10], planes[0][1]), (8.0, 9.0, 8.5));
        assert!(planes[0].iter().all(|v| (8.0..=9.0).contains(v)));
        assert!(fill(Path::new("a.exr"), w, h, &mut planes, |_| false).is_err());
    }
}
