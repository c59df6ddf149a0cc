//! Golden pictures: small pictures that the renderer drew of every view of a scene, committed beside the scene files. A
//! check takes its truth from the fit, so a fit that is wrong but consistent, and hashed again, passes it. Compared
//! with its golden, it draws a different picture.
//!
//! The limits follow from how far two adapters may differ, not from the effect of a changed fit. On Mesa's software
//! adapter, Vulkan stores maps in 32 bits and OpenGL in 16, as many GPUs do. Between the two, the committed scenes
//! differ by a mean FLIP of at most 4.0e-4, and 1.3e-4 of the pixels (leaves of the tree) are more than [`STEPS`] off.
//! An NVIDIA H200 differs from the goldens by at most 6.4e-4, and in 7.3e-4 of the pixels. The limits are somewhat
//! higher. Eight bits are enough: a mean over thousands of pixels resolves far less than one step of one pixel. A
//! ground or a card of one colour, however, may as a whole be rounded to another step than in the golden, as by that
//! GPU. So where a value lies on the border of two steps, both are right ([`settled`]).

use mesophyll_base::error::{Error, Result};
use mesophyll_files::image;
use mesophyll_scene::manifest::{FitOrigin, LeafOrigin, SceneManifest, StatedLeaf};
use mesophyll_scene::verdict::GoldenFigures;
use mesophyll_transport::{comparison, tone};
use mesophyll_viewer::Picture;
use std::path::{Path, PathBuf};

/// Longer side of a golden picture in pixels. The software adapter draws one in a fraction of a second.
const LONGEST: u32 = 200;

/// A pixel has changed where a displayed value differs by more than this many of 255 steps, which is more than rounding
/// and 16-bit maps cause.
const STEPS: u8 = 4;

/// A displayed value that is no farther than this (in steps of 255) from the border of two steps may be rounded to
/// either. The last bit of a radiance in 16 bits, as multisampled pictures have it, moves a displayed value by up to
/// .046 steps; this is two of them.
const EITHER: f64 = 0.1;

/// A comparison with a golden.
pub struct GoldenComparison {
    /// How far the two are apart.
    pub figures: GoldenFigures,
    /// Eightfold difference about grey, RGB.
    pub difference: Vec<u8>,
}

/// Number of frames, and of texels along the longer side, of a scan that is made only for golden pictures.
const SMALL_SCAN: (usize, usize) = (24, 96);

/// Makes the scans of leaves that have no fit of their own small, so that scanning and fitting them takes seconds.
pub fn small_scans(manifest: &mut SceneManifest) {
    for leaf in &mut manifest.leaves {
        let LeafOrigin::Fitted(FitOrigin { fit: None, scan: Some(scan), .. }) = &mut leaf.origin else { continue };
        let (w, h) = scan.texels().unwrap_or((720, 540));
        let longest = w.max(h);
        let scaled = |n: usize| (n * SMALL_SCAN.1).div_ceil(longest);
        if longest > SMALL_SCAN.1 {
            scan.size = Some(format!("{}x{}", scaled(w), scaled(h)));
        }
        scan.frames = Some(scan.frames.unwrap_or(100).min(SMALL_SCAN.0));
    }
}

/// Whether the scene as it stands draws its goldens. Where leaves are scanned first, only a scene with [`small_scans`]
/// does.
pub fn applies(manifest: &SceneManifest) -> bool {
    !manifest.leaves.iter().filter_map(StatedLeaf::fit).any(|f| f.fit.is_none() && f.scan.is_some())
}

/// Columns and rows of a scene's golden pictures: the shape of its check's pictures.
pub fn size(manifest: &SceneManifest) -> (u32, u32) {
    let (w, h) = (manifest.check.width, manifest.check.height);
    let longest = w.max(h).max(1);
    let scaled = |n: u32| ((n * LONGEST + longest / 2) / longest).max(2);
    (scaled(w), scaled(h))
}

/// `golden/SCENE-VIEW.png` beside the scene file.
pub fn path(manifest: &SceneManifest, view: &str) -> PathBuf {
    manifest.resolve(Path::new("golden")).join(format!("{}-{view}.png", manifest.name))
}

/// Writes a golden.
///
/// # Errors
/// [`Error::Write`] where it cannot be written.
pub fn write(path: &Path, width: usize, height: usize, pixels: &[[u8; 4]]) -> Result<()> {
    let rgb: Vec<u8> = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    image::write_png(path, width, height, &rgb)
}

/// Compares a picture with the golden.
///
/// # Errors
/// [`Error::Input`] when the golden cannot be read or has another size.
pub fn compare(path: &Path, picture: &Picture, exposure: f64) -> Result<GoldenComparison> {
    let (w, h, golden) = image::read_png(path)?;
    let (width, height) = (picture.width as usize, picture.height as usize);
    if (w, h) != (width, height) {
        let what = format!(
            "found {w}x{h} pixels, expected {width}x{height}; `mesophyll check --goldens-only --update-golden` writes \
             it anew"
        );
        return Err(Error::input(path, what));
    }
    let pixels = &settled(picture, &golden, exposure)[..];
    let [flip_mean, _] = comparison::flip_figures(&comparison::flip_map(&golden, pixels, w, h));
    let changed = golden.iter().zip(pixels).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > STEPS)).count();
    let figures = GoldenFigures { flip_mean, changed: changed as f64 / (w * h) as f64 };
    Ok(GoldenComparison { figures, difference: comparison::difference_picture(&golden, pixels, 8.0) })
}

/// The picture in 8 bits, rounded as the golden is where both ways are right.
fn settled(picture: &Picture, golden: &[[u8; 4]], exposure: f64) -> Vec<[u8; 4]> {
    let mut pixels = picture.ldr.clone();
    for ((pixel, golden), radiance) in pixels.iter_mut().zip(golden).zip(&picture.hdr) {
        for c in 0..3 {
            let border = f64::from(pixel[c].max(golden[c])) - 0.5;
            let value = || 255.0 * tone::display(f64::from(radiance[c]), exposure);
            if pixel[c].abs_diff(golden[c]) == 1 && (value() - border).abs() <= EITHER {
                pixel[c] = golden[c];
            }
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture whose displayed values are `off` steps of 255 beside these pixels.
    fn picture(width: usize, height: usize, ldr: &[[u8; 4]], off: f64) -> Picture {
        // The radiance of a displayed value at exposure 1: `tone::display` backwards, by halving.
        let radiance = |v: f64| {
            let halved = |(low, high): (f64, f64), _| {
                let middle: f64 = 0.5 * (low + high);
                if tone::display(middle, 1.0) < v { (middle, high) } else { (low, middle) }
            };
            (0..200).fold((0.0, 1e4), halved).0 as f32
        };
        let table: Vec<f32> = (0..256).map(|v| radiance((f64::from(v) + off) / 255.0)).collect();
        let hdr = ldr.iter().map(|p| [0, 1, 2, 3].map(|c| table[usize::from(p[c])])).collect();
        Picture { width: width as u32, height: height as u32, hdr, ldr: ldr.to_vec() }
    }

    #[test]
    fn what_adapters_differ_by_passes_and_a_change_does_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("golden.png");
        let (w, h) = (200usize, 150usize);
        let drawn: Vec<[u8; 4]> = (0..w * h).map(|k| [(k % w) as u8, (k / w) as u8, 60, 255]).collect();
        write(&path, w, h, &drawn).unwrap();
        let figures = |pixels: &[[u8; 4]]| compare(&path, &picture(w, h, pixels, 0.0), 1.0).unwrap().figures;
        assert_eq!(figures(&drawn), GoldenFigures { flip_mean: 0.0, changed: 0.0 });
        // 116 pixels of 800 × 600 are on the other side of an edge. At this size the edges have the same length, and a
        // pixel's side is four times as large.
        let edges: Vec<[u8; 4]> =
            drawn.iter().enumerate().map(|(k, p)| if k % 1000 == 0 { [255, 255, 255, 255] } else { *p }).collect();
        assert!(figures(&edges).changed == 1e-3, "{:?}", figures(&edges));
        // Making everything a little brighter changes no single pixel enough, but it is a different picture.
        let brighter: Vec<[u8; 4]> = drawn.iter().map(|p| p.map(|v| v.saturating_add(3))).collect();
        let seen = figures(&brighter);
        assert!(seen.changed == 0.0 && seen.missed().is_some_and(|why| why.contains("mean FLIP")), "{seen:?}");
        let moved: Vec<[u8; 4]> = drawn
            .iter()
            .enumerate()
            .map(|(k, p)| if k % 50 == 0 { [p[0] ^ 64, p[1], p[2], 255] } else { *p })
            .collect();
        assert!(
            figures(&moved).missed().is_some_and(|why| why.contains("2.00 % of the pixels changed")),
            "{:?}",
            figures(&moved)
        );
        assert!(GoldenFigures { flip_mean: f64::NAN, changed: 0.0 }.missed().is_some());
        let error = compare(&path, &picture(h, w, &drawn, 0.0), 1.0).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("found 200x150 pixels, expected 150x200"), "{error}");
    }

    /// An even ground whose value lies on the border of two steps is right on either side of it, and wrong where it
    /// lies well within the other step, or two steps away.
    #[test]
    fn an_even_colour_may_be_rounded_to_either_side_of_a_border() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("golden.png");
        let (w, h) = (40, 30);
        let all = |p: [u8; 4]| vec![p; w * h];
        write(&path, w, h, &all([120, 130, 90, 255])).unwrap();
        let figures = |p: [u8; 4], off: f64| compare(&path, &picture(w, h, &all(p), off), 1.0).unwrap().figures;
        for (rounded, off) in [([121, 131, 91, 255], -0.45), ([119, 129, 89, 255], 0.45)] {
            assert_eq!(figures(rounded, off).missed(), None);
        }
        for (rounded, off) in [([121, 131, 91, 255], -0.35), ([119, 129, 89, 255], 0.35), ([122, 132, 92, 255], -0.45)]
        {
            let seen = figures(rounded, off);
            assert!(seen.missed().is_some(), "{rounded:?}: {seen:?}");
        }
    }
}
